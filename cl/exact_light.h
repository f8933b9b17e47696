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
 *   a share below 0 is asked for at each place, and so are those of further lights; number of the type
 *   Where hair before lights is looked up in maps (deep.h) all of these shares are without it.
 */
typedef struct {
    float8 of[4];
} Row;

/* What is known of light that segments send: at places, see places.h, or what it depends on. */
typedef struct {
    __global const ulong *places;          // [segments, sources, FEW_PLACES]
    int sources;                           // lights, and one for a sky or for light from hair to hair
    __global const float *more;
    const View *view;
    Lighting lighting;
    __global const Lobes *lobes;           // see lobes.h
    __global const float4 *lobe_table;
    int shadowed;                          // 1: something stands before lights
    __global const float8 *ends;           // [segments] on the screen: each end's x, y, reversed depth, half width [pixels]
    Deeps deep;                            // the hair before lights, if there are maps of its pieces
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

/* The places of segment `number`, of all sources. */
INLINED __global const ulong *places_of(const Sent *known, uint number)
{
    return known->places + FEW_PLACES * known->sources * (size_t)number;
}

/* The row of `more` that a segment has, with MORE; 0 where each light is known at its places. */
INLINED ulong more_of(const Sent *known, uint number)
{
    return row_among(places_of(known, number), known->lighting.n);
}

/* Where a strand is seen in the middles x, y of pixels, which its place p is nearest to: so far aside as one of such a width
   [world] reaches beyond half a pixel; a thin one is p. */
INLINED lanes3 seen_beside(const View *view, lanes3 p, lanes width, lanes x, lanes y)
{
    const lanes4 c = by_columns(view->to_screen, p.x, p.y, p.z);
    const lanes room = 0.5f * (width - c.w / view->scale.x);
    const lanes_i wide = (room > 0.0f) & (c.w > 0.0f);
    if (!any_lane(wide))
        return p;
    const lanes4 q = by_columns(view->to_world, x, y, c.z / c.w);
    const lanes3 off = {q.x / q.w - p.x, q.y / q.w - p.y, q.z / q.w - p.z};
    const lanes far = full_root(dots(off, off));
    return chosen(wide, plus(p, scaled(off, far > room ? room / far : F(1.0f))), p);
}

#define FAINT 0.05f          // weight in its pixel up to which a piece is shaded by the grid of cells

/* Share of light i that hair lets through to places `at` of segments: single hairs, see deep.h, or all of them as if at random
   where pieces have little weight; x, y: the middles of their pixels. */
ONCE lanes share_deep(const Sent *sent, int i, const uint *numbers, lanes at, lanes weight, lanes x, lanes y, lanes_i on)
{
    if (!sent->deep.maps[i].size.x || !any_lane(on))
        return F(1.0f);
    const lanes_i look = on & (weight > FAINT);
    lanes start, end;
    for (int k = 0; k < LANES; ++k) {
        const uint haze = sent->deep.hazes[numbers[k] * (size_t)sent->lighting.n + i];
        LANE(start, k) = (float)(haze & 0xFFFF);
        LANE(end, k) = (float)(haze >> 16);
    }
    const lanes share = (start + at * (end - start)) * (1.0f / 65535.0f);
    if (!any_lane(look))
        return share;
    float8 axes[LANES];
    lanes c[8];
    for (int k = 0; k < LANES; ++k)
        axes[k] = sent->deep.axes[numbers[k]];
    columns_of(axes, c);
    const lanes3 start_of = {c[0], c[1], c[2]}, step = {c[4], c[5], c[6]};
    const lanes3 p = seen_beside(sent->view, plus(start_of, scaled(step, at)), c[7], x, y);
    const lanes through = through_deep(&sent->deep, i, look, p, c[3]);
    return look ? through : share;
}

/* Light from places `at` of segments, where lanes are `on`, of those lights of which no places are known; the other lanes are
   like one of these.  weight: in their pixels; x, y: the middles of these. */
INLINED lanes3 exact_light(const Sent *known, const uint *numbers, const Row *rows, lanes at, lanes weight,
                           lanes x, lanes y, lanes_i on)
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
    const Fibres fibres = {unit_lanes_or(t, first), color, c[11], c[15], c[19] == (float)HALF_VECTOR};
    const Looks looks = {known->lobes, known->lobe_table, TO(lanes_i, c[31]), c[19] == (float)CHIANG};
    lanes3 sent = {F(0.0f), F(0.0f), F(0.0f)};
    for (int i = 0; i < known->lighting.n; ++i) {
        const Light light = known->lighting.lights[i];
        lanes3 l;
        lanes_i here = on;
        for (int k = 0; k < LANES && known->lighting.n > 1; ++k)
            LANE_I(here, k) &= places_of(known, numbers[k])[FEW_PLACES * i] & MORE ? ON : 0;
        if (!any_lane(here))
            continue;
        const bool edged = light.position.w > 0.0f && light.cone.x > -1.0f;   // its cone ends somewhere
        lanes share = share_of_light(&light, edged ? seen_beside(known->view, p, c[3] + at * c[7], x, y) : p, &l);
        if (known->shadowed) {
            const lanes there = i == 0 ? c[27] : i == 1 ? c[29] : F(-1.0f);
            const lanes_i ask = here & (there < 0.0f) & (share > 0.0f);
            lanes through = there + at * (i == 0 ? c[28] : c[30]);
            if (any_lane(ask))
                through = ask ? share_along(known, i, start, step, n, c[3], c[7], c[23], at, ask) : through;
            share *= through;
        }
        if (known->deep.longest)
            share *= share_deep(known, i, numbers, at, weight, x, y, here & (share > 0.0f));
        const lanes3 one = fibre_lanes(&light, &fibres, &looks, l, v, disc_at(&light, p), share), none = {F(0.0f), F(0.0f), F(0.0f)};
        sent = known->lighting.n == 1 ? one : plus(sent, chosen(here, one, none));
    }
    return sent;
}

