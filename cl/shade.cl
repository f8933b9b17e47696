/*
 * Light on what each sample sees: Kajiya and Kay's hair (SIGGRAPH 1989; the report's section 2.2), a Lambert
 * body; and what else is known of a pixel.
 */

/* The world point that a sample sees. */
inline float4 seen_point(const View *view, int x, int y, int s, uint depth)
{
    const int2 offset = PATTERN[view->size.w + s];
    const float px = x + 0.5f + offset.x * (1.0f / SUBPIXEL), py = y + 0.5f + offset.y * (1.0f / SUBPIXEL);
    const float e = (float)(DEPTH_ONE - depth) / DEPTH_ONE;
    const float4 q = view->to_world[0] * px + view->to_world[1] * py + view->to_world[2] * e + view->to_world[3];
    return (float4)(q.xyz / q.w, 0.0f);
}

/* Unit vector from the point towards the eye. */
inline float4 towards_eye(const View *view, float4 p)
{
    const float4 eye = (float4)(view->eye.xyz, 0.0f);
    return unit_or(eye - view->eye.w * p, (float4)(0.0f, 0.0f, 1.0f, 0.0f));
}

/* Share of the way from a to b at which p stands. */
inline float place_between(float4 a, float4 b, float4 p)
{
    float4 d = b - a, e = p - a;
    d.w = e.w = 0.0f;
    const float square = dot3(d, d);
    return square > 0.0f ? clamp(dot3(d, e) / square, 0.0f, 1.0f) : 0.0f;
}

/* Weights of a triangle's corners at a point of its plane. */
inline float4 barycentric(float4 a, float4 b, float4 c, float4 p)
{
    const float4 n = cross3(b - a, c - a);
    const float square = dot3(n, n);
    if (!(square > 0.0f))
        return (float4)(1.0f, 0.0f, 0.0f, 0.0f);
    const float v = clamp(dot3(cross3(p - a, c - a), n) / square, 0.0f, 1.0f);
    const float w = clamp(dot3(cross3(b - a, p - a), n) / square, 0.0f, 1.0f - v);
    return (float4)(1.0f - v - w, v, w, 0.0f);
}

/* The surface's normal at a point of triangle t, on the eye's side. */
inline float4 body_normal(__global const float4 *positions, __global const float4 *normals, uint4 t,
                          float4 p, float4 v, float4 *weights)
{
    const float4 b = barycentric(positions[t.x], positions[t.y], positions[t.z], p);
    const float4 n = unit_or(b.x * normals[t.x] + b.y * normals[t.y] + b.z * normals[t.z], normals[t.x]);
    *weights = b;
    return dot3(n, v) < 0.0f ? -n : n;
}

inline float sine(float cosine)
{
    return sqrt(max(1.0f - cosine * cosine, 0.0f));
}

/* Kajiya and Kay's light from one fibre: t its tangent, l towards the light, v towards the eye. Their own highlight
   is the cone of mirror directions; the report's takes the half vector, which has no value at l = -v. */
inline float4 fibre(float4 color, float specular, float exponent, int half_vector,
                    float4 t, float4 l, float4 v, float4 light)
{
    const float tl = dot3(t, l), tv = dot3(t, v);
    float highlight, shine = 0.0f;
    if (half_vector) {
        const float4 h = l + v;
        const float length = sqrt(dot3(h, h));
        highlight = length > 1e-6f ? sine(dot3(t, h) / length) : 0.0f;
    } else {
        highlight = max(sine(tl) * sine(tv) - tl * tv, 0.0f);
    }
    /* highlight^exponent, left out where it is below exp(-16): a power costs more than all the rest here. */
    if ((1.0f - highlight) * exponent < 16.0f)
        shine = specular * exp2(exponent * log2(highlight));
    return light * (color * sine(tl) + shine) + light.w * color;
}

