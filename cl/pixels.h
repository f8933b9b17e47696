/*
 * A work-item each pixel, where LANES is 1; those of a tile are a work-group: `sort` puts a tile's list in order, `pixels`
 * draws it.  The same expressions as where columns go side by side, and so the same bits.  coverage.cl uses this.
 */
#define AT_ONCE 0    // a list is sorted in one launch, or in many, of a stretch each:
#define DEPTHS 1     // the least depth and the most,
#define TALLY 2      // how many are in each bucket,
#define PLACE 3      // and where they go

/* One work-group sorts the list of one tile into BUCKETS by depth. Not where `tiles` does so. */
RARE __kernel void sort(
    const ulong begin, const ulong end,    // work-items, see common.h: whole work-groups
    const uint first_tile,                 // tile of the first group
    const uint longest,                    // a list of more is left as it is AT_ONCE
    const int what,                        // of the above
    const uint2 stretch,                   // of a list: the first, one past the last; all AT_ONCE
    __global const uint *starts,           // [tiles + 1] where in `entries` those of each begin
    __global const uint2 *entries,         // depth, number of a segment
    __global uint2 *sorted,                // the same, by depth
    __global uint2 *grains,                // [tiles] see `all_before`
    __global uint *kept)                   // [BUCKETS + 2] one tile's, from launch to launch; nothing AT_ONCE
{
#if LANES == 1
    __local uint least, most, ends[BUCKETS];
    const uint me = get_local_id(0), all = get_local_size(0);
    const bool on = begin + get_group_id(0) * all < end;   // none returns before a barrier: PoCL would go astray
    const uint tile = on ? first_tile + (begin + get_global_id(0)) / all : 0;
    uint n = on ? starts[tile + 1] - starts[tile] : 0;
    n = what == AT_ONCE && n > longest ? 0 : n;
    const uint first = starts[tile] + (stretch.x < n ? stretch.x : n), until = starts[tile] + (stretch.y < n ? stretch.y : n);
    uint low = ~0u, high = 0, shift = 0;
    if (!me) {
        least = what == AT_ONCE ? ~0u : kept[BUCKETS];
        most = what == AT_ONCE ? 0 : kept[BUCKETS + 1];
    }
    for (uint k = me; k < BUCKETS; k += all)
        ends[k] = what == AT_ONCE ? 0 : kept[k];
    barrier(CLK_LOCAL_MEM_FENCE);
    if (what == AT_ONCE || what == DEPTHS) {
        for (uint i = first + me; i < until; i += all) {
            const uint depth = entries[i].x;
            low = depth < low ? depth : low;
            high = depth > high ? depth : high;
        }
        atomic_min(&least, low);
        atomic_max(&most, high);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    const uint nearest = least, range = most > nearest ? most - nearest : 0;
    while (range >> shift >= BUCKETS)
        ++shift;
    if (what == AT_ONCE || what == TALLY)
        for (uint i = first + me; i < until; i += all)
            atomic_inc(&ends[(entries[i].x - nearest) >> shift]);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (on && !me && (what == AT_ONCE || (what == PLACE && !stretch.x))) {
        uint sum = starts[tile];
        for (int k = 0; k < BUCKETS; ++k) {
            const uint in_it = ends[k];
            ends[k] = sum;
            sum += in_it;
        }
        grains[tile] = (uint2)(nearest, shift);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (what == AT_ONCE || what == PLACE)
        for (uint i = first + me; i < until; i += all) {
            const uint2 it = entries[i];
            sorted[atomic_inc(&ends[(it.x - nearest) >> shift])] = it;
        }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint k = me; on && what != AT_ONCE && k < BUCKETS; k += all)
        kept[k] = ends[k];
    if (on && what != AT_ONCE && !me) {
        kept[BUCKETS] = nearest;
        kept[BUCKETS + 1] = most;
    }
#endif
}

#if LANES == 1
#define DONE ~0u

/* A pixel on its way through its tile's list. */
typedef struct {
    Slots slots;
    Pixel pixel;
    long low, limit;                       // keys below are done; those from `limit` on have gone, and come again later
    uint bound, next;                      // depth from which on nothing is seen; in the list, or DONE
    int waiting;                           // pieces
} Walk;
typedef char a_walk_fits[sizeof(Walk) <= 16 * OF_WALK ? 1 : -1];

/* Copy what has become of one; the rest is as `begin_pixel` left it.  Member by member: a struct that is copied in one lies
   in memory for good on llvmpipe, with all its numbers. */
#define COPY(to, from, samples)                                \
    {                                                          \
        (to)->low = (from)->low;                               \
        (to)->limit = (from)->limit;                           \
        (to)->waiting = (from)->waiting;                       \
        for (int k = 0; k < (from)->waiting; ++k) {            \
            COPY_PIECE(&(to)->slots, k, &(from)->slots, k)     \
        }                                                      \
        COPY_PIXEL(&(to)->pixel, &(from)->pixel, samples)      \
    }

/* What the work-items of a tile have together. */
typedef struct {
    Chunk chunks[TILE * TILE];             // segments that are ready, each in a chunk of its own
    uint hits[TILE * TILE][2];             // which of them may be in each pixel, a bit each
    uint open[2], fullest[2];              // of this turn and the next: whether any pixel is open; the most that wait in one
} Group;

/* Take the first of some bits away -> its number. */
INLINED int next_bit(uint2 *bits)
{
    const bool low = bits->x != 0;
    const uint word = low ? bits->x : bits->y;
    bits->y = low ? bits->y : bits->y & (bits->y - 1);
    bits->x &= bits->x - 1;
    return 31 - (int)clz(word & -word) + (low ? 0 : 32);
}

/* Tell the pixels of a tile that segment k may be in them. */
INLINED void touch(__local Group *group, int k, const View *view, int left, int top)
{
    __local const Chunk *chunk = &group->chunks[k];
    const int steep = chunk->steep[0], u0 = steep ? top : left, v0 = steep ? left : top;
    const float out = chunk->out[0];
    if (!(chunk->bu[0] > chunk->au[0]) || chunk->bu[0] + out <= u0 || chunk->au[0] - out >= u0 + TILE)
        return;
    uint2 bits = 0;                        // TILE * u + v
    for (int u = 0; u < TILE; ++u) {
        Column column;
        Outline outline;
        if (leans(chunk, 0))
            outline_of(chunk, 0, view, u0 + u, &column, &outline);
        else
            column_of(chunk, 0, view, u0 + u, &column);
        const int low = column.low > v0 ? column.low - v0 : 0, high = column.high < v0 + TILE ? column.high - v0 : TILE;
        const uint rows = column.along > 0.0f && low < high ? (1u << high) - (1u << low) : 0;
        bits.x |= u < TILE / 2 ? rows << TILE * u : 0;
        bits.y |= u < TILE / 2 ? 0 : rows << TILE * (u - TILE / 2);
    }
    while (bits.x | bits.y) {
        const int at = next_bit(&bits);
        atomic_or(&group->hits[steep ? at : at % TILE * TILE + at / TILE][k / 32], 1u << k % 32);
    }
}

/* Draw a segment in pixel x, y, in which it may be. */
INLINED void draw(Walk *walk, const View *view, __local const Chunk *chunk, int x, int y)
{
    const int steep = chunk->steep[0], u = steep ? y : x, v = steep ? x : y;
    Column column;
    float share;
    if (leans(chunk, 0)) {
        Outline outline;
        outline_of(chunk, 0, view, u, &column, &outline);
        share = share_within(&outline, v);
    } else {
        column_of(chunk, 0, view, u, &column);
        share = share_of(&column, v);
    }
    const uint depth = column.depth;
    const long key = (long)((ulong)depth << 32 | chunk->id[0]);
    if (depth >= walk->bound || !(share > 0.0f) || key < walk->low)
        return;
    Slots *slots = &walk->slots;
    const int n = walk->waiting++;
    slots->keys[n] = key;
    slots->shares[n] = share;
    slots->wheres[n] = place_in(&column, v);
    slots->numbers[n] = chunk->number[0];
#if MASKS
    float8 strip;
    if (leans(chunk, 0))
        leaning_strips_of(chunk, 0, &column, u, v, &strip);
    else
        strips_of(chunk, 0, &column, u, v, &strip);
    slots->strips[n] = *(const Strip *)&strip;
#endif
    if (walk->waiting == SLOTS) {
        drop(slots, &walk->limit);
        --walk->waiting;
    }
}

/* Steps of loops that one turn takes at most in a work-item, or in several side by side, of which none has more pieces. */
INLINED uint steps_of(uint fullest, uint samples)
{
    const uint drops = fullest < SLOTS - 1 ? 0 : TILE * TILE * SLOTS;
    return TILE + 2 * TILE * TILE + drops + (fullest / 4 + 4) * (fullest + 1) + (fullest + 2 * samples) * (samples + CHAINS);
}

/* Go on through a sorted list of n, for about so many steps of loops -> whether all is done: the same in all of a group. */
INLINED bool go_on(Walk *walk, __local Group *group, const View *view, const Picture *picture, __global const uint2 *sorted,
                   uint n, uint2 grain, uint steps, int left, int top, long end, __global const float8 *ends,
                   __global const uint *ids, __global const uint *cuts)
{
    const int me = get_local_id(0), x = left + me % TILE, y = top + me / TILE;
    uint next = walk->next, spent = 0;
    bool open = n > 0;
    group->hits[me][0] = group->hits[me][1] = 0;
    if (me < 2)
        group->open[me] = group->fullest[me] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int turn = 0; open && spent < steps; turn = 1 - turn) {
        const int m = n - next < TILE * TILE ? n - next : TILE * TILE;
        if (me < m) {
            prepare(&group->chunks[me], view, sorted + next + me, 1, 1, ends, ids, cuts);
            touch(group, me, view, left, top);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        uint2 bits = walk->pixel.closed ? 0 : (uint2)(group->hits[me][0], group->hits[me][1]);
        group->hits[me][0] = group->hits[me][1] = 0;
        while (bits.x | bits.y) {
            const int k = next_bit(&bits);
            draw(walk, view, &group->chunks[k], x, y);
        }
        next += m;
        const bool last = next == n;
        const long until = last ? LONG_MAX : all_before(sorted[next].x, grain);
        atomic_max(&group->fullest[turn], (uint)walk->waiting);
        if (!walk->pixel.closed) {
            walk->waiting = settle(&walk->pixel, picture, &walk->slots, walk->waiting, until < walk->limit ? until : walk->limit);
            if (last) {                    // what has gone comes again; all before it is done
                walk->low = walk->limit;
                walk->limit = end;
                walk->waiting = 0;
            }
            if (!walk->pixel.closed && walk->low != end)
                atomic_or(&group->open[turn], 1);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        open = group->open[turn];
        spent += steps_of(group->fullest[turn], picture->samples);
        spent += picture->lit ? group->fullest[turn] * steps_of_light(&picture->sent) : 0;
        if (!me)
            group->open[1 - turn] = group->fullest[1 - turn] = 0;
        next = last ? 0 : next;
    }
    walk->next = open ? next : DONE;
    return !open;
}
#endif

/* One work-item draws one pixel; a work-group is a tile.  Not where LANES go side by side, but for `tiles`. */
RARE __kernel void pixels(
    const ulong begin, const ulong end,    // work-items, see common.h: whole work-groups
    const View view,
    const uint2 window,                    // tiles that are drawn: the first, one past the last
    const uint2 slab,                      // depths that are drawn: the first, one past the last
    __global uint4 *kept,                  // [a tile's pixels or 0, OF_PIXEL] between slabs
    volatile __global uint *unfinished,    // [1] of these, in which more can be seen
    const uint steps,                      // of loops that one may take in this launch, about
    const int fresh,                       // 1: they begin, 0: they go on
    const int listed,                      // 1: only some tiles, which keep where they are
    __global const uint *items,            // [n] these, if so
    __global uint *open,                   // [tiles or 0] those that don't come to their end, if not
    volatile __global uint *n_open,        // [1] how many these are
    __global uint4 *walks,                 // [n, TILE², OF_WALK] where they are
    __global const uint *starts,           // [tiles + 1] where in `sorted` those of each begin
    __global const uint2 *sorted,          // depth, number of a segment
    __global const uint2 *grains,          // [tiles] see `all_before`
    __global const float8 *ends,           // [survivors] of segments, see `fill`
    __global const uint *ids,
    __global const uint *cuts,
    __global const ulong *visible,         // [rows, width, samples] depth << 32 | id of the body
    const int has_shells,                  // the rest: see `tiles`
    __global const ulong *sample_shells,
    const int lit,
    const uint room,                       // for bundles of pieces that are told in place of their light; 0: none are
    volatile __global uint *taken,         // [1] pieces that are
    __global uint *bundles,                // [room, 3 * GLOWS] pixel, number, weight of one after the other
    __global const ulong *places,
    const int sources,
    __global const float *more,
    __global const Lobes *lobes,
    __global const float4 *lobe_table,
    const int n_lights,
    __global const Light *lights,
    __global const Shadow *shadows,
    __global const Grid *grids,
    __global const View *light_views,
    __global const float *crossings,
    __global const ulong *shadow_maps,
    const int shadowed,
    const int deep_longest,
    __global const Deep *deep_maps,
    __global const uint *deep_starts,
    __global const float *deep_nears,
    __global const uint *deep_blocks,
    __global const float8 *axes,
    __global const uint *hazes,
    __global float *body_transmittance,
    __global float *alpha,
    __global ulong *front,
    __global ulong *shell_front,
    __global float4 *image)
{
#if LANES == 1
    __local Group group;
    const uint k = (begin + get_global_id(0)) / (TILE * TILE), me = get_local_id(0);
    bool on = begin + get_group_id(0) * (TILE * TILE) < end;   // none returns before a barrier: PoCL would go astray
    const uint tile = !on ? 0 : listed ? items[k] : k;
    const int2 size = (int2)(view.size.x, view.rows.y - view.rows.x);
    const int across = (size.x + TILE - 1) / TILE, left = tile % across * TILE, top = tile / across * TILE;
    const int x = left + me % TILE, y = top + me / TILE;   // among those that are drawn
    __global Walk *walked = (__global Walk *)(walks + OF_WALK * (k * TILE * TILE + me));
    on = on && tile >= window.x && tile < window.y && (fresh || walked->next != DONE);
    const bool within = on && x < size.x && y < size.y;
    const Picture picture = {view.size.z, has_shells, lit, visible, sample_shells,
                             {places, sources, more, &view, {n_lights, lights, shadows, grids, light_views, crossings, shadow_maps},
                              lobes, lobe_table, shadowed, ends, {deep_longest, deep_maps, deep_starts, deep_nears, deep_blocks, axes, hazes}},
                             body_transmittance, alpha,
                             front, shell_front, image, 0, room * GLOWS, taken, bundles};
    Walk walk;
    walk.bound = walk.next = walk.waiting = 0;
    walk.low = key_at(slab.x);
    walk.limit = key_at(slab.y);
    walk.pixel.closed = true;
    if (within)
        walk.bound = begin_pixel(&walk.pixel, &picture, (size_t)y * size.x + x);
    if (within)
        walk.bound = go_on_behind(&walk.pixel, walk.bound, picture.samples, slab, kept + OF_PIXEL * me);
    if (on && !fresh)
        walk.next = walked->next;
    if (within && !fresh)
        COPY(&walk, walked, picture.samples);
    const bool done = go_on(&walk, &group, &view, &picture, sorted + starts[tile], on ? starts[tile + 1] - starts[tile] : 0,
                            grains[tile], steps, view.rows.z + left, view.rows.x + top, key_at(slab.y), ends, ids, cuts);
    if (done && within)
        end_slab(&walk.pixel, &picture, slab, kept + OF_PIXEL * me, unfinished);
    if (on && listed)
        walked->next = walk.next;
    if (within && listed)
        COPY(walked, &walk, picture.samples);
    if (!done && !me) {
        const uint stopped = atomic_inc(n_open);
        if (!listed)
            open[stopped] = tile;
    }
#endif
}
