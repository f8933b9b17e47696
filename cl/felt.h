/* What points of strands that move feel of the hair around them: newton.h has it in its equations, and moving.h before it. */

/* Friction with other hair, implicit, and the push out of where it is too dense: hair_grid.cl's `feel`. */
INLINED void add_felt(const Moving *m, int i, lanes mass, lanes3 gone, lanes *own, lanes3 *right)
{
    if (!m->of_hair)
        return;
    const lanes3 pull = three_of(m->of_hair, m->stride, 4 * i);
    const lanes drag = row_of(m->of_hair, m->stride, 4 * i + 3) * mass / m->he;
    *own += drag;
    *right = plus(*right, minus(scaled(pull, mass), scaled(gone, drag)));
}
