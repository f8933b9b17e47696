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

#include "events.h"

/* The slots are full: the furthest piece goes, and with it all from its key on. */
INLINED void drop(Slots *slots, long *limit)
{
    int far = 0;
    for (int k = 1; k < SLOTS; ++k)
        far = slots->keys[k] > slots->keys[far] ? k : far;
    *limit = slots->keys[far] < *limit ? slots->keys[far] : *limit;
    COPY_PIECE(slots, far, slots, SLOTS - 1)
}

#if LANES > 1
#include "settle.h"
#else
INLINED int first_lane(uint8 mask)
{
    const uint8 b = mask & (uint8)(1, 2, 4, 8, 16, 32, 64, 128);
    const uint4 c = b.lo | b.hi;
    const uint m = (c.x | c.y) | (c.z | c.w);
    for (int k = 0; k < CHAINS; ++k)
        if (m >> k & 1)
            return k;
    return CHAINS;
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
/* Hide a piece behind what came before it, patch by patch -> what it takes of the pixel's light. */
INLINED float take(Pixel *p, long key, const Strip *strip, float *hidden)
{
    bool begins;
    const int chain = chain_of(p, (uint)key, &begins);
    float areas[PATCHES] ALIGNED;
    areas_of(strip, areas);
    const float before = p->kept;
    p->kept = hide_patches(p->left, p->covered[chain], areas, begins, hidden);
    return before - p->kept;
}
#else
/* Hide a piece behind what came before it -> what it takes of the pixel's light.  Without a pointer to sums: llvmpipe would keep
   all that is known of a pixel in memory. */
INLINED float take(Pixel *p, long key, float share)
{
    bool begins;
    const int chain = chain_of(p, (uint)key, &begins);
    const int8 here = (uint8)(0, 1, 2, 3, 4, 5, 6, 7) == (uint)chain;
    const float8 its = here ? p->sums : 0.0f;
    const float4 four = its.lo + its.hi;
    const float before = begins ? 0.0f : (four.x + four.y) + (four.z + four.w);
    const float grown = before + share, sum = grown < 1.0f ? grown : 1.0f;
    p->sums = here ? sum : p->sums;
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

/* Add the light of a piece; where: on its segment, in 1/65535. */
INLINED void shine(const Picture *picture, Pixel *p, float weight, uint number, uint where)
{
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
}

/* Hide those of n pieces whose keys are below `until`, of which no more will come -> those that are left. */
INLINED int settle(Pixel *p, const Picture *picture, Slots *slots, int n, long until)
{
    int order[SLOTS + 4], i = 0;
    slots->keys[n] = slots->keys[n + 1] = slots->keys[n + 2] = LONG_MAX;   // those that fill the last four
    for (int j = 0; j < n; j += 4) {         // each one's rank: how many are nearer
        const long4 mine = (long4)(slots->keys[j], slots->keys[j + 1], slots->keys[j + 2], slots->keys[j + 3]);
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
    bool more = p->kept * p->room > UNSEEN;
    while (more && i < n && slots->keys[order[i]] < until) {
        const int j = order[i];
        const long key = slots->keys[j];
        if (p->next <= (uint)(key >> 32)) {
            pass_events(p, picture, (uint)(key >> 32));
            more = p->kept * p->room > UNSEEN;
            continue;
        }
#if MASKS
        float hidden[PATCHES] ALIGNED;
        const float weight = weight_of(p, key, take(p, key, &slots->strips[j], hidden));
        if (picture->lit)
            shine(picture, p, weight, slots->numbers[j], place_seen(&slots->strips[j], hidden));
#else
        const float weight = weight_of(p, key, take(p, key, slots->shares[j]));
        if (picture->lit)
            shine(picture, p, weight, slots->numbers[j], slots->wheres[j]);
#endif
        more = p->kept * p->room > UNSEEN;
        ++i;
    }
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
    const float kept = p->kept;
    ulong best = p->best, shell = ~0ul;
    if (picture->has_shells)
        pass_events(p, picture, BEHIND_ALL);
    float rest = 0.0f, of_body = p->of_body;
    for (int k = 0; k < samples; k += 4) {   // as `pass_events` would do it
        const FourSamples *four = &p->fours[k / 4];
        const float4 open = four->open;
        const int4 on = four->bodies < NOTHING;
        of_body = plus_four(of_body, on ? open * kept : 0.0f);
        rest = plus_four(rest, on ? 0.0f : open);
        put_four(picture->body_transmittance + p->at * samples + k, on ? open * samples * kept : four->through, samples);
    }
    const float alpha = 1.0f - rest * kept;
    picture->alpha[p->at] = alpha;
    const bool is_body = of_body >= p->most && of_body > 0.0f;
    if (is_body) {
        best = ~0ul;
        for (size_t sample = p->at * samples; sample < (p->at + 1) * samples; ++sample)
            best = picture->visible[sample] < best ? picture->visible[sample] : best;
    }
    for (size_t sample = p->at * samples; picture->has_shells && sample < (p->at + 1) * samples; ++sample)
        shell = picture->sample_shells[sample] < shell ? picture->sample_shells[sample] : shell;
    const bool is_shell = p->of_shells > (is_body ? of_body : p->most) && shell != ~0ul;
    picture->front[p->at] = is_shell ? ~0ul : best;
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
