"""Shell fur: the twin's values on every device, and the laws of the pattern and of the space that it stands in."""

import numpy as np
import pytest
from support.furred import BENT, FUR, MESHES, SINE, noise_shape

import clfur
from clfur.stages import shells as stage
from clfur.twin import march as rays
from clfur.twin import shells as twin

# --- the twin's values ----------------------------------------------------------------------------------


def check_preparation(gpu, mesh, options):
    mesh, fur = clfur.Mesh(*MESHES[mesh]), clfur.Shells(**options, seed=7)
    packed = stage.pack(fur, mesh, False, True)
    topology = stage.topology_of(mesh.faces)
    pattern = stage.lay(gpu, mesh, packed, topology)
    shell = stage.bend(gpu, mesh, packed, pattern, topology)
    uv = np.take_along_axis(mesh.uv, topology.order[..., None], 1)
    slabs = int(packed["kind"][2])
    curves = shell.curves.get().reshape(-1, slabs + 1, 4)
    np.testing.assert_allclose(curves[..., :3], twin.bend(packed, mesh.positions, mesh.normals), atol=2e-6)
    assert not curves[..., 3].any()
    lattice = pattern.lattice.get().reshape(-1, 8, 4)
    expected = twin.lattice(packed, mesh.positions, mesh.normals, topology.corners, uv,
                            stage.resting(fur.rest or mesh, topology).reshape(-1, 3, 4))
    np.testing.assert_array_equal(lattice[:, 1, 2], expected[:, 1, 2])
    np.testing.assert_allclose(lattice, expected, rtol=2e-5, atol=2e-5 * np.abs(expected).max())
    np.testing.assert_allclose(pattern.noise.get().reshape(*noise_shape(packed), 2), twin.noise(packed), atol=1e-6)


@pytest.mark.parametrize("options", [FUR, FUR | BENT, SINE | BENT], ids=["straight", "bent", "sine"])
@pytest.mark.parametrize("mesh", MESHES)
def test_preparation_equals_the_twin(gpu, mesh, options):
    check_preparation(gpu, mesh, options)


@pytest.mark.small
@pytest.mark.parametrize("pattern", ["cells", "sine"])
def test_a_small_preparation_equals_the_twin(gpu, monkeypatch, pattern):
    monkeypatch.setattr(stage, "AROUND", 4)
    gpu = clfur.Scheduler(gpu.device)
    gpu.lanes = 1   # Oclgrind 21.10 takes parts of a vector for unset that are not
    check_preparation(gpu, "quad", BENT | {"pattern": pattern, "frequency": 1.0})


@pytest.mark.parametrize("options", [
    {}, {"density": 0.4}, {"sharpness": 3.0}, {"length_variation": 1.0}, {"pattern": "sine"},
    {"pattern": "sine", "density": 0.4}], ids=str)
def test_means_equal_the_twin(gpu, options):
    packed = stage.pack(clfur.Shells(**options), clfur.Mesh(*MESHES["ball"]), False, True)
    means = gpu.empty((stage.HEIGHTS, 2), np.float32)
    gpu.launch("shells.means", stage.HEIGHTS, shells=packed, around=stage.AROUND, out=means)
    # At the roots a hair's edge is 1e-3 high, and places 1000 cells from the first are rounded to 6e-5.
    np.testing.assert_allclose(means.get()[1:], twin.means(packed, stage.AROUND)[1:], atol=2e-3)
    np.testing.assert_allclose(means.get()[0], twin.means(packed, stage.AROUND)[0], atol=3e-2)


# --- the space that the fur stands in --------------------------------------------------------------------

CUBE = np.array([(0, 3, 1), (0, 2, 3), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 7, 3), (2, 6, 7), (0, 6, 2),
                 (0, 4, 6), (1, 3, 7), (1, 7, 5)])
MOBIUS = np.array([(i, (i + 1) % 5, (i + 2) % 5) for i in range(5)])


def sides_of(topology):
    """(corner, corner) of each side of each face, [F, 3, 2]."""
    return topology.corners[:, [[1, 2], [0, 2], [0, 1]]]


