"""Base colours of the body, by materials and pictures laid on by uv."""

import attrs
import imageio.v3 as imageio
import numpy as np
import pytest
from support.command import wrong
from support.scenes import icosphere
from support.stages import on_host

import clfur
from clfur import layout, truth
from clfur.pipeline.views import light_of, view_of
from clfur.scene import material
from clfur.stages import shade
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import raster
from clfur.stages.strands import no_strands
from clfur.stages.tessellate import tessellate
from clfur.twin import shade as twin

FLAT = clfur.Light(color=(0, 0, 0), ambient=1)   # all is as bright as its colour
CAMERA = clfur.Camera(eye=(1.5, 1, 3), size=(41, 31))
WRAPS = [("repeat", "repeat"), ("mirror", "clamp"), ("clamp", "mirror")]


def noise(*shape, seed=0, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, (*shape, 3), dtype)


def checker(height, width):
    return np.broadcast_to(np.indices((height, width)).sum(0)[..., None] % 2 * 1.0, (height, width, 3))


def square(uv, n=1):
    """A square from -1 to 1 across the view, its uv from 0 to this at the upper right."""
    line = np.linspace(0, 1, n + 1)
    x, y = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([a, a + n + 1, a + n + 2], 1), np.stack([a, a + n + 2, a + 1], 1)])
    return clfur.Mesh(np.stack([2 * x - 1, 2 * y - 1, 0 * x], 1), uv=np.stack([x, y], 1) * uv, faces=faces)


def straight(pixels, **more):
    """Looks at the square from so far that it is seen without perspective, and fills the picture."""
    k = [[pixels * 500, 0, pixels / 2], [0, pixels * 500, pixels / 2], [0, 0, 1]]
    pose = np.eye(4)
    pose[2, 3] = 1000
    return clfur.Camera.calibrated(pose, k, (pixels, pixels))


def test_the_names_are_the_layouts():
    assert material.WRAPS == layout.WRAPS


# --- the twin's values ----------------------------------------------------------------------------------


@pytest.mark.parametrize("wrap, samples, scale", [
    pytest.param(WRAPS[1], 1, 2.5, marks=pytest.mark.small),   # one: a checker of races takes long
    *((wrap, samples, scale) for wrap in WRAPS for samples, scale in ((1, .3), (4, 2.5), (4, -30), (1, -30)))])
def test_the_twins(gpu, wrap, samples, scale):
    """A texel's number is rounded to 1/131070 of the largest; a place that is wrong by 1e-6 in uv is so by as much
    times the picture's texels, and its step by as much of itself."""
    positions, faces = icosphere(1)
    uv = scale * np.random.default_rng(3).random((len(faces), 3, 2)) + .2
    mesh = clfur.Mesh(positions, positions, uv, faces, material_of=np.arange(len(faces)) % 3)
    painted = (clfur.Material((.5, .7, 1), noise(13, 32), wrap), clfur.Material((.1, .2, .3)),
               clfur.Material(texture=noise(1, 5, seed=1).astype(np.float32) / 40, wrap=wrap[::-1]))
    there = clfur.Scene(mesh, None, attrs.evolve(CAMERA, size=(23, 17)), FLAT, painted)
    view, body = view_of(there, samples), tessellate(gpu, mesh)
    visible = raster(gpu, view, None, body)
    image = shade.color(gpu, view, unshadowed(gpu, light_of(FLAT)), visible, no_strands(gpu), body, (0, 0, 0),
                        paint=shade.paint_of(gpu, painted), material_of=gpu.upload(mesh.material_of)).get()
    strands = on_host(no_strands(gpu))
    strands.types, strands.colors = np.zeros(1, layout.HairType), np.zeros((1, 4))
    meant = twin.color(view, [light_of(FLAT)], visible.get(), strands, on_host(body), None, (painted, mesh.material_of))
    off = np.abs(image - meant).max(2)
    assert image[..., :3].std() > .1 and off.max() < 5e-3 and np.quantile(off, .9) < 2e-4


# --- laws -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrap", WRAPS)
def test_each_texel_is_where_uv_has_it(gpu, wrap):
    """One pixel a texel, one sample in its middle: the picture itself, its top row up, and what is outside as wrap has
    it."""
    picture = noise(8, 8)
    there = clfur.Scene(square(2), None, straight(16), FLAT, clfur.Material(texture=picture, wrap=wrap))
    image = clfur.render(there, gpu, clfur.Settings(samples=1))
    linear = clfur.color.srgb_to_linear(picture)
    modes = {"repeat": "wrap", "mirror": "symmetric", "clamp": "edge"}
    meant = np.pad(linear, ((8, 0), (0, 0), (0, 0)), mode=modes[wrap[1]])   # v runs up
    meant = np.pad(meant, ((0, 0), (0, 8), (0, 0)), mode=modes[wrap[0]])
    np.testing.assert_allclose(image[..., :3], meant, atol=2e-4)


