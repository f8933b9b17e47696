"""Arrays on the device are what they are declared to be, and the memory plan counts them all."""

import importlib
import re
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import layout
from clfur.pipeline import sizes
from clfur.pipeline.views import view_of
from clfur.stages import coverage, shade, shells, strand_light, strands, tessellate
from clfur.stages.lighting import unshadowed
from clfur.stages.lod import thin
from clfur.stages.raster import raster

ROOT = Path(__file__).resolve().parents[1]
STAGES = [importlib.import_module(f"clfur.stages.{path.stem}")
          for path in sorted((ROOT / "clfur/stages").glob("*.py")) if path.stem != "__init__"]
ROWS = {"point": 20, "strand": 5, "color": 5, "type": 2, "run": 1}


# --- what is declared -------------------------------------------------------------------------------------


@pytest.mark.parametrize("body", [
    "extra: Any", "extra: Any = None", "extra: Any = field(default=None)", "extra: int = layout.array('point', 'f4')"])
def test_an_array_that_is_not_declared_is_an_error_at_import(body):
    source = ("from dataclasses import dataclass, field\nfrom typing import Any\nfrom clfur import layout\n@dataclass\n"
              f"class Wrong(layout.Arrays):\n    points: Any = layout.array('point', 'f4', 4)\n    {body}\n")
    with pytest.raises(TypeError, match=r"Wrong\.extra is of .*; allowed: Any with layout\.array, or another type"):
        exec(source, {})
    exec(source.replace(body, "extra: int = 5"), {})


@pytest.mark.parametrize("name, shape, dtype, allowed", [
    ("points", (20, 4), np.float64, "float32 [20, 4]"), ("points", (20, 3), np.float32, "float32 [20, 4]"),
    ("points", 80, np.float32, "float32 [4]"), ("numbers", (5, 1), np.uint32, "uint32 [5]"),
    ("numbers", 19, np.uint32, "uint32 [5]"), ("spans", (0, 4), np.uint32, "uint32 [0, 2]"),
    ("types", 2, layout.Light, None)])
def test_an_array_unlike_its_declaration_is_refused(gpu, name, shape, dtype, allowed):
    grown = strands.DeviceStrands.empty(gpu, ROWS)
    with pytest.raises(TypeError, match=rf"DeviceStrands\.{name} is .*; allowed: ") as error:
        replace(grown, **{name: gpu.empty(shape, dtype)})
    assert allowed is None or allowed in str(error.value)
    with pytest.raises(TypeError, match=r"DeviceStrands\.first_point is an array on the device that is not declared"):
        replace(grown, first_point=gpu.empty(1, np.uint32))


def test_arrays_are_made_as_declared(gpu):
    made = coverage.Covered.empty(gpu, {"pixel": (3, 5), "sample": (3, 5, 4), "shell": (0, 5)},
                                  alpha=gpu.full((3, 5), np.float32, 7))
    shapes = {name: (getattr(made, name).shape, getattr(made, name).dtype) for name in coverage.Covered.declared}
    assert shapes == {
        "body_transmittance": ((3, 5, 4), np.float32), "alpha": ((3, 5), np.float32), "front": ((3, 5, 1), np.uint64),
        "shell_front": ((0, 5, 1), np.uint64)}
    tiles = coverage.Tiles.empty(gpu, {"tile": 6, "counter": 1, "strand": 5})
    assert (tiles.counts.get() == 0).all() and (made.alpha.get() == 7).all()
    assert bytes_of(made) == coverage.Covered.bytes(pixel=15, sample=60)
    assert coverage.Covered.bytes("body_transmittance", "front", pixel=15, sample=60) == 15 * 8 + 60 * 4


# --- the memory plan --------------------------------------------------------------------------------------


def bytes_of(*made):
    """What the arrays of some objects take on the device."""
    return sum(getattr(each, field.name).nbytes for each in made for field in fields(each)
               if hasattr(getattr(each, field.name), "base_data"))


