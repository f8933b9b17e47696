/*
 * Sums of cells that strands leave something in, till other cells come in their place: sky.cl and hair_cells.h use this, with
 * OF_CELL before it, how many numbers a cell has.
 */

/* Sums of eight cells that do not lie alike to each other: strands that follow each other are neighbours, and atomics cost
   most of all. In integers, so that neither matters. */
typedef struct {
    int cell[8];                           // -1: none
    int sums[8][OF_CELL];
} Nearby;

INLINED void give(volatile __global int *cells, Nearby *nearby, int slot)
{
    for (int j = 0; j < OF_CELL && nearby->cell[slot] >= 0; ++j)
        atomic_add(&cells[(size_t)nearby->cell[slot] * OF_CELL + j], nearby->sums[slot][j]);
}

/* What a strand has left in one cell, at (x, y, z) of grid `first`. */
INLINED void leave(volatile __global int *cells, Nearby *nearby, int4 at, int n, int first, const float *sums, float unit)
{
    const int cell = ((first * n + at.z) * n + at.y) * n + at.x, slot = (at.x & 1) | (at.y & 1) << 1 | (at.z & 1) << 2;
    if (nearby->cell[slot] != cell) {
        give(cells, nearby, slot);
        nearby->cell[slot] = cell;
        for (int j = 0; j < OF_CELL; ++j)
            nearby->sums[slot][j] = 0;
    }
    for (int j = 0; j < OF_CELL; ++j) {
        const float amount = sums[j] * unit;
        nearby->sums[slot][j] += (int)(amount < 0.0f ? amount - 0.5f : amount + 0.5f);
    }
}

INLINED void begin_nearby(Nearby *nearby)
{
    for (int slot = 0; slot < 8; ++slot)
        nearby->cell[slot] = -1;
}

INLINED void end_nearby(volatile __global int *cells, Nearby *nearby)
{
    for (int slot = 0; slot < 8; ++slot)
        give(cells, nearby, slot);
}
