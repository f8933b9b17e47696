"""Owns the context, queue, programs and buffers; launches kernels and times them; knows no fur."""

import functools
import math
import operator
import re
import threading
import time
import warnings
import weakref
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
from pyopencl import tools

from .. import cache, layout
from ..errors import DeviceError, Error, Stopped, go_on, shown
from . import caches, pocl, programs, signature, source
from .ahead import Ahead, starts
from .memory import allowed, in_large_pages, planned
from .selection import CHECKER, check_process, choose, describe, is_shared

GROUP = 64          # work-items in a work-group, where a kernel doesn't state how many it has
FIRST = 256         # work-items in the first piece of a launch
MOST = 65_472       # work-items in any piece: PoCL compiles a kernel anew for 2^16 and more
PIECE = 0.1         # seconds that a piece of a launch should take, so that Ctrl-C need not wait long
SMALL = 1 << 18     # bytes of an upload that is copied first, so as not to be waited for
TINY = 1 << 12      # bytes of one that a processor's driver copies at once, without waking another thread for it
ABREAST = 16        # work-items that share the steps of loops, at most
LARGE = 1 << 22     # bytes of an array in which there is a large page, wherever it begins
SPARE = 256 << 20   # bytes that the pool may hold beyond twice of what the last frame used


@functools.cache
def sources() -> str:
    """A hash of what this version of clfur consists of: a change anywhere may change times and pictures."""
    here, kernels = Path(__file__).parents[1], source.kernel_dir()
    return cache.digest([[path.name, path.read_bytes()] for path in [*sorted(here.rglob("*.py")), *sorted(
        (path for path in kernels.iterdir() if path.name.endswith((".cl", ".h"))), key=lambda path: path.name)]])


def _bytes(memory):
    """What `Scheduler.memory` takes as an int."""
    try:
        number = 0 if isinstance(memory, (bool, np.bool_)) else operator.index(memory)
    except Exception:   # an object's own conversion can raise anything
        number = 0
    if number < 1:
        raise Error(f"Scheduler.memory is {shown(memory)}; allowed: None or a number of bytes >= 1")
    return int(number)


