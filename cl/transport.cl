/*
 * Light that goes from hair to hair, in cells of the world: what hair that scatters in lobes (lobes.h) makes of light from each
 * of DIRECTIONS, of lights' and of the sky's, slice by slice through the grid, order by order; then what it sends to the eye.
 */
#if LANES > 8
#undef LANES
#define LANES 8                            // so many parts of a direction are there
#endif
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "light_lanes.h"
#include "sky.h"
#include "transport.h"
#include "hair_cells.h"
#include "phases.h"
#include "leaving.h"

#define MOST (1.0f - 0x1p-24f)             // next to 1
#define LARGEST 0.9f                      // ratio of what one order adds to what the one before does, from which it is told
#define RAYS 8                             // of light through a cell, by which its mean is known

/* Mean share of a light's direct light in a cell; l: towards it. */
INLINED float share_in_cell(const Obstacles *obstacles, const Light *light, float4 low, float side, float4 *l)
{
    float sum = 0.0f;
    lanes3 towards;
    const lanes3 none = {F(0.0f), F(0.0f), F(0.0f)};
    for (int first = 0; first < RAYS; first += LANES) {
        lanes3 p;
        for (int k = 0; k < LANES; ++k) {
            const int i = first + k;
            put_lane(&p, k, low + side * (float4)(0.25f + 0.5f * (i & 1), 0.25f + 0.5f * (i >> 1 & 1), 0.25f + 0.5f * (i >> 2), 0.0f));
        }
        const lanes there = share_of_light(light, p, &towards);
        const lanes share = there * transmittances_at(obstacles, there > 0.0f, p, none, F(0.0f), F(1.0f));
        for (int k = 0; k < LANES; ++k)
            sum += LANE(share, k);
    }
    share_of_light(light, all_lanes(low + 0.5f * side), &towards);
    *l = (float4)(LANE(towards.x, 0), LANE(towards.y, 0), LANE(towards.z, 0), 0.0f);
    return sum / RAYS;
}

/* Add what hair of one kind sends of a light at l, of any place; scale: how much of it there is, r, g, b. */
INLINED void add_from(__global float *sent, const Lobes *lobes, __global const float4 *table, __global const float *parts,
                      float4 t, float4 l, float4 shades, float4 scale)
{
    scale *= M_PI_F / PARTS_OF_ONE;
    for (int to = 0; to < DIRECTIONS; ++to) {
        float4 sum = 0.0f;
        for (int k = 0; k < PARTS_OF_ONE; k += LANES) {
            __global const float *its_parts = parts + to * PARTS_OF_ONE + k;
            const lanes3 v = {-*(__global const lanes *)its_parts,
                              -*(__global const lanes *)(its_parts + DIRECTIONS * PARTS_OF_ONE),
                              -*(__global const lanes *)(its_parts + 2 * DIRECTIONS * PARTS_OF_ONE)};
            Sought sought = sought_of(lobes, all_lanes(t), v, all_lanes(l), 4);
            sought.shades[0] = F(shades.x);
            sought.shades[1] = F(shades.y);
            sought.shades[2] = F(shades.z);
            for (int j = 0; j < LANES; ++j)
                sum += around_strand(&sought, j, table + lobes->table.x, lobes->table.y, lobes->table.z);
        }
        sent[to] += scale.x * sum.x;
        sent[DIRECTIONS + to] += scale.y * sum.y;
        sent[2 * DIRECTIONS + to] += scale.z * sum.z;
    }
}

/* The same of a distant light. rows: of `of_light`, of the hair's type and tangent. */
INLINED void add_tabulated(__global float *sent, __global const float *rows, float4 shades, float4 scale)
{
    const float by_channel[3] = {shades.x, shades.y, shades.z}, scales[3] = {scale.x, scale.y, scale.z};
    for (int channel = 0; channel < CHANNELS; ++channel) {
        const int dark = by_channel[channel] < SHADES - 2 ? (int)by_channel[channel] : SHADES - 2;
        const float pale = by_channel[channel] - dark;
        __global const float *a = rows + dark * DIRECTIONS, *b = a + DIRECTIONS;
        for (int to = 0; to < DIRECTIONS; ++to)
            sent[channel * DIRECTIONS + to] += scales[channel] * (a[to] + pale * (b[to] - a[to]));
    }
}

