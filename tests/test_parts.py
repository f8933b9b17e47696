"""Scenes that do not fit the device at once: drawn part by part and band by band, they are the same bits."""

import gc
import itertools
import json
import os
import subprocess
import sys

import attrs
import numpy as np
import pytest
from support.pictures import same
from support.plans import plan_of
from support.scenes import scene_of

import clfur
from clfur.pipeline import build
from clfur.pipeline.views import band_of
from clfur.render import OUTPUTS
from clfur.stages.raster import raster

SETTINGS = clfur.Settings(raster="samples", samples=4, grid=32, shadow_map=64)


WAYS = {"64-bit": (True, {}), "32-bit": (False, {}), "lod": (True, {"lod": 1}),
        "lod-count": (False, {"lod": .5, "shadows": "count"})}


@pytest.mark.parametrize("kind, way", [
    *((kind, "64-bit") for kind in ("faces", 9001, "curves", "striped")), ("faces", "32-bit"), ("striped", "32-bit"),
    ("faces", "lod-count"), (9001, "lod"), ("curves", "lod"), ("striped", "lod-count")])
def test_parts_and_bands_are_the_same_bits(gpu, another, sphere, kind, way):
    """How strands are divided into parts does not hang on atomics; each kind is thinned in one way or another."""
    wide, keys = WAYS[way]
    scene, settings = scene_of(kind, sphere), attrs.evolve(SETTINGS, **keys)
    whole = clfur.draw(scene, gpu, settings, tuple(OUTPUTS), hashes=True)
    assert np.isfinite(whole.images["depth"]).mean() > .2 and whole.images["color"].std() > .05
    small = another() if wide else another(int64_atomics=False)
    for small.memory in (1_400_000, 1_000_000):
        small.forget()
        plan = plan_of(scene, settings)
        parts = plan.parts(small)
        assert len(parts) > 1 and plan.rows(small) < 83
        if kind not in ("curves", "striped") and small.memory == 1_000_000:
            assert len({part.faces for part in parts}) > 1
        frame = clfur.draw(scene, small, settings, tuple(OUTPUTS), hashes=True)
        same(whole, frame)
        assert 0 < frame.memory <= small.memory


@pytest.mark.parametrize("kind", ["faces", 5000])
def test_parts_without_a_body(gpu, another, sphere, kind):
    scene = scene_of(kind, sphere, body=None)
    small = another(1_000_000)
    np.testing.assert_array_equal(clfur.render(scene, small, SETTINGS), clfur.render(scene, gpu, SETTINGS))


@pytest.mark.parametrize("kind, strands", [("faces", None), (7001, 7001), ("curves", 2500)])
def test_every_strand_and_face_is_in_one_part(another, sphere, kind, strands):
    small = another(1_000_000)
    plan = plan_of(scene_of(kind, sphere), SETTINGS)
    parts = plan.parts(small)
    runs = sorted(part.strands for part in parts if part.strands[1] > part.strands[0])
    assert runs[0][0] == 0 and runs[-1][1] == plan.strands == (strands or plan.triangles)
    assert all(one[1] == other[0] for one, other in itertools.pairwise(runs))
    faces = sorted(part.faces for part in parts if part.body)
    assert faces[0][0] == 0 and faces[-1][1] == len(sphere.faces)
    assert all(one[1] == other[0] for one, other in itertools.pairwise(faces))


@pytest.mark.parametrize("memory", [0, -1, 1.5, True, "1"])
def test_memory_is_checked(memory):
    with pytest.raises(clfur.Error, match="Scheduler.memory is .* allowed: None or a number of bytes"):
        clfur.Scheduler(memory=memory)


@pytest.mark.parametrize("fur", [
    clfur.Strands(inner=64, outer=64), clfur.Curves(np.linspace((0, 0, 0), (1, 1, 0), 9000)[None], width=.01)],
    ids=["a-face-of-10,000-triangles", "a-strand-of-9,000-points"])
@pytest.mark.parametrize("raster", ["samples", "coverage"])
def test_what_cannot_be_divided_stays_below_the_budget(gpu, monkeypatch, fur, raster):
    mesh = clfur.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], None, None, [[0, 1, 2]])
    scene = clfur.Scene(mesh, fur, camera=clfur.Camera(size=(64, 48)))
    settings = clfur.Settings(raster=raster, samples=1, grid=16, shadow_map=16)
    tried = range(300_000, 16_300_001, 200_000 if raster == "samples" else 4_000_000)   # small bands take time
    gpu.forget()
    gc.collect()
    others, drawn = gpu._pool.active_bytes, 0   # of other tests
    for memory in tried:
        monkeypatch.setattr(gpu, "memory", memory)   # not a new scheduler each: it would build all kernels
        gpu.forget()
        try:
            frame = clfur.draw(scene, gpu, settings)
        except clfur.Error as error:
            assert not drawn and "MiB has no room for" in str(error)
        else:
            drawn += 1
            assert frame.memory - others <= memory
    assert 0 < drawn < len(tried)


LIMITED = """
import hashlib, json, clfur
hair = clfur.HairType(segments=100, segment_length=.002, width=.003, direction_variation=.3)
scene = clfur.Scene(clfur.load_mesh("sphere"), clfur.Strands(types=[hair], roots=170_000),
                    camera=clfur.Camera(size=(320, 240)))
gpu = clfur.Scheduler("pocl")
frame = clfur.draw(scene, gpu, clfur.Settings(raster="samples", samples=1), hashes=True)
color = hashlib.sha256(frame.images["color"].tobytes()).hexdigest()
print(json.dumps([frame.hashes, color, frame.memory, gpu.largest, gpu.memory]))
"""


def test_strands_in_arrays_larger_than_a_device_takes():
    """PoCL with 1 GB, 256 MB a piece: 170,000 strands of 100 segments have 17 million points, 275 MB in one array."""
    results = [json.loads(subprocess.run([sys.executable, "-c", LIMITED], env=os.environ | limit, check=True,
                                         capture_output=True, text=True).stdout.splitlines()[-1])
               for limit in ({}, {"POCL_MEMORY_LIMIT": "1"})]
    (hashes, color, whole, _, _), (again, color_again, parts, largest, memory) = results
    assert (hashes, color) == (again, color_again)
    assert largest <= 2**28 < 170_000 * 101 * 16 and parts <= memory and parts < whole


@pytest.mark.parametrize("rows", [1, 7])
def test_a_band_is_what_the_whole_is_there(gpu, sphere, rows):
    plan = plan_of(scene_of("faces", sphere), SETTINGS)
    part, = plan.parts(gpu)
    drawn, view = (build.hair(gpu, plan, part, 0), build.body(gpu, plan, part)), plan.rig.view
    whole = raster(gpu, view, *drawn).get()
    for top in range(0, 83, 23):
        band = raster(gpu, band_of(view, top, min(top + rows, 83)), *drawn).get()
        np.testing.assert_array_equal(band, whole[top:top + rows])
