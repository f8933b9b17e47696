"""The sky's stage against its twin, and laws of its light: all of it where nothing hides it, in any order and parts."""

import attrs
import numpy as np
import pytest

import clfur
from clfur import Environment
from clfur.stages import sky
from clfur.stages.strands import grow, no_strands, upload_curves
from clfur.stages.tessellate import tessellate
from clfur.twin import sky as twin

N = 16
SINE, COSINE = (1, 0, -1 / 8), (1, 2 / 3, 1 / 4)
BOX = clfur.Mesh(np.array([(x, y, z) for z in (-.5, .5) for y in (-.5, .5) for x in (-.5, .5)], float), faces=np.array(
    [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2),
     (1, 3, 7), (1, 7, 5)]))


def grown(gpu, roots=60, width=.03):
    """(`Sky` of N cells a side, strands on a box, its surface) on the device."""
    fur = clfur.Strands(types=[clfur.HairType(segments=3, segment_length=.2, width=width, alpha=.4)], roots=roots)
    body = tessellate(gpu, BOX, 1, 1, "flat")
    return sky.sky_of((-1.17, -1.13, -1.11), (1.13, 1.17, 1.19), N), grow(gpu, body, fur), body


def host(gpu, packed, strands, body):
    """The same as the twin takes it: ((low, scale), moments, solid)."""
    low, scale = packed["place"][:3].astype(float), float(packed["place"][3])
    opaque = 1 - gpu.download(strands.types)["shine"][gpu.download(strands.uv)[:, 2].astype(int), 2].astype(float)
    corners = gpu.download(body.positions)[gpu.download(body.triangles)[:, :3].astype(int), :3]
    return (low, scale), twin.moments(low, scale, N, gpu.download(strands.points), gpu.download(strands.spans),
                                      opaque), twin.solid(low, scale, N, corners)


@pytest.mark.small
def test_cells_hold_what_the_twin_puts_there(gpu):
    """A strand's sum is rounded once in each cell that it comes to: to half of 1/unit."""
    packed, strands, body = grown(gpu)
    held = sky.held(gpu, packed, True, 10)
    sky.deposit(gpu, packed, held, strands, body)
    _, cells, solid = host(gpu, packed, strands, body)
    given = gpu.download(held.moments).reshape(N, N, N, 6) / held.unit
    for j, (a, b) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        np.testing.assert_allclose(given[..., j], cells[..., a, b], atol=100 / held.unit)
    assert cells[..., 0, 0].max() > .01
    gpu.launch("sky.fill", 3 * N * N, n=N, solids=held.solids)
    shares = np.abs(gpu.download(held.solids).reshape(3, N, N, N) / 4096).min(0)
    np.testing.assert_allclose(shares, solid, atol=1.5 / 256)   # corners are snapped to 1/256 of a cell
    assert solid.sum() == pytest.approx(float(packed["place"][3]) ** 3, rel=.1) and solid.max() == 1


@pytest.mark.small
@pytest.mark.parametrize("kernel", [SINE, COSINE])
def test_light_is_the_twin_s(gpu, kernel):
    packed, strands, body = grown(gpu)
    held = sky.held(gpu, packed, True, 10)
    sky.deposit(gpu, packed, held, strands, body)
    (low, scale), cells, solid = host(gpu, packed, strands, body)
    rng = np.random.default_rng(3)
    around = sky.spiral(5)
    table = np.zeros((5, 9, 4), np.float32)
    colors = rng.random((5, 3))
    table[..., :3] = sky.harmonics(around)[:, :, None] * colors[:, None]
    lit = sky.light(gpu, packed, held, around, table)
    shares = twin.through(cells, solid, around)
    assert .05 < shares.mean() < .95 and shares.min() == 0
    points = gpu.download(strands.points)[:, :3]
    if kernel is SINE:
        given = gpu.download(sky.at_points(gpu, lit, strands))[:, :3]
        spans = gpu.download(strands.spans).astype(int)
        axes = np.concatenate([np.gradient(points[a:a + n].astype(float), axis=0) for a, n in spans])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        expected = twin.light(low, scale, shares, around[:, None], colors[:, None], points, axes, kernel)
        np.testing.assert_allclose(given, expected, atol=3e-3)   # solid and points are snapped, see above
    else:
        given = gpu.download(lit.cells).reshape(N, N, N, 9, 4)[..., :3]
        expected = np.einsum("dzyx,djc->zyxjc", shares, table[..., :3])
        np.testing.assert_allclose(given, expected, atol=1e-2)


