"""Moving pictures as a page takes them."""

import io

import numpy as np

from .. import to_uint8

BACKGROUND = 38, 39, 43   # sRGB behind the picture: the page's own, which JPEG without alpha is laid over
QUALITY = 85              # of JPEG


def background() -> str:
    """The page's background, as CSS has it."""
    return "#{:02x}{:02x}{:02x}".format(*BACKGROUND)


def jpeg(image: np.ndarray) -> bytes:
    """The bytes of a JPEG file of a picture, float32 [h, w, 4] linear and premultiplied, laid over the background.

    It is laid over in sRGB, as browsers lay a PNG file over a page: the final picture's edges are the same.
    """
    from PIL import Image

    picture = Image.fromarray(to_uint8(image))
    page = Image.new("RGB", picture.size, BACKGROUND)
    page.paste(picture, mask=picture)
    file = io.BytesIO()
    page.save(file, "JPEG", quality=QUALITY)
    return file.getvalue()
