"""distance against its twin, and against what must hold for hair that slides along a body."""

import attrs
import numpy as np
import pytest
from support.plans import recorded
from support.scenes import icosphere

import clfur
from clfur import layout
from clfur.judge.geometry import geometry_of
from clfur.pipeline.sliding import sliding_of
from clfur.stages import distance
from clfur.stages.strands import grow
from clfur.stages.tessellate import tessellate
from clfur.twin import distance as twin

TURNED = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]   # so that nodes lie on no border of regions
TURNED *= np.sign(np.linalg.det(TURNED))


def cube(half=(1, 1, 1)):
    positions = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * half
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
             (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    return positions, np.array(faces)


def woven(x, y, z, around=True):
    """(positions, faces) of a net of points [n, m], closed along m, and along n if ``around``."""
    n, m = x.shape
    i, j = (each.ravel() for each in np.meshgrid(np.arange(n if around else n - 1), np.arange(m), indexing="ij"))
    at = [(a % n) * m + b % m for a, b in ((i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j))]
    faces = [np.stack([at[k] for k in t], 1) for t in ((0, 1, 2), (0, 2, 3))]
    return np.stack([x, y, z], -1).reshape(-1, 3), np.concatenate(faces)


def torus(n=24, m=12, inner=.35):
    a, b = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    ring = 1 + inner * np.cos(b)
    return woven(ring * np.cos(a), inner * np.sin(b), ring * np.sin(a))


def bag(n=6, m=24):
    """The lower half of a sphere, but for its pole, open above."""
    a, b = np.meshgrid(np.linspace(-1.4, 0, n), np.arange(m) * 2 * np.pi / m, indexing="ij")
    return woven(np.cos(a) * np.cos(b), np.sin(a), np.cos(a) * np.sin(b), around=False)


SHAPES = {
    "sphere": icosphere(2), "cube": cube(), "torus": torus(), "bag": bag(),
    "spike": (np.array([(0, 2, 0), (.1, 0, -.1), (.1, 0, .1), (-.2, 0, 0)], float),
              np.array([(0, 2, 1), (0, 3, 2), (0, 1, 3), (1, 2, 3)])),
    "pit": (np.array([(1, 0, 1), (1, 0, -1), (-1, 0, -1), (-1, 0, 1), (0, -1, 0)], float),
            np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])),
    "sheet": (np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], float), np.array([(0, 2, 1), (0, 3, 2)])),
}


def body_of(gpu, positions, faces, level=1, surface="flat"):
    """(Mesh, Surface, twin's Body) of a shape."""
    mesh = clfur.Mesh(positions, faces=faces)
    there = tessellate(gpu, mesh, level, level, surface)
    return mesh, there, twin_of(there)


def twin_of(surface):
    """The twin's Body of a Surface."""
    triangles = surface.triangles.get()[:, :3]
    return twin.Body(*(array.get()[:, :3][triangles] for array in (surface.positions, surface.normals)))


def known_of(found):
    """Distances of nodes, where they are, and which of them are known."""
    values = found.values.get()
    return values, twin.nodes(found.grid), np.abs(values) < .9999 * found.grid["reach"][0]


def distance_of(gpu, surface, runs=None):
    positions = surface.positions.get()[:, :3]
    return distance.distance(gpu, distance.grid_of(positions.min(0), positions.max(0)), lambda: runs or [surface])


# --- how far the body is -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape, nodes", [
    pytest.param("spike", 13, marks=pytest.mark.small), *((shape, 20) for shape in SHAPES)])
