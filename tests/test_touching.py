"""clfur.Motion and the body: meshes that turn, jump and deform, and hair that was groomed on and in them."""

import warnings

import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.motion import pose
from clfur.stages import distance
from clfur.twin.distance import Body

POSITIONS, FACES = icosphere(2)
HAIR = clfur.HairType(length=0.5, stiffness=1, segments=8, width=0.02)


def scene_of(positions, fur=None, roots=60, faces=FACES):
    fur = fur or clfur.Strands(roots=roots, types=HAIR, force=(0, -1, 0), collision=True, surface="flat")
    return clfur.Scene(mesh=clfur.Mesh(positions=positions, faces=faces), fur=fur,
                       camera=clfur.Camera(eye=(0, 0.5, 4), size=(32, 32)))


def turned(angle, middle=(0, 0, 0), rotation=pose._rotation):
    """POSITIONS turned about an upright axis."""
    return (POSITIONS - middle) @ rotation((np.cos(angle / 2), 0, np.sin(angle / 2), 0)).T + middle


def points(scene):
    curves = scene.fur.on_host
    return (np.asarray(curves.points, float) + curves.origin).reshape(len(curves.counts), -1, 3)


def depth(scene):
    """How far the nearest point that is not a root is from the mesh as it is drawn, below 0 inside."""
    mesh = scene.mesh
    return Body((mesh.positions + mesh.origin)[mesh.faces]).nearest(points(scene)[:, 1:].reshape(-1, 3))[0].min()


@pytest.mark.parametrize("rate", [12, 60])
def test_hair_of_a_body_that_turns_fast_stays_out(gpu, rate):
    """Limp hair, two turns a second about an axis beside the body, and back; without the body it goes through."""
    def scene(t):
        return scene_of(turned(4 * np.sin(6 * t), (0.4, 0, 0)))
    for body in (True, False):
        motion = clfur.Motion(scene, clfur.HairMotion(bend_length=0.1), gpu, fps=rate, body=body)
        depths = [depth(motion.at(frame)) for frame in range(1, rate // 3 + 1, rate // 12)]
        assert min(depths) > 0 if body else min(depths) < -0.05


@pytest.mark.parametrize("rate", [12, 48])
def test_hair_of_a_body_that_deforms_stays_out(gpu, rate, monkeypatch):
    monkeypatch.setattr(distance, "NODES", 48)

    def scene(t):
        wide = 1 + 0.3 * np.sin(8 * t)
        return scene_of(POSITIONS * [wide, 1 / wide, 1] * (1 + 0.1 * np.sin(3 * POSITIONS[:, :1] + 9 * t)))
    motion = clfur.Motion(scene, clfur.HairMotion(bend_length=0.1), gpu, fps=rate, units_per_metre=4)
    nearest = min(depth(motion.at(frame)) for frame in range(1, rate // 3 + 1, rate // 12))
    assert nearest > 0 and (gpu.download(motion._state.pressed) != 0).any()


def test_a_part_of_the_mesh_that_flies_by_pushes_hair_aside(gpu):
    """A small ball through hair at 16 lengths a second, at 24 frames a second."""
    hair = np.linspace(1, 1.5, 7)[:, None] * [[[x, 1, z]] for x in (-0.1, 0, 0.1) for z in (-0.1, 0, 0.1)]
    small, faces = icosphere(1)

    def scene(t):
        return scene_of(np.concatenate([POSITIONS, small * 0.2 + [-0.9 + 8 * t, 1.4, 0]]),
                        clfur.Curves(hair, width=0.02), faces=np.concatenate([FACES, faces + len(POSITIONS)]))
    motion = clfur.Motion(scene, clfur.HairMotion(bend_length=1), gpu, body=True)
    start, ways = points(motion.at(0)), []
    for frame in range(1, 6):
        now = motion.at(frame)
        assert depth(now) > 0
        ways.append(np.abs(points(now) - start).max())
    assert max(ways) > 0.2


@pytest.mark.parametrize("shape", ["sphere", "teapot"])
def test_a_groom_is_at_rest_on_the_body(gpu, shape):
    """Also hair that is groomed through it, which is told."""
    mesh = clfur.load_mesh("teapot") if shape == "teapot" else clfur.Mesh(positions=POSITIONS, faces=FACES)
    length = 0.5 * mesh.bounds[1]
    fur = clfur.Strands(roots=500, force=(0, -1, 0), types=clfur.HairType(
        length=length, stiffness=0.8, segments=8, width=0.01 * length))
    scene = clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=(0, 1, 3)))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = clfur.Motion(scene, clfur.HairMotion(bend_length=2 * length), gpu)
    assert [each.message.args[0].split(" strands")[0].split(" of ")[1] for each in said] == (
        ["500"] if shape == "teapot" else [])
    start = points(motion.at(0))
    assert np.abs(points(motion.at(24)) - start).max() < 1e-3 * length


def test_a_cut_takes_hair_and_its_contacts_along(gpu):
    """What lay on the body lies on it as before, elsewhere."""
    def scene(t):
        return scene_of(turned(2.0) + [30, 0, 0] if t > 1.01 else POSITIONS)
    motion = clfur.Motion(scene, clfur.HairMotion(bend_length=0.1), gpu)
    before, forces = points(motion.at(24)), gpu.download(motion._state.pressed)
    assert (forces != 0).any()
    after = points(motion.at(25))
    turn = pose._rotation((np.cos(1), 0, np.sin(1), 0))
    # Gravity is as it was, so that nothing is kicked; float32 at a length of 30.
    assert np.abs(after - [30, 0, 0] - before @ turn.T).max() < 0.02
    assert depth(motion._drawn()) > 0


def test_rigid_motions_are_found_and_go_on_circles():
    rng = np.random.default_rng(1)
    corners, normals = rng.normal(size=(2, 20, 3, 3)).astype(np.float32)
    rest = pose.pose_of(corners, normals, None)
    q = rng.normal(size=4)
    rotation, offset = pose._rotation(q / np.linalg.norm(q)), rng.normal(size=3)
    now = pose.pose_of((corners @ rotation.T + offset).astype(np.float32), normals, rest)
    np.testing.assert_allclose(now.rows()[:3], np.column_stack([rotation, offset]), atol=1e-6)
    assert now.corners is rest.corners and now.normals is rest.normals
    half = pose.between(rest, now, 0.5)
    np.testing.assert_allclose(half @ half, now.rows(), atol=1e-12)
    other = (corners * [1, 1.1, 1] @ rotation.T + offset).astype(np.float32)
    bent = pose.pose_of(other, normals, rest)
    assert np.abs(bent.corners - corners).max() > 0.05
    np.testing.assert_allclose(bent.corners @ bent.rotation.T + bent.offset, other, atol=2e-6)
    middle = pose.part_of(rest, bent, 0.5)
    np.testing.assert_allclose(middle.corners, (corners + bent.corners) / 2, atol=1e-6)


def test_the_body_is_felt_by_long_hair_alone_unless_told(gpu):
    short = clfur.Strands(roots=9, types=clfur.HairType(length=0.1, segments=4))
    for fur, body, feels in [(short, "auto", False), (short, True, True), (None, "auto", True), (None, False, False)]:
        motion = clfur.Motion(scene_of(POSITIONS, fur), device=gpu, body=body)
        assert bool(len(motion._state.away)) == feels
    for wrong in ("on", 1, None):
        with pytest.raises(clfur.Error, match="Motion.body is"):
            clfur.Motion(scene_of(POSITIONS), device=gpu, body=wrong)
    with pytest.raises(clfur.Error, match="HairMotion.friction is -1"):
        clfur.HairMotion(friction=-1)
