"""Pictures, charts and tables that tools/figures.py makes, as files."""

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from clfur.color import linear_to_srgb

KILOBYTES = 300                                            # no figure is larger


def size_of(mesh):
    """The distance of the mesh's furthest point from the middle of its box."""
    return float(np.linalg.norm(mesh.positions - mesh.bounds[0], axis=1).max())


def sheet(path, title, columns, rows):
    """Save rows of (label, images) under column headings as one PNG on white, in as many colours as fit KILOBYTES."""
    gap, top, left = 6, 46, 26
    height, width = rows[0][1][0].shape[:2]
    across, down = left + len(columns) * (width + gap) + gap, top + len(rows) * (height + gap)
    figure = Figure((across / 100, down / 100), dpi=100, facecolor="white")
    figure.text(gap / across, 1 - 4 / down, title, va="top", fontsize=9, weight="bold")
    for j, (label, images) in enumerate(rows):
        y = top + j * (height + gap)
        figure.text(4 / across, 1 - (y + height / 2) / down, label, rotation=90, va="center", fontsize=8)
        for i, image in enumerate(images):
            x = left + i * (width + gap)
            figure.figimage(linear_to_srgb(image[..., :3] + 1 - image[..., 3:]), x, down - y - height)
            if j == 0:
                figure.text((x + 2) / across, 1 - (top - 4) / down, columns[i], va="bottom", fontsize=8)
    save(figure, path)


def save(figure, path):
    """Write a figure, with fewer colours where it would be too large."""
    figure.savefig(path, facecolor="white")
    whole = Image.open(path).convert("RGB")
    for colors in (256, 128, 64, 32, 16, 8):
        whole.quantize(colors, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size < KILOBYTES * 1000:
            break
    print(f"{path}: {path.stat().st_size // 1000} kB", flush=True)


def write(path, text):
    """Print a text and keep it in a file."""
    print(text)
    path.write_text(text + "\n", encoding="utf-8")
    print(f"{path}", flush=True)


def line(*cells):
    """A row of a Markdown table."""
    return "| " + " | ".join(c if isinstance(c, str) else " | ".join(c) for c in cells) + " |"
