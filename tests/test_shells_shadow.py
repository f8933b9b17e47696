"""Shells before the light: what they put into its grid, against the twin, closed forms and brute force."""

import functools
import os
import subprocess
import sys

import numpy as np
import pytest
from support.devices import DEVICES
from support.plans import plan_of
from support.scenes import icosphere

import clfur
from clfur.pipeline import build
from clfur.pipeline.shadows import cast_shadows, shells_depth
from clfur.pipeline.views import grid_of, light_of, view_of
from clfur.stages import shade, sky
from clfur.stages import shells as stage
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import raster
from clfur.stages.strands import no_strands
from clfur.stages.tessellate import tessellate
from clfur.stages.voxelize import most_of
from clfur.twin import shells as twin

CROSSING_UNIT = 1 << 12


def ball(subdivisions=2):
    positions, faces = icosphere(subdivisions)
    return clfur.Mesh(positions, positions, None, faces)


def patch(n=1, half=1.0):
    """A level square of 2 n² faces, facing up, with uv."""
    x, z = (a.ravel() for a in np.meshgrid(*[np.linspace(-half, half, n + 1)] * 2))
    i = (np.arange(n) + (n + 1) * np.arange(n)[:, None]).ravel()
    faces = np.concatenate([np.stack([i, i + n + 1, i + 1], 1), np.stack([i + 1, i + n + 1, i + n + 2], 1)])
    positions = np.stack([x, 0 * x, z], 1)
    uv = np.stack([x, z], 1) / (2 * half) + .5
    return clfur.Mesh(positions, np.repeat([(0.0, 1, 0)], len(x), 0), uv[faces], faces)


def beam(*direction, **keys):
    return clfur.Light(direction=direction, ambient=0, **keys)


def furred(gpu, mesh, fur, filtered=True):
    """-> (`Shell`, `layout.Shells`)"""
    packed = stage.pack(fur, mesh, False, filtered)
    topology = stage.topology_of(mesh.faces)
    pattern = stage.lay(gpu, mesh, packed, topology)
    return stage.bend(gpu, mesh, packed, pattern, topology, stage.border(gpu, mesh, packed, topology)), packed


def deposited(gpu, scene, cells=48, method="length", crossing_unit=CROSSING_UNIT):
    """-> (cells [nz, ny, nx] int64, grid, shell, packed)"""
    grid = grid_of(scene, cells)
    shell, packed = furred(gpu, scene.mesh, scene.shells)
    return stage.deposit(gpu, grid, shell, packed, method, crossing_unit).get().astype(np.int64), grid, shell, packed


def area_in(cells, grid, crossing_unit=CROSSING_UNIT):
    """Area that hair shows to parallel light [world²]."""
    return cells.sum() / crossing_unit * float(grid["face"][0])


SHAPES = {"fine": {"length": .12, "frequency": 40}, "long": {"length": .2, "frequency": 30},
          "stubby": {"length": .1, "frequency": 10}}

# --- the twin ------------------------------------------------------------------------------------------------

FURS = {"straight": {}, "short": {"length": .02}, "bent": {"force": (0, -1, 0)},
        "long": {"length": .4, "force": (1, 0, 0)}, "windy": {"wind": (.5, 0, .3), "time": .3, "frequency": 3}}
LIGHTS = {"slanted": beam(1, -1, -.6), "along": beam(0, 0, -1), "below": beam(.2, 1, .1),
          "spot": beam(0, -1, 0, position=(0, 8, 0), angle=12),
          "near": beam(.3, -1, 0, position=(0, 1.6, 0), angle=100)}


@pytest.mark.parametrize("fur, light", [*((fur, "slanted") for fur in FURS), ("bent", "along"), ("bent", "below"),
                                        ("bent", "spot"), ("straight", "near")])
def test_twin(gpu, fur, light):
    check_twin(gpu, clfur.Scene(mesh=ball(1), fur=clfur.Shells(**FURS[fur]), light=LIGHTS[light]), 16)


@pytest.mark.small
@pytest.mark.parametrize("pattern, method, n", [("cells", "length", 1), ("sine", "binary", 2), ("sine", "count", 1)])
def test_twin_of_a_square(gpu, monkeypatch, pattern, method, n):
    """Faces of many cells, which several work-items divide between them."""
    monkeypatch.setattr(stage, "AROUND", 4)
    gpu = clfur.Scheduler(gpu.device)
    gpu.lanes = 1   # Oclgrind 21.10 takes parts of a vector for unset that are not
    fur = clfur.Shells(length=.3, pattern=pattern, frequency=3, force=(.3, 0, 0) if n == 1 else (0, 0, 0))
    check_twin(gpu, clfur.Scene(mesh=patch(n), fur=fur, light=beam(.4, -1, .2)), 16, method)


