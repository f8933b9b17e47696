/*
 * One step of strands that move: implicit in time, inextensible, by two Newton steps, each solved directly along the strand
 * (docs/motion.md).  A strand's points are relative to its root; what it keeps is by strand, the fastest:
 * [points, 3, strands].  Points i = 1..n are free, segment i ends in point i.
 */
#if LANES > STRANDS_BESIDE
#undef LANES
#define LANES STRANDS_BESIDE
#endif
#include "distance.h"
#include "symmetric.h"
#include "moving.h"
#include "contact.h"
#include "felt.h"
#include "bending.h"
#include "newton.h"
#include "within.h"

/* Of a type of hair. */
INLINED void put_motion(Moving *m, lanes *damping, lanes *carried, uint lane, __global const MotionType *type)
{
    LANE(m->bend, lane) = type->hair.x;
    LANE(m->air, lane) = type->hair.y;
    LANE(*damping, lane) = type->hair.z;
    LANE(*carried, lane) = type->hair.w;
    LANE(m->friction, lane) = type->touch.x;
}

/* One step of strands side by side. */
ONCE void move(Moving *m, int most, lanes second, float step, lanes damping, lanes carried, __global const float *roots,
               __global const float *roots_before, __global const float *rest, __global float *places,
               __global float *places_before, __global float *speeds, __global float *speeds_before,
               __global float *tensions)
{
    for (int a = 0; a < 3; ++a) {
        m->axes[a] = three_of(roots, m->stride, 3 + 3 * a);
        m->before[a] = three_of(roots_before, m->stride, 3 + 3 * a);
    }
    const lanes3 *before = m->before;
    const lanes3 root = three_of(roots, m->stride, 0), gone = minus(root, three_of(roots_before, m->stride, 0));
    if (m->feels) {
        m->places = places;
        m->places_now = places_before;
        m->at = place_by_rows(m->body->to_grid, root);
        m->root_taken = minus(place_by_rows(m->body->carry, three_of(roots_before, m->stride, 0)), root);
        m->by_step = 1.0f / step;
        second = row_of(m->pressed, m->stride, 0) > 0.0f ? F(0.0f) : second;   // implicit Euler for what has touched it
    }
    m->he = step / (1.0f + 0.5f * second);
    const lanes stiffer = 1.0f + damping / m->he, third = second / 3.0f;
    damp(m, most, before, rest, damping / m->he / stiffer, places);
    m->bend *= stiffer;
    for (int i = 1; i <= most; ++i) {
        /* Points are relative to the root, which has gone on; a share of them goes with it. */
        const lanes3 p = three_of(places, m->stride, 3 * i), o = three_of(places_before, m->stride, 3 * i);
        const lanes3 v = three_of(speeds, m->stride, 3 * i), w = three_of(speeds_before, m->stride, 3 * i);
        const lanes3 with = from_axes(m->axes, in_axes(before, p));
        const lanes3 p_now = plus(scaled(minus(p, gone), 1.0f - carried), scaled(with, carried));
        const lanes3 o_now = plus(scaled(minus(o, gone), 1.0f - carried),
                                  scaled(from_axes(m->axes, in_axes(before, o)), carried));
        const lanes3 v_now = plus(scaled(v, 1.0f - carried), scaled(from_axes(m->axes, in_axes(before, v)), carried));
        const lanes3 w_now = plus(scaled(w, 1.0f - carried), scaled(from_axes(m->axes, in_axes(before, w)), carried));
        const lanes3 base = plus(p_now, scaled(minus(p_now, o_now), third));
        keep(m, i, BASE, base);
        keep(m, i, FREE, plus(base, scaled(plus(v_now, scaled(minus(v_now, w_now), third)), m->he)));
        keep(m, i, PLACE, with);
        put_row(m->work, m->work_stride, i * ROWS_OF_POINT + TENSION, row_of(tensions, m->stride, i));
        const lanes_i there = i <= m->n;
        put_three(places_before, m->stride, 3 * i, masked(there, p_now));
        put_three(speeds_before, m->stride, 3 * i, masked(there, v_now));
    }
    if (m->feels)
        recall(m, most);
    for (int newton = 0; newton < 2; ++newton) {
        if (m->feels && newton)
            meet(m, most);
        improve(m, most);
    }
    if (m->feels)
        turn_out(m, most);
    for (int i = 1; i <= most; ++i) {
        const lanes_i there = i <= m->n;
        const lanes3 place = kept(m, i, PLACE);
        put_three(places, m->stride, 3 * i, masked(there, place));
        const lanes3 speed = m->feels ? kept(m, i, SOLVED) : scaled(minus(place, kept(m, i, BASE)), 1.0f / m->he);
        put_three(speeds, m->stride, 3 * i, masked(there, speed));
        const lanes tension = row_of(m->work, m->work_stride, i * ROWS_OF_POINT + TENSION);
        put_row(tensions, m->stride, i, there ? tension : F(0.0f));
    }
}

