/*
 * What hair and body let through of a light, and what hair sends on: as light.h and scatter.h have it, LANES places side by
 * side.  strand_light.cl uses this, and lanes.h and light.h before it.
 */
/* 1 / sqrt(x) for x > 0 to the last bit or two (Newton's method): no division, and no call. */
INLINED lanes inverse_root(lanes x)
{
    const lanes half_x = 0.5f * x;
    lanes y = AS_F(U(0x5F375A86u) - (AS_U(x) >> 1));
    y *= 1.5f - half_x * y * y;
    y *= 1.5f - half_x * y * y;
    y *= 1.5f - half_x * y * y;
    return y;
}

/* sqrt(1 - c²), 0 where rounding has left |c| above 1. */
INLINED lanes sine_of(lanes c)
{
    const lanes square = 1.0f - c * c;
    return square > 1e-30f ? square * inverse_root(greater(square, F(1e-30f))) : F(0.0f);
}

/* The whole number below, for |x| < 2^22. */
INLINED lanes whole_below(lanes x)
{
    const lanes near = nearest(x);
    return near - (near > x ? F(1.0f) : F(0.0f));
}

/* A row of (p, 1) times a matrix: which of x, y, z, w. */
#define ROW_OF(matrix, row, p) (((matrix)[0].row * (p).x + (matrix)[1].row * (p).y) + (matrix)[2].row * (p).z + (matrix)[3].row)

/* As through_hair; width: of the strand that p lies on, depth: its type's optical depth. */
INLINED lanes through_hairs(const Obstacles *obstacles, lanes3 p, lanes width, lanes depth)
{
    const Grid *grid = &obstacles->grid;
    const float4 hair = obstacles->shadow.hair;
    const int nx = grid->size.x, ny = grid->size.y, layer = nx * ny;
    const lanes w = ROW_OF(grid->to_grid, w, p), over = 1.0f / w;
    const lanes x = ROW_OF(grid->to_grid, x, p) * over - 0.5f, y = ROW_OF(grid->to_grid, y, p) * over - 0.5f;
    const lanes z = within(ROW_OF(grid->to_grid, z, p), 0.0f, (float)grid->size.z);
    const lanes_i in = (w > 0.0f) & (x > -1.0f) & (y > -1.0f) & (x < (float)nx) & (y < (float)ny);
    if (!any_lane(in))
        return F(1.0f);
    const lanes low_x = whole_below(in ? x : F(0.0f)), low_y = whole_below(in ? y : F(0.0f));
    const lanes low_z = lesser(whole_below(in ? z : F(0.0f)), F(grid->size.z - 1.0f));
    const lanes fx = x - low_x, fy = y - low_y, fz = z - low_z;
    const lanes_i x0 = TO(lanes_i, low_x), y0 = TO(lanes_i, low_y), z0 = TO(lanes_i, low_z);
    /* Columns outside the grid hold nothing: their weight is 0, and another's place is read. */
    const lanes left = low_x >= 0.0f ? 1.0f - fx : F(0.0f), right = low_x + 1.0f < (float)nx ? fx : F(0.0f);
    const lanes front = low_y >= 0.0f ? 1.0f - fy : F(0.0f), back = low_y + 1.0f < (float)ny ? fy : F(0.0f);
    const lanes_i xa = x0 > 0 ? x0 : I(0), xb = x0 + 1 < nx ? x0 + 1 : I(nx - 1);
    const lanes_i ya = y0 > 0 ? y0 : I(0), yb = y0 + 1 < ny ? y0 + 1 : I(ny - 1);
    const lanes_i first = z0 * layer + ya * nx, second = z0 * layer + yb * nx;
    lanes_i at[4] = {first + xa, first + xb, second + xa, second + xb};
    const lanes weights[4] = {left * front, right * front, left * back, right * back};
    lanes crossings[4];
    for (int c = 0; c < 4; ++c) {
        lanes before, behind;
        for (int k = 0; k < LANES; ++k) {
            __global const float *cell = obstacles->crossings + LANE_I(at[c], k);
            LANE(before, k) = cell[0];
            LANE(behind, k) = cell[layer];
        }
        crossings[c] = weights[c] * (before + fz * (behind - before));
    }
    const lanes all = (crossings[0] + crossings[1]) + (crossings[2] + crossings[3]);
    const lanes share = depth / hair.x, own = hair.y * width * share * over + hair.z * share;
    const lanes exponent = -1.44269504f * hair.x * greater(all - own, F(0.0f));
    return in ? exp2_of(greater(exponent, F(-100.0f))) : F(1.0f);
}

