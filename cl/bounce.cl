/*
 * The body's part in light that goes from hair to hair, in the same cells (transport.cl): where its surface lies, and which way
 * it faces, by how cells are filled; what it sends on; and light of cells as harmonics, for what the body shows (sky.h).
 */
#if LANES > 8
#undef LANES
#define LANES 8
#endif
#include "lanes.h"
#include "light.h"
#include "light_lanes.h"
#include "sky.h"

#define CLEAR 0.1f                         // of a cell's side before the surface: where it is asked for light
#define FLAT 0.01f                         // change of what is filled, from cell to cell, that no surface makes

/* Share of a cell that is body; the grid goes on beyond its sides as it is there. */
INLINED float solid_at(__global const float *solid, int n, int x, int y, int z)
{
    x = x < 0 ? 0 : x < n ? x : n - 1;
    y = y < 0 ? 0 : y < n ? y : n - 1;
    z = z < 0 ? 0 : z < n ? z : n - 1;
    return solid[((size_t)z * n + y) * n + x];
}

/* One work-item tells what the body is like in one cell, and what of lights' direct light it sends on. */
__kernel void faces(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    __global const float *held,            // [2, MOMENTS + 1, n, n, n] see `contents` in sky.cl
    const float4 body_color,               // linear r, g, b
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    __global float4 *faces)                // [n, n, n, 3] the way it faces, unit, or 0, and its share of the cell; r, g, b of
                                           // what it sends, and of that what is of lights' direct light
{
    WORK_ITEM(cell);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const int n = sky.size.x, x = cell % n, y = cell / n % n, z = cell / n / n;
    __global const float *solid = held + (size_t)MOMENTS * n * n * n;
    const float here = solid[cell], side = 1.0f / sky.place.w;
    const float4 change = {solid_at(solid, n, x - 1, y, z) - solid_at(solid, n, x + 1, y, z),
                           solid_at(solid, n, x, y - 1, z) - solid_at(solid, n, x, y + 1, z),
                           solid_at(solid, n, x, y, z - 1) - solid_at(solid, n, x, y, z + 1), 0.0f};
    const bool surface = dot3(change, change) > FLAT * FLAT;
    const float4 normal = surface ? unit_or(change, (float4)(0.0f)) : (float4)(0.0f);
    float4 sum = 0.0f;
    if (surface) {
        const float4 middle = (float4)(sky.place.xyz + side * (float3)(x + 0.5f, y + 0.5f, z + 0.5f), 0.0f);
        const lanes3 p = all_lanes(middle + side * (here - 0.5f + CLEAR) * normal), across = all_lanes(normal);
        for (int i = 0; i < n_lights; ++i) {
            const Light light = lights[i];
            const Obstacles obstacles = obstacles_of(&lighting, i);
            lanes3 l;
            const lanes there = share_of_light(&light, p, &l), cosine = dots(across, l);
            const lanes share = there * transmittances_at(&obstacles, there * cosine > 0.0f, p, across, F(0.0f), F(1.0f));
            sum += LANE(cosine, 0) > 0.0f ? LANE(share, 0) * LANE(cosine, 0) * light.color : (float4)(0.0f);
        }
    }
    sum *= body_color;
    faces[3 * cell] = (float4)(normal.xyz, here);
    faces[3 * cell + 1] = faces[3 * cell + 2] = (float4)(sum.xyz, 0.0f);
}

/* One work-item tells what the body sends on in one cell, of lights' light and of what light the cell has. */
__kernel void glow(
    const ulong begin, const ulong end,    // work-items, see common.h
    const float4 body_color,               // linear r, g, b
    __global const float *directions,      // [3, DIRECTIONS] towards where light comes from
    __global const float *light,           // [cells, CHANNELS, DIRECTIONS] see `sweep` in transport.cl
    __global float4 *faces)                // [cells, 3] see `faces`
{
    WORK_ITEM(cell);
    const float4 normal = faces[3 * cell];
    if (normal.x == 0.0f && normal.y == 0.0f && normal.z == 0.0f)
        return;
    __global const float *its = light + cell * (CHANNELS * DIRECTIONS);
    float4 sum = 0.0f;
    float total = 0.0f;
    for (int k = 0; k < DIRECTIONS; ++k) {
        const float cosine = normal.x * directions[k] + normal.y * directions[DIRECTIONS + k] + normal.z * directions[2 * DIRECTIONS + k];
        const float weight = cosine > 0.0f ? cosine : 0.0f;
        sum += weight * (float4)(its[k], its[DIRECTIONS + k], its[2 * DIRECTIONS + k], 0.0f);
        total += weight;
    }
    faces[3 * cell + 1] = faces[3 * cell + 2] + body_color * (sum / total);
}

/* One work-item tells one cell's light as spherical harmonics. */
__kernel void harmonics(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *light,           // [cells, CHANNELS, DIRECTIONS] see `sweep` in transport.cl
    __global const float *table,           // [HARMONICS, DIRECTIONS] how much each direction's light counts
    __global float4 *sky_cells)            // [cells, HARMONICS] r, g, b
{
    WORK_ITEM(cell);
    __global const float *its = light + cell * (CHANNELS * DIRECTIONS);
    for (int j = 0; j < HARMONICS; ++j) {
        float4 sum = 0.0f;
        for (int k = 0; k < DIRECTIONS; ++k)
            sum += table[j * DIRECTIONS + k] * (float4)(its[k], its[DIRECTIONS + k], its[2 * DIRECTIONS + k], 0.0f);
        sky_cells[cell * HARMONICS + j] = sum;
    }
}
