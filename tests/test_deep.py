"""deep against its twin: pieces of hair as a light sees them, what they let through; frames with it, and the truth."""

import attrs
import numpy as np
import pytest
from support.coverage import LIGHT, SETTINGS, ball, furry, wild

import clfur
from clfur import measures, truth
from clfur.device.team import Team
from clfur.pipeline import build, shadows
from clfur.pipeline.fit import Fit
from clfur.pipeline.plan import Plan
from clfur.pipeline.shadows import DeepPlan, deep_maps
from clfur.pipeline.views import Rig, deep_of
from clfur.stages import deep
from clfur.stages.deep import PADDING
from clfur.stages.strands import upload_curves
from clfur.twin import deep as twin

pytestmark = pytest.mark.usefixtures("plain")
DEEP = attrs.evolve(SETTINGS, shadows="deep", grid=16, shadow_map=64)
SPOT = clfur.Light((-1, -1, -1), position=(2, 2, 2), angle=70)


def made(gpu, curves, size, light=LIGHT, room=1 << 20):
    """(`Deep` of curves before one light, its view, its map)."""
    scene = clfur.Scene(fur=curves, light=light)
    view, packed = deep_of(scene, size, light, Fit.of(scene))
    plan = DeepPlan([view], np.array([packed]), room, size**2, 1)
    there = deep_maps(gpu, plan, lambda: [upload_curves(gpu, curves)])
    return there, view, packed


def lists(there, size):
    """{(y, x): [(depth, strand, opacity)]} of a `Deep` of one light."""
    starts, pieces = there.starts.get().astype(int), there.pieces.get()
    assert starts[-1] + PADDING == len(pieces) and there.longest == np.diff(starts).max()
    found = {}
    for texel in np.flatnonzero(np.diff(starts)):
        its = pieces[starts[texel]:starts[texel + 1]].astype(np.int64)
        assert (np.diff(its) >= 0).all(), "not sorted"
        found[divmod(int(texel), size)] = list(zip(its >> 40, its >> 16 & 0xFFFFFF, its & 0xFFFF))
    return found


def hair(n, seed=1, width=.1):
    strands = wild(n, seed, .8, width)
    return clfur.Curves(strands[..., :3], width=strands[..., 3], alpha=.3)


@pytest.mark.parametrize("n, size", [pytest.param(3, 16, marks=pytest.mark.small), (60, 64)])
@pytest.mark.parametrize("light", [LIGHT, SPOT], ids=["far", "spot"])
def test_pieces_are_the_twins(gpu, n, size, light):
    """Depths within 2^-18 of the whole, 32 steps: float32's rounding of reversed depth, more where a strand looks at
    the light.  Opacity: half a step, and 3e-5 of a share, up to 256 / ln 2 octaves for each."""
    curves = hair(n)
    those_there, view, packed = made(gpu, curves, size, light)
    strands = upload_curves(gpu, curves)
    meant = twin.pieces(view, packed, strands.points.get(), strands.spans.get(), np.full(n, .7))
    found = lists(those_there, size)
    assert sum(map(len, meant.values())) > 10 * n
    for texel in meant.keys() | found.keys():
        for strand in range(n):
            there, those = ([each[::2] for each in all_there.get(texel, []) if each[1] == strand]
                            for all_there in (found, meant))
            sums = [sum(opacity for _, opacity in each) for each in (there, those)]
            assert abs(sums[0] - sums[1]) < 2 + 1024 * 4e-4 * max(len(those), 1), (texel, strand)
            depths = np.array([depth for depth, _ in those])
            assert all(np.abs(depths - depth).min() < 64 for depth, opacity in there if opacity > 4), (texel, strand)


