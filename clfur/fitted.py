"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to 10 scenes.

COSTS: CPU time of each of `budget.LADDER`, in cheapest ones.  ERRORS: coefficients of 1, log(width of a strand in
pixels) and log(strands that cover a pixel) for log(error) of each; the residuals' standard
deviations are 0.05, 0.07, 0.15, 0.11, 0.12, 0.12, 0.11.  RANGES: widths and covers that were fitted.
"""

COSTS = [1.0, 1.34, 2.38, 2.56, 2.9, 3.78, 5.39]
ERRORS = [
    [-2.331, -0.05, -0.033],
    [-2.929, 0.001, 0.041],
    [-3.129, 0.074, 0.086],
    [-2.926, 0.319, -0.052],
    [-2.994, 0.306, -0.055],
    [-3.089, 0.294, -0.048],
    [-3.21, 0.309, 0.003],
]
RANGES = (0.1, 2.5), (1.6, 8.2)
