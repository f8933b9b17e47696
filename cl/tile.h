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

/* What a tile looks at of a chunk. */
typedef struct {
    lanes_l pixels[CHUNK / LANES];         // of the tile in which each segment may lie, a bit each
    int firsts[CHUNK] ALIGNED;             // of four columns along its longer axis, from the tile's first on, that hold all it
                                           // touches; or below 0: it touches more, or it leans
} Looked;

/* Where in a tile n segments may lie. */
INLINED void look_at(const Tile *t, const Chunk *chunk, int n, Looked *looked)
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
        looked->pixels[i / LANES] = row & ((one << until << until) - (one << from << from));
        const lanes_i start = steep ? top : left, from_four = start < TILE / 2 ? start : I(TILE / 2);
        const lanes beyond = bu - REAL(from_four + TILE / 2 + (steep ? t->top : t->left));
        const lanes_i few = (out == 0.0f) & ((beyond <= 0.0f) | (from_four == TILE / 2));
        *(lanes_i *)(looked->firsts + i) = few ? from_four : I(-1);
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

#define MOST_COVERED (2 * CHUNK)   // rows that wait

/* What a segment covers in a row of columns, or a column of rows. */
typedef struct {
    float shares[LANES] ALIGNED;
    uint wheres[LANES] ALIGNED, depths[LANES] ALIGNED;
    int places[LANES] ALIGNED;             // pixels in the tile
    uint id, number;
#if MASKS
    float8 strips[LANES];
#endif
    int on;                                // those in which it covers something, a bit each
} Covered;

/* All a chunk's segments are looked at first, and put into slots then: what is foreseen wrong of one keeps none waiting. */
typedef struct {
    Covered rows[MOST_COVERED];
    int n;
} Drawing;

/* Put pieces into slots: each is written, and counted if it is seen, without a branch. */
INLINED void put_pieces(Tile *t, Drawing *drawing)
{
    for (int i = 0; i < drawing->n; ++i) {
        const Covered *row = &drawing->rows[i];
        int full = 0;
        for (int left = row->on; left; left &= left - 1) {
            const int k = __builtin_ctz(left), p = row->places[k], n = t->counts[p];
            const long key = (long)((ulong)row->depths[k] << 32 | row->id);
            Slots *slots = &t->slots[p];
            slots->keys[n] = key;
            slots->shares[n] = row->shares[k];
            slots->wheres[n] = row->wheres[k];
            slots->numbers[n] = row->number;
#if MASKS
            *(float8 *)&slots->strips[n] = row->strips[k];
#endif
            const int m = n + ((row->depths[k] < t->bounds[p]) & (key >= t->lows[p]) & (key < t->limits[p]));
            t->counts[p] = m;
            full |= m == SLOTS;
        }
        if (full)                          // of a pixel there was one piece: it still had a slot
            make_room(t);
    }
    drawing->n = 0;
}

/* Put what is looked at of segment i of a chunk into a row that waits: columns u, rows v. */
INLINED void cover(const Tile *t, Drawing *drawing, const Chunk *chunk, int i, const Column *column, lanes_i u, lanes_i v,
                   lanes share, lanes_i on)
{
    const int steep = chunk->steep[i], u_stride = steep ? TILE : 1, v_stride = steep ? 1 : TILE;
    Covered *row = &drawing->rows[drawing->n];
    *(lanes *)row->shares = share;
    *(lanes_i *)row->wheres = place_in(column, v);
    *(lanes_i *)row->depths = column->depth;
    *(lanes_i *)row->places = u * u_stride + v * v_stride - (t->top * TILE + t->left);
    row->id = chunk->id[i];
    row->number = chunk->number[i];
    row->on = bits_of(on & (share > 0.0f));
    ++drawing->n;
}

/* Look at segment i of a chunk, which leans or not: eight columns side by side, row by row. */
INLINED void draw_as(Tile *t, Drawing *drawing, const View *view, const Chunk *chunk, int i, const bool wide)
{
    const int steep = chunk->steep[i], u0 = steep ? t->top : t->left, v0 = steep ? t->left : t->top;
    const lanes_i u = (int8)(0, 1, 2, 3, 4, 5, 6, 7) + u0;
    Column column;
    Outline outline;
    if (wide)
        outline_of(chunk, i, view, u, &column, &outline);
    else
        column_of(chunk, i, view, u, &column);
    lanes_i v = column.low > v0 ? column.low : v0;
    const lanes_i bottom = column.high < v0 + TILE ? column.high : v0 + TILE;
    const lanes_i on = (column.along > 0.0f) & (v < bottom);
    /* Open pixels of each column that it may touch, from row v on. */
    lanes_i todo = on & ((steep ? t->in_rows : t->in_columns) & ((I(1) << (bottom - v0 & 15)) - 1)) >> (v - v0 & 15);
    for (; any_lane(todo); v += 1, todo >>= 1) {
#if MASKS
        if (wide)
            leaning_strips_of(chunk, i, &column, u, v, drawing->rows[drawing->n].strips);
        else
            strips_of(chunk, i, &column, u, v, drawing->rows[drawing->n].strips);
#endif
        const lanes share = wide ? share_within(&outline, v) : share_of(&column, v);
        cover(t, drawing, chunk, i, &column, u, v, share, (todo & 1) != 0);
    }
    if (drawing->n > MOST_COVERED - TILE)
        put_pieces(t, drawing);
}

/* Look at segment i of a chunk in four columns from the tile's `first` on: two rows of each side by side. */
INLINED void draw_few(Tile *t, Drawing *drawing, const View *view, const Chunk *chunk, int i, int first)
{
    const int steep = chunk->steep[i], u0 = steep ? t->top : t->left, v0 = steep ? t->left : t->top;
    const lanes_i u = (int8)(0, 1, 2, 3, 0, 1, 2, 3) + (u0 + first), second = (int8)(0, 0, 0, 0, 1, 1, 1, 1);
    Column column;
    column_of(chunk, i, view, u, &column);
    const lanes_i top = column.low > v0 ? column.low : v0;
    const lanes_i bottom = column.high < v0 + TILE ? column.high : v0 + TILE;
    const lanes_i on = (column.along > 0.0f) & (top < bottom);
    const int4 four = *(const int4 *)((const int *)(steep ? &t->in_rows : &t->in_columns) + first);
    lanes_i v = top + second;
    lanes_i todo = on & ((lanes_i)(four, four) & ((I(1) << (bottom - v0 & 15)) - 1)) >> (v - v0 & 15);
    for (; any_lane(todo); v += 2, todo >>= 2) {
#if MASKS
        strips_of(chunk, i, &column, u, v, drawing->rows[drawing->n].strips);
#endif
        cover(t, drawing, chunk, i, &column, u, v, share_of(&column, v), (todo & 1) != 0);
    }
    if (drawing->n > MOST_COVERED - TILE)
        put_pieces(t, drawing);
}

/* Those that lean are few, and take more registers. */
ONCE void draw_wide(Tile *t, Drawing *drawing, const View *view, const Chunk *chunk, int i)
{
    draw_as(t, drawing, view, chunk, i, true);
}

INLINED void draw(Tile *t, Drawing *drawing, const View *view, const Chunk *chunk, int i)
{
    if (leans(chunk, i))
        draw_wide(t, drawing, view, chunk, i);
    else
        draw_as(t, drawing, view, chunk, i, false);
}
