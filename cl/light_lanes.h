/*
 * What light.h has for one place, for LANES of them side by side: shade.cl and strand_light.cl use this, and that before it.
 * The same operations in the same order, but for powers: those are here of + - * / alone, so that they are the same bits for
 * any LANES.
 */

#if LANES > 1 && defined(__clang__)
#define ONE_BY_ONE _Pragma("clang loop vectorize(disable)")   // PoCL would look things up with gathers, which are slower
#else
#define ONE_BY_ONE
#endif

/* Numbers of each lane, four in a row: where every lane looks its own up, a row is put down at once, not number by number. */
#if LANES == 1
typedef struct {
    float4 of[LANES];
} LaneRows;
#else
typedef struct {
    float4 of[LANES];
} __attribute__((aligned(64))) LaneRows;

/* Eight rows, two in each vector, as columns. */
INLINED void turn_eight(const float8 *rows, float8 *x, float8 *y, float8 *z, float8 *w)
{
    const float8 a = rows[0], b = rows[1], c = rows[2], d = rows[3];
    const float8 ab = (float8)(a.s0, a.s4, b.s0, b.s4, a.s1, a.s5, b.s1, b.s5);
    const float8 cd = (float8)(c.s0, c.s4, d.s0, d.s4, c.s1, c.s5, d.s1, d.s5);
    const float8 other_ab = (float8)(a.s2, a.s6, b.s2, b.s6, a.s3, a.s7, b.s3, b.s7);
    const float8 other_cd = (float8)(c.s2, c.s6, d.s2, d.s6, c.s3, c.s7, d.s3, d.s7);
    *x = (float8)(ab.lo, cd.lo);
    *y = (float8)(ab.hi, cd.hi);
    *z = (float8)(other_ab.lo, other_cd.lo);
    *w = (float8)(other_ab.hi, other_cd.hi);
}
#endif

/* Rows as vectors. */
INLINED lanes4 four_of(const LaneRows *rows)
{
#if LANES == 1
    const lanes4 columns = {rows->of[0].x, rows->of[0].y, rows->of[0].z, rows->of[0].w};
#else
    lanes4 columns;
    float8 x[LANES / 8], y[LANES / 8], z[LANES / 8], w[LANES / 8];
    #pragma unroll
    for (int k = 0; k < LANES / 8; ++k)
        turn_eight((const float8 *)rows->of + 4 * k, &x[k], &y[k], &z[k], &w[k]);
#if LANES == 8
    columns.x = x[0], columns.y = y[0], columns.z = z[0], columns.w = w[0];
#elif LANES == 16
    columns.x = (lanes)(x[0], x[1]), columns.y = (lanes)(y[0], y[1]);
    columns.z = (lanes)(z[0], z[1]), columns.w = (lanes)(w[0], w[1]);
#else
    columns.x = (lanes)(x[0], x[1], x[2], x[3]), columns.y = (lanes)(y[0], y[1], y[2], y[3]);
    columns.z = (lanes)(z[0], z[1], z[2], z[3]), columns.w = (lanes)(w[0], w[1], w[2], w[3]);
#endif
#endif
    return columns;
}

/* The first three of each row. */
INLINED lanes3 three_of(const LaneRows *rows)
{
    const lanes4 columns = four_of(rows);
    const lanes3 three = {columns.x, columns.y, columns.z};
    return three;
}

INLINED lanes3 unit_lanes_or(lanes3 v, lanes3 otherwise)
{
    const lanes square = dots(v, v), length = full_root(greater(square, F(1e-30f)));
    const lanes_i some = square > 1e-30f;
    v.x = some ? v.x / length : otherwise.x;
    v.y = some ? v.y / length : otherwise.y;
    v.z = some ? v.z / length : otherwise.z;
    return v;
}

