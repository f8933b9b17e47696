"""Launches by name: what a kernel's arguments may be is read from its text, and nothing else gets through."""

import math

import numpy as np
import pyopencl as cl
import pytest

from clfur import layout
from clfur.device import signature, source
from clfur.pipeline.views import view_of
from clfur.scene.scene import Scene
from clfur.scene.strands import Strands
from clfur.stages.raster import NONE, raster
from clfur.stages.strands import arrays, grow
from clfur.stages.tessellate import tessellate

KERNELS = sorted(source.kernel_dir().glob("*.cl"), key=lambda path: path.name)
TEXT = """
/* __kernel void not_this(const int a) */
__kernel void all_kinds(
    const ulong begin, const ulong end,    // work-items
    const View view,
    const int count,                       // a number; and (more) of it
    const uint2 part,
    const float share,
    const float4 color,
    __global const float4 *points,         // [P]
    volatile __global uint *cells,
    __global long4 *sums,
    __global const HairType *types)
{
}
"""


@pytest.fixture
def kernel():
    """The kernel of TEXT, that no device runs."""
    return signature.Kernel("made.all_kinds", signature.read(TEXT)["all_kinds"], None, 64)


@pytest.fixture
def fitting(gpu):
    """Arguments that fit it."""
    return {"view": np.zeros((), layout.View), "count": 7, "part": (1, 2), "share": .5, "color": (0, 0, 0, 1),
            "points": gpu.empty((3, 4), np.float32), "cells": gpu.empty((2, 2, 2), np.uint32),
            "sums": gpu.empty((2, 3, 4), np.int64), "types": gpu.empty(1, layout.HairType)}


def c_type(argument):
    """An argument's type in C."""
    return f"{argument.base}{argument.width if argument.width > 1 else ''}" + "*" * isinstance(
        argument, signature.Buffer)


def test_a_text_is_read():
    (name, arguments), = signature.read(TEXT).items()
    assert name == "all_kinds"
    assert [(a.name, c_type(a)) for a in arguments] == [
        ("view", "View"), ("count", "int"), ("part", "uint2"), ("share", "float"), ("color", "float4"),
        ("points", "float4*"), ("cells", "uint*"), ("sums", "long4*"), ("types", "HairType*")]


@pytest.mark.parametrize("wrong", [
    "const int count", "const ulong begin, const ulong stop, const int count",
    "const ulong begin, const ulong end, const double x", "const ulong begin, const ulong end, const float3 x",
    "const ulong begin, const ulong end, __global const Nothing *x", "const ulong begin, const ulong end, const int *x",
    "const ulong begin, const ulong end, __global const float4 x", "const ulong begin, const ulong end, const View2 x",
    "const ulong begin, const ulong end, __local float *x", ""])
def test_what_cannot_be_checked_is_no_argument(wrong):
    with pytest.raises(TypeError, match="; allowed: .*int, uint"):
        signature.read(f"__kernel void wrong({wrong}) {{ }}")


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_the_driver_reads_the_same(gpu, path):
    """Where a driver reports names and types of arguments, they are those that were read."""
    text = source.read(path.stem)
    program = cl.Program(gpu.context, layout.preamble(gpu.int64_atomics, lanes=gpu.lanes) + text)
    kernels = program.build(["-cl-std=CL1.2", "-cl-kernel-arg-info"]).all_kernels()
    read, info = signature.read(text), cl.kernel_arg_info
    assert sorted(read) == sorted(kernel.function_name for kernel in kernels)
    for kernel in kernels:
        expected = [("begin", "ulong"), ("end", "ulong"), *((a.name, c_type(a)) for a in read[kernel.function_name])]
        assert kernel.num_args == len(expected)
        try:
            reported = [(kernel.get_arg_info(i, info.NAME), kernel.get_arg_info(i, info.TYPE_NAME))
                        for i in range(kernel.num_args)]
        except cl.RuntimeError:   # not every driver does
            assert "Portable" not in gpu.device.platform.name
            continue
        assert reported == expected


def test_what_fits_is_taken(kernel, fitting):
    taken = kernel.bind(fitting)
    assert taken[:2] == [fitting["view"], 7] and taken[3] == .5
    np.testing.assert_array_equal(taken[2], np.array([1, 2], np.uint32))
    np.testing.assert_array_equal(taken[4], np.array([0, 0, 0, 1], np.float32))
    assert [taken[2].dtype, taken[4].dtype] == [np.uint32, np.float32]
    assert taken[5] is fitting["points"].base_data and taken[6] is fitting["cells"].base_data


def test_order_does_not_matter(kernel, fitting):
    turned = dict(reversed(fitting.items()))
    assert list(turned) != list(fitting)
    for one, other in zip(kernel.bind(fitting), kernel.bind(turned)):
        np.testing.assert_equal(one, other)


