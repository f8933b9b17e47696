"""Outputs in files and back: EXR as the format's own library reads it, Cryptomatte as its specification does."""

import json
import struct

import numpy as np
import OpenEXR
import pytest

import clfur
from clfur.errors import Error
from clfur.files import exr, matte
from clfur.render import OUTPUTS

HEIGHT, WIDTH, TYPES = 21, 13, 11


@pytest.fixture
def outputs():
    """What a render gives, made up: each of its names, shapes and dtypes."""
    rng = np.random.default_rng(3)
    shares = -np.sort(-rng.random((HEIGHT, WIDTH, 6), np.float32) / 6, axis=2)
    shares[rng.random(shares.shape) < .3] = 0
    ids = rng.integers(0, 200_000, shares.shape).astype(np.int32)
    ids[::3, ::2, 0], ids[5, :, 1], ids[6, :, 1] = -2, -4, -3
    ids[:, :, 3] = np.arange(WIDTH) + 300_000   # no strand twice in a pixel
    widths = {"tangent": 3, "normal": 3, "uv": 2, "position": 3, "orientation": 2, "type_alpha": TYPES, "color": 4}
    made = {name: rng.random((HEIGHT, WIDTH, widths.get(name, 1)), np.float32) for name in OUTPUTS
            if name != "strand_area"}
    made = {name: array if name in widths else array[..., 0] for name, array in made.items()}
    made["depth"][0] = np.inf
    for name, end in ("id", 2**31), ("type", TYPES):
        made[name] = rng.integers(-4, end, (HEIGHT, WIDTH)).astype(np.int32)
    return made | {"matte_id": np.where(shares > 0, ids, -1).astype(np.int32), "matte_alpha": shares}


def same(one, other):
    assert one.keys() == other.keys()
    for name, array in one.items():
        assert array.dtype == other[name].dtype and array.shape == other[name].shape, name
        np.testing.assert_array_equal(array, other[name], err_msg=name)


@pytest.mark.parametrize("suffix", [".exr", ".npz"])
def test_what_is_saved_is_loaded(tmp_path, outputs, suffix):
    clfur.save(tmp_path / f"a{suffix}", outputs)
    same(clfur.load(tmp_path / f"a{suffix}"), outputs)
    for name, array in outputs.items():   # each alone, in a file of one part
        if not name.startswith("matte"):
            clfur.save(tmp_path / f"b{suffix}", {name: array})
            same(clfur.load(tmp_path / f"b{suffix}"), {name: array})


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint32, np.int64, np.float16, np.float64, bool])
@pytest.mark.parametrize("size", [(1, 1), (16, 3), (17, 300)])
def test_arrays_of_ones_own(tmp_path, dtype, size):
    """Of any name and dtype; those that are not contiguous, too."""
    array = (np.random.default_rng(1).random(size[::-1]) * 99).astype(dtype).T
    if dtype in (np.uint32, np.int64):
        array = array * dtype(40_000_000 if dtype is np.uint32 else -20_000_000)   # beyond floats
    if dtype is np.float64:
        array = array.astype(np.float32).astype(np.float64)   # which is what EXR keeps
    for suffix in ".exr", ".npz":
        clfur.save(tmp_path / f"a{suffix}", {"mine.of_this": array})
        same(clfur.load(tmp_path / f"a{suffix}"), {"mine.of_this": array})


