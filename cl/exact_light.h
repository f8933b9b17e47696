/*
 * Light that segments send to the eye from any place along them, LANES of them side by side: of those that change too much
 * for what places.h has.  coverage.cl uses this, and lanes.h, light.h, light_lanes.h, scatter.h and ribbon.h before it.
 *
 * What a segment is like stands in four rows of eight floats, as strand_light.cl leaves them: what it is at its start, and how
 * much of it changes to its end.
 *   x, y, z, width; changes of them        [world]
 *   tangent, strength of the highlight; change of the tangent, exponent
 *   r, g, b, model | number of the type << MODEL_BITS; changes of them, alpha
 *   normal of the body at its root; for two lights the share of each that gets through to its start, and the change of that;
 *   a share below 0 is asked for at each place, and so are those of further lights; light of a sky, see `packed_sky`
 */
typedef struct {
    float8 of[4];
} Row;

/* What is known of light that segments send: at places, see places.h, or what it depends on. */
typedef struct {
    __global const ulong *places;
    __global const float *more;
    const View *view;
    Lighting lighting;
    __global const Lobes *lobes;           // see lobes.h
    __global const float4 *lobe_table;
    int shadowed;                          // 1: something stands before lights
    int is_scattered;                      // 1: light comes from hair to hair too
    __global const float8 *scattered;      // what each sends of it at its start and its end, if so
} Sent;

/* Share of light i that gets through to places of segments, from p to p + step; of lights of which no row tells. */
INLINED lanes share_along(const Sent *sent, int i, lanes3 p, lanes3 step, lanes3 n, lanes width, lanes width_step, lanes alpha,
                          lanes at, lanes_i on)
{
    const Obstacles obstacles = obstacles_of(&sent->lighting, i);
    const lanes_i few = on & (cells_crossed(&obstacles, p, step) <= CELLS), many = on & (few == 0);
    lanes share = F(0.0f);
    if (any_lane(many))
        share = transmittances_at(&obstacles, many, plus(p, scaled(step, at)), n, width + at * width_step, alpha);
    if (any_lane(few)) {
        const lanes a = transmittances_at(&obstacles, few, p, n, width, alpha);
        const lanes b = transmittances_at(&obstacles, few, plus(p, step), n, width + width_step, alpha);
        share = few ? a + at * (b - a) : share;
    }
    return share;
}

/* Light from places `at` of segments, where lanes are `on`; the others are like one of these. */
INLINED lanes3 exact_light(const Sent *known, const Row *rows, lanes at, lanes_i on)
{
    float8 part[LANES];
    lanes c[32];
    for (int i = 0; i < 4; ++i) {
        for (int k = 0; k < LANES; ++k)
            part[k] = rows[k].of[i];
        columns_of(part, c + 8 * i);
    }
    const lanes3 start = {c[0], c[1], c[2]}, step = {c[4], c[5], c[6]}, p = plus(start, scaled(step, at)), n = {c[24], c[25], c[26]};
    const lanes3 first = {c[8], c[9], c[10]}, t = {c[8] + at * c[12], c[9] + at * c[13], c[10] + at * c[14]};
    const lanes3 color = {c[16] + at * c[20], c[17] + at * c[21], c[18] + at * c[22]}, v = towards_eye_lanes(known->view, p);
    const lanes_i kind = TO(lanes_i, c[19]), model = kind & (1 << MODEL_BITS) - 1;
    const Fibres fibres = {unit_lanes_or(t, first), color, c[11], c[15], model == HALF_VECTOR};
    const Looks looks = {known->lobes, known->lobe_table, kind >> MODEL_BITS, model == CHIANG};
    lanes3 sent = {F(0.0f), F(0.0f), F(0.0f)};
    for (int i = 0; i < known->lighting.n; ++i) {
        const Light light = known->lighting.lights[i];
        lanes3 l;
        lanes share = share_of_light(&light, p, &l);
        if (known->shadowed) {
            const lanes there = i == 0 ? c[27] : i == 1 ? c[29] : F(-1.0f);
            const lanes_i ask = on & (there < 0.0f) & (share > 0.0f);
            lanes through = there + at * (i == 0 ? c[28] : c[30]);
            if (any_lane(ask))
                through = ask ? share_along(known, i, start, step, n, c[3], c[7], c[23], at, ask) : through;
            share *= through;
        }
        const lanes3 one = fibre_lanes(&light, &fibres, &looks, l, v, share);
        sent = i ? plus(sent, one) : one;
    }
    const lanes_u sky = AS_U(c[31]);
    if (any_lane(sky != 0u)) {
        const lanes scale = AS_F(sky & 0x7F800000u) * (1.0f / 256);
        sent.x += color.x * scale * TO(lanes, sky & 255u);
        sent.y += color.y * scale * TO(lanes, sky >> 8 & 255u);
        sent.z += color.z * scale * 2.0f * TO(lanes, sky >> 16 & 127u);
    }
    return sent;
}

/* Light that came from hair to hair, which segment `number` sends on from the place `at` of it. */
INLINED float4 scattered_along(const Sent *known, uint number, float at)
{
    const float8 ends = known->scattered[number];
    return ends.lo + at * (ends.hi - ends.lo);
}

INLINED Row row_of(const Sent *known, uint number)
{
    __global const float8 *its = (__global const float8 *)known->more + 4 * (known->places[FEW_PLACES * (size_t)number] & ROW);
    const Row row = {{its[0], its[1], its[2], its[3]}};
    return row;
}

#if LANES == 1
/* Light that segment `number` sends to the eye from the place `at` of it. */
INLINED float4 sent_by(const Sent *known, uint number, float at)
{
    __global const ulong *few = known->places + FEW_PLACES * (size_t)number;
    if (!(few[0] & MORE))
        return light_between(few, at);
    const Row row = row_of(known, number);
    const lanes3 light = exact_light(known, &row, at, 1);
    const float4 sent = (float4)(light.x, light.y, light.z, 0.0f);
    return known->is_scattered ? sent + scattered_along(known, number, at) : sent;
}
#endif

/* Steps of loops that the light of one piece may take. */
INLINED uint steps_of_light(const Sent *known)
{
    uint steps = 4;
    for (int i = 0; i < known->lighting.n && known->shadowed; ++i) {
        const int side = 2 * known->lighting.shadows[i].body.y + 1;
        steps += 1 + (i < 2 ? 1 : 2) * side * (side / STRIDE + 2);
    }
    return steps;
}
