/*
 * Strands side by side that touch the body.  motion.cl and newton.h use this, and moving.h and symmetric.h before it.
 *
 * A point in contact feels a force along the body's normal, as hard as it takes, and one along the skin that holds it
 * where the body takes it, up to Coulomb's limit.  Both are what they were a step ago, plus what a stiff spring adds (an
 * augmented Lagrangian): so what rests is held by forces that no longer change, and nothing chatters.  After the Newton
 * steps what is still inside is turned out, segment by segment: the last word is always outside.
 */
#define HARD 10.0f        // a contact's spring over all else that holds a point, across the skin
#define GRIP 1.0f         // and along it
#define FAR_GAP 1e30f       // where no contact is possible
#define OUT 4               // times that a segment is turned out, at most

/* Rows of the workspace that a point in contact has besides (moving.h). */
enum { NORMAL = 38, GAP = 41, FORCE = 42, APPLIED = 45, SPRING = 48, HOLD = 49 };   // of ROWS_OF_POINT

/* A vector by the first three of each of some rows. */
INLINED lanes3 by_rows(const float4 *rows, lanes3 v)
{
    const lanes3 p = {rows[0].x * v.x + rows[0].y * v.y + rows[0].z * v.z,
                      rows[1].x * v.x + rows[1].y * v.y + rows[1].z * v.z,
                      rows[2].x * v.x + rows[2].y * v.y + rows[2].z * v.z};
    return p;
}

INLINED lanes3 place_by_rows(const float4 *rows, lanes3 v)
{
    const lanes3 p = by_rows(rows, v);
    const lanes3 q = {p.x + rows[0].w, p.y + rows[1].w, p.z + rows[2].w};
    return q;
}

/* How far the body is from a place relative to the root; the slope is its unit normal there [world]. */
INLINED Near look(const Moving *m, lanes_i asked, lanes3 place)
{
    const float4 *rows = m->body->to_grid;
    Near near = near_at(m->grid, m->values, asked, plus(m->at, by_rows(rows, place)));
    const lanes3 s = near.slope;
    const lanes3 n = {rows[0].x * s.x + rows[1].x * s.y + rows[2].x * s.z,
                      rows[0].y * s.x + rows[1].y * s.y + rows[2].y * s.z,
                      rows[0].z * s.x + rows[1].z * s.y + rows[2].z * s.z};
    const lanes square = dots(n, n);
    const lanes3 normal = scaled(n, 1.0f / exact_root(greater(square, F(1e-4f))));
    near.slope = chosen(square > 1e-4f, normal, m->axes[2]);
    return near;
}

/* How far a point must stay away from the body. */
INLINED lanes away_of(const Moving *m, int i)
{
    return row_of(m->away, m->stride, i);
}

/* Where the body takes what was at a point's place a step ago, relative to the root. */
INLINED lanes3 taken(const Moving *m, int i)
{
    return plus(by_rows(m->body->carry, three_of(m->places, m->stride, 3 * i)), m->root_taken);
}

/* A vector of a step ago, as the root's frame has turned since, or as the body has. */
INLINED lanes3 brought(const Moving *m, lanes3 v)
{
    return m->body->more.y > 0.0f ? from_axes(m->axes, in_axes(m->before, v)) : by_rows(m->body->carry, v);
}

/* Where friction holds a point: where its root takes it on a body that deforms, else where the body does. */
INLINED lanes3 held_at(const Moving *m, int i)
{
    const lanes3 from_root = brought(m, three_of(m->places, m->stride, 3 * i));
    return m->body->more.y > 0.0f ? from_root : plus(from_root, m->root_taken);
}

INLINED lanes gap_of(const Moving *m, int i)
{
    return row_of(m->work, m->work_stride, i * ROWS_OF_POINT + GAP);
}

