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

/* A number for a strand that has none of its own: by where its ends are, whichever is the root. */
inline uint number_of(float4 a, float4 b)
{
    a += 0.0f;                                          // -0.0 is 0.0
    b += 0.0f;
    const uint3 sum = random3(as_uint(a.x), as_uint(a.y), as_uint(a.z)) + random3(as_uint(b.x), as_uint(b.y), as_uint(b.z));
    return random3(sum.x, sum.y, sum.z).x;
}

/* Whether b comes before a, by x, then y, then z. */
inline bool is_after(float4 a, float4 b)
{
    return a.x != b.x ? a.x > b.x : a.y != b.y ? a.y > b.y : a.z > b.z;
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
   times as wide, and their colours count too.  From one point to the next it is a `step`, 1 or -1. */
inline bool stands_for(__global const float4 *points, __global const float4 *colors, int step, uint from, uint to,
                       float near, float wider)
{
    const int begin = step * (int)from, end = step * (int)to;
    const float4 a = points[begin], way = points[end] - a;
    const float square = dot3(way, way);
    for (int p = begin + step; p != end; p += step) {
        float4 off = points[p] - a;
        const float at = square > 0.0f ? clamp(dot3(off, way) / square, 0.0f, 1.0f) : 0.0f;
        off -= at * way;
        off.w *= 0.5f * wider;
        if (!(dot3(off, off) + off.w * off.w <= near * near))
            return false;
        if (colors) {
            const float4 c = colors[p], error = fabs(colors[begin] + at * (colors[end] - colors[begin]) - c) * 32.0f;
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
    const int by_place,                    // 1: strands have no numbers, and are gone through from the same end whichever
                                           // is the root
    const uint first_strand,               // number among all of the strand of number 0
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const uint *numbers,          // [strands]
    __global const float4 *colors,         // [P] if color_per is 2
    const int color_per,                   // 2: each point has a colour
    __global float4 *out_points,           // [P] what is kept, at the front or, where gone through backwards, the end of
                                           // each strand's own run
    __global uint2 *out_spans,             // [strands] first point, points kept (0: bald)
    __global float4 *out_colors,           // [P] if color_per is 2
    const uint steps,                      // of loops that one may take in this launch, about; ~0: all
    __global uint4 *stages,                // [strands or 0] points kept and gone through, if there is another; ~0: all
    volatile __global uint *n_open)        // [1] how many have not come to their end
{
    WORK_ITEM(i);
    uint kept = 0, from = 0, spent = 0;
    if (steps != ~0u) {
        kept = stages[i].x;
        from = stages[i].y;
        stages[i].x = ~0u;
        if (kept == ~0u)
            return;
    }
    const uint first = spans[i].x, count = spans[i].y, last = first + count - 1;
    out_spans[i] = (uint2)(first, 0);
    if (!count)
        return;
    /* The end that is nearer to the eye decides. What has no width or is not before the eye stays. */
    const float4 root = points[first], tip = points[last];
    const float wide = by_place ? max(root.w, tip.w) : root.w;
    const float w = min(to_screen(&view, root).w, to_screen(&view, tip).w), width = wide * view.scale.x / w;
    const float k = w > 0.0f && wide > 0.0f && width < lod ? max(width / lod, LOD_LEAST) : 1.0f;
    const float wider = widening(place_of(by_place ? number_of(root, tip) : first_strand + numbers[i], seed), k);
    if (!(wider > 0.0f))
        return;

    const int step = by_place && is_after(root, tip) ? -1 : 1;
    const uint start = step > 0 ? first : last;
    points += start;
    __global const float4 *point_colors = color_per == 2 ? colors + start : 0;
    const float world = 0.25f * lod / view.scale.x;         // a quarter of lod at w = 1
    const uint most = min((count - 1 + PARTS - 1) / PARTS, MOST);
    for (;;) {
        if (spent >= steps) {
            stages[i] = (uint4)(kept, from, 0, 0);
            atomic_inc(n_open);
            return;
        }
        const uint to = start + step * (int)kept++;
        const int at = step * (int)from;
        out_points[to] = (float4)(points[at].xyz, points[at].w * wider);
        if (point_colors)
            out_colors[to] = point_colors[at];
        if (from == count - 1)
            break;
        const float here = to_screen(&view, points[at]).w;
        uint next = from + 1;
        while (next < count - 1 && next + 1 - from <= most) {
            spent += next + 2 - from;
            const float nearer = min(here, to_screen(&view, points[step * (int)(next + 1)]).w);
            if (!(nearer > 0.0f && stands_for(points, point_colors, step, from, next + 1, world * nearer, wider)))
                break;
            ++next;
        }
        from = next;
        spent += 2;
    }
    out_spans[i] = (uint2)(step > 0 ? first : last + 1 - kept, kept);
}
