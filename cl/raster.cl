/*
 * Lines and triangles into one buffer of samples, each keeping its nearest (depth, id).
 *
 * Points are projected in float and snapped to 1/SUBPIXEL pixel and 1/DEPTH_ONE depth; from there on everything
 * is integers, and samples are taken with order-free minima, so the result is the same bits on every device and
 * for every order of strands.
 */
#include "clip.h"
#include "lanes.h"

#if INT64_ATOMICS
#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
#pragma OPENCL EXTENSION cl_khr_int64_extended_atomics : enable
#endif

#define FRACTION 24                                     // fixed-point bits below the sub-pixel in a walk
#define PIXEL ((long)SUBPIXEL << FRACTION)                // one pixel in a walk: 2^32

/* What put reads before its atomic: a race, but one that is meant. Where races are looked for (tools/oclgrind.py) it is
   an atomic that changes nothing, so that only others are reported. */
#if CHECKED && INT64_ATOMICS
#define PEEK(p) atom_max(p, 0ul)
#elif CHECKED
#define PEEK(p) atomic_max(p, 0u)
#else
#define PEEK(p) (*(p))
#endif

/* Offer (depth, id) to a sample. The plain read only spares the atomic where it could not win, and may be out of date:
   what it reads can only have become smaller since. With 64-bit atomics one minimum does it; without, phase 0 finds the
   depths and phase 1 the smallest id at each depth. Both leave the same bits: depth in the high word, id in the low. */
inline void put(volatile __global ulong *visible, size_t sample, uint depth, uint id, int phase)
{
#if INT64_ATOMICS
    const ulong key = ((ulong)depth << 32) | id;
    if (key < PEEK(&visible[sample]))
        atom_min(&visible[sample], key);
#else
    volatile __global uint *word = (volatile __global uint *)&visible[sample];
    if (phase == 0) {
        if (depth < PEEK(&word[1]) && atomic_min(&word[1], depth) > depth)
            atomic_max(&word[0], NOTHING);                 // an id from an earlier launch lies behind
    } else if (depth == PEEK(&word[1]) && id < PEEK(&word[0])) {
        atomic_min(&word[0], id);
    }
#endif
}

/* Pixels, reversed depth and half a width, already divided by w -> sub-pixels and depth steps. */
inline int4 snap(float4 q)
{
    const float4 steps = (float4)(SUBPIXEL, SUBPIXEL, DEPTH_ONE, SUBPIXEL);
    int4 s = convert_int4(floor(q * steps + 0.5f));
    s.z = DEPTH_ONE - s.z;
    return s;
}

/* c.z is e (reversed depth) and c.w is w; radius is half a width in pixels at w = 1. */
inline int4 snap_clip(float4 c, float radius)
{
    return snap((float4)(c.x, c.y, min(max(c.z, 0.0f), c.w), min(radius, GUARD * c.w)) / c.w);
}

/* First pixel whose sample at `offset` lies at or beyond the place u, in sub-pixels. */
inline int first_pixel(int u, int offset)
{
    return (u - SUBPIXEL / 2 - offset + SUBPIXEL - 1) >> 8;
}

/* Pixels of all that is drawn: from left, to right, from top, to bottom. */
inline int4 all_of(const View *view)
{
    return (int4)(view->rows.z, view->rows.z + view->size.x, view->rows.x, view->rows.y);
}

/* The same of one of the windows, `side` pixels across and down, that all of it is cut into. */
inline int4 window_of(const View *view, int number, int side)
{
    const int across = (view->size.x + side - 1) / side;
    const int x = view->rows.z + number % across * side, y = view->rows.x + number / across * side;
    return (int4)(x, min(x + side, view->rows.z + view->size.x), y, min(y + side, view->rows.y));
}

/* Half-open in both directions: samples with u in [u0, u1) along the longer axis, and across it within half the
   width there, [v - r, v + r), measured along the shorter axis; at least a sample's share of a pixel.  Those of a window,
   see `all_of`; -> whether it was drawn: not if that would take more than `steps` of loops. */
