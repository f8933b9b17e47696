/*
 * How far nodes of a grid are from the body, below 0 inside, and strands that slide along it.
 *
 * Each triangle offers its distance to the nodes near it, as an integer, and the least is kept.  On which side a node lies
 * is told by what is nearest there, be it a face, an edge or a corner: its triangles are those that are as near, and each
 * counts by its angle around the feature (Baerentzen and Aanaes, "Signed Distance Computation Using the Angle Weighted
 * Pseudonormal", 2005).  Sums are of integers, so that no order of triangles, nor how they are cut into parts, matters.
 */
#include "distance.h"

#define CELL_ONE ((float)(1 << DISTANCE_BITS))
#define AS_NEAR 512.0f            // 1 / how much further than the nearest, in cells, a triangle is as near
#define TURN 2048.0f              // of a radian around a feature, in sums
#define HALF_TURN 3.14159265f
#define AT_END 1e-4f              // of a side: as near its end, it is the corner that is nearest

#define ACROSS (LANES < 8 ? LANES : 8)   // nodes of a row that are looked at together, and rows
#define DOWN (LANES / ACROSS)

#if CHECKED
#define KNOWN(p) atomic_max(p, 0u)   // a race, but one that is meant: see raster.cl
#else
#define KNOWN(p) (*(p))
#endif

/* A triangle, in cells. */
typedef struct {
    float4 corner[3], side[3];   // side i goes from corner i to the next
    float4 inward[3];            // across side i, in the plane
    float4 normal;               // unit; 0 where the triangle has no area
    float inverse[3];            // 1 / square of a side
    float angle[3];              // at a corner [radians]
    int4 low, high;              // nodes that are near it: first, last
} Facet;

/* The nearest of it to nodes side by side. */
typedef struct {
    lanes square;                // of the distance
    lanes height;                // part of the way from there along the normal
    lanes angle;                 // of the triangle around what is nearest [radians]
} Nearest;

/* The angle of a cosine, wrong by less than 7e-5 (Abramowitz and Stegun, 4.4.45). */
inline float angle_of(float cosine)
{
    const float x = min(fabs(cosine), 1.0f);
    const float angle = sqrt(1.0f - x) * (1.5707288f + x * (-0.2121144f + x * (0.0742610f - 0.0187293f * x)));
    return cosine < 0.0f ? HALF_TURN - angle : angle;
}

inline Facet facet_of(const Distances *grid, __global const float4 *positions, uint4 triangle)
{
    Facet t;
    const float4 origin = (float4)(grid->place.xyz, 0.0f), last = convert_float4(grid->size - 1);
    const uint index[3] = {triangle.x, triangle.y, triangle.z};
    for (int i = 0; i < 3; ++i) {
        const float4 p = positions[index[i]];
        t.corner[i] = ((float4)(p.x, p.y, p.z, 0.0f) - origin) * grid->place.w;
    }
    float sizes[3];
    for (int i = 0; i < 3; ++i) {
        t.side[i] = t.corner[(i + 1) % 3] - t.corner[i];
        sizes[i] = dot3(t.side[i], t.side[i]);
        t.inverse[i] = sizes[i] > 0.0f ? 1.0f / sizes[i] : 0.0f;
    }
    const float4 n = cross3(t.side[0], t.side[1]);
    const bool has_area = dot3(n, n) > 1e-10f * (sizes[0] * sizes[1]);
    t.normal = has_area ? unit_or(n, (float4)(0.0f)) : (float4)(0.0f);
    for (int i = 0; i < 3; ++i) {
        t.inward[i] = cross3(t.normal, t.side[i]);
        const float both = sqrt(sizes[i] * sizes[(i + 2) % 3]);
        t.angle[i] = both > 0.0f ? angle_of(-dot3(t.side[i], t.side[(i + 2) % 3]) / both) : 0.0f;
    }
    const float4 low = min(min(t.corner[0], t.corner[1]), t.corner[2]) - (float)DISTANCE_BAND;
    const float4 high = max(max(t.corner[0], t.corner[1]), t.corner[2]) + (float)DISTANCE_BAND;
    t.low = convert_int4(min(max(low, 0.0f), last));
    t.high = convert_int4(min(max(high, -1.0f), last));
    return t;
}

