"""Pictures to files and back."""

import io
import os
import warnings

import imageio.v3
import numpy as np
import pytest
from PIL import Image
from support import picture_files

from clfur.color import linear_to_srgb, srgb_to_linear
from clfur.errors import Error
from clfur.files import exr
from clfur.files import images as pictures
from clfur.files.images import check_writable, load_picture, save
from clfur.scene import HairType, Strands

HEIGHT, WIDTH = 5, 7


@pytest.fixture
def outputs():
    """The outputs of a render: colour premultiplied."""
    random = np.random.default_rng(1)
    color = random.random((HEIGHT, WIDTH, 4), np.float32)
    color[..., :3] *= color[..., 3:]
    color[0, 0] = 0
    return {
        "color": color,
        "depth": np.where(color[..., 0] > 0.2, color[..., 1], np.inf).astype(np.float32),
        "id": random.integers(-2, 2**31, (HEIGHT, WIDTH)).astype(np.int32),
        "tangent": random.random((HEIGHT, WIDTH, 3), np.float32),
        "normal": random.random((HEIGHT, WIDTH, 3), np.float32),
        "uv": random.random((HEIGHT, WIDTH, 2), np.float32),
        "coverage": color[..., 3],
    }


def test_srgb():
    codes = np.arange(256, dtype=np.uint8)
    linear = srgb_to_linear(codes)
    assert np.array_equal(np.round(linear_to_srgb(linear) * 255), codes)
    assert np.allclose(srgb_to_linear(codes / 255), linear, atol=1e-7)
    # Known values of IEC 61966-2-1: both sides of the joint, and the code of half the light.
    assert np.allclose(linear_to_srgb([0, 0.001, 0.5, 1, -1, 2]), [0, 0.01292, 0.735357, 1, 0, 1], atol=1e-5)
    assert (np.diff(linear) > 0).all()


def test_png_is_straight_srgb(tmp_path, outputs):
    import imageio.v3

    for image in (outputs, outputs["color"]):
        save(tmp_path / "a.PNG", image)
        pixels = imageio.v3.imread(tmp_path / "a.PNG", extension=".png")
        assert pixels.shape == (HEIGHT, WIDTH, 4) and pixels.dtype == np.uint8
        color = outputs["color"].astype(float)
        alpha = color[..., 3:]
        straight = np.divide(color[..., :3], alpha, out=np.zeros((HEIGHT, WIDTH, 3)), where=alpha > 0)
        expected = np.concatenate([linear_to_srgb(straight), alpha], axis=2) * 255
        assert np.abs(pixels - expected).max() <= 0.51
        assert (pixels[0, 0] == 0).all()
    save(tmp_path / "b.png", np.float32([[[0.5, 0, 9]]]))
    assert load_picture(tmp_path / "b.png").tolist() == [[[188, 0, 255]]]
    save(tmp_path / "c.png", np.float32([[[np.nan, np.inf, -np.inf, 1]]]))
    assert load_picture(tmp_path / "c.png").tolist() == [[[0, 255, 0]]]


def test_exr_is_real_and_linear(tmp_path, outputs):
    import OpenEXR

    save(tmp_path / "a.exr", outputs)
    assert (tmp_path / "a.exr").read_bytes()[:4] == b"\x76\x2f\x31\x01"  # imageio would write TIFF here
    parts = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).parts
    assert {part.name() for part in parts} == set(outputs) and parts[0].name() == "color"
    channels = {name: channel for part in parts for name, channel in part.channels.items()}
    assert set(channels) == {"R", "G", "B", "A", "Z", "id", "coverage", "uv.U", "uv.V", "tangent.X",
                             "tangent.Y", "tangent.Z", "normal.X", "normal.Y", "normal.Z"}
    for k, name in enumerate("RGBA"):
        assert np.array_equal(channels[name].pixels, outputs["color"][..., k])
        assert channels[name].pixels.dtype == np.float32
    assert np.array_equal(channels["Z"].pixels, outputs["depth"])
    assert np.array_equal(channels["normal.Z"].pixels, outputs["normal"][..., 2])
    assert np.array_equal(channels["id"].pixels.astype(np.uint32).view(np.int32), outputs["id"])
    save(tmp_path / "b.exr", outputs["color"][..., :3])
    assert set(OpenEXR.File(str(tmp_path / "b.exr"), separate_channels=True).channels()) == {"R", "G", "B"}