@pytest.mark.parametrize("change, message", [
    ({"points": None}, "made.all_kinds misses points; its arguments: view, count, part, share, color, points, cells, "
                       "sums, types"),
    ({"point": 3}, "made.all_kinds has no point; its arguments: view, count"),
    ({"points": None, "point": 3, "begin": 0}, "made.all_kinds misses points and has no point, begin; its arguments"),
])
def test_wrong_names_are_refused(kernel, fitting, change, message):
    given = {name: value for name, value in {**fitting, **change}.items() if value is not None}
    with pytest.raises(TypeError) as error:
        kernel.bind(given)
    assert str(error.value).startswith(message)


U32, I32 = "a whole number from 0 to 4294967295", "a whole number from -2147483648 to 2147483647"


@pytest.mark.parametrize("name, value, shown, allowed", [
    ("count", "7", "'7'", I32), ("count", None, "None", I32), ("count", 2**31, "2147483648", I32),
    ("count", -2**31 - 1, "-2147483649", I32), ("count", 7.5, "7.5", I32), ("count", math.nan, "nan", I32),
    ("count", math.inf, "inf", I32), ("count", 1j, "1j", I32), ("count", (7,), "(7,)", I32),
    ("count", np.zeros(1, np.int32), "int32 [1] on the host", I32), ("count", np.uint32(2**31), "2147483648", I32),
    ("count", np.zeros((), layout.Shadow), "Shadow [] on the host", I32),
    ("share", "half", "'half'", "a number from -3.4"), ("share", 1e39, "1e+39", "a number from -3.4"),
    ("share", 10**400, "1000", "a number from -3.4"),
    ("part", (1, -1), "-1", U32), ("part", (1,), "(1,)", f"2 numbers, each {U32}"),
    ("part", (1, 2, 3), "(1, 2, 3)", f"2 numbers, each {U32}"), ("part", 5, "5", f"2 numbers, each {U32}"),
    ("part", "12", "'12'", f"2 numbers, each {U32}"), ("part", {1, 2}, "{1, 2}", f"2 numbers, each {U32}"),
    ("part", np.zeros((2, 2)), "float64 [2, 2] on the host", f"2 numbers, each {U32}"),
    ("part", np.zeros(()), "float64 [] on the host", f"2 numbers, each {U32}"),
    ("color", np.zeros((4, 1)), "float64 [4, 1] on the host", "4 numbers, each a number from -3.4"),
    ("view", np.zeros((), layout.Grid), "Grid [] on the host", "a layout.View"),
    ("view", np.zeros(1, layout.View), "View [1] on the host", "a layout.View"),
    ("view", np.zeros((), layout.View.descr[:-1]), "a struct of 176 bytes [] on the host", "a layout.View"),
    ("view", np.zeros((), "V192"), "|V192 [] on the host", "a layout.View"), ("view", None, "None", "a layout.View"),
    ("points", np.zeros((3, 4), np.float32), "float32 [3, 4] on the host", "a device array of float32 [..., 4]"),
    ("points", 5, "5", "a device array of float32 [..., 4]"), ("types", None, "None", "a device array of HairType"),
])
def test_wrong_values_are_refused(kernel, fitting, name, value, shown, allowed):
    with pytest.raises(TypeError) as error:
        kernel.bind({**fitting, name: value})
    assert str(error.value).startswith(f"made.all_kinds: {name} is {shown}")
    assert f"; allowed: {allowed}" in str(error.value)


@pytest.mark.parametrize("name, shape, dtype, shown, allowed", [
    ("points", (3, 4), np.uint32, "uint32 [3, 4]", "float32 [..., 4]"),
    ("points", (3, 4), np.float64, "float64 [3, 4]", "float32 [..., 4]"),
    ("points", (4, 3), np.float32, "float32 [4, 3]", "float32 [..., 4]"),
    ("points", 12, np.float32, "float32 [12]", "float32 [..., 4]"),
    ("points", 0, np.float32, "float32 [0]", "float32 [..., 4]"),
    ("sums", (2, 4), np.uint64, "uint64 [2, 4]", "int64 [..., 4]"),
    ("cells", 5, np.int32, "int32 [5]", "uint32"), ("cells", 0, np.float32, "float32 [0]", "uint32"),
    ("types", 1, layout.Light, "Light [1]", "HairType"), ("types", 96, np.uint8, "uint8 [96]", "HairType"),
])
def test_wrong_arrays_are_refused(gpu, kernel, fitting, name, shape, dtype, shown, allowed):
    with pytest.raises(TypeError) as error:
        kernel.bind({**fitting, name: gpu.empty(shape, dtype)})
    expected = f"{name} is a device array of {shown}; allowed: a device array of {allowed}"
    assert str(error.value) == f"made.all_kinds: {expected}"


