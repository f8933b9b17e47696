/*
 * Light of strands at places along them: `transmittance` tells what share of each light gets through to their points, the
 * same from wherever they are seen; `radiance` what a segment sends to the eye at its start, middle and end; `further` at
 * more places where it needs them.  Several points, segments or places side by side.
 */
#if LANES == 32
#undef LANES
#define LANES 16                           // two vectors of 16 would not stay in registers here
#endif
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "strand_lanes.h"
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
        const float4 point = points[id], normal = strand_normal[strand];
        LANE(p.x, k) = point.x;
        LANE(p.y, k) = point.y;
        LANE(p.z, k) = point.z;
        LANE(width, k) = point.w;
        LANE(n.x, k) = normal.x;
        LANE(n.y, k) = normal.y;
        LANE(n.z, k) = normal.z;
        LANE(alpha, k) = types[(int)strand_uv[strand].z].shine.z;
    }
    for (int i = 0; i < n_lights; ++i) {
        const Obstacles obstacles = obstacles_of(&lighting, i);
        lanes share = transmittances_at(&obstacles, p, n, width, alpha);
        for (uint k = 0; k < count; ++k)
            transmittances[(size_t)i * n_points + first + k] = LANE(share, k);
    }
}

/* Segments: what they are like at their start, and how much of it changes to their end. */
typedef struct {
    lanes3 p, t, color, p_step, t_step, color_step;
    lanes specular, exponent;
    lanes_i half_vector;
} Segments;

/* Put the segment that begins at point id into lane k. */
INLINED void take(Segments *s, int k, const Hair *hair, uint id, uint next)
{
    const uint strand = strand_at(hair, id);
    const uint2 span = hair->spans[strand];
    const float4 shine = hair->types[(int)hair->strand_uv[strand].z].shine;
    const float4 a = hair->points[id], b = hair->points[next], way = next > id ? b - a : 0.0f;
    const float4 before = id > span.x ? hair->points[id - 1] : a, after = next + 1 < span.x + span.y ? hair->points[next + 1] : b;
    const float4 t = tangent_of(b - before, way), u = tangent_of(after - a, way);
    float4 c = hair->colors[hair->color_per == 0 ? 0 : hair->color_per == 1 ? strand : id];
    const float4 d = hair->color_per == 2 ? hair->colors[next] : c;
    LANE(s->p.x, k) = a.x;
    LANE(s->p.y, k) = a.y;
    LANE(s->p.z, k) = a.z;
    LANE(s->p_step.x, k) = b.x - a.x;
    LANE(s->p_step.y, k) = b.y - a.y;
    LANE(s->p_step.z, k) = b.z - a.z;
    LANE(s->t.x, k) = t.x;
    LANE(s->t.y, k) = t.y;
    LANE(s->t.z, k) = t.z;
    LANE(s->t_step.x, k) = u.x - t.x;
    LANE(s->t_step.y, k) = u.y - t.y;
    LANE(s->t_step.z, k) = u.z - t.z;
    LANE(s->color.x, k) = c.x;
    LANE(s->color.y, k) = c.y;
    LANE(s->color.z, k) = c.z;
    LANE(s->color_step.x, k) = d.x - c.x;
    LANE(s->color_step.y, k) = d.y - c.y;
    LANE(s->color_step.z, k) = d.z - c.z;
    LANE(s->specular, k) = shine.x;
    LANE(s->exponent, k) = shine.y;
    LANE_I(s->half_vector, k) = (int)shine.w == HALF_VECTOR ? -1 : 0;
}

/* Places `at` of segments: where they are, unit tangent and vector towards the eye. */
typedef struct {
    lanes3 p, t, v, color;
} Places;

INLINED lanes3 normalized(lanes3 a, lanes3 otherwise)
{
    const lanes square = dots(a, a);
    const lanes_i some = square > 1e-30f;
    const lanes by = inverse_root(greater(square, F(1e-30f)));
    const lanes3 result = {some ? a.x * by : otherwise.x, some ? a.y * by : otherwise.y, some ? a.z * by : otherwise.z};
    return result;
}

