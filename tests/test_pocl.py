"""PoCL 3.0's name for a processor that its compiler does not know: a struct like the driver's, made up in memory."""

import ctypes

import numpy as np
import pytest

import clfur
from clfur.device import pocl


def device_like(triple, name):
    """(a struct with pointers to these texts where PoCL 3.0 has them, its address)."""
    struct = (ctypes.c_char * 1024)()
    struct.texts = [ctypes.create_string_buffer(text) for text in (triple, name)]
    for place, text in zip((pocl.TRIPLE, pocl.NAME), struct.texts):
        ctypes.c_void_p.from_buffer(struct, place).value = ctypes.addressof(text)
    return struct, ctypes.addressof(struct)


def name_in(struct):
    return ctypes.c_char_p.from_buffer(struct, pocl.NAME).value


AVX512 = "sse2 avx2 fma bmi2 f16c avx512f avx512bw avx512cd avx512dq avx512vl avx_vnni"


@pytest.mark.parametrize("flags, name", [
    (AVX512, "skylake-avx512"),
    ("sse2 avx2 fma bmi2 f16c avx512f", "haswell"), ("sse2 avx fma4", "x86-64"), ("", "x86-64")])
def test_an_unknown_processor_gets_the_nearest_name(monkeypatch, flags, name):
    monkeypatch.setattr(pocl, "features", lambda: set(flags.split()))
    struct, place = device_like(b"x86_64-unknown-linux-gnu", b"generic")
    assert pocl.rename(place) == name and name_in(struct) == name.encode()


@pytest.mark.parametrize("flags, name", [(AVX512, "skylake-avx512"), ("sse2 avx2 fma bmi2 f16c", None)])
def test_zen_4_is_not_named_as_zen_3(monkeypatch, flags, name):
    """What has AVX-512 is no Zen 3, which is all that LLVM 14 knows of that family; a Zen 3 keeps its name."""
    monkeypatch.setattr(pocl, "features", lambda: set(flags.split()))
    struct, place = device_like(b"x86_64-unknown-linux-gnu", b"znver3")
    assert pocl.rename(place) == name and name_in(struct) == (name or "znver3").encode()


@pytest.mark.parametrize("triple, name", [
    (b"x86_64-unknown-linux-gnu", b"znver2"), (b"x86_64-unknown-linux-gnu", b"generic-rv64"),
    (b"aarch64-unknown-linux-gnu", b"generic"), (b"", b"")])
def test_another_name_or_target_stays(triple, name):
    struct, place = device_like(triple, name)
    assert pocl.rename(place) is None and name_in(struct) == name


def test_pointers_to_nowhere_do_no_harm():
    struct = (ctypes.c_char * 1024)()
    ctypes.c_void_p.from_buffer(struct, pocl.TRIPLE).value = 8
    ctypes.c_void_p.from_buffer(struct, pocl.NAME).value = 2**63 + 16
    before = bytes(struct)
    assert pocl.rename(ctypes.addressof(struct)) is None and bytes(struct) == before
    assert pocl.rename(8) is None


def test_a_scheduler_names_the_processor(gpu, monkeypatch):
    """Before anything is built; what is drawn then is tested everywhere else."""
    named = []
    monkeypatch.setattr(pocl, "name_processor", named.append)
    other = clfur.Scheduler(gpu.device)
    assert named == [gpu.device] and other.full(3, np.int32, 1).get().tolist() == [1, 1, 1]
