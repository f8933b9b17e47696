"""Strands belong to the skin: what moves the skin, or tells a strand in other words, changes nothing else."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.color import linear_to_srgb
from clfur.judge import truth
from clfur.judge.geometry import geometry_of
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig
from clfur.twin import strands as twin

STRAIGHT = clfur.HairType(segments=1, segment_length=.1, force_weight=0)
WILD = {"direction_variation": .4, "length_variation": .3, "curl": (.02, 2), "wave": (.01, 2)}
QUICK = clfur.Settings(grid=16, shadow_map=64)


def lumpy(level=1):
    """A closed mesh without symmetry; the uv tell the face, and the place in it."""
    positions, faces = icosphere(level)
    faces = np.unique(positions, axis=0, return_inverse=True)[1].reshape(-1)[faces]
    positions = np.unique(positions, axis=0)
    x, y, z = positions.T
    uv = np.arange(len(faces))[:, None, None] % (16, 1) // 1 + np.array([(0, 0), (.5, 0), (0, .5)])
    return clfur.Mesh(positions * (1 + .2 * np.sin(5 * x + 1) * np.cos(4 * y - 3 * z))[:, None], uv=uv, faces=faces)


def posed(mesh, places):
    return clfur.Mesh(places, uv=mesh.uv, faces=mesh.faces)


def swayed(mesh, t):
    """The mesh as it sways about y = 0, by so much."""
    x, y, z = mesh.positions.T.astype(float)
    return posed(mesh, np.stack([x + t * y**2, y, z + t * np.sin(3 * y)], 1))


def poses(mesh):
    stretched = posed(mesh, mesh.positions * (1, 1.15, 1))
    touching = mesh.positions.copy()
    touching[np.abs(touching - touching[0]).sum(1).argmax()] = touching[0]   # two vertices at one place
    return swayed(mesh, .01), swayed(mesh, .3), stretched, posed(mesh, touching)


def hair_on(mesh, **options):
    return clfur.Scene(mesh, clfur.Strands(**{"types": STRAIGHT, "roots": 3000, "inner": 2, "outer": 2, **options}),
                       clfur.Camera(eye=(.3, .5, 2.9), size=(64, 48)))


# --- roots in every pose --------------------------------------------------------------------------------


@pytest.mark.parametrize("surface", ["flat", "pn"])
def test_every_strand_keeps_its_place_on_its_face(gpu, surface):
    """The uv of a root are of its face and of where it is in it, whatever the pose: all of them are the same bits."""
    mesh = lumpy()
    for seed in 0, 7:
        options = {"surface": surface, "seed": seed}
        at_rest = clfur.grow(hair_on(mesh, **options), gpu)
        for pose in poses(mesh):
            there = clfur.grow(hair_on(pose, rest=mesh, **options), gpu)
            np.testing.assert_array_equal(there.root_uv, at_rest.root_uv)
            assert (there.points != at_rest.points).any()
        moved = clfur.grow(hair_on(poses(mesh)[2], **options), gpu).root_uv != at_rest.root_uv
        assert moved.any(1).mean() > .3   # planted: without a rest they leave


def test_a_place_on_a_flat_face_moves_as_its_corners(gpu):
    mesh = lumpy()
    for pose in poses(mesh)[:3]:
        grown = clfur.grow(hair_on(pose, rest=mesh, surface="flat"), gpu)
        of = clfur.grow(hair_on(mesh, surface="flat"), gpu)
        corners = mesh.positions.astype(float)[mesh.faces]
        # The face of each root: the one in whose plane and corners it lies at rest.
        root = of.points[::2].astype(float)
        weights = np.linalg.solve(corners.transpose(0, 2, 1)[None], np.broadcast_to(
            root[:, None, :, None], (len(root), len(corners), 3, 1)))[..., 0]
        face = np.where((weights > -1e-5).all(2), np.abs(weights.sum(2) - 1), np.inf).argmin(1)
        weight = weights[np.arange(len(root)), face]
        expected = np.einsum("nc,ncx->nx", weight, pose.positions.astype(float)[mesh.faces][face])
        np.testing.assert_allclose(grown.points[::2], expected, rtol=0, atol=2e-6)


def test_also_in_parts_and_for_a_team(gpu, another):
    mesh = lumpy()
    pose = swayed(mesh, .3)
    scene = hair_on(pose, rest=mesh, types=clfur.HairType(segments=4, segment_length=.03, width=.01), inner=12,
                    outer=12)
    small = another(2_000_000)
    parts = Plan(Rig.of(scene, QUICK), ("color",)).parts(small)
    assert len({part.faces for part in parts}) > 1
    whole, cut, shared = (clfur.draw(scene, device, QUICK, hashes=True)
                          for device in (gpu, small, [gpu, another(None)]))
    np.testing.assert_array_equal(cut.images["color"], whole.images["color"])
    np.testing.assert_array_equal(shared.images["color"], whole.images["color"])
    assert cut.hashes == whole.hashes and small.peak <= 2_000_000


def test_the_truth_knows_the_rest(gpu):
    mesh = lumpy()
    pose = swayed(mesh, .3)
    scene = hair_on(pose, rest=mesh, roots=500)
    hair, _ = geometry_of(scene)
    np.testing.assert_allclose(hair.points[:, :3], clfur.grow(scene, gpu).points, rtol=0, atol=2e-6)


def collapsed(mesh):
    """Places of the mesh in poses in which faces have no area, or no normal."""
    point, line, cap = (mesh.positions.astype(float) for _ in range(3))
    a, b, c = mesh.faces[5]
    point[[a, b, c]] = point[[a, b, c]].mean(0)
    line[c] = line[a]
    cap[cap[:, 1] > .4] = (.1, .5, .2)                # many vertices inside
    flat = mesh.positions * (1, 0, 1)                 # the normals of an edge cancel
    tube = cap.copy()
    high = np.flatnonzero(mesh.positions[:, 1] > .4)
    tube[high] = np.linspace((.1, .5, .2), (.1, 1.5, .2), len(high))   # a line that no other face reaches
    return {"to a point": point, "to a line": line, "a cap to a point": cap, "a cap to a line": tube,
            "to a plane": flat}


@pytest.mark.parametrize("how", ["to a point", "to a line", "a cap to a point", "a cap to a line", "to a plane"])
@pytest.mark.parametrize("roots", [3000, "faces"])
def test_faces_without_area_keep_their_strands(gpu, how, roots):
    """They stand where the face has shrunk to, as its corners' normals, or their neighbours', point; no other moves."""
    mesh = lumpy()
    pose = posed(mesh, collapsed(mesh)[how])
    assert len(pose.faces) < len(mesh.faces)
    scene, at_rest = (hair_on(each, rest=mesh, roots=roots, surface="flat") for each in (pose, mesh))
    assert scene.mesh is hair_on(pose, rest=mesh).mesh and len(scene.mesh.faces) == len(mesh.faces)
    np.testing.assert_array_equal(scene.mesh.kept_faces, mesh.kept_faces)
    np.testing.assert_array_equal(np.linalg.norm(scene.mesh.normals, axis=1).round(5), 1)
    grown, resting = clfur.grow(scene, gpu), clfur.grow(at_rest, gpu)
    np.testing.assert_array_equal(grown.root_uv, resting.root_uv)
    points = grown.points.reshape(-1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(points[:, 1] - points[:, 0], axis=1), .1, rtol=1e-5)
    settings = attrs.evolve(QUICK, samples=1)
    outputs = ("color", "depth", "normal", "tangent", "coverage")
    image = clfur.draw(scene, gpu, settings, outputs).images
    assert np.isfinite(image["color"]).all() and image["coverage"].sum() > 100
    for name in outputs[2:]:
        assert np.isfinite(image[name][image["coverage"] > 0]).all(), name


def test_where_faces_without_area_stand(gpu):
    """Strands of a face that has become a line stand on it; those of all others where they stand without it."""
    mesh = lumpy()
    places = collapsed(mesh)["to a line"]
    a, b, _ = mesh.faces[5]
    scene = hair_on(posed(mesh, places), rest=mesh, roots="faces", inner=1, outer=1, surface="flat")
    roots = clfur.grow(scene, gpu).points.reshape(-1, 2, 3)[:, 0]
    np.testing.assert_allclose(roots, places[mesh.faces].mean(1), atol=1e-6)
    along = (roots[5] - places[a]) / (places[b] - places[a])
    np.testing.assert_allclose(along, along.mean(), atol=1e-4)


def test_the_truth_of_faces_without_area(gpu):
    mesh = lumpy()
    pose = posed(mesh, collapsed(mesh)["a cap to a line"])
    scene = hair_on(pose, rest=mesh, roots=500, types=clfur.HairType(segments=1, segment_length=.1, width=.02))
    small = attrs.evolve(scene, camera=clfur.Camera(eye=(.3, .5, 2.9), size=(24, 18)))
    right = truth.picture(small, 4)
    drawn = clfur.render(small, gpu, clfur.Settings(samples=16))
    assert np.isfinite(right).all() and abs(drawn[..., 3].mean() - right[..., 3].mean()) < .01


def test_a_mesh_is_its_own_rest(gpu):
    mesh = lumpy()
    copy = posed(mesh, mesh.positions)
    for fur in {}, {"roots": "faces"}:
        one, own, other = (clfur.grow(hair_on(mesh, rest=rest, **fur), gpu) for rest in (None, mesh, copy))
        np.testing.assert_array_equal(one.points, own.points)
        np.testing.assert_array_equal(one.points, other.points)


def test_another_mesh_is_no_rest():
    mesh = lumpy()
    rng = np.random.default_rng(1)
    for faces, said in ((mesh.faces[:-1], "80 faces and Scene.mesh 79: face 79 of Strands.rest"),
                        (np.roll(mesh.faces, 1, 1), "another vertex than Scene.mesh at corner 0 of face 0"),
                        (rng.permutation(mesh.faces), "another vertex than Scene.mesh at corner")):
        with pytest.raises(clfur.Error, match=said):
            hair_on(clfur.Mesh(mesh.positions, faces=faces), rest=mesh)
    fallen = posed(mesh, collapsed(mesh)["to a point"])
    with pytest.raises(clfur.Error, match="face 5 of Scene.mesh is none that Strands.rest has kept"):
        hair_on(mesh, rest=fallen)   # what has no area at rest has no roots
    with pytest.raises(clfur.Error, match="Strands.rest is 3; allowed: an object of class Mesh or None"):
        clfur.Strands(rest=3)


# --- the world turned -----------------------------------------------------------------------------------


def turned(seed):
    """A rotation: about an axis by 90 degrees, all axes in turn, or any."""
    if seed < 2:
        return np.array(([(0, -1, 0), (1, 0, 0), (0, 0, 1)], [(0, 0, 1), (1, 0, 0), (0, 1, 0)])[seed], float)
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return q * np.linalg.det(q)


def furred(r, t, roots, hair):
    """Lumpy with fur, all of it turned and moved."""
    mesh = lumpy()
    there = clfur.Mesh(mesh.positions @ r.T + t, mesh.normals @ r.T, mesh.uv, mesh.faces)
    force = clfur.PointForce(r @ (1, 1, .5) + t, .4)
    fur = clfur.Strands(types=clfur.HairType(segments=8, segment_length=.03, width=.02, force_weight=.2, **hair),
                        roots=roots, inner=2, outer=2, force=r @ (0, -1, .3), point_forces=force, seed=4, rest=mesh)
    camera = clfur.Camera(eye=r @ (.5, .7, 2.9) + t, target=t, up=r @ (0, 1, 0), size=(64, 48))
    return clfur.Scene(there, fur, camera, clfur.Light(direction=r @ (-1, -1, -.4)))


NOT = np.eye(3), np.zeros(3)
TURNS = [(turned(seed), t) for seed, t in enumerate(np.array([(0, 0, 0), (0, 0, 0), (0, 0, 0), (1, 2, -.5)]))]


@pytest.mark.parametrize("roots", ["faces", 1500])
def test_strands_turn_with_the_world(gpu, roots):
    """Rounding places of 3 to float32 is 2.4e-7; over 8 segments, lengths of sides and curls some 1e-6."""
    grown = clfur.grow(furred(*NOT, roots, WILD), gpu).points
    for r, t in TURNS:
        there = clfur.grow(furred(r, t, roots, WILD), gpu)
        back = (there.points.astype(float) + there.origin - t) @ r
        np.testing.assert_allclose(back, grown, rtol=0, atol=1e-5)
        assert np.abs(there.points - grown).max() > .5


def rms(a, b):
    a, b = (np.dstack([linear_to_srgb(each[..., :3]), each[..., 3]]) for each in (a, b))
    return np.sqrt(((a - b)**2).mean())


def test_pictures_turn_with_the_world(gpu):
    """Without shadows, whose grid has axes of the world; and with them no more than fur without anything random."""
    off = clfur.Settings(shadows="off", shadow_map=0)
    for r, t in TURNS:
        wild, plain = ([[clfur.render(furred(*each, 1500, hair), gpu, settings) for each in (NOT, (r, t))]
                        for settings in (off, QUICK)] for hair in (WILD, {}))
        assert rms(*wild[0]) < 1e-5
        assert rms(*wild[1]) < 2 * rms(*plain[1]) + 1e-5


def test_directions_are_spread_as_before():
    """A cube about the normal, which is as wide in all directions as one about the world's axes: its second moments."""
    up = twin.unit_or(np.random.default_rng(0).normal(size=(20_000, 3)), 0)
    corners = np.random.default_rng(1).normal(size=(20_000, 3, 3))
    frame = twin.frames(corners, up)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape), atol=1e-12)
    lean = np.einsum("na,nax->nx", twin.signed(twin.random3(np.arange(20_000), 3, 3)), frame)
    assert np.abs(lean.mean(0)).max() < 4 / np.sqrt(3 * 20_000)
    np.testing.assert_allclose(np.cov(lean.T), np.eye(3) / 3, atol=.01)
    ahead = twin.unit_or(up + .5 * lean, up)
    old = twin.unit_or(up + .5 * twin.signed(twin.random3(np.arange(20_000), 3, 3)), up)
    tilt, tilt_before = ((each * up).sum(1) for each in (ahead, old))
    assert abs(tilt.mean() - tilt_before.mean()) < .01 and abs(tilt.std() - tilt_before.std()) < .01


