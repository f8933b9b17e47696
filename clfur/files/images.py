"""Pictures <-> files; the only importer of imageio and OpenEXR, each where it is needed."""

import os
from pathlib import Path

import numpy as np

from ..color import linear_to_srgb
from ..errors import Error, shown
from ..scene import checks
from . import output
from .output import is_path, output_path, reason, whole

__all__ = ["check_writable", "load_picture", "png", "save"]

BAND = 64   # rows of a picture that are coded at a time: NumPy and OpenEXR hear Ctrl-C only between their steps

# Names of the EXR channels of each output of the renderer, one for each of its last axis.
EXR_CHANNELS = {
    "depth": ("Z",),
    "tangent": ("tangent.X", "tangent.Y", "tangent.Z"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
    "id": ("id",),
    "uv": ("uv.U", "uv.V"),
    "coverage": ("coverage",),
}


def save(path: str | os.PathLike, image: np.ndarray | dict[str, np.ndarray]) -> None:
    """Write a picture to a .png, .exr or .npz file, by suffix: all of it or nothing.

    path: str or path-like. image: float [h, w, 4] linear premultiplied (or [h, w, 3]), or the dict of outputs
    that `render` returns. PNG holds the colour alone, 8-bit sRGB with straight alpha, clipped to 0..1. EXR
    holds linear float32: R, G, B, A (premultiplied), and of a dict also Z (depth), tangent.X and so on; `id`
    is unsigned there, so -1 reads 4294967295. NPZ holds the arrays as they are, a plain one as `color`.
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
    write = WRITERS[file.suffix.lower()]
    with whole(file) as temporary:
        write(temporary, outputs)


def check_writable(path: str | os.PathLike) -> None:
    """Raise Error unless `save` could write to this path; leaves nothing behind."""
    output.check_writable(path, WRITERS)


def png(color: np.ndarray) -> bytes:
    """The bytes of a PNG file, 8-bit sRGB with straight alpha: of a float picture as `save` takes it."""
    import imageio.v3

    coded = np.empty(color.shape, np.uint8)
    for top in range(0, len(color), BAND):
        coded[top:top + BAND] = _coded(color[top:top + BAND])
    return imageio.v3.imwrite("<bytes>", coded, extension=".png")


def _coded(color):
    """8-bit sRGB with straight alpha of a float picture as `save` takes it."""
    color = np.nan_to_num(color.astype(np.float32), nan=0.0, posinf=1.0, neginf=0.0)
    if color.shape[2] == 4:
        alpha = np.clip(color[:, :, 3:], 0, 1)
        straight = np.where(alpha > 0, color[:, :, :3] / np.where(alpha > 0, alpha, 1), 0)
        coded = np.concatenate([linear_to_srgb(straight), alpha], axis=2)
    else:
        coded = linear_to_srgb(color)
    return (coded * 255 + 0.5).astype(np.uint8)


def _png(path, outputs):
    if "color" not in outputs:
        raise Error("save to .png needs the output 'color'; allowed without it: .exr, .npz")
    path.write_bytes(png(outputs["color"]))


def _exr(path, outputs):
    import Imath
    import OpenEXR

    layers = {}   # of each channel: [h, w]
    for name, array in outputs.items():
        names = tuple("RGBA"[: array.shape[2]]) if name == "color" else EXR_CHANNELS.get(name, (name,))
        array = array if array.ndim == 3 else array[:, :, None] if array.ndim == 2 else None
        if array is None or array.shape[2] != len(names):
            raise Error(f"save output {name!r} has the shape {list(outputs[name].shape)}; "
                        f"allowed: [h, w, {len(names)}]")
        layers |= {channel: array[:, :, k] for k, channel in enumerate(names)}
    if len({array.shape for array in layers.values()}) != 1:
        raise Error("save outputs are not all of one size; allowed: arrays of the same [h, w]")
    height, width = next(iter(layers.values())).shape
    header = OpenEXR.Header(width, height) | {"compression": Imath.Compression(Imath.Compression.ZIP_COMPRESSION)}
    header["channels"] = {name: Imath.Channel(Imath.PixelType(Imath.PixelType.UINT if _is_whole(array) else
                                                              Imath.PixelType.FLOAT)) for name, array in layers.items()}
    file = OpenEXR.OutputFile(str(path), header)
    try:
        for top in range(0, height, BAND):   # OpenEXR.File takes all at once, and hears no Ctrl-C meanwhile
            file.writePixels({name: _exr_bytes(array[top:top + BAND]) for name, array in layers.items()},
                             min(BAND, height - top))
    finally:
        file.close()


def _is_whole(array):
    return array.dtype.kind in "iu"


def _exr_bytes(array):
    # EXR has no signed integers; floats would lose ids beyond 2**24.
    return (array.astype(np.int64).astype(np.uint32) if _is_whole(array) else array.astype(np.float32)).tobytes()


def _npz(path, outputs):
    np.savez(path, **outputs)


WRITERS = {".png": _png, ".exr": _exr, ".npz": _npz}


def load_picture(path: str | os.PathLike) -> np.ndarray:
    """Return a picture file's pixels as stored, without alpha: uint8 [h, w, 3], the top row first.

    path: str or path-like, of any format with 8 bits a channel that imageio reads (PNG, JPEG, ...).
    Raises Error, one line that names the file, where it is missing, damaged or has more than 8 bits.
    """
    if not is_path(path):
        raise Error(f"load_picture path is {shown(path)}; allowed: a file's name")
    path = Path(path)
    if not os.path.isfile(path):  # pathlib's would raise for names that the system refuses
        problem = "is a folder" if os.path.isdir(path) else "no such file"
        raise Error(f"{path}: {problem}; allowed: a picture file")
    import imageio.v3

    try:
        mode = imageio.v3.immeta(path, index=0, plugin="pillow").get("mode")
        plain = mode in (None, "1", "L", "LA", "P", "PA", "RGB", "RGBA") or mode.startswith(("I", "F"))
        pixels = imageio.v3.imread(path, index=0, plugin="pillow", **({} if plain else {"mode": "RGB"}))
    except Exception as error:  # a damaged file can fail in any way
        raise Error(f"{path}: cannot be read as a picture: {reason(error)}") from error
    if pixels.dtype == bool:
        pixels = pixels.astype(np.uint8) * 255
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or 0 in pixels.shape:
        raise Error(f"{path}: is {pixels.dtype} {list(pixels.shape)}; allowed: pictures of 8 bits a channel")
    pixels = pixels[:, :, :3] if pixels.shape[2] >= 3 else np.repeat(pixels[:, :, :1], 3, axis=2)
    return np.ascontiguousarray(pixels)
