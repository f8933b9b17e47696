/*
 * How much hair each cell of a grid seen from the light holds, in integers: sums that don't depend on the order.
 *
 * The grid's x and y lie across the light, z along the way it travels; the unit is a cell.  Points are snapped to
 * 1/SUBPIXEL cell, and everything after is integers.  The report's three methods (section 2.3.1) draw a strand as
 * the fragments of a line across the light, one for each step along its longer axis; `lengths` deposits how often
 * a ray of light is expected to cross the strand.  One work-item draws one strand; where LANES is more than 1, in
 * `lengths` the first of a group draws GATHERED for each that it has, LANES at once.
 */

#include "cells.h"
#if LANES == 1 && LANES_HINTED > 1
#undef LANES
#define LANES LANES_HINTED
#endif
#include "lanes.h"
#ifdef __SPIR64__                                       // Mesa takes none there
#undef PREFETCH
#undef PREFETCH_TO_WRITE
#define PREFETCH(p)
#define PREFETCH_TO_WRITE(p)
#endif

#if INT64_ATOMICS
#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
#endif

#define FRACTION 24                                     // fixed-point bits below the sub-cell in a walk

/* A segment with an end four grids away: what of it is in the grid's reach, snapped; whether anything is. */
bool ends_in_reach(const Grid *grid, float4 *from, float4 *to, int4 *a, int4 *b, float *wa, float *wb)
{
    if (!cut_to_grid(grid, from, to))
        return false;
    *a = to_cells(grid, *from, wa);
    *b = to_cells(grid, *to, wb);
    return (*a).x != OUTSIDE && (*b).x != OUTSIDE;
}

/* The report's voxels. A segment's fragments are those of a line drawn into x and y, as in raster.cl. */
RARE __kernel void fragments(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Grid grid,
    const uint2 stretch,                   // segments of each strand: the first, one past the last
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] -, -, type
    __global const uint *weights,          // [types] what one fragment adds
    const int method,                      // METHOD_BINARY, METHOD_COUNT or METHOD_TRILINEAR
    volatile __global uint *cells)         // [nz, ny, nx]
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const uint weight = weights[(int)strand_uv[strand].z];
    int4 a, b;
    float w;
    for (uint k = stretch.x; k < span.y && k <= stretch.y; ++k, a = b) {
        b = to_cells(&grid, points[span.x + k], &w);
        if (k == stretch.x)
            continue;
        int4 p = a, q = b;
        if (a.x == OUTSIDE || b.x == OUTSIDE) {
            float4 from = points[span.x + k - 1], to = points[span.x + k];
            if (!ends_in_reach(&grid, &from, &to, &p, &q, &w, &w))
                continue;
        }
        const bool steep = abs(q.x - p.x) < abs(q.y - p.y);
        if (steep) {
            p = p.yxzw;
            q = q.yxzw;
        }
        if (p.x > q.x) {
            const int4 t = p; p = q; q = t;
        }
        const int du = q.x - p.x;
        if (du == 0)
            continue;
        const long v_step = ((long)(q.y - p.y) << FRACTION) / du, z_step = ((long)(q.z - p.z) << FRACTION) / du;
        const int begin = max((p.x + SUBPIXEL / 2 - 1) >> 8, 0);
        const int end = min((q.x + SUBPIXEL / 2 - 1) >> 8, steep ? grid.size.y : grid.size.x);
        for (int u = begin; u < end; ++u) {
            const int along = u * SUBPIXEL + SUBPIXEL / 2 - p.x;
            const int v = p.y + (int)((v_step * along) >> FRACTION), z = p.z + (int)((z_step * along) >> FRACTION);
            if (method == METHOD_TRILINEAR) {
                /* The four cells whose centres surround the fragment; the parts add up to the whole. */
                const int v0 = (v - SUBPIXEL / 2) >> 8, near = (z - SUBPIXEL / 2) >> 8;
                const int z0 = layer(&grid, near), z1 = layer(&grid, near + 1);
                const uint fv = (v - SUBPIXEL / 2) & 255, fz = (z - SUBPIXEL / 2) & 255;
                const uint both = weight * fv / 256 * fz / 256, right = weight * fv / 256 - both;
                const uint behind = weight * fz / 256 - both, here = weight - right - behind - both;
                add(cells, &grid, steep ? v0 : u, steep ? u : v0, z0, here);
                add(cells, &grid, steep ? v0 + 1 : u, steep ? u : v0 + 1, z0, right);
                add(cells, &grid, steep ? v0 : u, steep ? u : v0, z1, behind);
                add(cells, &grid, steep ? v0 + 1 : u, steep ? u : v0 + 1, z1, both);
            } else {
                const int x = steep ? v >> 8 : u, y = steep ? u : v >> 8, at = layer(&grid, z >> 8);
                if (method == METHOD_COUNT)
                    add(cells, &grid, x, y, at, weight);
                else if (in_grid(&grid, x, y, at))
                    atomic_max(&cells[((size_t)at * grid.size.y + y) * grid.size.x + x], weight);
            }
        }
    }
}

