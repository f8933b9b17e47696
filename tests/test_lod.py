"""lod against its twin, and against what must hold for every head of hair seen from everywhere."""

import hashlib
import itertools
from dataclasses import replace

import attrs
import numpy as np
import pytest
from support.devices import DEVICES
from support.plans import recorded

import clfur
from clfur import layout
from clfur.pipeline.views import view_of
from clfur.stages.lod import thin
from clfur.stages.strands import grow, upload_curves
from clfur.stages.tessellate import tessellate
from clfur.twin import lod as twin


def flat_view(pixels):
    """An orthographic camera that looks along -z: so many pixels a world unit."""
    view = np.zeros((), layout.View)
    to_screen = np.diag([pixels, -pixels, .01, 0.])
    to_screen[:, 3] = 100, 100, .5, 1
    view["to_screen"], view["to_world"], view["eye"] = to_screen.T, np.linalg.inv(to_screen).T, (0, 0, 1, 0)
    view["size"], view["scale"][:2], view["rows"][1] = (200, 200, 4, 1), (pixels, 32), 200
    return view


def near_view(distance=3.0):
    """A pinhole camera this far from the origin."""
    fur = clfur.Curves(np.zeros((1, 2, 3)))
    return view_of(clfur.Scene(fur=fur, camera=clfur.Camera(eye=(0, 0, distance), size=(320, 240))), 4)


def rods(n, width, segments=1, length=1.0, **keys):
    """n straight strands along x, each at a height of its own."""
    points = np.zeros((n, segments + 1, 3))
    points[..., 0] = np.linspace(0, length, segments + 1)
    points[..., 1] = np.arange(n)[:, None] / n
    return clfur.Curves(points, width=width, **keys)


def wild(n, most=40, seed=2, per_point=True):
    """Strands of all lengths, bald ones and single points among them, with widths and colours at every point; some bend
    little and some much, and some are behind an eye at z = 3."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, most + 1, n)
    step = rng.normal(size=(n, 1, 3)) + rng.uniform(0, 2, (n, 1, 1)) ** 3 * rng.normal(size=(n, most, 3))
    points = rng.uniform(-1, 1, (n, 1, 3)) * (1, 1, 4) + .01 * np.cumsum(step, 1)
    here = np.arange(most) < counts[:, None]
    total = int(counts.sum())
    width = rng.uniform(.002, .01, n)[:, None] * np.linspace(1, .3, most)
    width[::11] = 0
    color = .5 + .3 * np.sin(np.linspace(0, 6, most))[:, None] * rng.uniform(0, 1, (n, 1, 3))
    colors = color[here] if per_point else rng.uniform(0, 1, (n, 3))
    assert total != n
    return clfur.Curves(points[here], counts=counts, width=width[here], color=colors)


def grown_fur(gpu, sphere, seed=3):
    hair = clfur.HairType(segments=12, segment_length=.02, curl=(.01, 1.5), width=.004, direction_variation=.3)
    fur = clfur.Strands(types=[hair], roots="faces", seed=seed, inner=1, outer=1)
    return grow(gpu, tessellate(gpu, sphere, 1, 1, "pn"), fur)


def strands_of(grown):
    """(points [n, 4], colors [n, 4] or None) of each strand, on the host."""
    points, colors = grown.points.get(), grown.colors.get()
    spans = grown.spans.get().astype(int)
    return [(points[a:a + n], colors[a:a + n] if grown.color_per == 2 else None) for a, n in spans]


def factors(grown, thinned):
    """By how much each strand's width at the root grew; 0 of those that went, or have none."""
    first, count = thinned.spans.get().astype(int).T
    before, after = (strands.points.get()[first * (count > 0), 3] for strands in (grown, thinned))
    return np.divide(after, before, out=np.zeros_like(after), where=(count > 0) & (before > 0))


