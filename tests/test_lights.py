"""Several lights: they add up, each with its own shadows, in all that draws and in the truth."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import truth
from clfur.pipeline import sizes
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig

SUN = clfur.Light((-1, -1, -.4), (1, .8, .6), .1)
SPOT = clfur.Light((1, -.6, -1), (.3, .5, 1), .05, position=(-2, 1.2, 2), angle=40)
OUT = clfur.Light((0, -1, 0), (0, 0, 0), .2)     # ambient alone: it casts no shadow
SMALL = {"grid": 16, "shadow_map": 32}


def furs():
    hair = clfur.HairType(segments=4, segment_length=.05, width=.02, alpha=.4, color_variation=.3)
    strands = clfur.Strands(roots=800, types=[hair], seed=3)
    points = np.random.default_rng(0).normal(size=(80, 1, 3)) + np.random.default_rng(1).normal(size=(80, 4, 3)) * .2
    shells = clfur.Shells(length=.2, frequency=8, layers=8, force=(0, -.4, 0))
    return {"strands": strands, "curves": clfur.Curves(points, width=.03), "body": None, "shells": shells,
            "turned": attrs.evolve(shells, shading="turned"), "both": [shells, strands]}


def scene_of(fur, light, **options):
    positions, faces = icosphere(1)
    mesh = clfur.Mesh(positions, positions, None, faces)
    camera = clfur.Camera(size=(37, 29))
    return clfur.Scene(mesh, furs()[fur], **{"camera": camera, "light": light, "body_color": (.4, .5, .3)} | options)


def assert_sum(together, alone):
    """Colours, which are up to 1, are the sum of each light's to rounding: 1e-6."""
    wrong = together[..., :3].astype(float) - np.sum(alone, 0, dtype=float)[..., :3]
    assert np.abs(wrong).max() < 1e-6


@pytest.mark.parametrize("lights", [(SUN, SPOT), (SPOT, OUT), (OUT, SUN, SPOT)], ids=["two", "one is out", "three"])
@pytest.mark.parametrize("raster", ["coverage", "samples"])
@pytest.mark.parametrize("fur", ["strands", "curves", "body", "shells", "turned", "both"])
def test_lights_add_up(gpu, fur, raster, lights):
    """One picture of several lights is the sum of the pictures of each: light is linear."""
    settings = clfur.Settings(samples=4, raster=raster, **SMALL)
    together, *alone = (clfur.draw(scene_of(fur, light), gpu, settings) for light in (lights, *lights))
    colors = [frame.images["color"] for frame in alone]
    assert len({color.tobytes() for color in colors}) == len(lights) and min(map(np.max, colors)) > .01
    assert_sum(together.images["color"], colors)
    np.testing.assert_array_equal(together.images["color"][..., 3], colors[0][..., 3])


@pytest.mark.parametrize("method", ["off", "binary", "count", "trilinear"])
def test_lights_add_up_with_each_method(gpu, method):
    settings = clfur.Settings(samples=1, shadows=method, **SMALL)
    together, *alone = (clfur.render(scene_of("both", light), gpu, settings)[..., :3]
                        for light in ([SUN, SPOT], SUN, SPOT))
    assert_sum(together, alone)


@pytest.mark.small
@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_small(gpu, monkeypatch, raster):
    """All that lights, as small as it can be; the second light's crossings and texels lie behind the first's."""
    monkeypatch.setattr("clfur.stages.shells.AROUND", 4)
    gpu = clfur.Scheduler(gpu.device)
    gpu.lanes = 1   # Oclgrind 21.10 takes parts of a vector for unset that are not
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], float)
    mesh = clfur.Mesh(corners, None, None, np.array([[0, 1, 2], [0, 2, 3]]))
    fur = [clfur.Shells(length=.3, frequency=2, layers=3),
           clfur.Strands(roots=12, types=[clfur.HairType(segments=2, segment_length=.3, width=.1)])]
    scenes = [clfur.Scene(mesh, fur, clfur.Camera(eye=(0, 2, 1.5), size=(9, 7)), light)
              for light in ([SUN, SPOT], SUN, SPOT)]
    settings = clfur.Settings(raster=raster, samples=1, grid=16, shadow_map=16)
    together, *alone = (clfur.render(scene, gpu, settings)[..., :3] for scene in scenes)
    assert_sum(together, alone)


def test_a_light_more_in_parts_and_by_a_team_is_the_same_bits(gpu):
    scene = scene_of("strands", [SUN, SPOT])
    settings = clfur.Settings(samples=4, **SMALL)
    whole = clfur.draw(scene, gpu, settings, ("color",), hashes=True)
    room = 480_000 + 100_000 * bool(gpu.steps)   # for a pixel's way through a tile, where drivers end long loops
    small, other = clfur.Scheduler(gpu.device, memory=room), clfur.Scheduler(gpu.device)
    assert len(Plan(Rig.of(scene, settings), ("color",)).parts(small)) > 1
    for device in small, [gpu, other]:
        frame = clfur.draw(scene, device, settings, ("color",), hashes=True)
        assert frame.hashes == whole.hashes and {"voxels", "shadow_map", "visibility"} == set(frame.hashes)
        np.testing.assert_array_equal(frame.images["color"], whole.images["color"])
    for light in SUN, [SPOT, SUN]:                        # and the hashes are those of all lights, in their order
        other = clfur.draw(scene_of("strands", light), gpu, settings, hashes=True)
        assert other.hashes["voxels"] != whole.hashes["voxels"]


