/*
 * A work-item each tile, where LANES is not 1: `tiles` goes through its list from the nearest on, until all of it is hidden.
 * coverage.cl uses this, and has what it needs before.
 */
#if LANES > 1
#include "tile.h"

#define FINE (4 * BUCKETS)   // fewer pieces have to wait in a pixel
#define SHORT 1024           // lists of so many are sorted where they are: no line of other memory is fetched to be written

/* Sort a tile's list into buckets by depth, about as many as segments, FINE at most; a SHORT one into `entries` itself -> the
   least depth, and the bits below a bucket's. */
ONCE uint2 sort_list(__global const uint2 *entries, uint n, __global uint2 *sorted)
{
    uint least = ~0u, most = 0, ends[FINE + 1], shift = 0, buckets = 64;
    uint2 copy[SHORT];
    for (uint i = 0; i < n; ++i) {
        const uint2 it = entries[i];
        least = it.x < least ? it.x : least;
        most = it.x > most ? it.x : most;
        if (n <= SHORT)
            copy[i] = it;
    }
    while (buckets < 4 * n && buckets < FINE)
        buckets *= 2;
    while ((most - least) >> shift >= buckets)
        ++shift;
    for (uint k = 0; k <= buckets; ++k)
        ends[k] = 0;
    for (uint i = 0; i < n; ++i)
        ++ends[(((n <= SHORT ? copy[i].x : entries[i].x) - least) >> shift) + 1];
    for (uint k = 1; k <= buckets; ++k)
        ends[k] += ends[k - 1];
    for (uint i = 0; i < n; ++i) {
        const uint2 it = n <= SHORT ? copy[i] : entries[i];
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
ONCE void settle_slots(Tile *t, const Picture *picture, int p)
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

/* Begin with the pixels of a tile, from pixel left, top on among those that are drawn. */
INLINED void begin_pixels_as(Tile *t, const Picture *picture, int2 size, int left, int top, uint2 slab, __global const uint4 *kept)
{
    const int right = size.x - left < TILE ? size.x - left : TILE, bottom = size.y - top < TILE ? size.y - top : TILE;
    const lanes_i lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    t->in_rows = lane < bottom ? I((1 << right) - 1) : I(0);
    t->in_columns = lane < right ? I((1 << bottom) - 1) : I(0);
    t->open = 0;
    for (int p = 0; p < TILE * TILE; ++p) {
        t->counts[p] = t->bounds[p] = 0;
        t->lows[p] = key_at(slab.x);
        t->limits[p] = t->end;
    }
    for (int y = 0; y < bottom; ++y) {
        t->open |= ((1ul << right) - 1) << TILE * y;
        for (int x = 0; x < right; ++x) {
            const int p = TILE * y + x;
            const uint bound = begin_pixel(&t->pixels[p], picture, (size_t)(top + y) * size.x + left + x);
            t->bounds[p] = go_on_behind(&t->pixels[p], bound, picture->samples, slab, kept + OF_PIXEL * p);
            t->pixels[p].number = p;
            picture->glow->lights[p] = t->pixels[p].light;
            if (RARELY(t->pixels[p].closed))
                set_open(t, p, false);
        }
    }
}

INLINED void end_pixels_as(Tile *t, const Picture *picture, int2 size, int left, int top, uint2 slab, __global uint4 *kept,
                     volatile __global uint *unfinished)
{
    const int right = size.x - left < TILE ? size.x - left : TILE, bottom = size.y - top < TILE ? size.y - top : TILE;
    for (int y = 0; y < bottom; ++y)
        for (int x = 0; x < right; ++x) {
            const int p = TILE * y + x;
            t->pixels[p].light = picture->glow->lights[p];
            end_slab(&t->pixels[p], picture, slab, kept + OF_PIXEL * p, unfinished);
        }
}

/* Pixels of a tile in which neither strands nor shells are. */
INLINED void pass_pixels_as(const Picture *picture, int2 size, int left, int top)
{
    for (int y = top; y < top + TILE && y < size.y; ++y)
        for (int x = left; x < left + TILE && x < size.x; ++x)
            pass_pixel(picture, (size_t)y * size.x + x);
}

/* Do something with a picture's pixels, of which a copy is `here`: the usual ones, with four samples and no shells, by code
   of their own. */
#define BY_KIND(picture, something)                \
    {                                              \
        Picture here = *(picture);                 \
        if (here.samples == 4 && !here.has_shells) { \
            here.samples = 4;                      \
            here.has_shells = 0;                   \
            something;                             \
        } else                                     \
            something;                             \
    }

ONCE void begin_pixels(Tile *t, const Picture *picture, int2 size, int left, int top, uint2 slab, __global const uint4 *kept)
{
    BY_KIND(picture, begin_pixels_as(t, &here, size, left, top, slab, kept))
}

ONCE void end_pixels(Tile *t, const Picture *picture, int2 size, int left, int top, uint2 slab, __global uint4 *kept,
                     volatile __global uint *unfinished)
{
    BY_KIND(picture, end_pixels_as(t, &here, size, left, top, slab, kept, unfinished))
}

ONCE void pass_pixels(const Picture *picture, int2 size, int left, int top)
{
    BY_KIND(picture, pass_pixels_as(&here, size, left, top))
}

/* Samples of the body in a tile are on their way. */
INLINED void fetch_samples(const Picture *picture, int2 size, int left, int top)
{
    for (int y = top; y < top + TILE && y < size.y; ++y)
        for (int k = 0; k < TILE * picture->samples; k += 8)
            PREFETCH(picture->visible + ((size_t)y * size.x + left) * picture->samples + k);
}

/* And what is written of its pixels. */
INLINED void fetch_pixels(const Picture *picture, int2 size, int left, int top)
{
    for (int y = top; y < top + TILE && y < size.y; ++y) {
        const size_t at = (size_t)y * size.x + left;
        for (int k = 0; k < TILE * picture->samples; k += 16)
            PREFETCH_TO_WRITE(picture->body_transmittance + at * picture->samples + k);
        PREFETCH_TO_WRITE(picture->alpha + at);
        PREFETCH_TO_WRITE(picture->front + at);
        for (int k = 0; picture->lit && k < TILE; k += 4)
            PREFETCH_TO_WRITE(picture->image + at + k);
    }
}

/* Go through a tile's sorted list of n: `grain` tells the least depth, and the bits below a bucket's. */
ONCE void go_through(Tile *t, const View *view, const Picture *picture, __global const uint2 *sorted, uint n, uint2 grain,
                 __global const float8 *ends, __global const uint *ids, __global const uint *cuts)
{
    Drawing drawing;
    drawing.n_pieces = 0;
    drawing.fetched = picture->lit && picture->glow->store->when == LIGHT_AT_ONCE ? &picture->sent : 0;
    bool open = true;
    for (uint next = 0; open && next < n;) {
        for (int fullest = 0; next < n && (t->overflow.list < 0 ? fullest < SLOTS / 2 : t->overflow.n < t->overflow.goal);) {
            const int m = n - next < CHUNK ? n - next : CHUNK;
            draw(t, &drawing, view, sorted + next, m, n - next, ends, ids, cuts);
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
LARGE ALONE BY_HAND __kernel void tiles(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 window,                    // tiles that are drawn: the first, one past the last
    const uint2 slab,                      // depths that are: the first, one past the last
    __global uint4 *kept,                  // [a tile's pixels or 0, OF_PIXEL] between slabs
    volatile __global uint *unfinished,    // [1] of these, in which more can be seen
    __global const uint *starts,           // [tiles + 1] where in `entries` those of each begin
    __global uint2 *entries,               // depth, number of a segment; out: SHORT lists by depth
    __global uint2 *sorted,                // the others by depth
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
        fetch_samples(&picture, size, x * TILE, y * TILE);
        fetch_pixels(&picture, size, x * TILE, y * TILE);
        pass_pixels(&picture, size, x * TILE, y * TILE);
        return;
    }
    Tile t;
    t.left = view.rows.z + x * TILE;
    t.top = view.rows.x + y * TILE;
    t.dropped = false;
    const Lists lists = {n_lists, most_left, busy, again, overflows};
    t.overflow.lists = &lists;
    t.overflow.list = NO_LIST;
    t.overflow.n = 0;
    t.end = key_at(slab.y);
    fetch_samples(&picture, size, x * TILE, y * TILE);
    __global uint2 *list = (n <= SHORT ? entries : sorted) + first;
    uint2 grain = 0;
    if (n)
        grain = sort_list(entries + first, n, list);
    for (uint i = 0; i < n && i < CHUNK; ++i) {   // while pixels begin
        PREFETCH(ends + list[i].y);
        PREFETCH(ids + list[i].y);
    }
    begin_pixels(&t, &picture, size, x * TILE, y * TILE, slab, kept);
    if (n) {
        go_through(&t, &view, &picture, list, n, grain, ends, ids, cuts);
        fetch_pixels(&picture, size, x * TILE, y * TILE);
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
    end_pixels(&t, &picture, size, x * TILE, y * TILE, slab, kept, unfinished);
#endif
}