def check_twin(gpu, grown, view, lod, seed, by_place=False):
    thinned = thin(gpu, grown, view, lod, seed, by_place)
    for name in ("strand_of", "normals", "uv", "types"):
        assert getattr(thinned, name) is getattr(grown, name)
    assert (thinned.colors is grown.colors) == (grown.color_per != 2)
    assert (thinned.first_strand, thinned.first_point, thinned.color_per) == (
        grown.first_strand, grown.first_point, grown.color_per)
    if not by_place:
        np.testing.assert_array_equal(thinned.spans.get()[:, 0], grown.spans.get()[:, 0])
    (first, count), begin = thinned.spans.get().astype(int).T, grown.spans.get()[:, 0].astype(int)
    assert (first >= begin).all() and (first + count <= begin + grown.spans.get()[:, 1]).all()
    to_screen, scale = view["to_screen"].astype(float).T, float(view["scale"][0])
    checked = []
    for number, (before, after) in enumerate(zip(strands_of(grown), strands_of(thinned))):
        colors = None if before[1] is None else before[1][:, :3].astype(float)
        name = None if by_place else grown.first_strand + number
        factor, kept = twin.thin(to_screen, scale, before[0], name, seed, lod, colors)
        assert len(after[0]) == len(kept), number
        np.testing.assert_array_equal(after[0][:, :3], before[0][kept, :3])
        if colors is not None:
            np.testing.assert_array_equal(after[1], before[1][kept])
        # A factor is one minus a place, over a mean: rounded to a few 2^-24 of the largest.
        np.testing.assert_allclose(after[0][:, 3], factor * before[0][kept, 3], rtol=1e-6,
                                   atol=4e-6 * before[0][:, 3].max(initial=0))
        checked.append((len(before[0]), len(kept), factor))
    return np.array(checked)


@pytest.mark.small
@pytest.mark.parametrize("per_point", [True, False], ids=["points-colours", "strands-colours"])
@pytest.mark.parametrize("lod", [.25, 4])
@pytest.mark.parametrize("by_place", [False, True])
def test_twin_small(gpu, lod, per_point, by_place):
    fur = wild(60, 20, per_point=per_point)
    checked = check_twin(gpu, upload_curves(gpu, fur), near_view(), lod, 0, by_place)
    assert (checked[:, 1] < checked[:, 0]).any() and (checked[:, 0] == 0).any()


@pytest.mark.parametrize("lod", [.6, 1, 4])
@pytest.mark.parametrize("kind", ["wild", "grown", "flat", "wild by place"])
def test_twin(gpu, sphere, kind, lod):
    if kind == "grown":
        grown, view, seed = grown_fur(gpu, sphere), near_view(2.5), 3
    else:
        fur = wild(600)
        grown, seed = upload_curves(gpu, fur), 2**32 - 1
        view = flat_view(90) if kind == "flat" else near_view()
    grown = replace(grown, first_strand=77)
    checked = check_twin(gpu, grown, view, lod, seed, kind == "wild by place")
    assert (checked[:, 1] < checked[:, 0]).any()
    assert (checked[:, 2] > 1).any() and (checked[checked[:, 0] > 0, 2] == 0).any()


@pytest.mark.parametrize("by_place", [False, True])
def test_strands_where_a_driver_ends_long_loops(gpu, another, by_place):
    """They go on in another launch: the same bits."""
    fur, thinned = wild(80, 60, per_point=True), []
    limited = another(lanes=1, hinted=1, steps=500)
    launched = recorded(limited)
    for one in gpu, limited:
        result = thin(one, upload_curves(one, fur), near_view(), 1, 0, by_place)
        thinned.append([result.spans.get().tolist(), *((a.tobytes(), b.tobytes()) for a, b in strands_of(result))])
    assert thinned[0] == thinned[1] and launched.count("lod.thin") > 3


# --- fewer and wider ------------------------------------------------------------------------------------


def test_the_mean_of_all_widths_stays():
    """For every share kept, by numerical integration over the places."""
    places = (np.arange(200_000) + .5) / 200_000
    for k in (.125, .2, .5, .6, 2 / 3, .7, .9, .99, 1 - 1e-6, 1):
        factor = twin.widening(places, k)
        assert factor.mean() == pytest.approx(1, abs=2e-5)
        assert factor.max() <= .8 / k * 1.000001 or k > 2 / 3
        assert ((factor > 0) == (places < 1.5 * k)).all()
    assert (twin.widening(places, 1.) == 1).all()
    assert twin.widening(0, 1 / 8) == pytest.approx(6.4)


