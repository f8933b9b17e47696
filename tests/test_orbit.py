"""The camera of who looks at a scene: it begins at the scene's own, and goes where a drag says."""

import json
import math

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import clfur
from clfur import Camera
from clfur.viewer.orbit import FURTHEST, NEAREST, STEEPEST, Orbit

SPHERE = clfur.load_mesh("sphere")
ORBITS = st.builds(
    Orbit, target=st.tuples(*[st.floats(-5, 5)] * 3), azimuth=st.floats(-180, 180),
    elevation=st.floats(-STEEPEST, STEEPEST), distance=st.floats(0.1, 50), fov=st.floats(5, 120),
    up=st.sampled_from([(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8), (-1.0, 0.0, 0.0)]))


def rotation(axis, degrees):
    """Around x, y or z, right-handed."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    at = np.roll([0, 1, 2], -axis)
    matrix = np.zeros((3, 3))
    matrix[np.ix_(at, at)] = [[1, 0, 0], [0, c, -s], [0, s, c]]
    return matrix


def posed(turn, place):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, place
    return pose


K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
CAMERAS = {
    "usual": Camera(), "from the side": Camera(eye=(3, 1, -2), target=(0.2, 0.1, 0)),
    "Z up": Camera(eye=(2, 2, 1), target=(0, 0, 0), up=(0, 0, 1)),
    "tilted": Camera(eye=(2, 2, 1), target=(0, 0, 0), up=(0.3, 1, 0)),
    "calibrated": Camera.calibrated(posed(rotation(1, 40) @ rotation(0, -20), (2, 1, 2.5)), K, (320, 240)),
    "calibrated and tilted": Camera.calibrated(
        posed(rotation(1, 40) @ rotation(0, -20) @ rotation(2, 15), (2, 1, 2.5)), K, (320, 240)),
    "on its side": Camera.calibrated(posed(rotation(2, 90), (0, 0, 4)), K, (320, 240)),
    "turned away": Camera.calibrated(posed(rotation(1, 180), (0, 0, 4)), K, (320, 240)),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_it_begins_at_the_scenes_own_camera(name):
    camera = CAMERAS[name]
    orbit = Orbit.of(clfur.Scene(SPHERE, camera=camera))
    assert np.abs(orbit.camera().pose - camera.pose).max() < 1e-12 * max(1, orbit.distance)
    assert np.abs(orbit.camera().intrinsics - camera.intrinsics).max() < 1e-9 and orbit.size == camera.size
    assert orbit.distance > 0


@pytest.mark.parametrize("eye, up, elevation", [((0, 4, 0), (0, 0, -1), STEEPEST), ((0, -4, 0), (1, 0, 0), -STEEPEST)])
def test_from_straight_above_and_below(eye, up, elevation):
    """It can be seen from there, a tenth of a degree aside, and what is to the right stays there."""
    camera = Camera(eye=eye, up=up)
    orbit = Orbit.of(clfur.Scene(SPHERE, camera=camera))
    assert orbit.elevation == elevation and np.allclose(orbit.up, (0, 1, 0))
    assert np.abs(orbit.camera().pose - camera.pose)[:3, :3].max() < 2 * math.radians(90 - STEEPEST)
    assert orbit.turned(0, 9).elevation == STEEPEST and orbit.turned(0, -9).elevation == -STEEPEST
    for steep in (orbit.turned(0, 9), orbit.turned(0, -9)):
        assert np.isfinite(steep.camera().pose).all()


@given(ORBITS)
def test_its_numbers_are_its_all(orbit):
    """As JSON and back it is the same, and its eye is where azimuth and elevation say."""
    again = Orbit(**json.loads(json.dumps(orbit.told())))
    assert again == orbit and np.array_equal(again.camera().pose, orbit.camera().pose)
    pose, up = orbit.camera().pose, np.array(orbit.up)
    away = pose[:3, 3] - orbit.target
    assert np.linalg.norm(away) == pytest.approx(orbit.distance)
    assert math.degrees(math.asin(away @ up / orbit.distance)) == pytest.approx(orbit.elevation, abs=1e-4)
    if orbit.up == (0, 1, 0):
        assert math.cos(math.radians(orbit.azimuth)) == pytest.approx(away[2] / math.hypot(away[0], away[2]), abs=1e-6)
        assert math.sin(math.radians(orbit.azimuth)) == pytest.approx(away[0] / math.hypot(away[0], away[2]), abs=1e-6)


@given(ORBITS, st.floats(-1, 1), st.floats(-1, 1))
def test_the_target_follows_a_pan(orbit, x, y):
    """What was in the middle is x and y heights of the picture from there."""
    camera = orbit.panned(x, y).camera()
    before = np.linalg.inv(camera.pose) @ np.append(orbit.target, 1)
    column, row, _ = camera.intrinsics @ (before[:3] * (1, -1, -1)) / -before[2]
    width, height = orbit.size
    assert (column, row) == pytest.approx((width / 2 + x * height, height / 2 + y * height), rel=1e-9, abs=1e-6)
    assert np.abs(camera.pose[:3, :3] - orbit.camera().pose[:3, :3]).max() < 1e-12


@given(ORBITS, st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_what_is_in_front_follows_a_drag(orbit, x, y):
    orbit = attrs.evolve(orbit, elevation=min(max(orbit.elevation, -15), 15))
    near = np.array(orbit.target) + 0.2 * (orbit.camera().pose[:3, 3] - orbit.target)
    seen = np.linalg.inv(orbit.turned(x, y).camera().pose) @ np.append(near, 1)
    assert (seen[0] * x > 0 or abs(x) < 1e-6) and (seen[1] * y < 0 or abs(y) < 1e-6)
    back = orbit.turned(x, y).turned(-x, -y)
    assert np.abs(back.camera().pose - orbit.camera().pose).max() < 1e-9 * orbit.distance + 1e-12


def test_steps_of_the_wheel():
    """As many back lead back; it comes no nearer and goes no further than the scene's size allows."""
    orbit = Orbit(distance=3.0, radius=2.0)
    assert orbit.zoomed(4).zoomed(-4).distance == pytest.approx(3) and orbit.zoomed(1).distance < 3
    assert orbit.zoomed(1e300).distance == NEAREST * 2 and orbit.zoomed(-1e300).distance == FURTHEST * 2
    assert orbit.zoomed(3).target == orbit.target


