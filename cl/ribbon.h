/*
 * Strands as ribbons that face the eye: which tiles a segment may show in, and how much of each pixel it covers.
 * coverage.cl uses this, and clip.h and lanes.h before it.  LANES segments of a strand go side by side, then one segment's
 * LANES columns; where LANES is 1 one segment and one pixel: the same expressions, and so the same bits.
 */
#define WHOLE(x) TO(lanes_i, x)
#define REAL(x) TO(lanes, x)
#if LANES == 1
#define ALIGNED
#else
#define ALIGNED __attribute__((aligned(32)))
#endif
#ifndef CHUNKS
#define CHUNKS                       // where chunks are
#endif
#define MARGIN 256                   // depth steps that rounding may put a piece before the nearer end of its segment
#define CLIPPED 0x80000000u          // of an id: the segment is clipped
#define WHOLE_WAY 0xFFFF0000u        // `cut` of a segment that is not clipped: from 0 to 65535 of its length

#include "outline.h"

#if LANES == 8
/* Eight rows of eight numbers -> its columns. */
INLINED void transposed(const float8 *r, float8 *m)
{
    const float8 a0 = (float8)(r[0].s0, r[1].s0, r[0].s1, r[1].s1, r[0].s4, r[1].s4, r[0].s5, r[1].s5);
    const float8 a1 = (float8)(r[0].s2, r[1].s2, r[0].s3, r[1].s3, r[0].s6, r[1].s6, r[0].s7, r[1].s7);
    const float8 a2 = (float8)(r[2].s0, r[3].s0, r[2].s1, r[3].s1, r[2].s4, r[3].s4, r[2].s5, r[3].s5);
    const float8 a3 = (float8)(r[2].s2, r[3].s2, r[2].s3, r[3].s3, r[2].s6, r[3].s6, r[2].s7, r[3].s7);
    const float8 a4 = (float8)(r[4].s0, r[5].s0, r[4].s1, r[5].s1, r[4].s4, r[5].s4, r[4].s5, r[5].s5);
    const float8 a5 = (float8)(r[4].s2, r[5].s2, r[4].s3, r[5].s3, r[4].s6, r[5].s6, r[4].s7, r[5].s7);
    const float8 a6 = (float8)(r[6].s0, r[7].s0, r[6].s1, r[7].s1, r[6].s4, r[7].s4, r[6].s5, r[7].s5);
    const float8 a7 = (float8)(r[6].s2, r[7].s2, r[6].s3, r[7].s3, r[6].s6, r[7].s6, r[6].s7, r[7].s7);
    const float8 b0 = (float8)(a0.s01, a2.s01, a0.s45, a2.s45), b1 = (float8)(a0.s23, a2.s23, a0.s67, a2.s67);
    const float8 b2 = (float8)(a1.s01, a3.s01, a1.s45, a3.s45), b3 = (float8)(a1.s23, a3.s23, a1.s67, a3.s67);
    const float8 b4 = (float8)(a4.s01, a6.s01, a4.s45, a6.s45), b5 = (float8)(a4.s23, a6.s23, a4.s67, a6.s67);
    const float8 b6 = (float8)(a5.s01, a7.s01, a5.s45, a7.s45), b7 = (float8)(a5.s23, a7.s23, a5.s67, a7.s67);
    m[0] = (float8)(b0.lo, b4.lo);
    m[1] = (float8)(b1.lo, b5.lo);
    m[2] = (float8)(b2.lo, b6.lo);
    m[3] = (float8)(b3.lo, b7.lo);
    m[4] = (float8)(b0.hi, b4.hi);
    m[5] = (float8)(b1.hi, b5.hi);
    m[6] = (float8)(b2.hi, b6.hi);
    m[7] = (float8)(b3.hi, b7.hi);
}
#endif

