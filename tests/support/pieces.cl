/* What coverage.cl does without tiles and lists, by the functions that it has: all pieces of a segment, whatever hides them,
   and one pixel's pieces in any order. */
#if LANES > 8 || LANES_HINTED > 1
#undef LANES
#define LANES 8
#endif
#define CHUNK (LANES == 1 ? 1 : 8)
#if LANES == 1
#define CHUNKS __local
#endif
#include "clip.h"
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "light_lanes.h"
#include "places.h"
#include "sums.h"
#include "ribbon.h"
#include "deep.h"
#include "exact_light.h"
#include "hiding.h"

/* One work-item draws one segment: counts its pieces, and writes them where there is room. */
BY_HAND __kernel void drawn(
    const ulong begin, const ulong end,
    const View view,
    __global const uint2 *list,            // [n] depth, number of a segment
    __global const float8 *ends,
    __global const uint *ids,
    __global const uint *cuts,
    const uint room,
    volatile __global uint *count,         // [1]
    __global ulong *keys,                  // [room] depth << 32 | id
    __global uint *pixels,                 // [room] among those that are drawn
    __global float *shares,                // [room]
    __global float *ats)                   // [room] where on the segment
{
#if LANES == 1
    __local Chunk chunks[64], *chunk = chunks + get_local_id(0);
#else
    Chunk one, *chunk = &one;
#endif
    WORK_ITEM(i);
    prepare(chunk, &view, list + i, 1, 1, ends, ids, cuts);
    if (!(chunk->bu[0] > chunk->au[0]))
        return;
    const int steep = chunk->steep[0];
    const int2 columns = view.rows.z + (int2)(0, view.size.x), us = steep ? view.rows.xy : columns, vs = steep ? columns : view.rows.xy;
    lanes_i lane;
    for (int k = 0; k < LANES; ++k)
        LANE_I(lane, k) = k;
    for (int u = us.x; u < us.y; u += LANES) {
        Column column;
        Outline outline;
        if (leans(chunk, 0))
            outline_of(chunk, 0, &view, lane + u, &column, &outline);
        else
            column_of(chunk, 0, &view, lane + u, &column);
        for (int k = 0; k < LANES && u + k < us.y; ++k) {
            const int top = max(LANE_I(column.low, k), vs.x), bottom = min(LANE_I(column.high, k), vs.y);
            for (int v = top; LANE(column.along, k) > 0.0f && v < bottom; ++v) {
                lanes share = leans(chunk, 0) ? share_within(&outline, I(v)) : share_of(&column, I(v));
                lanes_i at = place_in(&column, I(v));
                if (!(LANE(share, k) > 0.0f))
                    continue;
                const uint n = atomic_inc(count);
                if (n >= room)
                    continue;
                const int x = (steep ? v : u + k) - view.rows.z, y = (steep ? u + k : v) - view.rows.x;
                keys[n] = (ulong)LANE_I(column.depth, k) << 32 | chunk->id[0];
                pixels[n] = y * view.size.x + x;
                shares[n] = LANE(share, k);
                ats[n] = LANE_I(at, k) / 65535.0f;
            }
        }
    }
}

/* One work-item hides the pieces of one pixel, in passes of as many as wait. */
BY_HAND __kernel void hidden(
    const ulong begin, const ulong end,
    const int samples,
    __global const uint *starts,           // [pixels + 1]
    __global const ulong *keys,            // pieces: depth << 32 | id
    __global const float *shares,
    __global const ulong *places,          // [pieces, FEW_PLACES] light
    __global const ulong *visible,
    const int has_shells,
    __global const ulong *sample_shells,
    __global float *body_transmittance,
    __global float *alpha,
    __global ulong *front,
    __global ulong *shell_front,
    __global float4 *image)
{
    WORK_ITEM(i);
    Glow glow;
#if LANES > 1
    const Store at_once = {LIGHT_AT_ONCE};
    begin_glow(&glow, &at_once, 0, 0);
#endif
    View view;                             // of a row of pixels; where light falls is asked in it
    view.size = (int4)(1);
    view.rows = (int4)(0);
    Picture picture = {samples, has_shells, 1, visible, sample_shells, {places, 1}, body_transmittance, alpha, front,
                       shell_front, image, &glow};
    picture.sent.view = &view;
    Pixel pixel;
    Slots slots;
    const uint bound = begin_pixel(&pixel, &picture, i);
#if LANES > 1
    pixel.number = 0;
#endif
    long low = 0, limit = 0;
    while (!pixel.closed && limit != LONG_MAX) {
        int n = 0;
        limit = LONG_MAX;
        for (uint k = starts[i]; k < starts[i + 1]; ++k) {
            if ((uint)(keys[k] >> 32) >= bound || (long)keys[k] < low)
                continue;
            slots.keys[n] = keys[k];
            slots.shares[n] = shares[k];
            slots.wheres[n] = 0;
            slots.numbers[n] = k;
            if (++n == SLOTS) {
                drop(&slots, &limit);
                --n;
            }
        }
        settle(&pixel, &picture, &slots, n, limit);
        low = limit;
    }
#if LANES > 1
    glow_all(&glow, &picture.sent);
    pixel.light = glow.lights[0];
#endif
    end_pixel(&pixel, &picture);
}