@pytest.mark.parametrize("faces, open_sides", [
    (CUBE, 0),
    (MOBIUS, 5),                                              # a strip of five triangles with one border
    (np.array([(0, 1, 2), (1, 0, 3), (0, 1, 4)]), 9),         # three faces at one edge: none has a neighbour there
    (np.array([(5, 3, 4)]), 3),
    (np.array([(0, 1, 2), (0, 1, 3)]), 4),                    # wound against each other: neighbours all the same
    (np.array([(0, 1, 2), (2, 1, 0)]), 0),                    # back to back
], ids=["cube", "moebius", "three", "one", "against", "back"])
def test_topology(faces, open_sides):
    topology = stage.topology_of(faces)
    assert (np.diff(topology.corners.astype(int), axis=1) > 0).all()
    np.testing.assert_array_equal(np.take_along_axis(faces, topology.order, 1), topology.corners)
    across = topology.neighbours[:, :3]
    assert (across < 0).sum() == open_sides and (topology.neighbours[:, 3] == 0).all() and across.min() >= -1
    sides = sides_of(topology)
    for face, side in zip(*np.nonzero(across >= 0)):
        other, its = divmod(int(across[face, side]), 4)
        assert other != face and across[other, its] == 4 * face + side
        np.testing.assert_array_equal(sides[face, side], sides[other, its])


@pytest.mark.parametrize("slabs", [1, 3])
@pytest.mark.parametrize("faces", [CUBE, MOBIUS, np.array([(5, 3, 4)])], ids=["cube", "moebius", "one"])
@pytest.mark.parametrize("bare", [False, True])
def test_the_border_closes_the_fur(faces, slabs, bare):
    """Each triangle of the border is the side of the tetrahedron it names, wound to be seen from outside."""
    topology = stage.topology_of(faces)
    triangles, border = stage.border_of(faces, topology, slabs, bare)
    open_ = (topology.neighbours[:, :3] < 0).sum()
    assert len(triangles) == len(border) == len(faces) * (1 + bare) + 2 * slabs * open_
    for triangle, (face, start, *_) in zip(triangles[:, :3].astype(int), border.astype(int)):
        slab, tetrahedron, missing = start // 12, start // 4 % 3, start % 4
        corners = np.delete(rays.TETRAHEDRA[tetrahedron], missing)
        named = topology.corners[face, corners % 3].astype(int) * (slabs + 1) + slab + corners // 3
        assert sorted(named) == sorted(triangle)
    # All of a closed border's edges are run through both ways (with the skin, which only `bare` brings).
    if bare and faces is not MOBIUS:
        t = triangles[:, :3].astype(int)
        edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
        keys = edges[:, 0] * 10**6 + edges[:, 1]
        assert np.unique(keys).size == len(keys)
        np.testing.assert_array_equal(np.sort(keys), np.sort(edges[:, 1] * 10**6 + edges[:, 0]))


def test_the_fur_is_filled_without_gaps():
    """Straight fur of a closed mesh is as large as the space between the skin and the tips."""
    positions, normals, _, faces = MESHES["ball"]
    topology = stage.topology_of(faces)
    curves = np.stack([positions, positions + 0.125 * normals, positions + 0.25 * normals], 1)
    matrices, _ = rays._tetrahedra(topology.corners, curves, 2)
    inner, outer = (abs(np.linalg.det(shape[faces]).sum() / 6) for shape in (positions, positions + 0.25 * normals))
    assert abs(1 / np.linalg.det(matrices) / 6).sum() == pytest.approx(outer - inner, rel=1e-9)


# --- bending ---------------------------------------------------------------------------------------------


def curves_of(gpu, **options):
    mesh = clfur.Mesh(*MESHES["ball"])
    packed = stage.pack(clfur.Shells(**options), mesh, False, True)
    curves = gpu.empty((len(mesh.positions) * (int(packed["kind"][2]) + 1), 4), np.float32)
    lean = np.asarray(options.get("lean", mesh.normals), np.float32)
    gpu.launch("shells.bend", len(mesh.positions), shells=packed, positions=gpu.upload(stage.as_float4(mesh.positions)),
               normals=gpu.upload(stage.as_float4(mesh.normals)), leaning=int("lean" in options), lean=gpu.upload(lean),
               curves=curves)
    return curves.get().reshape(len(mesh.positions), -1, 4)[..., :3].astype(float)


@pytest.mark.parametrize("options", [
    {}, {"wind": (3, 0, 0)}, {"force": (0, -20, 0)}, {"wind": (1, 1, 0), "acceleration": (0, 0, 9), "time": 0.4},
], ids=str)
def test_layers_keep_their_distance(gpu, options):
    """However hairs are bent, they stay as long as they are, and so do all their steps."""
    curves = curves_of(gpu, length=0.3, **options)
    steps = np.linalg.norm(np.diff(curves, axis=1), axis=2)
    np.testing.assert_allclose(steps, 0.3 / (curves.shape[1] - 1), atol=1e-6)
    np.testing.assert_allclose(curves[:, 0], clfur.Mesh(*MESHES["ball"]).positions, atol=1e-7)


