"""Memory that this process may take: what limits say, and scenes that are drawn in parts because of them."""

import json
import mmap
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
import pytest
from support.plans import plan_of

import clfur
from clfur.command.types import Bytes
from clfur.device import memory, scheduler
from clfur.pipeline import sizes

ROOT = Path(__file__).resolve().parents[1]
FREE = "memory that is free"
GIB = 1 << 30


def flags_at(address):
    """What Linux tells of the memory at an address, a word of two letters each."""
    found = False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        words = line.split()
        if "-" in words[0]:
            begin, end = (int(part, 16) for part in words[0].split("-"))
            found = begin <= address < end
        elif found and words[0] == "VmFlags:":
            return words[1:]
    raise AssertionError(f"no memory at {address:#x}")


@pytest.mark.skipif(not Path("/sys/kernel/mm/transparent_hugepage").exists(), reason="a system without large pages")
def test_whole_pages_of_an_array_are_advised():
    there = np.frombuffer(mmap.mmap(-1, 9 << 20), np.uint8)
    address = there.ctypes.data
    memory.in_large_pages(address + 5, (8 << 20) - 5)
    assert "hg" not in flags_at(address) and "hg" not in flags_at(address + (8 << 20))
    assert "hg" in flags_at(address + mmap.PAGESIZE) and "hg" in flags_at(address + (8 << 20) - 1)
    memory.in_large_pages(address + (8 << 20) + 5, 100)   # no whole page
    assert "hg" not in flags_at(address + (8 << 20))


