"""Strand files: what is written is read again, and what others write is read as its format says."""

import struct
import time

import numpy as np
import pytest

import clfur

SHAPES = np.array([3, 5, 2, 4])


@pytest.fixture
def strands():
    rng = np.random.default_rng(3)
    total = int(SHAPES.sum())
    return clfur.Curves(rng.normal(size=(total, 3)), SHAPES, width=rng.uniform(.01, .02, total),
                        color=rng.uniform(0, 1, (total, 3)), alpha=.25, root_uv=rng.uniform(0, 1, (4, 2)))


def again(tmp_path, name, strands, **options):
    clfur.save_curves(tmp_path / name, strands)
    return clfur.load_curves(tmp_path / name, **options)


WHOLE = [".hair", ".npz", ".ply", ".usda", ".usdc"]


@pytest.mark.parametrize("suffix", WHOLE)
def test_a_round_trip_keeps_every_bit(tmp_path, strands, suffix):
    if suffix.startswith(".usd"):
        pytest.importorskip("pxr")
    back = again(tmp_path, f"a{suffix}", strands)
    for name in "points", "counts", "width", "color":
        assert np.array_equal(getattr(back, name), getattr(strands, name)), name
    if suffix != ".ply":   # which has no place for it
        assert back.alpha == pytest.approx(.25, abs=1e-7)
    if suffix == ".npz":
        assert np.array_equal(back.root_uv, strands.root_uv)


@pytest.mark.parametrize("suffix", [*WHOLE, ".npy", ".tfx", ".data"])
def test_one_width_and_colour_and_strands_that_are_alike(tmp_path, suffix):
    if suffix.startswith(".usd"):
        pytest.importorskip("pxr")
    points = np.random.default_rng(4).normal(size=(6, 4, 3)).astype(np.float32)
    given = clfur.Curves(points, width=.125, color=(.25, .5, .75))
    back = again(tmp_path, f"a{suffix}", given, width=.125)
    assert np.array_equal(back.points, given.points) and np.array_equal(back.counts, given.counts)
    assert (back.width == .125).all()
    assert suffix in (".npy", ".data") or (back.color == [.25, .5, .75]).all()


def test_the_same_picture_from_a_file(tmp_path):
    scene = clfur.Scene(mesh=clfur.load_mesh("sphere"), fur=clfur.Strands(
        types=[clfur.HairType(width=.01)], inner=1, outer=1), camera=clfur.Camera(eye=(0, 0, 4), size=(48, 48)))
    grown = clfur.grow(scene)
    first = clfur.render(clfur.Scene(mesh=scene.mesh, fur=grown, camera=scene.camera))
    back = again(tmp_path, "grown.npz", grown)
    assert back.width.shape == grown.width.shape   # per strand, as they are the same along each
    there = clfur.render(clfur.Scene(mesh=scene.mesh, fur=back, camera=scene.camera))
    assert np.array_equal(first, there)


def test_tressfx_adds_points_on_segments(tmp_path, strands):
    back = again(tmp_path, "a.tfx", strands)
    assert (back.counts == 8).all() and np.allclose(back.root_uv, strands.root_uv, rtol=0, atol=2**-24)   # 1 - v
    ends = np.cumsum(SHAPES)
    for number, (first, end) in enumerate(zip(ends - SHAPES, ends, strict=True)):
        there, line = back.points[8 * number:8 * number + 8], strands.points[first:end]
        apart = np.linalg.norm(there[:, None] - line, axis=2)
        assert (apart.min(axis=0) == 0).all()   # all of the strand's own are there, in order
        assert (np.diff(apart.argmin(axis=0)) > 0).all()
        length = np.linalg.norm(np.diff(there, axis=0), axis=1).sum()
        assert length == pytest.approx(np.linalg.norm(np.diff(line, axis=0), axis=1).sum(), rel=1e-6)
    assert np.array_equal(back.width, strands.width[ends - SHAPES])   # one a strand: its root's


@pytest.mark.parametrize("transparency, alphas", [(None, .5), (np.full(14, .25), .25)])
def test_hair_defaults_and_arrays(tmp_path, transparency, alphas):
    points = np.random.default_rng(5).normal(size=(14, 3)).astype("<f4")
    arrays = 2 | 1 | (0 if transparency is None else 8)
    data = struct.pack("<4s4I5f88s", b"HAIR", 4, 14, arrays, 9, .03, .5, .1, .2, .3, b"by hand")
    data += (SHAPES - 1).astype("<u2").tobytes() + points.tobytes()
    data += b"" if transparency is None else transparency.astype("<f4").tobytes()
    (tmp_path / "a.hair").write_bytes(data)
    back = clfur.load_curves(tmp_path / "a.hair")
    assert np.array_equal(back.points, points) and np.array_equal(back.counts, SHAPES)
    assert back.width == np.float32(.03) and np.array_equal(back.color, np.float32([[.1, .2, .3]]))
    assert back.alpha == alphas


