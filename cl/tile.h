/*
 * A tile's pixels, and segments drawn into them, eight columns side by side, where LANES is not 1: pieces wait in each pixel's
 * slots, then in a list of the tile.  tiles.h uses this, and ribbon.h, hiding.h and what these need before it.
 */
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
