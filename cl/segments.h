/* Segments drawn into samples: narrow ones side by side, others one by one.  raster.cl uses this, and samples.h before it. */
#define FRACTION 24                                     // fixed-point bits below the sub-pixel in a walk
#define PIXEL ((long)SUBPIXEL << FRACTION)                // one pixel in a walk: 2^32

/* First pixel whose sample at `offset` lies at or beyond the place u, in sub-pixels. */
inline int first_pixel(int u, int offset)
{
    return (u - SUBPIXEL / 2 - offset + SUBPIXEL - 1) >> 8;
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
