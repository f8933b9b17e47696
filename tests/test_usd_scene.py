"""Scenes of USD: meshes, curves, cameras and lights, against what UsdGeom and UsdLux say of them."""

import sys

import numpy as np
import pytest
from support.command import wrong

import clfur
from clfur.files import apart
from clfur.files.scenes import parts_of, turned
from clfur.files.subdivision import smoothed

pxr = pytest.importorskip("pxr", reason='needs pip install "clfur[usd]"')
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, Vt  # noqa: E402

SQUARE = [(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)]


@pytest.fixture
def stage():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    return stage


def plane(stage, path="/plane", points=SQUARE, sizes=(4,), corners=(0, 1, 2, 3), scheme="none"):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([Gf.Vec3f(*map(float, each)) for each in points])
    mesh.CreateFaceVertexCountsAttr(list(sizes))
    mesh.CreateFaceVertexIndicesAttr(list(corners))
    if scheme:
        mesh.CreateSubdivisionSchemeAttr(scheme)
    return mesh


def hair(stage, path="/hair", points=((0, 0, 0), (0, 1, 0)), width=.01):
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr([len(points)])
    curves.CreatePointsAttr([Gf.Vec3f(*map(float, each)) for each in points])
    curves.CreateWidthsAttr([width])
    curves.SetWidthsInterpolation("constant")
    return curves


def place(prim, matrix=None, **ops):
    """Move a prim: translate, rotateXYZ, scale."""
    to = UsdGeom.Xformable(prim)
    for name, value in ops.items():
        getattr(to, f"Add{name[0].upper()}{name[1:]}Op")().Set(Gf.Vec3d(*value) if name == "translate" else
                                                              Gf.Vec3f(*value))
    return prim


def load(stage, tmp_path, **options):
    stage.Export(str(tmp_path / "a.usda"))
    return clfur.load_scene(tmp_path / "a.usda", **options)


def told(stage, tmp_path):
    """(scene, what the one warning lists)."""
    with pytest.warns(UserWarning, match="left out: ") as warned:
        scene = load(stage, tmp_path)
    assert len(warned) == 1 and "\n" not in str(warned[0].message)
    return scene, str(warned[0].message).partition("left out: ")[2]


# --- meshes ---------------------------------------------------------------------------------------------------


def test_all_meshes_become_one_where_they_stand(stage, tmp_path):
    UsdGeom.SetStageUpAxis(stage, "Z")
    place(UsdGeom.Xform.Define(stage, "/group"), translate=(0, 0, 5))
    place(plane(stage, "/group/one"), translate=(10, 0, 0))
    plane(stage, "/other")
    mesh = load(stage, tmp_path).mesh
    places = {tuple(each) for each in mesh.positions.round(5).tolist()}
    assert len(mesh.faces) == 4
    assert places == {(x, y, 0) for x in (-1, 1) for y in (-1, 1)} | {(x, y, 0) for x in (9, 11) for y in (4, 6)}
    assert mesh.normals[0].tolist() == [0, 0, -1]   # +Y of the stage


def test_winding_by_orientation_and_mirroring(stage, tmp_path):
    up = [load(stage, tmp_path).mesh.normals[0][1]] if plane(stage) else []
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/plane"))
    mesh.CreateOrientationAttr("leftHanded")
    up.append(load(stage, tmp_path).mesh.normals[0][1])
    place(mesh, scale=(-1, 1, 1))
    up.append(load(stage, tmp_path).mesh.normals[0][1])
    assert up == [1, -1, -1]   # a mirror along x leaves what looks down


def test_uv_by_corner_and_holes(stage, tmp_path):
    mesh = plane(stage, points=[*SQUARE, (2, 0, -1), (2, 0, 1)], sizes=(4, 4), corners=(0, 1, 2, 3, 3, 2, 5, 4))
    uv = np.random.default_rng(1).uniform(size=(8, 2)).astype(np.float32)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
    primvar.Set(Vt.Vec2fArray.FromNumpy(uv[::-1].copy()))
    primvar.SetIndices(Vt.IntArray(list(range(7, -1, -1))))   # back again
    mesh.CreateHoleIndicesAttr([0])
    found = load(stage, tmp_path).mesh
    assert len(found.faces) == 2
    assert {tuple(each) for each in found.uv.reshape(-1, 2)} == {tuple(each) for each in uv[4:]}


