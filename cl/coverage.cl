/*
 * Strands as transparent as they are thin: how much of each pixel each of them covers, in the order of their depths.
 *
 * A strand is a ribbon that faces the eye, as wide as it is.  The picture is cut into tiles of TILE² pixels: `bound` tells how
 * far each can be seen into, `count` how many segments each may show, `fill` lists these, `tiles` (or `sort` and `pixels`)
 * goes through a tile's list from the nearest on, hides pieces behind each other pixel by pixel and adds up their light,
 * until all is hidden.  A pixel's pieces are taken in the order of depth << 32 | id: the same bits in whatever order
 * strands are drawn and lists are filled.
 *
 * A list is in no order; it is sorted by depth roughly, into BUCKETS.  So a pixel hides a piece only when all segments that
 * are still to come lie behind it (`settle`), and lets SLOTS of them wait meanwhile.  Where more would wait all of its tile
 * go on in a list of their own (overflow.h); without one the furthest goes, and the segments are gone through once more for
 * those from there on.
 *
 * A tile whose list does not fit is drawn in slabs of depth, one after the other, and a pixel is kept in between; all that
 * reach into a slab are listed for it.
 */
#if LANES > 8 || LANES_HINTED > 1
#undef LANES
#define LANES 8                            // columns of a tile
#endif
#define CHUNK (LANES == 1 ? 1 : LISTED)    // segments that are made ready together
#if LANES == 1
#define CHUNKS __local                     // where: each work-item makes one ready, all of its group draw it
#endif
#include "clip.h"
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "light_lanes.h"
#include "places.h"
#include "sums.h"
#include "ribbon.h"
#include "deep.h"
#include "exact_light.h"
#include "hiding.h"

/* One work-item tells how far one tile can be seen into. */
LARGE __kernel void bound(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id of the body
    __global uint *bounds)                 // [tiles] depth
{
    WORK_ITEM(tile);
    const int across = (view.size.x + TILE - 1) / TILE, left = (int)tile % across * TILE, top = (int)tile / across * TILE;
    const int right = min(left + TILE, view.size.x), bottom = min(top + TILE, view.rows.y - view.rows.x);
    uint furthest = 0;
    for (int y = top; y < bottom; ++y) {
        __global const ulong *row = visible + ((size_t)y * view.size.x + left) * view.size.z;
        for (int k = 0; k < (right - left) * view.size.z; ++k)
            furthest = max(furthest, (uint)(row[k] >> 32));
    }
    bounds[tile] = furthest;
}

#if LANES == 1
#define STRANDS 1                          // that one work-item lists,
#define BATCHES 1                          // and of their segments that get numbers together
#define IN_FEW
#else                                      // so that two cores seldom write into one line of memory
#define STRANDS AT_A_TIME
#define BATCHES AT_A_TIME
#define IN_FEW __attribute__((reqd_work_group_size(8, 1, 1)))   // each has much to do
#endif

#define ANY 0        // whether there is one
#define COUNT 1      // counts them
#define LIST 2       // lists them

#if LANES > 1
#include "boxes.h"
#endif

/* How far a strand has come where a driver ends long loops: then it goes on in another launch. */
typedef struct {
    uint steps;                            // of loops that may be taken still
    uint segment;                          // that is gone through
    int row;                               // of tiles that is next
    uint shown;                            // 1: in those before it shows; where they are listed, its number, and 1
} Stage;

/* Go through the tiles that segment k of a batch may show in -> how many there are.  counts: to COUNT them in, or where in
   `entries` to LIST the next one.  Where LANES is 1 it may come to a stop: then `stage` has no steps left. */
INLINED uint each_tile(const Batch *batch, int k, const View *view, __global const uint *bounds, uint2 window, const int what,
                       volatile __global uint *counts, __global uint2 *entries, uint number, Stage *stage)
{
    const int across = (view->size.x + TILE - 1) / TILE;
    const uint depth = LANE_U(batch->depth, k);
    const int top = LANE_I(batch->top, k), bottom = LANE_I(batch->bottom, k);
    uint n = 0;
    for (int y = LANES == 1 && stage->row > top ? stage->row : top; y <= bottom; ++y) {
        const int2 row = in_row(batch, k, y, view);
#if LANES == 1
        const uint steps = 3 + (row.y > row.x ? row.y - row.x : 0);
        stage->row = y;
        if (steps >= stage->steps) {
            stage->steps = 0;
            return n;
        }
        stage->steps -= steps;
#endif
        for (int x = row.x; x <= row.y; ++x) {
            const uint tile = y * across + x;
            if (tile < window.x || tile >= window.y || depth >= bounds[tile])
                continue;
            ++n;
            if (what == ANY)
                return 1;
            if (what == COUNT)
                atomic_inc(&counts[tile]);
            else {
                const uint place = atomic_inc(&counts[tile]);
                entries[place] = (uint2)(depth, number);
            }
        }
    }
    return n;
}

