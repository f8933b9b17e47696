/*
 * Triangles drawn into samples.  Where LANES is more than 1 small ones are set up side by side; those of many samples are then
 * drawn one by one, the samples of a row side by side, and those of few all at once.  raster.cl uses this, and samples.h before
 * it.
 */

/* n·2^14 / area, exact but for the last bit, modulo 2^64. */
inline ulong gradient(long n, long area)
{
    const long whole = n / area, rest = n % area;
    return ((ulong)whole << 14) + (ulong)((rest << 14) / area);
}

/* Twice the area spanned by the edge p -> q and the point (x, y). */
inline long edge(int4 p, int4 q, int x, int y)
{
    return (long)(q.x - p.x) * (y - p.y) - (long)(q.y - p.y) * (x - p.x);
}

/* A sample on an edge belongs to one of the two triangles there: to the one to the right of it or below. */
inline long edge_bias(int4 p, int4 q)
{
    return q.y < p.y || (q.y == p.y && q.x > p.x) ? 0 : -1;
}

/* Samples of a window, see `all_of`.  `after`: depth that a sample's fragment must lie behind, if `facing`, which also leaves
   out what faces away. */
ONCE void draw_triangle(volatile __global ulong *visible, const View *view, int4 window, int4 a, int4 b, int4 c, uint id,
                          int phase, int facing, __global const uint *after)
{
    long area = edge(a, b, c.x, c.y);
    if (area == 0 || (facing && area > 0))                  // counter-clockwise is clockwise where y points down
        return;
    if (area < 0) {
        const int4 t = b; b = c; c = t;
        area = -area;
    }
    const int samples = view->size.z, furthest = SUBPIXEL / 2;   // no sample lies further from a pixel's centre
    const int x0 = max((min(min(a.x, b.x), c.x) - furthest) >> 8, window.x);
    const int y0 = max((min(min(a.y, b.y), c.y) - furthest) >> 8, window.z);
    const int x1 = min((max(max(a.x, b.x), c.x) + furthest) >> 8, window.y - 1);
    const int y1 = min((max(max(a.y, b.y), c.y) + furthest) >> 8, window.w - 1);
    if (x0 > x1 || y0 > y1)
        return;

    const long bias_c = edge_bias(a, b), bias_a = edge_bias(b, c), bias_b = edge_bias(c, a);
    const long db = b.z - a.z, dc = c.z - a.z;
    const ulong gx = gradient(db * (c.y - a.y) - dc * (b.y - a.y), area);
    const ulong gy = gradient(dc * (b.x - a.x) - db * (c.x - a.x), area);
    const int nearest = min(min(a.z, b.z), c.z), farthest = max(max(a.z, b.z), c.z);
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        for (int y = y0; y <= y1; ++y) {
            /* The three edges at the row's first sample; along the row they change by as much each pixel. */
            const int sx = x0 * SUBPIXEL + SUBPIXEL / 2 + offset.x, sy = y * SUBPIXEL + SUBPIXEL / 2 + offset.y;
            long ec = edge(a, b, sx, sy) + bias_c, ea = edge(b, c, sx, sy) + bias_a, eb = edge(c, a, sx, sy) + bias_b;
            ulong d = gx * (ulong)(long)(sx - a.x) + gy * (ulong)(long)(sy - a.y);
            for (int x = x0; x <= x1; ++x) {
                if ((ec | ea | eb) >= 0) {
                    const size_t sample = ((size_t)(y - view->rows.x) * view->size.x + (x - view->rows.z)) * samples + s;
                    const uint depth = (uint)clamp(a.z + ((long)d >> 14), (long)nearest, (long)farthest);
                    if (!facing || depth > after[sample])
                        put(visible, sample, depth, id, phase);
                }
                ec -= (long)(b.y - a.y) * SUBPIXEL;
                ea -= (long)(c.y - b.y) * SUBPIXEL;
                eb -= (long)(a.y - c.y) * SUBPIXEL;
                d += gx * SUBPIXEL;
            }
        }
    }
}

/* How far clip-space c lies inside plane i of what a light sees of casters before its near plane. */
inline float before_near(const View *view, float4 c, int i)
{
    return i == 0 ? c.z - c.w : i == 1 ? c.w - view->scale.z : inside(c, i);
}

/* The rare triangle that leaves the guard band or crosses the near plane: clip it to a polygon and fan that.
   `before`: of what lies before the near plane, which is drawn at it; of what lies behind it else. */
