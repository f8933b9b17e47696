/* What a sample sees, and from where: shade.cl, flow.cl, strand_light.cl, shells.cl and march.cl use this. */

/* Reversed depth of what was seen at this depth: at least half a step, as infinity is no place. */
inline float reversed_depth(uint depth)
{
    return max((float)(DEPTH_ONE - depth), 0.5f) / DEPTH_ONE;
}

/* The world point that a sample sees. */
inline float4 seen_point(const View *view, int x, int y, int s, uint depth)
{
    const int2 offset = PATTERN[view->size.w + s];
    const float px = x + 0.5f + offset.x * (1.0f / SUBPIXEL), py = y + 0.5f + offset.y * (1.0f / SUBPIXEL);
    const float e = reversed_depth(depth);
    const float4 q = view->to_world[0] * px + view->to_world[1] * py + view->to_world[2] * e + view->to_world[3];
    return (float4)(q.xyz / q.w, 0.0f);
}

/* Distance along the view axis of a place that was seen at this depth; by the depth alone where the place lies so far aside
   that rounding errors leave nothing of it. */
inline float depth_along(const View *view, float4 p, uint depth)
{
    const float near = view->to_screen[3].z, distance = to_screen(view, p).w;
    return distance > 0.5f * near ? distance : near / reversed_depth(depth);
}

/* Share of a pixel that is covered: of the samples that see nothing, what shell fur before them hides. */
inline float covered_share(__global const ulong *visible, __global const float *transmittance, size_t pixel, int samples)
{
    float covered = 0.0f;
    for (int s = 0; s < samples; ++s)
        covered += (uint)visible[pixel * samples + s] == NOTHING ? 1.0f - transmittance[pixel * samples + s] : 1.0f;
    return covered / samples;
}

/* Unit vector from the point towards the eye. */
inline float4 towards_eye(const View *view, float4 p)
{
    const float4 eye = (float4)(view->eye.xyz, 0.0f);
    return unit_or(eye - view->eye.w * p, (float4)(0.0f, 0.0f, 1.0f, 0.0f));
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

/* Number of what a sample shows among the triangles, or the segments as they came, that a part of the scene holds; NOTHING
   if it shows none of these. */
inline uint local_id(ulong key, uint4 part)
{
    const bool is_body = (uint)key & BODY;
    const uint id = is_body ? ((uint)key & ~BODY) - part.z : (uint)key - part.x;   // wraps round below the first
    return (uint)key == NOTHING || id >= (is_body ? part.w : part.y) ? NOTHING : id;
}
