/*
 * Light of strands at places along them: `transmittance` tells what share of each light gets through to their points, the
 * same from wherever they are seen; `radiance` what a segment sends to the eye at FEW_PLACES of it; `further` at MANY_PLACES
 * where it needs them.  Several points, segments or places side by side.
 */
#if LANES == 32
#undef LANES
#define LANES 16                           // two vectors of 16 would not stay in registers here
#endif
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "light_lanes.h"
#include "places.h"

/* One work-item tells what share of each light's direct light hair and body let through to LANES points of strands. */
__kernel void transmittance(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *points,         // strands: see strands.cl
    __global const uint *strand_of,
    const uint run,
    __global const float4 *strand_normal,
    __global const float4 *strand_uv,
    __global const HairType *types,
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const uint n_points,
    __global float *transmittances)        // [n_lights, n_points] 0..1
{
    WORK_ITEM(item);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const uint first = LANES * (uint)item, count = n_points - first < LANES ? n_points - first : LANES;
    lanes3 p, n;
    lanes width, alpha;
    for (uint k = 0; k < LANES; ++k) {
        const uint id = first + (k < count ? k : 0), strand = strand_of[id / run];
        const float4 point = points[id];
        put_lane(&p, k, point);
        put_lane(&n, k, strand_normal[strand]);
        LANE(width, k) = point.w;
        LANE(alpha, k) = types[(int)strand_uv[strand].z].shine.z;
    }
    for (int i = 0; i < n_lights; ++i) {
        const Obstacles obstacles = obstacles_of(&lighting, i);
        lanes share = transmittances_at(&obstacles, I(ON), p, n, width, alpha);
        for (uint k = 0; k < count; ++k)
            transmittances[(size_t)i * n_points + first + k] = LANE(share, k);
    }
}

/* Segments: what they are like at their start, and how much of it changes to their end. */
typedef struct {
    lanes3 p, t, color, p_step, t_step, color_step;
    lanes specular, exponent;
    lanes_i half_vector, kind, of_lobes;   // a mask, which type, a mask
} Segments;

/* What LANES segments are like, those that begin at points `from` and end at `to`: both are one where none begins. */
INLINED void take(Segments *s, const Hair *hair, const uint *from, const uint *to)
{
    lanes3 chords[2];
    for (int k = 0; k < LANES; ++k) {
        const uint id = from[k], strand = strand_at(hair, id);
        const uint2 span = hair->spans[strand];
        const int kind = (int)hair->strand_uv[strand].z;
        const float4 shine = hair->types[kind].shine;
        const float4 a = hair->points[id], b = hair->points[to[k]];
        const float4 before = id > span.x ? hair->points[id - 1] : a;
        const float4 after = to[k] + 1 < span.x + span.y ? hair->points[to[k] + 1] : b;
        const float4 c = hair->colors[hair->color_per == 0 ? 0 : hair->color_per == 1 ? strand : id];
        put_lane(&s->p, k, a);
        put_lane(&s->p_step, k, b - a);
        put_lane(&chords[0], k, b - before);
        put_lane(&chords[1], k, after - a);
        put_lane(&s->color, k, c);
        put_lane(&s->color_step, k, hair->color_per == 2 ? hair->colors[to[k]] - c : (float4)(0.0f));
        LANE(s->specular, k) = shine.x;
        LANE(s->exponent, k) = shine.y;
        LANE_I(s->half_vector, k) = (int)shine.w == HALF_VECTOR ? ON : 0;
        LANE_I(s->kind, k) = kind;
        LANE_I(s->of_lobes, k) = (int)shine.w == CHIANG ? ON : 0;
    }
    s->t = tangent_of_lanes(chords[0], s->p_step);
    s->t_step = minus(tangent_of_lanes(chords[1], s->p_step), s->t);
}

/* Where a segment begins: `number` of those that are listed, or of all points. */
INLINED uint begin_of(uint number, int listed, __global const uint *segments, uint first_point, __global const uint *stored,
                      uint run)
{
    return listed ? lies_at(stored, run, (segments[number] & ~BODY) - first_point) : number;
}

