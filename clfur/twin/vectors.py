"""Vectors of the world in float64, for the twins of the kernels."""

import numpy as np


def f64(array):
    """Float64 copy of an array, so that nothing below is rounded to its type."""
    return np.asarray(array).astype(np.float64)


def dot(a, b):
    """Scalar products of vectors [..., 3]."""
    return (a * b).sum(-1)


def unit(a):
    """Vectors [..., 3] at length one."""
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def sine(a, b):
    """Sine between unit vectors [..., 3], from their cross product: right where they are parallel too."""
    return np.linalg.norm(np.cross(a, b), axis=-1)


def merge(first, one, other):
    """An array that takes its rows from `one` where `first` [n], else from `other`, in order."""
    result = np.empty((len(first), *one.shape[1:]), np.result_type(one, other))
    result[first], result[~first] = one, other
    return result


def mix(a, b, share):
    """Rows between a and b [n, k] at a share [n] of the way."""
    return a + (b - a) * share[:, None]
