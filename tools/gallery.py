"""Makes the pictures of docs/gallery and the page that shows them, docs/gallery.md.

    python tools/gallery.py                      all that are there
    python tools/gallery.py cat dog              these
    python tools/gallery.py spot --mesh spot.obj of a mesh of your own
    python tools/gallery.py --page               the page and the banner alone, of what was measured before

Each picture is a script of examples/gallery, or a command.  Time is that of a frame in which all but kernels is made
anew, after one that built these: seconds of processor time, and of the clock.  Error is measured as `clfur chart` does:
the root mean square of sRGB values (0 to 1) over black, against `clfur.truth.picture` of a window in the middle (of
shells against themselves in 120 layers), the truth's own noise taken out.
"""

import argparse
import importlib
import json
import shlex
import sys
import tempfile
import time
import warnings
from pathlib import Path

import attrs
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
WINDOW, RAYS = (80, 60), 4                      # pixels; squared, of each of two truths
LOOK = "--look chiang --scattering grid --masks 4 --ground lowest --size 800x600"
COMMANDS = {
    "teapot": ("The teapot, from one command.",
               f"clfur render teapot -o teapot.png {LOOK} --color '#a04810' --root-color '#3a1606' "
               "--tip-color '#e09030' --length 0.1 --alpha 0.15 --roots 200000 --zoom 1.25 --background '#39424a'"),
    "spot": ("[Spot](https://www.cs.cmu.edu/~kmcrane/Projects/ModelRepository/), Keenan Crane's cow (CC0), in a winter "
             "coat: bring the mesh.",
             f"clfur render spot.obj -o spot.png {LOOK} --color '#7a3410' --tip-color '#d09048' --length 0.1 "
             "--alpha 0.2 --tufts 3000:strength=0.7 --roots 220000 --view 150,8 --zoom 1.3 --background '#3c463c'"),
}
ORDER = ["portrait", "cat", "lion", "dog", "swirl", "sheep", "hedgehog", "chick", "meadow", "seal", "rabbit", "letters",
         "dandelion", "wind", "turned", "teapot", "spot"]
BANNER = ["cat", "portrait", "chick", "swirl", "hedgehog"]


def script(name):
    """The module of a picture."""
    sys.path.insert(0, str(SCRIPTS))
    return importlib.import_module(name)


def scene_of(name, mesh):
    """(Scene, Settings) of a picture, made anew."""
    if name not in COMMANDS:
        module = script(name)
        return module.scene(), module.settings
    words = [mesh if word == "spot.obj" else word for word in shlex.split(COMMANDS[name][1])[2:]]
    with render.make_context("render", words) as context:
        scene, _, settings = load_moving(context.params["given"], context.params)
    return scene, settings


def draw(name, mesh, folder):
    """Run the script or the command of a picture -> its file."""
    if name in COMMANDS:
        words = [mesh if word == "spot.obj" else word for word in shlex.split(COMMANDS[name][1])[2:]]
        words[words.index("-o") + 1] = str(folder / f"{name}.png")
        render.main(words, standalone_mode=False)
    else:
        script(name).main(folder)
    return folder / f"{name}.png"


def timed(name, mesh, gpu):
    """{cpu, seconds, strands} of a frame in which all but kernels is made anew."""
    clfur.draw(*[scene_of(name, mesh)[0], gpu, scene_of(name, mesh)[1]])
    scene, settings = scene_of(name, mesh)
    begun = time.process_time()
    frame = clfur.draw(scene, gpu, settings)
    return {"cpu": time.process_time() - begun, "seconds": frame.seconds, "strands": frame.strands}


def window(camera, image, times=1):
    """(column, row) of a window that is well covered, near a picture's middle, and the Camera that sees it alone."""
    (width, height), (wide, tall) = camera.size, WINDOW
    spots = [(x, y) for x in range(width // 4, 3 * width // 4 - wide, 10) for y in range(height // 4, height - tall,
                                                                                         10)]
    x, y = max(spots, key=lambda at: image[at[1]:at[1] + tall, at[0]:at[0] + wide, 3].mean().round(3))
    k = camera.intrinsics.copy()
    k[:2, 2] -= x, y
    k[:2, 2] = (k[:2, 2] + .5) * times - .5
    k[:2, :2] *= times
    return (x, y), clfur.Camera.calibrated(camera.pose, k, (wide * times, tall * times))