def test_a_triangle_seen_along_its_first_side_still_has_a_frame():
    up = np.array([(0, 1.0, 0)])
    for corners in ([(0, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 0, 0), (1e-9, 0, 0), (0, 0, 1)], [(0, 0, 0)] * 3):
        frame, = twin.frames(np.array([corners], float), up)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    around = np.random.default_rng(2).normal(size=(1, 3, 3))
    around[0, 1] = around[0, 0] + 3 * up[0]
    r = turned(5)
    np.testing.assert_allclose(twin.frames(around @ r.T, up @ r.T)[0] @ r, twin.frames(around, up)[0], atol=1e-9)


# --- points in straight segments ------------------------------------------------------------------------


def whiskers(seed, segments, bend, strands):
    """Random polylines that leave a ball, float64 [strands, segments + 1, 3], as float32 has them."""
    rng = np.random.default_rng(seed)
    ahead = twin.unit_or(rng.normal(size=(strands, 3)), 0)
    points = [.7 * ahead]
    for _ in range(segments):
        points.append(points[-1] + ahead * .4 / segments)
        ahead = twin.unit_or(ahead + bend * rng.normal(size=ahead.shape), 0)
    return np.stack(points, 1).astype(np.float32).astype(float)


def told_by_more(points, seed):
    """The same polylines with a point more in a random segment of each."""
    rng = np.random.default_rng(seed)
    strand, (n, count, _) = np.arange(len(points)), points.shape
    k, t = rng.integers(0, count - 1, n), rng.uniform(.2, .8, (n, 1))
    more = points[strand, k] * (1 - t) + points[strand, k + 1] * t
    at = np.arange(count + 1)[None] - (np.arange(count + 1)[None] > k[:, None])
    longer = points[strand[:, None], at]
    longer[strand, k + 1] = more
    return longer


