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

#define PARTS 4                            // of a cell's side: columns of the body, and steps along hair
#define WHOLE (PARTS * PARTS * SUBPIXEL)   // of a cell that is all body
#define HOLDS (MOMENTS + 1)                // numbers of what a cell holds: of hair, and of the body
#define EDGE 2                             // cells around a slice, through which all light comes

#if LANES == 1
typedef float loose;                       // of cells that begin anywhere
#else
typedef lanes loose __attribute__((aligned(4)));
#endif

/* What a strand has left in one cell. */
INLINED void leave(volatile __global int *moments, size_t cell, const float *sums, float unit)
{
    for (int j = 0; j < MOMENTS; ++j)
        atomic_add(&moments[cell * MOMENTS + j], (int)floor(sums[j] * unit + 0.5f));
}

/* One work-item adds up, for one strand, (1 - alpha) · width · length over a cell's face, times the second moment of its
   direction, whose trace is 1. */
__kernel void deposit(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] -, -, type
    __global const HairType *types,
    const float unit,                      // integers for 1
    volatile __global int *moments)        // [n, n, n, MOMENTS]
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const float opaque = 1.0f - types[(int)strand_uv[strand].z].shine.z, scale = sky.place.w;
    const int n = sky.size.x;
    float sums[MOMENTS];
    long cell = -1;
    for (int j = 0; j < MOMENTS; ++j)
        sums[j] = 0.0f;
    for (uint k = 0; k + 1 < span.y; ++k) {
        const float4 a = points[span.x + k], d = points[span.x + k + 1] - a;
        const float square = dot3(d, d), length = sqrt(square) * scale;
        if (!(square > 0.0f))
            continue;
        const int steps = length * PARTS < 4096.0f ? (int)(length * PARTS) + 1 : 4096;
        const float each = opaque * length * scale / steps;
        for (int i = 0; i < steps; ++i) {
            const float4 p = a + ((i + 0.5f) / steps) * d;
            const float4 c = (p - sky.place) * scale;
            if (!(c.x >= 0.0f && c.y >= 0.0f && c.z >= 0.0f && c.x < n && c.y < n && c.z < n))
                continue;
            const long here = ((long)(int)c.z * n + (int)c.y) * n + (int)c.x;
            if (here != cell) {
                if (cell >= 0)
                    leave(moments, cell, sums, unit);
                for (int j = 0; j < MOMENTS; ++j)
                    sums[j] = 0.0f;
                cell = here;
            }
            const float amount = each * p.w / square;
            sums[0] += amount * (d.x * d.x), sums[1] += amount * (d.y * d.y), sums[2] += amount * (d.z * d.z);
            sums[3] += amount * (d.x * d.y), sums[4] += amount * (d.x * d.z), sums[5] += amount * (d.y * d.z);
        }
    }
    if (cell >= 0)
        leave(moments, cell, sums, unit);
}

/* A coordinate in 1/SUBPIXEL of `parts` of a cell. */
INLINED int snapped(float place, float low, float scale, int n, int parts)
{
    const float at = (place - low) * scale * (parts * SUBPIXEL), most = (float)n * (parts * SUBPIXEL) - 1.0f;
    return (int)floor(at > 0.0f ? at < most ? at : most : 0.0f);
}

/* One work-item tells where the columns of cells' parts along an axis meet one triangle: what lies before it along the axis
   is body if the triangle faces that way, and what lies before one that faces back is taken away again. */
