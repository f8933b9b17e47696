/*
 * Tables of how hair that scatters in lobes sends light on, of a type and a tangent: from each direction to each, and of a
 * distant light.  transport.cl uses this, and scatter.h and transport.h before it.
 */

/* One work-item tells what share of all light around hair of a type sends to an eye at one angle, of each shade. */
__kernel void albedos(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const Lobes *lobes,           // [types]
    __global const float4 *table,
    __global float *albedos)               // [types, ALBEDOS, SHADES]
{
    WORK_ITEM(item);
    const Lobes its = lobes[item / ALBEDOS];
    const int n_cosines = its.table.y, n_angles = its.table.z;
    const float x = (float)(item % ALBEDOS) * (n_cosines - 1) / (ALBEDOS - 1);
    const int i = x < n_cosines - 2 ? (int)x : n_cosines - 2;
    float sums[SHADES];
    for (int k = 0; k < SHADES; ++k)
        sums[k] = 0.0f;
    for (int j = 0; j < n_angles; ++j) {
        __global const float4 *a = table + its.table.x + (size_t)(i * n_angles + j) * SHADES, *b = a + (size_t)n_angles * SHADES;
        const float weight = (j == 0 || j == n_angles - 1 ? 1.0f : 2.0f) * M_PI_F / (n_angles - 1);   // both sides
        for (int k = 0; k < SHADES; ++k) {
            const float4 lobe = a[k] + (x - i) * (b[k] - a[k]);
            sums[k] += weight * ((lobe.x + lobe.y) + (lobe.z + lobe.w));
        }
    }
    for (int k = 0; k < SHADES; ++k)
        albedos[item * SHADES + k] = sums[k] < 1.0f ? sums[k] : 1.0f;
}

/* Add to sums what hair of each shade scatters at LANES places of its table. */
INLINED void add_shades(const Sought *sought, const Lobes *lobes, __global const float4 *table, float *sums)
{
    const int n_cosines = lobes->table.y, n_angles = lobes->table.z;
    for (int k = 0; k < LANES; ++k) {
        const float4 along = (float4)(LANE(sought->along[0], k), LANE(sought->along[1], k), LANE(sought->along[2], k),
                                      LANE(sought->along[3], k));
        const float x = LANE(sought->cosine, k), y = LANE(sought->angle, k);
        const int i = x < n_cosines - 1 ? (int)x : n_cosines - 2, j = y < n_angles - 1 ? (int)y : n_angles - 2;
        const float right = x - i, below = y - j;
        __global const float4 *a = table + lobes->table.x + (size_t)(i * n_angles + j) * SHADES, *b = a + SHADES;
        __global const float4 *c = a + (size_t)n_angles * SHADES, *d = c + SHADES;
        for (int s = 0; s < SHADES; ++s) {
            const float4 left = a[s] + below * (b[s] - a[s]), lobe = along * (left + right * (c[s] + below * (d[s] - c[s]) - left));
            sums[s] += (lobe.x + lobe.y) + (lobe.z + lobe.w);
        }
    }
}

/* One work-item tells what hair of one type and tangent sends in one direction, of light from each of all: of each shade, so
   that its sum is the albedo. */
__kernel void phases(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const Lobes *lobes,           // [types]
    __global const float4 *table,
    __global const float *albedos,         // [types, ALBEDOS, SHADES]
    __global const float4 *tangents,       // [TANGENTS]
    __global const float *directions,      // [3, DIRECTIONS] towards where light comes from
    __global const float *parts,           // [3, DIRECTIONS, PARTS_OF_ONE] of each of them
    __global float *phases)                // [types, TANGENTS, SHADES, from DIRECTIONS, to DIRECTIONS]
{
    WORK_ITEM(item);
    const int to = item % DIRECTIONS;
    const size_t row = item / DIRECTIONS;
    const int type = row / TANGENTS;
    const Lobes its = lobes[type];
    const float4 t = tangents[row % TANGENTS];
    const float4 v = -(float4)(directions[to], directions[DIRECTIONS + to], directions[2 * DIRECTIONS + to], 0.0f);
    __global float *rows = phases + row * (SHADES * DIRECTIONS * DIRECTIONS) + to;
    float totals[SHADES], sums[SHADES];
    for (int s = 0; s < SHADES; ++s)
        totals[s] = 0.0f;
    for (int from = 0; from < DIRECTIONS; ++from) {
        for (int s = 0; s < SHADES; ++s)
            sums[s] = 0.0f;
        for (int k = 0; k < PARTS_OF_ONE; k += LANES) {
            __global const float *its_parts = parts + from * PARTS_OF_ONE + k;
            const lanes3 l = {*(__global const lanes *)its_parts, *(__global const lanes *)(its_parts + DIRECTIONS * PARTS_OF_ONE),
                              *(__global const lanes *)(its_parts + 2 * DIRECTIONS * PARTS_OF_ONE)};
            const Sought sought = sought_of(&its, all_lanes(t), all_lanes(v), l, 4);
            add_shades(&sought, &its, table, sums);
        }
        for (int s = 0; s < SHADES; ++s) {
            rows[(s * DIRECTIONS + from) * DIRECTIONS] = sums[s];
            totals[s] += sums[s];
        }
    }
    for (int s = 0; s < SHADES; ++s) {
        const float scale = albedo_of(albedos + type * (ALBEDOS * SHADES), t, v, s) / (totals[s] > 1e-20f ? totals[s] : 1e-20f);
        for (int from = 0; from < DIRECTIONS; ++from)
            rows[(s * DIRECTIONS + from) * DIRECTIONS] *= scale;
    }
}

/* One work-item tells what hair of one type and tangent sends in one direction, of a distant light of 1: of each shade. */
__kernel void of_light(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint number,                     // of the light
    __global const Light *lights,          // see light.h
    __global const Lobes *lobes,           // [types]
    __global const float4 *table,
    __global const float4 *tangents,       // [TANGENTS]
    __global const float *parts,           // [3, DIRECTIONS, PARTS_OF_ONE] see `phases`
    __global float *by_tangent)            // [types, TANGENTS, SHADES, DIRECTIONS]
{
    WORK_ITEM(item);
    const Light light = lights[number];
    const int to = item % DIRECTIONS;
    const size_t row = item / DIRECTIONS;
    const Lobes its = lobes[row / TANGENTS];
    float sums[SHADES];
    for (int s = 0; s < SHADES; ++s)
        sums[s] = 0.0f;
    for (int k = 0; k < PARTS_OF_ONE && light.position.w == 0.0f; k += LANES) {
        __global const float *its_parts = parts + to * PARTS_OF_ONE + k;
        const lanes3 v = {-*(__global const lanes *)its_parts, -*(__global const lanes *)(its_parts + DIRECTIONS * PARTS_OF_ONE),
                          -*(__global const lanes *)(its_parts + 2 * DIRECTIONS * PARTS_OF_ONE)};
        const Sought sought = sought_of(&its, all_lanes(tangents[row % TANGENTS]), v, all_lanes(-light.direction), 4);
        add_shades(&sought, &its, table, sums);
    }
    for (int s = 0; s < SHADES; ++s)
        by_tangent[(row * SHADES + s) * DIRECTIONS + to] = M_PI_F / PARTS_OF_ONE * sums[s];
}
