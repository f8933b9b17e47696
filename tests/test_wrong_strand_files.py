"""Strand files that are wrong anywhere: one line, in little time, and no memory beyond what is there."""

import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

import clfur
from clfur.files.curves import WRITERS

READ = [".hair", ".tfx", ".data", ".ply", ".npz", ".npy", ".usda"]
ROOM = 4 << 20   # bytes that reading a file of a kilobyte may take: NumPy's own and usd-core's, and room for text


def small(suffix):
    """The bytes of a small file with all that its format has."""
    if suffix == ".usda":
        pytest.importorskip("pxr")
    rng = np.random.default_rng(5)
    counts = [3, 3] if suffix == ".npy" else [2, 3]
    total = sum(counts)
    curves = clfur.Curves(rng.normal(size=(total, 3)), counts, width=rng.uniform(.01, .02, total), color=rng.uniform(
        size=(total, 3)), types=[clfur.HairType(alpha=alpha) for alpha in (.2, .6)], type_of=[0, 1],
        root_uv=rng.uniform(size=(2, 2)))
    from clfur.files.curves import stored

    return WRITERS[suffix](stored(curves))


def outcome(path, data):
    """What reading bytes comes to: Curves, or the one line of an Error."""
    path.write_bytes(data)
    try:
        return clfur.load_curves(path)
    except clfur.Error as error:
        assert "\n" not in str(error) and str(error).startswith(f"{path}: "), error
        return str(error)


@pytest.mark.parametrize("suffix", READ)
def test_cut_at_every_byte(tmp_path, suffix):
    data = small(suffix)
    assert isinstance(outcome(tmp_path / f"a{suffix}", data), clfur.Curves)
    whole = 8 if suffix == ".tfx" else 2 if suffix == ".usda" else 0   # zeros, or ends of lines, that nothing needs
    for size in range(len(data) - whole):
        found = outcome(tmp_path / f"a{suffix}", data[:size])
        assert isinstance(found, str), f"{size} of {len(data)} bytes were enough"


@pytest.mark.parametrize("suffix", READ)
@pytest.mark.filterwarnings("error", "ignore:strands of a file have one point each")
def test_every_byte_wrong(tmp_path, suffix):
    """Each byte as another one: curves that are in order, or one line; and no claim takes memory."""
    data = bytearray(small(suffix))
    refused = 0
    tracemalloc.start()
    try:
        for at in range(len(data)):
            for value in (255,) if suffix == ".usda" else (0, 128):   # the sign, most of an exponent, more than a text
                was, data[at] = data[at], value
                tracemalloc.reset_peak()
                before = tracemalloc.get_traced_memory()[0]
                found = outcome(tmp_path / f"a{suffix}", data)
                assert tracemalloc.get_traced_memory()[1] - before < ROOM, (at, value)
                data[at] = was
                if isinstance(found, str):
                    refused += 1
                else:
                    assert np.isfinite(found.points).all() and int(found.counts.sum()) == len(found.points)
    finally:
        tracemalloc.stop()
    assert refused > 10   # its counts at least


def _npy(array, shape):
    header = repr({"descr": array.dtype.str, "fortran_order": False, "shape": shape}).ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + array.tobytes()


def _npz(**arrays):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in arrays.items():
            archive.writestr(f"{name}.npy", data)
    return file.getvalue()


def _ply(head, rows=b""):
    vertices = "".join(f"property float {each}\n" for each in "xyz")
    return (f"ply\nformat binary_little_endian 1.0\nelement vertex {head[0]}\n{vertices}element strand {head[1]}\n"
            f"property list {head[2]} int vertex_indices\nend_header\n").encode() + rows