INLINED lanes3 towards_eye_lanes(const View *view, lanes3 p)
{
    const float4 eye = view->eye;
    const lanes3 v = {eye.x - eye.w * p.x, eye.y - eye.w * p.y, eye.z - eye.w * p.z}, aside = {F(0.0f), F(0.0f), F(1.0f)};
    return unit_lanes_or(v, aside);
}

/* Share of a light's direct light at p, none outside of a spot's cone; l: unit, towards it. */
INLINED lanes share_of_light(const Light *light, lanes3 p, lanes3 *l)
{
    *l = all_lanes(-light->direction);
    if (!(light->position.w > 0.0f))
        return F(1.0f);
    const lanes3 way = {light->position.x - p.x, light->position.y - p.y, light->position.z - p.z};
    *l = unit_lanes_or(way, *l);
    return -dots(*l, all_lanes(light->direction)) >= light->cone.x ? F(1.0f) : F(0.0f);
}

/* Tangent of half the angle that a light's disc has at p, 0: it is none. */
INLINED lanes disc_at(const Light *light, lanes3 p)
{
    if (!(light->cone.y > 0.0f) || !(light->position.w > 0.0f))
        return F(light->cone.y);
    const lanes3 way = {light->position.x - p.x, light->position.y - p.y, light->position.z - p.z};
    return light->cone.y / full_root(greater(dots(way, way), F(1e-30f)));
}

/* Mean over a disc of the cosines of its directions with a normal, 0 where these come from behind it or behind the face there:
   of its middle, the cosines are these two.  disc: see `disc_at`.  The horizon cuts the disc along a straight line; what of it
   is more than u aside counts by u (0.42 ... is the series of the disc's own mean of that, its slope the area). */
INLINED lanes clipped_cosine(lanes cosine, lanes of_face, lanes disc)
{
    const lanes slant = 2.0f / (1.0f + full_root(1.0f + disc * disc)), wide = disc * full_root(greater(1.0f - cosine * cosine, F(0.0f)));
    const lanes inverse = 1.0f / greater(wide, F(1e-6f)), at = cosine * inverse, q = lesser(at, of_face * inverse), x = q * q;
    const lanes mean = 0.5f * (q + (0.4244132f + x * (0.6366198f + x * (-0.0530516f - x * 0.0079814f))));
    const lanes area = 0.5f + q * (0.6366198f + x * (-0.1061032f - x * 0.0239442f));
    return slant * (q >= 1.0f ? cosine : q > -1.0f ? wide * (mean + (at - q) * area) : F(0.0f));
}

/* Of a light on a surface, the side of whose face that its normal n shows: the cosine, or its mean over the light's disc. */
INLINED lanes cosine_to(const Light *light, lanes3 p, lanes3 n, lanes of_face, lanes3 l)
{
    const lanes cosine = dots(n, l);
    return light->cone.y > 0.0f ? clipped_cosine(cosine, of_face, disc_at(light, p)) : greater(cosine, F(0.0f));
}

typedef float2 Pair __attribute__((aligned(4)));   // two numbers one after the other

/* Two numbers and two others, number by number where Oclgrind may run it. */
INLINED float4 pairs(__global const float *a, __global const float *b)
{
#if LANES == 1
    return (float4)(a[0], a[1], b[0], b[1]);
#else
    return (float4)(*(__global const Pair *)a, *(__global const Pair *)b);
#endif
}

