"""What a scene accepts, refuses and stores."""

import math
import re

import numpy as np
import pytest

from clfur.color import srgb_to_linear
from clfur.errors import Error
from clfur.scene import Camera, Curves, HairType, Light, Mesh, PointForce, Scene, Strands, frame

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
TENT = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5], [1, 1, -0.3], [2, 0.5, 0.4]])  # not flat
TENT_FACES = np.array([[0, 1, 2], [2, 1, 3], [1, 4, 3]])


def square(**options):
    return Mesh(SQUARE, faces=FACES, **options)


# --- errors: each names class.field, and says what is allowed, in one line ---


@pytest.mark.parametrize("make, words", [
    (lambda: HairType(segments=256), "HairType.segments is 256"),
    (lambda: HairType(segments=2.5), "HairType.segments is 2.5"),
    (lambda: HairType(segments=True), "HairType.segments is True"),
    (lambda: HairType(segment_length=-1), "HairType.segment_length is -1"),
    (lambda: HairType(segment_length="1"), "HairType.segment_length is '1'"),
    (lambda: HairType(width=math.nan), "HairType.width is nan"),
    (lambda: HairType(width=1e39), "HairType.width"),
    (lambda: HairType(force_weight=math.inf), "HairType.force_weight"),
    (lambda: HairType(color=(1, 1)), "HairType.color"),
    (lambda: HairType(color=(1, -1, 1)), "HairType.color"),
    (lambda: HairType(color="red"), "HairType.color"),
    (lambda: HairType(curl=(-1, 2)), "HairType.curl"),
    (lambda: HairType(wave=3), "HairType.wave"),
    (lambda: HairType(length_variation=1.1), "HairType.length_variation"),
    (lambda: HairType(exponent=0), "HairType.exponent"),
    (lambda: HairType(key=(0, 0, 256)), "HairType.key"),
    (lambda: HairType(key=(0, 0)), "HairType.key"),
    (lambda: HairType(color_texture=np.zeros((2, 2))), "HairType.color_texture"),
    (lambda: HairType(color_texture=np.full((2, 2, 3), np.nan)), "HairType.color_texture"),
    (lambda: HairType(color_texture=np.full((2, 2, 3), -1.0)), "HairType.color_texture"),
    (lambda: HairType(color_texture=np.full((2, 2, 3), 1e30)), "allowed: finite numbers from 0 to 1e+09"),
    (lambda: PointForce((0, 0)), "PointForce.position"),
    (lambda: Strands(inner=0), "Strands.inner is 0"),
    (lambda: Strands(inner=[1, 2, 65]), r"Strands.inner[2] is 65"),
    (lambda: Strands(outer=65), "Strands.outer is 65"),
    (lambda: Strands(outer=[1, 2, 3]), "Strands.outer"),
    (lambda: Strands(outer=[[1, 2, 0]]), "Strands.outer[0, 2] is 0"),
    (lambda: Strands(types=()), "Strands.types"),
    (lambda: Strands(types=[1]), "Strands.types"),
    (lambda: Strands(types=[HairType(), HairType()]), "Strands.type_map is None"),
    (lambda: Strands(roots=-1), "Strands.roots is -1"),
    (lambda: Strands(roots="vertices"), "Strands.roots is 'vertices'"),
    (lambda: Strands(roots=2**31), "Strands.roots"),
    (lambda: Strands(force=(0, math.nan, 0)), "Strands.force"),
    (lambda: Strands(point_forces=[(0, 0, 0)]), "Strands.point_forces"),
    (lambda: Strands(surface="bezier"), "Strands.surface is 'bezier'"),
    (lambda: Strands(seed=2**32), "Strands.seed"),
    (lambda: Strands(type_map=np.zeros((2, 2, 3))), "Strands.type_map"),
    (lambda: Camera(fov=180), "Camera.fov is 180"),
    (lambda: Camera(size=(0, 4)), "Camera.size is 0"),
    (lambda: Camera(size=(4, 16385)), "Camera.size is 16385"),
    (lambda: Camera(size=4), "Camera.size is 4"),
    (lambda: Camera(eye=(1, 2, 3), target=(1, 2, 3)), "Camera.target"),
    (lambda: Camera(up=(0, 0.4, 3.2)), "Camera.up"),
    (lambda: Camera(up=(0, 0, 0)), "Camera.up"),
    (lambda: Light(direction=(0, 0, 0)), "Light.direction"),
    (lambda: Light(ambient=-0.1), "Light.ambient"),
    (lambda: Light(color=(1, 1, -1)), "Light.color"),
    (lambda: Scene(), "Scene.mesh"),
    (lambda: Scene(mesh=3), "Scene.mesh is 3"),
    (lambda: Scene(fur=Strands()), "Scene.mesh is None"),
    (lambda: Scene(square(), body_color=(1, 1)), "Scene.body_color"),
    (lambda: Scene(square(), Strands(inner=[1, 2, 3])), "Strands.inner has levels for 3 faces"),
    (lambda: Scene(square(), Strands(outer=[[1, 2, 3]])), "Strands.outer has levels for 1 faces"),
    (lambda: Scene(square(), Strands(outer=[[1, 2, 3], [4, 5, 6]])), "at face 0, edge 1, "),
    (lambda: Scene(square(), Strands(types=HairType(color_texture=np.ones((1, 1, 3))))), "color_texture"),
    (lambda: frame(square(), None, fov=0), "frame fov"),
    (lambda: frame(square(), None, direction=(0, 0, 0)), "frame direction"),
])
def test_refuses(make, words):
    with pytest.raises(Error) as caught:
        make()
    text = str(caught.value)
    assert words in text and "allowed: " in text and "\n" not in text and len(text) < 400


