"""Choosing a device, on made-up lists of platforms and on the real one."""

from types import SimpleNamespace as Made

import pyopencl as cl
import pytest

from clfur import Error
from clfur import device as devices

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
    with pytest.raises(Error, match=r'pip install "pyopencl\[pocl\]"'):
        devices.pick(text, platforms)


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
def no_wish(monkeypatch):
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


def test_error_names_the_variable(no_wish):
    no_wish.setattr(devices, "_platforms", lambda: ALL)
    no_wish.setenv("CLFUR_DEVICE", "abacus")
    with pytest.raises(Error, match="^CLFUR_DEVICE: no OpenCL device matches 'abacus'"):
        devices.choose()


@pytest.mark.parametrize("wrong", [1, ["pocl"], b"pocl"])
def test_device_of_another_type(wrong):
    with pytest.raises(Error, match="must be text"):
        devices.choose(wrong)


def test_drivers_that_fail(no_wish):
    def get_platforms(message):
        raise cl.LogicError(message)

    class Broken:
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


def test_real_devices(no_wish):
    found = devices.find()
    assert found, "the tests need an OpenCL device; PoCL from PyPI is one"
    assert devices.choose() in found
    for device in found:
        assert devices.choose(device) is device
        assert device.name and devices.describe(device)
    for text, device in devices.handles(devices._platforms()):
        assert devices.choose(text) == device
