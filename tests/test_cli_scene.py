"""The scene and the settings that the commands' options describe; nothing is drawn."""

import attrs
import click
import numpy as np
import pytest
from support.command import wrong

from clfur import PRESETS, Chiang, Curves, Error, Kajiya, Settings, Shells, Strands, load_curves, load_mesh, save
from clfur.command.hair_types import groom_of, hair_types
from clfur.command.options import scene_options
from clfur.command.scenes import load_scene


@click.command()
@click.argument("given")
@scene_options
def described(given, **options):
    return load_scene(given, options)


def load(*arguments):
    """(Scene, Settings) of a command's arguments."""
    return described.main(list(map(str, arguments)), standalone_mode=False)


def radius():
    return load_mesh("teapot").bounds[1]


def test_strands_are_the_default():
    scene, settings = load("teapot")
    assert scene.shells is None and isinstance(scene.strands, Strands)
    hair, = scene.strands.types
    assert hair.full_length == pytest.approx(0.08 * radius())
    assert settings == Settings()


@pytest.mark.parametrize("length, width", [(1, .0012), (.02, .0012), (.01, .001), (.001, .0001)])
def test_strands_are_never_wider_than_a_tenth_of_their_length(length, width):
    """Both of the mesh's radius: else fur on a ground that is large covers all of the picture."""
    hair, = load("teapot", "--length", length * radius())[0].strands.types
    assert hair.width == pytest.approx(width * radius())


def test_a_body_and_a_ground():
    scene, _ = load("teapot")
    assert (scene.body, scene.ground) == ("drawn", None)
    scene, _ = load("teapot", "--body", "holdout", "--ground", "lowest")
    assert scene.body == "holdout" and scene.ground.height is None and scene.ground.color is None
    assert load("teapot", "--ground", 0)[0].ground.height == 0
    assert load("teapot", "--ground", -1.5)[0].ground.height == -1.5


def test_shells():
    scene, _ = load("teapot", "--fur", "shells")
    shells, plain = scene.shells, Shells()
    assert scene.strands is None and isinstance(shells, Shells)
    assert shells.length == pytest.approx(0.12 * radius()) and shells.hairs == 60_000
    assert shells.specular < plain.specular and shells.exponent < plain.exponent
    assert np.allclose(shells.force, (0, -0.8, 0))   # half of what 8 segments of strands bend
    assert np.array_equal(shells.color, (0.45, 0.2, 0.07))
    for name in ("layers", "pattern", "density", "noise", "time", "shading", "length_variation", "alpha", "seed",
                 "sharpness", "root_shade"):
        assert getattr(shells, name) == getattr(plain, name), name
    assert not shells.wind.any() and not shells.acceleration.any()


def test_options_of_shells():
    scene, _ = load(
        "sphere", "--fur", "shells", "--length", 0.25, "--layers", 7, "--frequency", 12.5, "--density", 0.75,
        "--wind", "1,2,-3", "--noise", "0,4", "--time", "-1.5", "--shading", "turned", "--color", "1,0,0.5",
        "--alpha", 0.125, "--variation", 0.0625, "--force", "2,0,-4", "--force-weight", 0.25, "--segments", 2,
        "--seed", 9)
    shells = scene.shells
    assert (shells.length, shells.layers, shells.frequency, shells.density) == (0.25, 7, 12.5, 0.75)
    assert (shells.noise, shells.time, shells.shading, shells.pattern) == ((0, 4), -1.5, "turned", "cells")
    assert (shells.alpha, shells.length_variation, shells.seed) == (0.125, 0.0625, 9)
    for name, vector in ("wind", (1, 2, -3)), ("color", (1, 0, 0.5)), ("force", (0.5, 0, -1)):
        assert np.array_equal(getattr(shells, name), vector)


def test_the_camera_sees_the_shells():
    """As far as the fur reaches, and no further."""
    away = [np.linalg.norm(scene.camera.eye - scene.camera.target) for scene, _ in (
        load("sphere", "--fur", "shells", "--length", length) for length in (0.1, 0.2, 0.4))]
    assert away[2] - away[1] == pytest.approx(2 * (away[1] - away[0])) and away[1] > away[0] + 0.1


def test_sine_has_the_reports_frequency(tmp_path):
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 5 0 0\nv 0 5 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    for given, frequency in ((), 40), (("--frequency", 25), 25):
        shells = load(tmp_path / "m.obj", "--fur", "shells", "--pattern", "sine", *given)[0].shells
        assert (shells.pattern, shells.frequency) == ("sine", frequency)


@pytest.mark.parametrize("given", [(), ("--length", 0.5)])
def test_both(given):
    """An undercoat, half as long as the strands, of the same colour and bent the same way."""
    scene, _ = load("teapot", "--fur", "both", *given, "--layers", 9, "--roots", 50, "--color", "0,1,0", "--seed", 3)
    hair, = scene.strands.types
    length = hair.full_length
    assert length == pytest.approx(given[1] if given else 0.08 * radius())
    assert scene.shells.length == pytest.approx(length / 2)
    assert (scene.shells.layers, scene.strands.roots) == (9, 50) and scene.strands.seed == scene.shells.seed == 3
    assert np.array_equal(scene.shells.color, hair.color) and np.array_equal(hair.color, (0, 1, 0))


