"""Light from hair to hair: the stage against its twin, and its laws: none is made, and white hair keeps almost all."""

import attrs
import numpy as np
import pytest
from support.scenes import strands_of

import clfur
from clfur.pipeline.views import light_of, view_of
from clfur.stages import chiang, sky, transport
from clfur.stages.lighting import unshadowed
from clfur.stages.strands import no_strands
from clfur.stages.tessellate import no_surface, tessellate
from clfur.twin import bounce as bounce_twin
from clfur.twin import sky as sky_twin
from clfur.twin import transport as twin

LOOK = clfur.Chiang(.5, .6)                    # so wide that small tables do
GRID = clfur.Settings(scattering="grid", grid=48)
BOX = clfur.Mesh(np.array([(x, y, z) for z in (-.5, .5) for y in (-.5, .5) for x in (-.5, .5)], float), faces=np.array(
    [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2),
     (1, 3, 7), (1, 7, 5)]))


def tuft(color=(.8, .5, .2), n=40, width=.05, look=LOOK, **scene):
    rng = np.random.default_rng(3)
    a = rng.uniform(-.8, .8, (n, 1, 3))
    d = rng.normal(size=(n, 1, 3)) * .2 + (.1, .5, 0)
    fur = clfur.Curves(a + d * np.linspace(0, 1, 3)[:, None], width=width, alpha=0, color=color, look=look)
    return clfur.Scene(fur=fur, camera=clfur.Camera(eye=(0, .3, 5), target=(0, 0, 0), size=(48, 36)),
                       **{"light": clfur.Light((1, -1, -1), color=(1, 1, 1)), **scene})


def made(gpu, scene, n, body=None, orders=3, outside=.7, color=(0, 0, 0)):
    """(`Sky` struct, `Transport`, sums, `Held`, strands, phases)."""
    packed, strands = sky.sky_of((-1.4, -1.3, -1.2), (1.4, 1.5, 1.3), n), strands_of(gpu, scene)
    looks = chiang.scattering(gpu, scene.strands.hair_types)
    phases = transport.phases(gpu, looks)
    held, there = sky.held(gpu, packed, body is not None, 100), transport.amounts(gpu, packed, 1)
    sky.deposit(gpu, packed, held, no_strands(gpu), body or no_surface(gpu))
    transport.deposit(gpu, packed, there, held.unit, strands, looks)
    lit = transport.transport(gpu, packed, held, there, unshadowed(gpu, *map(light_of, scene.lights)), looks, phases,
                              np.full((24, 3), outside), color, orders)
    return packed, lit, there, held, strands, phases


def host(packed):
    return packed["place"][:3].astype(float), float(packed["place"][3])


def sigma_of(shade):
    return chiang.shades()[shade]


@pytest.mark.small
def test_a_small_grid_is_lit(gpu):
    """Every kernel once: what is scattered adds up to the albedo, and light is no more than what comes in."""
    scene, n = tuft((1, 1, 1), n=1, width=.3), 4
    packed, strands = sky.sky_of((-1.4, -1.3, -1.2), (1.4, 1.5, 1.3), n), strands_of(gpu, scene)
    looks = chiang.Scattering.empty(gpu, {"type": 1, "entry": 3 * 4 * chiang.SHADES})
    lobes = gpu.download(chiang.scattering(gpu, scene.strands.hair_types).lobes)
    lobes["table"] = 0, 3, 4, 0
    looks = chiang.Scattering(gpu.upload(lobes), looks.lobe_table)
    chiang.tabulate(gpu, LOOK, 3, 4, 0, looks.lobe_table)
    phases = transport.phases(gpu, looks, 24)
    table = gpu.download(phases.phases)[:24].reshape(24, 24, 24)
    np.testing.assert_allclose(table[23].sum(0), 1, atol=1e-3)   # four angles
    phases.phases.set(np.concatenate([np.tile(table.reshape(24, -1), (96, 1))]))   # others like the first
    held, there = sky.held(gpu, packed, False, 100), transport.amounts(gpu, packed, 1)
    transport.deposit(gpu, packed, there, held.unit, strands, looks)
    lit = transport.transport(gpu, packed, held, there, unshadowed(gpu, light_of(clfur.Light(color=(0, 0, 0)))), looks,
                              phases, np.ones((24, 3)), orders=2)
    light = gpu.download(lit.light)
    np.testing.assert_allclose(light.max(), 1, rtol=1e-3)
    assert .3 < light.min() < .999
    sent = gpu.download(transport.leaving(gpu, view_of(scene, 1), lit, strands, None, 0, 3))[:, :3]
    assert (sent > .3).all() and (sent <= 1.001).all()
    of_one = gpu.download(transport.leaving(gpu, view_of(scene, 1), lit, strands, gpu.upload(np.uint32([1])), 0, 1))
    np.testing.assert_array_equal(of_one[1:, :3], sent[1:])   # the first is not asked for