@pytest.mark.parametrize("k", [1, .9, .5, .2, .125, .01])
def test_the_hairs_area_stays(gpu, k):
    n, lod = 40_000, 1.
    grown = upload_curves(gpu, rods(n, .01))
    factor = factors(grown, thin(gpu, grown, flat_view(100 * k), lod))
    kept = max(k, 1 / 8)
    sigma = ((twin.widening((np.arange(n) + .5) / n, kept) ** 2).mean() - 1) ** .5
    assert abs(factor.mean() - 1) <= 4 * sigma / n ** .5
    assert abs((factor > 0).mean() - min(1.5 * kept, 1)) < 4 * .5 / n ** .5
    if k == 1:
        assert (factor == 1).all()


def test_strands_as_wide_as_lod_are_the_same_bits(gpu, sphere):
    grown = grown_fur(gpu, sphere)
    view = near_view(2.5)
    thinned = thin(gpu, grown, view, 1e-4)
    for name in ("points", "spans"):
        np.testing.assert_array_equal(getattr(thinned, name).get(), getattr(grown, name).get())
    pixels = .004 * float(view["scale"][0])       # as wide as a strand is at distance 1
    assert (factors(grown, thin(gpu, grown, view, .9 * pixels / 3.8)) == 1).all()
    assert (factors(grown, thin(gpu, grown, view, pixels / 1.2)) != 1).all()


def test_the_order_is_random_and_for_ever(gpu):
    """Neither a prefix nor every n-th, another for another seed, and a strand's own wherever its part begins."""
    n = 4000
    fur = rods(n, .01)
    grown, view = upload_curves(gpu, fur), flat_view(20)
    kept = factors(grown, thin(gpu, grown, view, 1)) > 0
    assert abs(kept.mean() - .3) < .03
    for piece in np.split(kept, 8):
        assert abs(piece.mean() - .3) < .1
    assert abs((kept[1:] & kept[:-1]).mean() - .09) < .02
    other = factors(grown, thin(gpu, grown, view, 1, 9)) > 0
    assert abs((kept & other).mean() - .09) < .02
    part = upload_curves(gpu, fur, (1234, 2345))
    np.testing.assert_array_equal(factors(part, thin(gpu, part, view, 1)) > 0, kept[1234:2345])
    # What is kept of few is also kept of more.
    more = factors(grown, thin(gpu, grown, view, .7)) > 0
    assert (more >= kept).all() and more.sum() > kept.sum()


def test_nothing_pops_up(gpu):
    """20 times as far in small steps: no strand's width jumps, and all together keep their area."""
    n, lod, step = 20_000, 1., 1.05
    fur = rods(n, .04)
    grown, widths, p = upload_curves(gpu, fur), [], []
    for pixels in 30 * step ** -np.arange(62.):
        p.append(.04 * pixels)
        widths.append(factors(grown, thin(gpu, grown, flat_view(pixels), lod)))
    p, widths = np.array(p), np.array(widths)
    assert p[0] > 1 and p[0] / p[-1] > 19 and (widths[0] == 1).all()
    drawn = widths * p[:, None]
    assert drawn.max() <= p[0] and drawn[p < 2 / 3].max() == pytest.approx(.8 * lod, rel=1e-5)
    assert .05 * lod < np.abs(np.diff(drawn, axis=0)).max() < .15 * lod
    area = widths.mean(1)
    assert np.abs(area - 1).max() < .06 and np.abs(np.diff(area)).max() < .01