@pytest.mark.parametrize("options, words", [
    ({"positions": SQUARE}, "Mesh.faces is None"),
    ({"positions": SQUARE, "faces": np.zeros((0, 3), int)}, "Mesh.faces is empty"),
    ({"positions": SQUARE, "faces": [[0, 1, 4]]}, "Mesh.faces has the index 4"),
    ({"positions": SQUARE, "faces": [[0, 1, -1]]}, "Mesh.faces has the index -1"),
    ({"positions": SQUARE, "faces": np.array([[0, 1, 2**63]], np.uint64)}, "Mesh.faces has the index"),
    ({"positions": SQUARE, "faces": [[0.0, 1.0, 2.0]]}, "Mesh.faces"),
    ({"positions": SQUARE, "faces": [[0, 1, 2, 3]]}, "Mesh.faces"),
    ({"positions": SQUARE, "faces": [[0, 1, 1]]}, "1 are degenerate"),
    ({"positions": SQUARE[:, :2], "faces": FACES}, "Mesh.positions"),
    ({"positions": np.where(SQUARE == 1, np.nan, 0), "faces": FACES}, "Mesh.positions[1, 0] is nan"),
    ({"positions": np.where(SQUARE == 1, np.inf, 0), "faces": FACES}, "Mesh.positions[1, 0] is inf"),
    ({"positions": SQUARE * 1e39, "faces": FACES}, "Mesh.positions[1, 0] is 1e+39"),
    ({"positions": [[0, 0, 0], [1, 2]], "faces": FACES}, "Mesh.positions"),
    ({"positions": SQUARE, "faces": FACES, "normals": SQUARE[:3]}, "Mesh.normals"),
    ({"positions": SQUARE, "faces": FACES, "uv": SQUARE}, "Mesh.uv"),
    ({"positions": SQUARE, "faces": FACES, "uv": SQUARE[:3, :2]}, "Mesh.uv"),
    ({"positions": SQUARE, "faces": FACES, "uv": SQUARE[:, :2] * np.nan}, "Mesh.uv[0, 0] is nan"),
])
def test_mesh_refuses(options, words):
    with pytest.raises(Error, match="allowed: ") as caught:
        Mesh(**options)
    assert words in str(caught.value)


# --- Mesh ---


def test_mesh_stores_plain_arrays():
    mesh = Mesh(SQUARE, None, SQUARE[:, :2], FACES)
    assert (mesh.positions.dtype, mesh.normals.dtype, mesh.uv.dtype) == (np.float32,) * 3
    assert mesh.faces.dtype == np.uint32 and mesh.has_uv
    assert np.array_equal(mesh.positions, SQUARE) and np.array_equal(mesh.faces, FACES)
    assert np.array_equal(mesh.normals, [[0, 0, 1]] * 4)
    assert np.array_equal(mesh.uv, SQUARE[:, :2][FACES])
    for array in (mesh.positions, mesh.normals, mesh.uv, mesh.faces):
        assert array.flags.c_contiguous and not array.flags.writeable
    assert not square().has_uv and not square().uv.any() and square().uv.shape == (2, 3, 2)
    center, radius = mesh.bounds
    assert np.allclose(center, (0.5, 0.5, 0)) and math.isclose(radius, math.sqrt(0.5))


