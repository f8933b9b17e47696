/*
 * Pieces of a tile whose pixels have no more slots: they wait in a list in global memory.  Those that nothing can come before
 * any more are put in order of their keys by a radix sort, which takes as long for each however many there are, and are hidden
 * slots by slots.  A list that is too long keeps the nearest; the tile's segments are gone through once more for the others.
 * A tile takes a list when it first needs one and gives it back at its end; where none is free it does without.  tile.h
 * and tiles.h use this.
 */
#define NO_LIST (-1)                 // none is needed so far;
#define NONE_FREE (-2)
#define RADIX 256                    // keys go by so many values at a time

typedef struct {
    ulong key;                       // depth << 32 | id
    float share;
    uint where, number, pixel;       // as in `Slots`, and the pixel in the tile
#if MASKS
    Strip strip;
#endif
} Piece;
typedef char a_piece_fits[sizeof(Piece) + 2 * sizeof(ulong2) <= 4 * OF_PIECE ? 1 : -1];

/* All lists. */
typedef struct {
    uint n, most;                    // lists; pieces that may be left in one when its tile goes on
    volatile __global uint *busy;    // [n] 1: a tile has it
    volatile __global uint *again;   // [1] how often a tile's segments were gone through once more
    __global uint *memory;           // [n, most + AT_MOST, OF_PIECE]
} Lists;
#define AT_MOST (TILE * TILE * (CHUNK + SLOTS))   // pieces that come of a chunk, and of all slots

/* That of a tile. */
typedef struct {
    const Lists *lists;
    int list;                        // which, or one of the above
    uint n, goal;                    // pieces; so many are wanted before any are hidden
    long limit;                      // keys from here on have gone, and come again later
    __global Piece *pieces;
    __global ulong2 *orders[2];      // keys, and which piece has each
} Overflow;

#define LEAST_GOAL 1024

/* Take a list that no other tile has, if there is one. */
INLINED void take_list(Overflow *over)
{
    const Lists *lists = over->lists;
    for (uint k = 0; k < lists->n && over->list == NO_LIST; ++k)
        if (!atomic_xchg(&lists->busy[k], 1)) {
            const size_t rows = lists->most + AT_MOST;
            over->list = k;
            over->orders[0] = (__global ulong2 *)(lists->memory + k * rows * OF_PIECE);
            over->orders[1] = over->orders[0] + rows;
            over->pieces = (__global Piece *)(over->orders[1] + rows);
            over->goal = LEAST_GOAL < lists->most ? LEAST_GOAL : lists->most;
        }
    if (over->list == NO_LIST)
        over->list = NONE_FREE;
}

INLINED void give_list_back(Overflow *over)
{
    if (over->list >= 0)
        atomic_xchg(&over->lists->busy[over->list], 0);
}

/* Put a pixel's n pieces whose keys are below `limit` into its tile's list. */
ONCE void put_into_list(Overflow *over, const Slots *slots, int n, uint pixel, long limit)
{
    for (int k = 0; k < n; ++k) {
        __global Piece *piece = over->pieces + over->n;
        piece->key = slots->keys[k];
        piece->share = slots->shares[k];
        piece->where = slots->wheres[k];
        piece->number = slots->numbers[k];
        piece->pixel = pixel;
#if MASKS
        piece->strip = slots->strips[k];
#endif
        over->n += slots->keys[k] < limit;
    }
}

INLINED void take_from_list(Slots *slots, int k, __global const Piece *piece)
{
    slots->keys[k] = piece->key;
    slots->shares[k] = piece->share;
    slots->wheres[k] = piece->where;
    slots->numbers[k] = piece->number;
#if MASKS
    slots->strips[k] = piece->strip;
#endif
}

/* The keys of those pieces of a list that lie below `before` in pixels that are open, in order -> in which array. */
ONCE __global const ulong2 *in_order(const Overflow *over, ulong open, long before, uint *n)
{
    __global ulong2 *from = over->orders[0], *to = over->orders[1];
    ulong differ = 0;
    uint m = 0;
    for (uint i = 0; i < over->n; ++i) {
        const ulong key = over->pieces[i].key;
        if ((long)key < before && open >> over->pieces[i].pixel & 1) {
            from[m++] = (ulong2)(key, i);
            differ |= key ^ from[0].x;
        }
    }
    *n = m;
    for (int bits = 0; bits < 64; bits += 8) {   // of equal ones those that come first stay first
        if (!(differ >> bits & RADIX - 1))
            continue;
        uint ends[RADIX + 1];
        for (int k = 0; k <= RADIX; ++k)
            ends[k] = 0;
        for (uint i = 0; i < m; ++i)
            ++ends[(from[i].x >> bits & RADIX - 1) + 1];
        for (int k = 1; k <= RADIX; ++k)
            ends[k] += ends[k - 1];
        for (uint i = 0; i < m; ++i) {
            const ulong2 it = from[i];
            to[ends[it.x >> bits & RADIX - 1]++] = it;
        }
        __global ulong2 *other = from;
        from = to;
        to = other;
    }
    return from;
}

/* Keep those pieces of a list whose keys lie from `from` on and below `until`, in pixels that are open. */
ONCE void keep_in_list(Overflow *over, ulong open, long from, long until)
{
    uint left = 0;
    for (uint i = 0; i < over->n; ++i) {
        const long key = (long)over->pieces[i].key;
        if (left < i)
            over->pieces[left] = over->pieces[i];
        left += key >= from && key < until && open >> over->pieces[left].pixel & 1;
    }
    over->n = left;
}
