"""Polygons become triangles that cover just them."""

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import mesh_files

from clfur.errors import Error
from clfur.files import polygons
from clfur.files.meshes import load_mesh
from clfur.files.polygons import by_size, triangulate
from clfur.scene import Mesh

SQUARE = [(0, 0), (4, 0), (4, 4), (0, 4)]
HOLE = [(0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]   # behind SQUARE: a bridge, a hole of 4, the bridge back
SHAPES = {   # outlines and their areas
    "concave quad": ([(0, 0), (4, 0), (1, 1), (1, 3)], 3),
    "arrow of area 5": ([(0, 0), (5, 0), (1, 1), (0, 5)], 5),
    "L": ([(0, 2), (0, 0), (2, 0), (2, 1), (1, 1), (1, 2)], 3),
    "bridged hole": (SQUARE + HOLE, 12),
    "comb": ([(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (5, 1), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (0, 3)], 17),
    "straight sides": ([(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)], 4),
    "straight at the apex": ([(0, 0), (1, 0), (2, 0), (3, 0), (1.5, 3)], 4.5),
    "triangle of four": ([(0, 0), (1, 0), (2, 0), (0, 2)], 2),
    "corner twice": ([(0, 0), (2, 0), (2, 0), (2, 2), (0, 2)], 4),
    "touching itself": ([(0, 0), (2, 0), (1, 1), (2, 2), (0, 2), (1, 1)], 2),
}


def area_of(outline):
    """The area float of an outline [n, 2], counter-clockwise: by the shoelace formula."""
    x, y = np.transpose(outline).astype(float)
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def placed(outline, seed):
    """The outline [n, 2] in a plane of space: float64 [n, 3], and the plane's normal [3]."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn[:, 2] = np.cross(turn[:, 0], turn[:, 1])
    return np.asarray(outline, float) @ turn[:, :2].T + turn[:, 2] * 3, turn[:, 2]


def covered(points, triangles, normal):
    """Areas along the normal of triangles [F, 3] of points [n, 3]: float64 [F]."""
    corners = np.asarray(points, float)[triangles]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ normal / 2


def cut(outline, seed):
    points, normal = placed(outline, seed)
    triangles, owner = triangulate(points, np.arange(len(points)), [len(points)])
    assert not owner.any()
    return triangles, covered(points, triangles, normal)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", SHAPES)
def test_known_shapes_keep_their_area(name, seed):
    """Whichever corner is the first."""
    outline, area = SHAPES[name]
    for first in range(len(outline)):
        turned = outline[first:] + outline[:first]
        triangles, areas = cut(turned, seed)
        assert abs(area_of(turned) - area) < 1e-12
        assert areas.min() > -1e-12 and abs(areas.sum() - area) < 1e-11, (name, first)
        if name != "touching itself":
            assert {turned[k] for k in np.unique(triangles)} == set(turned)   # no corner lost


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "stl"])
def test_files_keep_their_area(tmp_path, suffix, name):
    outline, area = SHAPES[name]
    points = np.pad(np.asarray(outline, float), ((0, 0), (0, 1)))
    loops = "".join("vertex {} {} {}\n".format(*point) for point in points)
    data = {"obj": mesh_files.obj(points, [range(len(points))]),
            "off": mesh_files.off(points, [range(len(points))]),
            "ply": mesh_files.ply_of(points, [range(len(points))]).decode(),
            "stl": f"solid a\nfacet normal 0 0 1\nouter loop\n{loops}endloop\nendfacet\nendsolid a\n"}[suffix]
    file = tmp_path / f"a.{suffix}"
    file.write_text(data)
    mesh = load_mesh(file)
    assert abs(mesh.area - area) < 1e-6 and (mesh.normals == [0, 0, 1]).all()


@st.composite
def stars(draw):
    """Outlines of polygons around the origin, every side of which is seen from there; some with a hole there."""
    n = draw(st.integers(4, 24))
    radii = np.array(draw(st.lists(st.integers(4, 40), min_size=n, max_size=n)), float)
    angles = (np.arange(n) + np.array(draw(st.lists(st.floats(0, .6), min_size=n, max_size=n)))) * 2 * np.pi / n
    outline = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    if not draw(st.booleans()):
        return outline
    hole = np.stack([np.cos(angles), np.sin(angles)], axis=1)   # joined from the first corner
    return np.concatenate([outline, outline[:1], hole[:1], hole[:0:-1], hole[:1]])


@given(stars(), st.integers(0, 9), st.integers(0, 30))
def test_triangles_cover_a_polygon_once(outline, seed, first):
    """They have its area together, and none lies outside: each is inside of it at its middle, and crosses no side."""
    outline = np.roll(outline, -first, axis=0)
    triangles, areas = cut(outline, seed)
    assert areas.min() > -1e-9 and abs(areas.sum() - area_of(outline)) < 1e-9 * 40**2
    for middle in outline[triangles[areas > 1e-9]].mean(axis=1):
        assert abs(turns_around(outline, middle) - 1) < 1e-9


def turns_around(outline, point):
    """How often an outline [n, 2] goes around a point: 1 inside, 0 outside."""
    a, b = outline - point, np.roll(outline, -1, axis=0) - point
    return np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum() / (2 * np.pi)


@given(st.lists(st.integers(0, 9), max_size=40), st.integers(0, 1000))
def test_convex_polygons_stay_fans(sizes, seed):
    """Of any size, and bent out of their plane a little: then triangles are those of a fan, in their order."""
    rng = np.random.default_rng(seed)
    points, expected, owners, start = [], [], [], 0
    for k, n in enumerate(sizes):
        angles = 2 * np.pi * (np.arange(n) + rng.random(n) * .7) / max(n, 1)
        circle, normal = placed(np.stack([np.cos(angles), np.sin(angles)], axis=1), k)
        points += list(circle + normal * rng.random((n, 1)) * .01 * (n > 3))
        expected += [(start, start + i, start + i + 1) for i in range(1, n - 1)]
        owners += [k] * (n - 2)
        start += n
    triangles, owner = triangulate(np.reshape(points, (-1, 3)), np.arange(start), sizes)
    many = np.asarray(sizes, int)[owner] > 2
    assert triangles[many].tolist() == [list(each) for each in expected] and owner[many].tolist() == owners
    few = triangles[~many]   # faces of two, one and no corners: a triangle without area each
    assert len(few) == (sum(n < 3 for n in sizes) if start else 0) and (few[:, 1] == few[:, 2]).all()


def test_a_fan_that_is_right_is_kept():
    """Also where the polygon is not convex, or has a corner twice: pictures stay what they were."""
    for outline in ([(0, 0), (3, -1), (2, 0), (3, 1)], [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
                    [(0, 0), (2, 0), (2, 0), (0, 2)]):
        n = len(outline)
        assert cut(outline, 1)[0].tolist() == [[0, k, k + 1] for k in range(1, n - 1)]


def test_what_has_no_inside_stays_a_fan():
    for outline in ([(0, 0), (1, 0), (2, 0), (1, 0), (0, 0)], [(0, 0)] * 5, [(0, 0), (1, 1), (1, 0), (0, 1)],
                    [(0, 0), (1, 1), (2, 0), (2, 1), (1, 0), (0, 1)]):
        n = len(outline)
        assert cut(outline, 2)[0].tolist() == [[0, k, k + 1] for k in range(1, n - 1)]
    bad = np.array([(0, 0, 0), (4, 0, 0), (1, np.nan, 0), (0, 4, 0), (np.inf, 0, 0)])
    assert triangulate(bad, np.arange(5), [5])[0].tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]


def test_polygons_far_from_the_origin():
    outline = np.asarray(SHAPES["arrow of area 5"][0], float)
    points = np.pad(outline, ((0, 0), (0, 1))) + (431250, 5411800, 55)
    triangles, _ = triangulate(points, np.arange(4), [4])
    assert covered(points - points[0], triangles, np.array([0, 0, 1])).min() > 0


def test_a_polygon_out_of_its_plane():
    """An L whose corners stand 0.2 above and below: in the projection it is covered once."""
    outline, area = SHAPES["L"]
    points = np.column_stack([outline, [.2, -.2, .2, -.2, .2, -.2]])
    triangles, _ = triangulate(points, np.arange(6), [6])
    areas = covered(points, triangles, np.array([0, 0, 1]))
    assert (areas > 0).all() and abs(areas.sum() - area) < 1e-12


def test_the_order_that_ply_and_off_had():
    sizes = [4, 3, 5, 4]
    points = np.concatenate([np.pad(np.stack([np.cos(a), np.sin(a)], 1), ((0, 0), (0, 1)))
                             for a in (2 * np.pi * np.arange(n) / n for n in sizes)])
    triangles, _ = by_size(*triangulate(points, np.arange(16), sizes), sizes)
    assert triangles.tolist() == [[4, 5, 6], [0, 1, 2], [12, 13, 14], [2, 3, 0], [14, 15, 12],
                                  [7, 8, 9], [7, 9, 10], [7, 10, 11]]


def test_uv_and_normals_follow_their_corners(tmp_path):
    outline, _ = SHAPES["comb"]
    text = "".join(f"v {x} {y} 0\nvt {x / 8} {y / 8}\n" for x, y in outline) + "f " + " ".join(
        f"{k}/{k}" for k in range(1, len(outline) + 1))
    (tmp_path / "a.obj").write_text(text)
    mesh = load_mesh(tmp_path / "a.obj")
    assert np.array_equal(mesh.uv, mesh.positions[mesh.faces][..., :2] / 8)


def test_a_circle_of_a_million_corners():
    """It is a fan, though rounding has dented it, and takes at most 200 bytes a corner; text has some 30."""
    n = 10**6
    angles = 2 * np.pi * np.arange(n) / n
    points = np.round(np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1), 6)
    tracemalloc.start()
    began = time.perf_counter()
    triangles, _ = triangulate(points, np.arange(n), [n])
    seconds, peak = time.perf_counter() - began, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(triangles) == n - 2 and (triangles[:, 0] == 0).all()
    assert peak < 200 * n and seconds < 60


def test_a_polygon_that_is_too_large_to_cut(monkeypatch):
    monkeypatch.setattr(polygons, "MOST_CORNERS", 11)
    with pytest.raises(Error, match="not convex has 12 corners; allowed: at most 11"):
        cut(SHAPES["comb"][0], 0)


CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


@pytest.mark.parametrize("again", [lambda q: q[::-1], lambda q: [*q[2::-1], q[3]], lambda q: q[1:] + q[:1], list])
@pytest.mark.parametrize("own", [True, False])
def test_both_sides_of_a_quad_are_cut_alike(again, own):
    """A cube of which each side is there twice, with vertices of its own or not: one of each is left."""
    corners = np.array([*SIDES, *map(again, SIDES)])
    positions = CUBE
    if own:
        positions, corners = CUBE[corners].reshape(-1, 3), np.arange(48).reshape(-1, 4)
    triangles, _ = triangulate(positions, corners.ravel(), np.full(12, 4))
    mesh = Mesh(positions, faces=corners.ravel()[triangles])
    assert len(mesh.faces) == 12 and mesh.doubled_faces == 12
    normals = mesh.positions[mesh.faces].mean(1) * mesh.normals[mesh.faces].mean(1)
    assert (normals.sum(1) > 0).all()   # outwards


@pytest.mark.parametrize("name", SHAPES)
def test_both_sides_of_a_polygon_are_cut_alike(name):
    outline, area = SHAPES[name]
    points = np.column_stack([np.array(outline, float), np.zeros(len(outline))])
    corners = np.append(np.arange(len(points)), np.roll(np.arange(len(points))[::-1], 1))
    triangles, owner = triangulate(points, corners, np.full(2, len(points)))
    one, other = (np.sort(corners[triangles[owner == k]], 1) for k in (0, 1))
    once = len(np.unique(points, axis=0)) == len(points)
    if once:   # else it can go round its places in several ways
        assert sorted(map(tuple, one)) == sorted(map(tuple, other))
    a, b, c = np.moveaxis(points[corners[triangles]], 1, 0)
    signed = np.cross(b - a, c - a)[:, 2] / 2
    assert signed[owner == 0].sum() == pytest.approx(area) and signed[owner == 1].sum() == pytest.approx(-area)
