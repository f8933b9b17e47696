"""Fits what `clfur.budget` predicts to measured pictures, and writes clfur/fitted.py.

    python tools/fit_budget.py            measure (some minutes; what is measured is kept, scene by scene), fit, write
    python tools/fit_budget.py --dry      print only
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from budget_scenes import SAMPLES, costs_of, error_of, furry, sources, truths_of

import clfur
from clfur import budget, cache, measures, truth
from clfur.judge.frontier import digest
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
    """{what: of each rung} of a scene, kept in the cache; also its features."""
    known = digest(scene, budget.LADDER, SAMPLES, truth.VERSION, sources(), gpu.name)
    file = cache.folder("budget") / f"{known[:32]}.json"
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {"repeat": 0}
    if kept["repeat"] < repeat:
        kept = _measure(scene, gpu, repeat) | {"repeat": repeat}
        cache.write(file, json.dumps(kept).encode())
    return {what: np.array(value) for what, value in kept.items()}


def _measure(scene, gpu, repeat):
    rig, truths = Rig.of(scene), truths_of(scene)
    rungs, bands = [rung.settings for rung in budget.suited(rig)], budget.bands(rig)
    if len(rungs) < len(budget.LADDER):
        raise SystemExit("a scene that is fitted must take all rungs")
    frames = [clfur.draw(scene, gpu, rung) for rung in rungs]

    def rows(frame):
        return np.concatenate([frame.images["color"][top:end] for top, end in bands])
    return {
        "error": [error_of(frame.images["color"], truths) for frame in frames],
        "apart": [measures.error(rows(frame), rows(frames[-1])) for frame in frames],
        "cost": costs_of(scene, rungs, gpu, repeat).tolist(),
        "features": [float(each) for each in budget.features(rig, frames[-1].strands)], "grid": rungs[-2].grid}


def fit(found):
    """(coefficients [rungs, 3] of log(cost), those of log(error)) by 1, log width, log cover, of `measured` scenes."""
    known = np.array([[1, *np.log(each["features"])] for each in found])
    wanted = np.array([[np.log(each["cost"] / each["cost"][0]) for each in found],
                       [np.log(each["error"]) for each in found]])
    ridge = np.diag([0, 0.3, 0.3])   # few scenes: what they leave open is taken to have no influence
    return np.linalg.solve(known.T @ known + ridge, known.T @ wanted).swapaxes(1, 2)


def _listed(numbers):
    return ", ".join(f"{each:.2f}" for each in numbers)


def _rows(coefficients):
    return "".join(f"    {[round(float(c), 3) + 0 for c in row]},\n" for row in coefficients)


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
    taken, predicted = (np.exp(known @ each.T) for each in (costs, coefficients))
    errors, apart = np.array([each["error"] for each in found]), np.array([each["apart"] for each in found])
    estimated = np.hypot(apart, predicted[:, -1:])
    times = np.array([each["cost"] / each["cost"][0] for each in found])
    for what, guess, right in (("error predicted / measured", predicted, errors),
                               ("error estimated / measured", estimated, errors),
                               ("time predicted / measured", taken, times)):
        print(what)
        for name, row in zip(SCENES, guess / right):
            print(f"   {name:16} {np.round(row, 2)}")
    residual, of_estimate, of_time = (np.log(each).std(0) for each in (
        predicted / errors, estimated / errors, taken / times))
    print("residuals", np.round(residual, 2), "estimate's", np.round(of_estimate, 2), "time's", np.round(of_time, 2))
    widths, covers = np.exp(known[:, 1:]).T
    text = f'''"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to {len(found)} scenes.

COSTS and ERRORS: coefficients of 1, log(width of a strand in pixels) and log(strands that cover a pixel) for log(CPU
time in that of the first) and log(error) of each of `budget.LADDER`; standard deviations of the residuals:
{_listed(of_time)};
{_listed(residual)}.
RANGES: widths and covers that were fitted.
"""

COSTS = [
{_rows(costs)}]
ERRORS = [
{_rows(coefficients)}]
RANGES = ({widths.min():.2g}, {widths.max():.2g}), ({covers.min():.2g}, {covers.max():.2g})
'''
    if arguments.dry:
        print(text)
    else:
        Path(__file__).parents[1].joinpath("clfur", "fitted.py").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
