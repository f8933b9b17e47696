"""COLMAP's cameras.bin and images.bin, or .txt, of a folder -> Cameras.

Little-endian.  cameras.bin: uint64, how many; of each uint32 id, int32 model, uint64 width and height, float64 numbers
of its model.  images.bin: uint64, how many; of each uint32 id, float64 quaternion w, x, y, z and translation x, y, z
from the world to the camera (x right, y down, z forward), uint32 id of its camera, name and a zero byte, uint64 how
many points, 24 bytes each.  Text: the same numbers, a line for each camera, two for each image, the second of them its
points.  The origin of pixels is the corner of the top-left one, as in clfur.
"""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Error, shown
from ..scene import Camera
from .input import lines, plain, read
from .output import is_path

# By their numbers: names, how many focal lengths there are, and numbers in all, of which those behind the principal
# point bend lines.
MODELS = {0: ("SIMPLE_PINHOLE", 1, 3), 1: ("PINHOLE", 2, 4), 2: ("SIMPLE_RADIAL", 1, 4), 3: ("RADIAL", 1, 5),
          4: ("OPENCV", 2, 8), 5: ("OPENCV_FISHEYE", 2, 8), 6: ("FULL_OPENCV", 2, 12), 7: ("FOV", 2, 5),
          8: ("SIMPLE_RADIAL_FISHEYE", 1, 4), 9: ("RADIAL_FISHEYE", 1, 5), 10: ("THIN_PRISM_FISHEYE", 2, 12)}
STRAIGHT = 0, 1, 2, 3, 4, 6   # models without distortion where these are 0
POINT = 24                    # bytes of a point of an image
OF_IMAGE = 10                 # words of an image's first line


def load_colmap(folder: str | os.PathLike) -> dict[str, Camera]:
    """Return the cameras of COLMAP's model in a folder: {name of each image: `Camera`}, in the order of the file.

    folder: str or path-like; it holds cameras.bin and images.bin, or else cameras.txt and images.txt. The world is that
    of the model, in its units, which has no up. Images of a camera model that bends lines are refused, as clfur does
    not: first undistort them (colmap image_undistorter); SIMPLE_PINHOLE and PINHOLE are read, and SIMPLE_RADIAL,
    RADIAL, OPENCV and FULL_OPENCV where their distortion is 0. Raises Error, one line that names the file, for one that
    is missing, damaged, cut short, no regular file or of more than 2**30 bytes.
    """
    if not is_path(folder):
        raise Error(f"load_colmap folder is {shown(folder)}; allowed: a folder's name")
    where = Path(folder)
    suffix = next((each for each in (".bin", ".txt") if all(
        os.path.exists(where / f"{name}{each}") for name in ("cameras", "images"))), None)
    if suffix is None:
        raise Error(f"{where}: has no model of COLMAP; allowed: a folder with cameras.bin and images.bin, or .txt")
    readers: tuple[Callable, Callable] = (_cameras, _images) if suffix == ".bin" else (_cameras_text, _images_text)
    cameras, images = (_told(where / f"{name}{suffix}", reader) for name, reader in zip(("cameras", "images"), readers))
    found: dict[str, Camera] = {}
    for name, (quaternion, place, number) in images:
        try:
            if name in found:
                raise Error("is there twice")
            if number not in cameras:
                raise Error(f"is of camera {number}, which cameras{suffix} has not")
            model, size, numbers = cameras[number]
            found[name] = _camera(model, size, numbers, quaternion, place)
        except Error as error:
            raise Error(f"{where / f'images{suffix}'}: image {name!r:.60}: {error}") from None
    return found


def _told(path, reader):
    """What a reader gives of a file's bytes; its errors name the file."""
    try:
        return reader(read(path))
    except Error as error:
        raise Error(f"{error}" if f"{path}" in f"{error}" else f"{path}: {error}") from None
    except (struct.error, IndexError):
        raise Error(f"{path}: is damaged or cut short") from None
    except (ValueError, OverflowError) as error:
        raise Error(f"{path}: is damaged: {f'{error}'.splitlines()[0]:.80}") from None


