"""The ground: the twin's values on every device, and what a shadow on it must be."""

import attrs
import numpy as np
import pytest
from support.command import wrong
from support.pictures import same
from support.scenes import icosphere, scene_of, squares

import clfur
from clfur import layout, truth
from clfur.pipeline.views import Rig, ground_of, light_of, view_of
from clfur.scene.ground import height_of
from clfur.scene.light import AMBIENT
from clfur.stages import ground, shade, sky
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import VISIBLE
from clfur.twin import ground as twin
from clfur.twin import lighting

GREY = clfur.Light((1, -1, -.6))
LIGHTS = [GREY, clfur.Light((-.5, -1, .3), (1, .5, .2), 0, position=(.5, 2, -.5), angle=70)]
CAMERA = clfur.Camera(eye=(2.2, 1.6, 3.4), target=(0, -.3, 0), size=(65, 49))
RASTERS = pytest.mark.parametrize("raster", ["coverage", "samples"])
OUTPUTS = "color", "depth", "id", "normal", "coverage"


def fur(n=700, **hair):
    return clfur.Strands(roots=n, types=clfur.HairType(**{"segment_length": .04, "width": .02, "segments": 4} | hair))


def scene(sphere, color=None, height=None, **more):
    return clfur.Scene(**{"mesh": sphere, "fur": fur(), "camera": CAMERA, "light": GREY,
                          "ground": clfur.Ground(height, color)} | more)


def test_the_constants_are_the_twins():
    assert (layout.CONSTANTS["GROUND"], layout.CONSTANTS["ID_GROUND"]) == (twin.GROUND, twin.ID_GROUND)


# --- the twin's values ----------------------------------------------------------------------------------


@pytest.mark.small
@pytest.mark.parametrize("samples", [1, 4, 16])
@pytest.mark.parametrize("eye, height", [((2.2, 1.6, 3.4), -1), ((0, -.9, 5), -1), ((0, 9, .1), .5)])
def test_put_light_and_outputs_are_the_twins(gpu, sphere, samples, eye, height):
    """Reversed depths are sums of three float32: wrong by 2^-23 of the largest, light's places by as much of the
    distance; where the ground begins, a place may fall on the other side of the horizon by as little."""
    there = scene(sphere, (.5, .4, .3), height, camera=attrs.evolve(CAMERA, eye=eye, size=(23, 17)), light=LIGHTS)
    view = view_of(there, samples)
    packed = ground_of(there, view)
    before = VISIBLE.empty(gpu, (17, 23, samples))
    hidden = np.random.default_rng(samples).random((17, 23, samples)) < .2
    before[:] = np.where(hidden, np.uint64(5), before.get())
    visible = ground.put(gpu, view, packed, before).get()
    meant = twin.put(view, height, np.where(hidden, np.uint64(5), np.uint64((1 << 64) - 1)))
    ids, kinds = (each & np.uint64(0xFFFFFFFF) for each in (visible, meant))
    assert (ids != kinds).mean() < .005 and (ids == twin.GROUND).any() and (visible[hidden] == 5).all()
    most = np.abs(packed["plane"][:3] * (23, 17, 1)).sum()
    both = (ids == kinds) & (ids == twin.GROUND)
    depth, other = (each[both] >> np.uint64(32) for each in (visible, meant))
    np.testing.assert_allclose(depth.astype(float), other.astype(float), atol=2**30 * most * 2**-23)

    for color in ((.5, .4, .3), None):
        packed["color"] = (*color, 1) if color else 0
        sums = shade.no_light(gpu, 17, 23)
        lights = [light_of(each) for each in LIGHTS]
        ground.light(gpu, view, packed, unshadowed(gpu, *lights), gpu.upload(visible), sums)
        image = shade.blend(gpu, sums).get()
        off = np.abs(image - twin.light(view, height, color, lights, np.ones(2), visible)).max(2)
        assert (off > 2e-5).mean() < .01   # at the edge of the spot
        if color is None:
            assert not image.any()

    plane = sky.plane_of((-1, height, -1), (1, 2, .5), height, (.9, 1, 1.2))
    squares = np.random.default_rng(2).random((len(np.empty(int(plane["size"][0]) ** 2)), 4)).astype(np.float32)
    lit = sky.SkyLight(np.zeros((), layout.Sky), plane, gpu.empty((0, 4), np.float32), gpu.upload(squares))
    for color in ((.5, .4, .3), None):
        packed["color"] = (*color, 1) if color else 0
        sums = shade.no_light(gpu, 17, 23)
        ground.light(gpu, view, packed, unshadowed(gpu, *lights), gpu.upload(visible), sums, None, lit)
        image = shade.blend(gpu, sums).get()
        off = np.abs(image - twin.light(view, height, color, lights, np.ones(2), visible, plane, squares)).max(2)
        assert (off > 2e-4).mean() < .03 and image.any()   # from one square to the next is a step of 1 here

    known = shade.Outputs.empty(gpu, {"pixel": (17, 23)})
    ground.outputs(gpu, view, packed, gpu.upload(visible), vars(known))
    for name, value in twin.outputs(view, height, visible).items():
        np.testing.assert_allclose(getattr(known, name).get(), value, rtol=1e-4, err_msg=name)


