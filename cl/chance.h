/* Random numbers and exp(-x), side by side, the same bits on every device; after lanes.h. */

/* `random3` as numbers in [-1, 1), by their top 24 bits, for strands side by side. */
INLINED lanes signed_lanes(lanes_u r)
{
    const lanes low = AS_F((r >> 8 & 0x7FFFFFu) | as_uint(0x1p23f)) - 0x1p23f;
    return (AS_I(r) < 0 ? low + 0x1p23f : low) * 0x1p-23f - 1.0f;
}

INLINED lanes3 random_vectors(lanes_u number, uint seed, uint use)
{
    lanes_u x = number * 1664525u + 1013904223u, y = U(seed * 1664525u + 1013904223u), z = U(use * 1664525u + 1013904223u);
    x += y * z;  y += z * x;  z += x * y;
    x ^= x >> 16;  y ^= y >> 16;  z ^= z >> 16;
    x += y * z;  y += z * x;  z += x * y;
    const lanes3 v = {signed_lanes(x), signed_lanes(y), signed_lanes(z)};
    return v;
}

/* exp(-x) for x >= 0 in + - * only, so that every device gives the same bits: 2^-k * 2^-f, f in [0, 1), by the
   Taylor series of 2^(1/2 - f) around its middle. Wrong by less than 3e-7 of exp(0). */
INLINED lanes exp_minus(lanes x)
{
    const lanes y = lesser(x * 1.44269504f, F(125.0f)), k = whole_below(y);
    const lanes z = (0.5f - (y - k)) * 0.693147181f;
    const lanes series = 1.0f + z * (1.0f + z * (0.5f + z * (0.166666667f + z * (0.0416666667f
        + z * (0.00833333333f + z * (0.00138888889f + z * 0.000198412698f))))));
    return series * 0.707106781f * AS_F((127 - nearest_i(k)) << 23);
}
