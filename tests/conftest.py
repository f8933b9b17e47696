"""Fixtures: every OpenCL device that is present, and small scenes to draw on it."""

import hypothesis
import numpy as np
import pytest
from support.coverage import Kernels
from support.devices import DEVICES
from support.scenes import icosphere

import clfur
from clfur.command.main import main
from clfur.device import selection as device
from clfur.device import source

# The same examples in every run, on however slow a machine.
hypothesis.settings.register_profile("clfur", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("clfur")


def pytest_report_header(config):
    return [f"OpenCL: {handle} = {device.describe(d)}" for handle, d in device.handles(device._platforms())]


@pytest.fixture(scope="session", params=range(max(len(DEVICES), 1)),
                ids=lambda i: device.describe(DEVICES[i]).split(" ·")[0].replace(" ", "-") if DEVICES else "none")
def gpu(request):
    """A scheduler on each device in turn; a machine without any fails the tests, it doesn't skip them."""
    assert DEVICES, "no OpenCL device: the tests need one (PoCL comes with the package)"
    return clfur.Scheduler(DEVICES[request.param])


@pytest.fixture(autouse=True)
def _launches_as_its_class_does(request):
    """What monkeypatch puts back on an object stays there, before what tests patch in its class."""
    gpu = request.getfixturevalue("gpu") if "gpu" in request.fixturenames else None
    yield
    if gpu is not None:
        vars(gpu).pop("launch", None)


@pytest.fixture(scope="session")
def idle():
    """Schedulers that no test uses at the moment: {(device, what their kernels are built for): [Scheduler]}."""
    return {}


@pytest.fixture
def another(gpu, idle):
    """Gives further schedulers of the device, or of ``device``, each as if it were new: building kernels takes time.

    ``built``: attributes that kernels are built by, int64_atomics and lanes.
    """
    lent = []

    def lend(memory=None, device=None, **built):
        key = device or gpu.device, *sorted(built.items())
        one = idle[key].pop() if idle.get(key) else clfur.Scheduler(key[0])
        if one.room < one.memory:   # an error or a cache still holds arrays of a test before
            one = clfur.Scheduler(key[0])
        lent.append((key, one, dict(vars(one))))
        vars(one).update(built)
        one.memory = min(memory or one.memory, one.memory)
        return one
    yield lend
    for key, one, before in lent:
        vars(one).clear()
        vars(one).update(before)
        one.pace.clear()
        one.forget()
        idle.setdefault(key, []).append(one)


@pytest.fixture(autouse=True)
def fresh(request):
    """Each test starts without stages kept from the one before."""
    yield
    if "gpu" in request.fixturenames:
        request.getfixturevalue("gpu").forget()


@pytest.fixture
def plain(monkeypatch):
    """Kernels of the tests are found among the others."""
    folder = Kernels(source.kernel_dir())
    monkeypatch.setattr(source, "kernel_dir", lambda: folder)


@pytest.fixture(scope="session")
def sphere():
    """Unit sphere of 320 faces; its normals are exact and its uv are longitude and latitude by corner."""
    positions, faces = icosphere(2)
    uv = np.stack([np.arctan2(positions[:, 0], positions[:, 2]) / (2 * np.pi) + 0.5,
                   np.arcsin(positions[:, 1]) / np.pi + 0.5], 1)
    return clfur.Mesh(positions, positions, uv[faces], faces)


@pytest.fixture(name="clfur")
def command(tmp_path, monkeypatch, capfd):
    """Runs the command in an empty folder -> (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CLFUR_DEVICE", raising=False)
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)

    def run(*arguments):
        with pytest.raises(SystemExit) as exit:
            main(list(map(str, arguments)))
        return exit.value.code, *capfd.readouterr()
    return run


@pytest.fixture
def comparison():
    """A `clfur.Comparison` made up: two devices agree, one without times of stages, one crashed, one differs."""
    from clfur.judge.compare import Comparison, Difference, Row, Spread
    picture = np.zeros((12, 16, 4), np.float32)
    picture[3:9, 4:12] = 0.5, 0.25, 0.125, 1
    other = picture.copy()
    other[5, 5] = 0.75, 0.25, 0.125, 1
    seconds = {"frames": [0.5, 0.25, 1.0], "frame": Spread(0.5, 0.25, 1.0), "first": 8.0, "build": 2.5,
               "memory": 3 << 20, "resident": 600 << 20, "strands_per_second": 2000.0}
    stages = {"strands": Spread(0.125, 0.0625, 0.25), "raster": Spread(0.25, 0.125, 0.5)}
    same = {"visibility": True, "voxels": True}
    return Comparison("pocl", (16, 12), clfur.Settings(), 500, 1000, 8000, 3, [
        Row("pocl", "PoCL 3.0 · <b>Chip</b>", "ok", **seconds, stages=stages, picture=picture,
            difference=Difference(0.0, 0.0, 0.0, same)),
        Row("rusticl", "rusticl · Chip", "ok", **seconds, stages=None, picture=picture,
            difference=Difference(1e-6, 0.0, 1e-7, same)),
        Row("bad", "Bad driver · Chip", "crash", "the process died of SIGSEGV (after 1 of 5 frames)"),
        Row("odd", "Odd driver · Chip", "differs", "other bits in voxels", **seconds, stages=stages, picture=other,
            difference=Difference(0.25, 1 / 192, 0.01, same | {"voxels": False}))])


@pytest.fixture
def measured():
    """A `clfur.Frontier` made up: 40 settings, of which a dozen that stand close together are the frontier."""
    from clfur.judge.compare import Spread
    from clfur.judge.frontier import Frontier, Point, label
    points = []
    for place in range(40):
        best = place % 3 == 0 and place < 36
        settings = clfur.Settings(raster="samples", samples=(1, 4, 16)[min(place // 13, 2)], grid=16 * (place + 1),
                                  shadows=("length", "count")[place % 2])
        seconds, error = 0.02 * 1.04**place, 0.2 * 0.96**place * (1 if best else 1.5)
        spread = Spread(seconds, seconds * .9, seconds * 1.1)
        points.append(Point(settings, None, label(settings), "", [seconds], spread, 200, 1600, error, error, -.01, .9,
                            None, error / 2, best))
    default = clfur.Settings()
    points.append(Point(default, None, label(default), "default", [.5], Spread(.5, .5, .5), 200, 1600, .1, .1, .02,
                        None, .03, None))
    return Frontier("PoCL 3.0 · <b>Chip</b>", (32, 24), .004, "brute force", 0, points)
