/*
 * Rays through shell fur.
 *
 * The space between the skin and the tips is divided into prisms over the faces, in `slabs` one above the other, each of
 * three tetrahedra, so that a place in the fur is linear along a ray in each of them.  A ray walks from one to the next
 * (Maria, Horna and Aveneau, "Efficient ray traversal of constrained Delaunay tetrahedralization", 2017) and takes a
 * step wherever it has passed one more layer, or as much sideways: there it meets hair or not.  Corners of a face are
 * taken in the order of their numbers, so that neighbours divide the side between them alike.
 */
#if LANES == 1 && LANES_HINTED > 1
#undef LANES
#undef BLOCK_X
#undef BLOCK_Y
#define LANES LANES_HINTED
#define BLOCK_X 4
#define BLOCK_Y (LANES / BLOCK_X)
#endif
#include "lanes.h"
#include "seen.h"
#include "scatter.h"
#include "light.h"
#include "sky.h"
#include "pattern.h"
#include "cover.h"
#include "shell_light.h"
#include "tetrahedra.h"

#define SIDEWAYS 8.0f    // steps on the way across one x or y, down to one where hairs are seen on average
#define PIXEL 8.0f       // steps across a pixel, where hairs are not filtered, if that is fewer
#define SHARP 0.85f     // of a pixel's width counts as footprint: least error against 8 x 8 samples (tools/shells_laws.py)
#define FAR_FROM 0.3f   // pixels that are so many sides of a cell wide begin to see hairs on average,
#define FAR_TO 0.9f     // and those of so many see nothing else: no cell is looked for there, steps are a pixel long
#define MOST_TETRAHEDRA 20000    // on one way, on average: no scene that is any good has so many

inline uint depth_of(const View *view, float4 p)
{
    const float4 q = to_screen(view, p);
    return DEPTH_ONE - (uint)clamp(q.z / q.w * (float)DEPTH_ONE, 0.0f, (float)DEPTH_ONE);
}

/* From the eye to what samples see, as seen_point. */
INLINED lanes3 from_eye(const View *view, float4 eye, lanes x, lanes y, lanes e)
{
    const float4 a = view->to_world[0], b = view->to_world[1], c = view->to_world[2], d = view->to_world[3];
    const lanes w = 1.0f / (a.w * x + b.w * y + c.w * e + d.w);
    const lanes3 p = {(a.x * x + b.x * y + c.x * e + d.x) * w - eye.x, (a.y * x + b.y * y + c.y * e + d.y) * w - eye.y,
                      (a.z * x + b.z * y + c.z * e + d.z) * w - eye.z};
    return p;
}

/* One work-item takes the samples of LANES pixels through the fur, from where they enter it to where they leave it, meet
   what is drawn, or see no further; and adds their light to the picture. */