INLINED Places places_at(const View *view, const Segments *s, lanes at)
{
    Places here;
    here.p = plus(s->p, scaled(s->p_step, at));
    here.t = normalized(plus(s->t, scaled(s->t_step, at)), s->t);
    here.color = plus(s->color, scaled(s->color_step, at));
    const lanes3 to_eye = {view->eye.x - view->eye.w * here.p.x, view->eye.y - view->eye.w * here.p.y,
                           view->eye.z - view->eye.w * here.p.z};
    here.v = normalized(to_eye, all_lanes((float4)(0.0f, 0.0f, 1.0f, 0.0f)));
    return here;
}

/* Unit vectors towards a light, and how far inside a spot's cone places lie, as a cosine; 1 everywhere under parallel rays. */
INLINED lanes3 towards_light(const Light *light, lanes3 p, lanes *inside)
{
    lanes3 l = all_lanes(-light->direction);
    *inside = F(1.0f);
    if (light->position.w > 0.0f) {
        const lanes3 way = {light->position.x - p.x, light->position.y - p.y, light->position.z - p.z};
        l = normalized(way, l);
        *inside = -dots(l, all_lanes(light->direction)) - light->cone.x;
    }
    return l;
}

/* What one light adds to what places send to the eye: as `fibre` of scatter.h. */
INLINED lanes3 fibres_at(const Segments *s, const Places *here, const Light *light, lanes3 l, lanes transmittance)
{
    const lanes tl = dots(here->t, l), tv = dots(here->t, here->v), bright = sine_of(tl);
    lanes mirror = bright * sine_of(tv) - tl * tv;
    const lanes_i half_vector = s->half_vector != 0;
    if (any_lane(half_vector)) {
        const lanes square = 2.0f + 2.0f * dots(l, here->v);
        const lanes th = (tl + tv) * inverse_root(greater(square, F(1e-12f)));
        const lanes other = square > 1e-12f ? sine_of(th) : F(0.0f);
        mirror = half_vector ? other : mirror;
    }
    mirror = within(mirror, 0.0f, 1.0f);
    lanes shine = F(0.0f);
    const lanes_i shines = (1.0f - mirror) * s->exponent < 16.0f;      // elsewhere it is below exp(-16)
    if (any_lane(shines)) {
        const lanes power = s->exponent * log2_of(greater(mirror, F(1e-30f)));
        shine = shines ? s->specular * exp2_of(greater(power, F(-100.0f))) : F(0.0f);
    }
    const float4 c = light->color;
    const lanes3 sent = {
        c.x * transmittance * (here->color.x * bright + shine) + c.w * here->color.x,
        c.y * transmittance * (here->color.y * bright + shine) + c.w * here->color.y,
        c.z * transmittance * (here->color.z * bright + shine) + c.w * here->color.z};
    return sent;
}

#define TURN 1.5f            // by which a segment may turn, in widths of its highlight, for one parabola
#define CELLS 4.0f           // cells of a light's grid that it may cross with transmittances known at its ends alone

/* How many cells of a light's grid segments cross. */
INLINED lanes cells_crossed(const Obstacles *obstacles, const Segments *s)
{
    const Grid *grid = &obstacles->grid;
    if (!(obstacles->shadow.hair.x > 0.0f))
        return F(0.0f);
    const lanes3 q = plus(s->p, s->p_step);
    const lanes wa = ROW_OF(grid->to_grid, w, s->p), wb = ROW_OF(grid->to_grid, w, q);
    const lanes_i before = (wa > 0.0f) & (wb > 0.0f);
    const lanes x = ROW_OF(grid->to_grid, x, s->p) / wa - ROW_OF(grid->to_grid, x, q) / wb;
    const lanes y = ROW_OF(grid->to_grid, y, s->p) / wa - ROW_OF(grid->to_grid, y, q) / wb;
    const lanes z = ROW_OF(grid->to_grid, z, s->p) - ROW_OF(grid->to_grid, z, q);
    return before ? greater(greater(positive(x), positive(y)), positive(z)) : F(1e9f);
}

