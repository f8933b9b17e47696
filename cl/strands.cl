/*
 * Roots on the surface, and the strands that grow from them (the report's section 2.1.3), or strands that the
 * user brings.  A strand is a run of points; segment i joins points i and i + 1 of the same strand.
 */
#include "lanes.h"
#include "chance.h"
#include "skin.h"

/* The top 24 bits as numbers in [-1, 1): exact in a float. */
inline float4 signed_unit(uint3 r)
{
    return (float4)(convert_float3(r >> 8) * 0x1p-23f - 1.0f, 0.0f);
}

/* Integer area of a triangle whose sides are multiplied by `area_scale` first, so that no size of the world loses it:
   integers add up to the same sum in any order. */
inline ulong area_of(__global const float4 *positions, uint4 t, float area_scale)
{
    const float4 n = cross3(area_scale * (positions[t.y] - positions[t.x]), area_scale * (positions[t.z] - positions[t.x]));
    return (ulong)min(sqrt(dot3(n, n)), 0x1p58f);
}

/* Prefix sum of areas in three steps: each item sums SCAN triangles; one item runs over those sums; each item
   then writes its SCAN running sums. */
__kernel void sum_areas(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,
    __global const uint4 *triangles,       // [T]
    const uint n,                          // T
    const float area_scale,                // of lengths, that makes areas whole numbers
    __global ulong *sums)                  // [ceil(T / SCAN)]
{
    WORK_ITEM(block);
    const uint stop = min(((uint)block + 1) * (uint)SCAN, n);
    ulong sum = 0;
    for (uint t = block * SCAN; t < stop; ++t)
        sum += area_of(positions, triangles[t], area_scale);
    sums[block] = sum;
}

LARGE __kernel void scan_sums(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n,
    __global ulong *sums,                  // [n] in: sums; out: sum of all before
    __global ulong *total)                 // [1] sum of all
{
    WORK_ITEM(only);
    ulong sum = 0;
    for (uint i = 0; i < n; ++i) {
        const ulong of_block = sums[i];
        sums[i] = sum;
        sum += of_block;
    }
    *total = sum;
}

__kernel void scan_areas(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,
    __global const uint4 *triangles,       // [T]
    const uint n,                          // T
    const float area_scale,                // of lengths, that makes areas whole numbers
    __global const ulong *sums,            // [ceil(T / SCAN)] area before each block
    __global ulong *areas)                 // [T] area of triangles 0..t
{
    WORK_ITEM(block);
    const uint stop = min(((uint)block + 1) * (uint)SCAN, n);
    ulong sum = sums[block];
    for (uint t = block * SCAN; t < stop; ++t) {
        sum += area_of(positions, triangles[t], area_scale);
        areas[t] = sum;
    }
}

/* One strand a triangle, from its middle along the mean normal, as the report does. */
__kernel void roots_on_faces(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint first,                      // triangle of the first strand
    __global uint4 *roots)                 // [strands] triangle; weights of its corners, floats
{
    WORK_ITEM(i);
    const float third = 1.0f / 3.0f;
    roots[i] = (uint4)(first + (uint)i, as_uint(third), as_uint(third), as_uint(third));
}

/* Strand i of n stands at a random place of the i-th n-th of the surface's area, or of that of the same triangles at
   rest. The triangles here may be a run of all, and the strands those that stand there.  One work-item does LANES strands:
   the next is not far. */
