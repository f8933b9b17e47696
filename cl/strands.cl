/*
 * Roots on the surface, and the strands that grow from them (the report's section 2.1.3), or strands that the
 * user brings.  A strand is a run of points; segment i joins points i and i + 1 of the same strand.
 */

/* The top 24 bits as numbers in [-1, 1): exact in a float. */
inline float4 signed_unit(uint3 r)
{
    return (float4)(convert_float3(r >> 8) * 0x1p-23f - 1.0f, 0.0f);
}

/* exp(-x) for x >= 0 in + - * only, so that every device gives the same bits: 2^-k * 2^-f, f in [0, 1), by the
   Taylor series of 2^(1/2 - f) around its middle. Wrong by less than 3e-7 of exp(0). */
inline float exp_minus(float x)
{
    const float y = min(x * 1.44269504f, 125.0f), k = floor(y);
    const float z = (0.5f - (y - k)) * 0.693147181f;
    const float series = 1.0f + z * (1.0f + z * (0.5f + z * (0.166666667f + z * (0.0416666667f
        + z * (0.00833333333f + z * (0.00138888889f + z * 0.000198412698f))))));
    return series * 0.707106781f * as_float((uint)(127 - (int)k) << 23);
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

__kernel void scan_sums(
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

/* Unit vector across a direction that turns with the skin: along the triangle's first side, or its second where the first
   is hardly to be seen along the direction.  Only where both are not, is it an axis of the world that decides. */
inline float4 edge_across(float4 a, float4 b, float4 c, float4 direction)
{
    const float4 first = b - a - dot3(b - a, direction) * direction, second = c - b - dot3(c - b, direction) * direction;
    const float4 least = fabs(direction.x) < 0.6f ? (float4)(1.0f, 0.0f, 0.0f, 0.0f) : (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    return unit_or(dot3(first, first) > 0.01f * dot3(second, second) ? first : second, unit_or(cross3(direction, least), least));
}

inline void put_root(
    __global const float4 *positions, __global const float4 *normals, __global const float4 *uv,
    uint4 t, float a, float b, float c,
    __global float4 *root, __global float4 *direction, __global float4 *edge, __global float4 *root_uv)
{
    const float4 face = unit_or(cross3(positions[t.y] - positions[t.x], positions[t.z] - positions[t.x]),
                                (float4)(0.0f, 1.0f, 0.0f, 0.0f));
    *root = a * positions[t.x] + b * positions[t.y] + c * positions[t.z];
    *direction = unit_or(a * normals[t.x] + b * normals[t.y] + c * normals[t.z], face);
    *edge = edge_across(positions[t.x], positions[t.y], positions[t.z], *direction);
    *root_uv = a * uv[t.x] + b * uv[t.y] + c * uv[t.z];
}

/* One strand a triangle, from its middle along the mean normal, as the report does. */
__kernel void roots_on_faces(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,      // [V]
    __global const float4 *normals,
    __global const float4 *uv,
    __global const uint4 *triangles,       // [first + strands]
    const uint first,                      // triangle of the first strand
    __global float4 *root,                 // [strands]
    __global float4 *root_direction,       // [strands] unit
    __global float4 *root_edge,            // [strands] unit, across it, see edge_across
    __global float4 *root_uv)              // [strands] u, v, -, -
{
    WORK_ITEM(i);
    const float third = 1.0f / 3.0f;
    put_root(positions, normals, uv, triangles[first + i], third, third, third,
             &root[i], &root_direction[i], &root_edge[i], &root_uv[i]);
}

/* Strand i of n stands at a random place of the i-th n-th of the surface's area, or of that of the same triangles at
   rest. The triangles here may be a run of all, and the strands those that stand there. */
__kernel void roots_by_area(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,
    __global const float4 *normals,
    __global const float4 *uv,
    __global const uint4 *triangles,       // [T]
    __global const ulong *areas,           // [T] running sums
    const uint n_triangles,                // T
    const ulong before,                    // area of the triangles before these
    __global const ulong *whole,           // [1] area of all
    const uint seed,
    const uint first,                      // number of the first strand
    const uint n,                          // strands in all
    __global float4 *root,                 // [strands here]
    __global float4 *root_direction,
    __global float4 *root_edge,
    __global float4 *root_uv)
{
    WORK_ITEM(here);
    const uint i = first + here;
    const ulong total = *whole;
    const uint3 r = random3(i, seed, 0);
    /* total·(i + r)/n without overflow: total is below 2^62 only as a whole, so divide first. */
    const ulong share = total / n, rest = total % n;
    const ulong place = share * i + rest * i / n + mul_hi(share, (ulong)r.x << 32) - before;
    uint low = 0, high = n_triangles - 1;
    while (low < high) {
        const uint middle = (low + high) / 2;
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
    put_root(positions, normals, uv, triangles[low], 1.0f - a - b, a, b,
             &root[here], &root_direction[here], &root_edge[here], &root_uv[here]);
}

/* Bilinear texel with wrap-around; v runs up, rows run down. */
inline float4 texture_at(__global const float4 *texels, int width, int height, float4 uv)
{
    const float x = (uv.x - floor(uv.x)) * width - 0.5f, y = (1.0f - (uv.y - floor(uv.y))) * height - 0.5f;
    const float fx = x - floor(x), fy = y - floor(y);
    const int x0 = ((int)floor(x) + width) % width, y0 = ((int)floor(y) + height) % height;
    const int x1 = (x0 + 1) % width, y1 = (y0 + 1) % height;
    return (1.0f - fy) * ((1.0f - fx) * texels[y0 * width + x0] + fx * texels[y0 * width + x1])
         + fy * ((1.0f - fx) * texels[y1 * width + x0] + fx * texels[y1 * width + x1]);
}

/* From the frame of the skin to the world: along an edge, across it, upright. */
inline float4 on_skin(float4 edge, float4 upright, float4 v)
{
    return v.x * edge + v.y * cross3(upright, edge) + v.z * upright;
}

/* One strand: point k + 1 = point k + direction · length; direction += weight · force, at length one again.
   Curl and wave shift the points off that axis, in a frame carried along it with little twist.  What is random has
   directions in the frame of the skin at the root, so that it turns with it. */
__kernel void grow(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *root,           // [strands]
    __global const float4 *root_direction, // [strands] unit
    __global const float4 *root_edge,      // [strands] unit, across it
    __global const float4 *root_uv,        // [strands] u, v
    __global const HairType *types,        // [types]
    __global const uint *type_map,         // [height, width] index of the type; nearest texel, v runs up
    const int2 map_size,                   // width, height
    __global const float4 *texels,         // colour textures of all types, linear r, g, b
    const float4 force,
    __global const float4 *point_forces,   // [n_point_forces] position, strength
    const uint n_point_forces,
    const uint seed,
    const uint first_strand,               // number of the first of these strands among all
    const uint stride,                     // points set aside for a strand
    __global float4 *points,               // [strands, stride] x, y, z, width [world]
    __global float4 *tangents,             // [strands, stride] unit
    __global uint *strand_of,              // [strands, stride]
    __global uint2 *spans,                 // [strands] first point, points (0: bald)
    __global uint *shifts,                 // [strands] 0: they are where they came
    __global uint *numbers,                // [strands] their own
    __global float4 *colors,               // [strands] linear r, g, b
    __global float4 *strand_uv)            // [strands] u, v, type
{
    WORK_ITEM(item);
    const uint i = item, number = first_strand + i;
    const float4 uv = root_uv[i];
    const int column = (int)((uv.x - floor(uv.x)) * map_size.x), row = (int)((1.0f - (uv.y - floor(uv.y))) * map_size.y);
    const uint kind = type_map[min(row, map_size.y - 1) * map_size.x + min(column, map_size.x - 1)];
    const HairType type = types[kind];
    const uint first = i * stride;
    const int segments = type.counts.x;
    const float4 vary = signed_unit(random3(number, seed, 1));

    spans[i] = (uint2)(first, segments ? segments + 1 : 0);
    shifts[i] = 0;
    numbers[i] = i;
    strand_uv[i] = (float4)(uv.x, uv.y, (float)kind, 0.0f);
    float4 color = type.color;
    if (type.counts.z)
        color *= texture_at(texels + type.counts.y, type.counts.z, type.counts.w, uv);
    color *= 1.0f + type.color.w * vary.x;
    colors[i] = (float4)(color.xyz, 0.0f);
    if (!segments)
        return;

    const float length = type.shape.x * (1.0f + type.curl.w * vary.y);
    const float4 upright = root_direction[i], edge = root_edge[i];
    const float4 lean = on_skin(edge, upright, signed_unit(random3(number, seed, 3)));
    const float4 turn = on_skin(edge, upright, signed_unit(random3(number, seed, 2)));
    float4 axis = root[i];
    float4 direction = unit_or(upright + type.shape.w * lean, upright);
    const bool bent = type.curl.x > 0.0f || type.wave.x > 0.0f;
    float4 side = unit_or(cross3(direction, turn), unit_or(cross3(direction, edge), upright));
    float2 curl = (float2)(1.0f, 0.0f), wave = (float2)(1.0f, 0.0f);   // cos, sin of the angle so far
    float4 before = axis, here = axis, tangent = direction;

    for (int k = 0; k < segments; ++k) {
        axis += direction * length;
        float4 next = axis;
        if (bent) {
            const float4 across = cross3(direction, side);
            curl = (float2)(curl.x * type.curl.y - curl.y * type.curl.z, curl.x * type.curl.z + curl.y * type.curl.y);
            wave = (float2)(wave.x * type.wave.y - wave.y * type.wave.z, wave.x * type.wave.z + wave.y * type.wave.y);
            next += (type.curl.x * (curl.x - 1.0f) + type.wave.x * wave.y) * side + (type.curl.x * curl.y) * across;
        }
        tangent = unit_or(next - before, tangent);
        points[first + k] = (float4)(here.xyz, type.shape.y);
        tangents[first + k] = tangent;
        strand_of[first + k] = i;
        before = here;
        here = next;

        float4 push = force;
        for (uint j = 0; j < n_point_forces; ++j) {
            const float4 centre = point_forces[j];
            float4 away = axis - centre;
            away.w = 0.0f;
            const float distance = sqrt(dot3(away, away));
            if (distance > 0.0f)
                push += (centre.w * exp_minus(distance) / distance) * away;
        }
        const float4 bowed = direction + type.shape.z * push;
        if (dot3(bowed, bowed) > 1e-12f)   // of a sum that cancels only rounding is left
            direction = unit_or(bowed, direction);
        if (bent)
            side = unit_or(side - dot3(side, direction) * direction, side);
    }
    points[first + segments] = (float4)(here.xyz, type.shape.y);
    tangents[first + segments] = unit_or(here - before, tangent);
    strand_of[first + segments] = i;
}

/* One strand of the user's goes to its place in the order: packed arrays -> those of grown strands, tangents from the
   neighbouring points. */
__kernel void unpack_curves(
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
    __global float4 *tangents,             // [points] unit
    __global uint *strand_of,              // [points]
    __global uint2 *spans,                 // [strands] first point, points
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
    float4 before, here, next, tangent = (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    for (uint k = 0; k < count; ++k) {
        const uint p = came + k, to = first + k;
        if (k == 0)
            before = here = (float4)(vload3(p, packed), 0.0f);
        next = k + 1 < count ? (float4)(vload3(p + 1, packed), 0.0f) : here;
        tangent = unit_or(next - before, tangent);
        points[to] = (float4)(here.xyz, widths[width_per == 0 ? 0 : width_per == 1 ? i : p]);
        tangents[to] = tangent;
        strand_of[to] = strand;
        if (color_per == 2)
            colors[to] = (float4)(vload3(p, packed_colors), 0.0f);
        if (p % run == 0)
            stored[p / run] = to;
        before = here;
        here = next;
    }
}
