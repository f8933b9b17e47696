/*
 * An order of the user's strands in which those that are near each other in space are near each other in memory: what one
 * looks up, the next finds in the cache.  Strands are counted by the cell of a cube that their roots lie in, 1 << CELL_BITS
 * cells a side, and these follow each other along a curve (Morton's) that seldom jumps.  Within a cell any order will do.
 */

/* The box around some roots; what is no number is in no box. */
inline void widen(float4 *low, float4 *high, float4 p)
{
    low->x = p.x < low->x ? p.x : low->x;
    low->y = p.y < low->y ? p.y : low->y;
    low->z = p.z < low->z ? p.z : low->z;
    high->x = p.x > high->x ? p.x : high->x;
    high->y = p.y > high->y ? p.y : high->y;
    high->z = p.z > high->z ? p.z : high->z;
}

inline float4 root_of(__global const float *packed, uint2 span)
{
    return (float4)(vload3(span.x, packed), 0.0f);
}

/* One work-item puts a box around SCAN roots. */
__kernel void boxes(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *packed,          // [points, 3]
    __global const uint2 *spans,           // [strands] first point, points
    const uint n,                          // strands
    __global float4 *corners)              // [ceil(strands / SCAN), 2] lowest and highest x, y, z
{
    WORK_ITEM(block);
    float4 low = INFINITY, high = -INFINITY;
    const uint stop = min(((uint)block + 1) * (uint)SCAN, n);
    for (uint i = block * SCAN; i < stop; ++i)
        if (spans[i].y) {
            const float4 p = root_of(packed, spans[i]);
            widen(&low, &high, p);
        }
    corners[2 * block] = low;
    corners[2 * block + 1] = high;
}

/* One work-item puts a box around SCAN boxes: again and again, until there is one. */
__kernel void box(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n,                          // boxes
    __global const float4 *corners,        // [n, 2] lowest and highest x, y, z
    __global float4 *around)               // [ceil(n / SCAN), 2]
{
    WORK_ITEM(block);
    const uint first = block * SCAN, stop = min(first + (uint)SCAN, n);
    float4 low = corners[2 * first], high = corners[2 * first + 1];
    for (uint i = first + 1; i < stop; ++i) {
        widen(&low, &high, corners[2 * i]);
        widen(&low, &high, corners[2 * i + 1]);
    }
    around[2 * block] = low;
    around[2 * block + 1] = high;
}

inline uint cell_along(float x, float cells)
{
    const float at = x * cells;
    return at > 0.0f ? at < (1 << CELL_BITS) - 1 ? (uint)at : (1 << CELL_BITS) - 1 : 0;
}

/* One work-item counts one strand in its cell, and keeps how many strands and points were there before it. */
__kernel void count(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *packed,          // [points, 3]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *corners,        // [2] of the box around all roots
    volatile __global uint *counts,        // [cells, 2] strands, points
    __global uint4 *ranks)                 // [strands] cell; strands, points of it that were counted before; -
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    uint cell = 0;
    if (span.y) {
        const float4 size = corners[1] - corners[0], p = root_of(packed, span) - corners[0];
        const float side = size.x > size.y ? size.x : size.y, cells = (1 << CELL_BITS) / (side > size.z ? side : size.z);
        const uint x = cell_along(p.x, cells), y = cell_along(p.y, cells), z = cell_along(p.z, cells);
        for (uint bit = 0; bit < CELL_BITS; ++bit)
            cell |= (x >> bit & 1) << 3 * bit | (y >> bit & 1) << (3 * bit + 1) | (z >> bit & 1) << (3 * bit + 2);
    }
    ranks[i] = (uint4)(cell, atomic_inc(&counts[2 * cell]), atomic_add(&counts[2 * cell + 1], span.y), 0);
}

__kernel void scan(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n,                          // cells
    __global uint2 *counts)                // [n] in: strands, points; out: those of all cells before
{
    WORK_ITEM(only);
    uint2 sum = 0;
    for (uint i = 0; i < n; ++i) {
        const uint2 here = counts[i];
        counts[i] = sum;
        sum += here;
    }
}

__kernel void place(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const uint4 *ranks,           // [strands] see `count`
    __global const uint2 *counts,          // [cells] strands, points before each
    __global uint2 *placed)                // [strands] strand, first point in the new order
{
    WORK_ITEM(i);
    placed[i] = counts[ranks[i].x] + ranks[i].yz;
}
