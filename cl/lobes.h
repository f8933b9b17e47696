/*
 * Hair that scatters light in lobes, R, TT, TRT and the rest: Chiang, Bitterli, Tappan and Burley (EGSR 2016), the mean over
 * the strand's width, LANES places side by side.  Along the strand they are computed, around it looked up (chiang.cl).
 * scatter.h uses this.
 */

/* Hair at LANES places, whether it scatters light so. */
typedef struct {
    __global const Lobes *lobes;           // [types]
    __global const float4 *table;          // [cosines, angles, SHADES] of each lobe, where `lobes` say
    lanes_i kind, on;                      // which type; a mask of where it does
} Looks;

/* What one light does there: unit tangents, towards the tips, the hair's colour, towards the light and the eye. */
typedef struct {
    lanes3 t, color, l, v;
} Lit;

/* exp(-x) I0(x) for x >= 0, to 2e-7 of itself: Abramowitz and Stegun 9.8.1 and 9.8.2. */
INLINED lanes bessel(lanes x)
{
    const lanes small = x * (1.0f / 3.75f), t = small * small, u = 1.0f / greater(small, F(1.0f));
    const lanes series = 1.0f + t * (3.5156229f + t * (3.0899424f + t * (1.2067492f + t * (0.2659732f + t * (0.0360768f
        + t * 0.0045813f)))));
    const lanes far = 0.39894228f + u * (0.01328592f + u * (0.00225319f + u * (-0.00157565f + u * (0.00916281f
        + u * (-0.02057706f + u * (0.02635537f + u * (-0.01647633f + u * 0.00392377f)))))));
    const lanes near = series * exp2_of(greater(-1.44269504f * x, F(-100.0f)));
    return x < 3.75f ? near : far / full_root(greater(x, F(1.0f)));
}

/* The angle of a cosine, to 3e-8 (Abramowitz and Stegun 4.4.46). */
INLINED lanes angle_of(lanes c)
{
    const lanes x = lesser(positive(c), F(1.0f));
    const lanes a = full_root(1.0f - x) * (1.5707963f + x * (-0.2145988f + x * (0.08897899f + x * (-0.05017430f
        + x * (0.03089188f + x * (-0.01708813f + x * (0.00667009f - x * 0.00126249f)))))));
    return c < 0.0f ? 3.14159265f - a : a;
}

/* How much light a lobe sends along the strand, from the eye's and the light's sine and cosine to the plane across it: over
   the light's directions 1 in all. d'Eon et al. (EGSR 2011). */
INLINED lanes along_strand(float4 lobe, lanes sine_v, lanes cosine_v, lanes sine_l, lanes cosine_l)
{
    const lanes sine = sine_v * lobe.w + cosine_v * lobe.z;
    const lanes both = positive(cosine_v * lobe.w - sine_v * lobe.z) * cosine_l;
    const lanes power = 1.44269504f * lobe.x * (both - sine * sine_l - 1.0f);
    return lobe.y * bessel(lobe.x * both) * exp2_of(lesser(greater(power, F(-100.0f)), F(0.0f)));
}

/* Shades of a table that colours have: 0 black, SHADES - 1 white. */
INLINED lanes shade_of(lanes color, float fall)
{
    const lanes depth = log2_of(lesser(greater(color, F(1e-30f)), F(1.0f)));
    return exp2_of(greater(-fall * depth * depth, F(-100.0f))) * (SHADES - 1.0f);
}

/* What LANES places look up in a table: of each the four lobes along the strand, and where around it. */
typedef struct {
    lanes along[4], cosine, angle, shades[3];
} Sought;

/* Light of one place: r, g, b. */
INLINED float4 around_strand(const Sought *sought, int k, __global const float4 *table, int n_cosines, int n_angles)
{
    const float4 along = (float4)(LANE(sought->along[0], k), LANE(sought->along[1], k), LANE(sought->along[2], k),
                                  LANE(sought->along[3], k));
    const float x = LANE(sought->cosine, k), y = LANE(sought->angle, k);
    const int i = x < n_cosines - 1 ? (int)x : n_cosines - 2, j = y < n_angles - 1 ? (int)y : n_angles - 2;
    const float right = x - i, below = y - j;
    const float4 weights = (float4)((1.0f - right) * (1.0f - below), (1.0f - right) * below, right * (1.0f - below), right * below);
    __global const float4 *a = table + (size_t)(i * n_angles + j) * SHADES, *b = a + SHADES;
    __global const float4 *c = a + (size_t)n_angles * SHADES, *d = c + SHADES;
    float rgb[3];
    for (int channel = 0; channel < 3; ++channel) {
        const float z = LANE(sought->shades[channel], k);
        const int shade = z < SHADES - 1 ? (int)z : SHADES - 2;
        const float share = z - shade;
        const float4 dark = weights.x * a[shade] + weights.y * b[shade] + weights.z * c[shade] + weights.w * d[shade];
        const float4 pale = weights.x * a[shade + 1] + weights.y * b[shade + 1] + weights.z * c[shade + 1]
            + weights.w * d[shade + 1];
        const float4 lobes = along * (dark + share * (pale - dark));
        rgb[channel] = (lobes.x + lobes.y) + (lobes.z + lobes.w);
    }
    return (float4)(rgb[0], rgb[1], rgb[2], 0.0f);
}

/* The share of a light that hair sends to the eye where places are on; elsewhere `part`. A function of its own: other looks
   do without its registers. */
ONCE lanes3 with_lobes(const Looks *looks, const Lit *lit, lanes3 part)
{
    lanes_i on = looks->on, kind = looks->kind;
    const lanes3 t = lit->t, l = lit->l, v = lit->v;
    const lanes sine_v = within(dots(t, v), -1.0f, 1.0f), sine_l = within(dots(t, l), -1.0f, 1.0f);
    const lanes cosine_v = full_root(1.0f - sine_v * sine_v), cosine_l = full_root(1.0f - sine_l * sine_l);
    const lanes across = greater(cosine_v * cosine_l, F(1e-9f));
    const lanes angle = angle_of(within((dots(v, l) - sine_v * sine_l) / across, -1.0f, 1.0f));
    const lanes place = 0.5f * (cosine_v + full_root(cosine_v));
    #pragma unroll 1                       // what is unrolled is no faster, and slower where tables are large
    for (int first = 0; first < LANES; ++first) {
        if (!LANE_I(on, first))
            continue;
        const int type = LANE_I(kind, first);          // most of the time all are of one
        const Lobes lobes = looks->lobes[type];
        Sought sought;
        #pragma unroll 1
        for (int p = 0; p < 4; ++p)
            sought.along[p] = along_strand(lobes.along[p], sine_v, cosine_v, sine_l, cosine_l);
        sought.cosine = place * (lobes.table.y - 1.0f);
        sought.angle = angle * ((lobes.table.z - 1) / M_PI_F);
        sought.shades[0] = shade_of(lit->color.x, lobes.color.x);
        sought.shades[1] = shade_of(lit->color.y, lobes.color.x);
        sought.shades[2] = shade_of(lit->color.z, lobes.color.x);
        #pragma unroll 1
        for (int k = first; k < LANES; ++k) {
            if (!LANE_I(on, k) || LANE_I(kind, k) != type)
                continue;
            LANE_I(on, k) = 0;
            const float4 sent = M_PI_F * around_strand(&sought, k, looks->table + lobes.table.x, lobes.table.y, lobes.table.z);
            LANE(part.x, k) = sent.x;
            LANE(part.y, k) = sent.y;
            LANE(part.z, k) = sent.z;
        }
    }
    return part;
}