void draw_triangle_clipped(volatile __global ulong *visible, const View *view, int4 window, float4 a, float4 b, float4 c,
                           uint id, int phase, int facing, __global const uint *after, bool before)
{
    float4 polygon[9], next[9];
    int n = 3;
    polygon[0] = a;
    polygon[1] = b;
    polygon[2] = c;
    for (int i = 0; i < 6; ++i) {
        int m = 0;
        for (int j = 0; j < n; ++j) {
            const float4 p = polygon[j], q = polygon[j + 1 < n ? j + 1 : 0];
            const float dp = before ? before_near(view, p, i) : inside(p, i);
            const float dq = before ? before_near(view, q, i) : inside(q, i);
            if (dp >= 0.0f)
                next[m++] = p;
            if (dp >= 0.0f && dq < 0.0f)
                next[m++] = cut(p, dp, q, dq);
            else if (dp < 0.0f && dq >= 0.0f)
                next[m++] = cut(q, dq, p, dp);
        }
        n = m;
        for (int j = 0; j < n; ++j)
            polygon[j] = next[j];
    }
    for (int j = 0; j < n; ++j)
        if (!(polygon[j].w > 0.0f))
            return;
    for (int j = 1; j + 1 < n; ++j)
        draw_triangle(visible, view, window, snap_clip(polygon[0], 0.0f), snap_clip(polygon[j], 0.0f),
                      snap_clip(polygon[j + 1], 0.0f), id, phase, facing, after);
}

/* Draw a triangle [world] by itself: `whole` if it is not to be clipped. */
inline void draw_triangle_alone(volatile __global ulong *visible, const View *view, int4 window, float4 a, float4 b, float4 c,
                                bool whole, uint id, int phase, int facing, __global const uint *after)
{
    const float4 p = to_screen(view, a), q = to_screen(view, b), r = to_screen(view, c);
    if (whole)
        draw_triangle(visible, view, window, snap((float4)(p.xyz, 0.0f) / p.w), snap((float4)(q.xyz, 0.0f) / q.w),
                      snap((float4)(r.xyz, 0.0f) / r.w), id, phase, facing, after);
    else
        for (int before = 0; before < (view->scale.z > 0.0f ? 2 : 1); ++before)
            draw_triangle_clipped(visible, view, window, p, q, r, id, phase, facing, after, before);
}

INLINED lanes_i least_of(lanes_i a, lanes_i b, lanes_i c)
{
    const lanes_i d = a < b ? a : b;
    return d < c ? d : c;
}

INLINED lanes_i most_of(lanes_i a, lanes_i b, lanes_i c)
{
    const lanes_i d = a > b ? a : b;
    return d > c ? d : c;
}

/* A triangle's edge from p to q: twice the area with the point (x, y), less its bias. */
INLINED lanes_i edges(Corners p, Corners q, lanes_i x, lanes_i y)
{
    const lanes_i ours = (q.y < p.y) | ((q.y == p.y) & (q.x > p.x));
    return (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x) + (ours ? I(0) : I(-1));
}

/* The depths of a triangle, from the middle of the first pixel that it may touch. */
typedef struct {
    ulong gx, gy, start;
    long nearest, farthest, z;
    size_t at;                             // that pixel's first sample
} Plane;

inline Plane plane_of(int4 a, int4 b, int4 c, int x0, int y0)
{
    Plane plane;
    const long db = b.z - a.z, dc = c.z - a.z;
    const int area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    plane.gx = gradient(db * (c.y - a.y) - dc * (b.y - a.y), area);
    plane.gy = gradient(dc * (b.x - a.x) - db * (c.x - a.x), area);
    plane.start = plane.gx * (ulong)(long)(x0 * SUBPIXEL + SUBPIXEL / 2 - a.x)
        + plane.gy * (ulong)(long)(y0 * SUBPIXEL + SUBPIXEL / 2 - a.y);
    const int near = a.z < b.z ? a.z : b.z, far = a.z < b.z ? b.z : a.z;
    plane.nearest = near < c.z ? near : c.z;
    plane.farthest = far > c.z ? far : c.z;
    plane.z = a.z;
    return plane;
}

#if LANES > 1
INLINED int4 corner(const Corners *of, int k)
{
    return (int4)(LANE_I(of->x, k), LANE_I(of->y, k), LANE_I(of->z, k), 0);
}

#define SMALL 32   // pixels across and down that a small triangle may touch: its edges then fit 32 bits
#define MANY 48    // samples that they may hit, on average, from which on they are drawn one by one

#if LANES == 8
#define TOGETHER 8
typedef int8 some_i;
typedef long8 some_l;
typedef ulong8 Keys;
#define bits_of_some bits_of_eight
#else
#define TOGETHER 16
typedef int16 some_i;
typedef long16 some_l;
typedef ulong16 Keys;
#define bits_of_some(mask) (bits_of_eight((mask).lo) | bits_of_eight((mask).hi) << 8)
#endif
typedef Keys KeysThere __attribute__((aligned(8)));