def test_later_edits_change_nothing():
    positions, faces = SQUARE.astype(np.float32), FACES.astype(np.uint32)
    mesh = Mesh(positions, faces=faces)
    curves = Curves(points := np.ones((2, 3, 3), np.float32))
    positions[:] = faces[:] = points[:] = 7
    assert np.array_equal(mesh.positions, SQUARE) and np.array_equal(mesh.faces, FACES)
    assert (curves.points == 1).all()


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("given", [False, True])
def test_a_split_mesh_is_welded(scale, given):
    whole = Mesh(TENT * scale, faces=TENT_FACES)
    normals = whole.normals[TENT_FACES].reshape(-1, 3) if given else None
    split_positions = (TENT * scale)[TENT_FACES].reshape(-1, 3)
    split_positions[split_positions == 0] = -0.0
    uv = np.arange(18.0).reshape(9, 2)
    split = Mesh(split_positions, normals, uv, np.arange(9).reshape(3, 3))
    assert len(split.positions) == 5
    assert np.array_equal(split.positions[split.faces], whole.positions[whole.faces])
    assert np.allclose(split.normals[split.faces], whole.normals[whole.faces], atol=2e-7)
    assert np.array_equal(split.uv.reshape(9, 2), uv)
    assert np.allclose(np.linalg.norm(split.normals, axis=1), 1, atol=1e-6)
    assert np.allclose(whole.normals, Mesh(TENT, faces=TENT_FACES).normals, atol=1e-5)


def test_normals_are_weighted_by_area():
    # A large face in z = 0 and one with half its area in x = 0, which meet in an edge.
    mesh = Mesh([[0, 0, 0], [0, 2, 0], [-2, 0, 0], [0, 0, -1]], faces=[[0, 1, 2], [0, 3, 1]])
    assert np.allclose(mesh.normals[0], np.array([1, 0, 2]) / math.sqrt(5), atol=1e-6)
    assert np.allclose(mesh.normals[2], (0, 0, 1)) and np.allclose(mesh.normals[3], (1, 0, 0))


def test_given_normals_are_kept_and_mended():
    given = np.array([[0, 3, 4], [0, 0, 0], [np.nan, 0, 1], [0, 0, 1e-30]])
    mesh = square(normals=given)
    assert np.allclose(mesh.normals, [[0, 0.6, 0.8], [0, 0, 1], [0, 0, 1], [0, 0, 1]], atol=1e-7)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_degenerate_faces_are_dropped_and_counted(scale):
    positions = np.vstack([SQUARE, [[0, 0, 0], [0.5, 0, 0], [9, 9, 9]]]) * scale
    faces = [[0, 1, 1], [0, 4, 1], [0, 1, 2], [0, 5, 1], [0, 2, 3]]
    mesh = Mesh(positions, faces=faces)
    assert mesh.degenerate_faces == 3 and mesh.zero_normal_faces == 0
    assert np.array_equal(mesh.kept_faces, [2, 4]) and len(mesh.positions) == 4


def test_faces_whose_normals_cancel_are_dropped_and_counted():
    """Two that meet in a corner, one seen from above and one from below."""
    positions = np.vstack([SQUARE, [(5, 0, 0), (6, 0, 0), (5, 1, 0), (4, 0, 0), (5, -1, 0)]])
    mesh = Mesh(positions, faces=np.vstack([FACES, [(4, 5, 6), (4, 8, 7)]]))
    assert mesh.zero_normal_faces == 2 and len(mesh.faces) == 2 and len(mesh.positions) == 4


# --- fur ---


def test_type_map_chooses_types():
    types = [HairType(key=(255, 0, 0)), HairType(key=(0, 0, 255)), HairType(key=(0, 255, 0))]
    picture = np.array([[[255, 0, 0, 9], [0, 255, 0, 8]], [[0, 0, 255, 7], [0, 0, 255, 6]]], np.uint8)
    fur = Strands(types=types, type_map=picture)
    assert np.array_equal(fur.type_indices, [[0, 2], [1, 1]]) and fur.type_indices.dtype == np.uint8
    assert Strands().type_indices is None
    with pytest.raises(Error, match="by uv"):
        Scene(square(), fur)
    assert Scene(square(uv=SQUARE[:, :2]), fur).fur is fur


def test_type_map_lists_unlisted_colours():
    picture = np.zeros((4, 5, 3), np.uint8)
    picture[..., 0] = 100 + np.arange(20).reshape(4, 5)   # further than JPEG moves colours
    with pytest.raises(Error, match=re.escape("(100, 0, 0), (101, 0, 0)")) as caught:
        Strands(types=HairType(key=(0, 0, 0)), type_map=picture)
    assert "and 12 more" in str(caught.value)
    for keys, words in [([None], "None"), ([(0, 0, 0), (0, 0, 0)], "distinct")]:
        with pytest.raises(Error, match=words):
            Strands(types=[HairType(key=key) for key in keys], type_map=picture)