@pytest.mark.small
@pytest.mark.parametrize("light, off", [
    (clfur.Light((1, -.2, 0), size=40), .005), (clfur.Light((1, .1, 0), size=40), .005),
    (clfur.Light((0, -1, 0), size=8), 1e-4),
    (clfur.Light((-3, -1, 0), position=(3, 0, 0), angle=360, size=1.0), .03)], ids=["low", "set", "high", "lamp"])
def test_a_disc_is_the_mean_of_its_points_over_the_ground(gpu, light, off):
    """Of the sun partly under the horizon too. How much shorter a way to the rim is counts by its mean; and a lamp
    is taken to look at each place."""
    light = attrs.evolve(light, shadows=False)
    there = clfur.Scene(fur=clfur.Curves([[(0, 0, 0), (0, 1, 0)]]), light=light, ground=clfur.Ground(-1, (1, 1, 1)),
                        camera=clfur.Camera(eye=(0, 3, 4), target=(0, -1, 0), size=(13, 9)))
    view, packed = view_of(there, 1), light_of(light)
    visible = ground.put(gpu, view, ground_of(there, view), VISIBLE.empty(gpu, (9, 13, 1)))
    sums = shade.no_light(gpu, 9, 13)
    ground.light(gpu, view, ground_of(there, view), unshadowed(gpu, packed), visible, sums)
    image, points = shade.blend(gpu, sums).get(), lighting.points_of(packed)
    meant = np.mean([twin.light(view, -1, (1, 1, 1), [each], [1], visible.get()) for each in points], 0)
    np.testing.assert_allclose(image, meant, atol=off)
    assert meant[..., :3].max() > .1


# --- laws -----------------------------------------------------------------------------------------------


@RASTERS
def test_shadow_alone_takes_away_what_a_white_ground_has_not(gpu, sphere, raster):
    """Under one white light a coloured ground is its colour, as it is without shadow, laid under the shadow's alpha."""
    settings = clfur.Settings(raster=raster, grid=32, shadow_map=64)
    catcher = clfur.draw(scene(sphere), gpu, settings, OUTPUTS).images
    color = (.5, .4, .3)
    drawn = clfur.draw(scene(sphere, color), gpu, settings, OUTPUTS).images
    full = -GREY.direction[1] + AMBIENT
    ends = np.zeros((49, 65, 4)) + (*np.array(color) * full, 1)
    sky = drawn["id"] == -1
    laid = catcher["color"] + (1 - catcher["color"][..., 3:]) * np.where(sky[..., None], 0, ends)
    inside = ~sky & ~np.roll(sky, 1, 0) & ~np.roll(sky, -1, 0)
    np.testing.assert_allclose(laid[inside], drawn["color"][inside], atol=2e-6)
    assert (catcher["color"][..., 3][catcher["id"] == -4] > .8 * -GREY.direction[1] / full).any()
    assert (catcher["color"][..., 3][catcher["id"] == -4] == 0).any()
    np.testing.assert_array_equal(catcher["coverage"], catcher["color"][..., 3])
    for name in ("id", "depth", "normal"):
        np.testing.assert_array_equal(catcher[name], drawn[name])