def test_nodes_know_the_nearest_feature(gpu, shape, nodes, monkeypatch):
    """Against brute force: how far, to what rounding of coordinates below 2^5 to 2^-24 of themselves makes of it, on
    which side, and that all nodes of the band know."""
    monkeypatch.setattr(distance, "NODES", nodes)
    positions, faces = SHAPES[shape]
    _, surface, body = body_of(gpu, positions @ TURNED, faces)
    found = distance_of(gpu, surface)
    values, places, known = known_of(found)
    true, _ = body.nearest(places)
    cell = float(found.grid["reach"][1])
    assert known.sum() > 250
    assert np.abs(np.abs(true) - np.abs(values))[known].max() < 2e-5 * cell
    assert not (known ^ (np.abs(true) < found.grid["reach"][0]))[np.abs(np.abs(true) / cell - 3) > 1e-3].any()
    wrong = (np.sign(true) != np.sign(values))[known & (np.abs(true) > 1e-4 * cell)]
    # At a border two features that are as near may tell of two sides, and then rounding decides.
    assert wrong.sum() <= (2 if shape in ("pit", "bag", "sheet") else 0)
    assert (values[~known] == found.grid["reach"][0]).all()


def test_a_distance_does_not_depend_on_order_or_parts(gpu, monkeypatch):
    monkeypatch.setattr(distance, "NODES", 24)
    positions, faces = SHAPES["torus"]
    mesh, surface, _ = body_of(gpu, positions, faces)
    whole = distance_of(gpu, surface).values.get()
    parts = [tessellate(gpu, mesh, 1, 1, "flat", run) for run in ((300, len(faces)), (0, 1), (1, 300))]
    assert np.array_equal(distance_of(gpu, surface, parts).values.get(), whole)
    order = np.random.default_rng(0).permutation(len(faces))
    other = clfur.Mesh(positions, faces=np.roll(faces[order], 1, 1))
    moved = distance_of(gpu, surface, [tessellate(gpu, other, 1, 1, "flat")]).values.get()
    # Corners in another order are rounded otherwise.
    assert np.abs(moved - whole).max() < 1e-5 * distance_of(gpu, surface).grid["reach"][1]


@pytest.mark.parametrize("shape, nodes, closed", [
    pytest.param("cube", 14, True, marks=pytest.mark.small), ("sphere", 28, True), ("torus", 33, True),
    ("sheet", 40, False), ("bag", 40, False)])
def test_far_nodes_know_their_side_and_about_how_far(gpu, shape, nodes, closed, monkeypatch):
    """As the twin has it: half of the distance or more, and not more than it, but for a part of a cell; an open body is
    no deeper than the band; what is between two poses is between them."""
    monkeypatch.setattr(distance, "NODES", nodes)
    mesh, surface, body = body_of(gpu, *SHAPES[shape])
    grid = distance.grid_of(mesh.positions.min(0), mesh.positions.max(0))
    found = distance.distance(gpu, grid, lambda: [surface])
    deep = distance.deepened(gpu, found)
    near, values = gpu.download(found.values), gpu.download(deep.values)
    np.testing.assert_allclose(values, twin.deepened(grid, near), rtol=0, atol=1e-5)
    far = near >= grid["reach"][0]
    assert (values[~far] == near[~far]).all() and far.any()
    true = np.abs(body.nearest(twin.nodes(grid)[far])[0])
    assert (np.abs(values[far]) <= true + grid["reach"][1] / 2).all()
    assert (np.abs(values[far]) >= true / 2).all()
    if closed:
        assert ((values < 0) == (body.nearest(twin.nodes(grid))[0] < 0))[far].all()
    else:
        assert (values[far] > 0).all()
    between = gpu.download(distance.between(gpu, found, deep, 0.25).values)
    np.testing.assert_allclose(between, 0.75 * near + 0.25 * values, rtol=0, atol=1e-6)


def test_an_open_sheet_has_an_inside_as_deep_as_the_band(gpu):
    """And its surface goes on so far beyond its border; beyond that all is outside."""
    _, surface, _ = body_of(gpu, *SHAPES["sheet"])
    found = distance_of(gpu, surface)
    values, places, known = known_of(found)
    x, y, z = places.T
    cell, band = float(found.grid["reach"][1]), float(found.grid["reach"][0])
    over = (np.abs(x) < 1 - cell) & (np.abs(z) < 1 - cell)
    assert np.allclose(values[over & known], y[over & known], atol=1e-5 * cell)
    assert (values[y < -1.001 * band] == found.grid["reach"][0]).all()
    beyond = (np.abs(x) > 1 + cell) & known & (np.abs(y) > .5 * cell)
    assert (values[beyond & (y < 0)] < 0).sum() > 100 and ((values < 0) == (y < 0))[beyond].all()


