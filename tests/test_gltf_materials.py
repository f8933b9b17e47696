"""Base colours of glTF files: factors and pictures, where they are and how they repeat."""

import io
import json

import imageio.v3 as imageio
import numpy as np
import pytest
from support.command import wrong
from support.gltf import File, data_uri

import clfur
from clfur.color import srgb_to_linear

PICTURE = np.random.default_rng(0).integers(0, 256, (3, 4, 3), np.uint8)
FLAT = clfur.Light(color=(0, 0, 0), ambient=1)
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)


def coded(picture=PICTURE, kind=".png"):
    stream = io.BytesIO()
    imageio.imwrite(stream, picture, extension=kind)
    return stream.getvalue()


def two_squares(numbers, **tree):
    """A file of squares side by side, with these materials' numbers; None: without."""
    file = File(**tree)
    for k, number in enumerate(numbers):
        attributes = {"POSITION": file.accessor(CORNERS + (k, 0, 0), np.float32),
                      "TEXCOORD_0": file.accessor(CORNERS[:, :2] * (1, -1) + (0, 1), np.float32)}
        indices = file.accessor(np.array([0, 1, 2, 0, 2, 3])[:, None], np.uint16)
        mesh = file.mesh(attributes, indices, **({} if number is None else {"material": number}))
        file.add("nodes", mesh=mesh)
    return file


def textured(texture=None, info=None, **fields):
    """{name: list} of a file whose only material has a picture."""
    return {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0} | (info or {})} | fields}],
            "textures": [{"source": 0} if texture is None else texture]}


def written(tmp_path, file):
    path = tmp_path / "a.gltf"
    path.write_bytes(file.gltf())
    return path


def test_factors_by_face(gpu, tmp_path):
    """Each face has its primitive's, and those without a material the white default."""
    path = written(tmp_path, two_squares([1, None], materials=[
        {}, {"pbrMetallicRoughness": {"baseColorFactor": [.5, .25, 0, .1]}}]))
    mesh, materials = clfur.load_mesh(path), clfur.load_materials(path)
    assert [each.color.tolist() for each in materials] == [[1, 1, 1], [.5, .25, 0], [1, 1, 1]]
    left = mesh.positions[mesh.faces].mean(1)[:, 0] < 1
    assert mesh.material_of[left].tolist() == [1, 1] and mesh.material_of[~left].tolist() == [2, 2]
    camera = clfur.Camera(eye=(1, .5, 3), target=(1, .5, 0), size=(40, 20))
    image = clfur.render(clfur.Scene(mesh, None, camera, FLAT, materials), gpu)
    np.testing.assert_allclose(image[10, 15], (.5, .25, 0, 1), atol=1e-6)
    np.testing.assert_allclose(image[10, 25], 1, atol=1e-6)


@pytest.mark.parametrize("where", ["view", "uri", "file", "webp"])
def test_pictures_wherever_they_are(tmp_path, where):
    file = two_squares([0, 0], **textured(
        {"extensions": {"EXT_texture_webp": {"source": 0}}} if where == "webp" else None,
        baseColorFactor=[1, .5, .25, 1]))
    (tmp_path / "a b.png").write_bytes(coded())
    data = coded(np.full((3, 4, 3), 77, np.uint8), ".webp") if where == "webp" else coded()
    file.add("images", **{"view": {"bufferView": file.view(data), "mimeType": "image/png"},
                          "uri": {"uri": data_uri(data)}, "file": {"uri": "a%20b.png"},
                          "webp": {"bufferView": file.view(data)}}[where])
    material, _ = clfur.load_materials(written(tmp_path, file))
    meant = np.full((3, 4, 3), 77, np.uint8) if where == "webp" else PICTURE
    np.testing.assert_allclose(material.texture, srgb_to_linear(meant), atol=.01 if where == "webp" else 0)
    assert material.color.tolist() == [1, .5, .25] and material.wrap == ("repeat", "repeat")
    if where == "view":
        (tmp_path / "a.glb").write_bytes(file.glb())
        one, _ = clfur.load_materials(tmp_path / "a.glb")
        np.testing.assert_array_equal(one.texture, material.texture)


