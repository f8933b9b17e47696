/*
 * Light of a sky at a place, hidden by hair and body: sky.cl and shade.cl use this. A cell of the world's grid holds it as
 * nine spherical harmonics a colour.
 */

#if CHECKED
typedef float8 pair;                       // Oclgrind's vectors lie anywhere
#else
typedef float8 pair __attribute__((aligned(16)));
#endif

/* Where a place lies between eight cells: the first of them, and how far on to the others. */
typedef struct {
    __global const float4 *first;
    float x, y, z;
} Between;

INLINED Between cells_around(const Sky *sky, __global const float4 *cells, float4 p)
{
    const int n = sky->size.x;
    const float most = n - 1.0f;
    float4 c = (p - sky->place) * sky->place.w - 0.5f;
    c.x = c.x > 0.0f ? c.x < most ? c.x : most : 0.0f;   // also where it is no number
    c.y = c.y > 0.0f ? c.y < most ? c.y : most : 0.0f;
    c.z = c.z > 0.0f ? c.z < most ? c.z : most : 0.0f;
    const int x = (int)c.x < n - 2 ? (int)c.x : n - 2, y = (int)c.y < n - 2 ? (int)c.y : n - 2;
    const int z = (int)c.z < n - 2 ? (int)c.z : n - 2;
    const Between between = {cells + HARMONICS * (((size_t)z * n + y) * n + x), c.x - x, c.y - y, c.z - z};
    return between;
}

/* What is known at a place: harmonics 2 i and 2 i + 1 side by side, the last one with the one before. */
typedef struct {
    float8 of[5];
} Known;

INLINED Known known_at(const Sky *sky, __global const float4 *cells, float4 p, bool odd)
{
    const int n = sky->size.x;
    const Between here = cells_around(sky, cells, p);
    Known known;
    for (int i = 0; i < 5; ++i)
        known.of[i] = 0.0f;
    for (int k = 0; k < 8; ++k) {
        const float weight = ((k & 1) ? here.x : 1.0f - here.x) * ((k & 2) ? here.y : 1.0f - here.y)
            * ((k & 4) ? here.z : 1.0f - here.z);
        __global const float4 *there = here.first + HARMONICS * (((k >> 2) * n + (k >> 1 & 1)) * n + (k & 1));
        known.of[0] += weight * *(__global const pair *)there;
        if (odd)
            known.of[1] += weight * *(__global const pair *)(there + 2);
        known.of[2] += weight * *(__global const pair *)(there + 4);
        known.of[3] += weight * *(__global const pair *)(there + 6);
        known.of[4] += weight * *(__global const pair *)(there + 7);
    }
    return known;
}

/* Light around a direction, over that of a sky of 1 with nothing before it. one, two: what the kernel keeps of orders 1 and 2:
   0 and -1/8 of a fibre along the direction (sine), 2/3 and 1/4 of a surface across it (cosine). */
INLINED float4 light_around(const Known *known, float4 w, float one, float two)
{
    const float a = one * 0.488602512f, b = two * 1.092548431f;
    float8 sum = known->of[0] * (float8)((float4)0.282094792f, (float4)(a * w.y))
        + known->of[2] * (float8)((float4)(b * w.x * w.y), (float4)(b * w.y * w.z))
        + known->of[3] * (float8)((float4)(two * 0.315391565f * (3.0f * w.z * w.z - 1.0f)), (float4)(b * w.x * w.z))
        + known->of[4] * (float8)((float4)0.0f, (float4)(two * 0.546274215f * (w.x * w.x - w.y * w.y)));
    if (one != 0.0f)
        sum += known->of[1] * (float8)((float4)(a * w.z), (float4)(a * w.x));
    const float4 light = sum.lo + sum.hi;
    return (float4)(light.x > 0.0f ? light.x : 0.0f, light.y > 0.0f ? light.y : 0.0f, light.z > 0.0f ? light.z : 0.0f, 0.0f);
}
