/*
 * A sky that hair and body hide, in one grid of the world: what each cell holds of hair, with the second moment of its
 * directions, and of the body, in integers; then how much of each direction's light reaches each cell, slice by slice; then
 * all of it as spherical harmonics.
 */

#include "lanes.h"
#include "light.h"
#include "sky.h"

#define PARTS 4                            // of a cell's side: columns of the body, and steps along hair
#define WHOLE (PARTS * PARTS * SUBPIXEL)   // of a cell that is all body

/* What a strand has left in one cell. */
INLINED void leave(volatile __global int *moments, size_t cell, const float *sums, float unit)
{
    for (int j = 0; j < MOMENTS; ++j)
        atomic_add(&moments[cell * MOMENTS + j], (int)floor(sums[j] * unit + 0.5f));
}

/* One work-item adds up, for one strand, (1 - alpha) · width · length over a cell's face, times the second moment of its
   direction, whose trace is 1. */
__kernel void deposit(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] -, -, type
    __global const HairType *types,
    const float unit,                      // integers for 1
    volatile __global int *moments)        // [n, n, n, MOMENTS]
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const float opaque = 1.0f - types[(int)strand_uv[strand].z].shine.z, scale = sky.place.w;
    const int n = sky.size.x;
    float sums[MOMENTS];
    long cell = -1;
    for (int j = 0; j < MOMENTS; ++j)
        sums[j] = 0.0f;
    for (uint k = 0; k + 1 < span.y; ++k) {
        const float4 a = points[span.x + k], d = points[span.x + k + 1] - a;
        const float square = dot3(d, d), length = sqrt(square) * scale;
        if (!(square > 0.0f))
            continue;
        const int steps = length * PARTS < 4096.0f ? (int)(length * PARTS) + 1 : 4096;
        const float each = opaque * length * scale / steps;
        for (int i = 0; i < steps; ++i) {
            const float4 p = a + ((i + 0.5f) / steps) * d;
            const float4 c = (p - sky.place) * scale;
            if (!(c.x >= 0.0f && c.y >= 0.0f && c.z >= 0.0f && c.x < n && c.y < n && c.z < n))
                continue;
            const long here = ((long)(int)c.z * n + (int)c.y) * n + (int)c.x;
            if (here != cell) {
                if (cell >= 0)
                    leave(moments, cell, sums, unit);
                for (int j = 0; j < MOMENTS; ++j)
                    sums[j] = 0.0f;
                cell = here;
            }
            const float amount = each * p.w / square;
            sums[0] += amount * (d.x * d.x), sums[1] += amount * (d.y * d.y), sums[2] += amount * (d.z * d.z);
            sums[3] += amount * (d.x * d.y), sums[4] += amount * (d.x * d.z), sums[5] += amount * (d.y * d.z);
        }
    }
    if (cell >= 0)
        leave(moments, cell, sums, unit);
}

/* A coordinate in 1/SUBPIXEL of `parts` of a cell. */
INLINED int snapped(float place, float low, float scale, int n, int parts)
{
    const float at = (place - low) * scale * (parts * SUBPIXEL), most = (float)n * (parts * SUBPIXEL) - 1.0f;
    return (int)floor(at > 0.0f ? at < most ? at : most : 0.0f);
}

/* One work-item tells where the columns of cells' parts along an axis meet one triangle: what lies before it along the axis
   is body if the triangle faces that way, and what lies before one that faces back is taken away again. */
