/*
 * Light on what each sample sees: Kajiya and Kay's hair (SIGGRAPH 1989; the report's section 2.2), a Lambert
 * body; and what else is known of a pixel.
 */

#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "light_lanes.h"
#include "sky.h"
#include "sums.h"
#include "paint.h"
#include "listed.h"

/* The surface's normal at a point of triangle t, on the eye's side. */
inline float4 body_normal(__global const float4 *positions, __global const float4 *normals, uint4 t,
                          float4 p, float4 v, float4 *weights)
{
    const float4 b = barycentric(positions[t.x], positions[t.y], positions[t.z], p);
    const float4 n = unit_or(b.x * normals[t.x] + b.y * normals[t.y] + b.z * normals[t.z], normals[t.x]);
    *weights = b;
    return dot3(n, v) < 0.0f ? -n : n;
}

/* The places that samples see. */
INLINED lanes3 seen_points(const View *view, const Seen *samples)
{
    const lanes4 q = by_columns(view->to_world, samples->x, samples->y, samples->e);
    const lanes3 p = {q.x / q.w, q.y / q.w, q.z / q.w};
    return p;
}

/* A vector in the lanes of a mask. */
INLINED void put_where(lanes_i mask, lanes3 *to, float4 from)
{
    *to = chosen(mask, all_lanes(from), *to);
}

/* Corners of triangles, and normals there: each triangle's in all lanes at once that see it. */
INLINED void corners(lanes3 *at, lanes3 *normal, __global const float4 *positions, __global const float4 *normals,
                     __global const uint4 *triangles, lanes_u id)
{
    for (uint bits = LANES == 1 ? 1 : (1ul << LANES) - 1, these; bits; bits &= ~these) {
        const uint one = LANE_U(id, first_of(bits));
        const lanes_i mask = LANES == 1 ? I(1) : id == one;
        const uint4 t = triangles[one];
        these = bits_of(mask);
        put_where(mask, &at[0], positions[t.x]);
        put_where(mask, &at[1], positions[t.y]);
        put_where(mask, &at[2], positions[t.z]);
        put_where(mask, &normal[0], normals[t.x]);
        put_where(mask, &normal[1], normals[t.y]);
        put_where(mask, &normal[2], normals[t.z]);
    }
}

/* Normals n at places p of triangles, unit and on the side of the eye at v; face: those of the triangles, unit. */
INLINED void body_normals(const lanes3 *at, const lanes3 *normals, lanes3 p, lanes3 v, lanes3 *n, lanes3 *face)
{
    const lanes3 back = scaled(at[0], F(-1.0f)), b = plus(at[1], back), c = plus(at[2], back), q = plus(p, back);
    const lanes3 across = crosses(b, c);
    const lanes square = dots(across, across);
    const lanes_i some = square > 0.0f;
    const lanes over = some ? square : F(1.0f);
    const lanes two = some ? within(dots(crosses(q, c), across) / over, 0.0f, 1.0f) : F(0.0f);
    const lanes three = some ? lesser(greater(dots(crosses(b, q), across) / over, F(0.0f)), 1.0f - two) : F(0.0f);
    const lanes3 sum = plus(plus(scaled(normals[0], 1.0f - two - three), scaled(normals[1], two)), scaled(normals[2], three));
    *n = unit_lanes_or(sum, normals[0]);
    const lanes side = dots(*n, v) < 0.0f ? F(-1.0f) : F(1.0f);
    *n = scaled(*n, side);
    *face = unit_lanes_or(across, *n);
}

/* A product of each colour. */
INLINED lanes3 times(lanes3 a, lanes3 b)
{
    const lanes3 c = {a.x * b.x, a.y * b.y, a.z * b.z};
    return c;
}

/* Light of a sky at LANES places around directions, see sky.h. */
ONCE lanes3 sky_lanes(const Sky *sky, __global const float4 *cells, lanes3 p, lanes3 direction, float one, float two)
{
    lanes3 light;
    for (int k = 0; k < LANES; ++k) {
        const Known known = known_at(sky, cells, (float4)(lane_of(&p, k), 0.0f), one != 0.0f);
        put_lane(&light, k, light_around(&known, (float4)(lane_of(&direction, k), 0.0f), one, two));
    }
    return light;
}

