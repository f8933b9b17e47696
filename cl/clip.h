/* What of the space before a camera can be drawn: raster.cl and coverage.cl use this. */

inline bool within_guard(float4 c)
{
    return c.w > 0.0f && c.z >= 0.0f && c.z <= c.w && fabs(c.x) <= GUARD * c.w && fabs(c.y) <= GUARD * c.w;
}

/* How far clip-space c lies inside plane i: x, y within the guard band, depth between near and far. */
inline float inside(float4 c, int i)
{
    return i == 0 ? c.w - c.z : i == 1 ? c.z : i == 2 ? GUARD * c.w - c.x : i == 3 ? GUARD * c.w + c.x
         : i == 4 ? GUARD * c.w - c.y : GUARD * c.w + c.y;
}

/* Where the way between two ends meets a plane, from the nearer end: of two faces at an edge both get the same bits. */
inline float4 cut(float4 in, float in_by, float4 out, float out_by)
{
    return in_by > -out_by ? out + (in - out) * (out_by / (out_by - in_by)) : in + (out - in) * (in_by / (in_by - out_by));
}

/* Cut the way from a to b [clip space], with half its widths ha and hb, to what can be drawn; whether anything is left. */
inline bool clip(float4 *a, float4 *b, float *ha, float *hb)
{
    for (int i = 0; i < 6; ++i) {
        const float da = inside(*a, i), db = inside(*b, i);
        if (!(da >= 0.0f || db >= 0.0f))
            return false;
        if (da < 0.0f) {
            *ha = cut((float4)(*hb), db, (float4)(*ha), da).x;
            *a = cut(*b, db, *a, da);
        } else if (db < 0.0f) {
            *hb = cut((float4)(*ha), da, (float4)(*hb), db).x;
            *b = cut(*a, da, *b, db);
        }
    }
    return a->w > 0.0f && b->w > 0.0f;
}
