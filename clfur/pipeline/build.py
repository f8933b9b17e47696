"""What a frame is drawn of, made on the device.  All of it costs: the body is tessellated, strands grow.

A device keeps the last of each, so that what hasn't changed is there already (`Scheduler.keep`): one part of the faces
and strands, where they are cut into several.  Whatever is out of date goes before anything is made in its place.
"""

import functools
import hashlib
from typing import Any

import attrs
import numpy as np

from ..device.team import Team
from ..errors import Error
from ..scene import extent, hair_bounds
from ..scene.bounds import boxes_to_see, fur_extent
from ..scene.guides import far_from
from ..scene.remembered import remembered
from ..scene.tufts import spots_of
from ..stages import chiang, ground, guides, shade, shells, tufts
from ..stages import sky as sky_stage
from ..stages import transport as transport_stage
from ..stages.deep import Deep
from ..stages.lighting import Lighting
from ..stages.lod import thin
from ..stages.maps import traits
from ..stages.raster import raster
from ..stages.strands import DeviceStrands, area_sums, grow, no_strands, roots_of, upload_curves
from ..stages.tessellate import Surface, no_surface, tessellate
from .plan import Part, Plan
from .shadows import accumulate, deep_maps, finish, plan_shadows, shells_depth, without_body, without_hair
from .sliding import slide


def let_go(plan: Plan, gpu: Any) -> None:
    """Make a device ready for a frame: before anything new is made, it lets go of what this frame has no use for."""
    plan.check(gpu)
    gpu.load((plan.settings, plan.size, plan.faces, plan.strands, plan.points,
              plan.scene.shells and plan.scene.shells.layers))
    gpu.prepare(plan.kernel_files)
    gpu.keep_only(plan.scene.mesh, plan.rest or plan.scene.mesh, *[chiang.KEPT] * bool(plan.lobed), *plan.painted[:1])
    transmittances(gpu, plan)
    furry, under_sky = plan.scene.shells is not None, plan.scene.environment is not None
    for name, used in (("body", plan.faces), ("resting", plan.rest), ("strands", plan.strands), ("guides", plan.guides),
                       ("strands before", plan.before), ("body before", plan.before),
                       ("tufts", plan.tufted), ("distance", plan.sliding),
                       ("thinned", plan.strands and plan.settings.lod),
                       ("transport", plan.scatters), ("phases", plan.scatters), ("deep", plan.is_deep),
                       ("on hair", plan.is_deep), ("hair alone", plan.is_deep),
                       ("shell", furry), ("pattern", furry), ("border", furry),
                       ("sky", under_sky), ("sky points", under_sky)):
        if not used:
            gpu.keep(name, (), dict)
    if len(plan.parts(gpu)) > 1 and not plan.keeps_transmittances(gpu):
        transmittances(gpu, plan).clear()   # what a smaller picture in one part has left


def let_go_of_parts(gpu: Any, plan: Plan, parts: list[Part], others: list[Part]) -> None:
    """Go from some parts of the scene to others, for which less may be left: what is there of the former goes."""
    known = transmittances(gpu, plan)
    for part, what in list(known):
        if part not in others:
            del known[part, what]
    if parts != others:
        for name in "body", "resting", "strands", "thinned", "strands before", "body before":
            gpu.keep(name, (), dict)


def body(gpu: Any, plan: Plan, part: Part) -> Surface:
    """The `Surface` of a part that is drawn; one without a triangle if its faces are only grown on."""
    return _surface(gpu, plan, part.faces) if part.body else gpu.keep("no body", (), functools.partial(no_surface, gpu))


def hair(gpu: Any, plan: Plan, part: Part, lod: float) -> DeviceStrands:
    """`DeviceStrands` of a part: ``lod`` as in `Settings`, for the camera; 0 for all, which cast shadows."""
    if not part.hairy:
        return gpu.keep("no strands", (), functools.partial(no_strands, gpu))
    scene = plan.scene
    what = (scene.mesh, scene.strands, *part.strands, *(part.faces if plan.grown else ()))
    if lod:
        return gpu.keep("thinned", (*what, scene.camera, str(lod)),
                        functools.partial(_thin, gpu, plan, part, what, lod))
    return _whole(gpu, plan, part, what)