/* |a - b| */
INLINED lanes distance_between(lanes3 a, lanes3 b)
{
    const lanes3 d = plus(a, scaled(b, F(-1.0f)));
    const lanes square = greater(dots(d, d), F(1e-30f));
    return square * inverse_root(square);
}

/* One work-item tells what LANES segments send to the eye at three places each, and keeps rows of `more` for those that
   need them. */
__kernel void radiance(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 range,                     // of segments: the first, one past the last
    const int listed,                      // 1: they are `segments`, 0: as many points as there are
    __global const uint *segments,         // ids, if so, their highest bits aside
    const uint first_point,                // the id of the first of these points
    const uint n_points,
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global const float4 *strand_normal,
    __global const float4 *strand_uv,
    __global const HairType *types,
    __global const float4 *colors,
    const int color_per,
    const int n_lights,
    __global const Light *lights,
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const int shadowed,                    // 1: something stands before them
    __global const float *transmittances,  // [n_lights, n_points] share of direct light, if so
    __global float4 *places,               // [segments, 3] see places.h
    volatile __global uint *rows)          // [1] of `more` that are taken
{
    WORK_ITEM(item);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, color_per};
    const uint first = range.x + LANES * (uint)item, count = range.y - first < LANES ? range.y - first : LANES;
    Segments s;
    uint from[LANES], to[LANES];
    for (int k = 0; k < LANES; ++k) {
        const uint number = first + ((uint)k < count ? k : 0), id = listed ? lies_at(stored, run, (segments[number] & ~BODY) - first_point) : number;
        const uint next = id + 1 < n_points ? id + 1 : id;
        from[k] = id;
        to[k] = strand_at(&hair, next) == strand_at(&hair, id) ? next : id;          // what follows a strand's last point is none
        take(&s, k, &hair, id, to[k]);
    }
    const Places ends[2] = {places_at(&view, &s, F(0.0f)), places_at(&view, &s, F(1.0f))};
    lanes turn = distance_between(ends[0].t, ends[1].t) + distance_between(ends[0].v, ends[1].v), most = F(0.0f);
    lanes_i on_edge = I(0);
    lanes3 sent[3];
    for (int i = 0; i < n_lights; ++i) {
        const Light light = lights[i];
        lanes share = F(1.0f), share_step = F(0.0f), inside[3];
        if (shadowed) {
            const Obstacles obstacles = obstacles_of(&lighting, i);
            __global const float *there = transmittances + (size_t)i * n_points;
            for (int k = 0; k < LANES; ++k) {
                LANE(share, k) = there[from[k]];
                LANE(share_step, k) = there[to[k]] - there[from[k]];
            }
            most = greater(most, cells_crossed(&obstacles, &s) * (1.0f / CELLS));
        }
        for (int j = 0; j < 3; ++j) {
            const lanes at = F(0.5f * j);
            const Places here = places_at(&view, &s, at);
            const lanes3 l = towards_light(&light, here.p, &inside[j]);
            const lanes part = inside[j] >= 0.0f ? share + at * share_step : F(0.0f);
            const lanes3 more = fibres_at(&s, &here, &light, l, part);
            sent[j] = i ? plus(sent[j], more) : more;
        }
        if (light.position.w > 0.0f) {
            lanes unused;
            turn += distance_between(towards_light(&light, ends[0].p, &unused), towards_light(&light, ends[1].p, &unused));
            const lanes least = lesser(lesser(positive(inside[0]), positive(inside[1])), positive(inside[2]));
            on_edge |= least < positive(inside[0] - inside[1]) + positive(inside[1] - inside[2]);
        }
    }
    const lanes square = 1.0f + s.exponent;
    most = greater(most, turn * (square * inverse_root(square)) * (1.0f / TURN));
    lanes pieces = most <= 1.0f ? F(1.0f) : most <= 3.0f ? F(3.0f) : F(7.0f);
    pieces = on_edge ? F(7.0f) : pieces;
    for (uint k = 0; k < count; ++k) {
        uint row = 0;
        if (from[k] == to[k])
            LANE(pieces, k) = 1.0f;
        if (LANE(pieces, k) > 1.0f)
            row = atomic_add(rows, ((uint)LANE(pieces, k) + 1) * 2 / PLACE_ROW);
        const uint far = row / (uint)FAR_ROWS;
        __global float4 *three = places + 3 * (size_t)(first + k);
        three[0] = (float4)(LANE(sent[0].x, k), LANE(sent[0].y, k), LANE(sent[0].z, k), row - far * (uint)FAR_ROWS);
        three[1] = (float4)(LANE(sent[1].x, k), LANE(sent[1].y, k), LANE(sent[1].z, k), LANE(pieces, k));
        three[2] = (float4)(LANE(sent[2].x, k), LANE(sent[2].y, k), LANE(sent[2].z, k), far);
    }
}

