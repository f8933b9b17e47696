/*
 * The wind where hair is (docs/motion.md): its mean, gusts that it carries along, less near the skin and behind hair; and
 * shell fur that it bends, vertex by vertex.  Rows are as in motion.cl: [points, 3, strands].
 */
#include "lanes.h"
#include "chance.h"

INLINED lanes3 rows_of(__global const float *rows, size_t stride)
{
    const lanes3 v = {*(__global const lanes *)rows, *(__global const lanes *)(rows + stride),
                      *(__global const lanes *)(rows + 2 * stride)};
    return v;
}

INLINED void put_rows(__global float *rows, size_t stride, lanes3 v)
{
    *(__global lanes *)rows = v.x;
    *(__global lanes *)(rows + stride) = v.y;
    *(__global lanes *)(rows + 2 * stride) = v.z;
}

INLINED lanes smooth(lanes f)
{
    return f * f * f * (f * (f * 6.0f - 15.0f) + 10.0f);
}

/* Three numbers from -1 to 1 at corners of cells. */
INLINED lanes3 gusts_at(lanes_i x, lanes_i y, lanes_i z, uint seed)
{
    const lanes_i cell = (x & (PERIOD - 1)) + PERIOD * (y & (PERIOD - 1)) + PERIOD * PERIOD * (z & (PERIOD - 1));
    return random_vectors(AS_U(cell), seed, 9);
}

INLINED lanes3 between(lanes share, lanes3 a, lanes3 b)
{
    return plus(a, scaled(minus(b, a), share));
}

/* The wind at places [world] in free air: its mean, and gusts, random at the corners of cells and smooth between. */
INLINED lanes3 wind_at(const Wind *wind, lanes3 place)
{
    const lanes3 mean = all_lanes(wind->mean);
    if (!(wind->mean.w > 0.0f))
        return mean;
    const lanes3 p = minus(scaled(place, F(wind->gone.w)), all_lanes(wind->gone));
    const lanes3 low = {whole_below(p.x), whole_below(p.y), whole_below(p.z)};
    const lanes_i x = nearest_i(low.x), y = nearest_i(low.y), z = nearest_i(low.z);
    const lanes sx = smooth(p.x - low.x), sy = smooth(p.y - low.y), sz = smooth(p.z - low.z);
    const uint seed = (uint)wind->seed.x;
    lanes3 rows[4];
    for (int k = 0; k < 4; ++k)
        rows[k] = between(sx, gusts_at(x, y + (k & 1), z + (k >> 1), seed), gusts_at(x + 1, y + (k & 1), z + (k >> 1), seed));
    return plus(mean, scaled(between(sz, between(sy, rows[0], rows[1]), between(sy, rows[2], rows[3])), F(wind->mean.w)));
}

/* The wind at the points of strands.  One work-item does LANES strands. */
BY_HAND __kernel void blow(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Wind wind,
    const uint padded,
    const uint points,
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *places,          // [points, 3, padded] relative to the root [world]
    __global const float *open,            // [points, padded] shares of the wind that hair upwind leaves; or what isn't read
    __global float *winds)                 // [points, 3, padded] [world / s]
{
    WORK_ITEM(item);
    const size_t first = item * LANES, stride = padded;
    const lanes3 root = rows_of(roots + first, stride), normal = rows_of(roots + 9 * stride + first, stride);
    lanes3 here = wind_at(&wind, root);
    put_rows(winds + first, stride, all_lanes((float4)(0.0f)));   // roots are held
    for (uint i = 1; i < points; ++i) {
        const lanes3 place = rows_of(places + 3 * i * stride + first, stride);
        if (wind.seed.y)
            here = wind_at(&wind, plus(root, place));
        lanes share = F(1.0f);
        if (wind.less.x > 0.0f) {          // hair that hangs below its root's plane lies beside the body, not in its skin
            const lanes h = within(positive(dots(place, normal)) * wind.less.x, 0.0f, 1.0f);
            share = h * h * (3.0f - 2.0f * h);
        }
        if (wind.less.y > 0.0f)
            share *= *(__global const lanes *)(open + i * stride + first);
        put_rows(winds + 3 * i * stride + first, stride, scaled(here, share));
    }
}

/* Crossings of hair upwind of a place. */
inline float upwind_of(const Grid *grid, __global const float *sums, float4 p)
{
    const float4 most = convert_float4(grid->size) - (float4)(1.0f, 1.0f, 0.0f, 0.0f);
    const size_t across = grid->size.x, layer = across * grid->size.y;
    float4 q = ((grid->to_grid[0] * p.x + grid->to_grid[1] * p.y) + grid->to_grid[2] * p.z) + grid->to_grid[3];
    q -= (float4)(0.5f, 0.5f, 0.0f, 0.0f);   // middles of columns
    q = fmin(fmax(q, 0.0f), most);
    const int4 cell = min(convert_int4(q), grid->size - (int4)(2, 2, 1, 0));
    const float4 f = q - convert_float4(cell);
    __global const float *low = sums + cell.z * layer + cell.y * across + cell.x, *high = low + layer;
    const float near = (low[0] + f.x * (low[1] - low[0])) * (1.0f - f.y)
        + (low[across] + f.x * (low[across + 1] - low[across])) * f.y;
    const float far = (high[0] + f.x * (high[1] - high[0])) * (1.0f - f.y)
        + (high[across] + f.x * (high[across + 1] - high[across])) * f.y;
    return near + f.z * (far - near);
}

