/*
 * Shell fur: hair as a height field on the skin, between the mesh and a surface one length above it.
 *
 * The space between them is divided into prisms over the faces, in `slabs` one above the other, each of three
 * tetrahedra, so that a place in the fur is linear along a ray in each of them.  A ray walks from one to the next
 * (Maria, Horna and Aveneau, "Efficient ray traversal of constrained Delaunay tetrahedralizations", 2017) and looks at
 * the fur wherever it has passed one more layer, or as much sideways.  Corners of a face are taken in the order of their
 * numbers, so that neighbours divide the side between them alike.  What a place in the fur is called:
 *   h        height, 0 on the skin and 1 at the longest tips
 *   x, y     place in the pattern, on every face linear: "cells" are triangles with sides of 1, "sine" has periods of 1
 */
#include "light.h"
#include "cells.h"

#define CORNERS 4       // float4 a face in `lattice`
#define HEIGHTS 64      // of the table of means
#define CELL_RADIUS 0.62f   // of a hair at its root, in sides of a cell: it reaches just beyond the cell's corners
#define SIDEWAYS 4.0f   // looks on the way across one x or y, as long as a pixel is small against it
#define FAR_FROM 0.35f  // pixels that are so many sides of a cell wide begin to see hairs on average,
#define FAR_TO 1.0f     // and those of so many see nothing else
#define ROWS 16         // of a face's points in the light's grid that a work-item does
#define MOST_STEPS 20000    // tetrahedra on one way: no scene that is any good has so many

/* What the inner loops use is inlined by force, and does without OpenCL's own functions: PoCL calls each of these,
   even floor, and every call saves all registers. */
#define INLINED inline __attribute__((always_inline))

INLINED float lesser(float a, float b)
{
    return a < b ? a : b;
}

INLINED float greater(float a, float b)
{
    return a > b ? a : b;
}

INLINED float within(float x, float low, float high)
{
    return x < low ? low : x > high ? high : x;
}

INLINED float positive(float x)
{
    return x < 0.0f ? -x : x;
}

INLINED float between(float a, float b, float t)
{
    return a + t * (b - a);
}

/* The whole number below x, for |x| < 2^31. */
INLINED int whole(float x)
{
    const int i = (int)x;
    return i - (x < (float)i);
}

/* Square root to 5e-6 of itself (Newton's method), the same bits everywhere. */
INLINED float root(float x)
{
    float y = as_float(0x5F375A86u - (as_uint(x) >> 1));
    y *= 1.5f - 0.5f * x * y * y;
    y *= 1.5f - 0.5f * x * y * y;
    return x * y;
}

INLINED float4 root4(float4 x)
{
    float4 y = as_float4(0x5F375A86u - (as_uint4(x) >> 1));
    y *= 1.5f - 0.5f * x * y * y;
    y *= 1.5f - 0.5f * x * y * y;
    return x * y;
}

/* sin(2 pi x) of one quarter, |r| <= 1/4, to 1e-7 (Taylor); + and * alone, so that it is the same bits everywhere. */
INLINED float quarter(float r)
{
    const float z = r * r;
    return r * (6.2831853f + z * (-41.341702f + z * (81.605249f + z * (-76.705860f + z * (42.058694f - z * 15.094643f)))));
}

INLINED float sin_turns(float x)
{
    float r = x - whole(x + 0.5f);
    r = r > 0.25f ? 0.5f - r : r < -0.25f ? -0.5f - r : r;
    return quarter(r);
}

