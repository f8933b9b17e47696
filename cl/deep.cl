/*
 * Strands as a light sees them: its view is cut into tiles of TILE² pixels, and each lists the segments that may shade a place
 * in it, for shadows of single hairs.  `count` tells how many, `fill` lists them in any order, `sort` (and `exchange`) puts
 * the nearest to the light first, `lay` tells what each is like as seen from its tile's middle; deep.h looks there.
 */
#if LANES > 8 || LANES_HINTED > 1
#undef LANES
#define LANES 8                            // segments of a strand, then of a list
#endif
#include "clip.h"
#include "lanes.h"
#define CHUNK LANES
#include "ribbon.h"
#include "deep.h"

#define ACROSS 5.657f                      // half a tile from corner to corner [pixels]
#define SLACK 1e-6f                        // of reversed depth, by which rounding may put a place before the nearest of a segment
#define SHORT 32                           // lists that are sorted by insertion

/* The view of a light as a grid of tiles. */
typedef struct {
    View view;
    int tiles;                             // a side
    float reach;                           // see deep.h [pixels]
    __global const float *dark;            // [tiles, tiles] reversed depth behind which no light comes
} Sight;

/* Reversed depth, a little more than any that segment k of a batch has near a tile; below 0 if it is not near it, or in the
   dark. */
INLINED float near_tile(const Sight *sight, const float8 s, float along_x, float along_y, float length, int x, int y)
{
    const float from_x = (x + 0.5f) * TILE - s.s0, from_y = (y + 0.5f) * TILE - s.s1;
    const float aside = along_x * from_y - along_y * from_x, along = along_x * from_x + along_y * from_y;
    const float wide = (s.s3 > s.s7 ? s.s3 : s.s7) + sight->reach;
    const float side = 0.5f * TILE * ((along_x < 0.0f ? -along_x : along_x) + (along_y < 0.0f ? -along_y : along_y));
    const float reach = side + sight->reach;
    if (!(aside < side + wide && aside > -side - wide && along + reach > 0.0f && along - reach < length))
        return -1.0f;
    const float rise = (s.s6 - s.s2) / length, first = along - reach > 0.0f ? along - reach : 0.0f;
    const float last = along + reach < length ? along + reach : length;
    const float a = s.s2 + rise * first, b = s.s2 + rise * last, slack = SLACK + (rise < 0.0f ? -rise : rise) * (1.0f / 256);
    const float e = (a > b ? a : b) + slack, most = (s.s2 > s.s6 ? s.s2 : s.s6) + SLACK, nearest = e < most ? e : most;
    return nearest > sight->dark[y * sight->tiles + x] ? nearest : -1.0f;
}

/* Go through the tiles that segment k of a batch may shade places in, in some rows counts: of each tile one
   more; or, where `entries` are wanted, where in these its next one goes: 1 - nearest reversed depth << 32 | number. */
INLINED bool each_tile(const Sight *sight, const Batch *batch, int k, int2 rows, volatile __global uint *counts,
                       __global ulong *entries, uint number)
{
    const float8 s = batch->ends[k];
    const float dx = s.s4 - s.s0, dy = s.s5 - s.s1, length = sqrt(dx * dx + dy * dy);
    const float along_x = dx / length, along_y = dy / length, wide = 1.4143f * ((s.s3 > s.s7 ? s.s3 : s.s7) + sight->reach);
    const float left = (s.s0 < s.s4 ? s.s0 : s.s4) - wide, right = (s.s0 < s.s4 ? s.s4 : s.s0) + wide;
    const float low = (s.s1 < s.s5 ? s.s1 : s.s5) - wide, high = (s.s1 < s.s5 ? s.s5 : s.s1) + wide;
    const float size = (float)(TILE * sight->tiles - 1);
    if (!(length > 1e-9f) || right < 0.0f || high < 0.0f || left > size || low > size)
        return false;
    const int x0 = left > 0.0f ? (int)left / TILE : 0, x1 = (int)(right < size ? right : size) / TILE;
    const int y0 = low > 0.0f ? (int)low / TILE : 0, y1 = (int)(high < size ? high : size) / TILE;
    const bool leans = x1 - x0 > 1 && (dy > 1.0f || dy < -1.0f);
    bool any = false;
    for (int y = y0 > rows.x ? y0 : rows.x; y <= y1 && y < rows.y; ++y) {
        int first = x0, last = x1;
        if (leans) {                       // of a long one few of those around it
            const float a = (y * TILE - wide - s.s1) / dy, b = (y * TILE + TILE + wide - s.s1) / dy;
            const float from = a > 0.0f ? a < 1.0f ? a : 1.0f : 0.0f, until = b > 0.0f ? b < 1.0f ? b : 1.0f : 0.0f;
            const float p = s.s0 + from * dx, q = s.s0 + until * dx;
            const float least = (p < q ? p : q) - wide, most = (p < q ? q : p) + wide;
            first = least > first * TILE ? (int)least / TILE : first;
            last = most < last * TILE ? most > 0.0f ? (int)most / TILE : -1 : last;
        }
        for (int x = first; x <= last; ++x) {
            const float e = near_tile(sight, s, along_x, along_y, length, x, y);
            if (e < 0.0f)
                continue;
            const uint place = atomic_inc(&counts[y * sight->tiles + x]);
            if (entries)
                entries[place] = (ulong)~as_uint(e) << 32 | number;
            any = true;
        }
    }
    return any;
}

