/*
 * How hair scatters light: one hair, or LANES of them side by side.  shade.cl, coverage.cl and march.cl use this, and
 * lanes.h before it.
 */
inline float sine(float cosine)
{
    const float square = 1.0f - cosine * cosine;
    return sqrt(square > 0.0f ? square : 0.0f);
}

/* Light from one fibre that looks as `shine` tells: t its tangent, l towards the light, v towards the eye.  Kajiya and Kay's
   own highlight is the cone of mirror directions; the report's takes the half vector, which has no value at l = -v. */
inline float4 fibre(float4 shine, float4 color, float4 t, float4 l, float4 v, float4 light)
{
    const float tl = dot3(t, l), tv = dot3(t, v);
    float mirror, bright = 0.0f;
    switch ((int)shine.w) {
    case HALF_VECTOR: {
        const float4 h = l + v;
        const float length = sqrt(dot3(h, h));
        mirror = length > 1e-6f ? sine(dot3(t, h) / length) : 0.0f;
        break;
    }
    default:   // KAJIYA_KAY
        mirror = sine(tl) * sine(tv) - tl * tv;
        mirror = mirror > 0.0f ? mirror : 0.0f;
    }
    /* Rounding may leave it above 1, of which a large exponent would make a light of its own. */
    if ((mirror - 1.0f) * shine.y > 1e-3f)
        mirror = 1.0f;
    /* mirror^exponent, left out where it is below exp(-16): a power costs more than all the rest here. */
    if ((1.0f - mirror) * shine.y < 16.0f)
        bright = shine.x * exp2(shine.y * log2(mirror));
    return light * (color * sine(tl) + bright) + light.w * color;
}

/* sqrt(1 - c^2) */
INLINED lanes sines(lanes c)
{
    return root(greater(1.0f - c * c, F(1e-12f)));
}

/* The same of shell fur, side by side, of light that is 1 and without the ambient: n the body's normal, slope the fur's
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