def test_it_is_a_large_square(gpu):
    """The same light as on faces of a mesh, which reach to the horizon; grid and map of a mesh as large would show no
    shadow, so these are of the square's own near the ball."""
    positions, faces = icosphere(2)
    square = squares((3, -1.2))
    joined = clfur.Mesh(np.concatenate([positions, square.positions]),
                        faces=np.concatenate([faces, square.faces.astype(int) + len(positions)]))
    camera = clfur.Camera(eye=(1, 5, 1), target=(0, -1.2, 0), fov=30, size=(65, 49))
    settings = clfur.Settings(grid=32, shadow_map=1024)
    with_mesh = clfur.render(clfur.Scene(joined, None, camera, GREY, (.5, .4, .3)), gpu, settings)
    ball = clfur.Mesh(positions, faces=faces)
    over = clfur.render(clfur.Scene(ball, None, camera, GREY, (.5, .4, .3), ground=clfur.Ground(-1.2, (.5, .4, .3))),
                        gpu, settings)
    off = np.abs(over - with_mesh).max(2)
    assert over[..., 3].min() == 1 and np.quantile(off, .9) < 1e-5   # but at the shadow's edge
    assert (off > .15).mean() < .02 and over[..., 0].std() > .1


@pytest.mark.parametrize("light", LIGHTS, ids=["distant", "spot"])
def test_truth(gpu, sphere, light):
    there = scene(sphere, light=light)
    one, other = clfur.render(there, gpu, clfur.Settings(samples=16)), truth.picture(there, 4)
    assert np.abs(one - other)[..., 3].mean() < .012 and other[..., 3].max() > .8   # .003 to .009: where shadows end
    assert one[..., 3].mean() == pytest.approx(other[..., 3].mean(), abs=.004)


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_truth_of_a_sky(gpu, sphere, raster):
    """A ball that stands on it takes most of a sky's light away below, and less around; the truth's noise is .03 a
    pixel, .005 in a mean of 36."""
    for sun in (GREY, attrs.evolve(GREY, color=(0, 0, 0))):
        there = scene(sphere, light=sun, environment=clfur.Environment([(1, 1, 1), (.5, .5, .5), (0, 0, 0)]))
        frame = clfur.draw(there, gpu, clfur.Settings(samples=16, raster=raster), ("color", "id")).images
        one, other = frame["color"][..., 3], truth.picture(there, 4)[..., 3]
        on = frame["id"] == -4
        means = [np.where(on, each, 0)[:48, :60].reshape(8, 6, 10, 6).mean((1, 3)) for each in (one, other)]
        assert np.abs(means[0] - means[1]).mean() < .012 and means[1].max() > .3
        assert one[on].mean() == pytest.approx(other[on].mean(), abs=.006)


def test_a_sky_alone_on_a_bare_ground_is_all_there(gpu):
    """Far from anything the ground sends its colour times what falls on it, and its shadow's alpha is 0; both are the
    same where the sky's colours differ."""
    tiny = clfur.Mesh([(0, 0, 0), (1e-3, 0, 0), (0, 0, 1e-3)], faces=[(0, 1, 2)])
    sky_of_two = clfur.Environment([(1, 2, 3), (1, 1, 1), (0, 0, 0)])
    for color, alpha in ((None, 0), ((.5, .5, .5), 1)):
        there = clfur.Scene(tiny, None, clfur.Camera(eye=(0, 3, 3), target=(2, -1, 0), size=(8, 8)),
                            clfur.Light(color=(0, 0, 0)), environment=sky_of_two, ground=clfur.Ground(-1, color))
        image = clfur.render(there, gpu)
        np.testing.assert_allclose(image[..., 3], alpha, atol=1e-5)
        if color:   # of 1 + y (c - 1) a level plane gets 1 + 2/3 (c - 1)
            np.testing.assert_allclose(image[4, 4, :3], .5 * (1 + 2 / 3 * np.array([0, 1, 2])), rtol=1e-3)


def test_the_lowest_vertex_is_its_height():
    mesh = clfur.Mesh([(0, 5, 0), (1, 6, 0), (0, 6, 1)], faces=[(0, 1, 2)])
    assert height_of(clfur.Scene(mesh, ground=clfur.Ground())) == 5
    assert height_of(clfur.Scene(mesh, ground=clfur.Ground(-2))) == -2
    curves = clfur.Curves([[(0, 3, 0), (0, 2.5, 1)]])
    assert height_of(clfur.Scene(fur=curves, ground=clfur.Ground())) == 2.5
    far = clfur.Scene(clfur.Mesh(mesh.positions + (0, 2**20, 0), faces=mesh.faces), ground=clfur.Ground(2**20 + 4))
    assert height_of(far) == 2**20 + 4 - far.origin[1]


