/*
 * What strands send to the eye of the light of cells, looked up at some of their points.  transport.cl uses this, and scatter.h,
 * light.h, sky.h and transport.h before it.
 */
#define FAR 4                              // segments of a strand at whose ends alone light is looked up, where that is EVEN
#define EVEN 0.75f                         // sides of a cell
#define STRAIGHT 0.98f                     // cosine to its chord of each of them

/* One work-item notes that the points of one segment are looked up. */
__kernel void ask(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint first,                      // of the segments
    __global const uint *segments,         // their ids, their highest bits aside
    const uint first_point,                // the id of the first of these points
    __global const uint2 *spans,           // strands: see strands.cl
    __global const uint *strand_of,
    __global const uint *stored,
    const uint run,
    __global uint *asked)                  // [points] 1 where light is asked for; all 0 at first
{
    WORK_ITEM(item);
    const uint id = lies_at(stored, run, (segments[first + item] & ~BODY) - first_point);
    const uint2 span = spans[strand_of[id / run]];
    asked[id] = 1;
    if (id + 1 < span.x + span.y)
        asked[id + 1] = 1;
}

/* How many of a strand's segments around a point lie on one line, about, on which light changes evenly: FAR, half as many, or
   one. most: how long that may be. */
INLINED uint evenly(__global const float4 *points, uint2 span, uint id, float most)
{
    const uint past = span.x + span.y;
    for (uint far = FAR; far > 1; far /= 2) {
        const uint first = id - (id - span.x) % far, last = first + far < past ? first + far : past - 1;
        const float4 begins = points[first], whole = points[last] - begins;
        const float length = dot3(whole, whole);
        bool even = length < most * most;
        for (uint k = first; k < last && even; ++k) {
            const float4 step = points[k + 1] - points[k];
            const float ahead = dot3(step, whole);
            even = ahead >= 0.0f && ahead * ahead >= STRAIGHT * STRAIGHT * (dot3(step, step) * length);
        }
        if (even)
            return far;
    }
    return 1;
}

/* One work-item tells what some points of strands send to the eye of the light of cells.  It is looked up at the ends of what
   lies on a line, and lies on a line between. */
__kernel void leaving(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint n_points,
    const uint each,                       // points of a work-item
    const int asks,                        // 1: `asked` tells where light is asked for, 0: everywhere
    __global const uint *asked,            // [points] see `ask`
    __global const float4 *points,         // strands: see strands.cl
    __global const uint2 *spans,
    __global const uint *strand_of,
    const uint run,
    __global const float4 *strand_uv,
    __global const float4 *colors,
    const int color_per,
    const Sky sky,
    __global const float *light,           // [n, n, n, CHANNELS, DIRECTIONS] see `sweep`
    __global const float *directions,      // [3, DIRECTIONS]
    __global const Lobes *lobes,
    __global const float4 *table,
    __global const float *albedos,         // [types, ALBEDOS, SHADES]
    __global float4 *scattered)            // [points] r, g, b, where it is asked for
{
    WORK_ITEM(item);
    uint id = each * (uint)item, known[2] = {n_points, n_points};
    const uint until = n_points - id < each ? n_points : id + each;
    float4 sent[2];
    while (id < until) {
        const uint strand = strand_of[id / run];
        const uint2 span = spans[strand];
        const uint past = span.x + span.y;
        if ((asks && !asked[id]) || id < span.x || id >= past) {   // or no strand's
            ++id;
            continue;
        }
        const uint far = color_per == 2 ? 1 : evenly(points, span, id, EVEN / sky.place.w);
        const uint first = id - (id - span.x) % far, last = first + far < past ? first + far : past - 1;
        const uint ends[2] = {id == last ? last : first, id == first ? first : last};   // one alone, if it is that
        const int type = (int)strand_uv[strand].z;
        const Lobes its = lobes[type];
        if (ends[0] == known[1]) {
            known[0] = known[1];
            sent[0] = sent[1];
        }
        #pragma unroll 1
        for (int k = 0; k < 2; ++k) {
            const uint at = ends[k];
            if (at == known[k])
                continue;
            known[k] = at;
            if (k && at == known[0]) {
                sent[1] = sent[0];
                continue;
            }
            const float4 p = (float4)(points[at].xyz, 0.0f), before = points[at > span.x ? at - 1 : at];
            const float4 after = points[at + 1 < past ? at + 1 : at], c = colors[color_per == 0 ? 0 : color_per == 1 ? strand : at];
            sent[k] = scattered_at(&sky, light, directions, &its, table, albedos + type * (ALBEDOS * SHADES), p,
                                   tangent_of(after - before, after - p), towards_eye(&view, p), shades_of(c, its.color.x));
        }
        const float share = ends[1] == ends[0] ? 0.0f : (float)(id - ends[0]) / (ends[1] - ends[0]);
        scattered[id] = sent[0] + share * (sent[1] - sent[0]);
        ++id;
    }
}
