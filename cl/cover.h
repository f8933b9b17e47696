/*
 * What one step of a ray in shell fur hides: hair that is seen within its footprint, or many hairs on average.  march.cl uses
 * this, and lanes.h before it.
 */

/* Products may be added unrounded here and among march's steps: no whole number hangs on them.  Elsewhere it costs. */
#pragma OPENCL FP_CONTRACT ON

/* As root, in fewer steps. */
INLINED lanes quick_root(lanes x)
{
    const lanes half_x = 0.5f * x;
    lanes y = AS_F(U(0x5F375A86u) - (AS_U(x) >> 1));
    y *= 1.5f - half_x * y * y;
    y *= 1.5f - half_x * y * y;
    return x * y;
}

/* Integral of smoothstep(0, 1, u) over u, and 1. */
INLINED lanes integral(lanes u)
{
    const lanes c = within(u, 0.0f, 1.0f);
    return c * c * c * (1.0f - 0.5f * c) + greater(u, F(1.0f));
}

/* The same, averaged over a footprint: all in units of the smoothstep and from its start.  The fur's height there goes
   from u - half_footprint to u + half_footprint, but beyond the tip `top` it goes down again, and up beyond the `fold`
   before the next hair; scale: 1 / (2 half_footprint). */
INLINED lanes cover(lanes u, lanes half_footprint, lanes top, lanes fold, lanes scale)
{
    const lanes low = u - half_footprint, high = u + half_footprint;
    const lanes_i over = high > top, under = low < fold;
    lanes sum;
    if (any_lane(over | under)) {
        const lanes a = integral(under ? 2.0f * fold - low : low), b = integral(over ? 2.0f * top - high : high);
        sum = (over ? 2.0f * integral(top) - b : b) + (under ? a - 2.0f * integral(fold) : -a);
    } else {
        sum = integral(high) - integral(low);
    }
    return within(sum * scale, 0.0f, 1.0f);
}

/* Share of light that many hairs let through on a way that goes as far as `aside` sideways, from where `before` is covered
   to where `now` is; going sideways by 1 enters hair `entered` times.  A hair's flanks are met from above, from the side or
   both: what rays go through is the mean over all directions that flanks face of max(0, down + side·cos), here by a
   parabola through its ends, 1 % too large at most.  mean: the share of the way after which what is lost is, on average. */
INLINED lanes kept_by_many(lanes before, lanes now, lanes entered, lanes aside, lanes *mean)
{
    const lanes a = lesser(before, F(0.999f)), b = lesser(now, F(0.999f));
    const lanes down = b > a ? log2_of((1.0f - a) / (1.0f - b)) : F(0.0f);
    const lanes side = 4.5323601f * entered * aside / (1.0f - 0.5f * (a + b));    // pi / log(2)
    const lanes_i some = side > 0.0f;
    const lanes share = some ? down / (some ? side : F(1.0f)) : F(2.0f);
    const lanes depth = lesser(share < 1.0f ? side * (0.31830989f + share * (0.5f + share * 0.18169011f)) : down, F(100.0f));
    const lanes kept = exp2_of(-depth);
    const lanes_i deep = depth > 0.015f;
    *mean = deep ? 1.4426950f / (deep ? depth : F(1.0f)) - kept / (deep ? 1.0f - kept : F(1.0f)) : F(0.5f);
    return kept;
}

#pragma OPENCL FP_CONTRACT OFF
