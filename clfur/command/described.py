"""The scene that options describe: fur on a mesh, lights, camera, body and ground."""

import math

import attrs
import click

from .. import Camera, Ground, Material, Scene, Shells, Strands, load_materials, load_mesh
from ..files.curves import read_curves
from ..files.images import load_picture
from ..scene import frame, highlighted
from ..scene.checks import vector
from ..scene.strands import LAW
from .hair_types import hair_type, hair_types, type_map
from .types import light_of, read_for

SEGMENTS, MOST_SEGMENTS = 8, 64   # of a strand: at least, and where guides have as many points
SPARSE = 10_000            # strands; a mesh with fewer looks bald: the sphere has 47,360
LEVEL, MOST = 5, 250_000   # of tessellation without options; triangles that it may make then


def scene_of(mesh, options):
    """The scene of a mesh that the options describe."""
    options = options | {"rest": None if options["rest"] is None else read_for("--rest", load_mesh, options["rest"])}
    options |= _guided(options)
    _, radius = (options["rest"] or mesh).bounds   # hair is as long in every pose
    kind, length = options["fur"], options["length"]
    if length is None:
        length = (0.12 if kind == "shells" else 0.08) * radius
    fur = []
    if kind != "strands":
        fur.append(_shells(options, length / 2 if kind == "both" else length, radius))
    if kind != "shells":
        fur.append((_strands if options["hair"] is None else _hair)(options, length, radius, len(mesh.faces)))
    if options.get("specular") == "half-vector":   # the other is that of looks which say nothing
        fur = highlighted(tuple(fur), "half-vector")

    height = options["ground"]
    ground = None if height is None else Ground(None if height == "lowest" else height)
    lights = _lights(options["lights"], mesh.bounds[0])
    given = options["eye"] or options["target"]
    towards = {"direction": options["view"]} if options["view"] else {}
    camera = frame(mesh, fur, options["size"], options["fov"], ground=None if given else ground, lights=lights,
                   **towards)
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
                 body=options["body"], ground=ground, **_body_color(options))


def _guided(options):
    """{"guides": the Curves of the file that they name, "segments"}: as many as guides have where it is not told."""
    guides = options["guides"] and read_for("--guides", lambda path: read_curves(path, {}), options["guides"])
    longest = int(guides.counts.max(initial=0)) - 1 if guides else 0
    known = options["segments"]
    return {"guides": guides, "segments": min(max(SEGMENTS, longest), MOST_SEGMENTS) if known is None else known}


def _lights(texts, middle):
    """The `Light`s of texts, in which spots without a direction look at the middle [3] of the mesh; ambient light,
    where a text has none, comes with the first."""
    return [light_of(text, {"ambient": 0.0} if number else {}, middle) for number, text in enumerate(texts)]


def _body_color(options):
    """{"body_color"} of the options or else of the mesh's file; {} for a scene's own."""
    color, picture = options["body_color"], options["body_texture"]
    if picture is not None:
        return {"body_color": Material(color or (1, 1, 1), read_for("--body-texture", load_picture, picture))}
    if color is not None or options["body"] == "holdout":   # which is not seen
        return {} if color is None else {"body_color": color}
    materials = load_materials(options["given"])
    return {"body_color": materials or tuple(0.6 * part for part in options["color"])}


def _shells(options, length, radius):
    """The `Shells` of this length on a mesh of this radius that the options describe."""
    frequency = options["frequency"]
    if frequency is None:
        frequency = 60 / radius if options["pattern"] == "cells" else 40.0
    # Half of what strands bend: hairs that stand upright go into the body if they are bent by more than 1.
    weight = 0.5 / (options["stiffness"] or LAW["stiffness"])
    if options["force_weight"] is not None:
        weight = 0.5 * options["force_weight"] * options["segments"]
    return Shells(
        length=length, frequency=frequency, length_variation=options["variation"],
        force=[weight * part for part in options["force"]],
        **{name: options[name] for name in ("layers", "pattern", "density", "noise", "wind", "time", "shading", "color",
                                            "alpha", "seed", "rest")})


def density(options, faces):
    """{"inner", "outer", "roots"} of strands on a mesh of so many faces: those that are given, and what makes no more
    than `MOST` triangles and strands of them."""
    level = max((n for n in range(1, LEVEL + 1) if faces * triangles_of_face(n) <= MOST), default=1)
    inner, outer, roots = (options[name] for name in ("inner", "outer", "roots"))
    if inner or outer:
        return {"inner": inner or LEVEL, "outer": outer or LEVEL, "roots": roots or "faces"}
    fits = faces * triangles_of_face(level) <= MOST
    return {"inner": level, "outer": level, "roots": ("faces" if fits else MOST) if roots is None else roots}


def lowered(options, strands):
    """In a few words, how the strands of a mesh are fewer than the options would make of a small one; or ""."""
    if options["inner"] or options["outer"] or not isinstance(strands, Strands) or strands.inner == LEVEL:
        return ""
    roots = f" and roots {MOST:,}" if options["roots"] is None and strands.roots != "faces" else ""
    return f"tessellation level {strands.inner} in place of {LEVEL}{roots}, as the mesh is large"


def sparse(options, scene, drawn):
    """For the line that tells what was drawn: how a mesh of few faces, which looks bald, gets more strands; or ""."""
    given = options["inner"] or options["outer"] or options["roots"] is not None
    if given or not isinstance(scene.strands, Strands) or drawn.strands >= SPARSE:
        return ""
    return "; few strands, as the mesh has few faces: --roots 100000 gives more"


def triangles_of_face(level):
    """How many triangles a face is divided into, with this level within it and at its edges."""
    return 3 * level * level // 2


def _strands(options, length, radius, faces):
    """The `Strands` of this length that the options describe on a mesh of this radius and so many faces."""
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
        "tufts": options["tufts"],
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
    return Strands(
        types=[hair_type(hair, {})] if options["types"] is None else read_for(
            "--types", lambda path: hair_types(path, hair), options["types"]),
        type_map=None if options["type_map"] is None else type_map(options["type_map"]),
        **density(options, faces),
        **{name: options[name] for name in ("surface", "force", "seed", "rest", "guides", "parting")})


def _hair(options, length, radius, faces):
    """The `Curves` of the strand file that the options name; what it does not say is theirs."""
    levels = density(options, faces)
    given = {name: options[name] for name in ("width", "color", "alpha", "look", "surface", "seed")}
    given |= {"inner": levels["inner"], "outer": levels["outer"]}
    given = {name: value for name, value in given.items() if value is not None}
    return read_for("--hair", lambda path: read_curves(path, given), options["hair"])
