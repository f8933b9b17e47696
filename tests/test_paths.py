"""Light that the truth follows from hair to hair: what paths meet, where they go on, and the laws of their light."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import truth
from clfur.judge import lobes
from clfur.judge.sky import Sky
from clfur.judge.space import Space, dot
from clfur.twin import chiang, transport
from clfur.twin.vectors import unit

LOOKS = [clfur.Chiang(), clfur.Chiang(.6, .7, 5, 1.3), clfur.Chiang(.15, .1, -10)]
DARK = clfur.Light(color=(0, 0, 0), ambient=0)
SUN = clfur.Light((1, -1, -.6), color=(1, 1, 1), ambient=0)
CAMERA = clfur.Camera(eye=(0, .6, 4), target=(0, .45, 0), size=(16, 12))


def tuft(n=120, color=(1, 1, 1), alpha=0, width=.04, look=LOOKS[0]):
    rng = np.random.default_rng(0)
    root = np.stack([rng.uniform(-.5, .5, n), np.zeros(n), rng.uniform(-.5, .5, n)], 1)
    way = rng.normal(size=(n, 3)) * .25 + (0, 1, 0)
    return clfur.Curves(root[:, None] + way[:, None] * np.linspace(0, 1, 4)[:, None], width=width, alpha=alpha,
                        color=color, look=look)


def floor(y=0.0):
    return clfur.Mesh(np.array([(-2, y, -2), (2, y, -2), (2, y, 2), (-2, y, 2)], float),
                      faces=np.array([(0, 2, 1), (0, 3, 2)]))


def ball(subdivisions):
    positions, faces = icosphere(subdivisions)
    return clfur.Mesh(positions, faces=faces)


def mean(picture):
    return picture[..., :3].sum((0, 1)) / picture[..., 3].sum()


def seen(look, n, color=(.8, .5, .2)):
    """Strands in directions at random, as `lobes.Seen`."""
    rng = np.random.default_rng(4)
    t, v = unit(rng.normal(size=(n, 3))), unit(rng.normal(size=(n, 3)))
    return lobes.Seen(t, v, np.broadcast_to(color, (n, 3)), look.lobes), t, v


# --- where a path goes on -------------------------------------------------------------------------------


@pytest.mark.parametrize("look", LOOKS)
def test_the_mean_over_a_strand_is_what_the_look_sends(look):
    its, t, v = seen(look, 40)
    w = unit(np.random.default_rng(5).normal(size=(40, 3)))
    h = np.broadcast_to((np.arange(4000) + .5) / 2000 - 1, (40, 4000))
    given = its.sent(w, h, np.ones((40, 3)))[0].mean(1)
    for channel, value in enumerate((.8, .5, .2)):
        sigma = chiang.absorption_of(np.array([value]), look.azimuthal_roughness)[0]
        expected = transport.scattering(t, v, w, sigma, look.lobes)
        np.testing.assert_allclose(given[:, channel], expected, rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("look", LOOKS)
def test_directions_are_chosen_as_likely_as_they_say(look):
    """The sum over all directions of how likely they are is 1; and a mean over those that are chosen is the sum over
    all of them, by what is sent."""
    n, weight, random = 40000, np.array([1, .3, .1]), np.random.default_rng(6)
    one, t, v = (each.take([7]) if isinstance(each, lobes.Seen) else each[7] for each in seen(look, 8))
    weight = weight[None]
    h = np.array([[.3]])
    x, parts = np.polynomial.legendre.leggauss(120)
    phi = 2 * np.pi * (np.arange(240) + .5) / 240
    sine, phi = (each.ravel() for each in np.meshgrid(x, phi, indexing="ij"))
    cosine = np.sqrt(1 - sine**2)
    w = sine[:, None] * t + cosine[:, None] * (np.cos(phi)[:, None] * one.x + np.sin(phi)[:, None] * one.y)
    angle = np.repeat(parts, 240) * 2 * np.pi / 240
    many = one.take(np.zeros(len(w), int))
    likely = many.sent(w, np.broadcast_to(h, (len(w), 1)), np.broadcast_to(weight, (len(w), 3)))[1][:, 0]
    assert (likely * angle).sum() == pytest.approx(1, abs=1e-3)
    places = np.broadcast_to((np.arange(64) + .5) / 32 - 1, (len(w), 64))
    sent = np.concatenate([many.take(some).sent(w[some], places[some], np.ones((len(some), 3)))[0].mean(1)
                           for some in np.array_split(np.arange(len(w)), 20)])
    chosen, factor, _ = one.take(np.zeros(n, int)).choose(np.broadcast_to(weight, (n, 3)), random)
    np.testing.assert_allclose(np.linalg.norm(chosen, axis=1), 1, rtol=1e-12)
    for side in (v, -v, t, np.cross(t, v)):
        values = factor * np.maximum(dot(chosen, np.broadcast_to(side, chosen.shape)), 0)[:, None]
        expected = (sent * (np.maximum(w @ side, 0) * angle)[:, None]).sum(0)
        assert (abs(values.mean(0) - expected) < 4.5 * values.std(0) / n**.5 + 2e-3 * expected).all()


@pytest.mark.parametrize("lobe", range(4))
def test_rough_hair_turns_light_as_its_look_says(lobe):
    """So rough that half a turn cuts the logistic off."""
    n, look = 40000, clfur.Chiang(.3, .9)
    its = seen(look, 1)[0].take(np.zeros(n, int))
    h, phi = np.full(n, .4), 2 * np.pi * np.arange(2000) / 2000
    turns = its._turn(h, np.full(n, lobe), np.random.default_rng(2))
    expected = chiang.turned(phi, its.theta[0], .4, .9, 1.55)[:, lobe] * 2 * np.pi / 2000
    for of in np.cos, np.sin:
        assert of(turns).mean() == pytest.approx((of(phi) * expected).sum(), abs=4 * n**-.5)


def test_white_hair_takes_nothing_wherever_it_is_met():
    its, _, _ = seen(LOOKS[1], 500, (1, 1, 1))
    factor = its.choose(np.ones((500, 3)), np.random.default_rng(1))[1]
    np.testing.assert_allclose(factor, 1, rtol=1e-12)


def test_bessel_is_its_integral():
    x, t = np.array([0, .3, 5, 49, 51, 800.0]), np.pi * (np.arange(2000) + .5) / 2000
    np.testing.assert_allclose(lobes._bessel(x), np.exp(x[:, None] * (np.cos(t) - 1)).mean(1), rtol=1e-9)


# --- what a path meets ----------------------------------------------------------------------------------


def space(alpha=0.0, triangles=60):
    rng = np.random.default_rng(2)
    a = rng.uniform(-1, 1, (200, 4))
    b = a + rng.normal(size=(200, 4)) * .2
    a[:, 3], b[:, 3] = .2, .1
    corners = rng.uniform(-1, 1, (triangles, 1, 3)) + rng.normal(size=(triangles, 3, 3)) * .2
    return Space(a, b, np.arange(200) // 2, np.full(200, max(np.log(max(alpha, 1e-300)), -1e3)), corners)


def rays(n):
    rng = np.random.default_rng(3)
    return rng.uniform(-1.5, 1.5, (n, 3)), unit(rng.normal(size=(n, 3))), rng.integers(-1, 100, n)


def test_the_nearest_is_that_of_a_loop():
    its, (p, w, strand) = space(0), rays(400)
    none = np.full(400, -1)
    distance, segment, triangle = its.nearest(p, w, strand, none, 1e-9, np.random.default_rng(0))
    for k in range(400):
        things = np.arange(200), np.arange(60)
        found = []
        for meets, those in zip((its._meets_segment, its._meets_triangle), things):
            met, at = meets(p, w, np.full(len(those), k), those)
            met &= at > 1e-9
            if len(those) == 200:
                met &= its.owner != strand[k]
            found += [(at[j], j if len(those) == 200 else -1, j if len(those) == 60 else -1) for j in those[met]]
        assert (distance[k], segment[k], triangle[k]) == min(found, default=(np.inf, -1, -1))
    assert min((segment >= 0).sum(), (triangle >= 0).sum(), np.isinf(distance).sum()) > 25


def test_hair_lets_paths_through_as_it_lets_light_through():
    its, (p, w, strand) = space(.6), rays(400)
    none = np.full(400, -1)
    left = its.light_left(p, w, strand, none, 1e-9)
    many = np.repeat(np.arange(400), 100)
    out = its.nearest(p[many], w[many], strand[many], none[many], 1e-9, np.random.default_rng(0))[0] == np.inf
    share = out.reshape(400, 100).mean(1)
    assert ((left > 0) & (left < 1)).sum() > 60
    assert abs(share - left).max() < 4.5 * .05 and abs((share - left).mean()) < 4 * .05 / 20


# --- laws of light --------------------------------------------------------------------------------------


@pytest.mark.parametrize("fields", [
    {"fur": tuft()}, {"fur": tuft(alpha=.6, look=LOOKS[1])},
    {"fur": tuft(width=.02), "mesh": ball(1), "body_color": (1, 1, 1)}])
def test_all_that_is_white_cannot_be_seen_in_white(fields):
    """Wherever paths go, they end in the sky, and nothing of them is lost."""
    scene = clfur.Scene(**fields, camera=CAMERA, environment=clfur.Environment(), light=DARK)
    picture = truth.picture(scene, 2, orders=truth.ALL)
    assert picture[..., 3].sum() > 20
    np.testing.assert_allclose(picture[..., :3], np.repeat(picture[..., 3:], 3, 2), rtol=1e-9)


def test_paths_leave_a_ball_by_its_faces():
    """Its normals lean over them, but nothing of a coarse ball hides its own faces."""
    scene = clfur.Scene(mesh=ball(1), body_color=(.8, .5, .2), light=DARK, camera=CAMERA,
                        environment=clfur.Environment())
    picture = truth.picture(scene, 4, orders=truth.ALL)
    np.testing.assert_allclose(picture[..., :3], picture[..., 3:] * (.8, .5, .2), rtol=1e-9)


def test_a_flat_ambient_that_is_given_counts_once():
    color = .9, .6, .3
    scene = clfur.Scene(fur=tuft(color=color), mesh=floor(-.1), body_color=color, light=SUN, camera=CAMERA)
    dark, ambient = (truth.picture(attrs.evolve(scene, light=attrs.evolve(SUN, ambient=a)), 4, orders=truth.ALL)
                     for a in (0, .3))
    np.testing.assert_allclose(ambient - dark, dark[..., 3:] * (.27, .18, .09, 0), atol=1e-9)
    default = truth.picture(attrs.evolve(scene, light=attrs.evolve(SUN, ambient=None)), 4, orders=truth.ALL)
    np.testing.assert_array_equal(default, dark)


def test_a_ball_of_light_is_lit_by_itself():
    """Within a ball of albedo a, around a lamp in its middle: 1 / (1 - a) of what the lamp does alone."""
    lamp = clfur.Light((0, 0, -1), position=(0, 0, 0), angle=360, color=(1, 1, 1), ambient=0, shadows=False)
    scene = clfur.Scene(mesh=ball(3), body_color=(.8, .5, 0), light=lamp,
                        camera=clfur.Camera(eye=(0, 0, .5), target=(0, 0, 0), size=(12, 12)))
    picture = truth.picture(scene, 8, orders=truth.ALL)
    np.testing.assert_allclose(mean(picture), (4, 1, 0), rtol=.01)


@pytest.mark.parametrize("light", [
    [SUN, clfur.Light((-1, -.2, -1), color=(.2, .5, 1), ambient=0, size=20)],
    clfur.Light((-1, -1, -1), position=(1.5, 2, 1.5), angle=70, ambient=0),
    clfur.Light((-1, -1, -1), position=(3, 4, 3), angle=360, ambient=.3)])
def test_light_that_is_scattered_once_is_that_without_paths(light):
    fur = tuft(color=(.9, .6, .3), alpha=.5)
    scene = clfur.Scene(fur=fur, mesh=floor(-.1), body_color=(.5, .4, .3), light=light, camera=CAMERA)
    straight, once = truth.picture(scene, 8), truth.picture(scene, 8, orders=1)
    np.testing.assert_array_equal(straight[..., 3], once[..., 3])
    assert mean(once) == pytest.approx(mean(straight), rel=.02)
    apart = abs(once - straight)[..., :3]
    assert apart.mean() < .05 * straight[..., :3].mean() and apart.any()


def test_a_lone_strand_sends_what_its_look_says():
    """Nothing else is there that light could come from, however often it is scattered."""
    fur = clfur.Curves([[(-1, 0, 0), (1, .2, .3)]], width=.4, color=(.7, .4, .1), alpha=0, look=clfur.Chiang())
    scene = clfur.Scene(fur=fur, light=SUN, camera=clfur.Camera(eye=(0, 0, 500), target=(0, 0, 0), fov=.02,
                                                                 size=(4, 4)))
    t, v = unit(np.array([[2, .2, .3]])), np.array([[0, 0, 1.0]])
    expected = chiang.fibre(np.array([(.7, .4, .1)]), np.array([clfur.Chiang().lobes]), t, -SUN.direction[None], v)[0]
    np.testing.assert_allclose(mean(truth.picture(scene, 16, orders=truth.ALL)), expected, rtol=.02)


def test_the_more_hair_absorbs_the_less_light_there_is():
    light = [mean(truth.picture(clfur.Scene(fur=tuft(color=(c, c, c)), light=SUN, camera=CAMERA), 4, orders=truth.ALL))
             for c in (1, .9, .5, .1, 0)]
    assert (np.diff(light, axis=0) < 0).all() and light[0][0] > 5 * light[-1][0]


def test_each_order_adds_light():
    scene = clfur.Scene(fur=tuft(), mesh=floor(-.1), body_color=(.5, .4, .3), light=SUN, camera=CAMERA)
    sums = [mean(truth.picture(scene, 4, orders=orders))[0] for orders in (1, 2, 4, truth.ALL)]
    assert (np.diff(sums) > 0).all()


def test_the_body_gives_hair_its_color():
    """A red floor, which is not seen itself, reddens white hair over it."""
    scene = clfur.Scene(fur=tuft(), mesh=floor(-.1), body_color=(.9, .1, 0), light=SUN, camera=CAMERA, body="holdout")
    r, g, b = mean(truth.picture(scene, 6, orders=truth.ALL))
    assert r > 1.5 * b and 1.02 * b < g < 1.2 * b


@pytest.mark.parametrize("body", [None, (.6, .6, .6)])
def test_aiming_at_what_is_bright_of_a_sky_has_no_bias(body, monkeypatch):
    picture = np.full((8, 16, 3), .3)
    picture[1:3, 5:8] = 4, 3, 2
    scene = clfur.Scene(fur=tuft(color=(.8, .8, .8), alpha=.3), mesh=floor(-.1), body_color=body, light=DARK,
                        camera=CAMERA, environment=clfur.Environment(picture))
    aimed = truth.picture(scene, 8, orders=truth.ALL)
    monkeypatch.setattr(Sky, "even", True)
    blind = truth.picture(scene, 16, orders=truth.ALL)
    np.testing.assert_allclose(mean(aimed), mean(blind), rtol=.02)


def test_two_seeds_differ_as_much_as_is_said():
    scene = clfur.Scene(fur=tuft(color=(.9, .8, .6)), light=SUN, camera=CAMERA)
    noise = np.sqrt((truth.noise_of(scene, 6, orders=truth.ALL)[..., :3]**2).mean())
    error = truth.picture(scene, 6, 7, orders=truth.ALL) - truth.picture(scene, 24, 9, orders=truth.ALL)
    assert np.sqrt((error[..., :3]**2).mean()) == pytest.approx(noise, rel=.25)


def test_the_same_seed_gives_the_same_picture():
    scene = clfur.Scene(fur=tuft(), light=SUN, camera=CAMERA)
    one, same, other = (truth.picture(scene, 2, seed, orders=truth.ALL) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_what_cannot_be_followed_is_refused():
    scene = clfur.Scene(fur=clfur.Curves([[(0, 0, 0), (0, 1, 0)]]), camera=CAMERA)
    with pytest.raises(clfur.Error, match="the look of hair is kajiya-kay; allowed: clfur.Chiang"):
        truth.picture(scene, 1, orders=2)
    for orders in (-1, 1.5, truth.ALL + 1):
        with pytest.raises(clfur.Error, match="orders"):
            truth.picture(attrs.evolve(scene, fur=tuft(1)), 1, orders=orders)


def test_pictures_of_other_orders_are_kept_apart(tmp_path):
    scene = clfur.Scene(fur=tuft(20), light=SUN, camera=CAMERA)
    pictures = [truth.cached_picture(scene, 1, tmp_path, orders=orders) for orders in (0, 3, 0, 3)]
    assert len(list(tmp_path.iterdir())) == 2 and (pictures[0] != pictures[1]).any()
    np.testing.assert_array_equal(pictures[1], pictures[3])
