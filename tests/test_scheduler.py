"""The scheduler: launches, buffers, kept stages, and the struct contract with the device."""

import weakref
from pathlib import Path

import numpy as np
import pyopencl as cl
import pytest

import clfur
from clfur import layout
from clfur.device import scheduler, signature
from clfur.device.scheduler import Scheduler


@pytest.mark.parametrize("name", layout.STRUCTS)
def test_structs_reach_the_kernel_whole(gpu, name):
    dtype = layout.STRUCTS[name]
    words = np.arange(dtype.itemsize // 4, dtype=np.uint32) + 1
    source = layout.preamble(gpu.int64_atomics) + f"""
        __kernel void copy(const {name} by_value, __global const {name} *by_pointer, __global uint *out)
        {{
            const uint n = sizeof({name}) / 4;
            for (uint i = 0; i < n; ++i) {{
                out[i] = ((const uint *)&by_value)[i];
                out[n + i] = ((__global const uint *)by_pointer)[i];
            }}
        }}"""
    out = gpu.empty(2 * len(words), np.uint32)
    value = words.view(dtype)
    kernel = cl.Kernel(cl.Program(gpu.context, source).build(), "copy")
    kernel(gpu.queue, (1,), None, value[0], gpu.upload(words).data, out.data)
    np.testing.assert_array_equal(out.get(), np.tile(words, 2))


def test_every_struct_member_is_made_of_16_byte_vectors():
    for dtype in layout.STRUCTS.values():
        for member in dtype.names:
            assert dtype[member].itemsize % 16 == 0 and dtype[member].shape[-1] == 4
            assert dtype.fields[member][1] % 16 == 0


@pytest.mark.parametrize("samples", [4, 16])
def test_no_two_samples_share_a_row_or_a_column(samples):
    x, y = np.transpose(layout.PATTERNS[samples])
    assert len(set(x)) == len(set(y)) == samples
    assert max(*abs(x), *abs(y)) <= 8


def test_the_patterns_follow_each_other():
    assert [layout.pattern_start(n) for n in (1, 4, 16)] == [0, 1, 5]


def test_a_build_error_names_file_and_line(gpu, tmp_path, monkeypatch):
    (tmp_path / "common.h").write_text("")
    (tmp_path / "oops.cl").write_text("__kernel void a(__global int *o)\n{\n    o[0] = NOPE;\n}\n")
    monkeypatch.setattr(scheduler, "kernel_dir", lambda: tmp_path)
    with pytest.raises(clfur.DeviceError, match=r"does not build oops\.cl: oops\.cl:3: .*NOPE"):
        gpu.launch("oops.a", 1)


def test_kernels_are_found_from_a_checkout_without_an_install(monkeypatch):
    def nowhere(name):
        raise ModuleNotFoundError(name)
    monkeypatch.setattr(scheduler, "files", nowhere)
    checkout = Path(__file__).resolve().parents[1]   # these tests may run against another, installed clfur
    monkeypatch.setattr(scheduler, "__file__", str(checkout / "clfur" / "device" / "scheduler.py"))
    assert scheduler.kernel_dir() == checkout / "cl" and (checkout / "cl" / "raster.cl").is_file()


def test_an_array_too_large_for_the_device_is_refused(gpu):
    with pytest.raises(clfur.Error, match="more than .* can hold in one piece"):
        gpu.empty((1 << 24, 1 << 20), np.float32)


def test_empty_arrays_have_a_buffer(gpu):
    array = gpu.upload(np.zeros((0, 4), np.float32))
    assert array.shape == (0, 4) and array.base_data is not None
    assert gpu.full((0, 2), np.uint32, 7).get().shape == (0, 2)


def test_buffers_are_used_again(gpu):
    gpu._pool.free_held()
    first = gpu.empty((1000, 4), np.float32)
    where = first.base_data.int_ptr
    del first
    assert gpu.empty((1000, 4), np.float32).base_data.int_ptr == where


def test_keep_asks_for_the_same_objects():
    gpu = Scheduler()
    made = []
    one, other = np.zeros(3), np.zeros(3)
    for key in [(one, 5), (one, 5), (other, 5), (other, 6), (other, 6), (one, 5)]:
        gpu.keep("stage", key, lambda: made.append(0) or len(made))
    assert len(made) == 4
    gpu.forget()
    assert gpu.keep("stage", (one, 5), lambda: "anew") == "anew"


def test_a_failed_build_keeps_nothing():
    gpu = Scheduler()
    with pytest.raises(ZeroDivisionError):
        gpu.keep("stage", (1,), lambda: 1 / 0)
    assert gpu.keep("stage", (1,), lambda: "made") == "made"


def test_seconds_add_up_by_kernel_file(gpu):
    gpu.start()
    assert gpu.seconds() == {}
    sums, total = gpu.upload(np.arange(10, dtype=np.uint64)), gpu.empty(1, np.uint64)
    gpu.launch("strands.scan_sums", 1, n=10, sums=sums, total=total)
    gpu.launch("strands.scan_sums", 1, n=10, sums=sums, total=total)
    seconds = gpu.seconds()
    assert set(seconds) == {"strands"} and 0 < seconds["strands"] < 10
    gpu.start()
    assert gpu.seconds() == {}


def test_no_wait_is_long_where_fur_follows_sky(monkeypatch):
    """A device made up, on a clock made up: work-items that are done in no time, then slow ones, then quick ones."""
    clock, pending, waits = [0.0], [0.0], []

    class Kernel:
        def __call__(self, queue, sizes, group, begin, end):
            begin, end = int(begin), int(end)
            slow = max(min(end, 4_000_000) - max(begin, 3_000_000), 0)
            pending[0] += 5e-5 + 1e-8 * (end - begin) + 1e-5 * slow
            return self

        def wait(self):
            clock[0] += pending[0]
            waits.append(pending[0])
            pending[0] = 0.0
    monkeypatch.setattr(scheduler.time, "perf_counter", lambda: clock[0])
    gpu = Scheduler()
    gpu._kernels["made.up"] = signature.Kernel("made.up", [], Kernel(), 64)
    gpu.launch("made.up", 5_000_000)
    assert max(*waits, pending[0]) < 0.7                            # one piece of the most that there is
    assert sum(wait > 1.5 * scheduler.PIECE for wait in waits) <= 2   # and then they are what they should be
    assert clock[0] + pending[0] < 10.1 + 0.1                       # waits cost little
    waits.clear()
    for _ in range(2):
        gpu.start()
        gpu.launch("made.up", 60_000)
    assert not waits                                                # short launches follow each other
    gpu.launch("made.up", 60_000)
    assert waits                                                    # of a second one in a frame nothing is known
    gpu.start()
    gpu.load("another scene")
    gpu.launch("made.up", 300_000)
    assert len(waits) > 4                                           # nothing is known of it
    waits.clear()
    gpu.start()
    gpu.launch("made.up", 300_000)
    assert not waits                                                # it took less than a piece may
    gpu.start()
    gpu.launch("made.up", 400_000)
    assert len(waits) > 4                                           # nobody knows what the others take


def test_an_upload_is_of_what_the_array_held_then(gpu):
    """It is not waited for where it is small: what the caller writes afterwards must not be on the device."""
    busy = [gpu.full(1 << 22, np.uint32, k) for k in range(8)]   # so that the device has something to do before
    array = np.arange(1000, dtype=np.int32)
    there = gpu.upload(array)
    array[:] = -1
    assert (gpu.download(there) == np.arange(1000)).all() and len(busy) == 8


def test_a_large_array_that_stays_is_not_waited_for_nor_kept(gpu):
    """One that may be written into is; what is uploaded goes with its owner once anything has been read back."""
    busy = [gpu.full(1 << 22, np.uint32, k) for k in range(8)]
    written, stays = np.arange(1 << 17), np.arange(1 << 17)
    stays.flags.writeable = False
    assert written.nbytes > scheduler.SMALL
    gpu.download(busy[0][:1])
    view = written.view()
    view.flags.writeable = False   # but what it is a view of is not
    waited = gpu.upload(written), gpu.upload(view)
    assert not gpu._uploads
    pending = gpu.upload(stays)
    assert len(gpu._uploads) == 1
    written[:], owner = -1, weakref.ref(stays)
    del stays
    for there in *waited, pending:
        np.testing.assert_array_equal(gpu.download(there), np.arange(1 << 17))
    assert owner() is None and len(busy) == 8


def test_what_is_launched_while_a_download_goes_on_is_not_in_it(gpu):
    sums, total = gpu.upload(np.ones(10, np.uint64)), gpu.empty(1, np.uint64)
    wait = gpu.downloading(sums)
    gpu.launch("strands.scan_sums", 1, n=10, sums=sums, total=total)
    np.testing.assert_array_equal(wait(), 1)
    np.testing.assert_array_equal(gpu.download(sums), np.arange(10))


def test_small_empty_arrays_are_made_once(gpu):
    """Kernels take one for each thing that there is not."""
    assert gpu.empty((0, 4), np.float32) is gpu.empty((0, 4), np.float32)
    assert gpu.empty(0, np.float32).shape == (0,) and gpu.empty(0, np.uint32).dtype == np.uint32
    assert gpu.empty((0, 1000), np.float32) is not gpu.empty((0, 1000), np.float32)
