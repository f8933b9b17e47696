/* Symmetric matrices of three rows, for strands side by side; after lanes.h. */

typedef struct {
    lanes xx, xy, xz, yy, yz, zz;
} Symmetric;

INLINED lanes3 times(const Symmetric *a, lanes3 v)
{
    const lanes3 product = {a->xx * v.x + a->xy * v.y + a->xz * v.z, a->xy * v.x + a->yy * v.y + a->yz * v.z,
                            a->xz * v.x + a->yz * v.y + a->zz * v.z};
    return product;
}

INLINED Symmetric inverse(const Symmetric *a)
{
    const lanes c0 = a->yy * a->zz - a->yz * a->yz, c1 = a->xz * a->yz - a->xy * a->zz, c2 = a->xy * a->yz - a->xz * a->yy;
    const lanes by = 1.0f / (a->xx * c0 + a->xy * c1 + a->xz * c2);
    const Symmetric p = {c0 * by, c1 * by, c2 * by, (a->xx * a->zz - a->xz * a->xz) * by,
                         (a->xy * a->xz - a->xx * a->yz) * by, (a->xx * a->yy - a->xy * a->xy) * by};
    return p;
}

/* a += by · v vᵀ */
INLINED void add_square(Symmetric *a, lanes by, lanes3 v)
{
    const lanes3 w = scaled(v, by);
    a->xx += w.x * v.x;
    a->xy += w.x * v.y;
    a->xz += w.x * v.z;
    a->yy += w.y * v.y;
    a->yz += w.y * v.z;
    a->zz += w.z * v.z;
}
