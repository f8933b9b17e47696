/*
 * Where what is seen was before: motion vectors on the screen, of the very same places on strands and triangles; and how far
 * anything goes there.  A place that has not moved, before a camera that has not, has gone exactly 0.
 */
#include "lanes.h"
#include "seen.h"
#include "light.h"

/* How far a place has gone on the screen, from p as a camera had it before to q as it has it now [pixels], x to the right and
   y down; infinite where it was not before the camera, or is not. */
inline float2 vector_of(float4 p, float4 q)
{
    return p.w > 0.0f && q.w > 0.0f ? q.xy / q.w - p.xy / p.w : (float2)(INFINITY);
}

/* The nearest of a pixel's samples, and which one it is. */
inline ulong nearest_of(__global const ulong *visible, size_t pixel, int samples, int *nearest)
{
    ulong key = ~0ul;
    *nearest = 0;
    for (int s = 0; s < samples; ++s)
        if (visible[pixel * samples + s] < key) {
            key = visible[pixel * samples + s];
            *nearest = s;
        }
    return key;
}

/* The place that a pixel's sample sees. */
inline float4 where_seen(const View *view, size_t pixel, int sample, uint depth)
{
    return seen_point(view, view->rows.z + (int)(pixel % view->size.x), view->rows.x + (int)(pixel / view->size.x), sample, depth);
}

/* Where on the screen a direction is, as to_screen has places. */
inline float4 endless(const View *view, float4 d)
{
    return (view->to_screen[0] * d.x + view->to_screen[1] * d.y) + view->to_screen[2] * d.z;
}

/* One work-item tells of one pixel that shows the ground, or nothing: what is endlessly far away turns with the camera. */
__kernel void still(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const View view_before,
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global float2 *vectors)              // [rows, width] pixels
{
    WORK_ITEM(pixel);
    int nearest;
    const ulong key = nearest_of(visible, pixel, view.size.z, &nearest);
    if ((uint)key == GROUND) {
        const float4 p = where_seen(&view, pixel, nearest, (uint)(key >> 32));
        vectors[pixel] = vector_of(to_screen(&view_before, p), to_screen(&view, p));
    } else if ((uint)key == NOTHING) {
        const float x = view.rows.z + (int)(pixel % view.size.x) + 0.5f, y = view.rows.x + (int)(pixel / view.size.x) + 0.5f;
        const float4 far = (view.to_world[0] * x + view.to_world[1] * y) + view.to_world[3];
        const float4 p = endless(&view_before, far), q = endless(&view, far);
        vectors[pixel] = vector_of(q.w < 0.0f ? -p : p, q.w < 0.0f ? -q : q);
    }
}

/* The segment of a strand that is nearest to a place: its first point. */
inline uint nearest_segment(__global const float4 *points, uint2 span, float4 p)
{
    uint best = span.x;
    float least = INFINITY;
    for (uint j = span.x; j + 1 < span.x + span.y; ++j) {
        const float4 a = points[j], b = points[j + 1], off = a + place_between(a, b, p) * (b - a) - p;
        const float square = dot3(off, off);
        if (square < least) {
            least = square;
            best = j;
        }
    }
    return best;
}

/* One work-item tells of one pixel that shows a strand or a triangle of this part of the scene. */
__kernel void moving(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const View view_before,
    const uint4 part,                      // first point's id, points, first triangle's id, triangles
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    const int thinned,                     // 1: the ids of points are of strands that have fewer
    __global const float4 *points,         // all points of strands, see strands.cl
    __global const uint2 *spans,
    __global const uint *shifts,
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global const float4 *points_before,  // the same strands, in another order it may be
    __global const uint *stored_before,
    const uint run_before,
    __global const float4 *positions,      // body: see tessellate.cl
    __global const float4 *positions_before,
    __global const uint4 *triangles,
    __global float2 *vectors)              // [rows, width] pixels
{
    WORK_ITEM(pixel);
    int nearest;
    const ulong key = nearest_of(visible, pixel, view.size.z, &nearest);
    const uint id = local_id(key, part);
    if (id == NOTHING)
        return;
    const float4 p = where_seen(&view, pixel, nearest, (uint)(key >> 32));
    float4 now, before;
    if ((uint)key & BODY) {
        const uint4 t = triangles[id];
        const float4 b = barycentric(positions[t.x], positions[t.y], positions[t.z], p);
        now = (b.x * positions[t.x] + b.y * positions[t.y]) + b.z * positions[t.z];
        before = (b.x * positions_before[t.x] + b.y * positions_before[t.y]) + b.z * positions_before[t.z];
    } else {
        const uint from = lies_at(stored, run, id), strand = strand_of[from / run];
        const uint j = thinned ? nearest_segment(points, spans[strand], p) : from;
        const uint k = lies_at(stored_before, run_before, j + shifts[strand]);
        const float at = place_between(points[j], points[j + 1], p);
        now = points[j] + at * (points[j + 1] - points[j]);
        before = points_before[k] + at * (points_before[k + 1] - points_before[k]);
    }
    vectors[pixel] = vector_of(to_screen(&view_before, before), to_screen(&view, now));
}

