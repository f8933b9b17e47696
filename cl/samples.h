/*
 * Places on the grid that lines and triangles are snapped to, windows of the picture, and samples that keep what is offered to
 * them.  segments.h and triangles.h use this, and clip.h and lanes.h before it.
 */
#if INT64_ATOMICS
#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
#pragma OPENCL EXTENSION cl_khr_int64_extended_atomics : enable
#endif

/* What put reads before its atomic: a race, but one that is meant. Where races are looked for (tools/oclgrind.py) it is
   an atomic that changes nothing, so that only others are reported. */
#if CHECKED && INT64_ATOMICS
#define PEEK(p) atom_max(p, 0ul)
#elif CHECKED
#define PEEK(p) atomic_max(p, 0u)
#else
#define PEEK(p) (*(p))
#endif

/* Offer (depth, id) to a sample. The plain read only spares the atomic where it could not win, and may be out of date:
   what it reads can only have become smaller since. With 64-bit atomics one minimum does it; without, phase 0 finds the
   depths and phase 1 the smallest id at each depth. Both leave the same bits: depth in the high word, id in the low. */
inline void put(volatile __global ulong *visible, size_t sample, uint depth, uint id, int phase)
{
#if INT64_ATOMICS
    const ulong key = ((ulong)depth << 32) | id;
    if (key < PEEK(&visible[sample]))
        atom_min(&visible[sample], key);
#else
    volatile __global uint *word = (volatile __global uint *)&visible[sample];
    if (phase == 0) {
        if (depth < PEEK(&word[1]) && atomic_min(&word[1], depth) > depth)
            atomic_max(&word[0], NOTHING);                 // an id from an earlier launch lies behind
    } else if (depth == PEEK(&word[1]) && id < PEEK(&word[0])) {
        atomic_min(&word[0], id);
    }
#endif
}

/* Pixels, reversed depth and half a width, already divided by w -> sub-pixels and depth steps. */
inline int4 snap(float4 q)
{
    const float4 steps = (float4)(SUBPIXEL, SUBPIXEL, DEPTH_ONE, SUBPIXEL);
    int4 s = convert_int4(floor(q * steps + 0.5f));
    s.z = DEPTH_ONE - s.z;
    return s;
}

/* c.z is e (reversed depth) and c.w is w; radius is half a width in pixels at w = 1. */
inline int4 snap_clip(float4 c, float radius)
{
    return snap((float4)(c.x, c.y, min(max(c.z, 0.0f), c.w), min(radius, GUARD * c.w)) / c.w);
}

/* Pixels of all that is drawn: from left, to right, from top, to bottom. */
inline int4 all_of(const View *view)
{
    return (int4)(view->rows.z, view->rows.z + view->size.x, view->rows.x, view->rows.y);
}

/* The same of one of the windows, `side` pixels across and down, that all of it is cut into. */
inline int4 window_of(const View *view, int number, int side)
{
    const int across = (view->size.x + side - 1) / side;
    const int x = view->rows.z + number % across * side, y = view->rows.x + number / across * side;
    return (int4)(x, min(x + side, view->rows.z + view->size.x), y, min(y + side, view->rows.y));
}

/* See `within_guard`. */
INLINED lanes_i within_guard_lanes(lanes4 c)
{
    const lanes most = GUARD * c.w;
    return (c.w > 0.0f) & (c.z >= 0.0f) & (c.z <= c.w) & (c.x <= most) & (c.x >= -most) & (c.y <= most) & (c.y >= -most);
}

/* The whole number nearest to x, as `snap` has it. */
INLINED lanes_i snapped(lanes x)
{
    const lanes moved = x + 0.5f;
    const lanes_i whole = TO(lanes_i, moved);
    return TO(lanes, whole) > moved ? whole - 1 : whole;
}

/* Snapped ends of segments, or corners of triangles. */
typedef struct {
    lanes_i x, y, z;
} Corners;

INLINED Corners snap_lanes(lanes4 c, lanes_i in)
{
    const lanes w = in ? c.w : F(1.0f);
    const Corners s = {snapped((in ? c.x : F(0.0f)) / w * (float)SUBPIXEL), snapped((in ? c.y : F(0.0f)) / w * (float)SUBPIXEL),
                       DEPTH_ONE - snapped((in ? c.z : F(0.0f)) / w * (float)DEPTH_ONE)};
    return s;
}
