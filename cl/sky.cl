/*
 * A sky that hair and body hide, in one grid of the world: what each cell holds of hair, with the second moment of its
 * directions, and of the body, in integers; then how much of each direction's light reaches each cell, slice by slice; then
 * all of it as spherical harmonics.
 */

#if LANES == 32
#undef LANES
#define LANES 16                           // n is a multiple of that
#endif
#include "lanes.h"
#include "light.h"
#include "sky.h"
#define OF_CELL MOMENTS
#include "nearby.h"

#define PARTS 4                            // of a cell's side: columns of the body
#define STEPS 2                            // along hair
#define WHOLE (PARTS * PARTS * SUBPIXEL)   // of a cell that is all body
#define HOLDS (MOMENTS + 1)                // numbers of what a cell holds: of hair, and of the body
#define FAINT 1e-6f                      // light that is left out: a CPU is slow with numbers that are next to nothing

#if LANES == 1
typedef float loose;                       // of cells that begin anywhere
#else
typedef lanes loose __attribute__((aligned(4)));
#endif

/* Of one strand: (1 - alpha) · width · length over a cell's face, times the second moment of its direction, whose trace is 1. */
INLINED void leave_strand(volatile __global int *moments, Nearby *nearby, const Sky *sky, __global const float4 *points,
                          uint2 span, float opaque, float unit)
{
    const float scale = sky->place.w;
    const int n = sky->size.x;
    float sums[MOMENTS];
    int4 cell = -1;
    for (int j = 0; j < MOMENTS; ++j)
        sums[j] = 0.0f;
    for (uint k = 0; k + 1 < span.y; ++k) {
        const float4 a = points[span.x + k], d = points[span.x + k + 1] - a;
        const float square = dot3(d, d), length = sqrt(square) * scale;
        if (!(square > 0.0f))
            continue;
        const int steps = length * STEPS < 4096.0f ? (int)(length * STEPS) + 1 : 4096;
        const float one = 1.0f / steps, part = opaque * scale * length * one / square;
        for (int i = 0; i < steps; ++i) {
            const float4 p = a + ((i + 0.5f) * one) * d, c = (p - sky->place) * scale;
            if (!(c.x >= 0.0f && c.y >= 0.0f && c.z >= 0.0f && c.x < n && c.y < n && c.z < n))
                continue;
            const int4 here = (int4)((int)c.x, (int)c.y, (int)c.z, 0);
            if (here.x != cell.x || here.y != cell.y || here.z != cell.z) {
                if (cell.x >= 0)
                    leave(moments, nearby, cell, n, 0, sums, unit);
                for (int j = 0; j < MOMENTS; ++j)
                    sums[j] = 0.0f;
                cell = here;
            }
            const float amount = part * p.w;
            sums[0] += amount * (d.x * d.x), sums[1] += amount * (d.y * d.y), sums[2] += amount * (d.z * d.z);
            sums[3] += amount * (d.x * d.y), sums[4] += amount * (d.x * d.z), sums[5] += amount * (d.y * d.z);
        }
    }
    if (cell.x >= 0)
        leave(moments, nearby, cell, n, 0, sums, unit);
}

/* One work-item adds up what some strands leave in cells. */
__kernel void deposit(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    const uint n_strands,
    const uint each,                       // strands of a work-item
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] -, -, type
    __global const HairType *types,
    const float unit,                      // integers for 1
    volatile __global int *moments)        // [n, n, n, MOMENTS]
{
    WORK_ITEM(item);
    Nearby nearby;
    begin_nearby(&nearby);
    const uint first = each * (uint)item;
    for (uint strand = first; strand < n_strands && strand < first + each; ++strand) {
        const float opaque = 1.0f - types[(int)strand_uv[strand].z].shine.z;
        leave_strand(moments, &nearby, &sky, points, spans[strand], opaque, unit);
    }
    end_nearby(moments, &nearby);
}

/* A coordinate in 1/SUBPIXEL of a part of a cell. */
INLINED int snapped(float place, float low, float scale, int n)
{
    const float at = (place - low) * scale * (PARTS * SUBPIXEL), most = (float)n * (PARTS * SUBPIXEL) - 1.0f;
    return (int)floor(at > 0.0f ? at < most ? at : most : 0.0f);
}

/* Where the columns of cells' parts along an axis meet one triangle: what lies before it along the axis is body if the triangle
   faces that way, and what lies before one that faces back is taken away again. p: corners, axis: along, next: across it;
   first, last: columns whose middles may lie in it. */
