"""How far a picture is from the truth, in numbers."""

import numpy as np

from .color import linear_to_srgb


def measure(picture, truth):
    """How a picture differs from the truth, both [h, w, 4] linear and premultiplied -> {name: float, or None}.

    error: root mean square of the difference of sRGB-coded values over black, of three channels, where either picture
    has any coverage.  rmse: the same of linear values.  bias: mean linear difference there, above 0 where the picture
    is brighter.  area: covered area, a share of the truth's, None if that is 0.  flip: mean FLIP error of the whole
    picture over black, None without the package flip_evaluator.  Without any coverage the differences are 0.
    """
    picture, truth = np.asarray(picture, np.float64), np.asarray(truth, np.float64)
    linear = (picture - truth)[_there(picture, truth)][:, :3]
    covered = truth[..., 3].sum()
    return {"error": error(picture, truth), "rmse": _rms(linear),
            "bias": float(linear.mean()) if linear.size else 0.0,
            "area": float(picture[..., 3].sum() / covered) if covered else None, "flip": flip(truth, picture)}


def error(picture, truth):
    """The error alone, as `measure` has it."""
    return _rms((shown(picture) - shown(truth))[_there(picture, truth)])


def flicker(pictures, truths):
    """How much more, or less, a picture changes than the truth does, step by step: mean of |change - change of truth|.

    ``pictures`` and ``truths``: [steps + 1, h, w, 4], the same moments.  In sRGB-coded values over black, over the
    pixels where anything is ever covered.
    """
    pictures, truths = (np.asarray(images, np.float64) for images in (pictures, truths))
    here = ((pictures[..., 3] > 0) | (truths[..., 3] > 0)).any(0)
    apart = np.diff([shown(picture) - shown(truth) for picture, truth in zip(pictures, truths)], axis=0)
    return float(np.abs(apart[:, here]).mean()) if here.any() else 0.0


def flip(truth, picture):
    """Mean FLIP error of two linear pictures over black, or None without the package flip_evaluator."""
    try:
        import flip_evaluator
    except ImportError:   # of the extra "report"
        return None
    images = [shown(np.nan_to_num(image)).astype(np.float32) for image in (truth, picture)]
    return float(flip_evaluator.evaluate(*images, "LDR", applyMagma=False)[1])


def shown(picture):
    """sRGB-coded values over black, float64 [h, w, 3]."""
    return linear_to_srgb(picture[..., :3]).astype(np.float64)


def _there(picture, truth):
    return (picture[..., 3] > 0) | (truth[..., 3] > 0) | np.isnan(picture).any(2)


def _rms(values):
    return float(np.sqrt((values**2).mean())) if values.size else 0.0
