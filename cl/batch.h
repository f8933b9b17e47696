/*
 * LANES segments of a strand side by side on the screen: where their ends are, which tiles they may touch, how far they lean.
 * ribbon.h uses this, and outline.h before it.
 */
#if LANES == 8
/* Eight rows of eight numbers -> its columns. */
INLINED void transposed(const float8 *r, float8 *m)
{
    const float8 a0 = (float8)(r[0].s0, r[1].s0, r[0].s1, r[1].s1, r[0].s4, r[1].s4, r[0].s5, r[1].s5);
    const float8 a1 = (float8)(r[0].s2, r[1].s2, r[0].s3, r[1].s3, r[0].s6, r[1].s6, r[0].s7, r[1].s7);
    const float8 a2 = (float8)(r[2].s0, r[3].s0, r[2].s1, r[3].s1, r[2].s4, r[3].s4, r[2].s5, r[3].s5);
    const float8 a3 = (float8)(r[2].s2, r[3].s2, r[2].s3, r[3].s3, r[2].s6, r[3].s6, r[2].s7, r[3].s7);
    const float8 a4 = (float8)(r[4].s0, r[5].s0, r[4].s1, r[5].s1, r[4].s4, r[5].s4, r[4].s5, r[5].s5);
    const float8 a5 = (float8)(r[4].s2, r[5].s2, r[4].s3, r[5].s3, r[4].s6, r[5].s6, r[4].s7, r[5].s7);
    const float8 a6 = (float8)(r[6].s0, r[7].s0, r[6].s1, r[7].s1, r[6].s4, r[7].s4, r[6].s5, r[7].s5);
    const float8 a7 = (float8)(r[6].s2, r[7].s2, r[6].s3, r[7].s3, r[6].s6, r[7].s6, r[6].s7, r[7].s7);
    const float8 b0 = (float8)(a0.s01, a2.s01, a0.s45, a2.s45), b1 = (float8)(a0.s23, a2.s23, a0.s67, a2.s67);
    const float8 b2 = (float8)(a1.s01, a3.s01, a1.s45, a3.s45), b3 = (float8)(a1.s23, a3.s23, a1.s67, a3.s67);
    const float8 b4 = (float8)(a4.s01, a6.s01, a4.s45, a6.s45), b5 = (float8)(a4.s23, a6.s23, a4.s67, a6.s67);
    const float8 b6 = (float8)(a5.s01, a7.s01, a5.s45, a7.s45), b7 = (float8)(a5.s23, a7.s23, a5.s67, a7.s67);
    m[0] = (float8)(b0.lo, b4.lo);
    m[1] = (float8)(b1.lo, b5.lo);
    m[2] = (float8)(b2.lo, b6.lo);
    m[3] = (float8)(b3.lo, b7.lo);
    m[4] = (float8)(b0.hi, b4.hi);
    m[5] = (float8)(b1.hi, b5.hi);
    m[6] = (float8)(b2.hi, b6.hi);
    m[7] = (float8)(b3.hi, b7.hi);
}
#endif

/* Two points of each of LANES segments, or ends on the screen: rows -> their eight numbers, and back. */
INLINED void columns_of(const float8 *rows, lanes *columns)
{
#if LANES == 1
    const float8 r = rows[0];
    columns[0] = r.s0;
    columns[1] = r.s1;
    columns[2] = r.s2;
    columns[3] = r.s3;
    columns[4] = r.s4;
    columns[5] = r.s5;
    columns[6] = r.s6;
    columns[7] = r.s7;
#else
    transposed(rows, columns);
#endif
}

INLINED void rows_of(const lanes *columns, float8 *rows)
{
#if LANES == 1
    rows[0] = (float8)(columns[0], columns[1], columns[2], columns[3], columns[4], columns[5], columns[6], columns[7]);
#else
    transposed(columns, rows);
#endif
}

