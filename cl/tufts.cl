/*
 * Tufts: strands gather towards the hair in the middle of the tuft that they stand in, curl with it, and are frizzy on top.
 * A middle is a place on the mesh where a hair grows as all others do; a strand is of the tuft whose middle is nearest to its
 * root.  Middles are the same whatever part of the mesh is on the device.
 */
#include "patch.h"

#define NO_TUFT 0xFFFFFFFFu

/* A small triangle around each middle, like its face but for one normal, on which a hair can grow. */
LARGE __kernel void stand(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *corners,        // [middles, 3] of its face [world]
    __global const float4 *corner_normals, // [middles, 3] unit
    __global const float4 *corner_uv,      // [middles, 3] u, v, -, -
    __global const float4 *weights,        // [middles] of the corners, -
    const int curved,                      // 1: PN triangles, 0: flat ones
    __global float4 *positions,            // [middles, 3] [world]
    __global float4 *normals,              // [middles, 3] unit
    __global float4 *uv)                   // [middles, 3] u, v, weights of the first two corners
{
    WORK_ITEM(i);
    float4 p[3], n[3], position, normal;
    for (int k = 0; k < 3; ++k) {
        p[k] = corners[3 * i + k];
        n[k] = corner_normals[3 * i + k];
    }
    const Patch patch = make_patch(p, n);
    const float4 b = weights[i], middle = (p[0] + p[1] + p[2]) / 3.0f;
    inside(&patch, b, curved, &position, &normal);
    float4 uv_of[3];
    for (int k = 0; k < 3; ++k)
        uv_of[k] = (float4)(corner_uv[3 * i + k].xy, k == 0, k == 1);
    const float4 at = b.x * uv_of[0] + b.y * uv_of[1] + b.z * uv_of[2], mean = (uv_of[0] + uv_of[1] + uv_of[2]) / 3.0f;
    for (int k = 0; k < 3; ++k) {
        positions[3 * i + k] = position + (p[k] - middle) * 0.0625f;
        normals[3 * i + k] = normal;
        uv[3 * i + k] = at + (uv_of[k] - mean) * 0.0625f;
    }
}

