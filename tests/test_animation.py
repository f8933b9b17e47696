"""Files that move: animations of glTF against values worked out by hand, and against trimesh and trigonometry."""

import time
import warnings

import numpy as np
import pytest
from support.gltf import File

import clfur

TRIANGLE = np.float32([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
HALF = 0.5**0.5
TURNS = [(0, 0, 0, 1), (0, 0, HALF, HALF), (0, 0, 1, 0)]   # none, a quarter and half a turn about z


def moving(node=None, channels=(), positions=TRIANGLE, targets=(), faces=None, animation=None):
    """A File of one mesh by node 0. channels: (path, times, values, interpolation, dtype) of it."""
    file = File()
    more = {"targets": [{name: file.accessor(np.float32(each)) for name, each in target.items()} for target in targets]}
    indices = None if faces is None else file.accessor(np.reshape(faces, (-1, 1)), np.uint32)
    mesh = file.mesh({"POSITION": file.accessor(np.float32(positions))}, indices, **(more if targets else {}))
    file.add("nodes", **({"mesh": mesh} | (node or {})))
    animate(file, [(0, *channel) for channel in channels], **(animation or {}))
    return file


def animate(file, channels, **more):
    """An animation of channels (node, path, times, values[, interpolation[, dtype]])."""
    told, samplers = [], []
    for node, path, times, values, *kind in channels:
        interpolation, dtype = *kind, *("LINEAR", np.float32)[len(kind):]
        values = np.asarray(values, dtype).reshape(-1, {"rotation": 4, "weights": 1}.get(path, 3))
        normal = {} if np.dtype(dtype).kind == "f" else {"normalized": True}
        told.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        samplers.append({"input": file.accessor(np.float32(times)[:, None]), "output": file.accessor(values, **normal),
                         "interpolation": interpolation})
    file.add("animations", channels=told, samplers=samplers, **more)


@pytest.fixture
def load(tmp_path):
    def of_file(file, name=None):
        (tmp_path / "x.glb").write_bytes(file.glb() if isinstance(file, File) else file)
        return clfur.load_animation(tmp_path / "x.glb", name)
    return of_file


def at(animation, seconds):
    """The first face's corners."""
    mesh = animation(seconds)
    return (mesh.positions[mesh.faces[0]] + mesh.origin).astype(float)


# --- keyframes ---


@pytest.mark.parametrize("seconds, linear, step", [(-1, 0, 0), (1, 0, 0), (1.5, 1, 0), (2, 2, 2), (3, 3, 2), (4, 4, 4),
                                                   (9, 4, 4)])
def test_translation(load, seconds, linear, step):
    """Straight between keyframes 1, 2 and 4, or in steps; it stays before the first and after the last."""
    for kind, wanted in ("LINEAR", linear), ("STEP", step):
        walk = load(moving(channels=[("translation", [1, 2, 4], [(0, 0, 0), (2, 0, 0), (4, 0, 0)], kind)]))
        assert walk.duration == 4 and walk.fps is None
        np.testing.assert_allclose(at(walk, seconds), TRIANGLE + (wanted, 0, 0), atol=1e-6)


def test_rotation_goes_the_short_way_at_even_speed(load):
    for turns in TURNS, [TURNS[0], tuple(-np.array(TURNS[1])), TURNS[2]]:   # q and -q are one turn
        spin = load(moving(channels=[("rotation", [0, 1, 2], turns)]))
        for seconds in 0, .25, 1 / 3, .5, 1, 1.7, 2:
            angle = seconds * np.pi / 2
            np.testing.assert_allclose(at(spin, seconds)[1], (np.cos(angle), np.sin(angle), 0), atol=1e-6)
    still = load(moving(channels=[("rotation", [0, 1], [(0, 0, 0, 1), (0, 0, 0, 1)])]))
    np.testing.assert_allclose(at(still, .5), TRIANGLE, atol=1e-7)


@pytest.mark.parametrize("dtype, one", [(np.int8, 127), (np.int16, 32767), (np.float32, 1)])
def test_turns_of_normalized_integers(load, dtype, one):
    spin = load(moving(channels=[("rotation", [0, 1], np.round(np.array(TURNS)[[0, 2]] * one), "LINEAR", dtype)]))
    np.testing.assert_allclose(at(spin, .5)[1], (0, 1, 0), atol=1e-6)


def test_cubic_splines(load):
    """The cube of time is Hermite's own cubic: t³ - t through its values and tangents. Turns become of length one."""
    times = np.array([0.5, 1, 3])
    values = np.stack([times * 0, times**3 - times, times * 0], 1)
    tangents = np.stack([times * 0, 3 * times**2 - 1, times * 0], 1)
    keys = np.stack([tangents, values, tangents], 1)
    walk = load(moving(channels=[("translation", times, keys, "CUBICSPLINE")]))
    for seconds in .5, .6, .9, 1, 1.3, 2.9, 3:
        np.testing.assert_allclose(at(walk, seconds)[0], (0, seconds**3 - seconds, 0), atol=2e-6)
    flat = np.zeros((2, 3, 4))
    flat[:, 1] = TURNS[0], TURNS[1]
    spin = load(moving(channels=[("rotation", [0, 1], flat, "CUBICSPLINE")]))
    angle = 2 * np.arctan2(HALF / 2, (1 + HALF) / 2)   # half way between both, by a spline without slopes
    np.testing.assert_allclose(at(spin, .5)[1], (np.cos(angle), np.sin(angle), 0), atol=1e-6)


def test_a_tree_of_nodes(load, tmp_path):
    """A child goes with its parent's turn and scale; trimesh, given the same local matrices, puts it there too."""
    import trimesh

    file = moving(node={"translation": [2, 0, 0]})
    file.tree["animations"].clear()
    file.add("nodes", children=[0], scale=[1, 2, 1])
    file.tree["nodes"][0]["rotation"] = [HALF, 0, 0, HALF]
    animate(file, [(1, "rotation", [0, 1], [TURNS[0], TURNS[1]]), (1, "scale", [0, 1], [(1, 2, 1), (3, 2, 1)]),
                   (0, "translation", [0, 2], [(2, 0, 0), (2, 4, 0)])])
    walk = load(file)
    for seconds in 0, .5, 1, 2:
        share = min(seconds, 1)
        angle = share * np.pi / 4
        still = moving(node={"translation": [2, 2 * seconds, 0], "rotation": [HALF, 0, 0, HALF]})
        del still.tree["animations"]
        still.add("nodes", children=[0], scale=[1 + 2 * share, 2, 1], rotation=[0, 0, np.sin(angle), np.cos(angle)])
        (tmp_path / "y.glb").write_bytes(still.glb())
        other = trimesh.load(tmp_path / "y.glb").to_geometry()
        np.testing.assert_allclose(at(walk, seconds), other.triangles[0], atol=1e-6)


# --- skins and morph targets ---


def bar(joints=3, rows=9, **more):
    """A File of a bar along y by so many joints, one above the other, each held by two of them; the second turns about
    z by 90 degrees in a second. Its own node stands elsewhere, which has no say."""
    file = File()
    y = np.linspace(0, joints - 1, rows)
    positions = np.stack([np.stack([x + 0 * y, y, 0 * y], 1) for x in (-.25, .25)], 1).reshape(-1, 3)
    k = np.arange(0, 2 * rows - 2, 2)
    faces = np.concatenate([np.stack([k, k + 1, k + 2], 1), np.stack([k + 1, k + 3, k + 2], 1)])
    below = np.minimum(positions[:, 1].astype(int), joints - 2)
    share = positions[:, 1] - below
    held = np.stack([below, below + 1, 0 * below, 0 * below], 1)
    weights = np.stack([1 - share, share, 0 * share, 0 * share], 1)
    bind = np.tile(np.eye(4), (joints, 1, 1))
    bind[:, 3, 1] = -np.arange(joints)   # by columns
    attributes = {"POSITION": file.accessor(np.float32(positions)), "JOINTS_0": file.accessor(held, np.uint8),
                  "WEIGHTS_0": file.accessor(np.float32(weights))} | {
        name: file.accessor(np.float32(values)) for name, values in more.items()}
    mesh = file.mesh(attributes, file.accessor(faces.reshape(-1, 1), np.uint16))
    for joint in range(joints):
        file.add("nodes", translation=[0, int(joint > 0), 0], **(
            {"children": [joint + 1]} if joint + 1 < joints else {}))
    file.add("skins", joints=list(range(joints)), inverseBindMatrices=file.accessor(np.float32(bind).reshape(-1, 16)))
    file.add("nodes", mesh=mesh, skin=0, translation=[7, 7, 7])
    animate(file, [(1, "rotation", [0, 1], TURNS[:2])], name="bend")
    return file, positions, held, weights


def bent(positions, held, weights, angle):
    """Where the bar's vertices are by hand: linear blends of what joint 0, and joint 1 with joint 2, do."""
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turned = (positions - (0, 1, 0)) @ turn.T + (0, 1, 0)
    each = np.stack([positions, turned, turned])
    return (weights[:, :2, None] * np.stack([each[held[:, k], np.arange(len(positions))] for k in (0, 1)], 1)).sum(1)


def test_a_skinned_bar_bends(load):
    file, positions, held, weights = bar()
    bend = load(file, "bend")
    assert bend.names == ("bend",)
    for seconds in 0, .3, 1:
        found = bend(seconds)
        np.testing.assert_allclose(found.positions, bent(positions, held, weights, seconds * np.pi / 2), atol=1e-6)
        assert np.abs(found.normals - (0, 0, 1)).max() < 1e-6
    assert np.abs(bend(1).positions[-1] - (-1, 1.25, 0)).max() < 1e-6   # it lies along -x


def test_all_sets_of_joints_have_a_say(load):
    """The same weights, half of each in a second set."""
    file, positions, held, weights = bar(WEIGHTS_1=[[0] * 4] * 18)
    primitive = file.tree["meshes"][0]["primitives"][0]["attributes"]
    half = file.accessor(np.float32(weights / 2))
    primitive |= {"WEIGHTS_0": half, "WEIGHTS_1": half, "JOINTS_1": primitive["JOINTS_0"]}
    np.testing.assert_allclose(load(file)(.6).positions, bent(positions, held, weights, .3 * np.pi), atol=1e-6)


def test_normals_that_are_given_turn_with_the_joints(load):
    lean = np.tile([(0, .6, .8)], (18, 1))
    file, *_ = bar(NORMAL=lean)
    normals = load(file)(1).normals
    np.testing.assert_allclose(normals[:2], lean[:2], atol=1e-6)
    np.testing.assert_allclose(normals[-2:], [(-.6, 0, .8)] * 2, atol=1e-6)


@pytest.mark.parametrize("kind", ["plain", "sparse", "spline"])
def test_morph_targets(load, kind):
    up, wide = np.float32([(0, 0, 0), (0, 0, 0), (0, 1, 0)]), np.float32([(0, 0, 0), (2, 0, 0), (0, 0, 0)])
    keys = [(0, 0), (1, 0), (.5, 1)]
    if kind == "spline":
        flat = np.zeros((3, 3, 2))
        flat[:, 1] = keys
        keys = flat
    file = moving(channels=[("weights", [0, 1, 2], keys, "CUBICSPLINE" if kind == "spline" else "LINEAR")],
                  targets=[{"POSITION": up}, {"POSITION": wide}])
    if kind == "sparse":
        targets = file.tree["meshes"][0]["primitives"][0]["targets"]
        targets[1]["POSITION"] = file.describe(np.float32, 3, 3, sparse=file.sparse([1], wide[1:2]))
    talk = load(file)
    for seconds, (one, other) in (0, (0, 0)), (.5, (.5, 0)), (1, (1, 0)), (1.5, (.75, .5)), (5, (.5, 1)):
        np.testing.assert_allclose(at(talk, seconds), TRIANGLE + one * up + other * wide, atol=1e-6)


def test_morph_targets_of_normals_and_weights_as_bytes(load):
    file = moving(channels=[("weights", [0, 1], [0, 255], "LINEAR", np.uint8)],
                  targets=[{"NORMAL": [(1, 0, -1)] * 3}])
    attributes = file.tree["meshes"][0]["primitives"][0]["attributes"]
    attributes["NORMAL"] = file.accessor(np.float32([(0, 0, 1)] * 3))
    talk = load(file)
    for seconds in 0, .5, 1:
        wanted = np.array((seconds, 0, 1 - seconds)) / np.hypot(seconds, 1 - seconds)
        np.testing.assert_allclose(talk(seconds).normals, [wanted] * 3, atol=1e-6)


# --- meshes of one topology ---


def test_as_in_rest(load, tmp_path):
    """Faces, uv and numbering are those of `load_mesh`, to the bit; so hair that is rooted there goes along."""
    file, *_ = bar(TEXCOORD_0=np.random.default_rng(0).random((18, 2)))
    bend = load(file)
    rest = clfur.load_mesh(tmp_path / "x.glb")
    start, now = bend(0), bend(1)
    for name in "positions", "normals":
        np.testing.assert_allclose(getattr(start, name), getattr(rest, name), atol=1e-6)
    for name in "faces", "uv", "kept_faces":
        np.testing.assert_array_equal(getattr(now, name), getattr(rest, name))
    assert now.numbering is start.numbering and now.numbering.vertices == rest.numbering.vertices
    assert bend(1) is now and bend(0) is not start   # asked again, the very same: what is drawn from it is kept
    clfur.Scene(mesh=now, fur=clfur.Strands(roots=9, rest=rest))


def test_lips_that_are_closed_can_open(load, tmp_path):
    """Vertices that touch in rest are one, unless they part at some time; hair's other vertices stay welded."""
    y = np.float32([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 1, 0), (1, 1, 0), (0, 2, 0), (1, 2, 0),
                    (1, 0, 0), (2, 0, 0), (1, 1, 0)])
    faces = [(0, 1, 2), (2, 1, 3), (4, 5, 6), (6, 5, 7), (8, 9, 10)]
    opened = np.zeros((11, 3), np.float32)
    opened[4:8, 1] = 1
    talk = load(moving(channels=[("weights", [0, 1], [0, 1])], positions=y, targets=[{"POSITION": opened}],
                       faces=faces))
    assert len(talk(0).positions) == 9   # of 11: 8 is 1, 10 is 3; the lips, 4 and 5, are not 2 and 3
    wide = talk(1)
    np.testing.assert_allclose(wide.positions[wide.faces], (y + opened)[np.array(faces)], atol=1e-6)
    for rest in talk(0), clfur.load_mesh(tmp_path / "x.glb"):   # which has 7
        clfur.Scene(mesh=wide, fur=clfur.Strands(roots=9, rest=rest))
    assert len(rest.positions) == 7


def test_a_frame_of_fifty_thousand_vertices(load):
    """Is far from slow: the median is some 15 ms here."""
    file, *_ = bar(joints=40, rows=25_000)
    bend, taken = load(file), []
    for k in range(5):
        begin = time.process_time()
        bend(.1 + k / 7)
        taken.append(time.process_time() - begin)
    assert len(bend(0).positions) == 50_000 and np.median(taken) < .5


def test_hair_moves_with_a_skin(gpu, load):
    file, *_ = bar()
    bend = load(file)

    def scene(seconds):
        fur = clfur.Strands(roots=20, types=clfur.HairType(length=.2, width=.01))
        return clfur.Scene(mesh=bend(seconds), fur=fur, camera=clfur.Camera(size=(16, 12)))
    motion = clfur.Motion(scene, device=gpu, fps=8)
    found = motion.at(8).strands.on_host
    far = np.abs(found.points.reshape(20, -1, 3)[:, 0] + found.origin)
    assert far[:, 0].max() > .5 and (far[:, 2] < 1e-4).all()   # roots lie on the bent bar


# --- what is refused, and what is left out ---


def spoiled(change):
    file = moving(channels=[("translation", [0, 1], [(0, 0, 0), (1, 0, 0)])], animation={"name": "walk"})
    change(file.tree, file)
    return file


@pytest.mark.parametrize("change, words", [
    (lambda tree, file: tree.pop("animations"), "has no animation; allowed: files with one"),
    (lambda tree, file: tree["animations"][0].update(channels=[]), "animations[0] moves nothing"),
    (lambda tree, file: tree["animations"][0]["channels"].append(tree["animations"][0]["channels"][0]),
     "animations[0].channels[1] moves the translation of nodes[0] again"),
    (lambda tree, file: tree["animations"][0]["channels"][0].update(sampler=3),
     "animations[0].channels[0].sampler is 3; allowed: less than 1"),
    (lambda tree, file: tree["animations"][0]["channels"][0]["target"].update(node=9),
     "animations[0].channels[0].target.node is 9"),
    (lambda tree, file: tree["animations"][0]["samplers"][0].update(interpolation="CUBIC"),
     "samplers[0].interpolation is 'CUBIC'; allowed: LINEAR, STEP, CUBICSPLINE"),
    (lambda tree, file: tree["animations"][0]["samplers"][0].update(interpolation="CUBICSPLINE"),
     "samplers[0].output has 2 elements; allowed: 6, as its 2 keyframes of translation need"),
    (lambda tree, file: tree["animations"][0]["samplers"][0].update(input=file.accessor(np.float32([[1], [0]]))),
     "samplers[0].input has 2 times that are not finite or do not rise"),
    (lambda tree, file: tree["animations"][0]["samplers"][0].update(output=file.accessor(np.float32([[np.nan] * 3] * 2))
                                                                    ),
     "samplers[0].output has numbers that are not finite"),
    (lambda tree, file: tree["animations"][0]["samplers"][0].update(output=99), "accessors"),
    (lambda tree, file: tree["nodes"][0].update(matrix=np.eye(4).ravel().tolist()),
     "nodes[0] has a matrix and is animated"),
])
def test_wrong_files(load, change, words):
    with pytest.raises(clfur.Error) as caught:
        load(spoiled(change))
    assert words in str(caught.value) and "x.glb: " in str(caught.value) and "\n" not in str(caught.value)


def test_names(load, tmp_path):
    file = moving(channels=[("translation", [0, 1], [(0, 0, 0), (1, 0, 0)])], animation={"name": "walk"})
    animate(file, [(0, "translation", [0, 2], [(0, 0, 0), (0, 8, 0)])])
    assert load(file).duration == load(file, "walk").duration == load(file, 0).duration == 1
    assert load(file, 1).duration == 2 and load(file).names == ("walk", None)
    for name in "run", 2, -1, True, 1.0:
        with pytest.raises(clfur.Error, match="has no animation .*; allowed: None, 0 to 1, 'walk'"):
            load(file, name)
    for path, words in (3, "load_animation path is 3"), (tmp_path / "x.obj", "has no animations; allowed: .glb"), (
            tmp_path / "no.glb", "no such file"):
        with pytest.raises(clfur.Error, match=words):
            clfur.load_animation(path)
    with pytest.raises(clfur.Error, match="seconds is 'x'"):
        load(file)("x")


def test_what_is_left_out_is_told(load):
    file = moving(channels=[("translation", [0, 1], [(0, 0, 0), (1, 0, 0)])])
    channels = file.tree["animations"][0]["channels"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(file)
    channels.append({"sampler": 0, "target": {"path": "pointer", "extensions": {"KHR_animation_pointer": {}}}})
    channels.append({"sampler": 0, "target": {"path": "translation"}})   # of no node: to be passed over
    with pytest.warns(UserWarning, match=r"x.glb: left out: what moves 'pointer' \(animations\[0\].channels\[1\]\)"):
        assert at(load(file), 1)[0, 0] == 1