# --- strands -------------------------------------------------------------------------------------------------------


def fur_of(length=1.6, segments=8, n=800, width=.004, **keys):
    force = keys.pop("force", (0, -1, 0))
    hair = clfur.HairType(segments=segments, segment_length=length / segments, width=width, **keys)
    return clfur.Strands(types=[hair], roots=n, force=force, inner=3, outer=3, seed=3)


def slid(gpu, mesh, fur):
    """(points [n, S, 4] as they grew, as they slid, twin's Body, `Distance`)."""
    surface = tessellate(gpu, mesh, fur.inner, fur.outer, fur.surface)
    grown = grow(gpu, surface, fur)
    before = grown.points.get()
    body = twin_of(surface)
    plan = sliding_of(mesh, fur)
    found = distance.distance(gpu, plan.grid, lambda: [tessellate(gpu, mesh, *plan.levels)])
    distance.slide(gpu, found, grown)
    shape = len(grown.spans), -1, 4
    return before.reshape(shape), grown.points.get().reshape(shape), body, found


def inside(body, points, by):
    """Share of each strand's points that are inside by more than so much; roots stand on the skin."""
    depth = -body.nearest(points[:, 1:, :3].reshape(-1, 3))[0].reshape(len(points), -1)
    return (depth > by).mean(1)


def lengths(points):
    return np.linalg.norm(np.diff(points[..., :3].astype(float), axis=1), axis=2)


def mesh_of(shape, hollow=False):
    """A mesh of a shape, or one of its faces from within."""
    positions, faces = SHAPES[shape]
    return clfur.Mesh(positions, normals=-positions if hollow else None, faces=faces)


def test_soft_long_hair_stays_out_of_a_sphere(gpu):
    """The law of the issue: no strand has more than 2 % of its points inside by more than its width; of those that grew
    a tenth of the upper ones have a tenth of theirs there."""
    before, after, body, _ = slid(gpu, mesh_of("sphere"), fur_of(width=.002))
    upper = before[:, 0, 1] > 0
    assert (inside(body, before, .002)[upper] > .1).mean() > .1
    assert inside(body, after, .002).max() <= .02
    assert np.abs(lengths(after) / lengths(before) - 1).max() < 1e-5


@pytest.mark.parametrize("shape, keys", [
    ("torus", {}), ("cube", {}), ("sphere", {"curl": (.03, 3), "direction_variation": .5}),
    ("sphere", {"length": .16}), ("sphere", {"segments": 24, "force_weight": .3})])
def test_other_bodies_and_hair(gpu, shape, keys):
    """At edges, which the grid rounds by up to a third of a cell (the mean of a corner's eight nodes), too."""
    before, after, body, found = slid(gpu, mesh_of(shape), fur_of(n=600, **keys))
    by = .004 + found.grid["reach"][1] / 3 * (shape == "cube")
    assert (inside(body, before, .004) > .02).any()
    assert (inside(body, after, by) <= .02).all()
    assert np.abs(lengths(after) / lengths(before) - 1).max() < 1e-5
    near = (body.nearest(before[:, 1:, :3].reshape(-1, 3))[0].reshape(before.shape[0], -1) < .01).any(1)
    assert (~near).sum() > 20 and np.array_equal(before[~near], after[~near])


def test_hair_does_not_go_through_an_ear(gpu):
    """Two sides as near to each other as two cells: what is blown from one does not come out of the other."""
    positions, faces = cube((1, 1, .025))
    fur = attrs.evolve(fur_of(.6, force=(.1, 0, -1.5)), surface="flat")
    before, after, body, found = slid(gpu, clfur.Mesh(positions, faces=faces), fur)
    assert 2 < .05 / found.grid["reach"][1] < 2.5
    front = (before[:, 0, 2] > .0249) & (np.abs(before[:, 0, :2]).max(1) < .3)
    assert front.sum() > 20 and (before[front][..., 2] < -.03).any(1).all() and (after[front][..., 2] > .02).all()
    assert inside(body, after, .004)[front].max() <= .02