/* One work-item counts the tiles that segments of one strand may shade places in. */
BY_HAND __kernel void count(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,                       // of the light
    const Deep map,
    __global const float *dark,            // [tiles, tiles] reversed depth behind which no light comes
    const uint2 stretch,                   // segments of each strand: the first, one past the last
    const int2 rows,                       // of tiles: likewise
    __global const float4 *points,         // [P] x, y, z, width [world]
    __global const uint2 *spans,           // [strands] first point, points
    volatile __global uint *counts,        // [tiles of all lights] segments
    volatile __global uint *survivors,     // [1] segments of this light, of each launch
    __global const uint *numbers,          // [strands] number of each as it came,
    const uint first_strand,               // from this on
    __global uint *shown)                 // [all strands] 1: some tile lists it
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    bool any = false;
    const Sight sight = {view, map.size.x, map.reach.x, dark};
    uint n = 0;
    for (uint i = stretch.x; i + 1 < span.y && i < stretch.y; i += LANES) {
        const uint left = (span.y - 1 < stretch.y ? span.y - 1 : stretch.y) - i;
        Batch batch;
        project(&sight.view, points, span.x + i, span.x + span.y - 1, left < LANES ? left : LANES, &batch);
        for (int k = 0; k < LANES; ++k)
            if (LANE_I(batch.on, k)) {
                any |= each_tile(&sight, &batch, k, rows, counts + (uint)map.size.y, 0, 0);
                ++n;
            }
    }
    if (any)
        shown[first_strand + numbers[strand]] = 1;
    if (n)
        atomic_add(survivors, n);
}

/* As `count`, and lists them; in any order, since nobody knows who comes first. */
BY_HAND __kernel void fill(
    const ulong begin, const ulong end,    // work-items, see common.h
    const View view,
    const Deep map,
    __global const float *dark,
    const uint2 stretch,
    const int2 rows,
    __global const float4 *points,
    __global const uint2 *spans,
    __global const uint *numbers,
    const uint first_strand,
    __global const uint *shown,
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const HairType *types,
    volatile __global uint *cursors,       // [tiles of all lights] where the next entry of each goes
    volatile __global uint *taken,         // [1] survivors so far
    __global ulong *entries,               // see `each_tile`
    __global float8 *ends,                 // [survivors] each end's x, y, reversed depth, half width [pixels]
    __global uint2 *marks)                 // [survivors] strand's number, share of light that it takes
{
    WORK_ITEM(strand);
    const uint2 span = spans[strand];
    const Sight sight = {view, map.size.x, map.reach.x, dark};
    if (!shown[first_strand + numbers[strand]])
        return;
    const float opaque = 1.0f - types[(int)strand_uv[strand].z].shine.z;
    for (uint i = stretch.x; i + 1 < span.y && i < stretch.y; i += LANES) {
        const uint left = (span.y - 1 < stretch.y ? span.y - 1 : stretch.y) - i;
        Batch batch;
        project(&sight.view, points, span.x + i, span.x + span.y - 1, left < LANES ? left : LANES, &batch);
        uint n = 0;
        for (int k = 0; k < LANES; ++k)
            n += LANE_I(batch.on, k) != 0;
        if (!n)
            continue;
        uint number = atomic_add(taken, n);
        for (int k = 0; k < LANES; ++k)
            if (LANE_I(batch.on, k)) {
                each_tile(&sight, &batch, k, rows, cursors + (uint)map.size.y, entries, number);
                ends[number] = batch.ends[k];
                marks[number++] = (uint2)(first_strand + numbers[strand] & DEEP_STRAND, as_uint(opaque));
            }
    }
}