/* What a CPU needs soon: rows lie so far apart that it does not foresee them. */
INLINED void ask_for(__global const float *rows, size_t stride, uint n)
{
#if LANES > 1
    for (uint row = 0; row < n; ++row)
        PREFETCH(rows + row * stride);
#endif
}

#if LANES > 1
#define BY_ITSELF ALONE BY_HAND
#else
#define BY_ITSELF
#endif

/* One step of all strands; a work-item does LANES of them at a time, one after another, in a workspace of its own. */
BY_ITSELF __kernel void advance(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n_items,                    // work-items in all
    const uint n,                          // strands
    const uint points,                     // of the longest
    const uint padded,                     // to whole LANES: from one row of what follows to the next
    __global const int *segments,          // [padded] of each strand; 0 where there is none
    __global const uint *type_of,          // [padded]
    __global const MotionType *types,      // [types]
    __global const float *groomed,         // [points, 3, padded] directions in the axes of the root; the first: its clamp's
    __global const float *rest,            // [points, 3, padded] of the next segment's directions at rest, in these
    __global const float *lengths,         // [points, padded] of segments [world]
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *roots_before,    // [4, 3, padded] a step ago
    const float seconds,                   // of the step
    const int order,                       // 2, or 1 where what came before is not known
    const int jumped,                      // 1: hair goes with its root
    const float4 gravity,                  // [world / s^2]
    __global const float *winds,           // [points, 3, padded] [world / s]
    const int feels_hair,                  // 1: what hair_grid.cl says of each point,
    __global const float *felt_of_hair,    // [points, 4, padded] acceleration [world / s^2], friction [1 / s]
    __global float *places,                // [points, 3, padded] relative to the root [world]
    __global float *places_before,         // [points, 3, padded]
    __global float *speeds,                // [points, 3, padded] [world / s]
    __global float *speeds_before,         // [points, 3, padded]
    __global float *tensions,              // [points, padded] of segments, by the points that they end in
    const int feels,                       // the body: 0, or else what follows is there
    const Distances grid,
    const Body body,
    __global const float *values,          // [nodes] distance from the body [world], below 0 inside
    __global const float *away,            // [points, padded] that a point keeps from it [world]
    __global float *free,                  // [points, padded] that it is from it, or less [world]
    __global float *pressed,               // [points, 3, padded] force of the contact over mass a length; 1 in the first
                                           // row: the strand has touched the body
    __global float *workspace)             // side by side: [work-items, points, ROWS_OF_POINT, LANES], else
                                           // [points, ROWS_OF_POINT, work-items]
{
    WORK_ITEM(item);
    /* A CPU's work-item takes strands that follow each other, and its workspace lies together: else each row would be a
       page of its own, and all of them one place in the cache.  On a GPU neighbours take neighbours. */
    const uint all = (n + LANES - 1) / LANES, run = (all + n_items - 1) / n_items;
    const uint past = LANES > 1 ? min((uint)(item + 1) * run, all) : all;
    Moving m;
    m.stride = padded;
    m.work_stride = LANES > 1 ? LANES : n_items;
    m.work = workspace + (LANES > 1 ? item * points * ROWS_OF_POINT * LANES : item);
    m.gravity = all_lanes(gravity);
    m.feels = feels;
    m.grid = &grid;
    m.body = &body;
    m.values = values;
    for (uint block = (uint)item * (LANES > 1 ? run : 1); block < past; block += LANES > 1 ? 1 : n_items) {
        const uint first = block * LANES, next = first + LANES;
        if (block + 1 < past) {
            ask_for(groomed + next, padded, 3 * points);
            ask_for(rest + next, padded, 3 * points);
            ask_for(lengths + next, padded, points);
            ask_for(winds + next, padded, 3 * points);
            ask_for(places + next, padded, 3 * points);
            ask_for(places_before + next, padded, 3 * points);
            ask_for(speeds + next, padded, 3 * points);
            ask_for(speeds_before + next, padded, 3 * points);
            ask_for(tensions + next, padded, points);
            if (feels) {
                ask_for(away + next, padded, points);
                ask_for(free + next, padded, points);
                ask_for(pressed + next, padded, 3 * points);
            }
            if (feels_hair)
                ask_for(felt_of_hair + next, padded, 4 * points);
        }
        m.groomed = groomed + first;
        m.lengths = lengths + first;
        m.away = away + first;
        m.free = free + first;
        m.pressed = pressed + first;
        m.winds = winds + first;
        m.of_hair = feels_hair ? felt_of_hair + first : 0;
        m.n = *(__global const lanes_i *)(segments + first);
        lanes damping = F(0.0f), carried = F(0.0f);
        m.bend = m.air = m.friction = F(0.0f);
        for (uint lane = 0; lane < LANES; ++lane)
            put_motion(&m, &damping, &carried, lane, &types[type_of[first + lane]]);
        const lanes n_segments = greater(TO(lanes, m.n), F(1.0f));
        m.bend *= 1.0f + 1.0f / (n_segments * n_segments);   // so that a bar of few bends as one of endlessly many
        carried = jumped ? F(1.0f) : carried;
        move(&m, most_lane(m.n), F(order == 2 ? 1.0f : 0.0f), seconds, damping, carried, roots + first,
             roots_before + first, rest + first, places + first, places_before + first, speeds + first,
             speeds_before + first, tensions + first);
    }
}

