"""What cl/scatter.h means, in float64: how hair scatters light.

``shine``: [n, 4] as `layout.HairType` has it: specular, exponent, alpha, model.  ``lobes``: [n, 4] as there too.
"""

import numpy as np

from . import chiang
from .vectors import dot, sine, unit

KAJIYA_KAY, HALF_VECTOR, TURNED, CHIANG = 0, 1, 2, 3   # models


def highlight(model, t, to_light, v):
    """Cosine between the eye and the cone of mirror directions (Kajiya and Kay 1989), or sine between fibre
    and half vector (the report's equation 5), 0 where there is none: [n] from unit vectors [n, 3]; model: [n]."""
    h = to_light + v
    length = np.linalg.norm(h, axis=-1)
    half = np.where(length > 1e-6, np.linalg.norm(np.cross(t, h), axis=-1) / np.maximum(length, 1e-6), 0)
    cone = np.maximum(sine(t, to_light) * sine(t, v) - dot(t, to_light) * dot(t, v), 0)
    return np.where(model == HALF_VECTOR, half, cone)


def fibre(color, shine, t, to_light, v, light, ambient, lobes=None):
    """Light from fibres [n, 3]: diffuse and highlight (the report's section 2.2), or that of Chiang's, and ambient."""
    specular, exponent, _, model = shine.T
    color, direct, glass = np.broadcast_to(color, t.shape), np.zeros(t.shape), model == CHIANG
    there = [each[~glass] for each in (model, t, to_light, v)]
    bright = specular[~glass] * highlight(*there) ** exponent[~glass]
    direct[~glass] = color[~glass] * sine(t, to_light)[~glass, None] + bright[:, None]
    if glass.any():
        direct[glass] = chiang.fibre(color[glass], lobes[glass], t[glass], to_light[glass], v[glass])
    return light * direct + ambient * color


def surface(color, shine, n, to_light, v, light, ambient):
    """Light from a surface [n, 3] with these normals, the height field of fur: Blinn's (1977), as the report has it."""
    specular, exponent, _, _ = shine.T
    towards = dot(n, to_light)
    bright = specular * np.clip(dot(n, unit(to_light + v)), 0, 1) ** exponent * (towards > 0)
    return light * (np.maximum(towards, 0)[:, None] * color + bright[:, None]) + ambient * color
