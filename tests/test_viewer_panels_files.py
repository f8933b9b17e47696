"""Scene files that the viewer writes, files that are dropped on it, and what its panels hold, without a browser."""

import ast
import io
import json
import warnings
import zipfile
from pathlib import Path

import attrs
import numpy as np
import pytest
from PIL import Image
from support.devices import DEVICES

import clfur
from clfur.command.main import main
from clfur.files import usd_curves
from clfur.viewer.changes import found
from clfur.viewer.coats import COATS, dressed, fitted
from clfur.viewer.document import Document, MeshFile
from clfur.viewer.dropped import MOST, suffix_of, take, types_of
from clfur.viewer.fields import Field, angles_of, color_of, direction_of, hex_of
from clfur.viewer.saving import STRANDS, normals_for, scene_file, strand_file
from clfur.viewer.sections import ON, put, sections, value_of, with_goal, with_type, without
from clfur.viewer.told import expected

OBJ = b"v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
CAMERA = clfur.Camera(eye=(1, 1, 3), size=(48, 36))


@pytest.fixture(scope="module")
def device():
    return clfur.Scheduler(DEVICES[0])


def furred(**fields):
    return clfur.Scene(**{"mesh": clfur.load_mesh("sphere"), "fur": clfur.Strands(roots=200), **fields})


def png(pixels):
    file = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(file, "PNG")
    return file.getvalue()


def painted():
    """A map of three plain colours, and a soft edge."""
    pixels = np.zeros((60, 60, 3), np.uint8)
    pixels[:, 20:] = 255, 0, 0
    pixels[:, 45:] = 0, 0, 255
    pixels[:, 20] = 128, 0, 0
    return pixels


# ------------------------------------------------------------------------------------------------- scene files

RICH = {
    "plain": lambda: furred(),
    "a mesh that is no file's, two furs, types, lights, sky, ground": lambda: furred(
        fur=[clfur.Shells(length=.05, hairs=500, look=clfur.Kajiya(.1, 20)), clfur.Strands(
            roots=200, type_map=painted(), maps=clfur.Maps(density=np.full((8, 8), .5)), force=(0, -1.5, .1), types=[
                clfur.HairType(key=(0, 0, 0), curl=(.01, 3), tufts=clfur.Tufts(40, within=clfur.Tufts(4)),
                               color_texture=np.linspace(0, 1, 192).reshape(8, 8, 3)),
                clfur.HairType(key=(255, 0, 0), segment_length=.03, force_weight=.5, tip_color=(.9, .8, .1)),
                clfur.HairType(key=(0, 0, 255), look=clfur.Chiang(eumelanin=1.3))])],
        light=[clfur.Light((-1, -2, -.3)), clfur.Light(position=(2, 3, 2), angle=30, ambient=0, color=(1, .5, .2))],
        environment=clfur.Environment([(.2, .3, .6), (.7, .7, .7), (.1, .1, .1)]),
        ground=clfur.Ground(color=(.2, .3, .1)),
        body_color=clfur.Material((.5, .4, .3), texture=np.arange(48, dtype=np.uint8).reshape(4, 4, 3)))}


@pytest.mark.parametrize("name", RICH)
def test_a_scene_file_draws_the_same_bytes(name, tmp_path, device):
    """Also the mesh's normals come back to the bit, of arrays."""
    scene = RICH[name]()
    document = Document(scene, clfur.Settings(samples=1, grid=32), motion={"wind": clfur.Wind((1, 0, 0))})
    plain = name == "plain"
    state = attrs.evolve(document.state, mesh_file=MeshFile(scene.mesh, "sphere") if plain else None)
    file, data = scene_file(state, CAMERA, "look")
    assert file == ("look.py" if plain else "look.zip")
    if plain:
        (tmp_path / file).write_bytes(data)
    else:
        zipfile.ZipFile(io.BytesIO(data)).extractall(tmp_path)
    text = (tmp_path / "look.py").read_text()
    assert max(map(len, text.splitlines())) <= 120 and "motion = {" in text
    written = tmp_path / "a.png"
    with pytest.raises(SystemExit, match="0"):
        main(["render", str(tmp_path / "look.py"), "-o", str(written)])
    frame = clfur.draw(attrs.evolve(scene, camera=CAMERA), device, document.settings)
    clfur.save(tmp_path / "b.png", frame.images["color"])
    assert written.read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("name", ["sphere", "teapot"])
