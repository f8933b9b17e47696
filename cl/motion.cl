/*
 * One step of strands that move: implicit in time, inextensible, by two Newton steps, each solved directly along the strand
 * (docs/motion.md).  A strand's points are relative to its root; what it keeps is by strand, the fastest:
 * [points, 3, strands].  Points i = 1..n are free, segment i ends in point i.  What bends joint j, between segments j and
 * j + 1, is a rest direction of segment j + 1 that hangs from the groomed direction of segment j in the axes of the root,
 * turned by the least rotation to where segment j points now.
 */
#if LANES > STRANDS_BESIDE
#undef LANES
#define LANES STRANDS_BESIDE
#endif
#include "distance.h"

typedef struct {
    lanes xx, xy, xz, yy, yz, zz;
} Symmetric;

typedef struct {
    lanes3 x, y, z;
} Rows;

/* Of the equations of the next two points towards the root: what solving for the points behind has left there. */
typedef struct {
    Symmetric first, second;   // of the next point's own, and of the one after that
    Rows between;              // of the two
    lanes3 right, right_second;
} Left;

/* What is set aside for each point between the two ways along the strand: rows of the workspace.  contact.h has more. */
enum { PLACE = 0, FREE = 3, BASE = 6, REST = 9, SOLVED = 12, BY_ONE = 15, BY_TWO = 24, PULL = 30, TENSION = 37 };   // of ROWS_OF_POINT

/* Of strands side by side. */
typedef struct {
    size_t stride, work_stride;                 // from one row to the next [floats]
    __global const float *groomed, *lengths;    // from these strands on
    __global float *work;
    lanes_i n;                                  // segments
    lanes bend, air;                            // B / mass a length, with what damps it; 1 / air [1 / s]
    lanes he;                                   // [s] of implicit Euler's step
    lanes3 axes[3], before[3];                  // of the root, and a step ago
    lanes3 gravity;
    __global const float *winds;                // at points [world / s]
    __global const float *of_hair;              // what is felt of other hair, from these strands on, or 0
    bool feels;                                 // the body, of which the rest tells
    const Distances *grid;
    const Body *body;
    __global const float *values, *away, *places, *places_now;   // the last: where what a step begins with counts as being
    __global float *free, *pressed;
    lanes3 at, root_taken;                      // the root in the grid's frame; what it lacks of the body's way [world]
    lanes friction;
    float by_step;                              // [1 / s]
} Moving;

INLINED lanes row_of(__global const float *rows, size_t stride, int row)
{
    return *(__global const lanes *)(rows + row * stride);
}

INLINED lanes3 three_of(__global const float *rows, size_t stride, int row)
{
    const lanes3 v = {row_of(rows, stride, row), row_of(rows, stride, row + 1), row_of(rows, stride, row + 2)};
    return v;
}

INLINED void put_row(__global float *rows, size_t stride, int row, lanes v)
{
    *(__global lanes *)(rows + row * stride) = v;
}

INLINED void put_three(__global float *rows, size_t stride, int row, lanes3 v)
{
    put_row(rows, stride, row, v.x);
    put_row(rows, stride, row + 1, v.y);
    put_row(rows, stride, row + 2, v.z);
}

INLINED lanes3 kept(const Moving *m, int point, int row)
{
    return three_of(m->work, m->work_stride, point * ROWS_OF_POINT + row);
}

INLINED void keep(const Moving *m, int point, int row, lanes3 v)
{
    put_three(m->work, m->work_stride, point * ROWS_OF_POINT + row, v);
}

INLINED lanes3 in_axes(const lanes3 *axes, lanes3 v)
{
    const lanes3 parts = {dots(axes[0], v), dots(axes[1], v), dots(axes[2], v)};
    return parts;
}

INLINED lanes3 from_axes(const lanes3 *axes, lanes3 v)
{
    return plus(plus(scaled(axes[0], v.x), scaled(axes[1], v.y)), scaled(axes[2], v.z));
}

/* p turned by the least rotation that takes unit a to unit b. */
INLINED lanes3 turned(lanes3 a, lanes3 b, lanes3 p)
{
    const lanes3 axis = crosses(a, b), once = crosses(axis, p);
    const lanes d = 1.0f + dots(a, b);
    return plus(plus(p, once), scaled(crosses(axis, once), d > 1e-3f ? 1.0f / d : F(0.0f)));
}

INLINED lanes3 times(const Symmetric *a, lanes3 v)
{
    const lanes3 product = {a->xx * v.x + a->xy * v.y + a->xz * v.z, a->xy * v.x + a->yy * v.y + a->yz * v.z,
                            a->xz * v.x + a->yz * v.y + a->zz * v.z};
    return product;
}

