"""What holds for every picture, whatever is in it: tried on scenes that are drawn by lot."""

import attrs
import numpy as np
import pytest
from support.anything import BALL, RASTERS, any_curves, any_scene, any_settings, drawn

import clfur


@pytest.mark.parametrize("seed", range(24))
def test_alpha_is_a_share(gpu, seed):
    """Of both rasters, with shells, strands, body and all of them; and what the output coverage says, to the bit."""
    images = drawn(any_scene(seed), gpu, any_settings(seed))
    alpha = images["color"][..., 3]
    assert alpha.max() <= 1 and images["coverage"].tobytes() == alpha.tobytes()
    assert ((images["id"] != -1) <= (alpha > 0)).all()


@pytest.mark.parametrize("raster", RASTERS)
@pytest.mark.parametrize("blur", ["all", "edges"])
def test_alpha_is_a_share_when_it_is_blurred(gpu, raster, blur):
    for seed in range(3):
        for sigma in (.1, .7, 16):
            settings = any_settings(seed, raster=raster, blur=blur, blur_sigma=sigma)
            assert drawn(any_scene(seed), gpu, settings)["color"][..., 3].max() <= 1
    flat = attrs.evolve(any_scene(1), camera=clfur.Camera(eye=(0, 0, 1.6), size=(37, 29)))   # all of it is covered
    assert drawn(flat, gpu, any_settings(1, raster=raster, blur=blur, blur_sigma=5))["color"][..., 3].max() <= 1


# --- strands in any order, from either end --------------------------------------------------------------------


