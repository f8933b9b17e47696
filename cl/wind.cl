/*
 * The wind where hair is: its mean, and gusts that it carries along (docs/motion.md).
 */

/* Three numbers from -1 to 1 at a corner of a cell. */
inline float4 gust_at(int4 cell, uint seed)
{
    const uint4 c = as_uint4(cell & (PERIOD - 1));
    const uint3 words = random3(c.x + PERIOD * c.y + PERIOD * PERIOD * c.z, seed, 9);
    return (float4)(convert_float3(words >> 8) * 0x1p-23f - 1.0f, 0.0f);
}

/* The wind at roots: its mean, and gusts, random at the corners of cells and smooth between, which it carries along. */
__kernel void blow(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    const float4 mean,                     // [world / s]; how strong gusts are, likewise
    const float4 gone,                     // how far gusts have gone [cells]; cells a world unit
    const uint seed,
    __global float *winds)                 // [3, padded] [world / s]
{
    WORK_ITEM(i);
    const float4 p = (float4)(roots[i], roots[padded + i], roots[2 * (size_t)padded + i], 0.0f) * gone.w - gone;
    const float4 low = floor(p), f = p - low, s = f * f * f * (f * (f * 6.0f - 15.0f) + 10.0f);
    const int4 cell = convert_int4(low);
    float4 rows[4];
    for (int k = 0; k < 4; ++k) {
        const int4 there = cell + (int4)(0, k & 1, k >> 1, 0);
        const float4 a = gust_at(there, seed), b = gust_at(there + (int4)(1, 0, 0, 0), seed);
        rows[k] = a + s.x * (b - a);
    }
    const float4 near = rows[0] + s.y * (rows[1] - rows[0]), far = rows[2] + s.y * (rows[3] - rows[2]);
    const float4 wind = mean + mean.w * (near + s.z * (far - near));
    winds[i] = wind.x;
    winds[padded + i] = wind.y;
    winds[2 * (size_t)padded + i] = wind.z;
}