def test_npz_holds_all(tmp_path, outputs):
    save(str(tmp_path / "a.npz"), outputs)
    with np.load(tmp_path / "a.npz") as stored:
        assert set(stored) == set(outputs)
        assert all(np.array_equal(stored[name], outputs[name]) for name in outputs)
    save(tmp_path / "b.npz", outputs["color"])
    with np.load(tmp_path / "b.npz") as stored:
        assert set(stored) == {"color"}


def test_nothing_is_left_behind(tmp_path, outputs, monkeypatch):
    (tmp_path / "folder.png").mkdir()
    before = sorted(os.listdir(tmp_path))
    color = outputs["color"]
    for path, image, words in [
        (tmp_path / "a.tif", color, "allowed: .png, .exr, .npz"),
        (tmp_path / "a", color, "no suffix"),
        (tmp_path / "none" / "a.png", color, "no folder"),
        (tmp_path / "folder.png", color, "is a folder"),
        (tmp_path / ("x" * 300 + ".png"), color, "cannot be written"),
        (3, color, "save path"),
        (tmp_path / "a.png", color[..., 0], "save color"),
        (tmp_path / "a.png", color[..., :2], "save color"),
        (tmp_path / "a.png", np.zeros((2, 2, 3), np.uint8), "save color"),
        (tmp_path / "a.png", np.zeros((0, 2, 3)), "save color"),
        (tmp_path / "a.png", {"depth": outputs["depth"]}, "'color'"),
        (tmp_path / "a.exr", {"uv": outputs["depth"]}, "'uv'"),
        (tmp_path / "a.exr", {"color": color, "depth": outputs["depth"][1:]}, "one size"),
    ]:
        with pytest.raises(Error, match=words) as caught:
            save(path, image)
        assert "\n" not in str(caught.value)
        assert sorted(os.listdir(tmp_path)) == before

    def fail(*_):
        raise OSError(28, "No space left on device")

    save(tmp_path / "old.png", color)
    old = (tmp_path / "old.png").read_bytes()
    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(Error, match="No space left"):
        save(tmp_path / "old.png", color * 0)
    assert (tmp_path / "old.png").read_bytes() == old and len(os.listdir(tmp_path)) == 2


def test_check_writable(tmp_path):
    check_writable(tmp_path / "a.png")
    assert not os.listdir(tmp_path)
    for name, words in [("a.jpg", "not supported"), ("none/a.png", "no folder"),
                        ("x" * 300 + ".exr", "cannot be written")]:
        with pytest.raises(Error, match=words):
            check_writable(tmp_path / name)
    with pytest.raises(Error, match="cannot be written"):
        check_writable("/proc/a.png")


def test_new_files_have_the_usual_permissions(tmp_path, outputs):
    save(tmp_path / "a.png", outputs)
    (tmp_path / "b").touch()
    assert (tmp_path / "a.png").stat().st_mode == (tmp_path / "b").stat().st_mode


@pytest.mark.parametrize("shape, name", [((4, 6, 3), "a.png"), ((4, 6, 4), "a.png"), ((4, 6), "a.png"),
                                         ((4, 6, 3), "a.bmp")])
def test_load_picture(tmp_path, shape, name):
    import imageio.v3

    pixels = np.random.default_rng(2).integers(0, 256, shape, np.uint8)
    imageio.v3.imwrite(tmp_path / name, pixels)
    loaded = load_picture(tmp_path / name)
    expected = pixels[..., :3] if pixels.ndim == 3 else np.stack([pixels] * 3, axis=2)
    assert loaded.dtype == np.uint8 and np.array_equal(loaded, expected)