def test_normals_of_corners_but_not_of_subdivision(stage, tmp_path):
    mesh = plane(stage)
    mesh.CreateNormalsAttr([(0, -1, 0)] * 4)
    mesh.SetNormalsInterpolation("faceVarying")
    assert load(stage, tmp_path).mesh.normals[0].tolist() == [0, -1, 0]
    mesh.CreateSubdivisionSchemeAttr().Set("catmullClark")
    assert load(stage, tmp_path).mesh.normals[0].tolist() == [0, 1, 0]


CUBE = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
SIDES = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]


def test_catmull_and_clark(stage, tmp_path):
    """Of a cube, by the rules of their paper: corners at 5/9, edges at 3/4, faces as they are; and once more."""
    points, _, uv = smoothed(np.array(CUBE, float), np.full(6, 4), np.array(SIDES), np.zeros((24, 2)))
    assert np.allclose(np.abs(points[:8]), 5 / 9) and len(points) == 8 + 12 + 6 and uv.shape == (96, 2)
    assert np.allclose(np.sort(np.abs(points[8:20])), [0, .75, .75])
    assert np.allclose(np.sort(np.abs(points[20:])), [0, 0, 1])
    plane(stage, points=CUBE, sizes=[4] * 6, corners=SIDES, scheme=None)   # which is USD's default
    mesh = load(stage, tmp_path).mesh
    assert len(mesh.faces) == 6 * 16 * 2 and not mesh.inward and not mesh.turned_faces
    reach = np.linalg.norm(mesh.positions, axis=1)
    # On the surface itself, (n P + 4 E + F) / (n + 5) of means: a corner of the cube, and the middle of a side.
    assert reach.max() == pytest.approx((3 + 4 / 3 - 1 / 3) / 8 * 3**.5, abs=1e-6)
    assert reach.min() == pytest.approx((4 * 1 + 4 * .75 + 5 / 9) / 9, abs=1e-6)


def test_boundaries_of_subdivision_and_what_of_it_is_left_out(stage, tmp_path):
    """A flat grid stays flat, its outline's corners stay, its sides stay straight; uv stay linear."""
    grid = [(x, 0, -y) for y in range(3) for x in range(3)]
    quads = [k for y in (0, 3) for x in (0, 1) for k in (x + y, x + y + 1, x + y + 4, x + y + 3)]
    mesh = plane(stage, points=grid, sizes=[4] * 4, corners=quads, scheme="catmullClark")
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        [Gf.Vec2f(x, -z) for x, _, z in grid])
    found = load(stage, tmp_path).mesh
    assert len(found.faces) == 4 * 16 * 2 and not found.positions[:, 1].any()
    assert found.positions.min(axis=0).tolist() == [0, 0, -2] and found.positions.max(axis=0).tolist() == [2, 0, 0]
    assert np.allclose(found.uv, found.positions[found.faces][..., [0, 2]] * (1, -1), atol=.2)   # which move
    mesh.CreateCreaseIndicesAttr([0, 1])
    assert told(stage, tmp_path)[1] == "creases of subdivision (/plane)"


def test_materials_of_subsets(stage, tmp_path):
    mesh = plane(stage, points=[*SQUARE, (2, 0, -1), (2, 0, 1)], sizes=(4, 4), corners=(0, 1, 2, 3, 3, 2, 5, 4))
    mesh.CreateDisplayColorAttr([(.5, .5, .5)])
    material = UsdShade.Material.Define(stage, "/red")
    shader = UsdShade.Shader.Define(stage, "/red/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        material.CreateInput("base", Sdf.ValueTypeNames.Color3f))
    material.GetInput("base").Set(Gf.Vec3f(.8, .1, .1))   # what the shader asks for, told on the material
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    subset = UsdGeom.Subset.CreateGeomSubset(mesh, "right", "face", Vt.IntArray([1]), "materialBind")
    UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    scene = load(stage, tmp_path)
    colors = np.array([scene.body_color[each].color for each in scene.mesh.material_of])
    assert np.allclose(colors, [[.5] * 3] * 2 + [[.8, .1, .1]] * 2)


@pytest.mark.parametrize("suffix", [".usda", ".usdz"])
def test_a_texture_is_found_beside_or_in_the_package(stage, tmp_path, suffix):
    pixels = np.zeros((2, 2, 4), np.float32)
    pixels[...] = [1, 0, 0, 1]
    clfur.save(tmp_path / "red.png", pixels)
    mesh = plane(stage)
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        [(0, 0), (1, 0), (1, 1), (0, 1)])
    material = UsdShade.Material.Define(stage, "/m")
    shader, texture = (UsdShade.Shader.Define(stage, f"/m/{name}") for name in ("s", "t"))
    shader.CreateIdAttr("UsdPreviewSurface")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("red.png")
    texture.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("mirror")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    stage.Export(str(tmp_path / "a.usda"))
    if suffix == ".usdz":
        from pxr import UsdUtils

        assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "a.usda"), str(tmp_path / "a.usdz"))
        (tmp_path / "red.png").unlink()
    found, = clfur.load_scene(tmp_path / f"a{suffix}").body_color
    assert found.texture.shape == (2, 2, 3) and found.texture[0, 0].tolist() == [1, 0, 0]
    assert found.wrap == ("mirror", "repeat")


