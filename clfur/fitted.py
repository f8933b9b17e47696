"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to 10 scenes.

COSTS and ERRORS: coefficients of 1, log(width of a strand in pixels) and log(strands that cover a pixel) for log(CPU
time in that of the first) and log(error) of each of `budget.LADDER`; standard deviations of the residuals:
0.00, 0.05, 0.12, 0.11, 0.07, 0.09, 0.08, 0.12, 0.15;
0.05, 0.06, 0.14, 0.14, 0.14, 0.12, 0.16, 0.16, 0.10.
RANGES: widths and covers that were fitted.
"""

COSTS = [
    [0.0, 0.0, 0.0],
    [0.349, 0.089, 0.01],
    [0.894, -0.07, -0.041],
    [0.658, -0.218, 0.085],
    [0.915, -0.194, 0.014],
    [1.077, -0.227, 0.061],
    [1.195, -0.241, 0.038],
    [1.567, -0.405, -0.09],
    [1.486, -0.244, 0.077],
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
    [-3.957, 0.31, 0.065],
]
RANGES = (0.1, 2.5), (1.6, 8.2)
