/* Samples that show something: listed first, then looked up side by side.  shade.cl uses this, and lanes.h, seen.h and light.h
   before it. */

/* Samples that are lit side by side: where they are on the screen, what they show, and how much of it. */
typedef struct {
    lanes x, y, e, share;                  // reversed depth; share of the pixel
    lanes_u id;                            // triangle or point
    lanes_i pixel;                         // of those of the work-item
} Seen;

#if LANES > 1
#define LOOKED 8                           // samples that are looked at together
typedef ulong8 Keys __attribute__((aligned(8)));
typedef float8 Shares __attribute__((aligned(4)));
typedef lanes_i Numbers __attribute__((aligned(4)));
#else
#define LOOKED 1
#endif

/* Which of the next LOOKED samples, of n, show something of a part, and let light through, a bit each; body: which of them
   show a triangle. */
INLINED uint shown_from(__global const ulong *visible, __global const float *transmittance, int attenuated, uint4 part,
                        uint n, uint *body)
{
    uint bits = 0;
    *body = 0;
#if LANES > 1
    if (n >= LOOKED) {
        const uint8 of = __builtin_convertvector(*(__global const Keys *)visible, uint8), ends = part.w, others = part.y;
        const int8 is_body = (of & BODY) != 0;
        const uint8 number = is_body ? (of & ~BODY) - part.z : of - part.x;
        const int8 shown = (of != NOTHING) & (number < (is_body ? ends : others));
        *body = bits_of_eight(is_body);
        return bits_of_eight(attenuated ? shown & (*(__global const Shares *)transmittance > 0.0f) : shown);
    }
#endif
    for (uint k = 0; k < LOOKED && k < n; ++k) {
        bits |= local_id(visible[k], part) != NOTHING && (!attenuated || transmittance[k] > 0.0f) ? 1u << k : 0;
        *body |= (uint)visible[k] & BODY ? 1u << k : 0;
    }
    return bits;
}

#if LANES > 1
/* Numbers of samples of a work-item that show strands, and of those that show the body; LANES more than there can be, as
   what is listed at last is filled up. */
typedef struct {
    uint numbers[2][SHADED * SAMPLES + LANES];
    uint n[2];
} Found;

/* List those of eight numbers from the first on that have a bit. */
INLINED uint list_some(uint *numbers, uint n, uint first, uint bits)
{
    #pragma unroll
    for (uint k = 0; k < 8; ++k) {         // no branch would be foreseen
        numbers[n] = first + k;
        n += bits >> k & 1;
    }
    return n;
}

/* List all samples of a work-item that show something; the last ones of each kind do as its first where there are fewer than
   LANES. */
INLINED void find(Found *found, __global const ulong *visible, __global const float *transmittance, int attenuated, uint4 part,
                  uint all)
{
    found->n[0] = found->n[1] = 0;
    for (uint i = 0; i < all; i += LOOKED) {
        uint body;
        const uint shown = shown_from(visible + i, transmittance + i, attenuated, part, all - i, &body);
        if (shown & ~body)
            found->n[0] = list_some(found->numbers[0], found->n[0], i, shown & ~body);
        if (shown & body)
            found->n[1] = list_some(found->numbers[1], found->n[1], i, shown & body);
    }
    for (int of_body = 0; of_body < 2; ++of_body)
        for (uint k = 0; found->n[of_body] && k < LANES; ++k)
            found->numbers[of_body][found->n[of_body] + k] = found->numbers[of_body][0];
}
#endif

/* What a work-item lights: its first pixel, and samples from there on. */
typedef struct {
    int x, y;                              // of the first pixel, in the rows that are drawn
    __global const ulong *visible;
    __global const float *transmittance;   // share of light that comes through what is before each, if attenuated
    int attenuated;
    uint4 part;                            // of the scene, see `color`
} Samples;

/* LANES samples by their numbers, all of the body or all of strands; stored, run: see `color`. */
INLINED Seen seen_at(const View *view, const Samples *lit, lanes_i number, int of_body, __global const uint *stored, uint run)
{
    Seen seen;
    const float weight = 1.0f / view->size.z;
    lanes_u depth;
    lanes x, y;
    /* Whole numbers as small as these are divided in floats: their quotients are further from whole ones than is rounded. */
    seen.pixel = TO(lanes_i, (TO(lanes, number) + 0.5f) * weight);
    const lanes_i of_pixel = number - seen.pixel * view->size.z, along = lit->x + seen.pixel;
    const lanes_i down = TO(lanes_i, (TO(lanes, along) + 0.5f) / (float)view->size.x);
    for (int k = 0; k < LANES; ++k) {
        const int i = LANE_I(number, k);
        const int2 offset = PATTERN[view->size.w + LANE_I(of_pixel, k)];
        const ulong key = lit->visible[i];
        LANE_U(seen.id, k) = (uint)key;
        LANE_U(depth, k) = (uint)(key >> 32);
        LANE(x, k) = offset.x;
        LANE(y, k) = offset.y;
        LANE(seen.share, k) = lit->attenuated ? lit->transmittance[i] : 1.0f;
    }
    seen.x = TO(lanes, view->rows.z + along - down * view->size.x) + 0.5f + x * (1.0f / SUBPIXEL);
    seen.y = TO(lanes, lit->y + down) + 0.5f + y * (1.0f / SUBPIXEL);
    seen.e = greater(TO(lanes, DEPTH_ONE - depth), F(0.5f)) / (float)DEPTH_ONE;   // `reversed_depth`
    seen.share *= weight;
    if (of_body)
        seen.id = (seen.id & ~BODY) - lit->part.z;
    else
        for (int k = 0; k < LANES; ++k)
            LANE_U(seen.id, k) = lies_at(stored, run, LANE_U(seen.id, k) - lit->part.x);
    return seen;
}
