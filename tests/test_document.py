"""What is viewed: changes by path, undo, listeners, motion."""

import threading

import attrs
import numpy as np
import pytest
from support.devices import DEVICES

import clfur
from clfur.viewer.changes import changed, found
from clfur.viewer.document import TOGETHER, Document, MeshFile, Moving
from clfur.viewer.playing import LONGEST
from clfur.viewer.sections import without
from clfur.viewer.shades import switched_on

LENGTH = "scene", "strands", "types", 0, "length"
STRANDS = "scene", "strands"
COLOR = "scene", "strands", "types", 0, "color"
SHELLS = clfur.Shells(length=.05, hairs=100)


class Clock:
    """A clock that goes on when it is told to."""

    now = 0.0

    def __call__(self):
        return self.now


def furred(**fields):
    mesh = clfur.load_mesh("sphere")
    return clfur.Scene(mesh=mesh, **{"fur": clfur.Strands(roots=60, types=clfur.HairType(length=.4)), **fields})


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def document(clock):
    return Document(furred(), clock=clock)


def test_what_is_switched_is_told(document):
    heard = []
    document.subscribe(lambda: heard.append(document.version))
    document.switch(("scene", "ground"), True, lambda state: clfur.Ground())
    document.switch(("scene", "ground"), True, lambda state: clfur.Ground())   # it is there
    document.switch(("scene", "ground"), False, lambda state: clfur.Ground())
    assert heard == [1, 2]


ROOT, TIP = ((*COLOR[:-1], name) for name in ("root_color", "tip_color"))


def ends(document):
    kind, = document.scene.strands.types
    return [None if each is None else each.tolist() for each in (kind.root_color, kind.tip_color)]


def dyed(**fields):
    kind = clfur.HairType(**{"color": (.4, .2, .1), "root_color": (.2, .05, .05), "tip_color": (.7, .6, .55), **fields})
    return Document(furred(fur=clfur.Strands(roots=60, types=kind)))


def test_root_and_tip_go_with_the_colour_until_they_are_chosen():
    """Darker channels as shares of the light, lighter ones of what is missing to white; also by way of black, and
    back."""
    document = dyed()
    document.set(COLOR, (.1, .5, .2))
    assert ends(document) == [pytest.approx([.05, .125, .1]), pytest.approx([.55, .75, .6])]
    for color in ((0, 0, 0), (1, 1, 1), (3, 0, 1), (.4, .2, .1)):
        document.set(COLOR, color)
    assert ends(document) == [pytest.approx([.2, .05, .05]), pytest.approx([.7, .6, .55])]
    document.set(ROOT, (0, 0, 1))
    document.set(COLOR, (.1, .5, .2))
    assert ends(document) == [[0, 0, 1], pytest.approx([.55, .75, .6])]
    while document.undo():
        pass
    document.set(COLOR, (.1, .5, .2))   # nobody has chosen it any more
    assert ends(document)[0] == pytest.approx([.05, .125, .1])
    assert document.undo() and ends(document) == [[.2, .05, .05], [.7, .6, .55]] and not document.can_undo
    document = dyed(root_color=None, tip_color=None)
    document.set(COLOR, (.1, .5, .2))
    assert ends(document) == [None, None]


def test_another_coats_root_is_nobodys_choice():
    """Though that of the one before was chosen; and what was known of its colour does not count."""
    document = dyed()
    document.set(ROOT, (0, 0, 1))
    document.set(COLOR, (.1, .5, .2))
    document.set(("scene", "strands"), dyed(root_color=(.04, .02, .01)).scene.strands)
    document.set(COLOR, (1, 1, 1))
    assert ends(document)[0] == pytest.approx([.1, .1, .1])


def test_a_choice_goes_with_its_hair_type():
    """Not to one that takes its number, or to another coat; it is there when hair is switched off and on."""
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[0] = 255
    brown, green = (clfur.HairType(color=color, key=key) for color, key in (
        ((.4, .2, .1), (0, 0, 0)), ((.1, .5, .1), (255, 255, 255))))
    document = Document(furred(fur=clfur.Strands(roots=60, types=[brown, green], type_map=picture)))
    document.set(ROOT, (0, 0, 1))
    document.set(ROOT, None)

    def root():
        value, chosen = switched_on(document.state, ROOT, (.05, .25, .05))
        return [*value], chosen
    usual = [.05, .25, .05], False
    assert root() == ([0, 0, 1], True)
    document.set(STRANDS, without(document.scene.strands, 0))
    assert root() == usual
    document.undo()
    document.set(STRANDS, without(document.scene.strands, 1))
    document.switch(STRANDS, False, None)
    document.set(("scene", "ground"), clfur.Ground())
    document.switch(STRANDS, True, None)
    assert root() == ([0, 0, 1], True)
    for scene in (furred(), furred(fur=SHELLS)):
        document.change(scene=scene)
    document.set(STRANDS, furred().strands)
    assert root() == usual