def test_normals_of_arrays_come_back_to_the_bit(name):
    mesh = clfur.load_mesh(name)
    again = clfur.Mesh(positions=mesh.positions, normals=normals_for(mesh), faces=mesh.faces)
    assert np.array_equal(again.normals, mesh.normals)
    assert not np.array_equal(clfur.Mesh(mesh.positions, mesh.normals, None, mesh.faces).normals, mesh.normals)


def test_a_dropped_mesh_is_beside_the_scene_file(tmp_path):
    document = Document(furred())
    take(document, "../../x.obj", OBJ)
    file, data = scene_file(document.state, document.scene.camera)
    archive = zipfile.ZipFile(io.BytesIO(data))
    assert file == "scene.zip" and archive.namelist() == ["scene.py", "scene-mesh.obj"]
    assert archive.read("scene-mesh.obj") == OBJ
    with pytest.raises(clfur.Error, match="a Comb that is a function"):
        scene_file(Document(furred(fur=clfur.Strands(comb=clfur.Comb(lambda p, n: n)))).state, CAMERA)


def test_a_function_of_seconds_is_saved_as_it_is_seen():
    """With what was changed, at the time that is told in the text."""
    mesh = clfur.load_mesh("sphere")
    document = Document(lambda seconds: furred(mesh=mesh, ground=clfur.Ground(height=-2 - seconds)))
    document.set(("scene", "strands", "types", 0, "length"), .25)
    state = attrs.evolve(document.state, mesh_file=MeshFile(mesh, "sphere"))
    _, data = scene_file(state, CAMERA, seconds=1.5)
    made = {}
    exec(data, made)
    assert made["scene"].ground.height == -3.5 and made["scene"].strands.types[0].length == .25
    assert "A still, at 1.5 s, of a scene that is a function of seconds." in made["__doc__"]
    assert b"A still" not in scene_file(Document(furred(mesh=mesh)).state, CAMERA)[1]


def test_a_mesh_may_have_any_name_a_system_takes(tmp_path):
    """Also bytes that are no UTF-8, which Python holds as surrogates."""
    scene = furred()
    for name in ("\udcfc.obj", "ü\U0001f98a.obj"):
        file, data = scene_file(attrs.evolve(Document(scene).state, mesh_file=MeshFile(
            scene.mesh, tmp_path / name)), CAMERA)
        call, = [each for each in ast.walk(ast.parse(data)) if isinstance(each, ast.Call)
                 and getattr(each.func, "attr", "") == "load_mesh"]
        assert file == "scene.py" and ast.literal_eval(call.args[0]) == str(tmp_path.resolve() / name)


def test_strand_files(device, tmp_path):
    scene = furred()
    for suffix in (".npz", ".hair", ".ply"):
        (tmp_path / f"a{suffix}").write_bytes(strand_file(scene, suffix, device))
        assert len(clfur.load_curves(tmp_path / f"a{suffix}").counts) == 200
    assert set(STRANDS) > {".usdc", ".tfx"}
    with pytest.raises(clfur.Error, match="no strands to save"):
        strand_file(furred(fur=None), ".npz", device)


# ---------------------------------------------------------------------------------------------- what is dropped


@pytest.mark.parametrize("name, data, said", [
    ("a.py", b"raise SystemExit", "a scene file is a program"), ("a.PY", b"", "a scene file is a program"),
    ("a.obj", b"", "the file is empty"), ("a.obj", b"\x00garbage\xff" * 9, None),
    ("a.glb", b"glTF" + b"\x00" * 40, None),
    ("a.png", b"\x89PNG\r\n" + b"\x01" * 90, None), ("a.npz", b"PK\x03\x04nothing", None), ("a.hdr", b"#?RAD", None),
    ("a.txt", b"1", "files .txt cannot be dropped"), ("a", b"1", "files without a suffix"),
    ("a.ply", b"ply\nend_header", None), ("a.tfx", b"1" * 200, None),
    ("a.png", png(np.random.default_rng(0).integers(0, 255, (64, 64, 3))), "as a photo has")])