def _camera(model, size, numbers, quaternion, place):
    """The Camera of an image: its camera's model, size and numbers, and its pose."""
    name, focals, _ = MODELS[model]
    bend = numbers[focals + 2:]
    if model not in STRAIGHT or any(bend):
        raise Error(f"its camera is of the model {name}, which bends lines; allowed: SIMPLE_PINHOLE or PINHOLE, as "
                    "colmap image_undistorter writes, or another whose distortion is 0")
    fx, fy, (cx, cy) = numbers[0], numbers[focals - 1], numbers[focals:focals + 2]
    length = float(np.linalg.norm(quaternion))
    if not 0 < length < np.inf:
        raise Error(f"its rotation is {quaternion}; allowed: a quaternion that is not zero")
    w, x, y, z = np.array(quaternion) / length
    rotation = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                         [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                         [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    # OpenCV's origin of pixels is half a pixel further than COLMAP's.
    return Camera.from_opencv([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]], rotation, place, size)


def _cameras(data):
    """{id: (model, (width, height), numbers)} of cameras.bin."""
    (count,), at, found = struct.unpack_from("<Q", data), 8, {}
    for _ in range(count):
        number, model, width, height = struct.unpack_from("<IiQQ", data, at)
        if model not in MODELS:
            raise Error(f"camera {number} is of the model {model}; allowed: 0 to {max(MODELS)}")
        found[number] = model, (width, height), struct.unpack_from(f"<{MODELS[model][2]}d", data, at + 24)
        at += 24 + 8 * MODELS[model][2]
    _check_end(data, at)
    return found


def _images(data):
    """[(name, (quaternion, translation, camera's id))] of images.bin."""
    (count,), at, found = struct.unpack_from("<Q", data), 8, []
    for _ in range(count):
        _, *pose, camera = struct.unpack_from("<I7dI", data, at)
        end = data.index(b"\0", at + 64)
        found.append((data[at + 64:end].decode("utf-8", "replace"), (pose[:4], pose[4:], camera)))
        points, = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + POINT * points
        if at > len(data):
            raise Error(f"is damaged or cut short: an image states {points} points, but it has {len(data)} bytes")
    _check_end(data, at)
    return found


def _check_end(data, at):
    if at != len(data):
        raise Error(f"has {len(data) - at} bytes more than its count says")


def _cameras_text(data):
    """`_cameras` of cameras.txt."""
    found, names = {}, {name: (model, numbers) for model, (name, _, numbers) in MODELS.items()}
    for line in lines(plain(data)):
        words = line.decode("utf-8", "replace").split()
        if not words or words[0].startswith("#"):
            continue
        number, name, width, height, *numbers = words
        if name not in names:
            raise Error(f"camera {number:.20} is of the model {name!r:.40}; allowed: {', '.join(names)}")
        model, count = names[name]
        if len(numbers) != count:
            raise Error(f"camera {number:.20} of the model {name} has {len(numbers)} numbers; allowed: {count}")
        found[int(number)] = model, (int(width), int(height)), tuple(map(float, numbers))
    return found


def _images_text(data):
    """`_images` of images.txt."""
    found: list[Any] = []
    rows = iter(lines(plain(data)))
    for line in rows:
        words = line.decode("utf-8", "replace").strip().split(maxsplit=OF_IMAGE - 1)
        if not words or words[0].startswith("#"):
            continue
        if len(words) < OF_IMAGE:
            raise Error(f"has an image of {len(words)} words; allowed: {OF_IMAGE}, IMAGE_ID, QW, QX, QY, QZ, TX, TY, "
                        "TZ, CAMERA_ID, NAME, and its points in the next line")
        pose = [float(word) for word in words[1:8]]
        found.append((words[9], (pose[:4], pose[4:], int(words[8]))))
        next(rows, None)   # its points
    return found
