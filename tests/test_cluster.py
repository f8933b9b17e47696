"""Frames and regions that the workers of a cluster draw: the same bytes as alone, whoever dies, and nothing left."""

import logging
import os
import pickle
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support import jobs as jobs_of
from support.command import wrong

import clfur as library
from clfur.film import cluster, local, regions, worker
from clfur.film.jobs import Job, alone
from clfur.film.parcels import Parcels, unpack
from clfur.pipeline.picture import OUTPUTS
from clfur.scene import Mesh

distributed = pytest.importorskip("distributed", reason='NO CLUSTER IS TESTED: pip install "clfur[cluster]"')

ROOT = Path(__file__).resolve().parents[1]
LONG = 120   # seconds, for what takes some
PROC = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks /proc for processes")


def frames(count, roots=300, size=(40, 30)):
    mesh = library.load_mesh("sphere")
    camera = library.Camera(eye=(0, 0, 4), size=size)
    for number in range(count):
        scene = library.Scene(mesh=mesh, fur=library.Strands(roots=roots, seed=number), camera=camera)
        yield Job(number, (scene,), library.Settings(), ".png")


def until(there):
    """Wait for what there() gives, and return it."""
    began = time.monotonic()
    while not (found := there()):
        assert time.monotonic() - began < LONG
        time.sleep(0.05)
    return found


def processes(mark):
    """The processes, by id, whose command line or environment holds a text."""
    found = set()
    for each in Path("/proc").iterdir():
        if each.name.isdigit():
            try:
                if mark.encode() in (each / "cmdline").read_bytes() + (each / "environ").read_bytes():
                    found.add(int(each.name))
            except OSError:   # it is gone, or another user's
                pass
    return found - {os.getpid()}


def test_two_workers_of_which_one_is_killed(tmp_path, monkeypatch):
    """Real frames, and jobs that kill the worker they are on, once and always: the frames are those of one process."""
    monkeypatch.setattr(cluster, "TRIES", 2)
    right = dict(alone(frames(4), library.Scheduler()))
    given = [*frames(4), jobs_of.Once(4, str(tmp_path)), jobs_of.Killer(5, str(tmp_path)),
             jobs_of.Wrong(6, str(tmp_path)), jobs_of.Counted(7, str(tmp_path))]
    found = {}
    with pytest.raises(library.Error) as raised:
        for number, data in cluster.on_cluster([given[5], *given[:5], *given[6:]], "local:2"):
            found[number] = data
    assert found == right | {4: b"4 0.0", 7: b"7 0.0"}
    assert str(raised.value) == ("frame 5 cannot be drawn: 2 workers died of it; "
                                 "frame 6 cannot be drawn: it is too large")
    tries = {number: len(list(tmp_path.glob(f"{number}-*"))) for number in (4, 5, 7)}
    assert tries == {4: 2, 5: 2, 7: 1}


def test_a_picture_in_regions():
    """All outputs of a region, and the frame's numbers; the whole one is `test_the_command`'s."""
    scene = library.Scene(mesh=library.load_mesh("sphere"), fur=(library.Shells(), library.Strands(roots=500)),
                          camera=library.Camera(eye=(0, 0, 4), size=(61, 45)))
    settings = library.Settings(blur="edges", samples=4)
    outputs = [name for name in OUTPUTS if name != "strand_area"]
    right = library.draw(scene, None, settings, outputs, region=(7, 5, 40, 33))
    found = regions.picture(scene, "local:2", settings, outputs, (7, 5, 40, 33))
    assert list(found.images) == outputs
    for name, image in right.images.items():
        other = found.images[name]
        assert other.dtype == image.dtype and np.array_equal(other, image, equal_nan=True), name
    assert (found.strands, found.segments, found.settings) == (right.strands, right.segments, right.settings)


@pytest.mark.parametrize("top, end", [(0, 1), (0, 45), (5, 38), (0, 480), (3, 4000), (8, 16)])
def test_rows_of_regions(top, end):
    cut = regions.rows(top, end)
    assert [row for first, last in cut for row in range(first, last)] == [*range(top, end)]
    assert len(cut) <= regions.PIECES + 1 and all(first % regions.EACH == 0 for first, _ in cut[1:])


