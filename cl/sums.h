/* Light of a pixel in integers, which add up to the same sum in any order. */

#define ONE 4294967296.0f   // of light
#define MOST 1e8f           // light that a sum can hold

/* A share of light or coverage in 1/ONE.  Light is cut before it is weighted: the shares of a pixel add up to 1, so that no
   sum leaves its 64 bits. */
inline long4 in_integers(float share, float4 light)
{
    const float4 part = share * ONE * (light < MOST ? light : MOST);
    return (long4)((long)part.x, (long)part.y, (long)part.z, (long)part.w);
}

inline float4 in_floats(long4 sum)
{
    return convert_float4(sum) * (1.0f / ONE);
}
