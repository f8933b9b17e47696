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

/* Ways on the screen. */
typedef struct {
    lanes x, y;
} Ways;

/* From a to b, of length 1; 0 where they are one. */
INLINED Ways ways_between(lanes ax, lanes ay, lanes bx, lanes by)
{
    const lanes x = bx - ax, y = by - ay, square = x * x + y * y;
    const lanes length = exact_root(square);
    const lanes_i apart = square > 1e-12f;
    const Ways ways = {apart ? x / length : F(0.0f), apart ? y / length : F(0.0f)};
    return ways;
}

/* How far the cuts at ends of segments are turned from square to them: tangents, of 45 degrees at most.  beyond: the ways of
   those which follow there; axis: along u; radius: half the width there. */
INLINED lanes turned(const Ways *way, const Ways *beyond, const Ways *axis, lanes radius)
{
    const lanes fade = radius < 2.0f * WIDE ? radius > WIDE ? radius / WIDE - 1.0f : F(0.0f) : F(1.0f);
    const lanes x = way->x + beyond->x, y = way->y + beyond->y, length = exact_root(x * x + y * y + 1e-12f);
    /* The cut is square to this. */
    const lanes tx = axis->x + fade * (x / length - axis->x), ty = axis->y + fade * (y / length - axis->y);
    const lanes over = way->x * ty - way->y * tx, under = way->x * tx + way->y * ty;
    return ((under > over) & (under > -over)) ? over / under : over < 0.0f ? F(-1.0f) : F(1.0f);
}

INLINED lanes_u in_steps(lanes lean, lanes radius)
{
    const lanes steps = within(lean / radius * LEAN, -32767.0f, 32767.0f);
    return AS_U(WHOLE(steps < 0.0f ? steps - 0.5f : steps + 0.5f)) & 0xFFFF;
}

/* How far both ends of segments lean, in steps of the larger half width: the first in the lower half.  c: the ends on the
   screen, as of a `Batch`; before, after: the ways of those which follow at each; whole_a, whole_b: where these are not
   clipped. */
INLINED lanes_u leans_of(const lanes *c, const Ways *before, lanes_i whole_a, const Ways *after, lanes_i whole_b)
{
    const Ways way = ways_between(c[0], c[1], c[4], c[5]);
    const lanes across = positive(c[4] - c[0]), down = positive(c[5] - c[1]);
    const lanes_i steep = across < down;
    const lanes along = steep ? way.y : way.x, forward = along < 0.0f ? F(-1.0f) : F(1.0f);
    const lanes upward = steep ? -forward : forward;
    const Ways axis = {steep ? F(0.0f) : forward, steep ? forward : F(0.0f)};
    const lanes most = 0.5f * (steep ? down : across), radius = greater(c[3], c[7]);
    lanes lean[2];
    for (int k = 0; k < 2; ++k) {
        const lanes its = k ? c[7] : c[3], straight = turned(&way, &way, &axis, its);
        const lanes bent = its * along * (turned(&way, k ? after : before, &axis, its) - straight);
        /* Bent within half its width it would lie on itself. */
        const lanes fits = bent > -most ? bent < most ? bent : most : -most;
        const lanes upper = upward * (its * ((steep ? way.x : -way.y) - along * straight) - fits);
        lean[k] = (k ? whole_b : whole_a) ? upper : F(0.0f);
    }
    const lanes mean = 0.5f * (lean[0] + lean[1]), apart = 0.5f * (lean[0] - lean[1]);
    const lanes kept = apart > -most ? apart < most ? apart : most : -most;     // nor do its two ends cross
    return in_steps(mean + kept, radius) | in_steps(mean - kept, radius) << 16;
}

/* Where a point is on the screen; false: not there, or where lines are clipped. */
INLINED bool seen_at(const View *view, float4 point, float2 *at)
{
    const float4 c = to_screen(view, (float4)(point.xyz, 1.0f));
    *at = (float2)(c.x, c.y) / c.w;
    return within_guard(c);
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