/* Two points of each of LANES segments, or ends on the screen: rows -> their eight numbers, and back. */
INLINED void columns_of(const float8 *rows, lanes *columns)
{
#if LANES == 1
    const float8 r = rows[0];
    columns[0] = r.s0;
    columns[1] = r.s1;
    columns[2] = r.s2;
    columns[3] = r.s3;
    columns[4] = r.s4;
    columns[5] = r.s5;
    columns[6] = r.s6;
    columns[7] = r.s7;
#else
    transposed(rows, columns);
#endif
}

INLINED void rows_of(const lanes *columns, float8 *rows)
{
#if LANES == 1
    rows[0] = (float8)(columns[0], columns[1], columns[2], columns[3], columns[4], columns[5], columns[6], columns[7]);
#else
    transposed(columns, rows);
#endif
}

/* LANES segments of a strand on the screen. */
typedef struct {
    float8 ends[LANES];              // each end's x, y, reversed depth, half width [pixels]
    int on[LANES], left[LANES], right[LANES], top[LANES], bottom[LANES];   // whether it can be seen; its tiles
    uint depth[LANES];               // no piece of it lies nearer
    uint cut[LANES];                 // what of its length is left where it is clipped: from and to, in 1/65535
    uint leans[LANES];               // of both its ends, see outline.h; 0 where it is clipped
} Batch;

/* Clip space, half a width in pixels at w = 1 -> pixels. */
inline float4 on_screen(float4 c, float radius)
{
    const float z = c.z > 0.0f ? c.z : 0.0f, most = GUARD * c.w;
    return (float4)(c.x, c.y, z < c.w ? z : c.w, radius < most ? radius : most) / c.w;
}

/* The rare segment that leaves the guard band or crosses the near plane; whether anything is left of it. */
inline bool clipped(const View *view, float8 ends, float8 *result, uint *cut)
{
    const float4 p = to_screen(view, ends.lo), q = to_screen(view, ends.hi), way = q - p;
    float4 a = p, b = q;
    float ha = 0.5f * ends.s3 * view->scale.x, hb = 0.5f * ends.s7 * view->scale.x;
    if (!clip(&a, &b, &ha, &hb))
        return false;
    *result = both(on_screen(a, ha), on_screen(b, hb));
    float4 from = a - p, until = b - p;
    float longest = 0.0f, along[4] = {way.x, way.y, way.z, way.w}, first[4] = {from.x, from.y, from.z, from.w};
    float last[4] = {until.x, until.y, until.z, until.w}, begin = 0.0f, end = 1.0f;
    for (int k = 0; k < 4; ++k)
        if (fabs(along[k]) > longest) {
            longest = fabs(along[k]);
            begin = first[k] / along[k];
            end = last[k] / along[k];
        }
    *cut = (uint)(clamp(begin, 0.0f, 1.0f) * 65535.0f + 0.5f) | (uint)(clamp(end, 0.0f, 1.0f) * 65535.0f + 0.5f) << 16;
    return true;
}