def test_what_cannot_be_taken_is_told_in_a_line(name, data, said, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    document = Document(furred())
    before = document.state
    with pytest.raises(clfur.Error) as error:
        take(document, name, data)
    line = str(error.value)
    assert (said or "") in line and "\n" not in line and str(tmp_path) not in line and len(line) < 600
    assert document.state is before and not list(tmp_path.iterdir())


def test_a_file_above_the_limit_is_refused_before_it_is_read():
    assert suffix_of("A.OBJ", MOST) == ".obj"
    with pytest.raises(clfur.Error, match="has 256.0 MiB; allowed: at most 256.0"):
        suffix_of("a.obj", MOST + 1)


def test_a_dropped_mesh_wears_the_coat_as_large_beside_it(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    kind = clfur.HairType(length=.2, width=.01, curl=(.05, 2), frizz=(.01, 5), tufts=clfur.Tufts(density=100))
    scene = furred(fur=[clfur.Shells(length=.1, frequency=30), clfur.Strands(roots=200, types=kind, outer=np.full(
        (1280, 3), 2), inner=np.full(1280, 2))], light=clfur.Light(position=(0, 4, 0), size=.5))
    document = Document(scene, motion={"units_per_metre": 2})
    assert take(document, "a.obj", OBJ) == "a mesh of 2 faces"
    after, times = document.scene, clfur.load_mesh("sphere").bounds[1]
    times = after.mesh.bounds[1] / times
    hair, = after.strands.types
    assert (hair.length, hair.width, *hair.curl) == pytest.approx((.2 * times, .01 * times, .05 * times, 2))
    assert hair.tufts.density == pytest.approx(100 / times**2) and after.strands.inner == 5
    assert (after.shells.length, after.shells.frequency) == pytest.approx((.1 * times, 30 / times))
    center, _ = after.mesh.bounds
    assert after.lights[0].position == pytest.approx(center + np.array([0, 4, 0]) * times)
    assert document.state.motion.units_per_metre == pytest.approx(2 * times) and document.state.mesh_file.data == OBJ
    assert not np.array_equal(after.camera.eye, scene.camera.eye) and after.camera.size == scene.camera.size
    assert document.undo() and document.scene is scene and not list(tmp_path.iterdir())


def test_a_painted_map_gives_places_hair_of_their_own():
    document = Document(furred())
    assert take(document, "map.png", png(painted())) == "a type map of 3 types"
    kinds = document.scene.strands.types
    assert sorted(kind.key for kind in kinds) == [(0, 0, 0), (0, 0, 255), (255, 0, 0)]
    assert kinds[0].key == (255, 0, 0) and kinds[0].color == pytest.approx((.8, .6, .4))   # it has most of the picture
    document.set(("scene", "strands", "types", 1, "length"), .5)
    assert take(document, "map.png", png(painted()[::-1])) == "a type map of 3 types"
    assert document.scene.strands.types[1].length == .5   # known keys keep their types
    strands = with_type(document.scene.strands)
    assert len(strands.types) == 4 and strands.types[3].key not in {kind.key for kind in kinds}
    fewer = without(strands, 0)
    assert len(fewer.types) == 3 and fewer.inexact == 0 and (fewer.type_indices == 0).mean() > .4
    alone = without(without(fewer, 1), 0)
    assert len(alone.types) == 1 and alone.type_map is None
    with pytest.raises(clfur.Error, match="the scene has no Strands"):
        take(Document(furred(fur=None)), "map.png", png(painted()))
    jpeg = io.BytesIO()
    Image.fromarray(np.kron(painted(), np.ones((4, 4, 1), np.uint8))).save(jpeg, "JPEG")
    assert take(document, "map.jpg", jpeg.getvalue()) == "a type map of 3 types"
    assert len(types_of(np.zeros((4, 4, 3), np.uint8), (clfur.HairType(),))) == 1


def test_dropped_strands_stand_on_the_mesh_if_they_are_near(tmp_path, device):
    scene = furred()
    data = strand_file(scene, ".npz", device)
    document = Document(attrs.evolve(scene, fur=(clfur.Shells(), scene.fur)))
    assert take(document, "a.npz", data) == "200 strands" and document.scene.shells is not None
    assert isinstance(document.scene.strands, clfur.Curves) and document.scene.mesh is scene.mesh
    assert [each.title for each in sections(document.state)][1] == "Hair"
    far = clfur.Curves(points=np.array([[[9, 9, 9], [9, 9, 9.5]]]))
    clfur.save_curves(tmp_path / "far.ply", far)
    assert "without the mesh" in take(document, "far.ply", (tmp_path / "far.ply").read_bytes())
    assert document.scene.mesh is None and sections(document.state)
    take(document, "a.obj", OBJ)   # a mesh for no coat gets one
    assert document.scene.strands.roots == 80_000


LAYER = """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Y"%s
)
def Xform "a" (%s
)
{
}
"""


@pytest.fixture
def beside(tmp_path):
    """Path of a USD file with strands that are somebody else's."""
    pytest.importorskip("pxr", reason='needs pip install "clfur[usd]"')
    clfur.save_curves(tmp_path / "beside.usda", clfur.Curves(points=[(0, 0, 0), (0, 1, 0)], counts=[2]))
    return tmp_path / "beside.usda"


@pytest.mark.parametrize("layer, prim, said", [
    ("\n    subLayers = [@%s@]", "", "is made of other files, as '"), ("", "\n    references = @%s@", "is made of"),
    ("", "\n    payload = @%s@", "is made of"), ("", "\n    references = @`\"%s\"`@", "is made of"),
    ("", "\n    clips = {\n        dictionary a = {\n            string templateAssetPath = \"%s\"\n        }\n    }",
     "has clips, which are other files, at /a")])
def test_dropped_usd_reads_no_other_file(beside, layer, prim, said, monkeypatch):
    text = LAYER % tuple(each.replace("%s", str(beside)) for each in (layer, prim))
    document = Document(furred())
    before = document.state
    monkeypatch.setattr("clfur.files.usd.called", lambda function, *given: function(*given))   # quicker than apart
    with pytest.raises(clfur.Error, match=said):
        take(document, "a.usda", text.encode())
    assert document.state is before


def textured(beside, file):
    """The strands of a file, of a material whose colour is a picture's, one of this name; else grey."""
    from pxr import Sdf, Usd, UsdShade

    stage = Usd.Stage.Open(str(beside))
    material, surface, picture = (kind.Define(stage, f"/m{path}") for kind, path in [
        (UsdShade.Material, ""), (UsdShade.Shader, "/s"), (UsdShade.Shader, "/p")])
    surface.CreateIdAttr("UsdPreviewSurface")
    picture.CreateIdAttr("UsdUVTexture")
    picture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(str(file))
    picture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set((.5, .5, .5, 1))
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        picture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    prim = next(each for each in stage.Traverse() if each.GetTypeName() == "BasisCurves")
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)
    prim.RemoveProperty("primvars:displayColor")
    stage.Save()
    return stage


def test_a_picture_of_strands_material_is_not_opened(beside, monkeypatch):
    """Their colour is one for each: none of a picture would be taken."""
    textured(beside, beside)
    monkeypatch.setattr("clfur.files.usd_mesh.content_of", lambda *_: pytest.fail("it was opened"))
    assert usd_curves._read(beside, .25, None)["counts"].tolist() == [2]


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_dropped_usd_does_not_tell_whether_a_file_is_there(beside, tmp_path, suffix, monkeypatch):
    """Strands, their colour, and all that is told are the same whether there is a picture or none of its name."""
    from pxr import Sdf

    monkeypatch.setattr("clfur.files.usd.called", lambda function, *given: function(*given))   # quicker than apart
    found = []
    for name in "picture.png", "no picture.png":
        (tmp_path / "picture.png").write_bytes(b"")
        stage = textured(beside, tmp_path / name)
        stage.GetPrimAtPath("/m/p").CreateAttribute("more", Sdf.ValueTypeNames.AssetArray).Set(
            [str(tmp_path / name)], 2.0)
        stage.Export(str(tmp_path / f"root{suffix.replace('z', 'c')}"))
        if suffix == ".usdz":
            with Sdf.ZipFileWriter.CreateNew(str(tmp_path / "root.usdz")) as archive:
                archive.AddFile(str(tmp_path / "root.usdc"), "root.usdc")
        document, data = Document(furred()), (tmp_path / f"root{suffix}").read_bytes()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            assert take(document, f"a{suffix}", data) == "1 strands"
        found.append((document.scene.strands.color.tolist(), [str(each.message).split(": ", 1)[1] for each in said]))
    assert found[0] == found[1] and found[0][0] == [[.5, .5, .5]]


@pytest.mark.parametrize("name", ["../beside.usda", "%s", "a/../../beside.usda", "file:%s", "..\\\\beside.usda"])
def test_a_dropped_package_looks_for_no_layer_outside(beside, tmp_path, name, monkeypatch):
    from pxr import Sdf

    (tmp_path / "root.usda").write_text(LAYER % (f"\n    subLayers = [@{name.replace('%s', str(beside))}@]", ""))
    with Sdf.ZipFileWriter.CreateNew(str(tmp_path / "out.usdz")) as archive:
        archive.AddFile(str(tmp_path / "root.usda"), "root.usda")
    monkeypatch.setattr("clfur.files.usd.called", lambda function, *given: function(*given))
    monkeypatch.setattr(Sdf, "ComputeAssetPathRelativeToLayer", lambda *_: pytest.fail("it was looked for"))
    with pytest.raises(clfur.Error, match="is made of other files"):
        take(Document(furred()), "out.usdz", (tmp_path / "out.usdz").read_bytes())


def test_dropped_usd_may_have_all_in_one_file(beside, tmp_path, monkeypatch):
    from pxr import Sdf, UsdUtils

    (tmp_path / "root.usda").write_text(LAYER % ("\n    subLayers = [@./beside.usda@]", ""))
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "root.usda")), str(tmp_path / "all.usdz"))
    assert take(Document(furred()), "all.usdz", (tmp_path / "all.usdz").read_bytes()).startswith("1 strands")
    (tmp_path / "root.usda").write_text(LAYER % (f"\n    subLayers = [@{beside}@]", ""))
    with Sdf.ZipFileWriter.CreateNew(str(tmp_path / "out.usdz")) as archive:   # the other would pack it too
        archive.AddFile(str(tmp_path / "root.usda"), "root.usda")
    monkeypatch.setattr("clfur.files.usd.called", lambda function, *given: function(*given))
    with pytest.raises(clfur.Error, match="is made of other files"):
        take(Document(furred()), "out.usdz", (tmp_path / "out.usdz").read_bytes())