INLINED Row row_of(const Sent *known, uint number)
{
    __global const float8 *its = (__global const float8 *)known->more + 4 * (more_of(known, number) & ROW);
    const Row row = {{its[0], its[1], its[2], its[3]}};
    return row;
}

#if LANES == 1
/* Light that segment `number` sends to the eye from the place `at` of it, a piece of such a weight in its pixel,
   whose middle is x, y. */
INLINED float4 sent_by(const Sent *known, uint number, float at, float weight, float x, float y)
{
    __global const ulong *few = places_of(known, number);
    float4 sum = (float4)(0.0f);
    if (more_of(known, number)) {
        const Row row = row_of(known, number);
        const lanes3 light = exact_light(known, &number, &row, at, weight, x, y, 1);
        sum = (float4)(light.x, light.y, light.z, 0.0f);
        sum = sum > 0.0f ? sum : 0.0f;
    }
    for (int i = 0; i < known->sources; ++i, few += FEW_PLACES)
        if (!(few[0] & MORE)) {
            const bool looks = known->deep.longest && i < known->lighting.n;
            const float share = looks ? share_deep(known, i, &number, at, weight, x, y, 1) : 1.0f;
            sum += share * light_between(few, at);
        }
    return sum;
}
#endif

/* Steps of loops that the light of one piece may take. */
INLINED uint steps_of_light(const Sent *known)
{
    uint steps = 4 + 4 * known->lighting.n;
    for (int i = 0; i < known->lighting.n && known->shadowed; ++i) {
        const int side = 2 * known->lighting.shadows[i].body.y + 1;
        steps += 1 + (i < 2 ? 1 : 2) * (side * (side / STRIDE + 2) + LOOK);
        steps += known->deep.longest ? 9 * known->deep.longest + 3 : 0;
    }
    return steps;
}