/* Light of white places, times base colours where samples see triangles. */
ONCE void multiply_by_paint(lanes3 *light, const Paint *paint, const View *view, const Seen *samples,
                            __global const float4 *positions, __global const uint4 *triangles)
{
    for (int k = 0; k < LANES; ++k)
        put_lane(light, k, (float4)(lane_of(light, k), 0.0f)
                     * base_color(paint, view, positions, triangles[LANE_U(samples->id, k)], LANE(samples->x, k),
                                  LANE(samples->y, k), LANE(samples->e, k)));
}

/* The light that waiting samples of the body send to the eye. */
ONCE lanes3 light_of_body(const View *view, const Lighting *lighting, const Sky *sky, __global const float4 *sky_cells,
                             const Seen *samples,
                             __global const float4 *positions, __global const float4 *normals,
                             __global const uint4 *triangles, float4 color)
{
    lanes3 at[3], normal[3], n, face, sum = {F(0.0f), F(0.0f), F(0.0f)};
    corners(at, normal, positions, normals, triangles, samples->id);
    const lanes3 p = seen_points(view, samples), v = towards_eye_lanes(view, p);
    body_normals(at, normal, p, v, &n, &face);
    for (int i = 0; i < lighting->n; ++i) {
        const Light light = lighting->lights[i];
        const Obstacles obstacles = obstacles_of(lighting, i);
        lanes3 l;
        lanes share = share_of_light(&light, p, &l);
        const lanes of_face = dots(face, n) < 0.0f ? -dots(face, l) : dots(face, l);
        share *= cosine_to(&light, p, n, of_face, l);
        if (obstacles.shadow.body.x)
            share *= past_body_lanes(&obstacles, share > 0.0f, p, face, of_face < 0.0f, 64.0f, 1.0f);
        if (obstacles.shadow.hair.x > 0.0f && any_lane(share > 0.0f))
            share *= through_hair_lanes(&obstacles, F(0.0f), F(0.0f), p);
        sum.x += color.x * (light.color.x * share + light.color.w);
        sum.y += color.y * (light.color.y * share + light.color.w);
        sum.z += color.z * (light.color.z * share + light.color.w);
    }
    if (sky->size.y)
        sum = plus(sum, times(all_lanes(color), sky_lanes(sky, sky_cells, p, n, 2.0f / 3, 0.25f)));
    return sum;
}

/* The light that waiting samples of strands send to the eye. */
ONCE lanes3 light_of_strands(const View *view, const Lighting *lighting, const Sky *sky, __global const float4 *sky_cells,
                              const Seen *samples, const Hair *hair, Looks *looks)
{
    const lanes3 p = seen_points(view, samples), v = towards_eye_lanes(view, p);
    Fibres here;
    lanes alpha, width, at;
    lanes3 normal, chords[2], along, sum = {F(0.0f), F(0.0f), F(0.0f)};
    for (int k = 0; k < LANES; ++k) {
        const uint id = LANE_U(samples->id, k), strand = strand_at(hair, id);
        const Segment ends = segment_at(hair, id, hair->spans[strand]);
        const float there = place_between(ends.a, ends.b, (float4)(lane_of(&p, k), 0.0f));
        const float4 c = hair->color_per == 0 ? hair->colors[0] : hair->color_per == 1 ? hair->colors[strand]
            : between(hair->colors[id], hair->colors[id + 1], there);
        const int kind = (int)hair->strand_uv[strand].z;
        const float4 shine = hair->types[kind].shine;
        put_lane(&chords[0], k, ends.b - ends.before);
        put_lane(&chords[1], k, ends.after - ends.a);
        put_lane(&along, k, ends.b - ends.a);
        put_lane(&normal, k, hair->strand_normal[strand]);
        LANE(at, k) = there;
        LANE(here.color.x, k) = c.x, LANE(here.color.y, k) = c.y, LANE(here.color.z, k) = c.z;
        LANE(here.specular, k) = shine.x, LANE(here.exponent, k) = shine.y, LANE(alpha, k) = shine.z;
        LANE_I(here.half_vector, k) = (int)shine.w == HALF_VECTOR ? ON : 0;
        LANE_I(looks->kind, k) = kind;
        LANE_I(looks->on, k) = (int)shine.w == CHIANG ? ON : 0;
        LANE(width, k) = there > 0.0f ? ends.a.w + there * (ends.b.w - ends.a.w) : ends.a.w;
    }
    const lanes3 first = tangent_of_lanes(chords[0], along), last = tangent_of_lanes(chords[1], along);
    here.tangent = unit_lanes_or(plus(first, scaled(minus(last, first), at)), first);
    for (int i = 0; i < lighting->n; ++i) {
        const Light light = lighting->lights[i];
        const Obstacles obstacles = obstacles_of(lighting, i);
        lanes3 l;
        lanes share = share_of_light(&light, p, &l);
        share *= transmittances_at(&obstacles, share > 0.0f, p, normal, width, alpha);
        sum = plus(sum, fibre_lanes(&light, &here, looks, l, v, disc_at(&light, p), share));
    }
    if (sky->size.y)
        sum = plus(sum, times(here.color, sky_lanes(sky, sky_cells, p, here.tangent, 0.0f, -0.125f)));
    return sum;
}