/* Strands as they were groomed are at rest: their directions, lengths, and where each segment would point without weight. */
__kernel void hang(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n,                          // strands
    const uint padded,
    __global const float4 *points,         // [points] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const MotionType *types,      // [types]
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    const float4 gravity,                  // [world / s^2]
    __global int *segments,                // [padded]
    __global uint *type_of,                // [padded]
    __global float *groomed,               // [points, 3, padded]
    __global float *rest,                  // [points, 3, padded]
    __global float *lengths,               // [points, padded]
    __global float *places,                // [points, 3, padded]
    __global float *places_before,         // [points, 3, padded] the same
    __global uint *too_soft)               // [strands] 1: it can't bear its weight as it was groomed
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    const int k = max((int)span.y - 1, 0);
    segments[i] = k;
    type_of[i] = (uint)strand_uv[i].z;
    const float bend = types[type_of[i]].hair.x * (1.0f + 1.0f / ((float)max(k, 1) * max(k, 1)));
    float4 axes[3], pull = (float4)(0.0f), reaction = (float4)(0.0f);
    for (int a = 0; a < 3; ++a)
        axes[a] = (float4)(roots[(3 + 3 * a) * (size_t)padded + i], roots[(4 + 3 * a) * (size_t)padded + i],
                           roots[(5 + 3 * a) * (size_t)padded + i], 0.0f);
    uint soft = 0;
    float next_length = 0.0f;
    for (int j = k; j >= 1; --j) {
        const float4 from = points[span.x + j - 1], along = points[span.x + j] - from, place = points[span.x + j] - points[span.x];
        const float size = sqrt(dot3(along, along));
        const float4 t = size > 0.0f ? along / size : axes[2];
        const float mass = 0.5f * (size + next_length);
        pull += mass * gravity;
        float4 before = t;                 // the clamp points as the first segment does
        float before_length = 0.0f;
        if (j > 1) {
            const float4 other = from - points[span.x + j - 2];
            before_length = sqrt(dot3(other, other));
            before = before_length > 0.0f ? other / before_length : axes[2];
        }
        const float stiff = j == 1 ? 2.0f * bend / size : 2.0f * bend / (before_length + size);
        float4 need = -size * pull - reaction;
        need -= dot3(need, t) * t;
        float square = dot3(need, need);   // of the sine that is asked for, times the stiffness
        if (square > 0.98f * stiff * stiff) {
            soft = 1;
            need = (float4)(0.0f);
        } else if (stiff > 0.0f)
            need /= stiff;
        square = dot3(need, need);
        const float4 wants = need + sqrt(1.0f - square) * t;
        reaction = stiff * cross3(cross3(wants, t), before);
        for (int a = 0; a < 3; ++a) {
            const size_t to = (size_t)(3 * (j - 1) + a) * padded + i, at = (size_t)(3 * j + a) * padded + i;
            rest[to] = dot3(axes[a], wants);
            groomed[at] = dot3(axes[a], t);
            if (j == 1)
                groomed[to] = dot3(axes[a], t);
            places[at] = places_before[at] = a == 0 ? place.x : a == 1 ? place.y : place.z;
        }
        lengths[(size_t)(j - 1) * padded + i] = size;
        next_length = size;
        if (!(size > 0.0f))
            segments[i] = 0;               // of no length: it stays as it is
    }
    /* What can't bear its weight falls: a clamp with all that it has would swing for ever. */
    for (int j = 0; soft && j < 3 * k; ++j)
        rest[(size_t)j * padded + i] = groomed[(size_t)(j + 3) * padded + i];
    too_soft[i] = soft;
}

