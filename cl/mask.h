/*
 * Where in a pixel pieces of strands lie: how much they cover of each of its patches, MASKS * MASKS equal squares, in which
 * they hide each other.  Only within a patch are they taken to lie at random.  A piece is kept as what its strand is like
 * there, and its areas are exact: they add up to its share of the pixel.  hiding.h uses this where MASKS is not 0.
 */
#define PATCHES (MASKS * MASKS)

/* What a strand is like in a pixel; u is its longer axis, v its shorter, both from the pixel's first corner on. */
typedef struct {
    float from, along;                 // where along u it is there, and how far: below 0 where u is y
    float height, slope, radius;       // its middle's height along v at `from`, what it rises along u, half its width along v
    float at, at_u, at_v;              // where the pixel's middle falls on the segment, 0..1, and how much further each pixel
} Strip;                               // along u and v does

/* The strips of segment i of a chunk in the pixels of rows v and columns u. */
INLINED void strips_of(CHUNKS const Chunk *c, int i, const Column *column, lanes_i u, lanes_i v, float8 *strips)
{
    const lanes at = c->au[i] - REAL(u);
    const lanes strip[8] = {at > 0.0f ? at : F(0.0f), c->steep[i] ? -column->along : column->along, column->v0 - REAL(v),
                            F(c->slope[i]), column->radius, column->at + REAL(v) * column->at_step, column->at_across,
                            column->at_step};
    rows_of(strip, strips);
}

#if LANES == 1
#define ACROSS(i) ((float)((i) % MASKS))
#define DOWN(i) ((float)((i) / MASKS))
#else
#define ACROSS(i) ((lanes)(0, 1, 2, 3, 0, 1, 2, 3))
#define DOWN(i) ((lanes)(0, 0, 0, 0, 1, 1, 1, 1) + (float)((i) / MASKS))
#endif

/* Share that a strand covers of each patch, row by row. */
INLINED void areas_of(const Strip *s, float *areas)
{
    const bool steep = s->along < 0.0f;
    const float until = s->from + (steep ? -s->along : s->along), radius = MASKS * s->radius;
    for (int i = 0; i < PATCHES; i += LANES) {
        const lanes x = ACROSS(i), y = DOWN(i), u = (steep ? y : x) * (1.0f / MASKS), v = steep ? x : y;
        const lanes first = greater(F(s->from), u), last = lesser(F(until), u + 1.0f / MASKS);
        const lanes a = MASKS * (s->height + s->slope * (first - s->from)) - v;
        const lanes b = MASKS * (s->height + s->slope * (last - s->from)) - v;
        const lanes mean = below(a + radius, b + radius) - below(a - radius, b - radius);
        *(lanes *)(areas + i) = greater(MASKS * (last - first), F(0.0f)) * greater(mean, F(0.0f));
    }
}

/* Sum over all patches, in one order whatever LANES is. */
INLINED float all_of(const float *patches)
{
#if LANES == 1
    float sums[PATCHES / 2];
    for (int i = 0; i < PATCHES / 2; ++i)
        sums[i] = patches[i] + patches[i + PATCHES / 2];
    for (int n = PATCHES / 4; n; n /= 2)
        for (int i = 0; i < n; ++i)
            sums[i] += sums[i + n];
    return sums[0];
#else
    const float8 b = *(const float8 *)patches + *(const float8 *)(patches + 8);
    const float4 a = b.lo + b.hi;
    return (a.x + a.z) + (a.y + a.w);
#endif
}

/* Hide what a strand covers of patches behind what is left of them, beside what others of its strand cover already: `whole`
   tells that there are none.  hidden: what it takes of each.  -> what is left, of all. */
INLINED float hide_patches(float *left, float *covered, const float *areas, bool whole, float *hidden)
{
    for (int i = 0; i < PATCHES; i += LANES) {
        const lanes kept = *(const lanes *)(left + i), area = *(const lanes *)(areas + i);
        const lanes before = whole ? F(0.0f) : *(const lanes *)(covered + i), sum = lesser(before + area, F(1.0f));
        const lanes taken = whole ? kept * sum : before < 1.0f ? kept * (sum - before) / (1.0f - before) : F(0.0f);
        *(lanes *)(covered + i) = sum;
        *(lanes *)(hidden + i) = taken;
        *(lanes *)(left + i) = kept - taken;
    }
    return all_of(left) * (1.0f / PATCHES);
}

/* The mean place of what is seen of a strand, on its segment, in 1/65535. */
INLINED uint place_seen(const Strip *s, const float *hidden)
{
    const bool steep = s->along < 0.0f;
    const float at_x = steep ? s->at_v : s->at_u, at_y = steep ? s->at_u : s->at_v;
    float places[PATCHES] ALIGNED;
    for (int i = 0; i < PATCHES; i += LANES) {
        const lanes x = (ACROSS(i) + 0.5f) * (1.0f / MASKS) - 0.5f, y = (DOWN(i) + 0.5f) * (1.0f / MASKS) - 0.5f;
        *(lanes *)(places + i) = *(const lanes *)(hidden + i) * (at_x * x + at_y * y);
    }
    const float all = all_of(hidden), at = s->at + (all > 0.0f ? all_of(places) / all : 0.0f);
    return (uint)((at > 0.0f ? at < 1.0f ? at : 1.0f : 0.0f) * 65535.0f + 0.5f);
}