INLINED void met_along(volatile __global int *solids, int n, const int4 *p, int axis, int4 first, int4 last)
{
    const int one = axis == 0 ? 1 : 0, two = axis == 2 ? 1 : 2, facing = axis == 1 ? -1 : 1, stride[3] = {1, n, n * n};
    long at[3][3];                         // of each corner: along, across, across
    for (int i = 0; i < 3; ++i) {
        const int xyz[3] = {p[i].x, p[i].y, p[i].z};
        at[i][0] = xyz[axis], at[i][1] = xyz[one], at[i][2] = xyz[two];
    }
    const long area = (at[1][1] - at[0][1]) * (at[2][2] - at[0][2]) - (at[1][2] - at[0][2]) * (at[2][1] - at[0][1]);
    if (area == 0)
        return;
    const int sign = area > 0 ? 1 : -1, low[3] = {first.x, first.y, first.z}, high[3] = {last.x, last.y, last.z};
    for (int v = low[two]; v < high[two]; ++v)
        for (int u = low[one]; u < high[one]; ++u) {
            const long x = u * SUBPIXEL + SUBPIXEL / 2, y = v * SUBPIXEL + SUBPIXEL / 2;
            long along = 0;
            bool inside = true;
            for (int i = 0; i < 3; ++i) {   // a place on a side belongs to one of the two triangles there
                const int a = i == 2 ? 0 : i + 1, b = i == 0 ? 2 : i - 1;
                const long dx = sign * (at[b][1] - at[a][1]), dy = sign * (at[b][2] - at[a][2]);
                const long edge = dx * (y - at[a][2]) - dy * (x - at[a][1]);
                inside &= edge > 0 || (edge == 0 && (dy > 0 || (dy == 0 && dx < 0)));
                along += edge * at[i][0];
            }
            if (!inside)
                continue;
            const int z = (int)(along / (sign * area)) / PARTS, layer = z / SUBPIXEL, part = z - layer * SUBPIXEL;
            const size_t column = (size_t)(u / PARTS) * stride[one] + (size_t)(v / PARTS) * stride[two];
            volatile __global int *there = solids + (size_t)axis * n * n * n + column;
            atomic_add(&there[(size_t)layer * stride[axis]], sign * facing * part);
            if (layer)
                atomic_add(&there[(size_t)(layer - 1) * stride[axis]], sign * facing * (SUBPIXEL - part));
        }
}

/* One work-item tells where the columns of cells' parts along each axis meet one triangle. Most are too small to meet any. */
__kernel void surface(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    __global const float4 *positions,      // body: see tessellate.cl
    __global const uint4 *triangles,
    volatile __global int *solids)         // [3, n, n, n] changes of solid, in 1/WHOLE
{
    WORK_ITEM(triangle);
    const uint4 t = triangles[triangle];
    const uint corner[3] = {t.x, t.y, t.z};
    const int n = sky.size.x;
    const float4 low = sky.place;
    int4 p[3];
    for (int i = 0; i < 3; ++i) {
        const float4 at = positions[corner[i]];
        p[i] = (int4)(snapped(at.x, low.x, low.w, n), snapped(at.y, low.y, low.w, n), snapped(at.z, low.z, low.w, n), 0);
    }
    int4 least = p[0] < p[1] ? p[0] : p[1], most = p[0] > p[1] ? p[0] : p[1];
    least = least < p[2] ? least : p[2], most = most > p[2] ? most : p[2];
    const int4 first = (least + (SUBPIXEL / 2 - 1)) / SUBPIXEL, last = (most + SUBPIXEL / 2) / SUBPIXEL;
    const bool x = first.x < last.x, y = first.y < last.y, z = first.z < last.z;
    if (y && z)
        met_along(solids, n, p, 0, first, last);
    if (x && z)
        met_along(solids, n, p, 1, first, last);
    if (x && y)
        met_along(solids, n, p, 2, first, last);
}

/* One work-item sums the changes of one column along one axis, from its far end. */
__kernel void fill(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    __global int *solids)                  // [3, n, n, n] in 1/WHOLE
{
    WORK_ITEM(item);
    const int axis = item / (n * n), rest = item % (n * n), u = rest % n, v = rest / n;
    const size_t across[3] = {(size_t)u * n + (size_t)v * n * n, (size_t)u + (size_t)v * n * n, (size_t)u + (size_t)v * n};
    const int along = axis == 0 ? 1 : axis == 1 ? n : n * n;
    __global int *column = solids + (size_t)axis * n * n * n + across[axis];
    int sum = 0;
    for (int k = n - 1; k >= 0; --k) {
        sum += column[(size_t)k * along];
        column[(size_t)k * along] = sum;
    }
}

