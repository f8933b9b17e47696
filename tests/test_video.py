"""Video files: what each format keeps of pictures, as it is decoded."""

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace

import clfur
from clfur.files import video

SIZE = 47, 33   # of which MP4 takes neither
SUFFIXES = sorted(video.KINDS)
FLAT = [(200, 120, 40), (20, 60, 200), (128, 128, 128), (255, 255, 255), (0, 0, 0), (230, 30, 30)]


def _pictures(frames=5, alpha=True):
    """A square of one colour goes to the right, on a ground that is half transparent, above one that is wholly."""
    for k in range(frames):
        picture = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
        picture[18:] = 20, 60, 200, 99
        picture[8:24, 4 + 3 * k:20 + 3 * k] = 200, 120, 40, 255
        yield picture if alpha else np.ascontiguousarray(picture[..., :3])


def _written(path, pictures, rate=24):
    video.write_video(path, lambda: iter(pictures), rate)
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    return _decoded(path)


def _decoded(path):
    """([frames, h, w, 4] uint8, the stream's tags, seconds of each frame) of a file."""
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        tags = {name: getattr(stream.codec_context, name)
                for name in ("colorspace", "color_primaries", "color_trc", "color_range")}
        decoder = av.CodecContext.create("libvpx-vp9", "r") if path.suffix == ".webm" else None   # FFmpeg's drops alpha
        frames = [frame for packet in file.demux(stream)
                  for frame in (decoder.decode(packet) if decoder else packet.decode())]
        seconds = [float(frame.pts * stream.time_base) for frame in frames]
    yuv = {"src_colorspace": Colorspace.ITU709, "src_color_range": ColorRange.MPEG, "dst_color_range": ColorRange.JPEG}
    shown = [frame.reformat(format="rgba", **(yuv if frame.format.name.startswith("yuv") else {})).to_ndarray()
             for frame in frames]
    return np.stack(shown), tags, seconds


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("color", FLAT)
def test_a_flat_colour_comes_back(tmp_path, suffix, color):
    """Its mean, by the tags, within 1.5/255, of the mean over its three parts; GIF and PNG to the bit."""
    there, tags, _ = _written(tmp_path / f"a{suffix}", [np.full((32, 48, 3), color, np.uint8)] * 3)
    assert there.shape == (3, 32, 48, 4) and (there[..., 3] == 255).all()
    if video.KINDS[suffix].is_yuv:
        ranged = tags.pop("color_range")   # ProRes has no other, and not all of FFmpeg's versions tell it
        assert tags == {"colorspace": 1, "color_primaries": 1, "color_trc": 1} and (ranged == 1 or suffix == ".mov")
        assert np.abs(there[..., :3].mean((0, 1, 2)) - color).mean() < 1.5
    else:
        assert (there[..., :3] == color).all()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_pictures_come_back(tmp_path, suffix):
    """In their order and at their times; with alpha where there is some, of a bit in GIF, and without dark edges."""
    kind = video.KINDS[suffix]
    given = np.stack([*_pictures(alpha=kind.alpha)])
    there, _, seconds = _written(tmp_path / f"a{suffix}", given)
    assert np.abs(np.array(seconds) - np.arange(5) / 24).max() < 0.006   # GIF counts hundredths
    if kind.even:
        assert there.shape == (5, 34, 48, 4)
        assert np.abs(there[:, 33].astype(int) - there[:, 32]).mean() < 3   # padded with the same, not with black
        assert np.abs(there[:, :, 47].astype(int) - there[:, :, 46]).mean() < 3
    there = there[:, :SIZE[1], :SIZE[0]].astype(int)
    for k in range(5):
        assert np.abs(there[k, 10:22, 6 + 3 * k:18 + 3 * k, :3] - (200, 120, 40)).mean() < 3
    if not kind.alpha:
        return
    alpha = given[..., 3].astype(int)
    if suffix == ".gif":
        assert (there[..., 3] == np.where(alpha < 128, 0, 255)).all()
        return
    assert np.abs(there[..., 3] - alpha).mean() < 0.5
    edges = alpha == 255   # of the square against what is transparent: colours of these don't mix in
    assert np.abs(there[edges][:, :3] - (200, 120, 40)).mean() < (0.5 if suffix != ".webm" else 6)


def test_transparent_pixels_take_the_colours_around_them():
    picture = np.zeros((9, 12, 4), np.uint8)
    picture[3, 4] = 200, 100, 50, 255
    picture[3, 5] = 200, 100, 50, 1
    filled = video.filled(picture)
    assert (filled[..., 3] == picture[..., 3]).all() and np.abs(filled[..., :3].astype(int) - (200, 100, 50)).max() <= 1
    for same in (np.zeros((3, 4, 4), np.uint8), np.full((3, 4, 4), 255, np.uint8)):
        assert (video.filled(same) == same).all()


def test_a_gif_has_one_palette(tmp_path):
    """What stands still does not flicker."""
    rng = np.random.default_rng(1)
    ground = rng.integers(0, 255, (SIZE[1], SIZE[0], 3), np.uint8)
    pictures = [ground.copy() for _ in range(4)]
    for k, picture in enumerate(pictures):
        picture[:8] = 60 * k
    there, _, _ = _written(tmp_path / "a.gif", pictures)
    assert (there[:, 8:] == there[:1, 8:]).all() and np.abs(there[0, 8:, :, :3].astype(int) - ground[8:]).mean() < 20


def test_nothing_is_left_of_a_video_that_fails(tmp_path):
    def pictures():
        yield next(_pictures())
        raise clfur.Error("no more")
    for suffix in SUFFIXES:
        with pytest.raises(clfur.Error, match="no more"):
            video.write_video(tmp_path / f"a{suffix}", pictures, 24)
    assert not list(tmp_path.iterdir())


def test_other_rates(tmp_path):
    for rate in (23.976, 30, 12.5):
        _, _, seconds = _written(tmp_path / "a.mp4", [*_pictures(3)], rate)
        assert seconds == pytest.approx([0, 1 / rate, 2 / rate], abs=1e-4)


def test_a_film_becomes_a_video(tmp_path):
    """Over black where a container holds no alpha, else over what is asked for; steps of frames take their time."""
    scene = clfur.Scene(mesh=clfur.load_mesh("sphere"), fur=None, camera=clfur.Camera(eye=(0, 0, 4), size=(32, 24)))
    settings = clfur.Settings(shadow_map=0)
    given = {"settings": settings, "frames": range(0, 6, 2)}
    still = clfur.to_uint8(clfur.render(scene, settings=settings))
    for suffix, background in ((".mp4", None), (".mp4", (1, 1, 1)), (".webm", None), (".webm", (0, 0, 1))):
        path = clfur.film(scene, tmp_path / f"a{suffix}", background=background, **given)
        there, _, seconds = _decoded(path)
        assert seconds == pytest.approx([0, 1 / 12, 2 / 12], abs=1e-3)
        assert not path.with_name(f"a{suffix}.frames").exists()
        corner = there[0, 0, 0].astype(int)
        if suffix == ".webm" and background is None:
            assert corner[3] == 0 and np.abs(there[0, ..., 3].astype(int) - still[..., 3]).mean() < 1
        else:
            expected = 255 * np.array(background or (0, 0, 0))
            assert corner[3] == 255 and np.abs(corner[:3] - expected).max() <= 3