def test_a_png_is_its_picture(tmp_path):
    """To half a code of 8 bits; saved once more it is the same file."""
    color = np.random.default_rng(1).random((9, 7, 4), np.float32)
    color[..., :3] *= color[..., 3:]
    color[0] = 0
    clfur.save(tmp_path / "a.png", color)
    loaded = clfur.load(tmp_path / "a.png")["color"]
    assert loaded.dtype == np.float32 and np.abs(loaded - color).max() < .006
    clfur.save(tmp_path / "b.png", loaded)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_formats_library_reads_it(tmp_path, outputs):
    """Each output in a part of its name, colour in the first, which alone is told to be one; whole numbers whole."""
    clfur.save(tmp_path / "a.exr", outputs)
    parts = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).parts
    assert parts[0].name() == "color"
    assert [part.header["colorInteropID"] for part in parts] == ["lin_rec709_scene"] + ["data"] * (len(parts) - 1)
    found = {name: channel.pixels for part in parts for name, channel in part.channels.items()}
    wanted = {"R": outputs["color"][..., 0], "Z": outputs["depth"], "uv.V": outputs["uv"][..., 1],
              "orientation.X": outputs["orientation"][..., 0], "hair_alpha": outputs["hair_alpha"],
              "position.Z": outputs["position"][..., 2], "type_alpha.010": outputs["type_alpha"][..., 10]}
    for name, array in wanted.items():
        assert found[name].dtype == np.float32
        np.testing.assert_array_equal(found[name], array, err_msg=name)
    assert found["id"].dtype == np.uint32 and (found["id"].view(np.int32) == outputs["id"]).all()   # beyond floats
    assert found["type"].dtype == np.float32 and (found["type"] == outputs["type"]).all()