def test_blur():
    for given, (blur, sigma) in {(): ("off", 1), ("--blur", "all"): ("all", 1),
                                 ("--blur", "edges", "--blur-sigma", 2.5): ("edges", 2.5)}.items():
        settings = load("sphere", *given)[1]
        assert (settings.blur, settings.blur_sigma, settings.filtered) == (blur, sigma, True)


def test_lod():
    assert load("sphere", "--shadow-map", 2048, "--pcf", 0)[1] == Settings(shadow_map=2048, pcf=0)
    assert [load("sphere", *given)[1].lod for given in ((), ("--lod", 0.5))] == [0, 0.5]


def test_preset():
    for name, settings in PRESETS.items():
        assert load("sphere", "--preset", name)[1] == settings
    beside = load("sphere", "--preset", "final", "--grid", 32, "--blur", "all")[1]
    assert beside == attrs.evolve(PRESETS["final"], grid=32, blur="all")
    assert load("sphere", "--grid", 96, "--preset", "final")[1].grid == 96   # also where it is the default's


def test_a_preset_that_the_scene_refuses():
    """The next below is taken, and told; options beside it still count."""
    with pytest.warns(UserWarning, match="^--preset reference: Settings.shadows is 'deep', but the scene has shells; "
                                         "drawn with 4 samples, coverage, shadow grid 32, masks 4, blur all$"):
        taken = load("sphere", "--fur", "both", "--preset", "reference", "--grid", 32, "--blur", "all")[1]
    assert taken == Settings(grid=32, masks=4, blur="all")
    beside = load("sphere", "--preset", "reference", "--scattering", "grid")[1]   # which no preset mends
    assert beside == attrs.evolve(PRESETS["reference"], scattering="grid")


STRANDS = {"--inner": 5, "--outer": 5, "--roots": "faces", "--surface": "pn", "--width": 0.1, "--type-map": "a.png",
           "--types": "a.json", "--curl": "0,0", "--look": "chiang", "--wave": "0,0", "--raster": "samples",
           "--lod": 0.5, "--tip-width": 1, "--root-color": "1,1,1", "--tip-color": "1,1,1", "--tufts": 9,
           "--frizz": "0,0", "--reach": 2,
           "--masks": 0, "--scattering": "off", "--hair": "a.npz", "--guides": "a.npz", "--parting": 30,
           "--map": "density=a.png", "--on": "head", "--comb": "0,-1,0", "--comb-weight": 0.5,
           "--collision": "on"}
SHELLS = {"--layers": 30, "--pattern": "cells", "--frequency": 40, "--hairs": 9, "--density": 1, "--noise": "0.5,8",
          "--shading": "turned"}
SHARED = {"--size": "9x9", "--fur": "both", "--length": 1, "--color": "1,1,1", "--alpha": 1, "--variation": 0,
          "--segments": 1, "--force": "0,0,0", "--force-weight": 1, "--stiffness": 2, "--seed": 1, "--eye": "9,9,9",
          "--target": "0,0,0", "--fov": 30, "--zoom": 2, "--light": "0,-1,0", "--shadows": "binary",
          "--grid": 16, "--samples": 1,
          "--shadow-map": 64, "--pcf": 0, "--wind": "1,0,0", "--time": 0,
          "--specular": "half-vector", "--blur": "all", "--blur-sigma": 2,
          "--preset": "draft", "--rest": "sphere", "--body": "holdout", "--body-color": "1,0,0", "--body-texture": "",
          "--ground": -1.5, "--view": "front", "--up": "z", "--sky": "1,1,1"}


def test_wind_bends_strands_too():
    """As far, at first, as shells of their length: by stiffness or by the report's rule; between gusts, and in them."""
    assert load("sphere")[0].strands.force == pytest.approx((0, -1, 0))
    options = "sphere", "--wind", "0.2,0,0.1", "--force", "0,0,0"
    by_law, by_rule = (load(*options, "--fur", "both", "--time", 0.25, *more)[0]
                       for more in (["--stiffness", 3], ["--force-weight", 0.1, "--segments", 5]))
    # In the middle of a sphere around 0 gusts are at their height after a quarter of a second.
    np.testing.assert_allclose(by_law.strands.force, (0.6, 0, 0.3), rtol=1e-6)
    np.testing.assert_allclose(by_rule.strands.force, (0.4, 0, 0.2), rtol=1e-6)
    assert (by_law.shells.wind == (0.2, 0, 0.1)).all()
    still = load(*options, "--time", 0.75, "--stiffness", 3)[0].strands.force
    np.testing.assert_allclose(still, np.multiply(0.4, (0.6, 0, 0.3)), rtol=1e-6)


