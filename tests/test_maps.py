"""maps against its twin, and what holds for hair that follows the skin."""

import math
import re

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import Comb, HairType, Maps, Strands
from clfur.judge.geometry import geometry_of
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig
from clfur.scene import maps as skin
from clfur.stages import maps, strands, tessellate
from clfur.twin import maps as twin
from clfur.twin import strands as twin_strands

# Against float64 on a mesh of radius 1.3 with numbers up to 1: each is a sum of three or four products in float32, at a
# place that is known to 2^-23 times the picture's 9 pixels [largest measured on four drivers: 1.4e-6].  Directions of
# pictures go by the sides of small triangles, known to 2^-23 of the mesh, and by their uv [1.9e-6 in the middles of
# these; more where uv are seen from the side, which no test asks for].
VALUE, WAY = 2e-6, 4e-6

NAMES = skin.NAMES


def lumpy():
    """A closed mesh without symmetry, 80 faces and 72 vertices as given, with uv from -1.7 to 1.7."""
    positions, faces = icosphere(1)
    x, y, z = positions.T
    radius = 1 + 0.3 * np.sin(5 * x + 1) * np.cos(4 * y - 3 * z)
    return clfur.Mesh(positions * radius[:, None], uv=positions[faces][:, :, :2] * 1.7, faces=faces)


def square(n=1, u=1.0):
    """The unit square in x, z, as 2 n² faces with uv (u x, z)."""
    x, z = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    at = np.arange((n + 1)**2).reshape(n + 1, n + 1)
    a, b, c, d = (each.ravel() for each in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    positions = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], 1)
    return clfur.Mesh(positions, uv=positions[:, [0, 2]] * (u, 1), faces=faces)


def traits_of(gpu, mesh, fur):
    """(The device's traits {name: [n, 4]}, the twin's) of strands on a mesh."""
    surface = tessellate.tessellate(gpu, mesh, fur.inner, fur.outer, fur.surface)
    first, roots = strands.roots_of(gpu, surface, fur)
    planes, weight = skin.planes(mesh, fur.maps, fur.comb), fur.comb.weight if fur.comb else 0.0
    found = maps.traits(gpu, surface, roots, planes, (0, len(mesh.faces)), weight, fur.seed, first).get()
    words = roots.get()
    host = [each.get().astype(float) for each in (surface.positions, surface.normals, surface.uv)]
    triangles = surface.triangles.get().astype(int)[words[:, 0]]
    weights = words[:, 1:].copy().view(np.float32).astype(float)
    _, frame, at = twin_strands.roots_at(host[0][:, :3], host[1][:, :3], host[2], triangles[:, :3], weights)
    right = twin.traits(planes, at[:, :2], at[:, 2:], frame[:, 2], host[0][triangles[:, :3], :3],
                        host[2][triangles[:, :3], :2], triangles[:, 3], weight, fur.seed, np.arange(len(words)))
    return {name: found[name].astype(float) for name in found.dtype.names}, right


def close(gpu, mesh, fur):
    """The traits, which are the twin's."""
    found, right = traits_of(gpu, mesh, fur)
    bald = (found["scale"][:, 0] == 0) != (right["scale"][:, 0] == 0)   # the random number but for rounding
    assert bald.mean() < 1e-3
    for name, most in ("scale", VALUE), ("tuft", VALUE), ("comb", WAY):
        np.testing.assert_allclose(found[name][~bald], right[name][~bald], rtol=0, atol=most, err_msg=name)
    return found


def random(shape, seed=1):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def of_vertices(mesh, seed=1):
    return random(mesh.numbering.vertices, seed)


@pytest.mark.small
def test_pictures_vertices_and_faces_are_the_twins(gpu):
    mesh = lumpy()
    by = Maps(density=random((7, 9)), on=of_vertices(mesh, 5), length=of_vertices(mesh), width=random(80),
              clump=random((1, 1)), curl=random((9, 2), 2), stiffness={"vertex": of_vertices(mesh, 3)})
    found = close(gpu, mesh, Strands(3, 3, maps=by, comb=Comb(random((5, 4, 3)) * 2 - 1)))
    assert 0.6 < (found["scale"][:, 0] == 0).mean() < 0.9
    assert np.ptp(found["scale"][:, 1:], 0).min() > 0.5 and np.ptp(found["comb"][:, :3], 0).min() > 0.5
    assert (found["comb"][:, 3] == np.float32(0.7)).all()


