/*
 * How far places are from the body, looked up in a grid of nodes (the stage distance): below 0 inside.  Where no node near
 * knows, it is the largest distance that any knows, grid->reach.x.
 */
#include "lanes.h"

typedef struct {
    lanes value;     // [world]
    lanes3 slope;    // how fast it grows along x, y and z; about of length 1
} Near;

/* The cell of a coordinate on an axis of so many nodes: its first node, and how far in it, 0 to 1. */
INLINED lanes cell_of(lanes x, int nodes, lanes *within_cell)
{
    const lanes inside = within(x, 0.0f, (float)(nodes - 1)), low = lesser(whole_below(inside), F((float)(nodes - 2)));
    *within_cell = inside - low;
    return low;
}

/* In the lanes that are `asked` for; in others it is anything. */
INLINED Near near_at(const Distances *grid, __global const float *values, lanes_i asked, lanes3 p)
{
    lanes3 f;
    const lanes x = cell_of((p.x - grid->place.x) * grid->place.w, grid->size.x, &f.x);
    const lanes y = cell_of((p.y - grid->place.y) * grid->place.w, grid->size.y, &f.y);
    const lanes z = cell_of((p.z - grid->place.z) * grid->place.w, grid->size.z, &f.z);
    const lanes_i first = (nearest_i(z) * grid->size.y + nearest_i(y)) * grid->size.x + nearest_i(x);
    const int row = grid->size.x, layer = grid->size.x * grid->size.y;
    lanes a = F(0.0f), b = a, c = a, d = a, e = a, g = a, h = a, k = a;   // corners: x runs first, then y, then z
    for (uint bits = bits_of(asked); bits; bits &= bits - 1) {
        const int lane = first_of(bits);
        __global const float *v = values + LANE_I(first, lane);
        LANE(a, lane) = v[0];
        LANE(b, lane) = v[1];
        LANE(c, lane) = v[row];
        LANE(d, lane) = v[row + 1];
        LANE(e, lane) = v[layer];
        LANE(g, lane) = v[layer + 1];
        LANE(h, lane) = v[layer + row];
        LANE(k, lane) = v[layer + row + 1];
    }
    const lanes ab = b - a, cd = d - c, eg = g - e, hk = k - h;
    const lanes ay = a + f.x * ab, cy = c + f.x * cd, ey = e + f.x * eg, hy = h + f.x * hk;
    const lanes low = ay + f.y * (cy - ay), high = ey + f.y * (hy - ey);
    const lanes low_x = ab + f.y * (cd - ab), high_x = eg + f.y * (hk - eg);
    const lanes low_y = cy - ay, high_y = hy - ey;
    Near near;
    near.value = low + f.z * (high - low);
    near.slope.x = (low_x + f.z * (high_x - low_x)) * grid->place.w;
    near.slope.y = (low_y + f.z * (high_y - low_y)) * grid->place.w;
    near.slope.z = (high - low) * grid->place.w;
    return near;
}
