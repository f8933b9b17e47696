"""Makes the pictures of docs/gallery and the page that shows them, docs/gallery.md.

    python tools/gallery.py                      all
    python tools/gallery.py cat dog              these
    python tools/gallery.py cat --only time      what is new of it: picture, time or error
    python tools/gallery.py --page               the page and the banner alone, of what was measured before

Each picture is a script of examples/gallery, or a command.  Time is that of a frame in which all but kernels is made
anew, after one that built these: seconds of processor time, and of the clock.  Error is, as in `clfur chart`, the root
mean square of sRGB values (0 to 1) over black against `clfur.truth.picture`, the truth's own noise taken out: in a
window near the middle, of the scene with no more than FEW strands, so much wider and in a picture so much smaller that
each covers as much of a pixel.  Shells are compared to themselves in 120 unfiltered layers.
"""

import argparse
import importlib
import json
import re
import shlex
import sys
import tempfile
import textwrap
import time
import warnings
from pathlib import Path

import attrs
import numpy as np
from PIL import Image, ImageSequence

import clfur
from clfur import measures, truth
from clfur.command.render import render
from clfur.command.scenes import load_moving
from clfur.judge.frontier import FINEST, LAYERS, OVER

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS, OUT, PAGE = ROOT / "examples" / "gallery", ROOT / "docs" / "gallery", ROOT / "docs" / "gallery.md"
MEASURED = OUT / "measured.json"
KILOBYTES, FILM_KILOBYTES, BANNER_KILOBYTES = 90, 400, 250
WINDOW, FEW = (12, 9), 8_000   # pixels, each of OVER * OVER rays; strands
LOOK = "--look chiang --scattering grid --masks 4 --ground lowest --size 800x600"
COMMANDS = {
    "teapot": ("The teapot, from one command.",
               f"clfur render teapot -o teapot.png {LOOK} --color '#a04810' --root-color '#3a1606' "
               "--tip-color '#e09030' --length 0.1 --alpha 0.15 --roots 200000 --zoom 1.25 --background '#39424a'"),
}
LARGEST = ("The largest errors are where hair lies dense: in windows of the sheep's wool the picture is a third to a "
           "half brighter than the truth, in the portrait's about twice as bright, and smoother. That is light from "
           "hair to hair, which is followed in cells ([light](light.md)): direct light alone is too dark in both. "
           "Grass before the meadow's sun is 30 % too dark.")
ORDER = ["portrait", "cat", "lion", "dog", "swirl", "sheep", "hedgehog", "chick", "meadow", "seal", "rabbit", "letters",
         "dandelion", "wind", "turned", "teapot"]
BANNER = ["cat", "portrait", "chick", "swirl", "hedgehog"]


def script(name):
    """The `Picture` of a script."""
    if str(SCRIPTS) not in sys.path:
        sys.path.insert(0, str(SCRIPTS))
    return getattr(importlib.import_module(name), name)


def scene_of(name):
    """(Scene, Settings) of a picture, made anew."""
    if name not in COMMANDS:
        picture = script(name)
        return picture.scene(picture.size), picture.settings
    words = shlex.split(COMMANDS[name][1])[2:]
    with render.make_context("render", words) as context:
        scene, _, settings = load_moving(context.params["given"], context.params)
    return scene, settings


def draw(name, folder):
    """Run the script or the command of a picture -> its file."""
    if name in COMMANDS:
        words = shlex.split(COMMANDS[name][1])[2:]
        words[words.index("-o") + 1] = str(folder / f"{name}.png")
        render.main(words, standalone_mode=False)
    else:
        script(name).draw(folder / f"{name}.png")
    return folder / f"{name}.png"


def timed(name, gpu):
    """{cpu, seconds, strands} of a frame in which all but kernels is made anew."""
    while True:
        scene, settings = scene_of(name)
        begun = time.process_time()
        frame = clfur.draw(scene, gpu, settings)
        if frame.building < .02:
            return {"cpu": time.process_time() - begun, "seconds": frame.seconds, "strands": frame.strands}