LARGE __kernel void roots_by_area(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const ulong *areas,           // [T] running sums
    const uint n_triangles,                // T
    const ulong before,                    // area of the triangles before these
    __global const ulong *whole,           // [1] area of all
    const uint seed,
    const uint first,                      // number of the first strand
    const uint n,                          // strands in all
    const uint n_here,                     // strands here
    __global uint4 *roots)                 // [strands here] triangle; weights of its corners, floats
{
    WORK_ITEM(block);
    const ulong total = *whole;
    /* total·(i + r)/n without overflow: total is below 2^62 only as a whole, so divide first. */
    const ulong share = total / n, rest = total % n;
    const uint last = n_triangles - 1, stop = min(((uint)block + 1) * (uint)LANES, n_here);
    uint low = 0, step = n_triangles;
    for (uint here = (uint)block * LANES; here < stop; ++here, step = 1) {
        const uint i = first + here;
        const uint3 r = random3(i, seed, 0);
        const ulong place = share * i + rest * i / n + mul_hi(share, (ulong)r.x << 32) - before;
        /* Places never fall: the first is looked for among all, the others ahead in steps that double. */
        uint high = step > last ? last : low;
        for (; high < last && areas[high] <= place; step *= 2) {
            low = high + 1;
            high = last - high > step ? high + step : last;
        }
        while (low < high) {
            const uint middle = low + (high - low) / 2;
            if (areas[middle] > place)
                high = middle;
            else
                low = middle + 1;
        }
        /* Uniform in a triangle: fold the unit square's far half back. */
        float a = (r.y >> 8) * 0x1p-24f, b = (r.z >> 8) * 0x1p-24f;
        if (a + b > 1.0f) {
            a = 1.0f - a;
            b = 1.0f - b;
        }
        roots[here] = (uint4)(low, as_uint(1.0f - a - b), as_uint(a), as_uint(b));
    }
}

/* Strands that grow side by side, and their types, one in each lane. */
typedef struct {
    lanes3 corners[3], normals[3];               // of the root's triangle
    lanes shares[3];                             // weights of the corners at the root
    lanes length, width, weight, lean;           // of a segment [world]; [world]; of forces; direction_variation
    lanes substeps, softness;                    // of a segment by the law, 0: by the report's rule; how far half of one
                                                 // turns towards a force of 1
    lanes curl, curl_cos, curl_sin;              // radius [world], the angle a segment
    lanes wave, wave_cos, wave_sin;              // amplitude [world], the angle a segment
    lanes gain, bias;                            // of width from root to tip [world]; 1 / taper - 2
    lanes3 comb;                                 // direction along the skin [world]
    lanes combed;                                // its weight against the normal
    lanes_u number;
    lanes_i segments;                            // -1 where none is drawn
} Growing;

/* The frame of the skin at roots: unit vectors along an edge of the triangle and upright. */
typedef struct {
    lanes3 edge, upright;
} Skin;

/* v at length one, as `unit_or`. */
INLINED lanes3 units_or(lanes3 v, lanes3 otherwise)
{
    const lanes square = dots(v, v), size = exact_root(square);
    const lanes3 one = {v.x / size, v.y / size, v.z / size};
    return chosen(square > 1e-30f, one, otherwise);
}

/* The mean of three, one for each corner. */
INLINED lanes3 mean_of(const Growing *strands, const lanes3 *three)
{
    return plus(plus(scaled(three[0], strands->shares[0]), scaled(three[1], strands->shares[1])),
                scaled(three[2], strands->shares[2]));
}

/* Upright is the normal.  The edge turns with the skin: the triangle's first side, or its second where the first is hardly to
   be seen along the normal.  Only where both are not, is it an axis of the world that decides. */
INLINED Skin skin_of(const Growing *strands)
{
    Skin skin;
    const lanes3 *c = strands->corners, up = all_lanes((float4)(0.0f, 1.0f, 0.0f, 0.0f));
    const lanes3 face = units_or(crosses(minus(c[1], c[0]), minus(c[2], c[0])), up);
    const lanes3 n = units_or(mean_of(strands, strands->normals), face);
    lanes3 first = minus(c[1], c[0]), second = minus(c[2], c[1]);
    first = minus(first, scaled(n, dots(first, n)));
    second = minus(second, scaled(n, dots(second, n)));
    const lanes3 least = chosen(positive(n.x) < 0.6f, all_lanes((float4)(1.0f, 0.0f, 0.0f, 0.0f)), up);
    skin.upright = n;
    skin.edge = units_or(chosen(dots(first, first) > 0.01f * dots(second, second), first, second),
                         units_or(crosses(n, least), least));
    return skin;
}

