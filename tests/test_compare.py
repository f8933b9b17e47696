"""The same frames on many devices: what is measured, what counts as the same picture, and what a bad driver costs."""

import json
import os
import signal
import time

import numpy as np
import pytest

import clfur
from clfur.device import selection as device
from clfur.judge import compare as library  # the module: clfur.compare is its function
from clfur.judge import isolated


def scene(sphere):
    return clfur.Scene(mesh=sphere, fur=clfur.Strands(inner=1, outer=1, roots=300), camera=clfur.Camera(size=(64, 48)))


@pytest.fixture(scope="module")
def found(sphere):
    """(Comparison of all devices that there are, the progress that it reported)"""
    progress = []
    return clfur.compare(scene(sphere), repeat=3, tell=lambda *what: progress.append(what)), progress


def test_all_devices_give_the_same_picture(found, sphere):
    result, _ = found
    assert [(row.device, row.status, row.message) for row in result.rows] == [
        (text, "ok", "") for text, _ in device.handles()]
    assert result.agree and len(result.rows) == len(device.find())
    for row in result.rows:
        assert row.difference.same == {"visibility": True, "voxels": True, "shadow_map": True}
        assert row.difference.largest < 1e-4 and row.difference.share == 0 and row.difference.flip < 1e-4
    reference = next(row for row in result.rows if row.device == result.reference)
    assert reference.name == device.describe(device.choose("auto"))
    assert reference.difference.largest == reference.difference.flip == 0
    np.testing.assert_allclose(reference.picture, clfur.render(scene(sphere), result.reference), atol=1e-6)
    assert (result.size, result.strands, result.segments, result.repeat) == ((64, 48), 300, 2400, 3)


def test_what_is_measured(found):
    for row in found[0].rows:
        assert len(row.frames) == 3
        assert (row.frame.median, row.frame.min, row.frame.max) == (
            sorted(row.frames)[1], min(row.frames), max(row.frames))
        assert row.first > row.build > 0 and row.first > row.frame.max   # it starts without any cache
        assert row.strands_per_second == pytest.approx(300 / row.frame.median)
        assert 64 * 48 * 4 * 8 < row.memory < 1 << 30                    # at least the samples' depths and ids
        assert 30 << 20 < row.resident < 8 << 30
        if row.stages is not None:
            assert {"tessellate", "strands", "raster", "voxelize", "zscan", "shadow_map", "coverage",
                    "strand_light", "shade"} == set(row.stages)
            for spread in row.stages.values():
                assert 0 <= spread.min <= spread.median <= spread.max < row.frame.max


def test_it_tells_how_far_it_is(found):
    assert found[1] == [(text, done, 5) for text, _ in device.handles() for done in range(6)]


def test_as_dict_is_json(found):
    result = json.loads(json.dumps(found[0].as_dict(), allow_nan=False))
    assert result["agree"] is True and result["reference"] == found[0].reference
    assert result["settings"]["samples"] == 4
    row = result["rows"][0]
    assert set(row) == {"device", "name", "status", "message", "frames", "frame", "stages", "first", "build", "memory",
                        "resident", "strands_per_second", "difference"}
    assert set(row["frame"]) == {"median", "min", "max"} and len(row["frames"]) == 3


def test_resident_is_the_process_s_own(sphere, monkeypatch):
    """What the caller holds is not counted."""
    held = np.ones(1 << 27)   # 1 GiB
    result = run(monkeypatch, sphere, ["resident"])
    assert 10 << 20 < result.rows[0].resident < 800 << 20 < held.nbytes


PICTURE = np.full((40, 50, 4), 0.5, np.float32)   # 2000 pixels: two are the share that may differ


def measured(**changes):
    return {"drawn": (1, 10, 80), "hashes": {"visibility": "a", "voxels": "b"}, "picture": PICTURE, "first": 3.0,
            "build": 1.0, "resident": 1, "memory": 2, "frames": [0.25, 0.5],
            "stages": [{"raster": 0.125}, {"raster": 0.25}], **changes}


def changed(pixels, by):
    picture = PICTURE.copy()
    picture.reshape(-1, 4)[:pixels, 1] += np.float32(by)
    return measured(picture=picture)


def made_up(device, scene, settings, repeat):
    """In place of `clfur.judge.compare._measure`: what a device of this name would do."""
    isolated.send("a frame")
    if device == "crash":
        print("LLVM ERROR: out of registers", flush=True)
        os.kill(os.getpid(), signal.SIGABRT)
    elif device == "hang":
        time.sleep(600)
    elif device == "error":
        raise clfur.Error("the device is out of memory")
    elif device == "resident":
        module = library
        module.draw = lambda *_, **__: clfur.Frame({"color": PICTURE}, "", 1, 2, 3, 1, {}, 5, {})
        return module._measure("auto", None, None, 1)
    return {"bits": lambda: measured(hashes={"visibility": "a", "voxels": "c"}),
            "few": lambda: changed(2, 0.5), "many": lambda: changed(3, 0.5), "faint": lambda: changed(2000, 9e-4),
            "nan": lambda: changed(3, np.nan), "stopped": lambda: measured(stages=[{"raster": 2e-9}] * 2),
            "wrong": lambda: measured(stages=[{"raster": 70.0}] * 2)}.get(device, measured)()


