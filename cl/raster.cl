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
RARE __kernel void lines(
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
RARE __kernel void line_pieces(
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

/* One work-item draws what one band of the picture shows of one triangle of the body: a large one is no long job.  It may leave
   it.  Where LANES is 1. */
RARE __kernel void body(
    const ulong begin, const ulong end,    // work-items, see common.h: all triangles for each band
    const View view,
    __global const float4 *positions,      // [V]
    __global const uint4 *triangles,       // [n]
    const uint n,                          // triangles
    const uint first,                      // added to the number of a triangle to make its id
    const int band,                        // rows of a band
    const int facing,                      // 1: only triangles that face the eye, behind `after`
    __global const uint *after,            // [rows, width, samples] depth, if facing
    const int phase,
    const int side,                        // pixels across and down of a triangle that is drawn, at most; 0: any
    const uint room,                       // of those that are left: how many can be listed
    volatile __global uint *n_left,        // [1] how many there are
    __global uint2 *left,                  // [room] these, and whether they are whole
    volatile __global ulong *visible)      // [rows, width, samples] depth << 32 | id
{
#if LANES == 1
    WORK_ITEM(item);
    const uint t = item % n;
    const int top = view.rows.x + (int)(item / n) * band;
    const int4 window = (int4)(view.rows.z, view.rows.z + view.size.x, top, min(top + band, view.rows.y));
    const uint4 v = triangles[t];
    const float4 p = positions[v.x], q = positions[v.y], r = positions[v.z];
    const lanes4 ca = by_columns(view.to_screen, p.x, p.y, p.z), cb = by_columns(view.to_screen, q.x, q.y, q.z);
    const lanes4 cc = by_columns(view.to_screen, r.x, r.y, r.z);
    const int in = within_guard_lanes(ca) & within_guard_lanes(cb) & within_guard_lanes(cc);
    const Corners a = snap_lanes(ca, in), b = snap_lanes(cb, in), c = snap_lanes(cc, in);
    const int across = most_of(a.x, b.x, c.x) - least_of(a.x, b.x, c.x);
    const int down = most_of(a.y, b.y, c.y) - least_of(a.y, b.y, c.y);
    if (side && (!in || across / SUBPIXEL + 2 > side || down / SUBPIXEL + 2 > side)) {
        const uint number = atomic_inc(n_left);
        if (number < room)
            left[number] = (uint2)(t, in);
        return;
    }
    draw_triangle_alone(visible, &view, window, p, q, r, in, BODY | (first + t), phase, facing, after);
#endif
}

#if LANES > 1
/* Corners of LANES triangles on the screen. */
typedef struct {
    lanes4 a, b, c;
} OnScreen;

INLINED OnScreen on_screen(const View *view, __global const float4 *positions, __global const uint4 *triangles, const uint *ids)
{
    lanes3 a, b, c;
    for (int k = 0; k < LANES; ++k) {
        const uint4 t = triangles[ids[k]];
        put_lane(&a, k, positions[t.x]);
        put_lane(&b, k, positions[t.y]);
        put_lane(&c, k, positions[t.z]);
    }
    const OnScreen on = {by_columns(view->to_screen, a.x, a.y, a.z), by_columns(view->to_screen, b.x, b.y, b.z),
                         by_columns(view->to_screen, c.x, c.y, c.z)};
    return on;
}

INLINED lanes_i within_guard_all(const OnScreen *on)
{
    return within_guard_lanes(on->a) & within_guard_lanes(on->b) & within_guard_lanes(on->c);
}

/* Draw n triangles by their numbers, LANES at most; alone: see `draw_small`. */
ONCE void draw_some(volatile __global ulong *visible, const View *view, int4 window, bool alone,
                    __global const float4 *positions, __global const uint4 *triangles, uint *numbers, uint n, uint first,
                    int phase, int facing, __global const uint *after)
{
    for (uint k = n; k < LANES; ++k)
        numbers[k] = numbers[0];
    const OnScreen on = on_screen(view, positions, triangles, numbers);
    lanes_i some;
    uint ids[LANES];
    for (uint k = 0; k < LANES; ++k) {
        LANE_I(some, k) = k < n ? ON : 0;
        ids[k] = first + numbers[k];
    }
    const lanes_i in = some & within_guard_all(&on);
    const Corners a = snap_lanes(on.a, in), b = snap_lanes(on.b, in), c = snap_lanes(on.c, in);
    const lanes_i across = most_of(a.x, b.x, c.x) - least_of(a.x, b.x, c.x);
    const lanes_i down = most_of(a.y, b.y, c.y) - least_of(a.y, b.y, c.y);
    const lanes_i small = in & (across < (SMALL - 2) * SUBPIXEL) & (down < (SMALL - 2) * SUBPIXEL);
    if (any_lane(small))
        draw_small(visible, view, window, alone, small, a, b, c, ids, phase, facing, after);
    for (uint others = bits_of(some & (small == 0)); others; others &= others - 1) {
        const int k = first_of(others);
        const uint4 v = triangles[numbers[k]];
        draw_triangle_alone(visible, view, window, positions[v.x], positions[v.y], positions[v.z], LANE_I(in, k), BODY | ids[k],
                            phase, facing, after);
    }
}

typedef lanes_u Reaches __attribute__((aligned(4)));
#endif

#define LAST 0xFFFF                        // row, and all after it, in `reach`
#define FAR 1e5f                           // pixels beyond which a corner's row is not known well

/* One work-item tells which rows each of LANES triangles may touch; where LANES is more than 1. */
RARE __kernel void reach(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const float4 *positions,      // as of `body`
    __global const uint4 *triangles,
    const uint n,
    __global uint *reaches)                // [n and LANES - 1 more] the last << 16 | the first, none if that is less
{
#if LANES > 1
    WORK_ITEM(item);
    const float4 x = view.to_screen[0], y = view.to_screen[1], z = view.to_screen[2], one = view.to_screen[3];
    lanes3 p[3];
    for (uint k = 0; k < LANES; ++k) {
        const uint4 t = triangles[item * LANES + k < n ? item * LANES + k : n - 1];
        put_lane(&p[0], k, positions[t.x]);
        put_lane(&p[1], k, positions[t.y]);
        put_lane(&p[2], k, positions[t.z]);
    }
    lanes at[3], w[3];
    for (int i = 0; i < 3; ++i) {
        w[i] = x.w * p[i].x + y.w * p[i].y + z.w * p[i].z + one.w;
        at[i] = (x.y * p[i].x + y.y * p[i].y + z.y * p[i].z + one.y) / w[i];
    }
    const lanes least = lesser(lesser(at[0], at[1]), at[2]), most = greater(greater(at[0], at[1]), at[2]);
    const lanes_i in = (w[0] > 0.0f) & (w[1] > 0.0f) & (w[2] > 0.0f) & (least > -FAR) & (most < FAR);
    /* The next ones as well, as far as a sample lies from its pixel's middle. */
    const lanes_i above = TO(lanes_i, in ? least : F(0.0f)) - 1 - view.rows.x;
    const lanes_i under = TO(lanes_i, in ? most : F(0.0f)) + 1 - view.rows.x;
    const lanes_i none = in & (under < 0), low = (in & (above > 0)) ? above : I(0), top = low < LAST ? low : I(LAST);
    const lanes_i bottom = (in & (under < LAST)) ? under : I(LAST);
    *(__global Reaches *)&reaches[item * LANES] = none ? U(LAST) : AS_U(bottom << 16 | top);
#endif
}

/* One work-item draws what one band of the picture shows of the body, so that nothing else writes there, or all that is shown
   of some triangles; where LANES is more than 1. */
LARGE APART __kernel void bands(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const float4 *positions,      // as of `body`
    __global const uint4 *triangles,
    const uint n,
    const uint share,                      // triangles of a work-item; 0: all, and it draws a band
    __global const uint *reaches,          // as `reach` tells, if so
    const uint first,
    const int band,
    const int facing,
    __global const uint *after,
    const int phase,
    const int fresh,                       // 1: nothing has been drawn into the band; else what is there already stays
    volatile __global ulong *visible)
{
#if LANES > 1
    WORK_ITEM(item);
    const bool alone = !share;
    const int top = alone ? view.rows.x + (int)item * band : view.rows.x;
    const int bottom = alone ? min(top + band, view.rows.y) : view.rows.y;
    const int4 window = (int4)(view.rows.z, view.rows.z + view.size.x, top, bottom);
    const uint begins = min(top - view.rows.x, LAST), ends = bottom - 1 - view.rows.x;
    const uint from = item * share, until = alone || n - from < share ? n : from + share;
    const size_t row = (size_t)view.size.x * view.size.z;
    for (size_t i = (top - view.rows.x) * row; fresh && i < (bottom - view.rows.x) * row; ++i)
        ((__global ulong *)visible)[i] = ~0ul;
    uint waiting[2 * LANES], count = 0;
    for (uint t = from; t < until || count; t += LANES) {
        uint bits = t >= until ? 0 : until - t < LANES ? (1u << (until - t)) - 1 : ~0u >> (32 - LANES);
        if (alone && t < until) {
            const lanes_u reach = *(__global const Reaches *)&reaches[t];
            bits &= bits_of(((reach & 0xFFFF) <= ends) & (reach >> 16 >= begins));
        }
        for (; bits; bits &= bits - 1)
            waiting[count++] = t + first_of(bits);
        const uint some = count < LANES ? count : LANES;
        if (!some || (some < LANES && t + LANES < until))
            continue;
        draw_some(visible, &view, window, alone, positions, triangles, waiting, some, first, phase, facing, after);
        count -= some;
        for (uint k = 0; k < count; ++k)
            waiting[k] = waiting[LANES + k];
    }
#endif
}

/* One work-item draws what one window of the picture shows of one triangle that `body` has left. */
RARE __kernel void body_pieces(
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
