"""The same picture however a driver runs the kernels; an end in time when it is interrupted; nothing left behind."""

import gc
import os
import signal
import subprocess
import sys
import time

import pytest

import clfur
from clfur.device import selection as device
from clfur.judge.isolated import isolated

HANDLES = [(text, one) for text, one in device.handles()]
POCL = [text for text, one in HANDLES if "pocl" in one.platform.version.lower()]


@pytest.mark.parametrize("threads, method", [("1", "loops"), ("2", "loopvec")])
@pytest.mark.parametrize("text", POCL)
def test_neither_threads_nor_work_group_method_change_a_bit(tmp_path, text, threads, method):
    """The self-test compares visibility, voxels and shadow map by hash, and the colours: each is judged alone."""
    (tmp_path / "cache").mkdir()   # PoCL does not distinguish what it has compiled by one method from another's
    outcome = isolated("clfur.judge.selftest:check", text, seconds=120,
                       environment={"POCL_MAX_PTHREAD_COUNT": threads, "POCL_WORK_GROUP_METHOD": method,
                                    "POCL_CACHE_DIR": str(tmp_path / "cache")})
    assert (outcome.status, outcome.value[0]) == ("ok", ""), outcome


@pytest.mark.parametrize("text", [text for text, _ in HANDLES])
def test_an_interrupt_ends_it_in_two_seconds(tmp_path, text):
    """A frame of many seconds, whose kernels are built already: Ctrl-C ends it, and leaves no file."""
    command = [sys.executable, "-c", "from clfur.command.main import main; main()", "render", "sphere",
               "--roots", "1000000", "--samples", "16", "--device", text, "-o", "a.png"]
    places = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    small = command + ["--roots", "70000", "--size", "300x240"]   # also by as many work-items as the large frame's
    subprocess.run(small, cwd=tmp_path, check=True, capture_output=True, env=places)
    (tmp_path / "a.png").unlink()
    running = subprocess.Popen(command + ["--size", "4000x3000"], cwd=tmp_path, stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True, env=places)
    time.sleep(4)
    assert running.poll() is None, running.communicate()
    asked = time.monotonic()
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert time.monotonic() - asked < 2
    # PoCL's compiler says "1 error generated." if it is interrupted, on a busy machine.
    assert (running.returncode, out, err.strip().splitlines()[-1]) == (130, "", "clfur: interrupted")
    assert list(tmp_path.iterdir()) == []


def test_frames_leave_nothing_behind(gpu):
    """Resident memory over 300 frames of ever other sizes: 3 MB in 10,000 frames would fail.

    Python's collector leaves cycles for hundreds of frames; they are no leak, so it runs before each look.
    """
    mesh = clfur.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], None, None, [[0, 1, 2]])

    def frames(n):
        for i in range(n):
            fur = clfur.Strands(types=[clfur.HairType(segments=2)], roots=20 + i % 7)
            clfur.draw(clfur.Scene(mesh, fur, camera=clfur.Camera(size=(16 + i % 5, 12))), gpu,
                       clfur.Settings(samples=1, grid=16, shadow_map=8))
        gc.collect()
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    before = frames(400)   # lru caches and pools are full by then: from there on nothing grows
    assert frames(300) - before < 1e5


def test_a_scheduler_does_not_survive_a_fork(gpu):
    """A child gets an error at once for a kept scheduler as well, and can end."""
    scene = clfur.Scene(clfur.load_mesh("sphere"), clfur.Strands(roots=50), camera=clfur.Camera(size=(32, 24)))
    clfur.render(scene, gpu)
    child = os.fork()
    if not child:
        code = 1
        try:
            clfur.render(scene, gpu)
        except clfur.Error as error:
            code = 0 if "spawn" in str(error) else 2
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
