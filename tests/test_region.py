"""A region of a picture: the same bits as of the whole, whatever is drawn."""

import json

import imageio.v3
import numpy as np
import pytest
from support.command import wrong
from support.coverage import ball
from support.plans import plan_of

import clfur
from clfur.files.images import load_picture
from clfur.render import OUTPUTS as ALL

OUTPUTS = tuple(name for name in ALL if name != "strand_area")
SIZE = 53, 39
REGIONS = (13, 9, 20, 14), (37, 21, 1, 1), (0, 0, 53, 39), (44, 30, 9, 9), (0, 23, 53, 2)
FUR = clfur.Strands(roots=900, force=(0, -1, 0), types=clfur.HairType(
    segments=5, segment_length=.06, width=.012, direction_variation=.4, length_variation=.3, alpha=.4))
WIDE = clfur.Strands(roots=120, types=clfur.HairType(segments=3, segment_length=.4, width=.1, direction_variation=.6))
SHELLS = clfur.Shells(length=.15, frequency=20, layers=6)
NEAR = clfur.Camera(eye=(.7, .5, .9), size=SIZE, fov=60)   # beside the fur, of which much is before the near plane
OFF = clfur.Camera.calibrated(clfur.Camera(eye=(1.5, .9, 2)).pose, [[60, 2, 9], [0, 52, 31], [0, 0, 1]], SIZE)
SKY = {"environment": clfur.Environment((.5, .6, .8)), "ground": clfur.Ground(color=(.4, .4, .4))}
SCENES = {
    "coverage": ({"fur": FUR}, {}), "near": ({"fur": FUR, "camera": NEAR}, {"samples": 1}),
    "wide": ({"fur": WIDE, "camera": OFF}, {"samples": 16}), "masks": ({"fur": FUR}, {"masks": 4}),
    "deep": ({"fur": FUR}, {"shadows": "deep"}), "lod": ({"fur": FUR}, {"lod": 2.0}),
    "samples": ({"fur": WIDE, "camera": NEAR}, {"raster": "samples"}), "shells": ({"fur": [SHELLS, FUR]}, {}),
    "shells in samples": ({"fur": [SHELLS, FUR], "camera": OFF, **SKY}, {"raster": "samples", "samples": 1}),
    "sky": ({"fur": FUR, **SKY}, {}), "holdout": ({"fur": FUR, "body": "holdout", "camera": NEAR}, {}),
    "edges": ({"fur": FUR}, {"blur": "edges", "blur_sigma": 1.3}),
    "blurred": ({"fur": FUR, "camera": NEAR}, {"blur": "all", "blur_sigma": 2.5}),
    "lights": ({"fur": FUR, "light": [clfur.Light(position=(2, 3, 1), direction=(-2, -3, -1), angle=30),
                                      clfur.Light(size=5)]}, {})}


def scene_of(fields):
    usual = {"mesh": clfur.load_mesh("teapot"), "camera": clfur.Camera(eye=(1.5, .9, 2), size=SIZE)}
    return clfur.Scene(**usual | fields)


def ok(result):
    """What a command that went well printed."""
    code, out, err = result
    assert code == 0, err
    return out


def cropped(image, region):
    x, y, width, height = region
    return image[y:y + height, x:x + width]


