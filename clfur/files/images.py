"""Pictures <-> files; the only importer of imageio, Pillow and OpenEXR, each where it is needed."""

import contextlib
import io
import os
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..color import srgb_codes, srgb_to_linear
from ..errors import Error, shown
from ..scene import Camera, checks
from . import exr, layers, output, radiance
from .arrays import read_arrays
from .input import read
from .output import is_path, output_path, reason, whole

__all__ = ["check_writable", "load", "load_header", "load_picture", "png_bytes", "save", "to_uint8"]

EFFORT = 1   # of PNG's compression, 0 to 9: 6 takes 2.3 to 3.9 times as long for files of 0.85 to 1.08 times the size
BAND = 64   # rows of a picture that are coded at a time: NumPy hears Ctrl-C only between its steps

def save(path: str | os.PathLike, image: np.ndarray | dict[str, np.ndarray], camera: Camera | None = None,
         settings: Any = None) -> None:
    """Write a picture to a .png, .exr or .npz file, by suffix: all of it or nothing.

    path: str or path-like. image: float [h, w, 4] linear premultiplied (or [h, w, 3]), or the dict of outputs
    that `render` returns. PNG holds the colour alone, 8-bit sRGB with straight alpha, clipped to 0..1. EXR
    holds linear float32: R, G, B, A (premultiplied), and of a dict other outputs in parts of their names: Z
    (depth), tangent.X and so on; whole numbers such as `id` are floats there, but where some are beyond 2**24, which
    are unsigned; matte_id with matte_alpha are a Cryptomatte of strands, type_alpha is one of types, too: see
    docs/data.md. NPZ holds the arrays as they are, a plain one as `color`. camera, settings: the Camera and Settings
    that it was drawn with, which EXR holds in its header.
    Raises Error for another suffix, other shapes, and where the file cannot be written.
    """
    file = output_path(path, WRITERS)
    outputs = image if isinstance(image, dict) else {"color": image}
    if odd := [name for name in outputs if not isinstance(name, str)]:
        raise Error(f"save has an output {shown(odd[0])}; allowed: names, such as those that render gives")
    outputs = {name: checks.numbers(array, f"save {name}", "an array of numbers", "biuf")
               for name, array in outputs.items()}
    if "color" in outputs:
        color = outputs["color"]
        if color.ndim != 3 or color.shape[2] not in (3, 4) or 0 in color.shape or color.dtype.kind != "f":
            raise Error(f"save color is {color.dtype} {list(color.shape)}; "
                        "allowed: floats [h, w, 4] or [h, w, 3]")
    about, write = layers.about(camera, settings), WRITERS[file.suffix.lower()]
    with whole(file) as temporary:
        write(temporary, outputs, about)