/* How much of the wind the hair upwind leaves at the points of strands.  One work-item does LANES strands. */
BY_HAND __kernel void shelter(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Wind wind,
    const Grid grid,                       // seen from where the wind comes from, as from a light
    __global const float *sums,            // [nz + 1, ny, nx] crossings before each layer, see zscan.cl
    const uint padded,
    const uint points,
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *places,          // [points, 3, padded] relative to the root [world]
    __global float *open)                  // [points, padded] shares that are left
{
    WORK_ITEM(item);
    const size_t first = item * LANES, stride = padded;
    const lanes3 root = rows_of(roots + first, stride);
    for (uint i = 1; i < points; ++i) {
        lanes3 place = plus(root, rows_of(places + 3 * i * stride + first, stride));
        lanes depth = F(0.0f);
        for (uint lane = 0; lane < LANES; ++lane)
            LANE(depth, lane) = upwind_of(&grid, sums, (float4)(LANE(place.x, lane), LANE(place.y, lane), LANE(place.z, lane), 1.0f));
        *(__global lanes *)(open + i * stride + first) = exp_minus(wind.less.y * depth);
    }
}

/* Where the hair of shell fur has its middle, at each vertex, while it stands upright.  One work-item, one vertex. */
__kernel void stand(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    const float height,                    // [world]
    __global float *places)                // [2, 3, padded] of root and middle, relative to the root
{
    WORK_ITEM(i);
    for (int a = 0; a < 3; ++a)
        places[(3 + a) * (size_t)padded + i] = height * roots[(9 + a) * (size_t)padded + i];
}

/* One step of shell fur: each vertex's lean is a damped oscillator about where forces would hold it, followed exactly
   (docs/motion.md).  Leans are in the axes of the root, and turn with them.  One work-item, one vertex. */
__kernel void sway(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *roots_before,    // [4, 3, padded] a step ago
    __global const float *rest,            // [3, padded] what `groomed` leans by, in the axes
    __global const float *weight,          // [3, padded] gravity as it was where hair was groomed, in the axes [world / s^2]
    __global const float *winds,           // [2, 3, padded] at root and middle [world / s]
    const float4 gravity,                  // [world / s^2]
    const float4 hair,                     // lean by a force [s^2 / world]; 1 / air [1 / s]; inertia; -
    const float4 onward,                   // of the way from there, and its speed: what is left of both after a step, and
                                           // speed by way [1 / s], way by speed [s]: x x, x v, v x, v v
    const float4 times,                    // 1 / step [1 / s]; 0 where roots have jumped, else 1; -, -
    __global float *leans,                 // [3, padded] from rest, in the axes
    __global float *speeds,                // [3, padded] [1 / s]
    __global float *going,                 // [3, padded] roots' speed in the step before [world / s]
    __global float *out)                   // [vertices, 3] what `Shells.lean` is [world's axes]
{
    WORK_ITEM(i);
    const size_t stride = padded;
    float4 axes[3], lean = (float4)(0.0f);
    float push[3];
    for (int a = 0; a < 3; ++a) {
        const float way = (roots[a * stride + i] - roots_before[a * stride + i]) * times.x;
        const float was = going[a * stride + i];
        const float goes = times.y > 0.0f ? way : was;
        push[a] = hair.y * (winds[(3 + a) * stride + i] - hair.z * goes) - hair.z * times.x * (goes - was);
        going[a * stride + i] = goes;
        axes[a] = (float4)(roots[(3 + 3 * a) * stride + i], roots[(4 + 3 * a) * stride + i], roots[(5 + 3 * a) * stride + i],
                           0.0f);
    }
    const float4 force = gravity + (float4)(push[0], push[1], push[2], 0.0f);
    for (int a = 0; a < 3; ++a) {
        const float target = hair.x * (dot3(axes[a], force) - weight[a * stride + i]), bent = rest[a * stride + i];
        const float x = leans[a * stride + i] - target, v = speeds[a * stride + i];
        const float now = target + (onward.x * x + onward.y * v);
        leans[a * stride + i] = now;
        speeds[a * stride + i] = onward.z * x + onward.w * v;
        /* However much it is pushed into the skin, hair stays out of it. */
        lean += (a == 2 ? fmax(bent + now, fmin(bent, -CROUCHED)) : bent + now) * axes[a];
    }
    vstore3(lean.xyz, i, out);
}

/* How shell fur leans between two moments.  One work-item, one number. */
__kernel void lean_between(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *before,          // [vertices, 3]
    __global const float *now,             // [vertices, 3]
    const float share,                     // 0: before, 1: now
    __global float *out)                   // [vertices, 3]
{
    WORK_ITEM(i);
    out[i] = before[i] + share * (now[i] - before[i]);
}
