"""Shell fur in whole frames: the same bits however it is cut up, kept where nothing changed, in front and behind."""

import attrs
import numpy as np
import pytest
from support.plans import plan_of
from support.scenes import icosphere

import clfur
from clfur.render import OUTPUTS

SETTINGS = clfur.Settings(raster="samples", samples=4, grid=32, shadow_map=64)
ONE = clfur.Settings(raster="samples", samples=1, shadows="off")
FUR = clfur.Shells(length=.2, frequency=12, layers=12, force=(0, -.8, 0))


def scene_of(mesh, fur=FUR, body=(.3, .2, .1), size=(61, 47), eye=(0, .4, 3.2), **options):
    return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=eye, size=size), body_color=body, **options)


def hairs(**options):
    hair = clfur.HairType(segments=8, segment_length=.03, curl=(.01, 1), width=.004, direction_variation=.3)
    return clfur.Strands(types=[hair], seed=3, **{"inner": 2, "outer": 2} | options)


def square(uv=False, height=0.0):
    """Two faces across the y axis, 2 by 2, that look up."""
    corners = np.array([[-1, height, -1], [-1, height, 1], [1, height, 1], [1, height, -1]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return clfur.Mesh(corners, None, (corners[:, [0, 2]] * (.5, -.5) + .5)[faces] if uv else None, faces)


def from_above(mesh, fur, **options):
    """A camera 3 above the middle; pixels are 0.05 of the skin wide."""
    camera = clfur.Camera(eye=(0, 3, 0), target=(0, 0, 0), up=(0, 0, -1), size=(61, 61),
                          fov=2 * np.degrees(np.arctan(61 * .025 / 3)))
    return clfur.Scene(mesh=mesh, fur=fur, camera=camera, **options)


def same(one, other):
    assert one.hashes == other.hashes
    for name in one.images:
        np.testing.assert_array_equal(one.images[name], other.images[name], err_msg=name)


@pytest.fixture(scope="module")
def ball():
    return clfur.Mesh(*icosphere(1)[:1], faces=icosphere(1)[1])   # 80 faces


@pytest.mark.small
def test_a_frame(gpu, monkeypatch):
    """Every kernel of shell fur, in a picture that is small enough for Oclgrind."""
    monkeypatch.setattr("clfur.stages.shells.AROUND", 4)
    gpu = clfur.Scheduler(gpu.device)
    gpu.lanes = 1   # Oclgrind 21.10 takes parts of a vector for unset that are not
    fur = clfur.Shells(length=.5, frequency=3, layers=4, wind=(.3, 0, 0))
    scene = clfur.Scene(mesh=square(True), fur=fur, camera=clfur.Camera(eye=(0, 2, 1.5), size=(12, 9)))
    frame = clfur.draw(scene, gpu, clfur.Settings(raster="samples", samples=1, grid=16, shadow_map=16), tuple(OUTPUTS))
    assert set(np.unique(frame.images["id"])) >= {-3, -1}


@pytest.mark.parametrize("fur", ["shells", "both"])
@pytest.mark.parametrize("body", [(.3, .2, .1), None], ids=["body", "bare"])
def test_parts_and_bands_are_the_same_bits(gpu, another, ball, fur, body):
    scene = scene_of(ball, FUR if fur == "shells" else [FUR, hairs(inner=6, outer=6)], body)
    whole = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    assert (whole.images["id"] == -3).mean() > .1 and whole.images["color"].std() > .05
    memory = 1_000_000 if fur == "both" else 700_000
    small = another(memory)
    plan = plan_of(scene, SETTINGS)
    assert plan.rows(small) < 47 and (len(plan.parts(small)) > 1 or fur == "shells")
    frame = clfur.draw(scene, small, SETTINGS, tuple(OUTPUTS), hashes=True)
    same(whole, frame)
    assert 0 < frame.memory <= memory


def test_teams_are_the_same_bits(gpu, another, ball):
    scene = scene_of(ball, [FUR, hairs(inner=4, outer=4)])
    alone = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    team = [another(), another()]
    for _ in range(2):
        same(alone, clfur.draw(scene, team, SETTINGS, tuple(OUTPUTS), hashes=True))


@pytest.mark.parametrize("change, built", [
    ({}, set()),
    ({"color": (1, 0, 0), "specular": 1, "shading": "turned", "root_shade": .9}, set()),
    ({"wind": (0, .5, .5)}, {"bend"}),
    ({"time": .25}, {"bend"}),
    ({"acceleration": (0, 1, 0)}, {"bend"}),
    ({"density": .5}, {"bend", "lattice", "means", "noise"}),
    ({"length": .25}, {"bend", "lattice", "means", "noise"}),
    ({"frequency": 9}, {"bend", "lattice", "means", "noise"}),
    ({"seed": 9}, {"bend", "lattice", "means", "noise"}),
], ids=lambda value: "-".join(sorted(value)))
def test_what_has_not_changed_is_kept(gpu, ball, monkeypatch, change, built):
    """A moved camera and new light on the fur build nothing; new wind bends what is there. The picture is the same."""
    fur, launched, launch = attrs.evolve(FUR, wind=(.5, 0, 0)), [], gpu.launch

    def told(name, size, /, **arguments):
        launched.append(name)
        return launch(name, size, **arguments)
    clfur.render(scene_of(ball, fur), gpu, ONE)
    monkeypatch.setattr(gpu, "launch", told)
    later = scene_of(ball, attrs.evolve(fur, **change), eye=(1, .4, 3))
    color = clfur.render(later, gpu, ONE)
    assert "march.march" in launched
    assert {name.split(".")[1] for name in launched if name.startswith("shells.")} == built
    gpu.forget()
    np.testing.assert_array_equal(color, clfur.render(later, gpu, ONE))


def test_filter_is_no_reason_to_build(gpu, ball):
    scene = scene_of(ball, attrs.evolve(FUR, frequency=60))
    filtered = clfur.render(scene, gpu, ONE)
    rough = clfur.render(scene, gpu, attrs.evolve(ONE, filtered=False))
    assert np.abs(filtered - rough).max() > .1
    gpu.forget()
    np.testing.assert_array_equal(rough, clfur.render(scene, gpu, attrs.evolve(ONE, filtered=False)))


@pytest.mark.parametrize("samples", [1, 4])
def test_outputs_of_fur_on_a_square(gpu, samples):
    """Seen from above, hairs that lean by 1 to x: depth lies in the fur, tangents lean, uv is that of the root."""
    fur = clfur.Shells(length=.5, frequency=8, noise=(0, 8), force=(1, 0, 0))
    settings = clfur.Settings(raster="samples", samples=samples, shadows="off")
    images = clfur.render(from_above(square(True), fur), gpu, settings, tuple(OUTPUTS))
    of_fur = images["id"] == -3
    assert of_fur.mean() > .3 and set(np.unique(images["id"])) <= {-3, -2, -1}
    np.testing.assert_allclose(images["coverage"], images["color"][..., 3], atol=1 / 250)

    y, x = np.nonzero(of_fur)
    height = 3 - images["depth"][of_fur]
    assert (height > 0).all() and (height < .5).all() and height.std() > .02
    # The way of a hair: four steps of an eighth, each along n + h · force at its middle.
    steps = np.array([(h, 1, 0) for h in (.125, .375, .625, .875)])
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    ends = np.concatenate([[[0, 0, 0]], np.cumsum(steps * .125, 0)])
    assert height.max() <= ends[-1, 1] + 1e-6
    slab = np.clip(np.searchsorted(ends[:, 1], height) - 1, 0, 3)
    clear = np.abs(height[:, None] - ends[1:4, 1]).min(1) > 1e-4
    np.testing.assert_allclose(images["tangent"][of_fur][clear], steps[slab][clear], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(images["normal"][of_fur], axis=1), 1, atol=1e-5)
    np.testing.assert_allclose((images["normal"] * images["tangent"])[of_fur].sum(1), 0, atol=1e-5)
    if samples == 1:   # the sample is the pixel's middle
        place = np.stack([x - 30, y - 30], 1) * .05 * (images["depth"][of_fur] / 3)[:, None]
        lean = ends[slab] + steps[slab] * ((height - ends[slab, 1]) / steps[slab, 1])[:, None]
        root = np.stack([place[:, 0] - lean[:, 0], -place[:, 1]], 1)
        np.testing.assert_allclose(images["uv"][of_fur], root * .5 + .5, atol=2e-4)
    np.testing.assert_array_equal(images["tangent"][images["id"] == -1], 0)


def test_uv_of_a_mesh_without_is_zero(gpu):
    images = clfur.render(from_above(square(), FUR), gpu, ONE, ("id", "uv"))
    assert (images["id"] == -3).any()
    np.testing.assert_array_equal(images["uv"], 0)


def test_a_strand_before_within_and_behind_the_fur(gpu):
    """Seen from above: what stands before the fur hides it, what is behind is hidden as much as the skin is."""
    fur = clfur.Shells(length=.5, frequency=8, color=(0, 1, 0), specular=0)
    white = {"width": .3, "color": (1, 1, 1)}
    plain = clfur.render(from_above(square(), fur, body_color=(0, 0, 0)), gpu, ONE)
    through = 1 - clfur.render(from_above(square(), fur, body_color=None), gpu, ONE)[..., 3]
    middle = (slice(28, 33), slice(15, 46))
    seen = {}
    for height in (.8, .25, .001, -.3):
        line = clfur.Curves([[(-.8, height, 0), (.8, height, 0)]], **white)
        scene = from_above(square(), [fur, line], body_color=(0, 0, 0))
        image, ids = clfur.render(scene, gpu, ONE, ("color", "id")).values()
        alone = clfur.render(from_above(square(height=-.5), line, body_color=(0, 0, 0)), gpu, ONE)
        seen[height] = image[middle][..., 0].mean() / alone[middle][..., 0].mean()
        np.testing.assert_allclose(image[..., 3][middle], 1, atol=1 / 250)
        if height == .8:
            np.testing.assert_array_equal(image[middle], alone[middle])
            assert (ids[middle] == 0).all()
        if height == .25:
            assert {-3, 0} <= set(np.unique(ids[middle]))
        if height == -.3:   # the near plane is another: depths are rounded elsewhere
            assert (np.abs(image - plain).max(2) > 1e-3).mean() < .01
    assert seen[.8] == 1 > seen[.25] > seen[.001] + .1 and seen[-.3] == 0
    assert seen[.001] == pytest.approx(through[middle].mean(), abs=.03)


def test_strands_that_fur_stands_behind_are_lit_as_ever(gpu, ball):
    """With fur too thin to see, the picture is that of strands alone, within rounding."""
    thin = clfur.Shells(length=1e-4, frequency=3, density=1e-6)
    strands = hairs()
    one = clfur.render(scene_of(ball, [thin, strands]), gpu, ONE)
    other = clfur.render(scene_of(ball, strands), gpu, ONE)
    assert (np.abs(one - other).max(2) > 1e-3).mean() < .02   # the camera's near plane differs a little


def test_shells_without_a_body_let_the_light_through(gpu, ball):
    fur = attrs.evolve(FUR, density=.5, force=(0, 0, 0))
    bare, ids, depth = clfur.render(scene_of(ball, fur, None), gpu, ONE, ("color", "id", "depth")).values()
    skinned = clfur.render(scene_of(ball, fur), gpu, ONE)
    assert -2 not in ids and -3 in ids
    disc = skinned[..., 3] > .99
    assert disc.sum() > 200 and .1 < bare[disc][:, 3].mean() < .98
    # Rays through the gaps of the fur before see that behind, from within.
    assert (depth[ids == -3] > 3.4).any() and (depth[ids == -3] < 2.6).any()
    assert np.isfinite(bare).all() and (bare >= 0).all() and bare[..., 3].max() <= 1 + 1e-6


@pytest.mark.parametrize("every", [1, 3])
def test_faces_wound_against_their_normals_have_fur(gpu, every):
    """Hair grows along the normals, and rays come in where it ends, whichever way a file winds its faces."""
    positions, faces = icosphere(1)
    turned = faces.copy()
    turned[::every] = turned[::every, ::-1]
    one, other = (clfur.render(scene_of(clfur.Mesh(positions, positions, faces=f)), gpu, ONE) for f in (faces, turned))
    # Shading of the skin and where neighbours divide their side don't hang on it.
    assert (np.abs(one - other).max(2) > 1e-3).mean() < .05


def test_stages_and_blur(gpu, ball):
    frame = clfur.draw(scene_of(ball), gpu, attrs.evolve(ONE, blur="edges"), ("color", "id"))
    assert {"entries", "march", "blur", "shade"} <= set(frame.stages)
    sharp = clfur.render(scene_of(ball), gpu, ONE)
    untouched = (frame.images["color"] == sharp).all(2)
    y, x = np.mgrid[:47, :61]
    assert untouched[np.hypot(y - 23, x - 30) < 10].all() and not untouched.all()


def test_fur_that_does_not_fit_is_an_error(another, sphere):
    small = another(200_000)
    said = r"has no room for .*shells of 0\.\d MiB, and a row of 61 pixels; allowed: smaller ones"
    with pytest.raises(clfur.Error, match=said):
        clfur.render(scene_of(sphere), small, clfur.Settings(raster="samples", samples=1, shadow_map=0, shadows="off"))


@pytest.mark.parametrize("other_mesh", [True, False])
def test_shells_of_an_earlier_scene_take_no_room(another, sphere, other_mesh):
    """What is kept of one scene goes before the next is made, whatever that has."""
    small = another(3_000_000)
    finer = clfur.Mesh(*icosphere(4)[:1], None, None, icosphere(4)[1]) if other_mesh else sphere
    fur = clfur.Shells(length=.1, frequency=9, layers=5, wind=(.5, 0, 0))
    camera = clfur.Camera(size=(64, 48))
    clfur.draw(clfur.Scene(finer, fur, camera), small, clfur.Settings(grid=16, shadow_map=64))
    after = clfur.Scene(sphere, clfur.Strands(roots=9000), camera)
    frame = clfur.draw(after, small, clfur.Settings(grid=16, shadow_map=64))
    assert frame.memory <= 3_000_000 and "shell" not in [name for name, (key, _) in small._kept.items() if key]


@pytest.mark.parametrize("samples", [4, 16])
def test_rays_that_come_in_again_stay_within_the_memory(another, sphere, samples):
    """Where they enter is made anew for each time, and counted once."""
    small = another(8_000_000)
    scene = clfur.Scene(sphere, clfur.Shells(layers=6, frequency=12), clfur.Camera(eye=(0, 1, 3), size=(320, 240)))
    frame = clfur.draw(scene, small, clfur.Settings(grid=32, shadow_map=64, samples=samples))
    assert 4_000_000 < frame.memory <= 8_000_000
