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
#define CLIPPED INT_MIN                                 // mark of a point that must be clipped before snapping

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

inline bool is_thin(const View *view, int a, int b)
{
    return 3 * (a > b ? a : b) <= 2 * (int)view->scale.y;
}

/* Half-open in both directions: samples with u in [u0, u1) along the longer axis, and across it within half the
   width there, [v - r, v + r), measured along the shorter axis; at least a sample's share of a pixel. */
inline void draw_segment(
    volatile __global ulong *visible, const View *view, int4 a, int4 b, uint id, int phase)
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
    const int2 columns = (int2)(0, view->size.x), us = steep ? view->rows.xy : columns, vs = steep ? columns : view->rows.xy;
    const int v_size = vs.y - vs.x;
    const int samples = view->size.z, margin = max(a.w, b.w) / 2 * 3 + SUBPIXEL;
    if (du == 0 || b.x < us.x * SUBPIXEL || a.x >= us.y * SUBPIXEL
        || max(a.y, b.y) + margin < vs.x * SUBPIXEL || min(a.y, b.y) - margin >= vs.y * SUBPIXEL)
        return;

    /* Measured along the shorter axis a slanted strand is thicker, by up to sqrt(2); most are thin all the same. */
    const long least = (long)view->scale.y << FRACTION;
    const bool thin = is_thin(view, a.w, b.w);
    long r0 = least, r_step = 0;
    if (!thin) {
        const float slope = (float)(b.y - a.y) / du, tilt = sqrt(1.0f + slope * slope);
        r0 = (long)(a.w * tilt * 256.0f) << (FRACTION - 8);   // cut to whole sub-pixels thin strands would lose 1 %
        r_step = (((long)(b.w * tilt * 256.0f) << (FRACTION - 8)) - r0) / du;
    }
    const uint gap = (uint)(PIXEL - 2 * least);            // between the rows that a thin strand can cover

    const long v_step = ((long)(b.y - a.y) << FRACTION) / du, d_step = ((long)(b.z - a.z) << FRACTION) / du;
    const size_t u_stride = (steep ? view->size.x : 1) * samples, v_stride = (steep ? 1 : view->size.x) * samples;
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        const int ou = steep ? offset.y : offset.x, ov = steep ? offset.x : offset.y;
        const int begin = max(first_pixel(a.x, ou), us.x), end = min(first_pixel(b.x, ou), us.y);
        const int along = begin * SUBPIXEL + SUBPIXEL / 2 + ou - a.x;
        /* v counts from the sample of the first row, rounded up, so that v >> 32 is the first row at or beyond. */
        long v = ((long)(a.y - SUBPIXEL / 2 - ov - vs.x * SUBPIXEL) << FRACTION) + v_step * along + (PIXEL - 1);
        long r = r0 + r_step * along, d = ((long)a.z << FRACTION) + d_step * along;
        size_t at = (size_t)(begin - us.x) * u_stride + s;
        for (int u = begin; u < end; ++u) {
            if (thin) {                                    // [v - least, v + least) holds one row or none
                const long low = v - least;
                const uint row = (uint)(low >> 32);
                if ((uint)low >= gap && row < (uint)v_size)
                    put(visible, at + row * v_stride, (uint)(d >> FRACTION), id, phase);
            } else {
                const long half_width = max(r, least);
                const int low = max((int)((v - half_width) >> 32), 0), high = min((int)((v + half_width) >> 32), v_size);
                for (int row = low; row < high; ++row)
                    put(visible, at + row * v_stride, (uint)(d >> FRACTION), id, phase);
            }
            v += v_step * SUBPIXEL;
            r += r_step * SUBPIXEL;
            d += d_step * SUBPIXEL;
            at += u_stride;
        }
    }
}

#if LANES > 1
/* Thin segments that wait to be drawn side by side: their snapped ends, and ids. */
typedef struct {
    lanes_i ax, ay, az, bx, by, bz;
    uint id[LANES];
    int n;
} Thin;

/* floor(over · scale / by) for scale of 1 or 2^24 where the result and `by` are at most 2^30 and 2^24, by > 0: an estimate in
   float, what it leaves divided again, and one more or less. It is known modulo 2^32 that what is left is small. */
INLINED lanes_i divided(lanes_i over, int shift, lanes_i by)
{
    const lanes divisor = TO(lanes, by);
    lanes_i q = TO(lanes_i, TO(lanes, over) * (float)(1 << shift) / divisor);
    lanes_i rest = (over << shift) - q * by;
    const lanes_i more = TO(lanes_i, TO(lanes, rest) / divisor);
    q += more;
    rest -= more * by;
    q = rest < 0 ? q - 1 : q;
    rest = rest < 0 ? rest + by : rest;
    return rest >= by ? q + 1 : q;
}

