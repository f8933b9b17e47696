"""Builds sdist and wheel as for a release, installs the wheel in an empty environment of each Python, and draws there.

    python tools/wheels.py                  Pythons 3.10 to 3.14 that are found: on PATH, and those of pyenv
    python tools/wheels.py 3.12 3.14        these alone
    python tools/wheels.py --this           this Python alone: what .ci/run does
    python tools/wheels.py --keep dist      also leave sdist and wheel in a folder

The wheel is built from what the sdist holds.  A line for each Python; exit code 0: all of them install, tell the right
version and draw the same teapot.  Needs setuptools, a package index, and minutes the first time.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = [f"3.{minor}" for minor in range(10, 15)]
DRAW = ["render", "teapot", "-o", "a.png", "--size", "32x24", "--roots", "300"]
LOOK = ("import clfur, imageio.v3, sys; picture = imageio.v3.imread('a.png'); print(clfur.__version__); "
        "assert picture.shape == (24, 32, 4) and picture[..., 3].max() == 255 and picture.std() > 20, picture.std()")


def run(command, folder, **more):
    """Output of a command in a folder, without what the checkout or the shell would put in its way."""
    unwanted = "PYTHONPATH", "CLFUR_DEVICE", "PYOPENCL_CTX", "VIRTUAL_ENV"
    environment = {name: text for name, text in os.environ.items() if name not in unwanted} | more
    done = subprocess.run([str(part) for part in command], cwd=folder, env=environment, capture_output=True, text=True,
                          encoding="utf-8", errors="replace")
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines() or ["nothing was said"]
        raise RuntimeError(f"{Path(str(command[0])).name} {' '.join(map(str, command[1:4]))}: {said[-1]}")
    return done.stdout


def build(folder):
    """(sdist, wheel that is built from it), as pip does."""
    run([sys.executable, "-c", f"from setuptools import build_meta; build_meta.build_sdist({str(folder)!r})"], ROOT)
    sdist, = folder.glob("*.tar.gz")
    run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, sdist], folder)
    wheel, = folder.glob("*.whl")
    return sdist, wheel


def pythons():
    """{"3.10": its program} of those that are found."""
    root = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    found = {}
    for name in PYTHONS:
        places = sorted(root.glob(f"versions/{name}.*/bin/python"))
        for program in [*filter(None, [shutil.which(f"python{name}")]), *map(str, places)]:
            try:
                told = run([program, "-c", "import sys, venv, ensurepip; print(sys.version_info[:2])"], root.parent)
            except (RuntimeError, OSError):   # pyenv's own name for one that is not chosen; Debian's without venv
                continue
            if told.strip() == f"(3, {name[2:]})":
                found.setdefault(name, program)
    return found


def install(python, wheel, version, folder):
    """Install the wheel in an empty environment and draw there -> the device's line, or raises RuntimeError."""
    run([python, "-m", "venv", folder / "venv"], folder)
    there = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    run([there / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", wheel], folder)
    told = run([there / "clfur", "--version"], folder).split()[-1]
    drawn = run([there / "clfur", *DRAW], folder)
    looked = run([there / "python", "-c", LOOK], folder).strip()
    if not told == looked == version:
        raise RuntimeError(f"versions differ: {told}, {looked}, {version}")
    return re.search(r" on (.*?) \(tess|$", drawn)[1] or drawn.strip()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="3.N", help="these Pythons alone")
    parser.add_argument("--this", action="store_true", help="this Python alone")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="leave sdist and wheel there")
    options = parser.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        sdist, wheel = build(folder)
        version = wheel.name.split("-")[1]
        print("; ".join(f"{file.name}: {file.stat().st_size / 2**20:.1f} MiB" for file in (sdist, wheel)), flush=True)
        if options.keep:
            options.keep.mkdir(parents=True, exist_ok=True)
            for file in sdist, wheel:
                shutil.copy(file, options.keep)
        here = ".".join(map(str, sys.version_info[:2]))
        found = {here: sys.executable} if options.this else pythons()
        for name in options.names or (found if options.this else PYTHONS):
            began, place = time.monotonic(), folder / name
            place.mkdir()
            try:
                said = "is not here" if name not in found else (
                    f"installs and draws on {install(found[name], wheel, version, place)}")
            except RuntimeError as error:
                said, bad = str(error), bad + 1
            print(f"Python {name} {said} ({time.monotonic() - began:.0f} s)", flush=True)
            shutil.rmtree(place)
    return int(bad > 0 or not found)


if __name__ == "__main__":
    sys.exit(main())