INLINED uint4 mixed(uint4 x)
{
    x ^= x >> 15;
    x *= 0x2C1B3C6Du;
    x ^= x >> 12;
    x *= 0x297A2D39u;
    return x ^ (x >> 15);
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
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const float4 *uv,             // [F * 3] u, v of these corners
    __global float4 *out)                  // [F, CORNERS] x0 y0 x1 y1; x2 y2 cells-a-side density; gradients of x and of y
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
    out[CORNERS * f] = (float4)(at[0], at[1]);
    out[CORNERS * f + 1] = (float4)(at[2], sides, sqrt(sqrt(dot3(grad_x, grad_x) * dot3(grad_y, grad_y))));
    out[CORNERS * f + 2] = grad_x;
    out[CORNERS * f + 3] = grad_y;
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
        const uint4 hash = mixed((uint4)(key, key + 0x68E31DA4u, 0u, 0u));
        const float4 from = t - convert_float4(d);
        const float weight = (d.x ? fade.x : 1 - fade.x) * (d.y ? fade.y : 1 - fade.y) * (d.z ? fade.z : 1 - fade.z);
        float value[2];
        for (int k = 0; k < 2; ++k) {
            /* One of the twelve edges of a cube. */
            const uint h = (k ? hash.y : hash.x) % 12u, axis = h >> 2;
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
    const int4 low = (int4)(whole(at.x), whole(at.y), whole(at.z), 0);
    const float4 f = at - convert_float4(low);
    const int4 wrapped = low % n, a = wrapped + (wrapped < 0 ? n : (int4)(0)), b = a + 1 < n ? a + 1 : (int4)(0);
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
INLINED float4 waves(const Shells *shells, float x, float y)
{
    const float sum = sin_turns(x) + sin_turns(y), side = sum < 0.0f ? -3.1415927f : 3.1415927f;
    const float4 v = (float4)(0.5f * positive(sum), side * sin_turns(x + 0.25f), side * sin_turns(y + 0.25f), 0.0f);
    const float thin = 1.0f / shells->shape.y;
    return (float4)(1.0f - thin * (1.0f - v.x), thin * v.y, thin * v.z, 0.0f);
}

/* Cones, one on each triangle of a lattice, the highest of the four that are nearest. Those beyond the face's border are
   left out, as the face behind it has its own; sides: cells along a side of the face. */
INLINED float4 cells(const Shells *shells, uint face, int sides, float x, float y, float2 lean)
{
    const float v = y * 1.1547005f, u = x - 0.5f * v;
    const int fu = whole(u), fv = whole(v);
    const bool down = (u - fu) + (v - fv) > 1.0f;
    const int4 i = fu + (down ? (int4)(0, 0, 1, 0) : (int4)(0, 0, -1, 0));
    const int4 j = fv + (down ? (int4)(0, 0, 0, 1) : (int4)(0, 0, 0, -1));
    const int4 turned = down ? (int4)(1, 0, 0, 0) : (int4)(0, 1, 1, 1);
    const uint4 random = mixed((as_uint4(i) * 0x9E3779B1u) ^ (as_uint4(j) * 0x85EBCA77u)
                               ^ ((2u * face + as_uint4(turned)) * 0xC2B2AE3Du) ^ (uint)shells->kind.y);
    const float4 third = convert_float4(1 + turned) * (1.0f / 3.0f);
    const float4 cu = convert_float4(i) + third, cv = convert_float4(j) + third;
    const float4 dx = x - lean.x - (cu + 0.5f * cv + 0.3f * (convert_float4(random & 1023u) * (1.0f / 1024) - 0.5f));
    const float4 dy = y - lean.y - (0.8660254f * cv + 0.3f * (convert_float4(random >> 10 & 1023u) * (1.0f / 1024) - 0.5f));
    const float4 off = root4(dx * dx + dy * dy + 1e-12f);
    const float4 tall = 1.0f - shells->size.w * (convert_float4(random >> 20 & 1023u) * (1.0f / 1024));
    const float thin = 1.0f / (CELL_RADIUS * shells->shape.y);
    const int4 there = i >= 0 && j >= 0 && i + j + turned < sides;
    const float4 high = tall - tall * off * thin;
    float4 best = (float4)(-1.0f, 0.0f, 0.0f, 0.0f);
    best = there.x && high.x > best.x ? (float4)(high.x, dx.x, dy.x, tall.x / off.x) : best;
    best = there.y && high.y > best.x ? (float4)(high.y, dx.y, dy.y, tall.y / off.y) : best;
    best = there.z && high.z > best.x ? (float4)(high.z, dx.z, dy.z, tall.z / off.z) : best;
    best = there.w && high.w > best.x ? (float4)(high.w, dx.w, dy.w, tall.w / off.w) : best;
    const float slope = -thin * best.w;
    return (float4)(best.x, slope * best.y, slope * best.z, 0.0f);
}

/* Height of the fur at a place and its gradient by x and y: hair is where this is more than h. */
INLINED float4 height_at(const Shells *shells, __global const float2 *noise, uint face, int sides, float2 at, float4 place,
                        float h)
{
    float2 moved = (float2)(0.0f);
    if (shells->shape.z > 0.0f)
        moved = shells->shape.z * noise_at(shells, noise, shells->kind.x ? (float4)(at / shells->shape.w, 0.0f, 0.0f) : place);
    if (shells->kind.x)
        return waves(shells, at.x + moved.x, at.y + moved.y);
    return cells(shells, face, sides, at.x, at.y, moved * h);
}

/* Integral of smoothstep(e0, e0 + width, t) over t. */
INLINED float integral(float t, float e0, float width)
{
    const float u = (t - e0) / width;
    return u <= 0.0f ? 0.0f : u >= 1.0f ? width * (u - 0.5f) : width * (u * u * u) * (1.0f - 0.5f * u);
}

/* Share of a place at height h that hair covers, where the fur is v high: the report's threshold and smoothstep,
   averaged over a footprint across which v - h changes by g. */
INLINED float cover(const Shells *shells, float v, float h, float g)
{
    const float width = greater((shells->shape.x - 1.0f) * h, 1e-3f);
    if (g > 1e-3f * width)
        return within((integral(v + 0.5f * g, h, width) - integral(v - 0.5f * g, h, width)) / g, 0.0f, 1.0f);
    const float u = within((v - h) / width, 0.0f, 1.0f);
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
    const float h = (float)k / (HEIGHTS - 1), step = shells.kind.x ? 1.0f / around : 0.125f;
    float covered = 0.0f, entered = 0.0f;
    for (int j = 0; j < around; ++j) {
        float x_before = 1.0f, y_before = 1.0f;
        for (int i = -1; i < around; ++i) {
            const float u = (i + 0.5f) * step, v = (j + 0.5f) * step;
            const float4 a = shells.kind.x ? waves(&shells, u, v) : cells(&shells, 0, 1 << 30, u + 1e3f, v + 1e3f, (float2)(0.0f));
            const float4 b = shells.kind.x ? waves(&shells, v, u) : cells(&shells, 0, 1 << 30, v + 1e3f, u + 1e3f, (float2)(0.0f));
            const float here = cover(&shells, a.x, h, 0.0f), there = cover(&shells, b.x, h, 0.0f);
            entered += max(here - x_before, 0.0f) + max(there - y_before, 0.0f);
            covered += i < 0 ? 0.0f : here;
            x_before = here;
            y_before = there;
        }
    }
    out[k] = (float2)(covered / (around * around), entered / (2.0f * around * around * step));
}

INLINED float2 mean_at(__global const float2 *means, float h)
{
    const float at = within(h, 0.0f, 1.0f) * (HEIGHTS - 1);
    const int k = at < HEIGHTS - 2 ? (int)at : HEIGHTS - 2;
    return means[k] + (at - k) * (means[k + 1] - means[k]);
}

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

/* Light from a place p at height h: t the hair's direction, n the skin's normal, slope the fur's gradient in the
   world.  Kajiya and Kay's hair, or the report's turned normals: those of the height field.  Both fade to the roots. */
inline float4 lit(const Lamp *lamp, float4 p, float h, float4 t, float4 n, float4 slope, float4 v)
{
    const Shells *shells = lamp->shells;
    const float4 color = (float4)(shells->color.xyz, 0.0f);
    float4 l = -lamp->light->direction, direct = lamp->light->color;
    if (lamp->light->position.w > 0.0f) {
        l = unit_or((float4)(lamp->light->position.xyz - p.xyz, 0.0f), l);
        direct.xyz *= -dot3(l, lamp->light->direction) >= lamp->light->cone.x ? 1.0f : 0.0f;
    }
    float share = 1.0f;
    if (lamp->shadow->body.x)
        share = past_body(lamp->seen, lamp->map, lamp->shadow->body.y, p, n, 5.0f, 1.0f + 2 * lamp->shadow->body.y);
    if (lamp->shadow->hair.x > 0.0f && share > 0.0f)
        share *= through_hair(lamp->grid, lamp->sums, lamp->shadow->hair.x, (float2)(0.0f), p);
    direct.xyz *= share;
    const float fade = mix(shells->color.w, 1.0f, h);
    if (!(shells->shine.w > 0.0f))
        return fade * fibre(color, shells->shine.x, shells->shine.y, lamp->half_vector, t, l, v, direct);
    const float4 turned = unit_or(n - shells->size.x * slope, n), middle = unit_or(l + v, turned);
    const float towards = dot3(turned, l), mirror = clamp(dot3(turned, middle), 0.0f, 1.0f);
    float shine = 0.0f;
    if (towards > 0.0f && (1.0f - mirror) * shells->shine.y < 16.0f)
        shine = shells->shine.x * exp2(shells->shine.y * log2(mirror));
    return fade * (direct * (max(towards, 0.0f) * color + shine) + direct.w * color);
}

/* Which way a ray leaves tetrahedron k of a prism where it leaves out corner `out` (0 1 2 below, 3 4 5 above them):
   0..2 to tetrahedron k, 3 + side to the neighbour across that side (0: corners 1 2, 1: 0 2, 2: 0 1), 6 down, 7 up.
   The tetrahedra are (0 1 2 5), (0 1 4 5) and (0 3 4 5). */
__constant uchar WAY[3][6] = {{3, 4, 1, 9, 9, 6}, {3, 2, 9, 9, 0, 5}, {7, 9, 9, 1, 4, 5}};
__constant uchar SUM[3] = {8, 10, 12};
/* Tetrahedron that holds the lower and the upper triangle of each side. */
__constant uchar BEHIND[3][2] = {{0, 1}, {0, 2}, {1, 2}};

INLINED float cross2(float2 a, float2 b)
{
    return a.x * b.y - a.y * b.x;
}

/* Weights of the corners of a triangle that holds the origin. */
INLINED float4 weights_of(float2 a, float2 b, float2 c)
{
    const float4 w = (float4)(cross2(b, c), cross2(c, a), cross2(a, b), 0.0f);
    const float sum = w.x + w.y + w.z;
    return sum > 0.0f ? w / sum : (float4)(1.0f / 3, 1.0f / 3, 1.0f / 3, 0.0f);
}

/* Place of corner 0..5 of a prism in the pattern. */
INLINED float2 in_pattern(float4 first, float4 second, int corner)
{
    return corner == 0 ? first.xy : corner == 1 ? first.zw : second.xy;
}

INLINED uint corner_of(uint4 face, int corner)
{
    return corner == 0 ? face.x : corner == 1 ? face.y : face.z;
}

inline uint depth_of(const View *view, float4 p)
{
    const float4 q = to_screen(view, p);
    return DEPTH_ONE - (uint)clamp(q.z / q.w * (float)DEPTH_ONE, 0.0f, (float)DEPTH_ONE);
}

/* One work-item takes the samples of one pixel through the fur, from where they enter it to where they leave it, meet
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
    WORK_ITEM(pixel);
    const int x = pixel % view.size.x, y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    const int slabs = shells.kind.z;
    const Lamp lamp = {&shells, &light, &shadow, &grid, sums, &seen, map, half_vector};
    const float4 eye = (float4)(view.eye.xyz, 0.0f);
    /* How fast the fur's height can change sideways, and with the height. */
    const float steep_here = (shells.kind.x ? 4.4428830f : 1.0f / CELL_RADIUS) / shells.shape.y;
    const float steep = steep_here * (shells.kind.x ? 1.0f + 6.0f * shells.shape.z / shells.shape.w : 1.0f);
    const float steep_up = 1.0f + (shells.kind.x ? 0.0f : 1.5f * steep_here * shells.shape.z);
    int pending = 0;
    float4 total = (float4)(0.0f);

    for (int s = 0; s < samples; ++s) {
        const size_t sample = pixel * samples + s;
        const ulong entry = entries[sample];
        const uint stop_depth = (uint)(visible[sample] >> 32), entry_depth = (uint)(entry >> 32);
        ulong gone = ~0ul;
        if ((uint)entry == NOTHING || entry_depth >= stop_depth) {
            after[sample] = NOTHING;
            continue;
        }
        const uint4 start = border[(uint)entry & ~BODY];
        uint face = start.x;
        int slab = start.y / 12, k = start.y / 4 % 3;
        /* The triangle by which it comes in, turned so that it goes round counter-clockwise. */
        int c[3], m = 0;
        const int missing = start.y % 4;
        const int4 all = k == 0 ? (int4)(0, 1, 2, 5) : k == 1 ? (int4)(0, 1, 4, 5) : (int4)(0, 3, 4, 5);
        const int four[4] = {all.x, all.y, all.z, all.w};
        for (int i = 0; i < 4; ++i)
            if (i != missing)
                c[m++] = four[i];

        /* Snapped corners and rounded depths leave the point a little beside that triangle: put it in. */
        float4 p = seen_point(&view, x, y, s, entry_depth);
        uint4 corners = faces[face];
        float4 q[3];
        for (int i = 0; i < 3; ++i)
            q[i] = curves[corner_of(corners, c[i] % 3) * (slabs + 1) + slab + c[i] / 3];
        {
            const float4 n = cross3(q[1] - q[0], q[2] - q[0]);
            const float square = dot3(n, n);
            float4 w = (float4)(dot3(cross3(q[1] - p, q[2] - p), n), dot3(cross3(q[2] - p, q[0] - p), n),
                                dot3(cross3(q[0] - p, q[1] - p), n), 0.0f);
            w = square > 0.0f ? max(w / square, 1e-3f) : (float4)(1.0f);
            w /= w.x + w.y + w.z;
            p = w.x * q[0] + w.y * q[1] + w.z * q[2];
        }
        const float4 d = unit_or(p - eye, (float4)(0.0f, 0.0f, -1.0f, 0.0f)), v = -d;
        /* Two axes across the ray (Duff et al. 2017). */
        const float sign = d.z >= 0.0f ? 1.0f : -1.0f, u = -1.0f / (sign + d.z), uv = d.x * d.y * u;
        const float4 across = (float4)(1.0f + sign * d.x * d.x * u, sign * uv, -sign * d.x, 0.0f);
        const float4 upward = (float4)(uv, sign + d.y * d.y * u, -d.y, 0.0f);

        float2 flat[3];
        float ahead[3];
        for (int i = 0; i < 3; ++i) {
            const float4 e = q[i] - p;
            flat[i] = (float2)(dot3(e, across), dot3(e, upward));
            ahead[i] = dot3(e, d);
        }
        if (cross2(flat[0], flat[1]) + cross2(flat[1], flat[2]) + cross2(flat[2], flat[0]) < 0.0f) {
            const int ci = c[1]; c[1] = c[2]; c[2] = ci;
            const float2 f = flat[1]; flat[1] = flat[2]; flat[2] = f;
            const float a = ahead[1]; ahead[1] = ahead[2]; ahead[2] = a;
        }
        float stop = INFINITY;
        if (stop_depth != NOTHING)
            stop = dot3(seen_point(&view, x, y, s, stop_depth) - p, d);
        /* How wide a pixel is at p, and how much wider a unit further on. */
        const float4 here = to_screen(&view, p), there = to_screen(&view, p + d);
        const float finer = 1.0f / (view.scale.x * sqrt((float)samples));
        const float wide = here.w * finer, wider = (there.w - here.w) * finer;

        float rest = through[sample];
        float4 sum = (float4)(0.0f), first = lattice[CORNERS * face], second = lattice[CORNERS * face + 1];
        float4 grad_x = lattice[CORNERS * face + 2], grad_y = lattice[CORNERS * face + 3];
        float4 w = weights_of(flat[0], flat[1], flat[2]);
        float z_in = w.x * ahead[0] + w.y * ahead[1] + w.z * ahead[2], front = 0.0f;
        float until = 0.5f, aside = 0.0f, before = 0.0f, slack = 0.0f;   // to the next look; since the last one
        bool leaves = false, ended = false;
        for (int step = 0; step < MOST_STEPS && !ended; ++step) {
            /* From the place where the ray comes in, */
            const float h_in = (slab + (w.x * (c[0] / 3) + w.y * (c[1] / 3) + w.z * (c[2] / 3))) / slabs;
            const float2 at_in = w.x * in_pattern(first, second, c[0] % 3) + w.y * in_pattern(first, second, c[1] % 3)
                + w.z * in_pattern(first, second, c[2] % 3);
            /* past the fourth corner, */
            const int fresh = SUM[k] - (c[0] + c[1] + c[2]);
            const float4 e = curves[corner_of(corners, fresh % 3) * (slabs + 1) + slab + fresh / 3] - p;
            const float2 flat_new = (float2)(dot3(e, across), dot3(e, upward));
            const float ahead_new = dot3(e, d);
            const bool a = cross2(flat[0], flat_new) < 0.0f, b = cross2(flat[1], flat_new) < 0.0f,
                       g = cross2(flat[2], flat_new) < 0.0f;
            const int drop = a && !b ? 2 : b && !g ? 0 : 1;
            const int out = c[drop];
            c[drop] = fresh;
            flat[drop] = flat_new;
            ahead[drop] = ahead_new;
            /* to the place where it goes out. */
            w = weights_of(flat[0], flat[1], flat[2]);
            const float z_out = w.x * ahead[0] + w.y * ahead[1] + w.z * ahead[2];
            const float h_out = (slab + (w.x * (c[0] / 3) + w.y * (c[1] / 3) + w.z * (c[2] / 3))) / slabs;
            const float2 at_out = w.x * in_pattern(first, second, c[0] % 3) + w.y * in_pattern(first, second, c[1] % 3)
                + w.z * in_pattern(first, second, c[2] % 3);
            const int way = WAY[k][out];

            /* What is new to the ray: space that is folded back is gone through again. */
            if (z_out > front) {
                const float length = z_out - z_in, from = greater(z_in, front), to = lesser(z_out, stop);
                const float low = length > 0.0f ? within((from - z_in) / length, 0.0f, 1.0f) : 0.0f;
                const float high = length > 0.0f ? within((to - z_in) / length, low, 1.0f) : 1.0f;
                const float rise = h_out - h_in, across_x = at_out.x - at_in.x, across_y = at_out.y - at_in.y,
                            move = root(across_x * across_x + across_y * across_y + 1e-20f);
                                const float footprint = greater(wide + wider * (0.5f * (from + to)), 0.0f);
                const float blur = shells.kind.w ? footprint * second.w : 0.0f;
                const float measure = greater(shells.size.y * positive(rise), move * SIDEWAYS / (1.0f + SIDEWAYS * blur));
                const float fade = within((blur - FAR_FROM) / (FAR_TO - FAR_FROM), 0.0f, 1.0f), far = fade * fade * (3.0f - 2.0f * fade);
                ended = z_out >= stop || (way == 6 && slab == 0);
                float at = low;
                while (true) {
                    const float next = measure > 0.0f ? at + until / measure : 2.0f;
                    const bool look = next <= high, last = !look && ended;
                    const float place = look ? next : high;
                    aside += (place - at) * move;
                    slack -= (place - at) * (positive(rise) * steep_up + move * steep);
                    until = look ? 1.0f : until - (place - at) * measure;
                    at = place;
                    if (!look && !last)
                        break;
                    if (!(slack > 0.0f) || far > 0.0f) {
                        const float h = within(h_in + place * rise, 0.0f, 1.0f), z = z_in + place * length;
                        const float2 xy = at_in + place * (at_out - at_in);
                        const float4 where = p + z * d;
                        float4 t = (float4)(0.0f), n = t;
                        float4 f = (float4)(0.0f);
                        float covered = 0.0f;
                        const float2 mean = far > 0.0f ? mean_at(means, h) : (float2)(0.0f);
                        if (far < 1.0f) {
                            f = height_at(&shells, noise, face, (int)second.z, xy,
                                          (where - (float4)(noise_box.xyz, 0.0f)) * noise_box.w, h);
                            /* v - h changes across the ray by this much over a pixel. */
                            float4 change = f.y * grad_x + f.z * grad_y;
                            const float4 away = change;
                            change -= dot3(change, d) * d;
                            covered = cover(&shells, f.x, h, blur > 0.0f ? footprint * root(dot3(change, change) + 1e-20f) : 0.0f);
                            if (covered == 0.0f)
                                slack = h - f.x - (blur > 0.0f ? 0.5f * footprint * root(dot3(away, away) + 1e-20f) : 0.0f);
                        }
                        covered = between(covered, mean.x, far);
                        /* What is hidden here and was not before, of what is left: hairs go down to the skin, so that
                           one look below another hides the same again. Sideways hairs come at random. */
                        float kept = covered > before ? (1.0f - covered) / (1.0f - before) : 1.0f;
                        if (far > 0.0f)
                            kept *= exp2(-1.44269504f * far * mean.y * aside / greater(1.0f - mean.x, 0.02f));
                        before = lesser(covered, 0.999f);
                        aside = 0.0f;
                        if (kept < 0.998f) {
                            /* Its light: half a layer back, and by the corners' weights. */
                            const float h_lit = within(h - (measure > 0.0f && look ? 0.5f * rise / measure : 0.0f), 0.0f, 1.0f);
                            const float2 in_face = xy - first.xy, one = first.zw - first.xy, two = second.xy - first.xy;
                            const float area = cross2(one, two);
                            const float wb = area != 0.0f ? cross2(in_face, two) / area : 0.0f;
                            const float wc = area != 0.0f ? cross2(one, in_face) / area : 0.0f, wa = 1.0f - wb - wc;
                            __global const float4 *ca = curves + corners.x * (slabs + 1) + slab,
                                *cb = curves + corners.y * (slabs + 1) + slab, *cc = curves + corners.z * (slabs + 1) + slab;
                            n = unit_or(wa * normals[corners.x] + wb * normals[corners.y] + wc * normals[corners.z],
                                        normals[corners.x]);
                            t = unit_or(wa * (ca[1] - ca[0]) + wb * (cb[1] - cb[0]) + wc * (cc[1] - cc[0]), n);
                            const float4 color = lit(&lamp, where, h_lit, t, n, (1.0f - far) * (f.y * grad_x + f.z * grad_y), v);
                            sum += rest * (1.0f - kept) * (float4)(color.xyz, 1.0f);
                        }
                        if (rest >= 0.5f && rest * kept < 0.5f)
                            gone = (ulong)depth_of(&view, where) << 32 | face;
                        rest *= kept;
                        if (rest < 1.0f / 256) {
                            rest = 0.0f;
                            ended = true;
                            break;
                        }
                    } else {
                        before = 0.0f;
                        aside = 0.0f;
                    }
                    if (last)
                        break;
                }
                front = z_out;
            }
            if (ended) {
                leaves = shells.noise.w && z_out < stop;
                break;
            }

            /* On into the next tetrahedron. */
            z_in = z_out;
            if (way < 3) {
                k = way;
            } else if (way == 7 || way == 6) {
                if (way == 7 ? slab + 1 == slabs : slab == 0) {
                    leaves = true;
                    break;
                }
                slab += way == 7 ? 1 : -1;
                k = way == 7 ? 0 : 2;
                for (int i = 0; i < 3; ++i)
                    c[i] += way == 7 ? -3 : 3;
            } else {
                const int side = way - 3;
                const int across_it = side == 0 ? neighbours[face].x : side == 1 ? neighbours[face].y : neighbours[face].z;
                if (across_it < 0) {
                    leaves = true;
                    break;
                }
                face = across_it >> 2;
                const int other = across_it & 3, low_corner = side == 0 ? 1 : 0, low_other = other == 0 ? 1 : 0;
                const int high_other = other == 2 ? 1 : 2;
                int upper = 0;
                for (int i = 0; i < 3; ++i) {
                    upper += c[i] / 3;
                    c[i] = (c[i] % 3 == low_corner ? low_other : high_other) + c[i] / 3 * 3;
                }
                k = BEHIND[other][upper - 1];
                corners = faces[face];
                first = lattice[CORNERS * face];
                second = lattice[CORNERS * face + 1];
                grad_x = lattice[CORNERS * face + 2];
                grad_y = lattice[CORNERS * face + 3];
                slack = 0.0f;
            }
        }
        after[sample] = NOTHING;
        if (leaves && rest > 0.0f) {
            after[sample] = entry_depth;   // fur that stands in other fur comes after it
            ++pending;
        }
        through[sample] = rest;
        if (gone != ~0ul)
            fur[sample] = gone;
        total += sum;
    }
    if (pending)
        atomic_add(left, pending);
    image[pixel] += total * (1.0f / samples);
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
    const float slant,                     // how much longer than the axis a ray in the grid can be
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
    for (int k = 0; k <= slabs; ++k) {
        const float4 ab = pb[k] - pa[k], bc = pc[k] - pb[k], ca = pa[k] - pc[k];
        const float wa = distance_of(&grid, pa[k]), wb = distance_of(&grid, pb[k]), wc = distance_of(&grid, pc[k]);
        square = greater(square, greater(greater(dot3(ab, ab), dot3(bc, bc)), dot3(ca, ca)));
        near = lesser(near, lesser(lesser(wa, wb), wc));
        far = greater(far, greater(greater(wa, wb), wc));
    }
    const float step = 0.75f * lesser(grid.face.y * greater(near, grid.face.z) / slant, deep);
    const int rows = (int)lesser(sqrt(square) / step, parts * ROWS - 1) + 1;
    const int heights = (int)lesser(shells.size.x / (slabs * step), parts * ROWS - 1) + 1;
    if (first_row >= rows || far < grid.face.z)
        return;

    const float4 first = lattice[CORNERS * face], second = lattice[CORNERS * face + 1];
    const float2 to_b = first.zw - first.xy, to_c = second.xy - first.xy;
    float left = 0.5f, covered = mean_at(means, 0.0f).x;
    for (int level = 0; level < slabs * heights; ++level) {
        const int slab = level / heights;
        const float inside = (level % heights + 0.5f) / heights;
        const float low = (float)level / (slabs * heights), top = (float)(level + 1) / (slabs * heights);
        /* Between these heights: what is covered below and not above, and entries going sideways. */
        const float above = mean_at(means, top).x, newly = covered - above;
        covered = above;
        float entered = 0.0f;
        for (float from = low * (HEIGHTS - 1), to = top * (HEIGHTS - 1); from < to;) {
            const float next = lesser(whole(from) + 1.0f, to);
            entered += (next - from) * mean_at(means, 0.5f * (from + next) / (HEIGHTS - 1)).y;
            from = next;
        }
        const float sideways = entered * slabs / (HEIGHTS - 1);

        const float4 up_a = pa[slab + 1] - pa[slab], up_b = pb[slab + 1] - pb[slab] - up_a,
                     up_c = pc[slab + 1] - pc[slab] - up_a;
        const float4 origin = pa[slab] + inside * up_a;
        const float4 ab = pb[slab] - pa[slab] + inside * up_b, ac = pc[slab] - pa[slab] + inside * up_c;
        const float4 n = cross3(ab, ac);
        const float share = weight * 0.25f / ((float)rows * rows * grid.face.x);
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
                w = max(w, grid.face.z);
                const float4 ray = grid.light - grid.light.w * p, up = up_a + wb * up_b + wc * up_c;
                const float along_b = dot3(ray, cross3(ac, up)), along_c = dot3(ray, cross3(up, ab));
                const float2 move = along_b * to_b + along_c * to_c;
                const float side = sideways * sideways * (move.x * move.x + move.y * move.y);
                const float down = newly * dot3(ray, n) * (dot3(up, n) < 0.0f ? -1.0f : 1.0f);
                const float both = down + max(fabs(down), sqrt(4.0f * side + 0.5947153f * (down * down)));
                const float exact = both * share / (w * w * w) + left;
                const uint amount = (uint)min(exact, 0x1p31f);
                left = min(exact - amount, 1.0f);
                if (!binary)
                    add_between(cells, &grid, at.x - SUBPIXEL / 2, at.y - SUBPIXEL / 2, at.z >> 8, amount);
                else if (amount && in_grid(&grid, at.x >> 8, at.y >> 8, at.z >> 8))
                    atomic_max(&cells[((size_t)(at.z >> 8) * grid.size.y + (at.y >> 8)) * grid.size.x + (at.x >> 8)], weight);
            }
    }
}
