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

/* Two numbers from -1 to 1 in 16 bits each. */
INLINED lanes packed_two(lanes a, lanes b)
{
    const lanes_u low = AS_U(below_or_at(within(a, -1.0f, 1.0f) * 32767.0f + 0.5f));
    return AS_F(low & 0xFFFFu | AS_U(below_or_at(within(b, -1.0f, 1.0f) * 32767.0f + 0.5f)) << 16);
}

INLINED float2 unpacked_two(float packed)
{
    const int both = as_int(packed);
    return (float2)(both << 16 >> 16, both >> 16) * (1.0f / 32767.0f);
}

#define LEANS_MOST 2.0f                // that a cut leans, in half widths along v, and some

/* Of one that leans: where it begins along u, and its length, below 0 where u is y; its middle's height along v at the pixel's
   border; the larger half width, below 0, which tells that it leans; `at`; in 16 bits each what it rises and how much less wide
   its second end is, or its first where that is below 0; how far both lean; `at_u` and `at_v`. */
INLINED void leaning_strips_of(CHUNKS const Chunk *c, int i, const Column *column, lanes_i u, lanes_i v, float8 *strips)
{
    const float length = c->bu[i] - c->au[i], a = c->tilt[i] * c->ar[i], b = c->tilt[i] * (c->ar[i] + c->r_step[i] * length);
    const float radius = a > b ? a : b, step = 1.0f / (LEANS_MOST * radius);
    const lanes from = F(c->au[i]) - REAL(u), height = c->av[i] - REAL(v) - c->slope[i] * from;
    const lanes_u across = AS_U(column->at_across) & 0xFFFF0000u, down = AS_U(column->at_step) >> 16;
    const lanes strip[8] = {from, F(c->steep[i] ? -length : length), height, packed_two(F(c->slope[i]), F((a - b) / radius)),
                            F(-radius), column->at + REAL(v) * column->at_step, AS_F(across | down),
                            packed_two(F(c->lean_a[i] * step), F(c->lean_b[i] * step))};
    rows_of(strip, strips);
}

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

/* `areas_of` a strand that leans. */
ONCE void leaning_areas_of(const Strip *s, float *areas)
{
    const bool steep = s->along < 0.0f;
    const float radius = -s->radius;
    const float2 shape = unpacked_two(s->slope), leans = unpacked_two(s->at_v) * (LEANS_MOST * radius);
    const float2 ends = radius * (float2)(shape.y < 0.0f ? 1.0f + shape.y : 1.0f, shape.y > 0.0f ? 1.0f - shape.y : 1.0f);
    const Corners corners = corners_of(s->from, steep ? -s->along : s->along, ends, leans);
    for (int i = 0; i < PATCHES; i += LANES) {
        const lanes x = ACROSS(i), y = DOWN(i), u = (steep ? y : x) * (1.0f / MASKS), v = steep ? x : y;
        lanes area = F(0.0f);
        #pragma unroll
        for (int k = 0; k < 4; ++k) {
            const Side side = side_in(&corners, k, u, u + 1.0f / MASKS);
            const lanes a = MASKS * (s->height + shape.x * side.from + side.above_from) - v;
            const lanes b = MASKS * (s->height + shape.x * side.to + side.above_to) - v;
            area += MASKS * side.along * below(a, b);
        }
        *(lanes *)(areas + i) = greater(area, F(0.0f));
    }
}

/* Share that a strand covers of each patch, row by row. */
INLINED void areas_of(const Strip *s, float *areas)
{
    if (s->radius < 0.0f) {
        leaning_areas_of(s, areas);
        return;
    }
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
    const float across = s->radius < 0.0f ? as_float(as_uint(s->at_u) & 0xFFFF0000u) : s->at_u;
    const float down = s->radius < 0.0f ? as_float(as_uint(s->at_u) << 16) : s->at_v;
    const float at_x = steep ? down : across, at_y = steep ? across : down;
    float places[PATCHES] ALIGNED;
    for (int i = 0; i < PATCHES; i += LANES) {
        const lanes x = (ACROSS(i) + 0.5f) * (1.0f / MASKS) - 0.5f, y = (DOWN(i) + 0.5f) * (1.0f / MASKS) - 0.5f;
        *(lanes *)(places + i) = *(const lanes *)(hidden + i) * (at_x * x + at_y * y);
    }
    const float all = all_of(hidden), at = s->at + (all > 0.0f ? all_of(places) / all : 0.0f);
    return (uint)((at > 0.0f ? at < 1.0f ? at : 1.0f : 0.0f) * 65535.0f + 0.5f);
}