def test_light_is_the_twins(gpu):
    """All kernels in turn: cells, phases, all orders of light past a body, and what leaves.  Tables lose a per cent or
    two where lobes are narrow; hair's tangent in a cell is one of 96."""
    scene, n = tuft((1, 1, 1), n=6), 16
    body = tessellate(gpu, BOX, 1, 1, "flat")
    packed, lit, there, held, strands, phases = made(gpu, scene, n, body, 12, color=(.2, .6, .3))
    (low, scale), axes, parts = host(packed), *transport.directions()
    to_light = -np.asarray(scene.lights[0].direction)
    points, spans = gpu.download(strands.points), gpu.download(strands.spans)
    given = gpu.download(there).reshape(n, n, n, 16)[..., :12] / held.unit
    meant = twin.amounts(low, scale, n, points, spans, np.ones(6), np.ones((6, 3)))
    np.testing.assert_allclose(given, meant, atol=20 / held.unit)
    assert meant[..., 6:9].sum(-1).max() > .01

    tangents = gpu.download(phases.tangents)[:, :3].astype(float)
    table = gpu.download(phases.phases).reshape(96, 24, 24, 24)
    for tangent, shade in (7, 23), (60, 11):
        exact = twin.phase(tangents[tangent], axes, parts, sigma_of(shade), LOOK.lobes)
        np.testing.assert_allclose(table[tangent, shade], exact, atol=.01 * exact.max())
    albedo = gpu.download(phases.albedos)[:, 11]
    cosines = chiang.cosines(32)
    np.testing.assert_allclose(albedo[4:], twin.albedo(np.arccos(cosines[4:]), sigma_of(11), LOOK.lobes), atol=4e-3)

    corners = gpu.download(body.positions)[gpu.download(body.triangles)[:, :3].astype(int), :3]
    solid, soft = sky_twin.solid(low, scale, n, corners), twin.softened(given)
    cells, facing = twin.tensors(soft[..., 6:]), bounce_twin.facing(sky_twin.solid(low, scale, n, corners))
    amount = np.trace(cells, axis1=3, axis2=4)
    filled = np.argwhere(amount > 0)
    t = soft[..., :3] / np.maximum(np.linalg.norm(soft[..., :3], axis=-1, keepdims=True), 1e-30)
    nearest = np.argmax(t @ tangents.T, -1)
    values = {each: np.pi * twin.scattering(*(np.broadcast_to(v, parts.reshape(-1, 3).shape) for v in (
        tangents[each], -parts.reshape(-1, 3), to_light)), 0, LOOK.lobes).reshape(24, 8).mean(1)
        for each in np.unique(nearest[tuple(filled.T)])}
    first = np.zeros((24, n, n, n))
    for z, y, x in filled:
        first[:, z, y, x] = values[nearest[z, y, x]]
    orders, glow = [], .6 * np.maximum(facing @ to_light, 0)
    sent, sends, stays = first, glow, twin.kept(cells, axes)
    for number in range(12):
        light = twin.swept(cells, solid, facing, axes, np.full(24, .7), sent, sends)
        if 0 < number < 11:
            share = (sent - first).sum(0) / np.maximum(orders[-1].sum(0), 1e-30)
            light = twin.settled(light, orders[-1], stays * share)
        orders.append(light if number != 10 else twin.continued([*orders[-2:], light]))
        sent = first.copy()
        for z, y, x in filled:
            sent[:, z, y, x] += table[nearest[z, y, x], 23].T @ orders[-1][:, z, y, x]
        sends = glow + .6 * bounce_twin.sent(facing, axes, orders[-1])
    meant = twin.evened(orders[-1], amount)
    light = np.moveaxis(gpu.download(lit.light).reshape(n, n, n, 3, 24)[..., 1, :], -1, 0)
    open_ = solid < .999   # corners are snapped to 1/256 of a cell: elsewhere what is open may be nothing or next to it
    np.testing.assert_allclose(light[:, open_], meant[:, open_], atol=.02)
    assert meant.max() > 1.1 * .7 and np.abs(orders[-1] - orders[0]).max() > .05

    view = view_of(scene, 1)
    given = gpu.download(transport.leaving(gpu, view, lit, strands, None, 0, len(points)))[:, 1]
    p, t = points[:, :3].astype(float), np.concatenate([np.gradient(points[a:a + k, :3].astype(float), axis=0)
                                                        for a, k in spans.astype(int)])
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    v = np.array([0, .3, 5]) - p
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    meant = twin.leaving(low, scale, light.astype(float), axes, p, t, v, 0, LOOK.lobes)
    np.testing.assert_allclose(given, meant, rtol=.01)


