"""Hair of Chiang's model: its laws, its tables, and the light that strands send to the eye by them."""

import attrs
import numpy as np
import pytest
from support.scenes import strands_of
from support.stages import on_host

import clfur
from clfur.pipeline.views import light_of, view_of
from clfur.stages import chiang, strand_light
from clfur.stages.lighting import unshadowed
from clfur.twin import chiang as twin
from clfur.twin import strand_light as places_twin

LOOKS = [clfur.Chiang(), clfur.Chiang(.6, .7, 5, 1.3), clfur.Chiang(.15, .2, -10), clfur.Chiang(1, 1, 20, 3),
         clfur.Chiang(.05, .3, 0)]
SHARP = clfur.Chiang(.1, .1, 3)
GREY = clfur.Light((-1, -1, -.3), color=(1, .9, .8), ambient=.2)


def types_of(looks):
    return [clfur.HairType(look=look) for look in looks]


def all_around(n):
    """Directions over the sphere as angles, and their weights: [n * 2n]."""
    x, weights = np.polynomial.legendre.leggauss(n)
    phi = np.pi * (np.arange(2 * n) + .5) / (2 * n)
    theta, phi = np.meshgrid(np.arcsin(x), phi, indexing="ij")
    return theta.ravel(), phi.ravel(), np.repeat(weights, 2 * n) * np.pi / n


@pytest.mark.parametrize("look", [*LOOKS, SHARP])
@pytest.mark.parametrize("theta", [0, .7, -1.3, 1.5])
def test_a_white_hair_gives_back_all_light_and_no_hair_more(look, theta):
    """The twin's own quadrature over all directions of the light: 1 for white, below it for others, less the darker."""
    theta_l, phi, weights = all_around(200)
    colors = np.array([1, .9, .5, .1, 0])
    m = twin.longitudinal(np.full(200, float(theta)), theta_l[::400], *look.lobes[::2])
    angles = phi[:400]
    sums = []
    for color in colors:
        sigma = np.full(400, twin.absorption_of(color, look.azimuthal_roughness))
        around = twin.across(np.full(400, float(theta)), angles, sigma, look.azimuthal_roughness, look.index)
        sums.append(((m * weights[::400, None]).sum(0) * around.sum(0)).sum())
    assert sums[0] == pytest.approx(1, abs=1e-4)
    assert (np.diff(sums) < 0).all() and sums[-1] > 0


def test_both_sides_of_a_strand_are_alike():
    """A mirrored place across the strand turns light the other way by as much."""
    rng = np.random.default_rng(1)
    phi, theta, h = rng.uniform(-3, 3, 200), rng.uniform(-1.5, 1.5, 200), rng.uniform(-1, 1, 200)
    np.testing.assert_allclose(twin.turned(phi, theta, h, .3, 1.55), twin.turned(-phi, theta, -h, .3, 1.55), rtol=1e-9)
    np.testing.assert_allclose(twin.attenuations(theta, h, 1.2, 1.55), twin.attenuations(theta, -h, 1.2, 1.55))


def test_the_highlight_moves_to_the_root():
    """Seen from aside, R is brightest where the light comes from nearer to the root by twice the tilt, TT from nearer
    to the tip by the tilt (Marschner et al. 2003)."""
    theta = np.linspace(-.6, .6, 2401)
    m = twin.longitudinal(np.zeros(2401), theta, .1, np.radians(5))
    assert np.degrees(theta[m.argmax(0)]) == pytest.approx([-10, 5, 20, 0], abs=.3)


@pytest.mark.small
def test_a_small_table_is_the_twins(gpu):
    """Float32's own rounding over a few dozen places across the strand."""
    look = clfur.Chiang(.3, .7)
    table = chiang.Scattering.declared["lobe_table"].empty(gpu, 7 + 3 * 4 * chiang.SHADES)
    chiang.tabulate(gpu, look, 3, 4, 7, table)
    _holds(table.get()[7:].reshape(3, 4, chiang.SHADES, 4), look)