@pytest.mark.parametrize("n, size", [pytest.param(3, 16, marks=pytest.mark.small), (60, 64)])
@pytest.mark.parametrize("light", [LIGHT, SPOT], ids=["far", "spot"])
def test_what_gets_through_is_the_twins(gpu, n, size, light):
    """Of the very pieces that the device has, at any place: 1e-4 by rounding of a place in texels, 2e-6 of the map's
    size; but one in a hundred, whose depth is rounded to the other side of a piece's."""
    there, _, packed = made(gpu, hair(n), size, light)
    rng = np.random.default_rng(2)
    places = np.c_[rng.uniform(-1.2, 1.2, (999, 3)), rng.integers(0, n, 999)].astype(np.float32)
    shares = gpu.empty(len(places), np.float32)
    gpu.launch("shaded.through", -(-len(places) // min(gpu.lanes, 8)), light=0, n=len(places),
               places=gpu.upload(places), shares=shares, **there.arrays())
    meant = twin.through(packed, lists(there, size), places[:, :3], places[:, 3])
    assert (np.abs(shares.get() - meant) > 1e-4).mean() < .01 and ((meant > .01) & (meant < .9)).mean() > .02


@pytest.mark.parametrize("n, steps", [pytest.param(40, 1, marks=pytest.mark.small), (700, 65_535), (1500, 65_535)])
def test_long_lists_are_sorted_in_launches(gpu, another, monkeypatch, n, steps):
    """Where a driver ends long loops; the same bits in whatever order strands come."""
    monkeypatch.setattr(deep, "SORTED", min(deep.SORTED, n // 4))
    way = np.random.default_rng(1).normal(size=(n, 1, 3)) * .2
    points = np.random.default_rng(2).normal(size=(n, 1, 3)) * .02 + way * np.array([-1, 1])[:, None]
    there, *_ = made(gpu, clfur.Curves(points, width=.05), 16)
    other, *_ = made(another(lanes=1, steps=steps), clfur.Curves(points, width=.05), 16)
    assert there.longest > min(n / 2, 512) and lists(there, 16)
    np.testing.assert_array_equal(there.pieces.get()[:-PADDING], other.pieces.get()[:-PADDING])
    order = np.random.default_rng(3).permutation(n)
    turned = lists(made(gpu, clfur.Curves(points[order], width=.05), 16)[0], 16)
    assert turned == {texel: sorted((d, np.argsort(order)[s], o) for d, s, o in each)
                      for texel, each in lists(there, 16).items()}


def test_more_pieces_than_there_is_room_for_are_refused(gpu, another):
    small = another(1600)   # of which half is left
    with pytest.raises(clfur.Error, match="has room for 34 pieces of hair that lights see, where there are 129; all"):
        made(small, hair(9), 16, room=10)


def test_samples_are_refused():
    with pytest.raises(clfur.Error, match="shadows is 'deep', but raster is 'samples'; allowed: raster 'coverage'"):
        clfur.Settings(shadows="deep", raster="samples")


@pytest.mark.small
def test_a_small_frame(gpu):
    scene = furry("grown", size=(9, 7), light=[LIGHT, SPOT])
    color = clfur.render(scene, gpu, DEEP)
    assert np.isfinite(color).all() and color.max() > .05
    assert np.abs(color - clfur.render(scene, gpu, attrs.evolve(DEEP, shadows="length"))).max() > .005


@pytest.mark.parametrize("kind", ["grown", "point"])
@pytest.mark.parametrize("lights", [[LIGHT], [LIGHT, SPOT]], ids=["one", "two"])
def test_parts_give_the_same_bits(gpu, another, kind, lights):
    scene = furry(kind, 4000, light=lights)
    if kind == "grown":
        kind = clfur.HairType(width=.01, segment_length=.05, segments=4)
        fur = clfur.Strands(inner=1, outer=1, roots=4000, types=kind)
        scene = clfur.Scene(scene.mesh, fur, scene.camera, lights)
    whole = clfur.draw(scene, gpu, DEEP)
    plan = Plan(Rig.of(scene, DEEP), ["color"])
    small = another()
    small.memory = plan._fixed * 16 // 15 + 700_000
    assert len(plan.parts(small)) > 1
    np.testing.assert_array_equal(whole.images["color"], clfur.draw(scene, small, DEEP).images["color"])


def test_maps_stay_while_the_camera_moves(gpu):
    scene = furry("grown")
    drawn = clfur.draw(scene, gpu, DEEP)
    assert drawn.stages["deep"] > 0
    turned = clfur.draw(attrs.evolve(scene, camera=clfur.Camera(eye=(1, 1, 2), size=(41, 31))), gpu, DEEP)
    assert "deep" not in turned.stages


def test_shadows_are_nearer_to_the_truth(gpu):
    """Above the noise of two pictures by brute force: .021 where the grid has .033."""
    kind = clfur.HairType(width=.02, segment_length=.03, segments=8, force_weight=.2, color=(.5, .28, .12))
    scene = clfur.Scene(ball(subdivisions=2), clfur.Strands(inner=1, outer=1, roots=2500, types=kind),
                        clfur.Camera(size=(64, 48)), LIGHT)
    one, other = (measures.shown(truth.picture(scene, 4, seed)) for seed in (0, 1))
    errors = []
    for method in "length", "deep":
        shown = measures.shown(clfur.render(scene, gpu, attrs.evolve(DEEP, shadows=method, grid=96, shadow_map=512)))
        errors.append(np.sqrt(((shown - one) * (shown - other)).mean()))
    assert errors[1] < .8 * errors[0], errors


@pytest.mark.parametrize("lights", [[LIGHT], [SPOT, LIGHT]], ids=["one", "two"])
def test_what_lies_in_the_dark_is_left_out_unseen(gpu, monkeypatch, lights):
    """Behind so much hair, or the body, that 5e-5 of the light gets there: fewer pieces, and the same picture."""
    kind = clfur.HairType(width=.02, segment_length=.06, segments=4, alpha=.2)
    scene = clfur.Scene(ball(subdivisions=2), clfur.Strands(inner=1, outer=1, roots=6000, types=kind),
                        clfur.Camera(size=(64, 48)), lights)
    settings = attrs.evolve(DEEP, grid=64, shadow_map=256)
    plan, found = Plan(Rig.of(scene, settings), ["color"]), []
    nothing = shadows.dark_of(gpu, None, len(lights))
    for dark in (shadows.dark_of, lambda *_: nothing):
        monkeypatch.setattr(shadows, "dark_of", dark)
        gpu.forget()
        color = clfur.render(scene, gpu, settings)
        lighting, _ = build.lighting(gpu, Team([gpu]), plan, False)
        found.append((color, len(build.deep(gpu, plan, lighting).pieces)))
    (with_it, some), (without, pieces) = found
    assert some < .9 * pieces
    assert np.abs(with_it - without).max() < 1e-3


@pytest.mark.parametrize("what, given", [
    ("the scene has shells", {"fur": [clfur.Strands(inner=1, outer=1), clfur.Shells(length=.1)]}),
    ("Scene.environment is given", {"environment": clfur.Environment((1, 1, 1))}),
    ("a light has a size", {"light": clfur.Light(size=2)}),
])
def test_what_does_not_go_with_it_is_refused(sphere, what, given):
    scene = clfur.Scene(sphere, **{"fur": clfur.Strands(inner=1, outer=1), **given})
    with pytest.raises(clfur.Error, match=f"shadows is 'deep', but {what}; allowed: 'length', or 'deep' without"):
        clfur.render(scene, settings=DEEP)
