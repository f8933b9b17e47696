/*
 * How wide strands end and bend.  A thin segment's ends are cut along its shorter axis v, so that each column of pixels has
 * two heights alone.  Where a strand is wider than 2 WIDE they are cut square to it where it begins and ends, and where it bends
 * by the bisector, so that neighbours meet: no gap, and nothing is covered twice.  Up to 4 WIDE the cut turns from the one to
 * the other.  It goes through the point in any case: the area stays length times width.
 *
 * A cut leans: its upper corner, of greater v, lies so far beyond the point along u, and the lower one as far before it.
 * ribbon.h uses this.
 */
#define WIDE 0.5f                    // half a width [pixels] up to which nothing leans
#define LEAN 21845.0f                // steps of a lean in half a width: one and a half of these fit 16 bits

/* From a to b, of length 1; 0 where they are one. */
INLINED float2 way_between(float2 a, float2 b)
{
    const float2 way = b - a;
    const float square = way.x * way.x + way.y * way.y;
    return square > 1e-12f ? way / sqrt(square) : (float2)(0.0f);
}

/* How far the cut at an end of a segment is turned from square to it: a tangent, of 45 degrees at most.  way: the segment's;
   beyond: that of the one which follows there; axis: along u; radius: half the width there. */
INLINED float turned(float2 way, float2 beyond, float2 axis, float radius)
{
    const float fade = radius < 2.0f * WIDE ? radius > WIDE ? radius / WIDE - 1.0f : 0.0f : 1.0f;
    const float2 bend = way + beyond, middle = bend / sqrt(bend.x * bend.x + bend.y * bend.y + 1e-12f);
    const float2 through = axis + fade * (middle - axis);       // the cut is square to this
    const float over = way.x * through.y - way.y * through.x, under = way.x * through.x + way.y * through.y;
    return under > over && under > -over ? over / under : over < 0.0f ? -1.0f : 1.0f;
}

INLINED uint in_steps(float lean, float radius)
{
    const float x = lean / radius * LEAN, steps = x > -32767.0f ? x < 32767.0f ? x : 32767.0f : -32767.0f;
    return (uint)(int)(steps < 0.0f ? steps - 0.5f : steps + 0.5f) & 0xFFFF;
}

/* How far both ends of a segment lean, in steps of the larger half width: the first in the lower half.  ends: on the screen;
   beyond: the ways of those which follow there; whole: that these are not clipped. */
INLINED uint leans_of(float8 ends, const float2 *beyond, const bool *whole)
{
    const float2 a = (float2)(ends.s0, ends.s1), b = (float2)(ends.s4, ends.s5), way = way_between(a, b);
    const bool steep = fabs(b.x - a.x) < fabs(b.y - a.y);
    const float along = steep ? way.y : way.x, forward = along < 0.0f ? -1.0f : 1.0f, upward = steep ? -forward : forward;
    const float2 axis = steep ? (float2)(0.0f, forward) : (float2)(forward, 0.0f);
    const float length = steep ? fabs(b.y - a.y) : fabs(b.x - a.x), radius = ends.s3 > ends.s7 ? ends.s3 : ends.s7;
    float lean[2];
    for (int k = 0; k < 2; ++k) {
        const float its = k ? ends.s7 : ends.s3, straight = turned(way, way, axis, its);
        const float bent = its * along * (turned(way, beyond[k], axis, its) - straight), most = 0.5f * length;
        /* Bent within half its width it would lie on itself. */
        const float fits = bent > -most ? bent < most ? bent : most : -most;
        lean[k] = whole[k] ? upward * (its * ((steep ? way.x : -way.y) - along * straight) - fits) : 0.0f;
    }
    const float mean = 0.5f * (lean[0] + lean[1]), apart = 0.5f * (lean[0] - lean[1]), most = 0.5f * length;
    const float kept = apart > -most ? apart < most ? apart : most : -most;     // nor do its two ends cross
    return in_steps(mean + kept, radius) | in_steps(mean - kept, radius) << 16;
}

/* Where a point is on the screen; false: not there, or where lines are clipped. */
INLINED bool seen_at(const View *view, float4 point, float2 *at)
{
    const float4 c = to_screen(view, (float4)(point.xyz, 1.0f));
    *at = (float2)(c.x, c.y) / c.w;
    return within_guard(c);
}

/* How far the segment from point i to i + 1 leans, of a strand of the points from `first` to `last`; at clipped ones not. */
ONCE uint leans_at(const View *view, __global const float4 *points, uint first, uint last, uint i, float8 ends)
{
    const float2 a = (float2)(ends.s0, ends.s1), b = (float2)(ends.s4, ends.s5);
    float2 beyond[2] = {(float2)(0.0f), (float2)(0.0f)}, at;
    bool whole[2] = {true, true};
    if (i > first) {
        whole[0] = seen_at(view, points[i - 1], &at);
        beyond[0] = way_between(at, a);
    }
    if (i + 1 < last) {
        whole[1] = seen_at(view, points[i + 2], &at);
        beyond[1] = way_between(b, at);
    }
    return leans_of(ends, beyond, whole);
}

/* Four corners in order around a ribbon's segment: along u, and how far above its middle. */
typedef struct {
    float u[4], above[4];
} Corners;

/* From its end of lesser u on: its length along u, half its width along v and how far its ends lean. */
INLINED Corners corners_of(float u, float length, float2 radius, float2 lean)
{
    const Corners c = {{u + lean.x, u + length + lean.y, u + length - lean.y, u - lean.x},
                       {radius.x, radius.y, -radius.y, -radius.x}};
    return c;
}

/* What one side of a ribbon has in columns. */
typedef struct {
    lanes along, from, to;           // its length, below 0 where it leads back; the places along u between which it lies
    lanes above_from, above_to;      // how far it is there above the middle
} Side;

/* Side i of a ribbon in columns from u to `until`. */
INLINED Side side_in(const Corners *c, int i, lanes u, lanes until)
{
    const int k = (i + 1) % 4;
    const float p = c->u[i], q = c->u[k], low = p < q ? p : q, high = p < q ? q : p, way = q - p;
    const float rise = high > low ? (c->above[k] - c->above[i]) / way : 0.0f;
    const lanes from = lesser(greater(u, F(low)), F(high)), to = lesser(greater(until, F(low)), F(high));
    const Side side = {way < 0.0f ? from - to : to - from, from, to, c->above[i] + rise * (from - p), c->above[i] + rise * (to - p)};
    return side;
}
