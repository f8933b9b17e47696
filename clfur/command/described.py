"""The scene that options describe: fur on a mesh, lights, camera, body and ground."""

import math
from pathlib import Path

import attrs
import click
import numpy as np

from .. import Camera, Ground, Material, Scene, Shells, Strands, load_mesh
from ..files.images import load_picture
from ..files.usd import is_usd
from ..scene import extent, frame, fur_extent, highlighted, upright
from ..scene.bounds import LONG
from ..scene.checks import vector
from ..scene.scene import DIRECTION
from ..scene.shells import gust
from ..scene.strands import LAW
from .hair_types import groom_of, hair_type, hair_types, type_map
from .skin import skin_of
from .types import light_of, read_for, tufts_of

SEGMENTS, MOST_SEGMENTS = 8, 64   # of a strand: at least, and where guides have as many points
SKIN = 0.6                 # of the hair's light: bare places are seen between hairs, and must not shine through
ROOTS = 100_000            # strands without options, on any mesh: it is framed as large as any other
SHEEN = 0.15, 40           # specular and exponent of shells: their hairs lie all alike, a narrow one is a band of satin
TUFTS = "4000:strength=0.5"   # in which strands gather without options: alike and evenly, they are of plush
HAIRS = 60_000             # of shells on a mesh without options
# As the camera sees them, from the upper left and from behind: the second draws the outline of hair.  At half the
# first's strength or more a ground is framed with the shadows of both.
LIGHTS = [((1.2, -1, -0.3), "color=1,0.97,0.92"), ((-0.9, -1.2, 0.7), "color=0.85,0.92,1 intensity=0.6")]
LEVEL, MOST = 5, 250_000   # of tessellation without options; triangles that it may make then


def scene_of(mesh, options):
    """The scene of a mesh that the options describe, or of none with "curves", strands that take the place of grown
    ones."""
    options = options | {"time": options["time"] or 0.0, "code": options["time"]}
    options |= {"rest": None if options["rest"] is None else standing("--rest", load_mesh, options["rest"],
                                                                               options["up"])}
    options |= _guided(options)
    base, curves = options["rest"] or mesh, options.get("curves")   # hair is as long in every pose
    middle, radius = extent(None, curves) if base is None else base.bounds
    kind, length = options["fur"], options["length"]
    if length is None:
        length = (0.12 if kind == "shells" else 0.08) * radius
    fur = []
    if kind != "strands":
        fur.append(_shells(options, length / 2 if kind == "both" else length))
    if curves is not None:
        fur.append(curves)
    elif kind != "shells":
        fur.append((_strands if options["hair"] is None else _hair)(options, length, radius, mesh))
    if options.get("specular") == "half-vector":   # the other is that of looks which say nothing
        fur = highlighted(tuple(fur), "half-vector")

    height = options["ground"]
    ground = None if height is None else Ground(None if height == "lowest" else height)
    lights = _lights(options, middle if mesh is None else mesh.bounds[0])
    given = options["eye"] or options["target"]
    towards = {"direction": options["view"]} if options["view"] else {}
    camera = frame(mesh, fur, options["size"], options["fov"], ground=None if given else ground, lights=lights,
                   sides=options.get("sides", 1), **towards)
    if given:
        target = vector(3)(options["target"] or camera.target, "Camera.target")
        eye = options["eye"] or (camera.eye + target - camera.target).tolist()
        aside, up = math.hypot(eye[0] - target[0], eye[2] - target[2]), abs(eye[1] - target[1])
        upright = aside > 1e-3 * up
        camera = Camera(eye=eye, target=target, up=(0, 1, 0) if upright else (0, 0, -1),
                        fov=options["fov"], size=options["size"])
    if options["zoom"] != 1:
        fov = 2 * math.degrees(math.atan(math.tan(math.radians(camera.fov) / 2) / options["zoom"]))
        camera = attrs.evolve(camera, fov=fov)
    return Scene(mesh=mesh, fur=fur, camera=camera, light=lights, environment=options["sky"],
                 body=options["body"], ground=ground, **_body_color(options, fur[-1]))


def standing(flag, read, path, up):
    """What `read_for` gives of a Mesh or Curves, of which an axis is ``up``, with Y up; USD tells its own."""
    found = read_for(flag, read, path)
    return upright(found) if up == "z" and not is_usd(path) else found