/* See `through_hair`; own_x and own_y are its self_shadow. */
ONCE lanes through_hair_lanes(const Obstacles *obstacles, lanes own_x, lanes own_y, lanes3 p)
{
    const Grid *grid = &obstacles->grid;
    const int nx = grid->size.x, ny = grid->size.y, nz = grid->size.z;
    const lanes4 c = by_columns(grid->to_grid, p.x, p.y, p.z);
    const lanes gx = c.x / c.w - 0.5f, gy = c.y / c.w - 0.5f, gz = within(c.z, 0.0f, (float)nz);
    const lanes_i in = (c.w > 0.0f) & (gx > -1.0f) & (gy > -1.0f) & (gx < (float)nx) & (gy < (float)ny);
    const lanes x = in ? gx : F(0.0f), y = in ? gy : F(0.0f), z = in ? gz : F(0.0f);
    const lanes x0 = whole_below(x), y0 = whole_below(y), z0 = lesser(whole_below(z), F(nz - 1.0f));
    const lanes fx = x - x0, fy = y - y0, fz = z - z0;
    /* Columns outside hold nothing: two inside are read, and the one that is not asked for counts 0. */
    const lanes xa = within(x0, 0.0f, nx - 2.0f), ya = greater(y0, F(0.0f)), yb = lesser(y0 + 1.0f, F(ny - 1.0f));
    const lanes left = x0 == xa ? 1.0f - fx : x0 < xa ? fx : F(0.0f), right = x0 == xa ? fx : x0 < xa ? F(0.0f) : 1.0f - fx;
    const lanes front = y0 >= 0.0f ? 1.0f - fy : F(0.0f), back = y0 + 1.0f < (float)ny ? fy : F(0.0f);
    const lanes_i column = TO(lanes_i, z0) * (nx * ny) + TO(lanes_i, xa);
    const lanes_i fore = column + TO(lanes_i, ya) * nx, rear = column + TO(lanes_i, yb) * nx;
    __global const float *near = obstacles->crossings, *far = near + nx * ny;
    LaneRows before, behind;
    for (int k = 0; k < LANES; ++k) {
        const int m = LANE_I(fore, k), n = LANE_I(rear, k);
        before.of[k] = pairs(near + m, near + n);
        behind.of[k] = pairs(far + m, far + n);
    }
    const lanes4 first = four_of(&before), last = four_of(&behind);
    const lanes a = left * front * (first.x + fz * (last.x - first.x));
    const lanes b = right * front * (first.y + fz * (last.y - first.y));
    const lanes d = left * back * (first.z + fz * (last.z - first.z));
    const lanes e = right * back * (first.w + fz * (last.w - first.w));
    const lanes crossings = greater((a + b) + (d + e) - own_x / c.w - own_y, F(0.0f));
    return in ? exp2_of(greater(-1.44269504f * obstacles->shadow.hair.x * crossings, F(-100.0f))) : F(1.0f);
}

typedef ulong4 Four __attribute__((aligned(8)));   // texels one after the other

#if LANES > 1
/* What of a map hides a plane as deep as `depth`: depths below this, 0 where none may be. */
INLINED lanes_u hides_below(lanes_i depth)
{
    const lanes_i none = I(0), most = I((int)DEPTH_ONE + 1), end = depth < most ? depth : most;
    return AS_U(end > none ? end : none);
}

/* Nine texels around texels `middle`: are all before planes at `plane` there (9), none (0), or some (-1, or it is not known)?
   As its blocks' ranges tell.  x0, y0: the texels. */
INLINED lanes_i dark_of_block(const Obstacles *obstacles, lanes x0, lanes y0, lanes_i plane, lanes_i x_step, lanes_i y_step)
{
    const float part = 1.0f / block_side(obstacles->view.size.xy);
    const lanes_i block = TO(lanes_i, (y0 + 0.5f) * part) * BLOCKS + TO(lanes_i, (x0 + 0.5f) * part);
    const lanes_i steep = (x_step > 0 ? x_step : -x_step) + (y_step > 0 ? y_step : -y_step);
    lanes_u range;
    ONE_BY_ONE
    for (int k = 0; k < LANES; ++k)
        LANE_U(range, k) = obstacles->ranges[LANE_I(block, k)];
    const lanes_u nearest = (range & 0xFFFFu) << RANGE_BITS, furthest = (range >> 16 << RANGE_BITS) + ((1u << RANGE_BITS) - 1);
    return furthest < hides_below(plane - steep) ? I(9) : nearest >= hides_below(plane + steep) ? I(0) : I(-1);
}