/* One work-item adds what hair in one cell scatters of one light's direct light. */
__kernel void direct(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    const uint n_types,
    const uint number,                     // of the light; 0: nothing is there yet
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    __global const Lobes *lobes,           // [types]
    __global const float4 *table,
    __global const float4 *kinds,          // [types, n, n, n, 2] see `kinds`
    __global const float8 *dense,          // [n, n, n] see `kinds`
    __global const float *parts,           // [3, DIRECTIONS, PARTS_OF_ONE] see `phases`
    __global const float *by_tangent,      // [types, TANGENTS, SHADES, DIRECTIONS] see `of_light`
    __global float *first)                 // [n, n, n, CHANNELS, DIRECTIONS] where hair is
{
    WORK_ITEM(cell);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const int n = sky.size.x;
    const size_t cells = (size_t)n * n * n;
    __global float *sent = first + cell * (CHANNELS * DIRECTIONS);
    if (dense[cell].s6 == 0.0f)
        return;
    for (int k = 0; k < CHANNELS * DIRECTIONS && number == 0; ++k)
        sent[k] = 0.0f;
    const float side = 1.0f / sky.place.w;
    const float4 low = (float4)(sky.place.xyz + side * (float3)(cell % n, cell / n % n, cell / n / n), 0.0f);
    const Light light = lights[number];
    const Obstacles obstacles = obstacles_of(&lighting, number);
    float4 l;
    const float share = share_in_cell(&obstacles, &light, low, side, &l);
    for (uint type = 0; type < n_types && share > 0.0f; ++type) {
        const float4 t = kinds[2 * (type * cells + cell)], shades = kinds[2 * (type * cells + cell) + 1];
        const float4 scale = share * shades.w * light.color;
        const Lobes its = lobes[type];
        if (shades.w > 0.0f && light.position.w == 0.0f)
            add_tabulated(sent, by_tangent + ((size_t)type * TANGENTS + (int)t.w) * (SHADES * DIRECTIONS), shades, scale);
        else if (shades.w > 0.0f)
            add_from(sent, &its, table, parts, (float4)(t.xyz, 0.0f), l, shades, scale);
    }
}

/* One work-item tells what hair in one cell scatters: of lights', and of what light the cell has from all directions. */
__kernel void scatter(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n_types,
    const uint cells,
    __global const float4 *kinds,          // [types, cells, 2] see `kinds`
    __global const float8 *dense,          // [cells] see `kinds`
    __global const float *phases,          // [types, TANGENTS, SHADES, from DIRECTIONS, to DIRECTIONS]
    __global const float *first,           // [cells, CHANNELS, DIRECTIONS] of lights' direct light
    __global const float *light,           // [cells, CHANNELS, DIRECTIONS] that comes from there
    __global float *sent,                  // [cells, CHANNELS, DIRECTIONS] that goes on the same way, where hair is
    __global float2 *before)               // [cells, CHANNELS] sum of the light, and which share of it goes on, likewise
{
    WORK_ITEM(cell);
    if (dense[cell].s6 == 0.0f)
        return;
    const size_t place = cell * (CHANNELS * DIRECTIONS);
    for (int channel = 0; channel < CHANNELS; ++channel) {
        lanes sums[DIRECTIONS / LANES];
        for (int k = 0; k < DIRECTIONS / LANES; ++k)
            sums[k] = ((__global const lanes *)(first + place + channel * DIRECTIONS))[k];
        for (uint type = 0; type < n_types; ++type) {
            const float4 t = kinds[2 * ((size_t)type * cells + cell)], shades = kinds[2 * ((size_t)type * cells + cell) + 1];
            if (shades.w == 0.0f)
                continue;
            const float shade = channel == 0 ? shades.x : channel == 1 ? shades.y : shades.z;
            const int dark = shade < SHADES - 2 ? (int)shade : SHADES - 2;
            __global const float *rows = phases
                + (((size_t)type * TANGENTS + (int)t.w) * SHADES + dark) * (DIRECTIONS * DIRECTIONS);
            const float pale = shade - dark;
            for (int from = 0; from < DIRECTIONS; ++from) {
                __global const lanes *a = (__global const lanes *)(rows + from * DIRECTIONS);
                __global const lanes *b = (__global const lanes *)(rows + (DIRECTIONS + from) * DIRECTIONS);
                const float in = shades.w * light[place + channel * DIRECTIONS + from], p = in * (1.0f - pale), q = in * pale;
                for (int k = 0; k < DIRECTIONS / LANES; ++k)
                    sums[k] += p * a[k] + q * b[k];
            }
        }
        lanes ins = F(0.0f), outs = F(0.0f);
        for (int k = 0; k < DIRECTIONS / LANES; ++k) {
            ins += ((__global const lanes *)(light + place + channel * DIRECTIONS))[k];
            outs += sums[k] - ((__global const lanes *)(first + place + channel * DIRECTIONS))[k];
            ((__global lanes *)(sent + place + channel * DIRECTIONS))[k] = sums[k];
        }
        float in = 0.0f, out = 0.0f;
        for (int k = 0; k < LANES; ++k) {
            in += LANE(ins, k);
            out += LANE(outs, k);
        }
        before[cell * CHANNELS + channel] = (float2)(in, in > 0.0f ? out / in : 0.0f);
    }
}

