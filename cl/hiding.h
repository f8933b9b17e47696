/*
 * The pieces of strands in one pixel, hidden behind each other, the body's samples and shell fur, and their light added up:
 * C += T a c, T *= 1 - a, but pieces of one strand lie beside each other.  Where less than 1/256 of the light is left no
 * more strands are looked at: the last one takes the rest, or what is behind them all.  coverage.cl uses this.
 */
#include "glow.h"
#if MASKS
#include "mask.h"
#define OF_PIXEL MASKED_PIXEL
#define OF_WALK MASKED_WALK
#define OF_PIECE MASKED_PIECE
#else
#define OF_PIXEL KEPT_PIXEL
#define OF_WALK WALK
#define OF_PIECE PIECE
#endif

#define CHAINS 8                     // strands whose pieces in a pixel are remembered: these lie beside each other, not behind

/* What is known of pieces, and of what else stands in pixels, and what is told of them. */
typedef struct {
    int samples, has_shells, lit;    // 1: there is shell fur; there is light
    __global const ulong *visible, *sample_shells;
    Sent sent;                       // what there is known of light
    __global float *body_transmittance, *alpha;
    __global ulong *front, *shell_front;
    __global float4 *image;
    Glow *glow;                      // light that waits, where LANES go side by side
#if LANES == 1
    uint room;                       // for pieces that are told in place of their light; 0: none are
    volatile __global uint *taken;   // [1] of these
    __global uint *told;             // [room, 3] pixel, number, weight
#endif
} Picture;

#if LANES == 1
#define FOUR(p) ((long4)((p)[0], (p)[1], (p)[2], (p)[3]))
#else
#define FOUR(p) (*(const long4 *)(p))
#endif

/* The pieces of a pixel that wait, in any order. */
typedef struct {
    long keys[SLOTS + 4] ALIGNED;    // depth << 32 | id
    float shares[SLOTS + 4];         // of the pixel's area
    uint wheres[SLOTS + 4];          // on the segment, in 1/65535 of its length; 16 bits are free
    uint numbers[SLOTS + 4];         // the segment's, among those that are seen
#if MASKS
    Strip strips[SLOTS + 4] ALIGNED; // what its strand is like in the pixel
#endif
} Slots;

#if MASKS
#define COPY_STRIP(to, i, from, j) (to)->strips[i] = (from)->strips[j];
#else
#define COPY_STRIP(to, i, from, j)
#endif
#define COPY_PIECE(to, i, from, j)            \
    {                                         \
        (to)->keys[i] = (from)->keys[j];      \
        (to)->shares[i] = (from)->shares[j];  \
        (to)->wheres[i] = (from)->wheres[j];  \
        (to)->numbers[i] = (from)->numbers[j];\
        COPY_STRIP(to, i, from, j)            \
    }

/* One pixel on its way. */
typedef struct {
    size_t at;                       // in the picture
    float kept, room, most, of_body, of_shells, all_shells;   // light that strands let through; share of samples that are open;
                                     // of what fills most of it; of body and shells; that these hide in all
    float4 light;
    ulong best;                      // of what fills most of it so far, strands alone
    uint8 lows, highs;               // numbers of each chain's pieces
    float8 sums;                     // and what they cover
    uint chains, oldest;
    int event, events;               // samples end, or go on behind shells: the next one
    uint depths[2 * SAMPLES];        // where, in order
    uchar which[2 * SAMPLES];        // 2 · sample + 1 where it ends
    float open[SAMPLES];             // share of the pixel that goes on
    float through[SAMPLES];          // share of the body's light that shells let through, and strands where it has ended
    bool closed;
#if LANES > 1
    uchar number;                    // in its tile
#endif
#if MASKS
    float left[PATCHES] ALIGNED;     // what strands let through of each patch; `kept` is the mean
    float covered[CHAINS][PATCHES] ALIGNED;   // what each chain's pieces cover of them
#endif
} Pixel;
typedef char a_pixel_fits[sizeof(Pixel) <= 16 * OF_PIXEL ? 1 : -1];

