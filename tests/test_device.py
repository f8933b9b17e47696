"""Choosing a device, on made-up lists of platforms and on the real one."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace as Made

import pyopencl as cl
import pytest

from clfur import Error, cache
from clfur.device import selection as devices
from clfur.device import vendors

CPU, GPU, OTHER = cl.device_type.CPU, cl.device_type.GPU, cl.device_type.ACCELERATOR


def platform(name, version, *named):
    p = Made(name=name, version=version)
    return [Made(platform=p, name=n, type=t, max_compute_units=2, driver_version="1.2") for n, t in named]


FPGA = platform("Intel(R) FPGA Emulation Platform for OpenCL(TM)", "OpenCL 1.2",
                ("Intel(R) FPGA Emulation Device", OTHER))
NONE = platform("Clover", "OpenCL 1.1 Mesa 22.3.6")
INTEL = platform("Intel(R) OpenCL", "OpenCL 3.0 LINUX", ("Intel(R) Xeon(R) Processor @ 2.00GHz", CPU))
POCL = platform("Portable Computing Language", "OpenCL 3.0 PoCL 3.0-rc2  Linux, LLVM 14.0.6",
                ("pthread-Intel(R) Xeon(R) Processor", CPU))
DEBIAN = platform("Portable Computing Language", "OpenCL 3.0 PoCL 3.1+debian  Linux, LLVM 15.0.6",
                  ("pthread-skylake-avx512-Intel(R) Xeon(R) Processor", CPU))
NVIDIA = platform("NVIDIA CUDA", "OpenCL 3.0 CUDA 12.2", ("NVIDIA H100", GPU), ("NVIDIA A100", GPU))
AMD = platform("AMD Accelerated Parallel Processing", "OpenCL 2.1", ("Ryzen", CPU), ("gfx90a", GPU))
ALL = [FPGA, NONE, INTEL, POCL, DEBIAN, NVIDIA, AMD]


@pytest.mark.parametrize("text, platforms, expected", [
    ("auto", ALL, NVIDIA[0]),
    ("auto", [FPGA, INTEL, POCL], POCL[0]),
    ("auto", [FPGA, INTEL], INTEL[0]),
    ("auto", [NONE, FPGA], FPGA[0]),
    ("auto", [DEBIAN, POCL], DEBIAN[0]),
    (" AUTO ", [POCL], POCL[0]),
    ("cpu", ALL, POCL[0]),
    ("cpu:1", ALL, DEBIAN[0]),
    ("cpu:2", ALL, INTEL[0]),
    ("gpu", ALL, NVIDIA[0]),
    ("gpu:1", ALL, NVIDIA[1]),
    ("gpu:2", ALL, AMD[1]),
    ("pocl", ALL, POCL[0]),
    ("PoCL:1", ALL, DEBIAN[0]),
    ("pocl 3.1", ALL, DEBIAN[0]),
    ("portable", ALL, POCL[0]),
    ("intel", [POCL, INTEL], INTEL[0]),        # the driver of that name goes before a processor of that name
    ("intel", [POCL, FPGA, INTEL], INTEL[0]),  # and a CPU before others
    ("intel", [POCL], POCL[0]),
    ("nvidia:1", ALL, NVIDIA[1]),
    ("a100", ALL, NVIDIA[1]),
    ("amd", ALL, AMD[1]),                      # the GPU of the platform before its CPU
    ("amd:1", ALL, AMD[0]),
    ("0", ALL, FPGA[0]),
    ("2", ALL, INTEL[0]),                      # platforms without devices count, as in PYOPENCL_CTX
    ("5:1", ALL, NVIDIA[1]),
    ("6:0", ALL, AMD[0]),
])
def test_pick(text, platforms, expected):
    assert devices.pick(text, platforms) is expected


@pytest.mark.parametrize("text", [
    "", "rusticl", "pocl:2", "pocl:", ":1", "gpu:3", "1:0", "1", "7", "5:2", "-1", "1:0:0"])
def test_pick_lists_what_there_is(text):
    with pytest.raises(Error) as error:
        devices.pick(text, ALL)
    message = str(error.value)
    assert "\n" not in message and repr(text) in message
    assert "pocl (PoCL 3.0 · Intel Xeon (2 units))" in message
    assert "nvidia:1 (NVIDIA CUDA 1.2 · NVIDIA A100 (2 units))" in message


@pytest.mark.parametrize("platforms", [[], [NONE]])
@pytest.mark.parametrize("text", ["auto", "pocl", "0:0"])
def test_no_device_at_all(text, platforms):
    with pytest.raises(Error, match=f"^there is no OpenCL device; {re.escape(vendors.advice())}"):
        devices.pick(text, platforms)


@pytest.mark.parametrize("text, failed, expected", [
    ("auto", [NVIDIA[0]], NVIDIA[1]),
    ("auto", [*NVIDIA, AMD[1]], POCL[0]),
    ("auto", [*NVIDIA, AMD[1], POCL[0], DEBIAN[0]], INTEL[0]),
    ("auto:1", [NVIDIA[0]], AMD[1]),
    ("auto", [d for p in ALL for d in p], NVIDIA[0]),   # all failed: the best of them
    ("gpu", NVIDIA, NVIDIA[0]),                         # what is named is taken
    ("nvidia", NVIDIA, NVIDIA[0]),
    ("pocl", POCL, POCL[0]),
    ("5:0", NVIDIA, NVIDIA[0]),
])
def test_auto_passes_over_what_failed(text, failed, expected):
    assert devices.pick(text, ALL, failed) is expected


@pytest.mark.parametrize("platforms, failed, words", [
    ([POCL], [], "it is the only device"),
    ([POCL], POCL, "it is the only device; it failed its check, though"),
    ([INTEL, POCL], [], "no GPU; PoCL before other CPU drivers"),
    ([POCL, DEBIAN], [], "no GPU; the first of 2 PoCL devices"),
    ([INTEL, POCL, DEBIAN], [], "no GPU; PoCL before other CPU drivers; the first of 2 PoCL devices"),
    ([INTEL, POCL], POCL, "pocl failed the check"),
    ([INTEL, POCL], INTEL, "no GPU"),
    ([INTEL, POCL], INTEL + POCL, "all failed their check; no GPU; PoCL before other CPU drivers"),
    ([FPGA, INTEL], [], "no GPU"),
    ([FPGA, FPGA], [], "no GPU or CPU; the first of 2 devices"),
    ([POCL, NVIDIA], [], "GPU before CPU; the first of 2 GPUs"),
    ([NVIDIA], [], "the first of 2 GPUs"),
    ([POCL, NVIDIA], NVIDIA[:1], "nvidia failed the check; GPU before CPU"),
    ([INTEL, POCL, NVIDIA], NVIDIA, "nvidia, nvidia:1 failed the check; PoCL before other CPU drivers"),
])
def test_reason(platforms, failed, words):
    assert devices.reason(platforms, failed) == words


SLOW, FAST = .5, .125   # seconds of a frame


@pytest.mark.parametrize("platforms, failed, measured, expected, why", [
    ([INTEL, POCL], [], [(INTEL[0], FAST), (POCL[0], SLOW)], INTEL, "the fastest of 2 that were measured"),
    ([INTEL, POCL], [], [(INTEL[0], SLOW), (POCL[0], FAST)], POCL, "the fastest of 2 that were measured"),
    ([POCL, NVIDIA[:1]], [], [(POCL[0], FAST), (NVIDIA[0], SLOW)], POCL, "the fastest of 2 that were measured"),
    # One that fails is none, however fast.
    ([INTEL, POCL, DEBIAN], INTEL, [(INTEL[0], FAST), (POCL[0], SLOW), (DEBIAN[0], .3)], DEBIAN,
     "the fastest of 2 that were measured"),
    # What is not measured keeps its place: a GPU with a new driver before CPUs, a new CPU driver behind PoCL.
    ([POCL, NVIDIA[:1]], [], [(POCL[0], FAST)], NVIDIA, "GPU before CPU"),
    ([INTEL, POCL], [], [(POCL[0], SLOW)], POCL, "no GPU; PoCL before other CPU drivers"),
    ([INTEL, POCL, NVIDIA], [], [(POCL[0], SLOW), (INTEL[0], FAST), (NVIDIA[0], .2)], INTEL,
     "the fastest of 3 that were measured"),
    ([POCL], [], [(POCL[0], SLOW)], POCL, "it is the only device")])
def test_auto_takes_the_fastest(platforms, failed, measured, expected, why):
    assert devices.pick("auto", platforms, failed, measured) is expected[0]
    assert devices.reason(platforms, failed, measured) == why
    kinds = [devices.pick(f"auto:{n}", platforms, failed, measured) for n in range(sum(map(len, platforms)))]
    assert len({id(device) for device in kinds}) == len(kinds)   # each has one place


def test_what_was_measured_is_remembered(no_wish):
    """As long as driver, clfur and the number of units are the same; damaged numbers are none."""
    no_wish.setattr(devices, "_platforms", lambda: [INTEL, POCL])
    assert devices.choose() is POCL[0]
    cache.remember(devices._identity(INTEL[0]), "pass", "", FAST)
    assert devices.choose() is POCL[0]
    cache.remember(devices._identity(POCL[0]), "pass", "", SLOW)
    assert devices.choose() is INTEL[0] and devices.choose("pocl") is POCL[0]
    for name, other in ("driver_version", "1.3"), ("max_compute_units", 64):
        with no_wish.context() as changed:
            changed.setattr(INTEL[0], name, other)
            assert devices.choose() is POCL[0]
        assert devices.choose() is INTEL[0]
    for seconds in ("0.1", -1.0, 0.0, float("inf"), float("nan"), True, None, [1.0]):
        cache.remember(devices._identity(INTEL[0]), "pass", "", seconds)
        assert cache.recall_seconds(devices._identity(INTEL[0])) is None and devices.choose() is POCL[0]
    cache.remember(devices._identity(INTEL[0]), "crash", "died", FAST)
    assert devices.choose() is POCL[0]


def test_jobs_go_to_gpus_unless_a_cpu_is_faster(no_wish):
    no_wish.setattr(devices, "_platforms", lambda: [POCL, NVIDIA])
    no_wish.setattr(devices, "choose", lambda wish: wish or POCL[0])
    assert devices.local_devices(None) == ["1:0", "1:1"]
    for device, seconds in (POCL[0], FAST), (NVIDIA[0], SLOW), (NVIDIA[1], SLOW):
        cache.remember(devices._identity(device), "pass", "", seconds)
    assert devices.local_devices(None) == ["0:0"]


def test_drivers_of_one_processor():
    one, other, gpu, card = (Made(name=name, type=kind, parent_device=None)
                             for name, kind in (("a", CPU), ("b", CPU), ("c", GPU), ("d", GPU)))
    half, rest = (Made(name=name, type=CPU, parent_device=one) for name in ("e", "f"))
    assert devices.shares_processor(one, other) and devices.shares_processor(gpu, gpu)
    assert not devices.shares_processor(one, gpu) and not devices.shares_processor(gpu, card)
    assert not devices.shares_processor(half, rest)


def test_handles_give_their_device():
    unnamed = platform("(R)", "OpenCL 1.2", ("?", OTHER))
    platforms = [unnamed, *ALL]
    named = devices.handles(platforms)
    assert [device for _, device in named] == [device for p in platforms for device in p]
    for text, device in named:
        assert devices.pick(text, platforms) is device
    assert [text for text, _ in named] == [
        "0:0", "intel:1", "intel", "pocl", "pocl:1", "nvidia", "nvidia:1", "amd:1", "amd"]


@pytest.mark.parametrize("device, text", [
    (POCL[0], "PoCL 3.0 · Intel Xeon (2 units)"),
    (DEBIAN[0], "PoCL 3.1 · Intel Xeon (2 units)"),
    (INTEL[0], "Intel OpenCL 1.2 · Intel Xeon @ 2.00GHz (2 units)"),
    (AMD[1], "AMD Accelerated Parallel Processing 1.2 · gfx90a (2 units)"),
])
def test_describe(device, text):
    assert devices.describe(device) == text


@pytest.fixture
def no_wish(monkeypatch, tmp_path):
    monkeypatch.setattr(cache, "folder", tmp_path.joinpath)
    monkeypatch.delenv("CLFUR_DEVICE", raising=False)
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)
    return monkeypatch


def test_order_of_wishes(no_wish):
    no_wish.setattr(devices, "_platforms", lambda: ALL)
    assert devices.choose() is NVIDIA[0]
    no_wish.setenv("PYOPENCL_CTX", "6:1")
    assert devices.choose() is AMD[1]
    no_wish.setenv("CLFUR_DEVICE", "intel")
    assert devices.choose() is INTEL[0]
    assert devices.choose("pocl") is POCL[0]
    assert devices.choose("auto") is NVIDIA[0]
    no_wish.setenv("CLFUR_DEVICE", "")
    assert devices.choose() is AMD[1]


def test_a_failed_check_is_remembered(no_wish):
    no_wish.setattr(devices, "_platforms", lambda: ALL)
    cache.remember(devices._identity(NVIDIA[0]), "crash", "the process died")
    assert devices.choose() is NVIDIA[1] and devices.choose("auto") is NVIDIA[1]
    assert devices.choose("gpu") is NVIDIA[0]
    no_wish.setenv("CLFUR_DEVICE", "nvidia")
    assert devices.choose() is NVIDIA[0]
    no_wish.delenv("CLFUR_DEVICE")
    cache.remember(devices._identity(NVIDIA[0]), "pass")
    assert devices.choose() is NVIDIA[0]
    NVIDIA[1].driver_version, old = "1.3", NVIDIA[1].driver_version   # another driver has to be tried anew
    cache.remember(devices._identity(NVIDIA[1]), "wrong")
    NVIDIA[1].driver_version = old
    assert devices._known(ALL) == ([], [])


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b'{"verdict": "perhaps", "message": ""}', b"\xff",
                                     b'{"verdict": [], "message": 1}'])
def test_damaged_memory_is_none(no_wish, content):
    cache.remember(["a"], "crash", "words")
    assert cache.recall(["a"]) == ("crash", "words") and cache.recall(["b"]) is None
    cache._file(["a"]).write_bytes(content)
    assert cache.recall(["a"]) is None


def test_no_cache_to_write(no_wish, tmp_path):
    (tmp_path / "checks").write_text("a file where the folder should be")
    with pytest.raises(Error, match="cannot write to .*checks"):
        cache.remember(["a"], "pass")
    assert cache.recall(["a"]) is None and devices.choose() in devices.find()
    assert [file.name for file in tmp_path.iterdir()] == ["checks"]


def test_no_home(monkeypatch, tmp_path):
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: f"~/.cache/{name}")
    monkeypatch.chdir(tmp_path)
    assert cache.recall(["a"]) is None
    with pytest.raises(Error, match="no cache folder"):
        cache.remember(["a"], "pass")
    assert not list(tmp_path.iterdir())


def test_error_names_the_variable(no_wish):
    no_wish.setattr(devices, "_platforms", lambda: ALL)
    no_wish.setenv("CLFUR_DEVICE", "abacus")
    with pytest.raises(Error, match="^CLFUR_DEVICE: no OpenCL device matches 'abacus'"):
        devices.choose()


@pytest.mark.parametrize("wrong", [1, ["pocl"], b"pocl"])
def test_device_of_another_type(wrong):
    with pytest.raises(Error, match="^device is .*; allowed: None, 'auto', .*'pocl', .*a pyopencl.Device"):
        devices.choose(wrong)


def test_drivers_that_fail(no_wish):
    def get_platforms(message):
        raise cl.LogicError(message)

    class Broken:
        name = "Broken"

        def get_devices(self):
            raise cl.RuntimeError("clGetDeviceIDs failed: DEVICE_NOT_FOUND")

    no_wish.setattr(cl, "get_platforms", lambda: [Broken()])
    assert devices.find() == []
    no_wish.setattr(cl, "get_platforms", lambda: get_platforms("PLATFORM_NOT_FOUND_KHR"))
    with pytest.raises(Error, match="there is no OpenCL device"):
        devices.choose()
    no_wish.setattr(cl, "get_platforms", lambda: get_platforms("OUT_OF_HOST_MEMORY"))
    with pytest.raises(Error, match="OUT_OF_HOST_MEMORY"):
        devices.choose()


def test_the_checker_of_kernels_is_left_out(no_wish):
    """Oclgrind, which the tests bring, draws only where it is alone; the numbers of platforms stay."""
    class Platform:
        def __init__(self, name):
            self.name, self.version, self.vendor = name, "OpenCL 1.2", "?"

        def get_devices(self):
            return [Made(platform=self, name=f"{self.name}'s", type=GPU, max_compute_units=1, driver_version="1")]
    checker, pocl = Platform("Oclgrind"), Platform("Portable Computing Language")
    no_wish.setattr(devices, "_facts", lambda device: {"name": device.name})
    no_wish.setattr(cl, "get_platforms", lambda: [checker, pocl])
    assert [device.platform for device in devices.find()] == [pocl] and devices.choose("1:0").platform is pocl
    assert [each["name"] for each in devices.survey()["platforms"]] == [pocl.name]
    no_wish.setattr(cl, "get_platforms", lambda: [checker])
    assert [device.platform for device in devices.find()] == [checker]
    assert [each["name"] for each in devices.survey()["platforms"]] == [checker.name]


def test_real_devices(no_wish):
    found = devices.find()
    assert found, "the tests need an OpenCL device; PoCL from PyPI is one"
    assert devices.choose() in found
    for device in found:
        assert devices.choose(device) is device
        assert device.name and devices.describe(device)
    for text, device in devices.handles(devices._platforms()):
        assert devices.choose(text) == device


def test_survey(no_wish):
    Platform = Made(name="Clover", version="1.1", vendor="Mesa")
    real = [(device.platform, [device]) for device in devices.find()]
    no_wish.setattr(devices, "_found", lambda: [(Platform, []), *real])
    surveyed = json.loads(json.dumps(devices.survey()))
    assert surveyed["platforms"][0] == {"name": "Clover", "version": "1.1", "vendor": "Mesa", "devices": []}
    assert surveyed["default"] == {"by": "auto", "text": "auto", "device": surveyed["auto"]["device"]}
    for number, (_, (device,)) in enumerate(real, 1):
        listed, = surveyed["platforms"][number]["devices"]
        assert (listed["number"], listed["name"], listed["check"]) == (f"{number}:0", device.name, None)
        assert listed["memory"] == device.global_mem_size and listed["compute_units"] == device.max_compute_units
    no_wish.setenv("CLFUR_DEVICE", "abacus")
    assert devices.survey()["default"] == {"by": "CLFUR_DEVICE", "text": "abacus", "device": None}
    no_wish.setattr(devices, "_found", lambda: [(Platform, [])])
    assert devices.survey()["auto"] is None


FORKS = """
import os, sys, clfur
from clfur.device import selection as device

