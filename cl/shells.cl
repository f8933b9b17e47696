/*
 * Shell fur: hair as a height field on the skin, between the mesh and a surface one length above it.
 *
 * The space between them is divided into prisms over the faces, in `slabs` one above the other.  `bend` tells where their
 * corners are, `lattice`, `noise` and `means` what stands in them: see pattern.h.  march.cl takes rays through it,
 * `deposit` puts it before the light, `outputs` what a picture besides its colour shows of it.
 */
#include "cells.h"
#include "lanes.h"
#include "seen.h"
#include "pattern.h"

#define STEPS 16        // through the table of means, at least, from the skin to the tips

/* The way hairs are bent at each vertex: places at heights 0, 1/slabs .. 1, all steps equally long, so that layers keep
   their distance (the report's wind, after Bakay, Lalonde and Heidrich 2002).  One work-item bends one vertex. */
__kernel void bend(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    __global const float4 *positions,      // [V]
    __global const float4 *normals,        // [V] unit
    const int leaning,                     // 1: vertices lean each by itself
    __global const float *lean,            // [V, 3] as the force; or what isn't read
    __global float4 *curves)               // [V, slabs + 1]
{
    WORK_ITEM(vertex);
    const int slabs = shells.kind.z;
    const float4 n = normals[vertex];
    float4 p = positions[vertex];
    p.w = 0.0f;
    /* Gusts travel with the wind: two parabolas make a wave of one turn. */
    const float turns = shells.gust.w - dot3(shells.gust, p), f = turns - floor(turns);
    const float wave = f < 0.5f ? 16.0f * f * (0.5f - f) : -16.0f * (f - 0.5f) * (1.0f - f);
    float4 force = shells.bend + (0.7f + 0.3f * wave) * shells.wind;
    if (leaning)
        force += (float4)(vload3(vertex, lean), 0.0f);
    for (int k = 0; k < slabs; ++k) {
        curves[vertex * (slabs + 1) + k] = p;
        p += (shells.size.x / slabs) * unit_or(n + ((k + 0.5f) / slabs) * force, n);
    }
    curves[vertex * (slabs + 1) + slabs] = p;
}

/* Where the corners of a face lie in the pattern, how x and y change in the world, and the noise's place with them.  How
   many cells there are and what noise they get is told by the mesh in rest.  One work-item, one face. */
