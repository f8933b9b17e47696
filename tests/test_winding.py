"""Which side of a mesh is outside, however its faces are wound."""

import time

import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.scene import winding

BALL = icosphere(2)


def mesh_of(*parts, **options):
    """A Mesh of parts (positions, faces)."""
    first = np.cumsum([0, *(len(positions) for positions, _ in parts)])
    return clfur.Mesh(np.concatenate([positions for positions, _ in parts]),
                      faces=np.concatenate([faces + n for (_, faces), n in zip(parts, first)]), **options)


def ball(size=1.0, at=(0, 0, 0), inwards=False):
    positions, faces = BALL
    return size * positions + at, faces[:, ::-1] if inwards else faces


def outward(mesh, at=(0, 0, 0), size=1.0, tolerance=1e-3):
    """1 where the normals of a ball's places point out of it, -1 where all point in, 0 otherwise."""
    away = mesh.positions + mesh.origin - at
    there = np.abs(np.linalg.norm(away, axis=1) - size) < tolerance
    sides = np.sign((away * mesh.normals)[there].sum(1))
    assert there.any()
    return int(sides[0]) if (sides == sides[0]).all() else 0


def grid(n=7, m=5, wrap=False, twist=False):
    """A sheet in z = 0, or joined to a ring, or to a Moebius strip -> (positions, faces)."""
    u, v = (each.ravel() for each in np.mgrid[0:n + 1, 0:m + 1])
    a, b = np.mgrid[0:n, 0:m].reshape(2, -1)
    corner = a * (m + 1) + b
    quads = np.stack([corner, corner + m + 1, corner + m + 2, corner + 1], 1)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    if not wrap:
        return np.stack([u, v, 0.0 * u], 1), faces
    turn, across = 2 * np.pi * (u % n) / n, np.where((u == n) & twist, m - v, v) - m / 2
    tilt = turn / 2 * twist
    radius = 9 + across * np.sin(tilt)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), across * np.cos(tilt)], 1), faces


def some_turned(faces, share, seed=1):
    turned = np.random.default_rng(seed).random(len(faces)) < share
    return np.where(turned[:, None], faces[:, ::-1], faces), int(turned.sum())


# --- inside out -----------------------------------------------------------------------------------------------


def test_a_ball_that_is_inside_out_is_turned():
    right, wrong = mesh_of(ball()), mesh_of(ball(inwards=True))
    assert (right.turned_faces, wrong.turned_faces) == (0, 320) and wrong.doubled_faces == 0
    np.testing.assert_allclose(wrong.normals, right.normals, atol=1e-7)
    np.testing.assert_array_equal(wrong.kept_faces, np.arange(320))


def test_hair_of_a_ball_that_was_inside_out_stands_outside(gpu):
    hair = clfur.HairType(segments=4, segment_length=.1)
    scene = clfur.Scene(mesh_of(ball(inwards=True)), clfur.Strands(inner=1, outer=1, types=[hair], force=(0, 0, 0)))
    tips = clfur.grow(scene, gpu).points.reshape(-1, 5, 3)[:, -1]
    np.testing.assert_allclose(np.linalg.norm(tips, axis=1), 1.38, atol=.03)


@pytest.mark.parametrize("at", [(0, 0, 0), (1e4, 50, -1e4)])
def test_each_ball_by_itself(at):
    """Also far from the origin, where a volume about it would be rounding errors."""
    mesh = mesh_of(ball(at=at), ball(at=np.add(at, (3, 0, 0)), inwards=True))
    assert mesh.turned_faces == 320 and [outward(mesh, at), outward(mesh, np.add(at, (3, 0, 0)))] == [1, 1]


@pytest.mark.parametrize("inside_out", [False, True])
def test_the_wall_of_a_hollow_stays_the_wall_of_a_hollow(inside_out):
    """A ball with a hollow in which a ball lies: all of it as it should be, or all the other way round."""
    mesh = mesh_of(ball(inwards=inside_out), ball(.6, inwards=not inside_out), ball(.3, inwards=inside_out))
    assert mesh.turned_faces == 960 * inside_out
    assert [outward(mesh, size=size) for size in (1, .6, .3)] == [1, -1, 1]


def test_what_is_in_a_box_need_not_be_inside():
    """In a corner of the large ball's box, outside of the ball."""
    mesh = mesh_of(ball(), ball(.1, (.9, .9, .9), inwards=True))
    assert mesh.turned_faces == 320 and outward(mesh, (.9, .9, .9), .1) == 1


def test_an_open_mesh_has_no_inside():
    """A sheet, and a ball with a hole: as they are."""
    assert mesh_of(grid()).turned_faces == 0 and (mesh_of(grid()).normals == (0, 0, 1)).all()
    positions, faces = grid()
    assert (mesh_of((positions, faces[:, ::-1])).normals == (0, 0, -1)).all()
    positions, faces = ball(inwards=True)
    assert mesh_of((positions, faces[1:])).turned_faces == 0