#if LANES == 1
#define SEVERAL(bits) (bits)               // how many bits are set
#else
#define SEVERAL __builtin_popcount
#endif

/* Count the tiles that segments of a batch may show in -> those that may show, a bit each. */
INLINED uint count_tiles(const Batch *batch, const View *view, __global const uint *bounds, volatile __global uint *counts,
                         Stage *stage)
{
    const uint2 all = (uint2)(0, ~0u);
#if LANES == 1
    return batch->on && each_tile(batch, 0, view, bounds, all, COUNT, counts, 0, 0, stage);
#else
    Boxes boxes;
    look_up_boxes(batch, batch->on, view, bounds, all, &boxes);
    for (int pair = 0; pair < BOX_ROWS / 2; ++pair)
        for (ulong bits = boxes.shows[pair]; bits; bits &= bits - 1)
            atomic_inc(&counts[tile_of(&boxes, pair, __builtin_ctzl(bits))]);
    uint these = shown_of(&boxes);
    for (uint bits = boxes.large; bits; bits &= bits - 1)
        these |= each_tile(batch, first_of(bits), view, bounds, all, COUNT, counts, 0, 0, stage) ? bits & -bits : 0;
    return these;
#endif
}

/* Go on with a strand where it has come to -> whether it is not at its beginning. */
INLINED bool begun(Stage *stage, __global uint4 *stages, uint strand)
{
#if LANES == 1
    if (stage->steps != ~0u) {
        const uint4 there = stages[strand];
        stage->segment = there.x;
        stage->row = there.y;
        stage->shown = there.z;
        stages[strand].x = ~0u - 1;        // at its end, if it does not come to a stop
        return there.x || there.y;
    }
#endif
    return false;
}

#define SPENT 8      // steps that a segment takes beside those of its tiles, at most

/* Leave a segment -> whether the strand comes to a stop, there or behind it. */
INLINED bool stops(Stage *stage, __global uint4 *stages, volatile __global uint *n_open, uint strand, uint segment)
{
#if LANES == 1
    const bool within = !stage->steps;
    if (!within) {
        stage->row = stage->shown = 0;
        if (stage->steps > 2 * SPENT) {
            stage->steps -= SPENT;
            return false;
        }
    }
    stages[strand] = (uint4)(segment + !within, stage->row, stage->shown, 0);
    atomic_inc(n_open);
    return true;
#else
    return false;
#endif
}

/* One work-item counts the tiles in which segments of STRANDS strands may show. */
LARGE IN_FEW BY_HAND __kernel void count(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint n_strands,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const uint *bounds,           // [tiles] depth
    volatile __global uint *counts,        // [tiles] segments
    volatile __global uint *survivors,     // [1] segments that may show anywhere
    const int known,                       // 1: the next is wanted
    __global uint *shown,                  // [strands] rows of tiles in which it may show: the first, one past the last << 16
    const uint steps,                      // of loops that one may take in this launch, about
    __global uint4 *stages,                // [strands or 0] how far each has come, if there is another
    volatile __global uint *n_open)        // [1] how many have not come to their end
{
    WORK_ITEM(item);
    const uint from = item * STRANDS;
    uint n = 0;
    Stage stage = {steps, 0, 0, 0};
    for (uint strand = from; strand < from + STRANDS && strand < n_strands; ++strand) {
        const uint2 span = spans[strand];
        uint first = 0xFFFF, last = 0;
        if (begun(&stage, stages, strand) && known) {
            first = shown[strand] & 0xFFFF;
            last = shown[strand] >> 16;
        }
        for (uint i = stage.segment; i + 1 < span.y; i += LANES) {
            const uint left = span.y - 1 - i;
            Batch batch;
            project(&view, points, span.x + i, span.x + span.y - 1, left < LANES ? left : LANES, &batch);
            const uint these = count_tiles(&batch, &view, bounds, counts, &stage);
            n += stage.shown ? 0 : SEVERAL(these);
            stage.shown = LANES == 1 && (stage.shown || these);
            for (uint bits = known ? these : 0; bits; bits &= bits - 1) {
                const int k = first_of(bits), top = LANE_I(batch.top, k), past = LANE_I(batch.bottom, k) + 1;
                first = top < first ? top : first;
                last = past > last ? past : last;
            }
            if (stops(&stage, stages, n_open, strand, i))
                break;
        }
        if (known)
            shown[strand] = last << 16 | first;
    }
    if (n)
        atomic_add(survivors, n);
}

