/*
 * A pixel on its way through the pieces of its strands: where its samples end at the body, or go on behind shells.  hiding.h
 * uses this, and has what it needs before.
 */
#define BEHIND_ALL (NOTHING - 1)     // depth of shells that hide what is behind but have none themselves

/* Four samples of a pixel; where it has but one, the others are nothing. */
typedef struct {
    uint4 bodies, shells;            // depths where they end, and where they go on behind shells; NOTHING: nowhere, or done
    float4 open, through;            // share of the pixel that goes on; of the body's light that shells let through, and
                                     // strands where it has ended
} FourSamples;

/* One pixel on its way: first what each piece asks. */
typedef struct {
    float kept, room, most;          // light let through; share of samples that are open; of what fills most
    uint next;                       // depth of `fours` that comes next
    ulong best;                      // what fills most of it so far, strands alone
    uint chains, oldest;             // begun so far, CHAINS at most where LANES is 1: there the next to go
    uint8 lows, highs;               // numbers of each chain's pieces
    float8 sums;                     // and what they cover
    size_t at;                       // in the picture
    bool closed;
#if LANES > 1
    uchar number;                    // in its tile
#endif
    float of_body, of_shells, all_shells;   // what these fill of it; that shells hide in all
    float4 light;
    FourSamples fours[SAMPLES / 4];
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
        (to)->next = (from)->next;                 \
        (to)->closed = (from)->closed;             \
        COPY_PATCHES(to, from)                     \
        for (int j = 0; j < samples; j += 4) {     \
            (to)->fours[j / 4].bodies = (from)->fours[j / 4].bodies;   \
            (to)->fours[j / 4].shells = (from)->fours[j / 4].shells;   \
            (to)->fours[j / 4].open = (from)->fours[j / 4].open;       \
            (to)->fours[j / 4].through = (from)->fours[j / 4].through; \
        }                                          \
    }

typedef ulong4 ulong4_at_8 __attribute__((aligned(8)));
typedef float4 float4_at_4 __attribute__((aligned(4)));

/* Of the keys of four samples, or of one sample four times, the depths. */
INLINED uint4 four_depths(__global const ulong *keys, int samples)
{
#if LANES > 1
    if (samples > 1)
        return as_uint8(*(__global const ulong4_at_8 *)keys).odd;
#endif
    const int more = samples > 1;
    return (uint4)(keys[0] >> 32, keys[more] >> 32, keys[2 * more] >> 32, keys[3 * more] >> 32);
}

/* Write what four samples have, or the first one's. */
INLINED void put_four(__global float *to, float4 four, int samples)
{
#if LANES > 1
    if (samples > 1) {
        *(__global float4_at_4 *)to = four;
        return;
    }
#endif
    to[0] = four.x;
    if (samples > 1) {
        to[1] = four.y;
        to[2] = four.z;
        to[3] = four.w;
    }
}

INLINED uint4 lesser_four(uint4 a, uint4 b)
{
    return a < b ? a : b;
}

INLINED uint least_of(uint4 a)
{
    const uint2 b = a.lo < a.hi ? a.lo : a.hi;
    return b.x < b.y ? b.x : b.y;
}

INLINED uint most_of(uint4 a)
{
    const uint2 b = a.lo > a.hi ? a.lo : a.hi;
    return b.x > b.y ? b.x : b.y;
}

/* sum + a.x + a.y + a.z + a.w, one after the other. */
INLINED float plus_four(float sum, float4 a)
{
    return (((sum + a.x) + a.y) + a.z) + a.w;
}

/* Begin with pixel `at`; how far it can be seen into: to the body where that fills it. */
INLINED uint begin_pixel(Pixel *p, const Picture *picture, size_t at)
{
    const int samples = picture->samples;
    const int4 there = (int4)(0, 1, 2, 3) < samples;
    uint furthest = 0, next = NOTHING;
    p->at = at;
    p->kept = p->room = 1.0f;
    p->most = p->of_body = p->of_shells = p->all_shells = 0.0f;
    p->light = 0.0f;
    p->best = ~0ul;
    p->lows = 0xFFFFFFFEu;
    p->highs = 0;
    p->sums = 0.0f;
    p->chains = p->oldest = 0;
    p->closed = false;
#if MASKS
    for (int i = 0; i < PATCHES; ++i)
        p->left[i] = 1.0f;
#endif
    for (int k = 0; k < samples; k += 4) {
        FourSamples *four = &p->fours[k / 4];
        const size_t sample = at * samples + k;
        const uint4 depths = four_depths(picture->visible + sample, samples), bodies = there ? depths : NOTHING;
        const uint most = most_of(depths);
        furthest = most > furthest ? most : furthest;
        four->bodies = bodies;
        four->shells = NOTHING;
        four->open = there ? 1.0f / samples : 0.0f;
        four->through = 1.0f;
        if (picture->has_shells) {
            const uint4 shells = four_depths(picture->sample_shells + sample, samples);
            __global const float *let = picture->body_transmittance + sample;
            const int more = samples > 1;
            float4 through = (float4)(let[0], let[more], let[2 * more], let[3 * more]);
            through = there ? through : 1.0f;
            four->through = through;
            four->shells = through < 1.0f ? lesser_four(lesser_four(shells, bodies), BEHIND_ALL) : NOTHING;
            p->all_shells = plus_four(p->all_shells, (1.0f - through) / samples);
        }
        const uint least = least_of(lesser_four(bodies, four->shells));
        next = least < next ? least : next;
    }
    p->next = next;
    return furthest;
}

/* Samples end, or go on behind shells, whose depths are `until` at most. */
INLINED void pass_events(Pixel *p, const Picture *picture, uint until)
{
    const int samples = picture->samples;
    while (p->next <= until) {
        /* One depth after the other where they take different shares; which of equal shares is first is no matter. */
        const uint last = picture->has_shells ? p->next : until;
        uint next = NOTHING;
        float room = 0.0f;
        for (int k = 0; k < samples; k += 4) {
            FourSamples *four = &p->fours[k / 4];
            float4 open = four->open, through = four->through;
            uint4 bodies = four->bodies;
            if (picture->has_shells) {
                const uint4 shells = four->shells;
                const int4 on = shells <= last;
                p->of_shells = plus_four(p->of_shells, on ? open * (1.0f - through) * p->kept : 0.0f);
                open = on ? open * through : open;
                four->shells = on ? NOTHING : shells;
                const uint least = least_of(four->shells);
                next = least < next ? least : next;
            }
            const int4 on = bodies <= last;
            p->of_body = plus_four(p->of_body, on ? open * p->kept : 0.0f);
            four->through = on ? open * samples * p->kept : through;
            four->open = open = on ? 0.0f : open;
            four->bodies = bodies = on ? NOTHING : bodies;
            const uint least = least_of(bodies);
            next = least < next ? least : next;
            room = plus_four(room, open);
        }
        p->next = next;
        p->room = room;
    }
}
