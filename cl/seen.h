/* What a sample sees, and from where: shade.cl, strand_light.cl, shells.cl and march.cl use this. */

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
