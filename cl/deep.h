/*
 * What strands let through of a light, from lists of their segments as the light sees them (deep.cl): the light's view is cut
 * into tiles, each lists the segments that may shade a place in it, the nearest to the light first.  A place looks through
 * its tile's list: each segment that lies nearer to the light, its own strand left out, takes the share that it covers of a
 * square around the place, turned along the segment; the square is `reach` pixels to each side.  exact_light.h uses this,
 * and lanes.h before it.
 *
 * Eight segments are a block of eight rows, of a number of each: see `laid`.  What each takes is in octaves, DEEP_UNIT steps
 * each, so that what lies before a place is a sum of whole numbers, the same in any order.
 */
#define DEEP_STRAND 0xFFFFFFu              // of a strand's number, as segments have it
#define DIRECTION_UNIT (1.0f / 32767)          // unit of a direction in a block,
#define ALONG_UNIT (1.0f / 1024)         // and of a place along a segment, in pixels
#define DARK (6 * DEEP_UNIT)                // what is behind so much is as dark as that
#define DARKEST (1.0f - 1.0f / 256)        // a segment lets UNSEEN through at least: eight octaves, so that sums have room

/* Lists of segments, in all tiles of each light's map. */
typedef struct {
    int longest;                           // list of blocks in a tile; 0: there are no maps
    __global const Deep *maps;             // [lights]
    __global const uint *starts;           // [tiles + 1] where in `blocks` those of each begin
    __global const float *nears;           // [blocks] reversed depth before which none of its segments lies, falling
    __global const uint *blocks;           // [blocks, 8, DEEP_BLOCK]
    __global const float8 *axes;           // [segments of the picture] start x, y, z, strand's number; way x, y, z, mean width
    __global const uint *hazes;            // [segments of the picture, lights] share that the grid's hair lets through to the
                                           // start, to the end << 16, in 1/65535
} Deeps;

/* Upper and lower half of 32 bits, with their signs. */
INLINED lanes upper(lanes_u halves)
{
    return TO(lanes, AS_I(halves) >> 16);
}

INLINED lanes lower(lanes_u halves)
{
    return TO(lanes, AS_I(halves << 16) >> 16);
}

/* Octaves that light loses where so much of it is left, 1/256 to 1: exact where as good as all is, to 1.9e-4 elsewhere. */
INLINED lanes octaves_to(lanes left)
{
    const lanes_i bits = AS_I(left);
    const lanes m = AS_F((bits & 0x007FFFFF) | 0x3F800000);
    const lanes log = (m - 1.0f) * (2.4752951f + m * (-1.4809664f + m * (0.51382154f + m * -0.071081005f)));
    return (127.0f - TO(lanes, bits >> 23)) - log;
}

/* What segments take of the light at a place: x, y [pixels] from the middle of its tile, reversed depth e, of strand `own`; in
   octaves.  it: their direction along x and y; where they begin and end along it, as the middle's is 0; how far the middle
   is aside; half their width at their beginning, and what it grows a pixel, the upper halves of floats; share of light that
   they take; reversed depth at their beginning; what it grows a pixel; strand's number. */
INLINED lanes_i taken_by(const lanes_u *it, float x, float y, float e, uint own, float reach)
{
    const lanes along_x = DIRECTION_UNIT * upper(it[0]), along_y = DIRECTION_UNIT * lower(it[0]);
    const lanes from = ALONG_UNIT * upper(it[1]), until = ALONG_UNIT * lower(it[1]);
    const lanes t = along_x * x + along_y * y, aside = along_x * y - along_y * x - AS_F(it[2]);
    const lanes way = (t < from ? from : t < until ? t : until) - from, depth = AS_F(it[5]) + AS_F(it[6]) * way;
    const lanes radius = AS_F(it[3] & 0xFFFF0000u) + AS_F(it[3] << 16) * way;
    const lanes wide = lesser(aside + reach, radius) - greater(aside - reach, -radius);
    const lanes length = lesser(t + reach, until) - greater(t - reach, from);
    const lanes_i on = (depth > e) & (wide > 0.0f) & (length > 0.0f) & (AS_I(it[7]) != (int)own);
    if (!any_lane(on))
        return I(0);
    const lanes share = lesser(AS_F(it[4]) * (wide * length), F(DARKEST));
    return on ? TO(lanes_i, (float)DEEP_UNIT * octaves_to(1.0f - share) + 0.5f) : I(0);
}

#if LANES > 1
INLINED uint all_taken(lanes_i sum)
{
    const int4 four = sum.lo + sum.hi;
    return (four.x + four.y) + (four.z + four.w);
}
#endif

/* What all segments of blocks take, as `taken_by`. */
INLINED uint taken_before(const Deeps *deep, uint first, uint end, float x, float y, float e, uint own, float reach)
{
#if LANES == 1
    uint sum = 0;
    for (uint k = first; k < end && deep->nears[k] > e && sum < DARK; ++k)
        for (uint j = 0; j < DEEP_BLOCK; ++j) {
            uint it[8];
            #pragma unroll
            for (uint i = 0; i < 8; ++i)
                it[i] = deep->blocks[DEEP_BLOCK * (8 * k + i) + j];
            sum += taken_by(it, x, y, e, own, reach);
        }
    return sum < DARK ? sum : DARK;
#else
    lanes_i sum = I(0);
    uint all = 0;
    for (uint k = first; k < end && deep->nears[k] > e && all < DARK; ++k) {
        lanes_u it[8];
        for (int i = 0; i < 8; ++i)
            it[i] = *(__global const lanes_u *)(deep->blocks + DEEP_BLOCK * (8 * k + i));
        sum += taken_by(it, x, y, e, own, reach);
        if ((k - first & 3) == 3)
            all = all_taken(sum);
    }
    all = all_taken(sum);
    return all < DARK ? all : DARK;
#endif
}

/* Share of light i that strands let through to places p of strands `own`. */
INLINED lanes through_deep(const Deeps *deep, int i, lanes_i on, lanes3 p, lanes own)
{
    const Deep map = deep->maps[i];
    const int n = map.size.x;
    const lanes4 c = by_columns(map.to_map, p.x, p.y, p.z);
    const lanes gx = c.x / c.w, gy = c.y / c.w, ge = c.z / c.w, end = F((float)(TILE * n));
    const lanes_i in = on & (c.w > 0.0f) & (gx >= 0.0f) & (gy >= 0.0f) & (gx < end) & (gy < end);
    const lanes x = in ? gx : F(0.0f), y = in ? gy : F(0.0f), e = greater(in ? ge : F(0.0f), F(0.0f));
    const lanes_i tx = TO(lanes_i, x) / TILE, ty = TO(lanes_i, y) / TILE;
    const lanes from_x = x - (TO(lanes, tx * TILE) + TILE / 2), from_y = y - (TO(lanes, ty * TILE) + TILE / 2);
    lanes octaves = F(0.0f);
    for (int k = 0; k < LANES; ++k) {
        if (!LANE_I(in, k))
            continue;
        __global const uint *start = deep->starts + (uint)map.size.y + LANE_I(ty, k) * n + LANE_I(tx, k);
        const uint taken = taken_before(deep, start[0], start[1], LANE(from_x, k), LANE(from_y, k), LANE(e, k),
                                        (uint)LANE(own, k), map.reach.x);
        LANE(octaves, k) = (float)taken;
    }
    return in ? exp2_of(greater(octaves * (-1.0f / DEEP_UNIT), F(-100.0f))) : F(1.0f);
}
