"""How fast a device is: the same frame on each, with all that a default picture needs, timed when it is warm."""

import statistics
import time

from ..device.scheduler import Scheduler
from ..files.meshes import load_mesh
from ..render import draw
from ..scene import Camera, HairType, Light, Scene, Strands
from .report import milliseconds

FRAMES, SECONDS = 5, 1.0   # so many frames are timed, but none begun after so long
ALIKE = 1.05               # what takes up to so many times as long as the fastest is as fast


def scene():
    """A ball of 50,000 strands of 8 segments, which fill most of 480x360."""
    hair = HairType(color=(.55, .36, .2), segments=8, length=.25, width=.003, direction_variation=.2)
    return Scene(mesh=load_mesh("sphere"), fur=Strands(roots=50_000, types=[hair], force=(0, -1, 0)),
                 camera=Camera(eye=(0, .4, 2.6), size=(480, 360)), light=Light(direction=(-1, -1, -1)))


def measure(device):
    """Seconds of a frame of `scene` by the default settings, everything done anew in each: the median of up to
    `FRAMES`, after one that builds kernels."""
    gpu, furry, frames = Scheduler(device), scene(), []
    draw(furry, gpu)
    began = time.perf_counter()
    while not frames or (len(frames) < FRAMES and time.perf_counter() - began < SECONDS):
        gpu.forget()
        frames.append(draw(furry, gpu).seconds)
    return statistics.median(frames)


def told(seconds):
    """Which device is fastest, and by how much, in a line; ``seconds``: {device: of a frame}, one or more."""
    (best, least), *others = sorted(seconds.items(), key=lambda item: item[1])
    words = [f"{best} {'is fastest, ' if others else 'takes '}{milliseconds(least)} ms a frame"]
    for place, (name, took) in enumerate(others):
        times = f"{took / least:.{2 if took < 9.95 * least else 3}g} times" + " as long" * (not place)
        words.append(f"{name} {'takes ' * (not place)}{times if took >= ALIKE * least else 'about as long'}")
    return words[0] + "; " * bool(others) + ", ".join(words[1:])
