/*
 * Light of strands at places along them: `transmittance` tells what share of each light gets through to their points, the
 * same from wherever they are seen; `radiance` what a segment sends to the eye at FEW_PLACES of it; `further` what it is like
 * where these are too few.  Several points or segments side by side.
 */
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "light_lanes.h"
#include "places.h"

/* A divisor of numbers below 2^31, by which many are divided: `part` of 2^shift, a bit more than its share. */
typedef struct {
    ulong part;
    uint by;
    int shift;
} Divisor;

INLINED Divisor divisor(uint by)
{
    const int shift = 63 - clz(by);
    const Divisor d = {((1ul << shift) + by - 1) / by, by, shift};   // too much by less than `by`: of 2^31 by less than 1 / by
    return d;
}

INLINED uint divided(uint x, const Divisor *d)
{
    return (uint)(x * d->part >> d->shift);
}

/* `begin_of`, where many are asked for. */
INLINED uint begins_at(uint number, int listed, __global const uint *segments, uint first_point, __global const uint *stored,
                       const Divisor *run)
{
    if (!listed)
        return number;
    const uint came = (segments[number] & ~BODY) - first_point, whole = divided(came, run);
    return stored[whole] + came - whole * run->by;
}

/* Where a segment begins: `number` of those that are listed, or of all points. */
INLINED uint begin_of(uint number, int listed, __global const uint *segments, uint first_point, __global const uint *stored,
                      uint run)
{
    return listed ? lies_at(stored, run, (segments[number] & ~BODY) - first_point) : number;
}

/* One work-item tells in which range a row of blocks of a light's shadow map has its depths, each with the texels around it:
   nine texels around any of its own need not be looked at where all of these lie before a strand, or none. */
LARGE __kernel void depth_ranges(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const Shadow *shadows,
    __global const View *light_views,
    __global const ulong *shadow_maps,
    __global uint *ranges)                 // [lights, BLOCKS, BLOCKS] the nearest | the furthest << 16, without RANGE_BITS
{
    WORK_ITEM(item);
    const uint light = (uint)item / BLOCKS;
    const int2 size = light_views[light].size.xy;
    const int side = block_side(size), y = (uint)item % BLOCKS * side;
    const int top = y > 0 ? y - 1 : 0, bottom = y + side < size.y ? y + side + 1 : size.y;
    if (!shadows[light].body.x || size.x < 4)
        return;
    __global const ulong *map = shadow_maps + place_of(shadows[light].place.zw);
    for (int x = 0; x < size.x; x += side) {
        uint4 low = NOTHING, high = 0;
        for (int row = top; row < bottom; ++row)
            for (int column = x - 1; column < x + side + 1; column += 4) {
                /* More than is asked for does no harm. */
                const int from = column < 0 ? 0 : column < size.x - 4 ? column : size.x - 4;
                const uint4 depth = as_uint8(*(__global const Four *)(map + (size_t)row * size.x + from)).odd;
                low = depth < low ? depth : low;
                high = depth > high ? depth : high;
            }
        const uint2 lows = low.lo < low.hi ? low.lo : low.hi, highs = high.lo > high.hi ? high.lo : high.hi;
        const uint nearest = (lows.x < lows.y ? lows.x : lows.y) >> RANGE_BITS;
        const uint furthest = (highs.x > highs.y ? highs.x : highs.y) >> RANGE_BITS;
        /* Where nothing is it is beyond 16 bits. */
        ranges[item * BLOCKS + x / side] = (nearest < 0xFFFFu ? nearest : 0xFFFFu) | (furthest < 0xFFFFu ? furthest : 0xFFFFu) << 16;
    }
}

/* One work-item tells what share of each light's direct light hair and body let through to LANES points of strands: all,
   or the start and the end of each of some segments. */