@pytest.mark.skipif(not Path("/sys/kernel/mm/transparent_hugepage").exists(), reason="a system without large pages")
def test_a_large_array_is_advised_where_it_lies():
    gpu = scheduler.Scheduler("pocl")
    large = gpu.empty(3 * scheduler.LARGE, np.uint8)
    there, _ = cl.enqueue_map_buffer(gpu.queue, large.base_data, cl.map_flags.READ, 0, (large.nbytes,), np.uint8)
    address = there.ctypes.data
    there.base.release(gpu.queue)
    assert "hg" in flags_at(address + large.nbytes // 2)


def tree(root, **files):
    """Files below a folder that stands for the file system's root."""
    for path, text in files.items():
        place = root / path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    return str(root)


def test_version_2(tmp_path):
    """Every group above counts; caches of files are not in use; "max" is no limit."""
    top = "sys/fs/cgroup/"
    root = tree(tmp_path, **{
        "proc/self/cgroup": "0::/job/step\n", f"{top}memory.max": "max\n", f"{top}memory.current": "1\n",
        f"{top}job/memory.max": "4000\n", f"{top}job/memory.current": "3000\n",
        f"{top}job/memory.stat": "anon 5\ninactive_file 1200\nactive_file 7\n",
        f"{top}job/step/memory.max": "5000\n", f"{top}job/step/memory.current": "100\n"})
    assert sorted(memory.cgroups(root)) == [(4000, 1800, "cgroup memory.max"), (5000, 100, "cgroup memory.max")]


@pytest.mark.parametrize("path", ["/docker/abc", "/"])
def test_version_1(tmp_path, path):
    """In a container the tree begins at the group, whatever its path is outside."""
    top = "sys/fs/cgroup/memory/"
    root = tree(tmp_path, **{
        "proc/self/cgroup": f"9:name=systemd:/x\n4:cpu,memory:{path}\n3:cpuset:/\n",
        f"{top}memory.limit_in_bytes": "9000\n", f"{top}memory.usage_in_bytes": "8000\n",
        f"{top}memory.stat": "inactive_file 1\ntotal_inactive_file 500\n"})
    assert memory.cgroups(root) == [(9000, 7500, "cgroup memory.limit_in_bytes")]
    (tmp_path / top / "memory.limit_in_bytes").write_text("9223372036854771712\n")
    assert memory.cgroups(root) == []


@pytest.mark.parametrize("text", [None, "", "nonsense", "0::/../../etc", "0::/none\n4:memory:/none"])
def test_no_groups(tmp_path, text):
    root = tree(tmp_path, **({} if text is None else {"proc/self/cgroup": text}), **{"etc/memory.max": "5"})
    assert memory.cgroups(root) == []


@pytest.fixture
def made_up(monkeypatch):
    """A process of 1 GiB with nothing but what a test says -> what to change."""
    limits = {}
    monkeypatch.setattr(memory.psutil, "virtual_memory", lambda: SimpleNamespace(
        available=limits.get("free", 64 * GIB)))
    monkeypatch.setattr(memory.psutil, "Process", lambda: SimpleNamespace(
        memory_info=lambda: SimpleNamespace(vms=GIB, rss=GIB // 4, data=GIB // 2)))
    monkeypatch.setattr(memory, "cgroups", lambda: limits.get("cgroups", []))
    monkeypatch.setattr(memory, "resource", SimpleNamespace(
        RLIMIT_AS=9, RLIMIT_DATA=2, RLIM_INFINITY=-1,
        getrlimit=lambda which: (limits.get({9: "AS", 2: "DATA"}[which], -1), -1)))
    return limits


@pytest.mark.parametrize("limits, left", [
    ({}, (64 * GIB, FREE)),
    ({"free": 3 * GIB}, (3 * GIB, FREE)),
    ({"AS": 4 * GIB}, (3 * GIB - 2 * memory.THREAD, "RLIMIT_AS")),
    ({"DATA": 2 * GIB, "AS": 4 * GIB}, (3 * GIB // 2, "RLIMIT_DATA")),
    ({"cgroups": [(5 * GIB, GIB, "cgroup memory.max"), (9 * GIB, GIB, "another")]}, (4 * GIB, "cgroup memory.max")),
    ({"AS": GIB // 2}, (0, "RLIMIT_AS")),
])
def test_the_least_counts(made_up, limits, left):
    made_up |= limits
    assert memory.left(threads=2) == left


def test_without_limits_of_processes(made_up, monkeypatch):
    monkeypatch.setattr(memory, "resource", None)   # Windows
    assert memory.left() == (64 * GIB, FREE)


def planned(device_bytes, shared):
    return memory.planned(device_bytes, memory.allowed(2, shared))


def test_what_is_planned(made_up):
    assert planned(16 * GIB, shared=True) == (12 * GIB, "")
    made_up["cgroups"] = [(3 * GIB, GIB, "cgroup memory.max")]
    assert planned(16 * GIB, shared=True) == ((2 * GIB - memory.BESIDE) * 7 // 8, "cgroup memory.max")
    assert planned(16 * GIB, shared=False) == (12 * GIB, "")   # a GPU keeps its own
    assert planned(GIB, shared=True) == (GIB * 3 // 4, "")
    made_up["cgroups"] = [(3 * GIB, 3 * GIB, "cgroup memory.max")]
    assert planned(16 * GIB, shared=True) == (1, "cgroup memory.max")


def test_what_is_given_counts_where_it_is_less(gpu, monkeypatch):
    monkeypatch.setattr(scheduler, "allowed", lambda *_: (1000, "RLIMIT_AS"))
    assert [clfur.Scheduler(gpu.device, n).memory for n in (None, 999, 2000)] == [1000, 999, 1000]


def test_pictures_on_the_host_count(another, sphere):
    """Sixteen bytes a pixel, twice, of what the process may take; none of what was given."""
    small, scene = another(), clfur.Scene(mesh=sphere, camera=clfur.Camera(size=(1000, 100)))
    plan = plan_of(scene, clfur.Settings(), ("color",))
    small.allowed = 5_000_000, "cgroup memory.max"
    assert sizes.memory(plan, small) == (1_800_000, "cgroup memory.max")
    small.memory = 1_700_000
    assert sizes.memory(plan, small) == (1_700_000, "")


def test_the_message_names_the_limit(another, sphere):
    small = another()
    small.allowed = 1 << 20, "cgroup memory.max"
    with pytest.raises(clfur.Error, match=r"with 0\.[0-9]+ MiB \(cgroup memory\.max\) has no room for"):
        clfur.draw(clfur.Scene(mesh=sphere, camera=clfur.Camera(size=(64, 48))), small)


LIMITED = """
import json, resource, sys
import clfur
from clfur.device.scheduler import Scheduler

def status(name):
    with open("/proc/self/status") as lines:
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith(name))

extra = int(sys.argv[1])
mesh = clfur.load_mesh("teapot")
hair = clfur.HairType(segments=12, segment_length=.02, width=.003)
scene = clfur.Scene(mesh=mesh, fur=clfur.Strands(inner=9, outer=9, types=[hair]), camera=clfur.Camera(size=(160, 120)))
if extra:
    clfur.draw(clfur.Scene(mesh=mesh, camera=clfur.Camera(size=(16, 12))), "pocl")   # the driver is there
    for which in resource.RLIMIT_AS, resource.RLIMIT_DATA:
        resource.setrlimit(which, (status("VmSize" if which == resource.RLIMIT_AS else "VmData") + extra,) * 2)
gpu = Scheduler("pocl")
frame = clfur.draw(scene, gpu, hashes=True)
parts = len(clfur.pipeline.plan.Plan(clfur.pipeline.views.Rig.of(scene, clfur.Settings()), ("color",)).parts(gpu))
print(json.dumps({"hashes": frame.hashes, "sum": float(frame.images["color"].sum()), "limit": gpu.allowed[1],
                  "parts": parts, "bits": frame.images["color"].tobytes().hex()[:4096]}))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="RLIMIT_AS is heeded on Linux")
def test_a_scene_that_does_not_fit_is_drawn_in_parts():
    """With a limit of addresses (`ulimit -v`) it is the same picture, and the process lives."""
    found = []
    for extra in (0, 700 << 20):
        done = subprocess.run([sys.executable, "-c", LIMITED, str(extra)], capture_output=True, text=True, timeout=300,
                              env={**os.environ, "PYTHONPATH": str(ROOT)})
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout.splitlines()[-1]))
    free, limited = found
    assert limited["limit"] in ("RLIMIT_AS", "RLIMIT_DATA") and limited["parts"] > 1 == free["parts"]
    assert all(free[name] == limited[name] for name in ("hashes", "sum", "bits"))


@pytest.mark.parametrize("text, number", [
    ("2GiB", 2 * GIB), ("2g", 2 * GIB), ("2 GB", 2 * GIB), ("512M", 1 << 29), ("1024k", 1 << 20), ("8000000", 8000000),
    ("1T", 1024 * GIB), ("0", None), ("-1", None), ("2 PiB", None), ("nan", None), ("", None), ("1e9", None),
    ("9" * 400, None), ("0.1", None), ("200", None), ("1023K", None)])
def test_bytes(text, number):
    if number is None:
        with pytest.raises(Exception, match="is not a number of bytes such as 2GiB"):
            Bytes().convert(text, None, None)
    else:
        assert Bytes().convert(text, None, None) == number


def test_the_command_takes_it(clfur, tmp_path):
    for size in ("64MiB", "8GiB"):
        assert clfur("render", "sphere", "--size", "32x24", "--memory", size, "-o", f"{size}.npz")[0] == 0
    assert (tmp_path / "64MiB.npz").read_bytes() == (tmp_path / "8GiB.npz").read_bytes()
    code, _, err = clfur("render", "sphere", "--size", "32x24", "--memory", "1MiB", "-o", "no.png")
    assert code == 2 and "MiB has no room for" in err and err.count("\n") == 1
    assert clfur("render", "sphere", "--memory", "much")[0] == 2