def _guided(options):
    """{"guides": the Curves of the file that they name, "segments"}: as many as guides have where it is not told."""
    guides = options["guides"] and standing(
        "--guides", lambda path: _curves(path, {}), options["guides"], options["up"])
    longest = int(guides.counts.max(initial=0)) - 1 if guides else 0
    known = options["segments"]
    return {"guides": guides, "segments": min(max(SEGMENTS, longest), MOST_SEGMENTS) if known is None else known}


def _lights(options, middle):
    """The `Light`s of the options, in which spots without a direction look at the middle [3] of the mesh; ambient
    light, where a text has none, comes with the first.  Without any they go with the camera, and a sky shines from
    behind by itself."""
    texts = options["lights"]
    if not texts:
        place = options["eye"] and vector(3)(options["eye"], "Camera.eye") - vector(3)(
            options["target"] or middle, "Camera.target")
        towards = options["view"] or (DIRECTION if place is None else place)
        around = math.atan2(towards[0], towards[2])
        turned = [(x * math.cos(around) + z * math.sin(around), y, z * math.cos(around) - x * math.sin(around), rest)
                  for (x, y, z), rest in LIGHTS[:1 if options["sky"] else None]]
        texts = [f"sun direction={x:.6f},{y:.6f},{z:.6f} {rest}" for x, y, z, rest in turned]
    return [light_of(text, {"ambient": 0.0} if number else {}, middle) for number, text in enumerate(texts)]


def _body_color(options, fur):
    """{"body_color"} of the options, else of the mesh's file, else skin under this fur; {} for a scene's own."""
    color, picture = options["body_color"], options["body_texture"]
    if picture is not None:
        found, color = read_for("--body-texture", load_picture, picture), color or (1, 1, 1)
        return {"body_color": {number: Material(color, each) for number, each in found.items()}
                if isinstance(found, dict) else Material(color, found)}
    if color is not None or options["body"] == "holdout":   # which is not seen
        return {} if color is None else {"body_color": color}
    if Path(options["given"]).suffix.lower() in (".glb", ".gltf"):
        from .. import load_materials  # takes long

        if materials := load_materials(options["given"]):
            return {"body_color": materials}
    return {"body_color": SKIN * _mean_color(fur)}


def _mean_color(fur):
    """Linear RGB float64 [3] of hair, mean over types, or over the points of a file's."""
    if isinstance(fur, Strands):
        return np.mean([kind.color for kind in fur.types if kind.segments] or [fur.types[0].color], axis=0)
    return np.mean(np.reshape(fur.color, (-1, 3)), axis=0, dtype=float)


def _shells(options, length):
    """The `Shells` of this length that the options describe."""
    fine = {"frequency": options["frequency"] or 40.0}
    if options["frequency"] is None and options["pattern"] == "cells":
        fine = {"hairs": options["hairs"] or HAIRS}
    # Half of what strands bend: hairs that stand upright go into the body if they are bent by more than 1.
    weight = 0.5 / (options["stiffness"] or LAW["stiffness"])
    if options["force_weight"] is not None:
        weight = 0.5 * options["force_weight"] * options["segments"]
    return Shells(
        length=length, **fine, specular=SHEEN[0], exponent=SHEEN[1], length_variation=options["variation"],
        force=[weight * part for part in options["force"]],
        **{name: options[name] for name in ("layers", "pattern", "density", "noise", "wind", "time", "shading", "color",
                                            "alpha", "seed", "rest")})


def density(options, faces):
    """{"inner", "outer", "roots"} of strands on a mesh of so many faces: those that are given, else `ROOTS` by area,
    and a level that makes no more than `MOST` triangles.  Who gives a level alone wants a strand a triangle."""
    level = max((n for n in range(1, LEVEL + 1) if faces * triangles_of_face(n) <= MOST), default=1)
    inner, outer, roots = (options[name] for name in ("inner", "outer", "roots"))
    if inner or outer:
        return {"inner": inner or LEVEL, "outer": outer or LEVEL, "roots": roots or "faces"}
    return {"inner": level, "outer": level, "roots": ROOTS if roots is None else roots}