def test_transparency_of_each_strand_becomes_types(tmp_path):
    kinds = [clfur.HairType(alpha=value) for value in (.2, .6)]
    given = clfur.Curves(np.arange(27.).reshape(3, 3, 3), types=kinds, type_of=[1, 0, 1], width=.1)
    back = again(tmp_path, "a.hair", given)
    assert [round(back.hair_types[k].alpha, 2) for k in back.type_of] == [.6, .2, .6]


def test_usc_has_roots_without_hair(tmp_path):
    points = np.arange(9, dtype="<f4").reshape(3, 3)
    data = struct.pack("<ii", 2, 1) + points[:1].tobytes() + struct.pack("<i", 2) + points[1:].tobytes()
    (tmp_path / "a.data").write_bytes(data)
    back = clfur.load_curves(tmp_path / "a.data")
    assert back.counts.tolist() == [1, 2] and np.array_equal(back.points, points)
    clfur.save_curves(tmp_path / "b.data", back)
    assert (tmp_path / "b.data").read_bytes() == data


@pytest.mark.parametrize("element", ["strand", "lines", "edge"])
def test_ply_by_hand(tmp_path, element):
    head = """ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z
property float radius\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"""
    rows = "0 0 0 .1 0 0 0\n1 0 0 .2 255 0 0\n2 0 0 .3 255 255 0\n0 1 0 .4 0 0 0\n1 1 0 .5 0 0 255\n"
    if element == "edge":
        head += "element edge 3\nproperty int vertex1\nproperty int vertex2\nend_header\n"
        rows += "1 2\n3 4\n0 1\n"   # in any order
    else:
        head += f"element {element} 2\nproperty list uchar int vertex_indices\nend_header\n"
        rows += "3 0 1 2\n2 3 4\n"
    (tmp_path / "a.ply").write_text(head + rows)
    back = clfur.load_curves(tmp_path / "a.ply")
    assert back.counts.tolist() == [3, 2] and back.points[:, 0].tolist() == [0, 1, 2, 0, 1]
    assert back.width == pytest.approx([.2, .4, .6, .8, 1])   # diameters
    assert back.color[2].tolist() == [1, 1, 0]


def test_ply_with_segments_of_strands(tmp_path):
    """As hairutil writes them, edges beside."""
    head = ("ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
            "element strand 2\nproperty ushort nsegs\nelement edge 3\nproperty int vertex1\nproperty int vertex2\n"
            "end_header\n")
    rows = "0 0 0\n1 0 0\n2 0 0\n0 1 0\n1 1 0\n{}\n1\n0 1\n1 2\n3 4\n"
    (tmp_path / "a.ply").write_text(head + rows.format(2))
    back = clfur.load_curves(tmp_path / "a.ply")
    assert back.counts.tolist() == [3, 2] and back.points[:, 0].tolist() == [0, 1, 2, 0, 1]
    (tmp_path / "a.ply").write_text(head + rows.format(3))
    with pytest.raises(clfur.Error, match="has 5 vertices, but its strands have 6"):
        clfur.load_curves(tmp_path / "a.ply")


def test_mitsuba_has_radii_and_pbrt_diameters(tmp_path):
    given = clfur.Curves([[[0, 0, 0], [0, 0, 3.]]], width=.5, color=(1, .5, .25))
    clfur.save_curves(tmp_path / "a.txt", given)
    assert (tmp_path / "a.txt").read_text() == "0.0 0.0 0.0 0.25\n0.0 0.0 3.0 0.25\n"
    clfur.save_curves(tmp_path / "a.pbrt", given)
    text = (tmp_path / "a.pbrt").read_text()
    assert "[ 0.0 0.0 0.0 0.0 0.0 1.0 0.0 0.0 2.0 0.0 0.0 3.0 ]" in text and '"float width1" 0.5' in text
    assert '"rgb reflectance" [ 1.0 0.5 0.25 ]' in text


def test_far_from_the_origin(tmp_path, strands):
    far = clfur.Curves(strands.points.astype(np.float64) + (431250, 55, 5411800), SHAPES, width=strands.width)
    for suffix in ".npz", ".ply", ".usdc":
        if suffix == ".usdc":
            pytest.importorskip("pxr")
        back = again(tmp_path, f"a{suffix}", far)
        places = back.points.astype(np.float64) + back.origin
        assert np.abs(places - (far.points.astype(np.float64) + far.origin)).max() < 1e-6, suffix


