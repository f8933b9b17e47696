/*
 * Light of strands' segments between the places where it is known: FEW_PLACES of each, from its start to its end, evenly
 * apart; through three that follow each other goes a parabola.  Where it changes too much between these, a row of `more` has
 * what a segment is like, and exact_light.h tells its light at any place.  strand_light.cl makes both, coverage.cl adds up.
 * Each light has places of its own, so that what one sends does not hang on the others; those of a segment stand together.
 */
#define MORE (1ul << 63)                   // instead of the first place: the row of `more` that it has
#define ROW (MORE - 1)

/* The row of `more`, with MORE, of a segment whose places these are, of all sources; 0 where all lights are known there. */
INLINED ulong row_among(__global const ulong *few, int n_lights)
{
    ulong row = few[0] & MORE ? few[0] : 0;   // there is a light at least
    for (int i = 1; i < n_lights; ++i)
        row = few[FEW_PLACES * i] & MORE ? few[FEW_PLACES * i] : row;
    return row;
}

/* Light of 63 bits, as `packed_lanes` of strand_light.cl makes it. */
INLINED float4 unpacked_light(ulong packed)
{
    return (float4)(as_float((uint)(packed >> 32) & 0x7FFFFC00u), as_float((uint)(packed >> 11) & 0x7FFFFC00u),
                    as_float((uint)packed << 10 & 0x7FFFFC00u), 0.0f);
}

/* Light that a segment sends to the eye from the place `at`, 0..1, of its length in the world: r, g, b, 0.
   few: of the segment and a light.  `at` is that of the place nearest to the pixel's middle at the piece's depth. */
INLINED float4 light_between(__global const ulong *few, float at)
{
    const float along = at * FEW_PIECES;
    const int whole = (int)along, piece = whole < FEW_PIECES - 1 ? whole : FEW_PIECES - 1;
    const float4 a = unpacked_light(few[2 * piece]), b = unpacked_light(few[2 * piece + 1]), c = unpacked_light(few[2 * piece + 2]);
    const float t = along - piece;
    const float4 light = (1.0f - t) * (1.0f - 2.0f * t) * a + 4.0f * t * (1.0f - t) * b + t * (2.0f * t - 1.0f) * c;
    return light > 0.0f ? light : 0.0f;
}