def in_a_process(_, *arguments, **how):
    return isolated.isolated(f"{__name__}:made_up", *arguments, **how)


def in_this_process(_, *arguments, **how):
    """For devices that do no harm."""
    return isolated.Outcome("ok", made_up(*arguments))


def run(monkeypatch, mesh, names, isolated=in_a_process, **options):
    """`clfur.compare` of devices made up."""
    best = device.choose("auto")
    monkeypatch.setattr(library, "_chosen", lambda _: [(name, best) for name in names])
    monkeypatch.setattr(library, "isolated", isolated)
    return clfur.compare(scene(mesh), **{"repeat": 2, "seconds": 60, **options})


def test_a_bad_driver_costs_its_own_row(sphere, monkeypatch):
    result = run(monkeypatch, sphere, ["crash", "fine", "error"])
    assert result.reference == "fine" and not result.agree
    assert [(row.status, row.message) for row in result.rows] == [
        ("crash", "the process died of SIGABRT: LLVM ERROR: out of registers (after 1 of 4 frames)"), ("ok", ""),
        ("error", "the device is out of memory (after 1 of 4 frames)")]
    assert result.rows[0].frame is None and result.rows[0].picture is None
    json.dumps(result.as_dict(), allow_nan=False)


def test_a_driver_that_hangs_costs_its_time(sphere, monkeypatch):
    """And where no device works there is no reference, but a result."""
    began = time.monotonic()
    result = run(monkeypatch, sphere, ["hang"], seconds=3)
    assert time.monotonic() - began < 20
    assert (result.rows[0].status, result.reference, result.strands, result.agree) == ("hang", None, None, False)
    assert result.rows[0].message.startswith("no answer in 3 s (after ")


def test_what_counts_as_the_same_picture(sphere, monkeypatch):
    names = ["fine", "bits", "few", "many", "faint", "nan"]
    result = run(monkeypatch, sphere, names, in_this_process)
    assert {row.device: (row.status, row.message) for row in result.rows} == {
        "fine": ("ok", ""), "few": ("ok", ""), "faint": ("ok", ""), "bits": ("differs", "other bits in voxels"),
        "many": ("differs", "0.15% of the pixels are beyond 0.001"),
        "nan": ("differs", "0.15% of the pixels are beyond 0.001")}
    by_name = {row.device: row.difference for row in result.rows}
    assert by_name["bits"].same == {"visibility": True, "voxels": False}
    assert by_name["few"].largest == 0.5 and by_name["few"].share == 0.001 and by_name["few"].flip > 0
    assert by_name["nan"].largest == np.inf and result.as_dict()["rows"][5]["difference"]["largest"] is None


def test_times_that_cannot_be_true_are_not_told(sphere, monkeypatch):
    rows = run(monkeypatch, sphere, ["fine", "stopped", "wrong"], in_this_process).rows
    assert [row.status for row in rows] == ["ok"] * 3
    assert (rows[0].stages["raster"].min, rows[0].stages["raster"].max) == (0.125, 0.25)
    assert rows[1].stages is None and rows[2].stages is None


def test_the_reference_can_be_named(sphere, monkeypatch):
    monkeypatch.setattr(library, "choose", str.strip)
    monkeypatch.setattr(library, "describe", str)
    monkeypatch.setattr(library, "isolated", lambda *_, **__: isolated.Outcome("ok", measured()))
    monkeypatch.setattr(library, "handles", lambda: [("a", "a"), ("b", "b")])
    assert clfur.compare(scene(sphere), "a, b", reference="b").reference == "b"
    assert clfur.compare(scene(sphere), ["b", "a", "b"], reference="a").reference == "a"
    with pytest.raises(clfur.Error, match="reference is 'c'; allowed: one of the devices compared: a, b"):
        clfur.compare(scene(sphere), ["a", "b"], reference="c")


@pytest.mark.parametrize("arguments, words", [
    ({"devices": "auto,abacus"}, "no OpenCL device matches 'abacus'; allowed: auto, "),
    ({"devices": []}, "devices is empty"), ({"devices": 3}, "devices is 3"),
    ({"repeat": 0}, "repeat is 0"), ({"settings": 4}, "settings is 4"), ({"scene": "teapot"}, "scene is 'teapot'")])
def test_wrong_arguments_are_refused_before_anything_runs(sphere, monkeypatch, arguments, words):
    monkeypatch.setattr(library, "isolated", None)
    with pytest.raises(clfur.Error, match=words):
        clfur.compare(**{"scene": scene(sphere), **arguments})
