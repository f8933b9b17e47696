/*
 * Strands as transparent as they are thin: how much of each pixel each of them covers, in the order of their depths.
 *
 * A strand is a ribbon that faces the eye, as wide as it is.  `count` counts which pixels it touches, `number` tells where
 * in memory a pixel's go, `gather` writes a fragment (depth, id, area) for each, `resolve` sorts those of a pixel and hides one
 * behind the other, and `light` lights what is left of each.  Sums are taken in the order of depths or in integers: the same
 * bits in whatever order strands are drawn.
 */
#include "clip.h"
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "sums.h"

#define CHAINS 8            // strands whose pieces in a pixel are remembered: these lie beside each other, not behind
#define BATCH 128           // fragments written together
#define FEW 64              // fragments that are sorted by insertion

/* Mean share of a row that lies below an edge which runs from a to b above the row's start.  What is taken from each other
   here is near each other: far outside of the row it is 0 or 1 without an error. */
inline float below(float a, float b)
{
    const float d = b - a, in_a = a < 0.0f ? 0.0f : a < 1.0f ? a : 1.0f, in_b = b < 0.0f ? 0.0f : b < 1.0f ? b : 1.0f;
    if (d < 1e-6f && d > -1e-6f)
        return in_a;
    return (0.5f * (in_b - in_a) * (in_b + in_a) + ((b > 1.0f ? b : 1.0f) - (a > 1.0f ? a : 1.0f))) / d;
}

/* Where fragments go. */
typedef struct {
    int counting;                          // 1: they are only counted
    volatile __global uint *pixels;        // [rows, width, 2] depth of the body where it fills the pixel; fragments so far
    __global ulong2 *areas;                // depth << 32 | id; share of the pixel's area
    uint n, waiting[BATCH];                // pixels of fragments that are not written yet
    ulong2 made[BATCH];
} Target;

/* Write what waits.  An atomic waits until all that was written before has arrived; so all places are asked for first. */
inline void flush(Target *to)
{
    for (uint i = 0; i < to->n; ++i)
        to->waiting[i] = atomic_inc(&to->pixels[2 * to->waiting[i] + 1]);
    for (uint i = 0; i < to->n; ++i)
        to->areas[to->waiting[i]] = to->made[i];
    to->n = 0;
}

inline int below_or_at(float x)
{
    const int n = (int)x;
    return n - (x < n);
}

/* A segment between a and b [pixels; z: reversed depth, w: half the width], column by column along its longer axis, or
   row by row.  Both ends are cut along the shorter axis, so that neighbours meet. */
inline void draw_segment(Target *to, const View *view, float4 a, float4 b, uint id)
{
    const float across = b.x - a.x, down = b.y - a.y;
    const bool steep = (across < 0.0f ? -across : across) < (down < 0.0f ? -down : down);
    if (steep) {
        a = a.yxzw;
        b = b.yxzw;
    }
    if (a.x > b.x) {
        const float4 t = a; a = b; b = t;
    }
    const float du = b.x - a.x;
    const int2 columns = (int2)(0, view->size.x), us = steep ? view->rows.xy : columns, vs = steep ? columns : view->rows.xy;
    if (!(du > 0.0f) || b.x <= us.x || a.x >= us.y)
        return;
    const float slope = (b.y - a.y) / du, e_step = (b.z - a.z) / du, r_step = (b.w - a.w) / du, tilt = sqrt(1.0f + slope * slope);
    const int first = below_or_at(a.x), last = below_or_at(b.x) + 1;
    const int begin = first > us.x ? first : us.x, end = last < us.y ? last : us.y;
    const int u_stride = steep ? view->size.x : 1, v_stride = steep ? 1 : view->size.x;
    for (int u = begin; u < end; ++u) {
        const float from = a.x > u ? a.x : u, until = b.x < u + 1 ? b.x : u + 1, along = until - from;
        const float middle = 0.5f * (from + until) - a.x;
        const float v0 = a.y + slope * (from - a.x), v1 = a.y + slope * (until - a.x), r = tilt * (a.w + r_step * middle);
        const int low = below_or_at((v0 < v1 ? v0 : v1) - r), high = below_or_at((v0 < v1 ? v1 : v0) + r) + 1;
        const float e = a.z + e_step * middle, in_range = e > 0.0f ? e < 1.0f ? e : 1.0f : 0.0f;
        const uint depth = DEPTH_ONE - (uint)(in_range * DEPTH_ONE);
        const int top = low > vs.x ? low : vs.x, bottom = high < vs.y ? high : vs.y;
        for (int v = top; v < bottom; ++v) {
            const int pixel = (u - us.x) * u_stride + (v - vs.x) * v_stride;
            if (depth >= to->pixels[2 * pixel])
                continue;
            if (to->counting) {
                atomic_inc(&to->pixels[2 * pixel + 1]);
                continue;
            }
            const float c0 = v0 - v, c1 = v1 - v;      // exact near the strand, so that a thin one is as wide as it is
            const float share = along * (below(c0 + r, c1 + r) - below(c0 - r, c1 - r));
            if (share > 0.0f) {
                to->waiting[to->n] = pixel;
                to->made[to->n++] = (ulong2)((ulong)depth << 32 | id, as_uint(share));
                if (to->n == BATCH)
                    flush(to);
            }
        }
    }
}