def test_the_rule_of_growth(tmp_path):
    """Length and stiffness, unless --force-weight asks for the report's; each type may have its own."""
    kinds = [load("sphere", "--length", .4, "--segments", 16, *given)[0].strands.types[0] for given in (
        (), ("--stiffness", 2), ("--force-weight", .1))]
    assert [(kind.length, kind.stiffness) for kind in kinds] == [(.4, .625), (.4, 2), (None, None)]
    assert (kinds[2].segment_length, kinds[2].force_weight) == (.025, .1)
    forces = [load("sphere", "--fur", "shells", *given)[0].shells.force[1] for given in ((), ("--stiffness", 2))]
    assert forces == pytest.approx([-.8, -.25])
    (tmp_path / "types.json").write_text('[{"key": [0, 0, 0], "stiffness": 3}, {"key": [2, 2, 2], "segments": 8},'
                                         ' {"key": [1, 1, 1], "segment_length": 0.5}]')
    file = str(tmp_path / "types.json")
    save(tmp_path / "map.png", np.zeros((1, 1, 3)))
    beside = "--length", .4, "--types", file, "--type-map", tmp_path / "map.png"
    first, third, second = load("sphere", *beside)[0].strands.types
    assert (first.length, first.stiffness) == (.4, 3) and (third.length, third.stiffness) == (.4, .625)
    assert (second.segment_length, second.force_weight, second.length) == (.5, .2, None)
    first, third, second = load("sphere", *beside, "--force-weight", .3)[0].strands.types
    assert first.stiffness == 3 and (second.force_weight, third.force_weight, third.segment_length) == (.3, .3, .4 / 8)


def test_long_hair_slides_along_the_mesh():
    given = (), ("--length", .15), ("--length", .3), ("--length", .3, "--collision", "off"), ("--collision", "on")
    slides = [load("sphere", *options)[0].strands.collision for options in given]
    assert slides == [False, False, True, False, True]


def test_tufts(tmp_path):
    kind = load("sphere", "--tufts", "200:strength=.9,within=20", "--frizz", ".01,7")[0].strands.types[0]
    assert (kind.tufts.count, kind.tufts.strength, kind.tufts.within.count, kind.frizz) == (200, .9, 20, (.01, 7))
    usual = load("sphere")[0].strands.types[0].tufts
    assert (usual.count, usual.strength) == (4000, .5) and load("sphere", "--tufts", "off")[0].strands.types[
        0].tufts is None
    (tmp_path / "types.json").write_text('[{"tufts": {"density": 9, "profile": 0.2, "within": 5}, "frizz": [0.1, 3]}]')
    kind, = load("sphere", "--types", tmp_path / "types.json", "--tufts", 3)[0].strands.types
    assert (kind.tufts.density, kind.tufts.profile, kind.tufts.within.count, kind.frizz) == (9, .2, 5, (.1, 3))
    for given, words in {"x": "Tufts.count is 'x'", "3:size=2": "tufts have no 'size'; allowed: count, dens",
                         "3:strength=2": "Tufts.strength is 2", "3:strength=1,strength=0": "tufts have strength twice",
                         "2.5": "Tufts.count is 2.5"}.items():
        with pytest.raises(click.BadParameter, match=words):
            load("sphere", "--tufts", given)


def test_each_option_is_of_strands_or_of_shells_or_of_both():
    flags = [option.opts[0] for option in described.params if isinstance(option, click.Option)]
    assert sorted(flags) == sorted([*STRANDS, *SHELLS, *SHARED, "--camera"])   # of USD scenes alone
    for fur in ("strands", "shells"):
        alone = {"strands": STRANDS, "shells": SHELLS}[fur]
        for flag, value in ({**alone, **SHARED, "--fur": fur}).items():
            if flag not in ("--type-map", "--types", "--body-texture", "--hair", "--guides", "--parting", "--reach",
                            "--map", "--on", "--comb-weight", "--time"):
                load("sphere", "--fur", fur, "--blur", "all", flag, value)
    everything = {**STRANDS, **SHELLS, **SHARED}
    for flag in ("--type-map", "--types", "--body-texture", "--hair", "--view", "--force-weight", "--guides",
                 "--parting", "--reach", "--hairs", "--map", "--on"):   # eye, stiffness, frequency are too
        del everything[flag]
    load("sphere", *(part for option in everything.items() for part in option))


@pytest.mark.parametrize("fur, flag, value, other", [
    *[("strands", *option, "shells") for option in SHELLS.items()],
    *[("shells", *option, "strands") for option in STRANDS.items()]])
