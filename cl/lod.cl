/*
 * No detail finer than `lod` pixels: strands that project thinner than this become fewer and wider ones, and points that
 * a straight line comes near enough to are left out.  One work-item thins one strand.
 */

#define PARTS 4u                                        // a strand keeps so many segments: light changes along straight ones
#define MOST 16u                                        // segments that one may stand for

/* A strand's place in (0, 1) in the order in which strands go: its own for ever, and never that of a prefix. */
inline float place_of(uint strand, uint seed)
{
    return ((random3(strand, seed, 4).x >> 9) + 0.5f) * 0x1p-23f;
}

/* By how much a strand's width grows where the share k of all is kept: 1/k or so up to place k, 0 from LOD_SOFT * k on. Its
   mean over all places is 1 for every k. */
inline float widening(float place, float k)
{
    if (k >= 1.0f)
        return 1.0f;
    const float end = LOD_SOFT * k, fade = end - k;
    const float mean = end <= 1.0f ? 0.5f * (k + end) : k + (1.0f - k) * (2.0f * end - k - 1.0f) / (2.0f * fade);
    return clamp((end - place) / fade, 0.0f, 1.0f) / mean;
}

/* Whether the points between two of a strand are nearer than this to the line that joins them; their widths, `wider`
   times as wide, and their colours count too. */
inline bool stands_for(__global const float4 *points, __global const float4 *colors, uint from, uint to, float near,
                       float wider)
{
    const float4 a = points[from], way = points[to] - a;
    const float square = dot3(way, way);
    for (uint p = from + 1; p < to; ++p) {
        float4 off = points[p] - a;
        const float at = square > 0.0f ? clamp(dot3(off, way) / square, 0.0f, 1.0f) : 0.0f;
        off -= at * way;
        off.w *= 0.5f * wider;
        if (!(dot3(off, off) + off.w * off.w <= near * near))
            return false;
        if (colors) {
            const float4 c = colors[p], error = fabs(colors[from] + at * (colors[to] - colors[from]) - c) * 32.0f;
            if (error.x > c.x || error.y > c.y || error.z > c.z)
                return false;
        }
    }
    return true;
}

__kernel void thin(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const float lod,                       // pixels, above 0
    const uint seed,
    const uint first_strand,               // number of the first of these strands among all
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const float4 *tangents,       // [P] unit
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *colors,         // [P] if color_per is 2
    const int color_per,                   // 2: each point has a colour
    __global float4 *out_points,           // [P] what is kept, at the front of each strand's own run
    __global float4 *out_tangents,         // [P]
    __global uint2 *out_spans,             // [strands] the same first point, points kept (0: bald)
    __global float4 *out_colors)           // [P] if color_per is 2
{
    WORK_ITEM(i);
    const uint first = spans[i].x, count = spans[i].y, last = first + count - 1;
    out_spans[i] = (uint2)(first, 0);
    if (!count)
        return;
    /* The end that is nearer to the eye decides. What has no width or is not before the eye stays. */
    const float4 root = points[first];
    const float w = min(to_screen(&view, root).w, to_screen(&view, points[last]).w), width = root.w * view.scale.x / w;
    const float k = w > 0.0f && root.w > 0.0f && width < lod ? max(width / lod, LOD_LEAST) : 1.0f;
    const float wider = widening(place_of(first_strand + (uint)i, seed), k);
    if (!(wider > 0.0f))
        return;

    __global const float4 *point_colors = color_per == 2 ? colors : 0;
    const float world = 0.25f * lod / view.scale.x;         // a quarter of lod at w = 1
    const uint most = min((count - 1 + PARTS - 1) / PARTS, MOST);
    uint kept = 0, from = first;
    for (;;) {
        const uint to = first + kept++;
        out_points[to] = (float4)(points[from].xyz, points[from].w * wider);
        out_tangents[to] = tangents[from];
        if (point_colors)
            out_colors[to] = colors[from];
        if (from == last)
            break;
        const float here = to_screen(&view, points[from]).w;
        uint next = from + 1;
        while (next < last && next + 1 - from <= most) {
            const float nearer = min(here, to_screen(&view, points[next + 1]).w);
            if (!(nearer > 0.0f && stands_for(points, point_colors, from, next + 1, world * nearer, wider)))
                break;
            ++next;
        }
        from = next;
    }
    out_spans[i] = (uint2)(first, kept);
}