/* One work-item tells what one cell holds. An axis alone would take what lies below an open surface for body. */
__kernel void contents(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,
    const float unit,                      // integers for 1
    __global const int *moments,           // [n, n, n, MOMENTS]
    const int is_body,                     // 1: there is one
    __global const int *solids,            // [3, n, n, n] in 1/WHOLE, if so
    __global float *held)                  // [2, HOLDS, n, n, n] xx, yy, zz, xy, xz, yz of hair; share that is body; by z, y, x
                                           // and by x, z, y
{
    WORK_ITEM(cell);
    const uint here = cell, side = n, x = here % side, y = here / side % side, z = here / (side * side);
    const size_t cells = (size_t)n * n * n, turned = (x * side + z) * side + y;
    const float one = 1.0f / unit;         // a power of two
    float solid = is_body ? 1.0f : 0.0f;
    for (int axis = 0; is_body && axis < 3; ++axis) {
        const int many = solids[axis * cells + cell];
        const float share = (float)(many < 0 ? -many : many) / WHOLE;
        solid = share < solid ? share : solid;
    }
    for (int j = 0; j < HOLDS; ++j) {
        const float value = j < MOMENTS ? moments[cell * MOMENTS + j] * one : solid;
        held[j * cells + cell] = value;
        held[(HOLDS + j) * cells + turned] = value;
    }
}

/* One direction's way through the cells: along an axis by slices of rows, in each of which cells lie side by side. */
typedef struct {
    float4 towards;                        // unit
    float length;                          // of its way through a slice, in sides of a cell
    bool upwards;                          // whether the last slice is the first one that light meets
    int forward, down;                     // cells held from slice to slice and from row to row
    int step, level;                       // which cell of the slice before comes to the first one, along and across rows
    float between, above;                  // and how far on to the next ones
    int along, across, aside;              // in `through`: from cell to cell of a row, from row to row, from slice to slice
} Way;

INLINED Way way_of(float4 w, int n)
{
    const float ax = fabs(w.x), ay = fabs(w.y), az = fabs(w.z);
    const int axis = ax >= ay && ax >= az ? 0 : ay >= az ? 1 : 2, square = n * n;
    const float ahead = axis == 0 ? w.x : axis == 1 ? w.y : w.z, length = 1.0f / fabs(ahead);
    const float du = (axis == 0 ? w.y : w.x) * length, dv = (axis == 2 ? w.y : w.z) * length;
    const int step = (int)floor(du), level = (int)floor(dv);
    const Way way = {w, length, ahead > 0.0f, axis == 1 ? n : square, axis == 1 ? square : n,
                     step, level, du - step, dv - level, axis == 0 ? n : 1, axis == 2 ? n : square, axis == 0 ? 1 : axis == 1 ? n : square};
    return way;
}

/* The light that comes to LANES cells of a row, from between four of the slice before. */
INLINED lanes between_rows(__global const float *before, int width, const Way *way)
{
    __global const float *next = before + width;
    const lanes a = *(__global const loose *)before, b = *(__global const loose *)(before + 1);
    const lanes c = *(__global const loose *)next, d = *(__global const loose *)(next + 1);
    const lanes low = a + way->between * (b - a), high = c + way->between * (d - c);
    return low + way->above * (high - low);
}

/* Optical depth of LANES cells along a way; planes: of what they hold. */
INLINED lanes depth_of(__global const float *planes, size_t cells, const Way *way)
{
    const float4 w = way->towards;
    lanes m[MOMENTS];
    for (int j = 0; j < MOMENTS; ++j)
        m[j] = *(__global const lanes *)(planes + j * cells);
    const lanes d = m[0] + m[1] + m[2];
    const lanes along = w.x * w.x * m[0] + w.y * w.y * m[1] + w.z * w.z * m[2]
        + 2.0f * (w.x * w.y * m[3] + w.x * w.z * m[4] + w.y * w.z * m[5]);
    return full_root(d * d - d * along) * way->length;
}

/* One work-item takes the light of one direction through rows of slices of cells across it. What a cell has of a body hides
   what lies behind the cell alone: so the body's surface, which looks up cells on both sides of it, gets what comes to it; and
   only what is more than half a body hides, as light that passes close to it would else be lost. On a body lies all of a
   cell's hair before it, in a cell without one half. */