INLINED Symmetric inverse(const Symmetric *a)
{
    const lanes c0 = a->yy * a->zz - a->yz * a->yz, c1 = a->xz * a->yz - a->xy * a->zz, c2 = a->xy * a->yz - a->xz * a->yy;
    const lanes by = 1.0f / (a->xx * c0 + a->xy * c1 + a->xz * c2);
    const Symmetric p = {c0 * by, c1 * by, c2 * by, (a->xx * a->zz - a->xz * a->xz) * by,
                         (a->xy * a->xz - a->xx * a->yz) * by, (a->xx * a->yy - a->xy * a->xy) * by};
    return p;
}

/* a += by · v vᵀ */
INLINED void add_square(Symmetric *a, lanes by, lanes3 v)
{
    const lanes3 w = scaled(v, by);
    a->xx += w.x * v.x;
    a->xy += w.x * v.y;
    a->xz += w.x * v.z;
    a->yy += w.y * v.y;
    a->yz += w.y * v.z;
    a->zz += w.z * v.z;
}

/* Rows of the transposed matrix times v. */
INLINED lanes3 across(const Rows *f, lanes3 v)
{
    return plus(plus(scaled(f->x, v.x), scaled(f->y, v.y)), scaled(f->z, v.z));
}

INLINED lanes3 masked(lanes_i on, lanes3 v)
{
    return chosen(on, v, all_lanes((float4)(0.0f)));
}

#include "contact.h"
#include "felt.h"

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

/* Solve for point i; what lies behind it has been solved for already. */
INLINED void solve(const Moving *m, int i, const Chain *c, Left *left, lanes3 *behind_moment)
{
    const lanes3 t = c->here.direction, u = c->behind.direction;
    const lanes_i inner = i < m->n;
    const lanes mass = 0.5f * (c->here.length + (inner ? c->behind.length : F(0.0f)));
    const lanes drag = m->air * mass, inertia = mass / (m->he * m->he) + drag / m->he;
    /* Second differences are not all of a joint that is bent at rest: what lies behind swings about the segment before,
     * and they do not feel it where both swing aside alike.  With this on the segment they are at least half of the true
     * second derivatives, however bent, so that Newton steps lead to rest and not away from it. */
    const lanes pull = greater(c->tension, F(0.0f)) * c->by + c->stiff * c->here.kink * c->by * c->by;
    const lanes pull_behind = greater(c->tension_behind, F(0.0f)) * c->by_behind
        + c->stiff_behind * c->behind.kink * c->by_behind * c->by_behind;
    const lanes both = c->by + c->by_behind;

    /* The block of the point, of it and the point before, and of it and the one before that (a number times one). */
    Symmetric a = left->first;
    lanes own = inertia + c->stiff_before * c->by * c->by + c->stiff * both * both
        + c->stiff_behind * c->by_behind * c->by_behind + pull + pull_behind;
    const lanes3 place = kept(m, i, PLACE);
    lanes3 b = left->right;
    add_felt(m, i, mass, minus(place, kept(m, i, BASE)), &own, &b);
    a.xx += own;
    a.yy += own;
    a.zz += own;
    add_square(&a, -pull, t);
    add_square(&a, -pull_behind, u);
    Rows f = left->between;
    const lanes beside = -c->stiff * both * c->by - c->stiff_before * c->by * (c->by_before + c->by) - pull;
    f.x = plus(f.x, scaled(t, pull * t.x));
    f.y = plus(f.y, scaled(t, pull * t.y));
    f.z = plus(f.z, scaled(t, pull * t.z));
    f.x.x += beside;
    f.y.y += beside;
    f.z.z += beside;
    const lanes g = c->stiff_before * c->by * c->by_before;

    const lanes3 moment = scaled(moment_of(c), c->by);
    b = plus(b, minus(moment, *behind_moment));
    *behind_moment = moment;
    b = minus(b, scaled(minus(place, kept(m, i, FREE)), mass / (m->he * m->he)));
    b = plus(b, scaled(m->gravity, mass));
    b = minus(b, scaled(minus(minus(place, kept(m, i, BASE)), scaled(three_of(m->winds, m->stride, 3 * i), m->he)), drag / m->he));
    if (m->feels)
        press(m, i, inertia, &a, &b);

    const Symmetric p = inverse(&a);
    const lanes3 pt = times(&p, t);
    const lanes by_s = 1.0f / dots(t, pt);
    const lanes3 q = scaled(pt, by_s);
    const Symmetric h = {p.xx - pt.x * q.x, p.xy - pt.x * q.y, p.xz - pt.x * q.z, p.yy - pt.y * q.y, p.yz - pt.y * q.z,
                         p.zz - pt.z * q.z};
    const lanes short_of = c->here.length - c->here.now;
    const lanes3 solved = plus(times(&h, b), scaled(q, short_of));
    const lanes3 z = plus(across(&f, q), scaled(t, by_s));
    const lanes known = dots(q, b) - short_of * by_s;

    /* Columns of Y = H F - q tᵀ. */
    const lanes3 f0 = {f.x.x, f.y.x, f.z.x}, f1 = {f.x.y, f.y.y, f.z.y}, f2 = {f.x.z, f.y.z, f.z.z};
    const lanes3 y0 = minus(times(&h, f0), scaled(q, t.x)), y1 = minus(times(&h, f1), scaled(q, t.y)),
                 y2 = minus(times(&h, f2), scaled(q, t.z));
    keep(m, i, SOLVED, solved);
    keep(m, i, BY_ONE, y0);
    keep(m, i, BY_ONE + 3, y1);
    keep(m, i, BY_ONE + 6, y2);
    const int at = i * ROWS_OF_POINT;
    const Symmetric gh = {g * h.xx, g * h.xy, g * h.xz, g * h.yy, g * h.yz, g * h.zz};
    put_row(m->work, m->work_stride, at + BY_TWO, gh.xx);
    put_row(m->work, m->work_stride, at + BY_TWO + 1, gh.xy);
    put_row(m->work, m->work_stride, at + BY_TWO + 2, gh.xz);
    put_row(m->work, m->work_stride, at + BY_TWO + 3, gh.yy);
    put_row(m->work, m->work_stride, at + BY_TWO + 4, gh.yz);
    put_row(m->work, m->work_stride, at + BY_TWO + 5, gh.zz);
    put_row(m->work, m->work_stride, at + PULL, known);
    keep(m, i, PULL + 1, z);
    keep(m, i, PULL + 4, scaled(q, g));

    left->first.xx = left->second.xx - dots(f0, y0) + t.x * z.x;
    left->first.xy = left->second.xy - dots(f0, y1) + t.x * z.y;
    left->first.xz = left->second.xz - dots(f0, y2) + t.x * z.z;
    left->first.yy = left->second.yy - dots(f1, y1) + t.y * z.y;
    left->first.yz = left->second.yz - dots(f1, y2) + t.y * z.z;
    left->first.zz = left->second.zz - dots(f2, y2) + t.z * z.z;
    left->right = plus(minus(left->right_second, across(&f, solved)), scaled(t, known));
    const Rows between = {minus(scaled(q, g * t.x), times(&gh, f0)), minus(scaled(q, g * t.y), times(&gh, f1)),
                          minus(scaled(q, g * t.z), times(&gh, f2))};
    left->between = between;
    left->second.xx = -g * gh.xx;
    left->second.xy = -g * gh.xy;
    left->second.xz = -g * gh.xz;
    left->second.yy = -g * gh.yy;
    left->second.yz = -g * gh.yz;
    left->second.zz = -g * gh.zz;
    left->right_second = scaled(solved, -g);
}

