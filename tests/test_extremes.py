"""What passes a check works afterwards: the extremes of each field are drawn, without an exception and without NaN."""

import warnings

import numpy as np
import pytest
from support.anything import BALL, RASTERS, drawn

import clfur
from clfur.scene import frame

MOST, LEAST, TINY = 1e9, 1e-9, 5e-324
CAMERA = clfur.Camera(size=(24, 18))
POSE = np.eye(4) + np.outer((0, 0, 3, 0), (0, 0, 0, 1))
POINTS = np.random.default_rng(1).normal(size=(9, 4, 3))


def hair(**fields):
    return clfur.HairType(**{"segments": 3, "segment_length": 0.1, "width": 0.02, **fields})


def strands(**fields):
    return clfur.Strands(**{"types": hair(), "inner": 1, "outer": 1, **fields})


def scene(**fields):
    return clfur.Scene(**{"mesh": BALL, "fur": strands(), "camera": CAMERA, **fields})


def shells(**fields):
    return scene(fur=clfur.Shells(**{"length": 0.2, "frequency": 8, **fields}))


def curves(**fields):
    return clfur.Scene(None, clfur.Curves(**{"points": POINTS, "width": 0.02, **fields}), CAMERA)


def light(**fields):
    return scene(light=clfur.Light(**fields))


def seen(eye, target, fov, size=(24, 18)):
    return scene(camera=clfur.Camera(eye=eye, target=target, up=(0.3, 0.5, 0.1), fov=fov, size=size))


def calibrated(fx, fy, skew, center):
    return scene(camera=clfur.Camera.calibrated(POSE, [[fx, skew, center], [0, fy, center], [0, 0, 1]], (24, 18)))


CASES = {
    "cameras": [
        (seen, (eye, target, fov))
        for eye in [(0, 0, MOST), (MOST, -MOST, MOST), (0, 0, 1e4), (0, 0, 1), (TINY,) * 3]
        for target in [(0, 0, 0), (-MOST, 0, MOST / 2), (0, LEAST, 0)]
        for fov in (1e-3, 45, 179.99)
    ],
    "frames": [
        (lambda fov, size: scene(camera=frame(BALL, strands(), size, fov)), (fov, size))
        for fov in (1e-3, 179.99)
        for size in ((1, 1), (16384, 1), (1, 16))
    ],
    "calibrations": [
        (calibrated, (fx, fy, skew * fx, center))
        for fx in (1e-5, MOST)
        for fy in (1e-5, 20, MOST)
        for skew in (-1, 0, 1)
        for center in (-1e6, 12, 1e6)
    ],
    "lights": [
        (lambda **fields: light(**fields), fields)
        for fields in [
            {"color": (MOST,) * 3, "ambient": MOST},
            {"color": (TINY,) * 3},
            {"direction": (TINY, 0, 0)},
            {"direction": (MOST,) * 3},
            *(
                {"position": place, "color": (MOST,) * 3, "angle": angle}
                for place in [(0, 0, 0), (0, 0, 1), (0, TINY, 0), (900, 0, 0)]
                for angle in (0.5, 179.99999)
            ),
        ]
    ],
    "hair": [
        (lambda **fields: scene(fur=strands(types=hair(**fields))), {name: value})
        for name, values in {
            "color": [(0, 0, 0), (MOST,) * 3],
            "segments": [0, 1, 255],
            "segment_length": [0, TINY, 1e-30, 1e6],
            "force_weight": [-MOST, TINY, MOST],
            "width": [0, TINY, 1e-30, 1e3, MOST],
            "alpha": [0, TINY, 1],
            "curl": [(TINY, MOST), (0.1, -MOST), (1e8, 1)],
            "wave": [(TINY, MOST), (1e8, 1)],
            "length_variation": [1],
            "direction_variation": [1],
            "color_variation": [1],
            "specular": [TINY, MOST],
            "exponent": [LEAST, 1, MOST],
            "color_texture": [np.zeros((1, 1, 3)), np.full((1, 2, 3), MOST), np.full((2, 1, 3), TINY)],
        }.items()
        for value in values
    ],
    "looks": [
        (lambda **fields: scene(fur=strands(types=hair(look=clfur.Kajiya(highlight=form, **fields)))), fields)
        for form in ("kajiya-kay", "half-vector")
        for fields in [{"exponent": LEAST}, {"exponent": MOST}, {"specular": MOST, "exponent": MOST}]
    ],
    "growth": [
        (lambda **fields: scene(fur=strands(**fields)), fields)
        for fields in [
            {"roots": 0},
            {"roots": 1, "seed": 2**32 - 1},
            {"force": (MOST,) * 3, "types": hair(force_weight=MOST)},
            {"force": (TINY, 0, 0)},
            *(
                {"point_forces": [clfur.PointForce(place, power)] * 30, "types": hair(force_weight=MOST)}
                for place in [(0, 0, 0), BALL.positions[0], (MOST, 0, 0)]
                for power in (-MOST, MOST)
            ),
        ]
    ],
    "curves": [
        (curves, fields)
        for fields in [
            *({"width": width} for width in (0, TINY, 1e-30, 1e3, MOST)),
            {"color": (MOST,) * 3, "specular": MOST, "alpha": 0},
            {"points": np.zeros((9, 4, 3))},
            {"points": np.zeros((9, 4, 3)) + CAMERA.eye},
            {"points": POINTS * 1e-6},
            {"points": POINTS * 1e8},
            {"points": np.where(np.arange(9)[:, None, None] == 3, 1e8, POINTS)},
            *({"root_normal": np.full((9, 3), size), "root_uv": np.full((9, 2), size)} for size in (0, TINY, MOST)),
        ]
    ],
    "bodies": [
        (lambda color: scene(body_color=color, light=clfur.Light(color=(MOST,) * 3)), ((size,) * 3,))
        for size in (0, TINY, MOST)
    ],
    "uv": [
        (
            lambda uv: scene(
                mesh=clfur.Mesh(BALL.positions, None, np.full((len(BALL.positions), 2), uv), BALL.faces),
                fur=strands(types=hair(color_texture=np.ones((3, 2, 3)))),
            ),
            (uv,),
        )
        for uv in (1e-30, 1e30, -3e38)
    ],
    "shells": [
        (shells, {name: value, "pattern": pattern})
        for pattern in ("cells", "sine")
        for name, values in {
            "length": [LEAST, 1e3, 1e8],
            "layers": [1],
            "frequency": [LEAST, 100],
            "sharpness": [1 + 1e-15, MOST],
            "density": [LEAST, 1],
            "noise": [(0, 1), (MOST, 1), (MOST, MOST)],
            "length_variation": [1],
            "color": [(MOST,) * 3],
            "alpha": [0, 1],
            "root_shade": [0],
            "wind": [(MOST, 0, 0), (1e-300, 0, 0), (1e-40, 0, 0)],
            "force": [(MOST,) * 3],
            "acceleration": [(MOST,) * 3],
            "time": [MOST, -MOST],
            "exponent": [LEAST, MOST],
            "specular": [MOST],
            "shading": ["turned"],
        }.items()
        for value in values
    ],
}
SETTINGS = {"samples": 1, "grid": 16, "shadow_map": 32}


