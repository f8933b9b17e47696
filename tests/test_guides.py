"""guides against its twin, and what holds of strands between guides."""

import warnings

import attrs
import numpy as np
import pytest
from support.plans import plan_of
from support.scenes import icosphere

import clfur
from clfur import HairType, Strands, layout
from clfur.judge.geometry import geometry_of
from clfur.stages import guides, strands
from clfur.stages.tessellate import tessellate
from clfur.twin import guides as twin
from clfur.twin import strands as of_strands

# Errors against float64 of strands up to 1 long on a mesh of radius 1.3, in float32 steps of 2^-24.  A place is the sum
# of up to seven guides, each of nine products, times weights that are off by a few steps themselves.
POSITION = 20 * 2.0**-24
# Where they curl, ends of a segment of .01 at least, rounded by half a step each, tell the direction from which a point
# is moved by .12 at most.
BENT = POSITION + 0.12 * 2.0**-24 / 0.01
QUICK = clfur.Settings(grid=16, shadow_map=64)
FLAT = {"surface": "flat", "inner": 1, "outer": 1}


def lumpy(level=2):
    """A closed mesh without symmetry: a dented sphere."""
    positions, faces = icosphere(level)
    x, y, z = positions.T
    return clfur.Mesh(positions * (1 + 0.2 * np.sin(5 * x + 1) * np.cos(4 * y - 3 * z))[:, None],
                      uv=positions[faces][:, :, :2], faces=faces)


def units(n, seed):
    return of_strands.unit_or(np.random.default_rng(seed).normal(size=(n, 3)), 0)


def rooted(mesh, n, seed=3):
    """Where n strands stand on a flat mesh, and its normals there: [n, 3] each."""
    curves = clfur.grow(clfur.Scene(mesh, Strands(types=HairType(segments=1), roots=n, seed=seed, **FLAT)))
    return curves.points[::2] + curves.origin, curves.root_normal.astype(float)


def shaped(roots, ends, points=9, bow=.2, seed=4):
    """Guides from roots to ends [n, 3] away, all of which bow aside."""
    t = np.linspace(0, 1, points)[:, None]
    aside = np.cross(ends, units(len(roots), seed))
    return roots[:, None] + t * ends[:, None] + bow * t * (1 - t) * aside[:, None]


def wild(mesh, n=60, seed=5, **options):
    """Guides of all kinds: of two points and of many, curled, of no length, bald ones among them."""
    rng = np.random.default_rng(seed)
    roots, normals = rooted(mesh, n, seed)
    counts = rng.integers(0, 14, n)
    counts[:2] = 1, 2
    steps = .5 * normals[:, None] + .4 * rng.normal(size=(n, 13, 3))
    ways = np.concatenate([np.zeros((n, 1, 3)), np.cumsum(steps, 1)], 1)
    places = roots[:, None] + ways * rng.uniform(.02, .1, (n, 1, 1))
    places[2] = places[2, 0]
    counts[2] = 3
    return clfur.Curves(places[:, :13][np.arange(13) < counts[:, None]], counts=counts, **options)


def made(gpu, mesh, fur, traits=None):
    """(strands [N, S, 3], NaN after the last point, and the surface, roots and types) of a device, on the host."""
    surface = tessellate(gpu, mesh, fur.inner, fur.outer, fur.surface)
    known, _ = guides.stand(gpu, mesh, fur.guides, len(fur.types))
    given = None if traits is None else lambda roots: gpu.upload(traits)
    grown = guides.between(gpu, surface, fur, guides=known, traits_of=given)
    points = np.nan_to_num(grown.points.get()).reshape(len(grown.spans), -1, 4)[..., :3].astype(float)
    points[np.arange(points.shape[1]) >= grown.spans.get()[:, 1:].astype(int)] = np.nan
    _, roots = strands.roots_of(gpu, surface, fur)
    return points, surface, roots.get(), grown.uv.get()[:, 2].astype(int)


