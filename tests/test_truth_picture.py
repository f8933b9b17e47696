"""Whole pictures of the truth against what can be worked out by hand, and against a ray tracer made of loops."""

import itertools
import math

import numpy as np
import pytest
from support.plans import plan_of

import clfur
from clfur import truth
from clfur.judge.geometry import geometry_of
from clfur.judge.lights import Light
from clfur.judge.rays import Eye, Fibres, frame_along
from clfur.pipeline import build
from clfur.pipeline.plan import Part

FAR, PIXELS = 1000.0, 100.0                   # an eye so far away that a unit is 100 pixels everywhere
UP_LIGHT = clfur.Light(direction=(0, -1, 0), color=(1, 1, 1), ambient=0)
FLAT = clfur.Light(color=(0, 0, 0), ambient=1)   # all is as bright as its colour


def camera(size, eye=(0, 0, FAR), pixels=PIXELS, turn=None):
    """Looks along -z at the origin in the middle of the picture, where a unit is `pixels` pixels."""
    pose = np.eye(4)
    pose[:3, 3] = eye
    if turn is not None:
        pose[:3, :3] = turn
        pose[:3, 3] = turn @ eye
    distance = np.linalg.norm(eye)
    return clfur.Camera.calibrated(pose, [[pixels * distance, 0, size[0] / 2], [0, pixels * distance, size[1] / 2],
                                          [0, 0, 1]], size)


def straight(ends, pixels=1.0, **more):
    """Straight strands [n, 2, 3] of a width in pixels of `camera`."""
    more = {"color": (.5, .4, .3), "specular": 0, "alpha": .5} | more
    return clfur.Curves(points=np.asarray(ends, float), width=np.asarray(pixels) / PIXELS, **more)


def quad(x, y, z, across=(1, 0, 0), down=(0, 1, 0)):
    """Corners of a square of two units about (x, y, z)."""
    center, across, down = np.array([x, y, z]), np.array(across), np.array(down)
    return np.array([center - across - down, center + across - down, center + across + down, center - across + down])


def mesh(*quads):
    faces = [np.array([(0, 1, 2), (0, 2, 3)]) + 4 * k for k in range(len(quads))]
    return clfur.Mesh(np.concatenate(quads), faces=np.concatenate(faces))


# --- coverage -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("width, slope", [(.1, 0), (.1, -4), (.36, .3), (.36, 1), (3, 0), (3, .3)])
def test_a_strand_covers_its_area(width, slope):
    """Ends within the picture; the area of a rectangle, however thin."""
    along = np.array([1, slope, 0]) / math.hypot(1, slope) * .2
    strand = straight([(-along + (.003, .002, 0), along + (.003, .002, 0))], width)
    s = clfur.Scene(fur=strand, camera=camera((56, 56)), light=FLAT)
    picture = truth.picture(s, 16)
    # Rays in the squares along its long sides fall on or beside it at random: the sum varies by .04 to .08.
    assert picture[..., 3].sum() == pytest.approx(40 * width, abs=.3)
    np.testing.assert_allclose(picture[..., :3], picture[..., 3:] * (.5, .4, .3), rtol=1e-6)


def test_coverage_has_no_bias():
    """The mean of many thin strands at random: one varies by .8 %, their mean by .15 %."""
    rng = np.random.default_rng(1)
    angle, total = rng.uniform(0, 2 * math.pi, 30), 0
    middle = rng.uniform(-.01, .01, (30, 3))
    along = np.stack([np.cos(angle), np.sin(angle), np.zeros(30)], 1) * .1
    for k in range(30):
        strand = straight([(middle[k] - along[k], middle[k] + along[k])], .36)
        s = clfur.Scene(fur=strand, camera=camera((24, 24)), light=FLAT)
        total += truth.picture(s, 16, k)[..., 3].sum()
    assert total / 30 == pytest.approx(20 * .36, rel=2.5e-3)