LARGE __kernel void transmittance(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int listed,                      // 1: of `segments`
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
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const int ranged,                      // 1: it is known what `depth_ranges` tells
    __global const uint *ranges,           // [n_lights, BLOCKS, BLOCKS] if so
    const uint n_asked,                    // points, or starts and ends
    __global float *transmittances)        // [n_lights, n_asked] 0..1
{
    WORK_ITEM(item);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const uint first = LANES * (uint)item, count = n_asked - first < LANES ? n_asked - first : LANES;
    const Divisor by_run = divisor(run);
    uint ids[LANES], strands[LANES];
    LaneRows places, across;
    lanes alpha;
    ONE_BY_ONE
    for (uint k = 0; k < LANES; ++k) {
        const uint number = first + (k < count ? k : 0);
        uint id = listed ? begins_at(number / 2, listed, segments, first_point, stored, &by_run) : number;
        const uint strand = strand_of[divided(id, &by_run)];
        id += listed && number % 2 && id + 1 < spans[strand].x + spans[strand].y;
        ids[k] = id, strands[k] = strand;
    }
    ONE_BY_ONE
    for (uint k = 0; k < LANES; ++k) {
        places.of[k] = points[ids[k]];
        across.of[k] = strand_normal[strands[k]];
        LANE(alpha, k) = types[(int)strand_uv[strands[k]].z].shine.z;
    }
    const lanes4 p = four_of(&places);
    const lanes3 n = three_of(&across), at = {p.x, p.y, p.z};
    for (int i = 0; i < n_lights; ++i) {
        Obstacles obstacles = obstacles_of(&lighting, i);
        obstacles.ranges = ranged ? ranges + BLOCKS * BLOCKS * i : 0;
        lanes share = transmittances_at(&obstacles, I(ON), at, n, p.w, alpha);
        for (uint k = 0; k < count; ++k)
            transmittances[(size_t)i * n_asked + first + k] = LANE(share, k);
    }
}

/* Where LANES segments begin and end: both are one where none begins. */
typedef struct {
    lanes_u from, to;
} Ends;

/* Segments: what they are like at their start, and how much of it changes to their end. */
typedef struct {
    lanes3 p, t, color, p_step, t_step, color_step;
    lanes specular, exponent;
    lanes_i half_vector;                   // a mask
} Segments;

/* What LANES segments are like, those that begin at points ends->from of strands: and where they end. */
INLINED void take(Segments *s, Looks *looks, Ends *ends, const Hair *hair, const uint *strands)
{
    LaneRows a, b, before, after, colors;
    ONE_BY_ONE
    for (int k = 0; k < LANES; ++k) {
        const uint id = LANE_U(ends->from, k);
        const uint2 span = hair->spans[strands[k]];
        const uint behind = span.x + span.y, to = id + (id + 1 < behind);
        a.of[k] = hair->points[id];
        b.of[k] = hair->points[to];
        before.of[k] = hair->points[id - (id > span.x)];
        after.of[k] = hair->points[to + (to + 1 < behind)];
        colors.of[k] = hair->colors[hair->color_per == 0 ? 0 : hair->color_per == 1 ? strands[k] : id];
        LANE_U(ends->to, k) = to;
        LANE_I(looks->kind, k) = (int)hair->strand_uv[strands[k]].z;
    }
    const lanes3 q = three_of(&b), none = {F(0.0f), F(0.0f), F(0.0f)};
    s->p = three_of(&a);
    s->p_step = minus(q, s->p);
    const lanes3 chords[2] = {minus(q, three_of(&before)), minus(three_of(&after), s->p)};
    s->color = three_of(&colors);
    s->color_step = none;
    if (hair->color_per == 2) {
        for (int k = 0; k < LANES; ++k)
            colors.of[k] = hair->colors[LANE_U(ends->to, k)];
        s->color_step = minus(three_of(&colors), s->color);
    }
    /* Mostly they are all of one type. */
    const int kind = LANE_I(looks->kind, 0);
    const float4 shine = hair->types[kind].shine;
    s->specular = F(shine.x);
    s->exponent = F(shine.y);
    s->half_vector = I((int)shine.w == HALF_VECTOR ? ON : 0);
    looks->on = I((int)shine.w == CHIANG ? ON : 0);
    if (any_lane(looks->kind != kind))
        for (int k = 0; k < LANES; ++k) {
            const float4 its = hair->types[LANE_I(looks->kind, k)].shine;
            LANE(s->specular, k) = its.x;
            LANE(s->exponent, k) = its.y;
            LANE_I(s->half_vector, k) = (int)its.w == HALF_VECTOR ? ON : 0;
            LANE_I(looks->on, k) = (int)its.w == CHIANG ? ON : 0;
        }
    s->t = tangent_of_lanes(chords[0], s->p_step);
    s->t_step = minus(tangent_of_lanes(chords[1], s->p_step), s->t);
}