/* One work-item tells what goes straight through one cell in each direction, and what does on average to places in it. */
__kernel void passing(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint cells,
    __global const float8 *dense,          // [cells] see `kinds`
    __global const float4 *towards,        // [DIRECTIONS] unit, where light comes from
    __global float2 *passes,               // [DIRECTIONS, cells] shares; the second is 1 where there is no hair, and only there
    __global float *keeps)                 // [cells] share of what hair in a cell sends that stays there, mean of directions
{
    WORK_ITEM(cell);
    const float8 m = dense[cell];
    float sum = 0.0f;
    for (int k = 0; k < DIRECTIONS; ++k) {
        const float4 w = towards[k];
        const float ax = fabs(w.x), ay = fabs(w.y), az = fabs(w.z), most = ax >= ay && ax >= az ? ax : ay >= az ? ay : az;
        const float d = m.s6, along = w.x * w.x * m.s0 + w.y * w.y * m.s1 + w.z * w.z * m.s2
            + 2.0f * (w.x * w.y * m.s3 + w.x * w.z * m.s4 + w.y * w.z * m.s5);
        const float square = d * d - d * along, depth = sqrt(square > 0.0f ? square : 0.0f) / most;
        const float through = depth > 0.0f ? exp(-depth) : 1.0f, mean = depth > 0.02f ? (1.0f - through) / depth : 1.0f - 0.5f * depth;
        passes[(size_t)k * cells + cell] = (float2)(through, d > 0.0f && mean > MOST ? MOST : mean);
        sum += 1.0f - mean;
    }
    keeps[cell] = m.s6 > 0.0f ? sum / DIRECTIONS : 0.0f;
}

/* One work-item takes the light of one direction through some rows of slices of cells across it, from the first that light
   meets on; a slice before these is done.  What a body hides in a cell stops there; where light leaves the body, what it
   sends takes the place of what it hides. */
__kernel void sweep(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    const int2 turns,                      // slices: the first, one past the last
    const int rows,                        // of a slice that a work-item takes; all of them where there are several slices
    const int everywhere,                  // 1: light of all cells is told, 0: of those with hair or a body's surface
    __global const float2 *passes,         // [DIRECTIONS, n, n, n] see `passing`
    __global const float4 *towards,        // [DIRECTIONS] unit, where light comes from
    __global const float *sent,            // [n, n, n, CHANNELS, DIRECTIONS] see `scatter`
    const int is_body,                     // 1: there is one
    __global const float4 *faces,          // [n, n, n, 3] see bounce.cl, if so
    __global float4 *behind,               // [DIRECTIONS, 2, (n + 2 SKY_EDGE)²] r, g, b, how much is open, of what is left behind
                                           // a slice and the one before; around these, and at first, light out of the grid
    __global float *light)                 // [n, n, n, CHANNELS, DIRECTIONS] mean of cells
{
    WORK_ITEM(item);
    const int each = n / rows, number = item / each, begin_row = item % each * rows, width = n + 2 * SKY_EDGE;
    const float4 w = towards[number];
    const float xyz[3] = {w.x, w.y, w.z}, ax = fabs(w.x), ay = fabs(w.y), az = fabs(w.z);
    const int axis = ax >= ay && ax >= az ? 0 : ay >= az ? 1 : 2;
    const int one = axis == 0 ? 1 : 0, two = axis == 2 ? 1 : 2, stride[3] = {1, n, n * n};
    const float most = fabs(xyz[axis]), du = xyz[one] / most, dv = xyz[two] / most;
    const int step_u = (int)floor(du), step_v = (int)floor(dv);
    const float fu = du - step_u, fv = dv - step_v;
    const float corners[4] = {(1.0f - fu) * (1.0f - fv), fu * (1.0f - fv), (1.0f - fu) * fv, fu * fv};
    __global float4 *own = behind + (size_t)2 * number * width * width + SKY_EDGE * width + SKY_EDGE;
    const float4 beyond = own[-1];
    for (int turn = turns.x; turn < turns.y; ++turn) {
        const int slice = xyz[axis] > 0.0f ? n - 1 - turn : turn;
        __global float4 *here = own + (turn & 1) * width * width;
        __global const float4 *before = own + (1 - (turn & 1)) * width * width + step_v * width + step_u;
        for (int v = begin_row; v < begin_row + rows; ++v)
            for (int u = 0; u < n; ++u) {
                const size_t cell = (size_t)slice * stride[axis] + (size_t)u * stride[one] + (size_t)v * stride[two];
                const size_t place = cell * (CHANNELS * DIRECTIONS) + number;
                __global const float4 *four = before + v * width + u;
                const float2 pass = passes[(size_t)number * n * n * n + cell];
                float4 there = beyond, source = 0.0f, glow = 0.0f;
                float open = 1.0f;
                bool leaves = false, told = everywhere || pass.y < 1.0f;
                if (pass.y < 1.0f)
                    source = (float4)(sent[place], sent[place + DIRECTIONS], sent[place + 2 * DIRECTIONS], 0.0f);
                if (turn)
                    there = corners[0] * four[0] + corners[1] * four[1] + corners[2] * four[width] + corners[3] * four[width + 1];
                if (is_body) {
                    const float4 normal = faces[3 * cell];
                    open = 1.0f - normal.w;
                    leaves = dot3(normal, w) < 0.0f;
                    told |= dot3(normal, normal) > 0.0f;
                    if (leaves)
                        glow = faces[3 * cell + 1];
                }
                const float hidden = open > there.w ? open - there.w : 0.0f, most_open = there.w + hidden;
                there = most_open > 0.0f ? (there + hidden * glow) / most_open : 0.0f;
                const float4 mean = pass.y * there + (1.0f - pass.y) * source;
                if (told) {
                    light[place] = mean.x;
                    light[place + DIRECTIONS] = mean.y;
                    light[place + 2 * DIRECTIONS] = mean.z;
                }
                const float share = leaves ? 1.0f : open;
                there = leaves ? open * there + (1.0f - open) * glow : there;
                there = share * (pass.x * there + (1.0f - pass.x) * source);
                there.w = share;
                here[v * width + u] = there;
            }
    }
}

