"""Shell fur as a scene holds it: what it accepts and refuses, alone and with strands."""

import math
import pickle

import numpy as np
import pytest

from clfur.errors import Error
from clfur.render import draw
from clfur.scene import Camera, Curves, HairType, Mesh, Scene, Strands, extent, frame
from clfur.scene.shells import Shells
from clfur.settings import Settings

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def square(**options):
    return Mesh(SQUARE, faces=FACES, **options)


def test_defaults():
    shells = Shells()
    assert (shells.length, shells.layers, shells.frequency, shells.sharpness, shells.density) == (0.1, 30, 40, 1.4, 1)
    assert (shells.pattern, shells.shading, shells.noise) == ("cells", "kajiya-kay", (0.5, 8.0))
    assert (shells.length_variation, shells.specular, shells.exponent, shells.alpha) == (0.3, 0.3, 150, 0.5)
    assert (shells.root_shade, shells.time, shells.seed) == (0.6, 0, 0)
    assert np.array_equal(shells.color, (0.8, 0.6, 0.4))
    for name in ("wind", "force", "acceleration"):
        assert np.array_equal(getattr(shells, name), (0, 0, 0)) and not getattr(shells, name).flags.writeable
    with pytest.raises(AttributeError):
        shells.length = 1


@pytest.mark.parametrize("name, good, bad", [
    ("length", [1e-9, 1e9], [0, -1, math.nan, math.inf, "1", None]),
    ("layers", [1, 1000], [0, 1001, 2.5, True]),
    ("frequency", [1e-9, 1e9], [0, -1, math.nan]),
    ("hairs", [None, 1, 10**9], [0, -1, 10**9 + 1, 2.5, True]),
    ("pattern", ["cells", "sine"], ["hair", None]),
    ("sharpness", [1.0001, 1e9], [1, 0.5, math.inf]),
    ("density", [1e-9, 1], [0, 1.001, -1]),
    ("noise", [(0, 1), [3, 100]], [(-1, 8), (0.5, 0.9), 3, (1, 2, 3), (0.5, math.nan)]),
    ("length_variation", [0, 1], [-0.1, 1.1]),
    ("color", [(0, 0, 0), (9, 9, 9)], [(1, 1), (1, -1, 1), "red", 0.5]),
    ("specular", [0, 9], [-0.1, math.nan]),
    ("exponent", [1e-9, 1e9], [0, -1]),
    ("alpha", [0, 1], [-0.1, 1.1]),
    ("root_shade", [0, 1], [-0.1, 1.1]),
    ("shading", ["kajiya-kay", "turned"], ["half-vector", None]),
    ("wind", [(-1, 0, 1)], [(0, 1), 1, (0, 0, math.inf)]),
    ("force", [(-1, 0, 1)], [(0, 1), 1, (0, 0, math.nan)]),
    ("acceleration", [(-1, 0, 1)], [(0, 1), 1, (0, 0, 1e10)]),
    ("time", [-1e9, 1e9], [math.inf, math.nan, "now"]),
    ("seed", [0, 2**32 - 1], [-1, 2**32, 0.5]),
])
def test_checks(name, good, bad):
    for value in good:
        assert np.array_equal(getattr(Shells(**{name: value}), name), value)
    for value in bad:
        with pytest.raises(Error, match=rf"^Shells\.{name} is .*; allowed: ") as caught:
            Shells(**{name: value})
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name, good, bad", [
    ("filtered", [True, False], [1, None, "no"]),
    ("blur", ["off", "all", "edges"], ["on", True]),
    ("blur_sigma", [0.001, 16], [0, -1, 16.1, math.nan]),
])
def test_settings(name, good, bad):
    for value in good:
        assert getattr(Settings(**{name: value}), name) == value
    for value in bad:
        with pytest.raises(Error, match=rf"^Settings\.{name} is .*; allowed: "):
            Settings(**{name: value})


def test_settings_are_off_by_default():
    assert (Settings().filtered, Settings().blur, Settings().blur_sigma) == (True, "off", 1.0)