/* One work-item lights the samples of SHADED pixels, those of one part of the scene, and adds their average, premultiplied linear
   r, g, b and coverage, to the picture, or to sums where more is to come: other parts, or strands. LANES samples
   of strands, or of the body, are lit side by side. */
LARGE APART __kernel void color(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint4 part,                      // first point's id, points, first triangle's id, triangles
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    __global const uint *stored,           // where the first point of each run lies that came
    const uint run,                        // points
    __global const float4 *strand_normal,  // [strands] of the body at the root, 0: not known
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const HairType *types,
    __global const Lobes *lobes,           // [types] see lobes.h; none where no type has that look
    __global const float4 *lobe_table,
    __global const float4 *colors,         // one, [strands] or [points]
    const int color_per,                   // 0: one for all, 1: each strand, 2: each point
    __global const float4 *positions,      // body: see tessellate.cl
    __global const float4 *normals,
    __global const uint4 *triangles,
    const float4 body_color,               // white where there are materials
    const int n_materials,                 // see paint.h
    __global const Material *materials,
    __global const uint *material_of,      // [faces of the part]
    __global const uint2 *texels,
    __global const float4 *uv,             // body
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const Sky sky,                         // see sky.h
    __global const float4 *sky_cells,      // [n, n, n, HARMONICS] r, g, b, if there is one
    const uint pixels,                     // rows · width
    const int attenuated,                  // 1: something before the samples lets only a share of their light through
    __global const float *sample_transmittance,   // [rows, width, samples] that share
    const int more,                        // 1: more is to come
    __global long4 *radiance_sums,         // [rows, width] in 1/ONE, if so
    const int covered,                     // 1: if not, it is known how much of the pixels is covered
    __global const float *coverage,        // [rows, width] that share, if so
    __global float4 *image)                // [rows, width], if no more is to come
{
    WORK_ITEM(item);
    const size_t first = item * SHADED;
    const uint n = pixels - first < SHADED ? (uint)(pixels - first) : SHADED, samples = view.size.z;
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, color_per};
    Looks looks = {lobes, lobe_table};
    const Paint paint = {n_materials, materials, material_of, texels, uv};
    const Samples lit = {(int)(first % view.size.x), view.rows.x + (int)(first / view.size.x), visible + first * samples,
                     sample_transmittance + first * samples, attenuated, part};
    long4 sums[SHADED];
    for (uint i = 0; i < n; ++i)
        sums[i] = 0;
#if LANES == 1
    for (uint i = 0, of_body; i < samples; ++i)
#else
    Found found;
    find(&found, lit.visible, lit.transmittance, attenuated, part, n * samples);
    for (uint of_body = 0, i = 0; of_body < 2; i = i + LANES < found.n[of_body] ? i + LANES : (++of_body, 0))