def drawn(gpu, points, settings):
    fur = clfur.Curves(points, width=.01, color=(.8, .5, .3))
    scene = clfur.Scene(None, fur, clfur.Camera(eye=(0, .4, 3.2), size=(96, 72)), clfur.Light(direction=(-1, -1, -.6)))
    return clfur.render(scene, gpu, settings, ("color", "coverage"))


@pytest.mark.parametrize("segments, bend", [(1, 0), (2, 0), (3, 0), (4, 0), (6, 0), (8, .05)])
def test_a_point_in_a_straight_segment_is_hardly_seen(gpu, segments, bend):
    """Light is known at places along segments, and tangents run from point to point, so it differs a little:
    less than .002 for strands that bend by 3 degrees at most [.0018].  A piece of a ribbon in a pixel has one width,
    and at most eight strands are told apart there: few areas differ, by less than 1e-4 rms [5e-5]."""
    for seed in range(3):
        points = whiskers(seed, segments, bend, 600)
        one, more = (drawn(gpu, each, clfur.Settings()) for each in (points, told_by_more(points, seed)))
        colors = (linear_to_srgb(each["color"][..., :3]) for each in (one, more))
        assert np.sqrt((np.subtract(*colors)**2).mean()) < .002
        assert np.sqrt(((one["coverage"] - more["coverage"])**2).mean()) < 1e-4
        assert (one["coverage"] > 0).mean() > .1 and (one["coverage"] != more["coverage"]).any()


@pytest.mark.parametrize("segments", [1, 2])
def test_straight_strands_of_few_segments_are_lit_as_of_many(gpu, sphere, segments):
    """Dense fur is dark at its roots and bright at its tips; along a segment light is that of each place where it
    crosses two cells of a light's grid [.0028].  With transmittances of the ends alone: .025, .012, and too bright."""
    def coat(n):
        hair = clfur.HairType(segments=n, segment_length=.16 / n, force_weight=0, width=.01)
        scene = clfur.Scene(sphere, clfur.Strands(roots=12_000, types=[hair]), clfur.Camera(size=(96, 72)))
        return linear_to_srgb(clfur.render(scene, gpu)[..., :3])
    wrong = coat(segments) - coat(32)
    assert np.sqrt((wrong**2).mean()) < .0035 and np.abs(wrong.mean()) < 3e-4