def tuft(seed, n=600):
    """Strands of all lengths and bends, with a colour and a width at every point: (points, counts, widths, colours)."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(2, 12, n)
    roots = rng.normal(size=(n, 3))
    roots /= np.linalg.norm(roots, axis=1, keepdims=True)
    along = np.concatenate([np.arange(count) for count in counts])
    of = np.repeat(np.arange(n), counts)
    bend = rng.normal(0, .004, (n, 3))
    points = roots[of] * (1 + .04 * along[:, None]) + bend[of] * along[:, None] ** 2
    width = np.repeat(10 ** rng.uniform(-3.5, -1.5, n), counts) * (1 - .06 * along)
    return points, counts, width, rng.uniform(0, 1, (n, 3))[of] * (.5 + .04 * along[:, None])


def of_tuft(parts, seed):
    points, counts, width, color = parts
    fur = clfur.Curves(points, counts=counts, width=width, color=color, seed=seed)
    camera = clfur.Camera(eye=(1, .4, 3), size=(61, 47))
    return clfur.Scene(None, fur, camera, clfur.Light(direction=(-1, -2, -1)))


def rows_of(counts, order):
    """Numbers of the points of strands in this order."""
    first = np.cumsum(counts) - counts
    return np.concatenate([np.arange(first[k], first[k] + counts[k]) for k in order])


@pytest.mark.parametrize("raster", RASTERS)
@pytest.mark.parametrize("lod", [0, .5, 2])
def test_the_order_of_strands_changes_no_bit(gpu, raster, lod):
    settings = clfur.Settings(raster=raster, lod=lod, grid=32)
    for seed in range(3):
        points, counts, width, color = parts = tuft(seed)
        order = np.random.default_rng(seed).permutation(len(counts))
        rows = rows_of(counts, order)
        shuffled = points[rows], counts[order], width[rows], color[rows]
        one, other = (drawn(of_tuft(each, seed), gpu, settings) for each in (parts, shuffled))
        for name in ("color", "depth", "tangent", "normal", "coverage"):
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
        hit = one["id"] >= 0
        np.testing.assert_array_equal(order[other["id"][hit]], one["id"][hit])


@pytest.mark.parametrize("raster", RASTERS)
@pytest.mark.parametrize("lod", [0, .5, 2])
def test_strands_may_be_given_from_their_tips(gpu, raster, lod):
    """The segments are the same but for rounding: rms up to 2.1e-6, measured."""
    settings = clfur.Settings(raster=raster, lod=lod, grid=32)
    for seed in range(3):
        points, counts, width, color = parts = tuft(seed)
        rows = np.concatenate([part[::-1] for part in np.split(np.arange(len(points)), np.cumsum(counts)[:-1])])
        turned = points[rows], counts, width[rows], color[rows]
        one, other = (drawn(of_tuft(each, seed), gpu, settings)["color"] for each in (parts, turned))
        assert np.sqrt(((one - other) ** 2).mean()) < 1e-5


# --- twice as large -------------------------------------------------------------------------------------------


def covered(scene, gpu, settings, size):
    return clfur.render(attrs.evolve(scene, camera=attrs.evolve(scene.camera, size=size)), gpu, settings,
                        "coverage")["coverage"].astype(float)


def at_both_sizes(scene, gpu, settings, size=(64, 48), larger=None):
    """What of each pixel is covered, and the mean of the four pixels that are it in a picture twice as large, which may
    have settings of its own."""
    width, height = size
    twice = covered(scene, gpu, larger or settings, (2 * width, 2 * height))
    return covered(scene, gpu, settings, size), twice.reshape(height, 2, width, 2).mean((1, 3))


def haired(seed):
    """A scene by lot: hair of any width on a ball, or curves."""
    rng = np.random.default_rng(seed)
    width, eye = 10 ** rng.uniform(-4, -1.3), (0, .4, rng.uniform(1.5, 8))
    hair = clfur.HairType(segments=6, segment_length=.05, width=width, curl=(.02, 1), length_variation=.3)
    n = int(min(40 / width, 10 ** rng.uniform(2, 4.5)))
    fur = clfur.Strands(types=hair, roots=n, seed=seed) if seed % 2 else any_curves(rng, 2000)
    return clfur.Scene(BALL if seed % 2 else None, fur, clfur.Camera(eye=eye), body_color=None)


@pytest.mark.parametrize("lod, most", [(0, .08), (.05, .084), (.2, .098), (.5, .124)])
def test_twice_the_size_covers_as_much(gpu, lod, most):
    """Averaged down within .02: the whole picture (of 60 scenes by lot at most .0069 more or less), and 16 x 16 pixels
    of it in root mean square (at most .0070, .0071, .0082, .0134).  Not single pixels that show anything: they differ
    by up to .5, in root mean square by up to .16: pixels at the larger size keep twice as many strands, half as wide
    (see the next test), and without lod a pixel knows how much of it a strand covers, not where, and takes two for
    independent (see below). Raster "samples" draws strands as at least 1/samples of a pixel wide, and cannot hold even
    the first: it is off by up to .12, in pixels by .3.
    """
    for seed in range(12):
        one, other = at_both_sizes(haired(seed), gpu, clfur.Settings(lod=lod, shadows="off"))
        apart, shown = one - other, (one > 0) | (other > 0)
        assert abs(apart.mean()) < .02
        blocks, some = apart.reshape(3, 16, 4, 16).mean((1, 3)), shown.reshape(3, 16, 4, 16).any((1, 3))
        assert np.sqrt((blocks[some] ** 2).mean()) < .02
        assert np.sqrt((apart[shown] ** 2).mean()) < most


@pytest.mark.parametrize("lod", [.05, .2, .5])
@pytest.mark.parametrize("masks, most", [(0, .08), (4, .05)])
def test_twice_the_size_at_twice_the_lod_has_the_same_strands(gpu, lod, masks, most):
    """So what differs is what differs without lod: where in a pixel strands lie, to a patch with masks. These are
    fewer and wider: up to a sixth more, measured."""
    for seed in range(0, 12, 2):
        small, large, none = (clfur.Settings(lod=each, shadows="off", masks=masks) for each in (lod / 2, lod, 0))
        scene, apart = haired(seed), []
        for settings in (none, none), (small, large):
            one, other = at_both_sizes(scene, gpu, settings[0], larger=settings[1])
            apart.append(np.sqrt(((one - other)[(one > 0) | (other > 0)] ** 2).mean()))
        assert apart[1] < most and apart[1] < 1.25 * apart[0] + .002, (seed, apart)


@pytest.mark.parametrize("lod", [0, .1, .5, 1])
def test_twice_the_size_covers_as_much_of_each_pixel_where_none_hides_another(gpu, lod):
    """Bent strands of .1 to .5 pixels (1 in the larger picture), no two in one pixel: within float32's rounding of
    places. Thinned ones are the same at twice the lod."""
    rng = np.random.default_rng(4)
    x, y = np.arange(-58, 60, 4.0), np.linspace(-30, 30, 9)
    points = np.zeros((len(x), len(y), 3))
    points[..., 0], points[..., 1] = x[:, None] + rng.uniform(-.7, .7, (len(x), len(y))), y
    fur = clfur.Curves(points, width=rng.uniform(.1, .5, len(x)).repeat(len(y)))
    camera = clfur.Camera(eye=(0, 0, 1000), fov=2 * np.degrees(np.arctan(48 / 1000)), size=(128, 96))
    settings = [clfur.Settings(lod=each, shadows="off") for each in (lod / 2, lod)]
    scene = clfur.Scene(None, fur, camera, body_color=None)
    one, other = at_both_sizes(scene, gpu, settings[0], (128, 96), settings[1])
    strands = len(np.unique((np.flatnonzero((one > 0).any(0)) + 2) // 4))
    assert strands > 25 if lod < .2 else strands > 5
    np.testing.assert_allclose(other, one, rtol=0, atol=2e-5)


@pytest.mark.parametrize("aside, larger", [(0, .5), (.5, 1)])
def test_where_in_a_pixel_strands_lie_is_not_known(gpu, aside, larger):
    """Two strands of half a pixel cover .75 of it, behind each other or side by side; twice as large .5, or 1."""
    points = np.zeros((2, 2, 3))
    points[:, :, 0] = np.array([[-.25], [-.25 + aside]])
    points[:, :, 1] = -9, 9
    points[:, :, 2] = [[0], [-1e-3]]
    fur = clfur.Curves(points, width=.5)
    # One unit is one pixel; that of the middle goes from -1/2 to 1/2.
    camera = clfur.Camera(eye=(0, 0, 1000), fov=2 * np.degrees(np.arctan(7.5 / 1000)), size=(15, 15))
    scene = clfur.Scene(None, fur, camera, body_color=None)
    one, other = (image[7, 7] for image in at_both_sizes(scene, gpu, clfur.Settings(shadows="off"), (15, 15)))
    assert (one, other) == (pytest.approx(.75, abs=.01), pytest.approx(larger, abs=.01))
