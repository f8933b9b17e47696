/* Cells of a grid seen from the light, and what is added to them: voxelize.cl and shells.cl use this. */

#define OUTSIDE INT_MIN                                 // mark of a point four grids away

inline int4 to_cells(const Grid *grid, float4 p, float *w)
{
    const float4 c = ((grid->to_grid[0] * p.x + grid->to_grid[1] * p.y) + grid->to_grid[2] * p.z) + grid->to_grid[3];
    *w = c.w;
    const int most = grid->size.x > grid->size.y ? grid->size.x : grid->size.y;
    const float far = 4 * (most > grid->size.z ? most : grid->size.z);
    const float4 q = (float4)(c.x / c.w, c.y / c.w, grid->size.w && c.z < -far ? -far : c.z, 0.0f);
    if (!(c.w > 0.0f && (!grid->size.w || c.w >= grid->face.w) && q.x <= far && q.y <= far && q.z <= far && q.x >= -far && q.y >= -far && q.z >= -far))
        return (int4)(OUTSIDE);
    /* The whole number below; PoCL calls floor as a function. */
    const float4 steps = q * (float)SUBPIXEL + 0.5f;
    const int4 near = (int4)((int)steps.x, (int)steps.y, (int)steps.z, 0);
    return near - (int4)(steps.x < near.x, steps.y < near.y, steps.z < near.z, 0);
}

/* How far a place lies inside one of the sides of the grid and a cell around it, in cells · w; before it hair may count. */
inline float inside_grid(const Grid *grid, float4 p, int side)
{
    const float4 c = ((grid->to_grid[0] * p.x + grid->to_grid[1] * p.y) + grid->to_grid[2] * p.z) + grid->to_grid[3];
    return side == 0 ? c.w - grid->face.w : side == 1 ? (grid->size.z + 1.0f) - c.z : side == 2 ? c.x + c.w
         : side == 3 ? (grid->size.x + 1.0f) * c.w - c.x : side == 4 ? c.y + c.w
         : side == 5 ? (grid->size.y + 1.0f) * c.w - c.y : c.z + 1.0f;
}

/* Cut the way from a to b [x, y, z, width] to these sides; whether anything is left. For the rare one that goes on for
   more than four grids. */
inline bool cut_to_grid(const Grid *grid, float4 *a, float4 *b)
{
    for (int side = 0; side < (grid->size.w ? 6 : 7); ++side) {
        const float da = inside_grid(grid, *a, side), db = inside_grid(grid, *b, side);
        if (!(da >= 0.0f || db >= 0.0f))
            return false;
        if (da < 0.0f)
            *a = *b + (*a - *b) * (db / (db - da));
        else if (db < 0.0f)
            *b = *a + (*b - *a) * (da / (da - db));
    }
    return true;
}

/* The layer of a place: what lies before the grid counts in the first one, where it counts at all. */
inline int layer(const Grid *grid, int z)
{
    return grid->size.w && z < 0 ? 0 : z;
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
        | (c.y > (grid->size.y + 1) * c.w) << 3 | (c.z < -1.0f && !grid->size.w) << 4 | (c.z > grid->size.z + 1) << 5;
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
