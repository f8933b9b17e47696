/*
 * Shell fur: hair as a height field on the skin, between the mesh and a surface one length above it.
 *
 * The space between them is divided into prisms over the faces, in `slabs` one above the other, each of three
 * tetrahedra, so that a place in the fur is linear along a ray in each of them.  A ray walks from one to the next
 * (Maria, Horna and Aveneau, "Efficient ray traversal of constrained Delaunay tetrahedralization", 2017) and looks at
 * the fur wherever it has passed one more layer, or as much sideways.  Corners of a face are taken in the order of their
 * numbers, so that neighbours divide the side between them alike.  What a place in the fur is called:
 *   h        height, 0 on the skin and 1 at the longest tips
 *   x, y     place in the pattern, on every face linear: "cells" are triangles with sides of 1, "sine" has periods of 1
 */
#include "light.h"
#include "cells.h"
#include "lanes.h"

#define CORNERS 5       // float4 a face in `lattice`
#define HEIGHTS 64      // of the table of means
#define CELL_RADIUS 0.62f   // of a hair at its root, in sides of a cell: it reaches just beyond the cell's corners
#define SIDEWAYS 8.0f    // looks on the way across one x or y, down to one where hairs are seen on average
#define SHARP 0.85f     // of a pixel's width counts as footprint: least error against 8 x 8 samples (tools/shells_laws.py)
#define FAR_FROM 0.3f   // pixels that are so many sides of a cell wide begin to see hairs on average,
#define FAR_TO 0.9f     // and those of so many see nothing else
#define ROWS 16         // of a face's points in the light's grid that a work-item does
#define LOOKS 16        // at the table of means, at least, from the skin to the tips
#define MOST_STEPS 20000    // tetrahedra on one way, on average: no scene that is any good has so many

/* sin(2 pi r), |r| <= 1/4, to 1e-7 (Taylor).  Words and not a function: what is told to round each step may do so. */
#define QUARTER(r, z) ((r) * ((6.2831853f - 41.341702f * (z) + (z) * (z) * (81.605249f - 76.705860f * (z))) \
                              + (z) * (z) * ((z) * (z)) * (42.058694f - 15.094643f * (z))))

INLINED lanes quarter(lanes r)
{
    return QUARTER(r, r * r);
}

/* sin(2 pi x) and cos(2 pi x); + and * alone, so that they are the same bits everywhere. */
INLINED lanes sin_turns(lanes x)
{
    const lanes y = x - 0.25f;
    return quarter(0.25f - positive(y - nearest(y)));
}

INLINED lanes cos_turns(lanes x)
{
    return quarter(0.25f - positive(x - nearest(x)));
}

INLINED lanes_u mixed(lanes_u x)
{
    x ^= x >> 15;
    x *= 0x2C1B3C6Du;
    x ^= x >> 12;
    x *= 0x297A2D39u;
    return x ^ (x >> 15);
}

/* Ten bits as 0..1. */
INLINED lanes share(lanes_u bits)
{
    return AS_F((bits & 1023u) << 13 | 0x3F800000u) - 1.0f;
}

/* The way hairs are bent at each vertex: places at heights 0, 1/slabs .. 1, all steps equally long, so that layers keep
   their distance (the report's wind, after Bakay, Lalonde and Heidrich 2002).  One work-item bends one vertex. */
__kernel void bend(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    __global const float4 *positions,      // [V]
    __global const float4 *normals,        // [V] unit
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
    const float4 force = shells.bend + (0.7f + 0.3f * wave) * shells.wind;
    for (int k = 0; k < slabs; ++k) {
        curves[vertex * (slabs + 1) + k] = p;
        p += (shells.size.x / slabs) * unit_or(n + ((k + 0.5f) / slabs) * force, n);
    }
    curves[vertex * (slabs + 1) + slabs] = p;
}

