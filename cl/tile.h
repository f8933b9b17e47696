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

typedef ushort8 __attribute__((aligned(2))) Numbers;

/* List the lanes that are on, from number `first` on -> how many.  LANES are written. */
INLINED int list_lanes(ushort *to, uint bits, int first)
{
#ifdef __BMI2__
    const ulong bytes = __builtin_ia32_pdep_di(bits, 0x0101010101010101ul) * 0xFF;
    const uchar8 lanes = as_uchar8(__builtin_ia32_pext_di(0x0706050403020100ul, bytes));
    *(Numbers *)to = __builtin_convertvector(lanes, ushort8) + (ushort)first;
    return __builtin_popcount(bits);
#else
    int n = 0;
    for (int k = 0; k < LANES; ++k) {
        to[n] = first + k;
        n += bits >> k & 1;
    }
    return n;
#endif
}

/* Segments of a chunk that are drawn, by how many columns of the tile they touch along their longer axis. */
typedef struct {
    ushort few[CHUNK + LANES], many[CHUNK + LANES], leaning[CHUNK + LANES];   // four at most; more; those that lean
    int n_few, n_many, n_leaning;
    int firsts[CHUNK] ALIGNED;             // of each of the few, four columns that hold these: the first one in the tile
} Drawn;

/* List those of m segments that may lie in open pixels. */
INLINED void look_at(const Tile *t, const Chunk *chunk, int m, Drawn *drawn)
{
#define GET(member) (*(const lanes *)(chunk->member + i))
    drawn->n_few = drawn->n_many = drawn->n_leaning = 0;
    for (int i = 0; i < m; i += LANES) {
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
        const lanes_l pixels = row & ((one << until << until) - (one << from << from)) & (long)t->open;
        const lanes_i start = steep ? top : left, of_few = start < TILE / 2 ? start : I(TILE / 2);
        const lanes_i few = (of_few == TILE / 2) | (bu <= REAL(of_few + TILE / 2 + (steep ? t->top : t->left)));
        const uint all = m - i < LANES ? (1u << (m - i)) - 1 : (1u << LANES) - 1;
        const uint on = bits_of(TO(lanes_i, pixels != 0)) & all, lean = bits_of(out > 0.0f), narrow = bits_of(few) & ~lean;
        *(lanes_i *)(drawn->firsts + i) = of_few;
        drawn->n_few += list_lanes(drawn->few + drawn->n_few, on & narrow, i);
        drawn->n_many += list_lanes(drawn->many + drawn->n_many, on & ~(narrow | lean), i);
        if (lean)
            drawn->n_leaning += list_lanes(drawn->leaning + drawn->n_leaning, on & lean, i);
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

#define MOST_COVERED 32            // rows that wait: these fit the first cache beside slots

/* What segments cover in rows of LANES pixels each: all are looked at first, and put into slots then, without branches that
   would be foreseen wrong. */
typedef struct {
    float shares[MOST_COVERED * LANES] ALIGNED;      // of pixels; how long the segment is there where that isn't known so far:
    float starts[MOST_COVERED * LANES] ALIGNED, stops[MOST_COVERED * LANES] ALIGNED;   // its middle at both ends,
    float radii[MOST_COVERED * LANES] ALIGNED;       // and half its width
    uint wheres[MOST_COVERED * LANES] ALIGNED;       // on the segment, and << 16 the pixel in the tile
    uint depths[MOST_COVERED * LANES] ALIGNED;
    uint on[MOST_COVERED];                           // lanes that may cover something, a bit each
    uint ids[MOST_COVERED], numbers[MOST_COVERED];   // of each row's segment
#if MASKS
    float8 strips[MOST_COVERED * LANES];
#endif
    ushort pieces[(MOST_COVERED + 1) * LANES];       // lanes in which something is covered
    int n_pieces;                                    // of these
    const Sent *fetched;                             // where light of segments is fetched from ahead, or 0
    ulong ranges[TILE * TILE] ALIGNED;               // how many keys from `lows` on each pixel takes
} Drawing;

INLINED void tell_ranges(const Tile *t, Drawing *drawing)
{
    for (int p = 0; p < TILE * TILE; ++p) {
        const ulong bound = (ulong)t->bounds[p] << 32, limit = t->limits[p], most = bound < limit ? bound : limit, low = t->lows[p];
        drawing->ranges[p] = most > low ? most - low : 0;
    }
}

/* Put pieces into slots: each is written, and counted if it is seen, without a branch. */
INLINED void put_pieces(Tile *t, Drawing *drawing)
{
    const uint n_pieces = drawing->n_pieces;
    for (uint i = 0; i < n_pieces; ++i) {
        const uint k = drawing->pieces[i], where = drawing->wheres[k], p = where >> 16, n = t->counts[p];
        const ulong key = (ulong)drawing->depths[k] << 32 | drawing->ids[k / LANES];
        Slots *slots = &t->slots[p];
        slots->keys[n] = (long)key;
        slots->shares[n] = drawing->shares[k];
        slots->wheres[n] = where;
        slots->numbers[n] = drawing->numbers[k / LANES];
#if MASKS
        *(float8 *)&slots->strips[n] = drawing->strips[k];
#endif
        const uint m = n + (key - (ulong)t->lows[p] < drawing->ranges[p]);
        t->counts[p] = m;
        if (RARELY(m == SLOTS)) {
            make_room(t);
            tell_ranges(t, drawing);
        }
    }
    drawing->n_pieces = 0;
}

/* Let row n be of segment i of a chunk in columns u and rows v. */
INLINED void begin_row(const Tile *t, Drawing *drawing, int n, const Chunk *chunk, int i, const Column *column, lanes_i u, lanes_i v)
{
    const int u_stride = chunk->steep[i] ? TILE : 1, v_stride = chunk->steep[i] ? 1 : TILE, at = n * LANES;
    const lanes_i pixel = u * u_stride + v * v_stride - (t->top * TILE + t->left);
    *(lanes_i *)(drawing->wheres + at) = place_in(column, v) | pixel << 16;
    *(lanes_i *)(drawing->depths + at) = column->depth;
    drawing->ids[n] = chunk->id[i];
    drawing->numbers[n] = chunk->number[i];
}

/* Row n has its shares. */
INLINED void end_row(Drawing *drawing, int n, lanes share, uint on)
{
    if (drawing->fetched)
        PREFETCH(places_of(drawing->fetched, drawing->numbers[n]));
    *(lanes *)(drawing->shares + n * LANES) = share;
    drawing->n_pieces += list_lanes(drawing->pieces + drawing->n_pieces, bits_of(share > 0.0f) & on, n * LANES);
}

/* Row n waits for its shares -> how many rows wait: not this one if none are on. */
INLINED int wait_for_shares(const Tile *t, Drawing *drawing, int n, const Chunk *chunk, int i, const Column *column, lanes_i u,
                            lanes_i v, lanes_i on)
{
    const int at = n * LANES;
    const lanes vf = REAL(v);              // as in `share_of`
    begin_row(t, drawing, n, chunk, i, column, u, v);
#if MASKS
    strips_of(chunk, i, column, u, v, drawing->strips + at);
#endif
    *(lanes *)(drawing->shares + at) = column->along;
    *(lanes *)(drawing->starts + at) = column->v0 - vf;
    *(lanes *)(drawing->stops + at) = column->v1 - vf;
    *(lanes *)(drawing->radii + at) = column->radius;
    drawing->on[n] = bits_of(on);
    return n + any_lane(on);
}

/* n rows get their shares, and their pieces are put into slots. */
ONCE void end_rows(Tile *t, Drawing *drawing, int n)
{
#define OF(member) (*(const lanes *)(drawing->member + k * LANES))
    for (int k = 0; k < n; ++k)
        end_row(drawing, k, share_between(OF(shares), OF(starts), OF(stops), OF(radii)), drawing->on[k]);
    put_pieces(t, drawing);
}

/* Open pixels of columns from row v on that a segment may touch, a bit each; open: all of each column's; v0: the tile's
   first row. */
INLINED lanes_i to_do(const Column *column, lanes_i open, lanes_i v, int v0)
{
    const lanes_i bottom = column->high < v0 + TILE ? column->high : v0 + TILE;
    const lanes_i on = (column->along > 0.0f) & (v < bottom);
    return on & (open & ((I(1) << (bottom - v0 & 15)) - 1)) >> (v - v0 & 15);
}

/* Look at segment i of a chunk, which leans: eight columns side by side, row by row.  They are few, and take more registers. */
ONCE void draw_leaning(Tile *t, Drawing *drawing, const View *view, const Chunk *chunk, int i)
{
    const int steep = chunk->steep[i], u0 = steep ? t->top : t->left, v0 = steep ? t->left : t->top;
    const lanes_i u = (int8)(0, 1, 2, 3, 4, 5, 6, 7) + u0;
    Column column;
    Outline outline;
    outline_of(chunk, i, view, u, &column, &outline);
    lanes_i v = column.low > v0 ? column.low : v0;
    lanes_i todo = to_do(&column, steep ? t->in_rows : t->in_columns, v, v0);
    for (int n = 0; any_lane(todo); ++n, v += 1, todo >>= 1) {
        begin_row(t, drawing, n, chunk, i, &column, u, v);
#if MASKS
        leaning_strips_of(chunk, i, &column, u, v, drawing->strips + n * LANES);
#endif
        end_row(drawing, n, share_within(&outline, v), bits_of((todo & 1) != 0));
    }
    put_pieces(t, drawing);
}

/* Look at two rows of each column of segment i of a chunk, after `skip` others: eight columns side by side, or four from the
   tile's `first` on and both rows -> whether there are more. */
INLINED bool draw_two(const Tile *t, Drawing *drawing, int *n, const View *view, const Chunk *chunk, int i, int first, int skip,
                      const bool few)
{
    const int steep = chunk->steep[i], u0 = steep ? t->top : t->left, v0 = steep ? t->left : t->top;
    const int *opens = (const int *)(steep ? &t->in_rows : &t->in_columns);
    const lanes_i u = (few ? (lanes_i)(0, 1, 2, 3, 0, 1, 2, 3) + first : (lanes_i)(0, 1, 2, 3, 4, 5, 6, 7)) + u0;
    const lanes_i open = few ? (lanes_i)(*(const int4 *)(opens + first), *(const int4 *)(opens + first)) : *(const lanes_i *)opens;
    Column column;
    column_of(chunk, i, view, u, &column);
    const lanes_i top = (column.low > v0 ? column.low : v0) + skip, todo = to_do(&column, open, top, v0);
    if (few) {
        const lanes_i second = (lanes_i)(0, 0, 0, 0, 1, 1, 1, 1);
        *n = wait_for_shares(t, drawing, *n, chunk, i, &column, u, top + second, (todo >> second & 1) != 0);
    } else {
        *n = wait_for_shares(t, drawing, *n, chunk, i, &column, u, top, (todo & 1) != 0);
        *n = wait_for_shares(t, drawing, *n, chunk, i, &column, u, top + 1, (todo & 2) != 0);
    }
    return any_lane(todo >> 2);
}

/* Draw two rows of n segments of a chunk that are listed, after `skip` others: see `draw_two`.  rows: how many wait -> how many
   segments have more, which are listed in place of all. */
INLINED int draw_rows(Tile *t, Drawing *drawing, int *rows, const View *view, const Chunk *chunk, ushort *list, int n,
                      const int *firsts, int skip, const bool few)
{
    int left = 0;
    for (int k = 0; k < n; ++k) {
        const int i = list[k];
        list[left] = i;
        left += draw_two(t, drawing, rows, view, chunk, i, few ? firsts[i] : 0, skip, few);
        if (*rows > MOST_COVERED - 2) {
            end_rows(t, drawing, *rows);
            *rows = 0;
        }
    }
    return left;
}

/* Draw the next m segments of a tile's list, in which so many are left. */
ONCE void draw(Tile *t, Drawing *drawing, const View *view, __global const uint2 *list, int m, uint left,
               __global const float8 *ends, __global const uint *ids, __global const uint *cuts)
{
    Chunk chunk;
    Drawn drawn;
    int rows = 0;
    prepare(&chunk, view, list, m, left, ends, ids, cuts);
    look_at(t, &chunk, m, &drawn);
    tell_ranges(t, drawing);
    for (int k = 0; k < drawn.n_leaning; ++k)
        draw_leaning(t, drawing, view, &chunk, drawn.leaning[k]);
    for (int skip = 0; drawn.n_few | drawn.n_many; skip += 2) {
        drawn.n_few = draw_rows(t, drawing, &rows, view, &chunk, drawn.few, drawn.n_few, drawn.firsts, skip, true);
        drawn.n_many = draw_rows(t, drawing, &rows, view, &chunk, drawn.many, drawn.n_many, drawn.firsts, skip, false);
    }
    end_rows(t, drawing, rows);
}
