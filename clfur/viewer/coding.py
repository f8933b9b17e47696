"""Pictures as a page takes them."""

import io

import numpy as np

from ..color import linear_to_srgb

BACKGROUND = 38, 39, 42   # sRGB behind the picture: the page's own, which JPEG without alpha is laid over
CODES = 4096              # of linear light, whose sRGB stands in a table: moving pictures need no more
QUALITY = 85              # of JPEG

_TABLE = np.round(255 * linear_to_srgb(np.linspace(0, 1, CODES))).astype(np.uint8)


def background() -> str:
    """The page's background, as CSS has it."""
    return "#{:02x}{:02x}{:02x}".format(*BACKGROUND)


def jpeg(image: np.ndarray) -> bytes:
    """The bytes of a JPEG file of a picture, float32 [h, w, 4] linear and premultiplied, laid over the background.

    It is laid over in sRGB, as browsers lay a PNG file over a page: the final picture's edges are the same.
    """
    from PIL import Image

    alpha = np.clip(image[..., 3:], 0, 1)
    straight = image[..., :3] / np.maximum(alpha, 1e-6)
    np.clip(straight, 0, 1, out=straight)
    straight *= CODES - 1
    coded = _TABLE[straight.astype(np.uint16)]
    if alpha.min(initial=1) < 1:
        coded = np.round(np.float32(BACKGROUND) + (coded - np.float32(BACKGROUND)) * alpha).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(coded).save(file, "JPEG", quality=QUALITY)
    return file.getvalue()