def test_options_of_other_fur(clfur, tmp_path, fur, flag, value, other):
    """Even with its default value, and before anything is loaded."""
    wrong(clfur("render", "missing.obj", "--fur", fur, flag, value, "-o", "a.png"),
          f"{flag} is for {other}, but --fur is {fur}; allowed: with --fur {other} or --fur both")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments, words", [
    (["--layers", "9"], ["--layers is for shells, but --fur is strands"]),
    (["--fur", "fluff"], ["--fur", "fluff", "shells"]),
    (["--fur", "shells", "--layers", "0"], ["--layers", "1000"]),
    (["--fur", "shells", "--layers", "1001"], ["--layers", "1000"]),
    (["--fur", "shells", "--frequency", "0"], ["--frequency"]),
    (["--fur", "shells", "--frequency", "nan"], ["--frequency", "'nan' is not a number above 0"]),
    (["--fur", "shells", "--density", "0"], ["--density"]),
    (["--fur", "shells", "--density", "1.5"], ["--density"]),
    (["--fur", "shells", "--noise", "1"], ["--noise", "2 numbers"]),
    (["--fur", "shells", "--noise", "1,0.5"], ["Shells.noise is (1.0, 0.5)", ">= 1"]),
    (["--fur", "shells", "--wind", "1,2"], ["--wind", "3 numbers"]),
    (["--fur", "shells", "--wind", "1,2,inf"], ["Shells.wind", "inf"]),
    (["--fur", "shells", "--time", "inf", "--wind", "1,0,0"], ["Shells.time is inf"]),
    (["--fur", "shells", "--length", "0"], ["Shells.length is 0.0"]),
    (["--fur", "shells", "--seed", "-1"], ["Shells.seed is -1"]),
    (["--fur", "shells", "--shading", "phong"], ["--shading", "turned"]),
    (["--fur", "shells", "--pattern", "hair"], ["--pattern", "sine"]),
    (["--fur", "shells", "--pattern", "sine"], ["Shells.pattern is 'sine'", "uv"]),
    (["--fur", "both", "--pattern", "sine"], ["Shells.pattern is 'sine'", "uv"]),
    (["--fur", "shells", "--pattern", "sine", "--variation", "1"], ["--variation is for --pattern cells"]),
    (["--raster", "area"], ["--raster", "'coverage', 'samples'"]),
    (["--lod", "-0.1"], ["--lod", "4"]),
    (["--shadow-map", "-1"], ["--shadow-map", "from 0 to 8192"]),
    (["--pcf", "17"], ["--pcf", "from 0 to 16"]),
    (["--masks", "2"], ["Settings.masks is 2", "0 or 4"]),
    (["--masks", "4", "--raster", "samples"], ["Settings.masks is 4", "Settings.raster is 'samples'"]),
    (["--color", "brown"], ["--color", "#rrggbb"]),
    (["--color", "255,128,0"], ["--color", "255,128,0", "0 to 1"]),
    (["--color", "0.5,-0.1,0"], ["--color", "0 to 1"]),
    (["--color", "nan,0,0"], ["--color", "0 to 1"]),
    (["--lod", "4.5"], ["--lod", "4"]),
    (["--blur", "some"], ["--blur", "edges"]),
    (["--fur", "shells", "--time", "1"], ["--time is the moment of the wind", "with --wind"]),
    (["--fur", "shells", "--hairs", "9", "--frequency", "9"], ["--hairs", "without --frequency; allowed: one of them"]),
    (["--fur", "both", "--hairs", "9", "--pattern", "sine"], ["--hairs is for --pattern cells"]),
    (["--look", "chiang", "--specular", "half-vector"], ["--specular is for --look kajiya", "allowed: one of them"]),
    (["--shadow-map", "0", "--pcf", "1"], ["--pcf has no use where --shadow-map is 0", "--shadow-map a number"]),
    (["--shadows", "off", "--grid", "64"], ["--grid has no use where --shadows is off; allowed: with --shadows any"]),
    (["--blur-sigma", "2"], ["--blur-sigma has no use where --blur is off", "--blur all or edges"]),
    (["--blur-sigma", "0"], ["--blur-sigma"]),
    (["--blur-sigma", "17"], ["--blur-sigma", "16"]),
])
@pytest.mark.parametrize("command", ["render", "compare"])
def test_wrong_options(clfur, tmp_path, command, arguments, words):
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")   # without uv
    wrong(clfur(command, "m.obj", *arguments), *words)
    assert [file.name for file in tmp_path.iterdir()] == ["m.obj"]