def of_twin(mesh, fur, surface, roots, kind, traits=None):
    """The same of the twin."""
    host = [each.get()[:, :3].astype(float) for each in (surface.positions, surface.normals, surface.uv)]
    triangles = surface.triangles.get()[:, :3].astype(int)[roots[:, 0]]
    shares = roots[:, 1:].view(np.float32).astype(float)
    root, frame, _ = of_strands.roots_at(*host[:2], host[2][:, :2], triangles, shares)
    curves, some = fur.guides, fur.guides.counts > 1
    ends = np.cumsum(curves.counts.astype(int))
    shapes = [shape.astype(float) for shape, one in zip(np.split(curves.points, ends[:-1]), some) if one]
    _, face, weights = twin.feet([shape[0] for shape in shapes], mesh.positions, mesh.faces)
    normals = twin.normals_at(face, weights, mesh.positions, mesh.normals, mesh.faces)
    return twin.between(root, frame, kind, fur.types, shapes, normals,
                        None if curves.type_of is None else curves.type_of[some], fur.guides_blended, fur.parting,
                        fur.seed, traits, fur.guides_reach)


TYPES = [HairType(segments=5, width=.01, key=(0, 0, 0), length_variation=.5, direction_variation=.4),
         HairType(segments=9, key=(1, 0, 0), curl=(.05, 2)), HairType(segments=0, key=(2, 0, 0)),
         HairType(segments=1, key=(3, 0, 0), wave=(.03, 1.5))]
MAP = np.zeros((5, 7, 3), np.uint8)
MAP[..., 0] = np.random.default_rng(1).integers(0, 4, (5, 7))
FURS = {
    "one": {"guides_blended": 1, "types": HairType(segments=7)},
    "near": {"types": HairType(segments=3), "guides_reach": .5},
    "three": {"types": HairType(segments=12, length_variation=.3)},
    "seven": {"guides_blended": 7, "parting": 180},
    "curls": {"types": HairType(segments=6, curl=(.02, 1))},
    "curled": {"types": HairType(segments=20, curl=(.03, 3), wave=(.05, -1.5), direction_variation=.3), "parting": 20},
    "types": {"types": TYPES, "type_map": MAP},
}


@pytest.mark.small
@pytest.mark.parametrize("name", FURS)
def test_strands_between_guides_equal_the_twins(gpu, name):
    """Weights don't jump where other guides come near, so that a tie that float32 decides otherwise changes nothing."""
    mesh = lumpy(1)
    given = {"type_of": np.random.default_rng(2).integers(0, 3, 60), "types": TYPES} if name == "types" else {}
    guide = clfur.Curves(shaped(*rooted(mesh, 60, 5))) if name == "curled" else wild(mesh, **given)
    fur = Strands(roots=150, guides=guide, **FLAT, **FURS[name])
    traits = None
    if name in ("curled", "three"):
        traits = np.zeros(150, layout.Traits)
        traits["scale"] = np.random.default_rng(3).random((150, 4)) * 1.2 + .3 * (name == "curled")
    points, *rest = made(gpu, mesh, fur, traits)
    atol = BENT if name in ("curled", "curls", "types") else POSITION
    np.testing.assert_allclose(points, of_twin(mesh, fur, *rest, traits), rtol=0, atol=atol)


