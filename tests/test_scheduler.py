"""The scheduler: launches, buffers, kept stages, and the struct contract with the device."""

import functools
import gc
import weakref
from pathlib import Path

import numpy as np
import pyopencl as cl
import pytest

import clfur
from clfur import layout
from clfur.device import scheduler, signature, source
from clfur.device.scheduler import Scheduler
from clfur.device.signature import Lent


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
    monkeypatch.setattr(source, "kernel_dir", lambda: tmp_path)
    with pytest.raises(clfur.DeviceError, match=r"does not build oops\.cl: oops\.cl:3: .*NOPE"):
        gpu.launch("oops.a", 1)


def test_kernels_are_found_from_a_checkout_without_an_install(monkeypatch):
    def nowhere(name):
        raise ModuleNotFoundError(name)
    monkeypatch.setattr(source, "files", nowhere)
    checkout = Path(__file__).resolve().parents[1]   # these tests may run against another, installed clfur
    monkeypatch.setattr(source, "__file__", str(checkout / "clfur" / "device" / "source.py"))
    assert source.kernel_dir() == checkout / "cl" and (checkout / "cl" / "raster.cl").is_file()


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


def frozen(n):
    """[n] uint64 that stays as it is, at a multiple of 16 bytes."""
    room = np.arange(n + 2, dtype=np.uint64)
    array = room[room.ctypes.data // 8 % 2:][:n]
    room.flags.writeable = array.flags.writeable = False
    return array


def test_what_stays_is_read_where_it_lies(gpu):
    """On a processor; elsewhere it is copied.  Once anything has been read back it goes with its owner."""
    array = frozen(5000)
    there = gpu.lend(array)
    np.testing.assert_array_equal(there.get(), array)
    assert isinstance(there, Lent) == gpu.on_host
    owner = weakref.ref(array.base)
    del array
    gpu.download(gpu.full(1, np.uint32, 0))
    busy = [gpu.full(1 << 22, np.uint32, k) for k in range(8)]   # so that the device has something to do before
    late = gpu.copied(there)
    del there
    assert owner() is not None or not gpu.on_host   # what was launched since may still read it
    np.testing.assert_array_equal(gpu.download(late), np.arange(5000) + int(late[0].get()))
    assert owner() is None and len(busy) == 8


def test_what_may_change_or_lies_askew_is_copied(gpu):
    """None of these is lent: what can be written into, a view of it, rows apart, at a wrong place, a few bytes."""
    array, few = frozen(5000), frozen(8)
    view = np.arange(5000, dtype=np.uint64)[:]
    view.flags.writeable = False
    for given in (array.copy(), view, array[::2], array[1:], few):
        there = gpu.lend(given)
        assert not isinstance(there, Lent)
        np.testing.assert_array_equal(there.get(), given)


def test_rows_of_a_host_array_are_lent(gpu):
    array = frozen(10_000)
    there = gpu.rows(array, 2, 5002)
    assert isinstance(there, Lent) == gpu.on_host
    np.testing.assert_array_equal(there.get(), array[2:5002])
    assert gpu.rows(there, 0, 5000) is there
    np.testing.assert_array_equal(gpu.rows(there, 1, 7).get(), array[3:9])


def test_kernels_cannot_write_into_what_is_lent(gpu):
    """Where it is copied they may: then it is theirs."""
    array = frozen(5000)
    sums, total = gpu.lend(array), gpu.empty(1, np.uint64)
    try:
        gpu.launch("strands.scan_sums", 1, n=10, sums=sums, total=total)
        assert not gpu.on_host
    except TypeError as error:
        assert gpu.on_host and "sums is a device array of uint64 [5000] in the host's memory" in str(error)
    np.testing.assert_array_equal(array, np.arange(5000) + int(array[0]))


def test_what_is_lent_is_as_large_as_a_device_can_hold(gpu, monkeypatch):
    array = frozen(5000)
    monkeypatch.setattr(gpu, "largest", array.nbytes - 1)
    with pytest.raises(clfur.Error, match="more than .* can hold in one piece"):
        gpu.lend(array)


def busy(gpu):
    """Give a device something to do -> what it fills, and an event that ends with it."""
    arrays = [gpu.full(1 << 24, np.uint32, k) for k in range(3)]
    return arrays, cl.enqueue_marker(gpu.queue)


def is_done(event):
    return event.command_execution_status == cl.command_execution_status.COMPLETE


def test_many_that_are_lent_are_not_all_kept():
    """A host array is not kept for ever where nothing is read back; it is let go when what may read it has run."""
    gpu = Scheduler("pocl")   # a processor, which lends
    arrays = [frozen(1000) for _ in range(100)]
    owners = [weakref.ref(array.base) for array in arrays]
    _, event = busy(gpu)
    for array in arrays[:64]:
        gpu.lend(array)
    assert not is_done(event)
    for array in arrays[64:]:
        gpu.lend(array)
    assert is_done(event)
    del array, arrays
    assert sum(owner() is not None for owner in owners) <= 64


def test_views_keep_what_is_lent(gpu):
    array = frozen(5000)
    there = gpu.lend(array)
    view = there.reshape(-1, 4)
    owner = weakref.ref(array.base)
    del there, array
    gpu.download(gpu.full(1, np.uint32, 0))
    filled, _ = busy(gpu)
    late = gpu.copied(view)
    del view
    assert owner() is not None or not gpu.on_host
    assert gpu.download(late).ravel()[1:].all() and len(filled) == 3


def test_a_scheduler_that_goes_waits_for_those_who_read():
    """One that is stopped in a thread goes with it."""
    gpu = Scheduler("pocl")   # a processor, which lends
    filled, event = busy(gpu)
    gpu.lend(frozen(5000))
    del gpu
    gc.collect()
    assert is_done(event) and len(filled) == 3


def test_a_frame_lets_go_what_was_lent_to_one_that_was_stopped(gpu):
    array = frozen(5000)
    owner = weakref.ref(array.base)
    gpu.lend(array)
    del array
    with gpu.frame():
        assert owner() is None or not gpu.on_host


def test_what_is_done_is_what_was_given_before(gpu):
    """In seconds that launches are known to take: a download tells of those before it, not of those that came since."""
    sums, total = gpu.upload(np.ones(10, np.uint64)), gpu.empty(1, np.uint64)
    scan = functools.partial(gpu.launch, "strands.scan_sums", 1, n=10, sums=sums, total=total)
    scan()
    gpu.start()
    gpu.download(total)
    gpu._rates |= {("strands.scan_sums", turn): seconds for turn, seconds in enumerate((.01, .02, .04, .05))}
    scan()
    wait = gpu.downloading(sums)
    scan()
    assert gpu._given - gpu._done == pytest.approx(.03)
    wait()
    assert gpu._given - gpu._done == pytest.approx(.02)
    scan()
    assert gpu._given - gpu._done == pytest.approx(.06)
    scan()   # more than PIECE may be before the device, so it is waited for
    assert gpu._given == gpu._done


def test_large_arrays_lie_in_large_pages(monkeypatch):
    """PoCL's, of memory that is new: the pool's are where they were."""
    gpu, asked = Scheduler("pocl"), []
    monkeypatch.setattr(scheduler, "in_large_pages", lambda address, nbytes: asked.append(nbytes))
    first = gpu.empty(scheduler.LARGE, np.uint8)
    small = gpu.empty(scheduler.LARGE - 1, np.uint8)
    assert len(asked) == 1 and asked[0] >= scheduler.LARGE and small.nbytes < scheduler.LARGE
    del first
    again = gpu.empty(scheduler.LARGE, np.uint8)
    assert len(asked) == 1 and again.nbytes == scheduler.LARGE


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