# --- what is seen ---------------------------------------------------------------------------------------------


def test_instances_of_both_kinds(stage, tmp_path):
    """Native instances stand beside what they are of; prototypes of a PointInstancer only where it says."""
    place(UsdGeom.Xform.Define(stage, "/lock"), translate=(5, 0, 0))
    hair(stage, "/lock/hair")
    again = stage.DefinePrim("/again", "Xform")
    again.GetReferences().AddInternalReference("/lock")
    again.SetInstanceable(True)
    instancer = UsdGeom.PointInstancer.Define(stage, "/many")
    place(instancer, translate=(0, 10, 0))
    proto = place(UsdGeom.Xform.Define(stage, "/many/protos/a"), translate=(0, 0, 1))
    hair(stage, "/many/protos/a/hair")
    instancer.CreatePrototypesRel().SetTargets([proto.GetPath()])
    instancer.CreateProtoIndicesAttr([0, 0, 0])
    instancer.CreatePositionsAttr([(1, 0, 0), (2, 0, 0), (3, 0, 0)])
    instancer.CreateOrientationsAttr([Gf.Quath(1)] * 3)
    instancer.CreateScalesAttr([(1, 1, 1), (1, 2, 1), (1, 1, 1)])
    instancer.CreateInvisibleIdsAttr([2])
    curves = load(stage, tmp_path).fur
    assert curves.points[::2].tolist() == [[5, 0, 0], [5, 0, 0], [1, 10, 1], [2, 10, 1]]
    assert curves.points[-1].tolist() == [2, 12, 1]
    assert curves.width.ravel() == pytest.approx([.01, .01, .01, .01 * 2**(1 / 3)])


def test_what_is_hidden(stage, tmp_path):
    plane(stage)
    hidden = UsdGeom.Xform.Define(stage, "/hidden")
    hidden.MakeInvisible()
    shown = place(plane(stage, "/hidden/within"), translate=(9, 0, 0))
    shown.CreateVisibilityAttr("inherited")   # which cannot show it
    plane(stage, "/guide").CreatePurposeAttr("guide")
    plane(stage, "/inactive").GetPrim().SetActive(False)
    stage.CreateClassPrim("/kind")
    plane(stage, "/kind/within")
    stage.OverridePrim("/over")
    assert len(load(stage, tmp_path).mesh.faces) == 2
    shown.CreatePurposeAttr("render")
    hidden.MakeVisible()
    assert len(load(stage, tmp_path).mesh.faces) == 4


def test_what_is_not_understood_is_listed_once(stage, tmp_path):
    plane(stage)
    for name in "abc":
        UsdGeom.Cube.Define(stage, f"/{name}")
    UsdGeom.NurbsCurves.Define(stage, "/nurbs")
    UsdLux.CylinderLight.Define(stage, "/tube")
    scene, listed = told(stage, tmp_path)
    assert sorted(listed.split("; ")) == ["a Cube (/a and 2 more)", "a CylinderLight (/tube)", "a NurbsCurves (/nurbs)"]
    assert len(scene.lights) == 1 and scene.environment is None


