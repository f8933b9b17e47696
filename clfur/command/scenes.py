"""The scene and the settings of a command: of a mesh and options, or of a Python file."""

import contextlib
import re
import runpy
import sys
import traceback
import warnings
from pathlib import Path

import attrs
import click

import clfur

from .. import PRESETS, Error, Scene, Settings, load_mesh
from ..budget import LADDER, refused
from ..files.usd import is_usd
from ..judge.frontier import label
from ..scene import highlighted, upright
from ..settings import CHOSEN
from .described import scene_of
from .options import check_fur, check_settings, given_flags
from .usd import scene_of_usd


def is_scene_file(given):
    """Whether a command's argument names a Python file that sets a scene, not a mesh."""
    return Path(given).suffix.lower() == ".py"


def load_scene(given, options):
    """(Scene, Settings) of a command's argument, a mesh or a scene file, and of its `scene_options`, {name: value}.

    Raises `clfur.Error` for what cannot be loaded, and click.UsageError for options that have no say: the
    scene file sets them itself, or they are of another fur than is chosen.
    """
    flags = given_flags(options)
    if "view" in flags and (other := next((flags[name] for name in ("eye", "target") if name in flags), None)):
        raise click.UsageError(f"--view places the camera, and so does {other}; allowed: one of them")
    if "stiffness" in flags and "force_weight" in flags:
        raise click.UsageError("--stiffness and --force-weight are of two rules of growth; allowed: one of them")
    settings = _settings(flags, options)
    if "camera" in flags and not is_usd(given):
        raise click.UsageError(f"--camera is for USD scenes, but {given} is none; allowed: with one")
    if not is_scene_file(given):
        check_fur({name: flag for name, flag in flags.items() if name != "time"} if is_usd(given) or is_usd(
            options["hair"]) else flags, options)
        check_settings(flags, settings)
        if "up" in flags and is_usd(given):
            raise click.UsageError(f"--up is for files that do not tell, but {given} does; allowed: without it")
        scene = scene_of_usd(given, flags, options) if is_usd(given) else scene_of(
            upright(load_mesh(given)) if options["up"] == "z" else load_mesh(given), options | {"given": given})
        return scene, _taken(scene, settings, flags, options)
    scene, given_settings = _run(given)
    # Options named as a field of Settings count where the file sets no settings; all others describe the scene.
    for name, flag in flags.items():
        if given_settings or not (hasattr(settings, name) or name == "preset"):
            raise click.UsageError(f"{flag}: {given} sets this itself; change it there")
    check_settings(flags, settings)
    if "specular" in flags:
        scene = attrs.evolve(scene, fur=highlighted(scene.fur, options["specular"]))
    return scene, given_settings or _taken(scene, settings, flags, options)


def _settings(flags, options):
    """The `Settings` of the options; raises click.UsageError where some of those given, {name: flag}, have no say."""
    values = {field.name: options[field.name] for field in attrs.fields(Settings)
              if field.name in options and field.name != "specular"}   # which is their looks'
    if values:
        values["samples"] = int(values["samples"])
    goal = next((flags[name] for name in ("seconds", "max_error") if name in flags), None)
    if beside := goal and next((flags[name] for name in (*CHOSEN, "preset") if name in flags), None):
        raise click.UsageError(f"{goal} chooses what {beside} sets; allowed: one of them")
    if preset := options.get("preset"):
        return attrs.evolve(PRESETS[preset], **{name: value for name, value in values.items() if name in flags})
    return Settings(**values)


def _taken(scene, settings, flags, options):
    """The `Settings`, but of a preset that the scene refuses those of the rung below that it takes; which is told."""
    why = options.get("preset") and refused(scene, settings)
    for rung in reversed(LADDER[:LADDER.index(PRESETS[options["preset"]])] if why else ()):
        if rung.raster != settings.raster:   # cheap ones, and another picture
            continue
        lower = attrs.evolve(rung, **{name: getattr(settings, name) for name in flags if hasattr(settings, name)})
        if not refused(scene, lower):
            warnings.warn(f"--preset {options['preset']}: {why.partition(';')[0]}; drawn with {label(lower)}",
                          stacklevel=2)
            return lower
    return settings


def _run(path):
    """(scene, settings or None) that a Python file sets; raises `clfur.Error` naming the file and the line."""
    if not Path(path).is_file():
        raise Error(f"{path}: {'is a folder' if Path(path).is_dir() else 'no such file'}; allowed: a scene file")
    try:
        with contextlib.redirect_stdout(sys.stderr):   # stdout is the command's own
            there = runpy.run_path(path)
    except (Exception, SystemExit) as error:
        lines = [place.lineno for place in traceback.extract_tb(error.__traceback__) if place.filename == path]
        line = error.lineno if isinstance(error, SyntaxError) and error.filename == path else lines[-1] if lines else 0
        kind = "" if isinstance(error, Error) else f"{type(error).__name__}: "
        said = f"{error.msg if isinstance(error, SyntaxError) else error}{_known(error)}"
        raise Error(f"{path}, line {line}: {kind}{said}") from error
    scene, settings = there.get("scene"), there.get("settings")
    if not isinstance(scene, Scene):
        raise Error(f"{path} sets {f'scene = {scene!r:.60}' if 'scene' in there else 'no scene'}; "
                    f"allowed: scene = clfur.Scene(...)")
    if not isinstance(settings, Settings | None):
        raise Error(f"{path} sets settings = {settings!r:.60}; allowed: settings = clfur.Settings(...), or none")
    return scene, settings


def _known(error):
    """For a scene file's error: the fields of the class of ours that was given another; or ""."""
    found = re.match(r"(\w+)\.__init__\(\) got an unexpected keyword", str(error))
    kind = found and getattr(clfur, found[1], None)
    if not (isinstance(error, TypeError) and isinstance(kind, type) and attrs.has(kind)):
        return ""
    return f"; allowed: {', '.join(field.alias for field in attrs.fields(kind) if field.init)}"
