/*
 * Light of strands' segments between the places where it is known: three of each, its start, middle and end, and where it
 * changes too much between these, more of them.  strand_light.cl makes them, coverage.cl adds them up.
 *
 * A segment's three: r, g, b, and in their last floats: the first row of `more`, in rows of PLACE_ROW places, modulo 2^20;
 * pieces, 1, 3 or 7; that row divided by 2^20.  With more pieces than one, `more` has their 2 · pieces + 1 places.
 * Between three places that follow each other light is a parabola.
 */
#define FAR_ROWS 1048576.0f                // rows that a float tells apart, with room to spare

/* Light in 64 bits: of each of r, g, b the upper 21 bits of its float, but for its sign. */
INLINED ulong packed_light(float r, float g, float b)
{
    const uint x = (as_uint(r) + 512u) >> 10, y = (as_uint(g) + 512u) >> 10, z = (as_uint(b) + 512u) >> 10;
    return (ulong)x << 42 | (ulong)y << 21 | (ulong)z;
}

INLINED float4 unpacked_light(ulong packed)
{
    return (float4)(as_float((uint)(packed >> 42 & 0x1FFFFF) << 10), as_float((uint)(packed >> 21 & 0x1FFFFF) << 10),
                    as_float((uint)(packed & 0x1FFFFF) << 10), 0.0f);
}

/* Light that a segment sends to the eye from the place `at`, 0..1, of its length in the world: r, g, b, and no meaning.
   three: of the segment.  `at` is that of the place nearest to the pixel's middle at the piece's depth. */
INLINED float4 light_between(__global const float4 *three, __global const ulong *more, float at)
{
    float4 a = three[0], b = three[1], c = three[2];
    const float pieces = b.w;
    if (pieces > 1.0f) {
        const float along = at * pieces;
        const int most = (int)pieces - 1, whole = (int)along, piece = whole < most ? whole : most;
        __global const ulong *from = more + PLACE_ROW * ((ulong)c.w * (ulong)FAR_ROWS + (ulong)a.w) + 2 * piece;
        a = unpacked_light(from[0]);
        b = unpacked_light(from[1]);
        c = unpacked_light(from[2]);
        at = along - piece;
    }
    const float4 light = (1.0f - at) * (1.0f - 2.0f * at) * a + 4.0f * at * (1.0f - at) * b + at * (2.0f * at - 1.0f) * c;
    return light > 0.0f ? light : 0.0f;
}
