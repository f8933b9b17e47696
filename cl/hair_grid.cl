/*
 * Hair that feels hair: a coarse grid of how much hair there is and how it moves, which each point looks up once a step
 * (particle in cell: Harlow, "The particle-in-cell method for numerical solution of problems in fluid dynamics", 1962;
 * for hair: McAdams, Selle, Ward, Sifakis and Teran, "Detail preserving continuum simulation of straight hair", 2009).
 * Points are shared out between the middles of eight cells, in integers: sums do not depend on the order.  The same
 * shares tell what a point feels, so that what hair loses by friction, other hair gets.
 */
#include "lanes.h"

#if INT64_ATOMICS
#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
#endif

#define SNAP 1024             // parts of a cell to which points are snapped

#if LANES > 1
#define GROUP ALONE BY_HAND
#else
#define GROUP
#endif

INLINED lanes rows_at(__global const float *rows, size_t at)
{
    return *(__global const lanes *)(rows + at);
}

INLINED lanes3 three_at(__global const float *rows, size_t padded, size_t at)
{
    const lanes3 v = {rows_at(rows, at), rows_at(rows, at + padded), rows_at(rows, at + 2 * padded)};
    return v;
}

/* Points of strands side by side, snapped: parts of a cell from the middle of the first. */
typedef struct {
    lanes_i x, y, z;
    lanes_i there;            // mask: all eight cells around one are in the grid
} Spots;

INLINED Spots spots_of(float4 low, int4 size, lanes3 root, lanes3 place, lanes_i on)
{
    const lanes x = ((root.x + place.x) - low.x) * low.w - 0.5f, y = ((root.y + place.y) - low.y) * low.w - 0.5f;
    const lanes z = ((root.z + place.z) - low.z) * low.w - 0.5f;
    Spots s;
    s.there = on & (x >= 0.0f) & (y >= 0.0f) & (z >= 0.0f) & (x < size.x - 1.0f) & (y < size.y - 1.0f) & (z < size.z - 1.0f);
    s.x = TO(lanes_i, s.there ? x * (float)SNAP : F(0.0f));
    s.y = TO(lanes_i, s.there ? y * (float)SNAP : F(0.0f));
    s.z = TO(lanes_i, s.there ? z * (float)SNAP : F(0.0f));
    return s;
}

/* Numbers in whole units, up to `most` on both sides. */
INLINED lanes_i whole(lanes x, float unit, float most)
{
    const lanes y = within(x * unit, -most, most);
    return TO(lanes_i, y + (y < 0.0f ? F(-0.5f) : F(0.5f)));
}

INLINED void add_long(volatile __global long *to, long amount)
{
#if INT64_ATOMICS
    atom_add(to, amount);
#else
    volatile __global uint *words = (volatile __global uint *)to;
    const uint low = (uint)amount, high = (uint)(amount >> 32), was = atomic_add(&words[0], low);
    const uint carried = was + low < was ? 1 : 0;
    if (high + carried)
        atomic_add(&words[1], high + carried);
#endif
}

INLINED void add_sum(volatile __global long *sums, int index, long4 amount)
{
    volatile __global long *to = sums + 4 * (size_t)index;
    add_long(to, amount.x);
    add_long(to + 1, amount.y);
    add_long(to + 2, amount.z);
    add_long(to + 3, amount.w);
}

#if LANES > 1
/* Cells that a work-item has added to lately: strands that follow each other lie near each other, so that few atomics are
   left. */
#define SIDE_OF_HELD 8
#define HELD_CELLS (SIDE_OF_HELD * SIDE_OF_HELD * SIDE_OF_HELD)
typedef struct {
    long4 sum[HELD_CELLS];
    int index[HELD_CELLS];    // -1: none yet
} Held;

INLINED void hold(Held *held, volatile __global long *sums, int at, int index, long4 amount)
{
    if (held->index[at] == index) {
        held->sum[at] += amount;
        return;
    }
    if (held->index[at] >= 0)
        add_sum(sums, held->index[at], held->sum[at]);
    held->index[at] = index;
    held->sum[at] = amount;
}
#else
typedef int Held;
#endif

/* Add what a point has to the eight cells around it; what cutting to whole units leaves stays in the lower ones. */
INLINED void share_out(Held *held, volatile __global long *sums, int4 size, int x, int y, int z, int mass, long4 speed)
{
    const int sx = x & (SNAP - 1), sy = y & (SNAP - 1), sz = z & (SNAP - 1);
    int part[8];
    part[1] = mass * sx / SNAP;
    part[0] = mass - part[1];
    for (int i = 0; i < 2; ++i) {
        part[2 + i] = part[i] * sy / SNAP;
        part[i] -= part[2 + i];
    }
    for (int i = 0; i < 4; ++i) {
        part[4 + i] = part[i] * sz / SNAP;
        part[i] -= part[4 + i];
    }
    x /= SNAP;
    y /= SNAP;
    z /= SNAP;
    const int first = (z * size.y + y) * size.x + x;
    for (int i = 0; i < 8; ++i) {
        const int right = i & 1, up = i >> 1 & 1, on = i >> 2, index = first + right + size.x * (up + size.y * on);
        const long4 amount = (long)part[i] * speed;
#if LANES > 1
        const int side = SIDE_OF_HELD, most = side - 1;
        hold(held, sums, ((x + right) & most) + side * (((y + up) & most) + side * ((z + on) & most)), index, amount);
#else
        if (part[i])
            add_sum(sums, index, amount);
#endif
    }
}