/* Segments `from` on of a strand whose last point is `last`: n of them, LANES at most. */
ONCE void project(const View *view, __global const float4 *points, uint from, uint last, int n, Batch *batch)
{
    float8 rows[LANES];
    lanes p[8], c[8];
    for (int k = 0; k < LANES; ++k) {
        const uint i = from + k < last ? from + k : last, j = i < last ? i + 1 : last;
        rows[k] = both(points[i], points[j]);
        batch->cut[k] = WHOLE_WAY;
    }
    columns_of(rows, p);
    lanes_i whole = I(-1);
    for (int k = 0; k < 8; k += 4) {
        const lanes x = p[k], y = p[k + 1], z = p[k + 2], radius = 0.5f * p[k + 3] * view->scale.x;
        const lanes cx = ((view->to_screen[0].x * x + view->to_screen[1].x * y) + view->to_screen[2].x * z) + view->to_screen[3].x;
        const lanes cy = ((view->to_screen[0].y * x + view->to_screen[1].y * y) + view->to_screen[2].y * z) + view->to_screen[3].y;
        const lanes cz = ((view->to_screen[0].z * x + view->to_screen[1].z * y) + view->to_screen[2].z * z) + view->to_screen[3].z;
        const lanes cw = ((view->to_screen[0].w * x + view->to_screen[1].w * y) + view->to_screen[2].w * z) + view->to_screen[3].w;
        const lanes most = GUARD * cw;
        whole &= (cw > 0.0f) & (cz >= 0.0f) & (cz <= cw) & (cx <= most) & (cx >= -most) & (cy <= most) & (cy >= -most);
        c[k] = cx / cw;
        c[k + 1] = cy / cw;
        c[k + 2] = cz / cw;
        c[k + 3] = lesser(radius, most) / cw;
    }
    rows_of(c, batch->ends);
    lanes_i kept = whole;
    if (any_lane(whole == 0)) {
        for (int k = 0; k < n; ++k)
            if (!LANE_I(whole, k)) {
                float8 ends = 0.0f;
                LANE_I(kept, k) = clipped(view, rows[k], &ends, &batch->cut[k]) ? -1 : 0;
                batch->ends[k] = ends;
            }
        columns_of(batch->ends, c);
    }
    /* Across its longer axis it reaches as far as its width is there: up to sqrt(2) of it. */
    const lanes widest = greater(c[3], c[7]), reach = 1.4143f * widest + 0.001f;
    const lanes left = lesser(c[0], c[4]) - reach, right = greater(c[0], c[4]) + reach;
    const lanes top = lesser(c[1], c[5]) - reach, bottom = greater(c[1], c[5]) + reach;
    const float first_column = view->rows.z, columns = view->rows.z + view->size.x, width = columns + view->rows.w;
    const float first = view->rows.x, height = view->rows.y;
    const lanes_i on = kept & (widest > 0.0f) & ((c[0] != c[4]) | (c[1] != c[5]))
        & (right >= first_column) & (bottom >= first) & (left < columns) & (top < height);
    const lanes e = within(greater(c[2], c[6]), 0.0f, 1.0f);
    const lanes_i x0 = WHOLE(greater(left, F(0.0f))) / TILE - view->rows.z / TILE;
    const lanes_i x1 = WHOLE(lesser(right, F(width - 1.0f))) / TILE - view->rows.z / TILE;
    const lanes_i y0 = (WHOLE(greater(top, F(first))) - view->rows.x) / TILE;
    const lanes_i y1 = (WHOLE(lesser(bottom, F(height - 1.0f))) - view->rows.x) / TILE;
    const lanes_i depth = (int)DEPTH_ONE - WHOLE(e * (float)DEPTH_ONE) - MARGIN;
    for (int k = 0; k < LANES; ++k) {
        batch->on[k] = k < n && LANE_I(on, k);
        batch->left[k] = LANE_I(x0, k);
        batch->right[k] = LANE_I(x1, k);
        batch->top[k] = LANE_I(y0, k);
        batch->bottom[k] = LANE_I(y1, k);
        batch->depth[k] = LANE_I(depth, k) > 0 ? LANE_I(depth, k) : 0;
    }
}

/* Tell how far those that are wide lean, of a strand of the points from `first` to `last`; see `project`. */
INLINED void lean(const View *view, __global const float4 *points, uint first, uint from, uint last, Batch *batch)
{
    for (int k = 0; k < LANES; ++k) {
        const float8 s = batch->ends[k];
        const bool wide = batch->on[k] && batch->cut[k] == WHOLE_WAY && (s.s3 > WIDE || s.s7 > WIDE);
        batch->leans[k] = wide ? leans_at(view, points, first, last, from + k, s) : 0;
    }
}

/* No piece of segment k lies further away. */
INLINED uint furthest(const Batch *batch, int k)
{
    const float8 s = batch->ends[k];
    const float e = s.s2 < s.s6 ? s.s2 : s.s6;
    return (int)DEPTH_ONE - (int)((e > 0.0f ? e < 1.0f ? e : 1.0f : 0.0f) * (float)DEPTH_ONE) + MARGIN;
}

/* Tiles of one row that a segment may touch, of a long one few of those around it: of the whole picture, whatever is drawn
   of it, but the first that is drawn is 0. */
