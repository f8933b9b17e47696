/* Cells of a grid seen from the light, and what is added to them: voxelize.cl and shells.cl use this. */

#define OUTSIDE INT_MIN                                 // mark of a point four grids away: what reaches it is left out

inline int4 to_cells(const Grid *grid, float4 p, float *w)
{
    const float4 c = ((grid->to_grid[0] * p.x + grid->to_grid[1] * p.y) + grid->to_grid[2] * p.z) + grid->to_grid[3];
    const float4 q = (float4)(c.x / c.w, c.y / c.w, c.z, 0.0f);
    *w = c.w;
    const int most = grid->size.x > grid->size.y ? grid->size.x : grid->size.y;
    const float far = 4 * (most > grid->size.z ? most : grid->size.z);
    if (!(c.w > 0.0f && q.x <= far && q.y <= far && q.z <= far && q.x >= -far && q.y >= -far && q.z >= -far))
        return (int4)(OUTSIDE);
    /* The whole number below; PoCL calls floor as a function. */
    const float4 steps = q * (float)SUBPIXEL + 0.5f;
    const int4 near = (int4)((int)steps.x, (int)steps.y, (int)steps.z, 0);
    return near - (int4)(steps.x < near.x, steps.y < near.y, steps.z < near.z, 0);
}

/* Distance of a place from a spot along its axis; 1 under parallel rays. */
inline float distance_of(const Grid *grid, float4 p)
{
    return ((grid->to_grid[0].w * p.x + grid->to_grid[1].w * p.y) + grid->to_grid[2].w * p.z) + grid->to_grid[3].w;
}

/* Which of the grid's sides a place lies beyond by more than a cell, a bit for each: no hair there adds to it. */
inline int beyond_grid(const Grid *grid, float4 p)
{
    const float4 c = ((grid->to_grid[0] * p.x + grid->to_grid[1] * p.y) + grid->to_grid[2] * p.z) + grid->to_grid[3];
    return (c.x < -c.w) | (c.x > (grid->size.x + 1) * c.w) << 1 | (c.y < -c.w) << 2
        | (c.y > (grid->size.y + 1) * c.w) << 3 | (c.z < -1.0f) << 4 | (c.z > grid->size.z + 1) << 5;
}

inline bool in_grid(const Grid *grid, int x, int y, int z)
{
    return (uint)x < (uint)grid->size.x && (uint)y < (uint)grid->size.y && (uint)z < (uint)grid->size.z;
}

inline void add(volatile __global uint *cells, const Grid *grid, int x, int y, int z, uint amount)
{
    if (amount && in_grid(grid, x, y, z))
        atomic_add(&cells[((size_t)z * grid->size.y + y) * grid->size.x + x], amount);
}

/* The same, divided between the four columns whose middles are around x, y [sub-cells from the middle of column 0]; the
   parts add up to the whole. */
inline void add_between(volatile __global uint *cells, const Grid *grid, int x, int y, int z, ulong all)
{
    const uint right = all * (x & 255) >> 8, both = (ulong)right * (y & 255) >> 8;
    const uint behind = all * (y & 255) >> 8;
    add(cells, grid, x >> 8, y >> 8, z, (uint)all - right - behind + both);
    add(cells, grid, (x >> 8) + 1, y >> 8, z, right - both);
    add(cells, grid, x >> 8, (y >> 8) + 1, z, behind - both);
    add(cells, grid, (x >> 8) + 1, (y >> 8) + 1, z, both);
}
