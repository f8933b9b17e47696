/* The report's Gaussian over a picture, first along its rows, then down its columns. */

#define FROM (1.0f / 64)    // share of the kernel that lies beyond an edge where its blur begins: fur that hides all
#define TO 0.25f            // but 1/256 of what is behind it is no edge; and where the blur is complete

/* One work-item adds up what is around one pixel.  Beyond a border lies what lies on it. */
__kernel void along(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int4 size,                       // width, rows there are, first row wanted, 1: down the columns
    const int radius,
    __global const float *weights,         // [2 radius + 1], of sum 1
    __global const float4 *image,          // [rows, width]
    __global float4 *out)                  // [rows wanted, width]
{
    WORK_ITEM(pixel);
    const int x = pixel % size.x, y = size.z + (int)(pixel / size.x);
    float4 sum = (float4)(0.0f);
    for (int k = -radius; k <= radius; ++k) {
        const int column = size.w ? x : clamp(x + k, 0, size.x - 1), row = size.w ? clamp(y + k, 0, size.y - 1) : y;
        sum += weights[k + radius] * image[(size_t)row * size.x + column];
    }
    out[pixel] = (float4)(sum.xyz, min(sum.w, 1.0f));   // the weights' sum is 1 but for rounding
}

/* Takes the blur back where no edge is near, by the coverage around.  One work-item, one pixel. */
__kernel void edges(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint first,                      // pixel of `image` where `blurred` begins
    __global const float4 *image,
    __global float4 *blurred)
{
    WORK_ITEM(pixel);
    const float4 sharp = image[first + pixel], soft = blurred[pixel];
    const float near = clamp((min(soft.w, 1.0f - soft.w) - FROM) / (TO - FROM), 0.0f, 1.0f);
    blurred[pixel] = near > 0.0f ? sharp + near * (soft - sharp) : sharp;
}