/* Share of light that the hair before p lets through: the light's running sums, read between four columns and two
   layers; full light outside the grid. `own` is what the strand that p lies on adds to its own sum: by its width at
   w = 1, and whatever that is. */
inline float through_hair(const Grid *grid, __global const float *sums, float depth, float2 own, float4 p)
{
    const float4 c = ((grid->to_grid[0] * p.x + grid->to_grid[1] * p.y) + grid->to_grid[2] * p.z) + grid->to_grid[3];
    if (!(c.w > 0.0f))
        return 1.0f;
    const float x = c.x / c.w - 0.5f, y = c.y / c.w - 0.5f, z = clamp(c.z, 0.0f, (float)grid->size.z);
    if (!(x > -1.0f && y > -1.0f && x < grid->size.x && y < grid->size.y))
        return 1.0f;
    const int x0 = (int)floor(x), y0 = (int)floor(y), z0 = min((int)z, grid->size.z - 1);
    const float fx = x - x0, fy = y - y0, fz = z - z0;
    /* Columns outside the grid hold nothing: their weight is 0, and another's place is read. */
    const int nx = grid->size.x, ny = grid->size.y;
    const float left = x0 >= 0 ? 1.0f - fx : 0.0f, right = x0 + 1 < nx ? fx : 0.0f;
    const float front = y0 >= 0 ? 1.0f - fy : 0.0f, back = y0 + 1 < ny ? fy : 0.0f;
    const int xa = max(x0, 0), xb = min(x0 + 1, nx - 1), ya = max(y0, 0), yb = min(y0 + 1, ny - 1);
    __global const float *near = sums + (size_t)z0 * nx * ny, *far = near + nx * ny;
    const float4 weights = (float4)(left * front, right * front, left * back, right * back);
    const float4 before = (float4)(near[ya * nx + xa], near[ya * nx + xb], near[yb * nx + xa], near[yb * nx + xb]);
    const float4 behind = (float4)(far[ya * nx + xa], far[ya * nx + xb], far[yb * nx + xa], far[yb * nx + xb]);
    const float4 there = weights * (before + fz * (behind - before));
    const float crossings = (there.x + there.y) + (there.z + there.w);
    return exp2(-1.44269504f * depth * max(crossings - own.x / c.w - own.y, 0.0f));
}

/* Share of light that the body lets through to p: the report's equation 8, over (2r + 1)² texels around. What is seen
   there is held against the plane through p across n, the normal of what is drawn there or of the skin at a strand's
   root, so that a slope does not shade itself; no steeper than `steepest` texels deep a texel, and level where n is 0.
   bias: in texels. */
inline float past_body(const View *seen, __global const ulong *map, int radius, float4 p, float4 n, float steepest,
                       float bias)
{
    const float4 c = to_screen(seen, p);
    if (!(c.w > 0.0f))
        return 1.0f;
    const float x = c.x / c.w, y = c.y / c.w, e = c.z / c.w;
    /* Projection takes the plane (n, -n·p) to a plane of (x, y, e): a x + b y + c e + d = 0. */
    const float4 plane = (float4)(n.xyz, -dot3(n, p));
    const float along_e = dot(plane, seen->to_world[2]), texel = seen->eye.w > 0.0f ? e / seen->scale.x : 1.0f / seen->size.x;
    const float limit = steepest * texel, flat = fabs(along_e) > 0.0f ? -1.0f / along_e : 0.0f;
    const float dx = clamp(dot(plane, seen->to_world[0]) * flat, -limit, limit);
    const float dy = clamp(dot(plane, seen->to_world[1]) * flat, -limit, limit);
    const int x0 = (int)floor(x), y0 = (int)floor(y);
    /* In depth steps: what lies nearer to the light than the plane by more than the bias. */
    const float nearest = e + bias * texel + dx * (x0 + 0.5f - x) + dy * (y0 + 0.5f - y);
    const long plane_at = (long)(nearest * DEPTH_ONE), x_step = (long)(dx * DEPTH_ONE), y_step = (long)(dy * DEPTH_ONE);
    int dark = 0;
    for (int j = max(-radius, -y0); j <= min(radius, seen->size.y - 1 - y0); ++j) {
        __global const ulong *row = map + (long)(y0 + j) * seen->size.x + x0;
        for (int i = max(-radius, -x0); i <= min(radius, seen->size.x - 1 - x0); ++i)
            dark += (long)(row[i] >> 32) + plane_at + i * x_step + j * y_step < DEPTH_ONE;
    }
    return 1.0f - (float)dark / ((2 * radius + 1) * (2 * radius + 1));
}