@pytest.mark.small
def test_each_vertex_leans_by_itself(gpu):
    """On top of the force that all feel; the same lean everywhere is the same force."""
    mesh = clfur.Mesh(*MESHES["ball"])
    lean = np.random.default_rng(14).normal(size=mesh.positions.shape).astype(np.float32)
    curves = curves_of(gpu, force=(0, -1, 0), lean=lean)
    packed = stage.pack(clfur.Shells(force=(0, -1, 0), lean=lean), mesh, False, True)
    there = twin.bend(packed, mesh.positions, mesh.normals, lean)
    np.testing.assert_allclose(curves, there, rtol=0, atol=1e-6)
    assert np.abs(curves - curves_of(gpu, force=(0, -1, 0))).max() > 0.01
    np.testing.assert_array_equal(curves_of(gpu, lean=np.tile(np.float32((1, -2, 0.5)), (len(lean), 1))),
                                  curves_of(gpu, force=(1, -2, 0.5)))
    with pytest.raises(clfur.Error, match="Shells.lean has 3 rows and Scene.mesh"):
        clfur.Scene(mesh=mesh, fur=clfur.Shells(lean=np.zeros((3, 3))), camera=clfur.Camera(eye=(0, 0, 3)))
    with pytest.raises(clfur.Error, match="Shells.lean is"):
        clfur.Shells(lean=(1, 2, 3))


def test_wind_comes_again(gpu):
    """Gusts are a function of time with a period of 1; without wind there is no time."""
    windy = [curves_of(gpu, wind=(1, 0, 0.5), time=time) for time in (0.25, 0.5, 1.25, -0.75)]
    assert np.abs(windy[0] - windy[1]).max() > 1e-3
    np.testing.assert_array_equal(windy[0], windy[2])
    np.testing.assert_array_equal(windy[0], windy[3])
    force = [curves_of(gpu, force=(0, -1, 0), time=time) for time in (0.25, 0.5)]
    np.testing.assert_array_equal(*force)


def test_hairs_are_bent_by_the_difference_of_force_and_acceleration(gpu):
    one = curves_of(gpu, force=(1, -2, 0.5))
    np.testing.assert_array_equal(one, curves_of(gpu, force=(2, -2, 0.5), acceleration=(1, 0, 0)))
    assert ((one[:, -1] - curves_of(gpu)[:, -1]) @ (1, -2, 0.5) > -1e-6).all()


# --- the pattern -----------------------------------------------------------------------------------------


def test_cover_is_the_reports():
    """|sin(2 f s) + sin(f t)| / sqrt f over the threshold 2 h / sqrt f, by a smoothstep up to 1.4 times that."""
    rng = np.random.default_rng(0)
    n = 100000
    f, s, t, h = rng.uniform(1, 200, n), *rng.uniform(0, 2 * np.pi, (2, n)), rng.uniform(3e-3, 1, n)
    value, threshold = np.abs(np.sin(2 * f * s) + np.sin(f * t)) / np.sqrt(f), 2 / np.sqrt(f) * h
    u = np.clip((value - threshold) / (0.4 * threshold), 0, 1)
    # The pattern's own places: x = f s / pi, y = f t / 2 pi.
    exact = {"shape": (1.4, 1.0, 0.0, 8.0)}
    v, *_ = twin.waves(exact, np.stack([f * s / np.pi, f * t / (2 * np.pi)], 1))
    np.testing.assert_allclose(twin.cover(exact, v, h), u * u * (3 - 2 * u), atol=1e-9)


def test_the_filter_is_the_mean():
    """Over a footprint the share covered is the mean of what it is at each place."""
    shape = {"shape": (1.4, 1.0, 0.0, 8.0)}
    rng = np.random.default_rng(0)
    v, h, g, tip, fold = (rng.uniform(*ends, 300) for ends in ((-0.5, 1), (0.01, 1), (0.1, 0.9), (0.7, 1), (-0.6, 0.2)))
    v = np.clip(v, fold, tip)
    across = (np.arange(4000) + 0.5) / 4000 - 0.5
    there = v[:, None] + across * g[:, None]
    there = np.where(there > tip[:, None], 2 * tip[:, None] - there, there)     # down the other side of the hair
    there = np.where(there < fold[:, None], 2 * fold[:, None] - there, there)   # and up the next
    expected = twin.cover(shape, there, h[:, None]).mean(1)
    np.testing.assert_allclose(twin.cover(shape, v, h, g, tip, fold), expected, atol=2e-3)


@pytest.mark.parametrize("pattern, shape", [("sine", (1.4, 0.7, 0.0, 8.0)), ("cells", (1.4, 0.7, 0.0, 8.0))])
def test_slopes_are_those_of_the_height(pattern, shape):
    rng = np.random.default_rng(0)
    shells = {"shape": shape, "size": (0.1, 30, 40, 0.5), "kind": np.array([pattern == "sine", 3, 1, 1])}
    at = rng.uniform(20, 60, (20000, 2))

    def height(at):
        return twin.waves(shells, at) if pattern == "sine" else twin.cells(shells, 4, 200, at)
    _v, grad, *_ = height(at)
    for axis in range(2):
        step = 1e-6 * np.eye(2)[axis]
        # On a ridge or at the edge of a cell there is no slope: few places.
        off = np.abs((height(at + step)[0] - height(at - step)[0]) / 2e-6 - grad[:, axis])
        assert (off > 1e-4).mean() < 1e-4


