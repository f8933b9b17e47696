"""The scene and the settings of a command: of a mesh and options, or of a Python file."""

import contextlib
import functools
import inspect
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
from ..errors import shown
from ..files.input import is_noted
from ..files.usd import is_usd
from ..scene import highlighted, on_host, upright
from ..settings import CHOSEN, label
from .described import scene_of
from .options import check_fur, check_settings, given_flags

FPS = 24   # frames a second in which hair is moved up to a time


def is_scene_file(given):
    """Whether a command's argument names a Python file that sets a scene, not a mesh."""
    return Path(given).suffix.lower() == ".py"


def spare(output):
    """Raise click.UsageError if a file that is to be written, a path, is one that this command has read."""
    if is_noted(output):
        raise click.UsageError(f"{output} is read by this command and would be overwritten: name another with -o")


def load_scene(given, options):
    """(Scene, Settings) of a command's argument, a mesh or a scene file, and of its `scene_options`, {name: value}.

    A scene file's function gives the Scene at the option time, whose hair is as it is groomed. Raises `clfur.Error` for
    what cannot be loaded, and click.UsageError for options that have no say: the scene file sets them itself, or they
    are of another fur than is chosen.
    """
    scene, _, settings = load_moving(given, options)
    return scene_at(scene, options["time"]), settings


def scene_at(scene, seconds):
    """The Scene that is given, or that a function gives at a time; None: 0."""
    return scene(float(seconds or 0)) if callable(scene) else scene


def moved(given, scene, motion, seconds, device):
    """(Scene, steps) of what `load_moving` gives of a file, at a time from 0, or None: its hair has moved by `motion`
    up to then, frame by frame, and is on the host. Without motion, or at 0, the Scene as it is groomed, and 0."""
    if motion is None or not seconds:
        return scene_at(scene, seconds), 0
    if seconds < 0:
        raise click.UsageError(f"--time is {seconds:g}; allowed: from 0, as {given} sets motion")
    with of_file(given):
        motion = clfur.Motion(scene, **motion, fps=FPS, device=device)
        now, frames = _go(motion, seconds)
    return on_host(now), frames


def within(given, scene, motion, seconds, device, length):
    """(function of a share, 0 to 1, that gives Scenes on the host, steps) of the time of so many seconds that ends at
    ``seconds``, in what `load_moving` gives of a file that moves."""
    seconds = float(seconds or 0)
    began = seconds - length
    if not callable(scene) and motion is None:
        raise click.UsageError("--shutter and motion_vector are of what moves; allowed: a scene file with def "
                               "scene(t), or motion")
    if began < 0:
        raise click.UsageError(f"--time is {seconds:g}, but what is asked for begins {length:g} s before; allowed: "
                               f"from {length:g} on")
    if motion is None:
        return lambda share: scene_at(scene, began + share * length), 0
    with of_file(given):
        motion = clfur.Motion(scene, **motion, fps=FPS, device=device)
        _, steps = _go(motion, began)
        motion.step(length)
    return lambda share: on_host(motion.between(share)), steps + 1


def _go(motion, seconds):
    """Go on to a time from 0, frame by frame -> (Scene then, steps)."""
    frames = int(seconds * FPS + 1e-6)
    now, rest = motion.at(frames), seconds - frames / FPS
    return (motion.step(rest), frames + 1) if rest > 1e-6 else (now, frames)


@contextlib.contextmanager
def of_file(given, start=""):
    """What goes wrong within, and begins so (a text or several), is told of the file, but what a device, or the file's
    own function, does."""
    try:
        yield
    except Error as error:
        if type(error) is not Error or str(error).startswith(f"{given}") or not str(error).startswith(start):
            raise
        raise Error(f"{given}: {error}") from error


def load_moving(given, options):
    """(scene, motion, Settings) as `load_scene`, for a film: scene is a Scene or a function of seconds that gives one,
    motion {argument: value} of `clfur.Motion`, or None."""
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
        scene = _of_usd(given, flags, options) if is_usd(given) else scene_of(
            upright(load_mesh(given)) if options["up"] == "z" else load_mesh(given), options | {"given": given})
        return scene, None, _taken(scene, settings, flags, options)
    scene, motion, given_settings = _run(given)
    # Options named as a field of Settings, and the highlight of all looks, count where the file sets no settings; all
    # others describe the scene.
    for name, flag in flags.items():
        if name == "time" and (callable(scene) or motion is not None):
            continue
        if given_settings or not (hasattr(settings, name) or name in ("preset", "specular")):
            raise click.UsageError(f"{flag}: {given} sets this itself; change it there")
    check_settings(flags, settings)
    if "specular" in flags:
        scene = _with_highlights(scene, options["specular"])
    return scene, motion, given_settings or _taken(scene_at(scene, options["time"]), settings, flags, options)