/* Segments that wait for their numbers. */
typedef struct {
    Batch batches[BATCHES];
#if LANES > 1
    Boxes boxes[BATCHES];
#endif
    uint ids[BATCHES];                     // of each one's first segment
    uint those[BATCHES];                   // of its segments that may show, a bit each
    uint segments;
    int n;                                 // batches
} Found;

/* Find the tiles of a window in which segments of the last batch may show -> those that may, a bit each. */
INLINED uint find_tiles(Found *found, const View *view, __global const uint *bounds, uint2 window, uint2 slab, Stage *stage)
{
    const Batch *batch = found->batches + found->n;
    lanes_i on = batch->on & (batch->depth < slab.y);
    for (uint bits = slab.x ? bits_of(on) : 0; bits; bits &= bits - 1) {
        const int k = first_of(bits);
        LANE_I(on, k) = furthest(batch, k) >= slab.x ? ON : 0;
    }
#if LANES == 1
    return on && (stage->shown || each_tile(batch, 0, view, bounds, window, ANY, 0, 0, 0, stage));
#else
    Boxes *boxes = found->boxes + found->n;
    look_up_boxes(batch, on, view, bounds, window, boxes);
    uint these = shown_of(boxes);
    for (uint bits = boxes->large; bits; bits &= bits - 1)
        these |= each_tile(batch, first_of(bits), view, bounds, window, ANY, 0, 0, 0, stage) ? bits & -bits : 0;
    return these;
#endif
}

/* Number and list segments that were found.  All that get numbers take them from one counter: seldom, and many at a time. */
ONCE void list(Found *found, const View *view, __global const uint *bounds, uint2 window, volatile __global uint *cursors,
                  volatile __global uint *survivors, __global uint2 *entries, __global float8 *ends, __global uint *ids,
                  __global uint *cuts, Stage *stage)
{
    uint number = stage->shown ? stage->shown - 1 : atomic_add(survivors, found->segments);
    for (int m = 0; m < found->n; ++m) {
        const Batch *batch = found->batches + m;
        uint numbers[LANES];
        for (uint bits = found->those[m]; bits; bits &= bits - 1) {
            const int k = first_of(bits);
            const bool whole = LANE_I(batch->whole, k);
            ends[number] = batch->ends[k];
            ids[number] = (found->ids[m] + k) | (whole ? 0 : CLIPPED);
            cuts[number] = whole ? LANE_U(batch->leans, k) : LANE_U(batch->cut, k);
            numbers[k] = number++;
        }
#if LANES == 1
        stage->shown = number;
        each_tile(batch, 0, view, bounds, window, LIST, cursors, entries, numbers[0], stage);
#else
        const Boxes *boxes = found->boxes + m;
        for (int pair = 0; pair < BOX_ROWS / 2; ++pair)
            for (ulong bits = boxes->shows[pair]; bits; bits &= bits - 1) {
                const int bit = __builtin_ctzl(bits), k = bit % LANES;
                const uint place = atomic_inc(&cursors[tile_of(boxes, pair, bit)]);
                entries[place] = (uint2)(LANE_U(batch->depth, k), numbers[k]);
                PREFETCH_TO_WRITE(entries + place + 8);   // a line further: the tile's next ones, soon
            }
        for (uint bits = boxes->large & found->those[m]; bits; bits &= bits - 1) {
            const int k = first_of(bits);
            each_tile(batch, k, view, bounds, window, LIST, cursors, entries, numbers[k], stage);
        }
#endif
    }
    found->n = found->segments = 0;
}

