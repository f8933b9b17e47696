"""The body's part in light from hair to hair: the stage against its twin, and what it does to pictures."""

import attrs
import numpy as np
import pytest

import clfur
from clfur.pipeline.views import light_of
from clfur.stages import bounce, sky, transport
from clfur.stages.lighting import unshadowed
from clfur.stages.strands import no_strands
from clfur.stages.tessellate import tessellate
from clfur.twin import bounce as twin

BOX = clfur.Mesh(np.array([(x, y, z) for z in (-.5, .5) for y in (-.5, .5) for x in (-.5, .5)], float), faces=np.array(
    [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2),
     (1, 3, 7), (1, 7, 5)]))
GRID = clfur.Settings(scattering="grid", grid=48)


@pytest.mark.small
def test_what_a_body_sends_is_the_twins(gpu):
    """Where it faces, what it sends of a light and of light in cells, and that light as harmonics."""
    n, light, rng = 8, clfur.Light((-1, -2, -.5), color=(1, 2, 3)), np.random.default_rng(1)
    packed = sky.sky_of((-1, -1.1, -.9), (1, 1, 1.2), n)
    held = sky.held(gpu, packed, True, 0)
    sky.deposit(gpu, packed, held, no_strands(gpu), tessellate(gpu, BOX, 1, 1, "flat"))
    contents = sky.contents(gpu, packed, held)
    solid = gpu.download(contents)[6].reshape(n, n, n).astype(float)
    assert solid.max() == 1 and solid.min() == 0
    made = bounce.faces(gpu, packed, contents, (.5, .2, .1), unshadowed(gpu, light_of(light)))
    faces = gpu.download(made).reshape(n, n, n, 3, 4)
    facing = twin.facing(solid)
    np.testing.assert_allclose(faces[..., 0, :3], facing, atol=1e-4)
    np.testing.assert_array_equal(faces[..., 0, 3], solid.astype(np.float32))
    cosine = np.maximum(facing @ -np.asarray(light.direction), 0)
    np.testing.assert_allclose(faces[..., 2, :3], cosine[..., None] * (.5, .4, .3), atol=1e-4)

    axes, cells = transport.directions()[0], rng.uniform(0, 1, (n**3, 3, 24)).astype(np.float32)
    there = gpu.upload(cells.reshape(n**3, 72))
    bounce.glow(gpu, (.5, .2, .1), gpu.upload(np.float32(axes.T)), there, made)
    sent = gpu.download(made).reshape(n, n, n, 3, 4)[..., 1, :3]
    for channel, color in enumerate((.5, .2, .1)):
        falls = twin.sent(facing, axes, np.moveaxis(cells[:, channel].reshape(n, n, n, 24), -1, 0))
        np.testing.assert_allclose(sent[..., channel], faces[..., 2, channel] + color * falls, atol=1e-4)

    around = gpu.download(bounce.light_around(gpu, packed, axes, there).cells).reshape(n**3, 9, 4)[..., :3]
    basis = sky.harmonics(axes)
    left = np.einsum("dj,cjk->cdk", basis, around) - np.moveaxis(cells, 1, 2)
    np.testing.assert_allclose(np.einsum("dj,cdk->cjk", basis, left), 0, atol=1e-4)   # nothing nearer to it


def furry(**scene):
    hair = clfur.HairType(segments=4, segment_length=.06, width=.01, direction_variation=.4, alpha=0,
                          color=(.9, .9, .9), look=clfur.Chiang(.5, .6))
    given = {"fur": clfur.Strands(types=[hair], roots=1500, inner=1, outer=1, seed=2), "body_color": (.8, .1, .1),
             "camera": clfur.Camera(eye=(0, .5, 4), target=(0, 0, 0), size=(64, 48)),
             "light": clfur.Light((-1, -1, -1), color=(1, 1, 1), ambient=0)}
    return clfur.Scene(clfur.load_mesh("sphere"), **{**given, **scene})


def test_hair_takes_on_the_body_s_colour_and_lights_the_body(gpu):
    """On a red body hair is redder than on a black one; a body is lit by hair too; a holdout sends nothing."""
    red = clfur.render(furry(), device=gpu, settings=GRID)
    kept = gpu._kept["transport"][1]
    black = clfur.render(furry(body_color=(0, 0, 0)), device=gpu, settings=GRID)
    assert gpu._kept["transport"][1] is not kept          # another colour, other light
    ids = clfur.draw(furry(), gpu, GRID, ("id",)).images["id"]
    hair, body = ids >= 0, ids == -2
    of_body = red[hair][:, :3].sum(0) - black[hair][:, :3].sum(0)
    assert of_body[0] > .05 * black[hair][:, 0].sum() and of_body[0] > 3 * of_body[1]
    off = clfur.render(furry(), device=gpu, settings=attrs.evolve(GRID, scattering="off"))
    assert (red[body][:, 0] - off[body][:, 0]).mean() > .01
    out = clfur.render(furry(body="holdout"), device=gpu, settings=GRID)
    np.testing.assert_allclose(out[hair][:, :3].mean(0), black[hair][:, :3].mean(0), rtol=.2)


def test_a_painted_body_sends_the_mean_of_its_paint(gpu):
    """Two materials of half of the faces each: the light of cells is that of their mean."""
    mesh = clfur.load_mesh("sphere")
    of = np.zeros(len(mesh.faces), int)
    corners = mesh.positions[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    of[np.cumsum(areas) > areas.sum() / 2] = 1
    share = areas[of == 1].sum() / areas.sum()
    painted = attrs.evolve(mesh, material_of=of)
    two = (clfur.Material((1, .5, .25)), clfur.Material((.2, .4, .6)))
    clfur.render(attrs.evolve(furry(), mesh=painted, body_color=two), device=gpu, settings=GRID)
    light = gpu.download(gpu._kept["transport"][1].light)
    mean = (1 - share) * np.array((1, .5, .25)) + share * np.array((.2, .4, .6))
    clfur.render(attrs.evolve(furry(), body_color=mean), device=gpu, settings=GRID)
    np.testing.assert_allclose(gpu.download(gpu._kept["transport"][1].light), light, rtol=1e-4, atol=1e-5)