def test_time_samples_of_places_and_transforms(stage, tmp_path):
    mesh = plane(stage)
    move = UsdGeom.Xformable(mesh).AddTranslateOp()
    move.Set((0, 0, 0), 1)
    move.Set((0, 10, 0), 11)
    assert load(stage, tmp_path).mesh.bounds[0][1] == 0
    assert load(stage, tmp_path, time=6).mesh.bounds[0][1] == 5


def test_curves_without_a_width_or_colour_beside_others(stage, tmp_path):
    hair(stage).CreateDisplayColorAttr([(.1, .2, .3)])
    plain = hair(stage, "/plain")
    plain.GetPrim().RemoveProperty("widths")
    scene = load(stage, tmp_path)
    assert np.allclose(scene.fur.color[[0, -1]], [[.1, .2, .3], clfur.HairType().color])
    assert scene.fur.width[0] == np.float32(.01) and scene.fur.width[-1] > 0


# --- cameras --------------------------------------------------------------------------------------------------


def camera(stage, path="/camera", **attributes):
    found = UsdGeom.Camera.Define(stage, path)
    for name, value in {"horizontalAperture": 36., "verticalAperture": 24., "focalLength": 50., **attributes}.items():
        found.GetPrim().GetAttribute(name).Set(value)
    return found


def seen_at(camera, point):
    """Where a point is seen, as shares of the picture from its left and top."""
    x, y, z = (np.linalg.inv(camera.pose) @ [*point, 1])[:3]
    column, row = (camera.intrinsics @ [x, -y, -z])[:2] / -z
    return column / camera.size[0], row / camera.size[1]


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_camera_sees_what_usd_says(stage, tmp_path, up):
    """Against Gf.Frustum, with offsets, a scale and a stage of either axis."""
    UsdGeom.SetStageUpAxis(stage, up)
    plane(stage)
    found = camera(stage, horizontalApertureOffset=3., verticalApertureOffset=-2.)
    place(found, translate=(3, -5, 4), rotateXYZ=(50, 10, 30), scale=(2, 2, 2))
    frustum = found.GetCamera(0).frustum
    ours = load(stage, tmp_path).camera
    assert ours.size == (640, 427)
    for point in (0, 0, 0), (1, .5, -.3), (-1, 1, .2):
        there = (frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()).Transform(Gf.Vec3d(*point))
        turned = point if up == "Y" else (point[0], point[2], -point[1])
        assert seen_at(ours, turned) == pytest.approx(((there[0] + 1) / 2, (1 - there[1]) / 2), abs=2e-3)   # 427 rows


@pytest.mark.parametrize("policy, window", [
    ("expandAperture", (.48, .48)), ("cropAperture", (.72, .72)), ("adjustApertureWidth", (.48, .48)),
    ("adjustApertureHeight", (.72, .72)), ("adjustPixelAspectRatio", (.72, .48))])
def test_how_an_aperture_fits_a_square(stage, tmp_path, policy, window):
    """Width and height on the plane one unit away: of 36 x 24 and a focal length of 50, .72 x .48."""
    wanted = {"expandAperture": (.72, .72), "cropAperture": (.48, .48)}.get(policy, window)
    plane(stage)
    camera(stage)
    settings = UsdRender.Settings.Define(stage, "/Render/settings")
    settings.CreateResolutionAttr(Gf.Vec2i(100, 100))
    settings.CreateAspectRatioConformPolicyAttr(policy)
    ours = load(stage, tmp_path).camera
    assert ours.size == (100, 100)
    assert (100 / ours.intrinsics[0, 0], 100 / ours.intrinsics[1, 1]) == pytest.approx(wanted)


def test_several_cameras(stage, tmp_path):
    plane(stage)
    camera(stage, "/a/one", focalLength=20.)
    camera(stage, "/b/two", focalLength=80.)
    _, listed = told(stage, tmp_path)
    assert listed == "other cameras than /a/one (/b/two)"
    assert load(stage, tmp_path, camera="two").camera.intrinsics[0, 0] == pytest.approx(640 * 80 / 36)
    assert load(stage, tmp_path, camera="/a/one", size=(10, 10)).camera.size == (10, 10)
    with pytest.raises(clfur.Error, match=r"a\.usda: has no camera three; allowed: /a/one, /b/two"):
        load(stage, tmp_path, camera="three")
    camera(stage, "/c", projection="orthographic")
    with pytest.raises(clfur.Error, match="/c: is orthographic; allowed: perspective"):
        load(stage, tmp_path, camera="c")