def test_strands_off_the_axis_keep_their_solid_angle():
    """Seen from near at 60 degrees off the axis: solid angle · f² / cos³ of the angle, for both ways across."""
    f, p, w = 40.0, np.array([math.tan(math.radians(60)), 0, -1]), .004
    for along in (np.array([0, 1, 0]), np.array([1, 0, 0])):
        k = [[f, 0, 16 - f * p[0]], [0, f, 16], [0, 0, 1]]
        s = clfur.Scene(fur=clfur.Curves(points=[(p - .1 * along, p + .1 * along)], width=w),
                        camera=clfur.Camera.calibrated(np.eye(4), k, (32, 32)))
        distance = np.linalg.norm(p)
        angle = .2 * np.linalg.norm(np.cross(along, p / distance)) * w / distance**2
        assert truth.picture(s, 32)[..., 3].sum() == pytest.approx(angle * f**2 * distance**3, rel=.02)


def test_a_bend_has_no_gap():
    """Two segments at a right angle, wider than their joint is far from the middle of the picture."""
    s = clfur.Scene(fur=straight([[(-1, 0, 0), (0, 0, 0), (0, -1, 0)]], 8), camera=camera((8, 8)), light=FLAT)
    covered = truth.picture(s, 16)[..., 3].sum()
    assert covered == pytest.approx(48 + 16 * math.pi / 4, abs=.1)               # the joint is round


@pytest.mark.parametrize("n", [1, 2, 9])
def test_ends_are_square(n):
    """Whatever is left behind the last joint: a ball there does not stick out."""
    points = np.linspace((-2, 0, 0), (2, 0, 0), n + 1) / PIXELS
    picture = truth.picture(clfur.Scene(fur=straight([points], 4), camera=camera((12, 12)), light=FLAT), 8)
    np.testing.assert_array_equal(picture[..., 3], np.pad(np.ones((4, 4)), 4))


def test_joints_do_not_count_twice():
    """A strand cut into many segments casts the shadow of one, and looks as one."""
    cut = np.linspace((-.5, .1, .002), (.5, .1, .002), 23)
    pictures = []
    for upper in ([cut[0], cut[-1]], cut):
        points = np.concatenate([upper, np.linspace((-.5, 0, 0), (.5, 0, 0), 5)])
        fur = clfur.Curves(points=points, counts=[len(upper), 5], width=[.05, .02], alpha=.5, specular=0)
        pictures.append(truth.picture(clfur.Scene(fur=fur, camera=camera((80, 40)), light=UP_LIGHT)))
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1e-7)


def test_the_nearer_strand_is_seen():
    crossing = [((-1, 0, .1), (1, 0, .1)), ((0, -1, 0), (0, 1, 0))]
    for order in ([0, 1], [1, 0]):
        fur = straight(np.array(crossing)[order], [4., 4.], color=np.eye(3)[order])
        picture = truth.picture(clfur.Scene(fur=fur, camera=camera((8, 8)), light=FLAT), 4)
        np.testing.assert_allclose(picture[2:6, :, :3].reshape(-1, 3), [(1, 0, 0)] * 32, atol=1e-12)
        np.testing.assert_allclose(picture[:2, 2:6, :3].reshape(-1, 3), [(0, 1, 0)] * 8, atol=1e-12)


def test_what_lies_before_the_near_plane_is_not_seen():
    """A strand from behind the eye to before it, seen from within the scene, and one behind the eye."""
    for ends, covered in (((-.02, 0, 2), (.3, 0, -2)), 1), (((0, 0, 1), (0, .01, 2)), 0):
        fur = clfur.Curves(points=[ends], width=.01)
        picture = truth.picture(clfur.Scene(fur=fur, camera=camera((16, 16), (0, 0, .01), 5)), 4)
        assert (picture[..., 3].sum() > 0) == covered and np.isfinite(picture).all()


@pytest.mark.parametrize("width", [.1, .36, 3])
def test_parallel_rays_see_what_a_far_eye_sees(width):
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-.1, .1, (12, 3)), np.full(12, width / PIXELS)])
    first, last = np.arange(11) == 0, np.arange(11) == 10
    far = Eye(np.array([0, 0, 1e5]), np.diag([1.0, -1, -1]), False)
    parallel = Eye(np.array([0, 0, 1e5]), np.diag([1.0, -1, -1]), True)
    places = rng.uniform(-.1, .1, (20000, 2))
    found = []
    for eye, scale in ((far, 1e-5), (parallel, 1.0)):
        window = places.min(0) * scale, places.max(0) * scale
        fibres = Fibres(eye, points[:-1], points[1:], first, last, 1.0, window)
        depth, which = fibres.nearest(places * scale)
        on = which >= 0
        found.append(on)
        back = eye.frame(eye.points(places[on] * scale, depth[on]))
        np.testing.assert_allclose(eye.places(back), places[on] * scale, atol=1e-9 * scale)
    assert found[0].mean() > width / 50 and (found[0] != found[1]).mean() < 2e-4