@pytest.mark.filterwarnings("ignore:nothing is seen of the ground")
def test_it_hides_what_is_under_it_and_is_not_seen_from_there(gpu, sphere):
    settings = clfur.Settings(grid=32, shadow_map=64)
    above = attrs.evolve(CAMERA, eye=(0, 1, 4))
    half = clfur.draw(scene(sphere, height=0, camera=above), gpu, settings, OUTPUTS).images
    seen = half["id"] == -2
    places = half["depth"][seen]
    assert len(places) and (half["normal"][seen][:, 1] > -.2).all()   # the upper half of the ball
    below = attrs.evolve(CAMERA, eye=(0, -1, 4))
    np.testing.assert_array_equal(clfur.render(scene(sphere, height=0, camera=below), gpu, settings),
                                  clfur.render(scene(sphere, camera=below, ground=None), gpu, settings))


def test_before_the_near_plane_it_is_seen(gpu, sphere):
    """The near plane stands before the ball, far away; the ground at the camera's feet is nearer."""
    there = scene(sphere, (1, 1, 1), camera=clfur.Camera(eye=(0, 0, 12), target=(0, -1, 9), fov=90, size=(48, 48)))
    images = clfur.draw(there, gpu, clfur.Settings(grid=16, shadow_map=32), OUTPUTS).images
    bottom = images["depth"][-1]
    assert float(view_of(there, 1)["to_screen"][3, 2]) > 3 * bottom.max() and (images["id"][-1] == -4).all()
    np.testing.assert_allclose(images["color"][-1, :, :3], -GREY.direction[1] + .1, atol=1e-5)


@RASTERS
def test_parts_bands_and_teams_are_the_same_bits(gpu, another, sphere, raster):
    there = attrs.evolve(scene_of("faces", sphere), ground=clfur.Ground(-1.1), light=LIGHTS)
    settings = clfur.Settings(raster=raster, grid=16, shadow_map=32)
    whole = clfur.draw(there, gpu, settings, OUTPUTS, hashes=True)
    assert len(np.unique(whole.images["id"])) > 3 and (whole.images["id"] == -4).any()
    small = another(1_400_000 if raster == "samples" else 2_600_000)
    frame = clfur.draw(there, small, settings, OUTPUTS, hashes=True)
    same(whole, frame)
    if raster == "samples":
        same(whole, clfur.draw(there, [gpu, another()], settings, OUTPUTS, hashes=True))


def test_coverage_alone_and_shells(gpu, sphere):
    """Coverage is known by light alone; fur of shells hides the ground and casts shadows on it."""
    for some in (fur(), None, clfur.Shells(layers=8), [clfur.Shells(layers=8), fur()]):
        there = scene(sphere, fur=some)
        settings = clfur.Settings(grid=32, shadow_map=64)
        alone = clfur.render(there, gpu, settings, ("coverage",))["coverage"]
        image = clfur.render(there, gpu, settings)
        np.testing.assert_array_equal(alone, image[..., 3])
        assert image[..., 3].max() <= 1 and 0 < image[0, 0, 3] + image[..., 3].mean() < 1


def test_close_up_the_grid_is_as_fine_as_what_is_seen_needs(gpu):
    """One of nine balls in a row: without any ground grids are fitted to it, with one too, and the shadows of its
    neighbours that fall into the picture are there."""
    positions, faces = icosphere(2)
    apart = np.array([(3.5 * k, 0, 0) for k in range(-4, 5)])
    row = clfur.Mesh((positions + apart[:, None]).reshape(-1, 3),
                     faces=(faces + len(positions) * np.arange(9)[:, None, None]).reshape(-1, 3))
    light = clfur.Light((1, -.6, 0))
    camera = clfur.Camera(eye=(-.5, 2.5, 5), target=(-.5, -.6, 0), fov=30, size=(65, 49))
    there = clfur.Scene(row, fur(2000), camera, light, ground=clfur.Ground())
    rig = Rig.of(there)
    assert rig.fit.seen.cropped and float(rig.grids[0]["face"][1]) * 96 < .5 * 2 * rig.fit.whole[1]
    one, other = clfur.render(there, gpu, clfur.Settings(samples=16)), truth.picture(there, 3)
    on = clfur.render(there, gpu, outputs=("id",))["id"] == -4
    left = on & (np.arange(65) < 20)
    assert other[left][:, 3].max() > .5   # a neighbour's
    assert np.abs(one - other)[on][:, 3].mean() < .02
    assert one[on][:, 3].mean() == pytest.approx(other[on][:, 3].mean(), abs=.006)


@pytest.mark.parametrize("wrong_one", [{"height": "low"}, {"height": np.nan}, {"color": (1, 2)}, {"color": -1}])
def test_what_is_no_ground_is_refused(wrong_one):
    with pytest.raises(clfur.Error, match=r"Ground\.(height|color) is"):
        clfur.Ground(**wrong_one)
    with pytest.raises(clfur.Error, match=r"Scene\.ground is 3"):
        clfur.Scene(clfur.load_mesh("sphere"), ground=3)


