"""tessellate in float64 NumPy, from the definitions: OpenGL 4.6 section 11.2.2.1, Vlachos et al. 2001."""

import numpy as np

from .vectors import unit

# The domain as OpenGL draws it: an equilateral triangle about the origin, corners counter-clockwise.
DOMAIN = np.array([[1, 0], [-0.5, 0.75**0.5], [-0.5, -(0.75**0.5)]])


def tessellate(
    positions,  # [V, 3]
    normals,    # [V, 3] unit
    uv,         # [F, 3, 2] by corner
    faces,      # [F, 3] vertices
    inner,      # level 1..64, one or [F]
    outer,      # level 1..64, one or [F, 3]; outer[:, i] is the side opposite corner i
    curved,     # PN triangles, or flat ones
):
    """Divide every face: (positions [N, 3], normals [N, 3], uv [N, 2], barycentric [N, 3], triangles [T, 4]).

    A triangle is three vertices counter-clockwise and its face; faces follow one another in both arrays.
    """
    levels = np.empty((len(faces), 4), int)
    levels[:, :3], levels[:, 3] = outer, inner
    distinct, which = np.unique(levels, axis=0, return_inverse=True)
    patterns = [pattern(level[3], level[:3]) for level in distinct]
    which = which.ravel()
    first = np.cumsum([0, *(len(patterns[w][0]) for w in which)])
    first_triangle = np.cumsum([0, *(len(patterns[w][1]) for w in which)])

    new_positions, new_normals, place = (np.empty((first[-1], 3)) for _ in range(3))
    new_uv = np.empty((first[-1], 2))
    triangles = np.empty((first_triangle[-1], 4), int)
    for w, (barycentric, joined) in enumerate(patterns):
        mine = np.flatnonzero(which == w)
        corners = np.asarray(faces)[mine]
        p, n = (np.asarray(a, float)[corners] for a in (positions, normals))            # [faces, corner, 3]
        rows = first[mine, None] + np.arange(len(barycentric))
        new_positions[rows], new_normals[rows] = (pn_triangle if curved else flat_triangle)(p, n, barycentric)
        new_uv[rows] = np.einsum("vc,fcx->fvx", barycentric, np.asarray(uv, float)[mine])
        place[rows] = barycentric
        rows = first_triangle[mine, None] + np.arange(len(joined))
        triangles[rows, :3] = first[mine, None, None] + joined
        triangles[rows, 3] = mine[:, None]
    return new_positions, new_normals, new_uv, place, triangles


def pattern(inner, outer):
    """One divided domain: barycentric [V, 3] of its vertices and triangles [T, 3]; OpenGL 4.6, 11.2.2.1.

    Concentric rings from the border inwards, each counter-clockwise from corner 0; the triangles of the strip
    between the two outermost rings come first.  The domain is drawn in the plane and every ring is found by
    intersecting perpendiculars, as the specification tells it for equal spacing.
    """
    inner, outer = int(inner), [int(level) for level in outer]
    if inner == 1 and max(outer) > 1:
        inner = 2                               # "as though it were originally specified as 1 + epsilon"
    sides = [outer[2], outer[0], outer[1]]      # side i runs from corner i to corner i + 1
    vertices, triangles, n, base = [divided(DOMAIN, sides)], [], inner, 0
    corners = DOMAIN
    while n > 1:
        within = shrunk(corners, n)
        next_base = base + sum(sides)
        if n == 2:
            vertices.append(within[:1])         # all three corners are the centre
        else:
            vertices.append(np.concatenate([feet(corners, within, i, n) for i in range(3)]))
        for i in range(3):
            triangles += strip(ring_indices(base, sides, i), ring_indices(next_base, [n - 2] * 3, i))
        corners, n, sides, base = within, n - 2, [n - 2] * 3, next_base
    if n == 1:
        triangles.append((base, base + 1, base + 2))
    to_barycentric = np.linalg.inv(np.vstack([DOMAIN.T, np.ones(3)]))
    vertices = np.concatenate(vertices)
    barycentric = np.column_stack([vertices, np.ones(len(vertices))]) @ to_barycentric.T
    return barycentric, np.array(triangles)


