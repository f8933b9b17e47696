/*
 * Light of a sky at a place, hidden by hair and body: sky.cl, shade.cl and transport.cl use this.  A cell of the world's grid
 * holds it as nine spherical harmonics a colour.
 */

/* Where a place lies between eight cells: the number of the first of them, and how far on to the others. */
typedef struct {
    size_t first;
    float x, y, z;
} Between;

/* c: in cells of n a side. */
INLINED Between between_these(int n, float4 c)
{
    const float most = n - 1.0f;
    c -= 0.5f;
    c.x = c.x > 0.0f ? c.x < most ? c.x : most : 0.0f;   // also where it is no number
    c.y = c.y > 0.0f ? c.y < most ? c.y : most : 0.0f;
    c.z = c.z > 0.0f ? c.z < most ? c.z : most : 0.0f;
    const int x = (int)c.x < n - 2 ? (int)c.x : n - 2, y = (int)c.y < n - 2 ? (int)c.y : n - 2;
    const int z = (int)c.z < n - 2 ? (int)c.z : n - 2;
    const Between between = {((size_t)z * n + y) * n + x, c.x - x, c.y - y, c.z - z};
    return between;
}

INLINED float corner_weight(const Between *here, int k)
{
    return ((k & 1) ? here->x : 1.0f - here->x) * ((k & 2) ? here->y : 1.0f - here->y) * ((k & 4) ? here->z : 1.0f - here->z);
}

INLINED Between cells_around(const Sky *sky, float4 p)
{
    return between_these(sky->size.x, (p - sky->place) * sky->place.w);
}

/* What is known at a place of each harmonic; of order 1 only what is asked for. */
typedef struct {
    float4 of[HARMONICS];
} Known;

INLINED Known known_at(const Sky *sky, __global const float4 *cells, float4 p, bool odd)
{
    const int n = sky->size.x;
    const Between here = cells_around(sky, p);
    Known known;
    for (int j = 0; j < HARMONICS; ++j)
        known.of[j] = 0.0f;
    for (int k = 0; k < 8; ++k) {
        const float weight = corner_weight(&here, k);
        __global const float4 *there = cells + HARMONICS * (here.first + ((k >> 2) * n + (k >> 1 & 1)) * n + (k & 1));
        known.of[0] += weight * there[0];
        for (int j = odd ? 1 : 4; j < HARMONICS; ++j)
            known.of[j] += weight * there[j];
    }
    return known;
}

/* Light around a direction, over that of a sky of 1 with nothing before it: by real spherical harmonics of orders 0 to 2. one,
   two: what the kernel keeps of orders 1 and 2: 0 and -1/8 of a fibre along the direction (sine), 2/3 and 1/4 of a surface
   across it (cosine). */
INLINED float4 light_around(const Known *known, float4 w, float one, float two)
{
    const float a = one * 0.488602512f, b = two * 1.092548431f;
    const float c = two * 0.315391565f * (3.0f * w.z * w.z - 1.0f), d = two * 0.546274215f * (w.x * w.x - w.y * w.y);
    __private const float4 *of = known->of;
    float4 sum = 0.282094792f * of[0] + (b * w.x * w.y) * of[4] + (b * w.y * w.z) * of[5] + c * of[6] + (b * w.x * w.z) * of[7]
        + d * of[8];
    if (one != 0.0f)
        sum += (a * w.y) * of[1] + (a * w.z) * of[2] + (a * w.x) * of[3];
    return (float4)(sum.x > 0.0f ? sum.x : 0.0f, sum.y > 0.0f ? sum.y : 0.0f, sum.z > 0.0f ? sum.z : 0.0f, 0.0f);
}
