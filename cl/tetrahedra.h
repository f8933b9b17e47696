/*
 * Rays through the tetrahedra that shell fur is divided into: three in each prism over a face between two slabs.  Where rays come
 * in, where they leave one, and into which they go on.  march.cl uses this, and lanes.h before it.
 */

/* Corners of the tetrahedra of a prism (0 1 2 below, 3 4 5 above them), and which way a ray leaves them that leaves out
   one of these: 4 · tetrahedron + the corner left out there; SIDE + 2 · side + 1 for the upper half of it, to the
   neighbour across that side (0: corners 1 2, 1: 0 2, 2: 0 1); DOWN, UP. */
#define SIDE 16
#define DOWN 24
#define UP 25
__constant uchar CORNER[12] = {
    0, 1, 2, 5,
    0, 1, 4, 5,
    0, 3, 4, 5,
};
__constant uchar WAY[12] = {
    SIDE, SIDE + 2, 4 + 2, DOWN,
    SIDE + 1, 8 + 1, 2, SIDE + 4,
    UP, 4 + 1, SIDE + 3, SIDE + 5,
};
/* Where a ray comes in by the lower and the upper half of each side: as above. */
__constant uchar BEHIND[6] = {0, 4 + 0, 1, 8 + 2, 4 + 3, 8 + 3};

/* Weights of a tetrahedron's corners where a ray goes through the side that leaves out corner `out`, from the areas
   that pairs of corners span with the ray. */
INLINED void weights(lanes_i out, const lanes e[6], lanes w[4])
{
    /* e: 01 02 03 12 13 23 */
    const lanes_i a = out == 0, b = out == 1, c = out == 2;
    w[0] = a ? F(0.0f) : b ? e[5] : c ? e[4] : e[3];
    w[1] = a ? e[5] : b ? F(0.0f) : c ? -e[2] : -e[1];
    w[2] = a ? -e[4] : b ? -e[2] : c ? F(0.0f) : e[0];
    w[3] = a ? e[3] : b ? e[1] : c ? e[0] : F(0.0f);
    const lanes sum = (w[0] + w[1]) + (w[2] + w[3]);
    const lanes_i flat = sum == 0.0f;
    const lanes scale = 1.0f / (flat ? F(1.0f) : sum);
    for (int i = 0; i < 4; ++i)
        w[i] = flat ? F(0.25f) : w[i] * scale;
}

/* Rays in every lane: direction, and two axes across it. */
typedef struct {
    lanes dx, dy, dz, ax, ay, az, ux, uy, uz;
} Rays;

/* Where rays come in by triangles of the border [-1: not at all]: the triangles' corners seen from the eye, the cell and the
   corner left out.  Most come in by the same few triangles. */
INLINED void come_in(lanes_i by, __global const uint4 *border, __global const uint4 *faces, __global const float4 *curves,
                     int slabs, float4 eye, lanes3 q[3], lanes_i *cell, lanes_i *in)
{
    for (int triangle = most_lane(by); triangle >= 0; triangle = most_lane(by)) {
        const lanes_i group = by == triangle;
        const uint4 start = border[triangle], f = faces[start.x];
        const int k = start.y / 4 % 3, out = start.y % 4, slab = start.y / 12;
        for (int n = 0, m = 0; n < 4; ++n)
            if (n != out) {
                const int c = CORNER[4 * k + n], side = c < 3 ? c : c - 3;
                const float4 corner = curves[(side == 0 ? f.x : side == 1 ? f.y : f.z) * (slabs + 1) + slab + (c >= 3)] - eye;
                q[m].x = group ? F(corner.x) : q[m].x;
                q[m].y = group ? F(corner.y) : q[m].y;
                q[m].z = group ? F(corner.z) : q[m].z;
                ++m;
            }
        *cell = group ? I(3 * (slabs * (int)start.x + slab) + k) : *cell;
        *in = group ? I(out) : *in;
        by = group ? I(-1) : by;
    }
}

/* Rays through places p seen from the eye, which snapped corners and rounded depths leave a little beside the triangles
   with corners q: they are put in. */
INLINED Rays rays_through(const lanes3 q[3], lanes3 p)
{
    const lanes3 a = plus(q[0], scaled(p, F(-1.0f))), b = plus(q[1], scaled(p, F(-1.0f))), c = plus(q[2], scaled(p, F(-1.0f)));
    const lanes3 n = crosses(plus(b, scaled(a, F(-1.0f))), plus(c, scaled(a, F(-1.0f))));
    const lanes smaller = 1.0f / greater(dots(n, n), F(1e-37f));
    const lanes wa = greater(dots(crosses(b, c), n) * smaller, F(1e-3f)),
        wb = greater(dots(crosses(c, a), n) * smaller, F(1e-3f)), wc = greater(dots(crosses(a, b), n) * smaller, F(1e-3f));
    const lanes3 d = unit(plus(scaled(q[0], wa), plus(scaled(q[1], wb), scaled(q[2], wc))));
    /* Two axes across the ray (Duff et al. 2017). */
    const lanes sign = d.z >= 0.0f ? F(1.0f) : F(-1.0f), u = -1.0f / (sign + d.z), uv = d.x * d.y * u;
    const Rays rays = {d.x, d.y, d.z, 1.0f + sign * d.x * d.x * u, sign * uv, -sign * d.x, uv, sign + d.y * d.y * u, -d.y};
    return rays;
}

/* The cells, -1: none, that rays go on into which leave a cell by the side that leaves out corner `out`; the corners left
   out there; -1 where it is another face. */
INLINED void onwards(int here, int slabs, int4 neighbours, lanes_i out, lanes_i *onto, lanes_i *entry, lanes_i *fresh)
{
    const int k = here % 3, slab = here / 3 % slabs;
    *onto = I(-1);
    *entry = *fresh = I(0);
    for (int i = 0; i < 4; ++i) {
        const int way = WAY[4 * k + i];
        int there = -1, by = 0, other = 0;
        if (way < SIDE) {
            there = here - k + way / 4;
            by = way % 4;
        } else if (way == UP) {
            there = slab + 1 == slabs ? -1 : here - k + 3;
            by = 3;
        } else if (way == DOWN) {
            there = slab == 0 ? -1 : here - k - 3 + 2;
        } else {
            const int side = (way - SIDE) / 2;
            const int across = side == 0 ? neighbours.x : side == 1 ? neighbours.y : neighbours.z;
            const int behind = across < 0 ? 0 : BEHIND[2 * (across & ((1 << SIDE_BITS) - 1)) + (way - SIDE) % 2];
            there = across < 0 ? -1 : 3 * (slabs * (across >> SIDE_BITS) + slab) + behind / 4;
            by = behind % 4;
            other = 1;
        }
        *onto = out == i ? I(there) : *onto;
        *entry = out == i ? I(by) : *entry;
        *fresh = out == i ? I(-other) : *fresh;
    }
}