def test_a_window_of_another_size_sees_as_much_upwards():
    wide = Orbit(distance=3.0).resized((1280, 480)).camera()
    assert wide.fov == 45 and wide.size == (1280, 480)
    with pytest.raises(clfur.Error):
        Orbit().resized((0, 480))


@pytest.mark.parametrize("size", [(640, 480), (900, 480), (300, 480), (480, 480)])
def test_a_window_sees_what_the_scenes_camera_does(size):
    """At its target: as far up and, in a narrow window, to the sides."""
    scene = clfur.Scene(SPHERE, camera=CAMERAS["from the side"])
    orbit = Orbit.of(scene, size)
    corner = 4 / 3 * np.linalg.norm(scene.camera.eye - scene.camera.target) * math.tan(math.radians(45) / 2)
    right = orbit.camera().pose[:3, 0]
    assert orbit.size == size and np.allclose(right, scene.camera.pose[:3, 0]) and orbit.fov == 45
    seen = np.linalg.inv(orbit.camera().pose) @ np.append(scene.camera.target + corner * right, 1)
    column = (orbit.camera().intrinsics @ seen[:3])[0] / -seen[2] + size[0]
    assert size[0] / 2 < column <= size[0] + 1e-6
    if size[0] / size[1] > 4 / 3 - 1e-9:
        assert np.allclose(orbit.camera().pose, scene.camera.pose)
    else:
        assert column == pytest.approx(size[0])


def test_depth_of_a_plane_from_200_poses(gpu):
    """What a page is told of its camera, as JSON, gives the depth of the plane z = 0 by itself."""
    random = np.random.default_rng(19)
    corners = np.array([(-999, -999, 0), (999, -999, 0), (999, 999, 0), (-999, 999, 0)], np.float32)
    plane = clfur.Mesh(corners, np.tile([0, 0, 1.0], (4, 1)), None, [(0, 1, 2), (0, 2, 3)])
    orbits = [Orbit(tuple(random.uniform(-1, 1, 3)), random.uniform(-60, 60), random.uniform(-60, 60),
                    random.uniform(2, 9), random.uniform(10, 60), (12, 8)) for _ in range(200)]
    told = [json.dumps(orbit.told()) for orbit in orbits]
    cameras = [Orbit(**json.loads(text)).camera() for text in told]
    settings = clfur.Settings(raster="samples", samples=1, shadows="off", shadow_map=0)
    columns, rows = np.meshgrid(np.arange(12) + 0.5, np.arange(8) + 0.5)
    frames = clfur.frames(clfur.Scene(plane, camera=cameras[0]), cameras, gpu, settings, outputs=("depth",))
    for text, frame in zip(told, frames):
        page = json.loads(text)
        azimuth, elevation = math.radians(page["azimuth"]), math.radians(page["elevation"])
        tall = math.tan(math.radians(page["fov"]) / 2)
        x, y = (columns - 6) / 4 * tall, (4 - rows) / 4 * tall   # of rays, where one along the view is 1 long
        high = page["target"][2] + page["distance"] * math.cos(elevation) * math.cos(azimuth)   # the eye's z
        along = (-math.cos(elevation) * math.cos(azimuth) - x * math.sin(azimuth)
                 - y * math.sin(elevation) * math.cos(azimuth))
        depth, hit, past = frame.images["depth"], along < -0.1, along > 0
        # Corners of triangles are snapped to 1/256 of a pixel.
        assert hit.any() and np.abs(high / depth[hit] + along[hit]).max() < tall / 4 / 256
        assert np.isinf(depth[past]).all()
