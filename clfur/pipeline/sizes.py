"""How many bytes a frame takes on a device, summed from what each stage declares of its arrays."""

from typing import Any

import numpy as np

from ..scene import Curves, Strands
from ..stages.chiang import bytes_of
from ..stages.coverage import GRAINS, KEPT, OPEN, TILE, Covered, Seen, Segments, Tiles
from ..stages.deep import bytes_of as deep_bytes
from ..stages.distance import STATES
from ..stages.flow import VECTORS
from ..stages.guides import FOUND
from ..stages.guides import bytes_of as guides_bytes
from ..stages.lighting import Lighting
from ..stages.lod import THINNED
from ..stages.maps import TRAITS
from ..stages.maps import bytes_of as bytes_of_planes
from ..stages.march import Rays
from ..stages.mattes import LEAST as MATTE_BUNDLES
from ..stages.mattes import Owners
from ..stages.order import Order
from ..stages.raster import LEFT, REACHES, VISIBLE
from ..stages.shade import IMAGE, RADIANCE_SUMS, Outputs, Paint
from ..stages.shells import size_of
from ..stages.sky import POINT_LIGHT
from ..stages.sky import bytes_of as sky_bytes
from ..stages.strand_light import TRANSMITTANCE, Places
from ..stages.strands import AREA, ROOTS, STAGES, DeviceStrands, Packed
from ..stages.tessellate import Source, Surface
from ..stages.transport import ASKED, LEAVING
from ..stages.transport import bytes_of as transport_bytes
from ..stages.tufts import TUFT_OF, Rested
from ..stages.tufts import bytes_of as tufts_bytes
from ..stages.voxelize import CELLS, RESTS
from .mattes import TOLD

# Bytes on the device, of all arrays that stages make, as they declare them.
VERTEX, TRIANGLE = Surface.bytes(vertex=1), Surface.bytes(triangle=1) + AREA.bytes + REACHES.bytes
POINT, STRAND = DeviceStrands.bytes(point=1), DeviceStrands.bytes(strand=1, color=1, run=1) + ROOTS.bytes
COLOR = DeviceStrands.bytes(color=1)    # of a point, where it has one
# More of the user's strands: of a point, where each has a width and a colour, and of a strand.
PACKED = Packed.bytes(point=1, width=1, color=1) + DeviceStrands.bytes(color=1)
RUN = DeviceStrands.bytes(run=1)        # and where strands differ in points
PUT_IN_ORDER = Packed.bytes(strand=1) + Order.bytes(strand=1) + DeviceStrands.bytes("spans", strand=1)
THIN_POINT, THIN_STRAND = DeviceStrands.bytes(*THINNED, point=1), DeviceStrands.bytes(*THINNED, strand=1)
MESH_VERTEX, MESH_FACE = Source.bytes(mesh_vertex=1), Source.bytes(face=1, corner=3, end=2)
OTHERS = Outputs.bytes(pixel=1)         # of a pixel but its colour
MATTES = 8 * sum(TOLD.values())         # and of what is told of it, on the host
OF_TILE = Tiles.bytes(tile=1) + Segments.bytes(tile=1, start=1) + Seen.bytes(tile=1) + GRAINS.bytes + OPEN.bytes
ENTRY = 2 * Segments.bytes(entry=1)     # of a segment in a tile, in two orders
SURVIVOR = Segments.bytes(survivor=1)   # of a segment that may show
LIT = Places.bytes(row=1)               # of its light, at most, and of each source of it; where only those get light
                                        # that are seen, `Seen` and theirs take less
AXIS, HAZE = Places.bytes(axis=1), Places.bytes(haze=1)   # of where it lies in the world; of each light
PLACES = Places.bytes(place=1)
SEEN = Seen.bytes(survivor=1) + 5       # of what is remembered of one till it has light: its mark, and its id if seen
OWNER = Owners.bytes(id=1)              # of whose it is, where that is told


def of_shells(plan: Any) -> int:
    """Bytes on the device of shell fur."""
    scene, shells = plan.scene, plan.scene.shells
    return size_of(scene.mesh, plan.packed_shells, plan.topology, shells.lean is not None) if shells else 0


def of_fixed(plan: Any) -> int:
    """Bytes on the device of what is never divided."""
    scene, settings = plan.scene, plan.settings
    fixed = plan.aside + plan.faces * MESH_FACE + of_shells(plan)
    fixed += MESH_VERTEX * max((len(mesh.positions) for mesh in (scene.mesh, plan.rest) if mesh), default=0)
    casting = sum(light.casts for light in scene.lights)
    maps = casting * (1 + (casting > 1))                                 # several are put together from as many
    fixed += maps * Lighting.bytes(sample=settings.shadow_map**2)
    if settings.shadows != "off" and (plan.strands or scene.shells):
        layers = Lighting.bytes(layer=(settings.grid + 1) * settings.grid**2)
        fixed += casting * (CELLS.bytes * settings.grid**3 + layers)
    if scene.environment is not None:
        fixed += sky_bytes(plan.body, plan.ground is not None)
    fixed += Paint.bytes(material=len(plan.painted), texel=sum(len(each.texels[2]) for each in plan.painted))
    fixed += bytes_of_planes(plan.planes or ())
    if plan.guides is not None:
        fixed += guides_bytes(plan.guides, len(scene.strands.types), len(scene.mesh.faces))
    if plan.sliding:
        fixed += plan.sliding.bytes
    if plan.tufted:
        fixed += sum(tufts_bytes(kind.tufts, plan.rest or scene.mesh, plan.stride)
                     for kind in scene.strands.hairy_types if kind.tufts is not None)
    if plan.scatters:
        fixed += transport_bytes(len(plan.lobed), plan.body)
    if plan.is_deep:
        fixed += 4 * plan.strands * len(plan.scene.lights)   # which of them any tile lists
        fixed += deep_bytes(plan.deep.entries, plan.deep.segments, int(plan.deep.tiles.sum()))
    if plan.uses_coverage:
        fixed += plan.of_kept * KEPT.bytes + Seen.bytes(bundle=MATTE_BUNDLES) * bool(plan.tells)
    return fixed + bytes_of(plan.lobed)


