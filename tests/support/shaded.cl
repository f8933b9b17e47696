/* What deep.h tells of places. */
#if LANES > 8 || LANES_HINTED > 1
#undef LANES
#define LANES 8
#endif
#include "lanes.h"
#include "deep.h"

/* One work-item asks for LANES places. */
BY_HAND __kernel void through(
    const ulong begin, const ulong end,
    const int light,
    const int deep_longest,
    __global const Deep *deep_maps,
    __global const uint *deep_starts,
    __global const float *deep_nears,
    __global const uint *deep_blocks,
    const uint n,
    __global const float4 *places,         // [n] x, y, z, number of the strand
    __global float *shares)                // [n]
{
    WORK_ITEM(item);
    const Deeps deep = {deep_longest, deep_maps, deep_starts, deep_nears, deep_blocks, 0, 0};
    const uint first = LANES * (uint)item;
    lanes3 p;
    lanes own;
    for (uint k = 0; k < LANES; ++k) {
        const float4 place = places[first + k < n ? first + k : n - 1];
        put_lane(&p, k, place);
        LANE(own, k) = place.w;
    }
    lanes share = through_deep(&deep, light, I(ON), p, own);
    for (uint k = 0; k < LANES && first + k < n; ++k)
        shares[first + k] = LANE(share, k);
}