def test_covered_area_stays_in_pictures(gpu):
    """Against all strands, from 1.2 to 0.06 pixels wide, by the area they cover; what is left is which are kept."""
    rng = np.random.default_rng(4)
    way = rng.normal(size=(4000, 1, 3))
    points = rng.uniform(-1, 1, (4000, 1, 3)) + .4 * way / np.linalg.norm(way, axis=-1, keepdims=True) * np.linspace(
        0, 1, 5)[:, None]
    fur, ratios = clfur.Curves(points, width=.02), []
    settings = [clfur.Settings(raster="coverage", lod=lod, shadows="off") for lod in (0, .5)]
    for distance in 5 * 20 ** np.linspace(0, 1, 25):
        scene = clfur.Scene(fur=fur, camera=clfur.Camera(eye=(0, 0, distance), size=(320, 240)))
        all_of, few = (clfur.render(scene, gpu, each)[..., 3].sum(dtype=float) for each in settings)
        ratios.append(few / all_of)
    assert ratios[0] == pytest.approx(1, abs=1e-3)
    assert np.abs(np.array(ratios) - 1).max() < .03 and np.abs(np.diff(ratios)).max() < .015


# --- fewer points ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("lod", [.2, 1, 4])
def test_points_left_out_are_near_their_line(gpu, sphere, lod):
    """Every one of them, also in pixels where the camera sees it."""
    left_out = 0
    for grown, view in ((grown_fur(gpu, sphere), near_view(2.5)),
                        (upload_curves(gpu, wild(800)), near_view()), (upload_curves(gpu, wild(800)), flat_view(90))):
        to_screen, scale = view["to_screen"].astype(float).T, float(view["scale"][0])
        for (before, _), (after, _) in zip(strands_of(grown), strands_of(thin(gpu, grown, view, lod))):
            if not len(after):
                continue
            before, after = before.astype(float), after.astype(float)
            kept = [int(np.flatnonzero((before[:, :3] == p[:3]).all(1))[0]) for p in after]
            assert kept[0] == 0 and kept[-1] == len(before) - 1 and (np.diff(kept) > 0).all()
            for a, b in itertools.pairwise(kept):
                way, off = (before[b] - before[a])[:3], (before[a + 1:b] - before[a])[:, :3]
                if not len(off):
                    continue
                at = np.clip(off @ way / (way @ way), 0, 1)[:, None]
                near = before[a, :3] + at * way
                w = before[[a, b], :3] @ to_screen[3, :3] + to_screen[3, 3]
                distance = np.linalg.norm(off - at * way, axis=1) * scale / w.min()
                assert w.min() > 0 and distance.max() <= lod / 4 * 1.0001
                # On the film a step is longer off the middle, and where it leads towards the eye.
                film = [(c[:, :2] / c[:, 3:]) for c in (
                    np.column_stack([p, np.ones(len(p))]) @ to_screen.T for p in (near, before[a + 1:b, :3]))]
                if w.min() > 1:
                    assert np.linalg.norm(film[0] - film[1], axis=1).max() <= lod / 4 * 2.5
                left_out += len(off)
    assert left_out > 300


def test_straight_strands_become_four_segments(gpu):
    """Or a few more of 16 each, if they are very long; those of four stay."""
    for segments, points in ((1, 2), (2, 3), (4, 5), (8, 5), (16, 5), (17, 5), (64, 5), (65, 6), (100, 8)):
        grown = upload_curves(gpu, rods(50, .5, segments))
        assert (thin(gpu, grown, flat_view(100), 1).spans.get()[:, 1] == points).all(), segments


def test_what_bends_more_than_a_quarter_of_lod_is_kept(gpu):
    """A strand that is off by one pixel at every other point, and one that comes back on itself."""
    along = np.linspace(0, 1, 9)
    zigzag = np.stack([along, .01 * (np.arange(9) % 2), 0 * along], 1)
    back = np.stack([along[[0, 2, 1, 4, 3, 6, 5, 8, 7]], 1 + 0 * along, 0 * along], 1)
    grown = upload_curves(gpu, clfur.Curves([zigzag, back], width=.1))
    for lod, points in (3.9, [9, 9]), (4, [5, 9]):
        assert thin(gpu, grown, flat_view(99.9), lod).spans.get()[:, 1].tolist() == points