/* From the frame of the skin to the world. */
INLINED lanes3 on_skin(const Skin *skin, lanes3 v)
{
    return plus(plus(scaled(skin->edge, v.x), scaled(crosses(skin->upright, skin->edge), v.y)), scaled(skin->upright, v.z));
}

/* What forces do to strands whose ends are at p. */
INLINED lanes3 push_at(lanes3 p, float4 force, __global const float4 *point_forces, uint n_point_forces)
{
    lanes3 push = all_lanes(force);
    for (uint j = 0; j < n_point_forces; ++j) {
        const float4 centre = point_forces[j];
        const lanes3 away = {p.x - centre.x, p.y - centre.y, p.z - centre.z};
        const lanes distance = exact_root(dots(away, away));
        push = chosen(distance > 0.0f, plus(push, scaled(away, centre.w * exp_minus(distance) / distance)), push);
    }
    return push;
}

/* What maps leave of a type's stiffness at least: of none a strand would have no shape. */
#define LEAST_STIFFNESS 0x1p-10f

/* What a type makes of a strand that is so many times as long, into a lane. */
INLINED void put_type(Growing *strands, uint lane, __global const HairType *type, float longer)
{
    LANE(strands->length, lane) = type->shape.x * longer;
    LANE(strands->width, lane) = type->shape.y * type->taper.x;
    LANE(strands->gain, lane) = type->shape.y * type->taper.y;
    LANE(strands->bias, lane) = type->taper.z;
    LANE(strands->weight, lane) = type->shape.z;
    LANE(strands->lean, lane) = type->shape.w;
    LANE(strands->substeps, lane) = type->taper.w;
    LANE(strands->softness, lane) = type->wave.w * longer;
    LANE(strands->curl, lane) = type->frizz.z > 0.0f ? 0.0f : type->curl.x;   // tufts curl as one, see tufts.cl
    LANE(strands->curl_cos, lane) = type->curl.y;
    LANE(strands->curl_sin, lane) = type->curl.z;
    LANE(strands->wave, lane) = type->frizz.z > 0.0f ? 0.0f : type->wave.x;
    LANE(strands->wave_cos, lane) = type->wave.y;
    LANE(strands->wave_sin, lane) = type->wave.z;
    LANE_I(strands->segments, lane) = type->counts.x ? type->counts.x : -1;
}

/* What maps on the skin make of it then. */
INLINED void put_traits(Growing *strands, uint lane, bool there, __global const Traits *traits)
{
    LANE_I(strands->segments, lane) = there ? LANE_I(strands->segments, lane) : -1;
    LANE(strands->length, lane) *= traits->scale.x;
    LANE(strands->width, lane) *= traits->scale.y;
    LANE(strands->gain, lane) *= traits->scale.y;
    LANE(strands->weight, lane) /= max(traits->scale.z, LEAST_STIFFNESS);
    LANE(strands->softness, lane) *= traits->scale.x / max(traits->scale.z, LEAST_STIFFNESS);
    LANE(strands->curl, lane) *= traits->scale.w;
    LANE(strands->wave, lane) *= traits->scale.w;
    LANE(strands->combed, lane) = traits->comb.w;
    put_lane(&strands->comb, lane, traits->comb);
}

/* How far strands have come: the line that they curl and wave about, its direction, and a vector across it that goes along
   with little twist. */
typedef struct {
    lanes3 axis, direction, side;
} Path;

/* How half a sub-step turns directions under one force: towards it, by the hyperbolic tangent of an amount, and 1 / its
   hyperbolic cosine. */
typedef struct {
    lanes3 towards;
    lanes tangent, secant;
} Turn;

