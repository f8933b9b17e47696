"""Pictures one after the other -> video files; the only importer of PyAV."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Error
from ..scene.mips import levels_of
from .output import whole

BT709, LIMITED = 1, 1   # of H.273, in FFmpeg's numbers: matrix, primaries and transfer; 16 to 235
HALF = 128              # alpha from which on a pixel of a GIF is there


@dataclass(frozen=True)
class Kind:
    """How a video file holds pictures.

    container, codec, pixels: FFmpeg's names. alpha: whether it holds alpha, of a bit in GIF. even: whether
    width and height must be. options: of the codec. muxing: of the container.
    """

    container: str
    codec: str
    pixels: str
    alpha: bool = True
    even: bool = False
    options: dict = field(default_factory=dict)
    muxing: dict = field(default_factory=dict)

    @property
    def is_yuv(self) -> bool:
        """Whether it holds light and two differences of colour, by BT.709."""
        return self.pixels.startswith("yuv")


# Fur is fine noise in motion, of which codecs take the most away: what crf and others keep was looked at.
KINDS = {
    ".mp4": Kind("mp4", "libx264", "yuv420p", alpha=False, even=True, options={"crf": "16", "preset": "medium"},
                 muxing={"movflags": "+faststart"}),
    ".webm": Kind("webm", "libvpx-vp9", "yuva420p",
                  # Without a lag: else its last frames are coded in one go, which takes 17 s at 1920x1080.
                  options={"crf": "16", "b": "0", "auto-alt-ref": "0", "lag-in-frames": "0", "cpu-used": "2",
                           "row-mt": "1"}),
    ".mov": Kind("mov", "prores_ks", "yuva444p10le", options={"profile": "4444", "alpha_bits": "16"}),
    ".gif": Kind("gif", "gif", "pal8"),
    ".png": Kind("apng", "apng", "rgba", muxing={"plays": "0"}),
}


def pyav() -> Any:
    """The module av; raises Error where it is missing."""
    try:
        import av
    except ImportError:
        raise Error("video files need PyAV, which is not there: pip install \"clfur[film]\"; allowed without it: "
                    "frames of a folder, such as frames/%04d.png") from None
    return av


def write_video(path: Path, pictures: Callable[[], Iterator[np.ndarray]], rate: float) -> None:
    """Write a video file, whole or not at all, by the suffix of its path.

    pictures: a function that gives them one after the other, uint8 [h, w, 4], sRGB with straight alpha, or [h, w, 3];
    GIF asks twice. rate: pictures a second. Raises Error where PyAV is missing, and where the file cannot be written.
    """
    kind = KINDS[path.suffix.lower()]
    av = pyav()
    with whole(path) as temporary, av.open(str(temporary), "w", format=kind.container, options=kind.muxing) as out:
        frames = _frames(av, kind, pictures)
        first = next(frames)
        exact = Fraction(rate).limit_denominator(1001)
        stream = out.add_stream(kind.codec, rate=exact, options=kind.options)
        stream.width, stream.height, stream.pix_fmt = first.width, first.height, kind.pixels
        if kind.is_yuv:
            for name in ("colorspace", "color_primaries", "color_trc"):
                setattr(stream.codec_context, name, BT709)
            stream.codec_context.color_range = LIMITED
        number, frame = 0, first
        while frame is not None:
            frame.pts, frame.time_base, number = number, 1 / exact, number + 1
            _encode(stream, out, frame)
            frame = next(frames, None)
        _encode(stream, out, None)


def _encode(stream, out, frame):
    """Give the codec a frame, or None at the end, and write what it has done; one by one, so that Ctrl-C is heard."""
    for packet in stream.codec_context.encode_lazy(frame):
        packet.stream = stream
        out.mux(packet)


def _frames(av, kind, pictures):
    """Pictures as the codec takes them."""
    if kind.codec == "gif":
        return _in_palette(av, pictures)
    return (_converted(av, kind, picture) for picture in pictures())


def _converted(av, kind, picture):
    if kind.even:
        picture = np.pad(picture, ((0, picture.shape[0] % 2), (0, picture.shape[1] % 2), (0, 0)), mode="edge")
    if picture.shape[2] == 3 and kind.alpha:
        picture = np.concatenate([picture, np.full_like(picture[..., :1], 255)], 2)
    if not kind.is_yuv:
        return _frame(av, picture)
    from av.video.reformatter import ColorRange, Colorspace, Interpolation

    frame = _frame(av, filled(picture) if kind.alpha else picture[..., :3]).reformat(
        format=kind.pixels, dst_colorspace=Colorspace.ITU709, src_color_range=ColorRange.JPEG,
        dst_color_range=ColorRange.MPEG, interpolation=Interpolation.BICUBIC)
    frame.colorspace, frame.color_range = BT709, LIMITED
    return frame


def _frame(av, picture):
    kind = "rgba" if picture.shape[2] == 4 else "rgb24"
    return av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format=kind)


def _in_palette(av, pictures):
    """Frames of 256 colours or fewer, the same in all of a film: hair would flicker with a palette of its own for each.

    Its dither is ordered, and stands still.
    """
    frames = (_converted(av, KINDS[".gif"], picture) for picture in pictures())
    (palette,) = _through(av, "palettegen", "reserve_transparent=1", frames)
    frames = (_converted(av, KINDS[".gif"], picture) for picture in pictures())
    yield from _through(av, "paletteuse", f"dither=bayer:bayer_scale=4:alpha_threshold={HALF}", frames, palette)


def _through(av, name, options, frames, *others):
    """What a filter of FFmpeg gives of frames, and of an only frame at each of its other inputs."""
    graph, first = av.filter.Graph(), next(frames)
    step, end = graph.add(name, options), graph.add("buffersink")
    sources = []
    for place, frame in enumerate([first, *others]):
        sources.append(graph.add_buffer(width=frame.width, height=frame.height, format=frame.format,
                                        time_base=Fraction(1, 100)))
        sources[-1].link_to(step, 0, place)
    step.link_to(end)
    graph.configure()
    for source, frame in zip(sources[1:], others):
        source.push(frame)
        source.push(None)
    for number, frame in enumerate(chain([first], frames)):
        frame.pts, frame.time_base = number, Fraction(1, 100)
        sources[0].push(frame)
        yield from _ready(av, end)
    sources[0].push(None)
    yield from _ready(av, end)


def _ready(av, end):
    """Frames that wait at the end of a graph."""
    while True:
        try:
            yield end.pull()
        except (av.BlockingIOError, EOFError):
            return


def filled(picture: np.ndarray) -> np.ndarray:
    """Return a picture uint8 [h, w, 4] whose transparent pixels have the colours of those around them.

    Codecs mix the colours of neighbours, whatever their alpha: black there would be seen around all hair. Pulled and
    pushed through halves of the picture (Gortler et al., "The lumigraph", 1996).
    """
    alpha = picture[..., 3:]
    if alpha.all() or not alpha.any():
        return picture
    weighted = np.concatenate([picture[..., :3] * (alpha / np.float32(255)), alpha / np.float32(255)], 2)
    levels = levels_of(weighted)
    below = levels[-1]
    for level in reversed(levels[:-1]):
        rows, columns = (np.minimum(np.arange(n) * m // n, m - 1) for n, m in zip(level.shape[:2], below.shape[:2]))
        there = below[rows][:, columns]
        below = np.where(level[..., 3:] > 0, level, there)
    colors = np.rint(below[..., :3] / below[..., 3:]).astype(np.uint8)
    return np.concatenate([np.where(alpha > 0, picture[..., :3], colors), alpha], 2)