def _of_usd(given, flags, options):
    from .usd import scene_of_usd  # with all that reads USD

    return scene_of_usd(given, flags, options)


def _with_highlights(scene, specular):
    """A Scene, or a function that gives one, whose looks have their highlight by the given direction."""
    if callable(scene):
        return lambda seconds: _with_highlights(scene(seconds), specular)
    return attrs.evolve(scene, fur=highlighted(scene.fur, specular))


def _settings(flags, options):
    """The `Settings` of the options; raises click.UsageError where some of those given, {name: flag}, have no say."""
    values = {field.name: options[field.name] for field in attrs.fields(Settings) if field.name in options}
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
    """(scene, motion or None, settings or None) that a Python file sets; a function `scene` gives Scenes, or raises.
    Raises `clfur.Error` naming the file and the line."""
    if not Path(path).is_file():
        raise Error(f"{path}: {'is a folder' if Path(path).is_dir() else 'no such file'}; allowed: a scene file")
    with _naming(path):
        there = runpy.run_path(path)
    scene, motion, settings = there.get("scene"), there.get("motion"), there.get("settings")
    if callable(scene):
        scene = _function(path, scene)
    elif not isinstance(scene, Scene):
        raise Error(f"{path} sets {f'scene = {scene!r:.60}' if 'scene' in there else 'no scene'}; "
                    f"allowed: scene = clfur.Scene(...), or def scene(t) that returns one")
    if not isinstance(settings, Settings | None):
        raise Error(f"{path} sets settings = {settings!r:.60}; allowed: settings = clfur.Settings(...), or none")
    if motion is not None:
        _check_motion(path, motion)
    return scene, motion, settings


def _check_motion(path, motion):
    """Raise `clfur.Error`, which names the scene file, for what are no arguments of `clfur.Motion`."""
    from ..film.moments import OF_MOTION

    wrong = [motion] if not isinstance(motion, dict) else [name for name in motion if name not in OF_MOTION]
    if wrong:
        what = f"motion[{wrong[0]!r:.60}]" if isinstance(motion, dict) else f"motion = {motion!r:.60}"
        raise Error(f"{path} sets {what}; allowed: motion = {{...}} of {', '.join(OF_MOTION)}, or none")


@contextlib.contextmanager
def _naming(path, doing=""):
    """What runs within and fails raises `clfur.Error` that names the file, its line and what it was ``doing``."""
    try:
        with contextlib.redirect_stdout(sys.stderr):   # stdout is the command's own
            yield
    except (Exception, SystemExit) as error:
        lines = [place.lineno for place in traceback.extract_tb(error.__traceback__) if place.filename == path]
        line = error.lineno if isinstance(error, SyntaxError) and error.filename == path else lines[-1] if lines else 0
        kind = "" if isinstance(error, Error) else f"{type(error).__name__}: "
        said = f"{error.msg if isinstance(error, SyntaxError) else error}{_known(error)}"
        raise Error(f"{path}, line {line}{doing}: {kind}{said}") from error


def _function(path, scene):
    """A scene file's function, whose errors name the file; it gives Scenes."""
    try:
        inspect.signature(scene).bind(0.0)
    except TypeError as error:
        raise Error(f"{path} sets scene as a function, but {error} when it is called with seconds; allowed: "
                    "def scene(t)") from None

    @functools.wraps(scene)
    def named(seconds):
        with _naming(path, f", scene({seconds:g})"):
            found = scene(seconds)
        if not isinstance(found, Scene):
            raise Error(f"{path}: scene({seconds:g}) is {shown(found)}; allowed: a clfur.Scene")
        return found
    return named


def _known(error):
    """For a scene file's error: the fields of the class of ours that was given another; or ""."""
    found = re.match(r"(\w+)\.__init__\(\) got an unexpected keyword", str(error))
    kind = found and getattr(clfur, found[1], None)
    if not (isinstance(error, TypeError) and isinstance(kind, type) and attrs.has(kind)):
        return ""
    return f"; allowed: {', '.join(field.alias for field in attrs.fields(kind) if field.init)}"