/* LANES segments of a strand on the screen. */
typedef struct {
    float8 ends[LANES];              // each end's x, y, reversed depth, half width [pixels]
    lanes_i on;                      // whether it can be seen
    lanes_i left, right, top, bottom;   // its tiles
    lanes_u depth;                   // no piece of it lies nearer
    lanes_u cut;                     // what of its length is left where it is clipped: from and to, in 1/65535
    lanes_i whole;                   // whether it is not clipped
    lanes_i wide;                    // whether it may lean: it is WIDE, and whole
    lanes_u leans;                   // of both its ends, see outline.h
} Batch;

/* Clip space, half a width in pixels at w = 1 -> pixels. */
inline float4 on_screen(float4 c, float radius)
{
    const float z = c.z > 0.0f ? c.z : 0.0f, most = GUARD * c.w;
    return (float4)(c.x, c.y, z < c.w ? z : c.w, radius < most ? radius : most) / c.w;
}

/* The rare segment that leaves the guard band or crosses the near plane; whether anything is left of it. */
inline bool clipped(const View *view, float8 ends, float8 *result, uint *cut)
{
    const float4 p = to_screen(view, ends.lo), q = to_screen(view, ends.hi), way = q - p;
    float4 a = p, b = q;
    float ha = 0.5f * ends.s3 * view->scale.x, hb = 0.5f * ends.s7 * view->scale.x;
    if (!clip(&a, &b, &ha, &hb))
        return false;
    *result = both(on_screen(a, ha), on_screen(b, hb));
    float4 from = a - p, until = b - p;
    float longest = 0.0f, along[4] = {way.x, way.y, way.z, way.w}, first[4] = {from.x, from.y, from.z, from.w};
    float last[4] = {until.x, until.y, until.z, until.w}, begin = 0.0f, end = 1.0f;
    for (int k = 0; k < 4; ++k)
        if (fabs(along[k]) > longest) {
            longest = fabs(along[k]);
            begin = first[k] / along[k];
            end = last[k] / along[k];
        }
    *cut = (uint)(clamp(begin, 0.0f, 1.0f) * 65535.0f + 0.5f) | (uint)(clamp(end, 0.0f, 1.0f) * 65535.0f + 0.5f) << 16;
    return true;
}

/* x, y, z and width of LANES points. */
INLINED void columns_of_points(const float4 *p, lanes *columns)
{
#if LANES == 1
    columns[0] = p[0].x;
    columns[1] = p[0].y;
    columns[2] = p[0].z;
    columns[3] = p[0].w;
#else
    const float8 a = (float8)(p[0], p[4]), b = (float8)(p[1], p[5]), c = (float8)(p[2], p[6]), d = (float8)(p[3], p[7]);
    const float8 ab = (float8)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5);
    const float8 cd = (float8)(c.s0, d.s0, c.s1, d.s1, c.s4, d.s4, c.s5, d.s5);
    columns[0] = (float8)(ab.s01, cd.s01, ab.s45, cd.s45);
    columns[1] = (float8)(ab.s23, cd.s23, ab.s67, cd.s67);
    const float8 e = (float8)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7);
    const float8 f = (float8)(c.s2, d.s2, c.s3, d.s3, c.s6, d.s6, c.s7, d.s7);
    columns[2] = (float8)(e.s01, f.s01, e.s45, f.s45);
    columns[3] = (float8)(e.s23, f.s23, e.s67, f.s67);
#endif
}

/* What the one after each has, and the last one's. */
INLINED lanes followers(lanes v, float last)
{
#if LANES == 1
    return last;
#else
    return (float8)(v.s1234, v.s567, last);
#endif
}

/* What the one before each has, and the first one's. */
INLINED lanes preceders(lanes v, float first)
{
#if LANES == 1
    return first;
#else
    return (float8)(first, v.s0123, v.s456);
#endif
}

/* Segments `from` on of a strand whose last point is `last`: n of them, LANES at most.  Each begins where the one before it
   ends, so that one point more is all that it takes. */