def test_a_far_spot_is_a_distant_light(gpu):
    """Of a distant light it is tabulated what hair of each tangent sends; of others each cell tells."""
    away, light = np.array((1, -1, -.5)) / 1.5, []
    for one in clfur.Light(away, color=(1, 1, 1)), clfur.Light(away, position=-500 * away, angle=1, color=(1, 1, 1)):
        light.append(gpu.download(made(gpu, tuft((.8, .5, .2), light=[one, one]), 16)[1].light))
    assert light[0].max() > 1
    np.testing.assert_allclose(light[1], light[0], atol=.005)


def test_parts_of_a_direction_are_all_around():
    axes, parts = transport.directions()
    assert parts.shape == (24, 8, 3)
    np.testing.assert_allclose(np.linalg.norm(parts, axis=2), 1, rtol=1e-12)
    np.testing.assert_allclose(np.einsum("dki,di->dk", parts, axes).mean(1), 1 - 1 / 24, rtol=1e-12)


def test_orders_of_strands_and_parts_give_the_same_bits(gpu):
    scene = tuft()
    turned = attrs.evolve(scene, fur=clfur.Curves(scene.fur.points.reshape(40, 3, 3)[::-1], width=.05, alpha=0,
                                                  color=(.8, .5, .2), look=LOOK))
    light = [gpu.download(made(gpu, each, 16)[1].light) for each in (scene, turned)]
    np.testing.assert_array_equal(*light)


def test_a_white_clump_in_a_white_sky_is_white(gpu):
    """The furnace: hair that takes no light gives back all of it, but for orders that are told from the last ones."""
    scene = tuft((1, 1, 1), n=400, light=clfur.Light(color=(0, 0, 0)), environment=clfur.Environment((1, 1, 1)))
    image = clfur.render(scene, device=gpu, settings=GRID)
    there = image[..., 3] > .5
    sent = image[there, :3] / image[there, 3:]
    assert there.sum() > 200 and sent.max() < 1.003 and sent.min() > .997