class Scheduler:
    """One OpenCL device made ready: keep it, and programs, buffers and unchanged stages stay warm.

    ``device`` is whatever `clfur.device.choose` accepts.  ``memory``: bytes that arrays may take on the device in all,
    three quarters of what it has if None; never more than this process may still take, where that is the same memory.
    A scene that needs more is drawn part by part.  One thread at a time can
    draw with a scheduler.  Raises `clfur.Error` if there is no such device, for an array that the device cannot hold,
    and (`DeviceError`) for what goes wrong on the device.
    """

    def __init__(self, device: Any = None, memory: int | None = None) -> None:
        self.device = choose(device)
        self.name = describe(self.device)
        pocl.name_processor(self.device)
        with self._watched("does not start"), caches.unheard():   # drivers start threads
            self.context = cl.Context([self.device])
            self.queue = cl.CommandQueue(self.context, properties=cl.command_queue_properties.PROFILING_ENABLE)
            self.int64_atomics = "cl_khr_int64_extended_atomics" in self.device.extensions.split()
            # What this process may take, pictures on the host and all, and what says so.
            self.allowed = allowed(self.device.max_compute_units, is_shared(self.device))
            self.memory, _ = planned(self.device.global_mem_size, self.allowed)
            # Work-items fill these by hand where a driver prefers vectors: PoCL does not vectorise loops of different
            # lengths.  Two of 16 at once hide what each waits for; only PoCL takes vectors that OpenCL doesn't name.
            self.lanes = max((n for n in (1, 8, 16) if n <= self.device.preferred_vector_width_float), default=1)
            is_pocl = self.device.platform.name == "Portable Computing Language"
            if self.lanes == 16 and is_pocl:
                self.lanes = 32
            # Intel's fills them with work-items, unless a kernel tells it not to.
            by_itself = self.lanes == 1 and self.device.type & cl.device_type.CPU
            self.hinted = 8 if by_itself and self.device.native_vector_width_float >= 8 else 1
            self.largest = self.device.max_mem_alloc_size   # bytes of one array
            # It works in the host's memory.  Oclgrind 21.10 takes what lies there for uninitialized: see findings/.
            self.on_host = bool(self.device.type & cl.device_type.CPU) and self.device.platform.name != CHECKER
            self.makes = self.on_host and is_pocl   # it makes kernels when they first run
            self.large_pages = self.on_host and is_pocl   # Intel's gains nothing, and rusticl 22.3 fails to unmap
            # It ends loops after so many steps, silently: of all loops together, and of work-items side by side.
            self.steps = 65_535 if "llvmpipe" in self.device.name else None
        if memory is not None:
            self.memory = min(_bytes(memory), self.memory)
        self.build_seconds = 0.0   # that building programs has taken so far
        self.held_up = 0.0         # seconds since `start` that launches have waited for kernels to be built
        self.pace: dict[str, float] = {}             # strands a second by what was done, for those who share work out
        self.peak = 0              # most bytes that arrays have taken at once since `start`
        self._pool = tools.MemoryPool(tools.ImmediateAllocator(self.queue))
        self._kernels: dict[str, signature.Kernel] = {}
        self._stems: set[str] = set()                # kernel files that are built,
        self._aheads: list[Ahead] = []               # and those that are being built beside what else is done
        self._building = threading.Lock()
        self._kept: dict[str, tuple] = {}
        self._nothing: dict[tuple, cla.Array] = {}   # empty arrays that are handed out again and again
        self._uploads: deque = deque(maxlen=64)      # events: each holds what is copied, and waits when it goes
        self._lent: list[tuple] = []                 # (host array that kernels may still read, weak one to its buffer)
        self._lent_then = 0                          # how many there were when all had been done
        weakref.finalize(self, _let_end, self.queue, self._lent)
        self._log: list[tuple] = []
        self._label: str | None = None
        self._busy = threading.Lock()
        self._stopped = False
        self._stop: Callable[[], bool] | None = None
        self._load = None
        # By launch, (kernel, how many of it came before in the frame): one may march all rays, and the next the rest.
        self._rates: dict[tuple, float] = {}         # seconds a work-item takes
        self._wholes: dict[tuple, tuple] = {}        # (work-items, seconds) of it when it last took several pieces
        self._turns: Counter[str] = Counter()        # launches of each kernel in this frame
        self._given = self._done = 0.0               # seconds of work that the device has been given, and of that done

    @contextmanager
    def _watched(self, doing):
        """Make one readable error of what the driver raises."""
        try:
            yield
        except (cl.Error, MemoryError) as error:
            raise DeviceError(f"{self.name} {doing}: {' '.join(str(error).split())[:300]}"
                              f"{caches.trouble_of(self.device.platform.name)}") from None

    def empty(self, shape: Any, dtype: Any) -> cla.Array:
        """Uninitialised device array, taken from the pool."""
        check_process()
        shape = tuple(shape) if isinstance(shape, (tuple, list)) else (shape,)
        if not shape[0] and (there := self._nothing.get((shape, dtype))) is not None:
            return there
        nbytes = math.prod(map(int, shape)) * np.dtype(dtype).itemsize
        self._check_size(shape, nbytes)
        if self._pool.managed_bytes + nbytes > self.memory:
            self._pool.free_held()
        held = self._pool.managed_bytes
        try:
            # OpenCL has no empty buffers: an empty array is the empty start of a small one.
            whole = cla.empty(self.queue, (max(shape[0], 1), *shape[1:]), dtype, allocator=self._pool)
        except (cl.MemoryError, cl.LogicError, MemoryError):   # a logic error: rounded up beyond the largest piece
            raise DeviceError(f"{self.name} is out of memory for {nbytes / 2**20:,.0f} MiB {shape}; arrays hold "
                              f"{self._pool.active_bytes / 2**20:,.0f} MiB") from None
        except cl.Error as error:
            raise DeviceError(f"{self.name} gives no memory: {error}") from None
        self.peak = max(self.peak, self._pool.active_bytes)
        if self.large_pages and whole.nbytes >= LARGE and self._pool.managed_bytes > held:
            self._lay_in_large_pages(whole)
        if shape[0]:
            return whole
        return self._nothing.setdefault((shape, dtype), whole[:0]) if whole.nbytes <= 512 else whole[:0]

    def _check_size(self, shape, nbytes):
        if nbytes > self.largest:
            raise Error(f"an array of {nbytes / 2**20:,.0f} MiB {shape} is more than {self.name} can hold "
                        f"in one piece ({self.largest / 2**20:,.0f} MiB)")

    def _lay_in_large_pages(self, array):
        """See `in_large_pages`; for an array of memory that is new."""
        with suppress(cl.Error):   # it is as right without
            there, _ = cl.enqueue_map_buffer(self.queue, array.base_data, cl.map_flags.WRITE, 0,
                                             (array.base_data.size,), np.uint8, is_blocking=False)
            in_large_pages(there.__array_interface__["data"][0], there.nbytes)
            there.base.release(self.queue)

    def full(self, shape: Any, dtype: Any, value: Any) -> cla.Array:
        """Device array filled with one value."""
        if self.on_host and math.prod(np.atleast_1d(shape)) * np.dtype(dtype).itemsize <= TINY:
            return self.upload(np.full(shape, value, dtype))
        there = self.empty(shape, dtype)
        if there.size:   # by the driver: pyopencl's own fill would compile a kernel for it
            pattern = np.dtype(dtype).type(value)
            with self._watched("does not fill an array"):
                cl.enqueue_fill_buffer(self.queue, _buffer(there), pattern, 0, there.nbytes)
        return there

    @property
    def own_steps(self) -> int:
        """Steps of loops that a work-item may take, whatever those beside it do."""
        return self.steps // ABREAST if self.steps else 2**32 - 1

    @property
    def room(self) -> int:
        """Bytes that arrays may still take on the device."""
        return self.memory - self._pool.active_bytes

    def upload(self, array: np.ndarray) -> cla.Array:
        """Copy of a host array on the device; a read-only one must stay as it is till anything is read back."""
        given, array = array, np.ascontiguousarray(array)
        if self.on_host and 0 < array.nbytes <= TINY:
            return self._holding(array, cl.mem_flags.COPY_HOST_PTR)
        there = self.empty(array.shape, array.dtype)
        if not array.size:
            return there
        # What nobody writes into is not waited for: to wait would be to wait for all that is to be done before.
        stays = _is_frozen(array) or (array is not given and array.base is None)
        with self._watched("takes no data"):
            if not stays and array.nbytes > SMALL:
                there.set(array)
                return there
            while self._uploads and self._uploads[0].command_execution_status == cl.command_execution_status.COMPLETE:
                self._uploads.popleft()
            self._uploads.append(cl.enqueue_copy(self.queue, _buffer(there), array if stays else array.copy(),
                                                 is_blocking=False))
        return there

    def lend(self, array: np.ndarray) -> cla.Array:
        """A host array on the device, for kernels that only read it: where it lies, if it stays as it is and the device
        works in the host's memory, else a copy.  It is kept alive till its buffer has gone and all that was launched by
        then has run."""
        # Kernels read 16 bytes at a time at most: see `signature.Lent`.
        if not (self.on_host and array.nbytes > TINY and array.flags.c_contiguous and _is_frozen(array)
                and array.__array_interface__["data"][0] % 16 == 0):
            return self.upload(array)
        if len(self._lent) >= self._lent_then + 64:
            self._finish()
        there = self._holding(array, cl.mem_flags.READ_ONLY | cl.mem_flags.USE_HOST_PTR, signature.Lent)
        self._lent.append((array, weakref.ref(there.base_data)))
        return there

    def _wait(self, wait):
        """Call wait().  PoCL runs nothing while it makes a kernel, whichever: that counts as being held up."""
        began, builds = time.perf_counter(), any(ahead.builds for ahead in self._aheads)
        wait()
        if builds:
            self.held_up += time.perf_counter() - began

    def _take_back(self):
        """Let go what was lent to kernels, all of which have run, and which no other can be given."""
        self._lent[:] = [(array, buffer) for array, buffer in self._lent if buffer() is not None]
        self._lent_then = len(self._lent)

    def _finish(self):
        """Wait for all that was launched."""
        with self._watched("does not finish"):
            self._wait(self.queue.finish)
        self._done = self._given
        self._take_back()

    def _holding(self, array, flags, kind=cla.Array):
        """Device array of a buffer that is made of a host array, beside the pool."""
        check_process()
        self._check_size(array.shape, array.nbytes)
        with self._watched("takes no data"):
            return kind(self.queue, array.shape, array.dtype, data=_Memory(self.context, flags, hostbuf=array))

    def rows(self, array: Any, first: int, end: int) -> cla.Array:
        """Rows of an array, to be read on this device: lent if on the host, copied from another context, else as is."""
        if isinstance(array, np.ndarray):
            return self.lend(array[first:end])
        if not array.size:
            return self.empty((0, *array.shape[1:]), array.dtype)
        with self._watched("takes no data"):
            if array.queue is not None and array.queue != self.queue:
                array.queue.finish()
            if array.base_data.context != self.context:
                return self.upload(array.get()[first:end])
            if (first, end, array.offset) == (0, len(array), 0):
                return array
            there = self.empty((end - first, *array.shape[1:]), array.dtype)
            if there.size:
                cl.enqueue_copy(self.queue, _buffer(there), array.base_data, byte_count=there.nbytes,
                                src_offset=array.offset + first * array.strides[0], dst_offset=0)
            return there

    def copied(self, array: cla.Array) -> cla.Array:
        """Copy of a device array on the device."""
        there = self.empty(array.shape, array.dtype)
        if there.size:
            with self._watched("takes no data"):
                cl.enqueue_copy(self.queue, _buffer(there), _buffer(array), byte_count=there.nbytes,
                                src_offset=array.offset, dst_offset=0)
        return there

    def joined(self, arrays: Sequence, dtype: Any) -> cla.Array:
        """Device arrays, None for none, one after the other -> [all their values]; one alone is not copied."""
        arrays = [array for array in arrays if array is not None]
        if len(arrays) == 1:
            return arrays[0]
        there, at = self.empty(sum(array.size for array in arrays), dtype), 0
        with self._watched("takes no data"):
            for array in arrays:
                cl.enqueue_copy(self.queue, _buffer(there), array.base_data, byte_count=array.nbytes, dst_offset=at)
                at += array.nbytes
        return there

    def download(self, array: cla.Array) -> np.ndarray:
        """Copy of a device array on the host."""
        there = self.downloading(array)()
        self._uploads.clear()   # nothing has been launched since
        self._take_back()
        return there

    def downloading(self, array: cla.Array) -> Callable[[], np.ndarray]:
        """Begin to copy a device array to the host -> a function that waits for the copy and gives it: what is launched
        in between is done meanwhile."""
        self.ask()
        with self._watched("gives no data"):
            there, event = array.get_async(queue=self.queue)
        array.events.clear()   # each would keep alive what was read, twelve times over
        before = self._given

        def wait():
            self.ask()
            with self._watched("gives no data"):
                self._wait(event.wait)
            self._done = max(self._done, before)
            return there
        return wait

    def launch(self, name: str, size: int, /, **arguments: Any) -> None:
        """Run kernel "stem.kernel" over ``size`` work-items.

        ``arguments``: by their names in its signature, see `signature`; TypeError, before anything is run, for one that
        is missing, unknown or of another type than the kernel's.
        """
        kernel = self._kernels.get(name)
        if not kernel or not kernel.ran:
            kernel = self._built(name)
        values = kernel.bind(arguments)
        for argument, array in arguments.items():   # PoCL and rusticl take another context's, and wait for nothing
            if isinstance(array, cla.Array) and array.queue is not self.queue and array.context != self.context:
                raise TypeError(f"{name}: {argument} is an array of another Scheduler; allowed: this one's")
        with self._watched(f"does not run {name}"):
            if not kernel.ran:
                self._make(kernel, values)
            self._run(kernel, int(size), values)

    def _make(self, kernel, values):
        """Run a kernel over nothing: drivers make one for its group size when it first runs."""
        self.queue.finish()
        began = time.perf_counter()
        with caches.taking_kernels(self.device.platform.name):
            kernel.run(self.queue, (kernel.group,), (kernel.group,), 0, 0, *values).wait()
        self._done, kernel.ran = self._given, True
        self.held_up += time.perf_counter() - began

    def _run(self, kernel, size, values):
        """Run a kernel, in pieces: a driver can't be interrupted.  All but the last are waited for, unless it took less
        than a piece may the last time."""
        name, group, begin, started = kernel.name, kernel.group, 0, time.perf_counter()
        turn = name, self._turns[name]
        self._turns[name] += 1
        most, whole = self._wholes.get(turn, (0, 0.0))
        short = size <= most and self._given - self._done + whole < PIECE
        while begin < size:
            self.ask()
            rate, alone = whole / most if short else self._rates.get(turn), self._done == self._given
            piece = MOST if short else FIRST if rate is None else min(int(PIECE / rate), MOST)
            end = min(begin + max(piece // group, 1) * group, size)
            began = time.perf_counter()
            # Whole groups of one size, and a kernel that ends where it should: see WORK_ITEM in common.h.
            event = kernel.run(self.queue, (-(-(end - begin) // group) * group,), (group,), begin, end, *values)
            self._log.append((self._label or name.split(".")[0], event))
            self._given += PIECE if rate is None else rate * (end - begin)
            if self._given - self._done >= PIECE or (end < size and not short):
                self._wait(event.wait)
                if not short and (alone or rate is None):
                    # Sky is done in no time, but fur may begin in the next piece: a rate falls slowly.
                    self._rates[turn] = max((time.perf_counter() - began) / (end - begin), (rate or 0) / 2, 1e-10)
                self._done = self._given
            if begin and end == size and not short:
                self._wait(event.wait)
                self._wholes[turn], self._done = (size, time.perf_counter() - started), self._given
            begin = end

    def load(self, key: Any) -> None:
        """Set what the lengths of launches depend on: while the key stays equal, they are taken to be as they were."""
        if key != self._load:
            self._load = key
            self._rates.clear()
            self._wholes.clear()

    def keep(self, name: str, key: tuple, build: Callable[[], Any]) -> Any:
        """``build()``, or what it gave last time under this name if ``key`` holds the very same objects."""
        last_key, value = self._kept.get(name, (None, None))
        if last_key is None or len(last_key) != len(key) or not all(a is b or (type(a) in (int, str) and a == b)
                                                for a, b in zip(last_key, key)):
            self._kept.pop(name, None)
            value = None   # the old arrays go before new ones are made
            value = build()
            self._kept[name] = (tuple(key), value)
        return value

    def keep_only(self, *owners: Any) -> None:
        """Drop what is kept of others: the results whose key begins with another object than one of these."""
        self._kept = {name: kept for name, kept in self._kept.items()
                      if not kept[0] or any(kept[0][0] is owner for owner in owners)}

    def forget(self) -> None:
        """Drop every kept stage, so that the next frame is built from the beginning."""
        self._kept.clear()

    @contextmanager
    def frame(self, stop: Callable[[], bool] | None = None) -> Iterator[None]:
        """One frame: nothing else may draw with this scheduler meanwhile, and `seconds` and `peak` count anew.

        ``stop``: asked between launches and their pieces, and before arrays are read back: `Stopped` is raised there
        once it says True.  What was launched by then runs on, for `PIECE` seconds or so.
        """
        check_process()
        if not self._busy.acquire(blocking=False):
            raise Error(f"this Scheduler ({self.name}) is drawing in another thread; allowed: one for each thread")
        try:
            self._stopped, self._stop = False, stop
            self.start()
            yield
        finally:
            self._stopped, self._stop = False, None   # what is read back between frames is wanted
            try:
                self._leave_builds()
            finally:   # also where Ctrl-C comes once more
                self._busy.release()

    def stop(self) -> None:
        """Let the frame that is being drawn in another thread end with `Stopped`, soon."""
        self._stopped = True

    def ask(self) -> None:
        """Raise `Stopped` if the frame that is being drawn is not wanted any more."""
        if self._stopped:
            raise Stopped("it was stopped with others that drew the same")
        go_on(self._stop)

    def start(self) -> None:
        """Begin a new frame: from here on `seconds` and `peak` count anew."""
        if self._lent:   # to a frame that was stopped
            self._finish()
        self._log.clear()
        self._turns.clear()
        self.held_up = 0.0
        # Frames of ever new sizes leave ever new pieces in the pool.  What the last one took may be of use again: in
        # new memory the system clears each page when it is first touched: up to a third of a frame.
        if self._pool.managed_bytes > 2 * max(self._pool.active_bytes, self.peak) + SPARE:
            self._pool.free_held()
        self.peak = self._pool.active_bytes

    @contextmanager
    def labelled(self, name: str) -> Iterator[None]:
        """Count the launches within under this name instead of their kernel file's."""
        self._label = name
        try:
            yield
        finally:
            self._label = None

    def seconds(self) -> dict[str, float]:
        """Seconds on the device since `start`, by kernel file: {"strands": 0.007, ...}; waits for them."""
        total: dict[str, float] = {}
        self._finish()
        with self._watched("does not finish"):
            for name, event in self._log:
                total[name] = total.get(name, 0.0) + 1e-9 * (event.profile.end - event.profile.start)
        return total

    def prepare(self, stems: Iterable[str]) -> None:
        """Begin to build these kernel files, in this order, beside what else is done: `launch` waits for what it
        needs."""
        known = self._stems.union(*self._aheads)
        missing = [stem for stem in stems if stem not in known]
        if missing and self.device.platform.name != CHECKER:
            self._aheads.append(Ahead(missing, self.build, self._to_make, starts(self.device, self.allowed[0])))

    def _to_make(self, stem):
        """Kernels of a file that most pictures need, of a driver that makes them when they first run."""
        return [f"{stem}.{name}" for name in signature.usual(source.read(stem))] if self.makes else []

    def build(self, name: str) -> None:
        """Build a kernel file, or make its kernel "stem.kernel" ready to run.  Raises `DeviceError`."""
        with self._building:
            if (stem := name.split(".")[0]) not in self._stems:
                self._build(stem)
        kernel = self._kernels.get(name)
        if kernel and not kernel.ran:
            with self._watched(f"does not run {name}"), caches.taking_kernels(self.device.platform.name):
                queue = cl.CommandQueue(self.context)   # beside what runs
                kernel.run(queue, (kernel.group,), (kernel.group,), 0, 0, *kernel.nothing).wait()
            kernel.ran = True

    def _built(self, name):
        """The kernel "stem.kernel", when its file is built, and no other thread has it."""
        began, stem = time.perf_counter(), name.split(".")[0]
        for ahead in self._aheads:
            if stem in ahead:
                ahead.wait_for(name)
        if name not in self._kernels:
            self.build(stem)
        self.held_up += time.perf_counter() - began
        return self._kernels[name]

    def _leave_builds(self):
        """End what `prepare` has begun, and what is not needed any more; what fails then fails when it is launched."""
        aheads = list(self._aheads)
        self._aheads.clear()
        for ahead in aheads:
            ahead.leave()

    def _build(self, stem):
        text = source.read(stem)
        whole = layout.preamble(self.int64_atomics, self.device.platform.name == "Oclgrind", self.lanes,
                                self.hinted, self.device.local_mem_size)
        whole += source.once(text) if self.lanes > 1 else text
        options = ["-cl-std=CL1.2", "-w"]   # some compilers write how many warnings there were to stderr
        if self.device.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT:
            options.append("-cl-fp32-correctly-rounded-divide-sqrt")
        began = time.perf_counter()
        try:
            with caches.taking_kernels(self.device.platform.name):
                kernels, spoilt = programs.build(self.context, self.device, whole, options,
                                                 signature.names(text))
        except (cl.Error, MemoryError, programs.NoKernelsError) as error:
            raise DeviceError(f"{self.name} does not build {stem}.cl: {_complaint(str(error))}"
                              f"{caches.trouble_of(self.device.platform.name)}") from None
        if spoilt:
            warnings.warn(f"what {self.name} keeps of {stem}.cl{caches.where(self.device.platform.name)} is spoilt: "
                          f"delete it; till then a second one is built", RuntimeWarning, stacklevel=2)
        self.build_seconds += time.perf_counter() - began
        signatures = signature.read(text)
        for function, kernel in kernels.items():
            name, arguments = f"{stem}.{function}", signatures[function]
            # Told so, pyopencl need not try out what each argument is: a tenth of the time.
            kernel.set_scalar_arg_dtypes([np.uint64, np.uint64, *(argument.packed for argument in arguments)])
            stated = kernel.get_work_group_info(cl.kernel_work_group_info.COMPILE_WORK_GROUP_SIZE, self.device)[0]
            self._kernels[name] = signature.Kernel(name, arguments, kernel, stated or GROUP)
        self._stems.add(stem)
        return self._kernels


class _Memory(cl.Buffer):
    """A buffer to which there can be weak references; arrays that are views of others have it in common."""


def _let_end(queue, lent):
    """Wait for kernels that may still read what was lent to them, when their scheduler goes."""
    if lent:
        with suppress(cl.Error):
            queue.finish()


def _is_frozen(array) -> bool:
    """Whether nobody can write into an array, nor into what it is a view of."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return array is None


def _buffer(array) -> Any:
    """The memory that an array lies in."""
    return array.base_data


def _complaint(log):
    """What a compiler's log complains about: "raster.cl:12: ..." if it names a place, or its first line of an error."""
    lines = [" ".join(line.split()) for line in log.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()] or lines or ["it says nothing"]
    for line in errors:
        if place := re.search(r"(\w+\.(?:cl|h))[:(](\d+)[\d:,)]*", line):
            what = re.sub(r"^\s*(fatal )?error:\s*", "", line[place.end():], flags=re.IGNORECASE)
            return f"{place[1]}:{place[2]}: {what.strip()}"[:300]
    return errors[0][:300]