/* A point of each of LANES strands. */
typedef struct {
    lanes3 p;                              // [world]
    lanes width, w;                        // [world]; distance, see `distance_of`
    lanes_i x, y, z;                       // [sub-cells]
    lanes_i away;                          // mask: four grids away, so that these are not known
} Places;

/* For |x| < 2^22; all OpenCL has for it is a function. */
INLINED lanes float_of(lanes_i x)
{
    return AS_F(x + as_int(SHIFT)) - SHIFT;
}

/* all * share / 256, for share < 256, without 64 bits. */
INLINED lanes_u share_of(lanes_u all, lanes_u share)
{
    return (all >> 8) * share + ((all & 255u) * share >> 8);
}

/* a / n for whole 0 <= a < 2^30, whose quotient is below 2^22: a float's is one off at most. */
INLINED lanes_i quotient(lanes a, lanes_i whole, lanes_i n)
{
    const lanes_i q = nearest_i(whole_below(a / float_of(n))), rest = whole - q * n;
    return q + (rest >= n ? I(1) : rest < 0 ? I(-1) : I(0));
}

#if LANES > 1
/* Eight points [x, y, z, width] -> eight x, eight y, ... */
INLINED void eight(__global const float4 *points, const uint *at, float8 *to)
{
    const float8 a = (float8)(points[at[0]], points[at[4]]), b = (float8)(points[at[1]], points[at[5]]);
    const float8 c = (float8)(points[at[2]], points[at[6]]), d = (float8)(points[at[3]], points[at[7]]);
    const float8 ab = (float8)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5);
    const float8 cd = (float8)(c.s0, d.s0, c.s1, d.s1, c.s4, d.s4, c.s5, d.s5);
    const float8 ab2 = (float8)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7);
    const float8 cd2 = (float8)(c.s2, d.s2, c.s3, d.s3, c.s6, d.s6, c.s7, d.s7);
    to[0] = (float8)(ab.s01, cd.s01, ab.s45, cd.s45);
    to[1] = (float8)(ab.s23, cd.s23, ab.s67, cd.s67);
    to[2] = (float8)(ab2.s01, cd2.s01, ab2.s45, cd2.s45);
    to[3] = (float8)(ab2.s23, cd2.s23, ab2.s67, cd2.s67);
}

/* Eights of numbers as one vector, without memory that would be written in small parts and read at once. */
INLINED lanes joined(const float8 *eights)
{
#if LANES == 8
    return eights[0];
#elif LANES == 16
    return (lanes)(eights[0], eights[1]);
#else
    return (lanes)(eights[0], eights[1], eights[2], eights[3]);
#endif
}
#endif