def test_a_part_of_an_array_is_refused(gpu, kernel, fitting):
    """A kernel would read it from the beginning of the whole."""
    with pytest.raises(TypeError, match=r"float32 \[2, 4\] that begins within a larger one; allowed"):
        kernel.bind({**fitting, "points": gpu.empty((3, 4), np.float32)[1:]})
    kernel.bind({**fitting, "points": gpu.empty((3, 4), np.float32)[:2]})


@pytest.mark.parametrize("name, value", [
    ("count", True), ("count", np.True_), ("count", 7.0), ("count", np.uint64(7)), ("count", np.array(7.0)),
    ("count", -2**31), ("share", 3), ("share", math.inf), ("share", np.float64(.1)), ("share", np.float32(.1)),
    ("share", -3.4028234e38), ("part", [1, np.int64(2)]), ("part", np.array([1.0, 2**32 - 1])),
    ("color", (1, 2.5, True, 0)), ("view", np.zeros(1, layout.View)[0]),
])
def test_whatever_is_a_number_is_taken(kernel, fitting, name, value):
    taken = dict(zip(kernel.takes, kernel.bind({**fitting, name: value})))[name]
    np.testing.assert_array_equal(taken, value)
    np.testing.assert_equal(math.nan, kernel.bind({**fitting, "share": math.nan})[3])


# --- on the device ----------------------------------------------------------------------------------------


def test_positional_arguments_are_refused(gpu):
    with pytest.raises(TypeError, match="positional"):
        gpu.launch("strands.scan_sums", 1, 10, gpu.empty(10, np.uint64), gpu.empty(1, np.uint64))


def test_arrays_of_another_context_are_refused(gpu, another):
    """PoCL and rusticl would run, without waiting for what the other device still does to it."""
    foreign = another().upload(np.arange(10, dtype=np.uint64))
    with pytest.raises(TypeError, match=r"strands.scan_sums: sums is an array of another Scheduler"):
        gpu.launch("strands.scan_sums", 1, n=10, sums=foreign, total=gpu.empty(1, np.uint64))


@pytest.mark.parametrize("base, width, fits", [
    ("float", 1, True), ("float", 4, True), ("uint", 2, True), ("ulong", 2, True), ("float", 8, False),
    ("long", 4, False), ("HairType", 1, False)])
def test_no_more_than_sixteen_bytes_are_read_at_a_time_from_what_is_lent(gpu, base, width, fits):
    """A host array need not begin at a multiple of more."""
    dtype = np.dtype(signature.NUMBERS.get(base) or layout.STRUCTS[base])
    there = signature.Lent(gpu.queue, (8, width) if width > 1 else (8,), dtype)
    for only_read in True, False:
        argument = signature.Buffer("given", base, width, only_read)
        if fits and only_read:
            assert argument.take(there) is there.base_data
        else:
            with pytest.raises(TypeError, match="in the host's memory"):
                argument.take(there)


def test_nothing_runs_before_all_is_checked(gpu):
    sums, total = gpu.upload(np.arange(10, dtype=np.uint64)), gpu.full(1, np.uint64, 5)
    for wrong in ({"n": 10.5}, {"total": gpu.empty(1, np.float32)}, {"begin": 0}):
        gpu.start()
        with pytest.raises(TypeError, match=r"^strands\.scan_sums"):
            gpu.launch("strands.scan_sums", 1, **{"n": 10, "sums": sums, "total": total, **wrong})
        assert gpu.seconds() == {}
    assert total.get()[0] == 5
    gpu.launch("strands.scan_sums", 1, total=total, n=10.0, sums=sums)
    assert total.get()[0] == 45


def test_arrays_of_another_shape_cannot_be_swapped(gpu, sphere):
    """Nor can two of one kind be by their order, as there is none; one name for the other is in the twins' hands."""
    strands = grow(gpu, tessellate(gpu, sphere), Strands())
    view = view_of(Scene(sphere), 1)
    right = raster(gpu, view, strands).get()
    given = {"view": view, "first": 0, "phase": 0, "strands": len(strands.spans), "stretch": (0, 99),
             "steps": 2**32 - 1, "room": 0, "n_left": gpu.full(1, np.uint32, 0), "left": gpu.empty((0, 2), np.uint32),
             **arrays(strands, "points", "spans", "shifts")}
    visible = gpu.full(right.shape, np.uint64, NONE)
    if gpu.int64_atomics:
        gpu.launch("raster.lines", len(strands.spans), **dict(reversed({**given, "visible": visible}.items())))
        np.testing.assert_array_equal(visible.get(), right)
    for one, other in (("points", "spans"), ("spans", "visible"), ("view", "first"), ("points", "first")):
        swapped = {**given, "visible": visible}
        swapped[one], swapped[other] = swapped[other], swapped[one]
        with pytest.raises(TypeError, match="raster.lines: "):
            gpu.launch("raster.lines", len(strands.spans), **swapped)
