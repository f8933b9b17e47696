"""Strands of USD: types, bases and wraps against the curves' own formulas, every interpolation, axes, transforms."""

import numpy as np
import pytest

import clfur
from clfur.files.bases import unrolled

pxr = pytest.importorskip("pxr", reason='needs pip install "clfur[usd]"')
from pxr import Gf, Usd, UsdGeom, Vt  # noqa: E402

SPLINES = [("bezier", "nonperiodic"), ("bezier", "periodic"), ("bspline", "nonperiodic"), ("bspline", "periodic"),
           ("bspline", "pinned"), ("catmullRom", "nonperiodic"), ("catmullRom", "periodic"), ("catmullRom", "pinned")]
COUNTS = {"nonperiodic": [7, 4], "periodic": [6, 9], "pinned": [5, 2]}


def save(path, points, counts, basis="linear", wrap="nonperiodic", widths=(.01,), how="constant", up="Y", more=None):
    """Write BasisCurves as another program would; ``more`` gets them and the stage."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.Xform.Define(stage, "/groom")
    curves = UsdGeom.BasisCurves.Define(stage, "/groom/hair")
    curves.CreateTypeAttr("linear" if basis == "linear" else "cubic")
    if basis != "linear":
        curves.CreateBasisAttr(basis)
    curves.CreateWrapAttr(wrap)
    curves.CreateCurveVertexCountsAttr(Vt.IntArray([int(each) for each in counts]))
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, np.float32)))
    if widths is not None:
        curves.CreateWidthsAttr(Vt.FloatArray([float(each) for each in widths]))
        curves.SetWidthsInterpolation(how)
    if more:
        more(curves, stage)
    stage.Save()
    return path


def curve_at(points, basis, t, step):
    """The place on a spline of four points, written out; scalar, of its basis' own textbook form."""
    a, b, c, d = (points[(step + k) % len(points)] for k in range(4))
    if basis == "bezier":
        return (1 - t)**3 * a + 3 * t * (1 - t)**2 * b + 3 * t * t * (1 - t) * c + t**3 * d
    if basis == "bspline":
        e = 1 - t
        return (e**3 * a + (3 * t**3 - 6 * t * t + 4) * b + (3 * e**3 - 6 * e * e + 4) * c + t**3 * d) / 6
    return (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t * t + (3 * b - a - 3 * c + d) * t**3) / 2


@pytest.mark.parametrize("basis, wrap", SPLINES)
def test_cubic_curves_keep_within_the_tolerance(tmp_path, basis, wrap):
    rng, counts = np.random.default_rng(7), COUNTS[wrap]
    points = rng.normal(size=(sum(counts), 3)).astype(np.float32)
    path = save(tmp_path / "a.usda", points, counts, basis, wrap)
    back = clfur.load_curves(path, tolerance=.5)   # .005
    fine = clfur.load_curves(path, tolerance=.05)
    assert len(fine.points) > 2 * len(back.points)
    first = 0
    for number, count in enumerate(counts):
        own = points[first:first + count].astype(np.float64)
        first += count
        if wrap == "pinned":
            own = np.concatenate([[2 * own[0] - own[1]], own, [2 * own[-1] - own[-2]]])
        step = 3 if basis == "bezier" else 1
        steps = range(0, count, step) if wrap == "periodic" else range(0, len(own) - 3, step)
        ends = np.cumsum([0, *back.counts])
        line = back.points[ends[number]:ends[number + 1]].astype(np.float64)
        begin, end = curve_at(own, basis, 0, 0), curve_at(own, basis, 1, steps[-1])
        assert np.allclose(line[0], begin, atol=1e-6) and np.allclose(line[-1], end, atol=1e-6)
        if wrap == "pinned":   # which begins and ends at its own points
            assert np.allclose(line[0], own[1], atol=1e-6) and np.allclose(line[-1], own[-2], atol=1e-6)
        places = np.array([curve_at(own, basis, t, k) for k in steps for t in np.linspace(0, 1, 40)])
        a, b = line[:-1], line[1:]
        share = ((places[:, None] - a) * (b - a)).sum(2) / ((b - a)**2).sum(1)
        near = a + np.clip(share, 0, 1)[..., None] * (b - a)
        assert np.linalg.norm(places[:, None] - near, axis=2).min(axis=1).max() <= .005 + 1e-6