def test_widths_and_colours_between_are_kept(gpu):
    """Bulges, and stripes, are more than straight lines."""
    red, green = (1, 0, 0), (0, 1, 0)
    for keys, points in (
            ({"width": np.tile([.1, .2, .1, .2, .1, .2, .1, .2, .1], (9, 1))}, 9),
            ({"width": np.tile(np.arange(1, 10) * .1, (9, 1))}, 5),
            ({"width": .1, "color": np.tile([red, green, red, green, red, green, red, green, red], (9, 1, 1))}, 9),
            ({"width": .1, "color": np.tile([red] * 9, (9, 1, 1))}, 5)):
        thinned = thin(gpu, upload_curves(gpu, rods(9, segments=8, **keys)), flat_view(100), 1)
        assert (thinned.spans.get()[:, 1] == points).all(), keys


# --- odd strands and cameras ----------------------------------------------------------------------------


def test_odd_strands(gpu):
    """Bald ones stay bald; of single points a share is kept; those without width, or behind the eye, stay."""
    n = 4000
    counts = np.zeros(n, int)
    grown = upload_curves(gpu, clfur.Curves(np.zeros((0, 3)), counts=counts))
    assert not thin(gpu, grown, flat_view(1), 4).spans.get()[:, 1].any()
    dots = upload_curves(gpu, clfur.Curves(np.random.default_rng(1).uniform(-1, 1, (n, 1, 3)), width=.01))
    assert abs(thin(gpu, dots, flat_view(50), 1).spans.get()[:, 1].mean() - .75) < .03
    thread = upload_curves(gpu, rods(n, 0.))
    assert (thin(gpu, thread, flat_view(50), 1).spans.get()[:, 1] == 2).all()
    curved = np.random.default_rng(1).normal(size=(n, 5, 3)) * .1
    for shift in (0, 3), (0, 5):     # around the eye: what is behind it with an end stays whole
        brought = upload_curves(gpu, clfur.Curves(curved + (*shift[:1], 0, shift[1]), width=1e-4))
        thinned = thin(gpu, brought, near_view(), 4)
        w = 3 - (curved[:, [0, -1], 2] + shift[1])
        behind, spans = w.min(1) <= 0, thinned.spans.get()[:, 1]
        assert behind.any() and (spans[behind] > 1).all()
        assert (factors(brought, thinned)[behind] == 1).all()
        if shift[1] == 3:
            assert (spans[w.min(1) > .01] == 0).any()
        else:
            np.testing.assert_array_equal(thinned.points.get(), brought.points.get())


def test_the_nearer_end_decides(gpu):
    """A strand towards the eye is as wide as where it comes nearest, whichever end is the root."""
    n = 2000
    ends = np.zeros((n, 2, 3))
    ends[:, 1, 2] = 2
    for points in (ends, ends[:, ::-1]):
        grown = upload_curves(gpu, clfur.Curves(points, width=.01))
        view = near_view()
        at_tip = .01 * float(view["scale"][0]) / 1
        assert (factors(grown, thin(gpu, grown, view, .999 * at_tip)) == 1).all()
        assert (factors(grown, thin(gpu, grown, view, 2 * at_tip)) == 0).any()


# --- whole frames ---------------------------------------------------------------------------------------


def furry(sphere, eye=(0, .4, 3.2), **keys):
    hair = clfur.HairType(segments=8, segment_length=.03, width=.004, force_weight=.1, direction_variation=.3)
    fur = clfur.Strands(types=[hair], roots=6000, seed=3, inner=1, outer=1)
    return clfur.Scene(mesh=sphere, fur=fur, camera=clfur.Camera(eye=eye, size=(161, 121)), **keys)


@pytest.mark.parametrize("raster", ["samples", "coverage"])
def test_the_frame_tells_what_was_drawn(gpu, sphere, raster):
    scene, settings = furry(sphere), clfur.Settings(raster=raster)
    whole, same, few = (clfur.draw(scene, gpu, attrs.evolve(settings, lod=lod)) for lod in (0, 0, 2))
    assert whole.strands == 6000 and whole.segments == 48_000 and "lod" not in whole.stages
    assert few.strands < 2000 and few.segments < 6 * few.strands and few.stages["lod"] > 0
    np.testing.assert_array_equal(whole.images["color"], same.images["color"])
    fine = clfur.draw(scene, gpu, attrs.evolve(settings, lod=1e-5), hashes=True)
    assert fine.hashes["visibility"] == clfur.draw(scene, gpu, settings, hashes=True).hashes["visibility"]
    assert fine.strands == 6000