/* See `dark_texels`, of nine texels with another one behind each three, around texels `middle`: so many before planes at
   `plane` there. */
INLINED lanes_i dark_of_nine(__global const ulong *map, lanes_i on, lanes_i middle, int width, lanes_i plane, lanes_i x_step,
                             lanes_i y_step)
{
    LaneRows rows[3];
    lanes_i dark = I(0);
    for (uint bits = bits_of(on); bits; bits &= bits - 1) {
        const int k = first_of(bits);
        __global const ulong *first = map + LANE_I(middle, k) - 1;
        #pragma unroll
        for (int j = 0; j < 3; ++j)
            rows[j].of[k] = as_float4(as_uint8(*(__global const Four *)(first + (j - 1) * width)).odd);
    }
    #pragma unroll
    for (int j = 0; j < 3; ++j) {
        const lanes4 seen = four_of(&rows[j]);
        const lanes_i end = plane - (j - 1) * y_step;
        const lanes_i ends[3] = {end + x_step, end, end - x_step};
        const lanes texels[3] = {seen.x, seen.y, seen.z};
        #pragma unroll
        for (int i = 0; i < 3; ++i)
            dark += AS_U(texels[i]) < hides_below(ends[i]);
    }
    return -dark;
}
#endif

/* See `past_body`; n: the normals, of any length; away: whether the surface that is lit looks away from the middle of a disc. */
ONCE lanes past_body_lanes(const Obstacles *obstacles, lanes_i on, lanes3 p, lanes3 n, lanes_i away, float steepest, float bias)
{
    const View *view = &obstacles->view;
    const int radius = obstacles->shadow.body.y;
    const lanes4 c = by_columns(view->to_screen, p.x, p.y, p.z);
    const lanes x = c.x / c.w, y = c.y / c.w, e = c.z / c.w, w = -dots(n, p);
    const float4 ex = view->to_world[0], ey = view->to_world[1], ez = view->to_world[2];
    const lanes along_e = n.x * ez.x + n.y * ez.y + n.z * ez.z + w * ez.w;
    const lanes texel = view->eye.w > 0.0f ? e / view->scale.x : F(1.0f / view->size.x);
    const lanes limit = steepest * texel, flat = along_e != 0.0f ? -1.0f / along_e : F(0.0f);
    const lanes dx = greater(lesser((n.x * ex.x + n.y * ex.y + n.z * ex.z + w * ex.w) * flat, limit), -limit);
    const lanes dy = greater(lesser((n.x * ey.x + n.y * ey.y + n.z * ey.z + w * ey.w) * flat, limit), -limit);
    /* What is beside the map is hidden by what is within the filter's reach, or within a disc's. */
    const lanes room = greater(F((float)radius), obstacles->shadow.disc.x * (1.0f - e));
    const lanes_i in = on & (c.w > 0.0f) & (x > -1.0f - room) & (y > -1.0f - room)
        & (x < (float)view->size.x + room) & (y < (float)view->size.y + room);
    const lanes x0 = whole_below(x), y0 = whole_below(y);
    const lanes nearest_seen = e + bias * texel + dx * (x0 + 0.5f - x) + dy * (y0 + 0.5f - y);
    lanes dark = F(0.0f);
    const bool disc = obstacles->shadow.disc.x > 0.0f;
    lanes_i left = in;
#if LANES > 1
    const int width = view->size.x, height = view->size.y;
    if (radius == 1 && !disc && width > 3 && height > 2) {
        /* And near enough to the map for 32 bits. */
        const lanes_i nine = in & (x0 >= 1.0f) & (y0 >= 1.0f) & (x0 < width - 2.0f) & (y0 < height - 1.0f)
            & (positive(dx) + positive(dy) < 0.5f) & (positive(nearest_seen) < 1.0f);
        const lanes xn = nine ? x0 : F(1.0f), yn = nine ? y0 : F(1.0f);
        const lanes_i plane = (int)DEPTH_ONE - TO(lanes_i, nine ? nearest_seen * (float)DEPTH_ONE : F(0.0f));
        const lanes_i x_step = TO(lanes_i, nine ? dx * (float)DEPTH_ONE : F(0.0f));
        const lanes_i y_step = TO(lanes_i, nine ? dy * (float)DEPTH_ONE : F(0.0f));
        lanes_i count = I(-1);
        if (obstacles->ranges)
            count = dark_of_block(obstacles, xn, yn, plane, x_step, y_step);
        const lanes_i some = nine & (count < 0);
        if (any_lane(some)) {
            const lanes_i at = TO(lanes_i, yn) * width + TO(lanes_i, xn);
            const lanes_i found = dark_of_nine(obstacles->shadow_map, some, at, width, plane, x_step, y_step);
            count = some ? found : count;
        }
        dark = nine ? TO(lanes, count) : dark;
        left = in & (nine == 0);
    }
#endif
    for (int k = 0; any_lane(left) && k < LANES; ++k)
        if (LANE_I(left, k))
            LANE(dark, k) = disc
                ? texels_hidden(obstacles, LANE(x, k), LANE(y, k), LANE(e, k), LANE(dx, k), LANE(dy, k), bias * LANE(texel, k),
                               LANE_I(away, k) != 0)
                : dark_texels(obstacles, (int)LANE(x0, k), (int)LANE(y0, k), LANE(nearest_seen, k), LANE(dx, k), LANE(dy, k));
    return 1.0f - dark / (float)((2 * radius + 1) * (2 * radius + 1));
}