ONCE bool draw_segment(
    volatile __global ulong *visible, const View *view, int4 window, int4 a, int4 b, uint id, int phase, uint *steps)
{
    const bool steep = abs(b.x - a.x) < abs(b.y - a.y);
    if (steep) {
        a = a.yxzw;
        b = b.yxzw;
    }
    if (a.x > b.x) {
        const int4 t = a; a = b; b = t;
    }
    const int du = b.x - a.x;
    const int2 us = steep ? window.zw : window.xy, vs = steep ? window.xy : window.zw;
    const int v_size = vs.y - vs.x;
    const int samples = view->size.z, margin = max(a.w, b.w) / 2 * 3 + SUBPIXEL;
    if (du == 0 || b.x < us.x * SUBPIXEL || a.x >= us.y * SUBPIXEL
        || max(a.y, b.y) + margin < vs.x * SUBPIXEL || min(a.y, b.y) - margin >= vs.y * SUBPIXEL)
        return true;
#if LANES == 1
    const int across = min(b.x >> 8, us.y) - max(a.x >> 8, us.x) + 2;
    const int high = min(max(3 * max(a.w, b.w), 2 * (int)view->scale.y) / SUBPIXEL + 2, v_size);
    const ulong taken = samples * (2 + (ulong)across * (2 + high));
    if (taken > *steps)
        return false;
    *steps -= (uint)taken;
#endif

    /* Measured along the shorter axis a slanted strand is thicker, by up to sqrt(2); most are thin all the same. */
    const long least = (long)view->scale.y << FRACTION;
    long r0 = least, r_step = 0;
    if (3 * max(a.w, b.w) > 2 * (int)view->scale.y) {
        const float slope = (float)(b.y - a.y) / du, tilt = sqrt(1.0f + slope * slope);
        r0 = (long)(a.w * tilt * 256.0f) << (FRACTION - 8);   // cut to whole sub-pixels thin strands would lose 1 %
        r_step = (((long)(b.w * tilt * 256.0f) << (FRACTION - 8)) - r0) / du;
    }
    const long v_step = ((long)(b.y - a.y) << FRACTION) / du, d_step = ((long)(b.z - a.z) << FRACTION) / du;
    const size_t u_stride = (steep ? view->size.x : 1) * samples, v_stride = (steep ? 1 : view->size.x) * samples;
    const int left = window.x - view->rows.z, top = window.z - view->rows.x;   // of its first pixel, among those there
    const size_t first = ((size_t)top * view->size.x + left) * samples;
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        const int ou = steep ? offset.y : offset.x, ov = steep ? offset.x : offset.y;
        const int begin = max(first_pixel(a.x, ou), us.x), end = min(first_pixel(b.x, ou), us.y);
        const int along = begin * SUBPIXEL + SUBPIXEL / 2 + ou - a.x;
        /* v counts from the sample of the first row, rounded up, so that v >> 32 is the first row at or beyond. */
        long v = ((long)(a.y - SUBPIXEL / 2 - ov - vs.x * SUBPIXEL) << FRACTION) + v_step * along + (PIXEL - 1);
        long r = r0 + r_step * along, d = ((long)a.z << FRACTION) + d_step * along;
        size_t at = first + (size_t)(begin - us.x) * u_stride + s;
        for (int u = begin; u < end; ++u) {
            const long half_width = max(r, least);
            const int low = max((int)((v - half_width) >> 32), 0), high = min((int)((v + half_width) >> 32), v_size);
            for (int row = low; row < high; ++row)
                put(visible, at + row * v_stride, (uint)(d >> FRACTION), id, phase);
            v += v_step * SUBPIXEL;
            r += r_step * SUBPIXEL;
            d += d_step * SUBPIXEL;
            at += u_stride;
        }
    }
    return true;
}

/* See `within_guard`. */
INLINED lanes_i within_guard_lanes(lanes4 c)
{
    const lanes most = GUARD * c.w;
    return (c.w > 0.0f) & (c.z >= 0.0f) & (c.z <= c.w) & (c.x <= most) & (c.x >= -most) & (c.y <= most) & (c.y >= -most);
}