@pytest.mark.small
@pytest.mark.parametrize("height", [-1.3, -.6])
def test_light_on_a_plane_is_the_twin_s(gpu, height):
    """Under the grid and in it; squares end where the plane is endless, and there all of the light comes."""
    packed, strands, body = grown(gpu)
    held = sky.held(gpu, packed, True, 10)
    sky.deposit(gpu, packed, held, strands, body)
    (low, scale), cells, solid = host(gpu, packed, strands, body)
    towards = sky.spiral(26)[:13] * (1, 1, -1)
    sent = np.random.default_rng(1).random((13, 4)).astype(np.float32)
    plane = sky.plane_of((-1, -1, -1), (1, 1, 1), height, sent[:, :3].sum(0))
    around = sky.spiral(5)   # so that the 13 come in three lots
    lit = sky.light(gpu, packed, held, around, np.zeros((5, 9, 4), np.float32), (plane, towards, sent))
    side = int(plane["size"][0])
    at = (np.arange(side) + .5) / side * 2 - 1
    v, u = (each.ravel() for each in np.meshgrid(at, at, indexing="ij"))
    far = np.sqrt(u * u + v * v)
    inside = far < .999
    assert 0 < inside.sum() < side * side
    wide = 1 / (1 - np.where(inside, far, 0))
    places = np.stack([u * wide, np.full(len(u), height), v * wide], 1)
    expected = twin.on_level(low, scale, twin.through(cells, solid, towards), towards, sent[:, :3], places)
    expected[~inside] = sent[:, :3].sum(0)
    given = gpu.download(lit.squares)[:, :3]
    np.testing.assert_allclose(given, expected, atol=.02)   # of 6: solid and points are snapped, see above
    assert np.abs(given - sent[:, :3].sum(0)).max() > 1.5


@pytest.mark.small
def test_parts_and_orders_give_the_same_bits(gpu):
    rng = np.random.default_rng(5)
    points = rng.uniform(-1, 1, (30, 3, 3))
    packed, nothing = sky.sky_of((-1, -1, -1), (1, 1, 1), N), tessellate(gpu, BOX, 1, 1, "flat")
    sums = []
    for runs in ([np.arange(30)], [np.arange(30)[::-1]], [np.arange(12), np.arange(12, 30)]):
        held = sky.held(gpu, packed, False, 10)
        for run in runs:
            sky.deposit(gpu, packed, held, upload_curves(gpu, clfur.Curves(list(points[run]), width=.02)), nothing)
        sums.append(gpu.download(held.moments))
    assert sums[0].any()
    np.testing.assert_array_equal(sums[0], sums[1])
    np.testing.assert_array_equal(sums[0], sums[2])


def test_a_sky_of_one_that_nothing_hides_is_one(gpu):
    packed = sky.sky_of((-1, -1, -1), (1, 1, 1), N)
    lit = sky.light(gpu, packed, sky.held(gpu, packed, False, 1), *sky.table_of(*Environment().places))
    cells = gpu.download(lit.cells).reshape(-1, 9, 4)[..., :3]
    np.testing.assert_allclose(cells[:, 0] * .28209479, 1, rtol=1e-5)
    np.testing.assert_allclose(cells[:, 1:], 0, atol=2e-3)   # places of the sky are the middles of their squares
    assert len(gpu.download(sky.at_points(gpu, lit, no_strands(gpu)))) == 0


def bald(environment, **light):
    return clfur.Scene(mesh=BOX, environment=environment, body_color=(.5, .5, .5), light=clfur.Light(**light),
                       camera=clfur.Camera(eye=(0, 0, 5), target=(0, 0, 0), size=(16, 16)))