def test_another_programs_files_are_read(tmp_path, outputs):
    """Of the format's own library, with any of the compressions that are read, in halves, floats and whole numbers."""
    channels = {name: np.ascontiguousarray(outputs["color"][..., k]) for k, name in enumerate("RGBA")}
    channels |= {"Z": outputs["depth"], "part.x": outputs["coverage"].astype(np.float16),
                 "n": outputs["id"].view(np.uint32)}
    for kind in OpenEXR.ZIP_COMPRESSION, OpenEXR.ZIPS_COMPRESSION, OpenEXR.NO_COMPRESSION:
        header = {"compression": kind, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, channels) as file:
            file.write(str(tmp_path / "a.exr"))
        found = clfur.load(tmp_path / "a.exr")
        same(found, {"color": outputs["color"], "depth": outputs["depth"], "n": outputs["id"].view(np.uint32),
                     "part.x": outputs["coverage"].astype(np.float16).astype(np.float32)})
    with OpenEXR.File({"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(tmp_path / "b.exr"))
    with pytest.raises(Error, match=r"b.exr: is EXR of another kind or compression; allowed: .*ZIP"):
        clfur.load(tmp_path / "b.exr")


def test_the_header_tells_of_camera_and_settings(tmp_path, outputs):
    camera = clfur.Camera((1, 2, 3), (0, .5, 0), fov=37.5, size=(WIDTH, HEIGHT))
    settings = clfur.Settings(samples=16, masks=4)
    clfur.save(tmp_path / "a.exr", outputs, camera, settings)
    found = clfur.load_header(tmp_path / "a.exr")
    np.testing.assert_allclose(found["camera"].pose, camera.pose, atol=1e-15)   # its rotation is made a rotation again
    np.testing.assert_array_equal(found["camera"].intrinsics, camera.intrinsics)
    assert found["camera"].size == camera.size and clfur.Settings(**found["settings"]) == settings
    assert found["software"].startswith("clfur")
    to_camera = OpenEXR.File(str(tmp_path / "a.exr")).header()["worldToCamera"]
    np.testing.assert_allclose([0, .5, 0, 1] @ to_camera, [0, 0, np.sqrt(1 + 1.5**2 + 9), 1], atol=1e-6)   # before it
    clfur.save(tmp_path / "b.exr", outputs)
    assert clfur.load_header(tmp_path / "b.exr")["camera"] is None
    for wrong in {"camera": 3}, {"settings": 3}:
        with pytest.raises(Error, match=f"save {next(iter(wrong))} is 3"):
            clfur.save(tmp_path / "c.exr", outputs, **wrong)


# --- Cryptomatte, read by its specification alone -------------------------------------------------------------------


def murmur3(text):
    """MurmurHash3_x86_32, seed 0, byte by byte."""
    state, end, data = 0, len(text) & ~3, text.encode()
    for at in range(0, len(data), 4):
        word = int.from_bytes(data[at:at + 4], "little") * 0xCC9E2D51 & 0xFFFFFFFF
        word = (word << 15 | word >> 17) * 0x1B873593 & 0xFFFFFFFF
        state ^= word
        if at < end:
            state = ((state << 13 | state >> 19) & 0xFFFFFFFF) * 5 + 0xE6546B64 & 0xFFFFFFFF
    state ^= len(data)
    state = (state ^ state >> 16) * 0x85EBCA6B & 0xFFFFFFFF
    state = (state ^ state >> 13) * 0xC2B2AE35 & 0xFFFFFFFF
    return state ^ state >> 16


def cryptomattes(path):
    """{layer: {name: [h, w]}} of a file: section 4 of the specification."""
    found = {}
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for key, layer in part.header.items():
            if not (key.startswith("cryptomatte/") and key.endswith("/name")):
                continue
            start = key.removesuffix("name")
            assert key == f"cryptomatte/{murmur3(layer):08x}"[:19] + "/name"
            assert part.header[start + "hash"] == "MurmurHash3_32"
            assert part.header[start + "conversion"] == "uint32_to_float32"
            names = sorted(name for name in part.channels if name[:len(layer)] == layer and name.endswith(".R"))
            ranks = []
            for name in names:
                r, g, b, a = (part.channels[name[:-1] + each].pixels for each in "RGBA")
                ranks += [(r, g), (b, a)]
            objects = {}
            for name, code in json.loads(part.header[start + "manifest"]).items():
                wanted, = struct.unpack("<f", struct.pack("<I", int(code, 16)))
                objects[name] = sum(np.where(ids == np.float32(wanted), share, 0) for ids, share in ranks)
            found[layer] = objects
    return found


def test_hashes_are_murmurs():
    """Known values of the function's author's verification, and the byte by byte one's for names of all lengths."""
    assert matte.murmur3([b"", b"hello", b"Hello, world!"]).tolist() == [0, 0x248BFA47, 0xC0363E43]
    names = ["", "a", "ab", "abc", "abcd", "bödy", *(f"strand_{10**k + 7}" for k in range(9))]
    assert matte.murmur3([name.encode() for name in names]).tolist() == [
        murmur3(name) if name.isascii() else murmur3_of(name) for name in names]
    coded = matte.hashes_of([f"strand_{k}" for k in range(20_000)])
    exponents = coded >> np.uint32(23) & np.uint32(255)
    assert exponents.min() > 0 and exponents.max() < 255 and np.isfinite(coded.view(np.float32)).all()


def murmur3_of(text):
    return murmur3("".join(map(chr, text.encode()))) if text.isascii() else int(matte.murmur3([text.encode()])[0])


def test_a_cryptomatte_is_read_by_its_specification(tmp_path, outputs):
    """Each strand's mask is the shares that were told of it; so is the body's; and the types', of the six most."""
    outputs["type_alpha"][..., 4:] = 0
    clfur.save(tmp_path / "a.exr", outputs)
    found = cryptomattes(tmp_path / "a.exr")
    ids, shares = outputs["matte_id"], outputs["matte_alpha"]
    names = {-2: "body", -3: "shells", -4: "ground"}
    seen = np.unique(ids[shares > 0]).tolist()
    assert set(found["CryptoStrand"]) == {names.get(k, f"strand_{k}") for k in seen}
    for k in seen:
        np.testing.assert_array_equal(found["CryptoStrand"][names.get(k, f"strand_{k}")],
                                      np.where(ids == k, shares, 0).sum(2, dtype=np.float32))
    assert set(found["CryptoType"]) == {"body", "type_0", "type_1", "type_2", "type_3"}
    np.testing.assert_array_equal(found["CryptoType"]["type_2"], outputs["type_alpha"][..., 2])
    np.testing.assert_array_equal(found["CryptoType"]["body"], outputs["body_alpha"])


def test_two_names_of_one_hash(tmp_path, monkeypatch):
    """The later one gets another name, so that both are told apart."""
    plain = matte.murmur3
    monkeypatch.setattr(matte, "murmur3", lambda names: np.where(
        np.isin(names, [b"strand_1", b"strand_2"]), np.uint32(0x40400000), plain(names)))
    wanted = {"matte_id": np.int32([[[1, 2]]]), "matte_alpha": np.float32([[[.5, .25]]])}
    clfur.save(tmp_path / "a.exr", wanted)
    same(clfur.load(tmp_path / "a.exr"), wanted)


# --- damaged files --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".exr", ".npz", ".png"])
def test_files_that_are_cut_short(tmp_path, outputs, suffix, capfd):
    clfur.save(tmp_path / f"a{suffix}", outputs)
    data = (tmp_path / f"a{suffix}").read_bytes()
    end = len(data) - 21 * (suffix == ".png")   # PNG ends with so many bytes behind its pixels
    for length in sorted({0, 3, 8, *range(9, end, end // 150), end - 1}):
        (tmp_path / f"cut{suffix}").write_bytes(data[:length])
        with pytest.raises(Error, match=f"cut{suffix}: ") as caught:
            clfur.load(tmp_path / f"cut{suffix}")
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".exr", ".npz"])
def test_files_with_wrong_bytes(tmp_path, outputs, suffix):
    """Anything is an Error of one line, or arrays; none takes more memory than the file may hold."""
    clfur.save(tmp_path / f"a{suffix}", {name: outputs[name] for name in ("color", "id", "matte_id", "matte_alpha")})
    data, rng = (tmp_path / f"a{suffix}").read_bytes(), np.random.default_rng(1)
    for _ in range(300):
        wrong = bytearray(data)
        for at in rng.integers(0, min(len(data), 3000), rng.integers(1, 4)):
            wrong[at] = rng.integers(256)
        (tmp_path / f"b{suffix}").write_bytes(wrong)
        try:
            clfur.load(tmp_path / f"b{suffix}")
        except Error as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize("attribute, claims", [
    ("dataWindow", (0, 0, 2**30, 5)), ("dataWindow", (0, 0, 2**31 - 1, 2**31 - 1)), ("both", (0, 0, 29_999, 29_999)),
    ("both", (0, 0, -5, 3))])
def test_sizes_that_lie(tmp_path, attribute, claims):
    clfur.save(tmp_path / "a.exr", {"depth": np.zeros((4, 4), np.float32)})
    data = bytearray((tmp_path / "a.exr").read_bytes())
    for name in [attribute] if attribute != "both" else ["dataWindow", "displayWindow"]:
        at = data.index(name.encode() + b"\0box2i\0") + len(name) + 11
        data[at:at + 16] = struct.pack("<4i", *claims)
    (tmp_path / "a.exr").write_bytes(data)
    with pytest.raises(Error, match="a.exr: is EXR that"):
        clfur.load(tmp_path / "a.exr")


def test_what_is_refused(tmp_path, outputs):
    for given, words in (({"strand_area": np.zeros(9, np.float32)}, r"\[9\]; allowed: in .npz"),
                         ({"matte_id": outputs["matte_id"]}, "one of matte_id and matte_alpha"),
                         ({"a": np.int64([[2**40]])}, "whole numbers from"),
                         ({"orientation": outputs["depth"]}, "'orientation'"),
                         ({"a": np.zeros((0, 3), np.float32)}, r"\[0, 3\]")):
        with pytest.raises(Error, match=words):
            clfur.save(tmp_path / "a.exr", given)
    for path in tmp_path / "gone.exr", tmp_path, tmp_path / "a.tif", 3, tmp_path / "a.exr":
        with pytest.raises(Error):
            clfur.load(path)
    (tmp_path / "a.exr").write_bytes(b"hello")
    with pytest.raises(Error, match="a.exr: is no EXR file"):
        clfur.load(tmp_path / "a.exr")
    assert exr.read   # its own errors do not name a file