/* The whole number nearest to x, as `snap` has it. */
INLINED lanes_i snapped(lanes x)
{
    const lanes moved = x + 0.5f;
    const lanes_i whole = TO(lanes_i, moved);
    return TO(lanes, whole) > moved ? whole - 1 : whole;
}

/* Snapped ends of segments, or corners of triangles. */
typedef struct {
    lanes_i x, y, z;
} Corners;

INLINED Corners snap_lanes(lanes4 c, lanes_i in)
{
    const lanes w = in ? c.w : F(1.0f);
    const Corners s = {snapped((in ? c.x : F(0.0f)) / w * (float)SUBPIXEL), snapped((in ? c.y : F(0.0f)) / w * (float)SUBPIXEL),
                       DEPTH_ONE - snapped((in ? c.z : F(0.0f)) / w * (float)DEPTH_ONE)};
    return s;
}

/* floor(over · scale / by) for scale of 1, 2^16 or 2^24 where the result and `by` are at most 2^30 and 2^24, by > 0: an
   estimate in float, what it leaves divided again, and one more or less. It is known modulo 2^32 that what is left is small. */
INLINED lanes_i divided(lanes_i over, int shift, lanes_i by)
{
    const lanes divisor = TO(lanes, by);
    lanes_i q = TO(lanes_i, TO(lanes, over) * (float)(1 << shift) / divisor);
    lanes_i rest = AS_I((AS_U(over) << shift) - AS_U(q) * AS_U(by));
    const lanes_i more = TO(lanes_i, TO(lanes, rest) / divisor);
    q += more;
    rest -= more * by;
    q = rest < 0 ? q - 1 : q;
    rest = rest < 0 ? rest + by : rest;
    return rest >= by ? q + 1 : q;
}

#define NARROW 90   // half a width [sub-pixels] up to which a segment, slanted by 45 degrees, is no more than a pixel across

/* What draw_segment does with those that cover one row of a column at most, for those of LANES that are on; half widths wa
   and wb [sub-pixels]. */
