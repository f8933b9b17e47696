"""Pictures of floats that are read: Radiance's .hdr, and .exr."""

import numpy as np
import pytest

import clfur
from clfur import Environment, Error, load_picture


def rgbe(pixels):
    """Colours [h, w, 3] as bytes [h, w, 4], the exponent by the largest of each."""
    _, power = np.frexp(pixels.max(-1))
    coded = np.floor(np.ldexp(pixels, 8 - power[..., None]))
    return np.dstack([coded, np.where(pixels.max(-1) > 0, power + 128, 0)]).astype(np.uint8)


def in_runs(row):
    """Bytes of a row [w, 4] of runs of up to 127, and of others as they are, up to 128 at a time."""
    out = bytes([2, 2, len(row) >> 8, len(row) & 255])
    for channel in row.T:
        starts = np.flatnonzero(np.append(True, channel[1:] != channel[:-1]))
        for start, end in zip(starts, [*starts[1:], len(channel)]):
            for at in range(start, end, 127):
                n, value = min(end - at, 127), channel[start]
                out += bytes([128 + n, value]) if n > 1 else bytes([1, value])
    return out


def hdr(pixels, runs=True, head=b"FORMAT=32-bit_rle_rgbe\n"):
    height, width = pixels.shape[:2]
    coded = rgbe(pixels)
    rows = b"".join(in_runs(row) if runs else row.tobytes() for row in coded)
    return b"#?RADIANCE\n" + head + b"\n-Y %d +X %d\n" % (height, width) + rows


@pytest.fixture
def pixels():
    rng = np.random.default_rng(3)
    pixels = np.exp2(rng.uniform(-12, 12, (9, 300, 3)))
    pixels[2:5, 20:180], pixels[6, 7] = pixels[2, 20], 0
    return pixels


@pytest.mark.parametrize("runs", [True, False])
def test_hdr(tmp_path, pixels, runs):
    """A mantissa is cut to 8 bits of the largest colour's."""
    (tmp_path / "a.hdr").write_bytes(hdr(pixels, runs))
    given = load_picture(tmp_path / "a.hdr")
    assert given.dtype == np.float32 and given.shape == pixels.shape and (given[6, 7] == 0).all()
    assert (np.abs(given - pixels) <= pixels.max(-1, keepdims=True) / 128).all()
    (tmp_path / "b.hdr").write_bytes(hdr(pixels, runs, b"EXPOSURE=2\nSOFTWARE=x\nEXPOSURE= 4.0\n"))
    np.testing.assert_allclose(load_picture(tmp_path / "b.hdr"), given / 8, rtol=1e-6)


def test_exr(tmp_path, pixels):
    import OpenEXR
    clfur.save(tmp_path / "a.exr", pixels.astype(np.float32))
    np.testing.assert_array_equal(load_picture(tmp_path / "a.exr"), pixels.astype(np.float32))
    for number, header in enumerate([{"lineOrder": OpenEXR.DECREASING_Y}, {"compression": OpenEXR.PIZ_COMPRESSION},
                                     {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}]):
        with OpenEXR.File({"type": OpenEXR.scanlineimage} | header, {"RGB": pixels.astype(np.float32)}) as file:
            file.write(str(tmp_path / f"{number}.exr"))
        np.testing.assert_array_equal(load_picture(tmp_path / f"{number}.exr"), pixels.astype(np.float32))
    clfur.save(tmp_path / "y.exr", {"Y": pixels[:, :, 0].astype(np.float32), "Z": pixels[:, :, 1]})
    grey = np.repeat(pixels[:, :, :1], 3, 2).astype(np.float32)
    np.testing.assert_array_equal(load_picture(tmp_path / "y.exr"), grey)
    clfur.save(tmp_path / "z.exr", {"depth": pixels[:, :, 0].astype(np.float32)})
    with pytest.raises(Error, match="z.exr: is EXR with the channels Z; allowed"):
        load_picture(tmp_path / "z.exr")


def test_bad_files_are_told_in_one_line(tmp_path, pixels):
    whole = hdr(pixels)
    clfur.save(tmp_path / "a.exr", pixels.astype(np.float32))
    exr = (tmp_path / "a.exr").read_bytes()
    for data, words in [
        (whole[:40], "cut off in its header"), (whole[:-9], "cut off or damaged"), (whole[:200], "cut off or damaged"),
        (hdr(pixels, False)[:-1], "cut off"), (whole.replace(b"rgbe", b"xyze"), "FORMAT=32-bit_rle_xyze"),
        (whole.replace(b"-Y 9", b"+Y 9"), "rows as"), (whole.replace(b"-Y 9", b"-Y 0"), "pixels; allowed"),
        (whole.replace(b"-Y 9", b"-Y 999999999"), "pixels; allowed"),
        (whole.replace(b"-Y 9", b"-Y 99999"), "cut off or damaged"),
        (hdr(pixels, head=b"EXPOSURE=0\n"), "EXPOSURE"), (hdr(pixels, head=b"EXPOSURE=nan\n"), "EXPOSURE"),
        (hdr(np.full((2, 3, 3), 1e25), False, b"EXPOSURE=1e-19\n"), "EXPOSURE"),
        (exr[:-100], "is EXR that is cut off"), (exr[:60], "is EXR that is cut off"),
    ]:
        (tmp_path / "bad").write_bytes(data)
        with pytest.raises(Error, match=f"bad: .*{words}") as caught:
            load_picture(tmp_path / "bad")
        assert "\n" not in str(caught.value)


def test_a_row_cut_anywhere_is_no_picture(tmp_path):
    """Bytes turned at random give an error or a picture of the stated size, and nothing else."""
    rng, whole = np.random.default_rng(4), np.frombuffer(hdr(np.full((3, 40, 3), .25)), np.uint8)
    for _ in range(200):
        data = whole.copy()
        data[rng.integers(60, len(data), 2)] = rng.integers(0, 256, 2)
        (tmp_path / "a").write_bytes(data.tobytes())
        try:
            assert load_picture(tmp_path / "a").shape == (3, 40, 3)
        except Error as error:
            assert "damaged" in str(error)


def test_a_sky_from_a_file(tmp_path):
    picture = np.zeros((8, 16, 3), np.float32)
    picture[:4] = 3
    clfur.save(tmp_path / "up.exr", picture)
    towards, light, _ = Environment(load_picture(tmp_path / "up.exr")).places
    assert (light[towards[:, 1] > 0] == 3).all() and (light[towards[:, 1] < 0] == 0).all()
    picture[5, 7, 1] = np.nan
    clfur.save(tmp_path / "nan.exr", picture)
    with pytest.raises(Error, match=r"Environment.sky is nan at \[5, 7, 1\]; allowed"):
        Environment(load_picture(tmp_path / "nan.exr"))