/* How far points of strands as they were groomed stay away from the body: half of their width, or as near as they are. */
BY_HAND __kernel void stand_off(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n,                          // strands
    const uint padded,
    const Distances grid,
    const Body body,
    __global const float *values,          // [nodes] distance from the body [world], below 0 inside
    __global const float4 *points,         // [points] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global float *away,                  // [points, padded] that a point keeps from it [world]
    __global float *free,                  // [points, padded] that it is from it [world]
    __global float *deepest)               // [padded] the least of these
{
    WORK_ITEM(block);
    const uint first = (uint)block * LANES;
    lanes least = F(grid.reach.x), width = F(0.0f);
    lanes_i count = I(0);
    for (uint lane = 0; lane < LANES && first + lane < n; ++lane)
        LANE_I(count, lane) = (int)spans[first + lane].y;
    const int most = most_lane(count);
    for (int k = 1; k < most; ++k) {
        lanes3 place = all_lanes((float4)(0.0f));
        for (uint lane = 0; lane < LANES && first + lane < n; ++lane)
            if (k < LANE_I(count, lane)) {
                const float4 p = points[spans[first + lane].x + k];
                put_lane(&place, lane, p);
                LANE(width, lane) = p.w;
            }
        const lanes value = near_at(&grid, values, I(ON), place_by_rows(body.to_grid, place)).value;
        least = k < count ? lesser(least, value) : least;
        put_row(free + first, padded, k, value);
        put_row(away + first, padded, k, lesser(0.5f * width, value - grid.reach.y * (1.0f / 128)));
    }
    put_row(deepest + first, padded, 0, least);
}

/* Where strands are now, as they are drawn. */
__kernel void place_points(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    __global const uint2 *spans,           // [strands] first point, points
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *places,          // [points, 3, padded] relative to the root [world]
    __global float *packed,                // [points, 3] x, y, z [world]
    __global float *normals)               // [strands, 3] unit, of the skin at the root
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    for (uint a = 0; a < 3; ++a) {
        const float root = roots[a * (size_t)padded + i];
        for (uint k = 0; k < span.y; ++k)
            packed[3 * (size_t)(span.x + k) + a] = root + (k ? places[(3 * (size_t)k + a) * padded + i] : 0.0f);
        normals[3 * i + a] = roots[(9 + a) * (size_t)padded + i];
    }
}

/* A mean of three corners of a face, between two poses. */
inline float4 on_face(float4 weights, float share, __global const float4 *before, __global const float4 *now)
{
    const float4 was = (weights.x * before[0] + weights.y * before[1]) + weights.z * before[2];
    const float4 is = (weights.x * now[0] + weights.y * now[1]) + weights.z * now[2];
    return was + share * (is - was);
}

/* Roots that stand on faces, between two poses: their axes turn with the skin.  They are a side of the face, as it lies
   along the skin, what is across both others, and the skin's normal. */
__kernel void place_roots(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    __global const float4 *feet,           // [strands] -; number of the face, weights of its second and third corner
    __global const float4 *offsets,        // [strands] from there to the root, along the axes [world]
    __global const float4 *before,         // [faces, 3] corners of the pose before [world]
    __global const float4 *normals_before, // [faces, 3] of the skin there, unit
    __global const float4 *now,            // [faces, 3] of this pose
    __global const float4 *normals,        // [faces, 3]
    const float share,                     // 0: the pose before, 1: this one
    const Body body,                       // where it takes them besides
    __global float *roots)                 // [4, 3, padded] place [world], three axes
{
    WORK_ITEM(i);
    const float4 foot = feet[i], weights = (float4)(1.0f - foot.z - foot.w, foot.z, foot.w, 0.0f);
    const size_t face = 3 * (size_t)as_uint(foot.y);
    float4 place = on_face(weights, share, before + face, now + face), axes[3];
    const float4 side = on_face((float4)(-1.0f, 1.0f, 0.0f, 0.0f), share, before + face, now + face);
    const float4 other = on_face((float4)(-1.0f, 0.0f, 1.0f, 0.0f), share, before + face, now + face);
    const float4 flat = unit_or(cross3(side, other), (float4)(0.0f, 1.0f, 0.0f, 0.0f));
    axes[2] = unit_or(on_face(weights, share, normals_before + face, normals + face), flat);
    const float4 along = fabs(axes[2].x) < 0.6f ? (float4)(1.0f, 0.0f, 0.0f, 0.0f) : (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    axes[0] = unit_or(side - dot3(side, axes[2]) * axes[2], unit_or(along - dot3(along, axes[2]) * axes[2], along));
    axes[1] = cross3(axes[2], axes[0]);
    const float4 offset = offsets[i];
    place += (offset.x * axes[0] + offset.y * axes[1]) + offset.z * axes[2];
    for (uint row = 0; row < 4; ++row) {
        const float4 v = row ? axes[row - 1] : place;
        for (int a = 0; a < 3; ++a)
            roots[(3 * row + a) * (size_t)padded + i] = dot3(body.to_world[a], v) + (row ? 0.0f : body.to_world[a].w);
    }
}