@pytest.mark.parametrize("basis, wrap", [*SPLINES, ("linear", "nonperiodic"), ("linear", "periodic")])
def test_widths_of_each_interpolation(tmp_path, basis, wrap):
    counts = [7, 4] if wrap != "periodic" else [6, 9]
    points = np.random.default_rng(8).normal(size=(sum(counts), 3))
    segments = {"nonperiodic": [4, 1], "periodic": counts, "pinned": [6, 3]}[wrap]
    if basis in ("linear", "bezier"):
        segments = {"linear": [6, 3], "bezier": [2, 1]}[basis] if wrap != "periodic" else \
            {"linear": counts, "bezier": [2, 3]}[basis]
    ends = [each + (wrap != "periodic") for each in segments]
    varying = np.concatenate([np.arange(each) * .1 + .1 for each in ends])
    path = save(tmp_path / "varying.usda", points, counts, basis, wrap, varying, "varying")
    back = clfur.load_curves(path, tolerance=.1)
    first = 0
    for count in back.counts.tolist():   # at the ends of segments the values are there, and nothing is above the most
        own = back.width[first:first + count]
        assert own[0] == np.float32(.1)
        first += count
    assert back.width.max() == pytest.approx(varying.max(), rel=1e-6)
    assert back.width[int(back.counts[0]) - 1] == pytest.approx(.1 if wrap == "periodic" else varying[ends[0] - 1])

    uniform = clfur.load_curves(save(tmp_path / "uniform.usda", points, counts, basis, wrap, (.1, .3), "uniform"))
    assert uniform.width == pytest.approx([.1, .3])
    vertex = np.full(len(points), .2)
    of_points = clfur.load_curves(save(tmp_path / "vertex.usda", points, counts, basis, wrap, vertex, "vertex"))
    assert of_points.width == pytest.approx(.2)   # weights add up to one everywhere


def test_vertex_widths_go_along_with_the_places(tmp_path):
    """A width that is x times a factor stays it, on every curve that is no chord of another."""
    points = np.random.default_rng(9).uniform(1, 2, (9, 3))
    for basis, wrap in SPLINES:
        counts = [9] if wrap == "periodic" else [7]
        own = points[:counts[0]]
        path = tmp_path / f"{basis}-{wrap}.usda"
        back = clfur.load_curves(save(path, own, counts, basis, wrap, own[:, 0] / 10, "vertex"))
        assert np.abs(back.width - back.points[:, 0] / 10).max() < 1e-6, (basis, wrap)


def test_pinned_varying_as_usd_core_counts_it(tmp_path):
    """usd-core's own count for a pinned curve is two fewer than its text's: ends stay, the rest is spread."""
    points = np.random.default_rng(10).normal(size=(7, 3))
    path = save(tmp_path / "a.usda", points, [7], "catmullRom", "pinned", [.1, .2, .3, .4, .5], "varying")
    stage = Usd.Stage.Open(str(path))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/groom/hair"))
    assert curves.ComputeVaryingDataSize(Usd.TimeCode.Default()) == 5
    back = clfur.load_curves(path)
    assert back.width[[0, -1]] == pytest.approx([.1, .5]) and (np.diff(back.width) > 0).all()


def test_axes_transforms_and_scales(tmp_path):
    def place(curves, stage):
        UsdGeom.Xformable(stage.GetPrimAtPath("/groom")).AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
        curves.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))

    path = save(tmp_path / "a.usda", [[0, 0, 0], [1, 2, 4]], [2], widths=(.25,), up="Z", more=place)
    back = clfur.load_curves(path)
    assert back.points.tolist() == [[1, 3, -2], [3, 11, -6]]   # (x, z, -y): +Z becomes +Y
    assert back.width == pytest.approx(.5)


def test_colour_opacity_and_time(tmp_path):
    def more(curves, stage):
        curves.CreateDisplayColorPrimvar("uniform").Set(Vt.Vec3fArray([(1, 0, 0), (0, 0, 1)]))
        curves.CreateDisplayOpacityPrimvar("constant").Set([.75])
        curves.GetPointsAttr().Set(Vt.Vec3fArray([(0, 0, 9)] * 4), 10)
        curves.GetPointsAttr().Set(Vt.Vec3fArray([(0, 0, 5)] * 4), 4)

    path = save(tmp_path / "a.usdc", np.zeros((4, 3)), [2, 2], more=more)
    assert (clfur.load_curves(path).points[:, 2] == 5).all()          # the first sample
    assert (clfur.load_curves(path, time=7).points[:, 2] == 7).all()  # USD's own interpolation
    back = clfur.load_curves(path, time=10)
    assert (back.points[:, 2] == 9).all() and back.alpha == .25
    assert back.color.tolist() == [[1, 0, 0], [0, 0, 1]]


