/*
 * What the skin says of the strands that stand on it: factors, and which way they are combed.  Which strands there are is told
 * by each one's own random number, so that all others keep their places; one that isn't there has no length.
 */
#include "lanes.h"
#include "skin.h"

#define USE 16   // of random3: which strands there are

/* Where a strand stands. */
typedef struct {
    float4 uv, middle;      // uv, weights of the first two corners of the mesh's face; the same of the triangle's middle
    float rest;             // weight of the third corner
    uint face;              // of those here
} Root;

/* A number that a map tells of a place on the skin; 1 where there is no map, `none` where that has no tile. */
INLINED float value_at(SkinMap map, __global const SkinTile *tiles, __global const float *texels, __global const float *values,
                       Root root, float none)
{
    const int per = map.kind.x, at = map.kind.y;
    if (per == PER_NONE)
        return 1.0f;
    if (per == PER_PICTURE)
        return number_at(tiles, at, map.kind.z, texels, root.middle, root.uv, none);
    if (per == PER_FACE)
        return values[at + root.face];
    __global const float *corner = values + at + 3 * root.face;
    return root.uv.z * corner[0] + root.uv.w * corner[1] + root.rest * corner[2];
}

/* A direction that a picture tells, red along u and green along v, as it goes on a triangle: at most 1 long. */
INLINED float4 along_uv(float4 side, float4 other, float4 uv_side, float4 uv_other, float red, float green)
{
    const float turned = uv_side.x * uv_other.y - uv_other.x * uv_side.y;
    const float4 u = uv_other.y * side - uv_side.y * other, v = uv_side.x * other - uv_other.x * side;
    float4 way = red * u + green * v;
    way.w = 0.0f;
    const float size = sqrt(red * red + green * green);
    const float strong = turned == 0.0f ? 0.0f : (turned < 0.0f ? -1.0f : 1.0f) * (size < 1.0f ? size : 1.0f);
    return strong * unit_or(way, (float4)(0.0f));
}

__kernel void traits(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,      // [V]
    __global const float4 *normals,        // [V]
    __global const float4 *uv,             // [V] u, v, weights of two corners of the mesh's face
    __global const uint4 *triangles,       // [T] three vertices, face
    const float area_scale,                // of lengths, that makes areas whole numbers
    __global const uint4 *roots,           // [strands] triangle; weights of its corners, floats
    __global const SkinMap *maps,          // [SKIN_MAPS] three for the direction: x, y, z, or along u and v
    __global const SkinTile *tiles,        // of their pictures
    __global const float *texels,          // of those
    __global const float *values,          // of maps by face, [F], and by corner, [F, 3]
    const float weight,                    // of the direction against the normal
    const uint seed,
    const uint first_strand,               // number of the first of these strands among all
    __global Traits *traits)               // [strands]
{
    WORK_ITEM(i);
    const uint4 t = triangles[roots[i].x];
    const float4 share = as_float4(roots[i].yzww);
    Root root;
    root.uv = share.x * uv[t.x] + share.y * uv[t.y] + share.z * uv[t.z];
    root.middle = (uv[t.x] + uv[t.y] + uv[t.z]) / 3.0f;
    const float rest = 1.0f - root.uv.z - root.uv.w;
    root.rest = rest > 0.0f ? rest : 0.0f;   // rounding could leave less
    root.face = t.w;
    float found[SKIN_MAPS];
    for (int k = 0; k < SKIN_MAPS; ++k)
        found[k] = value_at(maps[k], tiles, texels, values, root, k < SKIN_WAY ? 1.0f : 0.0f);

    const uint chance = random3(first_strand + (uint)i, seed, USE).x >> 8;
    const float length = chance * 0x1p-24f < found[SKIN_DENSITY] * found[SKIN_ON] ? found[SKIN_LENGTH] : 0.0f;
    float4 comb = (float4)(0.0f);
    if (maps[SKIN_WAY].kind.x != PER_NONE) {
        const float4 a = positions[t.x], b = area_scale * (positions[t.y] - a), c = area_scale * (positions[t.z] - a);
        const float4 up = unit_or(share.x * normals[t.x] + share.y * normals[t.y] + share.z * normals[t.z],
                                  unit_or(cross3(b, c), (float4)(0.0f, 1.0f, 0.0f, 0.0f)));
        const float4 way = maps[SKIN_WAY].kind.x == PER_PICTURE
            ? along_uv(b, c, uv[t.y] - uv[t.x], uv[t.z] - uv[t.x], found[SKIN_WAY], found[SKIN_WAY + 1])
            : (float4)(found[SKIN_WAY], found[SKIN_WAY + 1], found[SKIN_WAY + 2], 0.0f);
        comb = way - dot3(way, up) * up;
        comb.w = weight;
    }
    traits[i].scale = (float4)(length, found[SKIN_WIDTH], found[SKIN_STIFFNESS], found[SKIN_CURL]);
    traits[i].tuft = (float4)(found[SKIN_CLUMP], 1.0f, 0.0f, 0.0f);
    traits[i].comb = comb;
}
