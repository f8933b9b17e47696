"""Laws of frames under a sky: parts, bands and teams, what turns together, and no more light than there is."""

import attrs
import numpy as np
import pytest
from support.devices import DEVICES
from support.pictures import same
from support.plans import plan_of
from support.scenes import scene_of

import clfur
from clfur import Environment
from clfur.pipeline import build

SKY = Environment([(.2, .5, 1), (1, .8, .6), (.1, .1, 0)], intensity=2)
RASTERS = "coverage", "samples"


ROOM = {("faces", "coverage"): 2_500_000, (9001, "coverage"): 4_000_000, ("curves", "coverage"): 2_000_000,
        ("faces", "samples"): 1_250_000, (9001, "samples"): 2_000_000, ("curves", "samples"): 1_500_000}


def settings_of(raster):
    return clfur.Settings(raster=raster, samples=4, grid=32, shadow_map=64)


def under_sky(kind, mesh, **fields):
    return attrs.evolve(scene_of(kind, mesh), environment=SKY, **fields)


@pytest.mark.parametrize("kind", ["faces", 9001, "curves"])
@pytest.mark.parametrize("raster", RASTERS)
def test_parts_and_bands_are_the_same_bits(gpu, another, sphere, kind, raster):
    scene, settings = under_sky(kind, sphere), settings_of(raster)
    whole = clfur.draw(scene, gpu, settings, hashes=True)
    small = another()
    small.memory = int(plan_of(scene, settings)._fixed + ROOM[kind, raster])   # for some parts, and bands of some rows
    assert len(plan_of(scene, settings).parts(small)) > 1
    same(whole, clfur.draw(scene, small, settings, hashes=True))


@pytest.mark.parametrize("raster", RASTERS)
def test_a_team_gives_the_bits_of_one(gpu, another, sphere, raster):
    scene, settings = under_sky(9001, sphere), settings_of(raster)
    team = [another(), another(device=DEVICES[(DEVICES.index(gpu.device) + 1) % len(DEVICES)])]
    same(clfur.draw(scene, gpu, settings, hashes=True), clfur.draw(scene, team, settings, hashes=True))


def cells_of(gpu, scene, n=32):
    """Light of a scene's sky in cells, [n, n, n, 9, 3]."""
    with gpu.frame():
        lit = build.sky_in(gpu, plan_of(scene.local, settings_of("coverage"), ("color",)), n)
        return gpu.download(lit.cells).reshape(n, n, n, 9, 4)[..., :3].astype(float)


def test_light_is_never_more_than_the_sky_s(gpu, sphere):
    """Orders 0 to 2 of a share between 0 and 1 may go beyond both where it falls steeply: by a twelfth at most."""
    scene = attrs.evolve(under_sky(9001, sphere), environment=Environment((1, 1, 1)))
    cells = cells_of(gpu, scene)
    assert cells[..., 0, :].min() >= 0 and cells[..., 0, :].max() * .28209479 < 1 + 1e-5
    picture = clfur.render(attrs.evolve(scene, light=clfur.Light(color=(0, 0, 0)), body_color=(1, 1, 1)), gpu,
                           settings_of("coverage"))
    assert picture[..., 3].max() > .9 and (picture[..., :3] <= (1 + 1 / 12) * picture[..., 3:]).all()


def test_what_nothing_hides_gets_all_of_a_sky(gpu, sphere):
    """A bald sphere: cells tell of it to half a side, so that light which passes close to it counts a little less."""
    scene = clfur.Scene(mesh=sphere, environment=Environment((1, 2, 3)), light=clfur.Light(color=(0, 0, 0)),
                        body_color=(.5, .5, .5), camera=clfur.Camera(eye=(0, 0, 4), target=(0, 0, 0), size=(32, 32)))
    picture = clfur.render(scene, gpu)[12:20, 12:20, :3]
    np.testing.assert_allclose(picture / (.5, 1, 1.5), .95, atol=.07)


def turned(points):
    """Points a quarter turned to the right about +Y, as Environment.rotation turns."""
    return np.stack([-points[..., 2], points[..., 1], points[..., 0]], -1)


@pytest.mark.parametrize("raster", RASTERS)
def test_what_turns_together_looks_the_same(gpu, sphere, raster):
    """A world, its camera and its sky by a quarter: cells stay cells, but the 32 directions stay where they are."""
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(2000, 3))
    roots /= np.linalg.norm(roots, axis=1, keepdims=True)
    points = roots[:, None] * np.linspace(1, 1.4, 5)[:, None]
    window = np.full((16, 32, 3), .2)
    window[2:6, 20:24] = 9
    pictures = []
    for turn in (False, True):
        at = turned if turn else np.asarray
        fur = clfur.Curves(list(at(points)), width=.015, color=(.8, .8, .8))
        mesh = clfur.Mesh(at(sphere.positions), faces=sphere.faces)
        camera = clfur.Camera(eye=at(np.array([1., 1, 4])), target=(0, 0, 0), size=(48, 48))
        scene = clfur.Scene(mesh, fur, camera, clfur.Light(color=(0, 0, 0)), environment=Environment(
            window, rotation=90 * turn))
        pictures.append(clfur.render(scene, gpu, settings_of(raster)))
    one, two = (each[..., :3].reshape(12, 4, 12, 4, 3).mean((1, 3)) for each in pictures)
    assert one.max() > .1
    np.testing.assert_allclose(one, two, atol=.12 * one.max())
    assert np.abs(one - two).mean() < .02 * one.max()


@pytest.mark.parametrize("fields", [{"light": clfur.Light(direction=(0, -1, 0))}, {"camera": clfur.Camera(
    eye=(0, 1, 3), target=(0, 0, 0), size=(20, 20))}])
def test_a_sky_stays_while_lights_and_camera_move(gpu, sphere, fields):
    from support.plans import recorded
    scene = under_sky(9001, sphere)
    clfur.render(scene, gpu, settings_of("coverage"))
    names = recorded(gpu)
    clfur.render(attrs.evolve(scene, **fields), gpu, settings_of("coverage"))
    del gpu.launch
    assert names and not [name for name in names if name.startswith("sky.")]
