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
__kernel void bound(
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
    const uint depth = batch->depth[k];
    uint n = 0;
    for (int y = LANES == 1 && stage->row > batch->top[k] ? stage->row : batch->top[k]; y <= batch->bottom[k]; ++y) {
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
                PREFETCH_TO_WRITE(entries + place + 8);   // a line further: the tile's next ones, soon
            }
        }
    }
    return n;
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
IN_FEW BY_HAND __kernel void count(
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
            for (int k = 0; k < LANES; ++k)
                if (batch.on[k] && each_tile(&batch, k, &view, bounds, (uint2)(0, ~0u), COUNT, counts, 0, 0, &stage)) {
                    n += !stage.shown;
                    stage.shown = LANES == 1;
                    first = batch.top[k] < first ? batch.top[k] : first;
                    last = batch.bottom[k] + 1 > last ? batch.bottom[k] + 1 : last;
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
    uint ids[BATCHES];                     // of each one's first segment
    uint segments;
    int n;                                 // batches
} Found;

/* Number and list segments that were found.  All that get numbers take them from one counter: seldom, and many at a time. */
INLINED void list(Found *found, const View *view, __global const uint *bounds, uint2 window, volatile __global uint *cursors,
                  volatile __global uint *survivors, __global uint2 *entries, __global float8 *ends, __global uint *ids,
                  __global uint *cuts, Stage *stage)
{
    uint number = stage->shown ? stage->shown - 1 : atomic_add(survivors, found->segments);
    for (int m = 0; m < found->n; ++m) {
        const Batch *batch = found->batches + m;
        for (int k = 0; k < LANES; ++k)
            if (batch->on[k]) {
                ends[number] = batch->ends[k];
                ids[number] = (found->ids[m] + k) | (batch->cut[k] == WHOLE_WAY ? 0 : CLIPPED);
                cuts[number] = batch->cut[k] == WHOLE_WAY ? batch->leans[k] : batch->cut[k];
                stage->shown = LANES == 1 ? number + 1 : 0;
                each_tile(batch, k, view, bounds, window, LIST, cursors, entries, number++, stage);
            }
    }
    found->n = found->segments = 0;
}

/* As `count`, and lists them, STRANDS strands a work-item; in any order, since nobody knows who comes first. */
IN_FEW BY_HAND __kernel void fill(
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
            lean(&view, points, span.x, span.x + i, span.x + span.y - 1, batch);
            uint n = 0;
            for (int k = 0; k < LANES; ++k) {
                batch->on[k] = batch->on[k] && batch->depth[k] < slab.y && (!slab.x || furthest(batch, k) >= slab.x)
                    && (stage.shown || each_tile(batch, k, &view, bounds, window, ANY, 0, 0, 0, &stage));
                n += batch->on[k];
            }
            found.ids[found.n] = first + shifts[strand] + span.x + i;
            found.n += n > 0;
            found.segments += n;
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
BY_HAND __kernel void reach(
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
            if (batch.on[k] && each_tile(&batch, k, &view, bounds, window, ANY, 0, 0, 0, &stage))
                reaches[atomic_inc(survivors)] = (uint2)(batch.depth[k], furthest(&batch, k));
        if (stops(&stage, stages, n_open, strand, i))
            break;
    }
}

/* One work-item gives slots to those of MARKED segments that are marked, and takes their marks away. */
__kernel void choose(
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

/* --- A tile after the other, eight columns side by side. --- */

#if LANES > 1
#include "overflow.h"

/* The pixels of a tile, and their pieces that wait. */
typedef struct {
    Slots slots[TILE * TILE];
    Pixel pixels[TILE * TILE];
    int counts[TILE * TILE] ALIGNED;       // of these
    uint bounds[TILE * TILE];              // depth from which on nothing is seen
    ulong open;                            // pixels that aren't closed, row by row, a bit each:
    lanes_i in_rows, in_columns;           // those of each row, and of each column
    long lows[TILE * TILE];                // keys below are done
    long limits[TILE * TILE];              // keys from here on have gone, and come again later
    long end;                              // or from here on in another slab
    int left, right, top, bottom;          // in the picture
    bool dropped;                          // whether any have gone
    Overflow overflow;                     // where pieces wait for which there is no slot
} Tile;

/* Let a pixel be open or closed. */
INLINED void set_open(Tile *t, int p, bool open)
{
    const int x = p % TILE, y = p / TILE;
    t->open = (t->open & ~(1ul << p)) | (ulong)open << p;
    LANE_I(t->in_rows, y) = (LANE_I(t->in_rows, y) & ~(1 << x)) | open << x;
    LANE_I(t->in_columns, x) = (LANE_I(t->in_columns, x) & ~(1 << y)) | open << y;
}

/* Pixels from a tile's first one on to one that lies at x, none or TILE of them where that is outside. */
INLINED lanes_i before(lanes x, int first)
{
    const lanes from = x - (float)first;
    return WHOLE(from > 0.0f ? from < TILE ? from : F(TILE) : F(0.0f));
}

/* Pixels of a tile in which n segments may lie, a bit each. */
INLINED void pixels_of(const Tile *t, const Chunk *chunk, int n, lanes_l *pixels)
{
#define GET(member) (*(const lanes *)(chunk->member + i))
    for (int i = 0; i < n; i += LANES) {
        const lanes_i steep = *(const lanes_i *)(chunk->steep + i);
        const lanes au = GET(au), bu = GET(bu), av = GET(av), length = bu - au, bv = av + GET(slope) * length;
        const lanes ar = GET(ar), reach = GET(tilt) * greater(ar, ar + GET(r_step) * length) + 0.1f;   // and some for rounding
        const lanes out = GET(out);
        const lanes low = lesser(av, bv) - reach - out, high = greater(av, bv) + reach + out + 1.0f;
        const lanes first = au - out, last = bu + out + 1.0f;
        const lanes_i left = before(steep ? low : first, t->left), right = before(steep ? high : last, t->left);
        const lanes_i top = before(steep ? first : low, t->top), bottom = before(steep ? last : high, t->top);
        const lanes_l row = TO(lanes_l, bu > au ? (I(1) << right) - (I(1) << left) : I(0)) * 0x0101010101010101l;
        const lanes_l from = TO(lanes_l, 4 * top), until = TO(lanes_l, 4 * bottom), one = 1;
        pixels[i / LANES] = row & ((one << until << until) - (one << from << from));
    }
}

/* Slots of some pixels are full: their pieces go into the tile's list, or the furthest of each is dropped. */
ONCE void make_room(Tile *t)
{
    if (t->overflow.list == NO_LIST && !t->dropped)
        take_list(&t->overflow);
    for (int p = 0; p < TILE * TILE; ++p) {
        if (t->counts[p] < SLOTS)
            continue;
        if (t->overflow.list >= 0) {
            put_into_list(&t->overflow, &t->slots[p], SLOTS, p, t->limits[p]);
            t->counts[p] = 0;
        } else {
            drop(&t->slots[p], &t->limits[p]);
            t->counts[p] = SLOTS - 1;
            t->dropped = true;
        }
    }
}

/* Draw segment i of a chunk, which leans or not: eight columns side by side, row by row. */
INLINED void draw_as(Tile *t, const View *view, const Chunk *chunk, int i, const bool wide)
{
    const int steep = chunk->steep[i], u0 = steep ? t->top : t->left, v0 = steep ? t->left : t->top;
    const lanes_i lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    Column column;
    Outline outline;
    if (wide)
        outline_of(chunk, i, view, lane + u0, &column, &outline);
    else
        column_of(chunk, i, view, lane + u0, &column);
    lanes_i v = column.low > v0 ? column.low : v0;
    const lanes_i bottom = column.high < v0 + TILE ? column.high : v0 + TILE;
    const lanes_i on = (column.along > 0.0f) & (v < bottom);
    /* Open pixels of each column that it may touch, from row v on. */
    lanes_i todo = on & ((steep ? t->in_rows : t->in_columns) & ((I(1) << (bottom - v0 & 15)) - 1)) >> (v - v0 & 15);
    if (!any_lane(todo))
        return;
    const uint id = chunk->id[i], number = chunk->number[i];
    const int u_stride = steep ? TILE : 1, v_stride = steep ? 1 : TILE;
    uint depths[LANES] ALIGNED, wheres[LANES] ALIGNED;
#if MASKS
    float8 strips[LANES];
#endif
    float shares[LANES] ALIGNED;
    int places[LANES] ALIGNED, full = 0;
    *(lanes_i *)depths = column.depth;
    do {
        const lanes share = wide ? share_within(&outline, v) : share_of(&column, v);
        *(lanes *)shares = share;
        *(lanes_i *)wheres = place_in(&column, v);
        *(lanes_i *)places = lane * u_stride + (v - v0) * v_stride;
#if MASKS
        if (wide)
            leaning_strips_of(chunk, i, &column, lane + u0, v, strips);
        else
            strips_of(chunk, i, &column, lane + u0, v, strips);
#endif
        /* Each is written, and counted if it is seen: no branch. */
        for (int left = bits_of(((todo & 1) != 0) & (share > 0.0f)); left; left &= left - 1) {
            const int k = __builtin_ctz(left), p = places[k], n = t->counts[p];
            const long key = (long)((ulong)depths[k] << 32 | id);
            Slots *slots = &t->slots[p];
            slots->keys[n] = key;
            slots->shares[n] = shares[k];
            slots->wheres[n] = wheres[k];
            slots->numbers[n] = number;
#if MASKS
            *(float8 *)&slots->strips[n] = strips[k];
#endif
            const int m = n + ((depths[k] < t->bounds[p]) & (key >= t->lows[p]) & (key < t->limits[p]));
            t->counts[p] = m;
            full |= m == SLOTS;
        }
        v += 1;
        todo >>= 1;
    } while (any_lane(todo));
    if (full)                              // of a pixel there was one piece: it still had a slot
        make_room(t);
}

/* Those that lean are few, and take more registers. */
ONCE void draw_wide(Tile *t, const View *view, const Chunk *chunk, int i)
{
    draw_as(t, view, chunk, i, true);
}

INLINED void draw(Tile *t, const View *view, const Chunk *chunk, int i)
{
    if (leans(chunk, i))
        draw_wide(t, view, chunk, i);
    else
        draw_as(t, view, chunk, i, false);
}

#define FINE (4 * BUCKETS)   // fewer pieces have to wait in a pixel

/* Sort a tile's list into FINE buckets by depth -> the least depth, and the bits below a bucket's. */
ONCE uint2 sort_list(__global const uint2 *entries, uint n, __global uint2 *sorted)
{
    uint least = ~0u, most = 0, ends[FINE + 1], shift = 0;
    for (uint i = 0; i < n; ++i) {
        const uint depth = entries[i].x;
        least = depth < least ? depth : least;
        most = depth > most ? depth : most;
    }
    while ((most - least) >> shift >= FINE)
        ++shift;
    for (int k = 0; k <= FINE; ++k)
        ends[k] = 0;
    for (uint i = 0; i < n; ++i)
        ++ends[((entries[i].x - least) >> shift) + 1];
    for (int k = 1; k <= FINE; ++k)
        ends[k] += ends[k - 1];
    for (uint i = 0; i < n; ++i) {
        const uint2 it = entries[i];
        sorted[ends[(it.x - least) >> shift]++] = it;
    }
    return (uint2)(least, shift);
}

/* Settle all pixels as far as nothing before `until` is still to come -> whether any is still open. */
INLINED bool settle_all(Tile *t, const Picture *picture, long until)
{
    for (int p = 0; p < TILE * TILE; ++p) {
        if (!(t->open >> p & 1))
            continue;
        const long before = until < t->limits[p] ? until : t->limits[p];
        t->counts[p] = settle(&t->pixels[p], picture, &t->slots[p], t->counts[p], before);
        if (t->pixels[p].closed)
            set_open(t, p, false);
    }
    return t->open != 0;
}

/* All pieces of pixel p are hidden that are in its slots. */
INLINED void settle_slots(Tile *t, const Picture *picture, int p)
{
    if (!t->counts[p])
        return;
    settle(&t->pixels[p], picture, &t->slots[p], t->counts[p], LONG_MAX);
    t->counts[p] = 0;
    if (t->pixels[p].closed)
        set_open(t, p, false);
}

/* As `settle_all`, where pieces wait in a list: those that are in slots go there too. */
ONCE bool settle_list(Tile *t, const Picture *picture, long until)
{
    Overflow *over = &t->overflow;
    long limit = t->end;
    uint n;
    for (int p = 0; p < TILE * TILE; ++p)
        if (t->open >> p & 1) {
            limit = t->limits[p];              // of all the same
            put_into_list(over, &t->slots[p], t->counts[p], p, limit);
            t->counts[p] = 0;
        }
    const long before = until < limit ? until : limit;
    __global const ulong2 *order = in_order(over, t->open, before, &n);
    for (uint i = 0; i < n; ++i) {
        __global const Piece *piece = over->pieces + order[i].y;
        const int p = piece->pixel;
        if (!(t->open >> p & 1))
            continue;
        take_from_list(&t->slots[p], t->counts[p]++, piece);
        if (t->counts[p] == SLOTS)
            settle_slots(t, picture, p);
    }
    for (int p = 0; p < TILE * TILE; ++p)
        settle_slots(t, picture, p);
    keep_in_list(over, t->open, before, limit);
    const uint most = over->lists->most;
    if (over->n > most / 2) {                  // too many would be put in order again and again
        limit = (long)in_order(over, t->open, limit, &n)[most / 2].x;
        keep_in_list(over, t->open, before, limit);
        for (int p = 0; p < TILE * TILE; ++p)
            t->limits[p] = limit;
        t->dropped = true;
    }
    over->limit = limit;
    over->goal = 2 * over->n > LEAST_GOAL ? 2 * over->n : LEAST_GOAL;
    over->goal = over->goal < most ? over->goal : most;
    return t->open != 0;
}

/* What was dropped comes again; all before it is done.  Whether there is any. */
INLINED bool begin_again(Tile *t)
{
    bool again = false;
    for (int p = 0; p < TILE * TILE; ++p)
        if (t->open >> p & 1) {
            again |= t->limits[p] != t->end;
            t->lows[p] = t->limits[p];
            t->limits[p] = t->end;
            t->counts[p] = 0;
        }
    t->dropped = false;
    return again;
}

/* Go through a tile's sorted list of n: `grain` tells the least depth, and the bits below a bucket's. */
ONCE void go_through(Tile *t, const View *view, const Picture *picture, __global const uint2 *sorted, uint n, uint2 grain,
                 __global const float8 *ends, __global const uint *ids, __global const uint *cuts)
{
    Chunk chunk;
    lanes_l pixels[CHUNK / LANES];
    bool open = true;
    for (uint next = 0; open && next < n;) {
        for (int fullest = 0; next < n && (t->overflow.list < 0 ? fullest < SLOTS / 2 : t->overflow.n < t->overflow.goal);) {
            const int m = n - next < CHUNK ? n - next : CHUNK;
            prepare(&chunk, view, sorted + next, m, n - next, ends, ids, cuts);
            pixels_of(t, &chunk, m, pixels);
            for (int i = 0; i < m; ++i)
                if (((const ulong *)pixels)[i] & t->open) {
                    if (picture->lit && picture->glow->store->when == LIGHT_AT_ONCE)
                        PREFETCH(places_of(&picture->sent, chunk.number[i]));
                    draw(t, view, &chunk, i);
                }
            next += m;
            for (int p = 0; p < TILE * TILE; ++p)
                fullest = t->counts[p] > fullest ? t->counts[p] : fullest;
        }
        const long until = next < n ? all_before(sorted[next].x, grain) : LONG_MAX;
        open = t->overflow.list < 0 ? settle_all(t, picture, until) : settle_list(t, picture, until);
        const bool all_listed = t->overflow.list >= 0 && until >= t->overflow.limit;
        if (open && (next == n || all_listed) && t->dropped && begin_again(t)) {
            atomic_inc(t->overflow.lists->again);
            next = 0;
        }
    }
}
#endif

/* One work-item draws one tile.  They go block by block of TILE² tiles, so that what is looked up lies near. */
ALONE BY_HAND __kernel void tiles(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 window,                    // tiles that are drawn: the first, one past the last
    const uint2 slab,                      // depths that are: the first, one past the last
    __global uint4 *kept,                  // [a tile's pixels or 0, OF_PIXEL] between slabs
    volatile __global uint *unfinished,    // [1] of these, in which more can be seen
    __global const uint *starts,           // [tiles + 1] where in `entries` those of each begin
    __global const uint2 *entries,         // depth, number of a segment
    __global uint2 *sorted,                // the same, by depth
    __global const float8 *ends,           // [survivors] of segments, see `fill`
    __global const uint *ids,
    __global const uint *cuts,
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id of the body
    const int has_shells,                  // 1: there is shell fur
    __global const ulong *sample_shells,   // [rows, width, samples] depth << 32 | face where half of it is gone
    const int lit,                         // 1: there is light,
    const int when,                        // and when it is added: see glow.h
    const uint room,                       // for bundles of pieces that wait for light
    volatile __global uint *taken,         // [1] of these
    __global uint *bundles,                // [room, 3, GLOWS]
    __global uint *nexts,                  // [room]
    __global uint *heads,                  // [tiles or 0] the first bundle of each, and 1
    __global ulong *marks,                 // [survivors / 8 or 0] a byte of each, 1: its light is looked at
    __global const uint *slots,            // [survivors or 0] whose places it has
    __global const ulong *places,          // [survivors or slots, sources, FEW_PLACES] light, see places.h
    const uint n_lists,                    // for pieces of tiles that have no slot, see overflow.h
    const uint most_left,                  // of these in one between chunks
    volatile __global uint *busy,          // [n_lists] 1: a tile has it
    __global uint *overflows,              // [n_lists, most_left and some, OF_PIECE]
    volatile __global uint *again,         // [1] how often a tile's segments were gone through once more
    const int sources,                     // lights, and one for a sky or for light from hair to hair
    __global const float *more,            // [rows of them, 32] see exact_light.h
    __global const Lobes *lobes,           // [types] see lobes.h; none where no type has that look
    __global const float4 *lobe_table,
    const int n_lights,                    // see light.h
    __global const Light *lights,
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const int shadowed,                    // 1: something stands before them
    const int deep_longest,                // list of blocks in maps of hair, see deep.h; 0: there are none
    __global const Deep *deep_maps,
    __global const uint *deep_starts,
    __global const float *deep_nears,
    __global const uint *deep_blocks,
    __global const float8 *axes,           // [survivors or 0] in the world, likewise
    __global const uint *hazes,            // [survivors or 0, n_lights]
    __global float *body_transmittance,    // [rows, width, samples] share of the body's light that what stands before it
                                           // lets through; in: shells alone, out: strands too
    __global float *alpha,                 // [rows, width]
    __global ulong *front,                 // [rows, width] depth << 32 | id of what fills most of the pixel: strand or body
    __global ulong *shell_front,           // [rows, width] or depth << 32 | face, where that is shells; else nothing
    __global float4 *image)                // [rows, width] linear, premultiplied r, g, b, alpha of strands, over shells'
{
#if LANES > 1
    WORK_ITEM(item);
    const int2 size = (int2)(view.size.x, view.rows.y - view.rows.x), tiles = (size + TILE - 1) / TILE;
    const int block = item / (TILE * TILE), within = item % (TILE * TILE), blocks = (tiles.x + TILE - 1) / TILE;
    const int x = block % blocks * TILE + ((within & 1) | (within >> 1 & 2) | (within >> 2 & 4));
    const int y = block / blocks * TILE + ((within >> 1 & 1) | (within >> 2 & 2) | (within >> 3 & 4));
    if (x >= tiles.x || y >= tiles.y)
        return;
    const uint tile = y * tiles.x + x;
    if (tile < window.x || tile >= window.y)
        return;
    const uint first = starts[tile], n = starts[tile + 1] - first;
    const Store store = {when, room, taken, (__global uint8 *)bundles, nexts, heads, (__global uchar *)marks, slots};
    Glow glow;
    begin_glow(&glow, &store, view.rows.z + x * TILE, view.rows.x + y * TILE);
    const Picture picture = {view.size.z, has_shells, lit, visible, sample_shells,
                             {places, sources, more, &view, {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps},
                              lobes, lobe_table, shadowed, ends, {deep_longest, deep_maps, deep_starts, deep_nears, deep_blocks, axes, hazes}},
                             body_transmittance, alpha,
                             front, shell_front, image, &glow};
    if (when == LIGHT_NOW && (!n || heads[tile] != NOTHING)) {
        if (n)
            glow_stored(&glow, &picture.sent, heads[tile]);
        for (int p = 0; n && p < TILE * TILE; ++p) {
            const int px = x * TILE + p % TILE, py = y * TILE + p / TILE;
            if (px < size.x && py < size.y)
                add_light(&picture, (size_t)py * size.x + px, glow.lights[p]);
        }
        return;
    }
    if (!n && !has_shells && !slab.x && slab.y == NOTHING) {
        for (int py = y * TILE; py < (y + 1) * TILE && py < size.y; ++py)
            for (int px = x * TILE; px < (x + 1) * TILE && px < size.x; ++px)
                pass_pixel(&picture, (size_t)py * size.x + px);
        return;
    }
    Tile t;
    t.left = view.rows.z + x * TILE;
    t.top = view.rows.x + y * TILE;
    t.open = 0;
    t.in_rows = t.in_columns = 0;
    t.dropped = false;
    const Lists lists = {n_lists, most_left, busy, again, overflows};
    t.overflow.lists = &lists;
    t.overflow.list = NO_LIST;
    t.overflow.n = 0;
    t.end = key_at(slab.y);
    for (int row = 0; row < TILE && y * TILE + row < size.y; ++row)
        for (int k = 0; k < TILE * view.size.z; k += 8)
            PREFETCH(visible + ((size_t)(y * TILE + row) * size.x + x * TILE) * view.size.z + k);
    for (int p = 0; p < TILE * TILE; ++p) {
        const int px = x * TILE + p % TILE, py = y * TILE + p / TILE;
        t.counts[p] = t.bounds[p] = 0;
        t.lows[p] = key_at(slab.x);
        t.limits[p] = t.end;
        if (px < size.x && py < size.y) {
            t.bounds[p] = begin_pixel(&t.pixels[p], &picture, (size_t)py * size.x + px);
            t.bounds[p] = go_on_behind(&t.pixels[p], t.bounds[p], view.size.z, slab, kept + OF_PIXEL * p);
            t.pixels[p].number = p;
            glow.lights[p] = t.pixels[p].light;
            set_open(&t, p, !t.pixels[p].closed);
        }
    }
    if (n) {
        const uint2 grain = sort_list(entries + first, n, sorted + first);
        go_through(&t, &view, &picture, sorted + first, n, grain, ends, ids, cuts);
        glow_all(&glow, &picture.sent);
        give_list_back(&t.overflow);
    }
    if (when == LIGHT_LATER && n) {
        heads[tile] = glow.first;
        for (uint i = first; glow.first == NOTHING && i < first + n; ++i)
            store.marks[entries[i].y] = 1;
        if (glow.first == NOTHING)             // it is drawn anew when there is light
            return;
    }
    for (int p = 0; p < TILE * TILE; ++p)
        if (x * TILE + p % TILE < size.x && y * TILE + p / TILE < size.y) {
            t.pixels[p].light = glow.lights[p];
            end_slab(&t.pixels[p], &picture, slab, kept + OF_PIXEL * p, unfinished);
        }
#endif
}