__kernel void lattice(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    __global const float4 *positions,      // [V]
    __global const float4 *normals,        // [V]
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const float4 *uv,             // [F * 3] u, v of these corners
    __global const float4 *rest,           // [F * 3] these corners in rest, from its middle; which corner of the cells each is: 0, 1, 2
    __global float4 *out)                  // [F, CORNERS] x0 y0 x1 y1; x2 y2 cells-a-side density; gradients of x, y and h;
                                           // the most that x and y together can change; the noise's place at x = y = 0,
                                           // what x and what y add to it (0 for "sine")
{
    WORK_ITEM(f);
    const float4 a = positions[faces[f].x], b = positions[faces[f].y] - a, c = positions[faces[f].z] - a;
    const float4 n = cross3(b, c);
    const float square = dot3(n, n);
    const bool flat = !(square > 1e-20f * dot3(b, b) * dot3(c, c));   // no area in this pose: nothing changes along it
    const float4 none = (float4)(0.0f);        // gradients of the corners' weights:
    const float4 to_b = flat ? none : cross3(c, n) / square, to_c = flat ? none : cross3(n, b) / square;
    float2 at[3];
    float4 start = (float4)(0.0f), by_x = start, by_y = start;
    float sides = 0.0f;
    if (shells.kind.x) {
        for (int i = 0; i < 3; ++i)
            at[i] = (float2)(2.0f * shells.size.z * uv[3 * f + i].x, shells.size.z * uv[3 * f + i].y);
    } else {
        const float4 whole = cross3(rest[3 * f + 1] - rest[3 * f], rest[3 * f + 2] - rest[3 * f]);
        /* Half a cell more is a cell, also where the mesh is turned and rounded in another way. */
        sides = clamp(floor(shells.size.z * sqrt(0.5f * sqrt(dot3(whole, whole))) + 0.50001f), 1.0f, 4096.0f);
        float4 q[3];
        for (int i = 0; i < 3; ++i) {
            const float4 p = rest[3 * f + i];
            const int corner = (int)p.w;
            at[i] = (float2)(corner == 1 ? sides : corner == 2 ? 0.5f * sides : 0.0f, corner == 2 ? 0.8660254f * sides : 0.0f);
            q[corner] = shells.to_noise[0] * p.x + shells.to_noise[1] * p.y + shells.to_noise[2] * p.z;
        }
        start = q[0];
        by_x = (q[1] - q[0]) / sides;
        by_y = (q[2] - 0.5f * (q[0] + q[1])) / (0.8660254f * sides);
    }
    const float4 grad_x = (at[1].x - at[0].x) * to_b + (at[2].x - at[0].x) * to_c;
    const float4 grad_y = (at[1].y - at[0].y) * to_b + (at[2].y - at[0].y) * to_c;
    out[CORNERS * f] = (float4)(at[0].x, at[0].y, at[1].x, at[1].y);
    out[CORNERS * f + 1] = (float4)(at[2].x, at[2].y, sides, sqrt(sqrt(dot3(grad_x, grad_x) * dot3(grad_y, grad_y))));
    out[CORNERS * f + 2] = grad_x;
    out[CORNERS * f + 3] = grad_y;
    const float4 normal = normals[faces[f].x], upright = n / (dot3(n, normal) < 0.0f ? -sqrt(square) : sqrt(square));
    const float4 up = (flat ? normal : upright) / shells.size.x;
    out[CORNERS * f + 4] = (float4)(up.x, up.y, up.z, sqrt(dot3(grad_x, grad_x) + dot3(grad_y, grad_y)));
    out[CORNERS * f + 5] = start;
    out[CORNERS * f + 6] = by_x;
    out[CORNERS * f + 7] = by_y;
}

/* Perlin's improved noise (2002) at places 1/4 apart, two values each, with the lattice's own period. One work-item,
   one place. */
__kernel void noise(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    __global float2 *out)                  // [4 nz (1 if nz is 1), 4 ny, 4 nx]
{
    WORK_ITEM(i);
    const int4 n = shells.noise;
    const int4 place = (int4)((int)(i % (4 * n.x)), (int)(i / (4 * n.x) % (4 * n.y)), (int)(i / (16 * n.x * n.y)), 0);
    const int4 cell = place >> 2;
    const float4 t = convert_float4(place & 3) * 0.25f;
    const float4 fade = t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f);
    float2 sum = (float2)(0.0f);
    for (int corner = 0; corner < 8; ++corner) {
        const int4 d = (int4)(corner & 1, corner >> 1 & 1, corner >> 2, 0);
        const uint4 at = (uint4)((cell.x + d.x) % n.x, (cell.y + d.y) % n.y, (cell.z + d.z) % n.z, 0);
        const uint key = at.x * 0x9E3779B1u ^ at.y * 0x85EBCA77u ^ at.z * 0xC2B2AE3Du ^ (uint)shells.kind.y;
        const float4 from = t - convert_float4(d);
        const float weight = (d.x ? fade.x : 1 - fade.x) * (d.y ? fade.y : 1 - fade.y) * (d.z ? fade.z : 1 - fade.z);
        float value[2];
        for (int k = 0; k < 2; ++k) {
            /* One of the twelve edges of a cube. */
            uint h = key + (k ? 0x68E31DA4u : 0u);
            h ^= h >> 15;
            h *= 0x2C1B3C6Du;
            h ^= h >> 12;
            h *= 0x297A2D39u;
            h = (h ^ (h >> 15)) % 12u;
            const uint axis = h >> 2;
            const float u = axis == 0 ? from.y : from.x, v = axis == 2 ? from.y : from.z;
            value[k] = (h & 1 ? -u : u) + (h & 2 ? -v : v);
        }
        sum += weight * (float2)(value[0], value[1]);
    }
    out[i] = sum;
}