/* What draw_segment does with a thin one, for LANES of them. */
INLINED void draw_thin(volatile __global ulong *visible, const View *view, Thin *these, int phase)
{
    for (int k = these->n; k < LANES; ++k)
        LANE_I(these->ax, k) = LANE_I(these->bx, k) = LANE_I(these->ay, k) = LANE_I(these->by, k) = 0;
    these->n = 0;
    const lanes_i dx = these->bx - these->ax, dy = these->by - these->ay;
    const lanes_i steep = (dx < 0 ? -dx : dx) < (dy < 0 ? -dy : dy);
    const lanes_i pu = steep ? these->ay : these->ax, qu = steep ? these->by : these->bx;
    const lanes_i pv = steep ? these->ax : these->ay, qv = steep ? these->bx : these->by, back = pu > qu;
    const lanes_i au = back ? qu : pu, bu = back ? pu : qu, av = back ? qv : pv, bv = back ? pv : qv;
    const lanes_i az = back ? these->bz : these->az, bz = back ? these->az : these->bz;
    const lanes_i left = steep ? I(view->rows.x) : I(0), right = steep ? I(view->rows.y) : I(view->size.x);
    const lanes_i top = steep ? I(0) : I(view->rows.x), bottom = steep ? I(view->size.x) : I(view->rows.y);
    const lanes_i lower = av < bv ? av : bv, upper = av < bv ? bv : av;
    const lanes_i there = (bu > au) & (bu >= left * SUBPIXEL) & (au < right * SUBPIXEL)
        & (upper + 2 * SUBPIXEL >= top * SUBPIXEL) & (lower - 2 * SUBPIXEL < bottom * SUBPIXEL);
    if (!any_lane(there))
        return;

    const lanes_i du = there ? bu - au : I(1), dv = bv - av, dz = bz - az, rise = dv < 0 ? -dv : dv, sink = dz < 0 ? -dz : dz;
    const lanes_i rate = divided(there ? rise : I(0), 24, du), whole = divided(sink, 0, du), part = divided(sink - whole * du, 24, du);
    const lanes_l sinking = (TO(lanes_l, whole) << FRACTION) + TO(lanes_l, part);
    const lanes_l v_step = TO(lanes_l, dv < 0 ? -rate : rate), d_step = TO(lanes_l, dz) < 0 ? -sinking : sinking;
    const long least = (long)view->scale.y << FRACTION;
    const uint gap = (uint)(PIXEL - 2 * least);            // between the rows that a thin strand can cover
    const int samples = view->size.z, row_of_samples = view->size.x * samples;
    const lanes_i u_stride = steep ? I(row_of_samples) : I(samples), v_stride = steep ? I(samples) : I(row_of_samples);
    const lanes_u rows = AS_U(bottom - top);
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        const lanes_i ou = steep ? I(offset.y) : I(offset.x), ov = steep ? I(offset.x) : I(offset.y);
        const lanes_i first = (au - SUBPIXEL / 2 - ou + SUBPIXEL - 1) >> 8, last = (bu - SUBPIXEL / 2 - ou + SUBPIXEL - 1) >> 8;
        lanes_i u = first > left ? first : left;
        const lanes_i end = there ? (last < right ? last : right) : I(0);
        const lanes_l along = TO(lanes_l, u * SUBPIXEL + SUBPIXEL / 2 + ou - au);
        lanes_l low = (TO(lanes_l, av - SUBPIXEL / 2 - ov - top * SUBPIXEL) << FRACTION) + v_step * along + (PIXEL - 1 - least);
        lanes_l d = (TO(lanes_l, az) << FRACTION) + d_step * along;
        lanes_i at = (u - left) * u_stride + s;
        for (; any_lane(there & (u < end)); ++u) {
            const lanes_u row = AS_U(TO(lanes_i, low >> 32)), beside = TO(lanes_u, low);
            const lanes_i on = (u < end) & there & (beside >= gap) & (row < rows), sample = at + AS_I(row) * v_stride;
            const lanes_i depth = TO(lanes_i, d >> FRACTION);
            for (uint bits = bits_of(on); bits; bits &= bits - 1) {
                const int k = __builtin_ctz(bits);
                put(visible, (uint)LANE_I(sample, k), LANE_I(depth, k), these->id[k], phase);
            }
            low += v_step * SUBPIXEL;
            d += d_step * SUBPIXEL;
            at += u_stride;
        }
    }
}
#endif

/* The rare segment that leaves the guard band or crosses the near plane. */
void draw_clipped(volatile __global ulong *visible, const View *view, float4 a, float4 b, float ha, float hb,
                  uint id, int phase)
{
    if (clip(&a, &b, &ha, &hb))
        draw_segment(visible, view, snap_clip(a, ha), snap_clip(b, hb), id, phase);
}