def load(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Read what `save` has written: {output: array}, of the dtypes and shapes that were saved.

    path: str or path-like, of a .png, .exr or .npz file. Of PNG it is `color` alone, float32 [h, w, 4] linear
    premultiplied: 8 bits of it. Of EXR made by others it is `color` for R, G, B (and A), `depth` for Z, and every other
    channel by its name, float32 or uint32.
    Raises Error, one line that names the file, where it is missing, damaged, cut short or claims more than it has.
    """
    return _loaded(path, "load", READERS)


def load_header(path: str | os.PathLike) -> dict[str, Any]:
    """Read what `save` has told of a picture in an .exr file: {"software": clfur and its version, "camera": the Camera,
    "settings": {name: value} of the Settings}, None where it was not given.

    path: str or path-like. Raises Error as `load` does.
    """
    return _loaded(path, "load_header", {".exr": lambda data: layers.header_of(exr.read(data))})


def _loaded(path, name, readers):
    """What the reader of a file's suffix gives of it."""
    if not is_path(path):
        raise Error(f"{name} path is {shown(path)}; allowed: a file's name")
    path = Path(path)
    if path.suffix.lower() not in readers:
        raise Error(f"{path}: {path.suffix or 'no suffix'} is not supported; allowed: {', '.join(readers)}")
    if os.path.isdir(path) or not os.path.exists(path):
        problem = "is a folder" if os.path.isdir(path) else "no such file"
        raise Error(f"{path}: {problem}; allowed: a file that save has written")
    data = read(path)
    try:
        return readers[path.suffix.lower()](data)
    except Error as error:
        raise Error(f"{path}: {error}") from error.__cause__


def check_writable(path: str | os.PathLike) -> None:
    """Raise Error unless `save` could write to this path; leaves nothing behind."""
    output.check_writable(path, WRITERS)


def png_bytes(image: np.ndarray, level: int = EFFORT) -> bytes:
    """The bytes of a PNG file, 8-bit sRGB with straight alpha: of a float picture as `save` takes it.

    level: 0 to 9, how hard they are compressed.
    """
    import imageio.v3

    return imageio.v3.imwrite("<bytes>", _in_bands(image), extension=".png", compress_level=level)


def encoded(suffix: str, image: np.ndarray, camera: Camera | None = None, settings: Any = None) -> bytes:
    """The bytes of a .png or .exr file that `save` writes of a colour picture, linear and premultiplied."""
    if suffix == ".png":
        return png_bytes(image)
    file = io.BytesIO()
    exr.write_to(file, layers.parts_of({"color": image}, layers.about(camera, settings)))
    return file.getvalue()


def pixels(data: bytes) -> np.ndarray:
    """The pixels of a PNG file that `png_bytes` has given: uint8 [h, w, 4] or [h, w, 3], sRGB with straight alpha."""
    return np.asarray(_opened(data))


def to_uint8(image: np.ndarray) -> np.ndarray:
    """Return a picture in 8 bits, as PNG and screens have it: uint8 [h, w, 4], sRGB with straight alpha.

    image: float [h, w, 4] linear premultiplied, or [h, w, 3] linear, as `render` and `over` give; the result has as
    many channels, is contiguous and becomes a Pillow image by `PIL.Image.fromarray(clfur.to_uint8(image))`.
    Raises Error for anything else.
    """
    image = checks.numbers(image, "to_uint8 image", "floats [h, w, 4] or [h, w, 3]", "f")
    if image.ndim != 3 or image.shape[2] not in (3, 4):
        raise Error(f"to_uint8 image is {image.dtype} {list(image.shape)}; allowed: floats [h, w, 4] or [h, w, 3]")
    return _in_bands(image)


def _in_bands(color):
    """`_coded` of a picture, some rows at a time."""
    coded = np.empty(color.shape, np.uint8)
    for top in range(0, len(color), BAND):
        coded[top:top + BAND] = _coded(color[top:top + BAND])
    return coded


def _coded(color):
    """8-bit sRGB with straight alpha of a float picture as `save` takes it."""
    planes = np.ascontiguousarray(np.moveaxis(color, 2, 0), np.float32)
    coded = np.empty(color.shape, np.uint8)
    if len(planes) == 4:
        alpha = np.fmin(np.fmax(planes[3], 0), 1)   # 0 if it is NaN
        with np.errstate(invalid="ignore"):   # where alpha is 0; of NaN the code is 0
            planes = np.minimum(np.maximum(planes[:3], 0), alpha) / alpha
        coded[:, :, 3] = alpha * 255 + 0.5
    for channel, plane in enumerate(planes):
        coded[:, :, channel] = srgb_codes(plane)
    return coded


def _png(path, outputs, _about):
    if "color" not in outputs:
        raise Error("save to .png needs the output 'color'; allowed without it: .exr, .npz")
    path.write_bytes(png_bytes(outputs["color"]))


def _exr(path, outputs, about):
    exr.write(path, layers.parts_of(outputs, about))


def _npz(path, outputs, _about):
    np.savez(path, **outputs)


WRITERS: dict[str, Callable] = {".png": _png, ".exr": _exr, ".npz": _npz}


def _of_png(data):
    """{"color": ...} of a PNG file's bytes."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            picture = Image.open(io.BytesIO(data), formats=["PNG"])
            width, height = picture.size
            if width * height > MAX_PIXELS:
                raise Error(f"has {width} x {height} pixels; allowed: at most {MAX_PIXELS}")
            pixels = np.asarray(picture.convert("RGBA"))
    except Error:
        raise
    except Exception as error:   # a damaged file can fail in any way
        raise Error(f"cannot be read as a picture: {reason(error)}") from error
    alpha = pixels[..., 3:].astype(np.float32) / 255
    return {"color": np.concatenate([srgb_to_linear(pixels[..., :3]) * alpha, alpha], 2, dtype=np.float32)}


READERS: dict[str, Callable] = {
    ".png": _of_png, ".exr": lambda data: layers.outputs_of(exr.read(data)), ".npz": read_arrays}


# --- pictures that are read -----------------------------------------------------------------------------------

# Pillow's names of formats that have 8 bits a channel, or tell how many; of all others nobody knows what is lost.
READ = ["PNG", "JPEG", "MPO", "TIFF", "GIF", "WEBP", "BMP", "DIB", "TGA", "PPM", "PCX", "ICO", "SGI", "JPEG2000",
        "AVIF"]
MAX_PIXELS = 2**27   # of a picture: while it is read, it takes 10 bytes each, 16 where it has 16 bits a channel
UDIM, TILE = r"<UDIM>|%\(UDIM\)d", r"(?!1000)[1-9]\d{3}"   # in a picture's name; and its tiles' numbers
GREY16 = {"I;16", "I;16B", "I;16L", "I;16N"}
# Where the other byte of a channel stands: Pillow keeps one of the two alone.
OTHER_BYTE = {"B": "L", "L": "B", "N": "B" if sys.byteorder == "little" else "L"}


def load_picture(path: str | os.PathLike) -> Any:
    """Return a picture file's pixels as stored, without alpha: an array [h, w, 3], the top row first. Of a name with
    <UDIM> or %(UDIM)d in it, for which 1001 and so on stand in its files' names, {1001: array, ...} of all there are.

    path: str or path-like: PNG or TIFF of 8 or 16 bits a channel, JPEG, GIF, WebP, BMP and others of 8 are uint8 or
    uint16, sRGB; EXR and Radiance's HDR are float32, linear.
    Grey becomes three equal channels, CMYK and palettes become RGB; of several frames the first is taken; the
    orientation that a camera wrote (EXIF) is not applied, since uv is of pixels as they are stored.
    Raises Error, one line that names the file, where it is missing, damaged, no regular file, larger than 2**30 bytes
    or MAX_PIXELS (tiles: together), or has channels that would be cut: more than 8 bits in other formats, floats but of
    EXR and HDR, 16-bit grey with alpha.
    """
    if not is_path(path):
        raise Error(f"load_picture path is {shown(path)}; allowed: a file's name")
    path = Path(path)
    if re.search(UDIM, path.name):
        return _tiles(path)
    if os.path.isdir(path) or not os.path.exists(path):  # pathlib's would raise for names that the system refuses
        problem = "is a folder" if os.path.isdir(path) else "no such file"
        raise Error(f"{path}: {problem}; allowed: a picture file")
    data = read(path)
    try:
        return picture_of(data)
    except Error as error:
        raise Error(f"{path}: {error}") from error.__cause__


def tiles_of(path: str | os.PathLike) -> list[Path]:
    """Return the files that a picture's name stands for: itself, or its UDIM tiles, in their order."""
    path = Path(path)
    found = re.search(UDIM, path.name)
    if not found:
        return [path]
    begin, end = map(re.escape, (path.name[:found.start()], path.name[found.end():]))
    try:
        names = sorted(name for name in os.listdir(path.parent) if re.fullmatch(begin + TILE + end, name))
    except OSError:
        names = []
    return [path.with_name(name) for name in names]


def _tiles(path):
    """Return {number: pixels} of the tiles of a picture."""
    begin = re.search(UDIM, path.name).start()
    tiles, pixels = {}, 0
    for file in tiles_of(path):
        tiles[int(file.name[begin:begin + 4])] = picture = load_picture(file)
        pixels += picture.shape[0] * picture.shape[1]
        if pixels > MAX_PIXELS:
            raise Error(f"{path}: its tiles have more pixels than allowed: at most {MAX_PIXELS} together")
    if not tiles:
        raise Error(f"{path}: no such tiles; allowed: files with a number from 1001 in place of <UDIM>")
    return tiles


def picture_of(data: bytes) -> np.ndarray:
    """Return the pixels of the bytes of a picture file, as `load_picture` does; its errors do not name the file."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")   # of many pixels, which are counted here, and of odd metadata
            return (radiance.decoded(data, MAX_PIXELS) if data.startswith(radiance.MAGIC) else
                    _of_exr(data) if data.startswith(exr.MAGIC) else _pixels(data))
    except Error:
        raise
    except UnidentifiedImageError:
        raise Error(f"cannot be read as a picture; allowed: {', '.join(READ)}, EXR, HDR") from None
    except Image.DecompressionBombError:
        raise Error(f"has more pixels than allowed: at most {MAX_PIXELS}") from None
    except Exception as error:  # a damaged file can fail in any way
        raise Error(f"cannot be read as a picture: {reason(error)}") from error


def _pixels(data):
    """Return the pixels of the bytes of a picture file, as `load_picture` does."""
    picture = _opened(data)
    raw = {str(tile.args if isinstance(tile.args, str) else tile.args[0] if tile.args else "") for tile in picture.tile}
    if raw and raw <= GREY16 and picture.mode.startswith("I"):   # 16 bits of any byte order
        pixels = np.asarray(picture).astype(np.uint16)
        if picture.format == "TIFF" and picture.tag_v2.get(262) == 0:   # white is 0
            pixels = 65535 - pixels
    elif len(raw) == 1 and re.fullmatch("RGB[AX]?;16[BLN]", mode := next(iter(raw))) and not _in_planes(picture):
        pixels = _sixteen(data, mode)
    elif deep := _deep(picture, data, raw):
        raise Error(f"is {picture.format} with {deep}; allowed: 8 bits a channel, and PNG and TIFF of 16, grey or RGB")
    elif picture.mode in ("1", "L", "LA", "La"):
        pixels = np.asarray(picture.convert("L"))
    else:
        pixels = np.asarray(picture if picture.mode == "RGB" else picture.convert("RGB"))
    return np.repeat(pixels[:, :, None], 3, axis=2) if pixels.ndim == 2 else pixels


def _of_exr(data):
    """Return the pixels of the bytes of an EXR file's first part: R, G and B, or Y; others don't count."""
    import Imath
    import OpenEXR

    try:
        if _is_cut(data):   # OpenEXR would write to stderr
            raise EOFError
        opened = OpenEXR.InputFile(io.BytesIO(data))
    except Exception:
        raise Error("is EXR that is cut off or damaged") from None
    with contextlib.closing(opened) as file:
        header = file.header()
        channels, window, whole = header["channels"], header["dataWindow"], header["displayWindow"]
        size = [window.max.y - window.min.y + 1, window.max.x - window.min.x + 1]
        names = ["R", "G", "B"] if {"R", "G", "B"} <= channels.keys() else ["Y", "Y", "Y"]
        if names[0] not in channels:
            raise Error(f"is EXR with the channels {', '.join(sorted(channels))[:60]}; allowed: R, G, B or Y")
        if str(window) != str(whole) or any((channels[name].xSampling, channels[name].ySampling) != (1, 1)
                                            for name in names):
            raise Error("is EXR that stores a part of its picture; allowed: all pixels of its display window")
        if not 0 < size[0] * size[1] <= MAX_PIXELS:
            raise Error(f"has {size[1]} x {size[0]} pixels; allowed: at least 1 and at most {MAX_PIXELS}")
        pixels = np.empty((*size, 3), np.float32)
        for k, name in enumerate(names):
            try:
                of_one = file.channel(name, Imath.PixelType(Imath.PixelType.FLOAT))
            except Exception:
                raise Error("is EXR that is cut off or damaged") from None
            pixels[:, :, k] = np.frombuffer(of_one, np.float32).reshape(size)
    return pixels


def _is_cut(data):
    """Whether the last rows of an EXR file of one part, top to bottom, end behind its bytes; False for others."""
    at, number = 8, lambda place, size=4: int.from_bytes(data[place:place + size], "little")
    with contextlib.suppress(ValueError, IndexError):           # of what is not to be found
        if number(4) & 0x1A00:                                  # tiles, deep data, several parts
            return False
        while data[at:at + 1] not in (b"", b"\0"):             # each attribute: a name, a type, a size, as many bytes
            at = data.index(0, data.index(0, at) + 1) + 1
            at += 4 + number(at)
        places = np.frombuffer(data, "<u8", (number(at + 1, 8) - at - 1) // 8, at + 1)
        if (places[1:] > places[:-1]).all():
            last = int(places[-1])                              # there: a row's number, a size, as many bytes
            return last + 8 > len(data) or last + 8 + number(last + 4) > len(data)
    return False


def _in_planes(picture):
    """Whether a TIFF file has one channel after the other, of which Pillow keeps a byte in another way."""
    return picture.format == "TIFF" and picture.tag_v2.get(284) == 2


def _opened(data):
    """Return Pillow's Image of a file's bytes, before it is decoded; Error if it has too many pixels."""
    from PIL import Image

    Image.init()
    picture = Image.open(io.BytesIO(data), formats=[name for name in READ if name in Image.OPEN])
    width, height = picture.size
    if width * height > MAX_PIXELS:
        raise Error(f"has {width} x {height} pixels; allowed: at most {MAX_PIXELS}")
    return picture


def _sixteen(data, mode):
    """Return a picture of 16 bits a channel as uint16 [h, w, 3]: read twice, once for each byte of a channel.

    mode: how Pillow would unpack it, such as "RGB;16B", which takes a channel's first byte for all of it.
    """
    halves = []
    for other in (False, True):
        picture = _opened(data)
        if other:
            swapped = mode[:-1] + OTHER_BYTE[mode[-1]]
            picture.tile = [tile._replace(args=swapped if isinstance(tile.args, str) else (swapped, *tile.args[1:]))
                            for tile in picture.tile]
        halves.append(np.asarray(picture)[:, :, :3])
    pixels = halves[0].astype(np.uint16)
    pixels <<= 8
    pixels |= halves[1]
    return pixels


def _deep(picture, data, raw):
    """Return in words what of a picture would be cut to 8 bits a channel, or None."""
    if picture.mode == "F":
        return "floats"
    stated = picture.tag_v2.get(258, (1,)) if picture.format == "TIFF" else (1,)
    if picture.mode.startswith("I") or max(stated) > 8 or any(re.search("(?<!BGR);16", mode) for mode in raw):
        return "more than 8 bits a channel, not plain grey or RGB"
    deep = any(tile.codec_name == "SGI16" or (tile.codec_name.startswith("ppm") and tile.args[-1] > 255)
               for tile in picture.tile)
    if picture.format == "JPEG2000":   # how many channels and their bits stand in the segment SIZ
        at = data.find(b"\xff\x4f\xff\x51") + 41
        deep |= any(bits & 127 > 7 for bits in data[at + 1:at + 1 + 3 * data[at]:3])
    if picture.format == "AVIF":
        at = data.find(b"av1C")
        deep |= at < 0 or bool(data[at + 6] & 0x40)
    return "more than 8 bits a channel" if deep else None