def test_what_all_jobs_have_is_sent_once():
    """The mesh and large arrays, as the same objects or others of the same bits; what differs is in each job."""
    first, second = frames(2)
    points = np.arange(9000, dtype=np.float32)
    parcels = Parcels([first, points], (Mesh,))
    again = library.load_mesh("sphere")
    packed = parcels.pack([second, points.copy(), again, points + 1])
    parts = {token: pickle.loads(part) for token, part in parcels.parts.items()}
    job, same, mesh, other = unpack(packed, parts)
    assert job.scenes[0].mesh is mesh and np.array_equal(same, points) and np.array_equal(other, points + 1)
    assert attrs.asdict(job.settings) == attrs.asdict(second.settings)
    assert points.nbytes < len(packed) < points.nbytes + 8000 < sum(map(len, parcels.parts.values()))


def test_shares_of_a_machine(monkeypatch):
    for name in local.THREADS:
        monkeypatch.delenv(name, raising=False)
    one, two, three = local.shares_of(["0:0", "1:0"], 3, 9)
    assert [each["CLFUR_DEVICE"] for each in (one, two, three)] == ["0:0", "1:0", "0:0"]
    assert one == three and one["POCL_MAX_PTHREAD_COUNT"] == "4" and one[worker.SHARE] == "2"
    assert two == {"CLFUR_DEVICE": "1:0", worker.SHARE: "1"} and len(local.shares_of(["0:0", "1:0"], None, 9)) == 2
    monkeypatch.setenv("POCL_MAX_PTHREAD_COUNT", "1")
    assert local.shares_of(["0:0"], 2, 9)[0]["POCL_MAX_PTHREAD_COUNT"] == "1"


def test_a_folder_that_dask_removes_after_us_is_not_missed(monkeypatch, caplog):
    """A scheduler that has not closed in time removes it at exit: that was told after all that the command told."""
    import dask
    from distributed.diskutils import WorkSpace

    late = []

    class Cluster(SimpleNamespace):
        scheduler_address = "tcp://127.0.0.1:1"

        def __enter__(self):
            late.append(WorkSpace(dask.config.get("temporary-directory")).new_work_dir(prefix="scheduler-"))
            return self

        def __exit__(self, *_):
            pass
    monkeypatch.setattr(distributed, "SpecCluster", Cluster)
    monkeypatch.setattr(local.subprocess, "Popen", lambda *_, **__: None)
    monkeypatch.setattr(local, "end", lambda child: None)
    with local.local_cluster(1, None):
        assert Path(late[0].dir_path).exists()
    assert not Path(late[0].dir_path).exists()
    late[0].release()
    assert not caplog.records
    logging.getLogger("distributed.diskutils").error("Failed to remove '/tmp/others'")
    assert len(caplog.records) == 1


def test_another_clfur_and_a_wrong_device_take_no_part(monkeypatch):
    """By name; when nobody is left, an error says why."""
    monkeypatch.setattr(cluster, "sources", lambda: "others")
    with warnings.catch_warnings(record=True) as said, pytest.raises(library.Error, match="no worker may take part"):
        warnings.simplefilter("always")
        list(cluster.on_cluster(frames(1), "local"))
    assert "the worker local-0 takes no part: it has another version of clfur, or another state of its files" in {
        str(each.message) for each in said}
    monkeypatch.setattr(worker, "_device", [])
    monkeypatch.setattr(worker, "_parts", {})
    monkeypatch.setattr(worker.selftest, "check", lambda gpu: ("9.0% of the pixels", []))
    assert "fails the self-test: 9.0% of the pixels" in worker.greet(worker.sources(), "name", {})[0]
    assert worker.work("name", b"") == ("unknown", None, [])