INLINED Symmetric symmetric_of(const Moving *m, int row)
{
    const Symmetric s = {
        row_of(m->work, m->work_stride, row), row_of(m->work, m->work_stride, row + 1),
        row_of(m->work, m->work_stride, row + 2), row_of(m->work, m->work_stride, row + 3),
        row_of(m->work, m->work_stride, row + 4), row_of(m->work, m->work_stride, row + 5)};
    return s;
}

INLINED Symmetric only_square(lanes_i on, const Symmetric *a)
{
    const lanes o = F(0.0f);
    const Symmetric s = {on ? a->xx : o, on ? a->xy : o, on ? a->xz : o, on ? a->yy : o, on ? a->yz : o, on ? a->zz : o};
    return s;
}

INLINED Left only(lanes_i on, const Left *a)
{
    const Left left = {only_square(on, &a->first), only_square(on, &a->second),
                       {masked(on, a->between.x), masked(on, a->between.y), masked(on, a->between.z)},
                       masked(on, a->right), masked(on, a->right_second)};
    return left;
}

/* One Newton step: from the tip to the root, back, and lengths made exact. */
INLINED void improve(const Moving *m, int most)
{
    const lanes3 none = all_lanes((float4)(0.0f));
    const Symmetric empty = {F(0.0f), F(0.0f), F(0.0f), F(0.0f), F(0.0f), F(0.0f)};
    const Left nothing = {empty, empty, {none, none, none}, none, none};
    Left left = nothing;
    Chain c;
    lanes3 end = kept(m, most, PLACE), start = most > 1 ? kept(m, most - 1, PLACE) : none, moment = none;
    c.here = segment_of(m, most, start, end);
    c.behind = c.here;
    c.by = 1.0f / c.here.length;
    c.by_behind = c.stiff = c.stiff_behind = c.tension_behind = F(0.0f);
    for (int i = most; i >= 1; --i) {
        end = start;
        start = i > 2 ? kept(m, i - 2, PLACE) : none;
        c.before = segment_of(m, i - 1, start, end);
        c.by_before = i > 1 ? 1.0f / c.before.length : F(0.0f);
        c.stiff_before = stiffness(m, I(ON), i > 1 ? c.before.length : c.here.length, i > 1 ? c.here.length : F(0.0f));
        c.tension = row_of(m->work, m->work_stride, i * ROWS_OF_POINT + TENSION);
        const lanes_i inner = i < m->n;
        c.by_behind = inner ? c.by_behind : F(0.0f);
        solve(m, i, &c, &left, &moment);
        const lanes_i there = i <= m->n;
        if (any_lane(!there)) {    // behind the tip of a shorter strand nothing is left
            left = only(there, &left);
            moment = masked(there, moment);
        }
        c.behind = c.here;
        c.here = c.before;
        c.by_behind = c.by;
        c.by = c.by_before;
        c.stiff_behind = c.stiff;
        c.stiff = there ? c.stiff_before : F(0.0f);
        c.tension_behind = there ? c.tension : F(0.0f);
    }
    lanes3 one = none, two = none, was = none, is = none;
    for (int i = 1; i <= most; ++i) {
        const int at = i * ROWS_OF_POINT;
        lanes3 way = kept(m, i, SOLVED);
        way = minus(way, plus(plus(scaled(kept(m, i, BY_ONE), one.x), scaled(kept(m, i, BY_ONE + 3), one.y)),
                              scaled(kept(m, i, BY_ONE + 6), one.z)));
        const Symmetric h = symmetric_of(m, at + BY_TWO);
        way = minus(way, times(&h, two));
        const lanes tension = row_of(m->work, m->work_stride, at + PULL) - dots(kept(m, i, PULL + 1), one)
            - dots(kept(m, i, PULL + 4), two);
        put_row(m->work, m->work_stride, at + TENSION, tension);
        if (m->feels)
            pressed_by(m, i, way);
        two = one;
        one = way;
        const lanes3 place = plus(kept(m, i, PLACE), way), along = minus(place, was);
        const lanes square = dots(along, along);
        was = place;
        is = plus(is, scaled(along, square > 1e-30f ? row_of(m->lengths, m->stride, i - 1) / exact_root(square) : F(0.0f)));
        keep(m, i, PLACE, masked(i <= m->n, is));
    }
}