#if MASKS
#define COPY_PATCHES(to, from)                                \
    for (int i = 0; i < PATCHES; ++i) {                       \
        (to)->left[i] = (from)->left[i];                      \
        for (int chain = 0; chain < CHAINS; ++chain)          \
            (to)->covered[chain][i] = (from)->covered[chain][i]; \
    }
#else
#define COPY_PATCHES(to, from)
#endif

/* Copy what has become of a pixel; the rest is as `begin_pixel` left it.  Member by member: see COPY of pixels.h. */
#define COPY_PIXEL(to, from, samples)              \
    {                                              \
        (to)->kept = (from)->kept;                 \
        (to)->room = (from)->room;                 \
        (to)->most = (from)->most;                 \
        (to)->of_body = (from)->of_body;           \
        (to)->of_shells = (from)->of_shells;       \
        (to)->light = (from)->light;               \
        (to)->best = (from)->best;                 \
        (to)->lows = (from)->lows;                 \
        (to)->highs = (from)->highs;               \
        (to)->sums = (from)->sums;                 \
        (to)->chains = (from)->chains;             \
        (to)->oldest = (from)->oldest;             \
        (to)->event = (from)->event;               \
        (to)->closed = (from)->closed;             \
        COPY_PATCHES(to, from)                     \
        for (int j = 0; j < samples; ++j) {        \
            (to)->open[j] = (from)->open[j];       \
            (to)->through[j] = (from)->through[j]; \
        }                                          \
    }

/* Begin with pixel `at`; how far it can be seen into: to the body where that fills it. */
INLINED uint begin_pixel(Pixel *p, const Picture *picture, size_t at)
{
    const int samples = picture->samples;
    uint furthest = 0;
    int events = 0;
    p->at = at;
    p->kept = p->room = 1.0f;
    p->most = p->of_body = p->of_shells = p->all_shells = 0.0f;
    p->light = 0.0f;
    p->best = ~0ul;
    p->lows = 0xFFFFFFFEu;
    p->highs = 0;
    p->sums = 0.0f;
    p->chains = p->oldest = 0;
    p->event = 0;
    p->closed = false;
#if MASKS
    for (int i = 0; i < PATCHES; ++i)
        p->left[i] = 1.0f;
#endif
    for (int s = 0; s < samples; ++s) {
        const size_t sample = at * samples + s;
        const uint body = picture->visible[sample] >> 32;
        furthest = body > furthest ? body : furthest;
        p->open[s] = 1.0f / samples;
        p->through[s] = picture->has_shells ? picture->body_transmittance[sample] : 1.0f;
        p->all_shells += (1.0f - p->through[s]) / samples;
        for (int kind = picture->has_shells ? 0 : 1; kind < 2; ++kind) {
            uint depth = body;
            if (!kind) {
                const uint shell = picture->sample_shells[sample] >> 32;
                depth = shell < depth ? shell : depth;
                if (!(p->through[s] < 1.0f))
                    continue;
            } else if (depth == NOTHING) {
                continue;
            }
            int k = events++;
            for (; k > 0 && p->depths[k - 1] > depth; --k) {
                p->depths[k] = p->depths[k - 1];
                p->which[k] = p->which[k - 1];
            }
            p->depths[k] = depth;
            p->which[k] = 2 * s + kind;
        }
    }
    p->events = events;
    return furthest;
}

/* The next sample ends, or goes on behind shells. */
INLINED void pass_event(Pixel *p, int samples)
{
    const int s = p->which[p->event] / 2;
    if (p->which[p->event] & 1) {
        p->through[s] = p->open[s] * samples * p->kept;
        p->of_body += p->open[s] * p->kept;
        p->open[s] = 0.0f;
    } else {
        p->of_shells += p->open[s] * (1.0f - p->through[s]) * p->kept;
        p->open[s] *= p->through[s];
    }
    ++p->event;
    float room = 0.0f;
    for (int k = 0; k < samples; ++k)
        room += p->open[k];
    p->room = room;
}

