/*
 * Lines and triangles into one buffer of samples, each keeping its nearest (depth, id).
 *
 * Points are projected in float and snapped to 1/SUBPIXEL pixel and 1/DEPTH_ONE depth; from there on everything
 * is integers, and samples are taken with order-free minima, so the result is the same bits on every device and
 * for every order of strands.
 */
#include "clip.h"
#include "lanes.h"
#include "samples.h"
#include "segments.h"
#include "triangles.h"

/* One work-item draws DRAWN strands, LANES segments at once.  Where LANES is 1 it may leave some. */
__kernel void lines(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 stretch,                   // segments of each strand: the first, one past the last
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const uint *shifts,           // [strands] added to the number of a segment's first point,
    const uint first,                      // and this, to make its id
    const uint strands,
    const int phase,
    const uint steps,                      // of loops that one may take, about
    const uint room,                       // of those that it leaves: how many can be listed
    volatile __global uint *n_left,        // [1] how many there are
    __global uint2 *left,                  // [room] their first points, and their ids
    volatile __global ulong *visible)      // [rows, width, samples] depth << 32 | id
{
    WORK_ITEM(item);
    Segments waiting;
    waiting.n = 0;
    Left those = {n_left, left, room, steps, 0};
    const uint until = item * DRAWN + DRAWN < strands ? item * DRAWN + DRAWN : strands;
    for (uint strand = item * DRAWN; strand < until; ++strand) {
        const uint2 span = spans[strand];
        const uint first_id = first + shifts[strand] + span.x, last = span.y <= stretch.y ? span.y : stretch.y + 1;
        float4 a, b = span.y > stretch.x ? points[span.x + stretch.x] : (float4)(0.0f);
        for (uint k = stretch.x + 1; k < last; ++k) {
            a = b;
            b = points[span.x + k];
            const int n = waiting.n++;
            put_lane(&waiting.a, n, a);
            put_lane(&waiting.b, n, b);
            LANE(waiting.width_a, n) = a.w;
            LANE(waiting.width_b, n) = b.w;
            waiting.id[n] = first_id + k - 1;
#if LANES == 1
            those.point = span.x + k - 1;
#endif
            if (waiting.n == LANES)
                draw_waiting(visible, &view, &waiting, phase, &those);
        }
    }
    if (waiting.n)
        draw_waiting(visible, &view, &waiting, phase, &those);
}

/* One work-item draws what one window of the picture shows of one segment that `lines` has left. */
__kernel void line_pieces(
    const ulong begin, const ulong end,    // work-items, see common.h: all segments for each window
    const View view,
    __global const float4 *points,         // [P] x, y, z, width [world]
    const uint n,                          // segments
    __global const uint2 *left,            // [n] their first points, and their ids
    const int side,                        // pixels of a window
    const int phase,
    volatile __global ulong *visible)      // [rows, width, samples] depth << 32 | id
{
    WORK_ITEM(item);
    const uint2 one = left[item % n];
    uint all = ~0u;
    draw_alone(visible, &view, window_of(&view, item / n, side), points[one.x], points[one.x + 1], one.y, phase, &all);
}

/* One work-item draws what one band of the picture shows of LANES triangles of the body: a large one is no long job.  Where
   LANES is 1 it may leave its triangle. */
__kernel void body(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const float4 *positions,      // [V]
    __global const uint4 *triangles,       // [n]
    const uint n,                          // triangles; work-items are n / LANES, rounded up, for each band
    const uint first,                      // added to the number of a triangle to make its id
    const int band,                        // rows of a band
    const int facing,                      // 1: only triangles that face the eye, behind `after`
    __global const uint *after,            // [rows, width, samples] depth, if facing
    const int phase,
    const int side,                        // pixels across and down of a triangle that is drawn, at most
    const uint room,                       // of those that are left: how many can be listed
    volatile __global uint *n_left,        // [1] how many there are
    __global uint2 *left,                  // [room] these, and whether they are whole
    volatile __global ulong *visible)      // [rows, width, samples] depth << 32 | id
{
    WORK_ITEM(item);
    const uint groups = (n - 1) / LANES + 1, t = item % groups * LANES, count = n - t < LANES ? n - t : LANES;
    const int top = view.rows.x + (int)(item / groups) * band;
    const int4 window = (int4)(view.rows.z, view.rows.z + view.size.x, top, min(top + band, view.rows.y));
    lanes3 pa, pb, pc;
    lanes_i some;
    for (uint k = 0; k < LANES; ++k) {
        const uint4 v = triangles[k < count ? t + k : t];
        const float4 p = positions[v.x], q = positions[v.y], r = positions[v.z];
        LANE_I(some, k) = k < count ? ON : 0;
        LANE(pa.x, k) = p.x, LANE(pa.y, k) = p.y, LANE(pa.z, k) = p.z;
        LANE(pb.x, k) = q.x, LANE(pb.y, k) = q.y, LANE(pb.z, k) = q.z;
        LANE(pc.x, k) = r.x, LANE(pc.y, k) = r.y, LANE(pc.z, k) = r.z;
    }
    const lanes4 ca = by_columns(view.to_screen, pa.x, pa.y, pa.z), cb = by_columns(view.to_screen, pb.x, pb.y, pb.z);
    const lanes4 cc = by_columns(view.to_screen, pc.x, pc.y, pc.z);
    const lanes_i in = some & within_guard_lanes(ca) & within_guard_lanes(cb) & within_guard_lanes(cc);
    const Corners a = snap_lanes(ca, in), b = snap_lanes(cb, in), c = snap_lanes(cc, in);
    const lanes_i across = most_of(a.x, b.x, c.x) - least_of(a.x, b.x, c.x);
    const lanes_i down = most_of(a.y, b.y, c.y) - least_of(a.y, b.y, c.y);
#if LANES == 1
    const lanes_i small = 0;               // nothing stands beside it
    if (side && (!in || across / SUBPIXEL + 2 > side || down / SUBPIXEL + 2 > side)) {
        const uint number = atomic_inc(n_left);
        if (number < room)
            left[number] = (uint2)(t, in);
        return;
    }
#else
    const lanes_i small = in & (across < (SMALL - 2) * SUBPIXEL) & (down < (SMALL - 2) * SUBPIXEL);
    if (any_lane(small))
        draw_small(visible, &view, window, small, a, b, c, first + t, phase, facing, after);
#endif
    for (uint k = 0; k < count; ++k) {
        const uint4 v = triangles[t + k];
        if (!LANE_I(small, k))
            draw_triangle_alone(visible, &view, window, positions[v.x], positions[v.y], positions[v.z], LANE_I(in, k),
                                BODY | (first + t + k), phase, facing, after);
    }
}

/* One work-item draws what one window of the picture shows of one triangle that `body` has left. */
__kernel void body_pieces(
    const ulong begin, const ulong end,    // work-items, see common.h: all triangles for each window
    const View view,
    __global const float4 *positions,      // as of `body`
    __global const uint4 *triangles,
    const uint n,                          // triangles that are left
    __global const uint2 *left,            // [n] these, and whether they are whole
    const uint first,
    const int side,                        // pixels of a window
    const int facing,
    __global const uint *after,
    const int phase,
    volatile __global ulong *visible)      // [rows, width, samples] depth << 32 | id
{
    WORK_ITEM(item);
    const uint2 one = left[item % n];
    const uint4 v = triangles[one.x];
    draw_triangle_alone(visible, &view, window_of(&view, item / n, side), positions[v.x], positions[v.y], positions[v.z],
                        one.y, BODY | (first + one.x), phase, facing, after);
}