@pytest.mark.parametrize("shape, hollow", [("sphere", False), ("sphere", True), ("torus", False), ("cube", False)])
def test_straight_hair_keeps_its_bits(gpu, shape, hollow):
    """On skin of either curve and at corners: roots stand on it, and what is near them is not pushed off."""
    before, after, _, _ = slid(gpu, mesh_of(shape, hollow), fur_of(.1, force_weight=0, width=.002))
    assert np.array_equal(before, after)


def few():
    """Twenty strands, of which some are turned, as many for what Oclgrind has time for."""
    fur = fur_of(1.0, n=20, segments=5, width=.01, direction_variation=.5, force=(.4, -2, .7))
    return attrs.evolve(fur, inner=1, outer=1, surface="flat")


@pytest.mark.parametrize("shape, nodes, n", [pytest.param("cube", 13, 20, marks=pytest.mark.small), ("torus", 40, 500)])
def test_strands_slide_as_the_twin_says(gpu, shape, nodes, n, monkeypatch):
    """With the same nodes.  Where a distance is next to a limit, float32 may ask once more or once less: that moves a
    point by the limit's 1/128 of a cell, and what follows by as much in each segment."""
    monkeypatch.setattr(distance, "NODES", nodes)
    monkeypatch.setattr(distance, "stretches_of", lambda *_: [(0, 2), (2, 2**32 - 1)])
    before, after, _, found = slid(gpu, mesh_of(shape), attrs.evolve(few(), roots=n))
    values, counts = found.values.get(), np.full(len(before), before.shape[1])
    told, moved = twin.slide(before[..., :3], before[..., 3], counts,
                             lambda places: twin.near(found.grid, values, places), float(found.grid["reach"][1]))
    off = np.linalg.norm(told - after[..., :3], axis=2).max(1) / found.grid["reach"][1]
    assert n / 20 < moved.sum() < n and np.array_equal(moved, (before != after).any((1, 2)))
    assert (off < 1e-3).mean() > .9 and off.max() < 8 / 128


def test_lanes_and_stretches_leave_the_same_bits(gpu, another, monkeypatch):
    monkeypatch.setattr(distance, "NODES", 13)
    mesh, fur = mesh_of("cube"), few()
    before, after, _, found = slid(gpu, mesh, fur)
    assert (before != after).any()
    _, alone, _, again = slid(another(lanes=1), mesh, fur)
    assert np.array_equal(after, alone) and np.array_equal(found.values.get(), again.values.get())
    monkeypatch.setattr(distance, "stretches_of", lambda *_: [(0, 2), (2, 3), (3, 2**32 - 1)])
    assert np.array_equal(slid(gpu, mesh, fur)[1], after)


# --- frames --------------------------------------------------------------------------------------------------------


def scene_of(mesh=None, **keys):
    fur = attrs.evolve(fur_of(.8, n=900, curl=(.01, 2), length_variation=.2), **keys)
    return clfur.Scene(mesh=mesh_of("sphere") if mesh is None else mesh, fur=fur,
                       camera=clfur.Camera(eye=(0, 1, 5), size=(64, 48)))


def test_a_camera_frames_it_as_it_does_other_hair(gpu):
    """It fills .76 of the height; with room for curls that the body pulls straight it would fill half."""
    curly = fur_of(.3, n=900, curl=(.05, 4))
    slides = attrs.evolve(curly, collision=True)
    camera = clfur.Scene(mesh=mesh_of("sphere"), fur=slides).camera
    np.testing.assert_array_equal(camera.pose, clfur.Scene(mesh=mesh_of("sphere"), fur=curly).camera.pose)
    alpha = clfur.render(clfur.Scene(mesh=mesh_of("sphere"), fur=slides), gpu)[..., 3]
    assert not alpha[[0, -1]].any() and not alpha[:, [0, -1]].any() and (alpha > 0).any(1).mean() > .7