/* One work-item draws DRAWN strands, projecting each point once. */
__kernel void lines(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const uint *shifts,           // [strands] added to the number of a segment's first point,
    const uint first,                      // and this, to make its id
    const uint strands,
    const int phase,
    volatile __global ulong *visible)      // [rows, width, samples] depth << 32 | id
{
    WORK_ITEM(item);
#if LANES > 1
    Thin thin;
    thin.n = 0;
#endif
    const uint until = item * DRAWN + DRAWN < strands ? item * DRAWN + DRAWN : strands;
    for (uint strand = item * DRAWN; strand < until; ++strand) {
        const uint2 span = spans[strand];
        const uint first_id = first + shifts[strand] + span.x;
        float4 a, b;                       // clip space
        int4 sa, sb;                       // snapped; w = CLIPPED where it can't be
        float ha = 0.0f, hb;               // half a width in pixels at w = 1
        for (uint k = 0; k < span.y; ++k, a = b, sa = sb, ha = hb) {
            const float4 p = points[span.x + k];
            const uint id = first_id + k - 1;
            b = to_screen(&view, p);
            hb = 0.5f * p.w * view.scale.x;
            sb.w = CLIPPED;
            if (within_guard(b))
                sb = snap((float4)(b.xyz, min(hb, GUARD * b.w)) / b.w);
            if (!k)
                continue;
            if (sa.w == CLIPPED || sb.w == CLIPPED) {
                draw_clipped(visible, &view, a, b, ha, hb, id, phase);
                continue;
            }
#if LANES > 1
            if (is_thin(&view, sa.w, sb.w)) {
                const int n = thin.n++;
                LANE_I(thin.ax, n) = sa.x, LANE_I(thin.ay, n) = sa.y, LANE_I(thin.az, n) = sa.z;
                LANE_I(thin.bx, n) = sb.x, LANE_I(thin.by, n) = sb.y, LANE_I(thin.bz, n) = sb.z;
                thin.id[n] = id;
                if (thin.n == LANES)
                    draw_thin(visible, &view, &thin, phase);
                continue;
            }
#endif
            draw_segment(visible, &view, sa, sb, id, phase);
        }
    }
#if LANES > 1
    if (thin.n)
        draw_thin(visible, &view, &thin, phase);
#endif
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

/* `after`: depth that a sample's fragment must lie behind, if `facing`, which also leaves out what faces away. */
inline void draw_triangle(volatile __global ulong *visible, const View *view, int2 rows, int4 a, int4 b, int4 c, uint id,
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
    const int x0 = max((min(min(a.x, b.x), c.x) - furthest) >> 8, 0);
    const int y0 = max((min(min(a.y, b.y), c.y) - furthest) >> 8, rows.x);
    const int x1 = min((max(max(a.x, b.x), c.x) + furthest) >> 8, view->size.x - 1);
    const int y1 = min((max(max(a.y, b.y), c.y) + furthest) >> 8, rows.y - 1);
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
                    const size_t sample = ((size_t)(y - view->rows.x) * view->size.x + x) * samples + s;
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
void draw_triangle_clipped(volatile __global ulong *visible, const View *view, int2 rows, float4 a, float4 b, float4 c,
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
        draw_triangle(visible, view, rows, snap_clip(polygon[0], 0.0f), snap_clip(polygon[j], 0.0f),
                      snap_clip(polygon[j + 1], 0.0f), id, phase, facing, after);
}

/* One work-item draws what one band of the picture shows of one triangle of the body: a large one is no long job. */
__kernel void body(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const float4 *positions,      // [V]
    __global const uint4 *triangles,       // [n]
    const uint n,                          // triangles; work-items are n for each band
    const uint first,                      // added to the number of a triangle to make its id
    const int band,                        // rows of a band
    const int facing,                      // 1: only triangles that face the eye, behind `after`
    __global const uint *after,            // [rows, width, samples] depth, if facing
    const int phase,
    volatile __global ulong *visible)      // [rows, width, samples] depth << 32 | id
{
    WORK_ITEM(item);
    const uint t = item % n;
    const int top = view.rows.x + (int)(item / n) * band;
    const int2 rows = (int2)(top, min(top + band, view.rows.y));
    const uint4 v = triangles[t];
    const float4 a = to_screen(&view, positions[v.x]);
    const float4 b = to_screen(&view, positions[v.y]);
    const float4 c = to_screen(&view, positions[v.z]);
    if (within_guard(a) && within_guard(b) && within_guard(c))
        draw_triangle(visible, &view, rows, snap((float4)(a.xyz, 0.0f) / a.w), snap((float4)(b.xyz, 0.0f) / b.w),
                      snap((float4)(c.xyz, 0.0f) / c.w), BODY | (first + t), phase, facing, after);
    else
        for (int before = 0; before < (view.scale.z > 0.0f ? 2 : 1); ++before)
            draw_triangle_clipped(visible, &view, rows, a, b, c, BODY | (first + t), phase, facing, after, before);
}
