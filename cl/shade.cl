/*
 * Light on what each sample sees: Kajiya and Kay's hair (SIGGRAPH 1989; the report's section 2.2), a Lambert
 * body; and what else is known of a pixel.
 */

#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "sums.h"

/* Weights of a triangle's corners at a point of its plane. */
inline float4 barycentric(float4 a, float4 b, float4 c, float4 p)
{
    const float4 n = cross3(b - a, c - a);
    const float square = dot3(n, n);
    if (!(square > 0.0f))
        return (float4)(1.0f, 0.0f, 0.0f, 0.0f);
    const float v = clamp(dot3(cross3(p - a, c - a), n) / square, 0.0f, 1.0f);
    const float w = clamp(dot3(cross3(b - a, p - a), n) / square, 0.0f, 1.0f - v);
    return (float4)(1.0f - v - w, v, w, 0.0f);
}

/* The surface's normal at a point of triangle t, on the eye's side. */
inline float4 body_normal(__global const float4 *positions, __global const float4 *normals, uint4 t,
                          float4 p, float4 v, float4 *weights)
{
    const float4 b = barycentric(positions[t.x], positions[t.y], positions[t.z], p);
    const float4 n = unit_or(b.x * normals[t.x] + b.y * normals[t.y] + b.z * normals[t.z], normals[t.x]);
    *weights = b;
    return dot3(n, v) < 0.0f ? -n : n;
}

/* Number of what a sample shows among the triangles, or the segments as they came, that a part of the scene holds; NOTHING
   if it shows none of these. */
inline uint local_id(ulong key, uint4 part)
{
    const bool is_body = (uint)key & BODY;
    const uint id = is_body ? ((uint)key & ~BODY) - part.z : (uint)key - part.x;   // wraps round below the first
    return (uint)key == NOTHING || id >= (is_body ? part.w : part.y) ? NOTHING : id;
}

/* A light where it falls on place p of the body, with its ambient; n: the normal there, unit and on the eye's side, face: that
   of the face, of any length. */
inline float4 light_on_body(const Light *light, const Obstacles *obstacles, float4 p, float4 n, float4 face)
{
    float4 l, direct = light_at(light, p, &l);
    float share = max(dot3(n, l), 0.0f);
    if (obstacles->shadow.body.x && share > 0.0f)
        share *= past_body(obstacles, p, unit_or(face, n), 64.0f, 1.0f);
    if (obstacles->shadow.hair.x > 0.0f && share > 0.0f)
        share *= through_hair(obstacles, (float2)(0.0f), p);
    direct.xyz *= share;
    return direct + direct.w;
}

/* One work-item lights the samples of one pixel, those of one part of the scene, and adds their average, premultiplied linear
   r, g, b and coverage, to the picture, or to sums where more is to come: other parts, or strands. */
__kernel void color(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint4 part,                      // first point's id, points, first triangle's id, triangles
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global const float4 *points,         // strands: see strands.cl
    __global const float4 *tangents,
    __global const uint *strand_of,
    __global const uint *stored,           // where the first point of each run lies that came
    const uint run,                        // points
    __global const float4 *strand_normal,  // [strands] of the body at the root, 0: not known
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const HairType *types,
    __global const float4 *colors,         // one, [strands] or [points]
    const int color_per,                   // 0: one for all, 1: each strand, 2: each point
    __global const float4 *positions,      // body: see tessellate.cl
    __global const float4 *normals,
    __global const uint4 *triangles,
    const float4 body_color,
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const int attenuated,                  // 1: something before the samples lets only a share of their light through
    __global const float *sample_transmittance,   // [rows, width, samples] that share
    const int more,                        // 1: more is to come
    __global long4 *radiance_sums,         // [rows, width] in 1/ONE, if so
    __global float4 *image)                // [rows, width], if not
{
    WORK_ITEM(pixel);
    const int x = pixel % view.size.x, y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    const float weight = 1.0f / samples;
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, tangents, strand_of, strand_normal, strand_uv, types, colors, color_per};
    /* Of many pixels nothing is to be lit: what stands before the lights is not fetched for them. */
    bool empty = true;
    for (int s = 0; s < samples; ++s)
        empty &= local_id(visible[pixel * samples + s], part) == NOTHING
            || (attenuated && !(sample_transmittance[pixel * samples + s] > 0.0f));
    if (empty)
        return;
    long4 sum = 0;
    /* Light by light: what one needs of a sample fits the registers. */
    for (int i = 0; i < n_lights; ++i) {
        const Light light = lights[i];
        const Obstacles obstacles = obstacles_of(&lighting, i);
        for (int s = 0; s < samples; ++s) {
            const ulong key = visible[pixel * samples + s];
            const uint id = local_id(key, part);
            if (id == NOTHING || (attenuated && !(sample_transmittance[pixel * samples + s] > 0.0f)))
                continue;
            const float4 p = seen_point(&view, x, y, s, (uint)(key >> 32)), v = towards_eye(&view, p);
            float4 radiance;
            if ((uint)key & BODY) {
                float4 weights;
                const uint4 t = triangles[id];
                const float4 n = body_normal(positions, normals, t, p, v, &weights);
                const float4 face = cross3(positions[t.y] - positions[t.x], positions[t.z] - positions[t.x]);
                radiance = body_color * light_on_body(&light, &obstacles, p, n, face);
            } else {
                const uint from = lies_at(stored, run, id);
                const float at = place_between(points[from], points[from + 1], p);
                const Fibre here = fibre_at(&hair, from, at);
                radiance = shade_fibre(&light, &here, p, v, transmittance_at(&obstacles, &hair, from, at, p));
            }
            const float share = attenuated ? weight * sample_transmittance[pixel * samples + s] : weight;
            sum += in_integers(share, (float4)(radiance.xyz, i ? 0.0f : 1.0f));
        }
    }
    if (more)
        radiance_sums[pixel] += sum;
    else
        image[pixel] += in_floats(sum);
}