@pytest.mark.parametrize("texels, repeats", [((64, 64), 1), ((63, 61), 1), ((64, 64), 7.3), ((512, 2), 3)])
@pytest.mark.parametrize("turn", [0, 70])
def test_a_checker_seen_small_is_its_mean(gpu, texels, repeats, turn):
    """Many texels a pixel, seen from the front and aslant: no pixel differs from the mean by .01."""
    flat = square(repeats, n=3)
    angle = np.radians(turn)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = flat.positions @ np.array([(1, 0, 0), (0, cos, sin), (0, -sin, cos)])
    mesh = clfur.Mesh(turned, uv=flat.uv, faces=flat.faces)
    image = clfur.render(clfur.Scene(mesh, None, straight(16), FLAT, checker(*texels)), gpu)
    inside = image[image[..., 3] == 1][:, :3]
    mean = checker(*texels).mean() if repeats == 1 else .5
    assert len(inside) >= 16 * 3 and np.abs(inside - mean).max() < .01


@pytest.mark.parametrize("name", ["ball", "slope"])
def test_truth(gpu, sphere, name):
    """Boxes over pixels of the picture as it is: what is looked up is a little softer."""
    picture = noise(12, 24)
    aslant = clfur.Camera(eye=(0, -2.5, .8), size=(41, 31))
    mesh, camera = (sphere, CAMERA) if name == "ball" else (square(3, 2), aslant)
    there = clfur.Scene(mesh, None, camera, clfur.Light((0, 0, -1), ambient=.5), picture)
    one, other = clfur.render(there, gpu, clfur.Settings(samples=16)), truth.picture(there, 8)
    full = other[..., 3] == 1
    assert np.sqrt(((one - other)[full] ** 2).mean()) < .03 < .5 * other[full].std()
    np.testing.assert_allclose(one.mean((0, 1)), other.mean((0, 1)), atol=2e-3)


def test_a_colour_is_a_plain_material_and_multiplies(gpu, sphere):
    """The same bits with and without a class around it; of a white picture all but rounding."""
    there = clfur.Scene(sphere, None, CAMERA, body_color=(.5, .4, .3))
    plain = clfur.render(there, gpu)
    named = attrs.evolve(there, body_color=clfur.Material((.5, .4, .3)))
    np.testing.assert_array_equal(plain, clfur.render(named, gpu))
    white = clfur.Material((.5, .4, .3), np.full((5, 3, 3), 255, np.uint8))
    np.testing.assert_allclose(clfur.render(attrs.evolve(there, body_color=white), gpu), plain, atol=1e-6)


def test_parts_are_the_same_bits(gpu, another, sphere):
    mesh = clfur.Mesh(sphere.positions, sphere.normals, sphere.uv, sphere.faces, material_of=np.arange(320) // 160)
    fur = clfur.Strands(inner=4, outer=4, types=clfur.HairType(segment_length=.01))
    painted = [clfur.Material(texture=noise(32, 64)), clfur.Material((0, 1, 0))]
    there = clfur.Scene(mesh, fur, CAMERA, body_color=painted)
    settings = clfur.Settings(grid=16, shadow_map=32)
    whole, small = clfur.render(there, gpu, settings), another(1_000_000)
    assert whole[..., 1].max() > .3
    np.testing.assert_array_equal(whole, clfur.render(there, small, settings))


def test_faces_that_rest_has_keep_their_material():
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.)])
    faces, materials = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], [5, 6, 7, 8]
    rest = clfur.Mesh(positions, faces=faces)
    mesh = clfur.Mesh(positions * (1, 1, 0), faces=faces, material_of=materials)
    there = clfur.Scene(mesh, clfur.Strands(roots=9, rest=rest))
    assert len(mesh.faces) < 4 and there.mesh.material_of.tolist() == materials


# --- errors ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fields, words", [
    ({"wrap": "tile"}, r"Material.wrap is 'tile'; allowed: two of 'repeat', 'mirror', 'clamp'"),
    ({"wrap": ("repeat",)}, "Material.wrap"), ({"color": (1, 2)}, "Material.color"),
    ({"texture": np.zeros((3, 3))}, "Material.texture"), ({"texture": np.zeros((3, 3, 3), int)}, "Material.texture"),
    ({"texture": np.full((3, 3, 3), np.nan)}, "Material.texture")])