/* The points with these numbers, a lane each, snapped as in `to_cells`. */
INLINED void take(const Grid *grid, __global const float4 *points, const uint *at, Places *to)
{
    lanes x, y, z, width;
#if LANES == 1
    const float4 p = points[at[0]];
    x = p.x;
    y = p.y;
    z = p.z;
    width = p.w;
#else
    float8 xs[LANES / 8], ys[LANES / 8], zs[LANES / 8], widths[LANES / 8];
#pragma unroll
    for (int i = 0; i < LANES / 8; ++i) {
        float8 columns[4];
        eight(points, at + 8 * i, columns);
        xs[i] = columns[0];
        ys[i] = columns[1];
        zs[i] = columns[2];
        widths[i] = columns[3];
    }
    x = joined(xs);
    y = joined(ys);
    z = joined(zs);
    width = joined(widths);
#endif
    const float4 mx = grid->to_grid[0], my = grid->to_grid[1], mz = grid->to_grid[2], m1 = grid->to_grid[3];
    const lanes cx = ((mx.x * x + my.x * y) + mz.x * z) + m1.x, cy = ((mx.y * x + my.y * y) + mz.y * z) + m1.y;
    const lanes cz = ((mx.z * x + my.z * y) + mz.z * z) + m1.z;
    lanes w = F(1.0f), qx = cx, qy = cy;
    if (grid->light.w != 0.0f) {           // a spot: under parallel rays w is 1
        w = ((mx.w * x + my.w * y) + mz.w * z) + m1.w;
        qx = cx / w;
        qy = cy / w;
    }
    const int most = grid->size.x > grid->size.y ? grid->size.x : grid->size.y;
    const float far = 4 * (most > grid->size.z ? most : grid->size.z);
    const lanes qz = grid->size.w ? cz < -far ? F(-far) : cz : cz;
    const float least = grid->size.w ? grid->face.w : 0.0f;
    const lanes_i near = (w > 0.0f) & (w >= least) & (qx <= far) & (qy <= far) & (qz <= far) & (qx >= -far) & (qy >= -far)
        & (qz >= -far);
    to->p.x = x;
    to->p.y = y;
    to->p.z = z;
    to->width = width;
    to->w = w;
    to->x = nearest_i(whole_below((near ? qx : F(0.0f)) * (float)SUBPIXEL + 0.5f));
    to->y = nearest_i(whole_below((near ? qy : F(0.0f)) * (float)SUBPIXEL + 0.5f));
    to->z = nearest_i(whole_below((near ? qz : F(0.0f)) * (float)SUBPIXEL + 0.5f));
    to->away = !near;
}

/* Of segments with an end four grids away, the rare ones, what of them is in the grid's reach; mask: where anything is. */
lanes_i bring_in(const Grid *grid, Places *a, Places *b, lanes_i on)
{
    for (int l = 0; l < LANES; ++l) {
        if (!LANE_I(on, l) || !(LANE_I(a->away, l) || LANE_I(b->away, l)))
            continue;
        float4 from = (float4)(LANE(a->p.x, l), LANE(a->p.y, l), LANE(a->p.z, l), LANE(a->width, l));
        float4 to = (float4)(LANE(b->p.x, l), LANE(b->p.y, l), LANE(b->p.z, l), LANE(b->width, l));
        int4 p, q;
        if (!ends_in_reach(grid, &from, &to, &p, &q, &LANE(a->w, l), &LANE(b->w, l))) {
            LANE_I(on, l) = 0;
            continue;
        }
        LANE(a->p.x, l) = from.x, LANE(a->p.y, l) = from.y, LANE(a->p.z, l) = from.z, LANE(a->width, l) = from.w;
        LANE(b->p.x, l) = to.x, LANE(b->p.y, l) = to.y, LANE(b->p.z, l) = to.z, LANE(b->width, l) = to.w;
        LANE_I(a->x, l) = p.x, LANE_I(a->y, l) = p.y, LANE_I(a->z, l) = p.z;
        LANE_I(b->x, l) = q.x, LANE_I(b->y, l) = q.y, LANE_I(b->z, l) = q.z;
    }
    return on;
}

/* What the segments from a to b amount to: whole, and from and to the next ones what is left. */
INLINED lanes_u crossings_of(const Grid *grid, const Places *a, const Places *b, lanes weight, lanes_i on, lanes *left)
{
    /* A spot's rays meet the face, at distance w along its axis, at a slant: ray is w / cos long there. */
    const lanes w = greater(0.5f * (a->w + b->w), F(grid->face.w)), width = 0.5f * (a->width + b->width);
    const lanes3 d = {b->p.x - a->p.x, b->p.y - a->p.y, b->p.z - a->p.z};
    const float4 light = grid->light;
    const lanes3 ray = {light.x - light.w * (0.5f * (a->p.x + b->p.x)), light.y - light.w * (0.5f * (a->p.y + b->p.y)),
                        light.z - light.w * (0.5f * (a->p.z + b->p.z))};
    const lanes3 c = crosses(d, ray);
    const lanes exact = exact_root(dots(c, c)) * width / (grid->face.x * (w * w * w)) * weight + *left;
    /* Its whole part, in two halves that a float's fraction can be cut off; all of it is exact. */
    const lanes most = lesser(exact, F(0x1p31f)), high = whole_below(most * 0x1p-16f), low = whole_below(most - 65536.0f * high);
    const lanes rest = lesser(exact - (65536.0f * high + low), F(1.0f));
    *left = on ? rest : *left;
    return (AS_U(nearest_i(high)) << 16) + AS_U(nearest_i(low));
}