@pytest.mark.parametrize("surface", ["flat", "pn"])
def test_roots_by_area_and_levels_are_the_twins(gpu, surface):
    mesh = lumpy()
    fur = Strands(4, 3, roots=5000, seed=9, surface=surface,
                  maps=Maps(density=of_vertices(mesh), length=random((6, 3)), stiffness=random(80)),
                  comb=Comb(lambda p, n: np.cross(n, (0, 1, 0)), 0.3))
    close(gpu, mesh, fur)


def test_a_run_of_faces_gives_the_same_bits(gpu):
    """As one part of several does: its own triangles, numbers of strands and rows of arrays."""
    mesh = lumpy()
    fur = Strands(3, 3, maps=Maps(density=random(80), length=of_vertices(mesh), width=random((4, 4))), seed=4)
    planes = skin.planes(mesh, fur.maps, None)
    made = []
    for faces in (0, 80), (31, 59):
        surface = tessellate.tessellate(gpu, mesh, 3, 3, "pn", faces)
        first, roots = strands.roots_of(gpu, surface, fur)
        made.append((first, maps.traits(gpu, surface, roots, planes, faces, 0.0, fur.seed, first).get()))
    (_, whole), (first, part) = made
    assert first == 31 * 13 and len(part) == 28 * 13
    np.testing.assert_array_equal(part, whole[first:first + len(part)])


@pytest.mark.small
def test_without_a_map_a_factor_is_one(gpu):
    found = close(gpu, lumpy(), Strands(2, 2, maps=Maps()))
    assert (found["scale"] == 1).all() and (found["tuft"] == (1, 1, 0, 0)).all() and (found["comb"] == 0).all()


@pytest.mark.small
def test_tiles_are_chosen_by_the_triangle_and_end_at_their_border(gpu):
    """Of uv -1.7 to 1.7 only those of 1001, 1002 and 1012 have a picture; elsewhere a map says 1, a direction none."""
    tiles = {1012: random((3, 5)), 1001: random((4, 4), 2), 1002: random((1, 2), 3)}
    ways = {1001: random((3, 3, 3)) * 2 - 1}
    found = close(gpu, lumpy(), Strands(5, 5, maps=Maps(width=tiles), comb=Comb(ways)))
    assert 0.4 < (found["scale"][:, 1] == 1).mean() < 0.9
    assert 0.7 < (found["comb"][:, :3] == 0).all(1).mean() < 0.95


def test_a_tile_is_the_whole_picture_of_a_mesh_that_lies_within_it(gpu):
    """uv moved to tile 1023, but for what a picture repeats at its border."""
    picture, mesh = random((8, 8)), square(4)
    moved = clfur.Mesh(mesh.positions, uv=mesh.uv + (2, 2), faces=mesh.faces)
    fur = Strands(4, 4, maps=Maps(length=picture))
    one, _ = traits_of(gpu, mesh, fur)
    other, _ = traits_of(gpu, moved, attrs.evolve(fur, maps=Maps(length={1023: picture})))
    inner = (np.abs(root_places(gpu, mesh, fur) - 0.5) < 0.5 - 1 / 16).all(1)
    assert inner.sum() > 400
    np.testing.assert_allclose(one["scale"][inner], other["scale"][inner], atol=VALUE)


def root_places(gpu, mesh, fur):
    """x and z of the roots, [n, 2]."""
    grown = clfur.grow(clfur.Scene(mesh, attrs.evolve(fur, maps=None)), gpu)
    return grown.points[np.cumsum(grown.counts) - grown.counts][:, [0, 2]]


# --- laws -----------------------------------------------------------------------------------------------