INLINED void put_gap(const Moving *m, int i, lanes_i known, Near near)
{
    put_row(m->work, m->work_stride, i * ROWS_OF_POINT + GAP, known ? near.value - away_of(m, i) : F(FAR_GAP));
    keep(m, i, NORMAL, near.slope);
}

/* Contacts of the step before, at the places where a step begins. */
INLINED void recall(const Moving *m, int most)
{
    for (int i = 1; i <= most; ++i) {
        const lanes3 force = three_of(m->pressed, m->stride, 3 * i);
        const lanes_i held = force.x != 0.0f | force.y != 0.0f | force.z != 0.0f;
        if (any_lane(held)) {
            keep(m, i, FORCE, brought(m, force));
            put_gap(m, i, held, look(m, held, kept(m, i, PLACE)));
        } else
            put_row(m->work, m->work_stride, i * ROWS_OF_POINT + GAP, F(FAR_GAP));
    }
}

/* Between the Newton steps: what could have reached the body looks where it is now. */
INLINED void meet(const Moving *m, int most)
{
    for (int i = 1; i <= most; ++i) {
        const lanes3 place = kept(m, i, PLACE), way = minus(place, taken(m, i));
        const lanes_i held = gap_of(m, i) < FAR_GAP;
        const lanes left = row_of(m->free, m->stride, i) - away_of(m, i) - m->body->more.x;
        const lanes_i asked = (i <= m->n) & (held | (left <= 0.0f) | (dots(way, way) >= left * left));
        if (any_lane(asked)) {
            keep(m, i, FORCE, masked(held, kept(m, i, FORCE)));
            put_gap(m, i, asked, look(m, asked, place));
        }
    }
}

/* The contact of point i in its equations, whose diagonal is `own` without it. */
INLINED void press(const Moving *m, int i, lanes own, Symmetric *a, lanes3 *b)
{
    const lanes gap = gap_of(m, i);
    lanes_i in = gap < FAR_GAP;
    if (!any_lane(in))
        return;
    const lanes3 n = kept(m, i, NORMAL), last = kept(m, i, FORCE);
    const lanes before = dots(last, n), push = before - HARD * own * gap;
    in &= push > 0.0f;
    const lanes3 way = minus(kept(m, i, PLACE), held_at(m, i));
    const lanes3 along = minus(way, scaled(n, dots(way, n)));
    lanes hold = GRIP * own;
    lanes3 grip = minus(minus(last, scaled(n, before)), scaled(along, hold));
    const lanes limit = m->friction * (before > 0.0f ? push : -own * gap);
    const lanes wanted = exact_root(dots(grip, grip));
    const lanes_i slips = wanted > limit;
    const lanes by = slips ? limit / wanted : F(1.0f);
    hold = in ? hold * by : F(0.0f);
    const lanes spring = in ? HARD * own : F(0.0f);
    const lanes3 pull = scaled(grip, 1.0f / greater(wanted, F(1e-30f)));
    a->xx += hold;
    a->yy += hold;
    a->zz += hold;
    add_square(a, spring - hold, n);
    add_square(a, slips ? -hold : F(0.0f), pull);
    const lanes3 force = masked(in, plus(scaled(n, push), scaled(grip, by)));
    *b = plus(*b, force);
    keep(m, i, APPLIED, force);
    put_row(m->work, m->work_stride, i * ROWS_OF_POINT + SPRING, spring);
    put_row(m->work, m->work_stride, i * ROWS_OF_POINT + HOLD, slips ? -hold : hold);
}