def check_twin(gpu, scene, cells, method="length"):
    got, grid, shell, packed = deposited(gpu, scene, cells, method)
    deep = 1 / float(np.linalg.norm(grid["to_grid"][:3, 2]))
    step = .75 * min(float(grid["face"][1] * grid["face"][2]), deep)
    parts = -(-min(int(shell.longest / step) + 2, stage.MOST_ROWS) // stage.ROWS)
    pattern, slabs = shell.pattern, int(packed["kind"][2])
    expected = twin.deposit(packed, grid, pattern.faces.get()[:, :3], shell.curves.get().reshape(-1, slabs + 1, 4),
                            pattern.lattice.get().reshape(-1, stage.CORNERS, 4), pattern.means.get(), parts, deep,
                            method == "binary", CROSSING_UNIT)
    assert got.sum() > 0
    np.testing.assert_array_equal(got, expected)


# --- closed forms --------------------------------------------------------------------------------------------


def amount(means, lattice, direction, length):
    """What straight fur shows to light per area of a level face, from the table: by the formula of deposit, finely."""
    h = np.linspace(0, 1, 6301)
    table = np.stack([np.interp(h, np.linspace(0, 1, len(means)), column) for column in means.T], 1)
    down, middle = table[:-1, 0] - table[1:, 0], (table[1:, 1] + table[:-1, 1]) / 2 / 6300
    towards = -np.asarray(direction, float) / np.linalg.norm(direction)
    move = lattice[2:4, :3] @ (towards * (1, 0, 1))
    above, side = down * towards[1], middle * length * np.linalg.norm(move)
    return (above + np.maximum(np.abs(above), np.sqrt(4 * side**2 + (1 - 4 / np.pi**2) * above**2))).sum() / 2


@pytest.mark.parametrize("direction", [(0, -1, 0), (1, -1, .5), (1, 0, 0), (1, -.1, 0), (.3, 1, 0)])
@pytest.mark.parametrize("length", [.05, .4])
def test_a_level_patch_shows_its_table(gpu, direction, length):
    """Whatever the grid and the faces: the sum is the area of all hair that the light sees."""
    fur = clfur.Shells(length=length, frequency=20, seed=3)
    for n, cells in ((1, 16), (1, 48), (4, 48), (4, 112)):
        got, grid, shell, _ = deposited(gpu, clfur.Scene(mesh=patch(n), fur=fur, light=beam(*direction)), cells)
        means = shell.pattern.means.get().astype(float)
        lattice = shell.pattern.lattice.get().reshape(-1, stage.CORNERS, 4)
        expected = 4 * np.mean([amount(means, each, direction, length) for each in lattice.astype(float)])
        # Heights of 3/4 cell and 16 steps through the table.  Rounding: half a unit for each work-item.
        rounding = len(lattice) * 40 / CROSSING_UNIT * float(grid["face"][0])
        assert abs(area_in(got, grid) - expected) < .01 * expected + rounding, (n, cells)
        if direction == (0, -1, 0):
            assert expected == pytest.approx(4 * means[0, 0], rel=.002)


def test_a_turning_light_changes_sums_by_little(gpu):
    """By fractions of a cell: what a round thing shows stays the same."""
    fur = clfur.Shells(length=.1, frequency=30)
    areas = []
    for k in range(6):
        turn = .7 + k / 48 / 3
        got, grid, *_ = deposited(gpu, clfur.Scene(mesh=ball(3), fur=fur, light=beam(-np.cos(turn), -1, -np.sin(turn))))
        areas.append(area_in(got, grid))
    assert np.ptp(areas) < 1e-3 * areas[0]


# --- brute force -----------------------------------------------------------------------------------------------


class Fur:
    """Straight fur of a ball, solved for its corners: at height h a face is the skin's, 1 + h · length as large."""

    def __init__(self, mesh, fur, shell, packed):
        order = np.sort(mesh.faces, 1)
        self.inverse = np.linalg.inv(mesh.positions[order].astype(float).transpose(0, 2, 1))
        self.packed, self.length, self.shell = packed, fur.length, shell
        lattice = shell.pattern.lattice.get().astype(float).reshape(-1, stage.CORNERS, 4)
        self.at = np.stack([lattice[:, 0, :2], lattice[:, 0, 2:], lattice[:, 1, :2]], 1)       # [F, 3, 2]
        self.sides = lattice[:, 1, 2].astype(int)

    def weights(self, p):
        """-> (face, weights of its corners, whose sum is above 1 over the skin) of places [N, 3]."""
        w = (self.inverse.reshape(-1, 3) @ p.T).reshape(len(self.inverse), 3, len(p))
        face = w.min(1).argmax(0)
        return face, w[face, :, np.arange(len(p))]

    def place(self, p):
        """-> (face, weights of its corners, height) of places [N, 3]."""
        face, w = self.weights(p)
        return face, w / w.sum(1, keepdims=True), (w.sum(1) - 1) / self.length

    def cover(self, p):
        face, w, h = self.place(p)
        v = twin.cells(self.packed, face, self.sides[face], np.einsum("ni,nij->nj", w, self.at[face]))[0]
        return np.where((h >= 0) & (h <= 1), twin.cover(self.packed, v, np.clip(h, 0, 1)), 0)

    def crossings(self, starts, towards, step):
        """How often rays of light [N, 3] enter hair before they get here."""
        before, count = np.zeros((1, len(starts))), np.zeros(len(starts))
        for steps in np.array_split(np.arange(int(1.7 / step), -1, -1), 20):
            p = starts + ((steps[:, None, None] + .5) * step) * towards
            near = (p**2).sum(2) < (1 + self.length)**2
            here = np.zeros(near.shape)
            here[near] = self.cover(p[near])
            count += np.maximum(np.diff(np.concatenate([before, here]), axis=0), 0).sum(0)
            before = here[-1:]
        return count

    def around(self, places, h, spread, rays, rng):
        """Places at height h beside these [Q, 3], within a radius -> [Q, rays, 3]."""
        p = places[:, None] + spread * rng.uniform(-1, 1, (len(places), rays, 3))
        p = p.reshape(-1, 3)
        return (p / self.weights(p)[1].sum(1, keepdims=True) * (1 + h * self.length)).reshape(len(places), rays, 3)


def read(cells, grid, p, crossing_unit=CROSSING_UNIT):
    """Crossings before places [N, 3], between four columns and two layers."""
    sums = np.concatenate([np.zeros((1, *cells.shape[1:])), np.cumsum(cells, 0)]) / crossing_unit
    m = grid["to_grid"].astype(float)
    x, y, z = ((p @ m[:3] + m[3])[:, :3] - (.5, .5, 0)).T
    result = 0
    for dx, dy, dz in np.ndindex(2, 2, 2):
        weight = np.ones(len(p))
        for value, d in ((x, dx), (y, dy), (z, dz)):
            f = value - np.floor(value)
            weight *= f if d else 1 - f
        i, j, k = (np.floor(value).astype(int) + d for value, d in ((x, dx), (y, dy), (z, dz)))
        result = result + weight * sums[k, j, i]
    return result


@functools.cache
def judged(shape):
    """A scene, and [(places [N, 3], how often light enters hair before them [N])] on the skin and at two heights."""
    gpu, rng = clfur.Scheduler(DEVICES[0]), np.random.default_rng(1)
    fur = clfur.Shells(alpha=ALPHA, noise=(0, 8), **SHAPES[shape])
    mesh, direction = ball(1), np.array([1, -1, -.6])
    scene = clfur.Scene(mesh=mesh, fur=fur, light=beam(*direction))
    truth, towards = Fur(mesh, fur, *furred(gpu, mesh, fur)), -direction / np.linalg.norm(direction)
    places = rng.normal(size=(400, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    places, found = places[places @ towards > .25][:24], []
    for h in (0, .3, .6):
        rays = truth.around(places, h, 1.5 / fur.frequency, 16, rng).reshape(-1, 3)
        found.append((rays, truth.crossings(rays, towards, min(.125 / fur.frequency, fur.length / 30))))
    return scene, found


# Grid: the error of crossings, as a share of all on the skin, and of light, on the mean over places at one height.
# What is read is smeared over cells, 1/21 of the ball wide with 48 of them: places near the tips are too dark (.15 at
# worst, where fur is .12 long; .08 with 96 cells), those near the skin too bright (.08, .05).
ALPHA, ERRORS = .5, {48: (.2, .18), 96: (.12, .1), 192: (.09, .06)}


@pytest.mark.parametrize("cells", ERRORS)
@pytest.mark.parametrize("shape", SHAPES)
def test_light_in_a_furred_ball_is_near_the_truth(gpu, shape, cells):
    scene, found = judged(shape)
    got, grid, *_ = deposited(gpu, scene, cells)
    for rays, exact in found:
        crossed = read(got, grid, rays)
        assert abs(exact.mean() - crossed.mean()) < ERRORS[cells][0] * found[0][1].mean()
        expected, light = ALPHA**exact, np.exp(-shells_depth(ALPHA, "length") * crossed)
        assert np.abs((light - expected).reshape(-1, 16).mean(1)).mean() < ERRORS[cells][1]


# --- under a sky ---------------------------------------------------------------------------------------------


@pytest.mark.small
@pytest.mark.parametrize("pattern, force", [("cells", (.3, 0, 0)), ("sine", (0, 0, 0))])
def test_what_is_left_in_a_sky_s_cells_is_the_twin_s(gpu, monkeypatch, pattern, force):
    """Points at a cell's border may count in the next: compared are sums of cells along z; each point's is rounded."""
    monkeypatch.setattr(stage, "AROUND", 4)
    gpu = clfur.Scheduler(gpu.device)
    gpu.lanes = 1   # as above
    fur = clfur.Shells(length=.6, pattern=pattern, frequency=3, force=force)
    shell, packed = furred(gpu, patch(1), fur)
    grid = sky.sky_of((-1.1, -.1, -1.13), (1.13, .93, 1.1), 16)
    there = sky.held(gpu, grid, False, 20.0)
    stage.leave(gpu, grid, shell, packed, .7, there)
    got = there.moments.get().reshape(16, 16, 16, 6) / there.unit
    slabs, low, scale = int(packed["kind"][2]), grid["place"][:3].astype(float), float(grid["place"][3])
    heights = int(float(packed["size"][0]) / (slabs * .75 / scale)) + 1
    curves, lattice = shell.curves.get()[:, :3].reshape(-1, slabs + 1, 3), shell.pattern.lattice.get()
    meant = twin.leave(packed, low, scale, 16, shell.pattern.faces.get(), curves,
                       lattice.reshape(-1, stage.CORNERS, 4), shell.pattern.means.get(), heights, 48, .7)
    for j, (a, b) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        across, most = meant[..., a, b].sum((0, 2)), meant.sum((0, 2)).max()
        np.testing.assert_allclose(got[..., j].sum((0, 2)), across, atol=2e-3 * most)
        np.testing.assert_allclose(got[..., j], meant[..., a, b], atol=.15 * meant.max())
    assert got[..., 1].max() > 1e-3


@pytest.mark.parametrize("shape", SHAPES)
def test_light_of_a_sky_in_a_furred_ball_is_near_the_truth(gpu, shape):
    """Of a white sky, on hairs by the sine, at five heights: rays from all around that enter hairs or the ball. The
    flat ambient that is best for all would err by .06 to .2."""
    fur = clfur.Shells(alpha=ALPHA, noise=(0, 8), **SHAPES[shape])
    mesh, rng = ball(1), np.random.default_rng(2)
    scene = clfur.Scene(mesh=mesh, fur=fur, environment=clfur.Environment())
    with gpu.frame():
        lit = build.sky(gpu, plan_of(scene, clfur.Settings(), ["color"]))
        cells = gpu.download(lit.cells).reshape(32, 32, 32, 9, 4)[..., :3].astype(float)
    truth = Fur(mesh, fur, *furred(gpu, mesh, fur))
    towards, step = sky.spiral(64), min(.25 / fur.frequency, fur.length / 16)
    axes = rng.normal(size=(12, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for h in (.1, .3, .5, .7, .9):
        p = truth.around(axes, h, 1.5 / fur.frequency, 4, rng).reshape(-1, 3)
        t = p / np.linalg.norm(p, axis=1, keepdims=True)
        starts, ways = np.repeat(p, len(towards), 0), np.tile(towards, (len(p), 1))
        along = (starts * ways).sum(1)
        free = (along > 0) | ((starts**2).sum(1) - along**2 > .97)   # the ball's faces lie within it
        left = np.where(free, ALPHA**truth.crossings(starts, ways, step), 0).reshape(len(p), -1)
        sine = np.sqrt(1 - (t @ towards.T) ** 2)
        meant = (left * sine).mean(1) / (np.pi / 4)
        found = looked_up(lit, cells, p + t * (h - .5) * 2 / lit.sky["place"][3], t)
        off = (found - meant).reshape(-1, 4).mean(1)
        assert np.abs(off).mean() < .065   # at the roots of hair as wide as cells; elsewhere below .05


def looked_up(lit, cells, p, t):
    """Light [n] of the first colour around axes."""
    at = np.clip((p - lit.sky["place"][:3]) * lit.sky["place"][3] - .5, 0, 31)
    base, there = np.minimum(at.astype(int), 30), 0
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (base + corner).T
        there = there + np.prod(np.where(corner, at - base, 1 - at + base), 1)[:, None] * cells[z, y, x, :, 0]
    kept = np.array([1, 0, 0, 0, *[-1 / 8] * 5])
    return np.maximum((kept * sky.harmonics(t) * there).sum(1), 0)


# --- in a frame ----------------------------------------------------------------------------------------------


def test_the_body_is_dark_under_the_fur(gpu):
    """By what the grid holds; and fur that lets all light through is not there."""
    for alpha in (.3, 1):
        scene = clfur.Scene(mesh=ball(), fur=clfur.Shells(length=.15, alpha=alpha), light=beam(-.2, -.1, -1),
                            body_color=(1, 1, 1), camera=clfur.Camera(eye=(0, 0, 3), size=(60, 40)))
        body, view, light = tessellate(gpu, scene.mesh, 1, 1, "flat"), view_of(scene, 1), light_of(scene.light)
        visible, hair = raster(gpu, view, None, body), no_strands(gpu)
        settings = clfur.Settings(raster="samples", samples=1, shadow_map=0)
        cast = cast_shadows(gpu, scene, settings, hair, body, furred(gpu, scene.mesh, scene.shells))
        dark, full = (shade.color(gpu, view, each, visible, hair, body, (1, 1, 1)).get()[..., 0]
                      for each in (cast, unshadowed(gpu, light)))
        share = (dark[full > .2] / full[full > .2]).mean()
        assert share == pytest.approx(1) if alpha == 1 else .05 < share < .6


def ring(alpha, height):
    """Level strands over the y axis, about this high."""
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 2 * np.pi, 4000)
    along = .1 * np.stack([np.cos(angle), np.zeros(4000), np.sin(angle)], 1)
    middle = rng.uniform((-.7, height - .02, -.7), (.7, height + .02, .7), (4000, 3))
    return clfur.Curves(np.stack([middle - along, middle + along], 1), width=.01, alpha=alpha, specular=0)


@pytest.mark.parametrize("method", ["binary", "count", "trilinear", "length"])
def test_shells_and_strands_darken_each_other(gpu, method):
    camera = clfur.Camera(eye=(0, .6, 4), size=(80, 60))
    settings = clfur.Settings(raster="samples", samples=1, shadows=method, shadow_map=0)

    def drawn(alpha, strands_alpha, way):
        scene = clfur.Scene(mesh=ball(), fur=[clfur.Shells(length=.2, alpha=alpha), ring(strands_alpha, 1.5)],
                            light=beam(0, way, 0), camera=camera, body_color=None)
        out = clfur.render(scene, gpu, settings, outputs=("color", "id"))
        return out["color"][..., 0], out["id"]
    bright, ids = drawn(1, 1, -1)
    top = np.arange(60)[:, None] < 22                        # rows that show the ball's upper side and the strands
    shell = (ids < 0) & (bright > .05) & top
    assert shell.sum() > 50
    assert drawn(1, .2, -1)[0][shell].sum() < .7 * bright[shell].sum()
    bright, ids = drawn(1, 1, 1)                             # from below, through the ball
    assert (ids >= 0).sum() > 50
    assert drawn(.2, 1, 1)[0][ids >= 0].sum() < .7 * bright[ids >= 0].sum()


def both(mesh):
    fur = [clfur.Shells(length=.1, force=(0, -1, 0)), clfur.Strands(roots=4000, types=clfur.HairType(width=.01))]
    return clfur.Scene(mesh=mesh, fur=fur, light=beam(1, -1, -1), camera=clfur.Camera(eye=(0, 0, 3), size=(40, 30)))


def hashed(scene, *arguments, **keys):
    settings = clfur.Settings(raster="samples", samples=1, grid=32, **keys)
    return clfur.draw(scene, *arguments, settings=settings, hashes=True).hashes


@pytest.mark.parametrize("method", ["binary", "length"])
def test_the_same_counts_in_parts_by_teams_and_with_narrow_atomics(gpu, another, sphere, method):
    scene = both(sphere)
    whole = hashed(scene, gpu, shadows=method)["voxels"]
    bald = clfur.Scene(mesh=sphere, fur=scene.strands, light=scene.light)
    assert whole != hashed(bald, gpu, shadows=method)["voxels"]
    small = another(6_000_000, int64_atomics=False)
    settings = clfur.Settings(raster="samples", grid=32, samples=1)
    assert len(plan_of(scene, settings, ["color"]).parts(small)) > 1
    assert hashed(scene, small, shadows=method)["voxels"] == whole
    assert hashed(scene, [gpu, small], shadows=method)["voxels"] == whole
    only = clfur.Scene(mesh=sphere, fur=scene.shells, light=scene.light, body_color=None)
    assert hashed(only, gpu)["voxels"] == hashed(only, [small, gpu])["voxels"]


def test_one_thread_gives_the_same_counts(gpu):
    code = ("import clfur; fur, camera = clfur.Shells(), clfur.Camera(size=(16, 16));"
            "scene = clfur.Scene(mesh=clfur.load_mesh('sphere'), fur=fur, camera=camera);"
            "print(clfur.draw(scene, settings=clfur.Settings(samples=1), hashes=True).hashes['voxels'])")
    digests = [subprocess.run([sys.executable, "-c", code], env={**os.environ, "POCL_MAX_PTHREAD_COUNT": n}, check=True,
                              capture_output=True, text=True).stdout for n in "12"]
    assert len(digests[0]) == 65 and digests[0] == digests[1]


def test_shadows_of_shells_stay_when_only_the_camera_moves(gpu, sphere):
    fur, light = clfur.Shells(), beam(1, -1, -1)
    for eye in ((0, 0, 3), (1, 2, 3)):
        camera = clfur.Camera(eye=eye, size=(16, 16))
        frame = clfur.draw(clfur.Scene(mesh=sphere, fur=fur, light=light, camera=camera), gpu)
    assert not {"voxelize", "zscan", "shadow_map"} & set(frame.stages)


@pytest.mark.parametrize("fur", FURS)
@pytest.mark.parametrize("light", ["slanted", "along", "spot", "near"])
def test_counters_hold_what_shells_can_add(gpu, fur, light):
    scene = clfur.Scene(mesh=ball(1), fur=clfur.Shells(**FURS[fur]), light=LIGHTS[light])
    got, grid, shell, _ = deposited(gpu, scene, 16)
    pieces, area = stage.bounds_of(gpu, shell)
    assert got.sum() / CROSSING_UNIT < most_of(grid, "length", pieces, 0.0, area)


def test_more_fur_than_counters_hold_is_an_error(gpu, sphere):
    scene = clfur.Scene(mesh=sphere, fur=clfur.Shells(length=5, frequency=500), camera=clfur.Camera(size=(8, 8)),
                        light=beam(0, -1, 0, position=(0, 7, 0), angle=1))
    with pytest.raises(clfur.Error, match="32-bit counters"):
        clfur.render(scene, gpu, clfur.Settings(grid=256, samples=1))


def test_fur_beyond_a_spots_cone_costs_nothing(gpu, sphere):
    """Near a spot cells are small and points many, which is wasted on fur that its light does not meet."""
    fur, camera = clfur.Shells(length=.2, frequency=6), clfur.Camera(eye=(0, 0, 9), size=(4, 3))

    def seconds(light):
        scene = clfur.Scene(mesh=sphere, fur=fur, camera=camera, light=light)
        frame = clfur.draw(scene, gpu, clfur.Settings(grid=16, samples=1, shadow_map=0))
        return frame.seconds
    seconds(beam(0, -1, 0))   # builds the kernels
    assert seconds(beam(.5, .2, -1, position=(0, 1.3, 1.5), angle=20)) < 10 * seconds(beam(0, -1, -1)) + .1


def test_a_spot_in_long_fur_takes_no_hours(gpu, monkeypatch):
    """The points of a face are bounded by the grid, not by how near the light comes."""
    launched, launch = {}, gpu.launch

    def recorded(name, size, /, **arguments):
        launched[name] = size
        return launch(name, size, **arguments)
    monkeypatch.setattr(gpu, "launch", recorded)
    mesh = patch()
    scene = clfur.Scene(mesh=mesh, fur=clfur.Shells(length=10, frequency=2), light=beam(0, -1, 0, position=(0, 5, 0)))
    deposited(gpu, scene, cells=16)
    assert launched["shells.deposit"] <= len(mesh.faces) * 4 * 16 / stage.ROWS