@pytest.mark.parametrize("name", SCENES)
def test_a_region_is_what_the_whole_is_there(gpu, name):
    fields, settings = SCENES[name]
    scene, settings = scene_of(fields), clfur.Settings(**settings)
    whole = clfur.render(scene, gpu, settings, OUTPUTS)
    assert (whole["id"] >= 0).mean() > .03
    for region in REGIONS:
        part = clfur.render(scene, gpu, settings, OUTPUTS, region=region)
        for output in OUTPUTS:
            np.testing.assert_array_equal(part[output], cropped(whole[output], region), f"{output} of {region}")
            assert part[output].flags.c_contiguous


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_a_small_region(gpu, raster):
    """All that draws in columns, at the edge of a small picture."""
    fur = [clfur.Strands(inner=1, outer=1, types=clfur.HairType(segments=3, segment_length=.1, width=.05)),
           clfur.Shells(length=.1, frequency=6, layers=3)]
    camera = clfur.Camera(eye=(0, .6, 3.2), size=(15, 9))
    scene = clfur.Scene(ball(.8, 0), fur, camera, ground=clfur.Ground(color=(1, 1, 1)))
    settings = clfur.Settings(raster=raster, samples=1, grid=16, shadow_map=16)
    whole = clfur.render(scene, gpu, settings, OUTPUTS)
    part = clfur.render(scene, gpu, settings, OUTPUTS, region=(9, 2, 4, 6))
    for output in OUTPUTS:
        np.testing.assert_array_equal(part[output], whole[output][2:8, 9:13], output)
    assert {-4} < set(np.unique(part["id"]))


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_a_region_in_parts_and_of_a_team(gpu, another, raster):
    scene, region = scene_of({"fur": FUR}), (9, 5, 30, 30)
    settings = clfur.Settings(raster=raster, grid=16, shadow_map=16)
    whole = clfur.draw(scene, gpu, settings, OUTPUTS)
    small = another(plan_of(scene, settings)._fixed * 16 // 15 + 700_000)
    part = clfur.draw(scene, small, settings, OUTPUTS, region=region)
    assert len(plan_of(scene, settings).parts(small)) > 1
    for drawn in part, clfur.draw(scene, [gpu, small], settings, OUTPUTS, region=region):
        for output in OUTPUTS:
            np.testing.assert_array_equal(drawn.images[output], cropped(whole.images[output], region), output)


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_areas_of_strands_are_those_within_the_region(gpu, raster):
    """Of regions that are the picture together they add up to the whole's; each is a float32."""
    scene, settings = scene_of({"fur": WIDE}), clfur.Settings(raster=raster, blur="edges")
    whole = clfur.render(scene, gpu, settings, ["strand_area", "color"])["strand_area"]
    parts = [clfur.render(scene, gpu, settings, ["strand_area"], region)["strand_area"] for region in (
        (0, 0, 21, 19), (21, 0, 32, 19), (0, 19, 53, 20))]
    assert (whole > 1).sum() > 20 and all(0 < part.sum() < whole.sum() for part in parts)
    np.testing.assert_allclose(sum(part.astype(float) for part in parts), whole, rtol=1e-6)


def test_a_region_takes_its_share(gpu, monkeypatch):
    """Work-items that go through pixels, and bytes of these: as many as its tiles are."""
    scene, launch, sizes = scene_of({"fur": FUR}), type(gpu).launch, {}

    def counted(self, name, size, /, **known):
        sizes[name] = sizes.get(name, 0) + size
        return launch(self, name, size, **known)
    monkeypatch.setattr(type(gpu), "launch", counted)
    clfur.render(scene, gpu)
    whole = dict(sizes)
    sizes.clear()
    clfur.render(scene, gpu, region=(16, 8, 8, 8))
    for name in "coverage.bound", "shade.color":
        assert 0 < sizes[name] <= whole[name] / 20


@pytest.mark.parametrize("region", [
    (0, 0, 54, 1), (53, 0, 1, 1), (0, 38, 1, 2), (-1, 0, 4, 4), (0, 0, 0, 4), (0, 0, 4), 3, "abcd", (0, 0, 1.5, 2),
    (0, 0, True, 1), (10**30, 0, 1, 1)])
def test_what_is_no_region_is_refused(gpu, region):
    with pytest.raises(clfur.Error, match="region is .*allowed: .* within 53 x 39") as caught:
        clfur.render(scene_of({"fur": FUR}), gpu, region=region)
    assert "\n" not in str(caught.value)


def test_the_command_draws_a_region(clfur, tmp_path):
    options = "sphere", "--size", "40x30", "--roots", "500", "--background", "#336699"
    ok(clfur("render", *options, "-o", tmp_path / "whole.png"))
    found = ok(clfur("render", *options, "-o", tmp_path / "part.png", "--region", "10,5,12,9", "--json"))
    assert json.loads(found)["size"] == [12, 9]
    whole, part = (imageio.v3.imread(tmp_path / f"{name}.png") for name in ("whole", "part"))
    np.testing.assert_array_equal(part, whole[5:14, 10:22])
    for given in "1,2,3", "a", "-1,0,2,2", "30,0,11,2", "0,0,0,2":
        wrong(clfur("render", *options, "-o", tmp_path / "no.png", f"--region={given}"))
        assert not (tmp_path / "no.png").exists()


def test_a_picture_behind_a_region(clfur, tmp_path):
    """Of another size than the picture: what lies behind each pixel stays."""
    behind = np.random.default_rng(3).integers(0, 256, (15, 20, 3), np.uint8)
    imageio.v3.imwrite(tmp_path / "behind.png", behind)
    options = "sphere", "--size", "40x30", "--roots", "500", "--background", tmp_path / "behind.png"
    ok(clfur("render", *options, "-o", tmp_path / "whole.png"))
    ok(clfur("render", *options, "-o", tmp_path / "part.png", "--region", "3,2,30,9"))
    whole, part = (load_picture(tmp_path / f"{name}.png") for name in ("whole", "part"))
    np.testing.assert_array_equal(part, whole[2:11, 3:33])


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_areas_of_strands_are_those_in_the_region(gpu, raster):
    """Not those of the tiles around it; regions beside each other have what all of it has."""
    scene, settings = scene_of({"fur": FUR}), clfur.Settings(raster=raster, samples=4)
    whole = clfur.render(scene, gpu, settings, ["strand_area"])["strand_area"]
    parts = [clfur.render(scene, gpu, settings, ["strand_area", "hair_alpha"], region=region)
             for region in ((0, 0, 21, 39), (21, 0, 32, 17), (21, 17, 32, 22))]
    for part in parts:
        assert part["strand_area"].sum(dtype=float) == pytest.approx(part["hair_alpha"].sum(dtype=float), rel=1e-6)
    np.testing.assert_allclose(sum(part["strand_area"].astype(float) for part in parts), whole, rtol=1e-6)


@pytest.mark.parametrize("blur", ["all", "edges"])
@pytest.mark.parametrize("fields", [{"ground": clfur.Ground()}, {"body": "holdout"}, {}])
def test_coverage_without_color_is_the_same_where_color_is_blurred(gpu, blur, fields):
    scene, settings = scene_of({"fur": FUR, **fields}), clfur.Settings(grid=32, shadow_map=64, blur=blur)
    both = clfur.render(scene, gpu, settings, ("color", "coverage"))
    np.testing.assert_array_equal(clfur.render(scene, gpu, settings, ("coverage",))["coverage"], both["coverage"])