def test_hairs_of_one_cell_are_its_own():
    """One hair a cell, as tall as its variation lets it be, and none beyond the face."""
    shells = {"shape": (1.4, 1.0, 0.0, 8.0), "size": (0.1, 30, 40, 0.3), "kind": np.array([0, 3, 1, 1])}
    u, v = np.meshgrid(np.arange(0, 12, 1 / 64) + 1e-5, np.arange(0, 12, 1 / 64) + 1e-5)
    at = np.stack([(u + v / 2).ravel(), (v * np.sqrt(0.75)).ravel()], 1)
    height = twin.cells(shells, 9, 12, at)[0].reshape(u.shape)
    inside = u + v < 12
    peaks = height[1:-1, 1:-1]
    around = [height[1 + j:height.shape[0] - 1 + j, 1 + i:height.shape[1] - 1 + i]
              for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    tops = (peaks > np.max(around, 0)) & (peaks > 0.6) & inside[1:-1, 1:-1]
    assert tops.sum() == 144                                  # a side of 12 cells has 144 of them
    assert peaks[tops].min() > 0.65 and 0.97 < peaks[tops].max() <= 1
    assert (height[inside] <= 0).mean() < 2e-3                # at the skin nearly all is covered
    assert (twin.cells(shells, 9, 12, np.array([(20.0, 3.0), (-5.0, 1.0)]))[0] == -1).all()
    other = twin.cells(shells, 10, 12, at)[0].reshape(u.shape)
    assert np.abs(other - height)[inside].mean() > 0.05       # another face has other hairs


@pytest.mark.parametrize("pattern", ["cells", "sine"])
def test_noise_is_seeded_and_periodic(gpu, pattern):
    mesh = clfur.Mesh(*MESHES["ball"])

    def table(seed):
        packed = stage.pack(clfur.Shells(pattern=pattern, seed=seed, frequency=20.0), mesh, False, True)
        pattern_ = stage.lay(gpu, mesh, packed, stage.topology_of(mesh.faces))
        return pattern_.noise.get().reshape(*noise_shape(packed), 2).astype(float), packed
    one, packed = table(5)
    np.testing.assert_array_equal(one, table(5)[0])
    assert np.abs(one - table(6)[0]).mean() > 0.1
    assert np.abs(one.mean((0, 1, 2))).max() < 0.05 and 0.1 < one.std() < 0.5 and np.abs(one).max() <= 1.5
    assert abs(np.corrcoef(one[..., 0].ravel(), one[..., 1].ravel())[0, 1]) < 0.3
    # From the last place to the first the step is no larger than others are.
    for axis in range(3):
        if one.shape[axis] > 1:
            steps = np.abs(np.diff(one, axis=axis))
            around = np.abs(np.take(one, 0, axis) - np.take(one, -1, axis))
            assert around.max() <= 1.05 * steps.max()
            assert abs(around.mean() / steps.mean() - 1) < 0.5
    # A period further on is the same place.
    p = np.random.default_rng(0).uniform(0, 4, (500, 3)) * (1, 1, pattern == "cells")
    period = np.array(packed["noise"][:3]) * (1, 1, pattern == "cells")
    np.testing.assert_allclose(twin.noise_at(packed, one, p), twin.noise_at(packed, one, p - 2 * period), atol=1e-9)


def test_the_means_are_those_of_the_pattern(gpu):
    """The table against far more places than it was made of."""
    rng = np.random.default_rng(0)
    for pattern in ("cells", "sine"):
        fur = clfur.Shells(pattern=pattern, density=0.8)
        packed = stage.pack(fur, clfur.Mesh(*MESHES["ball"]), False, True)
        means = gpu.empty((stage.HEIGHTS, 2), np.float32)
        gpu.launch("shells.means", stage.HEIGHTS, shells=packed, around=stage.AROUND, out=means)
        at = rng.uniform(100, 180, (200000, 2))
        v = (twin.waves(packed, at) if pattern == "sine" else twin.cells(packed, 3, 1 << 30, at))[0]
        for k in (4, 16, 32, 48, 60):
            covered = twin.cover(packed, v, k / (stage.HEIGHTS - 1)).mean()
            assert means.get()[k, 0] == pytest.approx(covered, rel=0.05, abs=0.01)
