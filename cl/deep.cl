/*
 * Strands as a light sees them: the pieces that they have in the texels of a map, sorted by depth, for shadows of single
 * hairs.  `count` tells how many each texel may have, `fill` writes them in any order, `sort` (and `exchange`) sorts each
 * texel's; deep.h looks them up.
 *
 * All of a piece is whole numbers, and they are sorted by all of it: the same bits in whatever order strands come.
 */
#if LANES > 8 || LANES_HINTED > 1
#undef LANES
#define LANES 8                            // columns of texels
#endif
#define CHUNK LANES
#define CHUNKS
#include "clip.h"
#include "lanes.h"
#include "ribbon.h"
#include "deep.h"

#define DARKEST (1.0f - 1.0f / 256)        // a piece lets UNSEEN through at least: eight octaves, so that sums have room
#define SHORT 32                           // lists that are sorted by insertion

/* What a piece is made of, but for its place. */
typedef struct {
    float4 depth;                          // see layout.Deep
    ulong strand;                          // where it stands in a piece
    float opaque;                          // share of light that one takes which fills a texel
    int cells;                             // a side of `dark`,
    __global const uint *dark;             // [cells, cells] depth from which on no light comes
} Kind;

/* Put segments ready to be drawn, see `prepare`. */
INLINED void ready(const Batch *batch, Chunk *chunk)
{
    lanes c[8];
    lanes_u leans;
    for (int k = 0; k < LANES; ++k)
        LANE_U(leans, k) = batch->leans[k];
    columns_of(batch->ends, c);
    put_ends(chunk, 0, c, leans);
}

/* Go through the texels, in some columns, that segment k of a chunk may have pieces in, but those so deep that no light comes
   there.  counts: of each texel one more; or, where `pieces` are wanted, where in these its next one goes. */
INLINED void each_texel(const View *view, const Chunk *chunk, int k, int2 columns, const Kind *kind,
                        volatile __global uint *counts, __global ulong *pieces)
{
    const int n = view->size.x, u_stride = chunk->steep[k] ? n : 1, v_stride = chunk->steep[k] ? 1 : n;
    const float out = chunk->out[k], from = chunk->au[k] - out, until = chunk->bu[k] + out, ratio = (float)kind->cells / n;
    const int first = from > columns.x ? (int)from : columns.x, last = until < columns.y ? (int)until : columns.y - 1;
    const bool wide = leans(chunk, k);
#if LANES == 1
    const lanes_i lane = 0;
#else
    const lanes_i lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
#endif
    for (int u = first; u <= last; u += LANES) {
        Column column;
        Outline outline;
        if (wide)
            outline_of(chunk, k, view, lane + u, &column, &outline);
        else
            column_of(chunk, k, view, lane + u, &column);
        const lanes_i on = (column.along > 0.0f) & (lane + u <= last), bottom = column.high < n ? column.high : I(n);
        lanes_i v = column.low > 0 ? column.low : I(0), at = (lane + u) * u_stride + v * v_stride;
        const lanes e = REAL((int)DEPTH_ONE - column.depth) * (1.0f / DEPTH_ONE);
        const lanes depth = within(kind->depth.x + kind->depth.y * (kind->depth.z > 0.0f ? 1.0f / e : e), 0.0f, (float)DEEP_LAST);
        for (lanes_i todo = on & (v < bottom); any_lane(todo); v += 1, at += v_stride, todo = on & (v < bottom)) {
            const lanes_i in_u = WHOLE((REAL(lane + u) + 0.5f) * ratio), in_v = WHOLE((REAL(v) + 0.5f) * ratio);
            const lanes_i cell = chunk->steep[k] ? in_u * kind->cells + in_v : in_v * kind->cells + in_u;
            lanes octaves = F(0.0f);
            if (pieces) {
                const lanes share = lesser(kind->opaque * (wide ? share_within(&outline, v) : share_of(&column, v)), F(DARKEST));
                octaves = -(float)DEEP_UNIT * log2_of(1.0f - greater(share, F(0.0f))) + 0.5f;
            }
            for (int j = 0; j < LANES; ++j) {
                if (!LANE_I(todo, j) || (uint)LANE(depth, j) >= kind->dark[LANE_I(cell, j)])
                    continue;
                const uint place = atomic_inc(&counts[LANE_I(at, j)]);
                if (pieces)
                    pieces[place] = (ulong)LANE(depth, j) << 40 | kind->strand | (uint)LANE(octaves, j);
            }
        }
    }
}