@pytest.mark.parametrize("uri", ["../beside.bin", "%s/beside.bin", "file://%s/beside.bin"])
def test_dropped_gltf_reads_no_other_file(tmp_path, uri, monkeypatch):
    """Neither a buffer, though it is there, nor a picture."""
    (tmp_path / "beside.bin").write_bytes(bytes(72))
    (tmp_path / "folders").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "folders"))
    uri = uri.replace("%s", str(tmp_path)) if "%s" in uri else f"../{uri}"
    views = {"bufferViews": [{"buffer": 0, "byteLength": 36}], "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}], "meshes": [
        {"primitives": [{"attributes": {"POSITION": 0}}]}]}
    tree = {"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 72}], **views,
            "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    monkeypatch.setattr(Path, "resolve", lambda _: pytest.fail("it was looked for"))
    with pytest.raises(clfur.Error, match="allowed: files in its own folder"):
        take(Document(furred()), "a.gltf", json.dumps(tree).encode())


def test_a_dropped_sky_shines(tmp_path):
    document = Document(furred())
    clfur.save(tmp_path / "sky.exr", np.ones((4, 8, 3), np.float32))
    assert take(document, "sky.exr", (tmp_path / "sky.exr").read_bytes()) == "a sky"
    assert document.scene.environment.sky.shape == (4, 8, 3)


# --------------------------------------------------------------------------------------------------- the panels


def all_fields(parts):
    return [field for part in parts for field in (*part.fields, *all_fields(part.inner))]


@pytest.mark.parametrize("name", COATS)
def test_every_field_of_every_coat_shows_a_value_that_can_be_put(name):
    """And the slider stands at it: none is outside of its range."""
    scene = dressed(furred(ground=clfur.Ground(), environment=clfur.Environment()), name)
    document, count = Document(scene, motion={}), 0
    for field in all_fields(sections(document.state)):
        shown = value_of(field, document.state)
        count += 1
        if field.kind in ("number", "whole") and shown is not None:
            assert field.low <= shown <= field.high * 1.0001, field
            assert field.value(field.share(shown)) == pytest.approx(shown, rel=.01, abs=1e-9 + .005 * (
                field.high - field.low) * (field.kind == "whole"))
        if shown is None:
            shown = ON
        if shown != "" and not (field.path[-1] == "seconds" and document.settings.goal) and field.path[-1] not in (
                "eumelanin", "pheomelanin"):
            put(field, document, shown)
    assert count > 60 - 30 * (name == "Velvet")
    json.dumps([value_of(field, document.state) for field in all_fields(sections(document.state))])


def test_fields_tell_what_they_mean():
    """Each in a line of its own, and two of one group never by the same word; also of types, skies and lamps."""
    scenes = [dressed(furred(), name) for name in COATS]
    scenes += [attrs.evolve(each, **more) for each, more in zip(scenes, [
        {"environment": clfur.Environment(), "ground": clfur.Ground(), "light": clfur.Light(position=(0, 4, 0))},
        {"environment": clfur.Environment([(1, 1, 1)] * 3), "fur": clfur.Strands(type_map=painted(), types=types_of(
            painted(), (clfur.HairType(look=clfur.Chiang()), clfur.HairType(segment_length=.02))))}])]
    for scene in scenes:
        document = Document(scene, clfur.Settings(blur="all"), motion={"hair_on_hair": .1})
        for field in all_fields(sections(document.state)):
            assert field.hint and field.label[0].isupper() and len(field.label) < 21, field
        for part in sections(document.state):
            for group in (part, *part.inner):
                labels = [field.label for field in group.fields]
                assert len(set(labels)) == len(labels), labels


def test_a_type_tells_its_colour_on_the_map_and_that_of_its_hair():
    document = Document(furred())
    take(document, "map.png", png(painted()))
    document.set(("scene", "strands", "types", 0, "color"), (0, 1, 0))
    part = sections(document.state)[1]
    assert value_of(part.fields[0], document.state) == "#ff0000" and part.fields[0].label == "Map colour"
    assert hex_of(found(document.state, part.swatch)) == "#00ff00"


def test_root_and_tip_colours_are_switched_on_beside_the_colour():
    """As the command's roots are, and as they were, for what is the colour now; chosen ones stay."""
    document = Document(furred())
    kind = "scene", "strands", "types", 0
    fields = {field.path: field for field in all_fields(sections(document.state))}
    root, tip, color = (fields[(*kind, name)] for name in ("root_color", "tip_color", "color"))
    put(color, document, "#00ff00")
    put(root, document, ON)
    put(tip, document, ON)
    hair, = document.scene.strands.types
    assert hair.root_color.tolist() == [0, .5, 0] and hair.tip_color.tolist() == [.5, 1, .5]
    put(root, document, None)
    put(color, document, "#ff0000")
    put(root, document, ON)
    hair, = document.scene.strands.types
    assert hair.root_color.tolist() == [.5, 0, 0] and hair.tip_color.tolist() == [1, .5, .5]
    put(root, document, "#0000ff")
    put(root, document, None)
    put(color, document, "#00ff00")
    put(root, document, ON)
    assert document.scene.strands.types[0].root_color.tolist() == [0, 0, 1]


def test_coats_fit_meshes_without_uv():
    strands = attrs.evolve(furred(fur=clfur.Strands(type_map=painted(), types=types_of(painted(), (
        clfur.HairType(),)))).strands)
    mesh = clfur.Mesh(positions=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], faces=[(0, 1, 2)])
    after, shells = fitted((strands, clfur.Shells(pattern="sine")), clfur.load_mesh("sphere"), mesh)
    clfur.Scene(mesh=mesh, fur=(after, shells))
    assert after.type_map is None and len(after.types) == 1 and shells.pattern == "cells"


