/*
 * Running sums towards a light that is a disc: what lies before each layer of cells, as it looks from all of the disc.
 *
 * Rays from a place to one point of the disc lean, and pass from column to column: each work-item follows LANES rays side by
 * side through all layers, from the light on, sums up what they cross, and adds to each cell on the way what light gets
 * there.  The mean over points of the disc becomes crossings again, so that whoever looks up finds what a light without a
 * size has.
 */
#include "lanes.h"

/* Add the light of one point of the disc to what the cells hold of others. */
__kernel void rays(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const uint *cells,            // [nz, ny, nx]
    const uint4 size,                      // nx, ny, nz, columns of rays across and down besides nx and ny on all sides
    __global const float *shifts,          // [2 nz + 1] columns to the rim of the disc, at each half layer
    const float2 point,                    // of the disc of radius 1
    const float2 offset,                   // 0..1: what is added before a shift is cut to whole columns
    const float depth,                     // log2 of light that one unit of the cells takes away, below 0
    const int first,                       // 1: nothing is there yet
    __global float *light)                 // [nz + 1, ny, nx] of the points, at the near side of each layer; last: behind all
{
    WORK_ITEM(item);
    const int nx = size.x, ny = size.y, nz = size.z, aside = size.w, across = (nx + 2 * aside + LANES - 1) / LANES;
    const int u = (int)(item % across) * LANES - aside, v = (int)(item / across) - aside;
    float sum[LANES];
    for (int k = 0; k < LANES; ++k)
        sum[k] = 0.0f;
    for (int z = 0; z <= nz; ++z) {
        const int x = u - (int)floor(point.x * shifts[2 * z] + offset.x), y = v - (int)floor(point.y * shifts[2 * z] + offset.y);
        if (y >= 0 && y < ny) {
            lanes gone;
            for (int k = 0; k < LANES; ++k)
                LANE(gone, k) = sum[k] * depth;
            gone = exp2_of(greater(gone, F(-100.0f)));
            __global float *row = light + ((size_t)z * ny + y) * nx;
            for (int k = 0; k < LANES; ++k)
                if (x + k >= 0 && x + k < nx)
                    row[x + k] = first ? LANE(gone, k) : row[x + k] + LANE(gone, k);
        }
        if (z == nz)
            break;
        const float middle = shifts[2 * z + 1];
        const int cx = u - (int)floor(point.x * middle + offset.x), cy = v - (int)floor(point.y * middle + offset.y);
        if (cy < 0 || cy >= ny)
            continue;
        __global const uint *row = cells + ((size_t)z * ny + cy) * nx;
        for (int k = 0; k < LANES; ++k)
            sum[k] += cx + k >= 0 && cx + k < nx ? (float)row[cx + k] : 0.0f;
    }
}

/* Light -> crossings that let as much through. */
__kernel void crossings(
    const ulong begin, const ulong end,    // work-items, see common.h
    const float points,                    // of the disc
    const float of_one,                    // optical depth of one crossing
    __global float *light)                 // [nz + 1, ny, nx] sum over the points, then crossings
{
    WORK_ITEM(i);
    const float share = light[i] / points;
    light[i] = share < 1.0f ? -log(share) / of_one : 0.0f;
}