@pytest.mark.parametrize("raster", ["samples", "coverage"])
@pytest.mark.parametrize("fur", [None, clfur.Shells(frequency=8), clfur.Curves(np.zeros((0, 2, 3)))])
def test_without_strands_nothing_changes(gpu, sphere, fur, raster):
    scene = clfur.Scene(mesh=sphere, fur=fur, camera=clfur.Camera(size=(16, 12)))
    first, second = (clfur.draw(scene, gpu, clfur.Settings(raster=raster, lod=lod)) for lod in (0, 1))
    np.testing.assert_array_equal(first.images["color"], second.images["color"])
    assert second.strands == 0 and second.images["color"][..., 3].any()


@pytest.mark.parametrize("raster", ["samples", "coverage"])
@pytest.mark.parametrize("shadows", ["length", "count"])
def test_all_strands_cast_shadows(gpu, sphere, raster, shadows):
    """However few of them the camera sees: the very same shadows, which a film keeps, as it has them without lod."""
    near = furry(sphere)
    far = clfur.Scene(mesh=sphere, fur=near.fur, light=near.light,
                      camera=clfur.Camera(eye=(0, .4, 30), size=(161, 121)))
    settings = clfur.Settings(raster=raster, shadows=shadows)
    gpu.forget()
    frames = [clfur.draw(scene, gpu, attrs.evolve(settings, lod=lod), hashes=True)
              for scene, lod in ((near, 0), (near, .5), (far, .5), (far, 2))]
    assert ["voxelize" in frame.stages for frame in frames] == [True, False, False, False]
    assert len({frame.hashes["voxels"] for frame in frames}) == 1
    assert frames[0].strands > frames[1].strands > frames[2].strands


@pytest.mark.parametrize("raster", ["samples", "coverage"])
def test_a_frame_of_a_film_is_as_if_drawn_alone(gpu, sphere, raster):
    """Whatever was drawn before it, forwards or backwards: nothing that is kept depends on a camera of before."""
    near, settings = furry(sphere), clfur.Settings(raster=raster, lod=1)
    film = [clfur.Scene(mesh=sphere, fur=near.fur, light=near.light,
                        camera=clfur.Camera(eye=(np.sin(turn), .4, z), size=(61, 47)))
            for turn, z in ((0, 3.2), (.01, 3.21), (.5, 5), (0, 60))]
    alone = []
    for scene in film:
        gpu.forget()
        alone.append(clfur.draw(scene, gpu, settings, hashes=True))
    for order in (range(4), reversed(range(4))):
        for number in order:
            frame = clfur.draw(film[number], gpu, settings, hashes=True)
            np.testing.assert_array_equal(frame.images["color"], alone[number].images["color"])
            assert frame.hashes == alone[number].hashes


@pytest.mark.parametrize("raster", ["samples", "coverage"])
def test_the_light_stays_on_average(gpu, sphere, raster):
    """What thinned hair lets through and what it shows is what all hair does, but for its places."""
    scene = furry(sphere, eye=(0, .4, 6), body_color=(1, 1, 1))
    whole, few = (clfur.render(scene, gpu, clfur.Settings(samples=16, raster=raster, lod=lod))[..., :3].mean()
                  for lod in (0, .5))
    assert few == pytest.approx(whole, rel=.04)


@pytest.mark.parametrize("wrong", [-1, 4.1, float("nan"), "1", True, None])
def test_lod_is_checked(wrong):
    with pytest.raises(clfur.Error, match="Settings.lod is .* allowed: a finite number >= 0, <= 4"):
        clfur.Settings(lod=wrong)


def test_every_device_gives_the_same_bits():
    fur = wild(3000)
    digests = set()
    for device in DEVICES:
        gpu = clfur.Scheduler(device)
        thinned = thin(gpu, upload_curves(gpu, fur), near_view(), 1)
        digests.add(hashlib.sha256(b"".join(
            np.concatenate([part.ravel() for part in strand]).tobytes()
            for strand in strands_of(thinned) if len(strand[0]))).hexdigest())
    assert len(digests) == 1