def test_what_a_scene_holds():
    strands, shells, curves = Strands(), Shells(), Curves(np.ones((2, 3, 3)))
    for fur, wanted in [
        (None, (None, None)), ([], (None, None)), (strands, (strands, None)), (curves, (curves, None)),
        (shells, (None, shells)), ([shells], (None, shells)), ([strands], (strands, None)),
        ([shells, strands], (strands, shells)), ((strands, shells), (strands, shells)),
        ([curves, shells], (curves, shells)),
    ]:
        scene = Scene(square(), fur)
        assert scene.strands is wanted[0] and scene.shells is wanted[1]
        assert scene.fur == (tuple(fur) if isinstance(fur, list) else fur)
    again = pickle.loads(pickle.dumps(Scene(square(), [shells, strands])))   # as `compare` sends it to its processes
    assert again.fur == (again.shells, again.strands)


def test_a_list_may_change_afterwards():
    fur = [Shells()]
    scene = Scene(square(), fur)
    fur.clear()
    assert scene.fur == (scene.shells,) and scene.shells is not None


@pytest.mark.parametrize("make, words", [
    (lambda: Scene(square(), "fur"), "Scene.fur is 'fur'"),
    (lambda: Scene(square(), [None]), "Scene.fur is [None]"),
    (lambda: Scene(square(), [Shells(), Shells()]), "Scene.fur is [Shells("),
    (lambda: Scene(square(), [Strands(), Strands()]), "Scene.fur is [Strands("),
    (lambda: Scene(square(), [Shells(), Strands(), Curves(np.ones((2, 3, 3)))]), "Scene.fur is [Shells("),
    (lambda: Scene(square(), [[Shells()]]), "Scene.fur is [[Shells("),
    (lambda: Scene(fur=Shells()), "Scene.mesh is None but Scene.fur has Shells"),
    (lambda: Scene(fur=[Curves(np.ones((2, 3, 3))), Shells()]), "Scene.mesh is None but Scene.fur has Shells"),
    (lambda: Scene(fur=[Strands()]), "Scene.mesh is None but Scene.fur has Strands"),
    (lambda: Scene(fur=[]), "Scene.mesh and Scene.fur are None"),
    (lambda: Scene(square(), Shells(pattern="sine")), "Shells.pattern is 'sine'"),
    (lambda: Scene(square(), [Strands(), Shells(pattern="sine")]), "Shells.pattern is 'sine'"),
    (lambda: Scene(square(), [Shells(), Strands(inner=[1, 2, 3])]), "Strands.inner has levels for 3 faces"),
    (lambda: Scene(square(), [Shells(length=1e9)]), "Scene is 2e+09 across"),
    (lambda: frame(square(), "fur"), "frame fur is 'fur'"),
])
def test_refuses(make, words):
    with pytest.raises(Error) as caught:
        make()
    text = str(caught.value)
    assert words in text and "allowed: " in text and "\n" not in text and len(text) < 400


def test_the_reports_pattern_needs_uv():
    assert Scene(square(uv=SQUARE[:, :2]), Shells(pattern="sine")).shells.pattern == "sine"


@pytest.mark.parametrize("uv, most", [(1, 2048), (100, 20.48), (1e-9, 1e9)])
def test_the_reports_pattern_has_no_more_periods_than_rays_can_pass(uv, most):
    """A ray takes steps through each; beyond 2^24 of them it would not get on."""
    mesh = square(uv=uv * SQUARE[:, :2])
    Scene(mesh, Shells(pattern="sine", frequency=most))
    Scene(mesh, Shells(frequency=1e9))
    if most < 1e9:
        with pytest.raises(Error, match=rf"^Shells\.frequency is .*; allowed with these uv: at most {most:g}$"):
            Scene(mesh, Shells(pattern="sine", frequency=1.001 * most))
    moved = square(uv=SQUARE[:, :2] + (0, 1000))
    with pytest.raises(Error, match=r"^Shells\.frequency is 70, of sines over uv up to 1001; .* at most 65\.47"):
        Scene(moved, Shells(pattern="sine", frequency=70))