# --- lights ---------------------------------------------------------------------------------------------------


def light(stage, kind, path="/light", **inputs):
    prim = stage.DefinePrim(path, kind)
    for name, value in inputs.items():
        prim.GetAttribute(f"inputs:{name}").Set(value)
    return prim


def test_a_distant_light_is_its_illuminance_over_pi(stage, tmp_path):
    plane(stage)
    place(light(stage, "DistantLight", intensity=3., exposure=1., color=Gf.Vec3f(1, .5, 0), angle=60.),
          rotateXYZ=(-90, 0, 0))
    sun, = load(stage, tmp_path).lights
    assert sun.direction == pytest.approx([0, -1, 0]) and sun.size == 60 and sun.ambient == 0
    assert sun.strength == pytest.approx(6 * np.array([1, .5, 0]) * np.sin(np.radians(30))**2)
    stage.GetPrimAtPath("/light").GetAttribute("inputs:normalize").Set(True)
    sun, = load(stage, tmp_path).lights
    assert sun.strength == pytest.approx(np.array([6, 3, 0]) / np.pi)


@pytest.mark.parametrize("kind, inputs, area", [
    ("SphereLight", {"radius": .5}, 4 * np.pi), ("DiskLight", {"radius": .5}, np.pi),
    ("RectLight", {"width": .5, "height": 4.}, 8)])
def test_lights_that_are_near_are_as_strong_as_at_the_middle(stage, tmp_path, kind, inputs, area):
    """What a small white plane shows there: L times the solid angle over pi; size and area with the light's scale."""
    plane(stage)
    place(light(stage, kind, intensity=5., **inputs), translate=(0, 10, 0), rotateXYZ=(-90, 0, 0), scale=(2, 2, 2))
    ours, = load(stage, tmp_path).lights
    seen = area / 4 if kind == "SphereLight" else area   # a sphere shows a quarter of its surface
    assert ours.strength == pytest.approx([5 * seen / 100 / np.pi] * 3)
    assert np.pi * ours.size**2 == pytest.approx(seen) and ours.position.tolist() == [0, 10, 0]
    assert (ours.everywhere, ours.direction.round(6).tolist()) == (kind == "SphereLight", [0, -1, 0])
    stage.GetPrimAtPath("/light").GetAttribute("inputs:normalize").Set(True)
    ours, = load(stage, tmp_path).lights
    assert ours.strength == pytest.approx([5 / area * seen / 100 / np.pi] * 3)


def test_spots_points_shadows_and_temperature(stage, tmp_path):
    plane(stage)
    prim = light(stage, "SphereLight", intensity=100., normalize=True, radius=0., enableColorTemperature=True,
                 colorTemperature=3000.)
    place(prim, translate=(0, 3, 0))
    prim.GetAttribute("treatAsPoint").Set(True)
    UsdLux.ShapingAPI.Apply(prim).CreateShapingConeAngleAttr(20)
    UsdLux.ShadowAPI.Apply(prim).CreateShadowEnableAttr(False)
    ours, = load(stage, tmp_path).lights
    assert ours.angle == 40 and ours.size == 0 and not ours.shadows
    assert ours.strength == pytest.approx(
        np.array(UsdLux.BlackbodyTemperatureAsRgb(3000)) * 100 / (4 * np.pi**2 * 9) * np.pi, rel=1e-5)


def test_a_camera_s_exposure_is_the_lights(stage, tmp_path):
    plane(stage)
    camera(stage).CreateExposureAttr(2)
    light(stage, "DistantLight", intensity=1., normalize=True)
    light(stage, "DomeLight", "/sky", intensity=.5)
    scene = load(stage, tmp_path)
    assert scene.lights[0].strength == pytest.approx([4 / np.pi] * 3)
    assert scene.environment.sky.tolist() == [2, 2, 2]


def picture(tmp_path):
    """A sky whose middle column is red and whose top row is blue; what looks at these."""
    pixels = np.full((8, 16, 3), .1, np.float32)
    pixels[:, 7:9, 0] = 1
    pixels[:1] = [0, 0, 1]
    clfur.save(tmp_path / "sky.exr", pixels)


def looked_up(environment, towards):
    ways, colors, _ = environment.places
    return colors[np.argmax(ways @ np.asarray(towards, float))]