/* Where strands stand on a mesh in rest. */
RARE __kernel void at_rest(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,      // [V] of the tessellated mesh in rest
    __global const float4 *normals,        // [V]
    __global const uint4 *triangles,       // [T]
    __global const uint4 *roots,           // [strands] triangle; weights of its corners, floats
    __global float4 *places,               // [strands] x, y, z [world]
    __global float4 *place_normals)        // [strands] unit
{
    WORK_ITEM(i);
    const uint4 t = triangles[roots[i].x];
    const float4 share = as_float4(roots[i].yzww), up = (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    places[i] = share.x * positions[t.x] + share.y * positions[t.y] + share.z * positions[t.z];
    place_normals[i] = unit_or(share.x * normals[t.x] + share.y * normals[t.y] + share.z * normals[t.z], up);
}

/* What is nearest so far. */
typedef struct {
    float away;
    uint tuft;
} Nearest;

/* Look at the middles that some cells list, one after the other.  Those whose skin looks another way are further; of equally
   near ones it is the one of the lower number, so that their order has no say. */
inline Nearest look(Nearest best, float4 root, float4 normal, float spacing, uint from, uint to,
                    __global const uint *listed, __global const float4 *middles, __global const float4 *middle_normals)
{
    for (uint k = from; k < to; ++k) {
        const uint tuft = listed[k];
        const float4 middle = middles[tuft];
        const float4 apart = root - (float4)(middle.xyz, 0.0f);
        const float turned = 1.0f - dot3(normal, middle_normals[tuft]);
        const float away = (dot3(apart, apart) + spacing * spacing * turned) * middle.w;
        if (away < best.away || (away == best.away && tuft < best.tuft)) {
            best.away = away;
            best.tuft = tuft;
        }
    }
    return best;
}

/* Which cell a coordinate is in. */
inline int cell_of(float x, float low, float cells, int size)
{
    const float at = (x - low) * cells;
    return at > 0.0f ? (at < (float)(size - 1) ? (int)at : size - 1) : 0;
}

/* The tuft of each strand of a type, by cells around its root: 27 of them, then rings of more until none can be nearer. */
LARGE __kernel void assign(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *places,         // where strands have their roots [world]
    const int by_strand,                   // 1: a place for each strand, 0: the first point of each
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *place_normals,  // [strands] unit
    __global const float4 *strand_uv,      // [strands] u, v, type
    const int kind,                        // the type
    __global const float4 *middles,        // [middles] x, y, z [world], 1 / square of how large the tuft is
    __global const float4 *middle_normals, // [middles] unit
    __global const uint *listed,           // [middles of the type] cell after cell
    __global const uint *starts,           // [cells + 1] where each begins
    const float4 low,                      // lowest corner of the cells [world]; spacing of middles [world]
    const float4 scale,                    // cells a unit of length; -; -; least of all w of the middles
    const int4 size,                       // cells in x, y, z, -
    __global uint *tuft_of)                // [strands]; those of other types stay
{
    WORK_ITEM(i);
    if (!spans[i].y || (int)strand_uv[i].z != kind)
        return;
    const float4 root = (float4)(places[by_strand ? i : spans[i].x].xyz, 0.0f), normal = place_normals[i];
    const int x = cell_of(root.x, low.x, scale.x, size.x), y = cell_of(root.y, low.y, scale.x, size.y);
    const int z = cell_of(root.z, low.z, scale.x, size.z), most = max(size.x, max(size.y, size.z));
    Nearest best = {INFINITY, NO_TUFT};
    for (int ring = 1; ring <= most; ++ring) {
        for (int c = max(z - ring, 0); c <= min(z + ring, size.z - 1); ++c)
            for (int b = max(y - ring, 0); b <= min(y + ring, size.y - 1); ++b) {
                const int row = (c * size.y + b) * size.x, from = max(x - ring, 0), to = min(x + ring, size.x - 1);
                if (ring == 1 || c == z - ring || c == z + ring || b == y - ring || b == y + ring)
                    best = look(best, root, normal, low.w, starts[row + from], starts[row + to + 1], listed, middles,
                                middle_normals);
                else {
                    if (x - ring >= 0)
                        best = look(best, root, normal, low.w, starts[row + from], starts[row + from + 1], listed, middles,
                                    middle_normals);
                    if (x + ring < size.x)
                        best = look(best, root, normal, low.w, starts[row + to], starts[row + to + 1], listed, middles,
                                    middle_normals);
                }
            }
        const float beyond = (float)ring / scale.x;   // no middle in another cell is as near as that
        if (best.away < beyond * beyond * scale.w)
            break;
    }
    tuft_of[i] = best.tuft;
}

/* The tuft of a strand: of those around its own, where these are given. */
inline uint of_strand(__global const uint *tuft_of, uint i, int has_parents, __global const uint *parents)
{
    const uint tuft = tuft_of[i];
    return has_parents && tuft != NO_TUFT ? parents[tuft] : tuft;
}

/* Draw each strand of a type towards the hair in the middle of its tuft, at the same length from the root.  No segment gets
   longer: each goes from where the one before has ended towards where its own end is drawn, as far as it reaches, as a chain
   does that is pulled. */
LARGE __kernel void gather(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global float4 *points,               // x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] u, v, type
    const int kind,                        // the type
    __global const uint *tuft_of,          // [strands]
    const int has_parents,                 // 1: gather to the tufts around those
    __global const uint *parents,          // [tufts] which those are
    __global const float4 *middle_points,  // of the hair in the middle of each tuft [world]
    __global const uint2 *middle_spans,    // [tufts] first point, points
    const float strength,                  // share of the way that a tip goes
    const float bias,                      // 1 / profile - 2
    const int has_traits,                  // 0: there are none
    __global const Traits *traits)         // [strands] what maps on the skin make of them
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    const float whole = has_traits ? strength * traits[i].tuft.x : strength;
    if (span.y < 2 || (int)strand_uv[i].z != kind || whole == 0.0f)
        return;
    const uint tuft = of_strand(tuft_of, i, has_parents, parents);
    if (tuft == NO_TUFT || middle_spans[tuft].y < 2)
        return;
    uint at = middle_spans[tuft].x;
    const uint last = at + middle_spans[tuft].y - 2;       // where the last segment begins
    float4 before = (float4)(points[span.x].xyz, 0.0f), now = before;
    float length = 0.0f, gone = 0.0f;                      // of the strand; of the middle's hair up to its segment
    float4 from = (float4)(middle_points[at].xyz, 0.0f), along = (float4)(middle_points[at + 1].xyz, 0.0f) - from;
    float side = sqrt(dot3(along, along));
    for (uint k = 1; k < span.y; ++k) {
        const float4 point = points[span.x + k], here = (float4)(point.xyz, 0.0f);
        const float4 ahead = here - before;
        const float step = sqrt(dot3(ahead, ahead)), u = (float)k / (float)(span.y - 1);
        length += step;
        while (at < last && gone + side < length) {
            gone += side;
            ++at;
            from = (float4)(middle_points[at].xyz, 0.0f);
            along = (float4)(middle_points[at + 1].xyz, 0.0f) - from;
            side = sqrt(dot3(along, along));
        }
        const float4 there = side > 0.0f ? from + along * ((length - gone) / side) : from;
        const float share = whole * (u / (bias * (1.0f - u) + 1.0f));
        const float4 way = here + (there - here) * min(share, 1.0f) - now;
        const float far = sqrt(dot3(way, way));
        now = now + (far > step ? way * (step / far) : way);
        before = here;
        points[span.x + k] = (float4)(now.xyz, point.w);
    }
}