/* From the tangent of 1/16 of the amount, a Padé approximant to 4e-8 of itself, by doubling.  An amount of 4 turns by 177
   degrees at most: more would leave nothing but rounding of what stands against the force. */
INLINED Turn turn_of(lanes3 push, lanes softness)
{
    const lanes size = exact_root(dots(push, push)), z = lesser(size * softness, F(4.0f)) * 0.0625f, y = z * z;
    lanes t = z * (945.0f + y * (105.0f + y)) / (945.0f + y * (420.0f + y * 15.0f));
    t = 2.0f * t / (1.0f + t * t);
    t = 2.0f * t / (1.0f + t * t);
    t = 2.0f * t / (1.0f + t * t);
    Turn turn;
    turn.towards = units_or(push, push);
    turn.tangent = 2.0f * t / (1.0f + t * t);
    turn.secant = (1.0f - t * t) / (1.0f + t * t);
    return turn;
}

/* A direction of length one that such a turn has turned: with the cosine c to the force, c' = (1 - c^2) times it, solved. */
INLINED lanes3 turned(lanes3 direction, const Turn *turn)
{
    const lanes c = dots(direction, turn->towards), by = 1.0f / (1.0f + c * turn->tangent);
    return plus(scaled(direction, turn->secant * by), scaled(turn->towards, (c * (1.0f - turn->secant) + turn->tangent) * by));
}

/* What was across `before`, taken along by the least rotation from there to `after`. */
INLINED lanes3 carried(lanes3 side, lanes3 before, lanes3 after)
{
    const lanes by = dots(side, after) / greater(1.0f + dots(before, after), F(1e-6f));
    return minus(side, scaled(plus(before, after), by));
}

/* A segment further by the law: d direction / d length = the part of the force across it / stiffness.  Each sub-step turns
   exactly as the force in its middle would have it, and goes along Simpson's mean of its directions. */
INLINED Path onward(const Growing *strands, Path path, const Turn *everywhere, bool any_bent, float4 force,
                    __global const float4 *point_forces, uint n_point_forces)
{
    const lanes step = strands->length / greater(strands->substeps, F(1.0f));
    const int most = most_lane(nearest_i(strands->substeps));
    for (int j = 0; j < most; ++j) {
        Turn turn = *everywhere;
        if (n_point_forces)
            turn = turn_of(push_at(plus(path.axis, scaled(path.direction, 0.5f * step)), force, point_forces,
                                   n_point_forces), strands->softness);
        const lanes3 middle = turned(path.direction, &turn), after = turned(middle, &turn);
        const lanes3 sum = plus(plus(path.direction, after), scaled(middle, F(4.0f)));
        const lanes_i goes = (float)j < strands->substeps;
        if (any_bent)
            path.side = chosen(goes, carried(path.side, path.direction, after), path.side);
        path.axis = chosen(goes, plus(path.axis, scaled(sum, step * (1.0f / 6))), path.axis);
        path.direction = chosen(goes, after, path.direction);
    }
    path.direction = units_or(path.direction, path.direction);
    if (any_bent)
        path.side = units_or(minus(path.side, scaled(path.direction, dots(path.side, path.direction))), path.side);
    return path;
}

/* A segment further by the report's rule: as it pointed, then its direction gives way to the force there. */
INLINED Path step_ahead(const Growing *strands, Path path, bool any_bent, float4 force, __global const float4 *point_forces,
                        uint n_point_forces)
{
    path.axis = plus(path.axis, scaled(path.direction, strands->length));
    const lanes3 push = push_at(path.axis, force, point_forces, n_point_forces);
    const lanes3 bowed = plus(path.direction, scaled(push, strands->weight));
    path.direction = chosen(dots(bowed, bowed) > 1e-12f, units_or(bowed, path.direction), path.direction);   // else rounding
    if (any_bent)
        path.side = units_or(minus(path.side, scaled(path.direction, dots(path.side, path.direction))), path.side);
    return path;
}

