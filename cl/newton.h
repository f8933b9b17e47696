/*
 * One Newton step of strands side by side: its equations, whose blocks are of points and the two before each, are solved from the
 * tip to the root and back (docs/motion.md).  motion.cl uses this, and symmetric.h, bending.h, contact.h and felt.h before it.
 */

typedef struct {
    lanes3 x, y, z;
} Rows;

/* Of the equations of the next two points towards the root: what solving for the points behind has left there. */
typedef struct {
    Symmetric first, second;   // of the next point's own, and of the one after that
    Rows between;              // of the two
    lanes3 right, right_second;
} Left;

/* Rows of the transposed matrix times v. */
INLINED lanes3 across(const Rows *f, lanes3 v)
{
    return plus(plus(scaled(f->x, v.x), scaled(f->y, v.y)), scaled(f->z, v.z));
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