def grown(gpu, mesh, fur):
    """{number of a strand: its points [n, 3]} of those that stand."""
    scene = clfur.Scene(mesh, fur)
    curves = clfur.grow(scene, gpu)
    return np.split(curves.points, np.cumsum(curves.counts)[:-1])


def test_as_many_strands_stand_as_the_density_adds_up_to(gpu):
    """The share of a picture's mean, within 4 sigma of as many coins."""
    n, picture = 40_000, random((16, 16))**2
    found, _ = traits_of(gpu, square(), Strands(1, 1, roots=n, surface="flat", maps=Maps(density=picture)))
    there = (found["scale"][:, 0] > 0).sum()
    mean = picture.mean()   # the bilinear mean of a picture that repeats is its own
    assert abs(there - n * mean) < 4 * math.sqrt(n * mean * (1 - mean))


def test_more_density_only_adds_strands(gpu):
    fur = {}
    for density in (0.0, 0.3, 0.5, 1.0):
        found, _ = traits_of(gpu, square(), Strands(1, 1, roots=3000, maps=Maps(density=[[density]])))
        fur[density] = found["scale"][:, 0]
    assert not fur[0.0].any() and fur[1.0].all()
    assert ((fur[0.3] > 0) <= (fur[0.5] > 0)).all() and (fur[0.3] > 0).sum() < (fur[0.5] > 0).sum()


@pytest.mark.parametrize("rule, near", [({"force_weight": 1}, 0), ({"stiffness": .6}, 2e-6)])
def test_strands_that_stand_are_the_same_without_the_others(gpu, rule, near):
    """By the law they grow in more steps where there are maps, which could make hair softer."""
    mesh, plain = lumpy(), Strands(3, 3, types=HairType(segments=4, curl=(0.02, 2), length_variation=0.5, **rule))
    points = np.array(grown(gpu, mesh, plain))
    there = traits_of(gpu, mesh, attrs.evolve(plain, maps=Maps(density=[[0.5]])))[0]["scale"][:, 0] > 0
    some = [each for each in grown(gpu, mesh, attrs.evolve(plain, maps=Maps(density=[[0.5]]))) if len(each)]
    np.testing.assert_allclose(np.array(some), points[there], rtol=0, atol=near)


def test_where_the_length_is_none_nothing_stands(gpu):
    mesh = lumpy()
    short = [each for each in grown(gpu, mesh, Strands(3, 3, maps=Maps(length=np.arange(80) % 2))) if len(each)]
    assert len(short) == 80 * 13 // 2


def test_maps_of_ones_change_no_bit_of_the_picture(gpu):
    mesh, plain = lumpy(), Strands(3, 3, types=HairType(force_weight=1, curl=(0.02, 2), color_variation=0.3))
    ones = Maps(**{name: np.ones((2, 2)) for name in NAMES})
    one, other = (clfur.draw(clfur.Scene(mesh, attrs.evolve(plain, maps=each), clfur.Camera(size=(60, 45))), gpu,
                             hashes=True).hashes for each in (None, ones))
    assert one == other


def test_longer_and_wider_strands_are_within_the_bounds(gpu):
    mesh = lumpy()
    fur = Strands(3, 3, types=HairType(segments=4, segment_length=.1, force_weight=0),
                  maps=Maps(length=3 * random((4, 4)), width=[[9.0]], curl=[[2.0]]))
    curves = clfur.grow(clfur.Scene(mesh, fur), gpu)
    center, radius = clfur.scene.extent(mesh, fur)
    far = np.linalg.norm(curves.points - center, axis=1).max()
    plain = clfur.scene.extent(mesh, attrs.evolve(fur, maps=None))[1]
    assert plain < far < radius
    np.testing.assert_allclose(curves.width.max(), 9 * .002, rtol=1e-6)


def test_hair_is_combed_along_the_skin(gpu):
    """With weight 1 a strand's first segment lies on the skin, and goes where the direction points."""
    fur = Strands(1, 1, types=HairType(segments=1, force_weight=0), surface="flat", comb=Comb((1, 5, 0), 1))
    for each in grown(gpu, square(3), fur):
        np.testing.assert_allclose((each[1] - each[0]) / .02, (1, 0, 0), atol=1e-5)


