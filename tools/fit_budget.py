"""Fits what `clfur.budget` predicts to measured pictures, and writes clfur/fitted.py.

    python tools/fit_budget.py            measure (some ten minutes for the truths, which are kept), fit, write
    python tools/fit_budget.py --dry      print only
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from budget_scenes import costs_of, error_of, furry, truths_of

import clfur
from clfur import budget, measures
from clfur.pipeline.views import Rig

PALE = {"color": (0.8, 0.75, 0.6), "light": (1, -0.2, 0.3)}
SCENES = {   # mesh, strands, width in pixels, length in radii
    "sphere": ("sphere", 20_000, 0.3, 0.16, {}),
    "teapot": ("teapot", 20_000, 0.3, 0.12, {}),
    "teapot, dense": ("teapot", 60_000, 0.15, 0.15, {}),
    "sphere, wide": ("sphere", 5_000, 1.0, 0.25, {}),
    "teapot, widest": ("teapot", 2_000, 2.5, 0.35, {}),
    "sphere, far": ("sphere", 40_000, 0.1, 0.1, {"away": 2}),
    "teapot, short": ("teapot", 10_000, 0.6, 0.06, {}),
    "sphere, sparse": ("sphere", 3_000, 0.4, 0.3, {"light": (-1, -0.5, -1)}),
    "sphere, pale": ("sphere", 15_000, 0.25, 0.2, PALE),
    "teapot, coarse": ("teapot", 6_000, 1.5, 0.2, {"light": (-1, -0.3, 0.5)}),
}


def measured(scene, gpu, repeat):
    """{what: of each rung} of a scene; also its features."""
    truths, rungs = truths_of(scene), budget.ladder(Rig.of(scene))
    frames = [clfur.draw(scene, gpu, rung) for rung in rungs]
    finest, bands = frames[-1].images["color"], budget.bands(Rig.of(scene))

    def rows(picture):
        return np.concatenate([picture[top:end] for top, end in bands])
    return {
        "error": np.array([error_of(frame.images["color"], truths) for frame in frames]),
        "apart": np.array([measures.error(rows(frame.images["color"]), rows(finest)) for frame in frames]),
        "cost": costs_of(scene, rungs, gpu, repeat),
        "features": budget.features(Rig.of(scene), frames[-1].strands), "grid": rungs[-1].grid}


def fit(found):
    """(costs, coefficients [rungs, 3] of log(error) by 1, log width, log cover) of `measured` scenes."""
    known = np.array([[1, *np.log(each["features"])] for each in found])
    wanted = np.log([each["error"] for each in found])
    ridge = np.diag([0, 0.3, 0.3])   # few scenes: what they leave open is taken to have no influence
    coefficients = np.linalg.solve(known.T @ known + ridge, known.T @ wanted).T
    costs = np.exp(np.mean([np.log(each["cost"] / each["cost"][0]) for each in found], 0))
    return costs, coefficients


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--dry", action="store_true")
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    gpu = clfur.Scheduler()
    budget.RANGES = (1e-9, 1e9), (1e-9, 1e9)
    found = []
    for name, (mesh, strands, pixels, length, how) in SCENES.items():
        each = measured(furry(mesh, strands, pixels, length, **how), gpu, arguments.repeat)
        found.append(each)
        print(f"{name:16} {each['features'][0]:.2f} px wide, cover {each['features'][1]:.2f}, "
              f"grid {each['grid']}\n   error {np.round(each['error'], 4)}\n   apart {np.round(each['apart'], 4)}\n"
              f"   ms    {np.round(1e3 * each['cost'])}", flush=True)
    costs, coefficients = fit(found)
    known = np.array([[1, *np.log(each["features"])] for each in found])
    predicted = np.exp(known @ coefficients.T)
    errors, apart = np.array([each["error"] for each in found]), np.array([each["apart"] for each in found])
    estimated = np.hypot(apart, predicted[:, -1:])
    for what, guess in ("predicted / measured", predicted), ("estimated / measured", estimated):
        print(what)
        for name, row in zip(SCENES, guess / errors):
            print(f"   {name:16} {np.round(row, 2)}")
    residual, of_estimate = (np.log(guess / errors).std(0) for guess in (predicted, estimated))
    print("residuals", np.round(residual, 2), "estimate's", np.round(of_estimate, 2))
    widths, covers = np.exp(known[:, 1:]).T
    text = f'''"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to {len(found)} scenes.

COSTS: CPU time of each of `budget.LADDER`, in cheapest ones.  ERRORS: coefficients of 1, log(width of a strand in
pixels) and log(strands that cover a pixel) for log(error) of each; the residuals' standard
deviations are {", ".join(f"{each:.2f}" for each in residual)}.  RANGES: widths and covers that were fitted.
"""

COSTS = {[round(float(cost), 2) for cost in costs]}
ERRORS = [
{"".join(f"    {[round(float(c), 3) for c in row]},{chr(10)}" for row in coefficients)}]
RANGES = ({widths.min():.2g}, {widths.max():.2g}), ({covers.min():.2g}, {covers.max():.2g})
'''
    if arguments.dry:
        print(text)
    else:
        Path(__file__).parents[1].joinpath("clfur", "fitted.py").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