def before(gpu: Any, plan: Plan, part: Part) -> tuple[DeviceStrands, Surface]:
    """A part as it is in the scene from which motion vectors lead to this one."""
    other: Any = plan.before
    if plan.grown and len(plan.parts(gpu)) > 1:
        raise Error("motion_vector needs strands that do not grow, where they do not fit the device at once; allowed: "
                    "Curves, which clfur.grow and clfur.Motion give")
    strands = functools.partial(_grow, gpu, other, part) if part.hairy else functools.partial(no_strands, gpu)
    surface = functools.partial(tessellate, gpu, other.scene.mesh, *plan.levels, part.faces) if (
        part.body) else functools.partial(no_surface, gpu)
    key = other.scene.mesh, other.scene.strands, *part.strands, *part.faces
    return gpu.keep("strands before", key, strands), gpu.keep("body before", key, surface)


def tally(gpu: Any, plan: Plan, part: Part) -> tuple[int, int]:
    """(strands that are not bald, segments) that are drawn of a part; remembered: nothing grows for it again."""
    scene, lod = plan.scene, plan.settings.lod
    known = gpu.keep("tallies", (scene.mesh, scene.strands, str(lod), scene.camera if lod else None), dict)
    if part not in known:
        fur: Any = scene.strands
        points = (gpu.download(hair(gpu, plan, part, lod).spans)[:, 1] if plan.grown or lod else
                  fur.counts[slice(*part.strands)] if part.hairy else np.zeros(0)).astype(np.int64)
        known[part] = int((points > 0).sum()), int(np.maximum(points - 1, 0).sum())
    return known[part]


def transmittances(gpu: Any, plan: Plan) -> dict:
    """{part: (which strands, `strand_light.transmittance` of them)}, as far as known; it goes with what it depends
    on."""
    return gpu.keep("transmittances", (*plan.light_key(plan.settings.lod), plan.settings.raster), dict)


def sky(gpu: Any, plan: Plan) -> sky_stage.SkyLight | None:
    """Light of the scene's sky in cells of the world, None without one; it stays while camera and lights change."""
    scene = plan.scene
    if scene.environment is None:
        return None
    ground = None if plan.ground is None else str(float(plan.ground["plane"][3]))
    return gpu.keep("sky", (scene.mesh, scene.strands, scene.shells, scene.environment, int(plan.body), ground),
                    functools.partial(sky_in, gpu, plan, sky_stage.CELLS))


def sky_in(gpu: Any, plan: Plan, n: int) -> sky_stage.SkyLight:
    """Light of the scene's sky in n³ cells around all of it, and on its ground."""
    scene = plan.scene
    boxes, out = boxes_to_see(scene.mesh, scene.fur), fur_extent(scene.fur)
    center, radius = extent(scene.mesh, scene.fur)
    low, high = center - radius, center + radius
    if boxes:
        low = np.maximum(low, np.min([each for each, _ in boxes], 0) - out)
        high = np.minimum(high, np.max([each for _, each in boxes], 0) + out)
    grid = sky_stage.sky_of(low, high, n)
    area = hair_bounds(scene.strands, plan.strands)[2] if plan.strands else 0.0
    if scene.shells:
        area += shells.bounds_of(gpu, shell(gpu, plan)[0])[1]
    held = sky_stage.held(gpu, grid, plan.body, area)
    for part in plan.parts(gpu):
        sky_stage.deposit(gpu, grid, held, hair(gpu, plan, part, 0), body(gpu, plan, part))
    if scene.shells:
        shells.leave(gpu, grid, *shell(gpu, plan), shells_depth(scene.shells.alpha, "length"), held)
    around, table = _sky_table(scene.environment)
    if plan.ground is None:
        return sky_stage.light(gpu, grid, held, around, table)
    towards, sent = _falling(scene.environment)
    plane = sky_stage.plane_of(low, high, float(plan.ground["plane"][3]), sent[:, :3].sum(0, np.float64))
    return sky_stage.light(gpu, grid, held, around, table, (plane, towards, sent))


def sky_points(gpu: Any, plan: Plan, part: Part, hair: DeviceStrands) -> Any:
    """`sky.at_points` of the strands of a part, None without a sky; those of the last part stay."""
    lit = None if plan.scatters else sky(gpu, plan)   # where light goes from hair to hair, the sky's does too
    return lit and gpu.keep("sky points", (plan.scene.mesh, lit, hair),
                            functools.partial(sky_stage.at_points, gpu, lit, hair))


def scattering(gpu: Any, plan: Plan) -> chiang.Scattering | None:
    """`Scattering` of the strands' types, kept while their looks stay, whatever else changes; None where none has
    lobes."""
    if not plan.lobed:
        return None
    looks = str([(kind.look.model, kind.look.numbers, kind.look.lobes) for kind in plan.lobed])
    return gpu.keep("scattering", (chiang.KEPT, looks), functools.partial(chiang.scattering, gpu, plan.lobed))


