"""Builds programs, past what a driver or clfur has kept of them where that is spoilt."""

import contextlib
import hashlib
import warnings

import pyopencl as cl
from pyopencl.characterize import has_src_build_cache

from .. import cache
from ..errors import Error

KEEPS = not cl._PYOPENCL_NO_CACHE   # which the user's PYOPENCL_NO_CACHE sets


class NoKernelsError(Exception):
    """A program was built, but some of its kernels are not in it."""


def leave_pyopencls_cache():
    """Let pyopencl keep nothing: its lock file and its database break every later start once they are cut short.

    clfur keeps its own programs, and generating a kernel's call takes a millisecond.
    """
    cl._PYOPENCL_NO_CACHE = True


def build(context, device, source, options, names):
    """Build a program -> ({name: kernel} of all these ``names``, whether what was kept of it is spoilt).

    Raises what the driver does, or `NoKernelsError`.
    """
    file = _file(device, source, options)
    if file and (binary := cache.recall_bytes(file)):
        with contextlib.suppress(cl.Error, NoKernelsError):   # else it is of another build of the driver
            return _kernels(cl.Program(context, [device], [binary]), options, names), False
    kernels, failed = None, []
    # A signal cuts PoCL's compiler short: so once more.  Drivers name what they keep by the text behind the preprocessor:
    # that of another one they build anew.
    for text in source, source, f"{source}typedef int built_again;\n":
        program = cl.Program(context, text)
        try:
            kernels = _kernels(program, options, names)
            break
        except (cl.Error, MemoryError, NoKernelsError) as error:
            failed.append(error)
    if kernels is None:
        raise failed[0]
    if file:
        with contextlib.suppress(Error, cl.Error):   # built anew next time
            cache.remember_bytes(file, program.get_info(cl.program_info.BINARIES)[0])
    return kernels, len(failed) == 2


def _kernels(program, options, names):
    with warnings.catch_warnings():   # Intel's compiler reports that it has compiled
        warnings.simplefilter("ignore", cl.CompilerWarning)
        program.build(options=options)
    there = program.get_info(cl.program_info.KERNEL_NAMES).split(";")
    if missing := [name for name in names if name not in there]:
        raise NoKernelsError(f"the program lacks its kernels {', '.join(missing)}")
    # Not by all_kernels: pyopencl's holds each once too often, and so the whole program for good.
    return {name: cl.Kernel(program, name) for name in names}


def _file(device, source, options):
    """The file of a program in clfur's cache; None where the driver keeps it itself, or nothing is to be kept."""
    if not KEEPS or has_src_build_cache(device):
        return None
    what = [device.platform.vendor, device.platform.name, device.platform.version, device.name, device.version,
            device.driver_version, source, options]
    try:
        return cache.folder("programs") / hashlib.sha256(repr(what).encode()).hexdigest()[:32]
    except Error:   # no cache folder
        return None