/* The first and the last node of a row that the band around the triangle's plane can hold. */
inline int2 run_of_row(const Facet *t, float y, float z)
{
    float low = t->low.x, high = t->high.x;
    const float lies = (y - t->corner[0].y) * t->normal.y + (z - t->corner[0].z) * t->normal.z;
    const float steep = fabs(t->normal.x);
    if (steep > 0.01f) {
        const float middle = t->corner[0].x - lies / t->normal.x, half_way = DISTANCE_BAND / steep;
        low = max(low, middle - half_way);
        high = min(high, middle + half_way + 1.0f);
    }
    return (int2)((int)low, high < 0.0f ? -1 : (int)high);
}

/* The same of DOWN rows. */
inline int2 run_of(const Facet *t, int y, int z)
{
    int2 run = run_of_row(t, y, z);
    for (int down = 1; down < DOWN; ++down) {
        const int2 other = run_of_row(t, y + down, z);
        run = (int2)(other.x < run.x ? other.x : run.x, other.y > run.y ? other.y : run.y);
    }
    return run;
}

/* What of a triangle is nearest to nodes of rows. */
INLINED Nearest nearest_of(const Facet *t, lanes x, lanes y, float z)
{
    Nearest nearest = {F(1e30f), F(0.0f), F(0.0f)};
    lanes_i over = t->normal.x != 0.0f || t->normal.y != 0.0f || t->normal.z != 0.0f ? I(ON) : I(0);
    for (int i = 0; i < 3; ++i) {
        const float4 side = t->side[i], inward = t->inward[i], n = t->normal;
        lanes3 d = {x - t->corner[i].x, y - t->corner[i].y, F(z - t->corner[i].z)};
        over &= d.x * inward.x + d.y * inward.y + d.z * inward.z >= 0.0f;
        lanes along = (d.x * side.x + d.y * side.y + d.z * side.z) * t->inverse[i];
        const lanes height = d.x * n.x + d.y * n.y + d.z * n.z;   // a side has none
        if (i == 2)
            nearest.height = height;
        along = within(along, 0.0f, 1.0f);
        d.x -= along * side.x;
        d.y -= along * side.y;
        d.z -= along * side.z;
        const lanes square = dots(d, d);
        const lanes angle = along < AT_END ? F(t->angle[i]) : along > 1.0f - AT_END ? F(t->angle[(i + 1) % 3]) : F(HALF_TURN);
        nearest.angle = square < nearest.square ? angle : nearest.angle;
        nearest.square = lesser(square, nearest.square);
    }
    nearest.angle = over ? F(2.0f * HALF_TURN) : nearest.angle;
    nearest.square = over ? nearest.height * nearest.height : nearest.square;
    return nearest;
}

/* Where lanes lie from the first node of theirs: x, y. */
INLINED void spread(lanes *x, lanes *y)
{
    for (uint lane = 0; lane < LANES; ++lane) {
        LANE(*x, lane) = (float)(lane % ACROSS);
        LANE(*y, lane) = (float)(lane / ACROSS);
    }
}

/* One work-item offers a triangle's distances to every so manieth row of the nodes near it. */
__kernel void offer(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Distances grid,
    __global const float4 *positions,      // [V] world
    __global const uint4 *triangles,       // [T] three vertices
    const uint every,                      // work-items a triangle
    volatile __global uint *nearest)       // [nodes] distance in parts of a cell, NOTHING: far
{
    WORK_ITEM(item);
    const Facet t = facet_of(&grid, positions, triangles[item / every]);
    lanes right, down;
    spread(&right, &down);
    const int wide = (t.high.y - t.low.y + DOWN) / DOWN, rows = wide * (t.high.z - t.low.z + 1);
    for (int r = (int)(item % every); r < rows; r += (int)every) {
        const int y = t.low.y + r % wide * DOWN, z = t.low.z + r / wide;
        const int2 run = run_of(&t, y, z);
        volatile __global uint *row = nearest + ((size_t)z * grid.size.y + y) * grid.size.x;
        for (int x = run.x; x <= run.y; x += ACROSS) {
            const lanes at = (float)x + right, below = (float)y + down;
            const lanes_i there = at <= (float)run.y & below <= (float)t.high.y;
            const lanes square = nearest_of(&t, at, below, z).square;
            uint bits = bits_of(there & (square < (float)(DISTANCE_BAND * DISTANCE_BAND)));
            if (!bits)
                continue;
            const lanes_u distance = TO(lanes_u, exact_root(square) * CELL_ONE);
            for (; bits; bits &= bits - 1) {
                const int lane = first_of(bits), node = x + lane / ACROSS * grid.size.x + lane % ACROSS;
                if (LANE_U(distance, lane) < KNOWN(&row[node]))
                    atomic_min(&row[node], LANE_U(distance, lane));
            }
        }
    }
}