INLINED int first_lane(uint8 mask)
{
#if LANES == 1
    const uint8 b = mask & (uint8)(1, 2, 4, 8, 16, 32, 64, 128);
    const uint4 c = b.lo | b.hi;
    const uint m = (c.x | c.y) | (c.z | c.w);
    for (int k = 0; k < CHAINS; ++k)
        if (m >> k & 1)
            return k;
    return CHAINS;
#else
    return first_of(bits_of(as_int8(mask)) | 1 << CHAINS);
#endif
}

/* The chain of a piece, a new one if `*begins`: pieces of one strand follow each other in number. */
INLINED int chain_of(Pixel *p, uint id, bool *begins)
{
    const uint8 lane = (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    int chain = first_lane(as_uint8((id + 1 >= p->lows) & (id <= p->highs + 1)));
    *begins = chain == CHAINS;
    if (chain == CHAINS) {
        chain = p->chains < CHAINS ? p->chains++ : p->oldest;
        p->oldest = p->chains < CHAINS ? 0 : (chain + 1) % CHAINS;
        const int8 here = lane == (uint)chain;
        p->lows = here ? id : p->lows;
        p->highs = here ? id : p->highs;
    } else {
        const int8 here = lane == (uint)chain;
        p->lows = here & as_int8(p->lows > id) ? id : p->lows;
        p->highs = here & as_int8(p->highs < id) ? id : p->highs;
    }
    return chain;
}

#if MASKS
/* Hide a piece behind what came before it, patch by patch -> what it takes of the pixel's light.  whole: the pixel. */
INLINED float take(Pixel *p, Pixel *whole, long key, const Strip *strip, float *hidden)
{
    bool begins;
    const int chain = chain_of(p, (uint)key, &begins);
    float areas[PATCHES] ALIGNED;
    areas_of(strip, areas);
    const float before = p->kept;
    p->kept = hide_patches(whole->left, whole->covered[chain], areas, begins, hidden);
    return before - p->kept;
}
#else
/* Hide a piece behind what came before it -> what it takes of the pixel's light.  sums: the pixel's. */
INLINED float take(Pixel *p, float8 *sums, long key, float share)
{
    bool begins;
    const int chain = chain_of(p, (uint)key, &begins);
#if LANES == 1                           // without a pointer to it: llvmpipe would keep all that is known of a pixel in memory
    const int8 here = (uint8)(0, 1, 2, 3, 4, 5, 6, 7) == (uint)chain;
    const float8 its = here ? *sums : 0.0f;
    const float4 four = its.lo + its.hi;
    const float before = begins ? 0.0f : (four.x + four.y) + (four.z + four.w);
#else
    const float before = begins ? 0.0f : ((float *)sums)[chain];
#endif
    const float grown = before + share, sum = grown < 1.0f ? grown : 1.0f;
#if LANES == 1
    *sums = here ? sum : *sums;
#else
    ((float *)sums)[chain] = sum;
#endif
    const float hidden = begins ? p->kept * sum : before < 1.0f ? p->kept * (sum - before) / (1.0f - before) : 0.0f;
    p->kept -= hidden;
    return hidden;
}
#endif

/* The share of the pixel's light that a piece has which has taken so much. */
INLINED float weight_of(Pixel *p, long key, float hidden)
{
    float weight = hidden * p->room;
    if (RARELY(!(p->kept * p->room > UNSEEN))) {
        weight += p->kept * p->room;
        p->kept = 0.0f;
    }
    const bool best = weight > p->most;
    p->most = best ? weight : p->most;
    p->best = best ? key : p->best;
    return weight;
}

/* The slots are full: the furthest piece goes, and with it all from its key on. */
INLINED void drop(Slots *slots, long *limit)
{
    int far = 0;
    for (int k = 1; k < SLOTS; ++k)
        far = slots->keys[k] > slots->keys[far] ? k : far;
    *limit = slots->keys[far] < *limit ? slots->keys[far] : *limit;
    COPY_PIECE(slots, far, slots, SLOTS - 1)
}

/* Add the light of a piece; where: on its segment, in 1/65535. */
INLINED void shine(const Picture *picture, Pixel *p, float weight, uint number, uint where)
{
#if LANES == 1
    if (picture->room) {
        const uint k = atomic_inc(picture->taken);
        if (k < picture->room) {
            picture->told[3 * k] = (uint)p->at;
            picture->told[3 * k + 1] = number;
            picture->told[3 * k + 2] = as_uint(weight);
        }
        return;
    }
    const View *view = picture->sent.view;
    const int x = view->rows.z + (int)(p->at % view->size.x), y = view->rows.x + (int)(p->at / view->size.x);
    const float4 light = sent_by(&picture->sent, number, (where & 0xFFFF) * (1.0f / 65535.0f), weight, x + 0.5f, y + 0.5f);
    p->light += weight * (light < MOST ? light : MOST);
#else
    add_glow(picture->glow, &picture->sent, p->number, weight, number, where);
#endif
}

#if LANES > 1 && !MASKS
#define FEW 16                       // pieces that are put in order without a loop

/* Pieces of a pixel in their order. */
typedef struct {
    int depths[SLOTS + 8] ALIGNED;
    uint ids[SLOTS + 8] ALIGNED;
    float shares[SLOTS + 8] ALIGNED;
    uint near;                       // those whose ids follow those of the ones before them, a bit each
} Ordered;

typedef int8 int8_at_4 __attribute__((aligned(4)));

/* The numbers of up to 16 lanes that `order` tells, four bits each; eight of them, from 8 * g on. */
INLINED int8 among(const int8 *v, const int groups, ulong order, int g)
{
    const int8 which = as_int8((uint8)((uint)(order >> 32 * g)) >> (uint8)(0, 4, 8, 12, 16, 20, 24, 28) & 15);
    const int8 first = lanes_at(v[0], which);
    return groups == 1 ? first : which > 7 ? lanes_at(v[groups - 1], which) : first;
}

/* Put n pieces of different depths in order, 8 * groups at most -> whether they were. soon: of those that lie before a depth, a bit each. */
INLINED bool few_in_order(const Slots *slots, int n, const int groups, int until, uint pixel, Ordered *row, Waiting to, uint *soon)
{
    const int8 lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    int depths[FEW] ALIGNED;
    int8 depth[2], id[2], share[2], number[2], where[2], rank[2], ones = 0;
    *soon = 0;
    #pragma unroll
    for (int g = 0; g < groups; ++g) {
        const int8 a = *(const int8 *)(slots->keys + 8 * g), b = *(const int8 *)(slots->keys + 8 * g + 4);
        depth[g] = lane < n - 8 * g ? (int8)(a.s1357, b.s1357) : (int8)(INT_MAX);
        id[g] = (int8)(a.s0246, b.s0246);
        share[g] = *(const int8_at_4 *)(slots->shares + 8 * g);
        number[g] = *(const int8_at_4 *)(slots->numbers + 8 * g);
        where[g] = *(const int8_at_4 *)(slots->wheres + 8 * g) & 0xFFFF | (int)(pixel << 16);
        *(int8 *)(depths + 8 * g) = depth[g];
        *soon |= bits_of_eight(depth[g] < until) << 8 * g;
        rank[g] = 0;
    }
    if (!*soon)
        return true;
    #pragma nounroll
    for (int k = 0; k < n; k += 4) {
        #pragma unroll
        for (int g = 0; g < groups; ++g)
            rank[g] -= (depths[k] < depth[g]) + (depths[k + 1] < depth[g]) + (depths[k + 2] < depth[g]) + (depths[k + 3] < depth[g]);
    }
    ulong4 places = 0;
    #pragma unroll
    for (int g = 0; g < groups; ++g) {
        ones |= (int8)1 << rank[g];
        const uint8 bits = as_uint8(rank[g] * 4);
        places |= (ulong4)(0, 1, 2, 3) + (ulong)(8 * g) << __builtin_convertvector(bits.lo, ulong4);
        places |= (ulong4)(4, 5, 6, 7) + (ulong)(8 * g) << __builtin_convertvector(bits.hi, ulong4);
    }
    const ulong order = (places.x | places.y) | (places.z | places.w);
    const int4 four = ones.lo | ones.hi;
    const uint all = (four.x | four.y) | (four.z | four.w), wanted = (1u << n) - 1;
    row->near = 0;
    #pragma unroll
    for (int g = 0; g < groups; ++g) {
        const int8 its = among(id, groups, order, g), step = its - among(id, groups, order << 4, g);
        row->near |= bits_of_eight(as_int8(as_uint8(step + 1) <= 2u)) << 8 * g;
        *(int8 *)(row->depths + 8 * g) = among(depth, groups, order, g);
        *(int8 *)(row->ids + 8 * g) = its;
        *(int8 *)(row->shares + 8 * g) = among(share, groups, order, g);
        *(int8_at_4 *)(to.numbers + 8 * g) = among(number, groups, order, g);
        *(int8_at_4 *)(to.wheres + 8 * g) = among(where, groups, order, g);
    }
    row->near &= ~1u;
    return (all & wanted) == wanted;
}

/* As that, any pieces. */
ONCE void in_order_by_keys(Slots *slots, int n, long until, uint pixel, Ordered *row, Waiting to, uint *soon)
{
    *soon = row->near = 0;
    slots->keys[n] = slots->keys[n + 1] = slots->keys[n + 2] = LONG_MAX;   // those that fill the last four
    for (int j = 0; j < n; j += 4) {         // each one's rank: how many are nearer
        const long4 mine = FOUR(slots->keys + j);
        long4 rank = 0;
        for (int k = 0; k < n; k += 4) {
            rank -= slots->keys[k] < mine;
            rank -= slots->keys[k + 1] < mine;
            rank -= slots->keys[k + 2] < mine;
            rank -= slots->keys[k + 3] < mine;
        }
        for (int k = 0; k < 4 && j + k < n; ++k) {
            const int r = ((long *)&rank)[k], i = j + k;
            row->depths[r] = (int)(slots->keys[i] >> 32);
            row->ids[r] = (uint)slots->keys[i];
            row->shares[r] = slots->shares[i];
            to.numbers[r] = slots->numbers[i];
            to.wheres[r] = (slots->wheres[i] & 0xFFFF) | pixel << 16;
            *soon |= (uint)(slots->keys[i] < until) << i;
        }
    }
}

INLINED uint next_event(const Pixel *p)
{
    return p->event < p->events ? p->depths[p->event] : NOTHING;
}

/* Hide those of n pieces whose keys are below `until`, of which no more will come -> those that are left. */
INLINED int settle(Pixel *p, const Picture *picture, Slots *slots, int n, long until)
{
    const Waiting to = waiting(picture->glow);
    const bool plain = n <= FEW && ((uint)until == 0 || until == LONG_MAX);
    Ordered row;
    uint soon;
    if (!(plain && (n <= 8 ? few_in_order(slots, n, 1, (int)(until >> 32), p->number, &row, to, &soon)
                    : few_in_order(slots, n, 2, (int)(until >> 32), p->number, &row, to, &soon))))
        in_order_by_keys(slots, n, until, p->number, &row, to, &soon);
    if (!soon)
        return n;
    const int m = __builtin_popcount(soon);
    const uint8 lane = (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    float kept = p->kept, room = p->room, most = p->most;
    uint8 base = p->lows - 1, span = p->lows > p->highs ? 0 : p->highs - p->lows + 2;
    uint begun = p->chains, next = next_event(p);
    int i = 0, best = -1;
    bool more = kept * room > UNSEEN;
    while (more && i < m) {
        const uint id = row.ids[i];
        if (RARELY((uint)row.depths[i] >= next)) {
            p->kept = kept;
            pass_event(p, picture->samples);
            room = p->room;
            next = next_event(p);
            more = kept * room > UNSEEN;
            continue;
        }
        const float share = row.shares[i];
        const uint beside = bits_of_eight(as_int8(id - base <= span));
        float hidden;
        if (RARELY(row.near >> i & 1) || RARELY(beside)) {
            const int chain = first_of(beside);
            const int8 here = lane == (uint)chain;
            const uint8 low = base + 1, high = base + span - 1;
            const uint8 new_low = id < low ? id : low, new_high = id > high ? id : high;
            base = here ? new_low - 1 : base;
            span = here ? new_high - new_low + 2 : span;
            const float before = ((float *)&p->sums)[chain], grown = before + share, sum = grown < 1.0f ? grown : 1.0f;
            ((float *)&p->sums)[chain] = sum;
            hidden = before < 1.0f ? kept * (sum - before) / (1.0f - before) : 0.0f;
        } else {
            const uint chain = begun++ % CHAINS;
            const int8 here = lane == chain;
            base = here ? id - 1 : base;
            span = here ? 2 : span;
            const float sum = share < 1.0f ? share : 1.0f;
            ((float *)&p->sums)[chain] = sum;
            hidden = kept * sum;
        }
        kept -= hidden;
        float weight = hidden * room;
        if (RARELY(!(kept * room > UNSEEN))) {
            weight += kept * room;
            kept = 0.0f;
            more = false;
        }
        best = weight > most ? i : best;
        most = weight > most ? weight : most;
        to.weights[i++] = weight;
    }
    p->kept = kept;
    p->most = most;
    if (best >= 0)
        p->best = (ulong)row.depths[best] << 32 | row.ids[best];
    p->lows = base + 1;
    p->highs = base + span - 1;
    p->chains = begun;
    p->closed = !more;
    if (picture->lit)
        add_glows(picture->glow, &picture->sent, i);
    if (i == n || !more)
        return 0;
    int left = 0;
    for (uint bits = ~soon & (uint)((1ul << n) - 1); bits; bits &= bits - 1, ++left) {
        const int j = __builtin_ctz(bits);
        COPY_PIECE(slots, left, slots, j)
    }
    return left;
}
#else
/* Hide those of n pieces whose keys are below `until`, of which no more will come -> those that are left. */
INLINED int settle(Pixel *p, const Picture *picture, Slots *slots, int n, long until)
{
    int order[SLOTS + 4], i = 0;
    slots->keys[n] = slots->keys[n + 1] = slots->keys[n + 2] = LONG_MAX;   // those that fill the last four
#if LANES > 1
    long4 soon = 0;
    for (int j = 0; j < n; j += 4)
        soon |= FOUR(slots->keys + j) < until;
    if (!((soon.x | soon.y) | (soon.z | soon.w)))
        return n;
#endif
    for (int j = 0; j < n; j += 4) {         // each one's rank: how many are nearer
        const long4 mine = FOUR(slots->keys + j);
        long4 rank = 0;
        for (int k = 0; k < n; k += 4) {
            rank -= slots->keys[k] < mine;
            rank -= slots->keys[k + 1] < mine;
            rank -= slots->keys[k + 2] < mine;
            rank -= slots->keys[k + 3] < mine;
        }
        order[rank.x] = j;
        order[rank.y] = j + 1;
        order[rank.z] = j + 2;
        order[rank.w] = j + 3;
    }
#if LANES == 1
    Pixel *const hot = p;
#else
    Pixel registers = *p, *const hot = &registers;   // what changes with each piece
#endif
    bool more = p->kept * p->room > UNSEEN;
    while (more && i < n && slots->keys[order[i]] < until) {
        const int j = order[i];
        const long key = slots->keys[j];
        if (p->event < p->events && p->depths[p->event] <= (uint)(key >> 32)) {
            p->kept = hot->kept;
            pass_event(p, picture->samples);
            hot->room = p->room;
            more = hot->kept * hot->room > UNSEEN;
            continue;
        }
#if MASKS
        float hidden[PATCHES] ALIGNED;
        const float weight = weight_of(hot, key, take(hot, p, key, &slots->strips[j], hidden));
        if (picture->lit)
            shine(picture, p, weight, slots->numbers[j], place_seen(&slots->strips[j], hidden));
#else
        const float weight = weight_of(hot, key, take(hot, &p->sums, key, slots->shares[j]));
        if (picture->lit)
            shine(picture, p, weight, slots->numbers[j], slots->wheres[j]);
#endif
        more = hot->kept * hot->room > UNSEEN;
        ++i;
    }
    p->kept = hot->kept;
    p->most = hot->most;
    p->best = hot->best;
    p->lows = hot->lows;
    p->highs = hot->highs;
    p->chains = hot->chains;
    p->oldest = hot->oldest;
    p->closed = !more;
    if (i == n || !more)
        return 0;
    int left = 0;
    for (int j = 0; j < n; ++j) {
        const long key = slots->keys[j];
        COPY_PIECE(slots, left, slots, j)
        left += key >= until;
    }
    return left;
}

#endif

/* All strands are hidden: samples that are left end, and what fills most of the pixel is known. */
INLINED void end_pixel(Pixel *p, const Picture *picture)
{
    const int samples = picture->samples;
    ulong body = ~0ul, shell = ~0ul;
    float rest = 0.0f;
    while (p->event < p->events)
        pass_event(p, samples);
    for (int s = 0; s < samples; ++s) {
        const size_t sample = p->at * samples + s;
        body = picture->visible[sample] < body ? picture->visible[sample] : body;
        if (picture->has_shells)
            shell = picture->sample_shells[sample] < shell ? picture->sample_shells[sample] : shell;
        rest += p->open[s];
        picture->body_transmittance[sample] = p->through[s];
    }
    const float alpha = 1.0f - rest * p->kept;
    picture->alpha[p->at] = alpha;
    if (p->of_body >= p->most && p->of_body > 0.0f) {
        p->most = p->of_body;
        p->best = body;
    }
    const bool is_shell = p->of_shells > p->most && shell != ~0ul;
    picture->front[p->at] = is_shell ? ~0ul : p->best;
    if (picture->has_shells)
        picture->shell_front[p->at] = is_shell ? shell : ~0ul;
    if (picture->lit) {
        float4 light = p->light;
        if (picture->has_shells)         // what is there is theirs
            light += (p->all_shells > 0.0f ? p->of_shells / p->all_shells : 1.0f) * picture->image[p->at];
        picture->image[p->at] = (float4)(light.xyz, alpha);
    }
}

/* A pixel in which neither strands nor shells are: what `begin_pixel` and `end_pixel` tell, the same bits. */
INLINED void pass_pixel(const Picture *picture, size_t at)
{
    const int samples = picture->samples;
    ulong body = ~0ul;
    int seen = 0;
    for (size_t sample = at * samples; sample < (at + 1) * samples; ++sample) {
        const ulong key = picture->visible[sample];
        body = key < body ? key : body;
        seen += (uint)(key >> 32) != NOTHING;
        picture->body_transmittance[sample] = 1.0f;
    }
    const float alpha = (float)seen / samples;
    picture->alpha[at] = alpha;
    picture->front[at] = seen ? body : ~0ul;
    if (picture->lit)
        picture->image[at] = (float4)(0.0f, 0.0f, 0.0f, alpha);
}

/* The light of a pixel's strands, which `end_pixel` has not known: the same bits. */
INLINED void add_light(const Picture *picture, size_t at, float4 light)
{
    const float4 others = picture->image[at];
    picture->image[at] = (float4)(light.xyz + others.xyz, others.w);
}

/* Go on with a pixel of which what lies before a slab of depths is done, if anything does; `bound`: how far it can be seen
   into -> how far in the slab. */
INLINED uint go_on_behind(Pixel *p, uint bound, int samples, uint2 slab, __global const uint4 *kept)
{
    __global const Pixel *before = (__global const Pixel *)kept;
    if (slab.x)
        COPY_PIXEL(p, before, samples)
    return p->closed ? 0 : bound < slab.y ? bound : slab.y;
}

/* All strands of a slab are hidden. */
INLINED void end_slab(Pixel *p, const Picture *picture, uint2 slab, __global uint4 *kept, volatile __global uint *unfinished)
{
    if (slab.y == NOTHING) {
        end_pixel(p, picture);
        return;
    }
    __global Pixel *until_here = (__global Pixel *)kept;
    COPY_PIXEL(until_here, p, picture->samples)
    if (!p->closed)
        atomic_inc(unfinished);
}