ONCE void draw_narrow(volatile __global ulong *visible, const View *view, lanes_i on, Corners a, Corners b, lanes_i wa,
                      lanes_i wb, const uint *id, int phase)
{
    const lanes_i dx = b.x - a.x, dy = b.y - a.y;
    const lanes_i steep = (dx < 0 ? -dx : dx) < (dy < 0 ? -dy : dy);
    const lanes_i pu = steep ? a.y : a.x, qu = steep ? b.y : b.x, pv = steep ? a.x : a.y, qv = steep ? b.x : b.y;
    const lanes_i back = pu > qu;
    const lanes_i au = back ? qu : pu, bu = back ? pu : qu, av = back ? qv : pv, bv = back ? pv : qv;
    const lanes_i az = back ? b.z : a.z, bz = back ? a.z : b.z, aw = back ? wb : wa, bw = back ? wa : wb;
    const int4 window = all_of(view);
    const lanes_i left = steep ? I(window.z) : I(window.x), right = steep ? I(window.w) : I(window.y);
    const lanes_i top = steep ? I(window.x) : I(window.z), bottom = steep ? I(window.y) : I(window.w);
    const lanes_i lower = av < bv ? av : bv, upper = av < bv ? bv : av;
    const lanes_i there = on & (bu > au) & (bu >= left * SUBPIXEL) & (au < right * SUBPIXEL)
        & (upper + 2 * SUBPIXEL >= top * SUBPIXEL) & (lower - 2 * SUBPIXEL < bottom * SUBPIXEL);
    if (!any_lane(there))
        return;

    const lanes_i du = there ? bu - au : I(1), dv = bv - av, dz = bz - az, rise = dv < 0 ? -dv : dv, sink = dz < 0 ? -dz : dz;
    const lanes_i rate = divided(there ? rise : I(0), 24, du), whole = divided(sink, 0, du), part = divided(sink - whole * du, 24, du);
    const lanes_l sinking = (TO(lanes_l, whole) << FRACTION) + TO(lanes_l, part);
    const lanes_l v_step = TO(lanes_l, dv < 0 ? -rate : rate), d_step = TO(lanes_l, dz) < 0 ? -sinking : sinking;
    /* Half widths along the shorter axis: of thin ones the least. They fit 32 bits, and so do steps
       where there is more than one: a segment that is a sub-pixel long has one place. */
    const lanes slope = TO(lanes, dv) / TO(lanes, du), tilt = exact_root(1.0f + slope * slope);
    const lanes_i ra = TO(lanes_i, TO(lanes, aw) * tilt * 256.0f), rb = TO(lanes_i, TO(lanes, bw) * tilt * 256.0f);
    const lanes_i wide = 3 * (aw > bw ? aw : bw) > 2 * (int)view->scale.y, growth = wide ? rb - ra : I(0);
    const lanes_i widening = divided(there ? (growth < 0 ? -growth : growth) : I(0), FRACTION - 8, du);
    const lanes_u r_step = AS_U(growth < 0 ? -widening : widening), least = U((uint)view->scale.y << FRACTION);
    const lanes_u r0 = wide ? AS_U(ra) << (FRACTION - 8) : least;
    const bool grows = any_lane(growth != 0);
    const int samples = view->size.z, row_of_samples = view->size.x * samples;
    const lanes_i u_stride = steep ? I(row_of_samples) : I(samples), v_stride = steep ? I(samples) : I(row_of_samples);
    const lanes_u rows = AS_U(bottom - top);
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        const lanes_i ou = steep ? I(offset.y) : I(offset.x), ov = steep ? I(offset.x) : I(offset.y);
        const lanes_i first = (au - SUBPIXEL / 2 - ou + SUBPIXEL - 1) >> 8, last = (bu - SUBPIXEL / 2 - ou + SUBPIXEL - 1) >> 8;
        lanes_i u = first > left ? first : left;
        const lanes_i end = there ? (last < right ? last : right) : I(0);
        const lanes_i past = u * SUBPIXEL + SUBPIXEL / 2 + ou - au;
        const lanes_l along = TO(lanes_l, past);
        lanes_l v = (TO(lanes_l, av - SUBPIXEL / 2 - ov - top * SUBPIXEL) << FRACTION) + v_step * along + (PIXEL - 1);
        lanes_u r = r0 + r_step * AS_U(past), half_width = r > least ? r : least;
        lanes_l d = (TO(lanes_l, az) << FRACTION) + d_step * along;
        lanes_i at = (u - left) * u_stride + s;
        for (; any_lane(there & (u < end)); ++u) {
            const lanes_l low = v - TO(lanes_l, half_width);
            /* The row beyond is reached by those whose place in this one and width add up to a pixel. */
            const lanes_u row = AS_U(TO(lanes_i, low >> 32)), beside = TO(lanes_u, low), gap = 0u - 2u * half_width;
            const lanes_i hit = (u < end) & there & (beside >= gap) & (row < rows), sample = at + AS_I(row) * v_stride;
            const lanes_i depth = TO(lanes_i, d >> FRACTION);
            for (uint bits = bits_of(hit); bits; bits &= bits - 1) {
                const int k = first_of(bits);
                put(visible, (uint)LANE_I(sample, k), LANE_I(depth, k), id[k], phase);
            }
            v += v_step * SUBPIXEL;
            if (grows) {
                r += r_step * SUBPIXEL;
                half_width = r > least ? r : least;
            }
            d += d_step * SUBPIXEL;
            at += u_stride;
        }
    }
}

