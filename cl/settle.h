/*
 * The pieces of a pixel put in order and hidden behind each other, where LANES is not 1.  What the processor foresees wrong
 * costs most here: so a few pieces are put in order without a branch, with all that is known of them, and what can be told
 * of each is told before the loop that hides one after the other.  hiding.h uses this, and has what it needs before.
 */
#define AT_ONE_TIME 16               // pieces whose order fits into 64 bits

/* Pieces of a pixel in their order, and how many of them are to be hidden. */
typedef struct {
    int depths[SLOTS + 4] ALIGNED;
    uint ids[SLOTS + 4] ALIGNED;
    float shares[SLOTS + 4] ALIGNED;
#if MASKS
    int slots[SLOTS + 4] ALIGNED;    // where each is
#endif
    uint near;                       // those whose ids follow the ones before them, a bit each: of few pieces
    uint soon;                       // those that are hidden now, a bit each, by their slots
} Ordered;

typedef int8 int8_at_4 __attribute__((aligned(4)));

/* Eight from 8 * g on of the lanes of one vector or two, in the order that has four bits for each. */
INLINED int8 in_order_of(const int8 *v, const int vectors, ulong order, int g)
{
    const int8 which = as_int8((uint8)((uint)(order >> 32 * g)) >> (uint8)(0, 4, 8, 12, 16, 20, 24, 28) & 15);
    const int8 first = lanes_at(v[0], which);
    return vectors == 1 ? first : which > 7 ? lanes_at(v[1], which) : first;
}

/* Put n pieces in order, 8 * vectors at most, and into `glow` behind those that wait there -> whether it is their order: not
   if some lie at one depth.  until: the depth from which on they stay, or INT_MAX. */
INLINED bool few_in_order(const Slots *slots, int n, const int vectors, int until, uint pixel, Ordered *pieces, Glow *glow)
{
    const int8 lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    int depths[AT_ONE_TIME] ALIGNED;
    int8 depth[2], id[2], share[2], number[2], where[2], rank[2], ranks = 0;
    pieces->soon = pieces->near = 0;
    #pragma unroll 2
    for (int g = 0; g < vectors; ++g) {
        const int8 a = *(const int8 *)(slots->keys + 8 * g), b = *(const int8 *)(slots->keys + 8 * g + 4);
        depth[g] = lane < n - 8 * g ? (int8)(a.s1357, b.s1357) : (int8)(INT_MAX);   // little-endian, as devices with LANES are
        id[g] = (int8)(a.s0246, b.s0246);
        share[g] = *(const int8_at_4 *)(slots->shares + 8 * g);
        number[g] = *(const int8_at_4 *)(slots->numbers + 8 * g);
        where[g] = (*(const int8_at_4 *)(slots->wheres + 8 * g) & 0xFFFF) | (int)(pixel << 16);
        pieces->soon |= bits_of(depth[g] < until) << 8 * g;
        *(int8 *)(depths + 8 * g) = depth[g];
        rank[g] = 0;
    }
    if (!pieces->soon)
        return true;
    #pragma nounroll                 // it would be turned into shuffles
    for (int k = 0; k < n; k += 4) {
        #pragma unroll 2
        for (int g = 0; g < vectors; ++g)
            rank[g] -= (depths[k] < depth[g]) + (depths[k + 1] < depth[g])
                + (depths[k + 2] < depth[g]) + (depths[k + 3] < depth[g]);
    }
    ulong4 places = 0;
    #pragma unroll 2
    for (int g = 0; g < vectors; ++g) {
        ranks |= (int8)1 << rank[g];
        const uint8 bits = as_uint8(rank[g] * 4);
        places |= (ulong4)(0, 1, 2, 3) + (ulong)(8 * g) << __builtin_convertvector(bits.lo, ulong4);
        places |= (ulong4)(4, 5, 6, 7) + (ulong)(8 * g) << __builtin_convertvector(bits.hi, ulong4);
    }
    const ulong order = (places.x | places.y) | (places.z | places.w);
    #pragma unroll 2
    for (int g = 0; g < vectors; ++g) {
        const int8 its = in_order_of(id, vectors, order, g), step = its - in_order_of(id, vectors, order << 4, g);
        pieces->near |= bits_of(as_int8(as_uint8(step + 1) <= 2u)) << 8 * g;
        *(int8 *)(pieces->depths + 8 * g) = in_order_of(depth, vectors, order, g);
        *(int8 *)(pieces->ids + 8 * g) = its;
        *(int8 *)(pieces->shares + 8 * g) = in_order_of(share, vectors, order, g);
        *(int8_at_4 *)(glow->numbers + glow->n + 8 * g) = in_order_of(number, vectors, order, g);
        *(int8_at_4 *)(glow->wheres + glow->n + 8 * g) = in_order_of(where, vectors, order, g);
#if MASKS
        for (int k = 8 * g; k < 8 * g + 8; ++k)
            pieces->slots[k] = order >> 4 * k & 15;
#endif
    }
    pieces->near &= ~1u;
    const int4 four = ranks.lo | ranks.hi;
    const uint all = (four.x | four.y) | (four.z | four.w), each = (1u << n) - 1;
    return (all & each) == each;
}