/* What many hairs are on average at each of HEIGHTS heights: the share covered, and how often one that goes sideways
   by 1 enters hair.  One work-item, one height. */
__kernel void means(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    const int around,                      // places in x and in y over one period, or over `around` / 8 cells
    __global float2 *out)                  // [HEIGHTS]
{
    WORK_ITEM(k);
    const lanes h = F((float)k / (HEIGHTS - 1));
    const float step = shells.kind.x ? 1.0f / around : 0.125f;
    float covered = 0.0f, entered = 0.0f;
    for (int j = 0; j < around; ++j)
        for (int way = 0; way < 2; ++way) {
            float before = 1.0f;
            for (int i = -1; i < around; i += LANES) {
                lanes u, by_x, by_y, top, fold;
                for (int n = 0; n < LANES; ++n)
                    LANE(u, n) = (i + n + 0.5f) * step;
                const lanes v = F((j + 0.5f) * step), x = way ? v : u, y = way ? u : v;
                const lanes high = shells.kind.x ? waves(&shells, x, y, &by_x, &by_y, &top, &fold)
                    : cells(&shells, 0, 1 << 30, x + 1e3f, y + 1e3f, F(0.0f), F(0.0f), &by_x, &by_y, &top, &fold);
                lanes here = sharp_cover(&shells, high, h);
                for (int n = 0; n < LANES && i + n < around; ++n) {
                    entered += LANE(here, n) > before ? LANE(here, n) - before : 0.0f;
                    covered += i + n < 0 || way ? 0.0f : LANE(here, n);
                    before = LANE(here, n);
                }
            }
        }
    out[k] = (float2)(covered / (around * around), entered / (2.0f * around * around * step));
}

/* What a ray through a cell's face is expected to cross there, as voxelize.lengths does for strands.  A hair is entered
   where the share covered rises along the ray: from the side as often as the table of means tells, from above by what
   the height adds.  Of hairs that are round, rise = side · cos(angle) + above; the mean over the angles of what of it is
   positive is the amount, taken to 4 % as below.  Each prism is divided into points of 3/4 cell at most, and what
   rounding leaves goes on to the next.  One work-item does ROWS rows of a face's points. */