/* Draw the segment from a to b [world, width], see `draw_segment`. */
ONCE bool draw_alone(volatile __global ulong *visible, const View *view, int4 window, float4 a, float4 b, uint id,
                       int phase, uint *steps)
{
    float4 p = to_screen(view, a), q = to_screen(view, b);
    float ha = 0.5f * a.w * view->scale.x, hb = 0.5f * b.w * view->scale.x;
    if (within_guard(p) && within_guard(q))
        return draw_segment(visible, view, window, snap((float4)(p.xyz, min(ha, GUARD * p.w)) / p.w),
                            snap((float4)(q.xyz, min(hb, GUARD * q.w)) / q.w), id, phase, steps);
    return !clip(&p, &q, &ha, &hb)         // the rare one that leaves the guard band or crosses the near plane
        || draw_segment(visible, view, window, snap_clip(p, ha), snap_clip(q, hb), id, phase, steps);
}

/* Segments that wait to be drawn side by side. */
typedef struct {
    lanes3 a, b;
    lanes width_a, width_b;
    uint id[LANES];
    int n;
} Segments;

/* Segments that take too many steps of loops for one work-item. */
typedef struct {
    volatile __global uint *n;             // how many there are
    __global uint2 *list;                  // their first points, and their ids
    uint room;                             // how many can be listed
    uint steps;                            // that the work-item may take still
    uint point;                            // of the next segment
} Left;

INLINED lanes_i half_of(const View *view, lanes width, lanes4 c, lanes_i in)
{
    const lanes wide = 0.5f * width * view->scale.x, most = GUARD * c.w;
    return snapped((in ? lesser(wide, most) / c.w : F(0.0f)) * (float)SUBPIXEL);
}

INLINED void draw_waiting(volatile __global ulong *visible, const View *view, Segments *these, int phase, Left *left)
{
    lanes_i some;
    for (int k = 0; k < LANES; ++k)
        LANE_I(some, k) = k < these->n ? ON : 0;
    these->n = 0;
    lanes_i narrow = I(0);
#if LANES > 1
    const lanes4 ca = by_columns(view->to_screen, these->a.x, these->a.y, these->a.z);
    const lanes4 cb = by_columns(view->to_screen, these->b.x, these->b.y, these->b.z);
    const lanes_i in = some & within_guard_lanes(ca) & within_guard_lanes(cb);
    const lanes_i wa = half_of(view, these->width_a, ca, in), wb = half_of(view, these->width_b, cb, in);
    narrow = in & ((wa > wb ? wa : wb) <= NARROW);
    if (any_lane(narrow))
        draw_narrow(visible, view, narrow, snap_lanes(ca, in), snap_lanes(cb, in), wa, wb, these->id, phase);
#endif
    for (uint bits = bits_of(some & (narrow == 0)); bits; bits &= bits - 1) {
        const int k = first_of(bits);
        const float4 a = (float4)(LANE(these->a.x, k), LANE(these->a.y, k), LANE(these->a.z, k), LANE(these->width_a, k));
        const float4 b = (float4)(LANE(these->b.x, k), LANE(these->b.y, k), LANE(these->b.z, k), LANE(these->width_b, k));
        if (!draw_alone(visible, view, all_of(view), a, b, these->id[k], phase, &left->steps)) {
            const uint n = atomic_inc(left->n);
            if (n < left->room)
                left->list[n] = (uint2)(left->point, these->id[k]);
        }
    }
}

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

/* n·2^14 / area, exact but for the last bit, modulo 2^64. */
inline ulong gradient(long n, long area)
{
    const long whole = n / area, rest = n % area;
    return ((ulong)whole << 14) + (ulong)((rest << 14) / area);
}

/* Twice the area spanned by the edge p -> q and the point (x, y). */
inline long edge(int4 p, int4 q, int x, int y)
{
    return (long)(q.x - p.x) * (y - p.y) - (long)(q.y - p.y) * (x - p.x);
}

/* A sample on an edge belongs to one of the two triangles there: to the one to the right of it or below. */
inline long edge_bias(int4 p, int4 q)
{
    return q.y < p.y || (q.y == p.y && q.x > p.x) ? 0 : -1;
}

/* Samples of a window, see `all_of`.  `after`: depth that a sample's fragment must lie behind, if `facing`, which also leaves
   out what faces away. */