def test_bad_pictures(tmp_path, outputs):

    save(tmp_path / "a.png", np.random.default_rng(3).random((64, 64, 3)))
    data = (tmp_path / "a.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(data[: len(data) // 2])
    (tmp_path / "junk.png").write_bytes(b"hello")
    (tmp_path / "empty.png").touch()
    for name in ("cut.png", "junk.png", "empty.png", "gone.png", "."):
        with pytest.raises(Error) as caught:
            load_picture(tmp_path / name)
        assert "\n" not in str(caught.value)
    with pytest.raises(Error, match="load_picture path"):
        load_picture(None)


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("name", ["png", "tiff", "tiff big", "tiff packed", "tiff big packed"])
def test_pictures_of_16_bits_are_whole(tmp_path, name, channels):
    """Pillow alone would keep the first byte of each channel of RGB."""
    pixels = np.random.default_rng(channels).integers(0, 2**16, (9, 7, channels)).astype(np.uint16)
    data = picture_files.png(pixels) if name == "png" else picture_files.tiff(
        pixels, ">" if "big" in name else "<", "packed" in name)
    (tmp_path / "a").write_bytes(data)
    loaded = load_picture(tmp_path / "a")
    assert loaded.dtype == np.uint16 and np.array_equal(loaded, np.broadcast_to(pixels[..., :3], (9, 7, 3)))
    color = HairType(color_texture=loaded).color_texture
    assert np.abs(color - srgb_to_linear(loaded / 65535)).max() < 1e-6
    with pytest.raises(Error, match="type_map is an array of uint16.*uint8"):
        Strands(types=[HairType(key=(0, 0, 0))], type_map=loaded)


def test_other_pictures_that_are_read(tmp_path):
    rng = np.random.default_rng(4)
    grey = rng.integers(0, 2**16, (5, 3, 1)).astype(np.uint16)
    three = rng.integers(0, 256, (5, 3, 3)).astype(np.uint8)
    palette = Image.fromarray(three).quantize(8)
    rgb = np.asarray(palette.convert("RGB"))
    cmyk, turned = Image.fromarray(three).convert("CMYK"), Image.Exif()
    turned[0x112] = 6   # a camera held upright
    flat = Image.new("RGB", (8, 8), (128, 128, 128))
    for name, data, expected in [
        ("white_is_0.tif", picture_files.tiff(grey, photometric=0), np.repeat(65535 - grey, 3, 2)),
        ("planes.tif", picture_files.tiff(three, planes=True), three),
        ("16.pgm", b"P5 3 5 65535\n" + grey.astype(">u2").tobytes(), np.repeat(grey, 3, 2)),
        ("bits.png", coded(Image.fromarray(three[..., 0] > 99), "PNG"),
         np.repeat((three[..., :1] > 99).astype(np.uint8) * 255, 3, 2)),
        ("palette.png", coded(palette, "PNG"), rgb),
        ("alpha.png", picture_files.png(np.dstack([three, three[..., :1]]), 8), three),
        ("grey_alpha.png", picture_files.png(three[..., :2], 8), np.repeat(three[..., :1], 3, 2)),
        ("cmyk.tif", coded(cmyk, "TIFF"), np.asarray(cmyk.convert("RGB"))),
        ("frames.gif", coded(palette, "GIF", save_all=True, append_images=[palette.point(lambda v: 7 - v)]), rgb),
        ("exif.png", coded(Image.fromarray(three), "PNG", exif=turned), three),
        ("8.jp2", coded(Image.fromarray(three), "JPEG2000", irreversible=False), three),
        ("a.webp", coded(Image.fromarray(three), "WEBP", lossless=True), three),
        ("a.ppm", coded(Image.fromarray(three), "PPM"), three),
        *[("8.avif", coded(flat, "AVIF", quality=100), np.asarray(flat))] * ("AVIF" in Image.SAVE),
        ("a.sgi", coded(Image.fromarray(three), "SGI"), three),
    ]:
        (tmp_path / name).write_bytes(data)
        loaded = load_picture(tmp_path / name)
        assert loaded.dtype == expected.dtype and np.array_equal(loaded, expected), name


def coded(picture, kind, **options):
    """The bytes of a file of Pillow's Image."""
    file = io.BytesIO()
    picture.save(file, kind, **options)
    return file.getvalue()


def test_what_would_be_cut_is_refused(tmp_path):
    """Files whose channels are not 8 or 16 bits, and those of 16 that Pillow would cut; none is decoded first."""
    deep, three = np.zeros((4, 4, 2), np.uint16), Image.new("RGB", (4, 4))
    jp2 = bytearray(coded(three, "JPEG2000"))
    size = jp2.index(b"\xff\x4f\xff\x51")
    jp2[size + 42:size + 51:3] = [11] * 3   # 12 bits
    for name, data, words in [
        ("la.png", picture_files.png(deep), "more than 8 bits"),
        ("float.tif", picture_files.tiff(np.zeros((4, 4, 1), np.float32)), "floats"),
        ("int.tif", picture_files.tiff(np.zeros((4, 4, 1), np.int32)), "more than 8 bits"),
        ("signed.tif", picture_files.tiff(np.zeros((4, 4, 1), np.int16)), "more than 8 bits"),
        ("cmyk.tif", picture_files.tiff(np.zeros((4, 4, 4), np.uint16), photometric=5, extra=0), "cmyk.tif"),
        ("premultiplied.tif", picture_files.tiff(np.zeros((4, 4, 4), np.uint16), extra=1), "more than 8 bits"),
        ("planes.tif", picture_files.tiff(np.zeros((4, 4, 3), np.uint16), planes=True), "more than 8 bits"),
        ("zip.tif", picture_files.tiff(np.zeros((4, 4, 3), np.uint16), packed=True, planes=True), "more than 8 bits"),
        ("rgb.ppm", b"P6 2 1 65535\n" + bytes(12), "more than 8 bits"),
        ("grey.pgm", b"P5 2 1 1023\n" + bytes(4), "more than 8 bits"),
        ("deep.sgi", coded(three, "SGI", bpc=2), "more than 8 bits"),
        ("deep.jp2", bytes(jp2), "more than 8 bits"),
        ("a.exr", b"\x76\x2f\x31\x01" + bytes(99), "is EXR that is cut off or damaged"),
        ("a.eps", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "allowed: PNG"),
        ("many.png", picture_files.empty_png(2**14, 2**13 + 1), "16384 x 8193 pixels; allowed: at most 134217728"),
        ("more.png", picture_files.empty_png(2**20, 2**20), "pixels"),
    ]:
        (tmp_path / name).write_bytes(data)
        with warnings.catch_warnings(), pytest.raises(Error, match=words) as caught:
            warnings.simplefilter("error")
            load_picture(tmp_path / name)
        assert name in str(caught.value) and "\n" not in str(caught.value)


def test_only_regular_files_are_read_as_pictures(tmp_path):
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.png")
        with pytest.raises(Error, match="pipe.png: is a pipe"):
            load_picture(tmp_path / "pipe.png")
    for device in {"/dev/zero", "/dev/null"} if os.path.exists("/dev/zero") else ():
        with pytest.raises(Error, match="is a pipe, a device"):
            load_picture(device)


def test_a_png_is_coded_in_bands(monkeypatch):
    """NumPy hears Ctrl-C only between its steps: none is of more than a band, and the picture is the whole's."""
    color = np.random.default_rng(2).random((2 * pictures.BAND + 7, 5, 4), np.float32)
    rows, code = [], pictures.srgb_codes
    monkeypatch.setattr(pictures, "srgb_codes", lambda part: rows.append(len(part)) or code(part))
    for level in (1, 9):
        rows.clear()
        pixels = imageio.v3.imread(pictures.png_bytes(color, level))
        assert rows == [pictures.BAND] * 6 + [7] * 3
        np.testing.assert_array_equal(pixels, _by_formula(color))


def _by_formula(color):
    """8-bit codes of a picture as they are defined, without a table."""
    color = np.nan_to_num(color.astype(np.float32), nan=0.0, posinf=1.0, neginf=0.0)
    if color.shape[2] == 4:
        alpha = np.clip(color[:, :, 3:], 0, 1)
        straight = np.where(alpha > 0, np.clip(color[:, :, :3], 0, alpha) / np.where(alpha > 0, alpha, 1), 0)
        coded = np.concatenate([linear_to_srgb(straight), alpha], axis=2)
    else:
        coded = linear_to_srgb(color)
    return (coded * 255 + 0.5).astype(np.uint8)


def test_codes_are_those_of_the_formula():
    """Of floats of all kinds, and of all near which a code ends: the same bytes. All 2^32 floats were tried once."""
    middles = srgb_to_linear((np.arange(255) + 0.5) / 255)   # where one code becomes the next, to some ulp
    near = middles.view(np.uint32)[:, None].astype(np.int64) + np.arange(-500, 500)
    kinds = (0, 1, 0x7FFFFF, 0x800000, 0x3F800000, 0x7F7FFFFF, 0x7F800000, 0x7FC00000, 0x7FFFFFFF)
    ends = np.array([[kind + k for kind in kinds] for k in (-1, 0, 1)]).clip(0, 2**31 - 1)
    some = np.random.default_rng(3).integers(0, 2**32, 200_000)
    bits = np.concatenate([near.ravel(), ends.ravel(), ends.ravel() + 2**31, some, some % 0x3F800000])
    values = np.resize(bits, (len(bits) // 12 * 12)).astype(np.uint32).view(np.float32)
    with np.errstate(all="ignore"):
        wide = values.astype(np.float64)
        for picture in (values.reshape(-1, 1, 3), values.reshape(-1, 1, 4), wide.reshape(-1, 2, 3)):
            np.testing.assert_array_equal(pictures.to_uint8(picture), _by_formula(picture))
    assert len(np.unique(pictures.to_uint8(near.astype(np.uint32).view(np.float32)[..., None].repeat(3, 2)))) == 256


def test_an_exr_is_written_in_bands(tmp_path, monkeypatch):
    """NumPy hears Ctrl-C only between its steps: none takes more than some rows; and what is begun is taken away."""
    import OpenEXR

    rng, rows, pack = np.random.default_rng(2), [], exr._packed
    shape = 2 * exr.ROWS[exr.ZIP] + 7, 5
    outputs = {"depth": rng.random(shape, np.float32), "id": rng.integers(-2, 2**31, shape).astype(np.int32)}
    monkeypatch.setattr(exr, "_packed", lambda channels, top: rows.append(top) or pack(channels, top))
    save(tmp_path / "a.exr", outputs)
    assert rows == [top for top in range(0, shape[0], exr.ROWS[exr.ZIP]) for _ in outputs]
    depth, ids = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).parts
    assert np.array_equal(depth.channels["Z"].pixels, outputs["depth"])
    assert np.array_equal(ids.channels["id"].pixels.view(np.int32), outputs["id"])

    def interrupt(channels, top):
        if top:
            raise KeyboardInterrupt
        return pack(channels, top)
    monkeypatch.setattr(exr, "_packed", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save(tmp_path / "b.exr", outputs)
    assert os.listdir(tmp_path) == ["a.exr"]


@pytest.mark.parametrize("shape", [(1, 1, 3), (40, 33, 3), (70, 5, 4)])
def test_an_exr_that_is_cut_off(tmp_path, capfd, shape):
    """Wherever it is, one line says so, and the library behind says nothing of its own."""
    save(tmp_path / "a.exr", np.random.default_rng(0).random(shape).astype(np.float32))
    data = (tmp_path / "a.exr").read_bytes()
    for length in sorted({5, 8, *range(9, len(data), max(len(data) // 60, 1)), len(data) - 1}):
        with pytest.raises(Error, match="^is EXR that is cut off or damaged$"):
            pictures.picture_of(data[:length])
    assert pictures.picture_of(data).shape == (*shape[:2], 3)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("pattern", ["skin.<UDIM>.png", "skin.%(UDIM)d.png"])
def test_tiles_are_read_by_their_numbers(tmp_path, pattern):
    pictures = {1001: np.full((2, 3, 3), 7, np.uint8), 1012: np.full((1, 1, 3), 9, np.uint8)}
    for name, picture in [*pictures.items(), (1000, pictures[1001]), ("10011", pictures[1001]), ("a", pictures[1001])]:
        (tmp_path / f"skin.{name}.png").write_bytes(imageio.v3.imwrite("<bytes>", picture, extension=".png"))
    found = load_picture(tmp_path / pattern)
    assert list(found) == [1001, 1012]
    for number, picture in pictures.items():
        np.testing.assert_array_equal(found[number], picture)
    with pytest.raises(Error, match=r"other\.<UDIM>\.png: no such tiles; allowed: files with a number from 1001"):
        load_picture(tmp_path / "other.<UDIM>.png")
    with pytest.raises(Error, match="no such tiles"):
        load_picture(tmp_path / "nowhere" / pattern)


def test_a_broken_tile_is_named(tmp_path):
    (tmp_path / "skin.1002.png").write_bytes(b"x")
    with pytest.raises(Error, match=r"skin\.1002\.png: cannot be read"):
        load_picture(tmp_path / "skin.<UDIM>.png")
