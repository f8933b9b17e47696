"""What cl/chiang.cl and its part of cl/scatter.h mean, in float64: how Chiang, Bitterli, Tappan and Burley (EGSR 2016,
"A Practical and Controllable Hair and Fur Model for Production Path Tracing") have a hair scatter light, the mean over
its width.

Four lobes: R, TT, TRT and all further ones.  A look is known by ``lobes``: [..., 4] longitudinal and azimuthal
roughness, tilt of the scales [radians], index of refraction, as `layout.HairType` has it.
"""

import numpy as np

from .vectors import dot, f64, unit

LOBES = 4
MOST = 1 << 22             # values at a time


def absorption_of(color, roughness):
    """Absorption [..., 3], of a radius, of hair that looks as a linear colour [..., 3] where it is many (the paper's
    fit, by azimuthal roughness)."""
    fit = np.polynomial.polynomial.polyval(roughness, [5.969, -.215, 2.532, -10.73, 5.574, .245])
    return (np.log(np.clip(color, 1e-30, 1)) / fit)**2


def variances(roughness):
    """Of the lobes' longitudinal roughness (the paper's equation 7) -> [..., 4]."""
    v = (.726 * roughness + .812 * roughness**2 + 3.7 * roughness**20)**2
    return np.stack([v, v / 4, 4 * v, 4 * v], -1)


def scale(roughness):
    """Of the logistic distribution of azimuthal roughness (the paper's equation 8)."""
    return np.sqrt(np.pi / 8) * (.265 * roughness + 1.194 * roughness**2 + 5.372 * roughness**22)


def longitudinal(theta_v, theta_l, roughness, tilt):
    """M of each lobe at angles from the plane across the strand, up to its tip -> [n, 4]; over l, times the cosine, its
    integral is 1 (d'Eon et al. 2011, with tilts as Marschner et al. 2003 measured them: R moves to the root)."""
    v = variances(f64(roughness))
    theta_v = f64(theta_v)[:, None] + f64(tilt)[..., None] * [2, -1, -4, 0]
    theta_l = f64(theta_l)[:, None]
    x = np.abs(np.cos(theta_v)) * np.cos(theta_l) / v
    # exp(-x) I0(x), the mean of exp(x (cos t - 1)): of a smooth periodic function, few values do.
    t = np.pi * (np.arange(256) + .5) / 256
    width = np.minimum(1, 8 / np.sqrt(np.maximum(x, 1e-9)))[..., None]     # beyond it is next to nothing
    bessel = (np.exp(x[..., None] * (np.cos(width * t) - 1)) * width).mean(-1)
    sines = np.sin(theta_v) * np.sin(theta_l)
    return bessel * np.exp(x - (sines + 1) / v) / (v * -np.expm1(-2 / v))


def attenuations(theta, h, sigma, index):
    """A of each lobe at places h across the strand: shares of light that leave by it -> [..., 4], which add up to 1
    where sigma, what it absorbs of a radius, is 0."""
    cosine = np.cos(theta)
    gamma = np.arcsin(h * cosine / np.sqrt(index**2 - np.sin(theta)**2))
    c = cosine * np.sqrt(1 - h**2)
    inner = np.sqrt(index**2 - 1 + c**2)
    f = (((c - inner) / (c + inner))**2 + ((index**2 * c - inner) / (index**2 * c + inner))**2) / 2
    through = np.exp(-2 * sigma * np.cos(gamma) / np.sqrt(1 - (np.sin(theta) / index)**2))
    tt = (1 - f)**2 * through
    trt = tt * f * through
    further = trt * f * through / np.maximum(1 - f * through, 1e-300)       # nothing enters where f is 1
    return np.stack(np.broadcast_arrays(f, tt, trt, further), -1)


def turned(phi, theta, h, roughness, index):
    """N of each lobe: of light that enters at h, how much is turned by phi around the strand -> [..., 4]; its integral
    over a whole turn is 1."""
    s = scale(roughness)
    inside = np.arcsin(h * np.cos(theta) / np.sqrt(index**2 - np.sin(theta)**2))
    lobes = []
    for p in range(LOBES - 1):
        away = phi - (2 * p * inside - 2 * np.arcsin(h) + p * np.pi)
        away = np.abs(np.remainder(away + np.pi, 2 * np.pi) - np.pi)
        lobes.append(1 / (4 * s * np.cosh(away / (2 * s))**2) / np.tanh(np.pi / (2 * s)))
    return np.stack(np.broadcast_arrays(*lobes, 1 / (2 * np.pi)), -1)


def fejer(n):
    """(Places, weights) of Fejér's first rule: over -1..1 a polynomial's integral is exact."""
    t, j = np.pi * (np.arange(n) + .5) / n, np.arange(1, n // 2 + 1)[:, None]
    return np.cos(t), 2 / n * (1 - 2 * (np.cos(2 * j * t) / (4 * j * j - 1)).sum(0))


def across(theta, phi, sigma, roughness, index):
    """Mean of A N of each lobe over the strand's width, of light from the eye at theta that is turned by phi: all [n],
    one look -> [n, 4]."""
    h, weight = fejer(2 * int(3 / scale(roughness) + 32))
    weight = weight[h > 0]
    h = h[h > 0]
    result = np.zeros((len(theta), LOBES))
    step = MOST // len(h)
    for first in range(0, len(theta), step):
        there = slice(first, first + step)
        t, p, a = (f64(each)[there, None] for each in (theta, phi, sigma))
        both = turned(p, t, h, roughness, index) + turned(-p, t, h, roughness, index)
        result[there] = (attenuations(t, h, a, index) * both * weight[:, None]).sum(1) / 2
    return result


def scattering(theta_v, theta_l, phi, color, lobes):
    """S of light from l towards the eye at v, of hair of a linear colour [n, 3] and one look -> [n, 3]: light towards
    the eye = π · S · the light that a white surface would send that faces it."""
    longitudinal_roughness, roughness, tilt, index = f64(lobes)
    m = longitudinal(theta_v, theta_l, longitudinal_roughness, tilt)
    sigma = absorption_of(f64(color), roughness)
    return np.stack([(m * across(theta_v, phi, sigma[:, k], roughness, index)).sum(1) for k in range(3)], 1)


def fibre(color, lobes, t, to_light, v):
    """Light from fibres [n, 3] towards v of a light that is 1: each of its own look, all vectors unit [n, 3]."""
    sine_v, sine_l = dot(t, v), dot(t, to_light)
    theta_v, theta_l = np.arcsin(np.clip(sine_v, -1, 1)), np.arcsin(np.clip(sine_l, -1, 1))
    one, other = unit(v - sine_v[:, None] * t), unit(to_light - sine_l[:, None] * t)
    phi = np.arctan2(np.linalg.norm(np.cross(one, other), axis=-1), dot(one, other))
    result = np.zeros(color.shape)
    for look in np.unique(lobes, axis=0):
        these = (lobes == look).all(1)
        result[these] = np.pi * scattering(theta_v[these], theta_l[these], phi[these], color[these], look)
    return result
