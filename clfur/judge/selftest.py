"""Draws a small picture that goes through every stage of strands, and compares it with what it should be."""

import warnings
from importlib.resources import files

import attrs
import numpy as np

from ..render import draw
from ..scene import Camera, HairType, Light, Mesh, PointForce, Scene, Strands
from ..settings import RASTERS, Settings

SETTINGS = Settings(samples=4, shadows="length", grid=32, shadow_map=64)
TOLERANCE, SHARE = 1e-3, 1e-3   # colour, linear; pixels that may miss it: sines and powers differ between drivers


def scene():
    """A furry octahedron: two types of hair by uv, curl, wave, variation, forces, body and shadows, 64x48."""
    positions = np.array([(1, 0, 0), (-1, 0, 0), (0, 1.2, 0), (0, -.9, 0), (0, 0, 1), (0, 0, -1)])
    faces = np.array([(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)])
    uv = (positions[faces][..., :2] + 1.5) / 3
    short = HairType(color=(.2, .25, .5), segments=5, segment_length=.05, width=.012, force_weight=.1, key=(0, 0, 255),
                     wave=(.02, 1.5), direction_variation=.4)
    long = HairType(color=(.7, .45, .2), segments=9, segment_length=.05, width=.015, force_weight=.25, key=(255, 0, 0),
                    curl=(.03, 2), length_variation=.5, color_variation=.4, alpha=.6)
    fur = Strands(inner=3, outer=2, types=(short, long), roots=700, seed=3,
                  type_map=np.array([[short.key, long.key], [long.key, short.key]], np.uint8),
                  point_forces=[PointForce((1.5, 1, 1), .3)])
    return Scene(mesh=Mesh(positions, uv=uv, faces=faces), fur=fur, body_color=(.3, .2, .12),
                 camera=Camera(eye=(1.2, 1.1, 3), size=(64, 48)), light=Light(direction=(-1, -1.2, -.4)))


def picture(device):
    """The self-test as a device draws it -> {"color (RASTER)": float32 [48, 64, 4], and each hash as text}."""
    result, furry = {}, scene()
    for raster in RASTERS:
        drawn = draw(furry, device, attrs.evolve(SETTINGS, raster=raster), hashes=True)
        result |= {f"{name} ({raster})": value for name, value in (drawn.images | drawn.hashes).items()}
    return result


def expected():
    """The picture as it should be, with the same keys."""
    with files(__package__).joinpath("selftest.npz").open("rb") as file, np.load(file) as saved:
        return {name: value if value.ndim else str(value) for name, value in saved.items()}


def differences(drawn, right):
    """What is wrong with a picture, a text for each; none if it is right."""
    wrong = []
    for name, value in right.items():
        if isinstance(value, str):
            if drawn[name] != value:
                wrong.append(f"other bits in {name.replace('_', ' ')}")
            continue
        off = ~(np.abs(drawn[name] - value) <= TOLERANCE).all(-1)   # "not within": NaN is off, too
        if off.mean() > SHARE:
            worst = np.abs(drawn[name] - value).max()
            wrong.append(f"{off.mean():.1%} of the pixels have another {name}, by up to {worst:.2g}")
    return wrong


def check(device):
    """Draw the self-test -> (one line of what is wrong with it, or "", [what was warned of])."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", RuntimeWarning)
        wrong = ", ".join(differences(picture(device), expected()))
    return wrong, [str(warning.message) for warning in said if warning.category is RuntimeWarning]