@pytest.mark.parametrize("uv", [((1, 0), (0, 1)), ((0, 2), (-1, 0)), ((-1, 0), (0, 1)), ((1, .5), (0, 1))])
def test_a_picture_combs_along_u_and_v(gpu, uv):
    """Whichever way uv lies on the square, turned, mirrored or slanted: uv of a step there is the colour's way."""
    mesh, to_uv = square(3), np.array(uv, float)
    mesh = clfur.Mesh(mesh.positions, uv=(mesh.positions[:, [0, 2]] @ to_uv), faces=mesh.faces)
    way = np.array([255, 255, 0], np.uint8)
    fur = Strands(1, 1, types=HairType(segments=1, force_weight=0), surface="flat", comb=Comb(way[None, None], 1))
    for each in grown(gpu, mesh, fur):
        step = (each[1] - each[0])[[0, 2]] @ to_uv
        np.testing.assert_allclose(step / np.abs(step).max(), (1, 1), atol=1e-4)


# --- numbering ------------------------------------------------------------------------------------------


def test_numbers_go_by_the_mesh_as_it_was_given(gpu):
    """With a vertex that no face uses, two at one place with other values, a face without area and one given twice."""
    positions = [(9, 9, 9), (0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0), (0, 0, 1)]
    faces = [(1, 1, 2), (1, 3, 2), (3, 1, 2), (5, 6, 4)]
    mesh = clfur.Mesh(positions, normals=np.tile((0, 1, 0), (7, 1)), faces=faces)
    assert mesh.kept_faces.tolist() == [1, 3] and (mesh.numbering.vertices, mesh.numbering.faces) == (7, 4)
    planes = skin.planes(mesh, Maps(width=np.arange(7.0), length=[0.0, 1, 2, 3]), None)
    assert planes[3].tolist() == [[1, 3, 2], [5, 6, 4]] and planes[2].tolist() == [1, 3]


def test_faces_that_have_no_area_in_a_pose_keep_their_numbers(gpu):
    rest = square(2)
    flat = rest.positions.copy()
    flat[4] = flat[0]
    mesh = clfur.Mesh(flat, uv=rest.uv, normals=np.tile((0, 1, 0), (9, 1)), faces=rest.faces)
    assert len(mesh.faces) < len(rest.faces)
    fur = Strands(2, 2, rest=rest, maps=Maps(length=np.arange(9.0), width=np.arange(8.0)))
    scene = clfur.Scene(mesh, fur)
    one, other = (skin.planes(each, fur.maps, None) for each in (scene.mesh, rest))
    np.testing.assert_array_equal(one[2], other[2])
    np.testing.assert_array_equal(one[3], other[3])


# --- what is refused ------------------------------------------------------------------------------------