def _holds(table, look):
    """Compare a table with the twin's values, at the cosine 0 too, where hair reflects all."""
    cosines, angles = chiang.cosines(len(table)), np.linspace(0, np.pi, table.shape[1])
    grid = np.meshgrid(np.arccos(cosines), angles, chiang.shades(), indexing="ij")
    theta, phi, sigma = (each.ravel() for each in grid)
    some = np.random.default_rng(2).permutation(len(theta))[:3000]
    meant = twin.across(theta[some], phi[some], sigma[some], look.azimuthal_roughness, look.index)
    np.testing.assert_allclose(table.reshape(-1, 4)[some], meant, rtol=1e-4, atol=2e-5)


@pytest.mark.parametrize("look", [*LOOKS, SHARP])
def test_tables_are_the_twins_and_keep_all_light(gpu, look):
    """Between their places they are linear, so that what holds of sums over these holds everywhere."""
    made = on_host(chiang.scattering(gpu, types_of([clfur.Kajiya(), look])))
    begin, cosines, angles, _ = made.lobes["table"][1]
    assert begin == 0 and (cosines, angles) == chiang.sizes(look.scale) and not made.lobes["table"][0].any()
    table = made.lobe_table.reshape(cosines, angles, chiang.SHADES, 4)
    _holds(table, look)
    weights = np.full(angles, 2 * np.pi / (angles - 1))
    weights[[0, -1]] /= 2
    sums = np.einsum("tasp,a->ts", table.astype(float), weights)
    np.testing.assert_allclose(sums[:, -1], 1, atol=1e-5)
    assert (np.diff(sums, axis=1) > -1e-6).all() and sums.max() < 1 + 1e-5


def test_looks_that_differ_along_the_strand_share_a_table(gpu):
    looks = [clfur.Chiang(), clfur.Chiang(.5, tilt=4, eumelanin=2), clfur.Chiang(azimuthal_roughness=.5)]
    made = chiang.scattering(gpu, types_of(looks))
    begins = made.lobes.get()["table"][:, 0]
    assert begins[0] == begins[1] != begins[2] and len(made.lobe_table) == chiang.entries(types_of(looks))
    assert len(made.lobe_table) == chiang.entries(types_of(looks[::2]))