/* Where a frizzy strand is at t waves from the root: a smooth line through random places, one each wave. */
inline float2 frizz_at(uint number, uint seed, float t)
{
    const uint wave = (uint)t;
    const float f = t - (float)wave, g = f * f * (3.0f - 2.0f * f);
    const uint3 one = random3(number, seed, 64 + wave), other = random3(number, seed, 65 + wave);
    const float2 to = convert_float2(other.xy >> 8) * 0x1p-23f - 1.0f;
    const float2 from = wave ? convert_float2(one.xy >> 8) * 0x1p-23f - 1.0f : (float2)(0.0f);
    return from + (to - from) * g;
}

/* Curl and wave strands of a type together with their tuft, and make each frizzy by itself, in a frame carried along. */
RARE __kernel void curl(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global float4 *points,               // x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const uint *numbers,          // [strands] their own, behind first_strand
    const uint first_strand,
    __global const HairType *types,        // [types]
    const int kind,                        // the type
    const uint seed,
    const int has_tufts,                   // 0: curl and wave are not the tufts'
    __global const uint *tuft_of,          // [strands]
    const int has_parents,                 // 1: those around these curl as one
    __global const uint *parents,          // [tufts]
    __global const float4 *turns,          // [tufts] a vector that tells where the curl begins
    const int has_traits,                  // 0: there are none
    __global const Traits *traits)         // [strands] what maps on the skin make of them
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    if (span.y < 2 || (int)strand_uv[i].z != kind)
        return;
    const uint number = first_strand + numbers[i], tuft = has_tufts ? of_strand(tuft_of, i, has_parents, parents) : NO_TUFT;
    __global const HairType *type = &types[kind];
    const float bent = has_traits ? traits[i].scale.w : 1.0f, frizz = type->frizz.x * (has_traits ? traits[i].tuft.y : 1.0f);
    const float radius = has_tufts ? type->curl.x * bent : 0.0f, amplitude = has_tufts ? type->wave.x * bent : 0.0f;
    float4 before = (float4)(points[span.x].xyz, 0.0f), here = before;
    float4 after = (float4)(points[span.x + 1].xyz, 0.0f);
    float4 direction = unit_or(after - here, (float4)(0.0f, 1.0f, 0.0f, 0.0f));
    const float4 x = (float4)(1.0f, 0.0f, 0.0f, 0.0f), y = (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    const float4 least = fabs(direction.x) < 0.6f ? x : y;
    const float4 turn = tuft == NO_TUFT ? least : turns[tuft];
    float4 side = unit_or(cross3(direction, turn), unit_or(cross3(direction, least), x));
    float2 c = (float2)(1.0f, 0.0f), w = c;                // cosine and sine of the angles so far
    for (uint k = 1; k < span.y; ++k) {
        before = here;
        here = after;
        const float4 point = points[span.x + k];
        after = k + 1 < span.y ? (float4)(points[span.x + k + 1].xyz, 0.0f) : here;
        const float4 next = unit_or(after - before, direction);
        side = side - (direction + next) * (dot3(side, next) / max(1.0f + dot3(direction, next), 1e-6f));
        side = unit_or(side - next * dot3(side, next), least);
        direction = next;
        c = (float2)(c.x * type->curl.y - c.y * type->curl.z, c.x * type->curl.z + c.y * type->curl.y);
        w = (float2)(w.x * type->wave.y - w.y * type->wave.z, w.x * type->wave.z + w.y * type->wave.y);
        const float2 off = frizz != 0.0f ? frizz * frizz_at(number, seed, type->frizz.y * ((float)k / (float)(span.y - 1)))
                                         : (float2)(0.0f);
        const float4 moved = here + side * (radius * (c.x - 1.0f) + amplitude * w.y + off.x)
                           + cross3(direction, side) * (radius * c.y + off.y);
        points[span.x + k] = (float4)(moved.xyz, point.w);
    }
}
