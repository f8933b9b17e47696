"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to 10 scenes.

COSTS: CPU time of each of `budget.LADDER`, in cheapest ones.  ERRORS: coefficients of 1, log(width of a strand in
pixels) and log(strands that cover a pixel) for log(error) of each; the residuals' standard
deviations are 0.10, 0.06, 0.10, 0.15, 0.12, 0.05, 0.12, 0.11.  RANGES: widths and covers that were fitted.
"""

COSTS = [1.0, 1.1, 1.75, 2.6, 3.18, 3.5, 4.62, 6.17]
ERRORS = [
    [-2.184, -0.098, -0.07],
    [-2.333, -0.042, -0.025],
    [-2.907, -0.051, 0.036],
    [-3.156, 0.042, 0.109],
    [-3.181, 0.112, 0.058],
    [-3.052, 0.24, -0.025],
    [-3.057, 0.296, -0.059],
    [-3.174, 0.31, -0.003],
]
RANGES = (0.1, 2.5), (1.6, 8.2)
