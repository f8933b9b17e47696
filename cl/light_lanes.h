/*
 * What light.h has for one place, for LANES of them side by side: shade.cl and strand_light.cl use this, and that before it.
 * The same operations in the same order, but for powers: those are here of + - * / alone, so that they are the same bits for
 * any LANES.
 */
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

/* See `through_hair`; own_x and own_y are its self_shadow. */
INLINED lanes through_hair_lanes(const Obstacles *obstacles, lanes own_x, lanes own_y, lanes3 p)
{
    const Grid *grid = &obstacles->grid;
    const int nx = grid->size.x, ny = grid->size.y, nz = grid->size.z;
    const lanes4 c = by_columns(grid->to_grid, p.x, p.y, p.z);
    const lanes gx = c.x / c.w - 0.5f, gy = c.y / c.w - 0.5f, gz = within(c.z, 0.0f, (float)nz);
    const lanes_i in = (c.w > 0.0f) & (gx > -1.0f) & (gy > -1.0f) & (gx < (float)nx) & (gy < (float)ny);
    const lanes x = in ? gx : F(0.0f), y = in ? gy : F(0.0f), z = in ? gz : F(0.0f);
    const lanes x0 = whole_below(x), y0 = whole_below(y), z0 = lesser(whole_below(z), F(nz - 1.0f));
    const lanes fx = x - x0, fy = y - y0, fz = z - z0;
    const lanes left = x0 >= 0.0f ? 1.0f - fx : F(0.0f), right = x0 + 1.0f < (float)nx ? fx : F(0.0f);
    const lanes front = y0 >= 0.0f ? 1.0f - fy : F(0.0f), back = y0 + 1.0f < (float)ny ? fy : F(0.0f);
    const lanes xa = greater(x0, F(0.0f)), xb = lesser(x0 + 1.0f, F(nx - 1.0f));
    const lanes ya = greater(y0, F(0.0f)), yb = lesser(y0 + 1.0f, F(ny - 1.0f));
    lanes before[4], behind[4];
    const lanes_i layer = TO(lanes_i, z0) * (nx * ny), from = layer + TO(lanes_i, ya) * nx, until = layer + TO(lanes_i, yb) * nx;
    const lanes_i left_of = TO(lanes_i, xa), right_of = TO(lanes_i, xb);
    const lanes_i corners[4] = {from + left_of, from + right_of, until + left_of, until + right_of};
    __global const float *far = obstacles->crossings + nx * ny;
    for (int k = 0; k < LANES; ++k)
        for (int i = 0; i < 4; ++i) {
            LANE(before[i], k) = obstacles->crossings[LANE_I(corners[i], k)];
            LANE(behind[i], k) = far[LANE_I(corners[i], k)];
        }
    const lanes a = left * front * (before[0] + fz * (behind[0] - before[0]));
    const lanes b = right * front * (before[1] + fz * (behind[1] - before[1]));
    const lanes d = left * back * (before[2] + fz * (behind[2] - before[2]));
    const lanes e = right * back * (before[3] + fz * (behind[3] - before[3]));
    const lanes crossings = greater((a + b) + (d + e) - own_x / c.w - own_y, F(0.0f));
    return in ? exp2_of(greater(-1.44269504f * obstacles->shadow.hair.x * crossings, F(-100.0f))) : F(1.0f);
}

#if LANES > 1
typedef ulong4 Four __attribute__((aligned(8)));   // texels one after the other

/* See `dark_texels`, of nine texels with another one behind each three: so many before planes at `plane` in the middle, as deep
   as the map has it. */
INLINED int dark_of_nine(__global const ulong *middle, int width, long plane, long x_step, long y_step)
{
    const long4 most = (long4)(DEPTH_ONE + 1, DEPTH_ONE + 1, DEPTH_ONE + 1, 0);
    const long4 row = (long4)(plane + x_step, plane, plane - x_step, 0);
    long4 sum = 0;
    #pragma unroll
    for (int j = -1; j <= 1; ++j) {
        const long4 seen = as_long4(*(__global const Four *)(middle + j * width - 1) >> 32), end = row - j * y_step;
        sum += seen < (end < most ? end : most);
    }
    return -(int)((sum.x + sum.y) + sum.z);
}
#endif

/* See `past_body`; n: the normals, of any length; away: whether the surface that is lit looks away from the middle of a disc. */
INLINED lanes past_body_lanes(const Obstacles *obstacles, lanes_i on, lanes3 p, lanes3 n, lanes_i away, float steepest, float bias)
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
        const lanes_i nine = in & (x0 >= 1.0f) & (y0 >= 1.0f) & (x0 < width - 2.0f) & (y0 < height - 1.0f);
        const lanes_i at = TO(lanes_i, nine ? y0 : F(1.0f)) * width + TO(lanes_i, nine ? x0 : F(1.0f));
        const lanes_l planes = (long)DEPTH_ONE - TO(lanes_l, nearest_seen * (float)DEPTH_ONE);
        const lanes_l xs = TO(lanes_l, dx * (float)DEPTH_ONE), ys = TO(lanes_l, dy * (float)DEPTH_ONE);
        lanes_i count;
        for (int k = 0; k < LANES; ++k)
            LANE_I(count, k) = dark_of_nine(obstacles->shadow_map + LANE_I(at, k), width, LANE_L(planes, k), LANE_L(xs, k),
                                            LANE_L(ys, k));
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
