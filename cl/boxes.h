/*
 * The tiles of LANES segments side by side: those of each lie in a box, and most boxes have few rows and columns.
 * Which of its tiles a segment may show in nobody foresees, so these are looked up without a branch; coverage.cl uses this.
 */
#define BOX_COLUMNS 4                      // of a small box,
#define BOX_ROWS 4                         // at most
#if LANES * BOX_COLUMNS != 32
#error "two rows of a box fill 64 bits"
#endif

/* Segments of a batch, and the tiles that they may show in. */
typedef struct {
    lanes_u tiles[BOX_ROWS];               // of the small boxes: the first of each row that a segment may touch
    ulong shows[BOX_ROWS / 2];             // of two rows each, a bit each: in the row's i-th tile segment k may show, at
                                           // LANES * i + k; the second row's after BOX_COLUMNS of the first
    uint large;                            // a bit each: the box of segment k is not small
} Boxes;

INLINED lanes_u looked_up(__global const uint *from, lanes_u at)
{
    return (lanes_u)(from[LANE_U(at, 0)], from[LANE_U(at, 1)], from[LANE_U(at, 2)], from[LANE_U(at, 3)],
                     from[LANE_U(at, 4)], from[LANE_U(at, 5)], from[LANE_U(at, 6)], from[LANE_U(at, 7)]);
}

/* Look up row r of each box, in the first columns of those that segments may touch there.  on: whether there is one. */
INLINED void look_up_row(const Batch *batch, int r, lanes_i on, Columns touched, const int columns, int across,
                         __global const uint *bounds, uint2 window, Boxes *boxes)
{
    const lanes_i before = (batch->top + r) * across;
    const int past = window.y < INT_MAX ? window.y : INT_MAX;
    const lanes_i low = (int)window.x - before, high = past - 1 - before;
    lanes_i from = touched.from > 0 ? touched.from : I(0), to = touched.to < across ? touched.to : I(across - 1);
    from = from > low ? from : low;
    to = to < high ? to : high;
    const lanes_i more = on ? to - from : I(-1);
    const lanes_u first = AS_U(before + from);
    uint shows = 0;
    for (int i = 0; i < columns && (i < 2 || any_lane(more >= i)); ++i) {
        const lanes_i there = more >= i;
        shows |= bits_of(there & (batch->depth < looked_up(bounds, there ? first + (uint)i : U(0u)))) << LANES * i;
    }
    boxes->tiles[r] = first;
    boxes->shows[r / 2] |= (ulong)shows << LANES * BOX_COLUMNS * (r % 2);
}

/* Find the tiles of a window in which segments of a batch that are `on` may show. */
INLINED void look_up_boxes(const Batch *batch, lanes_i on, const View *view, __global const uint *bounds, uint2 window,
                           Boxes *boxes)
{
    const int across = (view->size.x + TILE - 1) / TILE;
    const lanes_i wide = batch->right - batch->left, high = batch->bottom - batch->top;
    const lanes_i small = on & (wide < BOX_COLUMNS) & (high < BOX_ROWS);
    boxes->large = bits_of(on & ~small);
    boxes->shows[0] = boxes->shows[1] = 0;
    const bool broad = any_lane(small & (wide > 1));
    if (!broad && !any_lane(small & (high > 1))) {                // so are most batches of short segments
        const Columns all = {batch->left, batch->right};
        for (int r = 0; r < 2; ++r)
            look_up_row(batch, r, small & (high >= r), all, 2, across, bounds, window, boxes);
        return;
    }
    lanes c[8];
    if (broad)
        columns_of(batch->ends, c);
    for (int r = 0; r < BOX_ROWS; ++r) {
        const lanes_i in_row = small & (high >= r);
        if (r > 1 && !any_lane(in_row))
            break;
        Columns touched = {batch->left, batch->right};
        if (broad)
            touched = in_rows(c, batch->left, batch->right, batch->top + r, view);
        look_up_row(batch, r, in_row, touched, BOX_COLUMNS, across, bounds, window, boxes);
    }
}

/* Those that show in tiles of a small box, a bit each. */
INLINED uint shown_of(const Boxes *boxes)
{
    const ulong four = boxes->shows[0] | boxes->shows[1];
    const uint two = (uint)(four | four >> LANES * BOX_COLUMNS), one = two | two >> 2 * LANES;
    return (one | one >> LANES) & (1u << LANES) - 1;
}

/* The tile of a bit of the rows 2 * pair and the next. */
INLINED uint tile_of(const Boxes *boxes, int pair, int bit)
{
    return LANE_U(boxes->tiles[2 * pair + bit / (LANES * BOX_COLUMNS)], bit % LANES) + bit / LANES % BOX_COLUMNS;
}