/* Put two entries in order. */
INLINED void in_order(__global ulong *entries, uint i, uint j)
{
    const ulong a = entries[i], b = entries[j];
    if (a > b) {
        entries[i] = b;
        entries[j] = a;
    }
}

#if LANES > 1
#define DIGIT 8                            // bits by which a long list is sorted at once: by two such digits of its depths

/* Move n entries into the order of one digit, from its lowest bit on, of how much further they lie than `least`. */
INLINED void by_digit(__global const ulong *from, __global ulong *to, uint n, uint least, uint shift)
{
    uint ends[(1 << DIGIT) + 1];
    for (uint k = 0; k <= 1 << DIGIT; ++k)
        ends[k] = 0;
    for (uint i = 0; i < n; ++i)
        ++ends[(((uint)(from[i] >> 32) - least) >> shift & ((1 << DIGIT) - 1)) + 1];
    for (uint k = 1; k < 1 << DIGIT; ++k)
        ends[k] += ends[k - 1];
    for (uint i = 0; i < n; ++i)
        to[ends[((uint)(from[i] >> 32) - least) >> shift & ((1 << DIGIT) - 1)]++] = from[i];
}

/* Put entries roughly into order: by the upper 2 · DIGIT bits of the depths that there are. */
ONCE void nearly_sorted(__global ulong *its, __global ulong *spare, uint n)
{
    uint least = ~0u, most = 0, shift = 0;
    for (uint i = 0; i < n; ++i) {
        const uint depth = its[i] >> 32;
        least = depth < least ? depth : least;
        most = depth > most ? depth : most;
    }
    while ((most - least) >> shift >> 2 * DIGIT)
        ++shift;
    by_digit(its, spare, n, least, shift);
    by_digit(spare, its, n, least, shift + DIGIT);
}
#else
/* Sort a long list by Batcher's method, as in Knuth, The Art of Computer Programming 3, 5.2.2 M. */
ONCE void nearly_sorted(__global ulong *its, __global ulong *spare, uint n)
{
    uint whole = 1;
    while (2 * whole < n)
        whole *= 2;
    for (uint p = whole; p; p /= 2)
        for (uint q = whole, r = 0, d = p; d; d = q > p ? q - p : 0, q = q > p ? q / 2 : 0, r = p)
            for (uint i = 0; i + d < n; ++i)
                if ((i & p) == r)
                    in_order(its, i, i + d);
}
#endif

/* One work-item sorts the list of one tile: a short one by insertion, a long one is brought into some order before. */
BY_HAND __kernel void sort(
    const ulong begin, const ulong end,    // work-items, see common.h
    const uint longest,                    // a list of more is left as it is
    __global const uint *starts,           // [tiles + 1] where in `entries` those of each begin
    __global ulong *entries,
    __global ulong *spare)                 // as many, or none where LANES is 1
{
    WORK_ITEM(tile);
    const uint n = starts[tile + 1] - starts[tile];
    __global ulong *its = entries + starts[tile];
    if (n > longest)
        return;
    if (n > SHORT)
        nearly_sorted(its, spare + starts[tile], n);
    for (uint i = 1; i < n; ++i) {
        const ulong entry = its[i];
        uint j = i;
        for (; j > 0 && its[j - 1] > entry; --j)
            its[j] = its[j - 1];
        its[j] = entry;
    }
}

/* One work-item puts two entries of a long list in order, in one step of the same method. */
__kernel void exchange(
    const ulong begin, const ulong end,    // work-items, see common.h: entries of the list, less `apart`
    const uint first,                      // where in `entries` it begins
    const uint bit,                        // of an entry's place in the list
    const uint value,                      // that this has where it is the first of two
    const uint apart,                      // how far away the other is
    __global ulong *entries)
{
    WORK_ITEM(i);
    if (((uint)i & bit) == value)
        in_order(entries + first, (uint)i, (uint)i + apart);
}