def test_scene_files_may_hold_any_fur(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = ("import clfur\nscene = clfur.Scene(clfur.load_mesh('sphere'), "
            "[clfur.Shells(), clfur.Curves([[[0, 0, 0], [0, 2, 0]]])])\n")
    (tmp_path / "fur.py").write_text(text)
    scene, settings = load("fur.py", "--blur", "edges")
    assert isinstance(scene.shells, Shells) and isinstance(scene.strands, Curves) and settings.blur == "edges"
    for flag, value in ("--layers", 30), ("--fur", "shells"):
        with pytest.raises(click.UsageError, match=f"{flag}: fur.py sets this itself"):
            load("fur.py", flag, value)
    (tmp_path / "fur.py").write_text(text.replace("clfur.Shells(), ", "3, "))
    with pytest.raises(Error, match="fur.py, line 2: Scene.fur is "):
        load("fur.py")


def test_the_highlight_is_the_looks(tmp_path, monkeypatch):
    """Of all fur, also of a scene file's and of types in JSON; settings know nothing of it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "types.json").write_text('[{"specular": 0.9}]')
    scene, _ = load("sphere", "--fur", "both", "--types", "types.json", "--specular", "half-vector")
    assert scene.shells.look.highlight == "half-vector"
    assert scene.strands.types[0].look == Kajiya(specular=.9, highlight="half-vector")
    (tmp_path / "fur.py").write_text("import clfur\nscene = clfur.Scene(clfur.load_mesh('sphere'), clfur.Shells())\n")
    assert load("fur.py", "--specular", "half-vector")[0].shells.look.highlight == "half-vector"
    assert load("fur.py")[0].shells.look.highlight == "kajiya-kay"


def test_roots_go_by_the_mesh_in_rest(tmp_path):
    ball = load_mesh("sphere")
    for name, stretch in ("rest", 1), ("pose", 1.15):
        rows = [f"v {x} {stretch * y} {z}" for x, y, z in ball.positions]
        rows += [f"f {a} {b} {c}" for a, b, c in ball.faces + 1]
        (tmp_path / f"{name}.obj").write_text("\n".join(rows))
    scene, _ = load(tmp_path / "pose.obj", "--roots", 50, "--rest", tmp_path / "rest.obj")
    np.testing.assert_array_equal(scene.strands.rest.positions, ball.positions)
    hair, = scene.strands.types
    assert hair.full_length == pytest.approx(0.08 * ball.bounds[1])   # in every pose
    both, _ = load(tmp_path / "pose.obj", "--fur", "both", "--rest", tmp_path / "rest.obj")
    assert both.shells.rest is both.strands.rest
    with pytest.raises(Error, match="Strands.rest has 6,320 faces and Scene.mesh"):
        load(tmp_path / "pose.obj", "--roots", 50, "--rest", "teapot")


def test_looks(tmp_path, monkeypatch):
    """Of strands, by an option or a type in JSON; numbers of a type's own make a Kajiya beside the option."""
    def look(*given):
        return load("sphere", *given)[0].strands.types[0].look
    assert look() == Kajiya() and look("--look", "kajiya:specular=0.5,highlight=half-vector").highlight == "half-vector"
    assert look("--look", "chiang") == Chiang()
    assert look("--look", "chiang:tilt=3, absorption=0.1/2/3") == Chiang(tilt=3, absorption=(.1, 2, 3))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "types.json").write_text('[{"look": "chiang:eumelanin=8", "key": [0, 0, 0]}, {"specular": 1}, {}]')
    types = hair_types("types.json", groom_of("types.json")["types"], {"look": Chiang(tilt=3)})
    assert [kind.look for kind in types] == [Chiang(eumelanin=8), Kajiya(specular=1), Chiang(tilt=3)]
    (tmp_path / "types.json").write_text('[{"look": 3}]')
    with pytest.raises(Error, match=r"types.json, type 0: HairType.look is 3; allowed: an object of class"):
        load("sphere", "--types", "types.json")


def test_skies(tmp_path):
    """One colour, three, or a picture; sRGB and linear; none without the option."""
    def sky(*given):
        environment = load("sphere", *given)[0].environment
        return environment and environment.sky.tolist()
    assert sky() is None
    assert sky("--sky", "1,2.5,0") == [1, 2.5, 0] and sky("--sky", "#ffffff") == [1, 1, 1]
    assert sky("--sky", "#ffffff:.5,.5,.5:0,0,1e3") == [[1, 1, 1], [.5, .5, .5], [0, 0, 1000]]
    picture = np.full((2, 4, 3), .25, np.float32)
    save(tmp_path / "a.exr", picture)
    assert sky("--sky", tmp_path / "a.exr") == picture.tolist()
    save(tmp_path / "a.png", picture)
    np.testing.assert_allclose(sky("--sky", tmp_path / "a.png"), picture, atol=.003)   # sRGB of 8 bits


@pytest.mark.parametrize("text, words", [
    ("1,1", "'1,1' is neither a colour"), ("1,1,1:0,0,0", "nor ZENITH:HORIZON:GROUND of three"), ("-1,0,0", "neither"),
    ("#12", "neither"), ("none.hdr", "none.hdr: no such file"), ("a.txt", "a.txt: cannot be read as a picture"),
    ("nan.exr", "nan.exr: Environment.sky is nan at [0, 1, 2]")])
def test_skies_that_are_none(clfur, tmp_path, text, words):
    (tmp_path / "a.txt").write_text("sky")
    picture = np.ones((2, 4, 3), np.float32)
    picture[0, 1, 2] = np.nan
    save(tmp_path / "nan.exr", picture)
    wrong(clfur("render", "sphere", "--sky", text, "-o", "a.png"), words)


@pytest.mark.parametrize("text, words", [
    ("phong", "look 'phong' is of no kind; allowed: kajiya or chiang"),
    ("chiang:roughness=1", "look chiang has no 'roughness'; allowed: longitudinal_roughness"),
    ("chiang:tilt=a", "Chiang.tilt is 'a'"), ("chiang:tilt", "Chiang.tilt is ''"),
    ("chiang:tilt=1/2", "Chiang.tilt is [1.0, 2.0]")])
def test_looks_that_are_none(clfur, text, words):
    wrong(clfur("render", "sphere", "--look", text, "-o", "a.png"), words)