/* Clip space, half a width in pixels at w = 1 -> pixels. */
inline float4 on_screen(float4 c, float radius)
{
    const float z = c.z > 0.0f ? c.z : 0.0f, most = GUARD * c.w;
    return (float4)(c.x, c.y, z < c.w ? z : c.w, radius < most ? radius : most) / c.w;
}

/* The rare segment that leaves the guard band or crosses the near plane. */
void draw_clipped(Target *to, const View *view, float4 a, float4 b, float ha, float hb, uint id)
{
    if (clip(&a, &b, &ha, &hb))
        draw_segment(to, view, on_screen(a, ha), on_screen(b, hb), id);
}

inline void draw_strand(Target *to, const View *view, __global const float4 *points, uint2 span, uint first)
{
    float4 a, b, sa, sb;                   // clip space, pixels
    float ha = 0.0f, hb;
    bool whole = false, is_whole;          // whether what was and is the last point can be drawn as it is
    for (uint k = 0; k < span.y; ++k) {
        const float4 p = points[span.x + k];
        b = to_screen(view, p);
        hb = 0.5f * p.w * view->scale.x;
        is_whole = within_guard(b);
        sb = is_whole ? on_screen(b, hb) : b;
        if (k) {
            if (whole && is_whole)
                draw_segment(to, view, sa, sb, first + span.x + k - 1);
            else
                draw_clipped(to, view, a, b, ha, hb, first + span.x + k - 1);
        }
        a = b;
        sa = sb;
        ha = hb;
        whole = is_whole;
    }
}

/* One work-item tells how far one pixel can be seen into: to the body where that fills it. */
__kernel void bound(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int samples,
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id of the body
    __global uint2 *pixels)                // [rows, width] depth; 0
{
    WORK_ITEM(pixel);
    uint furthest = 0;
    for (int s = 0; s < samples; ++s)
        furthest = max(furthest, (uint)(visible[pixel * samples + s] >> 32));
    pixels[pixel] = (uint2)(furthest, 0);
}

/* One work-item counts which pixels one strand may touch. */
__kernel void count(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    volatile __global uint *pixels)        // [rows, width, 2] depth of what hides strands; fragments
{
    WORK_ITEM(strand);
    Target to;
    to.counting = 1;
    to.pixels = pixels;
    draw_strand(&to, &view, points, spans[strand], 0);
}

/* One work-item sums the fragments of one row. */
__kernel void sum_rows(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint width,
    __global const uint2 *counted,         // [rows, width] depth; fragments
    __global ulong *sums)                  // [rows]
{
    WORK_ITEM(row);
    ulong sum = 0;
    for (uint x = 0; x < width; ++x)
        sum += counted[row * width + x].y;
    sums[row] = sum;
}

/* Run over the pixels of one block, SCAN of them, tile by tile: so those that are near each other lie near each other in
   memory, and a strand writes to fewer pages of it.  `sum`: fragments before them -> those before the next block. */
