"""What `clfur.budget` predicts by; tools/fit_budget.py has fitted it to 10 scenes.

COSTS and ERRORS: coefficients of 1, log(width of a strand in pixels) and log(strands that cover a pixel) for log(CPU
time in that of the first) and log(error) of each of `budget.LADDER`; standard deviations of the residuals:
0.00, 0.06, 0.17, 0.12, 0.09, 0.16, 0.17, 0.20, 0.16;
0.05, 0.07, 0.15, 0.11, 0.12, 0.12, 0.16, 0.16, 0.14.
RANGES: widths and covers that were fitted.
"""

COSTS = [
    [0.0, 0.0, 0.0],
    [0.307, 0.054, -0.007],
    [0.874, -0.098, -0.094],
    [0.7, -0.285, -0.017],
    [0.825, -0.282, -0.048],
    [1.117, -0.288, -0.046],
    [1.272, -0.295, -0.081],
    [1.605, -0.461, -0.194],
    [1.614, -0.222, -0.022],
]
ERRORS = [
    [-2.331, -0.05, -0.033],
    [-2.929, 0.001, 0.041],
    [-3.129, 0.074, 0.086],
    [-2.926, 0.319, -0.052],
    [-2.994, 0.306, -0.055],
    [-3.089, 0.294, -0.048],
    [-3.264, 0.353, 0.015],
    [-3.451, 0.381, 0.093],
    [-3.822, 0.488, 0.131],
]
RANGES = (0.1, 2.5), (1.6, 8.2)