/* Of a type of hair. */
INLINED void put_motion(Moving *m, lanes *damping, lanes *carried, uint lane, __global const MotionType *type)
{
    LANE(m->bend, lane) = type->hair.x;
    LANE(m->air, lane) = type->hair.y;
    LANE(*damping, lane) = type->hair.z;
    LANE(*carried, lane) = type->hair.w;
    LANE(m->friction, lane) = type->touch.x;
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

/* One step of strands side by side. */
ONCE void move(Moving *m, int most, lanes second, float step, lanes damping, lanes carried, __global const float *roots,
               __global const float *roots_before, __global const float *rest, __global float *places,
               __global float *places_before, __global float *speeds, __global float *speeds_before,
               __global float *tensions)
{
    for (int a = 0; a < 3; ++a) {
        m->axes[a] = three_of(roots, m->stride, 3 + 3 * a);
        m->before[a] = three_of(roots_before, m->stride, 3 + 3 * a);
    }
    const lanes3 *before = m->before;
    const lanes3 root = three_of(roots, m->stride, 0), gone = minus(root, three_of(roots_before, m->stride, 0));
    if (m->feels) {
        m->places = places;
        m->places_now = places_before;
        m->at = place_by_rows(m->body->to_grid, root);
        m->root_taken = minus(place_by_rows(m->body->carry, three_of(roots_before, m->stride, 0)), root);
        m->by_step = 1.0f / step;
        second = row_of(m->pressed, m->stride, 0) > 0.0f ? F(0.0f) : second;   // implicit Euler for what has touched it
    }
    m->he = step / (1.0f + 0.5f * second);
    const lanes stiffer = 1.0f + damping / m->he, third = second / 3.0f;
    damp(m, most, before, rest, damping / m->he / stiffer, places);
    m->bend *= stiffer;
    for (int i = 1; i <= most; ++i) {
        /* Points are relative to the root, which has gone on; a share of them goes with it. */
        const lanes3 p = three_of(places, m->stride, 3 * i), o = three_of(places_before, m->stride, 3 * i);
        const lanes3 v = three_of(speeds, m->stride, 3 * i), w = three_of(speeds_before, m->stride, 3 * i);
        const lanes3 with = from_axes(m->axes, in_axes(before, p));
        const lanes3 p_now = plus(scaled(minus(p, gone), 1.0f - carried), scaled(with, carried));
        const lanes3 o_now = plus(scaled(minus(o, gone), 1.0f - carried),
                                  scaled(from_axes(m->axes, in_axes(before, o)), carried));
        const lanes3 v_now = plus(scaled(v, 1.0f - carried), scaled(from_axes(m->axes, in_axes(before, v)), carried));
        const lanes3 w_now = plus(scaled(w, 1.0f - carried), scaled(from_axes(m->axes, in_axes(before, w)), carried));
        const lanes3 base = plus(p_now, scaled(minus(p_now, o_now), third));
        keep(m, i, BASE, base);
        keep(m, i, FREE, plus(base, scaled(plus(v_now, scaled(minus(v_now, w_now), third)), m->he)));
        keep(m, i, PLACE, with);
        put_row(m->work, m->work_stride, i * ROWS_OF_POINT + TENSION, row_of(tensions, m->stride, i));
        const lanes_i there = i <= m->n;
        put_three(places_before, m->stride, 3 * i, masked(there, p_now));
        put_three(speeds_before, m->stride, 3 * i, masked(there, v_now));
    }
    if (m->feels)
        recall(m, most);
    for (int newton = 0; newton < 2; ++newton) {
        if (m->feels && newton)
            meet(m, most);
        improve(m, most);
    }
    if (m->feels)
        turn_out(m, most);
    for (int i = 1; i <= most; ++i) {
        const lanes_i there = i <= m->n;
        const lanes3 place = kept(m, i, PLACE);
        put_three(places, m->stride, 3 * i, masked(there, place));
        const lanes3 speed = m->feels ? kept(m, i, SOLVED) : scaled(minus(place, kept(m, i, BASE)), 1.0f / m->he);
        put_three(speeds, m->stride, 3 * i, masked(there, speed));
        const lanes tension = row_of(m->work, m->work_stride, i * ROWS_OF_POINT + TENSION);
        put_row(tensions, m->stride, i, there ? tension : F(0.0f));
    }
}

/* What a CPU needs soon: rows lie so far apart that it does not foresee them. */
INLINED void ask_for(__global const float *rows, size_t stride, uint n)
{
#if LANES > 1
    for (uint row = 0; row < n; ++row)
        PREFETCH(rows + row * stride);
#endif
}

#if LANES > 1
#define BY_ITSELF ALONE BY_HAND
#else
#define BY_ITSELF
#endif

/* One step of all strands; a work-item does LANES of them at a time, one after another, in a workspace of its own. */
BY_ITSELF __kernel void advance(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n_items,                    // work-items in all
    const uint n,                          // strands
    const uint points,                     // of the longest
    const uint padded,                     // to whole LANES: from one row of what follows to the next
    __global const int *segments,          // [padded] of each strand; 0 where there is none
    __global const uint *type_of,          // [padded]
    __global const MotionType *types,      // [types]
    __global const float *groomed,         // [points, 3, padded] directions in the axes of the root; the first: its clamp's
    __global const float *rest,            // [points, 3, padded] of the next segment's directions at rest, in these
    __global const float *lengths,         // [points, padded] of segments [world]
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *roots_before,    // [4, 3, padded] a step ago
    const float seconds,                   // of the step
    const int order,                       // 2, or 1 where what came before is not known
    const int jumped,                      // 1: hair goes with its root
    const float4 gravity,                  // [world / s^2]
    __global const float *winds,           // [points, 3, padded] [world / s]
    const int feels_hair,                  // 1: what hair_grid.cl says of each point,
    __global const float *felt_of_hair,    // [points, 4, padded] acceleration [world / s^2], friction [1 / s]
    __global float *places,                // [points, 3, padded] relative to the root [world]
    __global float *places_before,         // [points, 3, padded]
    __global float *speeds,                // [points, 3, padded] [world / s]
    __global float *speeds_before,         // [points, 3, padded]
    __global float *tensions,              // [points, padded] of segments, by the points that they end in
    const int feels,                       // the body: 0, or else what follows is there
    const Distances grid,
    const Body body,
    __global const float *values,          // [nodes] distance from the body [world], below 0 inside
    __global const float *away,            // [points, padded] that a point keeps from it [world]
    __global float *free,                  // [points, padded] that it is from it, or less [world]
    __global float *pressed,               // [points, 3, padded] force of the contact over mass a length; 1 in the first
                                           // row: the strand has touched the body
    __global float *workspace)             // side by side: [work-items, points, ROWS_OF_POINT, LANES], else
                                           // [points, ROWS_OF_POINT, work-items]
{
    WORK_ITEM(item);
    /* A CPU's work-item takes strands that follow each other, and its workspace lies together: else each row would be a
       page of its own, and all of them one place in the cache.  On a GPU neighbours take neighbours. */
    const uint all = (n + LANES - 1) / LANES, run = (all + n_items - 1) / n_items;
    const uint past = LANES > 1 ? min((uint)(item + 1) * run, all) : all;
    Moving m;
    m.stride = padded;
    m.work_stride = LANES > 1 ? LANES : n_items;
    m.work = workspace + (LANES > 1 ? item * points * ROWS_OF_POINT * LANES : item);
    m.gravity = all_lanes(gravity);
    m.feels = feels;
    m.grid = &grid;
    m.body = &body;
    m.values = values;
    for (uint block = (uint)item * (LANES > 1 ? run : 1); block < past; block += LANES > 1 ? 1 : n_items) {
        const uint first = block * LANES, next = first + LANES;
        if (block + 1 < past) {
            ask_for(groomed + next, padded, 3 * points);
            ask_for(rest + next, padded, 3 * points);
            ask_for(lengths + next, padded, points);
            ask_for(winds + next, padded, 3 * points);
            ask_for(places + next, padded, 3 * points);
            ask_for(places_before + next, padded, 3 * points);
            ask_for(speeds + next, padded, 3 * points);
            ask_for(speeds_before + next, padded, 3 * points);
            ask_for(tensions + next, padded, points);
            if (feels) {
                ask_for(away + next, padded, points);
                ask_for(free + next, padded, points);
                ask_for(pressed + next, padded, 3 * points);
            }
            if (feels_hair)
                ask_for(felt_of_hair + next, padded, 4 * points);
        }
        m.groomed = groomed + first;
        m.lengths = lengths + first;
        m.away = away + first;
        m.free = free + first;
        m.pressed = pressed + first;
        m.winds = winds + first;
        m.of_hair = feels_hair ? felt_of_hair + first : 0;
        m.n = *(__global const lanes_i *)(segments + first);
        lanes damping = F(0.0f), carried = F(0.0f);
        m.bend = m.air = m.friction = F(0.0f);
        for (uint lane = 0; lane < LANES; ++lane)
            put_motion(&m, &damping, &carried, lane, &types[type_of[first + lane]]);
        const lanes n_segments = greater(TO(lanes, m.n), F(1.0f));
        m.bend *= 1.0f + 1.0f / (n_segments * n_segments);   // so that a bar of few bends as one of endlessly many
        carried = jumped ? F(1.0f) : carried;
        move(&m, most_lane(m.n), F(order == 2 ? 1.0f : 0.0f), seconds, damping, carried, roots + first,
             roots_before + first, rest + first, places + first, places_before + first, speeds + first,
             speeds_before + first, tensions + first);
    }
}

/* Strands as they were groomed are at rest: their directions, lengths, and where each segment would point without weight. */
__kernel void hang(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n,                          // strands
    const uint padded,
    __global const float4 *points,         // [points] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const MotionType *types,      // [types]
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    const float4 gravity,                  // [world / s^2]
    __global int *segments,                // [padded]
    __global uint *type_of,                // [padded]
    __global float *groomed,               // [points, 3, padded]
    __global float *rest,                  // [points, 3, padded]
    __global float *lengths,               // [points, padded]
    __global float *places,                // [points, 3, padded]
    __global float *places_before,         // [points, 3, padded] the same
    __global uint *too_soft)               // [strands] 1: it can't bear its weight as it was groomed
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    const int k = max((int)span.y - 1, 0);
    segments[i] = k;
    type_of[i] = (uint)strand_uv[i].z;
    const float bend = types[type_of[i]].hair.x * (1.0f + 1.0f / ((float)max(k, 1) * max(k, 1)));
    float4 axes[3], pull = (float4)(0.0f), reaction = (float4)(0.0f);
    for (int a = 0; a < 3; ++a)
        axes[a] = (float4)(roots[(3 + 3 * a) * (size_t)padded + i], roots[(4 + 3 * a) * (size_t)padded + i],
                           roots[(5 + 3 * a) * (size_t)padded + i], 0.0f);
    uint soft = 0;
    float next_length = 0.0f;
    for (int j = k; j >= 1; --j) {
        const float4 from = points[span.x + j - 1], along = points[span.x + j] - from, place = points[span.x + j] - points[span.x];
        const float size = sqrt(dot3(along, along));
        const float4 t = size > 0.0f ? along / size : axes[2];
        const float mass = 0.5f * (size + next_length);
        pull += mass * gravity;
        float4 before = t;                 // the clamp points as the first segment does
        float before_length = 0.0f;
        if (j > 1) {
            const float4 other = from - points[span.x + j - 2];
            before_length = sqrt(dot3(other, other));
            before = before_length > 0.0f ? other / before_length : axes[2];
        }
        const float stiff = j == 1 ? 2.0f * bend / size : 2.0f * bend / (before_length + size);
        float4 need = -size * pull - reaction;
        need -= dot3(need, t) * t;
        float square = dot3(need, need);   // of the sine that is asked for, times the stiffness
        if (square > 0.98f * stiff * stiff) {
            soft = 1;
            need = (float4)(0.0f);
        } else if (stiff > 0.0f)
            need /= stiff;
        square = dot3(need, need);
        const float4 wants = need + sqrt(1.0f - square) * t;
        reaction = stiff * cross3(cross3(wants, t), before);
        for (int a = 0; a < 3; ++a) {
            const size_t to = (size_t)(3 * (j - 1) + a) * padded + i, at = (size_t)(3 * j + a) * padded + i;
            rest[to] = dot3(axes[a], wants);
            groomed[at] = dot3(axes[a], t);
            if (j == 1)
                groomed[to] = dot3(axes[a], t);
            places[at] = places_before[at] = a == 0 ? place.x : a == 1 ? place.y : place.z;
        }
        lengths[(size_t)(j - 1) * padded + i] = size;
        next_length = size;
        if (!(size > 0.0f))
            segments[i] = 0;               // of no length: it stays as it is
    }
    /* What can't bear its weight falls: a clamp with all that it has would swing for ever. */
    for (int j = 0; soft && j < 3 * k; ++j)
        rest[(size_t)j * padded + i] = groomed[(size_t)(j + 3) * padded + i];
    too_soft[i] = soft;
}

