"""USD files that move: scenes at a time against what usd-core's UsdGeom and UsdSkel say of them."""

import attrs
import numpy as np
import pytest

import clfur
from clfur.files import scenes
from clfur.files.usd import called

pxr = pytest.importorskip("pxr", reason='needs pip install "clfur[usd]"')
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdSkel, Vt  # noqa: E402

SQUARE = np.array([(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)], float)


@pytest.fixture
def stage():
    """A square, whose corners and whose place move from code 10 to 20, ten codes a second."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetTimeCodesPerSecond(10)
    group = UsdGeom.Xform.Define(stage, "/group")
    turn = group.AddRotateZOp()
    turn.Set(0, 10)
    turn.Set(90, 20)
    square(stage, "/group/square", {10: SQUARE, 20: SQUARE * (3, 1, 1)})
    return stage


def square(stage, path, samples):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    points = mesh.CreatePointsAttr()
    for code, each in samples.items():
        points.Set(Vt.Vec3fArray.FromNumpy(np.float32(each)), code)
    return mesh


def load(stage, tmp_path, suffix=".usda"):
    stage.Export(str(tmp_path / f"a{suffix}"))
    return clfur.load_animation(tmp_path / f"a{suffix}")


def places(mesh):
    return mesh.positions[mesh.faces] + mesh.origin


@pytest.mark.parametrize("seconds", [-1, 0, .25, .5, 1, 4])
def test_points_and_places(stage, tmp_path, seconds):
    walk = load(stage, tmp_path)
    assert (walk.duration, walk.fps) == (1, 10)
    code = 10 + 10 * min(max(seconds, 0), 1)
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/group/square")).GetPointsAttr().Get(code))
    matrix = np.array(UsdGeom.XformCache(code).GetLocalToWorldTransform(stage.GetPrimAtPath("/group/square")))
    found = walk(seconds)
    assert walk(seconds) is found   # asked again, the very same
    np.testing.assert_allclose(found.mesh.positions, points @ matrix[:3, :3] + matrix[3, :3], atol=1e-6)
    np.testing.assert_array_equal(found.mesh.faces, walk(0).mesh.faces)
    np.testing.assert_allclose(found.mesh.normals, [(np.array((0, 1, 0)) @ matrix[:3, :3])] * 4, atol=1e-6)


def test_camera_and_lights_move(stage, tmp_path):
    """A camera of the file goes along; without one the picture stays where it is at first."""
    still = load(stage, tmp_path)
    np.testing.assert_array_equal(still(1).camera.pose, still(0).camera.pose)
    camera = UsdGeom.Camera.Define(stage, "/camera")
    move = camera.AddTranslateOp()
    move.Set((0, 0, 5), 10)
    move.Set((4, 0, 5), 20)
    light = UsdLux.DistantLight.Define(stage, "/sun")
    light.CreateIntensityAttr().Set(1, 10)
    light.GetIntensityAttr().Set(3, 20)
    walk = load(stage, tmp_path)
    assert [walk(seconds).camera.pose[0, 3] for seconds in (0, .5, 1)] == pytest.approx([0, 2, 4])
    one, other = (np.asarray(walk(seconds).lights[0].strength) for seconds in (0, .5))
    np.testing.assert_allclose(other, 2 * one, rtol=1e-5)


def test_triangles_stay_the_same(tmp_path):
    """A quad that is bent one way and then the other is cut as at first; so is a subdivided one."""
    bent = SQUARE * (1, 0, 1) + np.array([0, 1, 0, 1])[:, None] * (0, 1, 0)
    for scheme in "none", "catmullClark":
        stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(stage, "Y")
        mesh = square(stage, "/square", {0: SQUARE * (1, 1, .1) + (0, 0, .2) * bent, 24: bent, 48: bent * (1, -9, .1)})
        mesh.GetSubdivisionSchemeAttr().Set(scheme)
        walk = load(stage, tmp_path)
        first, later = walk(0).mesh, walk(2).mesh
        np.testing.assert_array_equal(later.faces, first.faces)
        clfur.Scene(mesh=later, fur=clfur.Strands(roots=5, rest=first))
        assert np.abs(clfur.load_scene(tmp_path / "a.usda", time=48).mesh.positions - later.positions).max() < 1e-6


def test_skeletons_and_blend_shapes(tmp_path):
    """A bar's end turns a quarter about z, and grows by a shape: by hand, and as UsdSkel bakes it."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    root = UsdSkel.Root.Define(stage, "/model")
    root.AddTranslateOp().Set((0, 0, 3))
    skeleton, animation = UsdSkel.Skeleton.Define(stage, "/model/bones"), UsdSkel.Animation.Define(stage, "/model/walk")
    joints, ahead = ["a", "a/b"], Gf.Matrix4d(1).SetTranslate((0, 1, 0))
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1), ahead])
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1), ahead])
    animation.CreateJointsAttr(["a/b"])
    animation.CreateTranslationsAttr([(0, 1, 0)])
    animation.CreateScalesAttr([Gf.Vec3h(1, 1, 1)])
    turns, shapes = animation.CreateRotationsAttr(), animation.CreateBlendShapeWeightsAttr()
    animation.CreateBlendShapesAttr(["wide"])
    for code, turn, weight in (0, (1, 0, 0), 0), (24, (.5**.5, 0, .5**.5), 1):
        turns.Set([Gf.Quatf(turn[0], 0, 0, turn[2])], code)
        shapes.Set([weight], code)
    mesh = square(stage, "/model/bar", {})
    mesh.GetPointsAttr().Set([(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 0)])
    mesh.AddTranslateOp().Set((50, 0, 0))   # which has no say
    shape = UsdSkel.BlendShape.Define(stage, "/model/bar/wide")
    shape.CreateOffsetsAttr([(1, 0, 0)])
    shape.CreatePointIndicesAttr([1])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateJointIndicesPrimvar(False, 1).Set([0, 0, 1, 1])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.] * 4)
    binding.CreateBlendShapesAttr(["wide"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    UsdSkel.BindingAPI.Apply(root.GetPrim()).CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    walk = load(stage, tmp_path)
    for share in 0, .5, 1:
        angle = share * np.pi / 2
        cos, sin = np.cos(angle), np.sin(angle)
        wanted = np.array([(0, 0, 3), (1 + share, 0, 3), (cos - sin, 1 + sin + cos, 3), (-sin, 1 + cos, 3)])
        found = walk(share).mesh
        np.testing.assert_allclose(places(found), wanted[found.faces], atol=1e-6)
    assert UsdSkel.BakeSkinning(stage.Traverse())
    baked = np.array(mesh.GetPointsAttr().Get(24)) @ np.array(
        UsdGeom.XformCache(24).GetLocalToWorldTransform(mesh.GetPrim()))[:3, :3]
    baked += np.array(UsdGeom.XformCache(24).GetLocalToWorldTransform(mesh.GetPrim()))[3, :3]
    np.testing.assert_allclose(found.positions, baked, atol=1e-6)


def test_curves_move_and_are_no_groom_but_at_first(gpu, stage, tmp_path):
    """Curves of each time are drawn as they are; `Motion` takes those of the beginning, and moves them itself."""
    curves = UsdGeom.BasisCurves.Define(stage, "/hair")
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr([3])
    curves.CreateWidthsAttr([.1])
    curves.SetWidthsInterpolation("constant")
    for code, y in (10, 1), (20, 2):
        curves.CreatePointsAttr().Set(Vt.Vec3fArray([(0, 0, 0), (0, y / 2, 0), (0, y, 0)]), code)
    walk = load(stage, tmp_path)
    assert [walk(seconds).fur.points[2, 1] for seconds in (0, .5, 1)] == pytest.approx([1, 1.5, 2])

    def scene(seconds):   # a mesh that stays under them
        return attrs.evolve(walk(seconds), mesh=walk(0).mesh)
    now = clfur.Motion(scene, clfur.HairMotion(bend_length=9), gpu).step(1)
    assert np.linalg.norm(now.strands.on_host.points[2]) == pytest.approx(1, abs=1e-3)


def test_a_file_of_bytes_is_read_apart(stage, tmp_path, monkeypatch):
    """Some times at once, where they are asked for one after the other: to the same bits."""
    text, crate = load(stage, tmp_path), load(stage, tmp_path, ".usdc")
    reads = []
    monkeypatch.setattr(scenes, "called", lambda *given: reads.append(given) or called(*given))
    for seconds in .1, .2, .3, .4:
        np.testing.assert_array_equal(crate(seconds).mesh.positions, text(seconds).mesh.positions)
    assert len([each for each in reads if each[1].suffix == ".usdc"]) == 1


def test_what_is_refused(tmp_path):
    stage = Usd.Stage.CreateInMemory()
    square(stage, "/square", {}).GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.float32(SQUARE)))
    with pytest.raises(clfur.Error, match="a.usda: has no time samples; allowed: files that move"):
        load(stage, tmp_path)
    with pytest.raises(clfur.Error, match="load_animation name is 'walk', but .* is USD"):
        clfur.load_animation(tmp_path / "a.usda", "walk")
    with pytest.raises(clfur.Error, match="no.usda: no such file"):
        clfur.load_animation(tmp_path / "no.usda")
    stage.GetPrimAtPath("/square").CreateAttribute("points", Sdf.ValueTypeNames.Point3fArray).Set(
        Vt.Vec3fArray.FromNumpy(np.float32(SQUARE)), 3)
    stage.SetEndTimeCode(5)
    stage.SetStartTimeCode(5)
    with pytest.raises(clfur.Error, match="has no time samples"):
        load(stage, tmp_path)