/* Where strands start: at their roots, along the normal or as they are combed, each as it leans. */
INLINED Path start(const Growing *strands, const Skin *skin, int has_traits, uint seed)
{
    const lanes3 turn = on_skin(skin, random_vectors(strands->number, seed, 2));
    const lanes3 lean = on_skin(skin, random_vectors(strands->number, seed, 3));
    lanes3 ahead = skin->upright;
    if (has_traits)
        ahead = plus(scaled(ahead, 1.0f - strands->combed), scaled(strands->comb, strands->combed));
    Path path;
    path.axis = mean_of(strands, strands->corners);
    path.direction = units_or(plus(ahead, scaled(lean, strands->lean)), skin->upright);
    path.side = units_or(crosses(path.direction, turn), units_or(crosses(path.direction, skin->edge), skin->upright));
    return path;
}

/* Grow strands from their roots; see `grow`. */
ONCE void lengthen(const Growing *strands, int has_traits, uint seed, float4 force, __global const float4 *point_forces,
                   uint n_point_forces, uint first, uint here, uint stride, __global float4 *points,
                   __global float4 *strand_normal)
{
    const Skin skin = skin_of(strands);
    for (uint lane = 0; lane < here; ++lane)
        strand_normal[first + lane] = (float4)(lane_of(&skin.upright, lane), 0.0f);
    Path path = start(strands, &skin, has_traits, seed);
    const lanes_i bent = strands->curl > 0.0f | strands->wave > 0.0f, lawful = strands->substeps > 0.0f;
    const bool any_bent = any_lane(bent), any_tapered = any_lane(strands->gain != 0.0f);
    const bool any_lawful = any_lane(lawful), any_other = any_lane(strands->substeps == 0.0f);
    const lanes steps = greater(TO(lanes, strands->segments), F(1.0f));
    const Turn everywhere = turn_of(all_lanes(force), strands->softness);
    lanes curl_cos = F(1.0f), curl_sin = F(0.0f), wave_cos = F(1.0f), wave_sin = F(0.0f);   // of the angle so far
    lanes3 now = path.axis;

    const int most = most_lane(strands->segments);
    for (int k = 0; k <= most; ++k) {
        lanes width = strands->width;
        if (any_tapered) {
            const lanes t = (float)k / steps;
            width += strands->gain * (t / (strands->bias * (1.0f - t) + 1.0f));
            width = greater(width, F(0.0f));   // of a tip of no width rounding could leave less
        }
        for (uint lane = 0; lane < here; ++lane)
            if (k <= LANE_I(strands->segments, lane)) {
                const size_t to = (size_t)(first + lane) * stride + k;
                points[to] = (float4)(lane_of(&now, lane), LANE(width, lane));
            }
        if (k == most)
            break;
        lanes3 direction = path.direction, side = path.side;   // of the segment by the report's rule, of its end by the law
        Path next = path;
        if (any_other)
            next = step_ahead(strands, path, any_bent, force, point_forces, n_point_forces);
        if (any_lawful) {
            const Path by_law = onward(strands, path, &everywhere, any_bent, force, point_forces, n_point_forces);
            next.axis = chosen(lawful, by_law.axis, next.axis);
            next.direction = chosen(lawful, by_law.direction, next.direction);
            next.side = chosen(lawful, by_law.side, next.side);
            direction = chosen(lawful, by_law.direction, direction);
            side = chosen(lawful, by_law.side, side);
        }
        path = next;
        now = path.axis;
        if (any_bent) {
            const lanes3 across = crosses(direction, side);
            const lanes c = curl_cos * strands->curl_cos - curl_sin * strands->curl_sin;
            curl_sin = curl_cos * strands->curl_sin + curl_sin * strands->curl_cos;
            curl_cos = c;
            const lanes w = wave_cos * strands->wave_cos - wave_sin * strands->wave_sin;
            wave_sin = wave_cos * strands->wave_sin + wave_sin * strands->wave_cos;
            wave_cos = w;
            const lanes3 off = plus(scaled(side, strands->curl * (curl_cos - 1.0f) + strands->wave * wave_sin),
                                    scaled(across, strands->curl * curl_sin));
            now = chosen(bent, plus(now, off), now);
        }
    }
}