def test_wraps_and_the_pictures_top_row(gpu, tmp_path):
    """(0, 0) of glTF's uv is the picture's upper left corner."""
    file = two_squares([0], **textured({"source": 0, "sampler": 0}),
                       samplers=[{"wrapS": 33648, "wrapT": 33071}])
    file.add("images", bufferView=file.view(coded()))
    path = written(tmp_path, file)
    material, _ = clfur.load_materials(path)
    assert material.wrap == ("mirror", "clamp")
    k = [[4000, 0, 0], [0, 3000, 3], [0, 0, 1]]
    pose = np.eye(4)
    pose[2, 3] = 1000
    camera = clfur.Camera.calibrated(pose, k, (4, 3))
    image = clfur.render(clfur.Scene(clfur.load_mesh(path), None, camera, FLAT, [material, clfur.Material()]), gpu,
                         clfur.Settings(samples=1))
    np.testing.assert_allclose(image[..., :3], srgb_to_linear(PICTURE), atol=1e-3)


def test_specular_glossiness(tmp_path):
    file = two_squares([0], materials=[{"extensions": {"KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [.1, .2, .3, 1]}}}])
    assert clfur.load_materials(written(tmp_path, file))[0].color.tolist() == [.1, .2, .3]


def test_none_and_other_formats(tmp_path):
    assert clfur.load_materials(written(tmp_path, two_squares([None]))) == ()
    assert clfur.load_mesh(tmp_path / "a.gltf").material_of is None
    assert clfur.load_materials("sphere") == ()


def test_unused_ones_are_not_read(tmp_path):
    tree = textured()
    tree["materials"].append({})
    file = two_squares([1], **tree, images=[{"uri": "missing.png"}])
    assert clfur.load_materials(written(tmp_path, file))[0].texture is None


@pytest.mark.parametrize("tree, words", [
    (textured(info={"texCoord": 1}), "baseColorTexture is laid on by TEXCOORD_1; allowed: by TEXCOORD_0"),
    (textured({"source": 0, "sampler": 0}) | {"samplers": [{"wrapS": 7}], "images": [
        {"uri": data_uri(coded())}]}, "samplers[0].wrapS is 7; allowed: 10497"),
    (textured({"extensions": {"KHR_texture_basisu": {"source": 0}}}),
     "textures[0] has its picture only as KHR_texture_basisu holds it"),
    (textured({}), "textures[0] has its picture nowhere"), (textured({"source": 3}), "textures[0].source is 3"),
    (textured() | {"images": [{"uri": "no.png"}]}, "images[0] is in 'no.png', which does not exist"),
    (textured() | {"images": [{"uri": "../no.png"}]}, "allowed: files in its own folder"),
    (textured() | {"images": [{"uri": data_uri(b"123")}]}, "images[0] cannot be read as a picture"),
    (textured() | {"images": [{"uri": 3}]}, "images[0].uri is 3"), (textured() | {"images": [{}]}, "images[0].uri"),
    (textured(baseColorFactor=[1]), "baseColorFactor is [1]"),
    (textured(baseColorFactor=[-1, 0, 0, 1]) | {"images": [{"uri": data_uri(coded())}]}, "Material.color")])
def test_what_cannot_be_read_is_told_in_a_line(clfur, tmp_path, tree, words):
    """The command says which file and what of it; a colour of one's own draws it all the same."""
    written(tmp_path, two_squares([0], **tree))
    common = "render", "a.gltf", "--size", "16x12", "--roots", 5, "-o", "b.png"
    wrong(clfur(*common), "a.gltf: ", words)
    assert clfur(*common, "--body-color", "0,1,0")[0] == 0


def test_command(clfur, tmp_path):
    """The body has the file's colours, but where options say otherwise."""
    file = two_squares([0], **textured())
    file.add("images", bufferView=file.view(coded(np.full((2, 2, 3), (255, 0, 0), np.uint8))))
    (tmp_path / "a.glb").write_bytes(file.glb())
    common = "render", "a.glb", "--size", "16x12", "--roots", 0, "--eye", ".5,.5,2", "--target", ".5,.5,0", "--light"
    common = *common, "0,0,-1", "-o", "b.png"
    for options, channels in ((), (0,)), (("--body-color", "0,0,1"), (2,)), (("--body", "holdout"), ()):
        code, _, err = clfur(*common, *options)
        assert code == 0, err
        image = imageio.imread("b.png")[6, 8]
        assert [k for k in range(3) if image[k] > 40] == list(channels), options
    assert json.loads(clfur(*common, "--json")[1])["triangles"]
