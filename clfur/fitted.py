"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to 10 scenes.

COSTS and ERRORS: coefficients of 1, log(width of a strand in pixels) and log(strands that cover a pixel) for log(CPU
time in that of the first) and log(error) of each of `budget.LADDER`; standard deviations of the residuals:
0.00, 0.07, 0.16, 0.13, 0.09, 0.13, 0.10, 0.13, 0.16;
0.05, 0.06, 0.14, 0.14, 0.14, 0.12, 0.16, 0.16, 0.11.
RANGES: widths and covers that were fitted.
"""

COSTS = [
    [0.0, 0.0, 0.0],
    [0.355, 0.094, 0.016],
    [0.906, -0.032, -0.039],
    [0.66, -0.191, 0.095],
    [0.835, -0.188, 0.061],
    [0.945, -0.242, 0.11],
    [1.068, -0.237, 0.097],
    [1.416, -0.405, -0.017],
    [1.415, -0.236, 0.109],
]
ERRORS = [
    [-2.334, -0.052, -0.032],
    [-2.934, -0.002, 0.042],
    [-3.17, 0.029, 0.071],
    [-2.96, 0.274, -0.071],
    [-3.029, 0.257, -0.077],
    [-3.122, 0.244, -0.073],
    [-3.302, 0.3, -0.009],
    [-3.49, 0.328, 0.07],
    [-3.931, 0.367, 0.104],
]
RANGES = (0.1, 2.5), (1.6, 8.2)