def test_root_and_tip_go_with_the_colour_at_all_times():
    """Of a scene that is a function of seconds, too."""
    scene = dyed().scene
    document = Document(lambda seconds: scene)
    document.set(COLOR, (.1, .5, .2))
    kind, = document.state.at(2.0).strands.types
    assert kind.root_color == pytest.approx([.05, .125, .1])


def test_a_change_is_another_scene_with_all_else_the_same(document):
    before = document.scene
    assert document.set(LENGTH, .5) and document.scene.strands.types[0].length == .5
    assert before.strands.types[0].length == .4 and document.scene.mesh is before.mesh
    assert document.scene.camera is before.camera and document.scene.light is before.light
    assert not document.set(LENGTH, .5) and not document.set(COLOR, [.8, .6, .4])
    assert not document.set(("settings",), clfur.Settings())


@pytest.mark.parametrize("path, value", [
    (("strands", "types", 0, "curl"), (.1, 3.0)), (("strands", "force"), (0, -2, 0)), (("strands",), None),
    (("shells", "density"), .5), (("lights",), (clfur.Light(), clfur.Light(intensity=.5))),
    (("lights", 0, "color"), (1, .5, .25)), (("strands", "types", 0, "look", "exponent"), 40.0),
    (("strands", "types", 0, "look"), clfur.Chiang()), (("environment",), clfur.Environment()),
    (("strands", "types", 0, "curl", 1), 4.0), (("body_color",), (.1, .2, .3))])
def test_all_that_stands_in_a_scene_can_be_set(path, value):
    scene = furred(fur=[SHELLS, clfur.Strands(types=clfur.HairType(specular=.2, exponent=9))])
    after = found(changed(scene, path, value), path)
    assert after == value if isinstance(value, (clfur.Chiang, tuple)) and path[-1] not in (
        "force", "color", "body_color") else after is value or np.allclose(after, value)


def test_what_does_not_fit_changes_nothing(document):
    before, version = document.state, document.version
    for path, value in [(LENGTH, -1.0), (LENGTH[:-1] + ("segments",), 1.5), (("scene", "strands", "speed"), 1),
                        (("scene", "strands", "types", 3, "length"), 1), (("scene", "strands", "segment_length"), .1),
                        (("settings", "masks"), 3), (("scene", "strands"), SHELLS), (("scene",), 3)]:
        with pytest.raises(clfur.Error):
            document.set(path, value)
    with pytest.raises(clfur.Error, match="raster 'coverage'"):   # fields that only fit together
        assert document.set(("settings", "raster"), "samples") and document.set(("settings", "masks"), 4)
    assert document.undo() and document.state is before and not document.can_undo and document.version > version


def test_undo_goes_back_and_forth_to_the_very_same(document, clock):
    states = [document.state]
    for n, length in enumerate((.1, .2, .3)):
        clock.now = 10.0 * n
        document.set(LENGTH, length)
        states.append(document.state)
    for state in reversed(states[:-1]):
        assert document.undo() and document.state is state
    assert not document.undo() and document.redo() and document.state is states[1]
    document.set(COLOR, (1, 0, 0))
    assert not document.can_redo and document.undo() and document.state is states[1]


def test_undo_holds_no_more_than_so_many_bytes(document, clock, monkeypatch):
    """Of files and arrays, each counted once; the last step is there in any case."""
    monkeypatch.setattr("clfur.viewer.document.BYTES", 1_000_000)
    mesh = document.scene.mesh

    def steps():
        count = 0
        while document.undo():
            count += 1
        return count
    for _ in range(20):
        document.change(mesh_file=MeshFile(mesh, data=bytes(300_000)))
    assert steps() == 3   # two files of the steps, and the mesh
    held = bytes(400_000)
    for _ in range(20):
        document.change(mesh_file=MeshFile(mesh, data=held))
    assert steps() == 20
    for n in range(3):
        document.set(("scene", "environment"), clfur.Environment(np.full((300, 600, 3), n / 4, np.float32)))
    assert steps() == 1


def test_a_slider_that_is_dragged_is_one_step(document, clock):
    before = document.state
    for n in range(20):
        clock.now += .9 * TOGETHER
        document.set(LENGTH, .1 + n / 100)
    document.set(COLOR, (1, 0, 0))
    document.set(LENGTH, .9)
    assert document.undo() and document.scene.strands.types[0].length == pytest.approx(.29)
    assert document.undo() and document.undo() and document.state is before
    document.set(LENGTH, .5)
    clock.now += 2 * TOGETHER
    document.set(LENGTH, .6)
    assert document.undo() and document.scene.strands.types[0].length == .5