def uncounted(modules, texts):
    """Names of what some modules declare whose bytes no text asks for."""
    declared = {name for module in modules for name, value in vars(module).items()
                if isinstance(value, layout.Declared)
                or (isinstance(value, type) and issubclass(value, layout.Arrays) and value is not layout.Arrays)}
    return {name for name in declared if not any(re.search(rf"\b{name}\.bytes\b", text) for text in texts)}


def test_all_that_is_declared_is_counted():
    """Lighting holds what SUMS and VISIBLE declare, Transport what FIELD does; State, SOFT, Leans and WINDS are of
    `Motion`, before a frame."""
    texts = [path.read_text() for path in (ROOT / "clfur").rglob("*.py")]
    assert uncounted(STAGES, texts) <= {"SUMS", "Transport", "State", "SOFT", "Leans", "WINDS"}
    planted = type("planted", (), {"Extra": dataclass(type("Extra", (layout.Arrays,), {
        "__annotations__": {"points": Any}, "points": layout.array("point", np.float32, 4)}))})
    assert uncounted([planted], texts) == {"Extra"}


def kept(gpu, mesh, curves=False):
    """(strands, how many points and strands they are, what the plan counts for them)."""
    kind = clfur.HairType(segments=9, segment_length=.01)
    if curves:
        points = np.random.default_rng(2).normal(size=(5000, 30, 3))
        fur = clfur.Curves(points, color=np.abs(points) % 1)
        made = strands.upload_curves(gpu, fur)
    else:
        fur = clfur.Strands(roots=20_000, types=[kind])
        made = strands.grow(gpu, tessellate.tessellate(gpu, mesh), fur)
    return made, sizes.POINT * len(made.points) + sizes.STRAND * len(made.spans) + sizes.PACKED * len(
        made.points) * curves


@pytest.fixture
def mesh():
    positions, faces = icosphere(2)
    return clfur.Mesh(positions, positions, np.abs(positions[faces][..., :2]), faces)


@pytest.fixture(autouse=True)
def copied(gpu, monkeypatch):
    """A device that has memory of its own: what others read in the host's memory is copied, as the plan has it."""
    monkeypatch.setattr(gpu, "lend", gpu.upload)


def most(gpu, make):
    """Bytes that arrays took at once, at most, while something was made and after that."""
    gpu.forget()
    gpu.start()
    before = gpu.peak
    made = make()
    return gpu.peak - before, made


def room(nbytes):
    """The pool rounds each array up by a sixteenth at most; and there are some small ones."""
    return nbytes * 17 / 16 + 50_000


def check_counts(gpu, mesh, curves):
    """All that is made of strands against the plan."""
    taken, (made, counted) = most(gpu, lambda: kept(gpu, mesh, curves))
    assert bytes_of(made) <= counted
    assert .5 * counted < taken < room(counted)
    scene = clfur.Scene(mesh, camera=clfur.Camera(eye=(0, 0, 300)))
    taken, thinned = most(gpu, lambda: thin(gpu, made, view_of(scene, 1), 1.0))
    more = sizes.THIN_POINT * len(made.points) + sizes.THIN_STRAND * len(made.spans) + (
        sizes.COLOR * len(made.points) * (made.color_per == 2))
    assert .9 * more < taken < room(more) and len(thinned.points) == len(made.points)


@pytest.mark.parametrize("curves", [False, True], ids=["grown", "curves"])
def test_the_plan_counts_all_of_strands(gpu, mesh, curves):
    check_counts(gpu, mesh, curves)


@pytest.mark.parametrize("curves", [False, True], ids=["grown", "curves"])
def test_an_array_more_than_the_plan_counts_is_seen(gpu, mesh, monkeypatch, curves):
    """Planted: a class with an array of rows that the plan has not heard of."""
    @dataclass(frozen=True, kw_only=True)
    class Longer(strands.DeviceStrands):
        knots: Any = layout.array("knot", np.float32, 4)

    def empty(gpu, rows, **given):
        return Longer(**vars(right(gpu, rows, **given)),
                      knots=Longer.declared["knots"].empty(gpu, rows["point"]))
    right = strands.DeviceStrands.empty
    monkeypatch.setattr(strands.DeviceStrands, "empty", empty)
    with pytest.raises(AssertionError):
        check_counts(gpu, mesh, curves)