def test_white_fur_on_a_white_body_in_a_white_sky_is_white(gpu):
    """The furnace with a body: a black one takes half of the light, a white one all but nothing.  Orders would have to
    go on and on where fur is thick: twelve alone leave .85."""
    mesh, sent = clfur.load_mesh("sphere"), []
    hair = clfur.HairType(segments=4, segment_length=.05, width=.01, direction_variation=.6, alpha=0, color=(1, 1, 1),
                          look=LOOK)
    for body in (1, 1, 1), (0, 0, 0):
        scene = clfur.Scene(mesh, clfur.Strands(types=[hair], roots=20000, inner=1, outer=1, seed=2), clfur.Camera(
            eye=(0, .5, 4), target=(0, 0, 0), size=(48, 36)), clfur.Light(color=(0, 0, 0)), body,
            environment=clfur.Environment((1, 1, 1)))
        image = clfur.render(scene, device=gpu, settings=GRID)
        sent.append(image[image[..., 3] > .9][:, :3])
    assert sent[0].max() < 1.01 and sent[0].mean() > .95 and sent[0].min() > .88
    assert sent[1].mean() < .7


def test_darker_hair_sends_less_and_all_light_is_linear(gpu):
    sums = []
    for color in (1, 1, 1), (.8, .5, .2), (.02, .02, .02):
        sums.append(clfur.render(tuft(color, n=400), device=gpu, settings=GRID)[..., :3].sum((0, 1)))
    assert (sums[0] > sums[1]).all() and (sums[1] > sums[2]).all()
    twice = clfur.render(tuft((.8, .5, .2), n=400, light=clfur.Light((1, -1, -1), color=(2, 2, 2))), device=gpu,
                         settings=GRID)
    np.testing.assert_allclose(twice[..., :3].sum((0, 1)), 2 * sums[1], rtol=1e-3)   # places are packed in 21 bits


def test_light_in_the_shade_comes_from_hair_to_hair(gpu):
    """White hair is brighter with it by far; in one band or many the same; kept while the camera moves."""
    scene = tuft((1, 1, 1), n=400)
    off = clfur.render(attrs.evolve(scene, light=clfur.Light((1, -1, -1), color=(1, 1, 1), ambient=0)), device=gpu,
                       settings=attrs.evolve(GRID, scattering="off"))
    on = clfur.render(scene, device=gpu, settings=GRID)
    kept = gpu._kept["transport"][1]
    assert on[..., :3].sum() > 2 * off[..., :3].sum()
    np.testing.assert_array_equal(on[..., 3], off[..., 3])
    moved = attrs.evolve(scene, camera=clfur.Camera(eye=(1, .3, 5), target=(0, 0, 0), size=(48, 36)))
    clfur.render(moved, device=gpu, settings=GRID)
    assert gpu._kept["transport"][1] is kept
    clfur.render(scene, device=gpu)
    assert "transport" not in gpu._kept or gpu._kept["transport"][1] == {}


@pytest.mark.parametrize("settings", [{"raster": "samples"}, {"max_error": .1}, {"seconds": 1}])
def test_what_scattering_does_not_go_with_is_refused(settings):
    with pytest.raises(clfur.Error, match="Settings.scattering is 'grid'.*allowed"):
        clfur.Settings(scattering="grid", **settings)


def test_other_looks_are_refused(gpu):
    with pytest.raises(clfur.Error, match="scattering is 'grid'.*kajiya-kay.*allowed.*Chiang"):
        clfur.render(tuft(look=clfur.Kajiya()), device=gpu, settings=GRID)
    with pytest.raises(clfur.Error, match="scattering is 'grid'.*allowed"):
        clfur.render(clfur.Scene(mesh=BOX), device=gpu, settings=GRID)
    fur = [clfur.Shells(), clfur.Strands(types=[clfur.HairType(look=clfur.Chiang())])]
    with pytest.raises(clfur.Error, match="scattering is 'grid', but the scene has shells; allowed: 'off'"):
        clfur.render(clfur.Scene(BOX, fur), device=gpu, settings=GRID)