def test_settings_with_a_goal_leave_the_rest_to_it():
    document = Document(furred(), clfur.Settings(samples=16, masks=4, blur="all"))
    field = next(each for each in all_fields(sections(document.state)) if each.path == ("settings", "max_error"))
    put(field, document, .05)
    assert document.settings == clfur.Settings(max_error=.05, blur="all")
    left = {each.path[-1] for each in all_fields(sections(document.state)) if each.path[0] == "settings"}
    assert "samples" not in left and "seconds" not in left and "blur" in left
    put(field, document, None)
    assert document.settings.goal is None and with_goal(document.settings, "seconds", 2.0).seconds == 2


def test_colours_and_directions_go_there_and_back():
    for text in ("#000000", "#ffffff", "#b37c4b", "#0a0b0c"):
        assert hex_of(color_of(text)) == text
    assert color_of("#808080")[0] == pytest.approx(.2158605, abs=1e-6)   # IEC 61966-2-1
    for wrong in ("red", "#12345", "#1234567", "#gggggg", ""):
        with pytest.raises(clfur.Error, match="#rrggbb"):
            color_of(wrong)
    assert direction_of(0, 0) == pytest.approx((0, 0, -1)) and direction_of(90, 0) == pytest.approx((-1, 0, 0))
    assert direction_of(0, 90) == pytest.approx((0, -1, 0))
    for angles in ((-120, 40), (30, -80), (180, 0)):
        assert angles_of(direction_of(*angles)) == pytest.approx(angles)