/* Where the corners of a face lie in the pattern, and how x and y change in the world.  One work-item, one face. */
__kernel void lattice(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Shells shells,
    __global const float4 *positions,      // [V]
    __global const float4 *normals,        // [V]
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const float4 *uv,             // [F * 3] u, v of these corners
    __global float4 *out)                  // [F, CORNERS] x0 y0 x1 y1; x2 y2 cells-a-side density; gradients of x, y and h;
                                           // the most that x and y together can change
{
    WORK_ITEM(f);
    const float4 a = positions[faces[f].x], b = positions[faces[f].y] - a, c = positions[faces[f].z] - a;
    const float4 n = cross3(b, c);
    const float square = dot3(n, n);
    const float4 to_b = cross3(c, n) / square, to_c = cross3(n, b) / square;   // gradients of the corners' weights
    float2 at[3];
    float sides = 0.0f;
    if (shells.kind.x) {
        for (int i = 0; i < 3; ++i)
            at[i] = (float2)(2.0f * shells.size.z * uv[3 * f + i].x, shells.size.z * uv[3 * f + i].y);
    } else {
        sides = clamp(floor(shells.size.z * sqrt(0.5f * sqrt(square)) + 0.5f), 1.0f, 4096.0f);
        at[0] = (float2)(0.0f);
        at[1] = (float2)(sides, 0.0f);
        at[2] = (float2)(0.5f * sides, 0.8660254f * sides);
    }
    const float4 grad_x = (at[1].x - at[0].x) * to_b + (at[2].x - at[0].x) * to_c;
    const float4 grad_y = (at[1].y - at[0].y) * to_b + (at[2].y - at[0].y) * to_c;
    out[CORNERS * f] = (float4)(at[0].x, at[0].y, at[1].x, at[1].y);
    out[CORNERS * f + 1] = (float4)(at[2].x, at[2].y, sides, sqrt(sqrt(dot3(grad_x, grad_x) * dot3(grad_y, grad_y))));
    out[CORNERS * f + 2] = grad_x;
    out[CORNERS * f + 3] = grad_y;
    const float4 up = n / (dot3(n, normals[faces[f].x]) < 0.0f ? -sqrt(square) : sqrt(square)) / shells.size.x;
    out[CORNERS * f + 4] = (float4)(up.x, up.y, up.z, sqrt(dot3(grad_x, grad_x) + dot3(grad_y, grad_y)));
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

/* The noise at a place in units of its lattice, between the eight around it. */
INLINED float2 noise_at(const Shells *shells, __global const float2 *noise, float4 p)
{
    const int4 n = (int4)(4 * shells->noise.x, 4 * shells->noise.y, shells->noise.z > 1 ? 4 * shells->noise.z : 1, 1);
    const float4 at = p * 4.0f;
    const float4 below = (at - 0.5f + SHIFT) - SHIFT, f = at - below;
    const int4 low = (int4)((int)below.x, (int)below.y, (int)below.z, 0);
    /* On the skin the noise closes where uv does; in space its sides are powers of two, which are quicker. */
    const int4 wrapped = shells->kind.x ? low % n : low & (n - 1), a = wrapped + (wrapped < 0 ? n : (int4)(0)), b = a + 1 < n ? a + 1 : (int4)(0);
    const int ya = a.y * n.x, yb = b.y * n.x, plane = n.x * n.y;
    __global const float2 *near = noise + (size_t)a.z * plane, *far = noise + (size_t)b.z * plane;
    const float2 front = (1 - f.y) * ((1 - f.x) * near[ya + a.x] + f.x * near[ya + b.x])
        + f.y * ((1 - f.x) * near[yb + a.x] + f.x * near[yb + b.x]);
    if (n.z == 1)
        return front;
    const float2 back = (1 - f.y) * ((1 - f.x) * far[ya + a.x] + f.x * far[ya + b.x])
        + f.y * ((1 - f.x) * far[yb + a.x] + f.x * far[yb + b.x]);
    return (1 - f.z) * front + f.z * back;
}

/* The report's fur function, halved so that it reaches 1: its threshold (2/sqrt f)·h of value/sqrt f is then h. */
INLINED lanes waves(const Shells *shells, lanes x, lanes y, lanes *by_x, lanes *by_y, lanes *top, lanes *fold)
{
    *top = F(1.0f);
    *fold = F(1.0f - 1.0f / shells->shape.y);
    const lanes sum = sin_turns(x) + sin_turns(y);
    const float thin = 1.0f / shells->shape.y;
    const lanes slope = sum < 0.0f ? F(-3.1415927f * thin) : F(3.1415927f * thin);
    *by_x = slope * cos_turns(x);
    *by_y = slope * cos_turns(y);
    return 1.0f - thin * (1.0f - 0.5f * positive(sum));
}

/* Cones, one on each triangle of a lattice, the highest of the four that are nearest. Those beyond the face's border are
   left out, as the face behind it has its own; sides: cells along a side of the face. */
INLINED lanes cells(const Shells *shells, uint face, int sides, lanes x, lanes y, lanes lean_x, lanes lean_y,
                    lanes *by_x, lanes *by_y, lanes *top, lanes *fold)
{
    const float thin = 1.0f / (CELL_RADIUS * shells->shape.y);
    x -= lean_x;
    y -= lean_y;
    const lanes v = y * 1.1547005f, u = x - 0.5f * v, fu = nearest(u - 0.5f), fv = nearest(v - 0.5f);
    const lanes_i i = nearest_i(u - 0.5f), j = nearest_i(v - 0.5f), down = (u - fu) + (v - fv) > 1.0f;
    lanes best = F(-1.0f), second = best, steep = F(0.0f);
    *by_x = *by_y = F(0.0f);
    *top = F(1.0f);
    for (int n = 0; n < 4; ++n) {
        /* This cell and the three across its sides, which point the other way. */
        const lanes_i next = down ? I(1) : I(-1), turned = n ? (down ? I(0) : I(1)) : (down ? I(1) : I(0));
        const lanes_i at_i = n == 2 ? i + next : i, at_j = n == 3 ? j + next : j;
        const lanes du = n == 2 ? (down ? fu + 1.0f : fu - 1.0f) : fu, dv = n == 3 ? (down ? fv + 1.0f : fv - 1.0f) : fv;
        const lanes_u random = mixed((AS_U(at_i) * 0x9E3779B1u) ^ (AS_U(at_j) * 0x85EBCA77u)
                                     ^ ((2u * face + AS_U(turned)) * 0xC2B2AE3Du) ^ (uint)shells->kind.y);
        const lanes third = n ? (down ? F(1.0f / 3.0f) : F(2.0f / 3.0f)) : (down ? F(2.0f / 3.0f) : F(1.0f / 3.0f));
        const lanes cu = du + third, cv = dv + third;
        const lanes dx = x - (cu + 0.5f * cv + 0.3f * (share(random) - 0.5f));
        const lanes dy = y - (0.8660254f * cv + 0.3f * (share(random >> 10) - 0.5f));
        const lanes off = root(dx * dx + dy * dy + 1e-12f), tall = 1.0f - shells->size.w * share(random >> 20);
        const lanes high = tall - tall * off * thin;
        const lanes_i inside = (at_i >= 0) & (at_j >= 0) & (at_i + at_j + turned < sides), better = inside & (high > best);
        second = better ? best : (inside & (high > second)) ? high : second;
        best = better ? high : best;
        steep = better ? tall / off : steep;
        *top = better ? tall : *top;
        *by_x = better ? dx : *by_x;
        *by_y = better ? dy : *by_y;
    }
    *fold = 0.5f * (best + second);
    *by_x *= -thin * steep;
    *by_y *= -thin * steep;
    return best;
}

/* Height of the fur at a place, its gradient by x and y, and the heights of its hair's tip and of the fold
   before the next hair: hair is where this is more than h.
   `moved`: the noise there. */
INLINED lanes height_at(const Shells *shells, uint face, int sides, lanes x, lanes y, lanes moved_x, lanes moved_y, lanes h,
                        lanes *by_x, lanes *by_y, lanes *top, lanes *fold)
{
    if (shells->kind.x)
        return waves(shells, x + moved_x, y + moved_y, by_x, by_y, top, fold);
    return cells(shells, face, sides, x, y, moved_x * h, moved_y * h, by_x, by_y, top, fold);
}

/* Share of a place at height h that hair covers, where the fur is v high: the report's threshold and smoothstep. */
INLINED lanes sharp_cover(const Shells *shells, lanes v, lanes h)
{
    const lanes u = within((v - h) / greater((shells->shape.x - 1.0f) * h, F(1e-3f)), 0.0f, 1.0f);
    return u * u * (3.0f - 2.0f * u);
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

INLINED float2 mean_at(__global const float2 *means, float h)
{
    const float at = (h < 0.0f ? 0.0f : h > 1.0f ? 1.0f : h) * (HEIGHTS - 1);
    const int k = at < HEIGHTS - 2 ? (int)at : HEIGHTS - 2;
    return means[k] + (at - k) * (means[k + 1] - means[k]);
}

/* Products may be added unrounded here and among march's looks: no whole number hangs on them.  Elsewhere it costs. */
#pragma OPENCL FP_CONTRACT ON
/* As root, in fewer steps. */
INLINED lanes quick_root(lanes x)
{
    const lanes half_x = 0.5f * x;
    lanes y = AS_F(U(0x5F375A86u) - (AS_U(x) >> 1));
    y *= 1.5f - half_x * y * y;
    y *= 1.5f - half_x * y * y;
    return x * y;
}

/* Integral of smoothstep(0, 1, u) over u, and 1. */
INLINED lanes integral(lanes u)
{
    const lanes c = within(u, 0.0f, 1.0f);
    return c * c * c * (1.0f - 0.5f * c) + greater(u, F(1.0f));
}

/* The same, averaged over a footprint: all in units of the smoothstep and from its start.  The fur's height there goes
   from u - reach to u + reach, but beyond the tip `top` it goes down again, and up beyond the `fold` before the next hair;
   scale: 1 / (2 reach). */
INLINED lanes cover(lanes u, lanes reach, lanes top, lanes fold, lanes scale)
{
    const lanes low = u - reach, high = u + reach;
    const lanes_i over = high > top, under = low < fold;
    lanes sum;
    if (any_lane(over | under)) {
        const lanes a = integral(under ? 2.0f * fold - low : low), b = integral(over ? 2.0f * top - high : high);
        sum = (over ? 2.0f * integral(top) - b : b) + (under ? a - 2.0f * integral(fold) : -a);
    } else {
        sum = integral(high) - integral(low);
    }
    return within(sum * scale, 0.0f, 1.0f);
}

/* Share of light that many hairs let through, from h0 to h and as far as `aside` sideways.  A hair's flanks are met from
   above, from the side or both: what rays go through is the mean over all directions that flanks face of max(0, down +
   side·cos), here by a parabola through its ends, 1 % too large at most. */
INLINED float kept_by_many(__global const float2 *means, float h0, float h, float aside)
{
    const float2 a = mean_at(means, h0), b = mean_at(means, h);
    const float before = a.x < 0.999f ? a.x : 0.999f, now = b.x < 0.999f ? b.x : 0.999f;
    const float down = now > before ? log2((1.0f - before) / (1.0f - now)) : 0.0f;
    const float side = 4.5323601f * b.y * aside / (1.0f - 0.5f * (before + now));    // pi / log(2)
    const float share = side > 0.0f ? down / side : 2.0f;
    return exp2(-(share < 1.0f ? side * (0.31830989f + share * (0.5f + share * 0.18169011f)) : down));
}

#pragma OPENCL FP_CONTRACT OFF
/* What a ray needs to light the fur. */
typedef struct {
    const Shells *shells;
    const Light *light;
    const Shadow *shadow;
    const Grid *grid;
    __global const float *sums;
    const View *seen;
    __global const ulong *map;
    int half_vector;
} Lamp;

/* sqrt(1 - c^2) */
INLINED lanes sines(lanes c)
{
    return root(greater(1.0f - c * c, F(1e-12f)));
}

/* Light from places p at heights h: t the hair's direction, n the skin's normal, slope the fur's gradient in the world, v
   the way to the eye.  Kajiya and Kay's hair, or the report's turned normals: those of the height field.  Both fade
   to the roots. */
INLINED lanes3 lit(const Lamp *lamp, lanes_i lanes_on, lanes3 p, lanes h, lanes3 t, lanes3 n, lanes3 slope, lanes3 v)
{
    const Shells *shells = lamp->shells;
    lanes3 l = all_lanes(-lamp->light->direction);
    lanes part = F(1.0f);
    if (lamp->light->position.w > 0.0f) {
        const lanes3 to_light = {lamp->light->position.x - p.x, lamp->light->position.y - p.y, lamp->light->position.z - p.z};
        const lanes inside = -dots(unit(to_light), all_lanes(lamp->light->direction));
        l = unit(to_light);
        part = inside >= lamp->light->cone.x ? F(1.0f) : F(0.0f);
    }
    if (lamp->shadow->body.x || lamp->shadow->hair.x > 0.0f)
        for (int i = 0; i < LANES; ++i)
            if (LANE_I(lanes_on, i) && LANE(part, i) > 0.0f) {
                const float4 place = (float4)(LANE(p.x, i), LANE(p.y, i), LANE(p.z, i), 0.0f);
                if (lamp->shadow->body.x)
                    LANE(part, i) *= past_body(lamp->seen, lamp->map, lamp->shadow->body.y, place,
                        (float4)(LANE(n.x, i), LANE(n.y, i), LANE(n.z, i), 0.0f), 5.0f, 1.0f + 2 * lamp->shadow->body.y);
                if (lamp->shadow->hair.x > 0.0f)
                    LANE(part, i) *= through_hair(lamp->grid, lamp->sums, lamp->shadow->hair.x, (float2)(0.0f), place);
            }
    lanes bright, mirror, shine = F(0.0f);
    if (shells->shine.w > 0.0f) {
        const lanes3 turned = unit(plus(n, scaled(slope, F(-shells->size.x))));
        bright = greater(dots(turned, l), F(0.0f));
        mirror = bright > 0.0f ? dots(turned, unit(plus(l, v))) : F(0.0f);
    } else {
        const lanes tl = dots(t, l), tv = dots(t, v);
        bright = sines(tl);
        if (lamp->half_vector) {
            const lanes3 middle = plus(l, v);
            mirror = dots(middle, middle) > 1e-12f ? sines(dots(t, unit(middle))) : F(0.0f);
        } else {
            mirror = bright * sines(tv) - tl * tv;
        }
    }
    mirror = within(mirror, 0.0f, 1.0f);
    const lanes_i shines = (1.0f - mirror) * shells->shine.y < 16.0f;   // elsewhere it is below exp(-16)
    if (shells->shine.x > 0.0f && any_lane(lanes_on & shines))
        shine = shines ? shells->shine.x * power(greater(mirror, F(1e-30f)), shells->shine.y) : F(0.0f);
    const float4 direct = lamp->light->color;
    const lanes fade = shells->color.w + (1.0f - shells->color.w) * h;
    const lanes3 color = {
        fade * (part * direct.x * (shells->color.x * bright + shine) + direct.w * shells->color.x),
        fade * (part * direct.y * (shells->color.y * bright + shine) + direct.w * shells->color.y),
        fade * (part * direct.z * (shells->color.z * bright + shine) + direct.w * shells->color.z)};
    return color;
}

/* Corners of the tetrahedra of a prism (0 1 2 below, 3 4 5 above them), and which way a ray leaves them that leaves out
   one of these: 4 · tetrahedron + the corner left out there; SIDE + 2 · side + 1 for the upper half of it, to the
   neighbour across that side (0: corners 1 2, 1: 0 2, 2: 0 1); DOWN, UP. */
#define SIDE 16
#define DOWN 24
#define UP 25
__constant uchar CORNER[12] = {
    0, 1, 2, 5,
    0, 1, 4, 5,
    0, 3, 4, 5,
};
__constant uchar WAY[12] = {
    SIDE, SIDE + 2, 4 + 2, DOWN,
    SIDE + 1, 8 + 1, 2, SIDE + 4,
    UP, 4 + 1, SIDE + 3, SIDE + 5,
};
/* Where a ray comes in by the lower and the upper half of each side: as above. */
__constant uchar BEHIND[6] = {0, 4 + 0, 1, 8 + 2, 4 + 3, 8 + 3};

inline uint depth_of(const View *view, float4 p)
{
    const float4 q = to_screen(view, p);
    return DEPTH_ONE - (uint)clamp(q.z / q.w * (float)DEPTH_ONE, 0.0f, (float)DEPTH_ONE);
}

/* From the eye to what samples see, as seen_point. */
INLINED lanes3 from_eye(const View *view, float4 eye, lanes x, lanes y, lanes e)
{
    const float4 a = view->to_world[0], b = view->to_world[1], c = view->to_world[2], d = view->to_world[3];
    const lanes w = 1.0f / (a.w * x + b.w * y + c.w * e + d.w);
    const lanes3 p = {(a.x * x + b.x * y + c.x * e + d.x) * w - eye.x, (a.y * x + b.y * y + c.y * e + d.y) * w - eye.y,
                      (a.z * x + b.z * y + c.z * e + d.z) * w - eye.z};
    return p;
}

/* Weights of a tetrahedron's corners where a ray goes through the side that leaves out corner `out`, from the areas
   that pairs of corners span with the ray. */
INLINED void weights(lanes_i out, const lanes e[6], lanes w[4])
{
    /* e: 01 02 03 12 13 23 */
    const lanes_i a = out == 0, b = out == 1, c = out == 2;
    w[0] = a ? F(0.0f) : b ? e[5] : c ? e[4] : e[3];
    w[1] = a ? e[5] : b ? F(0.0f) : c ? -e[2] : -e[1];
    w[2] = a ? -e[4] : b ? -e[2] : c ? F(0.0f) : e[0];
    w[3] = a ? e[3] : b ? e[1] : c ? e[0] : F(0.0f);
    const lanes sum = (w[0] + w[1]) + (w[2] + w[3]);
    const lanes_i flat = sum == 0.0f;
    const lanes scale = 1.0f / (flat ? F(1.0f) : sum);
    for (int i = 0; i < 4; ++i)
        w[i] = flat ? F(0.25f) : w[i] * scale;
}

/* One work-item takes the samples of LANES pixels through the fur, from where they enter it to where they leave it, meet
   what is drawn, or see no further; and adds their light to the picture. */
__kernel void march(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const Shells shells,
    const Light light,
    const int half_vector,
    __global const ulong *visible,         // [rows, width, samples] what else is drawn
    __global const ulong *entries,         // [rows, width, samples] where they enter: depth << 32 | BODY | border triangle
    __global const uint4 *border,          // [B] face; 4 · (3 · slab + tetrahedron) + corner left out; -; -
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const int4 *neighbours,       // [F] 4 · face + its side, across each side; -1: none
    __global const float4 *curves,         // [V, slabs + 1]
    __global const float4 *normals,        // [V]
    __global const float4 *lattice,        // [F, CORNERS]
    __global const float2 *noise,
    __global const float2 *means,          // [HEIGHTS]
    const float4 noise_box,                // origin of the noise, its lattices a unit of length
    const Shadow shadow,
    const Grid grid,
    __global const float *sums,
    const View seen,
    __global const ulong *map,
    __global uint *after,                  // [rows, width, samples] depth where they came in last; NOTHING: they are done
    __global float *through,               // [rows, width, samples] share of light that comes from behind
    __global ulong *fur,                   // [rows, width, samples] depth << 32 | face where half of it is gone
    volatile __global int *left,           // samples that are not done
    __global float4 *image)                // [rows, width]
{
    WORK_ITEM(item);
    const int rows = view.rows.y - view.rows.x, across_blocks = (view.size.x + BLOCK_X - 1) / BLOCK_X;
    const int block_x = item % across_blocks * BLOCK_X, block_y = item / across_blocks * BLOCK_Y;
    const int samples = view.size.z, slabs = shells.kind.z;
    const Lamp lamp = {&shells, &light, &shadow, &grid, sums, &seen, map, half_vector};
    const float4 eye = (float4)(view.eye.xyz, 0.0f);
    const float finer = 1.0f / (view.scale.x * sqrt((float)samples)), slabs_inverse = 1.0f / slabs;
    /* How fast the fur's height can change sideways, and with the height; 6 and 1.5 bound the noise's slope and size. */
    const float steep_here = (shells.kind.x ? 4.4428830f : 1.0f / CELL_RADIUS) / shells.shape.y;
    const float steep_noise = steep_here * 6.0f * shells.shape.z / shells.shape.w;     // of cells at the tips, which lean
    const float steep_up = shells.kind.x ? 0.0f : 1.5f * steep_here * shells.shape.z;
    const float steepest = 1.0f / shells.size.x;      // gradient of h
    const float half_thin = 0.5f / shells.shape.y, thinned = 1.0f - 2.0f * half_thin, smooth = shells.shape.x - 1.0f;
    int pending = 0;

    for (int s = 0; s < samples; ++s) {
        /* Rays: direction, two axes across it, distances from the eye; and where each is. */
        lanes dx, dy, dz, ax, ay, az, ux, uy, uz, stop, wide, rest, front = F(0.0f);
        lanes_i cell, in;                  // 3 · (slabs · face + slab) + tetrahedron, -1: at rest; corner left out
        lanes_i half_face = I(-1);
        lanes half_way = F(0.0f);
        cell = I(-1);
        in = I(0);
        lanes_i by = I(-1);                // border triangle where each comes in
        rest = F(0.0f);
        lanes at_x = rest, at_y = rest, depth = rest, behind = F(-1.0f);
        lanes3 q[3] = {all_lanes((float4)(0.0f, 0.0f, 1.0f, 0.0f)), all_lanes((float4)(1.0f, 0.0f, 1.0f, 0.0f)),
                       all_lanes((float4)(0.0f, 1.0f, 1.0f, 0.0f))};
        bool none = true;
        for (int i = 0; i < LANES; ++i) {
            const int x = block_x + i % BLOCK_X, y = block_y + i / BLOCK_X;
            if (x >= view.size.x || y >= rows)
                continue;
            const size_t sample = ((size_t)y * view.size.x + x) * samples + s;
            const ulong entry = entries[sample];
            const uint stop_depth = (uint)(visible[sample] >> 32), entry_depth = (uint)(entry >> 32);
            const bool enters = (uint)entry != NOTHING && entry_depth < stop_depth;
            after[sample] = enters ? entry_depth : NOTHING;   // fur that stands in other fur comes after it
            if (!enters)
                continue;
            none = false;
            LANE_I(by, i) = (int)((uint)entry & ~BODY);
            LANE(at_x, i) = x;
            LANE(at_y, i) = y + view.rows.x;
            LANE(depth, i) = (float)(DEPTH_ONE - entry_depth) * (1.0f / DEPTH_ONE);
            LANE(behind, i) = stop_depth == NOTHING ? -1.0f : (float)(DEPTH_ONE - stop_depth) * (1.0f / DEPTH_ONE);
            LANE(rest, i) = through[sample];
        }
        if (none)
            continue;
        /* Most come in by the same few triangles. */
        for (int triangle = most_lane(by); triangle >= 0; triangle = most_lane(by)) {
            const lanes_i group = by == triangle;
            const uint4 start = border[triangle], f = faces[start.x];
            const int k = start.y / 4 % 3, out = start.y % 4, slab = start.y / 12;
            for (int n = 0, m = 0; n < 4; ++n)
                if (n != out) {
                    const int c = CORNER[4 * k + n], side = c < 3 ? c : c - 3;
                    const float4 corner = curves[(side == 0 ? f.x : side == 1 ? f.y : f.z) * (slabs + 1) + slab + (c >= 3)] - eye;
                    q[m].x = group ? F(corner.x) : q[m].x;
                    q[m].y = group ? F(corner.y) : q[m].y;
                    q[m].z = group ? F(corner.z) : q[m].z;
                    ++m;
                }
            cell = group ? I(3 * (slabs * (int)start.x + slab) + k) : cell;
            in = group ? I(out) : in;
            by = group ? I(-1) : by;
        }
        {
            /* Snapped corners and rounded depths leave the point a little beside the triangle: put it in. */
            const int2 offset = PATTERN[view.size.w + s];
            at_x += 0.5f + offset.x * (1.0f / SUBPIXEL);
            at_y += 0.5f + offset.y * (1.0f / SUBPIXEL);
            const lanes3 p = from_eye(&view, eye, at_x, at_y, depth);
            const lanes3 a = plus(q[0], scaled(p, F(-1.0f))), b = plus(q[1], scaled(p, F(-1.0f))),
                c = plus(q[2], scaled(p, F(-1.0f)));
            const lanes3 n = crosses(plus(b, scaled(a, F(-1.0f))), plus(c, scaled(a, F(-1.0f))));
            const lanes smaller = 1.0f / greater(dots(n, n), F(1e-37f));
            const lanes wa = greater(dots(crosses(b, c), n) * smaller, F(1e-3f)),
                wb = greater(dots(crosses(c, a), n) * smaller, F(1e-3f)), wc = greater(dots(crosses(a, b), n) * smaller, F(1e-3f));
            const lanes3 d = unit(plus(scaled(q[0], wa), plus(scaled(q[1], wb), scaled(q[2], wc))));
            /* Two axes across the ray (Duff et al. 2017). */
            const lanes sign = d.z >= 0.0f ? F(1.0f) : F(-1.0f), u = -1.0f / (sign + d.z), uv = d.x * d.y * u;
            dx = d.x;
            dy = d.y;
            dz = d.z;
            ax = 1.0f + sign * d.x * d.x * u;
            ay = sign * uv;
            az = -sign * d.x;
            ux = uv;
            uy = sign + d.y * d.y * u;
            uz = -d.y;
            stop = behind >= 0.0f ? dots(from_eye(&view, eye, at_x, at_y, behind), d) : F(INFINITY);
            wide = (view.to_screen[0].w * d.x + view.to_screen[1].w * d.y + view.to_screen[2].w * d.z) * finer;   // of a pixel, at 1
        }
        lanes red = F(0.0f), green = red, blue = red, alpha = red;
        lanes until = F(0.5f), aside = red, uncovered_inverse = F(1.0f), slack = red;   // to the next look; since the last one
        lanes at_depth = red;              // distance where each is
        lanes_i leaves = I(0);

        for (int step = 0; step < MOST_STEPS * LANES; ++step) {
            /* The tetrahedron of the ray that has come least far, and all rays in it. */
            const lanes waiting = cell >= 0 ? at_depth : F(INFINITY);
            const lanes_i next_ones = (cell >= 0) & (waiting == least_lane(waiting));
            const int here = most_lane(next_ones ? cell : I(-1));
            if (here < 0)
                break;
            const lanes_i group = cell == here;
            const int k = here % 3, slab = here / 3 % slabs, face = here / 3 / slabs;
            const uint4 corners = faces[face];
            const float4 first = lattice[CORNERS * face], second = lattice[CORNERS * face + 1];
            const float4 grad_x = lattice[CORNERS * face + 2], grad_y = lattice[CORNERS * face + 3];
            const float4 up = lattice[CORNERS * face + 4];
            lanes fx[4], fy[4], ahead[4], e[6], w[4];
            float top[4], px[4], py[4];
            for (int i = 0; i < 4; ++i) {
                const int c = CORNER[4 * k + i], side = c < 3 ? c : c - 3;
                const float4 q = curves[(side == 0 ? corners.x : side == 1 ? corners.y : corners.z) * (slabs + 1) + slab
                                        + (c >= 3)] - eye;
                fx[i] = q.x * ax + q.y * ay + q.z * az;
                fy[i] = q.x * ux + q.y * uy + q.z * uz;
                ahead[i] = q.x * dx + q.y * dy + q.z * dz;
                top[i] = c >= 3;
                px[i] = side == 0 ? first.x : side == 1 ? first.z : second.x;
                py[i] = side == 0 ? first.y : side == 1 ? first.w : second.y;
            }
            e[0] = fx[0] * fy[1] - fy[0] * fx[1];
            e[1] = fx[0] * fy[2] - fy[0] * fx[2];
            e[2] = fx[0] * fy[3] - fy[0] * fx[3];
            e[3] = fx[1] * fy[2] - fy[1] * fx[2];
            e[4] = fx[1] * fy[3] - fy[1] * fx[3];
            e[5] = fx[2] * fy[3] - fy[2] * fx[3];
            /* A side holds the ray if that goes round its corners the same way; two sides do, one of them the one where
               it has come in. Both tetrahedra at a side take its edges alike, to the bit. */
            const lanes_i n0 = e[0] < 0.0f, n1 = e[1] < 0.0f, n2 = e[2] < 0.0f, n3 = e[3] < 0.0f, n4 = e[4] < 0.0f,
                n5 = e[5] < 0.0f;
            lanes_i out = (in + 1) & 3;
            out = ((n0 == n3) & (n0 != n1) & (in != 3)) ? I(3) : out;
            out = ((n0 == n4) & (n0 != n2) & (in != 2)) ? I(2) : out;
            out = ((n1 == n5) & (n1 != n2) & (in != 1)) ? I(1) : out;
            out = ((n3 == n5) & (n3 != n4) & (in != 0)) ? I(0) : out;

            weights(in, e, w);
            const lanes z_in = w[0] * ahead[0] + w[1] * ahead[1] + w[2] * ahead[2] + w[3] * ahead[3];
            const lanes h_in = (slab + (w[0] * top[0] + w[1] * top[1] + w[2] * top[2] + w[3] * top[3])) * slabs_inverse;
            const lanes x_in = w[0] * px[0] + w[1] * px[1] + w[2] * px[2] + w[3] * px[3];
            const lanes y_in = w[0] * py[0] + w[1] * py[1] + w[2] * py[2] + w[3] * py[3];
            weights(out, e, w);
            const lanes z_out = w[0] * ahead[0] + w[1] * ahead[1] + w[2] * ahead[2] + w[3] * ahead[3];
            const lanes h_out = (slab + (w[0] * top[0] + w[1] * top[1] + w[2] * top[2] + w[3] * top[3])) * slabs_inverse;
            const lanes x_out = w[0] * px[0] + w[1] * px[1] + w[2] * px[2] + w[3] * px[3];
            const lanes y_out = w[0] * py[0] + w[1] * py[1] + w[2] * py[2] + w[3] * py[3];
            const lanes_i down = slab == 0 && k == 0 ? out == 3 : I(0);
            lanes_i ended = group & ((z_out >= stop) | down);

            /* What is new to the ray: space that is folded back is gone through again. */
            lanes_i running = group & (z_out > front);
            if (any_lane(running)) {
                #pragma OPENCL FP_CONTRACT ON
                const lanes length = z_out - z_in, shorter = 1.0f / greater(length, F(1e-30f));
                const lanes low = within((front - z_in) * shorter, 0.0f, 1.0f);
                const lanes high = greater(within((stop - z_in) * shorter, 0.0f, 1.0f), low);
                const lanes rise = h_out - h_in, mx = x_out - x_in, my = y_out - y_in;
                const lanes move = quick_root(mx * mx + my * my + 1e-20f);
                const lanes footprint = shells.kind.w ? wide * (0.5f * (z_in + z_out)) : F(0.0f);
                const lanes blur = footprint * second.w;
                const lanes fade = within((blur - FAR_FROM) * (1.0f / (FAR_TO - FAR_FROM)), 0.0f, 1.0f);
                const lanes far = fade * fade * (3.0f - 2.0f * fade);
                const lanes measure = greater(greater(shells.size.y * positive(rise), move * (SIDEWAYS - (SIDEWAYS - 1.0f) * far)),
                                              F(1e-6f));
                const lanes_i is_far = far > 0.0f, passes = running;
                const bool any_far = any_lane(running & is_far);
                const lanes measure_inverse = 1.0f / measure, a_step = move * measure_inverse;
                /* How fast fur can come nearer from one look to the next. */
                const lanes nearer = move * (steep_here + steep_noise * (shells.kind.x ? F(1.0f) : greater(h_in, h_out))) + positive(rise) * steep_up - rise;
                const lanes rate = greater(nearer * measure_inverse, F(1e-2f));
                const lanes rate_inverse = lesser(measure / greater(nearer, F(1e-30f)), F(1e2f));
                /* From here on a place is told by what was looked past since it came in here: 0 to span. */
                const lanes z_step = length * measure_inverse, h_step = rise * measure_inverse;
                const lanes x_step = mx * measure_inverse, y_step = my * measure_inverse;
                const lanes z_first = z_in + low * length, h_first = h_in + low * rise;
                const lanes x_first = x_in + low * mx, y_first = y_in + low * my, span = (high - low) * measure;
                /* Most of half a footprint; in far fur all is near hair. */
                const lanes room = is_far ? F(2.0f) : 0.5f * footprint * (up.w * steep_here + steepest);
                /* Gradients across the ray. */
                const lanes grad_xa = grad_x.x * ax + grad_x.y * ay + grad_x.z * az, grad_xu = grad_x.x * ux + grad_x.y * uy + grad_x.z * uz;
                const lanes grad_ya = grad_y.x * ax + grad_y.y * ay + grad_y.z * az, grad_yu = grad_y.x * ux + grad_y.y * uy + grad_y.z * uz;
                const lanes up_a = up.x * ax + up.y * ay + up.z * az, up_u = up.x * ux + up.y * uy + up.z * uz;
                const lanes pixel = SHARP * footprint;
                lanes hidden = F(0.0f), sum = hidden, sum_x = hidden, sum_y = hidden;
                /* Looks that can't see hair are left out: there is none before `clear`. */
                lanes clear = is_far ? F(0.0f) : slack * rate_inverse, next = until, looked = hidden;
                next += clear > next ? nearest(clear - next + 0.5f) : F(0.0f);
                if (any_far)
                    looked = -aside / a_step;
                while (true) {
                    /* Where to look next doesn't hang on what is left of the light, so that a processor can begin with it. */
                    const lanes_i look = next <= span, looks = running & (look | ended);
                    if (!any_lane(looks & (rest > 0.0f)))
                        break;
                    const lanes at = look ? next : span, h = within(h_first + at * h_step, 0.0f, 1.0f);
                    lanes x = x_first + at * x_step, y = y_first + at * y_step;
                    lanes moved_x = F(0.0f), moved_y = F(0.0f), by_x, by_y, top, fold, v;
                    if (shells.shape.z > 0.0f) {
                        const lanes z = z_first + at * z_step;
                        for (int i = 0; i < LANES; ++i)
                            if (LANE_I(looks, i)) {
                                const float4 where = shells.kind.x
                                    ? (float4)(LANE(x, i), LANE(y, i), 0.0f, 0.0f) / shells.shape.w
                                    : (eye + LANE(z, i) * (float4)(LANE(dx, i), LANE(dy, i), LANE(dz, i), 0.0f)
                                       - (float4)(noise_box.xyz, 0.0f)) * noise_box.w;
                                const float2 moved = shells.shape.z * noise_at(&shells, noise, where);
                                LANE(moved_x, i) = moved.x;
                                LANE(moved_y, i) = moved.y;
                            }
                    }
                    if (shells.kind.x) {
                        x += moved_x;
                        y += moved_y;
                        const lanes sx = x - 0.25f, sy = y - 0.25f, qx = 0.25f - positive(sx - nearest(sx)), qy = 0.25f - positive(sy - nearest(sy));
                        by_x = QUARTER(qx, qx * qx) + QUARTER(qy, qy * qy);
                        v = thinned + half_thin * positive(by_x);
                    } else {
                        v = cells(&shells, face, (int)second.z, x, y, moved_x * h, moved_y * h, &by_x, &by_y, &top, &fold);
                    }
                    const lanes gap = (h - room) - v, ahead = greater(gap, F(0.0f)) * rate_inverse;
                    clear = looks ? at + ahead : clear;
                    next = looks & look ? (at + 1.0f) + nearest(ahead - 0.5f) : next;
                    running = looks & look;
                    if (!any_lane(looks & (gap < 0.0f))) {
                        uncovered_inverse = looks ? F(1.0f) : uncovered_inverse;
                        looked = at;
                        continue;
                    }
                    if (shells.kind.x) {
                        const lanes slope = by_x < 0.0f ? F(-6.2831853f * half_thin) : F(6.2831853f * half_thin);
                        const lanes qx = 0.25f - positive(x - nearest(x)), qy = 0.25f - positive(y - nearest(y));
                        by_x = slope * QUARTER(qx, qx * qx);
                        by_y = slope * QUARTER(qy, qy * qy);
                        top = F(1.0f);
                        fold = F(thinned);
                    }
                    /* v - h changes across the ray by g over a pixel. */
                    const lanes across_a = by_x * grad_xa + by_y * grad_ya - up_a, across_u = by_x * grad_xu + by_y * grad_yu - up_u;
                    const lanes width = greater(smooth * h, F(1e-3f));
                    const lanes sharper = 1.0f / width, least = 1e-2f * width;
                    const lanes g = greater(pixel * quick_root(across_a * across_a + across_u * across_u + 1e-20f), least);
                    const lanes covered = cover((v - h) * sharper, 0.5f * sharper * g, (top - h) * sharper, (fold - h) * sharper,
                                                width / g);
                    /* What is hidden here and was not before, of what is left: hairs go down to the skin, so that one
                       look below another hides the same again. */
                    lanes kept = lesser((1.0f - covered) * uncovered_inverse, F(1.0f));
                    if (any_far) {
                        lanes many = F(1.0f);
                        for (int i = 0; i < LANES; ++i)
                            if (LANE_I(looks, i) && LANE(far, i) > 0.0f)
                                LANE(many, i) = kept_by_many(means, LANE(h, i) - LANE(h_step, i), LANE(h, i),
                                                             (LANE(at, i) - LANE(looked, i)) * LANE(a_step, i));
                        kept = is_far ? kept + far * (many - kept) : kept;
                    }
                    looked = at;
                    kept = looks ? kept : F(1.0f);
                    uncovered_inverse = looks ? 1.0f / greater(1.0f - covered, F(1e-3f)) : uncovered_inverse;
                    if (!any_lane(kept < 1.0f))
                        continue;
                    /* It was met where the ramp from nothing to all was half gone through since the look before. */
                    const lanes ramp = 1.0f / (width + g), now = (v - h + 0.5f * g) * ramp, change = (by_x * x_step + by_y * y_step - h_step) * ramp;
                    const lanes middle = 0.5f * (within(now - change, 0.0f, 1.0f) + within(now, 0.0f, 1.0f));
                    const lanes_i rises = (change > 1e-6f) & !is_far;
                    const lanes back = rises ? within((now - middle) / (rises ? change : F(1.0f)), 0.0f, 1.0f) : F(0.5f);
                    const lanes after_it = rest * kept, left_over = after_it < 1.0f / 256 ? F(0.0f) : after_it;   // less would not be seen
                    const lanes part = rest - left_over;
                    hidden += part;
                    sum += part * (at - back);
                    if (shells.shine.w > 0.0f) {
                        sum_x += part * (1.0f - far) * by_x;
                        sum_y += part * (1.0f - far) * by_y;
                    }
                    const lanes_i halved = (rest >= 0.5f) & (left_over < 0.5f);
                    half_way = halved ? z_first + at * z_step : half_way;
                    half_face = halved ? I(face) : half_face;
                    rest = left_over;
                }
                ended |= passes & (rest == 0.0f);
                const lanes over = next - span, rest_of = over - nearest(over - 0.5f), to_next = rest_of > 0.0f ? rest_of : rest_of + 1.0f;
                aside = passes ? (span + to_next > 1.0f ? (1.0f - to_next) * a_step : aside + span * a_step) : aside;
                until = passes ? to_next : until;
                slack = passes ? greater((clear - span) * rate, F(0.0f)) : slack;
                front = group ? greater(front, z_out) : front;
                /* Light once a tetrahedron, at the mean place of what has hidden something there. */
                const lanes_i shown = hidden > 1e-4f;
                if (any_lane(shown)) {
                    const lanes scale = 1.0f / (shown ? hidden : F(1.0f)), mean = scale * sum, z = z_first + mean * z_step;
                    const float2 one = first.zw - first.xy, two = second.xy - first.xy;
                    const float area = one.x * two.y - one.y * two.x, smaller = area != 0.0f ? 1.0f / area : 0.0f;
                    const lanes at_x = x_first + mean * x_step - first.x, at_y = y_first + mean * y_step - first.y;
                    const lanes wb = (at_x * two.y - at_y * two.x) * smaller, wc = (one.x * at_y - one.y * at_x) * smaller;
                    const lanes wa = 1.0f - wb - wc;
                    __global const float4 *ca = curves + corners.x * (slabs + 1) + slab,
                        *cb = curves + corners.y * (slabs + 1) + slab, *cc = curves + corners.z * (slabs + 1) + slab;
                    const lanes3 n = unit(plus(scaled(all_lanes(normals[corners.x]), wa), plus(
                        scaled(all_lanes(normals[corners.y]), wb), scaled(all_lanes(normals[corners.z]), wc))));
                    const lanes3 t = unit(plus(scaled(all_lanes(ca[1] - ca[0]), wa), plus(
                        scaled(all_lanes(cb[1] - cb[0]), wb), scaled(all_lanes(cc[1] - cc[0]), wc))));
                    const lanes3 slope = scaled(plus(scaled(all_lanes(grad_x), sum_x), scaled(all_lanes(grad_y), sum_y)), scale);
                    const lanes3 place = {eye.x + z * dx, eye.y + z * dy, eye.z + z * dz}, v = {-dx, -dy, -dz};
                    const lanes3 color = lit(&lamp, shown, place, within(h_first + mean * h_step, 0.0f, 1.0f), t, n, slope, v);
                    red += shown ? hidden * color.x : F(0.0f);
                    green += shown ? hidden * color.y : F(0.0f);
                    blue += shown ? hidden * color.z : F(0.0f);
                    alpha += shown ? hidden : F(0.0f);
                }
            }

            /* On into the next tetrahedra. */
            at_depth = group ? z_out : at_depth;
            lanes_i onto = I(-1), by = I(0), fresh = I(0);
            for (int i = 0; i < 4; ++i) {
                const int way = WAY[4 * k + i];
                int there = -1, entry = 0, other = 0;
                if (way < SIDE) {
                    there = here - k + way / 4;
                    entry = way % 4;
                } else if (way == UP) {
                    there = slab + 1 == slabs ? -1 : here - k + 3;
                    entry = 3;
                } else if (way == DOWN) {
                    there = slab == 0 ? -1 : here - k - 3 + 2;
                } else {
                    const int side = (way - SIDE) / 2;
                    const int across = side == 0 ? neighbours[face].x : side == 1 ? neighbours[face].y : neighbours[face].z;
                    const int behind = across < 0 ? 0 : BEHIND[2 * (across & 3) + (way - SIDE) % 2];
                    there = across < 0 ? -1 : 3 * (slabs * (across >> 2) + slab) + behind / 4;
                    entry = behind % 4;
                    other = 1;
                }
                onto = out == i ? I(there) : onto;
                by = out == i ? I(entry) : by;
                fresh = out == i ? I(-other) : fresh;
            }
            const lanes_i stays = ended & !(shells.noise.w & down & (z_out < stop));
            leaves = group ? (onto < 0) & !stays : leaves;
            cell = group ? (ended ? I(-1) : onto) : cell;
            in = group ? by : in;
            slack = (group & (fresh != 0)) ? F(0.0f) : slack;
        }
        for (int i = 0; i < LANES; ++i) {
            const int x = block_x + i % BLOCK_X, y = block_y + i / BLOCK_X;
            const size_t pixel = (size_t)y * view.size.x + x, sample = pixel * samples + s;
            if (x >= view.size.x || y >= rows || after[sample] == NOTHING)
                continue;
            const float left_over = LANE(rest, i);
            if (LANE_I(leaves, i) && left_over > 0.0f)
                ++pending;
            else
                after[sample] = NOTHING;
            through[sample] = left_over;
            if (LANE_I(half_face, i) >= 0) {
                const float4 d = (float4)(LANE(dx, i), LANE(dy, i), LANE(dz, i), 0.0f);
                fur[sample] = (ulong)depth_of(&view, eye + LANE(half_way, i) * d) << 32 | (uint)LANE_I(half_face, i);
            }
            image[pixel] += (float4)(LANE(red, i), LANE(green, i), LANE(blue, i), LANE(alpha, i)) * (1.0f / samples);
        }
    }
    if (pending)
        atomic_add(left, pending);
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
    const float step = 0.75f * min(grid.face.y * max(near, grid.face.z), deep);
    const int rows = (int)min(sqrt(square) / step, parts * ROWS - 1.0f) + 1;
    const int heights = (int)min(shells.size.x / (slabs * step), parts * ROWS - 1.0f) + 1;
    if (first_row >= rows || far < grid.face.z || beyond)
        return;

    const float4 first = lattice[CORNERS * face], second = lattice[CORNERS * face + 1];
    const float2 to_b = first.zw - first.xy, to_c = second.xy - first.xy;
    const int looks = (LOOKS - 1) / (slabs * heights) + 1;
    float left = 0.5f, covered = mean_at(means, 0.0f).x;
    for (int level = 0; level < slabs * heights; ++level) {
        const int slab = level / heights;
        const float inside = (level % heights + 0.5f) / heights;
        const float low = (float)level / (slabs * heights), top = (float)(level + 1) / (slabs * heights);
        /* Between these heights: what is covered below and not above, and entries going sideways. */
        const float above = mean_at(means, top).x, newly = covered - above;
        covered = above;
        float entered = 0.0f;
        for (int k = 0; k < looks; ++k)
            entered += mean_at(means, low + (k + 0.5f) / (slabs * heights * looks)).y;
        const float sideways = entered / (heights * looks);

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
                if (at.x == OUTSIDE || at.z < 0)
                    continue;
                /* A spot's rays meet the cell's face, at distance w along its axis, at a slant: ray is w / cos long. */
                w = w > grid.face.z ? w : grid.face.z;
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
                    add_between(cells, &grid, at.x - SUBPIXEL / 2, at.y - SUBPIXEL / 2, at.z >> 8, amount);
                else if (amount && in_grid(&grid, at.x >> 8, at.y >> 8, at.z >> 8))
                    atomic_max(&cells[((size_t)(at.z >> 8) * grid.size.y + (at.y >> 8)) * grid.size.x
                                      + (at.x >> 8)], weight);
            }
    }
}

/* What the nearest sample of one pixel sees, where that is fur: what is told of strands, of a hair of the fur.  One
   work-item tells it of one pixel. */
__kernel void about(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const int slabs,
    __global const ulong *visible,         // [rows, width, samples] what else is drawn
    __global const ulong *fur,             // [rows, width, samples] depth << 32 | face, see march
    __global const float *through,         // [rows, width, samples]
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const float4 *curves,         // [V, slabs + 1]
    __global const float4 *uv,             // [F * 3] u, v of these corners
    __global float *out_depth,             // [rows, width] distance along the view axis
    __global int *out_id,                  // -3
    __global float4 *out_tangent,          // unit: the hair's direction
    __global float4 *out_normal,           // unit, towards the eye: across the hair
    __global float4 *out_uv,               // of the root
    __global float *out_coverage)          // share of light that does not come from behind everything
{
    WORK_ITEM(pixel);
    const int x = pixel % view.size.x, y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    ulong key = ~0ul;
    uint other = NOTHING;
    int nearest = 0;
    float covered = 0.0f;
    for (int s = 0; s < samples; ++s) {
        const ulong drawn = visible[pixel * samples + s], there = fur[pixel * samples + s];
        covered += (uint)drawn == NOTHING ? 1.0f - through[pixel * samples + s] : 1.0f;
        other = min(other, (uint)(drawn >> 32));
        if (there < key) {
            key = there;
            nearest = s;
        }
    }
    out_coverage[pixel] = covered / samples;
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
    out_depth[pixel] = to_screen(&view, p).w;
    out_id[pixel] = -3;
    out_tangent[pixel] = tangent;
    out_normal[pixel] = unit_or(v - dot3(v, tangent) * tangent, v);
    out_uv[pixel] = root_uv;
}