/* As `count`, and lists them, STRANDS strands a work-item; in any order, since nobody knows who comes first. */
LARGE IN_FEW BY_HAND __kernel void fill(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 window,                    // tiles: the first, one past the last
    const uint2 slab,                      // depths into which they reach: the first, one past the last
    const uint n_strands,
    __global const float4 *points,
    __global const uint2 *spans,
    __global const uint *bounds,
    __global const uint *shifts,           // [strands] added to the number of a segment's first point,
    const uint first,                      // and this, to make its id
    const int known,                       // 1: the next is,
    __global const uint *shown,            // [strands] as `count` tells it
    volatile __global uint *cursors,       // [tiles] where the next entry of each goes
    volatile __global uint *survivors,     // [1] segments so far
    __global uint2 *entries,               // of each tile: depth, number of a segment among those that may show
    __global float8 *ends,                 // [survivors] each end's x, y, reversed depth, half width [pixels]
    __global uint *ids,                    // [survivors] and CLIPPED where they are
    __global uint *cuts,                   // [survivors] what is left where they are clipped, from and to, in 1/65535; else
                                           // how far they lean, see outline.h
    const uint steps,                      // of loops that one may take in this launch, about
    __global uint4 *stages,                // [strands or 0] how far each has come, if there is another
    volatile __global uint *n_open)        // [1] how many have not come to their end
{
    WORK_ITEM(item);
    const uint across = (view.size.x + TILE - 1) / TILE, from = item * STRANDS;
    Found found;
    Stage stage = {steps, 0, 0, 0};
    found.n = found.segments = 0;
    for (uint strand = from; strand < from + STRANDS && strand < n_strands; ++strand) {
        if (known && ((shown[strand] >> 16) * across <= window.x || (shown[strand] & 0xFFFF) * across >= window.y))
            continue;
        const uint2 span = spans[strand];
        begun(&stage, stages, strand);
        for (uint i = stage.segment; i + 1 < span.y; i += LANES) {
            const uint left = span.y - 1 - i;
            Batch *batch = found.batches + found.n;
            project(&view, points, span.x + i, span.x + span.y - 1, left < LANES ? left : LANES, batch);
            const uint these = find_tiles(&found, &view, bounds, window, slab, &stage);
            lean(&view, points, span.x, span.x + i, span.x + span.y - 1, batch, these);
            found.ids[found.n] = first + shifts[strand] + span.x + i;
            found.those[found.n] = these;
            found.n += these > 0;
            found.segments += SEVERAL(these);
            if (found.n == BATCHES)
                list(&found, &view, bounds, window, cursors, survivors, entries, ends, ids, cuts, &stage);
            if (stops(&stage, stages, n_open, strand, i))
                break;
        }
    }
    if (found.n)
        list(&found, &view, bounds, window, cursors, survivors, entries, ends, ids, cuts, &stage);
}

/* As `fill`, and tells how far in depth those that may show in a window reach, in any order. */
RARE BY_HAND __kernel void reach(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 window,                    // tiles: the first, one past the last
    __global const float4 *points,
    __global const uint2 *spans,
    __global const uint *bounds,
    volatile __global uint *survivors,     // [1] segments so far
    __global uint2 *reaches,               // [survivors] the least depth of their pieces, and the most
    const uint steps,                      // of loops that one may take in this launch, about
    __global uint4 *stages,                // [strands or 0] how far each has come, if there is another
    volatile __global uint *n_open)        // [1] how many have not come to their end
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    Stage stage = {steps, 0, 0, 0};
    begun(&stage, stages, strand);
    for (uint i = stage.segment; i + 1 < span.y; i += LANES) {
        const uint left = span.y - 1 - i;
        Batch batch;
        project(&view, points, span.x + i, span.x + span.y - 1, left < LANES ? left : LANES, &batch);
        for (int k = 0; k < LANES; ++k)
            if (LANE_I(batch.on, k) && each_tile(&batch, k, &view, bounds, window, ANY, 0, 0, 0, &stage))
                reaches[atomic_inc(survivors)] = (uint2)(LANE_U(batch.depth, k), furthest(&batch, k));
        if (stops(&stage, stages, n_open, strand, i))
            break;
    }
}

/* One work-item gives slots to those of MARKED segments that are marked, and takes their marks away. */
RARE __kernel void choose(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global ulong *marks,                 // [segments / 8, rounded up] a byte each: 1 or 0
    __global const uint *ids,              // [segments] see `fill`
    const uint n,                          // of these
    volatile __global uint *taken,         // [1] slots so far
    __global uint *slots,                  // [segments] whose number is in it
    __global uint *chosen)                 // [slots] their ids
{
    WORK_ITEM(item);
    const uint first = item * MARKED, until = first + MARKED < n ? first + MARKED : n;
    uint marked = 0;
    for (uint i = first; i < until; i += 8) {
        const ulong eight = marks[i / 8];
        marked += (uint)(eight * 0x0101010101010101ul >> 56);
    }
    uint slot = marked ? atomic_add(taken, marked) : 0;
    for (uint i = first; marked && i < until; i += 8) {
        ulong eight = marks[i / 8];
        if (!eight)
            continue;
        marks[i / 8] = 0;
        for (uint k = i; eight; ++k, eight >>= 8)
            if (eight & 1) {
                slots[k] = slot;
                chosen[slot++] = ids[k];
            }
    }
}

/* Key of the first piece that may lie at a depth; NOTHING: behind all. */
INLINED long key_at(uint depth)
{
    return depth == NOTHING ? LONG_MAX : (long)depth << 32;
}

/* Key from which on pieces may come of a segment at this depth in a sorted list, and of those after it; grain: the list's
   least depth, and the bits of a depth that one bucket holds. */
INLINED long all_before(uint depth, uint2 grain)
{
    return (long)(grain.x + ((depth - grain.x) >> grain.y << grain.y)) << 32;
}

#include "pixels.h"
#include "tiles.h"