def test_a_frame_s_body_gets_half_of_a_wall_s_sky(gpu):
    """A face of a box sees one half of the world, which is all that its cosine weighs, but for the cells' blur."""
    color = clfur.render(bald(Environment((1, 2, 4)), color=(0, 0, 0)), device=gpu)[8, 8, :3]
    np.testing.assert_allclose(color, color[0] * np.array([1, 2, 4]), rtol=1e-4)
    assert .25 < color[0] < .55


@pytest.mark.parametrize("ambient", [None, .1, .2])
def test_the_flat_ambient_is_left_out_under_a_sky_unless_it_is_given(gpu, ambient):
    """Also where what is given is what lights have without a sky."""
    image = clfur.render(bald(Environment((0, 0, 0)), color=(0, 0, 0), ambient=ambient), device=gpu)
    np.testing.assert_allclose(image[8, 8, :3], .5 * (ambient or 0), rtol=1e-5)
    alone = clfur.render(attrs.evolve(bald(None, color=(0, 0, 0), ambient=ambient)), device=gpu)
    np.testing.assert_allclose(alone[8, 8, :3], .5 * (ambient or .1), rtol=1e-5)


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_twice_the_sky_is_twice_the_light_on_strands(gpu, raster):
    fur = clfur.Strands(types=[clfur.HairType(segments=4, segment_length=.1, width=.02)], roots=300)
    scene = attrs.evolve(bald(Environment((.2, .2, .2)), color=(0, 0, 0)), fur=fur, body_color=None)
    settings = clfur.Settings(raster=raster)
    one = clfur.render(scene, device=gpu, settings=settings)
    two = clfur.render(attrs.evolve(scene, environment=Environment((.2, .2, .2), intensity=2)), device=gpu,
                       settings=settings)
    assert one[..., :3].max() > .01
    np.testing.assert_allclose(two[..., :3], 2 * one[..., :3], rtol=2e-3, atol=1e-5)   # packed in 21 bits a colour


@pytest.mark.parametrize("bad", [(1, 2), (-1, 0, 0), np.full((4, 8, 3), np.nan), "sky", np.zeros((2, 3))])
def test_what_is_no_sky_is_refused(bad):
    with pytest.raises(clfur.Error, match="Environment.sky is .*allowed"):
        Environment(bad)


def test_a_picture_is_looked_up_where_it_says():
    """Its middle looks along -Z, its top is up; a quarter turned to the right, the middle is at +X."""
    picture = np.zeros((8, 16, 3), np.float32)
    picture[4, 8] = 1
    for turned, axis in ((0, (0, 0, -1)), (90, (1, 0, 0))):
        towards, light, angles = Environment(picture, rotation=turned).places
        middle = (light[:, :1] * angles[:, None] * towards).sum(0)
        assert middle @ axis > .9 * np.linalg.norm(middle)
    assert angles.sum() == pytest.approx(4 * np.pi)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 4), (3, 3), (4, 2), (33, 65), (64, 128), (63, 1)])
def test_a_plane_has_the_light_of_a_picture_of_few_pixels(shape):
    """A row from height a to b, of n pixels, sends pi (sin(b)^2 - sin(a)^2) / n of each to a level plane: exact."""
    picture = np.random.default_rng(5).uniform(0, 2, (*shape, 3))
    towards, light, angles = Environment(picture).places
    edges = np.maximum(np.sin(np.pi * (.5 - np.arange(shape[0] + 1) / shape[0])), 0)
    meant = np.pi * ((edges[:-1]**2 - edges[1:]**2) @ picture.mean(1, dtype=float))
    found = (np.maximum(towards[:, 1:2], 0) * light * angles[:, None]).sum(0)
    np.testing.assert_allclose(found, meant, rtol=1e-6)   # colours are float32
    wall = (np.maximum(Environment(np.ones((*shape, 3))).places[0][:, 0], 0) * angles).sum()
    assert wall == pytest.approx(np.pi, rel=2e-3)   # places have one direction each
