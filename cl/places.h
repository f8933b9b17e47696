/*
 * Light of strands' segments between the places where it is known: FEW_PLACES of each, or where it changes too much between
 * these, MANY_PLACES, from its start to its end, evenly apart.  strand_light.cl makes them, coverage.cl adds them up.
 *
 * Through three places that follow each other goes a parabola. A segment that the edge of a spot's cone crosses has straight
 * lines between them, and a step where the edge is: behind its places two floats tell it, in ways from place to place.
 */
#define MORE (1ul << 63)                   // instead of the first place: its row of `more` has them,
#define ON_EDGE (1ul << 62)                // and an edge crosses it
#define ROW (ON_EDGE - 1)

/* Light in 63 bits: of each of r, g, b the upper 21 bits of its float, but for its sign, which would be taken for MORE: what
   is not above 0 is 0. */
INLINED ulong packed_light(float r, float g, float b)
{
    const uint x = (as_uint(r > 0.0f ? r : 0.0f) + 512u) >> 10, y = (as_uint(g > 0.0f ? g : 0.0f) + 512u) >> 10;
    return (ulong)x << 42 | (ulong)y << 21 | (ulong)((as_uint(b > 0.0f ? b : 0.0f) + 512u) >> 10);
}

INLINED float4 unpacked_light(ulong packed)
{
    return (float4)(as_float((uint)(packed >> 32) & 0x7FFFFC00u), as_float((uint)(packed >> 11) & 0x7FFFFC00u),
                    as_float((uint)packed << 10 & 0x7FFFFC00u), 0.0f);
}

/* Light that a segment sends to the eye from the place `at`, 0..1, of its length in the world: r, g, b, 0.
   few: of the segment.  `at` is that of the place nearest to the pixel's middle at the piece's depth. */
INLINED float4 light_between(__global const ulong *few, __global const ulong *more, float at)
{
    const ulong first = few[0];
    __global const ulong *from = few;
    int pieces = FEW_PIECES;
    if (first & MORE) {
        from = more + (MANY_PLACES + 1) * (first & ROW);
        pieces = MANY_PIECES;
        if (first & ON_EDGE) {
            const float along = at * (MANY_PLACES - 1);
            const int whole = (int)along, last = whole < MANY_PLACES - 2 ? whole : MANY_PLACES - 2;
            const float4 a = unpacked_light(from[last]), b = unpacked_light(from[last + 1]);
            const float2 edges = as_float2(from[MANY_PLACES]);
            float share = along - last;
            if (edges.x >= last && edges.x < last + 1)
                share = along < edges.x ? 0.0f : 1.0f;
            if (edges.y >= last && edges.y < last + 1)
                share = along < edges.y ? 0.0f : 1.0f;
            return a + share * (b - a);
        }
    }
    const float along = at * pieces;
    const int whole = (int)along, piece = whole < pieces - 1 ? whole : pieces - 1;
    const float4 a = unpacked_light(from[2 * piece]), b = unpacked_light(from[2 * piece + 1]), c = unpacked_light(from[2 * piece + 2]);
    const float t = along - piece;
    const float4 light = (1.0f - t) * (1.0f - 2.0f * t) * a + 4.0f * t * (1.0f - t) * b + t * (2.0f * t - 1.0f) * c;
    return light > 0.0f ? light : 0.0f;
}