def test_a_part_that_is_switched_off_comes_back_as_it_was(document, clock):
    def never(state):
        raise AssertionError("made anew")
    parts = {("scene", "strands"): document.scene.strands, ("scene", "shells"): SHELLS,
             ("scene", "environment"): clfur.Environment((.1, .2, .3)), ("scene", "ground"): clfur.Ground(height=-2.0),
             ("motion",): Moving(units_per_metre=3.0), (*LENGTH[:-1], "tufts"): clfur.Tufts(density=8.0)}
    for path, part in parts.items():
        document.set(path, part)
    for path in parts:   # hair, with its tufts, is back when these are switched
        part = found(document.state, path)
        for on in (False, False, True, True):
            clock.now += 2 * TOGETHER
            document.switch(path, on, never)
            assert found(document.state, path) is (part if on else None)
    document.set(LENGTH, .5)
    document.switch(STRANDS, False, never)
    clock.now += 2 * TOGETHER
    document.switch(STRANDS, True, never)
    document.set(LENGTH, .6)
    document.switch(STRANDS, False, never)
    assert document.undo() and document.undo() and document.undo() and document.scene.strands is None
    assert document.switch(STRANDS, True, never) and document.scene.strands.types[0].length == .5


def test_a_part_that_is_switched_on_is_as_large_beside_another_mesh(document):
    document.set(("scene", "shells"), SHELLS)
    document.set(("scene", "ground"), clfur.Ground(height=-2.0))
    document.set(("motion",), Moving(units_per_metre=3.0))
    tufts = *LENGTH[:-1], "tufts"
    document.set(tufts, clfur.Tufts(density=8.0))
    order = [tufts, ("scene", "shells"), ("scene", "ground"), ("motion",)]
    for path in order:
        document.switch(path, False, None)
    mesh = document.scene.mesh
    twice = clfur.Mesh(2 * mesh.positions, mesh.normals, mesh.uv, mesh.faces)
    document.change(scene=attrs.evolve(document.scene, mesh=twice))
    for path in order:
        document.switch(path, True, None)
    scene = document.scene
    assert scene.shells.length == pytest.approx(.1) and scene.strands.types[0].tufts.density == pytest.approx(2)
    assert scene.ground.height is None and document.state.motion.units_per_metre == pytest.approx(6)


def test_large_arrays_are_the_very_same_after_a_change():
    """Undo would hold as many copies of a type map as there are steps, and a frame would look through it anew."""
    painted = np.zeros((256, 256, 3), np.uint8)
    painted[:, 128:] = 255
    scene = furred(fur=clfur.Strands(type_map=painted, types=[
        clfur.HairType(key=(0, 0, 0), color_texture=np.ones((200, 200, 3))), clfur.HairType(key=(255, 255, 255))]))
    document = Document(scene)
    document.set(LENGTH, .2)
    document.set(("scene", "strands", "seed"), 4)
    after = document.scene.strands
    assert after.type_map is scene.strands.type_map
    assert after.types[0].color_texture is scene.strands.types[0].color_texture
    document.set(("scene", "strands", "types", 0, "key"), (10, 10, 10))
    assert document.scene.strands.types[0].key == (10, 10, 10) and document.scene.strands.inexact == 128 * 256
    with pytest.raises(clfur.Error, match="distinct keys"):
        document.set(("scene", "strands", "types", 0, "key"), (255, 255, 255))


def test_everybody_hears_of_a_change_until_they_stop(document):
    heard = []
    end = document.subscribe(lambda: heard.append(document.version))
    document.set(LENGTH, .1)
    document.undo()
    assert len(heard) == 2 and heard == sorted(set(heard))
    end()
    end()
    document.redo()
    assert len(heard) == 2


def test_changes_of_many_threads_are_all_there(document):
    def change(n):
        for k in range(20):
            document.set(("settings", "pcf"), (n + k) % 16)
            document.set(("scene", "lights", 0, "intensity"), float(n * 100 + k))
            document.undo()
    threads = [threading.Thread(target=change, args=(n,)) for n in range(4)]
    heard = []
    document.subscribe(lambda: heard.append(1))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    while document.undo():
        pass
    assert heard and document.settings == clfur.Settings() and document.scene.lights[0].intensity == 1