ONCE void draw_triangle(volatile __global ulong *visible, const View *view, int4 window, int4 a, int4 b, int4 c, uint id,
                          int phase, int facing, __global const uint *after)
{
    long area = edge(a, b, c.x, c.y);
    if (area == 0 || (facing && area > 0))                  // counter-clockwise is clockwise where y points down
        return;
    if (area < 0) {
        const int4 t = b; b = c; c = t;
        area = -area;
    }
    const int samples = view->size.z, furthest = SUBPIXEL / 2;   // no sample lies further from a pixel's centre
    const int x0 = max((min(min(a.x, b.x), c.x) - furthest) >> 8, window.x);
    const int y0 = max((min(min(a.y, b.y), c.y) - furthest) >> 8, window.z);
    const int x1 = min((max(max(a.x, b.x), c.x) + furthest) >> 8, window.y - 1);
    const int y1 = min((max(max(a.y, b.y), c.y) + furthest) >> 8, window.w - 1);
    if (x0 > x1 || y0 > y1)
        return;

    const long bias_c = edge_bias(a, b), bias_a = edge_bias(b, c), bias_b = edge_bias(c, a);
    const long db = b.z - a.z, dc = c.z - a.z;
    const ulong gx = gradient(db * (c.y - a.y) - dc * (b.y - a.y), area);
    const ulong gy = gradient(dc * (b.x - a.x) - db * (c.x - a.x), area);
    const int nearest = min(min(a.z, b.z), c.z), farthest = max(max(a.z, b.z), c.z);
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        for (int y = y0; y <= y1; ++y) {
            /* The three edges at the row's first sample; along the row they change by as much each pixel. */
            const int sx = x0 * SUBPIXEL + SUBPIXEL / 2 + offset.x, sy = y * SUBPIXEL + SUBPIXEL / 2 + offset.y;
            long ec = edge(a, b, sx, sy) + bias_c, ea = edge(b, c, sx, sy) + bias_a, eb = edge(c, a, sx, sy) + bias_b;
            ulong d = gx * (ulong)(long)(sx - a.x) + gy * (ulong)(long)(sy - a.y);
            for (int x = x0; x <= x1; ++x) {
                if ((ec | ea | eb) >= 0) {
                    const size_t sample = ((size_t)(y - view->rows.x) * view->size.x + (x - view->rows.z)) * samples + s;
                    const uint depth = (uint)clamp(a.z + ((long)d >> 14), (long)nearest, (long)farthest);
                    if (!facing || depth > after[sample])
                        put(visible, sample, depth, id, phase);
                }
                ec -= (long)(b.y - a.y) * SUBPIXEL;
                ea -= (long)(c.y - b.y) * SUBPIXEL;
                eb -= (long)(a.y - c.y) * SUBPIXEL;
                d += gx * SUBPIXEL;
            }
        }
    }
}

/* How far clip-space c lies inside plane i of what a light sees of casters before its near plane. */
inline float before_near(const View *view, float4 c, int i)
{
    return i == 0 ? c.z - c.w : i == 1 ? c.w - view->scale.z : inside(c, i);
}

/* The rare triangle that leaves the guard band or crosses the near plane: clip it to a polygon and fan that.
   `before`: of what lies before the near plane, which is drawn at it; of what lies behind it else. */