def test_what_is_no_material_is_refused(fields, words):
    with pytest.raises(clfur.Error, match=words):
        clfur.Material(**fields)


def test_what_does_not_fit_the_mesh_is_refused(sphere):
    bare, two = clfur.Mesh(sphere.positions, faces=sphere.faces), [clfur.Material(), clfur.Material()]
    with pytest.raises(clfur.Error, match="body_color has a texture, .* Scene.mesh has none; allowed: a mesh with uv"):
        clfur.Scene(bare, body_color=noise(3, 3))
    with pytest.raises(clfur.Error, match="has 2 materials but Scene.mesh has no material_of"):
        clfur.Scene(bare, body_color=two)
    with pytest.raises(clfur.Error, match="has 2 materials but Scene.mesh has material_of up to 2"):
        clfur.Scene(clfur.Mesh(sphere.positions, faces=sphere.faces, material_of=np.full(320, 2)), body_color=two)
    with pytest.raises(clfur.Error, match="Mesh.material_of"):
        clfur.Mesh(sphere.positions, faces=sphere.faces, material_of=[0, 1])


def test_command(clfur):
    imageio.imwrite("red.png", np.broadcast_to(np.array((255, 0, 0), np.uint8), (4, 4, 3)))
    common = "render", "sphere", "--size", "32x24", "--roots", 0, "-o", "a.png", "--body-texture"
    assert clfur(*common, "red.png")[0] == 0
    image = imageio.imread("a.png")
    assert image[12, 16, 0] > 50 and not image[..., 1:3].any()
    wrong(clfur(*common, "no.png"), "no.png: no such file")
    with open("bare.obj", "w", encoding="ascii") as file:
        file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    wrong(clfur("render", "bare.obj", "--body-texture", "red.png"), "body_color has a texture", "a mesh with uv")
    wrong(clfur("render", "sphere", "-o", "red.png", "--body-texture", "red.png"), "would be overwritten")


def tiled_square():
    """Four squares in x, y from -1 to 1, whose uv lie in tiles 1001, 1002, 1011 and 1012."""
    x, y = np.meshgrid([-1., 0, 1], [-1., 0, 1])
    positions = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    corner = np.array([0, 1, 3, 4])[:, None]
    faces = np.concatenate([corner + (0, 1, 4), corner + (0, 4, 3)])
    return clfur.Mesh(positions, uv=positions[:, :2] + 1, faces=faces)


def test_a_body_has_a_picture_in_each_tile(gpu):
    """1001 is red, 1012 half a blue of another size; where there is no tile it is white."""
    red, blue = np.zeros((2, 2, 3)), np.zeros((1, 4, 3))
    red[..., 0], blue[..., 2] = 1, 1
    camera = clfur.Camera(eye=(0, 0, 4), target=(0, 0, 0), size=(32, 32), fov=30)
    body = {1012: clfur.Material((0.5, 0.5, 0.5), blue), 1001: red}
    scene = clfur.Scene(tiled_square(), None, camera, clfur.Light((0, 0, -1), ambient=0), body_color=body)
    color = clfur.render(scene, gpu)
    seen = [color[y, x, :3] for y, x in ((22, 9), (22, 22), (9, 9), (9, 22))]
    np.testing.assert_allclose(seen, [(1, 0, 0), (1, 1, 1), (1, 1, 1), (0, 0, 0.5)], atol=2e-3)
    assert clfur.Scene(scene.mesh, None, camera, body_color=scene.body_color).mesh is scene.mesh


@pytest.mark.parametrize("body, words", [
    ({}, "1001"), ({1000: np.ones((1, 1, 3))}, "1001 to 9999"), ({1001: np.ones((1, 1))}, r"Scene.body_color\[1001\]"),
])
def test_wrong_tiles_of_a_body(body, words):
    with pytest.raises(clfur.Error, match=words):
        clfur.Scene(tiled_square(), body_color=body)


def test_tiles_of_a_body_need_uv():
    mesh = tiled_square()
    bare = clfur.Mesh(mesh.positions, faces=mesh.faces)
    with pytest.raises(clfur.Error, match="has UDIM tiles, which are laid on by uv"):
        clfur.Scene(bare, body_color={1001: np.ones((1, 1, 3))})