@pytest.mark.parametrize("kind, up, turn, red", [
    ("DomeLight", "Y", (0, 0, 0), (0, 0, 1)), ("DomeLight", "Y", (0, 90, 0), (1, 0, 0)),
    ("DomeLight", "Z", (90, 0, 0), (0, 0, 1)), ("DomeLight_1", "Z", (0, 0, 0), (0, 0, 1)),
    ("DomeLight_1", "Z", (0, 0, 90), (1, 0, 0))])
def test_skies_look_where_usd_says(stage, tmp_path, kind, up, turn, red):
    """The middle of a picture lies towards +Z of the dome (OpenEXR), its top up; of a Z-up stage towards -Y, our +Z."""
    picture(tmp_path)
    UsdGeom.SetStageUpAxis(stage, up)
    plane(stage)
    sky = place(light(stage, kind, intensity=2.), rotateXYZ=turn)
    sky.GetAttribute("inputs:texture:file").Set("sky.exr")
    scene = load(stage, tmp_path)
    assert looked_up(scene.environment, red) == pytest.approx([2, .2, .2], abs=.01)
    assert looked_up(scene.environment, (0, 1, 0)) == pytest.approx([0, 0, 2], abs=.01)
    assert not scene.lights[0].strength.any()   # the sky alone


def test_a_sky_of_one_pixel_is_a_colour(stage, tmp_path):
    """As Blender writes a world of one colour."""
    clfur.save(tmp_path / "sky.exr", np.full((1, 1, 3), .5, np.float32))
    plane(stage)
    light(stage, "DomeLight").GetAttribute("inputs:texture:file").Set("sky.exr")
    assert load(stage, tmp_path).environment.sky.tolist() == [.5, .5, .5]


def test_a_sky_that_is_turned_is_looked_up(tmp_path):
    rng = np.random.default_rng(2)
    smooth = np.kron(rng.uniform(size=(4, 8, 3)), np.ones((8, 8, 1))).astype(np.float32)
    back = turned(smooth, np.diag([-1., 1, -1]))   # half a turn: its middle towards -Z, as an Environment's is
    assert np.abs(back - smooth).max() < 1e-5


# --- files that are wrong, and the command --------------------------------------------------------------------


@pytest.mark.parametrize("change, says", [
    (lambda mesh: mesh.GetFaceVertexCountsAttr().Set([5]), "/plane: has 4 faceVertexIndices, but its faceVertexCounts"),
    (lambda mesh: mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 9]), "/plane: has the index 9; allowed: 0 to 3"),
    (lambda mesh: mesh.GetPointsAttr().Set([(np.nan, 0, 0)] * 4), "Mesh.positions"),
    (lambda mesh: UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        [(0, 0)]), "/plane: has 1 values of uv, vertex; allowed: 4"),
    (lambda mesh: mesh.MakeInvisible(), "has neither Meshes nor BasisCurves that are seen"),
])
def test_wrong_meshes_are_one_line(stage, tmp_path, change, says):
    change(plane(stage))
    with pytest.raises(clfur.Error, match=says) as error:
        load(stage, tmp_path)
    assert "\n" not in str(error.value) and str(error.value).startswith(str(tmp_path))


def ends():
    """A stand-in for a library that ends its process."""
    import os
    os.abort()


def fills():
    """A stand-in for one that takes what a damaged file claims."""
    return bytes(apart.ROOM + (1 << 30))


@pytest.mark.parametrize("function, says", [(ends, "the library that reads it ended its process"),
                                            (fills, "it claims more memory than there is")])
def test_what_ends_a_process_is_one_line(function, says):
    if function is fills and sys.platform != "linux":
        pytest.skip("other systems do not keep such limits")
    with pytest.raises(clfur.Error, match=f"^is damaged: {says}$"):
        apart.apart(function)


@pytest.mark.parametrize("path, says", [("a.obj", "a.obj: .obj is no scene file; allowed: .usd, "),
                                        ("a.usdc", "a.usdc: no such file"), (3, "load_scene path is 3")])
def test_what_is_no_scene(path, says):
    with pytest.raises(clfur.Error, match=says):
        clfur.load_scene(path)


