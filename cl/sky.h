/*
 * Light of a sky at a place, hidden by hair and body: sky.cl and shade.cl use this. A cell of the world's grid holds it as
 * nine spherical harmonics a colour.
 */

/* Real spherical harmonics of orders 0 to 2 in a unit direction. */
INLINED void harmonics(float4 w, float *y)
{
    y[0] = 0.282094792f;
    y[1] = 0.488602512f * w.y, y[2] = 0.488602512f * w.z, y[3] = 0.488602512f * w.x;
    y[4] = 1.092548431f * w.x * w.y, y[5] = 1.092548431f * w.y * w.z, y[7] = 1.092548431f * w.x * w.z;
    y[6] = 0.315391565f * (3.0f * w.z * w.z - 1.0f), y[8] = 0.546274215f * (w.x * w.x - w.y * w.y);
}

/* Light at p around a direction, over that of a sky of 1 with nothing before it: between the eight cells around. one, two:
   what the kernel keeps of orders 1 and 2: 0 and -1/8 of a fibre along the direction (sine), 2/3 and 1/4 of a surface across
   it (cosine). */
INLINED float4 sky_light(const Sky *sky, __global const float4 *cells, float4 p, float4 direction, float one, float two)
{
    float y[HARMONICS];
    const int n = sky->size.x;
    const float most = n - 1.0f;
    harmonics(direction, y);
    float4 c = (p - sky->place) * sky->place.w - 0.5f;
    c.x = c.x > 0.0f ? c.x < most ? c.x : most : 0.0f;   // also where it is no number
    c.y = c.y > 0.0f ? c.y < most ? c.y : most : 0.0f;
    c.z = c.z > 0.0f ? c.z < most ? c.z : most : 0.0f;
    const int x = (int)c.x < n - 2 ? (int)c.x : n - 2, row = (int)c.y < n - 2 ? (int)c.y : n - 2;
    const int z = (int)c.z < n - 2 ? (int)c.z : n - 2;
    const float fx = c.x - x, fy = c.y - row, fz = c.z - z;
    float4 sum = 0.0f;
    for (int k = 0; k < 8; ++k) {
        const float weight = ((k & 1) ? fx : 1.0f - fx) * ((k & 2) ? fy : 1.0f - fy) * ((k & 4) ? fz : 1.0f - fz);
        __global const float4 *there = cells
            + HARMONICS * ((size_t)((z + (k >> 2)) * n + row + (k >> 1 & 1)) * n + x + (k & 1));
        float4 light = y[0] * there[0];
        if (one != 0.0f)
            light += one * (y[1] * there[1] + y[2] * there[2] + y[3] * there[3]);
        light += two * (y[4] * there[4] + y[5] * there[5] + y[6] * there[6] + y[7] * there[7] + y[8] * there[8]);
        sum += weight * light;
    }
    return (float4)(sum.x > 0.0f ? sum.x : 0.0f, sum.y > 0.0f ? sum.y : 0.0f, sum.z > 0.0f ? sum.z : 0.0f, 0.0f);
}
