/*
 * The OpenGL triangle tessellator with equal spacing, and the surface on it: flat, or the curved PN triangle
 * (Vlachos et al. 2001; the report's section 2.1.2).  Their mixed terms of the normal lack the 2 of a quadratic
 * Bezier triangle; with it the normals of a sphere are 3 to 200 times nearer, so it is here.
 *
 * One work-item divides one face of the mesh.  Rings: ring 0 is the face's border, its three sides divided by
 * the outer levels; ring k > 0 has `inner - 2k` segments a side and its corners at (1 - 4k/3n, 2k/3n, 2k/3n);
 * the last is a triangle (odd inner level) or a single point (even).  Ring vertices go round counter-clockwise
 * from corner 0; side i runs from corner i to corner i + 1.
 */
#include "patch.h"

/* The same on a side, from its two ends alone and always from a to b: both faces at the side get the same bits. */
inline void on_side(float4 pa, float4 na, float4 pb, float4 nb, float t, int curved, float4 *position, float4 *normal)
{
    const float s = 1.0f - t;
    *position = s * pa + t * pb;
    *normal = s * na + t * nb;
    if (curved) {
        float4 c[2], m;
        side_controls(pa, na, pb, nb, c, &m);
        *position = (s * s * s) * pa + (3.0f * s * s * t) * c[0] + (3.0f * s * t * t) * c[1] + (t * t * t) * pb;
        *normal = (s * s) * na + (2.0f * s * t) * m + (t * t) * nb;
    }
    *normal = unit_or(*normal, na);
}

/* Segments of ring k's side i; side 0 is opposite corner 2, so OpenGL calls its level outer[2]. */
inline int side_level(int4 levels, int k, int i)
{
    return k ? levels.w - 2 * k : i == 0 ? levels.z : i == 1 ? levels.x : levels.y;
}

LARGE __kernel void vertices(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *positions,       // [V, 3]
    __global const float *normals,         // [V, 3] unit
    __global const float *corner_uv,       // [F, 3, 2]
    __global const uint *faces,            // [F, 3] vertices
    __global const int4 *levels,           // [F] outer[0..2], inner: 1..64, inner already rounded up to 2
    __global const uint *first_vertex,     // [F + 1] of each face's part of the result
    const int curved,
    __global float4 *out_positions,        // [first_vertex[F]]
    __global float4 *out_normals,
    __global float4 *out_uv)
{
    WORK_ITEM(f);
    const uint index[3] = {faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]};
    float4 p[3], n[3], uv[3];              // u, v, weights of the first two corners
    for (int i = 0; i < 3; ++i) {
        p[i] = (float4)(vload3(index[i], positions), 0.0f);
        n[i] = (float4)(vload3(index[i], normals), 0.0f);
        uv[i] = (float4)(vload2(3 * f + i, corner_uv), i == 0, i == 1);
    }
    const Patch patch = make_patch(p, n);
    const int4 level = levels[f];
    const int inner = level.w;
    uint at = first_vertex[f];

    for (int k = 0; 2 * k <= inner; ++k) {
        const bool point = k > 0 && inner == 2 * k;
        for (int i = 0; i < (point ? 1 : 3); ++i) {
            const int segments = side_level(level, k, i), next = (i + 1) % 3;
            for (int j = 0; j < (point ? 1 : segments); ++j, ++at) {
                float b[3] = {0.0f, 0.0f, 0.0f};
                float4 position, normal;
                if (k == 0) {
                    const float t = (float)j / segments, back = (float)(segments - j) / segments;
                    b[i] = back;
                    b[next] = t;
                    if (index[i] < index[next])
                        on_side(p[i], n[i], p[next], n[next], t, curved, &position, &normal);
                    else
                        on_side(p[next], n[next], p[i], n[i], back, curved, &position, &normal);
                } else {
                    /* In 3n-ths: the ring's corner is (3n - 4k, 2k, 2k), a step along a side is 3. */
                    const float whole = 3.0f * inner;
                    b[i] = (whole - 4 * k - 3 * j) / whole;
                    b[next] = (2 * k + 3 * j) / whole;
                    b[3 - i - next] = 2 * k / whole;
                    inside(&patch, (float4)(b[0], b[1], b[2], 0.0f), curved, &position, &normal);
                }
                out_positions[at] = position;
                out_normals[at] = normal;
                out_uv[at] = b[0] * uv[0] + b[1] * uv[1] + b[2] * uv[2];
            }
        }
    }
}

/* Vertex j of ring k's side i; `base` is the ring's first vertex, side 3 is side 0 again. */
inline uint ring_vertex(int4 levels, uint base, int k, int i, int j)
{
    if (k && levels.w == 2 * k)
        return base;
    const int a = side_level(levels, k, 0), b = side_level(levels, k, 1), c = side_level(levels, k, 2);
    return base + ((i > 0 ? a : 0) + (i > 1 ? b : 0) + j) % (a + b + c);
}

/* Joins every ring to the next with a strip of triangles, always by the shorter diagonal in the domain. */
LARGE __kernel void triangles(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const int4 *levels,           // [F] as in vertices
    __global const uint *first_vertex,     // [F + 1]
    __global const uint *first_triangle,   // [F + 1]
    __global uint4 *out_triangles)         // [first_triangle[F]] three vertices counter-clockwise, face
{
    WORK_ITEM(f);
    const int4 level = levels[f];
    const int inner = level.w;
    uint at = first_triangle[f], base = first_vertex[f];

    if (inner == 1) {
        out_triangles[at] = (uint4)(base, base + 1, base + 2, (uint)f);
        return;
    }
    for (int k = 0; 2 * k + 1 < inner; ++k) {
        const uint next = base + side_level(level, k, 0) + side_level(level, k, 1) + side_level(level, k, 2);
        for (int i = 0; i < 3; ++i) {
            const int outside = side_level(level, k, i), within = inner - 2 * k - 2;
            int a = 0, b = 0;
            while (a < outside || b < within) {
                const uint va = ring_vertex(level, base, k, i, a), vb = ring_vertex(level, next, k + 1, i, b);
                /* Middles of the next outer and inner segment along the side: (2a+1)/2p against (2b+3)/2(q+2). */
                if (b == within || (a < outside && (2 * a + 1) * (within + 2) <= (2 * b + 3) * outside))
                    out_triangles[at++] = (uint4)(va, ring_vertex(level, base, k, i, ++a), vb, (uint)f);
                else
                    out_triangles[at++] = (uint4)(va, ring_vertex(level, next, k + 1, i, ++b), vb, (uint)f);
            }
        }
        base = next;
    }
    if (inner % 2)
        out_triangles[at] = (uint4)(base, base + 1, base + 2, (uint)f);
}