def test_a_function_of_time_keeps_what_was_changed(clock):
    """And its mesh goes on to move."""
    fur, mesh = clfur.Strands(roots=50), clfur.load_mesh("sphere")

    def scene(seconds):
        return clfur.Scene(mesh=mesh, fur=fur, ground=clfur.Ground(height=-seconds - 1))
    document = Document(scene, clock=clock)
    document.set(LENGTH, .7)
    document.set(LENGTH, .8)
    document.set(("scene", "strands", "types"), clfur.HairType(length=.3))
    document.set(COLOR, (0, 0, 1))
    document.play()
    assert document.advance() and document.scene.ground.height == -1
    clock.now += .05
    assert document.advance() and document.scene.ground.height == -1.05
    kind, = document.scene.strands.types
    assert kind.length == .3 and kind.color.tolist() == [0, 0, 1]
    document.change(scene=furred())
    document.advance()
    assert document.scene is document.state.scene and not document.playing
    document.undo()
    document.play()
    clock.now += 5
    document.advance()
    clock.now += 5
    document.advance()
    assert document.scene.ground.height == pytest.approx(-1 - LONGEST)


@pytest.fixture(scope="module")
def device():
    return clfur.Scheduler(DEVICES[0])


def points(document):
    return document.scene.strands.on_host.points


def test_hair_moves_while_it_plays_and_comes_back_to_rest(document, clock, device):
    groom = document.scene
    with pytest.raises(clfur.Error, match="nothing of this scene can move"):
        Document(furred(fur=None)).play()
    document.play()
    assert document.playing and document.state.motion.units_per_metre == pytest.approx(4 * 3**.5, rel=.01)
    assert document.advance(device) and not document.advance(device)
    rest = points(document)
    clock.now += 10   # a closed lid is no gale
    assert document.advance(device) and document.time == pytest.approx(LONGEST)
    first = points(document)
    assert np.abs(first - rest).max() > 1e-4
    document.pause()
    clock.now += 1
    assert not document.advance(device) and np.array_equal(points(document), first)
    document.set(COLOR, (1, 0, 0))   # while it is held, hair stays where it is
    assert document.advance(device) and np.array_equal(points(document), first)
    assert (document.scene.strands.color == (1, 0, 0)).all()
    document.set(("scene", "lights", 0, "intensity"), .5)
    assert document.scene.lights[0].intensity == .5 and np.array_equal(points(document), first)
    document.set(("motion", "wind"), clfur.Wind((9, 0, 0)))
    document.play()
    document.advance(device)
    clock.now += .05
    document.advance(device)
    assert np.abs(points(document) - first).max() > 1e-4
    assert document.time == pytest.approx(LONGEST + .05)
    document.stop()
    assert document.time == 0 and document.scene.strands.types[0].length == .4
    while document.undo():
        pass
    assert document.scene is groom and document.state.motion is None


def test_other_hair_begins_anew(document, clock, device):
    document.play()
    document.advance(device)
    clock.now += .05
    document.advance(device)
    document.set(LENGTH, .6)
    document.advance(device)
    clock.now += .05
    assert document.advance(device) and document.time == pytest.approx(.05)
    lengths = np.linalg.norm(np.diff(points(document).reshape(-1, 9, 3), axis=1), axis=2).sum(1)
    assert lengths == pytest.approx(.6, rel=.01)   # not 0.4


def test_what_goes_wrong_while_it_plays_ends_it_with_a_line(clock, device):
    def scene(seconds):
        return furred(fur=None) if not seconds else 1 / 0
    for given, motion, said in [(scene, None, "ZeroDivisionError: division by zero"),
                                (furred(), Moving(hair=[clfur.HairMotion()] * 3), "Motion.hair has 3 HairMotions")]:
        document = Document(given, motion=motion, clock=clock)
        document.play()
        document.advance(device)
        clock.now += .05
        document.advance(device)
        assert not document.playing and document.problem.startswith(said) and document.scene is document.state.scene


def test_what_scene_files_set_as_motion():
    motion = {"hair": clfur.HairMotion(air=.1), "wind": None, "rate": 240, "hair_on_hair": None}
    made = Moving.of(motion)
    assert made.hair[0].air == .1 and made.rate == 240 and made.wind.gust == 0 and made.hair_on_hair is None
    assert clfur.Motion(furred(), **attrs.evolve(made, body=False).arguments).rate == 240


def test_who_hears_of_a_change_may_wait_for_who_asks(document):
    """No lock is held meanwhile: a page that opens holds one that the listener waits for."""
    answered = []

    def heard():
        thread = threading.Thread(target=lambda: document.scene, daemon=True)
        thread.start()
        thread.join(5)
        answered.append(not thread.is_alive())
    document.subscribe(heard)
    for change in (lambda: document.set(LENGTH, .1), document.undo, document.redo, document.play, document.pause,
                   document.stop, lambda: document.change(settings=clfur.Settings(samples=1))):
        change()
    assert answered == [True] * 7