/* How much of segments lies before place j. */
INLINED lanes share_before(int j)
{
    return F((float)j / (FEW_PLACES - 1));
}

INLINED lanes3 place_at(const Segments *s, int j)
{
    return plus(s->p, scaled(s->p_step, share_before(j)));
}

INLINED lanes3 color_at(const Segments *s, int j)
{
    return plus(s->color, scaled(s->color_step, share_before(j)));
}

/* How far inside a spot's cone places lie, as a cosine. l: towards the light. */
INLINED lanes inside_cone(const Light *light, lanes3 l)
{
    return -dots(l, all_lanes(light->direction)) - light->cone.x;
}

#define TURN 1.5f            // by which a segment may turn, in widths of its highlight, for one parabola: twice as much as from
                             // place to place
/* `cells_crossed` by one segment, from a to b. */
INLINED float cells_between(__global const Shadow *shadow, __global const Grid *grid, float4 a, float4 b)
{
    __global const float4 *to_grid = grid->to_grid;
    if (shadow->hair.x == 0.0f)
        return 0.0f;
    const float4 p = ((to_grid[0] * a.x + to_grid[1] * a.y) + to_grid[2] * a.z) + to_grid[3];
    const float4 q = ((to_grid[0] * b.x + to_grid[1] * b.y) + to_grid[2] * b.z) + to_grid[3];
    const float x = fabs(p.x / p.w - q.x / q.w), y = fabs(p.y / p.w - q.y / q.w), z = fabs(p.z - q.z), wide = x > y ? x : y;
    return p.w > 0.0f && q.w > 0.0f ? wide > z ? wide : z : 1e9f;
}

/* Whether the edge of a spot's cone may lie between two places: how far inside they are, and how far apart the directions
   to the light (Euclid).  Between two outside they come nearest to the cone where they would meet its chord. */
INLINED lanes_i edge_between(const Light *light, lanes inside, lanes before, lanes turn)
{
    const lanes nearest = greater(inside, before) + light->cone.x;
    const lanes_i both_out = greater(inside, before) < 0.0f;
    const lanes_i may_meet = nearest > light->cone.x * root(greater(1.0f - 0.25f * turn * turn, F(1e-6f))) - 1e-5f;
    return ((lesser(inside, before) < 0.0f) & (greater(inside, before) >= 0.0f)) | (both_out & may_meet);
}

/* |a - b| */
INLINED lanes distance_between(lanes3 a, lanes3 b)
{
    const lanes3 d = minus(a, b);
    return root(greater(dots(d, d), F(1e-30f)));
}

/* Which segments' light of light i changes too much between few places: they turn far from one to the next, by `turns` or
   as seen from the light too, cross many cells of its grid, or may cross the edge of a spot's cone. */
INLINED lanes_i change_much(const Lighting *lighting, int i, int shadowed, const Segments *s, const lanes *turns)
{
    const Light light = lighting->lights[i];
    lanes most = F(0.0f);
    lanes_i needs = I(0);
    lanes3 l, before;
    share_of_light(&light, place_at(s, 0), &before);
    for (int j = 1; j < FEW_PLACES; ++j) {
        lanes turn = turns[j];
        if (light.position.w > 0.0f) {
            share_of_light(&light, place_at(s, j), &l);
            const lanes aside = distance_between(l, before);
            needs |= edge_between(&light, inside_cone(&light, l), inside_cone(&light, before), aside);
            turn += aside;
            before = l;
        }
        most = greater(most, turn);
    }
    if (shadowed) {
        const Obstacles obstacles = obstacles_of(lighting, i);
        needs |= cells_crossed(&obstacles, s->p, s->p_step) > CELLS;
    }
    return needs | (2.0f * most * root(1.0f + s->exponent) > TURN);
}