INLINED int2 in_whole_row(const Batch *batch, int k, int row, const View *view)
{
    int2 tiles = (int2)(batch->left[k], batch->right[k]);
    if (tiles.y - tiles.x < 2)
        return tiles;
    const float8 s = batch->ends[k];
    const float down = s.s5 - s.s1, reach = 1.4143f * (s.s3 > s.s7 ? s.s3 : s.s7) + 0.1f;   // and some for rounding
    if (down < 1.0f && down > -1.0f)
        return tiles;
    const float y = view->rows.x + row * TILE - s.s1;
    float a = (y - reach) / down, b = (y + TILE + reach) / down;
    a = a > 0.0f ? a < 1.0f ? a : 1.0f : 0.0f;
    b = b > 0.0f ? b < 1.0f ? b : 1.0f : 0.0f;
    const float xa = s.s0 + a * (s.s4 - s.s0), xb = s.s0 + b * (s.s4 - s.s0);
    const float low = (xa < xb ? xa : xb) - reach, high = (xa < xb ? xb : xa) + reach;
    const int first = view->rows.z / TILE;
    const int left = (low > 0.0f ? (int)low / TILE : 0) - first, right = (high > 0.0f ? (int)high / TILE : -1) - first;
    tiles.x = left > tiles.x ? left : tiles.x;
    tiles.y = right < tiles.y ? right : tiles.y;
    return tiles;
}

/* Those of them that are drawn. */
INLINED int2 in_row(const Batch *batch, int k, int row, const View *view)
{
    const int2 tiles = in_whole_row(batch, k, row, view);
    if (!(view->rows.z | view->rows.w))    // all of the picture is
        return tiles;
    const int last = (view->size.x - 1) / TILE;
    return (int2)(tiles.x > 0 ? tiles.x : 0, tiles.y < last ? tiles.y : last);
}

/* Segments ready to be drawn.  u is the longer axis of each, v the shorter. */
typedef struct {
    float au[CHUNK] ALIGNED, av[CHUNK] ALIGNED, ae[CHUNK] ALIGNED, ar[CHUNK] ALIGNED, bu[CHUNK] ALIGNED;   // one end; u of the other
    float slope[CHUNK] ALIGNED, e_step[CHUNK] ALIGNED, r_step[CHUNK] ALIGNED, tilt[CHUNK] ALIGNED;   // a pixel along u
    float lean_a[CHUNK] ALIGNED, lean_b[CHUNK] ALIGNED, out[CHUNK] ALIGNED;   // of both ends, see outline.h; the most of them: 0 of thin ones
    float at_u[CHUNK] ALIGNED, at_v[CHUNK] ALIGNED, at_e[CHUNK] ALIGNED, at_one[CHUNK] ALIGNED, at_start[CHUNK] ALIGNED;   // see `place_in`
    int steep[CHUNK] ALIGNED;
    uint number[CHUNK], id[CHUNK];   // among those that are seen; in the whole scene
} Chunk;

/* Where a pixel's middle falls on a segment, at a piece's depth: a share of the way in the world, linear in u, v and e but
   for one division. */
INLINED void place(const View *view, const lanes *c, lanes_i steep, lanes from, lanes until, lanes *by)
{
    lanes3 p[2];
    for (int k = 0; k < 2; ++k) {
        const lanes x = c[4 * k], y = c[4 * k + 1], e = c[4 * k + 2];
        const lanes w = view->to_world[0].w * x + view->to_world[1].w * y + view->to_world[2].w * e + view->to_world[3].w;
        p[k].x = (view->to_world[0].x * x + view->to_world[1].x * y + view->to_world[2].x * e + view->to_world[3].x) / w;
        p[k].y = (view->to_world[0].y * x + view->to_world[1].y * y + view->to_world[2].y * e + view->to_world[3].y) / w;
        p[k].z = (view->to_world[0].z * x + view->to_world[1].z * y + view->to_world[2].z * e + view->to_world[3].z) / w;
    }
    const lanes3 way = plus(p[1], scaled(p[0], F(-1.0f)));
    const lanes square = dots(way, way), share = square > 0.0f ? (until - from) / square : F(0.0f);
    const lanes3 d = scaled(way, share);
    const lanes x = dots(d, all_lanes(view->to_world[0])), y = dots(d, all_lanes(view->to_world[1]));
    by[0] = steep ? y : x;
    by[1] = steep ? x : y;
    by[2] = dots(d, all_lanes(view->to_world[2]));
    by[3] = dots(d, all_lanes(view->to_world[3]));
    by[4] = from - dots(d, p[0]);
}

