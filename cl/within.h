/* Where strands were within a step, from places and speeds at both of its ends.  motion.cl uses this. */

/* What places and speeds are before a step, for what lies within it. */
__kernel void remember(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *places,          // [points, 3, padded]
    __global const float *speeds,
    __global float *places_then,           // likewise
    __global float *speeds_then)
{
    WORK_ITEM(i);
    places_then[i] = places[i];
    speeds_then[i] = speeds[i];
}

inline float4 column_of(__global const float *rows, size_t padded, size_t strand)
{
    return (float4)(rows[strand], rows[padded + strand], rows[2 * padded + strand], 0.0f);
}

/* Between two places and the speeds there, times the seconds between (Hermite). */
inline float4 curve_at(float share, float4 from, float4 from_speed, float4 to, float4 to_speed)
{
    const float left = 1.0f - share, square = share * share, left_square = left * left;
    return ((left_square * (1.0f + 2.0f * share)) * from + (left_square * share) * from_speed)
        + ((square * (1.0f + 2.0f * left)) * to - (square * left) * to_speed);
}

/* Parts of v along three axes, and back. */
inline float4 along_axes(const float4 *axes, float4 v)
{
    return (float4)(dot3(axes[0], v), dot3(axes[1], v), dot3(axes[2], v), 0.0f);
}

inline float4 of_axes(const float4 *axes, float4 v)
{
    return (v.x * axes[0] + v.y * axes[1]) + v.z * axes[2];
}

/* Where one strand was within a step, from places and speeds at both of its ends: in the world as far as it goes by its own
   laws, and in the axes of its root as far as that carries it.  Then lengths are made exact again. */
__kernel void between(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    const float share,                     // of the step, 0 to 1
    const float seconds,                   // of the step
    const int jumped,                      // 1: hair went with its root
    __global const uint2 *spans,           // [strands] first point, points
    __global const uint *type_of,          // [padded]
    __global const MotionType *types,
    __global const float *lengths,         // [points, padded] of segments [world]
    __global const float *roots_then,      // [4, 3, padded] at the step's beginning: place [world], three axes
    __global const float *roots_now,       // at its end
    __global const float *roots,           // and at the time that is asked for
    __global const float *places_then,     // [points, 3, padded] relative to the root [world]
    __global const float *speeds_then,     // [world / s]
    __global const float *places,
    __global const float *speeds,
    __global float *packed,                // [points, 3] x, y, z [world]
    __global float *normals)               // [strands, 3] unit, of the skin at the root
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    const float carried = jumped ? 1.0f : types[type_of[i]].hair.w;
    float4 then[3], now[3], here[3];
    for (int a = 0; a < 3; ++a) {
        const size_t row = (size_t)(3 + 3 * a) * padded;
        then[a] = column_of(roots_then + row, padded, i);
        now[a] = column_of(roots_now + row, padded, i);
        here[a] = column_of(roots + row, padded, i);
    }
    const float4 root = column_of(roots, padded, i);
    const float4 from = column_of(roots_then, padded, i), gone = column_of(roots_now, padded, i) - from, come = root - from;
    float4 before = (float4)(0.0f), place = before;    // of the point before: as the curves have it, and as lengths do
    for (uint k = 0; k < span.y; ++k) {
        float4 p = (float4)(0.0f);
        if (k) {
            const size_t row = 3 * (size_t)k * padded;
            const float4 a = column_of(places_then + row, padded, i), b = column_of(places + row, padded, i);
            const float4 v = seconds * column_of(speeds_then + row, padded, i), w = seconds * column_of(speeds + row, padded, i);
            const float4 free = curve_at(share, a, v, b + gone, w) - come;
            const float4 held = curve_at(share, along_axes(then, a), along_axes(then, v), along_axes(now, b), along_axes(now, w));
            p = (1.0f - carried) * free + carried * of_axes(here, held);
            const float size = lengths[(size_t)(k - 1) * padded + i];
            const float4 way = p - before;
            place = size > 0.0f ? place + size * unit_or(way, (float4)(0.0f)) : p;
        }
        before = p;
        const size_t at = 3 * (size_t)(span.x + k);
        packed[at] = root.x + place.x;
        packed[at + 1] = root.y + place.y;
        packed[at + 2] = root.z + place.z;
    }
    for (uint a = 0; a < 3; ++a)
        normals[3 * i + a] = roots[(9 + a) * (size_t)padded + i];
}