def test_a_scheduler_of_the_users(monkeypatch):
    """A worker comes late, joins, and the scheduler goes: nobody there, and nobody any more."""
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    monkeypatch.setattr(cluster, "CONNECT", LONG)   # it is there for certain, however busy this machine is
    options = {"host": "127.0.0.1", "port": 0, "dashboard": False, "dashboard_address": "127.0.0.1:0"}
    with distributed.SpecCluster(scheduler={"cls": distributed.Scheduler, "options": options}, workers={}) as server:
        address = server.scheduler_address
        with pytest.raises(library.Error, match=f"{address}: no worker is there"):
            list(cluster.on_cluster(frames(1), address))
        monkeypatch.setattr(cluster, "PATIENCE", LONG)

        def late():
            nonlocal child
            for job in frames(2):
                yield job
                if child is None:
                    child = subprocess.Popen(
                        [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-nanny", "--nthreads", "1",
                         "--memory-limit", "0", "--host", "127.0.0.1", "--no-dashboard", "--name", "late"],
                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                        env=os.environ | {"PYTHONPATH": str(ROOT)})
        child = None
        try:
            jobs = late()
            first = next(jobs)
            next(jobs)   # starts the worker
            assert dict(cluster.on_cluster([first], address)).keys() == {0}
        finally:
            child.kill()
            child.wait()
    monkeypatch.setattr(cluster, "CONNECT", 1)
    with pytest.raises(library.Error, match=f"cluster {address}: .*127.0.0.1"):
        list(cluster.on_cluster(frames(1), address))


@PROC
@pytest.mark.parametrize("how", ["SIGINT", "SIGKILL"])
def test_no_process_is_left(tmp_path, how):
    """Ctrl-C ends within two seconds, in one line, also while workers draw; killed, its workers end as well."""
    mark = f"CLFUR_TEST={tmp_path}"
    code = ("import sys\nfrom clfur.command import endings\nfrom clfur.film.cluster import on_cluster\n"
            "from support.jobs import Slow\n"
            f"jobs = [Slow(number, {str(tmp_path)!r}) for number in range(4)]\n"
            "sys.exit(endings.run(lambda: list(on_cluster(jobs, 'local'))))\n")
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    (tmp_path / "temporary").mkdir()
    with subprocess.Popen([sys.executable, "-c", code], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          env=os.environ | {"PYTHONPATH": path, "CLFUR_TEST": str(tmp_path),
                                            "TMPDIR": str(tmp_path / "temporary")}) as child:
        began = time.monotonic()
        until(lambda: list(tmp_path.glob("?-*")) or child.poll() is not None)
        start = time.monotonic() - began
        assert len(processes(mark)) >= 3   # itself, the one that keeps the worker, and that
        asked = time.monotonic()
        child.send_signal(getattr(signal, how))
        out, err = child.communicate(timeout=LONG)
        took = time.monotonic() - asked
    until(lambda: not processes(mark))
    if how == "SIGINT":
        # What a process of before has left, if anything, is no part of the end.
        lines = [line for line in err.splitlines() if "kernels are not kept" not in line]
        assert (child.returncode, out, lines) == (130, "", ["clfur: interrupted"]), err
        assert list((tmp_path / "temporary").iterdir()) == []
        print(f"ended after {took:.2f} s")
        assert took < max(10, start)   # 2 on a machine that does nothing else


def test_the_command(clfur, tmp_path):
    plain = ("render", "sphere", "--roots", 300, "--size", "40x30")
    assert clfur(*plain, "-o", "alone.png")[0] == 0
    code, out, err = clfur(*plain, "-o", "many.png", "--cluster", "local")
    assert (code, err) == (0, ""), err
    assert out.startswith("many.png: ")
    one, other = (library.load(tmp_path / f"{name}.png") for name in ("alone", "many"))
    assert (one["color"] == other["color"]).all()


def test_what_is_wrong_is_one_line(clfur, monkeypatch):
    plain = ("render", "sphere", "--roots", 300, "--size", "40x30", "--cluster")
    wrong(clfur(*plain, "here"), "cluster is 'here'", "local:N")
    wrong(clfur(*plain, "local:0"), "local:N")
    wrong(clfur(*plain, "local", "--memory", "1GiB"), "--memory")
    wrong(clfur(*plain, "tcp://127.0.0.1:1", "--device", "cpu"), "CLFUR_DEVICE")
    wrong(clfur(*plain, "local", "--outputs", "strand_area", "-o", "a.npz"), "strand_area")
    wrong(clfur(*plain, "local", "--max-error", "0.1"), "max_error")
    wrong(clfur(*plain, "tls://127.0.0.1:1"), "tls://127.0.0.1:1", "docs/cluster.md")
    monkeypatch.setattr(cluster, "CONNECT", 1)
    wrong(clfur(*plain, "tcp://127.0.0.1:1"), "tcp://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "distributed", None)
    wrong(clfur(*plain, "local"), 'pip install "clfur[cluster]"')
