/*
 * The pattern of shell fur: how high hair stands at a place in it, where noise moves that, and what many hairs are on
 * average.  shells.cl and march.cl use this, and lanes.h before it.  What a place in the fur is called:
 *   h        height, 0 on the skin and 1 at the longest tips
 *   x, y     place in the pattern, on every face linear: "cells" are triangles with sides of 1, "sine" has periods of 1
 */
#define CELL_RADIUS 0.62f   // of a hair at its root, in sides of a cell: it reaches just beyond the cell's corners

/* sin(2 pi r), |r| <= 1/4, to 1e-7 (Taylor).  A macro and not a function: code that rounds each step may use it, too. */
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

/* Share of a place at height h that hair covers, where the fur is v high: the report's threshold and smoothstep. */
INLINED lanes sharp_cover(const Shells *shells, lanes v, lanes h)
{
    const lanes u = within((v - h) / greater((shells->shape.x - 1.0f) * h, F(1e-3f)), 0.0f, 1.0f);
    return u * u * (3.0f - 2.0f * u);
}

/* The table of means at a height. */
INLINED float2 mean_at(__global const float2 *means, float h)
{
    const float at = (h < 0.0f ? 0.0f : h > 1.0f ? 1.0f : h) * (HEIGHTS - 1);
    const int k = at < HEIGHTS - 2 ? (int)at : HEIGHTS - 2;
    return means[k] + (at - k) * (means[k + 1] - means[k]);
}