# --- light ----------------------------------------------------------------------------------------------


def side_by_side(alpha, others, light=UP_LIGHT):
    """A strand along x seen from +z, and others that are out of the picture -> its brightness against itself alone."""
    lower = [(-1, 0, 0), (1, 0, 0)]
    pictures = []
    for ends in ([lower], [lower, *others]):
        fur = straight(ends, 4, alpha=alpha)
        pictures.append(truth.picture(clfur.Scene(fur=fur, camera=camera((8, 8)), light=light)))
    assert pictures[0][..., 0].max() > .3
    return pictures[1][..., 0].sum() / pictures[0][..., 0].sum()


@pytest.mark.parametrize("alpha", [0, .5, .9, 1])
def test_each_strand_in_the_way_takes_its_share(alpha):
    above = [((-1, .5 + .1 * k, z), (1, .5 + .1 * k, z)) for k in range(3) for z in np.arange(-.04, .05, .04)]
    assert side_by_side(alpha, above[3:6]) == pytest.approx(alpha, abs=1e-12)     # they touch: no ray gets between
    assert side_by_side(alpha, above) == pytest.approx(alpha**3, abs=1e-12)
    below = [((-1, -.5, 0), (1, -.5, 0))]
    assert side_by_side(alpha, below) == 1


def test_a_strand_does_not_shade_itself():
    """A strand that turns back above itself."""
    turned = [[(-1, 0, 0), (.5, 0, 0), (1, 0, 0), (1, .5, 0), (-1, .5, 0)]]
    picture = truth.picture(clfur.Scene(fur=straight(turned, 4), camera=camera((8, 8)), light=UP_LIGHT))
    np.testing.assert_allclose(picture[2:6, :, :3].reshape(-1, 3), [(.5, .4, .3)] * 32, atol=1e-6)


def test_the_body_is_lamberts():
    light = clfur.Light(direction=(.3, -.4, -1), color=(.9, .8, .7), ambient=.2)
    body = mesh(quad(0, 0, 0))
    s = clfur.Scene(mesh=body, body_color=(.5, .25, .125), light=light, camera=camera((6, 4)))
    expected = np.array([.5, .25, .125]) * (np.array([.9, .8, .7]) / math.sqrt(1.25) + .2)
    np.testing.assert_allclose(truth.picture(s, 2), np.broadcast_to([*expected, 1], (4, 6, 4)), atol=1e-6)
    behind = clfur.Light(direction=(.3, -.4, 1), color=(.9, .8, .7), ambient=.2)
    s = clfur.Scene(mesh=body, body_color=(.5, .25, .125), light=behind, camera=camera((6, 4)))
    np.testing.assert_allclose(truth.picture(s, 2)[..., :3], np.broadcast_to([.1, .05, .025], (4, 6, 3)), atol=1e-6)


@pytest.mark.parametrize("spot", [False, True])
def test_the_body_casts_a_hard_shadow_on_itself_and_on_hair(spot):
    """A square out of the picture hides the light from the half of it where x < 0: of the floor, and of a strand."""
    light = clfur.Light(direction=(0, 0, -1), ambient=0, color=(1, 1, 1))
    above = quad(-1, 0, 1., down=(0, .3, 0))
    if spot:     # from height 2 above x = .5 the shadow of the square's side, x = .25 at height 1, falls at x = 0
        light = clfur.Light(direction=(0, 0, -1), ambient=0, color=(1, 1, 1), position=(.5, 0, 2), angle=90)
        above = quad(-.75, 0, 1., down=(0, .3, 0))
    turn = np.array([[1, 0, 0], [0, .8, -.6], [0, .6, .8]])          # looks in below the square
    strand = straight([((-1, .06, .02), (1, .06, .02))], 4, color=(.5, .5, .5))
    s = clfur.Scene(mesh=mesh(quad(0, 0, 0), above), fur=strand, body_color=(1, 1, 1), light=light,
                    camera=camera((20, 20), (0, 0, FAR), turn=turn))
    picture = truth.picture(s, 4)
    assert (picture[..., 3] == 1).all()
    assert (picture[:, :10, :3] == 0).all() and (picture[:, 11:, :3] > .3).all()