def paint(gpu: Any, plan: Plan, part: Part | None) -> tuple:
    """(`shade.Paint` of the body, kept while its materials stay; which of these the faces of a part have), None where
    it is of one colour."""
    if not plan.painted or part is None:
        return None, None
    known = gpu.keep("paint", plan.painted, functools.partial(shade.paint_of, gpu, plan.painted))
    mesh: Any = plan.scene.mesh
    return known, gpu.upload(mesh.material_of[slice(*part.faces)]) if len(plan.painted) > 1 else None


def transport(gpu: Any, plan: Plan, lighting: Lighting) -> transport_stage.Transport | None:
    """`Transport` of light from hair to hair; that of the frame before if only the camera has moved.  None where it is
    not followed."""
    if not plan.scatters:
        return None
    color = _body_color(plan)
    return gpu.keep("transport", (plan.scene.mesh, lighting, *plan.light_key(), str(color)),
                    functools.partial(_transport, gpu, plan, lighting, color))


def light_around(gpu: Any, plan: Plan, lighting: Lighting) -> sky_stage.SkyLight | None:
    """Light that comes to the body from all around: the sky's, and where light goes from hair to hair that of hair
    too."""
    lit = transport(gpu, plan, lighting)
    return sky(gpu, plan) if lit is None else lit.around


def shell(gpu: Any, plan: Plan) -> tuple[shells.Shell, np.void]:
    """Shell fur -> (`Shell`, `layout.Shells`)."""
    mesh, topology, packed = plan.scene.mesh, plan.topology, plan.packed_shells
    rest = plan.scene.shells.rest or mesh
    laid = str([packed["size"].tolist(), packed["shape"].tolist(), packed["kind"][:2].tolist(),
                packed["noise"][:3].tolist()])
    walls = int(packed["kind"][2]), int(packed["noise"][3])
    bent = str([packed[name].tolist() for name in ("bend", "wind", "gust")])
    lean = plan.scene.shells.lean
    return gpu.keep("shell", (mesh, rest, laid, *walls, bent, lean), functools.partial(
        _bend, gpu, mesh, packed, topology, (mesh, rest, laid), (mesh, *walls), lean)), packed


def rasterize(plan: Plan, view: np.void, gpu: Any, strands: tuple[int, int] | None = None,
              is_body: bool = True) -> list:
    """[Depth and id of what is nearest in each sample] of some strands and the body: a share of `Team.gather`.

    [rows, width, samples] uint64, see `raster`.
    """
    visible = None
    for part in plan.parts(gpu, strands, is_body):
        visible = raster(gpu, view, hair(gpu, plan, part, plan.settings.lod), body(gpu, plan, part), visible)
    return [visible if plan.ground is None or not is_body else ground.put(gpu, view, plan.ground, visible)]


def rasterize_body(gpu: Any, plan: Plan, view: np.void) -> Any:
    """Depth and id of body or ground where they are nearest in each sample -> [rows, width, samples] uint64."""
    visible = None
    for part in plan.parts(gpu):
        if part.body or visible is None:
            visible = raster(gpu, view, None, body(gpu, plan, part), visible)
    return visible if plan.ground is None else ground.put(gpu, view, plan.ground, visible)


def lighting(gpu: Any, team: Team, plan: Plan, hashes: bool) -> tuple[Lighting, dict]:
    """(`Lighting`, {what: SHA-256 of its bits} if ``hashes``), that of the frame before if only the camera has moved; a
    team's devices share the strands."""
    return gpu.keep("lighting", (*plan.light_key(), int(hashes)),
                    functools.partial(_lighting, gpu, team, plan, hashes))


def deep(gpu: Any, plan: Plan, lighting: Lighting) -> Deep | None:
    """Maps of the hair that lights see, those of the frame before if only the camera has moved; None where these are
    not asked for."""
    return gpu.keep("deep", plan.light_key(), functools.partial(_deep, gpu, plan, lighting)) if plan.is_deep else None


def on_hair(gpu: Any, plan: Plan, lighting: Lighting) -> Lighting:
    """`Lighting` as it falls on strands before these hide it: without their shadow where their pieces look for it."""
    if not plan.is_deep:
        return lighting
    return gpu.keep("on hair", plan.light_key(), functools.partial(without_hair, gpu, lighting))


def hair_alone(gpu: Any, plan: Plan, lighting: Lighting) -> Lighting:
    """`Lighting` before which the hair of its grids alone stands."""
    return gpu.keep("hair alone", plan.light_key(), functools.partial(without_body, gpu, lighting))


def on(gpu: Any, array: Any) -> Any:
    """An array on the device: it is there already, or comes from the host; None stays None."""
    return gpu.upload(array) if isinstance(array, np.ndarray) else array