def strands_with(looks, n, seed=3):
    """A scene of single segments of these looks, in all directions and colours."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, 1, 3))
    points = np.concatenate([a, a + .003 * rng.normal(size=(n, 1, 3))], 1)
    color = 10**rng.uniform(-2.5, .1, (n, 3))
    fur = clfur.Curves(points, width=.01, color=color, types=types_of(looks), type_of=np.arange(n) % len(looks))
    return clfur.Scene(fur=fur, light=GREY, camera=clfur.Camera(eye=(0, 0, 8), target=(0, 0, 0)))


@pytest.mark.parametrize("n, looks", [
    pytest.param(3, [clfur.Chiang(.3, .7)], marks=pytest.mark.small), (1500, LOOKS), (1500, [SHARP]),
    (1500, [clfur.Kajiya(), LOOKS[0], clfur.Kajiya(highlight="half-vector"), LOOKS[2]])],
    ids=["few", "all", "sharp", "mixed"])
def test_strands_send_the_twins_light(gpu, n, looks):
    """By tables: 0.2 % on average, of single values 1.5 % and .003."""
    scene = strands_with(looks, n)
    strands, view = strands_of(gpu, scene), view_of(scene, 1)
    lights = [light_of(scene.light), light_of(clfur.Light((1, -.2, .5)))]
    lit = strand_light.radiance(gpu, view, unshadowed(gpu, *lights), strands,
                                scattering=chiang.scattering(gpu, scene.strands.hair_types))
    places, k = lit.places.get(), 2 * np.arange(n)
    assert not len(lit.more)
    found = sum(places_twin.between(places[i::2], k, np.zeros(n)) for i in range(2))   # of either light
    meant = places_twin.sent(view, lights, k, np.zeros(n), on_host(strands))
    np.testing.assert_allclose(found, meant, rtol=.015, atol=.003)
    assert np.abs(found - meant).sum() < .002 * meant.sum()


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_pictures_take_the_look(gpu, raster):
    """Both ways to draw strands light them alike; a table is made once for frames that differ in all else."""
    rng = np.random.default_rng(0)
    fur = clfur.Curves(rng.normal(size=(60, 4, 3)) * .4, width=.05, color=(.7, .5, .3), alpha=1,
                       look=clfur.Chiang(.4, .4))
    scene = clfur.Scene(fur=fur, camera=clfur.Camera(eye=(0, 0, 5), target=(0, 0, 0), size=(64, 48)), light=GREY)
    settings = clfur.Settings(samples=16, shadows="off", raster=raster)
    picture = clfur.render(scene, gpu, settings)
    made = gpu._kept["scattering"][1]
    mesh = clfur.Mesh(np.eye(3) - 9, np.eye(3), None, [[0, 1, 2]])
    clfur.render(attrs.evolve(scene, mesh=mesh), gpu, settings)   # as in a film in which it moves
    again = clfur.render(attrs.evolve(scene, light=clfur.Light((0, 0, -1))), gpu, settings)
    assert gpu._kept["scattering"][1] is made
    plain = clfur.render(attrs.evolve(scene, fur=attrs.evolve(fur, look=clfur.Kajiya())), gpu, settings)
    other = clfur.render(scene, gpu, attrs.evolve(settings, raster="samples"))
    assert np.abs(picture - plain).max() > .05 and np.abs(again - picture).max() > .05
    assert np.abs(picture - other).mean() < .004


@pytest.mark.parametrize("given, words", [
    ({"azimuthal_roughness": .05}, "Chiang.azimuthal_roughness is 0.05; allowed: a finite number >= 0.1, <= 1"),
    ({"index": 1}, "Chiang.index is 1"), ({"tilt": 90}, "Chiang.tilt is 90"),
    ({"eumelanin": -1}, "Chiang.eumelanin is -1"), ({"absorption": 3}, "Chiang.absorption is 3"),
    ({"longitudinal_roughness": 0}, "Chiang.longitudinal_roughness is 0"),
    ({"absorption": (1, 1, 1), "pheomelanin": 1}, "melanin is given too; allowed: one of them")])
def test_what_is_given_is_checked(given, words):
    with pytest.raises(clfur.Error, match=words):
        clfur.Chiang(**given)


def test_shells_refuse_it():
    with pytest.raises(clfur.Error, match="Shells.look is Chiang.*; allowed: a Kajiya"):
        clfur.Shells(look=clfur.Chiang())


@pytest.mark.parametrize("given, absorbs", [
    ({"eumelanin": 1.3}, 1.3 * np.array([.419, .697, 1.37])), ({"absorption": (.1, 2, 30)}, (.1, 2, 30)),
    ({"eumelanin": .2, "pheomelanin": .4}, (.2 * .419 + .4 * .187, .2 * .697 + .4 * .4, .2 * 1.37 + .4 * 1.05))])
def test_pigment_becomes_the_colour_that_absorbs_as_much(given, absorbs):
    look = clfur.Chiang(azimuthal_roughness=.45, **given)
    kind = clfur.HairType(look=look)
    np.testing.assert_allclose(twin.absorption_of(kind.color, .45), absorbs, rtol=1e-9)
    assert clfur.Curves(np.zeros((1, 2, 3)), look=look).color[0] == pytest.approx(kind.color)
    assert clfur.HairType(look=clfur.Chiang(), color=(.1, .2, .3)).color == pytest.approx((.1, .2, .3))
    assert attrs.evolve(kind, width=.1).color == pytest.approx(kind.color)