/* Light of LANES places in 63 bits each: of each of r, g, b the upper 21 bits of its float, but for its sign, which would be
   taken for MORE: what is not above 0 is 0.  MORE where that is needed. */
INLINED lanes_l packed_lanes(lanes3 light, lanes_i need)
{
    const lanes none = F(0.0f);
    const lanes_u x = (AS_U(light.x > none ? light.x : none) + 512u) >> 10;
    const lanes_u y = (AS_U(light.y > none ? light.y : none) + 512u) >> 10;
    const lanes_u z = (AS_U(light.z > none ? light.z : none) + 512u) >> 10, high = need ? U(1u << 31) : x << 10 | y >> 11;
    return TO(lanes_l, high) << 32 | TO(lanes_l, need ? U(0) : y << 21 | z);
}

/* Put what LANES segments send to the eye into their places of source i, a light or after all lights another, of `count` of
   them, where they don't `need` more. */
INLINED void put_places(__global ulong *places, int sources, int i, uint count, lanes_i need, const lanes3 *sent)
{
    lanes_l packed[FEW_PLACES];
    const bool known = any_lane(need == 0);    // what is sent: else nobody has asked
    for (int j = 0; j < FEW_PLACES; ++j)
        packed[j] = known ? packed_lanes(sent[j], need) : (lanes_l)((long)MORE);
    for (uint k = 0; k < count; ++k) {
        __global ulong *few = places + FEW_PLACES * ((size_t)sources * k + i);
        const ulong its[FEW_PLACES] = {LANE_L(packed[0], k), LANE_L(packed[1], k), LANE_L(packed[2], k), LANE_L(packed[3], k),
                                       LANE_L(packed[4], k)};
        few[0] = its[0], few[1] = its[1], few[2] = its[2], few[3] = its[3], few[4] = its[4];
    }
}

/* One work-item tells what LANES segments send to the eye at FEW_PLACES each, and keeps rows of `more` for those that need
   them. */