/* TOGETHER samples that lie side by side in memory: those of some pixels of a row, or some of one pixel. */
typedef struct {
    int pixels, turns;                     // how many pixels, or how many times as many samples one has
    some_i pixel, x, y;                    // of each: its pixel, and where it is from the middle of the first, in 1/SUBPIXEL
} Row;

INLINED Row row_of(const View *view, int turn)
{
    Row row;
    const int samples = view->size.z;
    row.pixels = samples < TOGETHER ? TOGETHER / samples : 1;
    row.turns = samples < TOGETHER ? 1 : samples / TOGETHER;
    for (int k = 0; k < TOGETHER; ++k) {
        const int2 offset = PATTERN[view->size.w + (turn * TOGETHER + k) % samples];
        LANE_I(row.pixel, k) = k / samples;
        LANE_I(row.x, k) = k / samples * SUBPIXEL + offset.x;
        LANE_I(row.y, k) = offset.y;
    }
    return row;
}

/* Twice the areas of an edge of a small triangle with samples of a row from the middle of a pixel on, less its bias. */
INLINED some_i edge_in_row(int4 p, int4 q, int x, int y, const Row *row)
{
    return (int)(edge(p, q, x, y) + edge_bias(p, q)) + (q.x - p.x) * row->y - (q.y - p.y) * row->x;
}

/* Draw a small triangle into pixels (x0, y0) to (x1, y1), samples of a row side by side, where no other work-item writes;
   turn: see `Row`. */
INLINED void draw_in_rows(volatile __global ulong *visible, const View *view, int4 window, int4 a, int4 b, int4 c, int x0,
                          int y0, int x1, int y1, const Row *row, int turn, uint id, int phase, int facing,
                          __global const uint *after)
{
    const int samples = view->size.z, step = row->pixels * SUBPIXEL;
    const int x_first = x0 * SUBPIXEL + SUBPIXEL / 2, y_first = y0 * SUBPIXEL + SUBPIXEL / 2;
    some_i row_c = edge_in_row(a, b, x_first, y_first, row), row_a = edge_in_row(b, c, x_first, y_first, row);
    some_i row_b = edge_in_row(c, a, x_first, y_first, row);
    Plane plane;
    some_l offsets;
    bool known = false;                    // what planes are: many triangles hit no sample
    for (int y = y0; y <= y1; ++y) {
        some_i ec = row_c, ea = row_a, eb = row_b;
        for (int x = x0; x <= x1; x += row->pixels) {
            const some_i in = ((ec | ea | eb) >= 0) & (row->pixel <= x1 - x);
            ec -= (b.y - a.y) * step;
            ea -= (c.y - b.y) * step;
            eb -= (a.y - c.y) * step;
            uint bits = bits_of_some(in);
            if (!bits)
                continue;
            if (!known) {
                plane = plane_of(a, b, c, x0, y0);
                offsets = __builtin_convertvector(row->x, some_l) * (long)plane.gx
                    + __builtin_convertvector(row->y, some_l) * (long)plane.gy;
                known = true;
            }
            const ulong d = plane.start + plane.gx * (ulong)(long)((x - x0) * SUBPIXEL)
                + plane.gy * (ulong)(long)((y - y0) * SUBPIXEL);
            const some_l depth = plane.z + ((offsets + (long)d) >> 14), most = depth < plane.farthest ? depth : plane.farthest;
            const some_l depths = most < plane.nearest ? plane.nearest : most;
            const size_t first = ((size_t)(y - view->rows.x) * view->size.x + (x - view->rows.z)) * samples + turn * TOGETHER;
            if (!facing && x + row->pixels <= window.y) {
                __global KeysThere *there = (__global KeysThere *)&visible[first];
                const Keys keys = __builtin_convertvector(depths, Keys) << 32 | id, before = *there;
                *there = (__builtin_convertvector(in, some_l) & (keys < before)) ? keys : before;
                continue;
            }
            for (; bits; bits &= bits - 1) {
                const int k = first_of(bits);
                if (!facing || (uint)LANE_L(depths, k) > after[first + k])
                    put(visible, first + k, (uint)LANE_L(depths, k), id, phase);
            }
        }
        row_c += (b.x - a.x) * SUBPIXEL;
        row_a += (c.x - b.x) * SUBPIXEL;
        row_b += (a.x - c.x) * SUBPIXEL;
    }
}

/* Small triangles, those of `there`, drawn as draw_triangle draws them; alone: whether no other work-item writes into the
   window. */
