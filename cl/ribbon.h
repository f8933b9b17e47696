/*
 * Strands as ribbons that face the eye: how much of each pixel a segment covers, and which tiles it may show in (batch.h).
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
#include "batch.h"

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
