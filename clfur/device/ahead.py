"""Kernels are built ahead of their first launch: by a thread, and where they are not kept also by other processes.

PoCL's compiler works for one thread of a process at a time.  It keeps what others build, and this one reads it.
"""

import functools
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, wait
from contextlib import suppress
from pathlib import Path

import pyopencl as cl

from ..errors import Stopped
from .caches import POCL, taking_kernels, unheard
from .selection import local_devices

LONG = 0.15        # seconds that a file takes at most where its kernels are kept: .02 to .05
FEW = 3            # files that are left for another process to be started, at least: that takes half a second
PROCESSES = 3      # others at most,
MEMORY = 1 << 29   # each of which may take so many bytes


class Ahead:
    """Kernel files that are being built, and then their kernels that are being made ready to run.

    ``files``: in the order in which they are needed.  ``build`` builds one, or makes a kernel of it, in this process.
    ``kernels``: from a file to the names "file.kernel" of those that are to be made.  ``starts``: functions that start
    another process each -> `Builder`.  This process begins with the first ones, others with the last.
    """

    def __init__(self, files, build, kernels, starts=()):
        self._order, self._build, self._kernels_of = list(files), build, kernels
        # What nobody has begun: what is waited for, files, and kernels of files that are built.
        self._wanted, self._files, self._kernels = [], list(files), []
        self._jobs = {file: Future() for file in files}
        self._changed, self._stopped = threading.Condition(), False
        self._since, self._long = time.perf_counter(), False   # when this process began a job; whether any took long
        self._threads = [threading.Thread(target=self._work_here, daemon=True)] + [
            threading.Thread(target=self._work_there, args=(start,), daemon=True) for start in starts]
        for thread in self._threads:
            thread.start()

    def __iter__(self):
        """Over its files."""
        return iter(self._order)

    @property
    def builds(self):
        """Whether anything is being built that was not kept."""
        return self._long and any(thread.is_alive() for thread in self._threads)

    def wait_for(self, kernel):
        """Wait till a kernel's file is built, which is what is done next, and where that takes long the kernel made.
        Raises what building its file does.

        That is not made in the thread that launches it: the driver lets those wait who come last, and no signal is
        heard meanwhile.
        """
        self._wait_for(_file(kernel)).result()
        if kernel in self._jobs:
            wait([self._wait_for(kernel)])   # what fails fails again where it is launched

    def _wait_for(self, job):
        with self._changed:
            for left in self._files, self._kernels:
                if job in left:
                    left.remove(job)
                    self._wanted.append(job)
                    self._changed.notify_all()
        return self._jobs[job]

    def leave(self):
        """Wait for what is begun, and leave the rest."""
        with self._changed:
            self._stopped = True
            for job in self._wanted + self._files + self._kernels:
                self._jobs[job].set_exception(Stopped(f"{job} was not built any more"))
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()

    def _next(self, which):
        """What is waited for, or the first (0) or the last (-1) of what is to be done: files, then kernels.  None: no
        more."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopped or self._wanted or self._files or self._kernels or all(
                self._jobs[file].done() for file in self._order))
            left = self._wanted or self._files or self._kernels
            return left.pop(which) if left and not self._stopped else None

    def _do(self, job, build):
        """Call build(job), and let those know who wait for it -> what it gave."""
        done, kernels, failed, began = None, [], None, time.perf_counter()
        try:
            done = build(job)
            self._long |= time.perf_counter() - began > LONG
            kernels = self._kernels_of(job) if self._long and "." not in job else []
        except BaseException as error:
            failed = error
        with self._changed:
            if not self._stopped:
                self._jobs |= {kernel: Future() for kernel in kernels}
                self._kernels = sorted(self._kernels + kernels, key=lambda kernel: self._order.index(_file(kernel)))
            if failed:
                self._jobs[job].set_exception(failed)
            else:
                self._jobs[job].set_result(None)
            self._changed.notify_all()
        return done

    def _work_here(self):
        while job := self._next(0):
            self._since = time.perf_counter()
            self._do(job, self._build)

    def _is_slow(self):
        """Wait till this process has been at a job for `LONG` -> whether that came while there was enough to build."""
        with self._changed:
            while len(self._files) >= FEW and not self._stopped and not self._long:
                self._long = time.perf_counter() - self._since > LONG
                self._changed.wait(0 if self._long else LONG / 4)
            return len(self._files) >= FEW and not self._stopped

    def _work_there(self, start):
        if not self._is_slow():
            return
        try:
            with unheard():   # there for good: it would be killed as it builds, but ends when this process does
                builder = start()
        except OSError:   # the system starts no more processes: all is built here
            return
        with builder, taking_kernels(None):
            # This process reads what the driver has kept, or does again what failed there.
            while (job := self._next(-1)) and self._do(job, builder.build):
                pass


def _file(kernel):
    return kernel.split(".")[0]


class Builder:
    """Another process, which builds kernel files for a device, one after the other."""

    def __init__(self, device):
        here = str(Path(__file__).parents[2])
        path = [os.path.abspath(each) for each in sys.path if isinstance(each, str)]
        self._child = subprocess.Popen(
            [sys.executable, "-c", "import sys; sys.path[:] = sys.argv[2:]; from clfur.device.ahead import serve; "
             "serve(sys.argv[1])", device, *path, *[here] * (here not in path)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

    def build(self, job):
        """Build a file there, or make a kernel -> whether it goes on: what fails there ends it, and is told here."""
        try:
            self._child.stdin.write(f"{job}\n".encode())
            self._child.stdin.flush()
            return bool(self._child.stdout.readline())
        except OSError:   # it has died
            return False

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """Let it end, once it has built what it is at."""
        with suppress(OSError):   # by a word: a process that was forked meanwhile may hold the pipe open
            self._child.stdin.write(b"\n")
            self._child.stdin.flush()
        with suppress(OSError):
            self._child.stdin.close()
        self._child.wait()
        self._child.stdout.close()


def serve(device):
    """Build the files, and make the kernels, that lines of stdin name, till an empty one, and answer each by one."""
    from .scheduler import Scheduler

    gpu = Scheduler(device)
    for line in sys.stdin:
        if not line.strip():
            break
        gpu.build(line.strip())
        print(flush=True)
    os._exit(0)   # drivers may crash at exit, after all is done


def starts(device, memory):
    """Functions that start a `Builder` for a device each, as many as are of use.

    None but for a processor of PoCL's which keeps kernels; nor where Python may be a part of another program, which
    would start once more.  ``memory``: bytes that may be taken.
    """
    keeps = device.platform.name == POCL and os.environ.get("POCL_KERNEL_CACHE") != "0"
    is_python = os.path.basename(sys.executable or "").lower().startswith(("python", "pypy"))
    if not (keeps and is_python and device.type & cl.device_type.CPU):
        return []
    count = min(device.max_compute_units - 1, PROCESSES, memory // (4 * MEMORY))
    return [functools.partial(Builder, name) for name in local_devices(device)] * count