def test_what_is_not_seen_is_left_out(tmp_path):
    def more(curves, stage):
        other = UsdGeom.BasisCurves.Define(stage, "/groom/guides")
        other.CreateTypeAttr("linear")
        other.CreateCurveVertexCountsAttr([2])
        other.CreatePointsAttr([(5, 5, 5), (6, 6, 6)])
        other.CreateWidthsAttr([.5])
        other.CreatePurposeAttr("guide")

    back = clfur.load_curves(save(tmp_path / "a.usda", np.zeros((2, 3)), [2], more=more))
    assert len(back.points) == 2
    path = save(tmp_path / "c.usda", np.zeros((2, 3)), [2],
                more=lambda curves, stage: curves.CreatePurposeAttr("guide"))
    with pytest.warns(UserWarning, match=r"c\.usda: its BasisCurves have the purpose guide"):   # and no others
        assert len(clfur.load_curves(path).points) == 2
    path = save(tmp_path / "b.usda", np.zeros((2, 3)), [2], more=lambda curves, stage: curves.MakeInvisible())
    with pytest.raises(clfur.Error, match="no BasisCurves that are seen"):
        clfur.load_curves(path)


@pytest.mark.parametrize("counts, basis, widths, how, says", [
    ([3], "linear", (.1,), "constant", r"has 4 points, but its curveVertexCounts add up to 3"),
    ([4], "bspline", (.1, .2), "vertex", r"/groom/hair: has 2 values of width, vertex; allowed: 4"),
    ([3, 1], "catmullRom", (.1,), "constant", r"curve 0 has 3 points; allowed: 4 or more for nonperiodic catmullRom"),
    ([4], "bezier", (.1,), "faceVarying", r"has 1 values of width, faceVarying; allowed: "),
])
def test_wrong_curves_are_told_by_name(tmp_path, counts, basis, widths, how, says):
    path = save(tmp_path / "a.usda", np.zeros((4, 3)), counts, basis, "nonperiodic", widths, how)
    with pytest.raises(clfur.Error, match=says) as error:
        clfur.load_curves(path)
    assert "\n" not in str(error.value)


def test_nurbs_are_refused_by_name_and_text_is_no_stage(tmp_path):
    path = save(tmp_path / "a.usda", np.zeros((4, 3)), [4],
                more=lambda curves, stage: UsdGeom.NurbsCurves.Define(stage, "/groom/nurbs"))
    with pytest.raises(clfur.Error, match="NurbsCurves at /groom/nurbs; allowed: BasisCurves"):
        clfur.load_curves(path)
    (tmp_path / "b.usda").write_text("hair")
    with pytest.raises(clfur.Error, match=r"b\.usda: cannot be read as USD") as error:
        clfur.load_curves(tmp_path / "b.usda")
    assert "\n" not in str(error.value)


def test_what_is_written_is_valid(tmp_path):
    """usd-core's own checks: counts of values, extents, a default prim and units."""
    given = clfur.Curves(np.random.default_rng(1).normal(size=(5, 6, 3)), width=np.full((5, 6), .1), color=(.1, .2, .3))
    clfur.save_curves(tmp_path / "a.usdc", given)
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    curves = UsdGeom.BasisCurves(stage.GetDefaultPrim())
    assert UsdGeom.StageHasAuthoredMetersPerUnit(stage) and UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.BasisCurves(curves).ComputeVertexDataSize(0) == 30
    low, high = np.array(curves.GetExtentAttr().Get())
    assert (low <= given.points.min(axis=0) - .05).all() and (high >= given.points.max(axis=0) + .05).all()


def test_pinned_ends_are_extrapolated():
    control, counts = unrolled(np.array([[0.], [1], [5], [7]]), np.array([2, 2]), "bspline", "pinned")
    assert control.ravel().tolist() == [-1, 0, 1, 2, 3, 5, 7, 9] and counts.tolist() == [4, 4]


@pytest.mark.parametrize("scale", [1, .01, .001, 100])
def test_the_tolerance_is_in_widths_at_any_scale(tmp_path, scale):
    def larger(curves, stage):
        curves.AddScaleOp().Set(Gf.Vec3f(scale, scale, scale))

    points = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]])
    path = save(tmp_path / "a.usda", points, [4], "bezier", widths=(.02,), more=larger)
    back = clfur.load_curves(path, tolerance=.25)
    assert len(back.points) == 16 and back.width == pytest.approx(.02 * scale)   # as many whatever the scale


def test_widths_that_are_none_or_wrong(tmp_path):
    points = np.random.default_rng(3).normal(size=(8, 3))
    back = clfur.load_curves(save(tmp_path / "a.usda", points, [4, 4], "bspline", widths=(0, .1), how="uniform"))
    assert back.counts.max() < 200 and back.width.tolist() == pytest.approx([0, .1])
    for wrong in (-1., np.nan):
        with pytest.raises(clfur.Error, match=r"/groom/hair: has a width of (-1|nan); allowed: finite numbers >= 0"):
            clfur.load_curves(save(tmp_path / f"{wrong}.usda", points, [4, 4], "bspline", widths=(wrong,)))