/* Two numbers in 16 bits each, with their signs. */
INLINED lanes_u halves(lanes high, lanes low)
{
    return AS_U(nearest_i(high) << 16) | (AS_U(nearest_i(low)) & 0xFFFFu);
}

/* The upper half of a float. */
INLINED lanes_u coarse(lanes x)
{
    return (AS_U(x) + 0x8000u) & 0xFFFF0000u;
}

/* What segments with such ends, on the screen, are like as seen from a place; see `taken_by`. */
INLINED void laid(const lanes *c, float x, float y, float reach, lanes *opaque, lanes_u *it)
{
    const lanes dx = c[4] - c[0], dy = c[5] - c[1], length = sqrt(dx * dx + dy * dy);
    const lanes along_x = dx / length, along_y = dy / length;
    const lanes from_x = x - c[0], from_y = y - c[1], along = along_x * from_x + along_y * from_y;
    const lanes low = F(-ACROSS - reach), high = F(ACROSS + reach);
    const lanes from = greater(low, -along), until = lesser(high, length - along);
    const lanes first = ALONG_UNIT * nearest(from * 1024.0f), rise = (c[6] - c[2]) / length, grows = (c[7] - c[3]) / length;
    const lanes x_bits = nearest(along_x * 32767.0f), y_bits = nearest(along_y * 32767.0f);
    /* The line's nearest point to the place, aside by the directions as they are kept. */
    const lanes at_x = along_x * along - from_x, at_y = along_y * along - from_y;
    it[0] = halves(x_bits, y_bits);
    it[1] = halves(nearest(from * 1024.0f), nearest(until * 1024.0f));
    it[2] = AS_U(DIRECTION_UNIT * (x_bits * at_y - y_bits * at_x));
    it[3] = coarse(c[3] + grows * (first + along)) | coarse(grows) >> 16;
    it[4] = AS_U(*opaque * (1.0f / (4.0f * reach * reach)));
    it[5] = AS_U(c[2] + rise * (first + along));
    it[6] = AS_U(rise);
}

/* One work-item tells what the segments of some blocks of one tile are like. */
BY_HAND __kernel void lay(
    const ulong begin, const ulong end,    // work-items, see common.h
    const Deep map,
    const uint2 stretch,                   // blocks of each list: the first, one past the last
    __global const uint *starts,           // [tiles + 1] where in `entries` those of each begin
    __global const ulong *entries,         // sorted
    __global const float8 *ends,           // see `fill`
    __global const uint2 *marks,
    __global const uint *firsts,           // [tiles + 1] where in `blocks` those of each begin
    __global float *nears,                 // [blocks] see deep.h
    __global uint *blocks)                 // [blocks, 8, DEEP_BLOCK]
{
    WORK_ITEM(item);
    const uint tile = (uint)map.size.y + item, n = starts[tile + 1] - starts[tile];
    __global const ulong *its = entries + starts[tile];
    const float x = ((int)item % map.size.x + 0.5f) * TILE, y = ((int)item / map.size.x + 0.5f) * TILE;
    for (uint k = DEEP_BLOCK * stretch.x; k < n && k < DEEP_BLOCK * stretch.y; k += LANES) {
        const uint block = firsts[tile] + k / DEEP_BLOCK;
        float8 rows[LANES];
        lanes c[8], opaque;
        lanes_u it[8];
        for (uint j = 0; j < LANES; ++j) {
            const uint number = (uint)its[k + j < n ? k + j : k];
            rows[j] = ends[number];
            LANE_U(it[7], j) = marks[number].x;
            LANE(opaque, j) = k + j < n ? as_float(marks[number].y) : 0.0f;
        }
        columns_of(rows, c);
        laid(c, x, y, map.reach.x, &opaque, it);
        if (k % DEEP_BLOCK == 0)
            nears[block] = as_float(~(uint)(its[k] >> 32));
        for (uint i = 0; i < 8; ++i)
            for (uint j = 0; j < LANES; ++j)
                blocks[DEEP_BLOCK * (8 * block + i) + k % DEEP_BLOCK + j] = LANE_U(it[i], j);
#if LANES == 1
        for (uint j = n; k + 1 == n && j % DEEP_BLOCK; ++j)   // those that fill the last block take nothing
            for (uint i = 0; i < 8; ++i)
                blocks[DEEP_BLOCK * (8 * block + i) + j % DEEP_BLOCK] = 0;
#endif
    }
}
