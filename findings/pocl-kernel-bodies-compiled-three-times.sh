#!/usr/bin/env bash
# Packages: pocl-binary-distribution 3.0 (PyPI; PoCL 3.0 with LLVM 14, for x86-64 Linux), pyopencl 2026.1.4.
# Input: a kernel of 200 statements that LLVM does not fold, and one that calls a function of the same statements, which is
#   `static __attribute__((noinline))`; each is launched over one work-item.
# Seen: the first launch, in which PoCL makes the kernel's machine code, takes more than 1.6 times as much processor time
#   (measured: 2.0 and 2.3 times) where the statements are in the kernel itself. PoCL makes a function of the kernel and two
#   that start it for a work-group, with all of it inlined into each.
# Why it matters: large kernels wait twice as long for their first picture as they need to; a function that is not inlined
#   costs a call for each work-item.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check pyopencl==2026.1.4 pocl-binary-distribution==3.0 numpy==2.4.6

cat > try.py <<'PY'
import sys
import time

import numpy as np
import pyopencl as cl

[platform] = [each for each in cl.get_platforms() if "PoCL 3.0-rc2" in each.version]
context = cl.Context(platform.get_devices()[:1])
queue = cl.CommandQueue(context)
lines = "\n".join(f"if (x > {i}.0f) x = sqrt(x + {i}.5f) * y; else y += native_sin(x) / (y + {i}.0f);" for i in range(200))
body = f"float x = v[i], y = v[i + 1];\n{lines}\nv[i] = x + y;"
inside = f"__kernel void k(__global float *v) {{ const size_t i = get_global_id(0); {body} }}"
called = (f"static __attribute__((noinline)) void all(const size_t i, __global float *v) {{ {body} }}\n"
          "__kernel void k(__global float *v) { all(get_global_id(0), v); }")
empty = "__kernel void k(__global float *v) { }"


def first_launch(source):
    """Seconds of the processor, all threads, that the first launch takes."""
    kernel = cl.Kernel(cl.Program(context, source).build(), "k")
    memory = cl.Buffer(context, cl.mem_flags.READ_WRITE, 1024)
    kernel.set_args(memory)
    began = time.process_time()
    cl.enqueue_nd_range_kernel(queue, kernel, (1,), (1,)).wait()
    return time.process_time() - began


first_launch(empty)   # what the compiler does once
took = {name: first_launch(source) for name, source in (("inside", inside), ("called", called))}
ratio = took["inside"] / took["called"]
print(platform.version, {name: round(seconds, 3) for name, seconds in took.items()}, f"ratio {ratio:.2f}")
sys.exit(ratio < 1.6)
PY
POCL_CACHE_DIR="$dir/kernels" XDG_CACHE_HOME="$dir" PYOPENCL_NO_CACHE=1 bash -c 'mkdir -p kernels; exec venv/bin/python try.py'
