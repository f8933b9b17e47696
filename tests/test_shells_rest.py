"""Cells and noise of shell fur belong to the skin: they turn, move and bend with it."""

import attrs
import numpy as np
import pytest
from support.furred import FUR, MESHES

import clfur
from clfur.stages import shells as stage
from clfur.twin import shells as twin

QUARTER = np.array([(0, 0, 1), (1, 0, 0), (0, 1, 0)], float)
FURRY = FUR | {"frequency": 12.0, "noise": (0.6, 4)}


def turn(axis, angle):
    """The matrix of a turn by degrees (Rodrigues' formula)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross, radians = np.array([(0, -z, y), (z, 0, -x), (-y, x, 0)]), np.radians(angle)
    return np.eye(3) + np.sin(radians) * cross + (1 - np.cos(radians)) * cross @ cross


TURNS = {"90": (QUARTER, (0, 0, 0)), "77": (turn((1, 2, 3), 77), (0, 0, 0)), "moved": (np.eye(3), (3.3, -2, 0.7)),
         "133, moved": (turn((3, -1, 1), 133), (-1, 0.25, 2))}


def placed(mesh, matrix, offset=(0, 0, 0)):
    return clfur.Mesh(mesh.positions @ matrix.T + offset, mesh.normals @ matrix.T, mesh.uv, mesh.faces)


def pattern_of(gpu, mesh, fur):
    """(`layout.Shells`, lattice [F, 8, 4], noise) that a device lays."""
    packed = stage.pack(fur, mesh, False, True)
    pattern = stage.lay(gpu, mesh, packed, stage.topology_of(mesh.faces), fur.rest)
    lattice, shape = pattern.lattice.get().reshape(-1, stage.CORNERS, 4), 4 * packed["noise"][2::-1]
    return packed, lattice.astype(float), pattern.noise.get().reshape(*shape, 2)


def heights(packed, lattice, noise):
    """How high fur stands at the same three places of each face, at half height."""
    weights = np.array([(.5, .3, .2), (.1, .2, .7), (.34, .33, .33)])
    corners = np.concatenate([lattice[:, 0].reshape(-1, 2, 2), lattice[:, 1, None, :2]], 1)
    at = (weights @ corners).reshape(-1, 2)
    faces = np.repeat(np.arange(len(lattice)), 3)
    return twin.height_at(packed, noise, faces, lattice[faces], at, np.full(len(at), .5))[0]


@pytest.mark.parametrize("how", TURNS)
@pytest.mark.parametrize("mesh", ["ball", "quad"])
def test_the_pattern_turns_with_the_mesh(gpu, mesh, how):
    """The same hairs at the same places of the skin; float32 places, 6e-8 of 3, are seen through slopes of 10."""
    mesh, fur = clfur.Mesh(*MESHES[mesh]), clfur.Shells(**FURRY)
    one, other = (heights(*pattern_of(gpu, each, fur)) for each in (mesh, placed(mesh, *TURNS[how])))
    assert one.std() > .1
    np.testing.assert_allclose(one, other, atol=1e-5)


def test_the_pattern_stays_in_every_pose(gpu):
    """Stretched, bent and moved: the cells and noise of the mesh in rest, though faces are of other sizes."""
    rest = clfur.Mesh(*MESHES["ball"])
    x, y, z = rest.positions.astype(float).T
    pose = clfur.Mesh(np.stack([1.7 * x + .4 * y * y + 5, y, .6 * z + .2 * x], 1), None, rest.uv, rest.faces)
    fur = clfur.Shells(**FURRY)
    still, posed = pattern_of(gpu, rest, fur), pattern_of(gpu, pose, attrs.evolve(fur, rest=rest))
    np.testing.assert_array_equal(heights(*still), heights(*posed))
    np.testing.assert_array_equal(still[1][:, [0, 5, 6, 7]], posed[1][:, [0, 5, 6, 7]])
    assert (np.abs(heights(*still) - heights(*pattern_of(gpu, pose, fur))) > .01).mean() > .5   # without rest: others


def test_a_pose_whose_corners_touch_keeps_its_pattern(gpu):
    """A vertex that comes to lie on another has its number: cells of a face begin at the same corner all the same."""
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0), (3, 0, 0), (2, 1, 0)], float)
    faces = np.array([(0, 1, 2), (4, 5, 3)])
    rest, touching = clfur.Mesh(positions, None, None, faces), positions.copy()
    touching[5] = touching[2]
    fur = clfur.Shells(**FURRY, rest=rest)
    still, posed = (pattern_of(gpu, mesh, fur) for mesh in (rest, clfur.Mesh(touching, None, None, faces)))
    # Vertex 5 comes first in the pose and is the last of its face in rest.
    np.testing.assert_array_equal(posed[1][1, 0, :2], still[1][1, 1, :2])
    np.testing.assert_array_equal(posed[1][1, 0, 2:], still[1][1, 0, :2])


@pytest.mark.parametrize("how", TURNS)
def test_a_turned_world_is_the_same_picture(gpu, how):
    """With noise as without: rays that pass an edge by rounding alone leave 2e-4 (root mean square) of either."""
    matrix, offset = TURNS[how]
    mesh = clfur.Mesh(*MESHES["ball"])

    def picture(noise, matrix, offset):
        camera = clfur.Camera(eye=matrix @ (1, .8, 2.6) + offset, target=offset, up=matrix @ (0, 1, 0), size=(80, 60))
        light = clfur.Light(direction=matrix @ (-1, -1, -.4))
        fur = clfur.Shells(**FURRY | {"noise": noise}, force=matrix @ (0, -.5, 0))
        scene = clfur.Scene(placed(mesh, matrix, offset), fur, camera, light)
        return clfur.render(scene, gpu, clfur.Settings(shadows="off")).astype(float)

    def change(noise):
        return np.sqrt(((picture(noise, np.eye(3), (0, 0, 0)) - picture(noise, matrix, offset))**2).mean())
    assert change((.6, 4)) <= 2 * change((0, 4)) + 2e-4


def test_gusts_turn_with_the_world(gpu):
    """A wave of gusts is as long in a mesh that is turned, also by 45 degrees, where its box is larger."""
    mesh, matrix = clfur.Mesh(*MESHES["quad"]), turn((0, 0, 1), 45)
    one, other = (stage.pack(clfur.Shells(wind=wind), placed(mesh, turned), False, True)["gust"]
                  for wind, turned in (((1, 0, 0), np.eye(3)), (matrix @ (1, 0, 0), matrix)))
    np.testing.assert_allclose(matrix @ one[:3], other[:3], atol=1e-6)


def test_a_frame_of_its_own():
    """It turns and moves with the vertices, does not hang on their size, and its axes stand upright on each other."""
    for mesh in (clfur.Mesh(*MESHES["ball"]), clfur.Mesh(*MESHES["quad"]), clfur.Mesh(np.eye(3), faces=[(0, 1, 2)])):
        center, axes, radius = mesh.own_frame
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        matrix, offset = TURNS["133, moved"]
        turned_center, turned_axes, turned_radius = placed(mesh, 3 * matrix, offset).own_frame
        np.testing.assert_allclose(turned_center, 3 * matrix @ center + offset, atol=1e-6)
        np.testing.assert_allclose(turned_axes, axes @ matrix.T, atol=1e-6)
        assert turned_radius == pytest.approx(3 * radius, rel=1e-6)


@pytest.mark.parametrize("corners", [1, 2])
@pytest.mark.parametrize("pattern", ["cells", "sine"])
def test_faces_without_area_are_drawn(gpu, corners, pattern):
    """A face that has become a point or a line: the others' pattern is the same, and nothing is no number."""
    rest = clfur.Mesh(*MESHES["ball"])
    places = rest.positions.astype(float)
    face = rest.faces[7]
    places[face[:2 if corners == 2 else 3]] = places[face].mean(0)
    pose = clfur.Mesh(places, None, rest.uv, rest.faces)
    fur = clfur.Shells(**FURRY | {"pattern": pattern}, rest=rest)
    scene = clfur.Scene(pose, fur, clfur.Camera(eye=(1, .8, 2.6), size=(80, 60)))
    assert len(pose.faces) < len(scene.mesh.faces) == len(rest.faces)
    packed, topology = stage.pack(fur, scene.mesh, False, True), stage.topology_of(scene.mesh.faces)
    lattice = stage.lay(gpu, scene.mesh, packed, topology, rest).lattice.get().reshape(-1, stage.CORNERS, 4)
    expected = twin.lattice(packed, scene.mesh.positions, scene.mesh.normals, topology.corners,
                            np.take_along_axis(rest.uv, topology.order[..., None], 1),
                            stage.resting(rest, topology).reshape(-1, 3, 4))
    np.testing.assert_allclose(lattice, expected, rtol=1e-3, atol=1e-3)
    assert not lattice[7, 2:4, :3].any()
    for settings in clfur.Settings(), clfur.Settings(shadows="binary", samples=1):
        drawn = clfur.draw(scene, gpu, settings, ("color", "normal", "coverage"))
        assert all(np.isfinite(image).all() for image in drawn.images.values())
        assert drawn.images["coverage"].sum() > 100


def test_a_rest_of_another_mesh_is_refused():
    mesh, other = clfur.Mesh(*MESHES["ball"]), clfur.Mesh(*MESHES["quad"])
    with pytest.raises(clfur.Error, match=r"^Shells\.rest has 2 faces and Scene\.mesh 80"):
        clfur.Scene(mesh, clfur.Shells(rest=other))
    with pytest.raises(clfur.Error, match=r"^Shells\.rest is 3; allowed: an object of class Mesh or None$"):
        clfur.Shells(rest=3)


def test_another_rest_is_laid_anew(gpu):
    """What a device keeps of the fur goes with the mesh in rest."""
    mesh = clfur.Mesh(*MESHES["ball"])
    wide = clfur.Mesh(2 * mesh.positions, mesh.normals, mesh.uv, mesh.faces)
    camera = clfur.Camera(eye=(0, 0, 3), size=(40, 30))
    one, other = (clfur.Scene(mesh, clfur.Shells(**FURRY, rest=rest), camera) for rest in (mesh, wide))
    first = clfur.render(one, gpu)
    assert np.abs(clfur.render(other, gpu) - first).max() > .05
    np.testing.assert_array_equal(clfur.render(one, gpu), first)