/* One work-item counts the pieces of one strand, with those that cover nothing of a texel beside it. */
BY_HAND __kernel void count(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,                       // of the light
    const Deep map,                        // where its texels begin, and how depths are counted
    const int cells,                       // a side of `dark`
    __global const uint *dark,             // [cells, cells] depth from which on no light comes
    const uint2 stretch,                   // segments of each strand: the first, one past the last
    const int2 columns,                    // of texels, along a segment's longer axis: likewise
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    volatile __global uint *counts)        // [texels] pieces
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const Kind kind = {map.depth, 0, 0.0f, cells, dark};
    for (uint i = stretch.x; i + 1 < span.y && i < stretch.y; i += LANES) {
        const uint left = (span.y - 1 < stretch.y ? span.y - 1 : stretch.y) - i;
        Batch batch;
        Chunk chunk;
        project(&view, points, span.x + i, span.x + span.y - 1, left < LANES ? left : LANES, &batch);
        lean(&view, points, span.x, span.x + i, span.x + span.y - 1, &batch);
        ready(&batch, &chunk);
        for (int k = 0; k < LANES; ++k)
            if (batch.on[k])
                each_texel(&view, &chunk, k, columns, &kind, counts, 0);
    }
}

/* As `count`, and writes them; in any order, since nobody knows who comes first. */
BY_HAND __kernel void fill(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const Deep map,
    const int cells,
    __global const uint *dark,
    const uint2 stretch,
    const int2 columns,
    __global const float4 *points,
    __global const uint2 *spans,
    __global const uint *numbers,          // [strands] number of each as it came,
    const uint first_strand,               // from this on
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const HairType *types,
    volatile __global uint *cursors,       // [texels] where the next piece of each goes
    __global ulong *pieces)                // see deep.h
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const Kind kind = {map.depth, (ulong)(first_strand + numbers[strand] & DEEP_STRAND) << 16,
                       1.0f - types[(int)strand_uv[strand].z].shine.z, cells, dark};
    for (uint i = stretch.x; i + 1 < span.y && i < stretch.y; i += LANES) {
        const uint left = (span.y - 1 < stretch.y ? span.y - 1 : stretch.y) - i;
        Batch batch;
        Chunk chunk;
        project(&view, points, span.x + i, span.x + span.y - 1, left < LANES ? left : LANES, &batch);
        lean(&view, points, span.x, span.x + i, span.x + span.y - 1, &batch);
        ready(&batch, &chunk);
        for (int k = 0; k < LANES; ++k)
            if (batch.on[k])
                each_texel(&view, &chunk, k, columns, &kind, cursors + (uint)map.size.y, pieces);
    }
}

/* Put two pieces in order. */
INLINED void in_order(__global ulong *pieces, uint i, uint j)
{
    const ulong a = pieces[i], b = pieces[j];
    if (a > b) {
        pieces[i] = b;
        pieces[j] = a;
    }
}

/* One work-item sorts the pieces of one texel: by insertion, or where they are many by Batcher's method, as in Knuth, The Art
   of Computer Programming 3, 5.2.2 M. */
__kernel void sort(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint longest,                    // a list of more is left as it is
    __global const uint *starts,           // [texels + 1] where in `pieces` those of each begin
    __global ulong *pieces)
{
    WORK_ITEM(texel);
    const uint n = starts[texel + 1] - starts[texel];
    __global ulong *its = pieces + starts[texel];
    if (n > longest)
        return;
    if (n <= SHORT) {
        for (uint i = 1; i < n; ++i) {
            const ulong piece = its[i];
            uint j = i;
            for (; j > 0 && its[j - 1] > piece; --j)
                its[j] = its[j - 1];
            its[j] = piece;
        }
        return;
    }
    uint whole = 1;
    while (2 * whole < n)
        whole *= 2;
    for (uint p = whole; p; p /= 2)
        for (uint q = whole, r = 0, d = p; d; d = q > p ? q - p : 0, q = q > p ? q / 2 : 0, r = p)
            for (uint i = 0; i + d < n; ++i)
                if ((i & p) == r)
                    in_order(its, i, i + d);
}

/* One work-item puts two pieces of a long list in order, in one step of the same method. */
__kernel void exchange(
    const ulong begin, const ulong end,    // work-items, see common.h: pieces of the list, less `apart`
    const uint first,                      // where in `pieces` it begins
    const uint bit,                        // of a piece's place in the list
    const uint value,                      // that this has where it is the first of two
    const uint apart,                      // how far away the other is
    __global ulong *pieces)
{
    WORK_ITEM(i);
    if (((uint)i & bit) == value)
        in_order(pieces + first, (uint)i, (uint)i + apart);
}
