/*
 * What cells of the world hold of hair that scatters in lobes, and what it is like there.  transport.cl uses this, and scatter.h,
 * sky.h and transport.h before it.
 */
#define OF_CELL 16                         // sums of hair of a type in a cell: its direction, shades, second moment; 4 more
#define DIRECTION 0
#define COLOR 3
#define MOMENT 6
#include "nearby.h"

#define STEPS 2                            // along hair, in a cell's side

/* Of one segment from a, that long in sides of a cell: (1 - alpha) · width · length over a cell's face, times its direction,
   towards the tip, the shades of its colour, and the second moment of its direction. */
INLINED void leave_segment(volatile __global int *amounts, Nearby *nearby, const Sky *sky, float4 a, float4 d, float length,
                           float opaque, float4 shades, int type, float unit)
{
    const float scale = sky->place.w;
    const int n = sky->size.x, steps = length * STEPS < 4096.0f ? (int)(length * STEPS) + 1 : 4096;
    const float4 t = unit_or((float4)(d.xyz, 0.0f), (float4)(0.0f, 1.0f, 0.0f, 0.0f));
    float amount = 0.0f;
    int4 cell = -1;
    for (int i = 0; i <= steps; ++i) {     // the last is none, but ends the cell before it
        const float4 p = a + ((i + 0.5f) / steps) * d, q = (p - sky->place) * scale;
        const bool inside = i < steps && q.x >= 0.0f && q.y >= 0.0f && q.z >= 0.0f && q.x < n && q.y < n && q.z < n;
        const int4 here = inside ? (int4)((int)q.x, (int)q.y, (int)q.z, 0) : (int4)(-1);
        if (cell.x >= 0 && (here.x != cell.x || here.y != cell.y || here.z != cell.z)) {
            const float sums[OF_CELL] = {
                amount * t.x, amount * t.y, amount * t.z,
                amount * shades.x, amount * shades.y, amount * shades.z,
                amount * t.x * t.x, amount * t.y * t.y, amount * t.z * t.z,
                amount * t.x * t.y, amount * t.x * t.z, amount * t.y * t.z};
            leave(amounts, nearby, cell, n, type, sums, unit);
            amount = 0.0f;
        }
        cell = here;
        amount += inside ? opaque * length * scale / steps * p.w : 0.0f;
    }
}

/* One work-item adds up what some strands leave in cells. */
__kernel void hold(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    const uint n_strands,
    const uint each,                       // strands of a work-item
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const float4 *strand_uv,
    __global const HairType *types,
    __global const Lobes *lobes,
    __global const float4 *colors,
    const int color_per,
    const float unit,                      // integers for 1
    volatile __global int *amounts)        // [types, n, n, n, OF_CELL]
{
    WORK_ITEM(item);
    Nearby nearby;
    begin_nearby(&nearby);
    const uint first = each * (uint)item;
    for (uint strand = first; strand < n_strands && strand < first + each; ++strand) {
        const uint2 span = spans[strand];
        const int type = (int)strand_uv[strand].z;
        const float opaque = 1.0f - types[type].shine.z;
        float4 shades = 0.0f;
        for (uint k = 0; k + 1 < span.y; ++k) {
            const uint id = span.x + k;
            const float4 a = points[id], d = points[id + 1] - a;
            const float length = sqrt(dot3(d, d)) * sky.place.w;
            if (k == 0 || color_per == 2)
                shades = shades_of(colors[color_per == 0 ? 0 : color_per == 1 ? strand : id], lobes[type].color.x) / (SHADES - 1);
            if (length > 0.0f)
                leave_segment(amounts, &nearby, &sky, a, d, length, opaque, shades, type, unit);
        }
    }
    end_nearby(amounts, &nearby);
}

/* A cell beside one along an axis, -1 to 1 on; the grid goes on beyond its sides as it is there. */
INLINED int beside(int place, int step, int n)
{
    const int there = place + step;
    return there < 0 ? 0 : there < n ? there : n - 1;
}

/* The k-th of the 27 cells around one, and its weight: 8, 4, 2 or 1 of 64. */
INLINED size_t around_cell(size_t cell, int n, int k, float *weight)
{
    const int x = k % 3 - 1, y = k / 3 % 3 - 1, z = k / 9 - 1;
    *weight = (1.0f / 64) * ((x ? 1 : 2) * (y ? 1 : 2) * (z ? 1 : 2));
    return ((size_t)beside(cell / n / n, z, n) * n + beside(cell / n % n, y, n)) * n + beside(cell % n, x, n);
}

/* The number of the tangent that is nearest to t. */
INLINED int nearest_tangent(__global const float4 *tangents, float4 t)
{
    float nearest = -2.0f;
    int number = 0;
    for (int i = 0; i < TANGENTS; ++i) {
        const float cosine = dot3(t, tangents[i]);
        if (cosine > nearest) {
            nearest = cosine;
            number = i;
        }
    }
    return number;
}

/* One work-item tells what hair is like in and around one cell: where only the cell counts, the layers of cells show. */
__kernel void kinds(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n_types,
    const int n,
    const float unit,                      // integers for 1
    __global const int *amounts,           // [types, n, n, n, OF_CELL] see `hold`
    __global const float4 *tangents,       // [TANGENTS] unit
    __global float4 *kinds,                // [types, n, n, n, 2] the nearest of the tangents, its number; shades, and of the
                                           // hair in the cell what share is of this type
    __global float8 *dense)                // [n, n, n] moments of all its hair; their trace; -
{
    WORK_ITEM(cell);
    const size_t cells = (size_t)n * n * n;
    float8 all = 0.0f;
    for (uint type = 0; type < n_types; ++type) {
        float sums[OF_CELL];
        for (int j = 0; j < OF_CELL; ++j)
            sums[j] = 0.0f;
        for (int k = 0; k < 27; ++k) {
            float weight;
            __global const int *its = amounts + (type * cells + around_cell(cell, n, k, &weight)) * OF_CELL;
            for (int j = 0; j < OF_CELL; ++j)
                sums[j] += weight * its[j];
        }
        const float amount = sums[MOMENT] + sums[MOMENT + 1] + sums[MOMENT + 2];
        const float4 t = unit_or((float4)(sums[0], sums[1], sums[2], 0.0f), (float4)(0.0f, 1.0f, 0.0f, 0.0f));
        const int number = amount > 0.0f ? nearest_tangent(tangents, t) : 0;
        const float scale = amount > 0.0f ? (SHADES - 1) / amount : 0.0f;
        __global float4 *its = kinds + 2 * (type * cells + cell);
        its[0] = (float4)(tangents[number].xyz, number);
        its[1] = (float4)(scale * sums[COLOR], scale * sums[COLOR + 1], scale * sums[COLOR + 2], amount);
        all += (float8)(sums[MOMENT], sums[MOMENT + 1], sums[MOMENT + 2], sums[MOMENT + 3], sums[MOMENT + 4], sums[MOMENT + 5], amount, 0.0f);
    }
    for (uint type = 0; type < n_types; ++type)
        kinds[2 * (type * cells + cell) + 1].w /= all.s6 > 0.0f ? all.s6 : 1.0f;
    dense[cell] = all / unit;
}