ONCE void project(const View *view, __global const float4 *points, uint from, uint last, int n, Batch *batch)
{
    float4 rows[LANES + 1];
    lanes p[4], c[8];
    for (int k = 0; k <= LANES; ++k)
        rows[k] = points[from + k < last ? from + k : last];
    batch->cut = U(WHOLE_WAY);
    columns_of_points(rows, p);
    const lanes4 q = by_columns(view->to_screen, p[0], p[1], p[2]);
    const lanes radius = 0.5f * p[3] * view->scale.x, most = GUARD * q.w;
    const lanes_i in = (q.w > 0.0f) & (q.z >= 0.0f) & (q.z <= q.w) & (q.x <= most) & (q.x >= -most) & (q.y <= most) & (q.y >= -most);
    c[0] = q.x / q.w;
    c[1] = q.y / q.w;
    c[2] = q.z / q.w;
    c[3] = lesser(radius, most) / q.w;
    const float4 end = to_screen(view, rows[LANES]);
    const float end_radius = 0.5f * rows[LANES].w * view->scale.x, end_most = GUARD * end.w;
    const float4 there = (float4)(end.xyz, end_radius < end_most ? end_radius : end_most) / end.w;
    c[4] = followers(c[0], there.x);
    c[5] = followers(c[1], there.y);
    c[6] = followers(c[2], there.z);
    c[7] = followers(c[3], there.w);
    const lanes_i whole = in & AS_I(followers(AS_F(in), as_float(within_guard(end) ? ON : 0)));
    rows_of(c, batch->ends);
    lanes_i kept = whole;
    if (any_lane(whole == 0)) {
        for (int k = 0; k < n; ++k)
            if (!LANE_I(whole, k)) {
                float8 ends = 0.0f;
                LANE_I(kept, k) = clipped(view, both(rows[k], rows[k + 1]), &ends, &LANE_U(batch->cut, k)) ? ON : 0;
                batch->ends[k] = ends;
            }
        columns_of(batch->ends, c);
    }
    /* Across its longer axis it reaches as far as its width is there: up to sqrt(2) of it. */
    const lanes widest = greater(c[3], c[7]), reach = 1.4143f * widest + 0.001f;
    const lanes left = lesser(c[0], c[4]) - reach, right = greater(c[0], c[4]) + reach;
    const lanes top = lesser(c[1], c[5]) - reach, bottom = greater(c[1], c[5]) + reach;
    const float first_column = view->rows.z, columns = view->rows.z + view->size.x, width = columns + view->rows.w;
    const float first = view->rows.x, height = view->rows.y;
    const lanes_i on = kept & (widest > 0.0f) & ((c[0] != c[4]) | (c[1] != c[5]))
        & (right >= first_column) & (bottom >= first) & (left < columns) & (top < height);
    const lanes e = within(greater(c[2], c[6]), 0.0f, 1.0f);
    const lanes_i x0 = WHOLE(greater(left, F(0.0f))) / TILE - view->rows.z / TILE;
    const lanes_i x1 = WHOLE(lesser(right, F(width - 1.0f))) / TILE - view->rows.z / TILE;
    const lanes_i y0 = (WHOLE(greater(top, F(first))) - view->rows.x) / TILE;
    const lanes_i y1 = (WHOLE(lesser(bottom, F(height - 1.0f))) - view->rows.x) / TILE;
    const lanes_i depth = (int)DEPTH_ONE - WHOLE(e * (float)DEPTH_ONE) - MARGIN;
#if LANES == 1
    batch->on = on;
#else
    batch->on = on & ((lanes_i)(0, 1, 2, 3, 4, 5, 6, 7) < n);
#endif
    batch->whole = whole;
    batch->wide = batch->on & whole & (widest > WIDE);
    batch->left = x0;
    batch->right = x1;
    batch->top = y0;
    batch->bottom = y1;
    batch->depth = AS_U(depth > 0 ? depth : I(0));
}

/* How far segments lean that are wide; before, after: points of their strand before the first of them and behind the
   last, or where it begins and ends.  Where a neighbour is whole, its end on the screen is its point. */
