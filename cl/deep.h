/*
 * What strands let through of a light, from their pieces as the light sees them (deep.cl): each texel has a list of them,
 * sorted by depth.  A place looks at the four texels around it, at each for what lies nearer to the light than itself, its
 * own strand left out; the shares of light that these let through are averaged.  exact_light.h uses this, and lanes.h
 * before it.
 *
 * A piece is depth << 40 | strand << 16 | opacity: the last in octaves, DEEP_UNIT steps each, so that what lies before a place
 * is a sum of whole numbers, the same in any order.
 */
#define DEEP_STRAND 0xFFFFFFu        // of a strand's number, as pieces have it

/* Maps of pieces, one a light. */
typedef struct {
    int longest;                     // list of pieces in a texel; 0: there are no maps
    __global const Deep *maps;       // [lights]
    __global const uint *starts;     // [texels + 1] where in `pieces` those of each texel begin
    __global const ulong *pieces;    // and 4 that are nobody's
} Deeps;

#if LANES > 1
typedef long long_list __attribute__((ext_vector_type(4), aligned(8)));
#endif

/* Opacity of n pieces of a texel that lie before depth z, those of strand `own` left out. */
INLINED uint opacity_before(__global const ulong *pieces, uint n, uint z, uint own)
{
    const ulong limit = (ulong)z << 40;
#if LANES > 1
    const long4 till = (long4)((long)limit), other = (long4)((long)own << 16), number = (long4)((long)DEEP_STRAND << 16);
    const long4 place = (long4)(0, 1, 2, 3);
    long4 sum = 0;
    for (uint k = 0; k < n; k += 4) {
        const long4 four = *(__global const long_list *)(pieces + k);
        const long4 before = (four < till) & (place < (long4)((long)(n - k)));
        sum += before & ((four & number) != other) & four & 0xFFFF;
        if (!before.w)
            break;
    }
    return (sum.x + sum.y) + (sum.z + sum.w);
#else
    uint sum = 0;
    bool more = true;
    for (uint k = 0; more && k < n; k += 8)
        #pragma unroll
        for (uint j = 0; j < 8; ++j) {
            const ulong piece = pieces[k + j < n ? k + j : n - 1];
            more = piece < limit;
            sum += k + j < n && more && ((uint)(piece >> 16) & DEEP_STRAND) != own ? (uint)piece & 0xFFFF : 0;
        }
    return sum;
#endif
}

/* Share of light i that strands let through to places p of strands `own`. */
INLINED lanes through_deep(const Deeps *deep, int i, lanes_i on, lanes3 p, lanes own)
{
    const Deep map = deep->maps[i];
    const int n = map.size.x;
    const lanes4 c = by_columns(map.to_map, p.x, p.y, p.z);
    const lanes gx = c.x / c.w - 0.5f, gy = c.y / c.w - 0.5f;
    const lanes_i in = on & (c.w > 0.0f) & (gx > -1.0f) & (gy > -1.0f) & (gx < (float)n) & (gy < (float)n);
    const lanes x = in ? gx : F(0.0f), y = in ? gy : F(0.0f), x0 = whole_below(x), y0 = whole_below(y);
    const lanes z = within(c.z, 0.0f, (float)DEEP_LAST), fx = x - x0, fy = y - y0;
    lanes octaves[4] = {F(0.0f), F(0.0f), F(0.0f), F(0.0f)};
    for (int k = 0; k < LANES; ++k) {
        if (!LANE_I(in, k))
            continue;
        const int left = (int)LANE(x0, k), top = (int)LANE(y0, k);
        #pragma unroll
        for (int j = 0; j < 4; ++j) {
            const int tx = left + (j & 1), ty = top + (j >> 1);
            if ((uint)tx >= (uint)n || (uint)ty >= (uint)n)
                continue;
            __global const uint *start = deep->starts + (uint)map.size.y + ty * n + tx;
            const uint opacity = opacity_before(deep->pieces + start[0], start[1] - start[0], (uint)LANE(z, k), (uint)LANE(own, k));
            LANE(octaves[j], k) = (float)opacity;
        }
    }
    for (int j = 0; j < 4; ++j)
        octaves[j] = exp2_of(greater(octaves[j] * (-1.0f / DEEP_UNIT), F(-100.0f)));
    const lanes a = octaves[0] + fx * (octaves[1] - octaves[0]), b = octaves[2] + fx * (octaves[3] - octaves[2]);
    return in ? a + fy * (b - a) : F(1.0f);
}