def test_lights_of_the_command():
    def lights(*texts):
        return load("sphere", *(part for text in texts for part in ("--light", text)))[0].lights
    sun, = lights("0,-2,0")
    assert sun.direction.tolist() == [0, -1, 0] and (sun.ambient, sun.size, sun.shadows) == (None, 0, True)
    sun, point, spot = lights("sun direction=0,0,-1 size=0.5", "point position=9,8,7 color=#ffffff intensity=2",
                              "spot position=1,2,3 direction=0,-1,0 angle=40 shadows=off ambient=.2 color=3,2,1")
    assert (sun.size, sun.ambient, sun.position) == (.5, None, None)
    assert point.everywhere and point.position.tolist() == [9, 8, 7] and point.strength.tolist() == [2, 2, 2]
    assert (point.ambient, spot.ambient, spot.angle, spot.shadows) == (0, .2, 40, False)
    assert spot.color.tolist() == [3, 2, 1]
    before, behind = lights()   # which is framed with a ground as the first is
    assert before.direction[2] < 0 < behind.direction[2] and behind.strength.max() >= .5 * before.strength.max()
    assert (before.ambient, behind.ambient) == (None, 0)
    for given in ("--view", "100,30"), ("--eye", "9,3,1", "--target", "5,3,1"), ("--view", "back"):
        scene = load("sphere", *given)[0]   # they go with the camera
        for seen, light in zip(load("sphere", "--view", "front")[0].lights, scene.lights):
            right, back = scene.camera.pose[:3, 0], np.cross(scene.camera.pose[:3, 0], (0, 1, 0))
            np.testing.assert_allclose((light.direction @ right, light.direction[1], light.direction @ back),
                                       seen.direction, atol=1e-5)
    assert [light.direction.tolist() for light in load("sphere", "--sky", "1,1,1")[0].lights] == [
        before.direction.tolist()]   # a sky shines from behind


def test_a_grounds_shadow_is_framed_where_no_camera_is_given():
    """Another camera stands where it does without a ground."""
    def pose(*given):
        return load("sphere", *given)[0].camera.pose
    assert np.abs(pose("--ground", "lowest") - pose()).max() > .1
    for given in ("--eye", "0,1,5"), ("--target", "0,.5,0"):
        np.testing.assert_array_equal(pose("--ground", "lowest", *given), pose(*given))