/* One work-item puts the sums of one pixel over what is in the picture; its alpha, where that is known, is no sum of shares
   that have been rounded. */
__kernel void blend(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const long4 *radiance_sums,   // [rows, width] in 1/ONE
    const int attenuated,                  // 1: they let only a share of the picture through
    __global const float *strand_transmittance,   // [rows, width] that share
    const int covered,                     // 1: it is known how much of the pixels is covered
    __global const float *coverage,        // [rows, width] that share, if so
    __global float4 *image)                // [rows, width] premultiplied linear r, g, b, coverage
{
    WORK_ITEM(pixel);
    const float4 behind = attenuated ? strand_transmittance[pixel] * image[pixel] : image[pixel];
    const float4 all = behind + in_floats(radiance_sums[pixel]);
    image[pixel] = (float4)(all.xyz, covered ? coverage[pixel] : all.w);
}

/* One work-item puts into the picture what share of one pixel is covered: light of fur is added up by itself, and that of
   what hides next to nothing is left out. */
__kernel void cover(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int samples,
    __global const ulong *visible,         // [rows, width, samples] what else is drawn
    __global const float *transmittance,   // [rows, width, samples] share of light that comes from behind the fur
    __global float4 *image)                // [rows, width]
{
    WORK_ITEM(pixel);
    image[pixel].w = covered_share(visible, transmittance, pixel, samples);
}

/* One work-item tells what the nearest covered sample of one pixel sees, if this part of the scene holds it: the outputs
   but color (AOVs). */
__kernel void outputs(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint4 part,                      // first point's id, points, first triangle's id, triangles
    const uint first_strand,               // number of the part's first strand
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global const float4 *points,
    __global const float4 *tangents,
    __global const uint *strand_of,
    __global const uint *numbers,
    __global const uint *stored,
    const uint run,
    __global const float4 *strand_uv,
    __global const float4 *positions,
    __global const float4 *normals,
    __global const float4 *uv,             // body
    __global const uint4 *triangles,
    __global float *out_depth,             // [rows, width] distance along the view axis; infinite: nothing
    __global int *out_id,                  // strand, -1: nothing, -2: body
    __global float4 *out_tangent,          // unit; 0 but on strands
    __global float4 *out_normal,           // unit, towards the eye: the body's, or across a strand
    __global float4 *out_uv,               // of the body, or of the strand's root
    __global float *out_coverage)          // share of covered samples
{
    WORK_ITEM(pixel);
    const int x = pixel % view.size.x, y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    ulong key = ~0ul;
    int nearest = 0, covered = 0;
    for (int s = 0; s < samples; ++s) {
        const ulong other = visible[pixel * samples + s];
        covered += (uint)other != NOTHING;
        if (other < key) {
            key = other;
            nearest = s;
        }
    }
    out_coverage[pixel] = (float)covered / samples;
    const uint id = local_id(key, part);
    if (id == NOTHING)
        return;
    const float4 p = seen_point(&view, x, y, nearest, (uint)(key >> 32)), v = towards_eye(&view, p);
    out_depth[pixel] = depth_along(&view, p, (uint)(key >> 32));
    if ((uint)key & BODY) {
        const uint4 t = triangles[id];
        float4 b;
        out_id[pixel] = ID_BODY;
        out_normal[pixel] = body_normal(positions, normals, t, p, v, &b);
        out_uv[pixel] = b.x * uv[t.x] + b.y * uv[t.y] + b.z * uv[t.z];
    } else {
        const uint from = lies_at(stored, run, id), strand = strand_of[from];
        const float at = place_between(points[from], points[from + 1], p);
        const float4 tangent = unit_or(mix(tangents[from], tangents[from + 1], at), tangents[from]);
        out_id[pixel] = (int)(first_strand + numbers[strand]);
        out_tangent[pixel] = tangent;
        out_normal[pixel] = unit_or(v - dot3(v, tangent) * tangent, v);
        out_uv[pixel] = strand_uv[strand];
    }
}