ONCE lanes_u leans_at(const View *view, float4 before, float4 after, const Batch *batch)
{
    lanes c[8];
    float2 p, q;
    const bool p_seen = seen_at(view, before, &p), q_seen = seen_at(view, after, &q);
    columns_of(batch->ends, c);
    const Ways from = ways_between(preceders(c[0], p.x), preceders(c[1], p.y), c[0], c[1]);
    const Ways on = ways_between(c[4], c[5], followers(c[4], q.x), followers(c[5], q.y));
    const lanes_i a = AS_I(preceders(AS_F(batch->whole), as_float(p_seen ? ON : 0)));
    const lanes_i b = AS_I(followers(AS_F(batch->whole), as_float(q_seen ? ON : 0)));
    const lanes_u leans = leans_of(c, &from, a, &on, b);
    return batch->wide ? leans : U(0u);
}

/* Tell how far those lean that are wide, of some (a bit each) of a strand of the points from `first` to `last`; see
   `project`. */
INLINED void lean(const View *view, __global const float4 *points, uint first, uint from, uint last, Batch *batch, uint some)
{
    const uint after = from + LANES + 1;
    batch->leans = U(0u);
    if (some & bits_of(batch->wide))
        batch->leans = leans_at(view, points[from > first ? from - 1 : first], points[after < last ? after : last],
                                batch);
}

/* No piece of segment k lies further away. */
INLINED uint furthest(const Batch *batch, int k)
{
    const float8 s = batch->ends[k];
    const float e = s.s2 < s.s6 ? s.s2 : s.s6;
    return (int)DEPTH_ONE - (int)((e > 0.0f ? e < 1.0f ? e : 1.0f : 0.0f) * (float)DEPTH_ONE) + MARGIN;
}

/* Tiles of a row: the first and the last column. */
typedef struct {
    lanes_i from, to;
} Columns;

/* Tiles of a row that segments may touch, of a long one few of those around it: of the whole picture, whatever is drawn
   of it, but the first that is drawn is 0.  c: their ends, as of a `Batch`; left, right: their tiles; row: of each. */
INLINED Columns in_rows(const lanes *c, lanes_i left, lanes_i right, lanes_i row, const View *view)
{
    const lanes down = c[5] - c[1], reach = 1.4143f * greater(c[3], c[7]) + 0.1f;   // and some for rounding
    const lanes y = REAL(view->rows.x + row * TILE) - c[1];
    lanes a = (y - reach) / down, b = (y + TILE + reach) / down;
    a = a > 0.0f ? a < 1.0f ? a : F(1.0f) : F(0.0f);
    b = b > 0.0f ? b < 1.0f ? b : F(1.0f) : F(0.0f);
    const lanes xa = c[0] + a * (c[4] - c[0]), xb = c[0] + b * (c[4] - c[0]);
    const lanes low = lesser(xa, xb) - reach, high = greater(xb, xa) + reach;
    const int begin = view->rows.z / TILE;
    const lanes_i first = (low > 0.0f ? WHOLE(low) / TILE : I(0)) - begin;
    const lanes_i last = (high > 0.0f ? WHOLE(high) / TILE : I(-1)) - begin;
    const lanes_i some = (right - left > 1) & ((down >= 1.0f) | (down <= -1.0f));
    const Columns columns = {(some & (first > left)) ? first : left, (some & (last < right)) ? last : right};
    return columns;
}

/* Those of one segment that are drawn. */
INLINED int2 in_row(const Batch *batch, int k, int row, const View *view)
{
    const float8 s = batch->ends[k];
    const lanes c[8] = {F(s.s0), F(s.s1), F(s.s2), F(s.s3), F(s.s4), F(s.s5), F(s.s6), F(s.s7)};
    Columns touched = in_rows(c, I(LANE_I(batch->left, k)), I(LANE_I(batch->right, k)), I(row), view);
    const int from = LANE_I(touched.from, 0), to = LANE_I(touched.to, 0), last = (view->size.x - 1) / TILE;
    return (int2)(from > 0 ? from : 0, to < last ? to : last);
}