@pytest.mark.parametrize("make, words", [
    (lambda: Maps(density=[[1.5]]), ["Maps.density[0, 0] is 1.5", "0 to 1"]),
    (lambda: Maps(length=[[-1.0]]), ["Maps.length[0, 0] is -1", "0 to 16"]),
    (lambda: Maps(width=[[math.nan]]), ["Maps.width[0, 0] is nan"]),
    (lambda: Maps(curl=np.zeros((2, 2, 2))), ["Maps.curl", "grey picture"]),
    (lambda: Maps(curl=np.eye(3)[None]), ["Maps.curl", "this one has colours"]),
    (lambda: Maps(clump={}), ["Maps.clump", "UDIM"]),
    (lambda: Maps(clump={1000: [[1]]}), ["Maps.clump", "1001 to 9999"]),
    (lambda: Maps(clump={1001: [1]}), ["Maps.clump[1001]", "grey picture"]),
    (lambda: Maps(density="a.png"), ["Maps.density is 'a.png'"]),
    (lambda: Maps(density={"corner": [1.0]}), ["Maps.density", "vertex"]),
    (lambda: Maps(density={"vertex": [[1.0]]}), ["Maps.density", "vertex"]),
    (lambda: Comb((1, 0)), ["Comb.direction", "[3]"]),
    (lambda: Comb((1, 0, math.inf)), ["Comb.direction[2] is inf"]),
    (lambda: Comb((1, 0, 0), 2), ["Comb.weight is 2"]),
    (lambda: Comb([[[2.0, 0, 0]]]), ["Comb.direction[0, 0, 0] is 2", "-1 to 1"]),
    (lambda: clfur.Scene(lumpy(), Strands(maps=Maps(length=np.ones(41)))), ["Maps.length has 41", "72", "80"]),
    (lambda: clfur.Scene(lumpy(), Strands(maps=Maps(length={"face": np.ones(42)}))), ["Maps.length has 42", "80, one"]),
    (lambda: clfur.Scene(lumpy(), Strands(comb=Comb(np.ones((80, 3))))), ["Comb.direction has 80", "72"]),
    (lambda: clfur.Scene(lumpy(), Strands(comb=Comb(lambda p, n: p[:5]))), ["Comb.direction's result", "[42, 3]"]),
    (lambda: clfur.Scene(lumpy(), Strands(comb=Comb(lambda p: p))), ["Comb.direction raises TypeError"]),
    (lambda: clfur.Scene(lumpy(), Strands(comb=Comb(lambda p, n: p / 0))), ["Comb.direction's result[0, 0]"]),
    (lambda: clfur.Scene(bare(), Strands(maps=Maps(width=[[1.0]]))), ["Maps.width is a picture", "uv"]),
    (lambda: clfur.Scene(bare(), Strands(comb=Comb([[[1.0, 0, 0]]]))), ["Comb.direction is a picture", "uv"]),
])
def test_what_does_not_fit_is_one_line(make, words):
    with pytest.raises(clfur.Error) as error, np.errstate(all="ignore"):
        make()
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


def bare():
    return clfur.Mesh(*icosphere(1)[:1], faces=icosphere(1)[1])


def test_an_array_as_long_as_both_is_asked_about():
    tetrahedron = clfur.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
                             faces=[(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    with pytest.raises(clfur.Error, match="as many as the mesh has vertices and faces; allowed: {\"vertex\""):
        clfur.Scene(tetrahedron, Strands(maps=Maps(length=np.arange(4.0))))
    of = [skin.planes(tetrahedron, Maps(length={per: np.arange(4.0)}), None)[2].ndim for per in ("vertex", "face")]
    assert of == [2, 1]


# --- type maps ------------------------------------------------------------------------------------------


RED, GREEN = HairType(key=(255, 0, 0)), HairType(key=(0, 255, 0), segments=2)


def test_a_type_map_takes_the_nearest_key_and_counts():
    soft = np.stack([np.linspace(255, 0, 11), np.linspace(0, 255, 11), np.zeros(11)], 1).astype(np.uint8)[None]
    fur = Strands(types=[RED, GREEN], type_map=soft)
    assert fur.type_indices.tolist() == [[0] * 6 + [1] * 5] or fur.type_indices.tolist() == [[0] * 5 + [1] * 6]
    assert fur.inexact == 9
    assert Strands(types=[RED, GREEN], type_map=soft[:, [0, 10]]).inexact == 0


def test_jpeg_and_blends_of_three_are_near_enough():
    import io

    from PIL import Image
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32, :, 0] = picture[32:, :32, 1] = picture[32:, 32:, 2] = 255
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=75)
    stored = np.asarray(Image.open(file))
    fur = Strands(types=[RED, GREEN, HairType(key=(0, 0, 255))], type_map=stored)
    right = np.argmax(picture, 2)
    assert (fur.type_indices != right).mean() < 0.03 and fur.inexact > 0
    mixed = np.array([[(85, 85, 85)]], np.uint8)
    assert Strands(types=[RED, GREEN, HairType(key=(0, 0, 255))], type_map=mixed).inexact == 1


@pytest.mark.parametrize("color", [(255, 255, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0)])
def test_colours_that_no_brush_mixes_are_refused(color):
    with pytest.raises(clfur.Error, match=re.escape(f"no type's key: {color}; allowed: (255, 0, 0)")):
        Strands(types=[RED, GREEN], type_map=np.array([[color, (255, 0, 0)]], np.uint8))