LARGE APART __kernel void radiance(
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
    const int shadowed,                    // 1: something stands before them
    const int of_ends,                     // 1: it is known of each segment's start and end, 0: of points
    const uint n_asked,                    // how many these are
    __global const float *transmittances,  // [n_lights, n_asked] share of direct light, if so
    const int under_sky,                   // 1: light comes from all around too,
    const int has_sky,                     // 1: from a sky,
    __global const float4 *sky_light,      // [points] r, g, b of it, if so
    const float even,                      // and so much that is the same everywhere
    const int is_scattered,                // 1: light comes from hair to hair too
    __global const float4 *scattered,      // [n_points] what they send of it, if so
    __global ulong *places,                // [segments, n_lights + under_sky + is_scattered, FEW_PLACES] see places.h
    volatile __global uint *rows)          // [1] of `more` that are taken
{
    WORK_ITEM(item);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, color_per};
    Looks looks = {lobes, lobe_table};
    const uint first = range.x + LANES * (uint)item, count = range.y - first < LANES ? range.y - first : LANES;
    const Divisor by_run = divisor(run);
    Segments s;
    Ends ends;
    uint strands[LANES];
    ONE_BY_ONE
    for (uint k = 0; k < LANES; ++k) {
        LANE_U(ends.from, k) = begins_at(first + (k < count ? k : 0), listed, segments, first_point, stored, &by_run);
        strands[k] = strand_of[divided(LANE_U(ends.from, k), &by_run)];
    }
    take(&s, &looks, &ends, &hair, strands);
    lanes3 tangents[FEW_PLACES], towards_eye[FEW_PLACES];
    lanes turns[FEW_PLACES];
    lanes_i some = I(0);
    for (int j = 0; j < FEW_PLACES; ++j) {
        tangents[j] = unit_lanes_or(plus(s.t, scaled(s.t_step, share_before(j))), s.t);
        towards_eye[j] = towards_eye_lanes(&view, place_at(&s, j));
    }
    for (int j = 1; j < FEW_PLACES; ++j)
        turns[j] = distance_between(tangents[j], tangents[j - 1]) + distance_between(towards_eye[j], towards_eye[j - 1]);
    const lanes_i inside = ends.from != ends.to;
    const int sources = n_lights + under_sky + is_scattered;
    __global ulong *few = places + FEW_PLACES * sources * (size_t)first;
    for (int i = 0; i < n_lights; ++i) {
        const Light light = lights[i];
        const lanes_i need = inside & change_much(&lighting, i, shadowed, &s, turns);
        lanes share = F(1.0f), share_step = F(0.0f);
        lanes3 sent[FEW_PLACES];
        some |= need;
        if (shadowed) {
            __global const float *there = transmittances + (size_t)i * n_asked;
            ONE_BY_ONE
            for (uint k = 0; k < LANES; ++k) {
                const uint start = of_ends ? 2 * (first + (k < count ? k : 0)) : LANE_U(ends.from, k);
                LANE(share, k) = there[start];
                LANE(share_step, k) = there[of_ends ? start + 1 : LANE_U(ends.to, k)];
            }
            share_step -= share;
        }
        for (int j = 0; j < FEW_PLACES && any_lane(need == 0); ++j) {
            const Fibres here = {tangents[j], color_at(&s, j), s.specular, s.exponent, s.half_vector};
            const lanes3 p = place_at(&s, j);
            lanes3 l;
            const lanes part = share_of_light(&light, p, &l) * (share + share_before(j) * share_step);
            sent[j] = any_lane(part > 0.0f) ? fibre_lanes(&light, &here, &looks, l, towards_eye[j], disc_at(&light, p), part)
                                            : scaled(here.color, F(light.color.w));
        }
        put_places(few, sources, i, count, need, sent);
    }
    if (under_sky) {
        lanes3 light, light_step, sent[FEW_PLACES];
        for (int k = 0; k < LANES; ++k) {
            const float4 start = has_sky ? sky_light[LANE_U(ends.from, k)] : 0.0f, end_there = has_sky ? sky_light[LANE_U(ends.to, k)] : 0.0f;
            put_lane(&light, k, start + even);
            put_lane(&light_step, k, end_there - start);
        }
        for (int j = 0; j < FEW_PLACES; ++j) {
            const lanes3 there = plus(light, scaled(light_step, share_before(j))), c = color_at(&s, j);
            sent[j].x = c.x * there.x;
            sent[j].y = c.y * there.y;
            sent[j].z = c.z * there.z;
        }
        put_places(few, sources, n_lights, count, I(0), sent);
    }
    if (is_scattered) {
        lanes3 start, step, sent[FEW_PLACES];
        for (int k = 0; k < LANES; ++k) {
            put_lane(&start, k, scattered[LANE_U(ends.from, k)]);
            put_lane(&step, k, scattered[LANE_U(ends.to, k)] - scattered[LANE_U(ends.from, k)]);
        }
        for (int j = 0; j < FEW_PLACES; ++j)
            sent[j] = plus(start, scaled(step, share_before(j)));
        put_places(few, sources, n_lights + under_sky, count, I(0), sent);
    }
    uint needy = 0;
    for (uint k = 0; k < count; ++k)
        needy += LANE_I(some, k) ? 1 : 0;
    uint row = needy ? atomic_add(rows, needy) : 0;
    for (uint k = 0; k < count; ++k)
        if (LANE_I(some, k)) {
            for (int i = 0; i < n_lights; ++i)
                few[FEW_PLACES * (sources * k + i)] |= few[FEW_PLACES * (sources * k + i)] & MORE ? row : 0;
            ++row;
        }
}

/* Put what a segment is like into a row of `more`; known: what is told there of the light on it. */
INLINED void put_row(__global float *more, ulong row, const Hair *hair, uint id, uint strand, const Segment *ends,
                     const float known[4])
{
    __global float4 *its = (__global float4 *)more + 8 * row;
    const float kind = hair->strand_uv[strand].z;
    const float4 shine = hair->types[(int)kind].shine, along = ends->b - ends->a;
    const float4 t = tangent_of(ends->b - ends->before, along), u = tangent_of(ends->after - ends->a, along);
    const float4 c = hair->colors[hair->color_per == 0 ? 0 : hair->color_per == 1 ? strand : id];
    const float4 d = hair->color_per == 2 ? hair->colors[id + 1] - c : (float4)(0.0f);
    its[0] = ends->a;
    its[1] = along;
    its[2] = (float4)(t.xyz, shine.x);
    its[3] = (float4)(u.xyz - t.xyz, shine.y);
    its[4] = (float4)(c.xyz, shine.w);
    its[5] = (float4)(d.xyz, shine.z);
    its[6] = (float4)(hair->strand_normal[strand].xyz, known[0]);
    its[7] = (float4)(known[1], known[2], known[3], kind);
}