/* The same rows again: triangles that are as near as the nearest tell on which side of it nodes lie.  What is outside of a
   triangle is told by the normals of its corners, as for all else: faces may be wound either way. */
__kernel void weigh(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Distances grid,
    __global const float4 *positions,      // [V] world
    __global const float4 *normals,        // [V] unit
    __global const uint4 *triangles,       // [T] three vertices
    const uint every,                      // work-items a triangle
    __global const uint *nearest,          // [nodes] distance in parts of a cell, NOTHING: far
    volatile __global int *sums)           // [nodes] side, in TURN
{
    WORK_ITEM(item);
    const Facet t = facet_of(&grid, positions, triangles[item / every]);
    lanes right, down;
    spread(&right, &down);
    const int wide = (t.high.y - t.low.y + DOWN) / DOWN, rows = wide * (t.high.z - t.low.z + 1);
    if (t.normal.x == 0.0f && t.normal.y == 0.0f && t.normal.z == 0.0f)
        return;
    const uint4 corners = triangles[item / every];
    const float out = dot3(t.normal, normals[corners.x] + normals[corners.y] + normals[corners.z]) < 0.0f ? -TURN : TURN;
    for (int r = (int)(item % every); r < rows; r += (int)every) {
        const int y = t.low.y + r % wide * DOWN, z = t.low.z + r / wide;
        const int2 run = run_of(&t, y, z);
        const size_t row = ((size_t)z * grid.size.y + y) * grid.size.x;
        for (int x = run.x; x <= run.y; x += ACROSS) {
            const lanes at = (float)x + right, below = (float)y + down;
            const lanes_i there = at <= (float)run.y & below <= (float)t.high.y;
            lanes least = F(-1.0f);
            for (int lane = 0; lane < LANES; ++lane)
                if (LANE_I(there, lane))
                    LANE(least, lane) = nearest[row + x + lane / ACROSS * grid.size.x + lane % ACROSS] * (1.0f / CELL_ONE);
            const Nearest it = nearest_of(&t, at, below, z);
            const lanes distance = exact_root(it.square);
            const lanes share = 1.0f - (distance - least) * AS_NEAR;
            uint bits = bits_of(there & (share > 0.0f) & (distance < (float)DISTANCE_BAND));
            if (!bits)
                continue;
            const lanes side = out * lesser(share, F(1.0f)) * it.angle * it.height / greater(distance, F(1e-9f));
            for (; bits; bits &= bits - 1) {
                const int lane = first_of(bits);
                atomic_add(&sums[row + x + lane / ACROSS * grid.size.x + lane % ACROSS], (int)LANE(side, lane));
            }
        }
    }
}

__kernel void finish(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Distances grid,
    __global const uint *nearest,          // [nodes] distance in parts of a cell, NOTHING: far
    __global const int *sums,              // [nodes] side, in TURN
    __global float *values)                // [nodes] distance [world], below 0 inside; grid.reach.x where it is far
{
    WORK_ITEM(i);
    const float distance = nearest[i] * (grid.reach.y / CELL_ONE);
    values[i] = nearest[i] == NOTHING ? grid.reach.x : sums[i] < 0 ? -distance : distance;
}

/* Whether a node is one of which it is not known how far it is. */
inline bool is_far(const Distances *grid, float value)
{
    return value >= grid->reach.x;
}

/* One work-item goes along a row of nodes: where it is not known how far they are, but both ends of the gap are inside,
   they are inside too, as far as this row tells. */
