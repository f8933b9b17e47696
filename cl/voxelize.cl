/*
 * How much hair each cell of a grid seen from the light holds, in integers: sums that don't depend on the order.
 *
 * The grid's x and y lie across the light, z along the way it travels; the unit is a cell.  Points are snapped to
 * 1/SUBPIXEL cell, and everything after is integers.  The report's three methods (section 2.3.1) draw a strand as
 * the fragments of a line across the light, one for each step along its longer axis; `lengths` deposits how often
 * a ray of light is expected to cross the strand.  One work-item draws one strand.
 */

#include "cells.h"

#define FRACTION 24                                     // fixed-point bits below the sub-cell in a walk

/* A segment with an end four grids away: what of it is in the grid's reach, snapped; whether anything is. */
bool ends_in_reach(const Grid *grid, float4 *from, float4 *to, int4 *a, int4 *b, float *wa, float *wb)
{
    if (!cut_to_grid(grid, from, to))
        return false;
    *a = to_cells(grid, *from, wa);
    *b = to_cells(grid, *to, wb);
    return (*a).x != OUTSIDE && (*b).x != OUTSIDE;
}

/* The report's voxels. A segment's fragments are those of a line drawn into x and y, as in raster.cl. */
__kernel void fragments(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Grid grid,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] -, -, type
    __global const uint *weights,          // [types] what one fragment adds
    const int method,                      // METHOD_BINARY, METHOD_COUNT or METHOD_TRILINEAR
    volatile __global uint *cells)         // [nz, ny, nx]
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const uint weight = weights[(int)strand_uv[strand].z];
    int4 a, b;
    float w;
    for (uint k = 0; k < span.y; ++k, a = b) {
        b = to_cells(&grid, points[span.x + k], &w);
        if (k == 0)
            continue;
        int4 p = a, q = b;
        if (a.x == OUTSIDE || b.x == OUTSIDE) {
            float4 from = points[span.x + k - 1], to = points[span.x + k];
            if (!ends_in_reach(&grid, &from, &to, &p, &q, &w, &w))
                continue;
        }
        const bool steep = abs(q.x - p.x) < abs(q.y - p.y);
        if (steep) {
            p = p.yxzw;
            q = q.yxzw;
        }
        if (p.x > q.x) {
            const int4 t = p; p = q; q = t;
        }
        const int du = q.x - p.x;
        if (du == 0)
            continue;
        const long v_step = ((long)(q.y - p.y) << FRACTION) / du, z_step = ((long)(q.z - p.z) << FRACTION) / du;
        const int begin = max((p.x + SUBPIXEL / 2 - 1) >> 8, 0);
        const int end = min((q.x + SUBPIXEL / 2 - 1) >> 8, steep ? grid.size.y : grid.size.x);
        for (int u = begin; u < end; ++u) {
            const int along = u * SUBPIXEL + SUBPIXEL / 2 - p.x;
            const int v = p.y + (int)((v_step * along) >> FRACTION), z = p.z + (int)((z_step * along) >> FRACTION);
            if (method == METHOD_TRILINEAR) {
                /* The four cells whose centres surround the fragment; the parts add up to the whole. */
                const int v0 = (v - SUBPIXEL / 2) >> 8, near = (z - SUBPIXEL / 2) >> 8;
                const int z0 = layer(&grid, near), z1 = layer(&grid, near + 1);
                const uint fv = (v - SUBPIXEL / 2) & 255, fz = (z - SUBPIXEL / 2) & 255;
                const uint both = weight * fv / 256 * fz / 256, right = weight * fv / 256 - both;
                const uint behind = weight * fz / 256 - both, here = weight - right - behind - both;
                add(cells, &grid, steep ? v0 : u, steep ? u : v0, z0, here);
                add(cells, &grid, steep ? v0 + 1 : u, steep ? u : v0 + 1, z0, right);
                add(cells, &grid, steep ? v0 : u, steep ? u : v0, z1, behind);
                add(cells, &grid, steep ? v0 + 1 : u, steep ? u : v0 + 1, z1, both);
            } else {
                const int x = steep ? v >> 8 : u, y = steep ? u : v >> 8, at = layer(&grid, z >> 8);
                if (method == METHOD_COUNT)
                    add(cells, &grid, x, y, at, weight);
                else if (in_grid(&grid, x, y, at))
                    atomic_max(&cells[((size_t)at * grid.size.y + y) * grid.size.x + x], weight);
            }
        }
    }
}

/* What a ray through a cell's face is expected to cross there: length · width · sin(fibre, light) / area of the face.
   A segment's amount is spread evenly over steps of 3/4 cell at most, and each between the four columns around it, so
   that nothing jumps when the light turns; what rounding leaves goes on to the next. */
__kernel void lengths(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Grid grid,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] -, -, type
    __global const uint *weights,          // [types] amount of one crossing
    volatile __global uint *cells)         // [nz, ny, nx]
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const float weight = weights[(int)strand_uv[strand].z];
    int4 a, b;
    float4 from, to;
    float wa, wb, left = 0.5f;
    for (uint k = 0; k < span.y; ++k, a = b, from = to, wa = wb) {
        to = points[span.x + k];
        b = to_cells(&grid, to, &wb);
        if (k == 0)
            continue;
        int4 p = a, q = b;
        float4 one = from, other = to;
        float w1 = wa, w2 = wb;
        if ((a.x == OUTSIDE || b.x == OUTSIDE) && !ends_in_reach(&grid, &one, &other, &p, &q, &w1, &w2))
            continue;
        if (max(p.z, q.z) < 0 && !grid.size.w)
            continue;
        /* A spot's rays meet the face, at distance w along its axis, at a slant: ray is w / cos long there. */
        const float w = max(0.5f * (w1 + w2), grid.face.w), width = 0.5f * (one.w + other.w);
        float4 d = other - one, ray = grid.light - grid.light.w * (0.5f * (one + other));
        d.w = ray.w = 0.0f;
        const float4 c = cross3(d, ray);
        const float exact = sqrt(dot3(c, c)) * width / (grid.face.x * (w * w * w)) * weight + left;
        const uint amount = (uint)min(exact, 0x1p31f);
        left = min(exact - amount, 1.0f);

        const int4 e = q - p;
        const int n = max(max(abs(e.x), abs(e.y)), abs(e.z)) / (SUBPIXEL / 4 * 3) + 1;
        /* Middles of the steps, in 2^-9 sub-cells: four grids of 1024 cells are 2^29 of them. Most segments are one
           step long, and divisions are what costs here. */
        uint part = amount, more = 0;
        int4 step = e << 9;
        if (n > 1) {
            part = amount / n;
            more = amount % n;
            step = (int4)(step.x / n, step.y / n, step.z / n, 0);
        }
        int4 at = (p << 9) + step / 2;
        for (int i = 0; i < n; ++i, at += step) {
            const ulong all = part + ((uint)i < more);
            const int x = (at.x >> 9) - SUBPIXEL / 2, y = (at.y >> 9) - SUBPIXEL / 2, z = layer(&grid, at.z >> 17);
            add_between(cells, &grid, x, y, z, all);
        }
    }
}
