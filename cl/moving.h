/*
 * Strands side by side in a step: what is known of them, and the rows of floats in which all that they have lies.  motion.cl,
 * contact.h, felt.h, bending.h and newton.h use this, and distance.h before it.
 */

/* What is set aside for each point between the two ways along the strand: rows of the workspace.  contact.h has more. */
enum { PLACE = 0, FREE = 3, BASE = 6, REST = 9, SOLVED = 12, BY_ONE = 15, BY_TWO = 24, PULL = 30, TENSION = 37 };   // of ROWS_OF_POINT

/* Of strands side by side. */
typedef struct {
    size_t stride, work_stride;                 // from one row to the next [floats]
    __global const float *groomed, *lengths;    // from these strands on
    __global float *work;
    lanes_i n;                                  // segments
    lanes bend, air;                            // B / mass a length, with what damps it; 1 / air [1 / s]
    lanes he;                                   // [s] of implicit Euler's step
    lanes3 axes[3], before[3];                  // of the root, and a step ago
    lanes3 gravity;
    __global const float *winds;                // at points [world / s]
    __global const float *of_hair;              // what is felt of other hair, from these strands on, or 0
    bool feels;                                 // the body, of which the rest tells
    const Distances *grid;
    const Body *body;
    __global const float *values, *away, *places, *places_now;   // the last: where what a step begins with counts as being
    __global float *free, *pressed;
    lanes3 at, root_taken;                      // the root in the grid's frame; what it lacks of the body's way [world]
    lanes friction;
    float by_step;                              // [1 / s]
} Moving;

INLINED lanes row_of(__global const float *rows, size_t stride, int row)
{
    return *(__global const lanes *)(rows + row * stride);
}

INLINED lanes3 three_of(__global const float *rows, size_t stride, int row)
{
    const lanes3 v = {row_of(rows, stride, row), row_of(rows, stride, row + 1), row_of(rows, stride, row + 2)};
    return v;
}

INLINED void put_row(__global float *rows, size_t stride, int row, lanes v)
{
    *(__global lanes *)(rows + row * stride) = v;
}

INLINED void put_three(__global float *rows, size_t stride, int row, lanes3 v)
{
    put_row(rows, stride, row, v.x);
    put_row(rows, stride, row + 1, v.y);
    put_row(rows, stride, row + 2, v.z);
}

INLINED lanes3 kept(const Moving *m, int point, int row)
{
    return three_of(m->work, m->work_stride, point * ROWS_OF_POINT + row);
}

INLINED void keep(const Moving *m, int point, int row, lanes3 v)
{
    put_three(m->work, m->work_stride, point * ROWS_OF_POINT + row, v);
}

INLINED lanes3 in_axes(const lanes3 *axes, lanes3 v)
{
    const lanes3 parts = {dots(axes[0], v), dots(axes[1], v), dots(axes[2], v)};
    return parts;
}

INLINED lanes3 from_axes(const lanes3 *axes, lanes3 v)
{
    return plus(plus(scaled(axes[0], v.x), scaled(axes[1], v.y)), scaled(axes[2], v.z));
}

/* p turned by the least rotation that takes unit a to unit b. */
INLINED lanes3 turned(lanes3 a, lanes3 b, lanes3 p)
{
    const lanes3 axis = crosses(a, b), once = crosses(axis, p);
    const lanes d = 1.0f + dots(a, b);
    return plus(plus(p, once), scaled(crosses(axis, once), d > 1e-3f ? 1.0f / d : F(0.0f)));
}

INLINED lanes3 masked(lanes_i on, lanes3 v)
{
    return chosen(on, v, all_lanes((float4)(0.0f)));
}