void draw_triangle_clipped(volatile __global ulong *visible, const View *view, int4 window, float4 a, float4 b, float4 c,
                           uint id, int phase, int facing, __global const uint *after, bool before)
{
    float4 polygon[9], next[9];
    int n = 3;
    polygon[0] = a;
    polygon[1] = b;
    polygon[2] = c;
    for (int i = 0; i < 6; ++i) {
        int m = 0;
        for (int j = 0; j < n; ++j) {
            const float4 p = polygon[j], q = polygon[j + 1 < n ? j + 1 : 0];
            const float dp = before ? before_near(view, p, i) : inside(p, i);
            const float dq = before ? before_near(view, q, i) : inside(q, i);
            if (dp >= 0.0f)
                next[m++] = p;
            if (dp >= 0.0f && dq < 0.0f)
                next[m++] = cut(p, dp, q, dq);
            else if (dp < 0.0f && dq >= 0.0f)
                next[m++] = cut(q, dq, p, dp);
        }
        n = m;
        for (int j = 0; j < n; ++j)
            polygon[j] = next[j];
    }
    for (int j = 0; j < n; ++j)
        if (!(polygon[j].w > 0.0f))
            return;
    for (int j = 1; j + 1 < n; ++j)
        draw_triangle(visible, view, window, snap_clip(polygon[0], 0.0f), snap_clip(polygon[j], 0.0f),
                      snap_clip(polygon[j + 1], 0.0f), id, phase, facing, after);
}

/* Draw a triangle [world] by itself: `whole` if it is not to be clipped. */
inline void draw_triangle_alone(volatile __global ulong *visible, const View *view, int4 window, float4 a, float4 b, float4 c,
                                bool whole, uint id, int phase, int facing, __global const uint *after)
{
    const float4 p = to_screen(view, a), q = to_screen(view, b), r = to_screen(view, c);
    if (whole)
        draw_triangle(visible, view, window, snap((float4)(p.xyz, 0.0f) / p.w), snap((float4)(q.xyz, 0.0f) / q.w),
                      snap((float4)(r.xyz, 0.0f) / r.w), id, phase, facing, after);
    else
        for (int before = 0; before < (view->scale.z > 0.0f ? 2 : 1); ++before)
            draw_triangle_clipped(visible, view, window, p, q, r, id, phase, facing, after, before);
}

INLINED lanes_i least_of(lanes_i a, lanes_i b, lanes_i c)
{
    const lanes_i d = a < b ? a : b;
    return d < c ? d : c;
}

INLINED lanes_i most_of(lanes_i a, lanes_i b, lanes_i c)
{
    const lanes_i d = a > b ? a : b;
    return d > c ? d : c;
}

/* A triangle's edge from p to q: twice the area with the point (x, y), less its bias. */
INLINED lanes_i edges(Corners p, Corners q, lanes_i x, lanes_i y)
{
    const lanes_i ours = (q.y < p.y) | ((q.y == p.y) & (q.x > p.x));
    return (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x) + (ours ? I(0) : I(-1));
}

/* The depths of a triangle, from the middle of the first pixel that it may touch. */
typedef struct {
    ulong gx, gy, start;
    long nearest, farthest, z;
    size_t at;                             // that pixel's first sample
} Plane;

inline Plane plane_of(int4 a, int4 b, int4 c, int x0, int y0)
{
    Plane plane;
    const long db = b.z - a.z, dc = c.z - a.z;
    const int area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    plane.gx = gradient(db * (c.y - a.y) - dc * (b.y - a.y), area);
    plane.gy = gradient(dc * (b.x - a.x) - db * (c.x - a.x), area);
    plane.start = plane.gx * (ulong)(long)(x0 * SUBPIXEL + SUBPIXEL / 2 - a.x)
        + plane.gy * (ulong)(long)(y0 * SUBPIXEL + SUBPIXEL / 2 - a.y);
    const int near = a.z < b.z ? a.z : b.z, far = a.z < b.z ? b.z : a.z;
    plane.nearest = near < c.z ? near : c.z;
    plane.farthest = far > c.z ? far : c.z;
    plane.z = a.z;
    return plane;
}

INLINED int4 corner(const Corners *of, int k)
{
    return (int4)(LANE_I(of->x, k), LANE_I(of->y, k), LANE_I(of->z, k), 0);
}

#define SMALL 32   // pixels across and down that a triangle may touch to be drawn side by side: its edges then fit 32 bits

/* Triangles, drawn side by side as draw_triangle draws them: LANES different ones, each from the first pixel that it may
   touch. Those of `there` are small. */