def test_color_texture_is_linear():
    texture = HairType(color_texture=np.array([[[0, 255, 188]]], np.uint8)).color_texture
    assert texture.dtype == np.float32 and np.allclose(texture[0, 0, :2], (0, 1))
    assert abs(texture[0, 0, 2] - 0.5029) < 1e-3
    floats = HairType(color_texture=np.full((2, 3, 3), 0.25)).color_texture
    assert (floats == 0.25).all() and not floats.flags.writeable
    assert np.allclose(srgb_to_linear(np.array([0.04045])), 0.0031308, atol=1e-7)


def test_equal_outer_levels_on_shared_edges_are_accepted():
    outer = [[1, 7, 3], [4, 5, 7]]  # the edge 0-2 is opposite corner 1 of face 0 and corner 2 of face 1
    scene = Scene(square(), Strands(inner=[2, 3], outer=outer))
    assert np.array_equal(scene.fur.outer, outer) and np.array_equal(scene.fur.inner, [2, 3])


@pytest.mark.parametrize("width, shape", [
    (0.1, (1,)), ([0.1], (1,)), (np.ones(4), (4,)), (np.ones((4, 3)), (12,)), (np.ones(12), (12,)),
])
def test_curves_width_and_color(width, shape):
    curves = Curves(np.zeros((4, 3, 3)), width=width, color=np.multiply.outer(width, (1, 2, 3)))
    assert curves.points.shape == (12, 3) and curves.points.dtype == np.float32 and curves.uniform == 3
    assert curves.width.shape == shape and curves.color.shape == (*shape, 3)
    assert curves.width.dtype == curves.color.dtype == np.float32
    assert np.array_equal(curves.counts, [3, 3, 3, 3]) and curves.counts.dtype == np.uint32


def test_curves_of_different_lengths():
    curves = Curves(np.arange(18).reshape(6, 3), counts=[2, 0, 3, 1], width=[1, 2, 3, 4])
    assert curves.uniform is None and np.array_equal(curves.counts, [2, 0, 3, 1])
    assert Curves(np.zeros((4, 3)), counts=[2, 2]).uniform == 2
    assert Curves(np.zeros((3, 1, 3)), width=[1, 2, 3]).width.shape == (3,)  # per strand is per point here


def test_no_curves_at_all():
    for curves in (Curves(np.zeros((0, 9, 3))), Curves(np.zeros((0, 3)), counts=[], width=[])):
        assert len(curves.points) == len(curves.counts) == 0 and curves.width.shape == (1,)
        assert Scene(fur=curves).camera.size == (640, 480)


@pytest.mark.parametrize("options, words", [
    ({"points": np.zeros((4, 3))}, "Curves.counts is None"),
    ({"points": np.zeros((4, 3)), "counts": [2, 3]}, "Curves.counts add up to 5"),
    ({"points": np.zeros((4, 3)), "counts": [-1, 5]}, "Curves.counts"),
    ({"points": np.zeros((4, 3)), "counts": [2.0, 2.0]}, "Curves.counts"),
    ({"points": np.zeros((2, 2, 3)), "counts": [2, 2]}, "Curves.counts"),
    ({"points": np.zeros((2, 2, 2))}, "Curves.points"),
    ({"points": np.full((2, 2, 3), np.nan)}, "Curves.points[0, 0, 0] is nan"),
    ({"points": np.zeros((4, 3, 3)), "width": np.ones(5)}, "[4] per strand"),
    ({"points": np.zeros((4, 3, 3)), "width": np.ones((3, 4))}, "Curves.width"),
    ({"points": np.zeros((4, 3, 3)), "width": -1}, "Curves.width"),
    ({"points": np.zeros((4, 3, 3)), "width": math.nan}, "Curves.width"),
    ({"points": np.zeros((4, 3, 3)), "color": np.ones(4)}, "Curves.color"),
    ({"points": np.zeros((2, 3)), "counts": [2, 0], "width": [1, 2]}, "per strand or per point"),
    ({"points": np.zeros((4, 3, 3)), "exponent": 0}, "Curves.exponent"),
])
def test_curves_refuse(options, words):
    with pytest.raises(Error, match="allowed: ") as caught:
        Curves(**options)
    assert words in str(caught.value)


# --- camera and light ---