def bytes_of(gpu: Any, array: Any) -> np.ndarray:
    """The bits of an array, on the host."""
    return np.ascontiguousarray(array if isinstance(array, np.ndarray) else gpu.download(array))


def _body_color(plan):
    """Linear r, g, b that the body has on the whole; none of one that only hides what is behind."""
    mesh, color = plan.scene.mesh, plan.scene.body_color
    if mesh is None or color is None or plan.held:
        return 0.0, 0.0, 0.0
    if isinstance(color, tuple):
        corners = mesh.positions[mesh.faces]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        shares = np.bincount(mesh.material_of, areas, len(color)) if len(color) > 1 else np.ones(1)
        means = [np.asarray(each.color) * (each.levels[-1][0, 0] if each.levels else 1) for each in color]
        color = shares @ np.stack(means) / max(shares.sum(), 1e-30)
    return tuple(np.asarray(color, float).tolist())


def _transport(gpu, plan, lighting, color):
    scene, looks = plan.scene, scattering(gpu, plan)
    made = gpu.keep("phases", (chiang.KEPT, looks), functools.partial(transport_stage.phases, gpu, looks))
    center, radius = extent(scene.mesh, scene.strands)
    grid = sky_stage.sky_of(center - radius, center + radius, transport_stage.CELLS)
    held = sky_stage.held(gpu, grid, plan.body, hair_bounds(scene.strands, plan.strands)[2])
    there = transport_stage.amounts(gpu, grid, len(plan.lobed))
    for part in plan.parts(gpu):
        sky_stage.deposit(gpu, grid, held, no_strands(gpu), body(gpu, plan, part))
        if part.hairy:
            transport_stage.deposit(gpu, grid, there, held.unit, hair(gpu, plan, part, 0), looks)
    outside = transport_stage.outside(None if scene.environment is None else scene.environment.places)
    return transport_stage.transport(gpu, grid, held, there, lighting, looks, made, outside, color,
                                     transport_stage.ORDERS)


@remembered(4)
def _sky_table(environment):
    return sky_stage.table_of(*environment.places)


@remembered(4)
def _falling(environment):
    return sky_stage.falling_of(*environment.places)


def _surface(gpu, plan, faces):
    return gpu.keep("body", (plan.scene.mesh, *plan.levels, *faces),
                    functools.partial(tessellate, gpu, plan.scene.mesh, *plan.levels, faces))


def _whole(gpu, plan, part, what):
    return gpu.keep("strands", what, functools.partial(_grow, gpu, plan, part))


def standing(gpu: Any, plan: Plan) -> tuple[guides.Guides, str]:
    """(`Guides` of the strands on their mesh, in a line how far some are away from it, or ""); they stay while strands
    change in all else."""
    fur: Any = plan.scene.strands
    return gpu.keep("guides", (plan.scene.mesh, fur.guides, len(fur.types)), functools.partial(_stand, gpu, plan))


def told(plan: Plan, gpu: Any) -> list[str]:
    """What has turned out, as the frame was built, to be wrong in it."""
    line = "" if plan.guides is None else standing(gpu, plan)[1]
    return [line] * bool(line)


def _stand(gpu, plan):
    made, away = guides.stand(gpu, plan.scene.mesh, plan.guides, len(plan.scene.strands.types))
    return made, far_from(plan.scene.mesh, away)


def _grow(gpu, plan, part):
    if not plan.grown:
        return upload_curves(gpu, plan.scene.strands, part.strands)
    fur, surface, made = plan.scene.strands, _surface(gpu, plan, part.faces), []
    sums = plan.rest and gpu.keep("resting", (plan.rest, *plan.levels, *part.faces),
                                  functools.partial(_resting, gpu, plan, part.faces))
    rested = plan.rest and fur.tufted and tufts.at_rest(
        gpu, tessellate(gpu, plan.rest, *plan.levels, part.faces),
        roots_of(gpu, surface, fur, part.strands, part.area, sums)[1])
    grown = _maker(gpu, plan)(
        gpu, surface, fur, part.strands, part.area, sums,
        plan.planes and functools.partial(_traits, gpu, plan, plan.planes, part.faces, part.strands[0], surface, made))
    if fur.tufted:
        known = gpu.keep("tufts", (plan.scene.mesh, fur), functools.partial(_tufts, gpu, plan))
        tufts.put(gpu, grown, fur, known, made[0] if made else None, rested or None)
    if plan.sliding:
        slide(gpu, plan.scene.mesh, fur, grown)
    return grown