/* How far points of strands as they were groomed stay away from the body: half of their width, or as near as they are. */
BY_HAND __kernel void stand_off(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint n,                          // strands
    const uint padded,
    const Distances grid,
    const Body body,
    __global const float *values,          // [nodes] distance from the body [world], below 0 inside
    __global const float4 *points,         // [points] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    __global float *away,                  // [points, padded] that a point keeps from it [world]
    __global float *free,                  // [points, padded] that it is from it [world]
    __global float *deepest)               // [padded] the least of these
{
    WORK_ITEM(block);
    const uint first = (uint)block * LANES;
    lanes least = F(grid.reach.x), width = F(0.0f);
    lanes_i count = I(0);
    for (uint lane = 0; lane < LANES && first + lane < n; ++lane)
        LANE_I(count, lane) = (int)spans[first + lane].y;
    const int most = most_lane(count);
    for (int k = 1; k < most; ++k) {
        lanes3 place = all_lanes((float4)(0.0f));
        for (uint lane = 0; lane < LANES && first + lane < n; ++lane)
            if (k < LANE_I(count, lane)) {
                const float4 p = points[spans[first + lane].x + k];
                put_lane(&place, lane, p);
                LANE(width, lane) = p.w;
            }
        const lanes value = near_at(&grid, values, I(ON), place_by_rows(body.to_grid, place)).value;
        least = k < count ? lesser(least, value) : least;
        put_row(free + first, padded, k, value);
        put_row(away + first, padded, k, lesser(0.5f * width, value - grid.reach.y * (1.0f / 128)));
    }
    put_row(deepest + first, padded, 0, least);
}