def divided(corners, sides):
    """Points [sum(sides), 2] that divide a triangle's sides into equal segments, corner 0 first."""
    return np.array([corners[i] + (corners[(i + 1) % 3] - corners[i]) * j / sides[i]
                     for i in range(3) for j in range(sides[i])])


def shrunk(corners, n):
    """Corners [3, 2] of the next triangle inwards when this one has n segments a side.

    Each is where two lines meet that stand on the two sides at a corner, at the dividing point nearest to it.
    """
    result = []
    for i in range(3):
        along = corners[[i - 2, i - 1]] - corners[i]
        feet_of_lines = corners[i] + along / n
        result.append(np.linalg.solve(along, (along * feet_of_lines).sum(1)))
    return np.array(result)


def feet(corners, within, i, n):
    """Where lines that stand on side i at its dividing points 1..n-2 cross side i of the inner triangle."""
    a, b = within[i], within[(i + 1) % 3]
    points = corners[i] + (corners[(i + 1) % 3] - corners[i]) * np.arange(1, n - 1)[:, None] / n
    along = ((points - a) @ (b - a)) / ((b - a) @ (b - a))
    return a + along[:, None] * (b - a)


def ring_indices(base, sides, i):
    """Vertices along side i of a ring that starts at `base`, both ends included; no segments are a point."""
    start, count = sum(sides[:i]), max(sum(sides), 1)
    return [base + (start + j) % count for j in range(sides[i] + 1)]


def strip(outside, within):
    """Triangles between the vertices of an outer side and of the inner side beside it, counter-clockwise.

    Every segment of either is the base of one triangle.  In order of their middles along the side (the outer
    one first where they are equal), each new triangle takes the shorter of the two diagonals.
    """
    p, q = len(outside) - 1, len(within) - 1
    # Inner vertex b stands above point b + 1 of the q + 2 segments that the outer side has "temporarily".
    order = sorted([((2 * a + 1) * (q + 2), 0) for a in range(p)] + [((2 * b + 3) * p, 1) for b in range(q)])
    a = b = 0
    result = []
    for _, is_inner in order:
        if is_inner:
            result.append((outside[a], within[b + 1], within[b]))
            b += 1
        else:
            result.append((outside[a], outside[a + 1], within[b]))
            a += 1
    return result


def flat_triangle(
    p,            # [F, 3, 3] corners
    n,            # [F, 3, 3] their unit normals
    barycentric,  # [V, 3]
):
    """Position and unit normal [F, V, 3] each on flat triangles."""
    return np.einsum("vc,fcx->fvx", barycentric, p), unit(np.einsum("vc,fcx->fvx", barycentric, n))


def pn_triangle(p, n, barycentric):
    """Position and unit normal on curved triangles, as `flat_triangle`; Vlachos et al. 2001, section 3.

    The cubic's control points b210 ... lie at the thirds of the sides, put down into the tangent plane of the
    nearer corner; b111 = E + (E - V)/2.  The normal's n110 ... are mean normals mirrored across their side;
    as published, they have no factor 2.
    """
    b = barycentric.T[:, None, :, None]                                        # [corner, 1, V, 1]
    corner, normal = (np.moveaxis(a, 1, 0)[:, :, None] for a in (p, n))        # [corner, F, 1, 3]
    position = sum(b[i] ** 3 * corner[i] for i in range(3))
    slope = sum(b[i] ** 2 * normal[i] for i in range(3))
    edge_mean = 0
    for i in range(3):
        for j in {0, 1, 2} - {i}:
            along = corner[j] - corner[i]
            control = (2 * corner[i] + corner[j] - (along * normal[i]).sum(-1, keepdims=True) * normal[i]) / 3
            position = position + 3 * b[i] ** 2 * b[j] * control
            edge_mean = edge_mean + control / 6
            if i < j:
                both = normal[i] + normal[j]
                v = 2 * (along * both).sum(-1, keepdims=True) / (along * along).sum(-1, keepdims=True)
                slope = slope + 2 * b[i] * b[j] * unit(both - v * along)
    middle = edge_mean + (edge_mean - corner.mean(0)) / 2
    return position + 6 * b[0] * b[1] * b[2] * middle, unit(slope)