ONCE void draw_small(volatile __global ulong *visible, const View *view, int4 window, bool alone, lanes_i there, Corners a,
                     Corners b, Corners c, const uint *ids, int phase, int facing, __global const uint *after)
{
    const lanes_i turned = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x), swap = turned < 0;
    const Corners p = b, q = c;
    b.x = swap ? q.x : p.x, b.y = swap ? q.y : p.y, b.z = swap ? q.z : p.z;
    c.x = swap ? p.x : q.x, c.y = swap ? p.y : q.y, c.z = swap ? p.z : q.z;
    const int samples = view->size.z, furthest = SUBPIXEL / 2;
    lanes_i x0 = (least_of(a.x, b.x, c.x) - furthest) >> 8, y0 = (least_of(a.y, b.y, c.y) - furthest) >> 8;
    lanes_i x1 = (most_of(a.x, b.x, c.x) + furthest) >> 8, y1 = (most_of(a.y, b.y, c.y) + furthest) >> 8;
    x0 = x0 > window.x ? x0 : I(window.x);
    y0 = y0 > window.z ? y0 : I(window.z);
    x1 = x1 < window.y ? x1 : I(window.y - 1);
    y1 = y1 < window.w ? y1 : I(window.w - 1);
    there &= (x0 <= x1) & (y0 <= y1) & (turned != 0);
    if (facing)
        there &= swap;
    const lanes_i most = there ? (x1 - x0 + 1) * (y1 - y0 + 1) : I(0);
    uint left = bits_of(there);
    int sum = 0, number = 0;
    for (uint bits = left; bits; bits &= bits - 1, ++number)
        sum += LANE_I(most, first_of(bits));
    if (alone && sum * samples > MANY * number) {
        for (int turn = 0, turns = 1; turn < turns; ++turn) {
            const Row row = row_of(view, turn);
            turns = row.turns;
            for (uint bits = left; bits; bits &= bits - 1) {
                const int k = first_of(bits);
                draw_in_rows(visible, view, window, corner(&a, k), corner(&b, k), corner(&c, k), LANE_I(x0, k), LANE_I(y0, k),
                             LANE_I(x1, k), LANE_I(y1, k), &row, turn, BODY | ids[k], phase, facing, after);
            }
        }
        return;
    }
    if (!left)
        return;
    const int wide = most_lane(there ? x1 - x0 : I(0)), high = most_lane(there ? y1 - y0 : I(0));
    const lanes_i ec_x = (b.y - a.y) * SUBPIXEL, ea_x = (c.y - b.y) * SUBPIXEL, eb_x = (a.y - c.y) * SUBPIXEL;
    const lanes_i ec_y = (b.x - a.x) * SUBPIXEL, ea_y = (c.x - b.x) * SUBPIXEL, eb_y = (a.x - c.x) * SUBPIXEL;
    Plane planes[LANES];
    uint known = 0;                        // lanes of which there is one: many triangles hit no sample
    for (int s = 0; s < samples; ++s) {
        const int2 offset = PATTERN[view->size.w + s];
        const lanes_i sx = x0 * SUBPIXEL + (SUBPIXEL / 2 + offset.x), sy = y0 * SUBPIXEL + (SUBPIXEL / 2 + offset.y);
        lanes_i row_c = edges(a, b, sx, sy), row_a = edges(b, c, sx, sy), row_b = edges(c, a, sx, sy);
        for (int j = 0; j <= high; ++j) {
            const lanes_i in_row = there & (y0 + j <= y1);
            lanes_i ec = row_c, ea = row_a, eb = row_b;
            for (int i = 0; i <= wide; ++i) {
                const ulong across = (ulong)(long)(offset.x + i * SUBPIXEL), down = (ulong)(long)(offset.y + j * SUBPIXEL);
                const size_t from = ((size_t)j * view->size.x + i) * samples + s;
                for (uint bits = bits_of(in_row & ((ec | ea | eb) >= 0) & (x0 + i <= x1)); bits; bits &= bits - 1) {
                    const int k = first_of(bits);
                    if (!(known >> k & 1)) {
                        planes[k] = plane_of(corner(&a, k), corner(&b, k), corner(&c, k), LANE_I(x0, k), LANE_I(y0, k));
                        planes[k].at = ((size_t)(LANE_I(y0, k) - view->rows.x) * view->size.x
                                        + (LANE_I(x0, k) - view->rows.z)) * samples;
                        known |= 1u << k;
                    }
                    const Plane *plane = &planes[k];
                    const ulong d = plane->start + plane->gx * across + plane->gy * down;
                    const long here = plane->z + ((long)d >> 14);
                    const uint depth = (uint)(here < plane->nearest ? plane->nearest
                                              : here < plane->farthest ? here : plane->farthest);
                    const size_t sample = plane->at + from;
                    if (!facing || depth > after[sample])
                        put(visible, sample, depth, BODY | ids[k], phase);
                }
                ec -= ec_x;
                ea -= ea_x;
                eb -= eb_x;
            }
            row_c += ec_y;
            row_a += ea_y;
            row_b += eb_y;
        }
    }
}
#endif