/* Mass and momentum of all points, shared out.  A work-item does a run of strands, LANES at a time. */
GROUP __kernel void deposit(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint run,                        // strands of each, whole LANES
    const uint padded,
    __global const int *segments,          // [padded] of each strand; 0 where there is none
    __global const float *lengths,         // [points, padded] of segments [world]
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *places,          // [points, 3, padded] relative to the root [world]
    __global const float *speeds,          // [points, 3, padded] [world / s]
    __global const float *speeds_before,   // [points, 3, padded]
    const float ahead,                     // 1: as fast as they will be, if they go on to be faster; 0: as they are
    const float4 low,                      // corner of the grid [world]; cells a world unit
    const int4 size,                       // cells
    const float2 units,                    // of mass in a world unit of hair; of speed in a world unit a second
    volatile __global long *sums)          // [nz, ny, nx, 4] momentum, mass
{
    WORK_ITEM(item);
    Held held;
#if LANES > 1
    for (int i = 0; i < HELD_CELLS; ++i)
        held.index[i] = -1;
#endif
    const size_t past = (item + 1) * run < padded ? (item + 1) * run : padded;
    for (size_t first = item * run; first < past; first += LANES) {
        const lanes_i n = *(__global const lanes_i *)(segments + first);
        const lanes3 root = three_at(roots, padded, first);
        const int most = most_lane(n);
        lanes here = most ? rows_at(lengths, first) : F(0.0f);
        for (int i = 1; i <= most; ++i) {
            const size_t at = (size_t)i * padded + first, at3 = 3 * (size_t)i * padded + first;
            const lanes behind = i < most ? i < n ? rows_at(lengths, at) : F(0.0f) : F(0.0f);
            lanes_i mass = whole(0.5f * (here + behind), units.x, 65536.0f);
            here = behind;
            Spots spots = spots_of(low, size, root, three_at(places, padded, at3), i <= n);
            const lanes3 now = three_at(speeds, padded, at3), then = three_at(speeds_before, padded, at3);
            const lanes3 v = plus(now, scaled(minus(now, then), F(ahead)));
            lanes_i vx = whole(v.x, units.y, FASTEST), vy = whole(v.y, units.y, FASTEST), vz = whole(v.z, units.y, FASTEST);
            for (int l = 0; l < LANES; ++l)
                if (LANE_I(spots.there, l))
                    share_out(&held, sums, size, LANE_I(spots.x, l), LANE_I(spots.y, l), LANE_I(spots.z, l),
                              LANE_I(mass, l), (long4)(LANE_I(vx, l), LANE_I(vy, l), LANE_I(vz, l), 1));
        }
    }
#if LANES > 1
    for (int i = 0; i < HELD_CELLS; ++i)
        if (held.index[i] >= 0)
            add_sum(sums, held.index[i], held.sum[i]);
#endif
}

/* Of densities [strands across a cell], the share of their hair's friction that is felt: none of what a strand may have to
   do with itself, all of it from one more strand on. */
inline float4 coupling(float4 density)
{
    const float4 more = density - ALONE_IN_CELL, none = 0.0f, all = 1.0f;
    return more < none ? none : more > all ? all : more;
}

/* Sums of cells -> their mean velocities and densities. */
__kernel void average(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const long *sums,             // [cells, 4]
    const float2 units,                    // world units a second in one of speed; strands across a cell in one of mass
    __global float4 *cells)                // [cells] velocity [world / s] times its coupling; density
{
    WORK_ITEM(i);
    const long mass = sums[4 * i + 3];
    float4 cell = (float4)(0.0f);
    if (mass > 0) {
        cell.w = (float)mass * units.y;
        const float by = units.x * coupling(cell).w / (float)mass;
        cell.x = (float)sums[4 * i] * by;
        cell.y = (float)sums[4 * i + 1] * by;
        cell.z = (float)sums[4 * i + 2] * by;
    }
    cells[i] = cell;
}

/* What points are among. */
typedef struct {
    lanes3 velocity;          // mean, times its coupling [world / s]
    lanes3 gradient;          // of density [1 / cell]
    lanes density, coupling;
} Among;

/* Of rows of four along y and z, 0 or 1 each: between these by their shares. */
INLINED float between(float4 a, float4 low, float4 high)
{
    return (a.x * low.y + a.y * high.y) * low.z + (a.z * low.y + a.w * high.y) * high.z;
}