/* As that, any pieces, by their keys. */
ONCE void all_in_order(Slots *slots, int n, long until, uint pixel, Ordered *pieces, Glow *glow)
{
    pieces->soon = pieces->near = 0;
    slots->keys[n] = slots->keys[n + 1] = slots->keys[n + 2] = LONG_MAX;   // those that fill the last four
    for (int j = 0; j < n; j += 4) {
        const long4 mine = *(const long4 *)(slots->keys + j);
        long4 rank = 0;
        for (int k = 0; k < n; k += 4) {
            rank -= slots->keys[k] < mine;
            rank -= slots->keys[k + 1] < mine;
            rank -= slots->keys[k + 2] < mine;
            rank -= slots->keys[k + 3] < mine;
        }
        for (int k = j; k < j + 4 && k < n; ++k) {
            const long key = slots->keys[k], place = LANE_L(rank, k - j);
            pieces->depths[place] = (int)(key >> 32);
            pieces->ids[place] = (uint)key;
            pieces->shares[place] = slots->shares[k];
            glow->numbers[glow->n + place] = slots->numbers[k];
            glow->wheres[glow->n + place] = (slots->wheres[k] & 0xFFFF) | pixel << 16;
#if MASKS
            pieces->slots[place] = k;
#endif
            pieces->soon |= (uint)(key < until) << k;
        }
    }
}

INLINED void put_in_order(Slots *slots, int n, long until, uint pixel, Ordered *pieces, Glow *glow)
{
    const int depth = (int)(until >> 32);
    const bool is_depth = !(uint)until || until == LONG_MAX;
    if (!is_depth || n > AT_ONE_TIME || !(n <= 8 ? few_in_order(slots, n, 1, depth, pixel, pieces, glow)
                                  : few_in_order(slots, n, 2, depth, pixel, pieces, glow)))
        all_in_order(slots, n, until, pixel, pieces, glow);
}

/* The chains of a pixel: of the numbers n of pieces beside each, n - before <= span. */
typedef struct {
    uint8 before, span;
    uint begun;                      // so many since the first: each takes the next lane; `chains` of a pixel
} Chains;

/* A piece begins the next chain -> its lane. */
INLINED uint begin_chain(Chains *c, uint id)
{
    const uint chain = c->begun++ % CHAINS;
    const int8 here = (uint8)(0, 1, 2, 3, 4, 5, 6, 7) == chain;
    c->before = here ? id - 1 : c->before;
    c->span = here ? 2 : c->span;
    return chain;
}

/* A piece goes on with the first of the chains that it lies beside -> its lane. */
INLINED uint go_on_with_chain(Chains *c, uint id, uint beside)
{
    const uint chain = first_of(beside);
    const int8 here = (uint8)(0, 1, 2, 3, 4, 5, 6, 7) == chain;
    const uint8 low = c->before + 1, high = c->before + c->span - 1;
    const uint8 lower = id < low ? id : low, higher = id > high ? id : high;
    c->before = here ? lower - 1 : c->before;
    c->span = here ? higher - lower + 2 : c->span;
    return chain;
}