MORE = ("linear", "nonperiodic"), ("linear", "periodic"), ("linear", "pinned"), ("bezier", "pinned")


@pytest.mark.parametrize("basis, wrap", [*SPLINES, *MORE])
def test_as_many_values_as_usd_core_counts(tmp_path, basis, wrap):
    """Of each interpolation: so many are read, and one more or fewer is refused."""
    counts = {"bezier": [4, 7, 13, 4], "linear": [2, 3, 7, 4]}.get(basis, [4, 5, 9, 6])
    if wrap == "periodic":
        counts = {"bezier": [3, 6, 12, 9], "linear": [3, 4, 8, 5]}.get(basis, [3, 4, 9, 6])
    rng = np.random.default_rng(11)
    points = rng.normal(size=(sum(counts), 3))
    stage = Usd.Stage.Open(str(save(tmp_path / "a.usda", points, counts, basis, wrap)))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/groom/hair"))
    sizes = {"uniform": curves.ComputeUniformDataSize(0), "varying": curves.ComputeVaryingDataSize(0),
             "vertex": curves.ComputeVertexDataSize(0), "constant": 1}
    for how, size in sizes.items():
        widths = rng.uniform(.1, .2, size)
        back = clfur.load_curves(save(tmp_path / f"{how}.usda", points, counts, basis, wrap, widths, how))
        assert len(back.counts) == 4 and .05 < back.width.min() <= back.width.max() < .25, how
        for wrong in (size + 1, size - 1):
            if wrong:
                with pytest.raises(clfur.Error, match=rf"has {wrong} values of width, {how}; allowed: "):
                    clfur.load_curves(save(tmp_path / f"{wrong}{how}.usda", points, counts, basis, wrap,
                                           np.ones(wrong), how))


def test_one_value_is_for_all_whatever_it_says(tmp_path):
    """As files of hand-written exporters have it: no interpolation, which means one for each point."""
    points = np.random.default_rng(12).normal(size=(8, 3))
    for how in "vertex", "varying", "uniform":
        back = clfur.load_curves(save(tmp_path / f"{how}.usda", points, [4, 4], "catmullRom", widths=(.125,), how=how))
        assert (back.width == .125).all()


@pytest.mark.parametrize("basis, wrap, counts, drawn, says", [
    ("catmullRom", "nonperiodic", [5, 2, 4], [5, 4], "curve 1 has 2 points; allowed: 4 or more for nonperiodic"),
    ("bspline", "pinned", [2, 1, 3], [2, 3], "curve 1 has 1 points; allowed: 2 or more for pinned bspline"),
    ("bspline", "periodic", [2, 3], [3], "curve 0 has 2 points; allowed: 3 or more for periodic bspline"),
    ("bezier", "nonperiodic", [4, 8], [4, 7], "curve 1 has 8 points; allowed: 4, 7, 10, ... for nonperiodic bezier"),
    ("bezier", "periodic", [4, 3], [3, 3], "curve 0 has 4 points; allowed: 3, 6, 9, ... for periodic bezier")])
def test_curves_that_do_not_fit_are_drawn_as_far_as_they_do(tmp_path, basis, wrap, counts, drawn, says):
    """As Pixar's own test files have them, beside others; with values of points, which stay with theirs."""
    points = np.random.default_rng(13).uniform(1, 2, (sum(counts), 3))
    path = save(tmp_path / "a.usda", points, counts, basis, wrap, points[:, 0] / 9, "vertex")
    with pytest.warns(UserWarning, match="left out: what no segment has of curves that do not fit") as warned:
        back = clfur.load_curves(path)
    assert says in str(warned[0].message) and len(back.counts) == len(drawn)
    assert np.abs(back.width - back.points[:, 0] / 9).max() < 1e-6
    if (basis, wrap) == ("bezier", "nonperiodic"):   # the second ends where its last whole segment does
        assert np.allclose(back.points[-1], points[4 + 6], atol=1e-6)


def test_wide_curves_bend_smoothly(tmp_path):
    """A ribbon as wide as long: a quarter of its width would be most of its bend."""
    points = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]])
    back = clfur.load_curves(save(tmp_path / "a.usda", points, [4], "bezier", widths=(2.,)))
    places = np.array([curve_at(points.astype(float), "bezier", t, 0) for t in np.linspace(0, 1, 200)])
    a, b = back.points[:-1].astype(float), back.points[1:].astype(float)
    share = np.clip(((places[:, None] - a) * (b - a)).sum(2) / ((b - a)**2).sum(1), 0, 1)
    off = np.linalg.norm(places[:, None] - a - share[..., None] * (b - a), axis=2).min(axis=1).max()
    assert 0 < off <= .25 * .02 * 3
