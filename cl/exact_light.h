/*
 * Light that segments send to the eye from any place along them, LANES of them side by side: of those that change too much
 * for what places.h has.  coverage.cl uses this, and lanes.h, light.h, light_lanes.h, scatter.h and ribbon.h before it.
 *
 * What a segment is like stands in four rows of eight floats, as strand_light.cl leaves them: what it is at its start, and how
 * much of it changes to its end.
 *   x, y, z, width; changes of them        [world]
 *   tangent, strength of the highlight; change of the tangent, exponent
 *   r, g, b, model; changes of them, alpha
 *   normal of the body at its root; for two lights the share of each that gets through to its start, and the change of that;
 *   a share below 0 is asked for at each place, and so are those of further lights
 */
typedef struct {
    float8 of[4];
} Row;

/* light: of segments at places `at`, where lanes are `on`; the others are like one of these. */
INLINED lanes3 exact_light(const View *view, const Lighting *lighting, int shadowed, const Row *rows, lanes at, lanes_i on)
{
    float8 part[LANES];
    lanes c[32];
    for (int i = 0; i < 4; ++i) {
        for (int k = 0; k < LANES; ++k)
            part[k] = rows[k].of[i];
        columns_of(part, c + 8 * i);
    }
    const lanes3 p = {c[0] + at * c[4], c[1] + at * c[5], c[2] + at * c[6]}, n = {c[24], c[25], c[26]};
    const lanes3 start = {c[8], c[9], c[10]}, t = {c[8] + at * c[12], c[9] + at * c[13], c[10] + at * c[14]};
    const lanes3 color = {c[16] + at * c[20], c[17] + at * c[21], c[18] + at * c[22]}, v = towards_eye_lanes(view, p);
    const Fibres fibres = {unit_lanes_or(t, start), color, c[11], c[15], c[19] == (float)HALF_VECTOR};
    const lanes width = c[3] + at * c[7], alpha = c[23];
    lanes3 sent = {F(0.0f), F(0.0f), F(0.0f)};
    for (int i = 0; i < lighting->n; ++i) {
        const Light light = lighting->lights[i];
        lanes3 l;
        lanes share = share_of_light(&light, p, &l);
        if (shadowed) {
            const lanes known = i == 0 ? c[27] : i == 1 ? c[29] : F(-1.0f), step = i == 0 ? c[28] : c[30];
            const lanes_i ask = on & (known < 0.0f) & (share > 0.0f);
            lanes through = known + at * step;
            if (any_lane(ask)) {
                const Obstacles obstacles = obstacles_of(lighting, i);
                through = ask ? transmittances_at(&obstacles, ask, p, n, width, alpha) : through;
            }
            share *= through;
        }
        const lanes3 one = fibre_lanes(&light, &fibres, l, v, share);
        sent = i ? plus(sent, one) : one;
    }
    return sent;
}