/* One work-item tells what those of LANES segments are like whose light changes too much between few places. */
LARGE __kernel void further(
    const ulong begin, const ulong end,    // work-items, see common.h
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
    __global const float4 *colors,
    const int color_per,
    const int n_lights,
    __global const Shadow *shadows,
    __global const Grid *grids,
    const int shadowed,                    // 1: something stands before them
    const int of_ends,                     // 1: it is known of each segment's start and end, 0: of points
    const uint n_asked,                    // how many these are
    __global const float *transmittances,  // [n_lights, n_asked] share of direct light, if so
    const int sources,                     // of light: these, and others that need no more than few places
    __global const ulong *places,          // [segments, sources, FEW_PLACES] see places.h
    __global float *more)                  // [rows, 32] at least as many as `radiance` has counted, see exact_light.h
{
    WORK_ITEM(item);
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, color_per};
    const uint first = range.x + LANES * (uint)item;
    for (uint segment = first; segment < range.y && segment < first + LANES; ++segment) {
        __global const ulong *few = places + FEW_PLACES * sources * (size_t)segment;
        const ulong row = row_among(few, n_lights);
        if (!row)
            continue;
        const uint id = begin_of(segment, listed, segments, first_point, stored, run), strand = strand_at(&hair, id);
        const Segment ends = segment_at(&hair, id, spans[strand]);
        float known[4];
        for (int i = 0; i < 2; ++i) {
            const bool ask = i < n_lights && shadowed && cells_between(&shadows[i], &grids[i], ends.a, ends.b) > CELLS;
            const size_t start = (size_t)i * n_asked + (of_ends ? 2 * segment : id);
            __global const float *there = transmittances + (i < n_lights && shadowed ? start : 0);
            known[2 * i] = ask ? -1.0f : i < n_lights && shadowed ? there[0] : 1.0f;
            known[2 * i + 1] = !ask && i < n_lights && shadowed ? there[1] - there[0] : 0.0f;
        }
        put_row(more, row & ROW, &hair, id, strand, &ends, known);
    }
}

/* One work-item tells where in the world a segment lies, so that its pieces can look at the hair before lights: see deep.h. */
RARE __kernel void axes(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint first,                      // of segments
    __global const uint *segments,         // their ids, their highest bits aside
    const uint first_point,                // the id of the first of these points
    __global const float4 *points,         // strands: see strands.cl
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global const uint *numbers,
    const uint first_strand,
    const int n_lights,
    const int of_ends,                     // as of `radiance`,
    const uint n_asked,
    __global const float *transmittances,  // [n_lights, n_asked] but what hair as of the grid lets through
    __global float8 *axes,                 // [segments]
    __global uint *hazes)                  // [segments, n_lights]
{
    WORK_ITEM(item);
    const uint id = lies_at(stored, run, (segments[first + item] & ~BODY) - first_point);
    const uint strand = strand_of[id / run];
    const float4 a = points[id], way = points[id + 1] - a;
    for (int i = 0; i < n_lights; ++i) {
        __global const float *there = transmittances + (size_t)i * n_asked + (of_ends ? 2 * (first + item) : id);
        const uint start = (uint)(there[0] * 65535.0f + 0.5f), at_end = (uint)(there[1] * 65535.0f + 0.5f);
        hazes[(first + item) * n_lights + i] = at_end << 16 | start;
    }
    axes[first + item] = both((float4)(a.xyz, first_strand + numbers[strand] & 0xFFFFFF), (float4)(way.xyz, a.w + 0.5f * way.w));
}