def _maker(gpu, plan):
    """What makes strands on a surface."""
    return grow if plan.guides is None else functools.partial(guides.between, guides=standing(gpu, plan)[0])


def _tufts(gpu, plan):
    """{type: `Nested` tufts of its strands}."""
    return {kind: tufts.nest(gpu, hair.tufts, kind, *(_middles(gpu, plan, level, kind) for level in hair.tufts.levels))
            for kind, hair in enumerate(plan.scene.strands.types) if hair.tufts is not None and hair.segments}


def _middles(gpu, plan, level, kind):
    """`Middles` of the tufts of a type: hair grows there as all other does, but none shorter or bald."""
    mesh, fur = plan.scene.mesh, plan.scene.strands
    even = attrs.evolve(fur, roots="faces", types=[attrs.evolve(each, length_variation=0) for each in fur.types])
    there = spots_of(level, mesh, plan.rest or mesh, fur.seed)
    surface = tufts.surface_of(gpu, mesh, there, fur.surface)
    rested = tufts.surface_of(gpu, plan.rest, there, fur.surface) if plan.rest else surface
    said = plan.planes and (None,) * tufts.STANDING + plan.planes[tufts.STANDING:]
    hair = _maker(gpu, plan)(gpu, surface, even, traits_of=said and functools.partial(
        _traits, gpu, plan, said, (0, len(mesh.faces)), 0, surface, []))
    return tufts.middles_of(gpu, hair, rested, there, kind)


def _traits(gpu, plan, said, faces, first, surface, made, roots):
    """What the skin says, ``said``, of strands with these roots, which is the last of ``made`` then, too."""
    fur = plan.scene.strands
    made.append(traits(gpu, surface, roots, said, faces, fur.comb.weight if fur.comb else 0.0, fur.seed, first))
    return made[-1]


def _resting(gpu, plan, faces):
    """What `area_sums` gives of faces of the mesh in rest."""
    return area_sums(gpu, tessellate(gpu, plan.rest, *plan.levels, faces))


def _thin(gpu, plan, part, what, lod):
    fur = plan.scene.strands
    return thin(gpu, _whole(gpu, plan, part, what), plan.rig.view, lod, fur.seed,
                not plan.grown and fur.lod_by == "place")


def _bend(gpu, mesh, packed, topology, laid, walls, lean):
    pattern = gpu.keep("pattern", laid, functools.partial(shells.lay, gpu, mesh, packed, topology, laid[1]))
    sides = gpu.keep("border", walls, functools.partial(shells.border, gpu, mesh, packed, topology))
    return shells.bend(gpu, mesh, packed, pattern, topology, sides, lean)


def _lighting(gpu, team, plan, hashes):
    with_shells = plan.scene.shells is not None and plan.settings.shadows != "off"
    shell_bounds = shells.bounds_of(gpu, shell(gpu, plan)[0]) if with_shells else None
    shadow_plans = plan_shadows(plan.rig, plan.strands, plan.body, shell_bounds)
    n, add = len(shadow_plans), np.maximum if plan.settings.shadows == "binary" else np.add
    counted = list(team.gather("accumulate", functools.partial(_accumulate, plan, shadow_plans, with_shells),
                               [add] * n + [np.minimum] * n, plan.strands, gpu))
    digests = {}
    for name, arrays in ("voxels", counted[:n]), ("shadow_map", counted[n:]):
        if hashes and any(array is not None for array in arrays):
            digests[name] = _digest(gpu, arrays)
    for i, array in enumerate(counted):
        counted[i] = on(gpu, array)
    return finish(gpu, shadow_plans, counted), digests


def _deep(gpu, plan, lighting):
    return deep_maps(gpu, plan.deep, functools.partial(_all_hair, gpu, plan), lighting)


def _all_hair(gpu, plan):
    """Yield the strands of each part."""
    for part in plan.parts(gpu):
        if part.hairy:
            yield hair(gpu, plan, part, 0)


def _digest(gpu, arrays):
    """SHA-256 in hex of the bits of arrays, one after the other."""
    state = hashlib.sha256()
    for array in arrays:
        if array is not None:
            state.update(bytes_of(gpu, array))
    return state.hexdigest()


def _accumulate(plan, shadow_plans, with_shells, gpu, strands, is_body):
    """[Cells and shadow maps] of a share of what stands before the lights."""
    counted = None
    # With the body, shells are in one device's share, and there in the first part.
    shell_once = shell(gpu, plan) if with_shells and is_body else None
    for part in plan.parts(gpu, strands, is_body):
        counted = accumulate(gpu, shadow_plans, hair(gpu, plan, part, 0), body(gpu, plan, part), counted, shell_once)
        shell_once = None
    return counted