/* Where strands are now, as they are drawn. */
__kernel void place_points(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    __global const uint2 *spans,           // [strands] first point, points
    __global const float *roots,           // [4, 3, padded] place [world], three axes
    __global const float *places,          // [points, 3, padded] relative to the root [world]
    __global float *packed,                // [points, 3] x, y, z [world]
    __global float *normals)               // [strands, 3] unit, of the skin at the root
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    for (uint a = 0; a < 3; ++a) {
        const float root = roots[a * (size_t)padded + i];
        for (uint k = 0; k < span.y; ++k)
            packed[3 * (size_t)(span.x + k) + a] = root + (k ? places[(3 * (size_t)k + a) * padded + i] : 0.0f);
        normals[3 * i + a] = roots[(9 + a) * (size_t)padded + i];
    }
}

/* What places and speeds are before a step, for what lies within it. */
__kernel void remember(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float *places,          // [points, 3, padded]
    __global const float *speeds,
    __global float *places_then,           // likewise
    __global float *speeds_then)
{
    WORK_ITEM(i);
    places_then[i] = places[i];
    speeds_then[i] = speeds[i];
}

inline float4 column_of(__global const float *rows, size_t padded, size_t strand)
{
    return (float4)(rows[strand], rows[padded + strand], rows[2 * padded + strand], 0.0f);
}