/* One work-item does the same for LANES segments at more places, those of one that needs them side by side. */
__kernel void further(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 range,                     // of segments: the first, one past the last
    const int listed,                      // 1: they are `segments`, 0: as many points as there are
    __global const uint *segments,         // ids, if so, their highest bits aside
    const uint first_point,                // the id of the first of these points
    const uint n_points,
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global const float4 *strand_normal,
    __global const float4 *strand_uv,
    __global const HairType *types,
    __global const float4 *colors,
    const int color_per,
    const int n_lights,
    __global const Light *lights,
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const int shadowed,                    // 1: something stands before them
    __global const float *transmittances,  // [n_lights, n_points] share of direct light, if so
    __global const float4 *places,         // [segments, 3] see places.h
    const uint rows_before,                // of `more` that others have
    __global ulong *more)                  // [rows, PLACE_ROW] as `radiance` has counted them
{
    WORK_ITEM(item);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, color_per};
    lanes number;
    for (int k = 0; k < LANES; ++k)
        LANE(number, k) = k;
    const uint begins = range.x + LANES * (uint)item;
    for (uint segment = begins; segment < range.y && segment < begins + LANES; ++segment) {
        const float pieces = places[3 * (size_t)segment + 1].w;
        if (!(pieces > 1.0f))
            continue;
        const float4 a = places[3 * (size_t)segment], c = places[3 * (size_t)segment + 2];
        __global ulong *out = more + PLACE_ROW * ((ulong)c.w * (ulong)FAR_ROWS + (ulong)a.w - rows_before);
        const uint id = listed ? lies_at(stored, run, (segments[segment] & ~BODY) - first_point) : segment;
        const uint strand = strand_at(&hair, id);
        const float alpha = types[(int)strand_uv[strand].z].shine.z, width = points[id].w;
        const int last = 2 * (int)pieces + 1;
        Segments s;
        for (int k = 0; k < LANES; ++k)
            take(&s, k, &hair, id, id + 1);
        for (int start = 0; start <= last; start += LANES) {
            const lanes at = lesser((number + (float)start) * (0.5f / pieces), F(1.0f));
            const Places here = places_at(&view, &s, at);
            lanes3 sent;
            for (int i = 0; i < n_lights; ++i) {
                const Light light = lights[i];
                lanes inside, share = F(1.0f);
                const lanes3 l = towards_light(&light, here.p, &inside);
                if (shadowed) {
                    const Obstacles obstacles = obstacles_of(&lighting, i);
                    __global const float *there = transmittances + (size_t)i * n_points + id;
                    lanes crossed = cells_crossed(&obstacles, &s);
                    share = LANE(crossed, 0) > CELLS
                        ? transmittances_at(&obstacles, here.p, all_lanes(strand_normal[strand]),
                                            width + at * (points[id + 1].w - width), F(alpha))
                        : there[0] + at * (there[1] - there[0]);
                }
                const lanes3 one = fibres_at(&s, &here, &light, l, inside >= 0.0f ? share : F(0.0f));
                sent = i ? plus(sent, one) : one;
            }
            for (int k = 0; k < LANES && start + k <= last; ++k)
                out[start + k] = packed_light(LANE(sent.x, k), LANE(sent.y, k), LANE(sent.z, k));
        }
    }
}