# --- files that are wrong -------------------------------------------------------------------------------------


def _hair(hairs, points, arrays=3, segments=1, body=b""):
    return struct.pack("<4s4I5f88s", b"HAIR", hairs, points, arrays, segments, 1, 0, 1, 1, 1, b"") + body


WRONG = {
    "short.hair": (b"HAIR", "128 bytes of header from byte 0 on, but it has 4"),
    "other.hair": (b"hare" + bytes(140), "does not begin with HAIR"),
    "lies.hair": (_hair(10**9, 2 * 10**9), "2000000000 bytes of segments"),
    "even.hair": (_hair(10**9, 2 * 10**9, 2), "24000000000 bytes of points"),
    "sum.hair": (_hair(2, 5, 3, 1, struct.pack("<2H", 1, 1) + bytes(60)), "states 5 points, but its 2 hairs have 4"),
    "none.hair": (_hair(0, 0), "has no strands"),
    "nan.hair": (_hair(1, 2, 2, 1, struct.pack("<6f", 0, 0, 0, 0, float("nan"), 0)), "points"),
    "clear.hair": (_hair(1, 2, 10, 1, struct.pack("<8f", 0, 0, 0, 0, 1, 0, 0, 2)), "transparencies of 0 to 2"),
    "old.tfx": (struct.pack("<f7I128x", 3, 1, 4, 160, 0, 0, 0, 0) + bytes(64), "TressFX version 3"),
    "lies.tfx": (struct.pack("<f7I128x", 4, 2**31, 64, 160, 0, 0, 0, 0) + bytes(64), "damaged or cut short"),
    "uv.tfx": (struct.pack("<f7I128x", 4, 1, 4, 160, 9000, 0, 0, 0) + bytes(64), "8 bytes of uv of strands"),
    "lies.data": (struct.pack("<i", 10**9), "states 1000000000 strands"),
    "strand.data": (struct.pack("<iii", 1, 10**9, 0), "strand 0 of 1 states 1000000000 points"),
    "more.data": (struct.pack("<ii3fi", 1, 1, 0, 0, 0, 0), "4 bytes more"),
    "mesh.ply": (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
                 b"end_header\n0 0 0\n", "has no strands"),
    "circle.ply": (b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
                   b"element edge 2\nproperty int vertex1\nproperty int vertex2\nend_header\n0 0 0\n1 0 0\n0 1\n1 0\n",
                   "run in a circle"),
    "far.ply": (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
                b"element strand 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 1\n",
                "has the index 1; allowed: 0 to 0"),
    "text.npz": (b"hello", "damaged or cut short"),
    "text.npy": (b"hello", "damaged or cut short"),
    "empty.hair": (b"", "is empty"),
    "hair.abc": (b"Ogawa", "no strand file; allowed: .hair, "),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_is_one_line(tmp_path, name):
    data, says = WRONG[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(clfur.Error, match=says) as error:
        clfur.load_curves(tmp_path / name)
    assert "\n" not in str(error.value) and str(error.value).startswith(str(tmp_path / name))


def test_npy_that_claims_more_than_it_has(tmp_path):
    header = repr({"descr": "<f4", "fortran_order": False, "shape": (10**9, 100, 3)}).ljust(117).encode() + b"\n"
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    with pytest.raises(clfur.Error, match="takes 1200000000000 bytes, but it has 0"):
        clfur.load_curves(tmp_path / "a.npy")
    np.save(tmp_path / "b.npy", np.array([[[None]]]), allow_pickle=True)
    with pytest.raises(clfur.Error, match="Python objects"):
        clfur.load_curves(tmp_path / "b.npy")


@pytest.mark.parametrize("suffix", [".hair", ".tfx", ".data", ".ply", ".npz"])
def test_a_file_cut_anywhere_is_one_line(tmp_path, strands, suffix):
    clfur.save_curves(tmp_path / f"a{suffix}", strands)
    data = (tmp_path / f"a{suffix}").read_bytes()
    for size in [*range(0, len(data) - 8, max(1, len(data) // 40)), len(data) - 9]:   # .tfx is padded by up to 8
        (tmp_path / f"b{suffix}").write_bytes(data[:size])
        with pytest.raises(clfur.Error) as error:
            clfur.load_curves(tmp_path / f"b{suffix}")
        assert "\n" not in str(error.value)


def test_what_a_format_cannot_hold(tmp_path, strands):
    with pytest.raises(clfur.Error, match=r"a\.npy: strands have 2 to 5 points; allowed in .npy: as many each"):
        clfur.save_curves(tmp_path / "a.npy", strands)
    with pytest.raises(clfur.Error, match=r"allowed in .tfx: 2 to 64"):
        clfur.save_curves(tmp_path / "a.tfx", clfur.Curves(np.zeros((1, 65, 3)) + np.arange(65)[:, None]))
    with pytest.raises(clfur.Error, match="save_curves curves is"):
        clfur.save_curves(tmp_path / "a.hair", "hair")
    with pytest.raises(clfur.Error, match=r"\.abc is not supported; allowed: \.hair, "):
        clfur.save_curves(tmp_path / "a.abc", strands)
    assert not list(tmp_path.iterdir())


# --- what is easily mistaken ----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".hair", ".ply", ".npz", ".usda", ".data", ".txt"])
def test_strands_without_points_are_left_out(tmp_path, suffix):
    """Also where there are as many points as strands, and each strand has a width: it stays with its own."""
    if suffix == ".usda":
        pytest.importorskip("pxr")
    given = clfur.Curves(np.arange(12.).reshape(4, 3), [1, 2, 1, 0], width=np.array([[.02], [.04], [.06], [.08]]),
                         root_uv=np.arange(8).reshape(4, 2))
    if suffix == ".txt":
        clfur.save_curves(tmp_path / "a.txt", given)
        rows = [line.split() for line in (tmp_path / "a.txt").read_text().splitlines() if line]
        assert [float(row[3]) for row in rows] == pytest.approx([.02, .02])   # nor with one: Mitsuba refuses a file
        with pytest.raises(clfur.Error, match=r"a\.txt: strands have one point each; allowed in .txt: some of two"):
            clfur.save_curves(tmp_path / "a.txt", clfur.Curves(np.zeros((3, 1, 3))))
        return
    back = again(tmp_path, f"a{suffix}", given, width=.5)
    assert back.counts.tolist() == [1, 2, 1] and np.array_equal(back.points, given.points)
    if suffix != ".data":
        assert back.width == pytest.approx([.02, .04, .06])
    if suffix == ".npz":
        assert back.root_uv.tolist() == [[0, 1], [2, 3], [4, 5]]


@pytest.mark.parametrize("kind, value, light", [
    ("uchar", 255, 1), ("int", 255, 1), ("ushort", 65535, 1), ("short", 255, 1), ("float", 2.5, 2.5)])
def test_whole_numbers_of_colours_are_srgb(tmp_path, kind, value, light):
    (tmp_path / "a.ply").write_text(PLY_OF_ONE.format(kind=kind, value=value))
    assert clfur.load_curves(tmp_path / "a.ply").color == pytest.approx(np.full((1, 3), light))


@pytest.mark.parametrize("kind, value, says", [
    ("uchar", 300, "has red 300 of vertex, which is stated to be a whole number"), ("uchar", -1, "has red -1"),
    ("int", .5, "has red 0.5"), ("int", 256, "has colours of 256 to 256; allowed for whole numbers: 0 to 255")])
def test_whole_numbers_that_are_none(tmp_path, kind, value, says):
    (tmp_path / "a.ply").write_text(PLY_OF_ONE.format(kind=kind, value=value))
    with pytest.raises(clfur.Error, match=says):
        clfur.load_curves(tmp_path / "a.ply")


PLY_OF_ONE = """ply
format ascii 1.0
element vertex 2
property float x
property float y
property float z
property {kind} red
property {kind} green
property {kind} blue
element strand 1
property list uchar int vertex_indices
end_header
0 0 0 {value} {value} {value}
0 0 1 {value} {value} {value}
2 0 1
"""


def test_no_strands_at_all(tmp_path):
    none = clfur.Curves(np.zeros((0, 3, 3)))
    for suffix in ".hair", ".npy", ".npz", ".data", ".tfx", ".ply":
        with pytest.raises(clfur.Error, match=f"a{suffix}: Curves have no strands with points; allowed: one or more"):
            clfur.save_curves(tmp_path / f"a{suffix}", none)
    assert not list(tmp_path.iterdir())


def test_a_claim_of_a_header_alone_costs_no_time(tmp_path):
    (tmp_path / "a.hair").write_bytes(_hair(2**32 - 1, 2**32 - 1, 2, 0))
    start = time.process_time()
    with pytest.raises(clfur.Error, match="51539607540 bytes of points"):
        clfur.load_curves(tmp_path / "a.hair")
    assert time.process_time() - start < .5   # 4 s where its hairs were counted one by one