/* Between two places and the speeds there, times the seconds between (Hermite). */
inline float4 curve_at(float share, float4 from, float4 from_speed, float4 to, float4 to_speed)
{
    const float left = 1.0f - share, square = share * share, left_square = left * left;
    return ((left_square * (1.0f + 2.0f * share)) * from + (left_square * share) * from_speed)
        + ((square * (1.0f + 2.0f * left)) * to - (square * left) * to_speed);
}

/* Parts of v along three axes, and back. */
inline float4 along_axes(const float4 *axes, float4 v)
{
    return (float4)(dot3(axes[0], v), dot3(axes[1], v), dot3(axes[2], v), 0.0f);
}

inline float4 of_axes(const float4 *axes, float4 v)
{
    return (v.x * axes[0] + v.y * axes[1]) + v.z * axes[2];
}

/* Where one strand was within a step, from places and speeds at both of its ends: in the world as far as it goes by its own
   laws, and in the axes of its root as far as that carries it.  Then lengths are made exact again. */
__kernel void between(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    const float share,                     // of the step, 0 to 1
    const float seconds,                   // of the step
    const int jumped,                      // 1: hair went with its root
    __global const uint2 *spans,           // [strands] first point, points
    __global const uint *type_of,          // [padded]
    __global const MotionType *types,
    __global const float *lengths,         // [points, padded] of segments [world]
    __global const float *roots_then,      // [4, 3, padded] at the step's beginning: place [world], three axes
    __global const float *roots_now,       // at its end
    __global const float *roots,           // and at the time that is asked for
    __global const float *places_then,     // [points, 3, padded] relative to the root [world]
    __global const float *speeds_then,     // [world / s]
    __global const float *places,
    __global const float *speeds,
    __global float *packed,                // [points, 3] x, y, z [world]
    __global float *normals)               // [strands, 3] unit, of the skin at the root
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    const float carried = jumped ? 1.0f : types[type_of[i]].hair.w;
    float4 then[3], now[3], here[3];
    for (int a = 0; a < 3; ++a) {
        const size_t row = (size_t)(3 + 3 * a) * padded;
        then[a] = column_of(roots_then + row, padded, i);
        now[a] = column_of(roots_now + row, padded, i);
        here[a] = column_of(roots + row, padded, i);
    }
    const float4 root = column_of(roots, padded, i);
    const float4 from = column_of(roots_then, padded, i), gone = column_of(roots_now, padded, i) - from, come = root - from;
    float4 before = (float4)(0.0f), place = before;    // of the point before: as the curves have it, and as lengths do
    for (uint k = 0; k < span.y; ++k) {
        float4 p = (float4)(0.0f);
        if (k) {
            const size_t row = 3 * (size_t)k * padded;
            const float4 a = column_of(places_then + row, padded, i), b = column_of(places + row, padded, i);
            const float4 v = seconds * column_of(speeds_then + row, padded, i), w = seconds * column_of(speeds + row, padded, i);
            const float4 free = curve_at(share, a, v, b + gone, w) - come;
            const float4 held = curve_at(share, along_axes(then, a), along_axes(then, v), along_axes(now, b), along_axes(now, w));
            p = (1.0f - carried) * free + carried * of_axes(here, held);
            const float size = lengths[(size_t)(k - 1) * padded + i];
            const float4 way = p - before;
            place = size > 0.0f ? place + size * unit_or(way, (float4)(0.0f)) : p;
        }
        before = p;
        const size_t at = 3 * (size_t)(span.x + k);
        packed[at] = root.x + place.x;
        packed[at + 1] = root.y + place.y;
        packed[at + 2] = root.z + place.z;
    }
    for (uint a = 0; a < 3; ++a)
        normals[3 * i + a] = roots[(9 + a) * (size_t)padded + i];
}