/* One work-item grows LANES strands, by the law (`onward`) or by the report's rule (`step_ahead`).  Curl and wave shift the
   points off that axis, in a frame carried along it with little twist.  What is random has directions in the frame of the
   skin at the root, so that it turns with it. */
LARGE __kernel void grow(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,      // [V]
    __global const float4 *normals,        // [V]
    __global const float4 *uv,             // [V] u, v
    __global const uint4 *triangles,       // [T]
    __global const uint4 *roots,           // [strands] triangle; weights of its corners, floats
    __global const HairType *types,        // [types]
    __global const uint *type_map,         // index of the type; nearest texel, v runs up
    const int map_tiles,                   // how many tiles the map has, 0: none
    __global const SkinTile *tiles,            // of the map, then of textures
    __global const float4 *texels,         // colour textures of all types, linear r, g, b
    const int has_traits,                  // 0: there are none
    __global const Traits *traits,         // [strands] what maps on the skin make of them
    const float4 force,
    __global const float4 *point_forces,   // [n_point_forces] position, strength
    const uint n_point_forces,
    const uint seed,
    const uint first_strand,               // number of the first of these strands among all
    const uint n,                          // strands
    const uint stride,                     // points set aside for a strand
    const int color_per,                   // 1: strands have one colour each, 2: points have
    __global float4 *points,               // [strands, stride] x, y, z, width [world]
    __global uint2 *spans,                 // [strands] first point, points (0: bald)
    __global uint *strand_of,              // [strands] each is a run of stride points,
    __global uint *stored,                 // [strands] which lies where it came
    __global uint *shifts,                 // [strands] 0: they are where they came
    __global uint *numbers,                // [strands] their own
    __global float4 *colors,               // [strands] or [strands, stride] linear r, g, b
    __global float4 *strand_normal,        // [strands] of the body at the root, unit
    __global float4 *strand_uv)            // [strands] u, v, type
{
    WORK_ITEM(block);
    Growing strands;
    const uint first = (uint)block * LANES, here = min(n - first, (uint)LANES);
    for (uint lane = 0; lane < LANES; ++lane) {
        const uint i = first + (lane < here ? lane : 0);    // lanes without a strand do as the first, but for its points
        const uint4 t = triangles[roots[i].x];
        const float4 share = as_float4(roots[i].yzww);
        const float4 at = share.x * uv[t.x] + share.y * uv[t.y] + share.z * uv[t.z];
        const float4 middle = (uv[t.x] + uv[t.y] + uv[t.z]) / 3.0f;
        const uint kind = map_tiles ? type_at(tiles, map_tiles, type_map, middle, at) : 0;
        __global const HairType *type = &types[kind];
        const float4 vary = signed_unit(random3(first_strand + i, seed, 1));
        const float4 tint = type->counts.z ? color_at(tiles, type->counts.y, type->counts.z, texels, middle, at)
                                           : (float4)(1.0f);
        /* What maps leave without a length does not stand. */
        const bool there = type->counts.x && !(has_traits && traits[i].scale.x <= 0.0f);
        const float varied = 1.0f + type->color.w * vary.x;
        if (color_per == 1)
            colors[i] = (float4)((type->color * tint * varied).xyz, 0.0f);
        else if (lane < here)
            for (int k = 0; k <= type->counts.x; ++k) {
                const float4 color = type->root + (type->tip - type->root) * ((float)k / max(type->counts.x, 1));
                colors[(size_t)i * stride + k] = (float4)((color * tint * varied).xyz, 0.0f);
            }
        strand_uv[i] = (float4)(at.x, at.y, (float)kind, 0.0f);
        spans[i] = (uint2)(i * stride, there ? type->counts.x + 1 : 0);
        strand_of[i] = i;
        stored[i] = i * stride;
        shifts[i] = 0;
        numbers[i] = i;
        put_type(&strands, lane, type, 1.0f + type->curl.w * vary.y);
        if (has_traits)
            put_traits(&strands, lane, there, &traits[i]);
        LANE_U(strands.number, lane) = first_strand + i;
        put_lane(&strands.corners[0], lane, positions[t.x]);
        put_lane(&strands.corners[1], lane, positions[t.y]);
        put_lane(&strands.corners[2], lane, positions[t.z]);
        put_lane(&strands.normals[0], lane, normals[t.x]);
        put_lane(&strands.normals[1], lane, normals[t.y]);
        put_lane(&strands.normals[2], lane, normals[t.z]);
        LANE(strands.shares[0], lane) = share.x;
        LANE(strands.shares[1], lane) = share.y;
        LANE(strands.shares[2], lane) = share.z;
    }
    lengthen(&strands, has_traits, seed, force, point_forces, n_point_forces, first, here, stride, points, strand_normal);
}