/* Number of an id among those that a part of the scene holds, or the number of those if it isn't its. */
inline uint own(uint id, uint first, uint n)
{
    return min(id - first, n);
}

/* One work-item lights samples of one pixel, those of one part of the scene, and adds their share of the average:
   premultiplied linear r, g, b and coverage. */
__kernel void color(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint4 part,                      // first point's id, points, first triangle's id, triangles
    const int2 which,                      // samples: first, one past the last
    const Light light,
    const int half_vector,                 // 0: Kajiya and Kay's highlight, 1: the report's
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global const float4 *points,         // strands: see strands.cl
    __global const float4 *tangents,
    __global const uint *strand_of,
    __global const float4 *strand_normal,  // [strands] of the skin at the root, 0: not known
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const HairType *types,
    __global const float4 *colors,         // one, [strands] or [points]
    const int color_per,                   // 0: one for all, 1: each strand, 2: each point
    __global const float4 *positions,      // body: see tessellate.cl
    __global const float4 *normals,
    __global const uint4 *triangles,
    const float4 body_color,
    const Shadow shadow,
    const Grid grid,
    __global const float *sums,            // [nz + 1, ny, nx] crossings before each layer of the grid
    const View seen,                       // by the light
    __global const ulong *map,             // [seen.size] nearest body
    __global float4 *image)                // [rows, width]
{
    WORK_ITEM(pixel);
    const int x = pixel % view.size.x, y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    const float weight = 1.0f / samples;   // a power of two: the sum is the same bits, part by part or at once
    float4 sum = image[pixel];
    for (int s = which.x; s < which.y; ++s) {
        const ulong key = visible[pixel * samples + s];
        const bool is_body = (uint)key & BODY;
        const uint id = is_body ? own((uint)key & ~BODY, part.z, part.w) : own((uint)key, part.x, part.y);
        if ((uint)key == NOTHING || id == (is_body ? part.w : part.y))
            continue;
        const float4 p = seen_point(&view, x, y, s, (uint)(key >> 32)), v = towards_eye(&view, p);
        float4 lit, l = -light.direction, direct = light.color;
        if (light.position.w > 0.0f) {
            l = unit_or((float4)(light.position.xyz - p.xyz, 0.0f), l);
            direct.xyz *= -dot3(l, light.direction) >= light.cone.x ? 1.0f : 0.0f;
        }
        if (is_body) {
            float4 weights;
            const uint4 t = triangles[id];
            const float4 n = body_normal(positions, normals, t, p, v, &weights);
            float share = max(dot3(n, l), 0.0f);
            if (shadow.body.x && share > 0.0f)
                share *= past_body(&seen, map, shadow.body.y, p, unit_or(
                    cross3(positions[t.y] - positions[t.x], positions[t.z] - positions[t.x]), n), 64.0f, 1.0f);
            if (shadow.hair.x > 0.0f && share > 0.0f)
                share *= through_hair(&grid, sums, shadow.hair.x, (float2)(0.0f), p);
            direct.xyz *= share;
            lit = body_color * (direct + light.color.w);
        } else {
            const uint strand = strand_of[id];
            const float4 shine = types[(int)strand_uv[strand].z].shine;
            float share = 1.0f;
            if (shadow.body.x)
                share = past_body(&seen, map, shadow.body.y, p, strand_normal[strand], 5.0f, 1.0f + 2 * shadow.body.y);
            if (shadow.hair.x > 0.0f && share > 0.0f) {
                /* Of this type a crossing counts only so much of what one of the darkest does. */
                float depth = 1.0f - shine.z;
                if (!(shadow.hair.w > 0.0f))
                    depth = -log(max(shine.z, 1e-6f));
                const float2 own = (float2)(shadow.hair.y * points[id].w, shadow.hair.z) * (depth / shadow.hair.x);
                share *= through_hair(&grid, sums, shadow.hair.x, own, p);
            }
            direct.xyz *= share;
            const float at = place_between(points[id], points[id + 1], p);
            const float4 t = unit_or(mix(tangents[id], tangents[id + 1], at), tangents[id]);
            const float4 c = color_per == 0 ? colors[0] : color_per == 1 ? colors[strand]
                : mix(colors[id], colors[id + 1], at);
            lit = fibre(c, shine.x, shine.y, half_vector, t, l, v, direct);
        }
        sum += weight * (float4)(lit.xyz, 1.0f);
    }
    image[pixel] = sum;
}