@pytest.mark.small
@pytest.mark.parametrize("steps", [None, 16 * 1600])
@pytest.mark.parametrize("n", [1, 3, 300])
def test_the_nearest_guides_are_found(gpu, another, steps, n):
    """The very ones that float64 finds among all, nearest first, also where a driver's loops are cut."""
    one = another(steps=steps)
    places, normals = np.float32(units(n, 7) + .05 * units(n, 8)), units(n, 7).astype(np.float32)
    kind = np.random.default_rng(9).integers(0, 3, n)
    mesh = lumpy(1)
    curves = clfur.Curves(np.stack([places, places + normals], 1), types=[HairType(key=(i, 0, 0)) for i in range(3)],
                          type_of=kind, root_normal=normals)
    known, _ = guides.stand(one, mesh, curves, 4)
    roots, ups = rooted(mesh, 90)
    points = np.concatenate([roots, np.zeros((90, 1))], 1).astype(np.float32)
    mine = np.arange(90) % 4
    spans = np.stack([np.arange(90), np.ones(90)], 1).astype(np.uint32)
    uv = np.zeros((90, 4), np.float32)
    uv[:, 2] = mine
    found = guides.FOUND.empty(one, 90)
    up = np.pad(ups, ((0, 0), (0, 1))).astype(np.float32)
    for number in range(known.rounds):
        one.launch("guides.nearest", 90, points=one.upload(points), spans=one.upload(spans),
                   strand_normal=one.upload(up), strand_uv=one.upload(uv), boxes=known.boxes,
                   members=known.members, roots=known.roots, normals=known.normals, trees=known.trees,
                   tree_of=known.tree_of, n_trees=len(known.trees) // known.rounds, lap=number, most=8, found=found)
    assert (known.rounds > 1) == (steps is not None and n == 300)
    away, number = found.get()[:, :8].view(np.float32), found.get()[:, 8:].view(np.int32)
    allowed = mine[:, None] == kind
    allowed[~allowed.any(1)] = True
    expected = twin.nearest(points[:, :3].astype(float), up[:, :3].astype(float), allowed, places.astype(float),
                            normals.astype(float), 8)
    np.testing.assert_array_equal(number, expected[1])
    np.testing.assert_allclose(np.sqrt(away), expected[0], rtol=2e-6)


@pytest.mark.small
@pytest.mark.parametrize("steps", [None, 16 * 1600])
def test_guides_stand_where_the_mesh_is_nearest(gpu, another, steps):
    one, mesh = another(steps=steps), lumpy(1)
    places = np.concatenate([rooted(mesh, 40)[0], 1.3 * units(40, 2), mesh.positions[:10], .02 * units(10, 3)])
    curves = clfur.Curves(np.stack([places, places + 1], 1))
    known, away = guides.stand(one, mesh, curves, 1)
    distance, face, weights = twin.feet(curves.points[::2], mesh.positions, mesh.faces)
    np.testing.assert_allclose(away, distance, rtol=0, atol=4e-7)
    expected = twin.normals_at(face, weights, mesh.positions, mesh.normals, mesh.faces)
    clear = np.arange(len(places)) < 90   # of a place deep inside several faces are nearest but for rounding
    np.testing.assert_allclose(known.normals.get()[clear, :3], expected[clear], rtol=0, atol=2e-6)


# --- what holds of all guides ---------------------------------------------------------------------------


def hair(mesh, guide, gpu, **options):
    """Strands between guides, as Curves."""
    given = {"types": HairType(segments=8), "roots": 200, "seed": 3, **FLAT, **options}
    return clfur.grow(clfur.Scene(mesh, Strands(guides=guide, **given)), gpu)


@pytest.mark.parametrize("blended", [1, 3, 7])
def test_strands_at_the_roots_of_guides_are_the_guides(gpu, blended):
    mesh = lumpy()
    roots, normals = rooted(mesh, 200)
    guide = shaped(roots, normals * .5)
    curves = clfur.Curves(guide)
    found = hair(mesh, curves, gpu, guides_blended=blended)
    along = np.stack([twin.at_shares(one, np.linspace(0, 1, 9)) + one[0] for one in guide])
    np.testing.assert_allclose(found.points.reshape(200, 9, 3), along, rtol=0, atol=2e-6)


def test_hair_that_was_grown_is_a_guide_to_itself(gpu):
    """On curved faces too, as its roots' normals go along."""
    mesh = lumpy()
    for kind in HairType(segments=8, segment_length=.05, force_weight=.2), HairType(length=.4, stiffness=.5):
        options = {"roots": 200, "seed": 3, "types": kind}
        grown = clfur.grow(clfur.Scene(mesh, Strands(**options)), gpu)
        again = clfur.grow(clfur.Scene(mesh, Strands(guides=grown, **options)), gpu)
        uneven = 0 if kind.length is None else 2e-4   # chords of a bent hair are not of the very same length
        np.testing.assert_allclose(again.points, grown.points, rtol=0, atol=2e-6 + uneven)
    for name in "width", "color", "root_uv", "root_normal", "counts":
        np.testing.assert_array_equal(getattr(again, name), getattr(grown, name))


def test_a_constant_field_stays_constant(gpu):
    """Guides that are the same in the frame of the skin, and on a plane in the world: so are all strands."""
    mesh = lumpy()
    roots, normals = rooted(mesh, 40, 8)
    found = hair(mesh, clfur.Curves(shaped(roots, .4 * normals, bow=0)), gpu)
    points = found.points.reshape(200, 9, 3).astype(float)
    expected = points[:, :1] + np.linspace(0, .4, 9)[:, None] * found.root_normal[:, None].astype(float)
    np.testing.assert_allclose(points, expected, rtol=0, atol=2e-6)
    plane = clfur.Mesh([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], faces=[(0, 2, 1), (0, 3, 2)])
    guide = np.array([(0, 0, 0), (.1, .2, 0), (.1, .3, .3)])
    many = hair(plane, clfur.Curves(np.array([(-.5, 0, .5), (.3, 0, .2), (.6, 0, -.7)])[:, None] + guide), gpu)
    offsets = many.points.reshape(200, 9, 3)
    offsets = offsets - offsets[:, :1]
    np.testing.assert_allclose(offsets, np.broadcast_to(offsets[:1], offsets.shape), rtol=0, atol=5e-7)


def test_strands_turn_with_mesh_and_guides(gpu):
    """Random leans and curls too.  Roots of a few in ten thousand may come to stand elsewhere: of these none does."""
    mesh = lumpy()
    guide = clfur.Curves(shaped(*rooted(mesh, 60, 5)))
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    kind = HairType(segments=8, curl=(.03, 2), direction_variation=.3, length_variation=.4)
    one = hair(mesh, guide, gpu, types=kind)
    other = hair(clfur.Mesh(mesh.positions @ turn.T, faces=mesh.faces),
                 clfur.Curves(guide.points @ turn.T, counts=guide.counts), gpu, types=kind)
    np.testing.assert_allclose(other.points, one.points @ turn.T, rtol=0, atol=5e-6)


def test_far_from_the_origin_strands_are_the_same(gpu):
    mesh, shift = lumpy(), np.array([3e6, -5e5, 2e7])
    guide = wild(mesh)
    one = hair(mesh, guide, gpu)
    far = hair(clfur.Mesh(mesh.positions + shift, faces=mesh.faces),
               clfur.Curves(guide.points + shift, counts=guide.counts), gpu)
    np.testing.assert_allclose(far.points + (far.origin - shift), one.points, rtol=0, atol=3e-6)


def test_a_parting_keeps_both_sides_apart(gpu):
    """Guides left of a line go left, those right of it right: no strand lies between, whatever its root."""
    plane = clfur.Mesh([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], faces=[(0, 2, 1), (0, 3, 2)])
    x, z = (each.ravel() for each in np.meshgrid(np.linspace(-.9, .9, 10), np.linspace(-.9, .9, 10)))
    roots = np.stack([x, 0 * x, z], 1)
    ends = np.stack([.5 * np.sign(x), .4 + 0 * x, 0 * x], 1)
    apart = hair(plane, clfur.Curves(shaped(roots, ends, bow=0)), gpu, roots=2000).points.reshape(2000, 9, 3)
    way = apart[:, -1] - apart[:, 0]
    np.testing.assert_allclose(np.abs(way), np.broadcast_to((.5, .4, 0), way.shape), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(np.sign(way[:, 0]), np.sign(apart[:, 0, 0]))
    merged = hair(plane, clfur.Curves(shaped(roots, ends, bow=0)), gpu, roots=2000, parting=180).points
    way = np.abs(merged.reshape(2000, 9, 3)[:, -1, 0] - merged.reshape(2000, 9, 3)[:, 0, 0])
    assert (way < .3).sum() > 20


def test_hair_that_falls_alike_is_parted_at_its_roots(gpu):
    """What hangs down on both sides differs near the roots alone, and is kept apart as well."""
    plane = clfur.Mesh([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], faces=[(0, 2, 1), (0, 3, 2)])
    x, z = (each.ravel() for each in np.meshgrid([-.15, -.05, .05, .15], np.linspace(-.9, .9, 10)))
    t = np.linspace(0, 1, 20)[:, None]
    fall = np.sign(x)[:, None, None] * np.minimum(4 * t, 1) * (.4, 0, 0) + np.maximum(t - .2, 0) * (0, -2, 0)
    guide = clfur.Curves(np.stack([x, 0 * x, z], 1)[:, None] + fall)
    found = hair(plane, guide, gpu, roots=3000, types=HairType(segments=40))
    points = found.points.reshape(3000, 41, 3)
    near = np.abs(points[:, 0, 0]) < .2
    np.testing.assert_array_equal(np.sign(points[near, 8, 0] - points[near, 0, 0]), np.sign(points[near, 0, 0]))


@pytest.mark.parametrize("segments", [4, 8, 32])
def test_segments_only_tell_how_smooth_a_strand_is(gpu, segments):
    """Points of 4 and of 8 segments are among those of 32."""
    mesh = lumpy()
    guide = clfur.Curves(shaped(*rooted(mesh, 50, 9), points=33))
    fine = hair(mesh, guide, gpu, types=HairType(segments=32)).points.reshape(200, 33, 3)
    found = hair(mesh, guide, gpu, types=HairType(segments=segments)).points.reshape(200, -1, 3)
    np.testing.assert_allclose(found, fine[:, ::32 // segments], rtol=0, atol=1e-6)


def test_what_is_shorter_is_cut(gpu):
    """A factor of the length keeps the curve up to there; more than 1 is 1."""
    mesh = lumpy()
    fur = Strands(guides=wild(mesh), roots=64, types=HairType(segments=64), **FLAT)
    whole, *_ = made(gpu, mesh, fur)
    traits = np.zeros(64, layout.Traits)
    for share in (8, 32, 64, 96):
        traits["scale"] = share / 64, 1, 1, 1
        points, *_ = made(gpu, mesh, fur, traits)
        step = min(share, 64) / 64 * np.arange(65)
        on = [np.stack([np.interp(step, np.arange(65), line) for line in each.T], 1) for each in whole]
        every = np.arange(65) if share >= 64 else np.arange(0, 65, max(64 // max(share, 1), 1))
        np.testing.assert_allclose(points[:, every], np.array(on)[:, every], rtol=0, atol=1e-6)


def test_strands_stand_where_guides_are(gpu):
    """On half a ball alone, and a little beyond; without a reach everywhere, also of guides at one place."""
    mesh = lumpy()
    roots, normals = rooted(mesh, 400, 8)
    upper = roots[:, 1] > 0
    guide = clfur.Curves(shaped(roots[upper], .2 * normals[upper]))
    for reach, low in ((1.5, -.6), (1, -.4), (.5, -.2)):
        found = hair(mesh, guide, gpu, roots=3000, guides_reach=reach)
        everywhere = hair(mesh, guide, gpu, roots=3000)
        height, some = everywhere.points[::9, 1], found.counts > 0
        assert everywhere.counts.all() and not some[height < low].any()
        assert some[height > 0].mean() > {1.5: .9999, 1: .99, .5: .8}[reach]
        np.testing.assert_array_equal(found.points, everywhere.points.reshape(-1, 9, 3)[some].reshape(-1, 3))
    same = clfur.Curves(np.repeat(shaped(roots[:1], normals[:1]), 8, 0))
    assert hair(mesh, same, gpu).counts.all() and not hair(mesh, same, gpu, guides_reach=1).counts.any()


def test_strands_follow_guides_of_their_own_type(gpu):
    """As if there were no others; of a type that no guide has, all."""
    mesh = lumpy()
    roots, normals = rooted(mesh, 60, 9)
    guide, kind = shaped(roots, normals * .3), np.arange(60) % 2
    types = [HairType(segments=8, key=(i, 0, 0)) for i in range(3)]
    picture = np.zeros((1, 3, 3), np.uint8)
    picture[0, :, 0] = 0, 1, 2
    options = {"types": types, "type_map": picture}
    both = hair(mesh, clfur.Curves(guide, type_of=kind, types=types), gpu, **options)
    every = hair(mesh, clfur.Curves(guide), gpu, **options)
    for number in range(3):
        alone = every if number == 2 else hair(mesh, clfur.Curves(guide[kind == number]), gpu, **options)
        mine = np.repeat(both.type_of == number, 9)
        assert mine.any()
        np.testing.assert_array_equal(both.points[mine], alone.points[mine])


def test_the_other_side_of_what_is_thin_does_not_count(gpu):
    """On a thin plate, guides of the near side alone count, though those of the far side are nearer."""
    corners = np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], float)
    plate = clfur.Mesh(np.concatenate([corners + (0, .005, 0), corners - (0, .005, 0)]), normals=np.repeat(
        [(0, 1, 0), (0, -1, 0)], 4, 0), faces=[(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)])
    x, z = (each.ravel() for each in np.meshgrid(np.linspace(-.9, .9, 12), np.linspace(-.9, .9, 12)))
    upper, lower = np.stack([x, 0 * x + .005, z], 1), np.stack([x + .04, 0 * x - .005, z + .04], 1)
    guide = np.concatenate([upper[:, None] + [(0, 0, 0), (.2, .1, 0)], lower[:, None] + [(0, 0, 0), (-.2, -.1, 0)]])
    points = hair(plate, clfur.Curves(guide), gpu, roots=2000, parting=180).points.reshape(2000, 9, 3)
    way = points[:, -1] - points[:, 0]
    np.testing.assert_allclose(way, np.sign(points[:, :1, 1] * 1.0) * (.2, .1, 0), rtol=0, atol=1e-6)


# --- the same picture -----------------------------------------------------------------------------------


def scene(**options):
    mesh = lumpy()
    kind = HairType(segments=8, width=.01, curl=(.01, 1), direction_variation=.2, length_variation=.3, tip_width=.2)
    fur = Strands(**{"guides": clfur.Curves(shaped(*rooted(mesh, 80, 8))), "roots": 3000, "types": kind, **options})
    return clfur.Scene(mesh, fur, clfur.Camera(eye=(.3, .5, 4), size=(96, 72)))


@pytest.mark.parametrize("roots", ["faces", 3000])
def test_parts_bands_and_teams_draw_the_same_bits(gpu, another, roots):
    outputs = "depth", "id", "coverage", "tangent"
    given = scene(roots=roots, inner=3, outer=3)
    whole = clfur.draw(given, gpu, QUICK, outputs, hashes=True)
    small = another()
    low, high = 1 << 18, 1 << 26
    while high - low > 1 << 16:   # the least that does: in as many parts as can be
        small.memory = (low + high) // 2
        try:
            plan_of(given, QUICK, outputs).parts(small)
            high = small.memory
        except clfur.Error:
            low = small.memory
    small.memory = high + (1 << 19)
    parts = plan_of(given, QUICK, outputs).parts(small)
    assert len(parts) > 2
    for device in small, [another(), another()]:
        drawn = clfur.draw(given, device, QUICK, outputs, hashes=True)
        assert drawn.hashes == whole.hashes and drawn.strands == whole.strands
        for name in outputs:
            np.testing.assert_array_equal(drawn.images[name], whole.images[name])


def test_loops_that_end_change_no_bit(gpu, another):
    given = scene()
    one, other = (clfur.grow(given, device) for device in (gpu, another(steps=4000, lanes=1, hinted=1)))
    np.testing.assert_array_equal(one.points, other.points)


def test_the_order_of_guides_does_not_matter(gpu):
    mesh = lumpy()
    guide, order = shaped(*rooted(mesh, 80, 8)), np.random.default_rng(1).permutation(80)
    one, other = (hair(mesh, clfur.Curves(each), gpu).points for each in (guide, guide[order]))
    np.testing.assert_array_equal(one, other)


def test_what_is_bounded_holds(gpu):
    """The ball around all, the lengths that counters must have room for, and the camera that sees all of it."""
    mesh = lumpy()
    kind = HairType(segments=8, width=.02, curl=(.05, 2), wave=(.03, 2), direction_variation=.4, length_variation=.3)
    fur = Strands(guides=wild(mesh), roots=2000, types=kind, parting=180, **FLAT)
    given = clfur.Scene(mesh, fur)
    center, radius = clfur.scene.extent(mesh, fur)
    found = clfur.grow(given, gpu)
    assert np.linalg.norm(found.points - center, axis=1).max() + .01 <= radius
    length = np.linalg.norm(np.diff(found.points.reshape(2000, 9, 3).astype(float), axis=1), axis=2).sum()
    segments, most, area = clfur.scene.hair_bounds(fur, 2000)
    assert segments >= 16_000 and length <= most and length * .02 <= area
    half = rooted(mesh, 300, 5)
    half = [each[half[0][:, 1] > 0] for each in half]
    near = clfur.Scene(mesh, attrs.evolve(fur, guides_reach=1, guides=clfur.Curves(shaped(half[0], 1.5 * half[1]))))
    for each in given, near:
        alpha = clfur.render(each, gpu, QUICK)[..., 3]
        assert max(alpha[0].max(), alpha[-1].max(), alpha[:, 0].max(), alpha[:, -1].max()) == 0
    rows = np.flatnonzero(alpha.max(1))
    assert len(rows) > .7 * len(alpha)   # and does not stand far off


def test_the_picture_is_that_of_the_truth(gpu):
    """Strands that the twin has between guides are where those of the device are: depths of the truth's own rays."""
    given = attrs.evolve(scene(roots=400), camera=clfur.Camera(eye=(.3, .5, 4), size=(48, 36)))
    strands_of_truth, _ = geometry_of(given)
    found = clfur.grow(given, gpu)
    np.testing.assert_allclose(strands_of_truth.points[:, :3], found.points, rtol=0, atol=POSITION)


@pytest.mark.parametrize("roots", [0, 1, 65, "faces"])
@pytest.mark.parametrize("n", [1, 9])
def test_any_number_of_strands_and_guides(gpu, roots, n):
    """Each strand has its own place and is as long as guides are; of one guide all are the same."""
    mesh = lumpy()
    guide = clfur.Curves(shaped(*rooted(mesh, n, 8), bow=0))
    found = hair(mesh, guide, gpu, roots=roots, parting=0, guides_reach=10)
    strands = 320 if roots == "faces" else roots
    assert (found.counts == 9).all() and len(found.counts) == strands
    if n == 1:
        ends = found.points.reshape(-1, 9, 3)
        np.testing.assert_allclose(np.linalg.norm(ends[:, -1] - ends[:, 0], axis=1), 1, rtol=1e-5)
    frame = clfur.draw(clfur.Scene(mesh, Strands(guides=guide, roots=roots, **FLAT)), gpu, QUICK)
    assert frame.strands == strands


def test_guides_on_a_device_are_the_same(gpu):
    """Arrays of a scheduler's own context, whose origin is as it is given."""
    mesh = lumpy()
    guide = wild(mesh)
    there = clfur.Curves(gpu.upload(guide.points), counts=guide.counts)
    one, other = (hair(mesh, each, gpu) for each in (guide, there))
    np.testing.assert_array_equal(other.points, one.points)


def test_maps_cut_and_thin_strands_between_guides(gpu):
    """In pictures, grown strands and the truth: bald where density is 0, half as long where length is."""
    mesh = lumpy()
    x, y, _ = mesh.positions[mesh.faces].mean(1).T
    guide = clfur.Curves(shaped(*rooted(mesh, 80, 8), bow=0))
    options = {"types": [HairType(segments=0, key=(0, 0, 0)), HairType(segments=8, key=(9, 0, 0))],
               "type_map": np.full((1, 1, 3), (9, 0, 0), np.uint8), "roots": 500}
    maps = clfur.Maps(length=np.where(x > 0, 1., .5), density=np.where(y > 0, 1., 0.))
    whole, cut = hair(mesh, guide, gpu, **options), hair(mesh, guide, gpu, maps=maps, **options)
    some = cut.counts > 0
    assert some[whole.points[::9, 1] > .5].all() and not some[whole.points[::9, 1] < -.5].any()
    shares = [np.linalg.norm(each.reshape(-1, 9, 3)[:, -1] - each.reshape(-1, 9, 3)[:, 0], axis=1) for each in (
        cut.points, whole.points.reshape(-1, 9, 3)[some].reshape(-1, 3))]
    share, at = shares[0] / shares[1], cut.points[::9, 0]
    np.testing.assert_allclose(share[at > .4], 1, rtol=1e-5)
    np.testing.assert_allclose(share[at < -.4], .5, rtol=1e-5)
    given = clfur.Scene(mesh, Strands(guides=guide, maps=maps, **options, **FLAT), clfur.Camera(eye=(0, 0, 4)))
    np.testing.assert_allclose(geometry_of(given)[0].points[:, :3], clfur.grow(given, gpu).points, rtol=0,
                               atol=POSITION)


def test_shadows_of_a_light_are_kept_as_the_camera_moves(gpu):
    """Guides are put on the mesh once."""
    given = scene()
    clfur.draw(given, gpu, QUICK)
    launched, run = [], gpu.launch
    try:
        gpu.launch = lambda name, size, /, **arguments: (launched.append(name), run(name, size, **arguments))
        clfur.draw(attrs.evolve(given, camera=clfur.Camera(eye=(.2, .5, 4), size=(96, 72))), gpu, QUICK)
        assert launched and not [name for name in launched if name.startswith("guides")]
        fur = attrs.evolve(given.strands, roots=2000)
        clfur.draw(attrs.evolve(given, fur=fur), gpu, QUICK)
        assert "guides.blend" in launched and "guides.stand" not in launched
    finally:
        del gpu.launch   # the class' own


# --- what is given --------------------------------------------------------------------------------------


def test_guides_beside_the_mesh_are_told_or_refused(gpu):
    mesh = lumpy()
    roots, normals = rooted(mesh, 80, 8)
    for off, told in ((0, False), (.01, False), (.06, True)):
        guide = shaped(roots, normals)
        guide[:7] += off * mesh.bounds[1] * normals[:7, None]
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            hair(mesh, clfur.Curves(guide), gpu)
            clfur.draw(clfur.Scene(mesh, Strands(guides=clfur.Curves(guide), roots=9, **FLAT)), gpu, QUICK)
        lines = [str(each.message) for each in said if "guides" in str(each.message)]
        assert len(lines) == 2 * told
        assert all(line.startswith("Strands.guides has 7 of 80 roots more than 0.0") for line in lines)
    with pytest.raises(clfur.Error, match=r"Strands.guides has 80 of 80 roots .*; allowed: at most 0\.1.*units"):
        hair(mesh, clfur.Curves(100 * guide), gpu)


@pytest.mark.parametrize("given, message", [
    ({"guides": 3}, r"Strands\.guides is 3; allowed: None or an object of class Curves"),
    ({"guides": clfur.Curves(np.zeros((5, 1, 3)))}, r"Strands\.guides has 5 strands, none of two points or more"),
    ({"guides": clfur.Curves(np.zeros((0, 3, 3)))}, r"Strands\.guides has 0 strands"),
    ({"guides_blended": 8}, r"Strands\.guides_blended is 8"), ({"guides_blended": 0}, r"Strands\.guides_blended is 0"),
    ({"guides_reach": 0}, r"Strands\.guides_reach is 0"),
    ({"parting": 181}, r"Strands\.parting is 181"), ({"parting": -1}, r"Strands\.parting is -1")])
def test_what_cannot_be_a_guide_is_refused(given, message):
    with pytest.raises(clfur.Error, match=message):
        Strands(**given)