#if LANES > 1
#include "gathered.h"
#else
typedef int Block;                         // a strand a work-item: nothing is gathered
#endif

/* `add_between` of a step in each lane, into the block where that has these cells. */
INLINED void add_lanes(volatile __global uint *cells, const Grid *grid, Block *block, lanes_i x, lanes_i y, lanes_i z,
                       lanes_u all)
{
#if LANES == 1
    add_between(cells, grid, x, y, z, all);
#else
    const int across = block->size.x;
    const lanes_i bx = (x >> 8) - block->first.x, by = (y >> 8) - block->first.y, bz = z - block->first.z;
    const lanes_i within = (AS_U(bx) < U(across - 1)) & (AS_U(by) < U(block->size.y - 1)) & (AS_U(bz) < U(block->size.z));
    const lanes_i at = within ? (bz * block->size.y + by) * across + bx : I(0);
    const lanes_u here = within ? all : U(0), other = all - here, fx = AS_U(x & 255), fy = AS_U(y & 255);
    const lanes_u right = share_of(here, fx), both = share_of(right, fy), behind = share_of(here, fy);
    const lanes_u corner = here - right - behind + both, right_alone = right - both, behind_alone = behind - both;
    __local uint *front = block->held, *back = front + across;
#pragma unroll 4
    for (int l = 0; l < LANES; ++l) {
        const int i = LANE_I(at, l);
        front[i] += LANE_I(corner, l);
        front[i + 1] += LANE_I(right_alone, l);
        back[i] += LANE_I(behind_alone, l);
        back[i + 1] += LANE_I(both, l);
    }
    for (uint rest = bits_of(other != 0u); rest; rest &= rest - 1) {
        const int l = first_of(rest);
        add_between(cells, grid, LANE_I(x, l), LANE_I(y, l), LANE_I(z, l), LANE_U(other, l));
    }
#endif
}

/* 512 e / n, rounded towards 0; n > 1 steps reach |e| sub-cells. */
INLINED lanes_i step_of(lanes_i e, lanes_i n)
{
    const lanes_i way = e < 0 ? -e : e, step = quotient(512.0f * float_of(way), way << 9, n);
    return e < 0 ? -step : step;
}

/* Spread amounts evenly over steps of 3/4 cell at most from a to b. */
INLINED void spread(volatile __global uint *cells, const Grid *grid, Block *block, const Places *a, const Places *b,
                    lanes_u amount, lanes_i on)
{
    const lanes_i ex = b->x - a->x, ey = b->y - a->y, ez = b->z - a->z;
    lanes_i longest = ex < 0 ? -ex : ex;
    longest = longest > ey ? longest : ey;
    longest = longest > -ey ? longest : -ey;
    longest = longest > ez ? longest : ez;
    longest = longest > -ez ? longest : -ez;
    const lanes_i n = longest / (SUBPIXEL / 4 * 3) + 1;
    const int most = most_lane(on ? n : I(0));
    /* Middles of the steps, in 2^-9 sub-cells: four grids of 1024 cells are 2^29 of them. Most segments are one or two
       steps long, and divisions are what costs here. */
    lanes_u part = amount >> AS_U(n - 1), more = amount & AS_U(n - 1);
    const lanes_i shift = 10 - n;
    lanes_i sx = ex << shift, sy = ey << shift, sz = ez << shift;
    if (most > 2) {
        part = any_lane(amount >= 1u << 22) ? amount / AS_U(n) : AS_U(quotient(float_of(AS_I(amount)), AS_I(amount), n));
        more = amount - part * AS_U(n);
        sx = step_of(ex, n);
        sy = step_of(ey, n);
        sz = step_of(ez, n);
    }
    lanes_i x = (a->x << 9) + sx / 2, y = (a->y << 9) + sy / 2, z = (a->z << 9) + sz / 2;
    for (int i = 0; i < most; ++i, x += sx, y += sy, z += sz) {
        const lanes_u one = part + (more > (uint)i ? U(1) : U(0)), all = (on & (n > i)) ? one : U(0);
        lanes_i layers = z >> 17;
        if (grid->size.w)
            layers = layers < 0 ? I(0) : layers;
        add_lanes(cells, grid, block, (x >> 9) - SUBPIXEL / 2, (y >> 9) - SUBPIXEL / 2, layers, all);
    }
}