def test_solids_that_share_an_edge_or_a_corner():
    """Edges of four faces join nothing, and still no surface is open there."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for at in (1, 1, 0), (1, 1, 1):
        for first, second in (faces, faces[:, ::-1]), (faces[:, ::-1], faces[:, ::-1]), (faces, faces):
            mesh = mesh_of((corners, first), (corners + at, second))
            expected = 12 * sum(part is not faces for part in (first, second))
            assert mesh.turned_faces == expected


# --- at odds --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [.01, .3, .49])
def test_faces_at_odds_with_their_neighbours_are_turned(share):
    for positions, faces in (ball(), grid(), grid(9, 2, wrap=True)):
        odd, count = some_turned(faces, share)
        mesh, right = clfur.Mesh(positions, faces=odd), clfur.Mesh(positions, faces=faces)
        np.testing.assert_allclose(mesh.normals, right.normals, atol=1e-6)
        assert mesh.turned_faces == count and len(mesh.faces) == len(faces)


def test_most_faces_of_a_closed_mesh_may_be_wrong():
    positions, faces = ball()
    odd, count = some_turned(faces, .8)
    mesh = clfur.Mesh(positions, faces=odd)
    assert mesh.turned_faces == count and outward(mesh) == 1


def test_a_surface_with_one_side_is_told():
    mesh = clfur.Mesh(*[None] * 0, **dict(zip(("positions", "faces"), grid(12, 2, wrap=True, twist=True))))
    assert mesh.one_sided_faces == 48 and mesh.turned_faces == 0
    assert mesh_of(grid(12, 2, wrap=True)).one_sided_faces == 0


# --- doubled --------------------------------------------------------------------------------------------------


def interleaved(one, other):
    return np.stack([one, other], 1).reshape(-1, 3)


@pytest.mark.parametrize("order", ["front first", "back first", "in turn", "mixed"])
def test_a_two_sided_ball_keeps_its_outside(order):
    positions, front = ball()
    back = front[:, [0, 2, 1]]
    mixed = np.random.default_rng(3).permutation(np.concatenate([front, back[:, [2, 0, 1]]]))
    faces = {"front first": np.concatenate([front, back]), "back first": np.concatenate([back, front]),
             "in turn": interleaved(back, front), "mixed": mixed}[order]
    mesh = clfur.Mesh(positions, faces=faces)
    assert (mesh.doubled_faces, mesh.turned_faces, mesh.zero_normal_faces) == (320, 0, 0)
    np.testing.assert_allclose(mesh.normals, clfur.Mesh(positions, faces=front).normals, atol=1e-7)
    kept = positions[faces[mesh.kept_faces]]     # the very faces that look outwards
    assert (np.cross(kept[:, 1] - kept[:, 0], kept[:, 2] - kept[:, 0]) * kept[:, 0]).sum(1).min() > 0


def test_a_two_sided_sheet_keeps_its_first_side():
    positions, front = grid()
    mesh = clfur.Mesh(positions, faces=np.concatenate([front[:, ::-1], front]))
    assert mesh.doubled_faces == len(front) and (mesh.normals == (0, 0, -1)).all()
    np.testing.assert_array_equal(mesh.kept_faces, np.arange(len(front)))


def test_a_two_sided_sheet_with_vertices_and_normals_of_its_own():
    """As exporters write leaves and ears: each side has its vertices, its normals and its uv."""
    positions, front = grid()
    n, normals = len(positions), np.tile((0, 0, 1.0), (len(positions), 1))
    uv = np.concatenate([positions[:, :2], -positions[:, :2]])
    for up, down in (normals, -normals), (-normals, normals):   # also with normals against the winding
        mesh = clfur.Mesh(np.tile(positions, (2, 1)), np.concatenate([up, down]), uv,
                          np.concatenate([front, front[:, ::-1] + n]))
        kept = mesh.kept_faces
        assert mesh.doubled_faces == len(front) == len(kept) and mesh.zero_normal_faces == 0
        assert (mesh.normals == up[0]).all()
        np.testing.assert_array_equal(mesh.uv, uv[np.concatenate([front, front[:, ::-1] + n])[kept]])


def test_faces_that_are_there_twice_are_kept_once():
    positions, faces = ball()
    mesh = clfur.Mesh(positions, faces=np.concatenate([faces, faces[:7, [1, 2, 0]], faces[3:5]]))
    assert (mesh.doubled_faces, mesh.turned_faces) == (9, 0)
    np.testing.assert_array_equal(mesh.kept_faces, np.arange(320))
    np.testing.assert_array_equal(mesh.normals, clfur.Mesh(positions, faces=faces).normals)


# --- with normals ---------------------------------------------------------------------------------------------


def test_given_normals_tell_what_is_outside():
    """Whatever the winding: hair grows along them, as ever."""
    positions, faces = ball()
    for normals in positions, -positions:
        for given in faces, faces[:, ::-1], some_turned(faces, .4)[0]:
            mesh = clfur.Mesh(positions, normals, faces=given)
            assert mesh.turned_faces == 0 and len(mesh.faces) == 320
            np.testing.assert_allclose(mesh.normals, normals[0] @ positions[0] * mesh.positions, atol=1e-6)
            np.testing.assert_array_equal(mesh.positions[mesh.faces], np.float32(positions[given]))


@pytest.mark.parametrize("inwards", [False, True])
def test_normals_that_are_missing_follow_those_that_are_given(inwards):
    positions, faces = ball(inwards=inwards)
    normals = np.where(np.arange(len(positions))[:, None] % 3, positions, np.nan)
    mesh = clfur.Mesh(positions, normals, faces=faces)
    assert outward(mesh) == 1 and mesh.turned_faces == 0


# --- all of them ----------------------------------------------------------------------------------------------


def test_meshes_without_faults_keep_their_bits():
    """The normals are those of the faces as they are given, each added in its turn."""
    rng = np.random.default_rng(2)
    for positions, faces in (ball(), grid(), grid(12, 3, wrap=True)):
        positions = positions + rng.normal(0, .01, positions.shape)
        order = rng.permutation(len(faces))
        mesh = clfur.Mesh(positions, faces=faces[order])
        given = positions.astype(np.float32).astype(float)
        _, place = np.unique(given, axis=0, return_inverse=True)
        normal = np.cross(*(given[faces[order][:, k]] - given[faces[order][:, k - 1]] for k in (1, 2)))
        corner = place[faces[order].ravel()]
        sums = np.stack([np.bincount(corner, np.repeat(normal[:, k], 3)) for k in range(3)], 1)
        wanted = (sums / np.sqrt((sums**2).sum(1, keepdims=True))).astype(np.float32)
        np.testing.assert_array_equal(mesh.normals[mesh.faces.ravel()], wanted[corner])
        assert (mesh.doubled_faces, mesh.turned_faces, mesh.one_sided_faces) == (0, 0, 0)
        np.testing.assert_array_equal(mesh.positions[mesh.faces], positions.astype(np.float32)[faces[order]])


@pytest.mark.parametrize("n", [1, 2, 3, 1000])
def test_components_are_those_of_a_search(n):
    rng = np.random.default_rng(n)
    a, b = rng.integers(0, n, (2, n // 2 + 1))
    found = np.arange(n)
    for _ in range(n):
        before = found.copy()
        np.minimum.at(found, a, found[b])
        np.minimum.at(found, b, found[a])
        if (before == found).all():
            break
    np.testing.assert_array_equal(winding.components(n, a, b), found)


def test_components_of_a_star_and_of_a_chain():
    n = 20000
    chain = np.random.default_rng(1).permutation(n)
    assert (winding.components(n, chain[1:], chain[:-1]) == 0).all()
    for middle in 0, 7, n - 1:
        assert (winding.components(n, np.full(n, middle), np.arange(n)) == 0).all()


def test_thousands_of_parts_take_no_time():
    """4,000 balls of eight faces within a large one, all inside out: 0.3 s."""
    corners = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
    faces = np.array([(x, y, z) if (x + y + z) % 2 else (y, x, z) for x in (0, 1) for y in (2, 3) for z in (4, 5)])
    places = np.random.default_rng(1).uniform(-.5, .5, (4000, 1, 3))
    began = time.perf_counter()
    mesh = mesh_of(ball(inwards=False), *((.001 * corners + place, faces) for place in places))
    assert time.perf_counter() - began < 20
    assert mesh.turned_faces == 0   # walls of hollows, for all that can be known
    alone = mesh_of(*((.001 * corners + place, faces) for place in places))
    assert alone.turned_faces == 32000


def test_normals_that_point_inwards_are_told():
    """Those that are given count, so that fur grows inside of a closed mesh: this is not to happen without a word."""
    mesh = clfur.load_mesh("sphere")
    inwards = clfur.Mesh(mesh.positions, -mesh.normals, faces=mesh.faces)
    assert inwards.inward and not mesh.inward
    np.testing.assert_allclose(inwards.normals, -mesh.normals, atol=1e-6)
    bowl = clfur.Mesh(mesh.positions, -mesh.normals, faces=mesh.faces[1:])
    assert not bowl.inward   # open: it has no inside