__kernel void surface(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    const int axis,                        // 0, 1, 2
    __global const float4 *positions,      // body: see tessellate.cl
    __global const uint4 *triangles,
    volatile __global int *solids)         // [3, n, n, n] changes of solid, in 1/WHOLE
{
    WORK_ITEM(triangle);
    const uint4 t = triangles[triangle];
    const uint corner[3] = {t.x, t.y, t.z};
    const int n = sky.size.x, place[3] = {axis, axis == 2 ? 0 : axis + 1, axis == 0 ? 2 : axis - 1};
    const int stride[3] = {1, n, n * n};
    long p[3][3];                          // of each corner: along, across, across
    for (int i = 0; i < 3; ++i) {
        const float4 at = positions[corner[i]];
        const float xyz[3] = {at.x, at.y, at.z}, low[3] = {sky.place.x, sky.place.y, sky.place.z};
        for (int j = 0; j < 3; ++j)
            p[i][j] = snapped(xyz[place[j]], low[place[j]], sky.place.w, n, j ? PARTS : 1);
    }
    const long area = (p[1][1] - p[0][1]) * (p[2][2] - p[0][2]) - (p[1][2] - p[0][2]) * (p[2][1] - p[0][1]);
    if (area == 0)
        return;
    const int sign = area > 0 ? 1 : -1;
    long first[2], last[2];
    for (int j = 0; j < 2; ++j) {
        const long a = p[0][j + 1], b = p[1][j + 1], c = p[2][j + 1];
        first[j] = (min(a, min(b, c)) + SUBPIXEL / 2 - 1) / SUBPIXEL;
        last[j] = min((max(a, max(b, c)) + SUBPIXEL / 2) / SUBPIXEL, (long)n * PARTS);
    }
    for (long v = first[1]; v < last[1]; ++v)
        for (long u = first[0]; u < last[0]; ++u) {
            const long x = u * SUBPIXEL + SUBPIXEL / 2, y = v * SUBPIXEL + SUBPIXEL / 2;
            long along = 0;
            bool inside = true;
            for (int i = 0; i < 3; ++i) {   // a place on a side belongs to one of the two triangles there
                const int a = i == 2 ? 0 : i + 1, b = i == 0 ? 2 : i - 1;
                const long dx = sign * (p[b][1] - p[a][1]), dy = sign * (p[b][2] - p[a][2]);
                const long edge = dx * (y - p[a][2]) - dy * (x - p[a][1]);
                inside &= edge > 0 || (edge == 0 && (dy > 0 || (dy == 0 && dx < 0)));
                along += edge * p[i][0];
            }
            if (!inside)
                continue;
            const int z = (int)(along / (sign * area)), layer = z / SUBPIXEL, part = z - layer * SUBPIXEL;
            const size_t column = (size_t)(u / PARTS) * stride[place[1]] + (size_t)(v / PARTS) * stride[place[2]];
            volatile __global int *there = solids + (size_t)axis * n * n * n + column;
            atomic_add(&there[(size_t)layer * stride[axis]], sign * part);
            if (layer)
                atomic_add(&there[(size_t)(layer - 1) * stride[axis]], sign * (SUBPIXEL - part));
        }
}

/* One work-item sums the changes of one column along one axis, from its far end. */
__kernel void fill(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    __global int *solids)                  // [3, n, n, n] in 1/WHOLE
{
    WORK_ITEM(item);
    const int axis = item / (n * n), rest = item % (n * n), u = rest % n, v = rest / n;
    const size_t across[3] = {(size_t)u * n + (size_t)v * n * n, (size_t)u + (size_t)v * n * n, (size_t)u + (size_t)v * n};
    const int along = axis == 0 ? 1 : axis == 1 ? n : n * n;
    __global int *column = solids + (size_t)axis * n * n * n + across[axis];
    int sum = 0;
    for (int k = n - 1; k >= 0; --k) {
        sum += column[(size_t)k * along];
        column[(size_t)k * along] = sum;
    }
}

/* One work-item tells what one cell holds. An axis alone would take what lies below an open surface for body. */
__kernel void contents(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    const float unit,                      // integers for 1
    __global const int *moments,           // [n, n, n, MOMENTS]
    const int is_body,                     // 1: there is one
    __global const int *solids,            // [3, n, n, n] in 1/WHOLE, if so
    __global float8 *held)                 // [n, n, n] xx, yy, zz, xy, xz, yz of hair; share that is body
{
    WORK_ITEM(cell);
    __global const int *m = moments + cell * MOMENTS;
    float solid = is_body ? 1.0f : 0.0f;
    for (int axis = 0; is_body && axis < 3; ++axis) {
        const float share = fabs((float)solids[(size_t)axis * n * n * n + cell]) / WHOLE;
        solid = share < solid ? share : solid;
    }
    held[cell] = (float8)(m[0] / unit, m[1] / unit, m[2] / unit, m[3] / unit, m[4] / unit, m[5] / unit, solid, 0.0f);
}