/* LANES strands from one on, `end` at most, each segment of them in turn; of a stretch of segments -> what rounding leaves of
   the first one, which had so much of it `before`. */
ONCE float put_lanes(const Grid *grid, __global const float4 *points, __global const uint2 *spans,
                       __global const float4 *strand_uv, __global const uint *weights, volatile __global uint *cells,
                       Block *block, uint strand, uint end, uint2 stretch, float before)
{
    uint some = 0, longest = 0;
    lanes_u first;
    lanes_i counts;
    lanes weight, left = F(before);
    for (uint l = 0; l < LANES; ++l) {
        const bool there = strand + l < end;
        const uint2 span = there ? spans[strand + l] : (uint2)(0);
        LANE_U(first, l) = span.x;
        LANE_I(counts, l) = span.y;
        LANE(weight, l) = there ? weights[(int)strand_uv[strand + l].z] : 0;
        some = span.y ? span.x : some;
        longest = span.y > longest ? span.y : longest;
    }
    Places ends[2], kept;
    for (uint k = stretch.x; k < longest && k <= stretch.y; ++k) {
        const lanes_u at = counts > (int)k ? first + k : U(some);   // where a strand has ended, any point will do
        for (uint l = 0; l < LANES; l += 4)   // strands lie one behind the other: those that are next
            PREFETCH(points + LANE_U(first, 0) + LANES * (longest + k) + l);
        /* Vectors so long are in memory, and stay where they are; a GPU has its points in registers. */
        const uint turn = LANES == 1 ? 1 : k & 1;
        Places *p = &ends[1 - turn], *q = &ends[turn];
        if (LANES == 1 && k > stretch.x)
            *p = *q;
        take(grid, points, (const uint *)&at, q);
        if (k == stretch.x)
            continue;
        lanes_i on = counts > (int)k;
        const bool leaves = any_lane(on & (p->away | q->away));
        if (leaves) {
            kept = *q;
            on = bring_in(grid, p, q, on);
        }
        if (!grid->size.w)
            on &= (p->z >= 0) | (q->z >= 0);
        const lanes_u amount = crossings_of(grid, p, q, weight, on, &left);
        spread(cells, grid, block, p, q, amount, on);
        if (leaves)
            *q = kept;
    }
    return LANE(left, 0);
}

/* What a ray through a cell's face is expected to cross there: length · width · sin(fibre, light) / area of the face.
   A segment's amount is spread evenly over steps of 3/4 cell at most, and each between the four columns around it, so
   that nothing jumps when the light turns; what rounding leaves goes on to the next. */
BY_HAND __kernel void lengths(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Grid grid,
    const uint2 stretch,                   // segments of each strand: the first, one past the last; all where LANES > 1
    __global float *rests,                 // [strands] what rounding left of those before; nothing if all are
    const uint n_strands,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] -, -, type
    __global const uint *weights,          // [types] amount of one crossing
    volatile __global uint *cells)         // [nz, ny, nx]
{
#if LANES == 1
    WORK_ITEM(i);
    Block block;
    const bool all = !stretch.x && stretch.y == ~0u;
    const float before = stretch.x ? rests[i] : 0.5f;
    const float rest = put_lanes(&grid, points, spans, strand_uv, weights, cells, &block, i, i + 1, stretch, before);
    if (!all)
        rests[i] = rest;
#else
    __local uint held[HELD + 32];          // so many of a row are looked at at once
    WORK_ITEM(i);
    if (get_local_id(0))
        return;
    Block block;
    block.held = held;
    const uint begun = (uint)i * GATHERED, after = (uint)(i + get_local_size(0) < end ? i + get_local_size(0) : end) * GATHERED;
    const uint last = after < n_strands ? after : n_strands;
    uint run = get_local_size(0) * GATHERED;
    for (uint first = begun, past; first < last; first = past) {
        past = open_block(&block, &grid, points, spans, first, last, &run);
        for (uint strand = first; strand < past; strand += LANES)
            put_lanes(&grid, points, spans, strand_uv, weights, cells, &block, strand, past, stretch, 0.5f);
        give_back(&block, &grid, cells);
    }
#endif
}