/* As past_body; n: of the body at the strands' roots. */
INLINED lanes past_bodies(const Obstacles *obstacles, lanes3 p, lanes3 n, float steepest, float bias)
{
    const View *view = &obstacles->view;
    const int radius = obstacles->shadow.body.y, across = view->size.x, down = view->size.y;
    const lanes w = ROW_OF(view->to_screen, w, p);
    const lanes x = within(ROW_OF(view->to_screen, x, p) / w, -1e6f, 1e6f);
    const lanes y = within(ROW_OF(view->to_screen, y, p) / w, -1e6f, 1e6f), e = ROW_OF(view->to_screen, z, p) / w;
    /* Projection takes the plane (n, -n·p) to a plane of (x, y, e): a x + b y + c e + d = 0. */
    const lanes d = -dots(n, p);
    lanes along[3];
    for (int k = 0; k < 3; ++k) {
        const float4 column = view->to_world[k];
        along[k] = (n.x * column.x + n.y * column.y) + (n.z * column.z + d * column.w);
    }
    const lanes texel = view->eye.w > 0.0f ? e / view->scale.x : F(1.0f / across);
    const lanes limit = steepest * texel, flat = along[2] != 0.0f ? -1.0f / along[2] : F(0.0f);
    const lanes dx = lesser(greater(along[0] * flat, -limit), limit), dy = lesser(greater(along[1] * flat, -limit), limit);
    const lanes low_x = whole_below(x), low_y = whole_below(y);
    const lanes nearest_e = e + bias * texel + dx * (low_x + 0.5f - x) + dy * (low_y + 0.5f - y);
    /* In depth steps; of what lies before all or behind all there is only the sign counts. */
    const lanes steps = within(nearest_e, -1.9f, 1.9f) * (float)DEPTH_ONE;
    const lanes_l plane = TO(lanes_l, TO(lanes_i, steps)), x_step = TO(lanes_l, TO(lanes_i, within(dx, -1.9f, 1.9f) * (float)DEPTH_ONE)),
                  y_step = TO(lanes_l, TO(lanes_i, within(dy, -1.9f, 1.9f) * (float)DEPTH_ONE));
    const lanes_i x0 = TO(lanes_i, low_x), y0 = TO(lanes_i, low_y);
    lanes_i dark = I(0);
    for (int j = -radius; j <= radius; ++j)
        for (int i = -radius; i <= radius; ++i) {
            const lanes_i column = x0 + i, row = y0 + j;
            const lanes_i in = (column >= 0) & (row >= 0) & (column < across) & (row < down);
            lanes_i at = in ? row * across + column : I(0), seen;
            for (int k = 0; k < LANES; ++k)
                LANE_I(seen, k) = (int)(obstacles->shadow_map[LANE_I(at, k)] >> 32);   // -1 where nothing is
            const lanes_i nearer = TO(lanes_i, TO(lanes_l, seen) + plane + (long)i * x_step + (long)j * y_step < (long)DEPTH_ONE);
            dark += in & (seen >= 0) & nearer ? I(1) : I(0);
        }
    const lanes share = 1.0f - TO(lanes, dark) / (float)((2 * radius + 1) * (2 * radius + 1));
    return w > 0.0f ? share : F(1.0f);
}

/* As transmittance_at: share of a light's direct light that body and other hair let through to places p of strands whose
   roots' normals are n, with this width and alpha. */
INLINED lanes transmittances_at(const Obstacles *obstacles, lanes3 p, lanes3 n, lanes width, lanes alpha)
{
    const Shadow *shadow = &obstacles->shadow;
    lanes share = F(1.0f);
    if (shadow->body.x)
        share = past_bodies(obstacles, p, n, HAIR_STEEPEST, HAIR_BIAS(shadow->body.y));
    if (shadow->hair.x > 0.0f && any_lane(share > 0.0f)) {
        /* Of this type a crossing counts only so much of what one of the darkest does. */
        lanes depth = 1.0f - alpha;
        if (!(shadow->hair.w > 0.0f))
            depth = -0.69314718f * log2_of(greater(alpha, F(1e-6f)));
        share *= through_hairs(obstacles, p, width, depth);
    }
    return share;
}