def error(name, mesh, gpu):
    """How far a window of the picture is from the truth."""
    scene, settings = scene_of(name, mesh)
    image = clfur.render(scene, gpu, settings)
    if scene.shells is not None:
        (x, y), camera = window(scene.camera, image, OVER)
        fur = [attrs.evolve(part, layers=LAYERS) if part is scene.shells else part
               for part in (scene.fur if isinstance(scene.fur, tuple) else [scene.fur])]
        fine = clfur.render(attrs.evolve(scene, fur=fur, camera=camera), gpu, clfur.Settings(**FINEST))
        true = [fine.reshape(WINDOW[1], OVER, WINDOW[0], OVER, 4).mean((1, 3))] * 2
    else:
        (x, y), camera = window(scene.camera, image)
        orders = truth.ALL if settings.scattering != "off" else 0
        true = [truth.picture(attrs.evolve(scene, camera=camera), RAYS, seed, orders=orders) for seed in (0, 1)]
    part = image[y:y + WINDOW[1], x:x + WINDOW[0]]
    noise = measures.error(*true) / 2
    return float(max(measures.error(part, (true[0] + true[1]) / 2)**2 - noise**2, 0)**.5)


def packed(images, path, kilobytes, **options):
    """Save a picture, or those of a film, as WebP of no more than so many kilobytes."""
    for quality in range(88, 10, -4):
        images[0].save(path, quality=quality, method=6, save_all=len(images) > 1, append_images=images[1:], **options)
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
             "`python examples/gallery/cat.py`, or by one command, and all by `python tools/gallery.py`. Animals are "
             "made by code, too: [animals.py](../examples/gallery/animals.py) joins balls and cones, finds the surface "
             "and says what grows where; [studio.py](../examples/gallery/studio.py) has the lights.", "",
             "Times are of one frame on two cores (PoCL), all but kernels made anew: of the processor, and by the "
             "clock of a machine that others used too. The error is the root mean square of sRGB values over black, "
             f"against [the truth](truth.md) of a window of {WINDOW[0]}x{WINDOW[1]} pixels in the middle, without the "
             "truth's noise (of shells: against themselves in 120 layers), as `clfur chart` measures it.", ""]
    for name in (name for name in ORDER if name in known):
        about = COMMANDS[name][0] if name in COMMANDS else script(name).__doc__.splitlines()[0]
        one = known[name]
        lines += [f"## {name.capitalize()}", "", f"![{name}](gallery/{name}.webp)", "", about, ""]
        lines += ([f"```sh\n{COMMANDS[name][1]}\n```"] if name in COMMANDS else
                  [f"[{name}.py](../examples/gallery/{name}.py)"]) + [""]
        told = [f"{one['strands']:,} strands" if one["strands"] else "shells",
                f"{one['cpu']:.1f} s of processor time ({one['seconds']:.1f} s by the clock)"] if "cpu" in one else []
        lines += [", ".join([*told, *([f"error {one['error']:.3f}"] if "error" in one else [])]), ""]
    PAGE.write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(ORDER)}")
    parser.add_argument("--mesh", help="spot.obj")
    parser.add_argument("--page", action="store_true", help="draw and measure nothing")
    parser.add_argument("--only", choices=["picture", "time", "error"], nargs="*", default=["picture", "time", "error"])
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(ORDER)
    if unknown:
        parser.error(f"no picture {', '.join(unknown)}; there are {', '.join(ORDER)}")
    OUT.mkdir(exist_ok=True)
    warnings.simplefilter("ignore", RuntimeWarning)
    known = json.loads(MEASURED.read_text()) if MEASURED.exists() else {}
    names = [] if arguments.page else arguments.names or [n for n in ORDER if n != "spot" or arguments.mesh]
    gpu = clfur.Scheduler() if names else None
    for name in names:
        one = known.setdefault(name, {})
        if "picture" in arguments.only:
            with tempfile.TemporaryDirectory() as folder:
                put(name, draw(name, arguments.mesh, Path(folder)))
        if "time" in arguments.only:
            one |= timed(name, arguments.mesh, gpu)
        if "error" in arguments.only:
            one["error"] = error(name, arguments.mesh, gpu)
        print(name, one, flush=True)
        MEASURED.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")
    banner()
    page(known)


if __name__ == "__main__":
    sys.exit(main())
