/* What two or more kernels use.  Geometry needs + - * / sqrt only, each rounded by itself. */
#pragma OPENCL FP_CONTRACT OFF

/* Every kernel runs over the work-items begin to end, in pieces and in whole work-groups: a driver compiles a kernel anew
   for another size of work-group, and PoCL also for a start elsewhere than at 0. */
#define WORK_ITEM(i) const size_t i = begin + get_global_id(0); if (i >= end) return

/* A kernel that would take PoCL long to compile, as it makes three functions of each: see clfur/device/source.py. */
#define LARGE

/* A kernel whose work-items are groups of their own: some have much more to do than others, and Intel's compiler would lay
   several of a group side by side. */
#define ALONE __attribute__((reqd_work_group_size(1, 1, 1)))

#define RARE   // a kernel that most pictures do without: it is not made ready ahead of its first launch

#define UNSEEN (1.0f / 256)   // share of light that would not be seen: what is behind so little is left out

inline float dot3(float4 a, float4 b)
{
    return (a.x * b.x + a.y * b.y) + a.z * b.z;
}

inline float4 cross3(float4 a, float4 b)
{
    return (float4)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x, 0.0f);
}

/* v at length one; `otherwise` where v has no direction. v.w must be 0. */
inline float4 unit_or(float4 v, float4 otherwise)
{
    const float square = dot3(v, v);
    return square > 1e-30f ? v / sqrt(square) : otherwise;
}

/* World -> (x, y, e, w): pixels and reversed depth, times w. */
inline float4 to_screen(const View *view, float4 p)
{
    return ((view->to_screen[0] * p.x + view->to_screen[1] * p.y) + view->to_screen[2] * p.z) + view->to_screen[3];
}

/* Three random words for one strand: pcg3d of Jarzynski and Olano, "Hash Functions for GPU Rendering" (2020).
   They depend on (strand, seed, use) alone, never on the work-item. */
inline uint3 random3(uint strand, uint seed, uint use)
{
    uint3 v = (uint3)(strand, seed, use) * 1664525u + 1013904223u;
    v.x += v.y * v.z;  v.y += v.z * v.x;  v.z += v.x * v.y;
    v ^= v >> 16;
    v.x += v.y * v.z;  v.y += v.z * v.x;  v.z += v.x * v.y;
    return v;
}