/* One work-item adds to one channel's light of one cell, after an order of `scatter` and `sweep`, what of it comes back there
   again and again: the sum of a geometric series; and after the last of three orders, what further ones would add. */
__kernel void settle(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int turn,                        // 0, 1, 2: of these three orders; else -1
    __global const float *keeps,           // [cells] see `passing`
    __global const float2 *before,         // [cells, CHANNELS] see `scatter`
    __global float *sums,                  // [cells, CHANNELS, 2] of the first two of three
    __global float *light)                 // [cells, CHANNELS, DIRECTIONS] see `sweep`
{
    WORK_ITEM(item);
    __global float *its = light + item * DIRECTIONS, *earlier = sums + 2 * item;
    const float keep = keeps[item / CHANNELS];
    if (keep == 0.0f && turn < 0)
        return;
    float sum = 0.0f, more = 0.0f;
    for (int k = 0; k < DIRECTIONS; ++k)
        sum += its[k];
    if (keep > 0.0f) {
        const float2 came = before[item];
        const float stays = keep * came.y, ratio = stays < LARGEST ? stays : LARGEST;
        more = (sum - came.x) * ratio / (1.0f - ratio);
    }
    if (turn == 0 || turn == 1)
        earlier[turn] = sum + more;
    if (turn == 2) {
        const float first = earlier[1] - earlier[0], last = sum + more - earlier[1];
        const float falls = first > 0.0f && last > 0.0f ? last < LARGEST * first ? last / first : LARGEST : 0.0f;
        more += last * falls / (1.0f - falls);
    }
    for (int k = 0; k < DIRECTIONS; ++k) {
        const float value = its[k] + more / DIRECTIONS;
        its[k] = value > 0.0f ? value : 0.0f;
    }
}

/* One work-item evens out the light of one cell with that of hair in the cells around it, as far as these are dense: there it
   changes within a cell, and the layers of cells would show. */
__kernel void even_out(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    __global const float8 *dense,          // [n, n, n] see `kinds`
    __global const float *light,           // [n, n, n, CHANNELS, DIRECTIONS] see `sweep`
    __global float *evened)                // [n, n, n, CHANNELS, DIRECTIONS]
{
    WORK_ITEM(cell);
    const float square = dense[cell].s6 * dense[cell].s6, share = square / (square + 1.0f);
    __global const lanes *all = (__global const lanes *)light, *its = all + cell * (CHANNELS * DIRECTIONS / LANES);
    __global lanes *to = (__global lanes *)evened + cell * (CHANNELS * DIRECTIONS / LANES);
    lanes sums[CHANNELS * DIRECTIONS / LANES];
    float total = 0.0f;
    for (int j = 0; j < CHANNELS * DIRECTIONS / LANES; ++j)
        sums[j] = F(0.0f);
    for (int k = 0; k < 27 && share > 0.001f; ++k) {
        float weight;
        const size_t there = around_cell(cell, n, k, &weight);
        weight *= dense[there].s6;
        total += weight;
        for (int j = 0; j < CHANNELS * DIRECTIONS / LANES; ++j)
            sums[j] += weight * all[there * (CHANNELS * DIRECTIONS / LANES) + j];
    }
    for (int j = 0; j < CHANNELS * DIRECTIONS / LANES; ++j)
        to[j] = total > 0.0f ? its[j] + share * (sums[j] / total - its[j]) : its[j];
}
