/*
 * Cells that a work-group gathers by itself before it adds them to a light's grid: voxelize.cl uses this, where LANES is
 * more than 1.
 */

/* Cells that the first work-item of a group, which does the strands of all of it, gathers by itself, so that few atomics
   are left: in local memory, as PoCL has private memory for a whole group on a stack of 8 MB. */
typedef struct {
    int4 first, size;
    __local uint *held;                    // [size.z, size.y, size.x]
} Block;

/* Cells around a run of strands, of which a few points tell where they lie; what is elsewhere goes to the grid at once.
   -> How many there are. */
int put_around(Block *block, const Grid *grid, __global const float4 *points, __global const uint2 *spans, uint begin,
               uint end)
{
    const int4 lowest = (int4)(-1, -1, 0, 0), highest = (int4)(grid->size.x, grid->size.y, grid->size.z - 1, 0);
    int4 low = (int4)(INT_MAX), high = (int4)(INT_MIN);
    const uint step = (end - begin + 7) / 8;
    for (uint strand = begin; strand < end; strand += step)
        for (uint k = 0; k < 3; ++k)
            PREFETCH(points + spans[strand].x + (max(spans[strand].y, 1u) - 1) * k / 2);   // from all over memory
    for (uint strand = begin; strand < end; strand += step) {
        const uint2 span = spans[strand];
        for (uint k = 0; k < 3 && span.y; ++k) {
            float w;
            const int4 p = to_cells(grid, points[span.x + (span.y - 1) * k / 2], &w);
            if (p.x != OUTSIDE) {
                low = min(low, p);
                high = max(high, p);
            }
        }
    }
    block->first = clamp((low >> 8) - 2, lowest, highest);
    block->size = max(clamp((high >> 8) + 2, lowest, highest) + 1 - block->first, 1);
    /* Columns in pairs, see `give_row`. */
    block->size.x += block->first.x & 1;
    block->first.x -= block->first.x & 1;
    block->size.x += block->size.x & 1;
    return block->size.x * block->size.y * block->size.z;
}

/* Clear cells around strands from `begin` on, as many of `run` as a block can hold, `end` at most; where it can't, `run`
   is halved. -> One past the last of these. */
uint open_block(Block *block, const Grid *grid, __global const float4 *points, __global const uint2 *spans, uint begin,
                uint end, uint *run)
{
    uint past;
    int cells;
    for (;; *run /= 2) {
        past = begin + *run < end ? begin + *run : end;
        cells = put_around(block, grid, points, spans, begin, past);
        if (cells <= HELD || *run <= LANES)
            break;
    }
    if (cells > HELD) {
        block->size = (int4)(2, 1, 1, 0);  // too small for anything
        cells = 2;
    }
    for (int i = 0; i < cells; ++i)
        block->held[i] = 0;
    return past;
}

/* Add a row of a block to the grid, by pairs of columns: which of these hold something nobody foresees, so it is looked up
   for 32 cells without a branch. */
INLINED void give_row(const __local uint *held, int4 first, int across, const Grid *grid, volatile __global uint *cells)
{
    for (int x = 0; x < across; x += 32) {
        uint some = 0;
#pragma unroll
        for (int i = 0; i < 32; i += 8)
            some |= bits_of_eight(vload8(0, held + x + i) != 0u) << i;
        if (across - x < 32)
            some &= (1u << (across - x)) - 1;
        for (some = (some | some >> 1) & 0x55555555; some; some &= some - 1) {
            const int i = x + first_of(some), to = first.x + i;
#if INT64_ATOMICS
            /* No cell can overflow into the next. */
            if (in_grid(grid, to, first.y, first.z))
                atom_add((volatile __global ulong *)&cells[((size_t)first.z * grid->size.y + first.y) * grid->size.x + to],
                         (ulong)held[i + 1] << 32 | held[i]);
#else
            add(cells, grid, to, first.y, first.z, held[i]);
            add(cells, grid, to + 1, first.y, first.z, held[i + 1]);
#endif
        }
    }
}

/* Add what a block holds to the grid, whose lines the other cores had: those of the next layer are fetched ahead. */
void give_back(const Block *block, const Grid *grid, volatile __global uint *cells)
{
    const __local uint *held = block->held;
    const int4 first = block->first, past = first + block->size;
    for (int z = first.z; z < past.z; ++z)
        for (int y = first.y; y < past.y; ++y, held += block->size.x) {
            for (int x = first.x; x < past.x; x += 16)
                PREFETCH_TO_WRITE(cells + ((long)(z + 1) * grid->size.y + y) * grid->size.x + x);
            give_row(held, (int4)(first.x, y, z, 0), block->size.x, grid, cells);
        }
}