/* Share of a light that body and other hair let through to places p of strands; n: the body's normals at their roots, width
   and alpha: of the strands. */
ONCE lanes transmittances_at(const Obstacles *obstacles, lanes_i on, lanes3 p, lanes3 n, lanes width, lanes alpha)
{
    const Shadow *shadow = &obstacles->shadow;
    lanes share = on ? F(1.0f) : F(0.0f);
    if (shadow->body.x)
        share *= past_body_lanes(obstacles, on, p, n, I(0), HAIR_STEEPEST, HAIR_BIAS(shadow->body.y));
    if (shadow->hair.x > 0.0f && any_lane(share > 0.0f)) {
        /* Of this type a crossing counts only so much of what one of the darkest does. */
        const lanes depth = shadow->hair.w > 0.0f ? 1.0f - alpha : -0.69314718f * log2_of(greater(alpha, F(1e-6f)));
        const lanes of_one = depth / shadow->hair.x;
        share *= through_hair_lanes(obstacles, shadow->hair.y * width * of_one, shadow->hair.z * of_one, p);
    }
    return share;
}

/* See `tangent_of`. */
INLINED lanes3 tangent_of_lanes(lanes3 chord, lanes3 along)
{
    const lanes3 up = {F(0.0f), F(1.0f), F(0.0f)};
    return unit_lanes_or(chosen(dots(chord, chord) > 1e-30f, chord, along), up);
}

#define CELLS 2.0f           // cells of a light's grid that a segment may cross with transmittances known at its ends alone

/* How many cells of a light's grid segments cross, from p to p + step. */
INLINED lanes cells_crossed(const Obstacles *obstacles, lanes3 p, lanes3 step)
{
    const Grid *grid = &obstacles->grid;
    if (obstacles->shadow.hair.x == 0.0f)
        return F(0.0f);
    const lanes3 q = plus(p, step);
    const lanes4 a = by_columns(grid->to_grid, p.x, p.y, p.z), b = by_columns(grid->to_grid, q.x, q.y, q.z);
    const lanes_i before = (a.w > 0.0f) & (b.w > 0.0f);
    const lanes x = a.x / a.w - b.x / b.w, y = a.y / a.w - b.y / b.w, z = a.z - b.z;
    return before ? greater(greater(positive(x), positive(y)), positive(z)) : F(1e9f);
}
