"""Owns the context, queue, programs and buffers; launches kernels and times them; knows no fur."""

import time
import warnings
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
from pyopencl import tools

from . import layout
from .device import choose, describe
from .errors import Error

GROUP = 64          # work-items in a work-group
SPARE = 256 << 20   # bytes that the pool may hold beyond twice of what is in use


def _kernel_dir():
    """Folder of the .cl files: the installed package clfur.cl, or cl/ beside clfur/ in a checkout."""
    try:
        return files("clfur.cl")
    except ModuleNotFoundError:
        return Path(__file__).resolve().parents[1] / "cl"


class Scheduler:
    """One OpenCL device made ready: keep it, and programs, buffers and unchanged stages stay warm.

    ``device`` is whatever `clfur.device.choose` accepts.  Use a scheduler from one thread at a time.
    Raises `clfur.Error` if there is no such device, or for an array that the device cannot hold.
    """

    def __init__(self, device=None):
        self.device = choose(device)
        self.context = cl.Context([self.device])
        self.queue = cl.CommandQueue(self.context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        self.int64_atomics = "cl_khr_int64_extended_atomics" in self.device.extensions.split()
        self.build_seconds = 0.0   # that building programs has taken so far
        self.peak = 0              # most bytes that arrays have taken at once since `start`
        self._pool = tools.MemoryPool(tools.ImmediateAllocator(self.queue))
        self._kernels = {}
        self._kept = {}
        self._log = []
        self._called = None

    def empty(self, shape, dtype):
        """Uninitialised device array, taken from the pool."""
        shape = (shape,) if np.isscalar(shape) else tuple(shape)
        nbytes = int(np.prod(shape, dtype=object)) * np.dtype(dtype).itemsize
        if nbytes > self.device.max_mem_alloc_size:
            raise Error(f"an array of {nbytes / 2**20:,.0f} MiB {shape} is more than {describe(self.device)} can hold "
                        f"in one piece ({self.device.max_mem_alloc_size / 2**20:,.0f} MiB)")
        try:
            # OpenCL has no empty buffers: an empty array is the empty start of a small one.
            whole = cla.empty(self.queue, (max(shape[0], 1), *shape[1:]), dtype, allocator=self._pool)
        except (cl.MemoryError, cl.LogicError, MemoryError):   # a logic error: rounded up beyond the largest piece
            raise Error(f"{describe(self.device)} is out of memory for {nbytes / 2**20:,.0f} MiB {shape}") from None
        self.peak = max(self.peak, self._pool.active_bytes)
        return whole if shape[0] else whole[:0]

    def full(self, shape, dtype, value):
        """Device array filled with one value."""
        there = self.empty(shape, dtype)
        if there.size:   # by the driver: pyopencl's own fill would compile a kernel for it
            pattern = np.dtype(dtype).type(value)
            cl.enqueue_fill_buffer(self.queue, there.base_data, pattern, 0, there.nbytes)
        return there

    def upload(self, array):
        """Copy of a host array on the device."""
        array = np.ascontiguousarray(array)
        there = self.empty(array.shape, array.dtype)
        if array.size:
            there.set(array)
        return there

    def launch(self, name, size, *args):
        """Run kernel "stem.kernel" over ``size`` work-items; ``args`` in the order of its signature."""
        kernel = self._kernels.get(name) or self._build(name.split(".")[0])[name]
        if len(args) != kernel.num_args:
            raise TypeError(f"{name} takes {kernel.num_args} arguments, {len(args)} given")
        size = (size,) if np.isscalar(size) else tuple(size)
        if not all(size):
            return
        size = tuple(map(int, size))
        args = [a.base_data if isinstance(a, cla.Array) else a for a in args]
        # Groups of one size, and what is left over one by one: PoCL compiles a kernel anew for every group size, and
        # would pick another for each number of strands.
        whole = size[0] // GROUP * GROUP
        for begin, count, group in ((0, whole, GROUP), (whole, size[0] - whole, 1)):
            if count:
                event = kernel(self.queue, (count, *size[1:]), (group, *(1 for _ in size[1:])), *args,
                               global_offset=(begin, *(0 for _ in size[1:])))
                self._log.append((self._called or name.split(".")[0], event))

    def keep(self, name, key, build):
        """``build()``, or what it gave last time under this name if ``key`` holds the very same objects."""
        last_key, value = self._kept.get(name, ((), None))
        if len(last_key) != len(key) or not all(a is b or (type(a) in (int, str) and a == b)
                                                for a, b in zip(last_key, key)):
            self._kept.pop(name, None)   # frees the old arrays before new ones are made
            value = build()
            self._kept[name] = (tuple(key), value)
        return value

    def forget(self):
        """Drop every kept stage, so that the next frame is built from the beginning."""
        self._kept.clear()

    def start(self):
        """Begin a new frame: from here on `seconds` and `peak` count anew."""
        self._log.clear()
        self.peak = self._pool.active_bytes
        # Frames of ever new sizes leave ever new pieces in the pool.
        if self._pool.managed_bytes > 2 * self._pool.active_bytes + SPARE:
            self._pool.free_held()

    @contextmanager
    def called(self, name):
        """Count the launches within under this name instead of their kernel file's."""
        self._called = name
        try:
            yield
        finally:
            self._called = None

    def seconds(self):
        """Seconds on the device since `start`, by kernel file: {"strands": 0.007, ...}; waits for them."""
        self.queue.finish()
        total = {}
        for name, event in self._log:
            total[name] = total.get(name, 0.0) + 1e-9 * (event.profile.end - event.profile.start)
        return total

    def _build(self, stem):
        folder = _kernel_dir()
        source = layout.preamble(self.device, self.int64_atomics) + "".join(
            f'#line 1 "{file}"\n{folder.joinpath(file).read_text()}\n' for file in ("common.h", f"{stem}.cl"))
        options = ["-cl-std=CL1.2"]
        if self.device.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT:
            options.append("-cl-fp32-correctly-rounded-divide-sqrt")
        with warnings.catch_warnings():   # Intel's compiler reports that it has compiled
            warnings.simplefilter("ignore", cl.CompilerWarning)
            began = time.perf_counter()
            program = cl.Program(self.context, source).build(options=options)
            self.build_seconds += time.perf_counter() - began
        self._kernels |= {f"{stem}.{k.function_name}": k for k in program.all_kernels()}
        return self._kernels