def test_a_spot_without_a_direction_looks_at_the_mesh(tmp_path):
    """At the middle of it, wherever that is; another direction counts more."""
    (tmp_path / "m.obj").write_text("v 7 0 0\nv 9 0 0\nv 7 4 0\nv 7 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    mesh = load_mesh(tmp_path / "m.obj")

    def spot(text):
        return load(tmp_path / "m.obj", "--light", text)[0].lights[0]
    ways = [spot(f"spot position={x},9,{x}").direction for x in (-3, 5)]
    for x, way in zip((-3, 5), ways):
        to = mesh.bounds[0] - (x, 9, x)
        np.testing.assert_allclose(way, to / np.linalg.norm(to), atol=1e-12)
    assert spot("spot position=1,9,1 direction=0,0,3").direction.tolist() == [0, 0, 1]
    middle = ",".join(map(repr, mesh.bounds[0].tolist()))
    with pytest.raises(Error, match="light spot stands in the mesh's middle.*allowed: direction=X,Y,Z"):
        spot(f"spot position={middle}")


@pytest.mark.parametrize("arguments, words", [
    (["--light", "spot position=0,3,0 angle=40 angle=50"], "'--light': light spot has angle twice; allowed: each"),
    (["--light", "sun direction=0,0,1 direction=0,0,1"], "'--light': light sun has direction twice"),
    (["--look", "chiang:tilt=3,tilt=4"], "'--look': look chiang has tilt twice; allowed: each field once"),
    (["--types", "twice.json"], "--types: twice.json is not JSON: 'segments' is there twice in an object")])
def test_what_is_said_twice(clfur, tmp_path, arguments, words):
    (tmp_path / "twice.json").write_text('[{"segments": 3, "color": [1, 0, 0], "segments": 4}]')
    wrong(clfur("render", "sphere", *arguments), words)
    assert [file.name for file in tmp_path.iterdir()] == ["twice.json"]


@pytest.mark.parametrize("arguments, words", [
    (["--body-texture", "no.png"], "--body-texture: no.png: no such file"),
    (["--background", "no.png"], "--background: no.png: no such file"),
    (["--type-map", "no.png", "--types", "plain.json"], "--type-map: no.png: no such file"),
    (["--types", "no.json"], "--types: no.json: No such file"), (["--types", "."], "--types: .: is a"),
    (["--rest", "no.obj"], "--rest: no.obj: no such file"),
    (["--rest", "teapot"], "--rest: Strands.rest has 6,320 faces"),
    (["--sky", "no.hdr"], "'--sky': no.hdr: no such file"), (["--sky", ""], "'--sky': '' is neither"),
    (["--sky", "blue"], "'--sky': 'blue' is neither"),
    (["--sky", "nan,1,1"], "'--sky': 'nan,1,1' is neither"),
    (["--sky", "1e12,0,0"], "'--sky': '1e12,0,0' is neither a colour, R,G,B of 0 to 1e+09 each"),
    (["--length", "inf"], "--length: HairType.length is inf"),
    (["--length", "nan"], "'--length': 'nan' is not a number from 0"),
    (["--fur", "shells", "--length", "0"], "--length: Shells.length is 0.0"),
    (["--zoom", "nan"], "'--zoom': 'nan' is not a number from 0.01 to 100"),
    (["--hair", "no.npz"], "--hair: no.npz: no such file"), (["--hair", ""], "--hair: "),
    (["--fov", "nan"], "'--fov': 'nan' is not a number from 0.001 to 179.99"),
    (["--eye", "nan,0,0"], "--eye: Camera.eye is "),
    (["--force", "nan,0,0"], "--force: Strands.force is "), (["--seed", "-1"], "--seed: Strands.seed is -1"),
    (["--masks", "3"], "--masks: Settings.masks is 3"), (["--budget", "inf"], "--budget: Settings.seconds is inf"),
    (["--scattering", "grid"], "--scattering: Settings.scattering is 'grid', but the look of hair is kajiya-kay"),
    (["--light", "point position=0,0,0"], "--light: Light.position is "),
    (["--body-texture", "white.png"], "--body-texture: Scene.body_color has a texture, which is laid on by uv"),
    (["--types", "types.json"], "--types: types.json, type 0: HairType.segments is 'a'"),
    (["--types", "keys.json", "--type-map", "white.png"], "--types: HairType.key (0, 0, 0) is that of more than one"),
    (["--target", "nan,0,0"], "--target: Camera.target is (nan, 0.0, 0.0)"),
    (["--segments", "1.5"], "'--segments': '1.5' is not a whole number from 0 to 255"),
    (["--segments", "256"], "'--segments': '256' is not a whole number from 0 to 255"),
    (["--seed", "x"], "'--seed': 'x' is not a whole number"),
    (["--force-weight", "x"], "'--force-weight': 'x' is not a number"),
    (["--stiffness", 0], "'--stiffness': '0' is not a number from 1e-06"),
    (["--stiffness", 1, "--force-weight", 1], "--stiffness and --force-weight are of two rules of growth"),
    (["--alpha", "1.5"], "'--alpha': '1.5' is not a number from 0 to 1"),
    (["--max-error", "0"], "'--max-error': '0' is not a number above 0\n"),
    (["--fur", "shells", "--density", "2"], "'--density': '2' is not a number above 0 and at most 1"),
    (["--width", "-1"], "'--width': '-1' is not a number from 0\n"),
    (["--background", ""], "--background: .: is a folder"),
    (["-o", ""], "save path is '.'; allowed: a file's name")])
def test_an_error_begins_with_the_option(clfur, tmp_path, arguments, words):
    """Whose value is wrong, or whose file; the field of Python's follows."""
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")   # without uv
    (tmp_path / "types.json").write_text('[{"segments": "a"}]')
    (tmp_path / "plain.json").write_text("[{}]", encoding="utf-16")
    (tmp_path / "keys.json").write_text('[{"key": [0, 0, 0]}, {"key": [0, 0, 0]}]')
    save(tmp_path / "white.png", np.ones((1, 1, 3)))
    before = sorted(tmp_path.iterdir())
    mesh = "m.obj" if "white.png" in arguments else "sphere"
    *_, err = result = clfur("render", mesh, "--size", "16x12", *arguments)
    wrong(result, words)
    assert err.removeprefix("clfur: error: ").removeprefix("Invalid value for ").startswith(words)
    assert sorted(tmp_path.iterdir()) == before


def test_an_error_of_a_field_that_no_option_has_set(clfur, tmp_path):
    """It begins with the field: --grid has no part in it."""
    (tmp_path / "fur.py").write_text("import clfur\nscene = clfur.Scene(clfur.load_mesh('sphere'), clfur.Shells())\n"
                                     "settings = clfur.Settings(shadows='deep')")
    wrong(clfur("render", "fur.py"), "clfur: error: Settings.shadows is 'deep', but the scene has shells")


@pytest.mark.parametrize("view, towards", [
    ("front", (0, 0, 1)), ("back", (0, 0, -1)), ("left", (-1, 0, 0)), ("right", (1, 0, 0)), ("top", (0, 1, 0)),
    ("90,0", (1, 0, 0)), ("0,-90", (0, -1, 0)), ("-45,0", (-.5**.5, 0, .5**.5))])
def test_views(view, towards):
    """All of the mesh is in the picture, from there; its middle stays when it is enlarged."""
    scene, _ = load("sphere", "--view", view)
    eye = scene.camera.pose[:3, 3]
    np.testing.assert_allclose(eye / np.linalg.norm(eye), towards, atol=1e-3)   # it is centred exactly
    near, _ = load("sphere", "--view", view, "--zoom", 3)
    np.testing.assert_array_equal(near.camera.pose, scene.camera.pose)
    assert near.camera.intrinsics[1, 1] == pytest.approx(3 * scene.camera.intrinsics[1, 1])


@pytest.mark.parametrize("arguments, says", [
    (["--view", "side"], "'side' is none of 34, front, back, left, right, top, nor AZIMUTH,ELEVATION in degrees"),
    (["--view", "0,91"], "-90 to 90"), (["--view", "nan,0"], "none of"), (["--zoom", "0"], "--zoom"),
    (["--view", "top", "--eye", "0,9,0"], "--view places the camera, and so does --eye; allowed: one of them")])
def test_views_that_are_none(clfur, arguments, says):
    wrong(clfur("render", "sphere", *arguments), says)


@pytest.mark.parametrize("arguments, says", [
    (["--size", "32x24", "--region", "0,0,33,9"], "--region: region is (0, 0, 33, 9); allowed: x, y, width and height"),
    (["--outputs", "colour", "-o", "a.exr"], "--outputs: there is no output 'colour'; allowed: color, depth"),
    (["--outputs", "colour", "-o", "a.png"], "--outputs: a.png can hold color alone, not colour; allowed: color, or")])
def test_what_is_asked_of_a_picture_that_there_is_not(clfur, arguments, says):
    wrong(clfur("render", "sphere", "--roots", 9, *arguments), says)


def z_up(folder, name, array):
    """Write places [n, 3] of which +Y is up as lines of an OBJ file of which +Z is."""
    x, y, z = np.asarray(array, float).T
    (folder / name).write_text("".join(f"v {a!r} {b!r} {c!r}\n" for a, b, c in np.stack([x, -z, y], 1).tolist()))
    return folder / name


def test_z_is_up(tmp_path, clfur):
    """The same mesh, pose in rest and hair; strands that are saved lie on the mesh of the file."""
    mesh = load_mesh("sphere")
    file = z_up(tmp_path, "ball.obj", mesh.positions * (1, .8, .6))
    file.write_text(file.read_text() + "".join(f"f {a} {b} {c}\n" for a, b, c in mesh.faces + 1))
    turned, _ = load(file, "--up", "z", "--rest", file)
    np.testing.assert_array_equal(turned.mesh.positions, np.float32(mesh.positions * (1, .8, .6)))
    np.testing.assert_array_equal(turned.strands.rest.positions, turned.mesh.positions)
    assert np.abs(turned.mesh.normals[:, 1] * np.sign(turned.mesh.positions[:, 1])).min() >= 0   # they are turned, too
    assert np.ptp(load(file)[0].mesh.positions, axis=0) == pytest.approx([2, 1.2, 1.6], rel=1e-3)

    code, _, err = clfur("grow", file, "--up", "z", "--roots", "600", "-o", tmp_path / "hair.npz")
    assert code == 0, err
    hair = load_curves(tmp_path / "hair.npz")
    strands = hair.points.reshape(600, hair.uniform, 3)
    roots = strands[:, 0] / (1, .6, .8)   # on the ball, but for the flat triangles of it
    assert np.abs(np.linalg.norm(roots, axis=1) - 1).max() < .02
    fall = (strands[:, -1] - strands[:, 0]).mean(0)   # gravity pulls along -Z there
    assert fall[2] < -.02 and np.abs(fall[:2]).max() < .01
    brought, _ = load(file, "--up", "z", "--hair", tmp_path / "hair.npz")
    x, y, z = hair.points.T
    np.testing.assert_array_equal(brought.strands.points, np.stack([x, z, -y], 1))
    wrong(clfur("render", file, "--up", "x"), "'y', 'z'")


def test_skin_is_as_the_hair_but_darker():
    for fur in "strands", "shells", "both":
        assert load("sphere", "--color", "1,.5,.25", "--fur", fur)[0].body_color == pytest.approx((.6, .3, .15))


def test_skin_is_as_the_hair_of_a_file_or_of_its_types(tmp_path):
    """The mean of them; --color counts where a file says nothing, and not for types that are bald."""
    (tmp_path / "a.json").write_text(
        '[{"segments": 0, "key": [0, 0, 0]}, {"color": [1, 0, 0], "key": [1, 0, 0]}, {"key": [2, 0, 0]}]')
    save(tmp_path / "map.png", np.zeros((2, 2, 4), np.float32))
    skin = load("teapot", "--types", tmp_path / "a.json", "--type-map", tmp_path / "map.png",
                "--color", "0,0,.5")[0].body_color
    assert skin == pytest.approx((.3, 0, .15))
    points, color = np.random.default_rng(1).random((2, 3, 3)), np.float32([(1, 0, 0), (0, .5, 0)])
    for colors, mean in ((color, (.5, .25, 0)), (None, (.1, .2, .3))):
        given = {} if colors is None else {"color": colors}
        np.savez(tmp_path / "a.npz", points=points, **given)
        hairy = load("sphere", "--hair", tmp_path / "a.npz", "--color", ".1,.2,.3")[0]
        assert hairy.body_color == pytest.approx(np.multiply(.6, mean))


def test_help_lists_each_option_once_under_its_section(clfur):
    titles = ("Fur", "Strands", "Grooming of strands", "Shells", "Body and ground", "Light", "Camera",
              "Quality and speed", "Output and device")
    for command, shown in (("render", titles), ("compare", titles), ("chart", (*titles[:7], titles[8]))):
        code, out, _ = clfur(command, "--help")
        assert code == 0 and tuple(line[:-1] for line in out.splitlines() if line in [f"{t}:" for t in titles]) == shown
        flags = [line.split()[0] for line in out.splitlines() if line.startswith("  -")]
        assert len(flags) == len(set(flags)) > 20 and "None" not in out
        section = out.partition("Camera:")[2].partition("\n\n")[0]
        assert "--eye" in section and "--size" in section and "--color" not in section