/* Where the segment ends that begins at a point: there itself if that is a strand's last one, or no strand's. */
INLINED uint end_of(const Hair *hair, uint id)
{
    const uint2 span = hair->spans[strand_at(hair, id)];
    return id + 1 < span.x + span.y ? id + 1 : id;
}

/* Places `at` of segments: where they are, what they are like there, unit vectors towards the eye. */
typedef struct {
    lanes3 p, v;
    Fibres fibres;
} Places;

INLINED Places places_at(const View *view, const Segments *s, lanes at)
{
    Places here;
    here.p = plus(s->p, scaled(s->p_step, at));
    here.v = towards_eye_lanes(view, here.p);
    here.fibres.tangent = unit_lanes_or(plus(s->t, scaled(s->t_step, at)), s->t);
    here.fibres.color = plus(s->color, scaled(s->color_step, at));
    here.fibres.specular = s->specular;
    here.fibres.exponent = s->exponent;
    here.fibres.half_vector = s->half_vector;
    here.fibres.kind = s->kind;
    here.fibres.of_lobes = s->of_lobes;
    return here;
}

/* How far inside a spot's cone places lie, as a cosine; 1 everywhere under parallel rays. l: towards the light. */
INLINED lanes inside_cone(const Light *light, lanes3 l)
{
    return light->position.w > 0.0f ? -dots(l, all_lanes(light->direction)) - light->cone.x : F(1.0f);
}

#define TURN 1.5f            // by which a segment may turn, in widths of its highlight, for one parabola
#define CELLS 2.0f           // cells of a light's grid that it may cross with transmittances known at its ends alone

/* How many cells of a light's grid segments cross. */
INLINED lanes cells_crossed(const Obstacles *obstacles, const Segments *s)
{
    const Grid *grid = &obstacles->grid;
    if (!(obstacles->shadow.hair.x > 0.0f))
        return F(0.0f);
    const lanes3 q = plus(s->p, s->p_step);
    const lanes4 a = by_columns(grid->to_grid, s->p.x, s->p.y, s->p.z), b = by_columns(grid->to_grid, q.x, q.y, q.z);
    const lanes_i before = (a.w > 0.0f) & (b.w > 0.0f);
    const lanes x = a.x / a.w - b.x / b.w, y = a.y / a.w - b.y / b.w, z = a.z - b.z;
    return before ? greater(greater(positive(x), positive(y)), positive(z)) : F(1e9f);
}

/* |a - b| */
INLINED lanes distance_between(lanes3 a, lanes3 b)
{
    const lanes3 d = minus(a, b);
    return root(greater(dots(d, d), F(1e-30f)));
}

/* One work-item tells what LANES segments send to the eye at FEW_PLACES each, and keeps rows of `more` for those that need
   them. */
