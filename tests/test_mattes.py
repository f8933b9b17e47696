"""Whose light a pixel's is: hair, types, strands and body, told alone."""

import attrs
import imageio.v3
import numpy as np
import pytest
from support.coverage import LIGHT, OFF, ball, wild
from support.plans import plan_of
from support.stages import strands_on
from support.views import perspective

import clfur
from clfur.files.images import png_bytes
from clfur.pipeline.mattes import RANKS, TOLD
from clfur.render import OUTPUTS
from clfur.stages import mattes
from clfur.twin import mattes as twin

NAMES = ("coverage", *TOLD)

def curves(n, seed=3, types=1, **known):
    strands = wild(n, seed, .8, .05)
    return clfur.Curves(strands[..., :3], width=strands[..., 3], type_of=np.arange(n) % types,
                        types=[clfur.HairType() for _ in range(types)], **known)


def scene_of(n=70, types=3, mesh=True, size=(41, 31), **known):
    return clfur.Scene(ball(.5) if mesh else None, curves(n, types=types),
                       clfur.Camera(size=size), light=LIGHT, **known)


@pytest.mark.small
def test_owners_are_found(gpu):
    """Each segment's strand and type, and twice its angle: as float64 has it to 1e-4, where it is 0.1 pixels long."""
    rng = np.random.default_rng(1)
    view = perspective(64, 48, 1)
    points = np.c_[rng.uniform(-.5, .5, (60, 3)), np.full(60, .01)].astype(np.float32)
    spans = np.c_[np.arange(0, 60, 5), np.full(12, 5)]
    strands = strands_on(gpu, points, spans, np.arange(12) % 3)
    order = rng.permutation(12).astype(np.uint32)
    strands.numbers, strands.first_strand, strands.run = gpu.upload(order), 100, 5
    strands.strand_of, strands.stored = (gpu.upload(each) for each in (
        np.arange(12, dtype=np.uint32), np.arange(0, 60, 5, dtype=np.uint32)))
    strands.first_point = 1000
    segments = np.array([k for k in range(60) if k % 5 < 4])
    ids = np.r_[1000 + segments, 999, 1060].astype(np.uint32)
    ids[::3] |= np.uint32(1 << 31)
    known = mattes.Owners.empty(gpu, {"id": len(ids)})
    mattes.owners(gpu, view, gpu.upload(ids), strands, known)
    owners, turns = known.owners.get(), known.turns.get()
    np.testing.assert_array_equal(owners[:-2], np.c_[100 + order[segments // 5], segments // 5 % 3])
    assert (owners[-2:] == 2**32 - 1).all() and not turns[-2:].any()
    meant = twin.twice_the_angle(view, points[segments], points[segments + 1])
    np.testing.assert_allclose(turns[:-2], meant, atol=1e-4)
    flat = twin.twice_the_angle(view, [[0, 0, 0]] * 3, [[.1, 0, 0], [0, .1, 0], [.1, .1, 0]])
    np.testing.assert_allclose(flat, [[1, 0], [-1, 0], [0, 1]], atol=.02)   # but for the view's height


@pytest.mark.small
def test_small_mattes(gpu):
    """Every output of these, in a picture that Oclgrind has time for."""
    check_sums(clfur.render(scene_of(12, size=(13, 9)), gpu, OFF, NAMES))


def check_sums(out, shells=False):
    """The laws of sums; float32 holds each of the numbers to 2^-25, and strands take light in steps of as much."""
    hair, areas = out["hair_alpha"].astype(float), out["strand_area"].astype(float)
    assert hair.max() > .2
    np.testing.assert_allclose(hair + out["body_alpha"], out["coverage"], atol=1e-6)
    np.testing.assert_allclose(out["type_alpha"].sum(2, dtype=float), hair, atol=2e-7)
    assert (out["orientation"].astype(float)**2).sum(2).max() <= 1 + 1e-6
    assert (np.hypot(*np.moveaxis(out["orientation"], 2, 0)) <= hair + 1e-6).all()
    of_fur = out["type_alpha"][..., -1].sum(dtype=float) if shells else 0
    np.testing.assert_allclose(areas.sum(), hair.sum() - of_fur, rtol=1e-6)
    np.testing.assert_array_equal(out["type"] < 0, hair == 0)
    assert (out["matte_alpha"].sum(2) <= out["coverage"] + 1e-6).all()
    assert (np.diff(out["matte_alpha"], axis=2) <= 0).all()
    np.testing.assert_array_equal(out["matte_id"] == -1, out["matte_alpha"] == 0)
    few = out["matte_id"][..., -1] == -1   # all who are there are told
    np.testing.assert_allclose(out["matte_alpha"].sum(2)[few], out["coverage"][few], atol=1e-6)


@pytest.mark.parametrize("settings", [OFF, attrs.evolve(OFF, samples=4), attrs.evolve(OFF, masks=4),
                                      attrs.evolve(OFF, raster="samples", samples=16)],
                         ids=["one", "four", "masks", "samples"])
@pytest.mark.parametrize("shells", [False, True])
def test_shares_add_up(gpu, settings, shells):
    scene = scene_of(400)
    if shells:
        if settings.masks:
            settings = attrs.evolve(settings, samples=1)
        scene = attrs.evolve(scene, fur=[scene.fur, clfur.Shells(length=.1, frequency=6, layers=4)])
    check_sums(clfur.render(scene, gpu, settings, NAMES), shells)


def test_shares_are_the_twins(gpu):
    """Of each strand in each pixel: float32 keeps what is left of a pixel to 1e-6 after all that hides there."""
    n, size = 60, (31, 23)
    scene = clfur.Scene(None, curves(n, types=2), clfur.Camera(size=size), light=LIGHT)
    out = clfur.render(scene, gpu, OFF, (*NAMES, "id"))
    view = plan_of(scene, OFF, ("id",)).rig.view
    fur = scene.local.fur
    points = np.c_[fur.points.reshape(-1, 3), fur.width]
    spans = np.c_[np.arange(n) * 5, np.full(n, 5)]
    found = twin.shares(view, points, spans, np.full((*size[::-1], 1), 2**64 - 1, np.uint64))
    area, types = np.zeros(n), np.zeros((*size[::-1], 2))
    for (y, x), (of_strands, _) in found.items():
        ranked = sorted(of_strands.items(), key=lambda each: -each[1])[:RANKS]
        told = dict(zip(out["matte_id"][y, x].tolist(), out["matte_alpha"][y, x].tolist()))
        for strand, share in ranked:
            assert told.get(strand, 0) == pytest.approx(share, abs=2e-5)
        for strand, share in of_strands.items():
            area[strand] += share
            types[y, x, strand % 2] += share
    np.testing.assert_allclose(out["strand_area"], area, atol=1e-3)
    np.testing.assert_allclose(out["type_alpha"], types, atol=2e-5)
    np.testing.assert_allclose(out["hair_alpha"], out["coverage"], atol=1e-6)


def test_who_is_in_front_is_told_first(gpu):
    """A wide strand before everything has the pixel for itself."""
    points = np.float32([[[-1, 0, 1], [1, 0, 1]], [[-1, -1, 0], [1, 1, 0]]])
    fur = clfur.Curves(points, width=[.5, .01], types=[clfur.HairType(), clfur.HairType()], type_of=[1, 0])
    out = clfur.render(clfur.Scene(None, fur, clfur.Camera((0, 0, 4), size=(33, 25))), gpu, OFF, NAMES)
    assert out["matte_id"][12, 16].tolist() == [0, -1, -1, -1, -1, -1]
    assert out["type"][12, 16] == 1 and out["matte_alpha"][12, 16, 0] == 1
    np.testing.assert_allclose(out["orientation"][12, 16], [1, 0], atol=1e-6)


def test_nothing_else_changes(gpu):
    """What is asked for beside them has the same bits, as have they beside it."""
    scene = scene_of(300)
    settings = clfur.Settings(grid=16, shadow_map=32, samples=4)
    all_of, alone = (clfur.render(scene, gpu, settings, names) for names in (tuple(OUTPUTS), NAMES))
    plain = clfur.render(scene, gpu, settings, tuple(name for name in OUTPUTS if name not in TOLD))
    for name in OUTPUTS:
        np.testing.assert_array_equal(all_of[name], (alone if name in NAMES else plain)[name], err_msg=name)


@pytest.mark.parametrize("settings", [OFF, attrs.evolve(OFF, masks=4)], ids=["default", "masks"])
def test_room_for_pieces_does_not_matter(gpu, monkeypatch, settings):
    """Bundle by bundle, tile by tile: the same bits."""
    scene = scene_of(500)
    whole = clfur.render(scene, gpu, settings, NAMES)
    for room in 40, 1:
        monkeypatch.setattr(mattes, "LEAST", room)
        monkeypatch.setattr(mattes, "BUNDLES", room)
        cut = clfur.render(scene, gpu, settings, NAMES)
        for name in NAMES:
            np.testing.assert_array_equal(cut[name], whole[name], err_msg=name)


def test_places_are_where_the_depth_is(gpu):
    """Projected once more they are in the middles of their pixels, at the distance that depth tells."""
    out = clfur.render(scene_of(), gpu, OFF, ("position", "depth"))
    camera = clfur.Camera(size=(41, 31))
    seen = np.isfinite(out["depth"])
    np.testing.assert_array_equal(np.isfinite(out["position"]).all(2), seen)
    there = (out["position"][seen] - camera.pose[:3, 3]) @ camera.pose[:3, :3]
    np.testing.assert_allclose(-there[:, 2], out["depth"][seen], rtol=1e-6)
    row, column = np.nonzero(seen)
    x, y = there[:, 0] / -there[:, 2], -there[:, 1] / -there[:, 2]
    focal = camera.intrinsics[0, 0]
    np.testing.assert_allclose(np.c_[x, y] * focal + [20.5, 15.5], np.c_[column, row] + .5, atol=1e-4)


def test_hair_laid_over_another_background_has_no_fringes(gpu):
    """As a holdout hides it, hair's colour by its alpha over any picture is what covers the pixel: to float32."""
    scene = scene_of(300, body="holdout")
    out = clfur.render(scene, gpu, OFF, ("color", "hair_alpha"))
    np.testing.assert_allclose(out["color"][..., 3], out["hair_alpha"], atol=1e-6)
    for color in (0, 0, 0), (.2, .7, .4):   # a body for a background: the same hair, and the body's share behind it
        drawn = clfur.render(scene_of(300, body_color=color), gpu, OFF, ("color", "hair_alpha", "body_alpha"))
        np.testing.assert_array_equal(drawn["hair_alpha"], out["hair_alpha"])
        behind = drawn["color"] - out["color"]
        np.testing.assert_allclose(behind[..., 3], drawn["body_alpha"], atol=1e-6)
        hidden = drawn["body_alpha"] == 0
        np.testing.assert_allclose(behind[hidden], 0, atol=1e-6)
        if not any(color):
            np.testing.assert_allclose(behind[..., :3], 0, atol=1e-6)


def test_arrays_are_handed_over_as_they_are(gpu):
    """Contiguous, and to others that speak DLPack without a copy; 8 bits are those of a PNG."""
    out = clfur.render(scene_of(), gpu, OFF, tuple(OUTPUTS))
    for name, array in out.items():
        assert array.flags.c_contiguous and array.flags.writeable, name
        assert np.shares_memory(np.from_dlpack(array), array), name
    pixels = clfur.to_uint8(out["color"])
    np.testing.assert_array_equal(pixels, imageio.v3.imread(png_bytes(out["color"])))
    assert pixels.flags.c_contiguous and clfur.to_uint8(out["color"][..., :3]).shape == (31, 41, 3)
    for wrong in pixels, out["depth"], None:
        with pytest.raises(clfur.Error, match="to_uint8 image"):
            clfur.to_uint8(wrong)


@pytest.mark.parametrize("built", [{}, {"lanes": 1}], ids=["lanes", "pixels"])
@pytest.mark.parametrize("settings", [OFF, attrs.evolve(OFF, masks=4)], ids=["default", "masks"])
def test_slabs_and_parts_do_not_matter(gpu, another, built, settings):
    """A tile that is drawn slab by slab, in a picture whose strands come part by part: the same bits."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-.2, .2, (400, 1, 3)) + np.linspace(0, .2, 6)[:, None] * rng.normal(size=(400, 1, 3))
    scene = clfur.Scene(fur=clfur.Curves(points, width=.001), camera=clfur.Camera(eye=(0, 0, 6), size=(8, 8)))
    whole, small = clfur.render(scene, gpu, settings, NAMES), another(**built)
    done = 0
    for small.memory in 400_000, 500_000, 600_000, 1_000_000, 8_000_000, 30_000_000:
        small.forget()
        try:
            frame = clfur.draw(scene, small, settings, NAMES)
        except clfur.Error as error:
            assert "has no room for" in str(error)
            continue
        assert frame.memory <= small.memory
        for name in NAMES:
            np.testing.assert_array_equal(frame.images[name], whole[name], err_msg=name)
        done += 1
    assert done > 1