inline ulong over_tiles(uint block, int2 size, __global const uint2 *counted, ulong sum, int numbering,
                        __global uint *starts, __global uint2 *pixels)
{
    const int across = (size.x + TILE - 1) / TILE, tiles = across * ((size.y + TILE - 1) / TILE), each = SCAN / (TILE * TILE);
    for (int tile = (int)block * each; tile < min(((int)block + 1) * each, tiles); ++tile) {
        const int left = tile % across * TILE, top = tile / across * TILE;
        for (int y = top; y < min(top + TILE, size.y); ++y)
            for (int x = left; x < min(left + TILE, size.x); ++x) {
                const size_t pixel = (size_t)y * size.x + x;
                const uint2 here = counted[pixel];
                if (numbering) {
                    starts[pixel] = (uint)sum;
                    pixels[pixel] = (uint2)(here.x, (uint)sum);
                }
                sum += here.y;
            }
    }
    return sum;
}

/* Prefix sum of fragments over pixels in three steps, as that of areas in strands.cl: one work-item sums a block; one runs
   over these sums (strands.scan_sums); one numbers the pixels of a block. */
__kernel void sum_tiles(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int2 size,                       // of the band of rows: width, rows
    const uint first,                      // its first pixel
    __global const uint2 *counted,         // [first + rows * width] depth; fragments
    __global ulong *sums)                  // [ceil(tiles * TILE² / SCAN)]
{
    WORK_ITEM(block);
    sums[block] = over_tiles(block, size, counted + first, 0, 0, 0, 0);
}

__kernel void number(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int2 size,                       // of the band of rows: width, rows
    const uint first,                      // its first pixel
    __global const uint2 *counted,         // [first + rows * width] depth; fragments
    __global const ulong *sums,            // [ceil(tiles * TILE² / SCAN)] fragments before each block
    __global uint *starts,                 // [rows, width] a pixel's first fragment
    __global uint2 *pixels)                // [rows, width] depth; a pixel's first fragment
{
    WORK_ITEM(block);
    over_tiles(block, size, counted + first, sums[block], 1, starts, pixels);
}

/* As `count`, and writes the fragments. */
__kernel void gather(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    __global const float4 *points,
    __global const uint2 *spans,
    __global const uint *shifts,           // [strands] added to the number of a segment's first point,
    const uint first,                      // and this, to make its id
    volatile __global uint *pixels,        // [rows, width, 2] depth of what hides strands; end of its fragments so far
    __global ulong2 *areas)                // fragments: depth << 32 | id; share of the pixel's area, a float
{
    WORK_ITEM(strand);
    Target to;
    to.counting = 0;
    to.pixels = pixels;
    to.areas = areas;
    to.n = 0;
    draw_strand(&to, &view, points, spans[strand], first + shifts[strand]);
    flush(&to);
}

/* Let fragment i of n sink in a heap whose nearest is first. */
inline void sink(__global ulong2 *heap, uint i, uint n)
{
    const ulong2 it = heap[i];
    for (uint child = 2 * i + 1; child < n; child = 2 * i + 1) {
        ulong2 least = heap[child];
        if (child + 1 < n) {
            const ulong2 other = heap[child + 1];
            if (other.x < least.x) {
                least = other;
                ++child;
            }
        }
        if (it.x < least.x)
            break;
        heap[i] = least;
        i = child;
    }
    heap[i] = it;
}

/* One work-item sorts the fragments of one pixel and hides one behind the other, the body and shell fur among them: C += T a c,
   T *= 1 - a, but pieces of one strand lie beside each other.  Where less than 1/256 of the light is left no more strands
   are looked at: the last one takes the rest, or what is behind them all. */