INLINED Among among(__global const float4 *cells, int4 size, Spots spots)
{
    Among a;
    const lanes3 none = all_lanes((float4)(0.0f));
    a.velocity = a.gradient = none;
    a.density = a.coupling = F(0.0f);
    const size_t up = size.x, on = up * size.y;
    for (int l = 0; l < LANES; ++l) {
        if (!LANE_I(spots.there, l))
            continue;
        const int x = LANE_I(spots.x, l), y = LANE_I(spots.y, l), z = LANE_I(spots.z, l), part = SNAP - 1;
        const float4 high = (float4)(x & part, y & part, z & part, 0.0f) * (1.0f / SNAP), low = 1.0f - high;
        __global const float4 *at = cells + (((size_t)(z / SNAP) * size.y + y / SNAP) * size.x + x / SNAP);
        const float4 p[4] = {at[0], at[up], at[on], at[on + up]}, q[4] = {at[1], at[up + 1], at[on + 1], at[on + up + 1]};
        const float4 mean = (low.x * p[0] + high.x * q[0]) * (low.y * low.z)
            + (low.x * p[1] + high.x * q[1]) * (high.y * low.z)
            + ((low.x * p[2] + high.x * q[2]) * (low.y * high.z) + (low.x * p[3] + high.x * q[3]) * (high.y * high.z));
        const float4 left = (float4)(p[0].w, p[1].w, p[2].w, p[3].w), right = (float4)(q[0].w, q[1].w, q[2].w, q[3].w);
        const float4 mid = low.x * left + high.x * right;
        put_lane(&a.velocity, l, mean);
        LANE(a.density, l) = mean.w;
        LANE(a.coupling, l) = between(low.x * coupling(left) + high.x * coupling(right), low, high);
        put_lane(&a.gradient, l, (float4)(between(right - left, low, high),
                                          (mid.y - mid.x) * low.z + (mid.w - mid.z) * high.z,
                                          (mid.z - mid.x) * low.y + (mid.w - mid.y) * high.y, 0.0f));
    }
    return a;
}

/* How dense hair is at each point.  A work-item does LANES strands. */
GROUP __kernel void density(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint points,                     // of the longest strand
    const uint padded,
    __global const int *segments,          // [padded]
    __global const float *roots,           // [4, 3, padded]
    __global const float *places,          // [points, 3, padded]
    const float4 low,                      // as above
    const int4 size,
    __global const float4 *cells,          // [nz, ny, nx]
    __global float *densities)             // [points, padded] [strands across a cell]
{
    WORK_ITEM(item);
    const size_t first = item * LANES;
    const lanes_i n = *(__global const lanes_i *)(segments + first);
    const lanes3 root = three_at(roots, padded, first);
    for (int i = 1; i < (int)points; ++i) {
        const Spots spots = spots_of(low, size, root, three_at(places, padded, 3 * (size_t)i * padded + first), i <= n);
        *(__global lanes *)(densities + (size_t)i * padded + first) = among(cells, size, spots).density;
    }
}

/* What each point feels of the hair around it: friction, and a push out of where hair is denser than it was groomed.
   A work-item does LANES strands. */
GROUP __kernel void feel(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint points,                     // of the longest strand
    const uint padded,
    __global const int *segments,          // [padded]
    __global const float *roots,           // [4, 3, padded]
    __global const float *places,          // [points, 3, padded]
    __global const float *groomed,         // [points, padded] densities of the groom
    const float4 low,                      // as above
    const int4 size,
    __global const float4 *cells,          // [nz, ny, nx]
    const float friction,                  // [1 / s]
    const float4 push,                     // where density falls to none in a cell: acceleration of hair that is far
                                           // too dense [world / s^2], friction [1 / s]; the most of the first
    __global float *felt)                  // [points, 4, padded] acceleration of what is at rest [world / s^2]; friction [1 / s]
{
    WORK_ITEM(item);
    const size_t first = item * LANES, row = padded;
    const lanes_i n = *(__global const lanes_i *)(segments + first);
    const lanes3 root = three_at(roots, row, first);
    for (int i = 1; i < (int)points; ++i) {
        const Spots spots = spots_of(low, size, root, three_at(places, row, 3 * i * row + first), i <= n);
        const Among a = among(cells, size, spots);
        const lanes rest = greater(rows_at(groomed, i * row + first), F(ALONE_IN_CELL)) * DENSER;
        const lanes_i dense = a.density > rest;
        const lanes by = 1.0f / (dense ? a.density : F(1.0f));
        const lanes3 slope = scaled(a.gradient, by);
        const lanes3 away = scaled(slope, dense ? -push.x * (1.0f - rest * by) : F(0.0f));
        const lanes size_of = exact_root(dots(away, away));
        /* What the push would change in a step, if it were as it is then: without it pressed hair would never rest. */
        const lanes rub = friction + (dense ? push.y * dots(slope, slope) : F(0.0f));
        const lanes3 out = plus(scaled(a.velocity, rub), scaled(away, size_of > push.z ? push.z / size_of : F(1.0f)));
        __global float *to = felt + 4 * i * row + first;
        *(__global lanes *)to = out.x;
        *(__global lanes *)(to + row) = out.y;
        *(__global lanes *)(to + 2 * row) = out.z;
        *(__global lanes *)(to + 3 * row) = rub * a.coupling;
    }
}