__kernel void deposit(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    const Grid grid,
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const float4 *curves,         // [V, slabs + 1]
    __global const float4 *lattice,        // [F, CORNERS]
    __global const float2 *means,          // [HEIGHTS]
    const int parts,                       // work-items a face
    const float deep,                      // a cell's depth [world]
    const int binary,                      // 1: a cell that holds anything holds one crossing
    const uint weight,                     // amount of one crossing
    volatile __global uint *cells)         // [nz, ny, nx]
{
    WORK_ITEM(item);
    const int slabs = shells.kind.z, first_row = (int)(item % parts) * ROWS;
    const uint face = item / parts;
    const uint4 corners = faces[face];
    __global const float4 *pa = curves + (size_t)corners.x * (slabs + 1), *pb = curves + (size_t)corners.y * (slabs + 1),
        *pc = curves + (size_t)corners.z * (slabs + 1);
    /* Points stand no further apart than where the face is nearest to the light. */
    float square = 0.0f, near = INFINITY, far = 0.0f;
    int beyond = 63;                       // sides of the grid that all of the prism lies beyond, by more than a cell
    for (int k = 0; k <= slabs; ++k) {
        beyond &= beyond_grid(&grid, pa[k]) & beyond_grid(&grid, pb[k]) & beyond_grid(&grid, pc[k]);
        const float4 ab = pb[k] - pa[k], bc = pc[k] - pb[k], ca = pa[k] - pc[k];
        const float wa = distance_of(&grid, pa[k]), wb = distance_of(&grid, pb[k]), wc = distance_of(&grid, pc[k]);
        square = max(square, max(max(dot3(ab, ab), dot3(bc, bc)), dot3(ca, ca)));
        near = min(near, min(min(wa, wb), wc));
        far = max(far, max(max(wa, wb), wc));
    }
    const float step = POINT_STEP * min(grid.face.y * max(near, grid.face.z), deep);
    const int rows = (int)min(sqrt(square) / step, parts * ROWS - 1.0f) + 1;
    const int heights = (int)min(shells.size.x / (slabs * step), parts * ROWS - 1.0f) + 1;
    if (first_row >= rows || far < grid.face.w || beyond)
        return;

    const float4 first = lattice[CORNERS * face], second = lattice[CORNERS * face + 1];
    const float2 to_b = first.zw - first.xy, to_c = second.xy - first.xy;
    const int steps = (STEPS - 1) / (slabs * heights) + 1;
    float left = 0.5f, covered = mean_at(means, 0.0f).x;
    for (int level = 0; level < slabs * heights; ++level) {
        const int slab = level / heights;
        const float inside = (level % heights + 0.5f) / heights;
        const float low = (float)level / (slabs * heights), top = (float)(level + 1) / (slabs * heights);
        /* Between these heights: what is covered below and not above, and entries going sideways. */
        const float above = mean_at(means, top).x, newly = covered - above;
        covered = above;
        float entered = 0.0f;
        for (int k = 0; k < steps; ++k)
            entered += mean_at(means, low + (k + 0.5f) / (slabs * heights * steps)).y;
        const float sideways = entered / (heights * steps);

        const float4 up_a = pa[slab + 1] - pa[slab], up_b = pb[slab + 1] - pb[slab] - up_a,
                     up_c = pc[slab + 1] - pc[slab] - up_a;
        const float4 origin = pa[slab] + inside * up_a;
        const float4 ab = pb[slab] - pa[slab] + inside * up_b, ac = pc[slab] - pa[slab] + inside * up_c;
        const float4 n = cross3(ab, ac);
        const float each = weight * 0.25f / ((float)rows * rows * grid.face.x);
        for (int row = first_row; row < min(first_row + ROWS, rows); ++row)
            for (int k = 0; k <= 2 * row; ++k) {
                const int turned = k & 1;
                const float wb = (k / 2 + (1 + turned) / 3.0f) / rows;
                const float wc = (row - k / 2 - turned + (1 + turned) / 3.0f) / rows;
                const float4 p = origin + wb * ab + wc * ac;
                float w;
                const int4 at = to_cells(&grid, p, &w);
                if (at.x == OUTSIDE || (at.z < 0 && !grid.size.w))
                    continue;
                /* A spot's rays meet the cell's face, at distance w along its axis, at a slant: ray is w / cos long. */
                w = w > grid.face.w ? w : grid.face.w;
                const float4 ray = grid.light - grid.light.w * p, up = up_a + wb * up_b + wc * up_c;
                const float along_b = dot3(ray, cross3(ac, up)), along_c = dot3(ray, cross3(up, ab));
                const float2 move = along_b * to_b + along_c * to_c;
                const float side = sideways * sideways * (move.x * move.x + move.y * move.y);
                const float down = newly * dot3(ray, n) * (dot3(up, n) < 0.0f ? -1.0f : 1.0f);
                const float level_down = down < 0.0f ? -down : down;
                const float around = sqrt(4.0f * side + 0.5947153f * (down * down));
                const float both = down + (around > level_down ? around : level_down);
                const float exact = both * each / (w * w * w) + left;
                const uint amount = exact < 0x1p31f ? (uint)exact : 1u << 31;
                left = exact - amount < 1.0f ? exact - amount : 1.0f;
                if (!binary)
                    add_between(cells, &grid, at.x - SUBPIXEL / 2, at.y - SUBPIXEL / 2, layer(&grid, at.z >> 8), amount);
                else if (amount && in_grid(&grid, at.x >> 8, at.y >> 8, layer(&grid, at.z >> 8)))
                    atomic_max(&cells[((size_t)layer(&grid, at.z >> 8) * grid.size.y + (at.y >> 8)) * grid.size.x
                                      + (at.x >> 8)], weight);
            }
    }
}

/* What hair leaves in the cells of a sky's grid, see `deposit` of sky.cl: moments of two parts, one across the hairs and one
   along them, so that rays from aside meet as much as they enter there, and those from above as much as is newly covered.  One
   work-item takes one of a slab's `heights` of one face, at points 3/4 of a cell apart at most. */