def test_memory_is_planned_for_all_lights(gpu):
    """A grid and a map for each light that is not out, and the transmittance of each to the strands."""
    settings = clfur.Settings(samples=4, grid=32, shadow_map=64)
    used, planned = [], []
    for lights in [SUN], [SUN, SPOT], [SUN, SPOT, SUN, SPOT]:
        gpu.forget()
        scene = scene_of("strands", lights)
        used.append(clfur.draw(scene, gpu, settings).memory)
        plan = Plan(Rig.of(scene, settings), ("color",))
        planned.append(plan._fixed + sizes.of_transmittance(plan) * plan.points)
    assert np.all(np.diff(used) > 0) and np.all(np.diff(planned) >= np.diff(used))
    dark = [Plan(Rig.of(scene_of("strands", lights), settings), ("color",))._fixed for lights in ([SUN], [SUN, OUT])]
    assert dark[0] == dark[1]


def test_the_truth_adds_lights_up():
    together, *alone = (truth.picture(attrs.evolve(scene_of("curves", light), camera=clfur.Camera(size=(12, 9))), 2)
                        for light in ([SUN, SPOT], SUN, SPOT))
    assert alone[0][..., :3].max() > .01 < alone[1][..., :3].max()
    np.testing.assert_allclose(together[..., :3], alone[0][..., :3] + alone[1][..., :3], atol=1e-12)
    np.testing.assert_array_equal(together[..., 3], alone[0][..., 3])


def test_lights_of_a_scene():
    for light, lights in (SUN, (SUN,)), ([SUN], (SUN,)), ((SUN, SPOT), (SUN, SPOT)):
        scene = scene_of("body", light)
        assert scene.lights == lights and type(scene.lights) is tuple
    assert scene_of("body", [SUN]).light == (SUN,) and scene_of("body", SUN).light is SUN
    for wrong in [], None, [SUN, None], "sun":
        with pytest.raises(clfur.Error, match="Scene.light is .* allowed: an object of class Light, or a list of them"):
            scene_of("body", wrong)
    with pytest.raises(clfur.Error, match="Light.position is .* at most 1000 radii"):
        scene_of("body", [SUN, attrs.evolve(SPOT, position=(9e3, 0, 0))])


def test_a_light_without_shadows_makes_and_costs_none(gpu):
    settings, free = clfur.Settings(samples=1, **SMALL), attrs.evolve(SUN, shadows=False)
    off = attrs.evolve(settings, shadows="off")
    one, other = (clfur.draw(scene_of("strands", light), gpu, each) for light, each in ((free, settings), (SUN, off)))
    np.testing.assert_array_equal(one.images["color"], other.images["color"])
    assert set(one.stages) == set(other.stages) and "voxelize" not in one.stages
    rig = Rig.of(scene_of("strands", [SUN, free]), settings)
    assert rig.grids[0] is not None and rig.grids[1] is None and rig.light_views[1] is None
    together, *alone = (clfur.render(scene_of("strands", light), gpu, settings) for light in ([SPOT, free], SPOT, free))
    assert_sum(together, alone)


@pytest.mark.parametrize("fur", ["strands", "body"])
def test_a_point_light_shines_as_a_spot_that_sees_all(gpu, fur):
    place = np.array((-3, 4, 5.0))
    point = clfur.Light(color=(1, .5, .2), position=place, angle=360)
    spot = attrs.evolve(point, direction=-place, angle=170)
    one, other = (clfur.render(scene_of(fur, light), gpu, clfur.Settings(grid=32)) for light in (point, spot))
    np.testing.assert_allclose(one, other, atol=1e-4)
    assert one[..., :3].max() > .1
    one, other = (truth.picture(attrs.evolve(scene_of("curves", light), camera=clfur.Camera(size=(12, 9))), 2)
                  for light in (point, spot))
    np.testing.assert_allclose(one, other, atol=1e-9)


def test_what_lights_take():
    assert clfur.Light(color=(.5, 1, 0), intensity=3).strength.tolist() == [1.5, 3, 0]
    assert not clfur.Light(intensity=0).casts and not clfur.Light(shadows=False).casts and clfur.Light().casts
    for wrong, text in (({"size": 91}, "Light.size is 91.0; allowed: at most 90 degrees"), ({"size": -1}, "Light.size"),
                        ({"angle": 200}, "Light.angle is 200"), ({"angle": 360}, "Light.angle is 360.0"),
                        ({"shadows": 1}, "Light.shadows"), ({"intensity": -1}, "Light.intensity")):
        with pytest.raises(clfur.Error, match=text):
            clfur.Light(**wrong)
    inside = clfur.Light(position=(.2, 0, 0), angle=360)
    with pytest.raises(clfur.Error, match="Light.position is .*, inside of all that is drawn"):
        scene_of("body", inside)
    scene_of("body", attrs.evolve(inside, shadows=False))


def test_lights_that_a_device_would_not_finish_are_refused(gpu, monkeypatch):
    """llvmpipe ends a work-item's loops after 65,535 steps, silently."""
    monkeypatch.setattr(gpu, "steps", 65_535)
    scene, settings = scene_of("strands", [SUN] * 2), clfur.Settings(pcf=16, **SMALL)
    clfur.render(scene, gpu, settings)
    clfur.render(scene_of("strands", [SUN] * 12), gpu, clfur.Settings(**SMALL))
    scene = scene_of("strands", [SUN] * 40)
    with pytest.raises(clfur.Error, match="Scene.light has 40 lights and Settings.pcf is 16, .* allowed: fewer lights"):
        clfur.render(scene, gpu, settings)
    clfur.render(scene, gpu, clfur.Settings(shadows="off", **SMALL))