def test_a_temporary_more_than_the_plan_counts_is_seen(gpu, mesh, monkeypatch):
    """Planted: an array that no class declares, while strands grow."""
    launch = gpu.launch

    def wasteful(name, size, /, **arguments):
        gpu.empty((size, 100), np.float32)
        launch(name, size, **arguments)
    monkeypatch.setattr(gpu, "launch", wasteful)
    with pytest.raises(AssertionError):
        check_counts(gpu, mesh, False)


def test_the_plan_counts_all_of_a_surface(gpu, mesh):
    taken, made = most(gpu, lambda: tessellate.tessellate(gpu, mesh, 20, 20))
    counted = sizes.VERTEX * len(made.positions) + sizes.TRIANGLE * len(made.triangles)
    mesh_bytes = sizes.MESH_VERTEX * len(mesh.positions) + sizes.MESH_FACE * len(mesh.faces)
    assert bytes_of(made) <= counted and .7 * counted < taken < room(counted + mesh_bytes)
    taken, _area = most(gpu, lambda: strands.grow(gpu, made, clfur.Strands(roots=1, types=clfur.HairType(segments=1))))
    assert taken < room(strands.AREA.bytes * len(made.triangles))


def test_the_plan_counts_all_of_segments(gpu, mesh):
    scene = clfur.Scene(mesh, clfur.Strands(roots=3000), clfur.Camera(size=(200, 152)))
    grown, view = strands.grow(gpu, tessellate.tessellate(gpu, mesh), scene.strands), view_of(scene, 4)

    def make():
        visible = raster(gpu, view)
        tiles = coverage.bound(gpu, view, visible)
        coverage.count(gpu, view, grown, tiles)
        segments = coverage.allocate(gpu, tiles.counts.get(), int(tiles.survivors.get()[0]))
        coverage.fill(gpu, view, grown, tiles, segments)
        lit = strand_light.radiance(gpu, view, unshadowed(gpu, np.zeros((), layout.Light)), grown, None, segments.ids)
        image = shade.IMAGE.empty(gpu, (152, 200))
        covered = coverage.nothing(gpu, visible)
        coverage.cover(gpu, view, visible, segments, covered, lit, image)
        return segments, lit, image, covered
    taken, (segments, lit, image, covered) = most(gpu, make)
    counted = 152 * 200 * (sizes.VISIBLE.bytes * 4 + coverage.Covered.bytes(pixel=1, sample=4) + sizes.IMAGE.bytes + 1)
    counted += sizes.ENTRY * len(segments.entries) + sizes.SURVIVOR * len(segments.ids)
    # Lists of what has no slot are no part of the plan: they take what is free, a 64th of the memory at most.
    lists = coverage._overflows(gpu, segments.longest, 25 * 19, "coverage")["overflows"].nbytes
    assert lists <= gpu.memory // 64
    lights = bytes_of(lit) + lists
    assert bytes_of(lit) <= sizes.LIT * len(segments.ids)
    assert bytes_of(segments, covered) + image.nbytes < counted
    assert .8 * (counted + lights) < taken < room(counted + lights)


@pytest.mark.parametrize("options", [{}, {"pattern": "sine"}, {"wind": (.5, 0, 0)}], ids=str)
def test_the_plan_counts_all_of_shells(gpu, mesh, options):
    topology = shells.topology_of(mesh.faces)
    packed = shells.pack(clfur.Shells(**options), mesh, True, True)

    def make():
        pattern = shells.lay(gpu, mesh, packed, topology)
        return shells.bend(gpu, mesh, packed, pattern, topology)
    taken, shell = most(gpu, make)
    counted = shells.size_of(mesh, packed, topology)
    making = shells.POSITIONS.bytes * len(mesh.positions) + shells.REST.bytes * 3 * len(mesh.faces)
    assert bytes_of(shell, shell.pattern) + making == counted
    assert .8 * counted < taken < room(counted)