/* One strand of the user's goes to its place in the order: packed arrays -> those of grown strands. */
RARE __kernel void unpack_curves(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *packed,          // [points, 3]
    __global const uint2 *brought,         // [strands] first point, points
    __global const uint2 *placed,          // [strands] strand, first point in the order; see order.cl
    __global const float *widths,          // one, [strands] or [points]
    const int width_per,                   // 0: one for all, 1: each strand, 2: each point
    __global const float *packed_colors,   // one, [strands, 3] or [points, 3]
    const int color_per,                   // as width_per
    __global const float *root_normals,    // [strands, 3]; none where has_normals is 0
    const int has_normals,
    __global const float *root_uv,         // [strands, 2]; none where has_uv is 0
    const int has_uv,
    __global const uint *type_of,          // [strands]; none where has_types is 0
    const int has_types,
    const uint run,                        // points of each strand, or 1 where these differ
    __global float4 *points,               // in the order: [points] x, y, z, width
    __global uint2 *spans,                 // [strands] first point, points
    __global uint *strand_of,              // [points / run]
    __global uint *shifts,                 // [strands] what, added to the number of a point here, is that as it came
    __global uint *numbers,                // [strands] of the strand as it came
    __global float4 *colors,               // one, [strands] or [points] linear r, g, b
    __global float4 *strand_normal,        // [strands] of the body at the root, 0: not known
    __global float4 *strand_uv,            // [strands] u, v, type
    __global uint *stored)                 // [points / run] where the first point of each run is that came
{
    WORK_ITEM(i);
    const uint came = brought[i].x, count = brought[i].y, strand = placed[i].x, first = placed[i].y;
    spans[strand] = (uint2)(first, count);
    shifts[strand] = came - first;
    numbers[strand] = i;
    strand_normal[strand] = has_normals ? (float4)(vload3(i, root_normals), 0.0f) : (float4)(0.0f);
    strand_uv[strand] = (float4)(has_uv ? vload2(i, root_uv) : (float2)(0.0f), has_types ? type_of[i] : 0.0f, 0.0f);
    if (color_per == 1)
        colors[strand] = (float4)(vload3(i, packed_colors), 0.0f);
    if (color_per == 0 && i == 0)
        colors[0] = (float4)(vload3(0, packed_colors), 0.0f);
    for (uint k = 0; k < count; ++k) {
        const uint p = came + k, to = first + k;
        points[to] = (float4)(vload3(p, packed), widths[width_per == 0 ? 0 : width_per == 1 ? i : p]);
        if (color_per == 2)
            colors[to] = (float4)(vload3(p, packed_colors), 0.0f);
        if (!k || run == 1) {
            stored[p / run] = to;
            strand_of[to / run] = strand;
        }
    }
}
