"""Base colours of glTF's materials: a factor and a picture (glTF 2.0, 3.9.2); what else they say is not read."""

from typing import Any

import numpy as np

from ..errors import Error
from ..scene import Material
from .gltf_data import Source, child, vector, whole
from .images import picture_of

WRAPS = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
OTHER_PICTURES = ("EXT_texture_webp", "EXT_texture_avif")   # extensions of a texture that name a picture which is read
GLOSSY = "KHR_materials_pbrSpecularGlossiness"


def materials_of(source: Source, used: set[int]) -> tuple[Material, ...]:
    """Return the materials of a file, of which those that are not used stay white, and one more for primitives without:
    white, as the specification has it (3.9)."""
    items = source.items("materials")
    pictures: dict[int, np.ndarray] = {}
    return (*(_material(source, item, f"materials[{k}]", pictures) if k in used else Material()
              for k, item in enumerate(items)), Material())


def _material(source, item, where, pictures):
    """One material; ``pictures``: those that are read by now, by number."""
    extensions = child(item, "extensions", dict, where)
    if GLOSSY in extensions:
        holder, names, where = extensions[GLOSSY], ("diffuseFactor", "diffuseTexture"), f"{where}.{GLOSSY}"
    else:
        holder, names = item, ("baseColorFactor", "baseColorTexture")
        holder, where = child(item, "pbrMetallicRoughness", dict, where), f"{where}.pbrMetallicRoughness"
    if not isinstance(holder, dict):
        raise Error(f"{where} is no object; allowed: one")
    color = vector(holder, names[0], 4, where, (1, 1, 1, 1))[:3]
    if names[1] not in holder:
        return Material(color)
    info, where = child(holder, names[1], dict, where), f"{where}.{names[1]}"
    transform = child(child(info, "extensions", dict, where), "KHR_texture_transform", dict, where)
    if coordinates := whole(transform, "texCoord", where, whole(info, "texCoord", where, 0)):
        raise Error(f"{where} is laid on by TEXCOORD_{coordinates}; allowed: by TEXCOORD_0")
    number, texture = source.item("textures", info, "index", where)
    where = f"textures[{number}]"
    return Material(color, _picture(source, texture, where, pictures), _wrap(source, texture, where))


def _wrap(source, texture, where):
    """What of a texture is seen outside of it, along u and v."""
    if "sampler" not in texture:
        return "repeat", "repeat"
    number, sampler = source.item("samplers", texture, "sampler", where)
    wraps = []
    for name in ("wrapS", "wrapT"):
        code = whole(sampler, name, f"samplers[{number}]", 10497)
        if code not in WRAPS:
            raise Error(f"samplers[{number}].{name} is {code}; allowed: {', '.join(map(str, WRAPS))}")
        wraps.append(WRAPS[code])
    return tuple(wraps)


def _picture(source, texture, where, pictures):
    """The pixels of a texture's picture."""
    extensions: dict[str, Any] = child(texture, "extensions", dict, where)
    holder = texture
    if "source" not in texture:
        named = [name for name in OTHER_PICTURES if name in extensions]
        if not named:
            kind = f"only as {next(iter(extensions))[:60]} holds it" if extensions else "nowhere"
            raise Error(f"{where} has its picture {kind}; allowed: files with one that is read here")
        holder, where = child(extensions, named[0], dict, where), f"{where}.{named[0]}"
    number, image = source.item("images", holder, "source", where)
    if number not in pictures:
        content = source.content_of(image, f"images[{number}]")
        try:
            pictures[number] = picture_of(content)
        except Error as error:
            raise Error(f"images[{number}] {error}") from None
    return pictures[number]