/* What four cells of a slice let through around (u, v); 1 outside of the grid. */
INLINED float between_four(__global const float *slice, int n, float u, float v)
{
    const float lu = floor(u), lv = floor(v), fu = u - lu, fv = v - lv;
    float sum = 0.0f;
    for (int k = 0; k < 4; ++k) {
        const int a = (int)lu + (k & 1), b = (int)lv + (k >> 1);
        const float weight = ((k & 1) ? fu : 1.0f - fu) * ((k & 2) ? fv : 1.0f - fv);
        sum += weight * (a < 0 || b < 0 || a >= n || b >= n ? 1.0f : slice[b * n + a]);
    }
    return sum;
}

/* One work-item takes the light of one direction through a row of one slice of cells across it; the slice before it towards
   that light is done. */
__kernel void sweep(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    const int turn,                        // the slice: 0 is the first one that light meets
    __global const float8 *held,           // [n, n, n], see `contents`
    __global const float4 *directions,     // [directions] unit, towards the light
    __global float *behind,                // [directions, 2, n, n] what is left behind this slice and the one before
    __global float *through)               // [directions, n, n, n] what reaches the middles of cells
{
    WORK_ITEM(item);
    const size_t number = item / n;
    const int v = item % n;
    const float4 w = directions[number];
    const float xyz[3] = {w.x, w.y, w.z}, ax = fabs(w.x), ay = fabs(w.y), az = fabs(w.z);
    const int axis = ax >= ay && ax >= az ? 0 : ay >= az ? 1 : 2;
    const int one = axis == 0 ? 1 : 0, two = axis == 2 ? 1 : 2, stride[3] = {1, n, n * n};
    const float most = fabs(xyz[axis]), du = xyz[one] / most, dv = xyz[two] / most;
    const int slice = xyz[axis] > 0.0f ? n - 1 - turn : turn;
    __global float *here = behind + (2 * number + (turn & 1)) * n * n;
    __global const float *before = behind + (2 * number + 1 - (turn & 1)) * n * n;
    for (int u = 0; u < n; ++u) {
        const size_t cell = (size_t)slice * stride[axis] + (size_t)u * stride[one] + (size_t)v * stride[two];
        const float8 m = held[cell];
        const float d = m.s0 + m.s1 + m.s2;
        const float along = w.x * w.x * m.s0 + w.y * w.y * m.s1 + w.z * w.z * m.s2
            + 2.0f * (w.x * w.y * m.s3 + w.x * w.z * m.s4 + w.y * w.z * m.s5);
        const float square = d * d - d * along, depth = sqrt(square > 0.0f ? square : 0.0f) / most;
        const float half_way = sqrt(exp(-depth) * (1.0f - m.s6));
        const float there = (turn ? between_four(before, n, u + du, v + dv) : 1.0f) * half_way;
        through[number * n * n * n + cell] = there;
        here[v * n + u] = there * half_way;
    }
}

/* One work-item adds up the light of all directions in one cell. */
__kernel void gather(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    const int n_directions,
    __global const float *through,         // [directions, n, n, n]
    __global const float4 *table,          // [directions, HARMONICS] r, g, b of each direction's light
    __global float4 *cells)                // [n, n, n, HARMONICS]
{
    WORK_ITEM(cell);
    float4 sums[HARMONICS];
    for (int j = 0; j < HARMONICS; ++j)
        sums[j] = 0.0f;
    for (int i = 0; i < n_directions; ++i) {
        const float share = through[(size_t)i * n * n * n + cell];
        for (int j = 0; j < HARMONICS; ++j)
            sums[j] += share * table[i * HARMONICS + j];
    }
    for (int j = 0; j < HARMONICS; ++j)
        cells[cell * HARMONICS + j] = sums[j];
}

/* One work-item looks up the light that one point of strands gets from all around its fibre. */
__kernel void at_points(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    __global const float4 *cells,          // [n, n, n, HARMONICS]
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    const uint run,
    __global float4 *light)                // [points] r, g, b
{
    WORK_ITEM(id);
    const uint2 span = spans[strand_of[id / run]];
    const uint last = span.x + span.y;
    const float4 here = points[id];
    const float4 before = id > span.x && id < last ? points[id - 1] : here;
    const float4 after = id + 1 < last && id >= span.x ? points[id + 1] : here;
    const float4 along = (float4)((after - before).xyz, 0.0f);
    light[id] = sky_light(&sky, cells, here, unit_or(along, (float4)(0.0f, 1.0f, 0.0f, 0.0f)), 0.0f, -0.125f);
}
