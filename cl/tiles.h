/*
 * A work-item each tile, where LANES is not 1: `tiles` goes through its list from the nearest on, until all of it is hidden.
 * coverage.cl uses this, and has what it needs before.
 */
#if LANES > 1
#include "tile.h"

#define FINE (4 * BUCKETS)   // fewer pieces have to wait in a pixel

/* Sort a tile's list into buckets by depth, about as many as segments, FINE at most -> the least depth, and the bits below a
   bucket's. */
ONCE uint2 sort_list(__global const uint2 *entries, uint n, __global uint2 *sorted)
{
    uint least = ~0u, most = 0, ends[FINE + 1], shift = 0, buckets = 64;
    for (uint i = 0; i < n; ++i) {
        const uint depth = entries[i].x;
        least = depth < least ? depth : least;
        most = depth > most ? depth : most;
    }
    while (buckets < 4 * n && buckets < FINE)
        buckets *= 2;
    while ((most - least) >> shift >= buckets)
        ++shift;
    for (uint k = 0; k <= buckets; ++k)
        ends[k] = 0;
    for (uint i = 0; i < n; ++i)
        ++ends[((entries[i].x - least) >> shift) + 1];
    for (uint k = 1; k <= buckets; ++k)
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
    const int few = until == LONG_MAX ? 0 : SLOTS / 4 - 1;
    ulong due = 0;
    for (int row = 0; row < TILE; ++row)
        due |= (ulong)bits_of(*(const lanes_i *)(t->counts + TILE * row) > few) << TILE * row;
    for (due &= t->open; due; due &= due - 1) {
        const int p = __builtin_ctzl(due);
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
    Drawing drawing;
    drawing.n = 0;
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
                    draw(t, &drawing, view, &chunk, i);
                }
            put_pieces(t, &drawing);
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
    uint2 grain = 0;
    if (n)
        grain = sort_list(entries + first, n, sorted + first);
    for (uint i = 0; i < n && i < CHUNK; ++i) {   // while pixels begin
        PREFETCH(ends + sorted[first + i].y);
        PREFETCH(ids + sorted[first + i].y);
    }
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