__kernel void leave(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    const Sky sky,
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const float4 *curves,         // [V, slabs + 1]
    __global const float4 *lattice,        // [F, CORNERS]
    __global const float2 *means,          // [HEIGHTS]
    const int heights,                     // in which a slab is divided
    const int most,                        // rows of points on a face
    const float opaque,                    // optical depth of one crossing
    const float unit,                      // integers for 1
    volatile __global int *moments)        // [n, n, n, MOMENTS] xx, yy, zz, xy, xz, yz
{
    WORK_ITEM(item);
    const int slabs = shells.kind.z, levels = slabs * heights, level = item % levels, slab = level / heights, n = sky.size.x;
    const uint face = item / levels;
    const uint4 corners = faces[face];
    __global const float4 *pa = curves + (size_t)corners.x * (slabs + 1) + slab, *pb = curves + (size_t)corners.y * (slabs + 1) + slab,
        *pc = curves + (size_t)corners.z * (slabs + 1) + slab;
    const float inside = (level % heights + 0.5f) / heights, scale = sky.place.w;
    const float4 up_a = pa[1] - pa[0], up_b = pb[1] - pb[0] - up_a, up_c = pc[1] - pc[0] - up_a;
    const float4 origin = pa[0] + inside * up_a, ab = pb[0] - pa[0] + inside * up_b, ac = pc[0] - pa[0] + inside * up_c;
    const float4 across = cross3(ab, ac), bc = ac - ab;
    const float area = sqrt(dot3(across, across)), longest = max(max(dot3(ab, ab), dot3(ac, ac)), dot3(bc, bc));
    const float4 first = lattice[CORNERS * face], second = lattice[CORNERS * face + 1];
    const float2 to_b = first.zw - first.xy, to_c = second.xy - first.xy;
    if (!(area > 0.0f))
        return;
    /* Between these heights: crossings a unit of length from aside and from above. */
    const float low = (float)level / levels, top = (float)(level + 1) / levels, thick = shells.size.x / levels;
    float entered = 0.0f;
    for (int k = 0; k < STEPS; ++k)
        entered += mean_at(means, low + (k + 0.5f) / (levels * STEPS)).y * (1.0f / STEPS);
    const float aside = entered * sqrt(fabs(to_b.x * to_c.y - to_b.y * to_c.x) / area);
    const float down = max(mean_at(means, low).x - mean_at(means, top).x, 0.0f) / thick;
    const float density = sqrt(aside * aside + 0.5f * down * down);
    const float flat = density > 0.0f ? min(down * down / density, density) : 0.0f, upright = density - flat;
    const int rows = (int)min(sqrt(longest) * scale / POINT_STEP, most - 1.0f) + 1;
    for (int row = 0; row < rows; ++row)
        for (int k = 0; k <= 2 * row; ++k) {
            const int turned = k & 1;
            const float wb = (k / 2 + (1 + turned) / 3.0f) / rows, wc = (row - k / 2 - turned + (1 + turned) / 3.0f) / rows;
            const float4 c = (origin + wb * ab + wc * ac - sky.place) * scale, up = up_a + wb * up_b + wc * up_c;
            if (!(c.x >= 0.0f && c.y >= 0.0f && c.z >= 0.0f && c.x < n && c.y < n && c.z < n))
                continue;
            const float volume = fabs(dot3(across, up)) * (0.5f / heights) / ((float)rows * rows);
            const float4 t = unit_or(up, (float4)(0.0f, 1.0f, 0.0f, 0.0f));
            const float each = opaque * volume * scale * scale * unit, even = 0.5f * flat * each, along = upright * each - even;
            const float sums[MOMENTS] = {even + along * t.x * t.x, even + along * t.y * t.y, even + along * t.z * t.z,
                                         along * t.x * t.y, along * t.x * t.z, along * t.y * t.z};
            volatile __global int *cell = moments + (size_t)(((int)c.z * n + (int)c.y) * n + (int)c.x) * MOMENTS;
            #pragma unroll
            for (int j = 0; j < MOMENTS; ++j)
                atomic_add(&cell[j], (int)(sums[j] < 0.0f ? sums[j] - 0.5f : sums[j] + 0.5f));
        }
}

