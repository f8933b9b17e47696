/*
 * The ground: a level plane without an end, seen from above, on which shadows fall.  It is no part of the body: each sample's
 * place on it comes from the plane itself, so that it takes no triangles, no depths and no room before the near plane.
 */

#include "lanes.h"
#include "seen.h"
#include "light.h"
#include "light_lanes.h"
#include "sums.h"

#define LUMINANCE ((float4)(0.2126f, 0.7152f, 0.0722f, 0.0f))   // ITU-R BT.709

/* Reversed depth of the ground at a place of the picture, above 1 before the near plane; it lies there where that is > 0. */
INLINED lanes ground_depth(const Ground *ground, lanes x, lanes y)
{
    return (ground->plane.x * x + ground->plane.y * y) + ground->plane.z;
}

/* One work-item offers the ground to the samples of one pixel.  Before the near plane it hides all, as nothing else stands
   there. */
__kernel void put(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const Ground ground,
    __global ulong *visible)               // [rows, width, samples] depth << 32 | id
{
    WORK_ITEM(pixel);
    const int x = view.rows.z + (int)(pixel % view.size.x), y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view.size.w + s];
        const float px = x + 0.5f + offset.x * (1.0f / SUBPIXEL), py = y + 0.5f + offset.y * (1.0f / SUBPIXEL);
        const float e = (ground.plane.x * px + ground.plane.y * py) + ground.plane.z;
        if (!(e > 0.0f))
            continue;
        const uint depth = e < 1.0f ? DEPTH_ONE - (uint)(e * DEPTH_ONE) : 0;
        const ulong key = (ulong)depth << 32 | GROUND;
        if (key < visible[pixel * samples + s])
            visible[pixel * samples + s] = key;
    }
}

/* Light of a sky at places (x, z) of the ground, whose squares grow with the way to its middle: a quadratic B-spline, so that
   no square is seen. */
INLINED lanes3 light_of_sky(const OnGround *plane, __global const float4 *squares, lanes x, lanes z)
{
    const int side = plane->size.x;
    const lanes s = (x - plane->place.x) * plane->place.z, t = (z - plane->place.y) * plane->place.w;
    const lanes far = full_root(s * s + t * t);
    const lanes_i near = far < 1e6f;       // also where it is no number
    const lanes wide = (0.5f * side) / (1.0f + (near ? far : F(0.0f)));
    const lanes u = near ? s * wide + 0.5f * side : F(0.0f), v = near ? t * wide + 0.5f * side : F(0.0f);
    const lanes column = lesser(whole_below(u), F(side - 1.0f)), row = lesser(whole_below(v), F(side - 1.0f));
    const lanes a = u - column, b = v - row, one = 0.5f + a * (1.0f - a), two = 0.5f * a * a, three = 0.5f + b * (1.0f - b);
    const lanes four = 0.5f * b * b;
    lanes3 sum;
    for (int k = 0; k < LANES; ++k) {
        const int i = (int)LANE(column, k), j = (int)LANE(row, k);
        const float across[3] = {1.0f - LANE(one, k) - LANE(two, k), LANE(one, k), LANE(two, k)};
        const float down[3] = {1.0f - LANE(three, k) - LANE(four, k), LANE(three, k), LANE(four, k)};
        float4 light = plane->whole;
        if (i > 0 && j > 0 && i < side - 1 && j < side - 1) {
            __global const float4 *first = squares + (j - 1) * side + (i - 1);
            light = 0.0f;
            #pragma unroll
            for (int m = 0; m < 3; ++m)
                light += down[m] * (across[0] * first[m * side] + across[1] * first[m * side + 1] + across[2] * first[m * side + 2]);
        }
        put_lane(&sum, k, light);
    }
    return sum;
}

