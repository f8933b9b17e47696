#!/usr/bin/env bash
# Package: OpenImageIO 3.2.2.0 (PyPI), its oiiotool; with OpenEXR 3.5.3 and numpy 2.4.6, which make and read the files.
# Input: an EXR of one channel `id` of type UINT, with the values 0, 16777217, 2147483649 and 4294967294.
# Seen (oiiotool ids.exr -o out.exr): the channel is UINT again, but holds 0, 16777216, 2147483648 and 4294967295: pixels went
#   through 32-bit floats on the way, and the file does not show it. With --native all four are as they were. No warning.
# Why it matters: ids of strands beyond 2^24, and marks at the top of the range, become those of other strands after a mere
#   copy. Ids below are safe either way; hand others on with --native.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check OpenImageIO==3.2.2.0 OpenEXR==3.5.3 numpy==2.4.6

cat > try.py <<'PY'
import subprocess

import numpy as np
import OpenEXR

IDS = np.array([[0, 16777217, 2147483649, 4294967294]], np.uint32)
with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"id": IDS}) as file:
    file.write("ids.exr")


def through(*options):
    subprocess.run(["venv/bin/oiiotool", *options, "ids.exr", "-o", "out.exr"], check=True)
    with OpenEXR.File("out.exr") as out:
        pixels = out.channels()["id"].pixels
    print(*options, pixels.dtype, pixels.tolist())
    return pixels.dtype.name, pixels.tolist()


plain, native = through(), through("--native")
if plain != ("uint32", [[0, 16777216, 2147483648, 4294967295]]) or native != ("uint32", IDS.tolist()):
    raise SystemExit(f"changed: {plain} and {native}")
PY
venv/bin/python try.py
