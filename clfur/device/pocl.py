"""PoCL 3.0 on a processor that is newer than its compiler: without this it builds no program there.

PoCL hands Clang the name that LLVM has for the processor.  LLVM 14, which the wheel on PyPI holds, calls those that it
does not know "generic" (AMD's Zen 5), and Clang refuses that name: "unknown target CPU 'generic'" (PoCL's issues 512
and 1049).  A Zen 4 it calls "znver3", which has no AVX-512, while PoCL takes its own library for AVX-512: the compiler
ends the process.  No variable and no option overrides it, so the name is put right where the driver keeps it.
"""

import ctypes
import os
import struct
from pathlib import Path

TRIPLE, NAME = 632, 640   # in PoCL 3.0's struct of a device: pointers to LLVM's target and to the processor's name
BUILD = "PoCL 3.0-rc2", "LLVM 14."   # of the wheel, in the platform's version: the only one with these places
NEWER = b"generic", b"znver3"   # what LLVM 14 calls processors that it does not know
# PoCL takes its own library by the processor's features; the name must allow for the same ones.
NEAREST = [("skylake-avx512", {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}),
           ("haswell", {"avx2", "fma", "bmi2", "f16c"}), ("x86-64", set())]


def name_processor(device):
    """Give a `pyopencl.Device` of PoCL 3.0's wheel the nearest processor that its compiler knows, if it knows none."""
    if all(part in device.platform.version for part in BUILD):
        rename(device.int_ptr)


def rename(place):
    """Change the name in the struct at address ``place`` if it is one of `NEWER` -> the new name, or None.

    What is there is read by the system, which refuses where a pointer would end the process.
    """
    try:
        memory = os.open("/proc/self/mem", os.O_RDONLY)
    except OSError:
        return None
    try:
        triple, name = struct.unpack("<2Q", os.pread(memory, 16, place + TRIPLE))
        now = os.pread(memory, 8, name).partition(b"\0")[0]
        if os.pread(memory, 7, triple) != b"x86_64-" or now not in NEWER:
            return None
    except (OSError, OverflowError, struct.error):
        return None
    finally:
        os.close(memory)
    nearest = next(known for known, needs in NEAREST if needs <= features())
    if now == b"znver3" and nearest != NEAREST[0][0]:   # a Zen 3, by its right name
        return None
    copy = ctypes.CDLL(None).strdup   # by the C library: the driver may free it
    copy.restype = ctypes.c_void_p
    ctypes.c_void_p.from_address(place + NAME).value = copy(nearest.encode())
    return nearest


def features():
    """Names of the processor's features, as Linux reports them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return set()
    return next((set(line.partition(":")[2].split()) for line in lines if line.startswith("flags")), set())
