/*
 * Whose pieces are seen: of what has an id, the strand, its type, and which way it lies on the screen.
 */
#include "lanes.h"
#include "light.h"

#define CUT 0x80000000u                    // of an id: see ribbon.h

/* Twice the angle of the line through two places of the screen, as (cosine, sine): so a way and its opposite are one.  The
   angle goes from x, to the right, against the clock.  0 where the line is a point. */
inline float2 twice_the_angle(const View *view, float4 a, float4 b)
{
    const float4 p = to_screen(view, a), q = to_screen(view, b);
    const float x = q.x * p.w - p.x * q.w, y = p.y * q.w - q.y * p.w;    // the rows go down
    const float right = x < 0.0f ? -x : x, up = y < 0.0f ? -y : y, most = right > up ? right : up;
    if (!(most > 0.0f))
        return 0.0f;
    const float c = x / most, s = y / most, square = c * c + s * s;
    return (float2)((c * c - s * s) / square, 2.0f * c * s / square);
}

/* One work-item tells of one id whose it is, if this part of the scene holds it. */
__kernel void owners(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 part,                      // first point's id, points
    const uint first_strand,               // number of the part's first strand
    __global const uint *ids,              // [n] of segments, see raster.cl; CUT or not
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint *strand_of,        // [points / run]
    __global const uint *numbers,          // [strands] as they came
    __global const uint *stored,           // [points / run] where these begin
    const uint run,                        // points
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global uint2 *owners,                // [n] strand, type
    __global float2 *turns)                // [n] twice the angle on the screen: cosine, sine
{
    WORK_ITEM(i);
    const uint came = (ids[i] & ~CUT) - part.x;
    if (came >= part.y)
        return;
    const uint from = lies_at(stored, run, came), strand = strand_of[from / run];
    owners[i] = (uint2)(first_strand + numbers[strand], (uint)strand_uv[strand].z);
    turns[i] = twice_the_angle(&view, points[from], points[from + 1]);
}