#endif
    {
#if LANES == 1
        if (!shown_from(lit.visible + i, lit.transmittance + i, attenuated, part, 1, &of_body))
            continue;
        const int number = i, here = 1;
#else
        if (!found.n[of_body])
            continue;
        const lanes_i number = *(const Numbers *)&found.numbers[of_body][i];
        const int here = found.n[of_body] - i < LANES ? found.n[of_body] - i : LANES;
#endif
        const Seen these = seen_at(&view, &lit, number, of_body, stored, run);
        lanes3 light = of_body
            ? light_of_body(&view, &lighting, &sky, sky_cells, &these, positions, normals, triangles, body_color)
            : light_of_strands(&view, &lighting, &sky, sky_cells, &these, &hair, &looks);
        if (of_body && n_materials)
            multiply_by_paint(&light, &paint, &view, &these, positions, triangles);
        for (int k = 0; k < here; ++k)
            sums[LANES == 1 ? 0 : LANE_I(these.pixel, k)] += in_integers(
                LANE(these.share, k), (float4)(LANE(light.x, k), LANE(light.y, k), LANE(light.z, k), 1.0f));
    }
    for (uint i = 0; i < n; ++i)
        if (more) {
            if (sums[i].w > 0)
                radiance_sums[first + i] += sums[i];
        } else if (covered || sums[i].w > 0) {
            const float4 all = image[first + i] + in_floats(sums[i]);
            image[first + i] = (float4)(all.xyz, covered ? coverage[first + i] : all.w);
        }
}

/* One work-item puts the sums of one pixel over what is in the picture; its alpha, where that is known, is no sum of shares
   that have been rounded. */
RARE __kernel void blend(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const long4 *radiance_sums,   // [rows, width] in 1/ONE
    const int covered,                     // 1: it is known how much of the pixels is covered
    __global const float *coverage,        // [rows, width] that share, if so
    __global float4 *image)                // [rows, width] premultiplied linear r, g, b, coverage
{
    WORK_ITEM(pixel);
    const float4 all = image[pixel] + in_floats(radiance_sums[pixel]);
    image[pixel] = (float4)(all.xyz, covered ? coverage[pixel] : all.w);
}

/* One work-item puts into the picture what share of one pixel is covered: light of fur is added up by itself, and that of
   what hides next to nothing is left out. */
RARE __kernel void cover(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int samples,
    __global const ulong *visible,         // [rows, width, samples] what else is drawn
    __global const float *transmittance,   // [rows, width, samples] share of light that comes from behind the fur
    __global float4 *image)                // [rows, width]
{
    WORK_ITEM(pixel);
    image[pixel].w = covered_share(visible, transmittance, pixel, samples);
}

/* One work-item takes out of the alpha of one pixel what the samples add to it that see anything: a holdout adds nothing, and
   a ground only its shadow. */
RARE __kernel void uncover(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int samples,
    __global const ulong *visible,         // [rows, width, samples]
    __global const float *transmittance,   // [rows, width, samples] share of each that comes through what stands before it
    __global float4 *image)                // [rows, width]
{
    WORK_ITEM(pixel);
    float covered = 0.0f;
    for (int s = 0; s < samples; ++s)
        covered += (uint)visible[pixel * samples + s] == NOTHING ? 0.0f : transmittance[pixel * samples + s];
    const float left = image[pixel].w - covered / samples;
    image[pixel].w = left > 0.0f ? left : 0.0f;
}

/* One work-item tells what the nearest covered sample of one pixel sees, if this part of the scene holds it: the outputs
   but color (AOVs). */
RARE __kernel void outputs(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint4 part,                      // first point's id, points, first triangle's id, triangles
    const uint first_strand,               // number of the part's first strand
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global const float4 *points,
    __global const uint2 *spans,
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
    const int x = view.rows.z + (int)(pixel % view.size.x), y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
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
        const uint from = lies_at(stored, run, id), strand = strand_of[from / run];
        const Hair hair = {points, spans, strand_of, run, 0, strand_uv, 0, 0, 0};
        const Segment ends = segment_at(&hair, from, spans[strand]);
        const float4 first = tangent_of(ends.b - ends.before, ends.b - ends.a);
        const float4 last = tangent_of(ends.after - ends.a, ends.b - ends.a);
        const float4 tangent = unit_or(mix(first, last, place_between(ends.a, ends.b, p)), first);
        out_id[pixel] = (int)(first_strand + numbers[strand]);
        out_tangent[pixel] = tangent;
        out_normal[pixel] = unit_or(v - dot3(v, tangent) * tangent, v);
        out_uv[pixel] = strand_uv[strand];
    }
}