def lowered(options, strands):
    """In a few words, how strands of faces are fewer than on a small mesh; or ""."""
    if options["inner"] or options["outer"] or options["roots"] != "faces" or not isinstance(strands, Strands) or (
            strands.inner == LEVEL):
        return ""
    return f"tessellation level {strands.inner} in place of {LEVEL}, as the mesh is large"


def triangles_of_face(level):
    """How many triangles a face is divided into, with this level within it and at its edges."""
    return 3 * level * level // 2


def _tufts(options):
    """The `Tufts` of the options or None; guides have their own shapes."""
    told = options["tufts"]
    return tufts_of(TUFTS) if told is None and options["guides"] is None else told or None


def _strands(options, length, radius, mesh):
    """The `Strands` of this length that the options describe on a mesh of this radius."""
    hair = {
        "color": options["color"],
        "segments": options["segments"],
        # Short fur on a mesh with a wide ground: strands that are wider than long would cover all of the picture.
        "width": min(0.0012 * radius, 0.1 * length) if options["width"] is None else options["width"],
        "tip_width": options["tip_width"],
        "root_color": options["root_color"],
        "tip_color": options["tip_color"],
        "curl": options["curl"],
        "wave": options["wave"],
        "tufts": _tufts(options),
        "frizz": options["frizz"],
        "alpha": options["alpha"],
        "look": options.get("look"),
        **dict.fromkeys(("length_variation", "direction_variation", "color_variation"), options["variation"]),
    }
    if options["guides"] is not None:   # which lean as they are told to
        hair["direction_variation"] = 0
    law = {"length": length, "stiffness": options["stiffness"] or LAW["stiffness"]}
    rule = {"segment_length": length / max(options["segments"], 1),
            "force_weight": 0.2 if options["force_weight"] is None else options["force_weight"]}
    hair["rules"] = (law, rule) if options["force_weight"] is None else (rule, law)
    if options["type_map"] is not None and options["types"] is None:
        raise click.UsageError("--type-map needs --types, the hair types that its colours mean")
    file = options["types"]
    said = {} if file is None else read_for("--types", groom_of, file)
    keys = options["type_map"] or ("type_map" in said and Path(file).parent / str(said["type_map"]))
    made = Strands(
        types=[hair_type(hair, {})] if "types" not in said else read_for(
            "--types", lambda path: hair_types(path, said["types"], hair), file),
        type_map=type_map(keys) if keys else None,
        **density(options, len(mesh.faces)), **skin_of(mesh, options, said, Path(file or "").parent),
        guides_reach=options["reach"] or None, force=_force(options, mesh),
        **{name: options[name] for name in ("surface", "seed", "rest", "guides", "parting")})
    slides = fur_extent(made) > LONG * radius if options["collision"] == "auto" else options["collision"] == "on"
    return attrs.evolve(made, collision=True) if slides else made


def _force(options, mesh):
    """The force on strands that the options describe, with the wind of that moment in the mesh's middle: it takes tips
    as far aside, at first, as those of as long shells."""
    force, wind = np.asarray(options["force"], float), vector(3)(options["wind"], "--wind")
    if not wind.any():
        return force
    _, _, radius = (options["rest"] or mesh).own_frame
    stiffness = options["stiffness"] or LAW["stiffness"]
    if options["force_weight"] is not None:
        whole = options["force_weight"] * options["segments"]
        stiffness = 1 / whole if whole else 0.0
    return force + stiffness * gust(wind, options["time"], mesh.bounds[0], radius) * wind


def _curves(path, given, time=None):
    from ..files.curves import read_curves  # with all formats

    return read_curves(path, given, time=time)


def _hair(options, length, radius, mesh):
    """The `Curves` of the strand file that the options name; what it does not say is theirs."""
    levels = density(options, len(mesh.faces))
    given = {name: options[name] for name in ("width", "color", "alpha", "look", "surface", "seed")}
    given |= {"inner": levels["inner"], "outer": levels["outer"]}
    given = {name: value for name, value in given.items() if value is not None}
    curves = standing("--hair", lambda path: _curves(path, given, options["code"] if is_usd(path) else None),
                      options["hair"], options["up"])
    if options["inner"] or options["outer"]:   # a file may say otherwise
        curves = attrs.evolve(curves, inner=given["inner"], outer=given["outer"])
    return curves