def test_it_is_off_unless_asked_for(gpu):
    names = recorded(gpu)
    clfur.draw(scene_of(), gpu)
    assert "distance.slide" not in names and not clfur.Strands().collision
    with pytest.raises(clfur.Error, match="Strands.collision is 1; allowed: True or False"):
        clfur.Strands(collision=1)


def test_it_is_made_once_for_a_mesh(gpu):
    scene = scene_of(collision=True)
    names = recorded(gpu)
    clfur.draw(scene, gpu)
    assert {"distance.offer", "distance.weigh", "distance.finish", "distance.slide"} <= set(names)
    names.clear()
    clfur.draw(attrs.evolve(scene, camera=clfur.Camera(eye=(1, 1, 5), size=(64, 48))), gpu)
    assert not [name for name in names if name.startswith("distance.")]
    clfur.draw(attrs.evolve(scene, fur=attrs.evolve(scene.fur, force=(1, 0, 0))), gpu)
    assert [name for name in names if name.startswith("distance.")] == ["distance.slide"]


def test_parts_and_teams_draw_the_same(gpu, another, monkeypatch):
    """Strands in parts, the body's distance from runs of faces, two devices: the same bits."""
    monkeypatch.setattr(distance, "NODES", 32)
    scene = scene_of(collision=True)
    settings = clfur.Settings(grid=16, shadow_map=32)
    whole = clfur.draw(scene, gpu, settings, hashes=True)
    small = another(memory=whole.memory * 7 // 8)
    parts = clfur.draw(scene, small, settings, hashes=True)
    assert parts.hashes == whole.hashes and parts.memory <= small.memory
    monkeypatch.setattr("clfur.pipeline.sliding.SURFACE", 1 << 12)
    sliding_of.forget()
    again = clfur.draw(scene, [another(), another(memory=small.memory)], settings, hashes=True)
    assert len(sliding_of(scene.mesh, scene.fur).runs) > 3 and again.hashes == whole.hashes
    sliding_of.forget()


def test_strands_read_back_have_slid(gpu):
    scene = scene_of(collision=True)
    there = clfur.grow(scene, gpu).points.reshape(-1, 9, 3)
    assert (np.linalg.norm(there, axis=2) > .98).all()
    assert (np.linalg.norm(clfur.grow(scene_of(), gpu).points.reshape(-1, 9, 3), axis=2) < .95).any()


def test_the_truth_has_strands_that_slide(gpu):
    """By exact distances: the segments of those between nodes differ by a tenth of a cell, and tips by what eight of
    them add up to."""
    scene = scene_of(collision=True, roots=150)
    there = clfur.grow(scene, gpu).points
    hair, _ = geometry_of(scene)
    grown = clfur.grow(scene_of(roots=150), gpu).points
    off, moved = np.linalg.norm(there - hair.points[:, :3], axis=1) * 87 / 2, (there != grown).any(1)
    assert (np.linalg.norm(there - grown, axis=1) > .05).sum() > 20
    assert off[~moved].max() < 1e-4 and off[moved].mean() < .1 and off.max() < .8


def test_a_grid_has_room_for_all_of_a_body():
    """With the band and a cell around it; its longest side takes all nodes, and flat bodies take few."""
    for size in ((1, 1, 1), (5, .1, 2), (0, 3, 0), (1e-9, 1e-9, 1e-9), (1e9, 1, 1)):
        grid = distance.grid_of((3, -2, 1), np.add((3, -2, 1), size))
        cell, nodes = float(grid["reach"][1]), grid["size"][:3].astype(int)
        room = (nodes - 1) * cell - np.array(size)
        assert (room >= 7.99 * cell).all() and (room <= 9.01 * cell).all()
        assert abs(nodes.max() - distance.NODES) <= 1 and distance.nodes_of(grid) == nodes.prod()
    assert layout.CONSTANTS["DISTANCE_BAND"] == 3