/* Put LANES segments into a chunk at i, by their ends as of a `Batch` and their leans -> which are steep. */
INLINED lanes_i put_ends(CHUNKS Chunk *chunk, int i, const lanes *c, lanes_u leans)
{
    const lanes dx = c[4] - c[0], dy = c[5] - c[1];
    const lanes_i steep = positive(dx) < positive(dy);
    const lanes pu = steep ? c[1] : c[0], pv = steep ? c[0] : c[1], qu = steep ? c[5] : c[4], qv = steep ? c[4] : c[5];
    const lanes_i swap = pu > qu;
    const lanes au = swap ? qu : pu, av = swap ? qv : pv, ae = swap ? c[6] : c[2], ar = swap ? c[7] : c[3];
    const lanes bu = swap ? pu : qu, bv = swap ? pv : qv, be = swap ? c[2] : c[6], br = swap ? c[3] : c[7];
    const lanes du = bu - au, slope = (bv - av) / du;
#define PUT(member, value) *(CHUNKS lanes *)(chunk->member + i) = value
    PUT(au, au);
    PUT(av, av);
    PUT(ae, ae);
    PUT(ar, ar);
    PUT(bu, bu);
    PUT(slope, slope);
    PUT(e_step, (be - ae) / du);
    PUT(r_step, (br - ar) / du);
    PUT(tilt, sqrt(1.0f + slope * slope));
    const lanes step = greater(ar, br) * (1.0f / LEAN);
    const lanes la = step * REAL(AS_I(leans << 16) >> 16), lb = step * REAL(AS_I(leans) >> 16);
    PUT(lean_a, swap ? lb : la);
    PUT(lean_b, swap ? la : lb);
    PUT(out, greater(positive(la), positive(lb)));
    *(CHUNKS lanes_i *)(chunk->steep + i) = steep;
    return steep;
}

/* Make n segments ready, the next ones of a tile's list, in which so many are left; those that fill the last lanes are
   never drawn. */
INLINED void prepare(CHUNKS Chunk *chunk, const View *view, __global const uint2 *list, int n, uint left,
                     __global const float8 *ends, __global const uint *ids, __global const uint *cuts)
{
    for (int i = 0; i < n; ++i)
        chunk->number[i] = list[i].y;
    for (int i = n; i % LANES; ++i)
        chunk->number[i] = list[0].y;
    for (int i = 0; i < n; i += LANES) {
        float8 rows[LANES];
        lanes c[8], from = F(0.0f), until = F(0xFFFF * (1.0f / 65535.0f));   // see WHOLE_WAY
        lanes_u leans = U(0);
        uint cut_off = 0;
#if LANES > 1
        if (i + LANES + CHUNK <= left)         // of the next chunk, from far away
            #pragma unroll
            for (int k = 0; k < LANES; ++k) {
                PREFETCH(ends + list[i + k + CHUNK].y);
                PREFETCH(ids + list[i + k + CHUNK].y);
            }
        if (i + 2 * LANES < n)                 // from near: what was drawn since has taken their places
            #pragma unroll
            for (int k = 0; k < LANES; ++k) {
                PREFETCH(ends + chunk->number[i + 2 * LANES + k]);
                PREFETCH(ids + chunk->number[i + 2 * LANES + k]);
            }
#endif
        #pragma unroll
        for (int k = 0; k < LANES; ++k) {
            const uint number = chunk->number[i + k], id = ids[number];
            chunk->id[i + k] = id;
            cut_off |= id;
            rows[k] = ends[number];
        }
        columns_of(rows, c);
        if ((cut_off & CLIPPED) || any_lane(greater(c[3], c[7]) > WIDE))
            for (int k = 0; k < LANES; ++k) {
                const uint number = chunk->number[i + k], cut = cuts[number];
                const bool clipped = chunk->id[i + k] & CLIPPED;
                chunk->id[i + k] &= ~CLIPPED;
                LANE(from, k) = clipped ? (cut & 0xFFFF) * (1.0f / 65535.0f) : LANE(from, k);
                LANE(until, k) = clipped ? (cut >> 16) * (1.0f / 65535.0f) : LANE(until, k);
                LANE_U(leans, k) = clipped ? 0 : cut;
            }
        lanes by[5];
        place(view, c, put_ends(chunk, i, c, leans), from, until, by);
        PUT(at_u, by[0]);
        PUT(at_v, by[1]);
        PUT(at_e, by[2]);
        PUT(at_one, by[3]);
        PUT(at_start, by[4]);
    }
}