@pytest.mark.parametrize("field", [
    Field(("a",), "", high=2, curve="fine"), Field(("a",), "", low=1e-3, high=10, curve="log"),
    Field(("a",), "", low=-5, high=5), Field(("a",), "", "whole", low=1, high=1000, curve="log")])
def test_sliders_begin_and_end_where_their_fields_do(field):
    assert field.value(0) == pytest.approx(field.low) and field.value(1) == pytest.approx(field.high)
    assert field.share(field.low - 1) == 0 and field.share(field.high + 1) == 1
    values = [field.value(each) for each in np.linspace(0, 1, 20)]
    assert values == sorted(values)
    assert field.kind != "whole" or all(isinstance(each, int) for each in values)


def test_what_a_picture_errs_is_told_where_it_is_known(device):
    """By the fit, and as the budget tells it of the same settings."""
    from clfur.budget import LADDER, suited
    from clfur.pipeline.views import Rig

    scene = attrs.evolve(furred(), camera=CAMERA)
    frame = clfur.draw(scene, device, LADDER[1])
    rung, = (each for each in suited(Rig.of(scene)) if each.settings == LADDER[1])
    assert expected(frame, scene) == pytest.approx(rung.error, rel=1e-6)
    odd = attrs.evolve(LADDER[1], pcf=3)
    assert expected(clfur.draw(scene, device, odd), scene) is None


def test_dropped_files_are_sent_as_the_page_says():
    """The page's own limit is the server's."""
    script = (Path(clfur.__file__).parent / "viewer" / "panels.js").read_text()
    assert "MOST" in script and "/drop?name=" in script