def thinned(scene, times):
    """A scene of 1 / times as many pixels across, and 1 / times**2 of its strands, which are times as wide."""
    width, height = (round(side / times) for side in scene.camera.size)
    k = scene.camera.intrinsics * (np.array([[width / scene.camera.size[0]], [height / scene.camera.size[1]], [1]]))
    k[:2, 2] += .5 * (k[0, 0] / scene.camera.intrinsics[0, 0] - 1)
    camera = clfur.Camera.calibrated(scene.camera.pose, k, (width, height))
    fur = scene.strands
    if isinstance(fur, clfur.Strands):
        types = [attrs.evolve(each, width=each.width * times) for each in fur.types]
        fur = attrs.evolve(fur, roots=round(fur.roots / times**2), types=types)
    else:
        few = np.unique(np.linspace(0, len(fur.counts) - 1, round(len(fur.counts) / times**2)).round().astype(int))
        at = np.isin(np.repeat(np.arange(len(fur.counts)), fur.counts), few)
        fur = clfur.Curves(fur.points[at], counts=fur.counts[few], width=fur.width[at] * times, color=fur.color[at],
                           alpha=fur.alpha, look=fur.look)
    return attrs.evolve(scene, camera=camera, fur=fur)


def window(camera, cover):
    """(column, row) of a window that hair covers well, near a picture's middle, and the Camera that sees it alone, in
    OVER times as many pixels across and down."""
    (width, height), (wide, tall) = camera.size, WINDOW
    middle = np.array([width - wide, height - tall]) / 2
    spots = [(x, y) for x in range(width // 5, 4 * width // 5 - wide, 4) for y in range(height // 4, height - tall, 4)]
    spots.sort(key=lambda at: np.hypot(*at - middle))   # max takes the first of those that are covered as well
    x, y = max(spots, key=lambda at: cover[at[1]:at[1] + tall, at[0]:at[0] + wide].mean().round(2))
    k = camera.intrinsics.copy()
    k[:2, 2] -= x, y
    k[:2, 2] = (k[:2, 2] + .5) * OVER - .5
    k[:2, :2] *= OVER
    return (x, y), clfur.Camera.calibrated(camera.pose, k, (wide * OVER, tall * OVER))


def error(name, gpu):
    """How far a window of the picture is from the truth; strands are thinned to FEW first."""
    scene, settings = scene_of(name)
    strands = clfur.draw(scene, gpu, settings).strands
    if scene.shells is None and strands > FEW:
        scene = thinned(scene, (strands / FEW)**.5)
    image, cover = clfur.render(scene, gpu, settings, outputs=("color", "hair_alpha")).values()
    (x, y), camera = window(scene.camera, cover)
    odd, noise = np.indices((OVER, OVER)).sum(0) % 2, 0.0
    if scene.shells is not None:
        fur = [attrs.evolve(part, layers=LAYERS) if part is scene.shells else part
               for part in (scene.fur if isinstance(scene.fur, tuple) else [scene.fur])]
        fine = clfur.render(attrs.evolve(scene, fur=fur, camera=camera), gpu, clfur.Settings(**FINEST))
    else:
        orders = truth.ALL if settings.scattering != "off" else 0
        fine = truth.picture(attrs.evolve(scene, camera=camera), 1, orders=orders)
    fine = fine.reshape(WINDOW[1], OVER, WINDOW[0], OVER, 4).swapaxes(1, 2)
    if scene.shells is None:   # as `clfur chart` has it, of two halves of the rays
        noise = measures.error(*[fine[:, :, odd == side].mean(2) for side in (0, 1)]) / 2
    part = image[y:y + WINDOW[1], x:x + WINDOW[0]]
    return float(max(measures.error(part, fine.mean((2, 3)))**2 - noise**2, 0)**.5)


def packed(images, path, kilobytes, **options):
    """Save a picture, or those of a film, as WebP of no more than so many kilobytes."""
    film = len(images) > 1
    for quality in range(72, 10, -20) if film else range(88, 10, -4):
        images[0].save(path, quality=quality, method=4, save_all=film, append_images=images[1:], **options)
        if path.stat().st_size < 1000 * kilobytes:
            break
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1000} kB, quality {quality}", flush=True)


def put(name, file):
    """Keep a picture in docs/gallery."""
    with Image.open(file) as opened:
        images = [frame.convert("RGB") for frame in ImageSequence.Iterator(opened)]
    film = len(images) > 1
    packed(images, OUT / f"{name}.webp", FILM_KILOBYTES if film else KILOBYTES,
           **({"duration": 1000 // 24, "loop": 0, "minimize_size": True} if film else {}))


def banner(height=300, width=1500):
    """A strip of parts of pictures."""
    each = width // len(BANNER)
    strip = Image.new("RGB", (each * len(BANNER), height))
    for number, name in enumerate(BANNER):
        with Image.open(OUT / f"{name}.webp") as opened:
            scale = max(height / opened.height, each / opened.width)
            image = opened.convert("RGB").resize((round(opened.width * scale), round(opened.height * scale)),
                                                 Image.LANCZOS)
        left = (image.width - each) // 2
        strip.paste(image.crop((left, 0, left + each, height)), (number * each, 0))
    packed([strip], OUT / "banner.webp", BANNER_KILOBYTES)


def page(known):
    """Write the page of all pictures that were measured."""
    lines = ["# Gallery", "",
             "Each picture is made by one script of [examples/gallery](../examples/gallery), as "
             "`python examples/gallery/cat.py` (`-o FILE`, `--size WxH`), or by one command, and all by "
             "`python tools/gallery.py`. A script is a coat. What the coat is on is made by code, too, in "
             "[models](../examples/gallery/models): there [animals.py](../examples/gallery/models/animals.py) joins "
             "balls and cones to a body, and a file for each animal says where on it face, ears and belly are. "
             "[studio.py](../examples/gallery/studio.py) has the lights.", "",
             "Times are processor time (PoCL, two cores) of one frame in which all but kernels is made anew. The error "
             "is, as in `clfur chart`, the root mean square of sRGB values over black against [the truth](truth.md), "
             f"without its noise: in a window near the middle, of the scene with {FEW:,} strands at most, so much "
             "wider and in a picture so much smaller that each covers as much of a pixel. Shells are compared to "
             "themselves in 120 layers.", "", LARGEST, ""]
    for name in (name for name in ORDER if name in known):
        about = COMMANDS[name][0] if name in COMMANDS else script(name).about
        one = known[name]
        lines += [f"## {name.capitalize()}", "", f"![{name}](gallery/{name}.webp)", "", about, ""]
        lines += ([f"```sh\n{COMMANDS[name][1]}\n```"] if name in COMMANDS else
                  [f"[{name}.py](../examples/gallery/{name}.py)"]) + [""]
        told = [f"{one['strands']:,} strands" if one["strands"] else "shells",
                f"{one['cpu']:.1f} s"] if "cpu" in one else []
        lines += [", ".join([*told, *([f"error {one['error']:.3f}"] if "error" in one else [])]), ""]
    lines = [line if line.startswith(("#", "!", "```")) else wrapped(line) for line in lines[:-1]]
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")


def wrapped(line):
    """A paragraph as lines; code is not broken."""
    whole = re.sub("`[^`]*`", lambda code: code[0].replace(" ", "\0"), line)
    return textwrap.fill(whole, 120, break_long_words=False, break_on_hyphens=False).replace("\0", " ")


def keep(name=None, **numbers):
    """Add numbers of a picture to those that are kept -> all of them."""
    known = json.loads(MEASURED.read_text(encoding="utf-8")) if MEASURED.exists() else {}
    if name is not None:
        print(name, numbers, flush=True)
        known[name] = {**known.get(name, {}), **numbers}
        MEASURED.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return known


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(ORDER)}")
    parser.add_argument("--page", action="store_true", help="draw and measure nothing")
    parser.add_argument("--only", choices=["picture", "time", "error"], nargs="*", default=["picture", "time", "error"])
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(ORDER)
    if unknown:
        parser.error(f"no picture {', '.join(unknown)}; there are {', '.join(ORDER)}")
    OUT.mkdir(exist_ok=True)
    warnings.simplefilter("ignore", RuntimeWarning)
    names = [] if arguments.page else arguments.names or ORDER
    gpu = clfur.Scheduler() if names else None
    for name in names:
        if "picture" in arguments.only:
            with tempfile.TemporaryDirectory() as folder:
                put(name, draw(name, Path(folder)))
        if "time" in arguments.only:
            keep(name, **timed(name, gpu))
        if "error" in arguments.only:
            keep(name, error=error(name, gpu))
    known = keep()
    banner()
    page(known)


if __name__ == "__main__":
    sys.exit(main())
