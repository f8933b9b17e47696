/*
 * How a strand bends: what each joint would have of the segments beside it, and what its stiffness makes of that.  What
 * bends joint j, between segments j and j + 1, is a rest direction of segment j + 1 that hangs from the groomed direction of
 * segment j in the axes of the root, turned by the least rotation to where segment j points now.  motion.cl and newton.h use
 * this, and moving.h before it.
 */

/* A segment as it is now, and the joint at its end. */
typedef struct {
    lanes3 direction;   // unit
    lanes3 ghost;       // the groomed direction, which turned with the root alone
    lanes3 wants;       // where the next segment would point at rest
    lanes kink;         // (1 - cosine of the angle there at rest)²
    lanes now, length;  // [world] as it is, as it should be
} Segment;

/* Segment j, which ends in `end`; 0 is the clamp of the root, which is of no length. */
INLINED Segment segment_of(const Moving *m, int j, lanes3 start, lanes3 end)
{
    Segment s;
    s.ghost = from_axes(m->axes, three_of(m->groomed, m->stride, 3 * j));
    const lanes3 rest = from_axes(m->axes, kept(m, j, REST));
    if (j == 0) {
        s.direction = s.ghost;
        s.wants = rest;
        s.now = s.length = s.kink = F(0.0f);
        return s;
    }
    const lanes3 along = minus(end, start);
    s.now = exact_root(dots(along, along));
    s.length = row_of(m->lengths, m->stride, j - 1);
    s.direction = scaled(along, s.now > 0.0f ? 1.0f / s.now : F(0.0f));   // behind a tip is nothing
    s.wants = plus(s.direction, turned(s.ghost, s.direction, minus(rest, s.ghost)));
    const lanes bent = 1.0f - dots(s.ghost, rest);
    s.kink = bent * bent;
    return s;
}

/* Stiffness of the joint between a segment and the next, one over a length; that of the clamp is half a segment away. */
INLINED lanes stiffness(const Moving *m, lanes_i there, lanes length, lanes next)
{
    return there ? m->bend * 2.0f / (length + next) : F(0.0f);
}

/* Around point i, in which segment i ends. */
typedef struct {
    Segment before, here, behind;
    lanes by, by_behind, by_before;             // one over lengths
    lanes stiff_before, stiff, stiff_behind;    // of joints i - 1, i and i + 1
    lanes tension, tension_behind;
    lanes3 moment_behind;                       // what the gradient is made of, of segment i + 1, over its length
} Chain;

/* The bending force on the segment's direction, before it is divided by its length. */
INLINED lanes3 moment_of(const Chain *c)
{
    lanes3 moment = scaled(minus(c->before.wants, c->here.direction), c->stiff_before);
    const lanes3 torque = crosses(c->here.wants, c->behind.direction);
    moment = plus(moment, scaled(crosses(torque, c->here.direction), c->stiff));
    const lanes apart = greater(1.0f + dots(c->here.ghost, c->here.direction), F(0.1f));
    const lanes twist = c->stiff * dots(torque, c->here.direction) / apart;
    return minus(moment, scaled(crosses(c->here.ghost, c->here.direction), twist));
}

/* The rest directions with Kelvin's and Voigt's damping: a share of where the strand points now. */
INLINED void damp(const Moving *m, int most, const lanes3 *before, __global const float *rest, lanes share,
                  __global const float *places)
{
    const bool any = any_lane(share > 0.0f);
    lanes3 from = from_axes(before, three_of(m->groomed, m->stride, 0)), start = all_lanes((float4)(0.0f));
    for (int j = 0; j <= most; ++j) {
        lanes3 wants = three_of(rest, m->stride, 3 * j);
        if (any && j < most) {
            const lanes3 end = three_of(places, m->stride, 3 * (j + 1)), along = minus(end, start);
            const lanes square = dots(along, along);
            const lanes3 direction = scaled(along, square > 0.0f ? 1.0f / exact_root(square) : F(0.0f));
            const lanes3 ghost = from_axes(before, three_of(m->groomed, m->stride, 3 * j));
            const lanes3 now = in_axes(before, turned(from, ghost, direction));
            wants = plus(scaled(wants, 1.0f - share), scaled(now, share));
            from = direction;
            start = end;
        }
        keep(m, j, REST, wants);
    }
}