def test_shells_reach_beyond_the_mesh():
    mesh, shells = square(), Shells(length=0.5)
    hair = Strands(types=HairType(segments=1, segment_length=0.25, width=0), surface="flat")
    far = Curves(np.array([[[0, 0, 0], [0, 0, 7.0]]]), width=0.2)
    alone = math.sqrt(0.5)
    for fur, radius in [(None, alone), (shells, alone + 0.5), ((shells,), alone + 0.5), (hair, alone + 0.25),
                        ((hair, shells), alone + 0.5), ((Shells(length=0.125), hair), alone + 0.25)]:
        center, found = extent(mesh, fur)
        assert np.allclose(center, (0.5, 0.5, 0)) and math.isclose(found, radius, rel_tol=1e-6)
    center, radius = extent(mesh, (far, shells))
    assert np.allclose(center, (0.5, 0.5, 3.5)) and math.isclose(radius, math.sqrt(0.5 + 3.5**2) + 0.5, rel_tol=1e-6)


def test_frame_holds_shells_and_takes_lists():
    mesh, shells, hair = square(), Shells(length=0.5), Strands(surface="flat")
    away = [np.linalg.norm(camera.eye - camera.target) for camera in (
        frame(mesh, fur) for fur in (None, hair, [hair], shells, [shells, hair], (hair, shells)))]
    assert away[1] == away[2] and away[0] < away[1] < away[3] == away[4] == away[5]
    camera = frame(mesh, [shells, hair], (100, 400))
    corners = (SQUARE[:, None] + 0.5 * np.vstack([np.eye(3), -np.eye(3)])).reshape(-1, 3)
    in_camera = np.c_[corners, np.ones(len(corners))] @ np.linalg.inv(camera.pose).T
    places = in_camera[:, :2] / -in_camera[:, 2:3] * camera.intrinsics[0, 0] * (1, -1) + camera.intrinsics[:2, 2]
    assert (in_camera[:, 2] < 0).all() and (places >= 0).all() and (places <= camera.size).all()
    assert np.array_equal(Scene(mesh, [shells, hair]).camera.eye, frame(mesh, (shells, hair)).eye)


def test_an_extent_is_kept():
    """A film asks for it again in every frame: a tuple of the same objects is the same key."""
    shells, mesh = Shells(), square()
    first = Scene(mesh, [shells])
    assert extent(mesh, first.fur) is extent(mesh, Scene(mesh, [shells]).fur)


def test_kept_shadows_are_those_of_the_shells(gpu, sphere):
    """The light's grid holds the shells too: it is another with longer ones, and the same as without anything kept."""
    strands, camera, settings = Strands(inner=1, outer=1, roots=50), Camera(size=(16, 12)), Settings(samples=1, grid=16)
    scenes = [Scene(sphere, fur, camera) for fur in (strands, [Shells(length=0.5), strands], [strands])]
    warm = [draw(scene, gpu, settings, hashes=True).hashes["voxels"] for scene in scenes]
    cold = []
    for scene in scenes:
        gpu.forget()
        cold.append(draw(scene, gpu, settings, hashes=True).hashes["voxels"])
    assert warm == cold and warm[0] != warm[1] and warm[0] == warm[2]


@pytest.mark.parametrize("size", [1e-6, 1, 1e6])
def test_hairs_of_the_whole_mesh(size):
    """As many on a large mesh as on a small one, and in a pose as in rest; in place of a frequency."""
    mesh = Mesh(SQUARE * (size, 4 * size, size), faces=FACES)
    assert Shells(hairs=10_000, frequency=7).frequency_on(mesh) == pytest.approx(50 / size, rel=1e-6)
    posed = Mesh(SQUARE * 3 * size, faces=FACES)
    assert Shells(hairs=10_000, rest=mesh).frequency_on(posed) == Shells(hairs=10_000).frequency_on(mesh)
    assert Shells(frequency=7).frequency_on(mesh) == 7


def test_hairs_draw_what_their_frequency_draws(gpu):
    def hashed(**fine):
        fur = Shells(length=0.2, noise=(0, 8), **fine)
        scene = Scene(square(), fur, Camera(eye=(0.5, 0.5, 2), target=(0.5, 0.5, 0), size=(32, 24)))
        return draw(scene, gpu, hashes=True).hashes
    assert hashed(hairs=400) == hashed(frequency=20) != hashed(hairs=100)


def test_sines_have_no_number_of_hairs():
    with pytest.raises(Error, match=r"^Shells\.hairs is 9; allowed: None with the pattern 'sine', whose frequency"):
        Shells(pattern="sine", hairs=9)