BY_HAND __kernel void march(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const Shells shells,
    __global const ulong *visible,         // [rows, width, samples] what else is drawn
    __global const ulong *entries,         // [rows, width, samples] where they enter: depth << 32 | BODY | border triangle
    __global const uint4 *border,          // [B] face; 4 · (3 · slab + tetrahedron) + corner left out; -; -
    __global const uint4 *faces,           // [F] corners in the order of their numbers
    __global const int4 *neighbours,       // [F] face << SIDE_BITS | its side, across each side; -1: none
    __global const float4 *curves,         // [V, slabs + 1]
    __global const float4 *normals,        // [V]
    __global const float4 *lattice,        // [F, CORNERS]
    __global const float2 *noise,
    __global const float2 *means,          // [HEIGHTS]
    const int n_lights,
    __global const Light *lights,          // see light.h
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const Sky sky,                         // see sky.h
    __global const float4 *sky_cells,      // [n, n, n, HARMONICS] r, g, b, if there is one
    __global uint *after,                  // [rows, width, samples] depth where they came in last; NOTHING: they are done
    __global float *shell_transmittance,   // [rows, width, samples] share of light that comes from behind
    __global ulong *shell_front,           // [rows, width, samples] depth << 32 | face where half of it is gone
    volatile __global int *left,           // samples that are not done
    __global float4 *image)                // [rows, width]
{
    WORK_ITEM(item);
    const int rows = view.rows.y - view.rows.x, across_blocks = (view.size.x + BLOCK_X - 1) / BLOCK_X;
    const int block_x = item % across_blocks * BLOCK_X, block_y = item / across_blocks * BLOCK_Y;
    const int samples = view.size.z, slabs = shells.kind.z;
    const Lighting lighting = {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps};
    const float4 eye = (float4)(view.eye.xyz, 0.0f);
    const float finer = 1.0f / (view.scale.x * sqrt((float)samples)), slabs_inverse = 1.0f / slabs;
    /* How fast the fur's height can change sideways, and with the height; 6 and 1.5 bound the noise's slope and size. */
    const float steep_here = (shells.kind.x ? 4.4428830f : 1.0f / CELL_RADIUS) / shells.shape.y;
    const float steep_noise = steep_here * 6.0f * shells.shape.z / shells.shape.w;     // of cells at the tips, which lean
    const float steep_up = shells.kind.x ? 0.0f : 1.5f * steep_here * shells.shape.z;
    const float steepest = 1.0f / shells.size.x;      // gradient of h
    const bool turned = (int)shells.shine.w == TURNED;
    const float half_thin = 0.5f / shells.shape.y, thinned = 1.0f - 2.0f * half_thin, smooth = shells.shape.x - 1.0f;
    int pending = 0;

    for (int s = 0; s < samples; ++s) {
        /* Where each ray is. */
        lanes rest, new_from = F(0.0f);    // share of light that is left; how far what is new begins
        lanes_i cell, in;                  // 3 · (slabs · face + slab) + tetrahedron, -1: at rest; corner left out
        lanes_i half_face = I(-1);
        lanes half_way = F(0.0f);
        cell = I(-1);
        in = I(0);
        lanes_i by = I(-1);                // border triangle where each comes in
        rest = F(0.0f);
        lanes at_x = rest, at_y = rest, depth = rest, behind = F(-1.0f);
        lanes3 q[3] = {all_lanes((float4)(0.0f, 0.0f, 1.0f, 0.0f)), all_lanes((float4)(1.0f, 0.0f, 1.0f, 0.0f)),
                       all_lanes((float4)(0.0f, 1.0f, 1.0f, 0.0f))};
        bool none = true;
        for (int i = 0; i < LANES; ++i) {
            const int x = block_x + i % BLOCK_X, y = block_y + i / BLOCK_X;
            if (x >= view.size.x || y >= rows)
                continue;
            const size_t sample = ((size_t)y * view.size.x + x) * samples + s;
            const ulong entry = entries[sample];
            const uint stop_depth = (uint)(visible[sample] >> 32), entry_depth = (uint)(entry >> 32);
            const bool enters = (uint)entry != NOTHING && entry_depth < stop_depth;
            after[sample] = enters ? entry_depth : NOTHING;   // fur that stands in other fur comes after it
            if (!enters)
                continue;
            none = false;
            LANE_I(by, i) = (int)((uint)entry & ~BODY);
            LANE(at_x, i) = x + view.rows.z;
            LANE(at_y, i) = y + view.rows.x;
            LANE(depth, i) = (float)(DEPTH_ONE - entry_depth) * (1.0f / DEPTH_ONE);
            LANE(behind, i) = stop_depth == NOTHING ? -1.0f : (float)(DEPTH_ONE - stop_depth) * (1.0f / DEPTH_ONE);
            LANE(rest, i) = shell_transmittance[sample];
        }
        if (none)
            continue;
        come_in(by, border, faces, curves, slabs, eye, q, &cell, &in);
        at_x += 0.5f + PATTERN[view.size.w + s].x * (1.0f / SUBPIXEL);
        at_y += 0.5f + PATTERN[view.size.w + s].y * (1.0f / SUBPIXEL);
        const Rays rays = rays_through(q, from_eye(&view, eye, at_x, at_y, depth));
        const lanes dx = rays.dx, dy = rays.dy, dz = rays.dz, ax = rays.ax, ay = rays.ay, az = rays.az, ux = rays.ux, uy = rays.uy,
            uz = rays.uz;
        const lanes3 d = {dx, dy, dz};
        const lanes stop = behind >= 0.0f ? dots(from_eye(&view, eye, at_x, at_y, behind), d) : F(INFINITY);
        const lanes wide = (view.to_screen[0].w * dx + view.to_screen[1].w * dy + view.to_screen[2].w * dz) * finer;   // of a pixel, at 1
        lanes red = F(0.0f), green = red, blue = red, alpha = red;
        lanes until = F(0.5f), aside = red, uncovered_inverse = F(1.0f), slack = red;   // to the next step; since the last one
        lanes at_depth = red, last_h = F(-1.0f);   // distance where each is; height of its last step, -1: it comes in
        lanes_i leaves = I(0);

        for (int walked = 0; walked < MOST_TETRAHEDRA * LANES; ++walked) {
            /* The tetrahedron of the ray that has come least far, and all rays in it. */
            const lanes waiting = cell >= 0 ? at_depth : F(INFINITY);
            const lanes_i next_ones = (cell >= 0) & (waiting == least_lane(waiting));
            const int here = most_lane(next_ones ? cell : I(-1));
            if (here < 0)
                break;
            const lanes_i group = cell == here;
            const int k = here % 3, slab = here / 3 % slabs, face = here / 3 / slabs;
            const uint4 corners = faces[face];
            const float4 first = lattice[CORNERS * face], second = lattice[CORNERS * face + 1];
            const float4 grad_x = lattice[CORNERS * face + 2], grad_y = lattice[CORNERS * face + 3];
            const float4 up = lattice[CORNERS * face + 4];
            const float4 noise_start = lattice[CORNERS * face + 5], noise_x = lattice[CORNERS * face + 6],
                noise_y = lattice[CORNERS * face + 7];
            lanes fx[4], fy[4], ahead[4], e[6], w[4];
            float top[4], px[4], py[4];
            for (int i = 0; i < 4; ++i) {
                const int c = CORNER[4 * k + i], side = c < 3 ? c : c - 3;
                const float4 q = curves[(side == 0 ? corners.x : side == 1 ? corners.y : corners.z) * (slabs + 1) + slab
                                        + (c >= 3)] - eye;
                fx[i] = q.x * ax + q.y * ay + q.z * az;
                fy[i] = q.x * ux + q.y * uy + q.z * uz;
                ahead[i] = q.x * dx + q.y * dy + q.z * dz;
                top[i] = c >= 3;
                px[i] = side == 0 ? first.x : side == 1 ? first.z : second.x;
                py[i] = side == 0 ? first.y : side == 1 ? first.w : second.y;
            }
            e[0] = fx[0] * fy[1] - fy[0] * fx[1];
            e[1] = fx[0] * fy[2] - fy[0] * fx[2];
            e[2] = fx[0] * fy[3] - fy[0] * fx[3];
            e[3] = fx[1] * fy[2] - fy[1] * fx[2];
            e[4] = fx[1] * fy[3] - fy[1] * fx[3];
            e[5] = fx[2] * fy[3] - fy[2] * fx[3];
            /* A side holds the ray if that goes round its corners the same way; two sides do, one of them the one where
               it has come in. Both tetrahedra at a side take its edges alike, to the bit. */
            const lanes_i n0 = e[0] < 0.0f, n1 = e[1] < 0.0f, n2 = e[2] < 0.0f, n3 = e[3] < 0.0f, n4 = e[4] < 0.0f,
                n5 = e[5] < 0.0f;
            lanes_i out = (in + 1) & 3;
            out = ((n0 == n3) & (n0 != n1) & (in != 3)) ? I(3) : out;
            out = ((n0 == n4) & (n0 != n2) & (in != 2)) ? I(2) : out;
            out = ((n1 == n5) & (n1 != n2) & (in != 1)) ? I(1) : out;
            out = ((n3 == n5) & (n3 != n4) & (in != 0)) ? I(0) : out;

            weights(in, e, w);
            const lanes z_in = w[0] * ahead[0] + w[1] * ahead[1] + w[2] * ahead[2] + w[3] * ahead[3];
            const lanes h_in = (slab + (w[0] * top[0] + w[1] * top[1] + w[2] * top[2] + w[3] * top[3])) * slabs_inverse;
            const lanes x_in = w[0] * px[0] + w[1] * px[1] + w[2] * px[2] + w[3] * px[3];
            const lanes y_in = w[0] * py[0] + w[1] * py[1] + w[2] * py[2] + w[3] * py[3];
            weights(out, e, w);
            const lanes z_out = w[0] * ahead[0] + w[1] * ahead[1] + w[2] * ahead[2] + w[3] * ahead[3];
            const lanes h_out = (slab + (w[0] * top[0] + w[1] * top[1] + w[2] * top[2] + w[3] * top[3])) * slabs_inverse;
            const lanes x_out = w[0] * px[0] + w[1] * px[1] + w[2] * px[2] + w[3] * px[3];
            const lanes y_out = w[0] * py[0] + w[1] * py[1] + w[2] * py[2] + w[3] * py[3];
            const lanes_i down = slab == 0 && k == 0 ? out == 3 : I(0);
            lanes_i ended = group & ((z_out >= stop) | down);

            /* What is new to the ray: space that is folded back is gone through again. */
            lanes_i running = group & (z_out > new_from);
            if (any_lane(running)) {
                #pragma OPENCL FP_CONTRACT ON
                const lanes length = z_out - z_in, shorter = 1.0f / greater(length, F(1e-30f));
                const lanes low = within((new_from - z_in) * shorter, 0.0f, 1.0f);
                const lanes high = greater(within((stop - z_in) * shorter, 0.0f, 1.0f), low);
                const lanes rise = h_out - h_in, mx = x_out - x_in, my = y_out - y_in;
                const lanes move = quick_root(mx * mx + my * my + 1e-20f);
                const lanes footprint = shells.kind.w ? wide * (0.5f * (z_in + z_out)) : F(0.0f);
                const lanes blur = footprint * second.w;
                const lanes fade = within((blur - FAR_FROM) * (1.0f / (FAR_TO - FAR_FROM)), 0.0f, 1.0f);
                const lanes far = fade * fade * (3.0f - 2.0f * fade);
                const lanes_i is_far = far > 0.0f, is_crowd = far >= 1.0f, passes = running;
                const bool any_far = any_lane(running & is_far), all_crowd = !any_lane(running & !is_crowd);
                lanes along = SIDEWAYS * move;
                if (!shells.kind.w) {
                    /* Not filtered: more looks than PIXEL across a pixel would show noise of another grain and no more. */
                    const lanes across = 0.5f * (z_in + z_out) * wide * second.w;
                    along = move * lesser(F(SIDEWAYS), PIXEL / greater(across, F(1e-6f)));
                }
                if (any_far) {
                    /* Where hairs begin to be seen on average a step is a pixel long, if that is longer. */
                    const float square_x = dot3(grad_x, grad_x), square_y = dot3(grad_y, grad_y);
                    const float slower = sqrt(square_x < square_y ? square_x : square_y);
                    const lanes longest = is_far ? 1.0f / (slower * footprint) : F(SIDEWAYS);
                    along = is_crowd ? move / blur : move * lesser(SIDEWAYS - (SIDEWAYS - 1.0f) * far, longest);
                }
                const lanes measure = greater(greater(shells.size.y * positive(rise), along), F(1e-6f));
                const lanes measure_inverse = 1.0f / measure, a_step = move * measure_inverse;
                /* How fast fur can come nearer from one step to the next. */
                const lanes nearer = move * (steep_here + steep_noise * (shells.kind.x ? F(1.0f) : greater(h_in, h_out))) + positive(rise) * steep_up - rise;
                const lanes rate = greater(nearer * measure_inverse, F(1e-2f));
                const lanes rate_inverse = lesser(measure / greater(nearer, F(1e-30f)), F(1e2f));
                /* From here on a place is how many steps the ray has taken since it came in here: 0 to span. */
                const lanes z_step = length * measure_inverse, h_step = rise * measure_inverse;
                const lanes x_step = mx * measure_inverse, y_step = my * measure_inverse;
                const lanes z_first = z_in + low * length, h_first = h_in + low * rise;
                const lanes x_first = x_in + low * mx, y_first = y_in + low * my, span = (high - low) * measure;
                /* Most of half a footprint; in far fur all is near hair, however thin that is. */
                const lanes room = is_far ? F(1e9f) : 0.5f * footprint * (up.w * steep_here + steepest);
                /* Gradients across the ray. */
                const lanes grad_xa = grad_x.x * ax + grad_x.y * ay + grad_x.z * az, grad_xu = grad_x.x * ux + grad_x.y * uy + grad_x.z * uz;
                const lanes grad_ya = grad_y.x * ax + grad_y.y * ay + grad_y.z * az, grad_yu = grad_y.x * ux + grad_y.y * uy + grad_y.z * uz;
                const lanes up_a = up.x * ax + up.y * ay + up.z * az, up_u = up.x * ux + up.y * uy + up.z * uz;
                const lanes pixel = SHARP * footprint;
                last_h = (running & (last_h < 0.0f)) ? h_first : last_h;
                lanes hidden = F(0.0f), sum = hidden, sum_x = hidden, sum_y = hidden;
                /* Steps that can't meet hair are left out: there is none before `clear`. */
                lanes clear = is_far ? F(0.0f) : slack * rate_inverse, next = until, last = hidden;
                next += clear > next ? nearest(clear - next + 0.5f) : F(0.0f);
                if (any_far)
                    last = -aside / a_step;
                while (true) {
                    /* Where the next step ends doesn't hang on what is left of the light, so that a processor can
                       begin with it. */
                    const lanes_i whole = next <= span, stepping = running & (whole | ended);
                    if (!any_lane(stepping & (rest > 0.0f)))
                        break;
                    const lanes at = whole ? next : span, h = within(h_first + at * h_step, 0.0f, 1.0f);
                    lanes x = x_first + at * x_step, y = y_first + at * y_step;
                    lanes moved_x = F(0.0f), moved_y = F(0.0f), by_x = moved_x, by_y = moved_x, top = F(1.0f), fold = moved_x, v = moved_x;
                    if (shells.shape.z > 0.0f && !all_crowd) {
                        for (int i = 0; i < LANES; ++i)
                            if (LANE_I(stepping, i)) {
                                const float4 where = shells.kind.x
                                    ? (float4)(LANE(x, i), LANE(y, i), 0.0f, 0.0f) / shells.shape.w
                                    : noise_start + (LANE(x, i) * noise_x + LANE(y, i) * noise_y);
                                const float2 moved = shells.shape.z * noise_at(&shells, noise, where);
                                LANE(moved_x, i) = moved.x;
                                LANE(moved_y, i) = moved.y;
                            }
                    }
                    if (all_crowd) {
                        /* No cell is seen, so none is looked for. */
                    } else if (shells.kind.x) {
                        x += moved_x;
                        y += moved_y;
                        const lanes sx = x - 0.25f, sy = y - 0.25f, qx = 0.25f - positive(sx - nearest(sx)), qy = 0.25f - positive(sy - nearest(sy));
                        by_x = QUARTER(qx, qx * qx) + QUARTER(qy, qy * qy);
                        v = thinned + half_thin * positive(by_x);
                    } else {
                        v = cells(&shells, face, (int)second.z, x, y, moved_x * h, moved_y * h, &by_x, &by_y, &top, &fold);
                    }
                    const lanes gap = (h - room) - v, ahead = greater(gap, F(0.0f)) * rate_inverse;
                    clear = stepping ? at + ahead : clear;
                    next = stepping & whole ? (at + 1.0f) + nearest(ahead - 0.5f) : next;
                    running = stepping & whole & (rest > 0.0f);
                    if (!any_lane(stepping & (gap < 0.0f))) {
                        uncovered_inverse = stepping ? F(1.0f) : uncovered_inverse;
                        last = at;
                        last_h = stepping ? h : last_h;
                        continue;
                    }
                    if (shells.kind.x && !all_crowd) {
                        const lanes slope = by_x < 0.0f ? F(-6.2831853f * half_thin) : F(6.2831853f * half_thin);
                        const lanes qx = 0.25f - positive(x - nearest(x)), qy = 0.25f - positive(y - nearest(y));
                        by_x = slope * QUARTER(qx, qx * qx);
                        by_y = slope * QUARTER(qy, qy * qy);
                        top = F(1.0f);
                        fold = F(thinned);
                    }
                    /* v - h changes across the ray by g over a pixel. */
                    const lanes across_a = by_x * grad_xa + by_y * grad_ya - up_a, across_u = by_x * grad_xu + by_y * grad_yu - up_u;
                    const lanes width = greater(smooth * h, F(1e-3f));
                    const lanes sharper = 1.0f / width, least = 1e-2f * width;
                    const lanes g = greater(pixel * quick_root(across_a * across_a + across_u * across_u + 1e-20f), least);
                    lanes covered = cover((v - h) * sharper, 0.5f * sharper * g, (top - h) * sharper, (fold - h) * sharper,
                                                width / g);
                    /* What is hidden here and was not before, of what is left: hairs go down to the skin, so that one
                       step below another hides the same again. */
                    lanes mean_back = F(0.5f), kept = lesser((1.0f - covered) * uncovered_inverse, F(1.0f));
                    if (any_far) {
                        const lanes before_h = is_crowd ? last_h : h - h_step;
                        lanes before = F(0.0f), now = before, before_entered = before, entered = before, mean;
                        for (int i = 0; i < LANES; ++i)
                            if (LANE_I(stepping, i) && LANE_I(is_far, i)) {
                                const float2 a = mean_at(means, LANE(before_h, i)), b = mean_at(means, LANE(h, i));
                                LANE(before, i) = a.x;
                                LANE(now, i) = b.x;
                                LANE(before_entered, i) = a.y;
                                LANE(entered, i) = b.y;
                            }
                        const lanes way = at - last;
                        const lanes many = kept_by_many(before, now, is_crowd ? 0.5f * (before_entered + entered) : entered,
                                                        way * a_step, &mean);
                        kept = is_crowd ? many : is_far ? kept + far * (many - kept) : kept;
                        covered = is_crowd ? now : covered;
                        mean_back = is_crowd ? lesser(way, at) * (1.0f - mean) : mean_back;
                    }
                    last = at;
                    last_h = stepping ? h : last_h;
                    kept = stepping ? kept : F(1.0f);
                    uncovered_inverse = stepping ? 1.0f / greater(1.0f - covered, F(1e-3f)) : uncovered_inverse;
                    if (!any_lane(kept < 1.0f))
                        continue;
                    /* It was met where the ramp from nothing to all was half gone through since the step before. */
                    const lanes ramp = 1.0f / (width + g), now = (v - h + 0.5f * g) * ramp, change = (by_x * x_step + by_y * y_step - h_step) * ramp;
                    const lanes middle = 0.5f * (within(now - change, 0.0f, 1.0f) + within(now, 0.0f, 1.0f));
                    const lanes_i rises = (change > 1e-6f) & !is_far;
                    const lanes back = rises ? within((now - middle) / (rises ? change : F(1.0f)), 0.0f, 1.0f) : mean_back;
                    const lanes after_it = rest * kept, left_over = after_it < UNSEEN ? F(0.0f) : after_it;
                    const lanes part = rest - left_over;
                    hidden += part;
                    sum += part * (at - back);
                    if (turned) {
                        sum_x += part * (1.0f - far) * by_x;
                        sum_y += part * (1.0f - far) * by_y;
                    }
                    const lanes_i halved = (rest >= 0.5f) & (left_over < 0.5f);
                    half_way = halved ? z_first + (is_crowd ? at - back : at) * z_step : half_way;
                    half_face = halved ? I(face) : half_face;
                    rest = left_over;
                }
                ended |= passes & (rest == 0.0f);
                const lanes over = next - span, rest_of = over - nearest(over - 0.5f), to_next = rest_of > 0.0f ? rest_of : rest_of + 1.0f;
                aside = passes ? (span + to_next > 1.0f ? (1.0f - to_next) * a_step : aside + span * a_step) : aside;
                until = passes ? to_next : until;
                slack = passes ? greater((clear - span) * rate, F(0.0f)) : slack;
                new_from = group ? greater(new_from, z_out) : new_from;
                /* Light once a tetrahedron, at the mean place of what has hidden something there. */
                const lanes_i shown = hidden > 1e-4f;
                if (any_lane(shown)) {
                    const lanes scale = 1.0f / (shown ? hidden : F(1.0f)), mean = scale * sum, z = z_first + mean * z_step;
                    const float2 one = first.zw - first.xy, two = second.xy - first.xy;
                    const float area = one.x * two.y - one.y * two.x, smaller = area != 0.0f ? 1.0f / area : 0.0f;
                    const lanes at_x = x_first + mean * x_step - first.x, at_y = y_first + mean * y_step - first.y;
                    const lanes wb = (at_x * two.y - at_y * two.x) * smaller, wc = (one.x * at_y - one.y * at_x) * smaller;
                    const lanes wa = 1.0f - wb - wc;
                    __global const float4 *ca = curves + corners.x * (slabs + 1) + slab,
                        *cb = curves + corners.y * (slabs + 1) + slab, *cc = curves + corners.z * (slabs + 1) + slab;
                    const lanes3 n = unit(plus(scaled(all_lanes(normals[corners.x]), wa), plus(
                        scaled(all_lanes(normals[corners.y]), wb), scaled(all_lanes(normals[corners.z]), wc))));
                    const lanes3 t = unit(plus(scaled(all_lanes(ca[1] - ca[0]), wa), plus(
                        scaled(all_lanes(cb[1] - cb[0]), wb), scaled(all_lanes(cc[1] - cc[0]), wc))));
                    const lanes3 slope = scaled(plus(scaled(all_lanes(grad_x), sum_x), scaled(all_lanes(grad_y), sum_y)), scale);
                    const lanes3 place = {eye.x + z * dx, eye.y + z * dy, eye.z + z * dz}, v = {-dx, -dy, -dz};
                    const lanes3 color = shade_fur(&lighting, &sky, sky_cells, &shells, shown, place, within(h_first + mean * h_step, 0.0f, 1.0f), t, n, slope, v);
                    red += shown ? hidden * color.x : F(0.0f);
                    green += shown ? hidden * color.y : F(0.0f);
                    blue += shown ? hidden * color.z : F(0.0f);
                    alpha += shown ? hidden : F(0.0f);
                }
            }

            /* On into the next tetrahedra. */
            at_depth = group ? z_out : at_depth;
            lanes_i onto, entry, fresh;
            onwards(here, slabs, neighbours[face], out, &onto, &entry, &fresh);
            const lanes_i stays = ended & !(shells.noise.w & down & (z_out < stop));
            leaves = group ? (onto < 0) & !stays : leaves;
            cell = group ? (ended ? I(-1) : onto) : cell;
            in = group ? entry : in;
            slack = (group & (fresh != 0)) ? F(0.0f) : slack;
        }
        for (int i = 0; i < LANES; ++i) {
            const int x = block_x + i % BLOCK_X, y = block_y + i / BLOCK_X;
            const size_t pixel = (size_t)y * view.size.x + x, sample = pixel * samples + s;
            if (x >= view.size.x || y >= rows || after[sample] == NOTHING)
                continue;
            const float left_over = LANE(rest, i);
            if (LANE_I(leaves, i) && left_over > 0.0f)
                ++pending;
            else
                after[sample] = NOTHING;
            shell_transmittance[sample] = left_over;
            if (LANE_I(half_face, i) >= 0) {
                const float4 d = (float4)(LANE(dx, i), LANE(dy, i), LANE(dz, i), 0.0f);
                shell_front[sample] = (ulong)depth_of(&view, eye + LANE(half_way, i) * d) << 32 | (uint)LANE_I(half_face, i);
            }
            image[pixel] += (float4)(LANE(red, i), LANE(green, i), LANE(blue, i), LANE(alpha, i)) * (1.0f / samples);
        }
    }
    if (pending)
        atomic_add(left, pending);
}