def test_the_command_draws_a_scene(clfur, stage, tmp_path):
    plane(stage, "/mesh")
    hair(stage)
    place(camera(stage), translate=(0, .5, 4))
    light(stage, "DistantLight", intensity=1., normalize=True)
    UsdGeom.Cube.Define(stage, "/cube")
    stage.Export(str(tmp_path / "a.usda"))
    code, out, err = clfur("render", "a.usda", "--size", "60x40")
    assert code == 0 and "a.png: 1 strand in " in out
    assert err == "clfur: warning: a.usda: left out: a Cube (/cube)\n"
    stage.RemovePrim("/cube")
    stage.Export(str(tmp_path / "a.usda"))
    wrong(clfur("render", "a.usda", "--curl", "1,2"), "--curl is for hair that grows, but a.usda has its own")
    wrong(clfur("render", "a.usda", "--camera", "b"), "a.usda: has no camera b; allowed: /camera")
    wrong(clfur("render", "sphere", "--camera", "b"), "--camera is for USD scenes, but sphere is none")
    wrong(clfur("grow", "a.usda", "-o", "b.npz"), "a.usda grows no strands")
    stage.RemovePrim("/hair")
    stage.Export(str(tmp_path / "b.usda"))
    code, out, err = clfur("render", "b.usda", "--size", "60x40", "--inner", 2, "--outer", 2, "--zoom", 2)
    assert code == 0 and "12 strands" in out and not err
    assert clfur("grow", "b.usda", "-o", "b.npz", "--inner", 1)[0] == 0


def test_lights_beyond_and_within_what_is_drawn(stage, tmp_path):
    """A lamp very far away becomes a distant light, one within casts no shadows; hair tells how strong they are."""
    plane(stage)
    hair(stage, points=((0, 0, 0), (0, .5, 0)))
    place(light(stage, "SphereLight", "/far", intensity=1e6, radius=10.), translate=(0, 5000, 0))
    place(light(stage, "SphereLight", "/within", intensity=1., radius=.1), translate=(0, 1, 0))
    scene, listed = told(stage, tmp_path)
    far, within = scene.lights
    assert far.position is None and far.direction == pytest.approx([0, -1, 0])
    assert far.size == pytest.approx(np.degrees(20 / 5000), rel=1e-3)
    assert far.strength == pytest.approx([1e6 * (10 / 5000)**2] * 3, rel=1e-3)
    assert listed == "shadows of a light within the scene (/within)" and not within.shadows
    assert within.strength == pytest.approx([(.1 / .75)**2] * 3, rel=1e-5)   # .75 from the middle of the hair


def test_a_mesh_that_says_no_colour(stage, tmp_path):
    """USD's grey in Python; the command gives it skin for its hair."""
    plane(stage)
    assert load(stage, tmp_path).body_color.tolist() == [.18] * 3
    assert "body_color" not in parts_of(tmp_path / "a.usda", {})


@pytest.mark.parametrize("output", ["sub.usda", "deep.usdc", "frames.usdc"])
def test_layers_that_were_read_stay(stage, clfur, tmp_path, output):
    """Of files that a file names, and of those that these name: a reference, a payload, a clip."""
    mesh = plane(stage)
    stage.Export(str(tmp_path / "deep.usdc"))
    mesh.GetPointsAttr().Set(mesh.GetPointsAttr().Get(), 0)
    stage.Export(str(tmp_path / "frames.usdc"))
    sub, top = (Usd.Stage.CreateNew(str(tmp_path / name)) for name in ("sub.usda", "top.usda"))
    sub.OverridePrim("/plane").GetPayloads().AddPayload("./deep.usdc", "/plane")
    top.OverridePrim("/plane").GetReferences().AddReference("./sub.usda", "/plane")
    clips = Usd.ClipsAPI(top.GetPrimAtPath("/plane"))
    clips.SetClipPrimPath("/plane")
    clips.SetClipAssetPaths([Sdf.AssetPath("./frames.usdc")])
    clips.SetClipManifestAssetPath(Sdf.AssetPath("./frames.usdc"))
    clips.SetClipActive([(0, 0)])
    clips.SetClipTimes([(0, 0)])
    sub.Save()
    top.Save()
    before = (tmp_path / output).read_bytes()
    wrong(clfur("grow", "top.usda", "--roots", "50", "-o", output), f"{output} is read by this command")
    assert (tmp_path / output).read_bytes() == before