__kernel void resolve(
    const ulong begin, const ulong end,    // work-items, see common.h
    const int samples,
    __global const uint *starts,           // [rows, width] a pixel's first fragment
    __global const uint2 *pixels,          // [rows, width] depth; end of its fragments
    __global ulong2 *weights,              // fragments: depth << 32 | id; in: share of the pixel's area; out: of its light
    __global uint *used,                   // [rows, width] fragments that have any: the last ones, the nearest last of all
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id of the body
    const int has_shells,                  // 1: there is shell fur
    __global const ulong *sample_shells,   // [rows, width, samples] depth << 32 | face where half of it is gone
    __global float *body_transmittance,    // [rows, width, samples] share of the body's light that what stands before it
                                           // lets through; in: shells alone, out: strands too
    __global float *strand_transmittance,  // [rows, width] share of the shells' light that strands before them let through
    __global float *alpha,                 // [rows, width]
    __global ulong *front,                 // [rows, width] depth << 32 | id of what fills most of the pixel: strand or body
    __global ulong *shell_front)           // or depth << 32 | face, where that is shells; else nothing
{
    WORK_ITEM(pixel);
    /* Where samples end, or go on behind shells, by depth. */
    uint depths[2 * SAMPLES], places[2 * SAMPLES];
    float open[SAMPLES];
    int events = 0;
    ulong nearest_body = ~0ul, nearest_shell = ~0ul;
    for (int s = 0; s < samples; ++s) {
        const size_t sample = pixel * samples + s;
        open[s] = 1.0f / samples;
        nearest_body = min(nearest_body, visible[sample]);
        for (int kind = has_shells ? 0 : 1; kind < 2; ++kind) {
            uint depth = (uint)(visible[sample] >> 32);
            if (!kind) {
                nearest_shell = min(nearest_shell, sample_shells[sample]);
                depth = min(depth, (uint)(sample_shells[sample] >> 32));
                if (!(body_transmittance[sample] < 1.0f))
                    continue;
            } else if (depth == NOTHING) {
                continue;
            }
            int at = events++;
            for (; at > 0 && depths[at - 1] > depth; --at) {
                depths[at] = depths[at - 1];
                places[at] = places[at - 1];
            }
            depths[at] = depth;
            places[at] = 2 * s + kind;
        }
    }

    const uint n = pixels[pixel].y - starts[pixel];
    __global ulong2 *heap = weights + starts[pixel];
    const bool few = n <= FEW;
    if (few)                               // sorted at once, the nearest last, as a heap's first will be put
        for (uint i = 1; i < n; ++i) {
            const ulong2 it = heap[i];
            uint at = i;
            for (; at > 0 && heap[at - 1].x < it.x; --at)
                heap[at] = heap[at - 1];
            heap[at] = it;
        }
    else
        for (uint i = n / 2; i-- > 0;)
            sink(heap, i, n);
    uint lows[CHAINS], highs[CHAINS], left = n;
    float sums[CHAINS], kept = 1.0f, room = 1.0f, most = 0.0f, of_body = 0.0f, of_shells = 0.0f, all_shells = 0.0f;
    ulong best = ~0ul;
    int chains = 0, oldest = 0, event = 0;
    for (int s = 0; s < samples && has_shells; ++s)
        all_shells += (1.0f - body_transmittance[pixel * samples + s]) / samples;

    while (event < events || left) {
        const bool more = left && kept * room > UNSEEN;
        if (event < events && (!more || depths[event] <= (uint)(heap[few ? left - 1 : 0].x >> 32))) {
            const int s = places[event] / 2;
            const size_t sample = pixel * samples + s;
            if (places[event] & 1) {
                body_transmittance[sample] = open[s] * samples * kept;
                of_body += open[s] * kept;
                open[s] = 0.0f;
            } else {
                of_shells += open[s] * (1.0f - body_transmittance[sample]) * kept;
                open[s] *= body_transmittance[sample];
            }
            ++event;
            room = 0.0f;
            for (int k = 0; k < samples; ++k)
                room += open[k];
            continue;
        }
        if (!more)
            break;
        const ulong2 it = heap[few ? left - 1 : 0];
        --left;
        if (!few) {
            heap[0] = heap[left];
            if (left)
                sink(heap, 0, left);
        }

        /* Pieces of one strand follow each other in number. */
        const uint id = (uint)it.x;
        int chain = 0;
        while (chain < chains && !(id + 1 >= lows[chain] && id <= highs[chain] + 1))
            ++chain;
        float before = 0.0f;
        if (chain < chains) {
            before = sums[chain];
            lows[chain] = min(lows[chain], id);
            highs[chain] = max(highs[chain], id);
        } else {
            chain = chains < CHAINS ? chains++ : oldest;
            oldest = chains < CHAINS ? 0 : (chain + 1) % CHAINS;
            lows[chain] = highs[chain] = id;
        }
        const float sum = min(before + as_float((uint)it.y), 1.0f);
        sums[chain] = sum;
        const float hidden = before < 1.0f ? kept * (sum - before) / (1.0f - before) : 0.0f;
        kept -= hidden;
        float weight = hidden * room;
        if (!(kept * room > UNSEEN)) {
            weight += kept * room;
            kept = 0.0f;
        }
        heap[left] = (ulong2)(it.x, as_uint(weight));
        if (weight > most) {
            most = weight;
            best = it.x;
        }
    }
    float rest = 0.0f;
    for (int s = 0; s < samples; ++s)
        rest += open[s];
    used[pixel] = n - left;
    alpha[pixel] = 1.0f - rest * kept;
    strand_transmittance[pixel] = all_shells > 0.0f ? of_shells / all_shells : 1.0f;
    if (of_body >= most && of_body > 0.0f) {
        most = of_body;
        best = nearest_body;
    }
    const bool is_shell = of_shells > most && nearest_shell != ~0ul;
    front[pixel] = is_shell ? ~0ul : best;
    shell_front[pixel] = is_shell ? nearest_shell : ~0ul;
}