def test_types_and_colours_have_tiles(gpu):
    """Tile 1001 is of the second type and blue, 1002 of the first in its own colour, as there is none."""
    blue = np.array([[(0, 0, 255)]], np.uint8)
    types = [attrs.evolve(RED, color=(1, 1, 1), color_texture={1001: blue}),
             attrs.evolve(GREEN, color=(1, 1, 1), color_texture={1001: blue})]
    fur = Strands(2, 2, types=types, type_map={1001: np.array([[(0, 255, 0)]], np.uint8)})
    curves = clfur.grow(clfur.Scene(square(4, u=2.0), fur), gpu)
    roots = curves.points[np.cumsum(curves.counts) - curves.counts]
    left = roots[:, 0] < 0.5
    assert (curves.counts[left] == 3).all() and (curves.counts[~left] == 9).all() and 0.4 < left.mean() < 0.6
    np.testing.assert_array_equal(curves.color[left], np.tile(np.float32((0, 0, 1)), (left.sum(), 1)))
    np.testing.assert_array_equal(curves.color[~left], np.ones(((~left).sum(), 3), np.float32))


# --- frames ---------------------------------------------------------------------------------------------


def painted(mesh, n=2000, **fields):
    comb = Comb(lambda p, n: np.cross(n, (0, 1, 0)), 0.6)
    maps = Maps(density=random((8, 8)), length=of_vertices(mesh), width=random((4, 4), 5), curl=random(80))
    return Strands(4, 4, types=HairType(segments=5, segment_length=.05, width=.01, curl=(.02, 1)), roots=n, maps=maps,
                   comb=comb, **fields)


def test_parts_bands_and_teams_give_the_same_bits(gpu, another):
    mesh = lumpy()
    scene = clfur.Scene(mesh, painted(mesh, 20_000), clfur.Camera(size=(64, 48)))
    settings = clfur.Settings(grid=16, shadow_map=32)
    whole = clfur.draw(scene, gpu, settings, hashes=True)
    little = another(memory=3 << 20)
    assert len(Plan(Rig.of(scene, settings), ("color",)).parts(little)) > 1
    small = clfur.draw(scene, little, settings, hashes=True)
    team = clfur.draw(scene, [another(), another()], settings, hashes=True)
    assert whole.hashes == small.hashes == team.hashes


def test_strands_read_back_draw_the_same_picture(gpu):
    """Those that do not stand are left out, so that ids are others."""
    scene = clfur.Scene(lumpy(), painted(lumpy()), clfur.Camera(size=(64, 48)))
    curves = clfur.grow(scene, gpu)
    one, other = (clfur.render(each, gpu) for each in (scene, attrs.evolve(scene, fur=curves)))
    np.testing.assert_array_equal(one, other)


def test_the_truth_has_the_same_strands(gpu):
    mesh = lumpy()
    scene = clfur.Scene(mesh, painted(mesh), clfur.Camera(size=(48, 36)))
    fibres, _ = geometry_of(scene)
    curves = clfur.grow(scene, gpu)
    np.testing.assert_array_equal(fibres.counts, curves.counts)
    np.testing.assert_allclose(fibres.points[:, :3], curves.points, atol=2e-5)
    thick = np.broadcast_to(curves.width, len(curves.counts)) if len(curves.width) == len(curves.counts) else None
    widths = np.repeat(thick, curves.counts) if thick is not None else curves.width
    np.testing.assert_allclose(fibres.points[:, 3], widths, atol=1e-7)


def test_a_comb_is_asked_in_the_world_however_far_that_is(gpu):
    mesh, seen = lumpy(), []
    away = clfur.Mesh(mesh.positions + np.float64(1e6), uv=mesh.uv, faces=mesh.faces)
    for each in mesh, away:
        fur = attrs.evolve(painted(each), comb=Comb(lambda p, n: seen.append(p.mean(0)) or np.cross(n, (0, 1, 0))))
        clfur.grow(clfur.Scene(each, fur), gpu)
    np.testing.assert_allclose(seen[0] + 1e6, seen[-1], atol=1e-3)