/* One work-item tells what the nearest covered sample of one pixel sees, if this part of the scene holds it. */
__kernel void about(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const uint4 part,                      // first point's id, points, first triangle's id, triangles
    const uint first_strand,               // number of the part's first strand
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id
    __global const float4 *points,
    __global const float4 *tangents,
    __global const uint *strand_of,
    __global const float4 *strand_uv,
    __global const float4 *positions,
    __global const float4 *normals,
    __global const float4 *uv,             // body
    __global const uint4 *triangles,
    __global float *out_depth,             // [rows, width] distance along the view axis; infinite: nothing
    __global int *out_id,                  // strand, -1: nothing, -2: body
    __global float4 *out_tangent,          // unit; 0 but on strands
    __global float4 *out_normal,           // unit, towards the eye: the body's, or across a strand
    __global float4 *out_uv,               // of the body, or of the strand's root
    __global float *out_coverage)          // share of covered samples
{
    WORK_ITEM(pixel);
    const int x = pixel % view.size.x, y = view.rows.x + (int)(pixel / view.size.x), samples = view.size.z;
    ulong key = ~0ul;
    int nearest = 0, covered = 0;
    for (int s = 0; s < samples; ++s) {
        const ulong other = visible[pixel * samples + s];
        covered += (uint)other != NOTHING;
        if (other < key) {
            key = other;
            nearest = s;
        }
    }
    out_coverage[pixel] = (float)covered / samples;
    const bool is_body = (uint)key & BODY;
    const uint id = is_body ? own((uint)key & ~BODY, part.z, part.w) : own((uint)key, part.x, part.y);
    if ((uint)key == NOTHING || id == (is_body ? part.w : part.y))
        return;
    const float4 p = seen_point(&view, x, y, nearest, (uint)(key >> 32)), v = towards_eye(&view, p);
    out_depth[pixel] = to_screen(&view, p).w;
    if (is_body) {
        const uint4 t = triangles[id];
        float4 b;
        out_id[pixel] = -2;
        out_normal[pixel] = body_normal(positions, normals, t, p, v, &b);
        out_uv[pixel] = b.x * uv[t.x] + b.y * uv[t.y] + b.z * uv[t.z];
    } else {
        const float at = place_between(points[id], points[id + 1], p);
        const float4 tangent = unit_or(mix(tangents[id], tangents[id + 1], at), tangents[id]);
        out_id[pixel] = (int)(first_strand + strand_of[id]);
        out_tangent[pixel] = tangent;
        out_normal[pixel] = unit_or(v - dot3(v, tangent) * tangent, v);
        out_uv[pixel] = strand_uv[strand_of[id]];
    }
}