/* Mean share of a row that lies below an edge which runs from a to b above the row's start.  What is taken from each other
   here is near each other: far outside of the row it is 0 or 1 without an error. */
INLINED lanes below(lanes a, lanes b)
{
    const lanes d = b - a, in_a = a < 0.0f ? F(0.0f) : a < 1.0f ? a : F(1.0f), in_b = b < 0.0f ? F(0.0f) : b < 1.0f ? b : F(1.0f);
    const lanes mean = (0.5f * (in_b - in_a) * (in_b + in_a) + ((b > 1.0f ? b : F(1.0f)) - (a > 1.0f ? a : F(1.0f)))) / d;
    const lanes_i level = (d < 1e-6f) & (d > -1e-6f);
    return level ? in_a : mean;
}

INLINED lanes_i below_or_at(lanes x)
{
    const lanes_i n = WHOLE(x);
#if LANES == 1
    return n - (x < n);
#else
    return n + (x < REAL(n));
#endif
}

/* What a segment has in a column: LANES of them side by side. */
typedef struct {
    lanes along, v0, v1, radius;     // its length; its height at both ends; half its width, along v
    lanes_i low, high;               // rows that it may touch: the first, one past the last
    lanes_i depth;
    lanes at, at_step, at_across;    // where row 0 falls on it, and how much further each row and each column do
} Column;

/* Segment i of a chunk in columns from uf on, at reversed depth e: how deep, and where on it. */
INLINED void looked_at(CHUNKS const Chunk *c, int i, const View *view, lanes uf, lanes e, Column *column)
{
    const lanes in_range = e > 0.0f ? e < 1.0f ? e : F(1.0f) : F(0.0f);
    column->depth = (int)DEPTH_ONE - WHOLE(in_range * (float)DEPTH_ONE);
    const lanes over = 1.0f / (view->to_world[2].w * e + view->to_world[3].w);
    column->at_step = c->at_v[i] * over;
    column->at_across = c->at_u[i] * over;
    column->at = ((uf + 0.5f) * c->at_u[i] + 0.5f * c->at_v[i] + e * c->at_e[i] + c->at_one[i]) * over + c->at_start[i];
}

/* Segment i of a chunk in columns u.  Both its ends and each column's are cut along v, so that neighbours meet. */
INLINED void column_of(CHUNKS const Chunk *c, int i, const View *view, lanes_i u, Column *column)
{
    const float au = c->au[i], bu = c->bu[i], slope = c->slope[i];
    const lanes uf = REAL(u), next = REAL(u + 1);
    const lanes from = au > uf ? F(au) : uf, until = bu < next ? F(bu) : next, along = until - from;
    const lanes middle = 0.5f * (from + until) - au;
    const lanes v0 = c->av[i] + slope * (from - au), v1 = c->av[i] + slope * (until - au);
    const lanes radius = c->tilt[i] * (c->ar[i] + c->r_step[i] * middle);
    const lanes e = c->ae[i] + c->e_step[i] * middle;
    column->along = along;
    column->v0 = v0;
    column->v1 = v1;
    column->radius = radius;
    column->low = below_or_at((v0 < v1 ? v0 : v1) - radius);
    column->high = below_or_at((v0 < v1 ? v1 : v0) + radius) + 1;
    looked_at(c, i, view, uf, e, column);
}