__kernel void radiance(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 range,                     // of segments: the first, one past the last
    const int listed,                      // 1: they are `segments`, 0: as many points as there are
    __global const uint *segments,         // ids, if so, their highest bits aside
    const uint first_point,                // the id of the first of these points
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global const float4 *strand_normal,
    __global const float4 *strand_uv,
    __global const HairType *types,
    __global const Lobes *lobes,           // [types] see lobes.h; none where no type has that look
    __global const float4 *lobe_table,
    __global const float4 *colors,
    const int color_per,
    const int n_lights,
    __global const Light *lights,
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const uint n_points,
    const int shadowed,                    // 1: something stands before them
    __global const float *transmittances,  // [n_lights, n_points] share of direct light, if so
    __global ulong *places,                // [segments, FEW_PLACES] see places.h
    volatile __global uint *rows)          // [1] of `more` that are taken
{
    WORK_ITEM(item);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, color_per};
    const Looks looks = {lobes, lobe_table};
    const uint first = range.x + LANES * (uint)item, count = range.y - first < LANES ? range.y - first : LANES;
    Segments s;
    uint from[LANES], to[LANES];
    for (uint k = 0; k < LANES; ++k) {
        from[k] = begin_of(first + (k < count ? k : 0), listed, segments, first_point, stored, run);
        to[k] = end_of(&hair, from[k]);
    }
    take(&s, &hair, from, to);
    lanes turn = F(0.0f), crossed = F(0.0f);
    lanes_i on_edge = I(0);
    lanes3 sent[FEW_PLACES], tangent, v;
    for (int i = 0; i < n_lights; ++i) {
        const Light light = lights[i];
        lanes share = F(1.0f), share_step = F(0.0f), before = F(0.0f);
        lanes3 l_before;
        if (shadowed) {
            const Obstacles obstacles = obstacles_of(&lighting, i);
            __global const float *there = transmittances + (size_t)i * n_points;
            for (int k = 0; k < LANES; ++k) {
                LANE(share, k) = there[from[k]];
                LANE(share_step, k) = there[to[k]] - there[from[k]];
            }
            crossed = greater(crossed, cells_crossed(&obstacles, &s));
        }
        for (int j = 0; j < FEW_PLACES; ++j) {
            const lanes at = F((float)j / (FEW_PLACES - 1));
            const Places here = places_at(&view, &s, at);
            lanes3 l;
            const lanes part = share_of_light(&light, here.p, &l) * (share + at * share_step), inside = inside_cone(&light, l);
            const lanes3 one = fibre_lanes(&light, &here.fibres, &looks, l, here.v, part);
            sent[j] = i ? plus(sent[j], one) : one;
            if (j) {
                on_edge |= (lesser(inside, before) < 0.0f) & (greater(inside, before) >= 0.0f);
                turn += distance_between(l, l_before);
                if (!i)
                    turn += distance_between(here.fibres.tangent, tangent) + distance_between(here.v, v);
            }
            before = inside;
            l_before = l;
            tangent = here.fibres.tangent;
            v = here.v;
        }
    }
    const lanes_i turns = turn * root(1.0f + s.exponent) > TURN * FEW_PIECES;
    const lanes_i needs = turns | (crossed > CELLS) | on_edge;
    for (uint k = 0; k < count; ++k) {
        __global ulong *few = places + FEW_PLACES * (size_t)(first + k);
        if (LANE_I(needs, k) && from[k] != to[k])
            few[0] = MORE | (LANE_I(on_edge, k) ? ON_EDGE : 0ul) | atomic_inc(rows);
        else
            for (int j = 0; j < FEW_PLACES; ++j)
                few[j] = packed_light(LANE(sent[j].x, k), LANE(sent[j].y, k), LANE(sent[j].z, k));
    }
}

/* The segment from point id to the next one, in all lanes. */
INLINED void take_one(Segments *s, const Hair *hair, uint id)
{
    const uint strand = strand_at(hair, id);
    const Segment ends = segment_at(hair, id, hair->spans[strand]);
    const int kind = (int)hair->strand_uv[strand].z;
    const float4 shine = hair->types[kind].shine, along = ends.b - ends.a;
    const float4 t = tangent_of(ends.b - ends.before, along), u = tangent_of(ends.after - ends.a, along);
    const float4 c = hair->colors[hair->color_per == 0 ? 0 : hair->color_per == 1 ? strand : id];
    s->p = all_lanes(ends.a);
    s->p_step = all_lanes(along);
    s->t = all_lanes(t);
    s->t_step = all_lanes(u - t);
    s->color = all_lanes(c);
    s->color_step = all_lanes(hair->color_per == 2 ? hair->colors[id + 1] - c : (float4)(0.0f));
    s->specular = F(shine.x);
    s->exponent = F(shine.y);
    s->half_vector = I((int)shine.w == HALF_VECTOR ? ON : 0);
    s->kind = I(kind);
    s->of_lobes = I((int)shine.w == CHIANG ? ON : 0);
}