#if MASKS
/* What a piece leaves of the pixel's light, patch by patch; where: of what is seen of it. */
INLINED float hide_strip(Pixel *p, const Strip *strip, uint chain, bool begins, uint *where)
{
    float areas[PATCHES] ALIGNED, hidden[PATCHES] ALIGNED;
    areas_of(strip, areas);
    const float left = hide_patches(p->left, p->covered[chain], areas, begins, hidden);
    *where = place_seen(strip, hidden) | (uint)p->number << 16;
    return left;
}
#else
/* What the first piece of a chain takes of the pixel's light. */
INLINED float hide_first(Pixel *p, float kept, float share, uint chain)
{
    const float sum = share < 1.0f ? share : 1.0f;
    ((float *)&p->sums)[chain] = sum;
    return kept * sum;
}

/* What one takes that lies beside others of its chain. */
INLINED float hide_beside(Pixel *p, float kept, float share, uint chain)
{
    const float before = ((float *)&p->sums)[chain], grown = before + share, sum = grown < 1.0f ? grown : 1.0f;
    ((float *)&p->sums)[chain] = sum;
    return before < 1.0f ? kept * (sum - before) / (1.0f - before) : 0.0f;
}
#endif

/* Hide those of n pieces whose keys are below `until`, of which no more will come -> those that are left. */
INLINED int settle(Pixel *p, const Picture *picture, Slots *slots, int n, long until)
{
    Glow *glow = picture->glow;
    Ordered pieces;
    put_in_order(slots, n, until, p->number, &pieces, glow);
    if (!pieces.soon)
        return n;
    const int m = __builtin_popcount(pieces.soon);
    Chains chains = {p->lows - 1, p->lows > p->highs ? 0 : p->highs - p->lows + 2, p->chains};
    float kept = p->kept, room = p->room, most = p->most;
    uint next = p->next;
    int i = 0, best = -1;
    bool more = kept * room > UNSEEN;
    while (more && i < m) {
        if (RARELY((uint)pieces.depths[i] >= next)) {
            p->kept = kept;
            pass_events(p, picture, (uint)pieces.depths[i]);
            room = p->room;
            next = p->next;
            more = kept * room > UNSEEN;
            continue;
        }
        const uint id = pieces.ids[i], beside = bits_of(as_int8(id - chains.before <= chains.span));
#if MASKS
        const uint chain = beside ? go_on_with_chain(&chains, id, beside) : begin_chain(&chains, id);
        const float rest = hide_strip(p, &slots->strips[pieces.slots[i]], chain, !beside, glow->wheres + glow->n + i);
        const float hidden = kept - rest;
        kept = rest;
#else
        float hidden;
        if (RARELY(pieces.near >> i & 1) || RARELY(beside))   // the first is known early, and then the second is true too
            hidden = hide_beside(p, kept, pieces.shares[i], go_on_with_chain(&chains, id, beside));
        else
            hidden = hide_first(p, kept, pieces.shares[i], begin_chain(&chains, id));
        kept -= hidden;
#endif
        float weight = hidden * room;
        if (RARELY(!(kept * room > UNSEEN))) {
            weight += kept * room;
            kept = 0.0f;
            more = false;
        }
        best = weight > most ? i : best;
        most = weight > most ? weight : most;
        glow->weights[glow->n + i++] = weight;
    }
    p->kept = kept;
    p->most = most;
    if (best >= 0)
        p->best = (ulong)pieces.depths[best] << 32 | pieces.ids[best];
    p->lows = chains.before + 1;
    p->highs = chains.before + chains.span - 1;
    p->chains = chains.begun;
    p->closed = !more;
    if (picture->lit)
        add_glow(glow, &picture->sent, i);
    if (i == n || !more)
        return 0;
    int left = 0;
    for (uint bits = ~pieces.soon & (uint)((1ul << n) - 1); bits; bits &= bits - 1, ++left) {
        const int j = __builtin_ctz(bits);
        COPY_PIECE(slots, left, slots, j)
    }
    return left;
}