@pytest.mark.parametrize("name", CASES)
def test_extremes_are_drawn(gpu, name):
    for number, (make, given) in enumerate(CASES[name]):
        what = make(**given) if isinstance(given, dict) else make(*given)
        for raster in RASTERS:
            more = {"lod": 1.0, "shadows": "trilinear", "samples": 4} if number % 2 else {}
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                images = drawn(what, gpu, clfur.Settings(raster=raster, **{**SETTINGS, **more}))
            assert images["color"].max() < 1e30, given


@pytest.mark.parametrize(
    "setting",
    [
        {"lod": 4},
        {"lod": TINY},
        {"blur": "all", "blur_sigma": LEAST},
        {"blur": "edges", "blur_sigma": 16},
        {"pcf": 16},
        {"shadow_map": 1, "pcf": 16},
        {"shadow_map": 0},
        {"samples": 16},
        {"filtered": np.bool_(False)},
    ],
)
def test_extremes_of_settings_are_drawn(gpu, setting):
    for what in (
        scene(),
        shells(),
        curves(),
        scene(fur=None),
        clfur.Scene(None, clfur.Curves(np.zeros((0, 2, 3))), CAMERA),
    ):
        drawn(what, gpu, clfur.Settings(**{**SETTINGS, **setting}))


def test_a_highlight_is_no_brighter_than_its_light(gpu):
    """However narrow: rounding errors of a cosine of 1 are not raised to its power (2.5e7 without that)."""
    for exponent in 1e3, 1e6, MOST:
        fur = strands(types=hair(look=clfur.Kajiya(specular=1, exponent=exponent), color=(1, 1, 1)), inner=4, outer=4)
        for raster in RASTERS:
            color = drawn(scene(fur=fur), gpu, clfur.Settings(raster=raster, **SETTINGS))["color"]
            assert color.max() <= 2.2  # 1 of the light, as much of the highlight, .1 of the ambient


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: clfur.Camera(fov=5e-324), "Camera.fov is 5e-324; allowed: a finite number >= 0.001, <= 179.99"),
        (lambda: clfur.Camera(fov=179.9999999), "Camera.fov is 179.9999999; allowed"),
        (
            lambda: clfur.Camera.calibrated(POSE, [[1e-300, 0, 0], [0, 1, 0], [0, 0, 1]], (4, 4)),
            "fx and fy|fx > 0 and fy > 0",
        ),
        (
            lambda: clfur.Camera.calibrated(POSE, [[1, 0, 1e9], [0, 1, 0], [0, 0, 1]], (4, 4)),
            "cx and cy from -1e\\+06 to 1e\\+06",
        ),
        (
            lambda: clfur.HairType(exponent=5e-324),
            "HairType.exponent is 5e-324; allowed: a finite number >= 1e-09, <= 1e\\+09",
        ),
        (
            lambda: clfur.HairType(color_texture=np.full((1, 1, 3), 1e38)),
            "color_texture.* allowed: .* from 0 to 1e\\+09",
        ),
        (lambda: clfur.HairType(color_texture=np.full((1, 1, 3), np.inf)), "color_texture.* is inf; allowed"),
        (lambda: clfur.Curves(POINTS, width=1e30), "Curves.width is 1e\\+30; allowed"),
        (lambda: clfur.Curves(POINTS, color=(1e30, 0, 0)), "Curves.color\\[0\\] is 1e\\+30; allowed"),
    ],
)
def test_what_could_not_be_drawn_is_refused(make, words):
    with pytest.raises(clfur.Error, match=words):
        make()
