/* Motion blur: the mean of pictures that were taken while a shutter was open, in integers, so that their order does not
   matter. */
#include "sums.h"

/* One work-item adds one number of a picture to what there is of it, in 1/ONE. */
__kernel void add(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *picture,         // [n] any of its numbers
    __global long *sums)                   // [n] in 1/ONE
{
    WORK_ITEM(i);
    const float value = picture[i], cut = value > MOST ? MOST : value < -MOST ? -MOST : value;
    sums[i] += (long)(cut * ONE);
}

/* One work-item divides one sum, rounded to the nearest: the mean of equal numbers is that number. */
__kernel void mean(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int pictures,                    // how many were added
    __global const long *sums,             // [n] in 1/ONE
    __global float *out)                   // [n]
{
    WORK_ITEM(i);
    const long sum = sums[i], most = pictures / 2;
    out[i] = convert_float((sum + (sum < 0 ? -most : most)) / pictures) * (1.0f / ONE);
}
