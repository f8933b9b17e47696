/*
 * How hair scatters light, LANES places side by side: that of strands and that of shells.  shade.cl, strand_light.cl and
 * march.cl use this, and lanes.h before it.
 */
#include "lobes.h"

/* What strands are like at LANES places. */
typedef struct {
    lanes3 tangent, color;
    lanes specular, exponent;
    lanes_i half_vector;                   // the model: 1, of a mask
} Fibres;

/* Light of a disc that lobes scatter: the mean of four of its points, which has its mean and its width. */
ONCE lanes3 lobes_of_disc(const Looks *looks, const Lit *lit, lanes disc, lanes3 part)
{
    const lanes3 none = {F(0.0f), F(0.0f), F(0.0f)}, up = {F(0.0f), F(1.0f), F(0.0f)}, aside = {F(1.0f), F(0.0f), F(0.0f)};
    const lanes3 x = unit(crosses(lit->l, chosen(positive(lit->l.y) < 0.9f, up, aside))), y = crosses(lit->l, x);
    lanes3 sum = none;
    for (int k = 0; k < 4; ++k) {
        const lanes far = disc * (k & 1 ? 0.5f : -0.5f), other = disc * (k & 2 ? 0.5f : -0.5f);
        const Lit one = {lit->t, lit->color, unit(plus(lit->l, plus(scaled(x, far), scaled(y, other)))), lit->v};
        sum = plus(sum, scaled(with_lobes(looks, &one, part), F(0.25f)));
    }
    return sum;
}

/* Light from fibres towards the eye at v of one light at l; disc: see `disc_at`; share: of its direct light. Kajiya and Kay's own highlight is the
   cone of mirror directions; the report's takes the half vector, which has no value at l = -v. Chiang's is in lobes.h. */
INLINED lanes3 fibre_lanes(const Light *light, const Fibres *here, const Looks *looks, lanes3 l, lanes3 v, lanes disc,
                           lanes share)
{
    const lanes tl = dots(here->tangent, l), tv = dots(here->tangent, v);
    lanes bright = full_root(1.0f - tl * tl), exponent = here->exponent, specular = here->specular;
    lanes mirror = bright * full_root(1.0f - tv * tv) - tl * tv, shine = F(0.0f);
    if (any_lane(here->half_vector)) {
        const lanes3 h = plus(l, v);
        const lanes square = dots(h, h), cosine = dots(here->tangent, h) / full_root(greater(square, F(1e-12f)));
        const lanes of_half = square > 1e-12f ? full_root(1.0f - cosine * cosine) : F(0.0f);
        mirror = here->half_vector ? of_half : mirror;
    }
    if (light->cone.y > 0.0f) {            // the mean over a disc of what is as wide as 1 / exponent and as 2 sine^2
        const lanes square = disc * disc, slant = (6.0f + square) / (6.0f + 4.0f * square);   // of its cosines' squares
        const lanes3 h = plus(l, v);
        const lanes along = here->half_vector ? square / greater(dots(h, h), F(1e-2f)) : square;
        const lanes wider = 1.0f / (1.0f + 0.25f * along * exponent);
        bright = full_root(greater(0.5f * (1.0f + slant) - (0.5f * (3.0f * slant - 1.0f)) * (tl * tl), F(0.0f)));
        specular *= full_root(wider);
        exponent *= wider;
    }
    mirror = greater(mirror, F(0.0f));
    /* Rounding may leave it above 1, of which a large exponent would make a light of its own. */
    mirror = (mirror - 1.0f) * exponent > 1e-3f ? F(1.0f) : mirror;
    /* mirror^exponent, left out where it is below exp(-16): a power costs more than all the rest here. */
    const lanes_i shines = (1.0f - mirror) * exponent < 16.0f;
    if (any_lane(shines)) {
        const lanes power = exp2_of(greater(exponent * log2_of(greater(mirror, F(1e-30f))), F(-100.0f)));
        shine = shines ? specular * power : F(0.0f);
    }
    const lanes3 c = here->color;
    const float4 direct = light->color;
    lanes3 part = {c.x * bright + shine, c.y * bright + shine, c.z * bright + shine};
    if (any_lane(looks->on)) {             // copies, so that nothing else must lie in memory
        const Lit lit = {here->tangent, c, l, v};
        part = light->cone.y > 0.0f ? lobes_of_disc(looks, &lit, disc, part) : with_lobes(looks, &lit, part);
    }
    const lanes3 sum = {direct.x * share * part.x + direct.w * c.x,
                        direct.y * share * part.y + direct.w * c.y,
                        direct.z * share * part.z + direct.w * c.z};
    return sum;
}

/* sqrt(1 - c^2) */
INLINED lanes sines(lanes c)
{
    return root(greater(1.0f - c * c, F(1e-12f)));
}

/* The same of shell fur, of light that is 1 and without the ambient: n the body's normal, slope the fur's
   gradient in the world.  Or the report's turned normals: those of the height field. */
INLINED lanes3 fibres(const Shells *shells, lanes_i on, lanes3 t, lanes3 n, lanes3 slope, lanes3 l, lanes3 v)
{
    lanes bright, mirror, shine = F(0.0f);
    const lanes tl = dots(t, l);
    switch ((int)shells->shine.w) {
    case TURNED: {
        const lanes3 turned = unit(plus(n, scaled(slope, F(-shells->size.x))));
        bright = greater(dots(turned, l), F(0.0f));
        mirror = bright > 0.0f ? dots(turned, unit(plus(l, v))) : F(0.0f);
        break;
    }
    case HALF_VECTOR: {
        const lanes3 middle = plus(l, v);
        bright = sines(tl);
        mirror = dots(middle, middle) > 1e-12f ? sines(dots(t, unit(middle))) : F(0.0f);
        break;
    }
    default:   // KAJIYA_KAY
        bright = sines(tl);
        mirror = bright * sines(dots(t, v)) - tl * dots(t, v);
    }
    mirror = within(mirror, 0.0f, 1.0f);
    const lanes_i shines = (1.0f - mirror) * shells->shine.y < 16.0f;   // elsewhere it is below exp(-16)
    if (shells->shine.x > 0.0f && any_lane(on & shines))
        shine = shines ? shells->shine.x * power(greater(mirror, F(1e-30f)), shells->shine.y) : F(0.0f);
    const lanes3 share = {shells->color.x * bright + shine, shells->color.y * bright + shine, shells->color.z * bright + shine};
    return share;
}