/* The outputs but color (AOVs) of what the nearest sample of one pixel sees, where that is fur: of a hair there, as of a
   strand.  One work-item, one pixel. */
__kernel void outputs(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const int slabs,
    __global const ulong *visible,         // [rows, width, samples] what else is drawn
    __global const ulong *shell_front,     // [rows, width, samples] depth << 32 | face, see march
    __global const float *transmittance,   // [rows, width, samples] share of light that comes from behind all hair
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const float4 *curves,         // [V, slabs + 1]
    __global const float4 *uv,             // [F * 3] u, v of these corners
    __global float *out_depth,             // [rows, width] distance along the view axis
    __global int *out_id,                  // ID_SHELLS
    __global float4 *out_tangent,          // unit: the hair's direction
    __global float4 *out_normal,           // unit, towards the eye: across the hair
    __global float4 *out_uv,               // of the root
    __global float *out_coverage)          // share of light that does not come from behind everything
{
    WORK_ITEM(pixel);
    const int x = view.rows.z + (int)(pixel % view.size.x), y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    ulong key = ~0ul;
    uint other = NOTHING;
    int nearest = 0;
    for (int s = 0; s < samples; ++s) {
        const ulong drawn = visible[pixel * samples + s], there = shell_front[pixel * samples + s];
        other = min(other, (uint)(drawn >> 32));
        if (there < key) {
            key = there;
            nearest = s;
        }
    }
    out_coverage[pixel] = covered_share(visible, transmittance, pixel, samples);
    if (key == ~0ul || (uint)(key >> 32) >= other)
        return;
    const float4 p = seen_point(&view, x, y, nearest, (uint)(key >> 32)), v = towards_eye(&view, p);
    const uint face = (uint)key;
    const uint4 corners = faces[face];
    __global const float4 *curve[3] = {curves + corners.x * (slabs + 1), curves + corners.y * (slabs + 1),
                                       curves + corners.z * (slabs + 1)};
    /* The tetrahedron that p lies in, or is the least beside. */
    float best = -INFINITY, share[3] = {1.0f, 0.0f, 0.0f};   // of each corner of the face
    int slab = 0;
    for (int i = 0; i < 3 * slabs; ++i) {
        const int k = i % 3, four[4] = {0, k == 2 ? 3 : 1, k == 0 ? 2 : 4, 5};
        float4 q[4];
        for (int j = 0; j < 4; ++j)
            q[j] = curve[four[j] % 3][i / 3 + four[j] / 3] - p;
        const float4 w = (float4)(dot3(cross3(q[1], q[2]), q[3]), -dot3(cross3(q[2], q[3]), q[0]),
                                  dot3(cross3(q[3], q[0]), q[1]), -dot3(cross3(q[0], q[1]), q[2]));
        const float all = (w.x + w.y) + (w.z + w.w);
        const float part[4] = {w.x / all, w.y / all, w.z / all, w.w / all};
        const float least = min(min(part[0], part[1]), min(part[2], part[3]));
        if (all != 0.0f && least > best) {
            best = least;
            slab = i / 3;
            share[0] = share[1] = share[2] = 0.0f;
            for (int j = 0; j < 4; ++j)
                share[four[j] % 3] += part[j];
        }
    }
    float4 along = (float4)(0.0f), root_uv = along;
    for (int j = 0; j < 3; ++j) {
        along += share[j] * (curve[j][slab + 1] - curve[j][slab]);
        root_uv += share[j] * uv[3 * face + j];
    }
    const float4 tangent = unit_or(along, v);
    out_depth[pixel] = depth_along(&view, p, (uint)(key >> 32));
    out_id[pixel] = ID_SHELLS;
    out_tangent[pixel] = tangent;
    out_normal[pixel] = unit_or(v - dot3(v, tangent) * tangent, v);
    out_uv[pixel] = root_uv;
}