def test_strands_on_the_body_get_light_from_their_roots_on():
    """On a plane in the light, nothing of hair that stands apart is dark."""
    fur = clfur.Strands(inner=1, outer=1, roots=60, force=(0, 0, 0), types=clfur.HairType(
        segments=3, segment_length=.03, width=.01, specular=0, color=(1, 1, 1), alpha=1, direction_variation=.4))
    light = clfur.Light(direction=(0, -1, -.2), color=(1, 1, 1), ambient=0)
    s = clfur.Scene(mesh=mesh(quad(0, 0, 0, down=(0, 0, -1))), fur=fur, body_color=(0, 0, 0), light=light,
                    camera=clfur.Camera(eye=(0, 1, 2), size=(60, 40)))
    hair, body = geometry_of(s)
    sun = Light(s, light, hair, body)
    p = hair.points[hair.first[::3], :3]                             # the roots themselves
    assert (sun._transmittance(p, np.full(len(p), -1), hair.owner[::3]) == 1).all()
    assert (sun._transmittance(p - (0, .001, 0), np.full(len(p), -1), hair.owner[::3]) == 0).all()
    assert truth.picture(s, 4)[..., 0].max() > .1


def test_a_spot_lights_its_cone():
    """At distance 1 a cone of 20 degrees is a disc of radius tan(10 degrees), where Lambert's cosine is integrated."""
    light = clfur.Light(direction=(0, 0, -1), position=(0, 0, 1), angle=20, ambient=0, color=(1, 1, 1))
    s = clfur.Scene(mesh=mesh(quad(0, 0, 0)), body_color=(1, 1, 1), light=light, camera=camera((40, 40)))
    picture = truth.picture(s, 8)
    radius = math.tan(math.radians(10))
    # The integral of r dr / sqrt(1 + r²), all around.
    total = 2 * math.pi * (math.sqrt(1 + radius**2) - 1) * PIXELS**2
    assert picture[..., 0].sum() == pytest.approx(total, rel=2e-3)


# --- the same picture by loops --------------------------------------------------------------------------


