"""A picture laid over what is behind it."""

from typing import Any

import numpy as np

from ..color import linear_of
from ..errors import Error
from . import checks
from .mips import halved


def over(image: np.ndarray, background: Any) -> np.ndarray:
    """Return a picture laid over a background: float32 [h, w, 3], linear light, without alpha.

    image: float [h, w, 4], linear and premultiplied, as `render` gives it. background: a colour [3] or a picture
    [h', w', 3] of the same aspect: linear light, or sRGB where it is uint8 or uint16. A picture of another size is
    scaled: halved by mean while it is twice as large, then bilinear. C = image + (1 - alpha) background (Porter and
    Duff 1984, "over"). Raises Error for other shapes, other aspects and negative light.
    """
    image = checks.numbers(image, "over image", "floats [h, w, 4]", "f")
    if image.ndim != 3 or image.shape[2] != 4 or 0 in image.shape:
        checks.refuse("over image", image, "floats [h, w, 4]")
    behind = _scaled(backdrop(background, image.shape[1::-1], "over background"), image.shape[1::-1])
    return (image[..., :3] + (1 - image[..., 3:]) * behind).astype(np.float32)


def backdrop(value: Any, size: tuple[int, int], where: str) -> np.ndarray:
    """Return a background for a picture of (width, height), a float32 colour [3] or picture [h, w, 3] of linear light;
    Error where its aspect is another, by half a pixel or more."""
    allowed = "a colour [3] or a picture [h, w, 3], of linear light >= 0, or of uint8 or uint16 (sRGB)"
    array = checks.numbers(value, where, allowed)
    if array.ndim not in (1, 3) or array.shape[-1] not in (3, *[4] * (array.ndim == 3)) or 0 in array.shape:
        checks.refuse(where, value, allowed)
    if array.ndim == 3:
        (width, height), (tall, wide) = size, array.shape[:2]
        if abs(wide * height / tall - width) >= .5 and abs(tall * width / wide - height) >= .5:
            raise Error(f"{where} has {wide} x {tall} pixels; allowed: the aspect of the picture, {width} x {height}")
    return checks.float32(linear_of(array[..., :3]), where, checks.LARGEST, 0)


def _scaled(picture, size):
    """A picture [h, w, 3] at another size, (width, height); a colour [3] as it is."""
    if picture.ndim == 1 or picture.shape[1::-1] == size:
        return picture
    for axis in (0, 1):
        while picture.shape[axis] >= 2 * size[1 - axis]:
            picture = halved(picture, axis)
        at = np.clip((np.arange(size[1 - axis]) + .5) * picture.shape[axis] / size[1 - axis] - .5,
                     0, picture.shape[axis] - 1)
        low = at.astype(int)
        high, share = np.minimum(low + 1, picture.shape[axis] - 1), (at - low).astype(np.float32)
        share = share[:, None, None] if axis == 0 else share[:, None]
        picture = (1 - share) * picture.take(low, axis) + share * picture.take(high, axis)
    return picture