/* A mean of three corners of a face, between two poses. */
inline float4 on_face(float4 weights, float share, __global const float4 *before, __global const float4 *now)
{
    const float4 was = (weights.x * before[0] + weights.y * before[1]) + weights.z * before[2];
    const float4 is = (weights.x * now[0] + weights.y * now[1]) + weights.z * now[2];
    return was + share * (is - was);
}

/* Roots that stand on faces, between two poses: their axes turn with the skin.  They are a side of the face, as it lies
   along the skin, what is across both others, and the skin's normal. */
__kernel void place_roots(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint padded,
    __global const float4 *feet,           // [strands] -; number of the face, weights of its second and third corner
    __global const float4 *offsets,        // [strands] from there to the root, along the axes [world]
    __global const float4 *before,         // [faces, 3] corners of the pose before [world]
    __global const float4 *normals_before, // [faces, 3] of the skin there, unit
    __global const float4 *now,            // [faces, 3] of this pose
    __global const float4 *normals,        // [faces, 3]
    const float share,                     // 0: the pose before, 1: this one
    const Body body,                       // where it takes them besides
    __global float *roots)                 // [4, 3, padded] place [world], three axes
{
    WORK_ITEM(i);
    const float4 foot = feet[i], weights = (float4)(1.0f - foot.z - foot.w, foot.z, foot.w, 0.0f);
    const size_t face = 3 * (size_t)as_uint(foot.y);
    float4 place = on_face(weights, share, before + face, now + face), axes[3];
    const float4 side = on_face((float4)(-1.0f, 1.0f, 0.0f, 0.0f), share, before + face, now + face);
    const float4 other = on_face((float4)(-1.0f, 0.0f, 1.0f, 0.0f), share, before + face, now + face);
    const float4 flat = unit_or(cross3(side, other), (float4)(0.0f, 1.0f, 0.0f, 0.0f));
    axes[2] = unit_or(on_face(weights, share, normals_before + face, normals + face), flat);
    const float4 along = fabs(axes[2].x) < 0.6f ? (float4)(1.0f, 0.0f, 0.0f, 0.0f) : (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    axes[0] = unit_or(side - dot3(side, axes[2]) * axes[2], unit_or(along - dot3(along, axes[2]) * axes[2], along));
    axes[1] = cross3(axes[2], axes[0]);
    const float4 offset = offsets[i];
    place += (offset.x * axes[0] + offset.y * axes[1]) + offset.z * axes[2];
    for (uint row = 0; row < 4; ++row) {
        const float4 v = row ? axes[row - 1] : place;
        for (int a = 0; a < 3; ++a)
            roots[(3 * row + a) * (size_t)padded + i] = dot3(body.to_world[a], v) + (row ? 0.0f : body.to_world[a].w);
    }
}