/* One work-item tells what share of each light's direct light hair and body let through to the points of one strand: the
   same from wherever they are seen. */
__kernel void transmittance(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *points,         // strands: see strands.cl
    __global const uint *strand_of,
    const uint run,
    __global const float4 *strand_normal,
    __global const float4 *strand_uv,
    __global const HairType *types,
    __global const float4 *colors,
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    __global const uint2 *spans,           // [strands] first point, points
    const uint n_points,
    __global float *transmittances)        // [n_lights, n_points] 0..1
{
    WORK_ITEM(strand);
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const Hair hair = {points, spans, strand_of, run, strand_normal, strand_uv, types, colors, 0};
    for (int i = 0; i < n_lights; ++i) {
        const Obstacles obstacles = obstacles_of(&lighting, i);
        for (uint k = 0; k < spans[strand].y; ++k) {
            const uint id = spans[strand].x + k;
            transmittances[(size_t)i * n_points + id] =
                transmittance_at(&obstacles, &hair, id, 0.0f, (float4)(points[id].xyz, 0.0f));
        }
    }
}

/* One work-item lights the fragments of one pixel, those of one part of the scene. */
__kernel void light(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint2 part,                      // first point's id, points
    __global const uint2 *pixels,          // [rows, width] depth; end of its fragments
    __global const uint *used,             // [rows, width] those that are seen
    __global const ulong2 *weights,        // fragments: depth << 32 | id; share of the pixel's light
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global const float4 *strand_uv,
    __global const HairType *types,
    __global const float4 *colors,
    const int color_per,
    const int n_lights,
    __global const Light *lights,
    const int shadowed,                    // 1: something stands before them
    __global const float *transmittances,  // [n_lights, points] share of direct light, if so
    __global long4 *radiance_sums)         // [rows, width] r, g, b, alpha in 1/ONE
{
    WORK_ITEM(pixel);
    const Hair hair = {points, spans, strand_of, run, 0, strand_uv, types, colors, color_per};
    const float x = pixel % view.size.x + 0.5f, y = view.rows.x + (int)(pixel / view.size.x) + 0.5f;
    const uint last = pixels[pixel].y, first = last - used[pixel];
    long4 sum = radiance_sums[pixel];
    /* Light by light: what one needs of a fragment fits the registers. */
    for (int k = 0; k < n_lights; ++k) {
        const Light light = lights[k];
        __global const float *there = transmittances + (size_t)k * part.y;
        for (uint i = last; i-- > first;) {
            const uint came = (uint)weights[i].x - part.x;
            if (came >= part.y)
                continue;
            const uint id = lies_at(stored, run, came);
            const float e = (float)(DEPTH_ONE - (uint)(weights[i].x >> 32)) / DEPTH_ONE;
            const float4 q = view.to_world[0] * x + view.to_world[1] * y + view.to_world[2] * e + view.to_world[3];
            const float4 p = (float4)(q.xyz / q.w, 0.0f);
            const float at = place_between(points[id], points[id + 1], p);
            const Fibre here = fibre_at(&hair, id, at);
            const float4 radiance = shade_fibre(&light, &here, p, towards_eye(&view, p),
                                                shadowed ? there[id] + at * (there[id + 1] - there[id]) : 1.0f);
            sum += in_integers(as_float((uint)weights[i].y), (float4)(radiance.xyz, k ? 0.0f : 1.0f));
        }
    }
    radiance_sums[pixel] = sum;
}
