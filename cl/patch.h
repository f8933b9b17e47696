/*
 * A curved face: the PN triangle (Vlachos et al. 2001), see tessellate.cl.
 */
typedef struct {
    float4 p[3], n[3];       // corners: position, unit normal
    float4 side[3][2];       // control points at one and two thirds of side i
    float4 side_normal[3];   // mid-side control normals
    float4 middle;           // control point b111
} Patch;

inline void side_controls(float4 pa, float4 na, float4 pb, float4 nb, float4 out[2], float4 *normal)
{
    const float4 d = pb - pa, sum = na + nb;
    out[0] = (2.0f * pa + pb - dot3(d, na) * na) / 3.0f;
    out[1] = (2.0f * pb + pa + dot3(d, nb) * nb) / 3.0f;
    *normal = unit_or(sum - (2.0f * dot3(d, sum) / dot3(d, d)) * d, na);
}

inline Patch make_patch(const float4 p[3], const float4 n[3])
{
    Patch patch;
    float4 sides = (float4)(0.0f);
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3;
        patch.p[i] = p[i];
        patch.n[i] = n[i];
        side_controls(p[i], n[i], p[j], n[j], patch.side[i], &patch.side_normal[i]);
        sides += patch.side[i][0] + patch.side[i][1];
    }
    patch.middle = sides / 4.0f - (p[0] + p[1] + p[2]) / 6.0f;   // E + (E - V)/2
    return patch;
}

/* Position and normal at barycentric b inside the face. */
inline void inside(const Patch *q, float4 b, int curved, float4 *position, float4 *normal)
{
    *position = b.x * q->p[0] + b.y * q->p[1] + b.z * q->p[2];
    *normal = b.x * q->n[0] + b.y * q->n[1] + b.z * q->n[2];
    if (curved) {
        const float4 s = b * b, c = s * b;
        *position = c.x * q->p[0] + c.y * q->p[1] + c.z * q->p[2]
            + 3.0f * ((s.x * b.y) * q->side[0][0] + (b.x * s.y) * q->side[0][1]
                    + (s.y * b.z) * q->side[1][0] + (b.y * s.z) * q->side[1][1]
                    + (s.z * b.x) * q->side[2][0] + (b.z * s.x) * q->side[2][1])
            + (6.0f * b.x * b.y * b.z) * q->middle;
        *normal = s.x * q->n[0] + s.y * q->n[1] + s.z * q->n[2]
            + 2.0f * ((b.x * b.y) * q->side_normal[0] + (b.y * b.z) * q->side_normal[1] + (b.z * b.x) * q->side_normal[2]);
    }
    *normal = unit_or(*normal, q->n[0]);
}