__kernel void enclose(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Distances grid,
    const int4 row,                        // nodes of a row; from one to the next; rows side by side, from one to the next
    const int layer,                       // from one layer of such rows to the next [nodes]
    __global const float *values,          // [nodes] distance [world], below 0 inside; grid.reach.x where it is far
    __global int *enclosed,                // [nodes] rows that tell so; all three do inside of what is closed
    __global float *found)                 // [nodes] the same values; further than all where they are not known
{
    WORK_ITEM(i);
    const size_t first = i % row.z * row.w + i / row.z * layer;
    int since = 0;                         // nodes of the gap that are behind
    bool inside = false;
    for (int k = 0; k < row.x; ++k) {
        const size_t node = first + (size_t)k * row.y;
        const float value = values[node];
        found[node] = is_far(&grid, value) ? 1e30f : value;
        if (is_far(&grid, value)) {
            ++since;
            continue;
        }
        for (int back = 1; inside && value < 0.0f && back <= since; ++back)
            ++enclosed[node - (size_t)back * row.y];
        inside = value < 0.0f;
        since = 0;
    }
}

/* One work-item goes along a row and back: a node whose distance is not known is half a cell further than the one before it,
   or more, which the straight way in any direction is at least. */
__kernel void deepen(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Distances grid,
    const int4 row,                        // nodes of a row; from one to the next; rows side by side, from one to the next
    const int layer,                       // from one layer of such rows to the next [nodes]
    __global const float *values,          // [nodes] distance [world], below 0 inside; grid.reach.x where it is far
    __global const int *enclosed,          // [nodes] 3: inside
    const int last,                        // 1: of the axes
    __global float *found)                 // [nodes] distance [world], or less, below 0 inside; 1e30: not known yet
{
    WORK_ITEM(i);
    const size_t first = i % row.z * row.w + i / row.z * layer;
    for (int back = 0; back < 2; ++back) {
        float size = 1e30f;
        for (int k = 0; k < row.x; ++k) {
            const size_t node = first + (size_t)(back ? row.x - 1 - k : k) * row.y;
            const bool is_known = !is_far(&grid, values[node]);
            size = is_known ? fabs(found[node]) : min(fabs(found[node]), size + 0.5f * grid.reach.y);
            if (!is_known)
                found[node] = last && back && enclosed[node] == 3 ? -size : size;
        }
    }
}

__kernel void between(
    const ulong begin, const ulong end,    // work-items, see common.h
    const float share,                     // 0: before, 1: now
    __global const float *before,          // [nodes] distance [world]
    __global const float *now,             // [nodes]
    __global float *found)                 // [nodes]
{
    WORK_ITEM(i);
    found[i] = before[i] + share * (now[i] - before[i]);
}

/* Segments side by side, one of each strand. */
typedef struct {
    lanes3 at, ahead;    // where it begins [world], which way it goes, unit
    lanes length;        // [world]
    lanes free;          // distance from the body where it begins, or less; after `go_along` where it ends
    lanes away;          // distance from the body that it must keep
} Going;

/* Any vector of length one across a unit one. */
INLINED lanes3 across_of(lanes3 v)
{
    const lanes3 x = {F(0.0f), -v.z, v.y}, y = {v.z, F(0.0f), -v.x};
    const lanes3 across = chosen(v.y * v.y + v.z * v.z > 0.5f, x, y);
    return scaled(across, 1.0f / exact_root(greater(dots(across, across), F(1e-12f))));
}

/* Segments that are `asked` for are looked at from place to place, and where one is too near the body it is turned about its
   beginning till it is not, by Newton's method. -> which were turned. */