/* The force that a contact has had in the end, when its point has gone so far in a Newton step. */
INLINED void pressed_by(const Moving *m, int i, lanes3 way)
{
    if (!any_lane(gap_of(m, i) < FAR_GAP))
        return;
    const lanes3 n = kept(m, i, NORMAL), force = kept(m, i, APPLIED);
    const lanes hold = row_of(m->work, m->work_stride, i * ROWS_OF_POINT + HOLD);
    const lanes spring = row_of(m->work, m->work_stride, i * ROWS_OF_POINT + SPRING);
    const lanes push = dots(force, n), gone = dots(way, n);
    lanes3 grip = minus(force, scaled(n, push)), along = minus(way, scaled(n, gone));
    const lanes square = dots(grip, grip);
    const lanes slipped = hold < 0.0f ? dots(grip, along) / greater(square, F(1e-30f)) : F(0.0f);
    along = minus(along, scaled(grip, slipped));
    grip = minus(grip, scaled(along, positive(hold)));
    const lanes now = push - spring * gone;
    const lanes most = m->friction * greater(now, F(0.0f)), wanted = exact_root(dots(grip, grip));
    grip = scaled(grip, wanted > most ? most / wanted : F(1.0f));
    keep(m, i, APPLIED, masked(gap_of(m, i) < FAR_GAP & now > 0.0f, plus(scaled(n, now), grip)));
}

/* What is turned about `start` so that it lies further along n by so much, as long as before. */
INLINED lanes3 turned_out(lanes3 start, lanes3 end, lanes length, lanes3 n, lanes lack)
{
    const lanes3 way = minus(end, start);
    const lanes up = dots(way, n), wants = lesser(up + lack, 0.9999f * length);
    const lanes3 flat = minus(way, scaled(n, up));
    const lanes square = greater(dots(flat, flat), F(1e-30f));
    const lanes by = full_root(length * length - wants * wants) / exact_root(square);
    return plus(start, plus(scaled(n, wants), scaled(flat, by)));
}

/* After the Newton steps, from root to tip: each segment is turned about its start until its end is out. */
INLINED void turn_out(const Moving *m, int most)
{
    lanes3 start = all_lanes((float4)(0.0f)), shift = start;
    lanes_i touched = I(0);
    for (int i = 1; i <= most; ++i) {
        const lanes3 solved = kept(m, i, PLACE), from = taken(m, i);
        lanes3 place = plus(solved, shift), speed = scaled(minus(solved, kept(m, i, BASE)), 1.0f / m->he);
        const lanes_i there = i <= m->n, held = gap_of(m, i) < FAR_GAP;
        const lanes away = away_of(m, i);
        const lanes3 way = minus(place, from);
        lanes free = row_of(m->free, m->stride, i) - m->body->more.x - exact_root(dots(way, way));
        lanes_i asked = there & (held | (free <= away)), pushed = I(0);
        for (int tries = 0; tries < OUT && any_lane(asked); ++tries) {
            const Near near = look(m, asked, place);
            const lanes lack = away - near.value;
            free = asked ? greater(near.value, tries == OUT - 1 ? away : near.value) : free;
            asked &= lack > 0.0f;
            const lanes3 out = turned_out(start, place, row_of(m->lengths, m->stride, i - 1), near.slope,
                                          lack * (1.0f + 0.01f * tries));
            place = chosen(asked, out, place);
            /* Pushed out is no speed gained: it is no longer that with which it came in. */
            const lanes3 gone = minus(held_at(m, i), three_of(m->places_now, m->stride, 3 * i));   // by the body alone
            const lanes inward = dots(minus(speed, scaled(gone, m->by_step)), near.slope);
            speed = minus(speed, scaled(near.slope, asked ? lesser(inward, F(0.0f)) : F(0.0f)));
            pushed |= asked;
        }
        shift = minus(place, solved);
        start = place;
        const lanes3 force = masked(there & held, kept(m, i, APPLIED));
        touched |= there & (pushed | (force.x != 0.0f) | (force.y != 0.0f) | (force.z != 0.0f));
        keep(m, i, PLACE, place);
        keep(m, i, SOLVED, speed);
        put_three(m->pressed, m->stride, 3 * i, force);
        put_row(m->free, m->stride, i, free);
    }
    put_row(m->pressed, m->stride, 0, touched ? F(1.0f) : F(0.0f));   // the root's own tells of the strand
}
