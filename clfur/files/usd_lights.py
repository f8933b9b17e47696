"""Cameras and lights in USD files, as clfur has them (UsdGeomCamera, UsdLux)."""

import math
from typing import Any

import numpy as np

from ..errors import Error
from .usd import Stage
from .usd_mesh import content_of

LIGHTS = "DistantLight", "SphereLight", "DiskLight", "RectLight", "DomeLight", "DomeLight_1"
OTHER = "CylinderLight", "GeometryLight", "PortalLight", "PluginLight"
POLES = {"X": [[0, 0, 1], [1, 0, 0], [0, 1, 0]], "Y": np.eye(3), "Z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]]}


def camera_of(stage: Stage, name: str | None) -> dict | None:
    """Return the camera of this name or path, or the only one (or first) of a stage: pose float64 [4, 4] as `Camera`
    has it, window (left, right, bottom, top) on the plane one unit before it, and exposure, a factor of all light."""
    there = [(prim, matrices[0]) for prim, matrices in stage.seen() if prim.IsA(stage.pxr.UsdGeom.Camera)]
    names = ", ".join(str(prim.GetPath()) for prim, _ in there) or "none"
    chosen = [each for each in there if name in (None, each[0].GetName(), str(each[0].GetPath()))]
    if name is not None and len(chosen) != 1:
        raise Error(f"has {'several cameras' if chosen else 'no camera'} {name}; allowed: {names}")
    if not chosen:
        return None
    if len(chosen) > 1:
        stage.leave(f"other cameras than {chosen[0][0].GetPath()}", chosen[1][0])
    prim, matrix = chosen[0]
    camera, at = stage.pxr.UsdGeom.Camera(prim), stage.at
    if str(camera.GetProjectionAttr().Get(at)) != "perspective":
        raise Error(f"{prim.GetPath()}: is orthographic; allowed: perspective")
    if camera.GetFStopAttr().Get(at) > 0:
        stage.leave("depth of field", prim)
    focal, wide, tall, aside, above = (float(each.Get(at)) for each in (
        camera.GetFocalLengthAttr(), camera.GetHorizontalApertureAttr(), camera.GetVerticalApertureAttr(),
        camera.GetHorizontalApertureOffsetAttr(), camera.GetVerticalApertureOffsetAttr()))
    if not min(focal, wide, tall) > 0:
        raise Error(f"{prim.GetPath()}: has a focal length of {focal:g} and an aperture of {wide:g} x {tall:g}; "
                    "allowed: above 0")
    window = [(aside - wide / 2) / focal, (aside + wide / 2) / focal, (above - tall / 2) / focal,
              (above + tall / 2) / focal]
    return {"pose": _pose(matrix, prim), "window": window, "exposure": float(camera.ComputeLinearExposureScale(at))
            if hasattr(camera, "ComputeLinearExposureScale") else 2.0 ** float(camera.GetExposureAttr().Get(at))}


def _pose(matrix, prim):
    """A pose of a matrix, rows times which is the world: without its scales, which a picture does not show."""
    u, sizes, v = np.linalg.svd(matrix[:3, :3].T)
    if np.linalg.det(u @ v) < 0 or not sizes[2] > 0:
        raise Error(f"{prim.GetPath()}: is mirrored or flat; allowed: a camera that is turned and moved")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = u @ v, matrix[3, :3]
    return pose


def resolution_of(stage: Stage) -> tuple[tuple[int, int] | None, str]:
    """(the size of the picture that a stage asks for, how its camera's aperture fits another shape)."""
    UsdRender = stage.pxr.UsdRender
    settings = UsdRender.Settings.GetStageRenderSettings(stage.stage)
    settings = settings or next((UsdRender.Settings(prim) for prim in stage.stage.Traverse()
                                 if prim.IsA(UsdRender.Settings)), None)
    if not settings:
        return None, "expandAperture"
    asked = settings.GetResolutionAttr()
    size = [int(each) for each in asked.Get(stage.at)] if asked.HasAuthoredValue() else None
    return (size[0], size[1]) if size else None, str(settings.GetAspectRatioConformPolicyAttr().Get(stage.at))


def lights_of(stage: Stage) -> list[dict]:
    """Return the lights of a stage that are seen, each a dictionary of kind and, by it:

    distant: direction [3], angle in degrees, strength [3] as `Light` has it. near: position [3], direction [3], size,
    cone in degrees (360: everywhere), strength, which the square of the distance divides, and flat, whether it shines
    less aside. dome: turn [3, 3], from its own directions to the world's (rows times it), strength, and, as it has one,
    texture (bytes of a picture).
    """
    found = []
    for prim, matrices in stage.seen():
        kind = str(prim.GetTypeName())
        if kind in OTHER:
            stage.leave(f"a {kind}", prim)
        elif kind in LIGHTS:
            for matrix in matrices:
                light = {"DistantLight": _distant, "DomeLight": _dome, "DomeLight_1": _dome}.get(kind, _near)(
                    stage, prim, matrix)
                found.append(light | {"shadows": bool(_input(stage, prim, "shadow:enable", True)), "name": str(
                    prim.GetPath())})
    return found


def _input(stage, prim, name, usual):
    attribute = prim.GetAttribute(f"inputs:{name}")
    value = attribute.Get(stage.at) if attribute else None
    return usual if value is None else value


def _emitted(stage, prim):
    """The light's L [3]: its colour times its intensity and exposure."""
    said = [float(_input(stage, prim, name, usual)) for name, usual in (("intensity", 1), ("exposure", 0))]
    color = np.array(_input(stage, prim, "color", (1, 1, 1)), np.float64)
    if _input(stage, prim, "enableColorTemperature", False):
        color *= np.array(stage.pxr.UsdLux.BlackbodyTemperatureAsRgb(_input(stage, prim, "colorTemperature", 6500)))
    if any(_input(stage, prim, name, 1) != 1 for name in ("diffuse", "specular")):
        stage.leave("a light's diffuse or specular multiplier", prim)
    if not math.isfinite(said[0]) or not abs(said[1]) < 64 or not (color * said[0] >= 0).all():
        raise Error(f"{prim.GetPath()}: has the intensity {said[0]:g} and exposure {said[1]:g}; allowed: light >= 0")
    return color * said[0] * 2.0 ** said[1]


def _distant(stage, prim, matrix):
    """E, the light on a surface that faces it, over pi: what white cloth shows."""
    angle = min(max(float(_input(stage, prim, "angle", 0.53)), 0), 180)
    spread = math.sin(math.radians(angle) / 2) ** 2
    light = _emitted(stage, prim)
    same = _input(stage, prim, "normalize", False) or not spread   # then it is E
    return {"kind": "distant", "direction": -matrix[2, :3], "angle": angle,
            "strength": light / math.pi if same else light * spread}


def _near(stage, prim, matrix):
    scale = np.linalg.norm(matrix[:3, :3], axis=1)
    kind = str(prim.GetTypeName())
    if kind == "RectLight":
        area = float(_input(stage, prim, "width", 1)) * float(_input(stage, prim, "height", 1)) * scale[0] * scale[1]
        size = math.sqrt(abs(area) / math.pi)   # a disc as large
    else:
        size = abs(float(_input(stage, prim, "radius", 0.5))) * float(scale[:2].mean())
    point = kind == "SphereLight" and prim.GetAttribute("treatAsPoint").Get(stage.at)
    light = _emitted(stage, prim)
    faces = 4 if kind == "SphereLight" else 1   # of a sphere's surface a quarter is seen as a disc
    strength = light / (faces * math.pi) if _input(stage, prim, "normalize", False) else light * size**2
    cone = 360.0
    shaping = prim.GetAttribute("inputs:shaping:cone:angle")
    if shaping and shaping.HasAuthoredValue():
        cone = 2 * float(shaping.Get(stage.at))
    for name, what in ("shaping:focus", "focus"), ("shaping:ies:file", "IES profile"), ("texture:file", "picture"):
        if _input(stage, prim, name, None):
            stage.leave(f"a light's {what}", prim)
    if _input(stage, prim, "shaping:cone:softness", 0):
        stage.leave("a cone's softness", prim)
    return {"kind": "near", "position": matrix[3, :3], "direction": -matrix[2, :3], "size": 0.0 if point else size,
            "cone": cone if cone < 180 else 360.0 if faces == 4 else 179.0, "strength": strength, "flat": faces == 1}


def _dome(stage, prim, matrix):
    found: dict[str, Any] = {"kind": "dome", "strength": _emitted(stage, prim)}
    turn = matrix[:3, :3]
    if str(prim.GetTypeName()) == "DomeLight_1":
        pole = str(prim.GetAttribute("poleAxis").Get(stage.at))
        up = str(stage.pxr.UsdGeom.GetStageUpAxis(stage.stage))
        turn = np.array(POLES[up if pole == "scene" else pole], np.float64) @ turn
    u, _, v = np.linalg.svd(turn)
    asset = _input(stage, prim, "texture:file", None)
    content = content_of(stage, asset) if asset else None
    if asset and content is None:
        stage.leave("a sky's picture that is not to be had", prim)
    layout = str(_input(stage, prim, "texture:format", "automatic"))
    if content is not None and layout not in ("automatic", "latlong"):
        stage.leave(f"a sky's picture of format {layout}", prim)
        content = None
    return found | {"turn": u @ v} | ({} if content is None else {"texture": content})