def loops(scene, samples, seed):
    """`truth.picture` of Curves with one width, and a flat body, ray by ray and thing by thing."""
    fur, light, k = scene.fur, scene.light, np.linalg.inv(scene.camera.intrinsics)
    eye, axes = scene.camera.pose[:3, 3], scene.camera.pose[:3, :3]
    width, height = scene.camera.size
    ends = np.cumsum(fur.counts.astype(int))
    strands = [(n, fur.points[b:e].astype(float)) for n, (b, e) in enumerate(zip(ends - fur.counts, ends))]
    radius = float(fur.width[0]) / 2
    corners = scene.mesh.positions[scene.mesh.faces].astype(float)
    normals = scene.mesh.normals[scene.mesh.faces].astype(float)

    def closest(o, d, a, b):
        """(t, s) of the nearest points of o + t d and a + s (b - a)."""
        return np.linalg.solve(np.array([[d @ d, -d @ (b - a)], [d @ (b - a), -(b - a) @ (b - a)]]),
                               np.array([(a - o) @ d, (a - o) @ (b - a)]))

    def on_triangle(o, d, c):
        """(t, weights) where o + t d meets the triangle, or None."""
        matrix = np.array([*c.T, np.ones(3)]).T                              # rows: corners and 1
        solved = np.linalg.solve(np.block([[matrix.T, -np.append(d, 0)[:, None]]]), np.append(o, 1))
        return (solved[3], solved[:3]) if (solved[:3] >= 0).all() else None

    def left(p, strand, triangle):
        d = -light.direction if light.position is None else light.position - p
        end = np.inf if light.position is None else 1
        if light.position is not None and -d @ light.direction / np.linalg.norm(d) < math.cos(
                math.radians(light.angle) / 2):
            return 0
        for n, c in enumerate(corners):
            hit = on_triangle(p, d, c)
            if n != triangle and hit and 1e-6 < hit[0] < end:
                return 0
        share = 1.0
        for n, points in strands:
            for a, b in itertools.pairwise(points):
                t, s = closest(p, d, a, b)
                if n != strand and 0 <= s < 1 and 0 < t < end and np.linalg.norm(
                        p + t * d - a - s * (b - a)) < radius:
                    share *= fur.alpha
        return share

    def light_on(p):
        l = -light.direction if light.position is None else light.position - p   # noqa: E741
        return l / np.linalg.norm(l)

    picture = np.zeros((height, width, 4))
    for row in range(height):
        for at, (x, y) in enumerate(truth._in_row(row, width, samples, seed)):
            d = axes @ ((k @ (x, y, 1)) * (1, -1, -1))
            best, nearest = np.inf, None
            for n, points in strands:
                for i, (a, b) in enumerate(itertools.pairwise(points)):
                    _, s = closest(eye, d, a, b)
                    if (s < 0 and i == 0) or (s > 1 and i == len(points) - 2):
                        continue
                    end = b if s > 1 else a
                    other = (points[i + 2] if s > 1 else points[i - 1]) - end if not 0 <= s <= 1 else 0 * d
                    s = min(max(s, 0), 1)
                    q = a + s * (b - a)
                    t = (q - eye) @ d / (d @ d)
                    if (eye + t * d - q) @ other > 0:      # the ray passes the other fibre, not only the joint
                        continue
                    if 0 < t < best and np.linalg.norm(eye + t * d - q) < radius:
                        best, nearest = t, ("hair", n, points, i, s)
            for n, c in enumerate(corners):
                hit = on_triangle(eye, d, c)
                if hit and 0 < hit[0] < best:
                    best, nearest = hit[0], ("body", n, hit[1])
            if not nearest:
                continue
            p, v = eye + best * d, -d / np.linalg.norm(d)
            to_light = light_on(p)
            if nearest[0] == "hair":
                _, n, points, i, s = nearest
                chord = [points[min(j + 1, len(points) - 1)] - points[max(j - 1, 0)] for j in (i, i + 1)]
                t0, t1 = (c / np.linalg.norm(c) for c in chord)
                t = t0 + s * (t1 - t0)
                t /= np.linalg.norm(t)
                tl, tv = t @ to_light, t @ v
                shine = max(math.sqrt(1 - tl**2) * math.sqrt(1 - tv**2) - tl * tv, 0) ** fur.exponent
                color = fur.color[0].astype(float)
                rgb = light.color * left(p, n, -1) * (color * math.sqrt(1 - tl**2) + fur.specular * shine)
                rgb = rgb + light.ambient * color
            else:
                _, n, weights = nearest
                normal = weights @ normals[n]
                normal /= np.linalg.norm(normal)
                if normal @ v < 0:
                    normal = -normal
                rgb = scene.body_color * (light.color * max(normal @ to_light, 0) * left(p, -1, n) + light.ambient)
            picture[row, at // samples**2] += np.append(rgb, 1) / samples**2
    return picture


@pytest.mark.parametrize("spot", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_loops_make_the_same_picture(seed, spot):
    rng = np.random.default_rng(seed)
    counts = [4, 2, 3, 5, 4, 3, 6, 2]
    steps = rng.normal(size=(sum(counts), 3)) * .25
    points = np.concatenate([np.cumsum(part, 0) for part in np.split(steps, np.cumsum(counts)[:-1])])
    points += np.repeat(rng.uniform(-.3, .3, (8, 3)), counts, 0)
    fur = clfur.Curves(points=points, counts=counts, width=.06, alpha=.6, specular=.4, exponent=7.0, color=(.7, .5, .4))
    body = clfur.Mesh(rng.uniform(-.8, .8, (9, 3)), faces=np.arange(9).reshape(3, 3))
    light = clfur.Light(direction=rng.normal(size=3), color=(1, .9, .8), ambient=.15)
    if spot:
        place = 2 * rng.normal(size=3)
        light = clfur.Light(direction=-place, position=place, angle=25, color=(1, .9, .8), ambient=.15)
    s = clfur.Scene(mesh=body, fur=fur, light=light, body_color=(.3, .4, .5),
                    camera=clfur.Camera(eye=rng.normal(size=3) + (0, 0, 2.5), fov=35, size=(8, 8)))
    picture = truth.picture(s, 3, seed)
    assert .15 < picture[..., 3].mean() < 1
    np.testing.assert_allclose(picture, loops(s, 3, seed), atol=1e-9)


# --- the scene's own fur, and clfur's picture -------------------------------------------------------------


def furry(sphere, roots=3000, **more):
    types = (clfur.HairType(color=(.8, .5, .3), width=.012, key=(0, 0, 255), segments=6, segment_length=.03,
                            curl=(.01, 1)),
             clfur.HairType(color=(.3, .4, .6), width=.02, key=(255, 0, 0), segments=4, segment_length=.04, alpha=.7,
                            length_variation=.5, color_variation=.3))
    fur = clfur.Strands(inner=2, outer=2, types=types, roots=roots, force=(0, -.3, 0),
                        type_map=np.array([[types[0].key, types[1].key]], np.uint8))
    return clfur.Scene(mesh=sphere, fur=fur, **{"camera": clfur.Camera(eye=(.6, .5, 3), size=(48, 36))} | more)


def test_clfur_draws_nearly_the_same(gpu, sphere):
    """The whole chain: growth, visibility, colour and shadows.  What is left is the kernels' own error."""
    s = furry(sphere)
    expected = truth.picture(s, 8)
    drawn = clfur.render(s, gpu, clfur.Settings(raster="samples", samples=16, grid=96, shadow_map=1024))
    on = expected[..., 3] > 0
    bias = (drawn - expected)[on].mean(0)
    assert np.abs(bias).max() < .015 and np.sqrt(((drawn - expected)[on] ** 2).mean()) < .05
    assert drawn[..., 3].sum() == pytest.approx(expected[..., 3].sum(), rel=.01)
    off = clfur.render(s, gpu, clfur.Settings(raster="samples", samples=16, shadows="off"))
    assert (off - expected)[on][:, :3].mean() > .03                   # so the shadows are there


@pytest.mark.parametrize("roots", [5000, "faces"])
def test_strands_stand_where_the_device_has_them(gpu, sphere, roots):
    """Every one of them: none stands on the next triangle for a last bit."""
    s = furry(sphere, roots)
    hair, _ = geometry_of(s)
    part = Part((0, len(sphere.faces)), (0, len(hair.counts)))
    grown = build.hair(gpu, plan_of(s, clfur.Settings()), part, 0)
    points, spans = gpu.download(grown.points), gpu.download(grown.spans)
    np.testing.assert_array_equal(spans[:, 1], hair.counts)
    for strand in range(len(spans)):
        mine, its = (a[b:b + n] for a, (b, n) in ((hair.points, hair.spans[strand]), (points, spans[strand])))
        np.testing.assert_allclose(mine, its, atol=5e-6)


def test_nothing_but_a_body():
    s = clfur.Scene(mesh=mesh(quad(0, 0, 0)), camera=camera((4, 4)), light=FLAT, body_color=(.2, .3, .4))
    np.testing.assert_allclose(truth.picture(s, 2), np.broadcast_to([.2, .3, .4, 1], (4, 4, 4)), atol=1e-12)


def test_nothing_at_all():
    s = clfur.Scene(fur=clfur.Curves(points=np.zeros((0, 2, 3))), camera=camera((4, 4)))
    assert (truth.picture(s, 2) == 0).all()


# --- rays, noise, cache ---------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [1, 3, 8])
def test_rays_are_spread_over_a_pixel(samples):
    for row in (0, 7):
        at = truth._in_row(row, 5, samples, 3).reshape(5, samples**2, 2)
        at = at - np.stack([np.arange(5), np.full(5, row)], 1)[:, None]
        assert (at >= 0).all() and (at < 1).all()
        squares = np.floor(at * samples).astype(int)
        for pixel in range(5):
            assert len({tuple(s) for s in squares[pixel]}) == samples**2
    assert (truth._in_row(0, 5, samples, 3) != truth._in_row(0, 5, samples, 4)).any()


def test_bands_do_not_matter(sphere, monkeypatch):
    shares, s = [], furry(sphere, 300)
    whole = truth.picture(s, 2, progress=shares.append)
    assert shares[-1] == 1
    monkeypatch.setattr(truth, "RAYS", 48 * 4 * 5)
    shares.clear()
    np.testing.assert_array_equal(truth.picture(s, 2, progress=shares.append), whole)
    assert len(shares) == 8 and shares == sorted(shares) and shares[-1] == 1


def test_noise_is_that_of_the_picture(sphere):
    """What two seeds say of the error at 2 x 2 is the distance to a picture with many more rays."""
    s = furry(sphere, 1000)
    error = truth.picture(s, 2) - truth.picture(s, 16)
    noise = truth.noise_of(s, 2)
    assert math.sqrt((noise**2).mean()) == pytest.approx(math.sqrt((error**2).mean()), rel=.15)


def test_shells_are_refused(sphere):
    s = clfur.Scene(mesh=sphere, fur=clfur.Shells())
    with pytest.raises(clfur.Error, match="strands and bodies only"):
        truth.picture(s)
    with pytest.raises(clfur.Error, match="samples is 0; allowed: a whole number from 1 to 64"):
        truth.picture(furry(sphere), 0)
    with pytest.raises(clfur.Error, match="samples is 8.0; allowed: a whole number from 1 to 64"):
        truth.picture(furry(sphere), 8.0)
    with pytest.raises(clfur.Error, match="scene is 'teapot'; allowed: a clfur.Scene"):
        truth.picture("teapot")


def test_the_cache_keeps_a_picture(sphere, tmp_path, monkeypatch):
    s, calls = furry(sphere, 50), []
    made = truth.picture
    monkeypatch.setattr(truth, "picture", lambda *a, **k: calls.append(a) or made(*a, **k))
    first = truth.cached_picture(s, 2, tmp_path)
    np.testing.assert_array_equal(first, made(s, 2))
    np.testing.assert_array_equal(truth.cached_picture(furry(sphere, 50), 2, tmp_path), first)
    assert len(calls) == 1                                            # an equal scene, made anew
    for other in (furry(sphere, 51), furry(sphere, 50, body_color=(.1, .1, .1)), furry(sphere, 50, light=FLAT),
                  furry(sphere, 50, camera=clfur.Camera(eye=(.6, .5, 3.01), size=(48, 36)))):
        truth.cached_picture(other, 2, tmp_path)
    truth.cached_picture(s, 3, tmp_path)
    assert len(calls) == 6 and len(list(tmp_path.iterdir())) == 6


@pytest.mark.parametrize("light, mean", [
    (clfur.Light(), (0.1178694759635108, 0.08994179729366546, 0.07575768144549934, 0.45109953703703703)),
    (clfur.Light(direction=(-1, -1, -3), position=(1, 1, 3), angle=50, ambient=.1),
     (0.12410454865678301, 0.09473286702906915, 0.0798019178931875, 0.45109953703703703))])
def test_the_version_names_these_pictures(sphere, light, mean):
    """What is kept is kept under `truth.VERSION`: where these numbers have changed for good, it must change too."""
    assert truth.VERSION == 3
    np.testing.assert_allclose(truth.picture(furry(sphere, 500, light=light), 2).mean((0, 1)), mean, rtol=1e-6)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", b"nonsense", "cut", "flipped", "other shape"])
def test_a_damaged_file_is_made_anew(sphere, tmp_path, damage):
    s = furry(sphere, 50)
    first = truth.cached_picture(s, 2, tmp_path)
    file, = tmp_path.iterdir()
    whole = file.read_bytes()
    if damage == "cut":
        file.write_bytes(whole[:len(whole) // 2])
    elif damage == "flipped":
        file.write_bytes(whole[:400] + bytes(255 - b for b in whole[400:440]) + whole[440:])
    elif damage == "other shape":
        with file.open("wb") as stream:
            np.savez_compressed(stream, picture=np.zeros(3))
    else:
        file.write_bytes(damage)
    np.testing.assert_array_equal(truth.cached_picture(s, 2, tmp_path), first)
    with np.load(file) as saved:
        np.testing.assert_array_equal(saved["picture"], first)


def test_the_cache_is_clfurs(sphere, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    truth.cached_picture(furry(sphere, 20), 1)
    assert [f.parent for f in tmp_path.rglob("*.npz")] == [tmp_path / "clfur" / "truth"]


def test_axes_are_right_handed():
    for direction in np.eye(3):
        for sign in (1, -1):
            axes = frame_along(sign * direction)
            np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
            assert np.linalg.det(axes) == pytest.approx(1)
            np.testing.assert_array_equal(axes[2], sign * direction)