BY_HAND __kernel void sweep(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,                           // cells a side, a multiple of 16
    const int2 turns,                      // slices: the first one, 0 is that which light meets first; one past the last
    const int rows,                        // of a slice that a work-item takes: all, where there is more than one slice
    __global const float *held,            // [2, HOLDS, n, n, n], see `contents`
    __global const float4 *directions,     // [directions] unit, towards the light
    __global float *behind,                // [directions, 2, (n + 2 SKY_EDGE)²] what is left behind a slice and the one before;
                                           // all 1 at first
    __global float *through)               // [directions, n, n, n] what reaches the middles of cells
{
    WORK_ITEM(item);
    const size_t number = item / (n / rows), cells = (size_t)n * n * n;
    const int first = (int)(item % (n / rows)) * rows, width = n + 2 * SKY_EDGE;
    const Way way = way_of(directions[number], n);
    __global const float *planes = held + (way.along == 1 ? 0 : HOLDS * cells);
    __global float *own = behind + 2 * number * width * width + SKY_EDGE * width + SKY_EDGE;
    for (int turn = turns.x; turn < turns.y; ++turn) {
        const int slice = way.upwards ? n - 1 - turn : turn;
        __global float *here = own + (turn & 1) * width * width;
        __global const float *before = own + (1 - (turn & 1)) * width * width + way.level * width + way.step;
        for (int v = first; v < first + rows; ++v)
            for (int u = 0; u < n; u += LANES) {
                __global const float *these = planes + slice * way.forward + v * way.down + u;
                const lanes come = between_rows(before + v * width + u, width, &way);
                const lanes solid = *(__global const lanes *)(these + MOMENTS * cells), depth = depth_of(these, cells, &way);
                lanes there = come, left = solid > 0.5f ? come * (2.0f - 2.0f * solid) : come;
                if (any_lane(depth > 0.0f)) {
                    const lanes lost = lesser(depth * 1.44269504f, F(100.0f));   // as a power of two
                    there *= exp2_of(lost * (-0.5f - 0.5f * solid));
                    left *= exp2_of(-lost);
                    there = there > FAINT ? there : F(0.0f);
                    left = left > FAINT ? left : F(0.0f);
                }
                *(__global loose *)(here + v * width + u) = left;
                __global float *out = through + number * cells + slice * way.aside + v * way.across + u * way.along;
                if (LANES == 1 || way.along == 1)
                    *(__global lanes *)out = there;
                else
                    for (int k = 0; k < LANES; ++k)
                        out[k * way.along] = LANE(there, k);
            }
    }
}

/* One work-item adds up the light of all directions in LANES cells. */
BY_HAND __kernel void gather(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int n,                           // cells a side, a multiple of 16
    const int n_directions,
    __global const float *through,         // [directions, n, n, n]
    __global const float *table,           // [directions, HARMONICS, 4] r, g, b of each direction's light
    __global float *cells)                 // [n, n, n, HARMONICS, 4] r, g, b
{
    WORK_ITEM(item);
    const size_t first = LANES * item, count = (size_t)n * n * n;
    for (int c = 0; c < 3; ++c) {          // nine sums stay in registers
        lanes sums[HARMONICS];
        for (int j = 0; j < HARMONICS; ++j)
            sums[j] = F(0.0f);
        for (int i = 0; i < n_directions; ++i) {
            const lanes share = *(__global const lanes *)(through + i * count + first);
            for (int j = 0; j < HARMONICS; ++j)
                sums[j] += share * table[(i * HARMONICS + j) * 4 + c];
        }
        for (int k = 0; k < LANES; ++k)
            for (int j = 0; j < HARMONICS; ++j)
                cells[((first + k) * HARMONICS + j) * 4 + c] = LANE(sums[j], k);
    }
    for (int k = 0; k < LANES * HARMONICS; ++k)
        cells[(first * HARMONICS + k) * 4 + 3] = 0.0f;
}

/* What reaches a place of some light, at `from` in cells: where it leaves the grid on its way `w` there, or 1 beside it. */
INLINED float share_from(__global const float *through, int n, float4 from, float4 w)
{
    const float start[3] = {from.x, from.y, from.z}, along[3] = {w.x, w.y, w.z};
    float first = 0.0f, last = INFINITY;
    for (int i = 0; i < 3; ++i) {
        const float a = (along[i] > 0.0f ? 0.0f : n) - start[i], b = (along[i] > 0.0f ? n : 0.0f) - start[i];
        const bool level = !(fabs(along[i]) > 1e-6f);
        const float near = level ? (start[i] > 0.0f && start[i] < n ? 0.0f : INFINITY) : a / along[i];
        const float far = level ? INFINITY : b / along[i];
        first = near > first ? near : first;
        last = far < last ? far : last;
    }
    if (!(first < last))
        return 1.0f;
    const Between here = between_these(n, from + first * w);
    float sum = 0.0f;
    for (int k = 0; k < 8; ++k)
        sum += corner_weight(&here, k) * through[here.first + ((k >> 2) * n + (k >> 1 & 1)) * n + (k & 1)];
    return sum;
}

