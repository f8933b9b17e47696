"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to 10 scenes.

COSTS and ERRORS: coefficients of 1, log(width of a strand in pixels) and log(strands that cover a pixel) for log(CPU
time in that of the first) and log(error) of each of `budget.LADDER`; standard deviations of the residuals:
0.00, 0.08, 0.14, 0.09, 0.07, 0.13, 0.14, 0.19, 0.26;
0.05, 0.07, 0.15, 0.11, 0.12, 0.12, 0.16, 0.16, 0.09.
RANGES: widths and covers that were fitted.
"""

COSTS = [
    [0.0, 0.0, 0.0],
    [0.35, 0.087, -0.028],
    [0.807, -0.128, -0.066],
    [0.805, -0.233, -0.067],
    [0.974, -0.222, -0.089],
    [1.153, -0.23, -0.044],
    [1.257, -0.267, -0.042],
    [1.712, -0.454, -0.213],
    [1.656, -0.592, 0.084],
]
ERRORS = [
    [-2.331, -0.05, -0.033],
    [-2.929, 0.001, 0.041],
    [-3.129, 0.074, 0.086],
    [-2.926, 0.319, -0.052],
    [-2.994, 0.306, -0.055],
    [-3.089, 0.294, -0.048],
    [-3.266, 0.353, 0.015],
    [-3.464, 0.38, 0.098],
    [-3.723, 0.577, 0.064],
]
RANGES = (0.1, 2.5), (1.6, 8.2)