/* What the ground at places of the picture sends to the eye; alpha: 1, or how much of the light that falls on it is missing. */
ONCE lanes4 light_of_ground(const View *view, const Ground *ground, const Lighting *lighting, const OnGround *plane,
                            __global const float4 *squares, lanes x, lanes y)
{
    const lanes4 ahead = by_columns(view->to_world, x, y, F(0.0f));
    const lanes distance = view->to_screen[3].z / greater(ground_depth(ground, x, y), F(1e-30f));
    const lanes3 p = {view->eye.x + distance * ahead.x, F(ground->plane.w), view->eye.z + distance * ahead.z};
    const lanes3 n = {F(0.0f), F(1.0f), F(0.0f)};
    lanes3 sum = {F(0.0f), F(0.0f), F(0.0f)};
    lanes left = F(0.0f), whole = F(0.0f);
    for (int i = 0; i < lighting->n; ++i) {
        const Light light = lighting->lights[i];
        const Obstacles obstacles = obstacles_of(lighting, i);
        const float bright = dot3(light.color, LUMINANCE);
        lanes3 l;
        const lanes all = share_of_light(&light, p, &l);
        lanes share = all * cosine_to(&light, p, n, l.y, l);
        whole += bright * share + light.color.w;
        if (obstacles.shadow.body.x)
            share *= past_body_lanes(&obstacles, share > 0.0f, p, n, l.y < 0.0f, 64.0f, 1.0f);
        if (obstacles.shadow.hair.x > 0.0f && any_lane(share > 0.0f))
            share *= through_hair_lanes(&obstacles, F(0.0f), F(0.0f), p);
        left += bright * share + light.color.w;
        sum.x += ground->color.x * (light.color.x * share + light.color.w);
        sum.y += ground->color.y * (light.color.y * share + light.color.w);
        sum.z += ground->color.z * (light.color.z * share + light.color.w);
    }
    if (plane->size.x) {
        whole += dot3(plane->whole, LUMINANCE);
        const lanes3 falls = light_of_sky(plane, squares, p.x, p.z);
        left += dots(falls, all_lanes(LUMINANCE));
        sum.x += ground->color.x * falls.x;
        sum.y += ground->color.y * falls.y;
        sum.z += ground->color.z * falls.z;
    }
    const lanes missing = whole > 0.0f ? 1.0f - left / whole : F(0.0f);
    const lanes4 result = {sum.x, sum.y, sum.z, ground->color.w > 0.0f ? F(1.0f) : missing};
    return result;
}

/* One work-item lights the samples of SHADED pixels that see the ground, LANES of them side by side, and adds them to sums. */
__kernel void light(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const Ground ground,
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const OnGround plane,
    __global const float4 *squares,        // [side, side] r, g, b of a sky's light on it, if there is one
    const uint pixels,                     // rows · width
    const int attenuated,                  // 1: something before the samples lets only a share of their light through
    __global const float *sample_transmittance,   // [rows, width, samples] that share
    __global long4 *radiance_sums)         // [rows, width] r, g, b, alpha in 1/ONE
{
    WORK_ITEM(item);
    const size_t first = item * SHADED;
    const uint n = pixels - first < SHADED ? (uint)(pixels - first) : SHADED, samples = view.size.z;
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    lanes x = F(0.0f), y = F(0.0f), share = F(0.0f);
    uint at[LANES];
    int waiting = 0;
    for (uint i = 0; i < n * samples; ++i) {
        const size_t sample = first * samples + i, pixel = first + i / samples;
        const float its = attenuated ? sample_transmittance[sample] : 1.0f;
        if ((uint)visible[sample] == GROUND && its > 0.0f) {
            const int2 offset = PATTERN[view.size.w + i % samples];
            LANE(x, waiting) = view.rows.z + (int)(pixel % view.size.x) + 0.5f + offset.x * (1.0f / SUBPIXEL);
            LANE(y, waiting) = view.rows.x + (int)(pixel / view.size.x) + 0.5f + offset.y * (1.0f / SUBPIXEL);
            LANE(share, waiting) = its / samples;
            at[waiting++] = i / samples;
        }
        if (!waiting || (waiting < LANES && i + 1 < n * samples))
            continue;
        for (int k = waiting; k < LANES; ++k) {   // lanes that nothing waits in do the first one's work
            LANE(x, k) = LANE(x, 0);
            LANE(y, k) = LANE(y, 0);
        }
        const lanes4 light = light_of_ground(&view, &ground, &lighting, &plane, squares, x, y);
        for (int k = 0; k < waiting; ++k)
            radiance_sums[first + at[k]] += in_integers(LANE(share, k), (float4)(LANE(light.x, k), LANE(light.y, k),
                                                                                LANE(light.z, k), LANE(light.w, k)));
        waiting = 0;
    }
}

/* One work-item tells what is known of one pixel whose nearest sample sees the ground. */
__kernel void outputs(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const Ground ground,
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global float *out_depth,             // [rows, width] distance along the view axis
    __global int *out_id,                  // ID_GROUND
    __global float4 *out_normal)           // up
{
    WORK_ITEM(pixel);
    const int x = view.rows.z + (int)(pixel % view.size.x), y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    ulong key = ~0ul;
    int nearest = 0;
    for (int s = 0; s < samples; ++s)
        if (visible[pixel * samples + s] < key) {
            key = visible[pixel * samples + s];
            nearest = s;
        }
    if ((uint)key != GROUND)
        return;
    const int2 offset = PATTERN[view.size.w + nearest];
    const float px = x + 0.5f + offset.x * (1.0f / SUBPIXEL), py = y + 0.5f + offset.y * (1.0f / SUBPIXEL);
    const float e = (ground.plane.x * px + ground.plane.y * py) + ground.plane.z, least = 0.5f / DEPTH_ONE;
    out_depth[pixel] = view.to_screen[3].z / (e > least ? e : least);
    out_id[pixel] = ID_GROUND;
    out_normal[pixel] = (float4)(0.0f, 1.0f, 0.0f, 0.0f);
}
