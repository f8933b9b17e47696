/* Base colours of the body: one, or of materials, which may have a picture laid on by uv.  shade.cl uses this. */

/* What the body is painted with; pictures are there at half their size too, and at half of that, down to one texel. */
typedef struct {
    float4 color;                          // of all of it, where there are no materials
    int n;                                 // materials
    __global const Material *materials;
    __global const uint *material_of;      // [faces of the part] index, where there are several
    __global const uint2 *texels;          // 16 bits each of r, g, b: rows from the top, one picture after the other
    __global const float4 *uv;             // [vertices] see tessellate.cl
} Paint;

/* Number of the texel on one side of a picture of n that `wrap` lays at i; -1 <= i <= 2 n. */
inline int wrapped(int i, int n, int wrap)
{
    const int inside = i < 0 ? 0 : i < n ? i : n - 1;
    const int turned = i < 0 ? -1 - i : i < n ? i : i < 2 * n ? 2 * n - 1 - i : i - 2 * n;
    const int round = i < 0 ? i + n : i < n ? i : i - n;
    const int found = wrap == WRAP_CLAMP ? inside : wrap == WRAP_MIRROR ? turned : round;
    return found < 0 ? 0 : found < n ? found : n - 1;
}

/* A place on a side of a picture, brought to where `wrapped` has it: 0 to 1, of a mirrored one to 2. */
inline float folded(float u, int wrap)
{
    const float once = u - floor(u), twice = u - 2.0f * floor(0.5f * u);
    const float inside = u > 0.0f ? u < 1.0f ? u : 1.0f : 0.0f;
    return wrap == WRAP_CLAMP ? inside : wrap == WRAP_MIRROR ? twice : once;
}

inline float4 texel_at(__global const uint2 *texels, int at)
{
    const uint2 t = texels[at];
    return (float4)(t.x & 0xFFFF, t.x >> 16, t.y, 0.0f);
}

/* A picture's colour at a place, at the size of one of its levels: between four texels. */
inline float4 picture_at(const Material *m, __global const uint2 *texels, int level, float u, float v)
{
    int at = m->size.z, width = m->size.x, height = m->size.y;
    for (int k = 0; k < level; ++k) {
        at += width * height;
        width = width > 1 ? width / 2 : 1;
        height = height > 1 ? height / 2 : 1;
    }
    const float x = u * width - 0.5f, y = v * height - 0.5f;
    const int x0 = (int)floor(x), y0 = (int)floor(y);
    const float fx = x - x0, fy = y - y0;
    const int left = wrapped(x0, width, m->wrap.x), right = wrapped(x0 + 1, width, m->wrap.x);
    const int top = at + width * wrapped(y0, height, m->wrap.y), bottom = at + width * wrapped(y0 + 1, height, m->wrap.y);
    return (1.0f - fy) * ((1.0f - fx) * texel_at(texels, top + left) + fx * texel_at(texels, top + right))
         + fy * ((1.0f - fx) * texel_at(texels, bottom + left) + fx * texel_at(texels, bottom + right));
}

/* How far in uv a step of a pixel goes on a triangle's plane: `step` is the matrix's column of that pixel's axis, q the
   place's homogeneous one. */
inline float2 uv_step(const View *view, float4 step, float4 plane, float4 q, float4 b, float4 c, float square,
                      float4 uv_b, float4 uv_c)
{
    const float along = dot(plane, view->to_world[2]);
    const float4 dq = step - dot(plane, step) / along * view->to_world[2];
    float4 d = (dq - q * (dq.w / q.w)) / q.w;
    d.w = 0.0f;
    const float two = dot3(cross3(d, c), plane) / square, three = dot3(cross3(b, d), plane) / square;
    return two * uv_b.xy + three * uv_c.xy;
}

/* Base colour where a sample sees triangle t, at a place of the picture and a reversed depth.  A picture is looked up at the
   two sizes between which a texel is as large as the sample's share of the pixel. */
inline float4 base_color(const Paint *paint, const View *view, __global const float4 *positions, uint4 t, float x, float y, float e)
{
    const Material m = paint->materials[paint->n > 1 ? paint->material_of[t.w] : 0];
    if (!m.size.x)
        return m.color;
    const float4 q = view->to_world[0] * x + view->to_world[1] * y + view->to_world[2] * e + view->to_world[3];
    const float4 a = positions[t.x], b = positions[t.y] - a, c = positions[t.z] - a, p = (float4)(q.xyz / q.w, 0.0f);
    const float4 weights = barycentric(a, a + b, a + c, p);
    const float4 uv_a = paint->uv[t.x], uv_b = paint->uv[t.y] - uv_a, uv_c = paint->uv[t.z] - uv_a;
    const float2 uv = uv_a.xy + weights.y * uv_b.xy + weights.z * uv_c.xy;
    float4 plane = cross3(b, c);
    const float square = dot3(plane, plane);
    plane.w = -dot3(plane, a);
    const float2 size = (float2)(m.size.x, m.size.y);
    const float2 dx = size * uv_step(view, view->to_world[0], plane, q, b, c, square, uv_b, uv_c);
    const float2 dy = size * uv_step(view, view->to_world[1], plane, q, b, c, square, uv_b, uv_c);
    const float one = dx.x * dx.x + dx.y * dx.y, other = dy.x * dy.x + dy.y * dy.y;
    const float level = 0.5f * log2((one > other ? one : other) / view->size.z), most = m.size.w - 1.0f;
    const float within = level > 0.0f ? level < most ? level : most : 0.0f;   // also where it is no number
    const int low = (int)within, high = low + 1 < m.size.w ? low + 1 : low;
    const float u = folded(uv.x, m.wrap.x), v = folded(1.0f - uv.y, m.wrap.y);
    const float4 sharp = picture_at(&m, paint->texels, low, u, v);
    return m.color * (sharp + (within - low) * (picture_at(&m, paint->texels, high, u, v) - sharp));
}