def of_transmittance(plan: Any) -> int:
    """Bytes on the device of the transmittance to a point of strands, of all lights."""
    under_sky = plan.scene.environment is not None
    around = (LEAVING.bytes + ASKED.bytes) * plan.scatters + POINT_LIGHT.bytes * under_sky
    shares = TRANSMITTANCE.bytes * len(plan.scene.lights) * (1 + plan.is_deep)   # of the body and hair apart
    return shares + around


def of_strand_and_point(plan: Any, gpu: Any) -> tuple[int, int]:
    """Bytes on the device of a strand and of each of its points."""
    fur = plan.scene.strands
    strand, point = (STRAND, POINT) if plan.grown else (STRAND + PUT_IN_ORDER, POINT + PACKED)
    if plan.before:   # so are the same strands as they were
        strand, point = 2 * strand, 2 * point
    if isinstance(fur, Curves) and fur.uniform is None:
        point += RUN
    if isinstance(fur, Strands) and fur.colored_points:
        point += COLOR
    strand += TRAITS.bytes * bool(plan.planes)
    if plan.guides is not None:
        strand += FOUND.bytes
    strand += (TUFT_OF.bytes + Rested.bytes(strand=1) * bool(plan.rest)) * plan.tufted
    if plan.settings.lod:
        per_point = fur.colored_points if isinstance(fur, Strands) else isinstance(fur, Curves) and (
            len(fur.color) == len(fur.points))
        strand, point = strand + THIN_STRAND, point + THIN_POINT + COLOR * per_point
    if gpu.steps:
        strand += RESTS.bytes + STAGES.bytes + STATES.bytes * bool(plan.sliding)
        point += 0 if plan.uses_coverage else LEFT.bytes
    if plan.uses_coverage:
        strand += Tiles.bytes(strand=1)
        point += 0 if plan.keeps_transmittances(gpu) else of_transmittance(plan)
    return strand, point


def of_pixel(plan: Any, counted: bool) -> int:
    """Bytes on the device of a pixel that is drawn, without the pieces of strands in it; ``counted``: after these
    are counted where they must be."""
    samples = plan.settings.samples
    pixel = VISIBLE.bytes * samples
    if plan.uses_coverage:
        pixel += -(-OF_TILE // TILE**2)
        if not counted:
            return pixel
        covered = Covered.bytes(pixel=1, sample=samples, shell=bool(plan.scene.shells))
        pixel += covered + (IMAGE.bytes + covered) * bool(plan.tells)   # drawn again
    if plan.scene.shells:
        pixel += VISIBLE.bytes * samples + Rays.bytes(sample=samples)   # where they enter
    return pixel + IMAGE.bytes + RADIANCE_SUMS.bytes + (OTHERS + VECTORS.bytes * bool(plan.before)) * plan.others


def of_largest_row(plan: Any) -> int:
    """Bytes of a row of the largest array of pixels or samples."""
    return plan.size[0] * max(VISIBLE.bytes * plan.settings.samples, RADIANCE_SUMS.bytes)


def of_survivor(plan: Any) -> int:
    """Bytes on the device of a segment that may show, and of its light."""
    lit = LIT + (AXIS + HAZE * len(plan.scene.lights)) * plan.is_deep + PLACES * plan.sources
    return SURVIVOR + max(lit * plan.wants_color, (OWNER + SEEN) * bool(plan.tells))


def of_lists(plan: Any, listed: Any, survivors: int) -> Any:
    """Bytes on the device of so many segments in lists of tiles, of which not more than ``survivors`` are different
    ones."""
    return ENTRY * listed + of_survivor(plan) * np.minimum(listed, survivors)


def memory(plan: Any, gpu: Any) -> tuple[int, str]:
    """(bytes that arrays may take on a device, the limit of this process that says so or "").

    Its limits are for pictures on the host too, which are there twice: as they are, and as they are written.
    """
    width, height = plan.size
    bytes_allowed, name = gpu.allowed
    host = 2 * width * height * (IMAGE.bytes + OTHERS * plan.others + MATTES * bool(plan.tells))
    return min((gpu.memory, ""), (max(bytes_allowed - host, 0), name))


def fitting(room: int, survivor: int, survivors: int) -> int:
    """Segments in tiles that so many bytes have room for, one at least; each of ``survivors`` segments takes some."""
    both = room // (ENTRY + survivor)
    return max(both if both <= survivors else (room - survivor * survivors) // ENTRY, 1)


def largest(gpu: Any) -> int:
    """Bytes of the largest array: the pool rounds them up, by up to a sixteenth."""
    return gpu.largest * 7 // 8