def draw(scene):
    return clfur.render(scene, settings=clfur.Settings(samples=1)).shape

def child(how):
    try:
        how()
    except clfur.Error as error:
        print(error, flush=True)
    else:
        print("no error", flush=True)

scene = clfur.Scene(mesh=clfur.load_mesh("sphere"), camera=clfur.Camera(size=(8, 6)))
before = os.fork()
if not before:
    child(lambda: print(draw(scene), flush=True))   # OpenCL was not started yet: all is well
    sys.exit(4)
assert os.waitstatus_to_exitcode(os.waitpid(before, 0)[1]) == 4
import pyopencl   # found without clfur, and then used by it
here = pyopencl.get_platforms()[0].get_devices()[0]
device.check_process()
clfur.Scheduler(here)
assert device._started == os.getpid()
draw(scene)
device.check_process()
for how in (lambda: draw(scene), lambda: clfur.Scheduler("cpu"), lambda: clfur.Scheduler(here), device.find,
            device.check_process):
    sys.stdout.flush()
    pid = os.fork()
    if not pid:
        child(how)
        sys.exit(5)   # an ordinary end, with what Python and the drivers do then
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 5
import multiprocessing
worker = multiprocessing.get_context("fork").Process(target=child, args=(lambda: draw(scene),))
worker.start(); worker.join()
assert worker.exitcode == 0
print(draw(scene))
"""


def test_a_forked_child_is_told_to_spawn(no_wish):
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run([sys.executable, "-c", FORKS], env={**os.environ, "PYTHONPATH": str(root)},
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:2] == ["(6, 8, 4)", "no error"] and lines[-1] == "(6, 8, 4)"
    assert len(lines[2:-1]) == 6 and set(lines[2:-1]) == {
        'OpenCL does not survive a fork: start processes by "spawn", as multiprocessing.get_context("spawn") does'}


def test_a_cache_that_cannot_be_written(no_wish, tmp_path):
    """pyopencl fails without one, unless it is told; PoCL has to be given another."""
    code = "import clfur; print(clfur.render(clfur.Scene(mesh=clfur.load_mesh('sphere')), 'pocl').any())"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1]),
                   "XDG_CACHE_HOME": "/dev/null/cache", "POCL_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr
