/*
 * Tables of how hair scatters light around itself: Chiang, Bitterli, Tappan and Burley (EGSR 2016), of each lobe the mean
 * of A N over the strand's width.  scatter.h looks them up, `lobes_around`.
 */

/* Light that enters at one place across the strand. */
typedef struct {
    float enters, within;                  // angles around the strand, outside and inside
    float cosine;                          // of the angle between the light and the surface
} Entry;

inline Entry entry_of(float gamma, float cosine, float index)
{
    const float h = sin(gamma);
    const Entry entry = {gamma, asin(h * cosine / sqrt(index * index - 1.0f + cosine * cosine)), cosine * cos(gamma)};
    return entry;
}

/* Share of light that glass reflects, mean of both polarisations (Fresnel). */
inline float reflected(float c, float index)
{
    const float inner = sqrt(1.0f - (1.0f - c * c) / (index * index));
    const float parallel = (index * c - inner) / (index * c + inner), across = (c - index * inner) / (c + index * inner);
    return 0.5f * (parallel * parallel + across * across);
}

/* One work-item tells what shares of light leave by each lobe that enters at one place across the strand, of hair of each
   shade. */
__kernel void attenuate(
    const ulong begin, const ulong end,    // work-items, see common.h
    const float index,                     // of refraction
    const uint entries,                    // how many places
    __global const float *cosines,         // [cosines] of the eye's angle to the plane across the strand
    __global const float *gammas,          // [entries] angles around the strand, 0 to pi / 2
    __global const float *absorptions,     // [SHADES] of a radius
    __global float4 *shares)               // [cosines, entries, SHADES] of R, TT, TRT and the rest
{
    WORK_ITEM(item);
    const float cosine = cosines[item / entries];
    const Entry entry = entry_of(gammas[item % entries], cosine, index);
    const float f = reflected(entry.cosine, index);
    const float sine = sqrt(1.0f - cosine * cosine) / index;
    const float way = 2.0f * cos(entry.within) / sqrt(1.0f - sine * sine);   // in radii
    for (int k = 0; k < SHADES; ++k) {
        const float through = exp(-absorptions[k] * way), back = f * through;
        const float tt = (1.0f - f) * (1.0f - f) * through;
        shares[(size_t)item * SHADES + k] = (float4)(f, tt, tt * back, back < 1.0f ? tt * back * back / (1.0f - back) : 0.0f);
    }
}

/* The logistic distribution of an angle, of those within half a turn; angle: within three. */
inline float logistic(float angle, float s)
{
    float x = fabs(angle);
    while (x > M_PI_F)
        x = fabs(x - 2.0f * M_PI_F);
    const float e = exp(-x / s);
    return e / (s * (1.0f + e) * (1.0f + e));
}

/* One work-item tells for one angle of the eye, and one around the strand, the mean over the strand's width for hair of each
   shade. */
__kernel void gather(
    const ulong begin, const ulong end,    // work-items, see common.h
    const float index,                     // of refraction
    const float s,                         // scale of the logistic distribution
    const float whole,                     // what of it lies within half a turn
    const uint entries,                    // places across the strand
    const uint angles,                     // from 0 to pi, evenly
    const uint first,                      // of the table's rows
    __global const float *cosines,         // [cosines] see `attenuate`
    __global const float *gammas,          // [entries]
    __global const float *weights,         // [entries] of the mean over the width
    __global const float4 *shares,         // [cosines, entries, SHADES]
    __global float4 *table)                // [first + cosines · angles · SHADES]
{
    WORK_ITEM(item);
    const uint row = (uint)item / angles;
    const float phi = M_PI_F * ((uint)item % angles) / (angles - 1);
    float4 sums[SHADES];
    for (int k = 0; k < SHADES; ++k)
        sums[k] = 0.0f;
    for (uint i = 0; i < entries; ++i) {
        const Entry entry = entry_of(gammas[i], cosines[row], index);
        float4 turned = 0.5f / M_PI_F;
        const float r = -2.0f * entry.enters, t = r + 2.0f * entry.within + M_PI_F, trt = r + 4.0f * entry.within;
        turned.x = 0.5f * (logistic(phi - r, s) + logistic(phi + r, s)) / whole;   // h and -h
        turned.y = 0.5f * (logistic(phi - t, s) + logistic(phi + t, s)) / whole;
        turned.z = 0.5f * (logistic(phi - trt, s) + logistic(phi + trt, s)) / whole;
        turned *= weights[i];
        for (int k = 0; k < SHADES; ++k)
            sums[k] += turned * shares[(size_t)(row * entries + i) * SHADES + k];
    }
    for (int k = 0; k < SHADES; ++k)
        table[first + item * SHADES + k] = sums[k];
}