INLINED lanes_i go_along(const Distances *grid, __global const float *values, lanes_i asked, Going *s)
{
    const float least_lack = grid->reach.y * (1.0f / 128);
    const lanes pace = greater(F(grid->reach.y), s->length * (1.0f / SLIDE_PLACES));
    lanes r = lesser(greater(s->free - s->away, pace), s->length);
    lanes_i going = asked, turned = I(0);
    for (int look = 0; look < SLIDE_LOOKS && any_lane(going); ++look) {
        const Near near = near_at(grid, values, going, plus(s->at, scaled(s->ahead, r)));
        const lanes lack = s->away - near.value;
        const lanes_i in = going & (lack > least_lack), out = going & ~in, ended = out & (r >= s->length);
        if (any_lane(in)) {
            lanes3 up = minus(near.slope, scaled(s->ahead, dots(near.slope, s->ahead)));
            lanes rise = exact_root(dots(up, up));
            const lanes_i straight = rise < 0.02f;                 // in, or out again
            up = chosen(straight, across_of(s->ahead), scaled(up, 1.0f / greater(rise, F(0.02f))));
            const lanes turn = straight ? F(0.25f) : lesser(lack / (r * rise), F(1.0f));
            const lanes3 ahead = plus(s->ahead, scaled(up, turn));
            s->ahead = chosen(in, scaled(ahead, 1.0f / exact_root(dots(ahead, ahead))), s->ahead);
            turned |= in;
        }
        s->free = going ? near.value : s->free;
        r = out ? lesser(r + greater(near.value - s->away, pace), s->length) : r;
        going &= ~ended;
    }
    return turned;
}

/* One work-item slides LANES strands along the body, from root to tip.  A segment may not come nearer than half its width;
   but one that begins nearer, as at a root, may stay about as near.  Strands that are not turned keep their bits. */
BY_HAND __kernel void slide(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Distances grid,
    __global const float *values,          // [nodes] distance [world], below 0 inside
    const uint n,                          // strands
    const uint2 stretch,                   // segments of each: first, one past the last
    __global const uint2 *spans,           // [strands] first point, points
    __global float4 *points,               // [points] x, y, z, width [world]
    __global float4 *states)               // [strands] where a stretch ends: the point as it came; distance from the body
{
    WORK_ITEM(block);
    const uint first = (uint)block * LANES, here = n - first < LANES ? n - first : LANES;
    const uint k0 = stretch.x;
    Going s;
    lanes3 came = {F(0.0f), F(0.0f), F(0.0f)}, next;
    lanes width = F(0.0f);
    lanes_u place = U(0), count = U(0);
    s.at = came;
    s.free = F(0.0f);
    for (uint lane = 0; lane < here; ++lane) {
        const uint2 span = spans[first + lane];
        if (span.y <= k0 + 1)
            continue;
        LANE_U(place, lane) = span.x;
        LANE_U(count, lane) = span.y;
        const float4 p = points[span.x + k0], state = k0 ? states[first + lane] : p;
        put_lane(&s.at, lane, p);
        put_lane(&came, lane, state);
        LANE(s.free, lane) = state.w;
    }
    if (!k0)
        s.free = near_at(&grid, values, I(ON), s.at).value;
    lanes_i moved = s.at.x != came.x | s.at.y != came.y | s.at.z != came.z;
    const uint most = (uint)most_lane(AS_I(count)), last = most - 1 < stretch.y ? most - 1 : stretch.y;
    for (uint k = k0; most && k < last; ++k) {
        next = came;
        for (uint lane = 0; lane < here; ++lane)
            if (k + 1 < LANE_U(count, lane)) {
                const float4 p = points[LANE_U(place, lane) + k + 1];
                put_lane(&next, lane, p);
                LANE(width, lane) = p.w;
            }
        const lanes3 way = minus(next, came);
        s.length = exact_root(dots(way, way));
        s.ahead = scaled(way, 1.0f / greater(s.length, F(1e-30f)));
        s.away = lesser(0.5f * width, s.free + 0.1f * s.length);
        const lanes_i asked = U(k + 1) < count & s.length > 0.0f & s.free - s.length < s.away;
        const lanes3 before = s.at;
        lanes_i turned = I(0);
        s.free = asked ? s.free : s.free - s.length;
        if (any_lane(asked))
            turned = go_along(&grid, values, asked, &s);
        s.at = chosen(moved | turned, plus(before, chosen(turned, scaled(s.ahead, s.length), way)), next);
        moved |= turned;
        came = next;
        uint bits = bits_of(moved & (U(k + 1) < count));
        for (; bits; bits &= bits - 1) {
            const int lane = first_of(bits);
            points[LANE_U(place, lane) + k + 1].xyz = lane_of(&s.at, lane);
        }
    }
    for (uint lane = 0; lane < here; ++lane)
        if (last < LANE_U(count, lane) - 1 && LANE_U(count, lane))
            states[first + lane] = (float4)(lane_of(&came, lane), LANE(s.free, lane));
}