def test_command(clfur):
    code, _, err = clfur("render", "sphere", "--size", "32x24", "--roots", 100, "--ground", "lowest", "-o", "a.png")
    assert code == 0, err
    wrong(clfur("render", "sphere", "--ground", "low"), "'--ground'", "'low' is neither 'lowest' nor a height")
    for height in "nan", "inf", "-1e10":
        wrong(clfur("render", "sphere", "--ground", height),
              f"'--ground': '{height}' is neither 'lowest' nor a height from -1e+09 to 1e+09")


@RASTERS
def test_a_painted_holdout_is_a_holdout(gpu, sphere, raster):
    """What paints it is not seen."""
    settings = clfur.Settings(raster=raster, grid=32, shadow_map=64)
    plain, painted = (clfur.render(scene(sphere, body="holdout", body_color=color), gpu, settings)
                      for color in ((.3, .2, .1), np.random.default_rng(1).random((3, 4, 3))))
    np.testing.assert_array_equal(painted, plain)


@pytest.mark.parametrize("more, words", [
    ({"camera": attrs.evolve(CAMERA, eye=(0, -1, 4)), "height": 0}, "the camera does not stand above it"),
    ({"light": clfur.Light((0, -1, 0), shadows=False)}, "no shadow falls on it"),
    ({"light": clfur.Light((0, 1, 1))}, "no shadow falls on it"),
])
def test_a_ground_of_which_nothing_is_seen_is_told(sphere, more, words):
    found, = Rig.of(scene(sphere, **more)).warnings
    assert words in found and found.startswith("nothing is seen of the ground")
    assert not Rig.of(scene(sphere, **{"light": clfur.Light((0, -1, 0))} | (
        {"height": -2} if "height" in more else {"color": (1, 1, 1)}))).warnings


SUNS = [GREY], [clfur.Light((-1, -1.5, 1)), GREY], [clfur.Light((.2, -1, .1), position=(-.5, 3, 0))]


@pytest.mark.parametrize("away", [0, 1e6])
@pytest.mark.parametrize("lights", SUNS)
def test_the_shadow_is_framed(gpu, sphere, lights, away):
    """All of it is in the picture, as near as it can: without the shadow the camera is where it is without a ground."""
    moved = clfur.Mesh(sphere.positions + np.array([away, 0, -away]), sphere.normals, None, sphere.faces)
    lights = [light if light.position is None else attrs.evolve(light, position=light.position + (away, 0, -away))
              for light in lights]
    there = clfur.Scene(moved, fur(), light=lights, ground=clfur.Ground())
    camera = attrs.evolve(there.camera, size=(64, 48))
    alpha = clfur.render(attrs.evolve(there, camera=camera), gpu, clfur.Settings(grid=32, shadow_map=64))[..., 3]
    at = np.argwhere(alpha > .001)   # less is what cells of the grid spread
    assert (at > 0).all() and (at < (47, 63)).all()
    assert (at < 4).any() or (at > (43, 59)).any()
    dark = clfur.Scene(moved, fur(), light=[attrs.evolve(light, shadows=False) for light in lights],
                       ground=clfur.Ground()).camera
    bald = clfur.Scene(moved, fur()).camera
    np.testing.assert_array_equal(dark.pose, bald.pose)


def test_a_low_suns_shadow_is_framed_as_far_as_three_radii(sphere):
    far = [np.linalg.norm(clfur.Scene(sphere, light=clfur.Light((1, -slope, -.6)), ground=clfur.Ground()).camera.eye)
           for slope in (.3, .1, 1e-3)]
    assert max(far) < 3 * np.linalg.norm(clfur.Scene(sphere).camera.eye)


def test_a_weak_lights_shadow_is_not_framed(sphere):
    """A low fill beside the sun would make all small; it counts where it is the strongest, or half as strong."""
    def pose(*lights):
        return clfur.Scene(sphere, light=list(lights), ground=clfur.Ground()).camera.pose
    fill = clfur.Light((.8, -.5, 1), intensity=.4, ambient=0)
    np.testing.assert_array_equal(pose(GREY, fill), pose(GREY))
    half = pose(GREY, attrs.evolve(fill, intensity=.5))
    assert np.abs(half - pose(GREY)).max() > .1 and np.abs(pose(fill) - pose(GREY)).max() > .1