/* One work-item adds up what comes of some directions to one place of a level plane. */
__kernel void plane(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    const OnGround plane,
    const int n_directions,
    const float share,                     // of all directions that these are
    __global const float4 *directions,     // [directions] unit, towards the light, upwards
    __global const float4 *light,          // [directions] r, g, b that each sends to the plane
    __global const float *through,         // [directions, n, n, n], see `sweep`
    __global float4 *squares)              // [side, side] r, g, b at their middles
{
    WORK_ITEM(item);
    const int n = sky.size.x, side = plane.size.x;
    const float u = ((int)(item % side) + 0.5f) * (2.0f / side) - 1.0f, v = ((int)(item / side) + 0.5f) * (2.0f / side) - 1.0f;
    const float far = sqrt(u * u + v * v), wide = far < 1.0f ? 1.0f / (1.0f - far) : 0.0f;
    const float x = plane.place.x + u * wide / plane.place.z, z = plane.place.y + v * wide / plane.place.w;
    const float4 from = ((float4)(x, plane.whole.w, z, 0.0f) - sky.place) * sky.place.w;
    float4 sum = wide > 0.0f ? (float4)(0.0f) : (float4)(plane.whole.xyz, 0.0f) * share;
    for (int i = 0; i < n_directions && wide > 0.0f; ++i)
        sum += share_from(through + (size_t)i * n * n * n, n, from, directions[i]) * light[i];
    squares[item] += sum;
}

/* Light that a point of a strand gets from all around its fibre, between the points beside it. */
INLINED float4 light_of_point(float4 before, float4 after, const Known *known)
{
    const float4 along = (float4)((after - before).xyz, 0.0f);
    return light_around(known, unit_or(along, (float4)(0.0f, 1.0f, 0.0f, 0.0f)), 0.0f, -0.125f);
}

/* |a - b| */
INLINED float apart(float4 a, float4 b)
{
    const float4 d = a - b;
    return sqrt(dot3(d, d));
}

/* One work-item tells the light that some points of strands get from all around their fibres. What cells have is looked up at
   every `far`th of a strand's points, where these are within a cell, and lies on a line between. */
__kernel void at_points(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    __global const float4 *cells,          // [n, n, n, HARMONICS]
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    const uint run,
    const uint n_points,
    const uint each,                       // points of a work-item
    __global float4 *light)                // [points] r, g, b
{
    WORK_ITEM(item);
    uint id = each * (uint)item, known_to = n_points;
    const uint until = n_points - id < each ? n_points : id + each;
    const float most = 1.6f / sky.place.w;
    Known from, to;
    while (id < until) {
        const uint2 span = spans[strand_of[id / run]];
        const uint past = span.x + span.y;
        if (id < span.x || id >= past) {   // no strand's
            light[id++] = (float4)(0.0f);
            continue;
        }
        const float length = span.y > 1 ? apart(points[span.x], points[span.x + 1]) : 0.0f;
        uint far = 4.0f * length < most ? 4 : 2.0f * length < most ? 2 : 1, first = id - (id - span.x) % far;
        uint last = first + far < past ? first + far : past - 1;
        float way = 0.0f;
        for (uint k = first; k < last && run == 1; ++k)
            way += apart(points[k], points[k + 1]);
        if (way > 2.0f * most)             // of the user's strands, others may be longer than the first
            far = 1, first = id, last = id + 1 < past ? id + 1 : id;
        if (first != known_to)
            to = known_at(&sky, cells, points[first], false);
        from = to;
        if (last != first)
            to = known_at(&sky, cells, points[last], false);
        known_to = last;
        const uint stop = last + 1 < past ? last : past;
        float4 here = points[id], before = points[id > span.x ? id - 1 : id];
        for (; id < stop && id < until; ++id) {
            const float4 after = points[id + 1 < past ? id + 1 : id];
            const float share = last == first ? 0.0f : (float)(id - first) / (last - first);
            Known known;
            known.of[0] = from.of[0] + share * (to.of[0] - from.of[0]);
            for (int j = 4; j < HARMONICS; ++j)   // order 1 is not a fibre's
                known.of[j] = from.of[j] + share * (to.of[j] - from.of[j]);
            light[id] = light_of_point(before, after, &known);
            before = here, here = after;
        }
    }
}