/* Where the plane of a face is nearest to a place, as weights of its corners, and how far above it the place is. */
inline float4 above_face(__global const float4 *corners, float4 weights, float height)
{
    const float4 n = unit_or(cross3(corners[1] - corners[0], corners[2] - corners[0]), (float4)(0.0f));
    return ((weights.x * corners[0] + weights.y * corners[1]) + weights.z * corners[2]) + height * n;
}

/* One work-item tells of one pixel that shows shell fur: it stands on its face as it did before. */
__kernel void of_shells(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const View view_before,
    const int samples,
    __global const ulong *shell_front,     // [rows, width, samples] depth << 32 | face, see march.cl
    __global const int *ids,               // [rows, width] ID_SHELLS where it is seen
    __global const float4 *corners,        // [faces, 3]
    __global const float4 *corners_before,
    __global float2 *vectors)              // [rows, width] pixels
{
    WORK_ITEM(pixel);
    if (ids[pixel] != ID_SHELLS)
        return;
    int nearest;
    const ulong key = nearest_of(shell_front, pixel, samples, &nearest);
    const float4 p = where_seen(&view, pixel, nearest, (uint)(key >> 32));
    const size_t first = 3 * (size_t)(uint)key;
    const float4 weights = barycentric(corners[first], corners[first + 1], corners[first + 2], p);
    const float4 n = unit_or(cross3(corners[first + 1] - corners[first], corners[first + 2] - corners[first]), (float4)(0.0f));
    const float height = dot3(p - corners[first], n);
    vectors[pixel] = vector_of(to_screen(&view_before, above_face(corners_before + first, weights, height)),
                               to_screen(&view, above_face(corners + first, weights, height)));
}

/* How far a point goes on the screen, from p to q [as to_screen has them]: 0 where its way does not come before the camera, or
   not so near to the picture as its own size; what begins or ends behind the near plane does so on it. */
inline float way_of(const View *view_before, const View *view, float4 p, float4 q)
{
    const float near_p = view_before->to_screen[3].z, near_q = view->to_screen[3].z;
    const float in_p = p.w - near_p, in_q = q.w - near_q;
    if (!(in_p > 0.0f || in_q > 0.0f))
        return 0.0f;
    if (!(in_p > 0.0f))
        p = q + (p - q) * (in_q / (in_q - in_p));
    else if (!(in_q > 0.0f))
        q = p + (q - p) * (in_p / (in_p - in_q));
    const float2 from = p.xy / p.w, to = q.xy / q.w, size = convert_float2(view->size.xy);
    if (!(p.w > 0.0f && q.w > 0.0f) || any(fmax(from, to) < -size) || any(fmin(from, to) > 2.0f * size))
        return 0.0f;
    const float2 way = to - from;
    return sqrt(way.x * way.x + way.y * way.y);
}

/* One work-item asks how far the points of one strand go. */
__kernel void of_strands(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const View view_before,
    __global const float4 *points,         // see strands.cl
    __global const uint2 *spans,
    __global const uint *shifts,
    __global const float4 *points_before,
    __global const uint *stored_before,
    const uint run_before,
    volatile __global uint *most)          // [1] bits of a float [pixels]
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    float farthest = 0.0f;
    for (uint j = span.x; j < span.x + span.y; ++j) {
        const float4 before = points_before[lies_at(stored_before, run_before, j + shifts[strand])];
        const float way = way_of(&view_before, &view, to_screen(&view_before, before), to_screen(&view, points[j]));
        farthest = way > farthest ? way : farthest;
    }
    atomic_max(most, as_uint(farthest));   // floats that are not negative are in the order of their bits
}

/* One work-item asks how far one corner of the body goes. */
__kernel void of_body(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const View view_before,
    __global const float4 *positions,
    __global const float4 *positions_before,
    volatile __global uint *most)          // [1] bits of a float [pixels]
{
    WORK_ITEM(i);
    atomic_max(most, as_uint(way_of(&view_before, &view, to_screen(&view_before, positions_before[i]),
                                    to_screen(&view, positions[i]))));
}
