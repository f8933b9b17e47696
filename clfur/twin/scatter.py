"""What cl/scatter.h means, in float64: how hair scatters light."""

import numpy as np

from .vectors import dot, sine, unit


def highlight(half_vector, t, to_light, v):
    """Cosine between the eye and the cone of mirror directions (Kajiya and Kay 1989), or sine between fibre
    and half vector (the report's equation 5), 0 where there is none: [n] from unit vectors [n, 3]."""
    if half_vector:
        h = to_light + v
        length = np.linalg.norm(h, axis=-1)
        return np.where(length > 1e-6, np.linalg.norm(np.cross(t, h), axis=-1) / np.maximum(length, 1e-6), 0)
    return np.maximum(sine(t, to_light) * sine(t, v) - dot(t, to_light) * dot(t, v), 0)


def fibre(color, specular, exponent, half_vector, t, to_light, v, light, ambient):
    """Light from fibres [n, 3]: diffuse and highlight (the report's section 2.2), and ambient."""
    shine = specular * highlight(half_vector, t, to_light, v)[:, None] ** exponent
    return light * (color * sine(t, to_light)[:, None] + shine) + ambient * color


def surface(color, specular, exponent, n, to_light, v, light, ambient):
    """Light from a surface [n, 3] with these normals, the height field of fur: Blinn's (1977), as the report has it."""
    towards = dot(n, to_light)
    shine = specular * np.clip(dot(n, unit(to_light + v)), 0, 1) ** exponent * (towards > 0)
    return light * (np.maximum(towards, 0)[:, None] * color + shine[:, None]) + ambient * color