/* Share of pixels that lies between two edges, half a width below and above the middle, which runs from c0 to c1. */
INLINED lanes share_between(lanes along, lanes c0, lanes c1, lanes radius)
{
    return along * (below(c0 + radius, c1 + radius) - below(c0 - radius, c1 - radius));
}

/* Share of the pixels in rows v. */
INLINED lanes share_of(const Column *c, lanes_i v)
{
    const lanes vf = REAL(v);              // exact near the strand, so that a thin one is as wide as it is
    return share_between(c->along, c->v0 - vf, c->v1 - vf, c->radius);
}

/* Whether segment i of a chunk leans: then it has an `Outline` too. */
INLINED bool leans(CHUNKS const Chunk *c, int i)
{
    return c->out[i] > 0.0f;
}

/* The four sides of a segment in a column. */
typedef struct {
    lanes along[4], a[4], b[4], above_a[4], above_b[4];   // of the middle at both ends of a side, and how far this is above
} Outline;

/* As `column_of`, of a segment that leans. */
INLINED void outline_of(CHUNKS const Chunk *c, int i, const View *view, lanes_i u, Column *column, Outline *outline)
{
    const float au = c->au[i], bu = c->bu[i], length = bu - au, ra = c->tilt[i] * c->ar[i];
    const float rb = c->tilt[i] * (c->ar[i] + c->r_step[i] * length);
    const Corners corners = corners_of(0.0f, length, (float2)(ra, rb), (float2)(c->lean_a[i], c->lean_b[i]));
    const lanes uf = REAL(u), next = REAL(u + 1);
    lanes along = F(0.0f), low = F(4.0f * GUARD), high = F(-4.0f * GUARD);
    #pragma unroll
    for (int k = 0; k < 4; ++k) {
        const Side side = side_in(&corners, k, uf - au, next - au);
        const lanes_i there = side.along != 0.0f;
        along += positive(side.along);
        const lanes a = c->av[i] + c->slope[i] * side.from, b = c->av[i] + c->slope[i] * side.to;
        low = there ? lesser(low, lesser(a + side.above_from, b + side.above_to)) : low;
        high = there ? greater(high, greater(a + side.above_from, b + side.above_to)) : high;
        outline->along[k] = side.along;
        outline->a[k] = a;
        outline->b[k] = b;
        outline->above_a[k] = side.above_from;
        outline->above_b[k] = side.above_to;
    }
    const lanes from = within(uf, au, bu), until = within(next, au, bu), middle = 0.5f * (from + until) - au;
    column->along = along;
    column->radius = c->tilt[i] * (c->ar[i] + c->r_step[i] * middle);
    column->low = below_or_at(low);
    column->high = below_or_at(high) + 1;
    looked_at(c, i, view, uf, c->ae[i] + c->e_step[i] * middle, column);
}

#define SPECK 1e-6f                  // of a pixel: less is what rounding leaves

/* Share of the pixels in rows v. */
INLINED lanes share_within(const Outline *outline, lanes_i v)
{
    const lanes vf = REAL(v);
    lanes share = F(0.0f);
    #pragma unroll
    for (int k = 0; k < 4; ++k)
        share += outline->along[k] * below((outline->a[k] - vf) + outline->above_a[k], (outline->b[k] - vf) + outline->above_b[k]);
    return share > SPECK ? share : F(0.0f);
}

/* Where rows v fall on it, in 1/65535 of its length in the world. */
INLINED lanes_i place_in(const Column *c, lanes_i v)
{
    const lanes at = c->at + REAL(v) * c->at_step;
    return WHOLE((at > 0.0f ? at < 1.0f ? at : F(1.0f) : F(0.0f)) * 65535.0f + 0.5f);
}