def project(camera, point):
    """Return (column, row) of a world point, by the words of Camera.calibrated."""
    x, y, z = (np.linalg.inv(camera.pose) @ [*point, 1])[:3]
    (fx, s, cx), (_, fy, cy), _ = camera.intrinsics
    assert z < 0
    return (fx * x - s * y) / -z + cx, cy - fy * y / -z


def test_camera_looks_at_its_target():
    camera = Camera(eye=(1, 2, 3), target=(-1, 0, 2), fov=60, size=(641, 479))
    assert np.allclose(project(camera, camera.target), (320.5, 239.5))
    assert np.allclose(camera.pose[:3, :3].T @ camera.pose[:3, :3], np.eye(3))
    assert np.linalg.det(camera.pose[:3, :3]) > 0 and np.array_equal(camera.pose[:3, 3], camera.eye)
    assert project(camera, camera.target + (0, 0.1, 0))[1] < 239.5  # up is towards row 0
    right = camera.pose[:3, 0]
    assert project(camera, camera.target + 0.1 * right)[0] > 320.5
    top = camera.pose @ [0, math.tan(math.radians(30)), -1, 1]  # on the upper border of the picture
    assert abs(project(camera, top[:3])[1]) < 1e-9


def test_calibrated_camera():
    usual = Camera(eye=(1, 2, 3))
    k = [[500, 2, 310.5], [0, 510, 250.5], [0, 0, 1]]
    camera = Camera.calibrated(usual.pose, k, (640, 480))
    assert np.allclose(camera.pose, usual.pose) and np.array_equal(camera.intrinsics, k)
    assert camera.size == (640, 480) and not camera.pose.flags.writeable
    assert Scene(square(), camera=camera).camera is camera
    mirrored, stretched, shifted = usual.pose.copy(), usual.pose.copy(), usual.pose.copy()
    mirrored[:3, 0] *= -1
    stretched[:3, 0] *= 1.001
    shifted[3, 0] = 1
    for pose in (mirrored, stretched, shifted, usual.pose[:3], np.full((4, 4), np.nan)):
        with pytest.raises(Error, match="Camera.calibrated pose"):
            Camera.calibrated(pose, k, (640, 480))
    for bad in (np.eye(4), [[0, 0, 1], [0, 1, 1], [0, 0, 1]], [[1, 0, 0], [1, 1, 0], [0, 0, 1]]):
        with pytest.raises(Error, match="Camera.calibrated intrinsics"):
            Camera.calibrated(usual.pose, bad, (640, 480))
    with pytest.raises(Error, match="Camera.size"):
        Camera.calibrated(usual.pose, k, (640, 0))


@pytest.mark.parametrize("size", [(640, 480), (100, 400), (641, 479)])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("direction", [(0.45, 0.3, 1.0), (0, 1, 0), (0, -1, 0)])
def test_frame_holds_all(size, scale, direction):
    mesh = Mesh(TENT * scale, faces=TENT_FACES)
    fur = Strands(types=HairType(segments=10, segment_length=0.1 * scale, width=0, curl=(0.2 * scale, 3)))
    camera = frame(mesh, fur, size, 50, direction)
    tips = (mesh.positions[:, None] + 1.2 * scale * np.vstack([np.eye(3), -np.eye(3)])).reshape(-1, 3)
    places = np.array([project(camera, tip) for tip in tips])
    assert (places >= 0).all() and (places <= size).all()
    assert np.ptp(places, axis=0).max() > 0.3 * min(size)  # and not too far away
    bald = frame(mesh, None, size, 50, direction)
    assert np.linalg.norm(bald.eye - bald.target) < np.linalg.norm(camera.eye - camera.target)


def test_frame_holds_curves():
    points = np.random.default_rng(0).normal(size=(50, 4, 3)) * (1, 5, 1) + 100
    scene = Scene(fur=Curves(points))
    places = np.array([project(scene.camera, point) for point in points.reshape(-1, 3)])
    assert (places >= 0).all() and (places <= scene.camera.size).all()


def test_light_is_normalised():
    light = Light(direction=(0, -3e-30, 4e-30))
    assert np.allclose(light.direction, (0, -0.6, 0.8))


def test_objects_are_frozen():
    scene = Scene(square(), Strands())
    for thing, name in [(scene, "mesh"), (scene.mesh, "faces"), (scene.fur, "seed"), (scene.light, "color")]:
        with pytest.raises(AttributeError):
            setattr(thing, name, None)
    with pytest.raises(ValueError, match="read-only"):
        scene.mesh.positions[0] = 1
    assert Scene(square(), Strands(), body_color=None).body_color is None