NAN, MANY = float("nan"), 10**9
THREE = np.zeros((1, 1, 3), np.float32)
CLAIMS = {
    "strands.hair": struct.pack("<4s4I5f88s", b"HAIR", MANY, 2 * MANY, 3, 1, 1, 0, 1, 1, 1, b"") + bytes(64),
    "all.hair": struct.pack("<4s4I5f88s", b"HAIR", MANY, 2 * MANY, 31, 1, 1, 0, 1, 1, 1, b"") + bytes(64),
    "one.hair": struct.pack("<4s4I5f88s", b"HAIR", 1, 2**32 - 1, 2, 2**32 - 2, 1, 0, 1, 1, 1, b"") + bytes(64),
    "strands.tfx": struct.pack("<f7I128x", 4, MANY, 64, 160, 0, 0, 0, 0) + bytes(64),
    "points.tfx": struct.pack("<f7I128x", 4, 1, MANY, 160, 0, 0, 0, 0) + bytes(64),
    "far.tfx": struct.pack("<f7I128x", 4, 1, 4, 2**32 - 8, 0, 0, 0, 0) + bytes(64),
    "new.tfx": struct.pack("<f7I128x", 5, 1, 4, 160, 0, 0, 0, 0) + bytes(64),
    "nan.tfx": struct.pack("<f7I128x", NAN, 1, 4, 160, 0, 0, 0, 0) + bytes(64),
    "place.tfx": struct.pack("<f7I128x", 4, 1, 4, 160, 0, 0, 0, 0) + np.full(16, NAN, "<f4").tobytes(),
    "strands.data": struct.pack("<i", MANY) + bytes(64), "minus.data": struct.pack("<i", -1) + bytes(64),
    "points.data": struct.pack("<ii", 1, MANY) + bytes(64), "below.data": struct.pack("<ii", 1, -MANY) + bytes(64),
    "nan.data": struct.pack("<iifff", 1, 1, NAN, 0, 0),
    "vertices.ply": _ply((MANY, 1, "uint"), bytes(64)), "strands.ply": _ply((1, MANY, "uint"), bytes(64)),
    "list.ply": _ply((1, 1, "uint"), bytes(12) + struct.pack("<I", MANY)),
    "less.ply": _ply((1, 1, "int"), bytes(12) + struct.pack("<i", -1)),
    "version.ply": b"ply\nformat binary_little_endian 9.0\nend_header\n",
    "claim.npy": _npy(THREE, (MANY, 100, 3)), "object.npy": _npy(np.array([[[1]]], "M8[D]"), (1, 1, 1)),
    "nan.npy": _npy(np.full((1, 2, 3), NAN), (1, 2, 3)), "shape.npy": _npy(THREE, (1, 3)),
    "less.npy": _npy(THREE, (-1, -1, 3)),
    "claim.npz": _npz(points=_npy(THREE, (MANY, 100, 3))),
    "counts.npz": _npz(points=_npy(THREE[0], (1, 3)), counts=_npy(np.array([MANY]), (1,))),
    "minus.npz": _npz(points=_npy(THREE[0], (1, 3)), counts=_npy(np.array([-1, 2]), (2,))),
    "bomb.npz": _npz(points=_npy(np.zeros((2**22, 1, 3), "<f4"), (2**26, 1, 3))),   # 50 MB in 50 kB, told as 800
    "name.npz": _npz(points=_npy(THREE, (1, 1, 3)), lengths=_npy(THREE, (1, 1, 3))),
    "bounds.npz": _npz(points=_npy(np.zeros((1, 2, 3)), (1, 2, 3)), bounds=_npy(np.zeros(3), (3,))),
    "surface.npz": _npz(points=_npy(np.zeros((1, 2, 3)), (1, 2, 3)), surface=_npy(np.array("soft"), ())),
}


@pytest.mark.filterwarnings("error", "ignore:strands of a file have one point each")
@pytest.mark.parametrize("name", CLAIMS)
def test_what_a_header_claims(tmp_path, name):
    data = CLAIMS[name]
    tracemalloc.start()
    try:
        found = outcome(tmp_path / name, data)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert isinstance(found, str), found
    assert peak < ROOM + 64 * len(data)