ONCE void draw_small(volatile __global ulong *visible, const View *view, int4 window, lanes_i there, Corners a, Corners b,
                        Corners c, uint first, int phase, int facing, __global const uint *after)
{
    const lanes_i turned = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x), swap = turned < 0;
    const Corners p = b, q = c;
    b.x = swap ? q.x : p.x, b.y = swap ? q.y : p.y, b.z = swap ? q.z : p.z;
    c.x = swap ? p.x : q.x, c.y = swap ? p.y : q.y, c.z = swap ? p.z : q.z;
    const int samples = view->size.z, furthest = SUBPIXEL / 2;
    lanes_i x0 = (least_of(a.x, b.x, c.x) - furthest) >> 8, y0 = (least_of(a.y, b.y, c.y) - furthest) >> 8;
    lanes_i x1 = (most_of(a.x, b.x, c.x) + furthest) >> 8, y1 = (most_of(a.y, b.y, c.y) + furthest) >> 8;
    x0 = x0 > window.x ? x0 : I(window.x);
    y0 = y0 > window.z ? y0 : I(window.z);
    x1 = x1 < window.y ? x1 : I(window.y - 1);
    y1 = y1 < window.w ? y1 : I(window.w - 1);
    there &= (x0 <= x1) & (y0 <= y1) & (turned != 0);
    if (facing)
        there &= swap;
    if (!any_lane(there))
        return;
    const int wide = most_lane(there ? x1 - x0 : I(0)), high = most_lane(there ? y1 - y0 : I(0));
    const lanes_i ec_x = (b.y - a.y) * SUBPIXEL, ea_x = (c.y - b.y) * SUBPIXEL, eb_x = (a.y - c.y) * SUBPIXEL;
    const lanes_i ec_y = (b.x - a.x) * SUBPIXEL, ea_y = (c.x - b.x) * SUBPIXEL, eb_y = (a.x - c.x) * SUBPIXEL;
    Plane planes[LANES];
    uint known = 0;                        // lanes of which there is one: many triangles hit no sample
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        const lanes_i sx = x0 * SUBPIXEL + (SUBPIXEL / 2 + offset.x), sy = y0 * SUBPIXEL + (SUBPIXEL / 2 + offset.y);
        lanes_i row_c = edges(a, b, sx, sy), row_a = edges(b, c, sx, sy), row_b = edges(c, a, sx, sy);
        for (int j = 0; j <= high; ++j) {
            const lanes_i in_row = there & (y0 + j <= y1);
            lanes_i ec = row_c, ea = row_a, eb = row_b;
            for (int i = 0; i <= wide; ++i) {
                const ulong across = (ulong)(long)(offset.x + i * SUBPIXEL), down = (ulong)(long)(offset.y + j * SUBPIXEL);
                const size_t from = ((size_t)j * view->size.x + i) * samples + s;
                for (uint bits = bits_of(in_row & ((ec | ea | eb) >= 0) & (x0 + i <= x1)); bits; bits &= bits - 1) {
                    const int k = first_of(bits);
                    if (!(known >> k & 1)) {
                        planes[k] = plane_of(corner(&a, k), corner(&b, k), corner(&c, k), LANE_I(x0, k), LANE_I(y0, k));
                        planes[k].at = ((size_t)(LANE_I(y0, k) - view->rows.x) * view->size.x
                                        + (LANE_I(x0, k) - view->rows.z)) * samples;
                        known |= 1u << k;
                    }
                    const Plane *plane = &planes[k];
                    const ulong d = plane->start + plane->gx * across + plane->gy * down;
                    const long here = plane->z + ((long)d >> 14);
                    const uint depth = (uint)(here < plane->nearest ? plane->nearest
                                              : here < plane->farthest ? here : plane->farthest);
                    const size_t sample = plane->at + from;
                    if (!facing || depth > after[sample])
                        put(visible, sample, depth, BODY | (first + k), phase);
                }
                ec -= ec_x;
                ea -= ea_x;
                eb -= eb_x;
            }
            row_c += ec_y;
            row_a += ea_y;
            row_b += eb_y;
        }
    }
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