__kernel void surface(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    const int axis,                        // 0, 1, 2
    __global const float4 *positions,      // body: see tessellate.cl
    __global const uint4 *triangles,
    volatile __global int *solids)         // [3, n, n, n] changes of solid, in 1/WHOLE
{
    WORK_ITEM(triangle);
    const uint4 t = triangles[triangle];
    const uint corner[3] = {t.x, t.y, t.z};
    const int n = sky.size.x, place[3] = {axis, axis == 2 ? 0 : axis + 1, axis == 0 ? 2 : axis - 1};
    const int stride[3] = {1, n, n * n};
    long p[3][3];                          // of each corner: along, across, across
    for (int i = 0; i < 3; ++i) {
        const float4 at = positions[corner[i]];
        const float xyz[3] = {at.x, at.y, at.z}, low[3] = {sky.place.x, sky.place.y, sky.place.z};
        for (int j = 0; j < 3; ++j)
            p[i][j] = snapped(xyz[place[j]], low[place[j]], sky.place.w, n, j ? PARTS : 1);
    }
    const long area = (p[1][1] - p[0][1]) * (p[2][2] - p[0][2]) - (p[1][2] - p[0][2]) * (p[2][1] - p[0][1]);
    if (area == 0)
        return;
    const int sign = area > 0 ? 1 : -1;
    long first[2], last[2];
    for (int j = 0; j < 2; ++j) {
        const long a = p[0][j + 1], b = p[1][j + 1], c = p[2][j + 1];
        first[j] = (min(a, min(b, c)) + SUBPIXEL / 2 - 1) / SUBPIXEL;
        last[j] = min((max(a, max(b, c)) + SUBPIXEL / 2) / SUBPIXEL, (long)n * PARTS);
    }
    for (long v = first[1]; v < last[1]; ++v)
        for (long u = first[0]; u < last[0]; ++u) {
            const long x = u * SUBPIXEL + SUBPIXEL / 2, y = v * SUBPIXEL + SUBPIXEL / 2;
            long along = 0;
            bool inside = true;
            for (int i = 0; i < 3; ++i) {   // a place on a side belongs to one of the two triangles there
                const int a = i == 2 ? 0 : i + 1, b = i == 0 ? 2 : i - 1;
                const long dx = sign * (p[b][1] - p[a][1]), dy = sign * (p[b][2] - p[a][2]);
                const long edge = dx * (y - p[a][2]) - dy * (x - p[a][1]);
                inside &= edge > 0 || (edge == 0 && (dy > 0 || (dy == 0 && dx < 0)));
                along += edge * p[i][0];
            }
            if (!inside)
                continue;
            const int z = (int)(along / (sign * area)), layer = z / SUBPIXEL, part = z - layer * SUBPIXEL;
            const size_t column = (size_t)(u / PARTS) * stride[place[1]] + (size_t)(v / PARTS) * stride[place[2]];
            volatile __global int *there = solids + (size_t)axis * n * n * n + column;
            atomic_add(&there[(size_t)layer * stride[axis]], sign * part);
            if (layer)
                atomic_add(&there[(size_t)(layer - 1) * stride[axis]], sign * (SUBPIXEL - part));
        }
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
    const size_t cells = (size_t)n * n * n, turned = ((cell % n) * n + cell / (n * n)) * n + cell / n % n;
    float solid = is_body ? 1.0f : 0.0f;
    for (int axis = 0; is_body && axis < 3; ++axis) {
        const float share = fabs((float)solids[axis * cells + cell]) / WHOLE;
        solid = share < solid ? share : solid;
    }
    for (int j = 0; j < HOLDS; ++j) {
        const float value = j < MOMENTS ? moments[cell * MOMENTS + j] / unit : solid;
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
    const Way way = {w, length, ahead > 0.0f, axis == 1 ? n : square, axis == 1 ? square : n, step, level, du - step, dv - level,
                     axis == 0 ? n : 1, axis == 2 ? n : square, axis == 0 ? 1 : axis == 1 ? n : square};
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
    __global float *behind,                // [directions, 2, n + 2 EDGE, n + 2 EDGE] what is left behind a slice and the
                                           // one before; all 1 at first
    __global float *through)               // [directions, n, n, n] what reaches the middles of cells
{
    WORK_ITEM(item);
    const size_t number = item / (n / rows), cells = (size_t)n * n * n;
    const int first = (int)(item % (n / rows)) * rows, width = n + 2 * EDGE;
    const Way way = way_of(directions[number], n);
    __global const float *planes = held + (way.along == 1 ? 0 : HOLDS * cells);
    __global float *own = behind + 2 * number * width * width + EDGE * width + EDGE;
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
}

/* One work-item looks up the light that one point of strands gets from all around its fibre. */
__kernel void at_points(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Sky sky,
    __global const float4 *cells,          // [n, n, n, HARMONICS]
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    const uint run,
    __global float4 *light)                // [points] r, g, b
{
    WORK_ITEM(id);
    const uint2 span = spans[strand_of[id / run]];
    const uint last = span.x + span.y;
    const float4 here = points[id];
    const float4 before = id > span.x && id < last ? points[id - 1] : here;
    const float4 after = id + 1 < last && id >= span.x ? points[id + 1] : here;
    const float4 along = (float4)((after - before).xyz, 0.0f);
    light[id] = sky_light(&sky, cells, here, unit_or(along, (float4)(0.0f, 1.0f, 0.0f, 0.0f)), 0.0f, -0.125f);
}