/* Where along a segment the edges of spots' cones cross it, two of them at most, in ways between MANY_PLACES; -1: nowhere. */
INLINED float2 edges_of(const Lighting *lighting, const View *view, const Segments *s, lanes number)
{
    float2 edges = -1.0f;
    for (int i = 0; i < lighting->n; ++i) {
        const Light light = lighting->lights[i];
        float before = 0.0f;
        for (int start = 0; start < MANY_PLACES && light.position.w > 0.0f; start += LANES) {
            lanes3 l;
            share_of_light(&light, plus(s->p, scaled(s->p_step, (number + (float)start) * (1.0f / (MANY_PLACES - 1)))), &l);
            lanes inside = inside_cone(&light, l);
            for (int k = 0; k < LANES && start + k < MANY_PLACES; ++k) {
                const float here = LANE(inside, k);
                if (start + k && (here < 0.0f) != (before < 0.0f)) {
                    edges.y = edges.x;
                    edges.x = start + k - 1 + before / (before - here);
                }
                before = here;
            }
        }
    }
    return edges;
}

/* One work-item tells what one segment after the other, of LANES, sends to the eye at MANY_PLACES, if it needs them. */
__kernel void further(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 range,                     // of segments: the first, one past the last
    const int listed,                      // 1: they are `segments`, 0: as many points as there are
    __global const uint *segments,         // ids, if so, their highest bits aside
    const uint first_point,                // the id of the first of these points
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global const float4 *strand_normal,
    __global const float4 *strand_uv,
    __global const HairType *types,
    __global const Lobes *lobes,           // [types] see lobes.h; none where no type has that look
    __global const float4 *lobe_table,
    __global const float4 *colors,
    const int color_per,
    const int n_lights,
    __global const Light *lights,
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const uint n_points,
    const int shadowed,                    // 1: something stands before them
    __global const float *transmittances,  // [n_lights, n_points] share of direct light, if so
    __global const ulong *places,          // [segments, FEW_PLACES] see places.h
    const uint rows_before,                // of `more` that others have
    __global ulong *more)                  // [rows, MANY_PLACES + 1] as `radiance` has counted them
{
    WORK_ITEM(item);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, color_per};
    const Looks looks = {lobes, lobe_table};
    const uint first = range.x + LANES * (uint)item;
    lanes number;
    for (int k = 0; k < LANES; ++k)
        LANE(number, k) = k;
    for (uint segment = first; segment < range.y && segment < first + LANES; ++segment) {
        const ulong row = places[FEW_PLACES * (size_t)segment];
        if (!(row & MORE))
            continue;
        __global ulong *many = more + (MANY_PLACES + 1) * ((row & ROW) - rows_before);
        const uint id = begin_of(segment, listed, segments, first_point, stored, run), strand = strand_at(&hair, id);
        const float alpha = types[(int)strand_uv[strand].z].shine.z, width = points[id].w;
        Segments s;
        take_one(&s, &hair, id);
        many[MANY_PLACES] = row & ON_EDGE ? as_ulong(edges_of(&lighting, &view, &s, number)) : 0;
        for (int start = 0; start < MANY_PLACES; start += LANES) {
            const lanes at = lesser((number + (float)start) * (1.0f / (MANY_PLACES - 1)), F(1.0f));
            const Places here = places_at(&view, &s, at);
            lanes3 sent;
            for (int i = 0; i < n_lights; ++i) {
                const Light light = lights[i];
                lanes3 l;
                lanes share = share_of_light(&light, here.p, &l);
                if (shadowed) {
                    const Obstacles obstacles = obstacles_of(&lighting, i);
                    __global const float *there = transmittances + (size_t)i * n_points + id;
                    lanes crossed = cells_crossed(&obstacles, &s);
                    if (LANE(crossed, 0) > CELLS)
                        share *= transmittances_at(&obstacles, share > 0.0f, here.p, all_lanes(strand_normal[strand]),
                                                   width + at * (points[id + 1].w - width), F(alpha));
                    else
                        share *= there[0] + at * (there[1] - there[0]);
                }
                const lanes3 one = fibre_lanes(&light, &here.fibres, &looks, l, here.v, share);
                sent = i ? plus(sent, one) : one;
            }
            for (int k = 0; k < LANES && start + k < MANY_PLACES; ++k)
                many[start + k] = packed_light(LANE(sent.x, k), LANE(sent.y, k), LANE(sent.z, k));
        }
    }
}
