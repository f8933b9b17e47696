"""Strands and body of a scene as the truth has them: the float64 twin's, on a surface that a device tessellates."""

from types import SimpleNamespace

import attrs
import numpy as np

from .. import layout
from ..render import schedulers
from ..scene import Curves, Mesh, Strands, Tufts
from ..scene.maps import planes
from ..scene.tufts import spots_of
from ..stages.tessellate import tessellate
from ..twin import distance, guides, maps, strands, tufts
from .rays import Fibres, Triangles

CELLS = 87               # of a body's longest side: strands that slide along it are looked at so often


def geometry_of(scene):
    """(strands, body) of a scene, with the members of `DeviceStrands` and `Surface`; strands are the float64 twin's.

    The strands have besides: first [n] each segment's first point, owner [n] its strand, and starts, ends [n]: whether
    the strand starts or ends with it.
    """
    mesh, fur = scene.mesh, scene.strands
    body = SimpleNamespace(positions=np.zeros((0, 3)), normals=np.zeros((0, 3)), triangles=np.zeros((0, 4), int))
    if mesh is not None and (scene.body_color is not None or isinstance(fur, Strands)):
        levels = (1, 1, "flat") if fur is None else (fur.inner, fur.outer, fur.surface)
        body = _tessellated(mesh, *levels)
    if isinstance(fur, Strands):
        by_area = fur.roots != "faces" and fur.rest is not None
        hair = _grown(fur, body, _tessellated(fur.rest, *levels) if by_area else body, mesh)
    elif isinstance(fur, Curves):
        fur = fur.on_host
        counts = fur.counts.astype(int)
        tangents, width, _ = strands.unpack_curves(fur.points, counts, fur.width)
        kind = np.zeros(len(counts), int) if fur.type_of is None else fur.type_of.astype(int)
        hair = SimpleNamespace(points=np.column_stack([fur.points, width]).astype(float), tangents=tangents,
                               counts=counts, colors=fur.color.astype(float), kind=kind,
                               **_looks(fur.hair_types))
    else:
        hair = SimpleNamespace(points=np.zeros((0, 4)), tangents=np.zeros((0, 3)), counts=np.zeros(0, int),
                               colors=np.zeros((1, 3)), shine=np.ones((1, 4)), lobes=np.zeros((1, 4)),
                               kind=np.zeros(0, int))
    hair.spans = np.stack([np.cumsum(hair.counts) - hair.counts, hair.counts], 1)
    hair.first, hair.owner = segments(hair.spans)
    hair.starts = hair.first == hair.spans[hair.owner, 0]
    hair.ends = hair.first + 2 == hair.spans[hair.owner].sum(1)
    if scene.body_color is None:
        body.triangles = body.triangles[:0]
    return hair, body


def _tessellated(mesh, inner, outer, surface):
    """The surface that carries the strands, from a device, whose bits are the same on all.

    The twin's would do but for this: next to a triangle's side the last bit decides which triangle a root stands on,
    and 0.2 % of 20,000 strands on a teapot of 234,000 triangles would stand on another one than `render`'s.
    """
    gpu, = schedulers(None)
    with gpu.frame():
        made = tessellate(gpu, mesh, inner, outer, surface)
        positions, normals, uv = (gpu.download(each).astype(float) for each in (made.positions, made.normals, made.uv))
        return SimpleNamespace(positions=positions[:, :3], normals=normals[:, :3], uv=uv[:, :2], weights=uv[:, 2:],
                               area_scale=made.area_scale,
                               triangles=gpu.download(made.triangles).astype(int))


def _grown(fur, body, rest, mesh):
    triangles = body.triangles[:, :3]
    surface = body.positions, body.normals, np.column_stack([body.uv, body.weights]), triangles
    if fur.roots == "faces":
        chosen, (root, frame, at) = np.arange(len(triangles)), strands.roots_on_faces(*surface)
    else:
        x, y, z = strands.twice_areas(rest.positions * rest.area_scale, surface[3]).T
        area = np.sqrt(x * x + y * y + z * z)
        spread = np.cumsum(area.astype(np.uint64)), fur.roots, fur.seed
        root, frame, at, chosen = strands.roots_by_area(*surface, *spread)
    traits = _traits(fur, planes(mesh, fur.maps, fur.comb), body, chosen, at, frame)
    points, tangents, counts, colors, kind = _lines(
        fur, mesh, root, frame, at[:, :2], traits, body.uv[triangles[chosen]].mean(1))
    for number, hair in enumerate(fur.types):
        mine = np.flatnonzero((kind == number) & (counts > 0))
        if len(mine) and (hair.tufts is not None or hair.frizz[0]):
            levels = [] if hair.tufts is None else [
                middles_of(fur, mesh, number, level) for level in hair.tufts.levels]
            up, end = frame[mine, 2], hair.segments + 1
            places = root, frame
            if rest is not body:
                places = strands.roots_by_area(rest.positions, rest.normals, *surface[2:], *spread)[:2]
            points[mine, :end] = tufts.put(
                points[mine, :end], places[0][mine], places[1][mine, 2], hair, mine, fur.seed, levels,
                None if traits is None else traits[mine])
            tangents[mine, :end] = strands.tangents_of(points[mine, :end], up)
    there = np.arange(points.shape[1]) < counts[:, None]
    width = np.stack([np.pad(strands.widths_along(t), (0, there.shape[1] - 1 - t.segments)) for t in fur.types])[kind]
    width = width if traits is None else width * traits["scale"][:, 1:2]
    if fur.collision:
        points, tangents = _slid(fur, body, points, tangents, width, counts, kind, frame[:, 2])
    return SimpleNamespace(points=np.column_stack([points[there], width[there]]), tangents=tangents[there],
                           counts=counts, colors=colors[there] if colors.ndim == 3 else colors, kind=kind,
                           **_looks(fur.types))


def middles_of(fur: Strands, mesh: Mesh, number: int, level: Tufts) -> SimpleNamespace:
    """The middles of tufts of a type, by its number, as `clfur.twin.tufts.put` takes them."""
    rest = mesh if fur.roots == "faces" or fur.rest is None else fur.rest
    spots = spots_of(level, mesh, rest, fur.seed)
    corners = mesh.faces[spots.faces]
    (root, up), (place, normal) = (tufts.stand(each.positions[corners], each.normals[corners], spots.weights,
                                               fur.surface == "pn") for each in (mesh, rest))
    of_corners = np.concatenate([mesh.uv[spots.faces], np.tile(np.eye(3)[:, :2], (len(root), 1, 1))], 2)
    at = np.einsum("nc,ncx->nx", spots.weights.astype(float), of_corners)
    frame = strands.frames(mesh.positions[corners].astype(float), up)
    there = SimpleNamespace(positions=mesh.positions[corners].reshape(-1, 3), uv=mesh.uv[spots.faces].reshape(-1, 2),
                            triangles=np.column_stack([np.arange(3 * len(root)).reshape(-1, 3), spots.faces]))
    traits = _traits(fur, (None,) * 3 + planes(mesh, fur.maps, fur.comb)[3:], there, np.arange(len(root)), at, frame)
    even = [attrs.evolve(kind, length_variation=0) for kind in fur.types]
    lines, _, counts, _, kind = _lines(attrs.evolve(fur, types=even), mesh, root, frame, at[:, :2], traits, at[:, :2])
    mine = np.flatnonzero((kind == number) & (counts > 0))
    return SimpleNamespace(
        lines=lines[mine, :even[number].segments + 1], places=place[mine], normals=normal[mine],
        sizes=spots.sizes[mine], turns=spots.turns[mine], spacing=spots.spacing, strength=level.strength,
        profile=level.profile)


def _traits(fur, said, body, chosen, at, frame):
    """What the skin says, `planes`, of strands on triangles by their numbers, None where there is nothing."""
    if not (fur.maps or fur.comb):
        return None
    triangles = body.triangles[chosen, :3]
    return maps.traits(said, at[:, :2], at[:, 2:], frame[:, 2], body.positions[triangles], body.uv[triangles],
                       body.triangles[chosen, 3], fur.comb.weight if fur.comb else 0.0, fur.seed, np.arange(len(at)))


def _lines(fur, mesh, root, frame, uv, traits, middle):
    """What `strands.grow` gives, between guides where there are some."""
    points, tangents, counts, colors, kind = strands.grow(
        root, frame, uv, fur.types, fur.type_indices, fur.force, fur.point_forces, fur.seed, traits, middle=middle)
    if fur.guides is not None:
        points, tangents = _between(fur, root, frame, kind, mesh, traits)
        counts = np.where(np.isfinite(points[:, 0, 0]), counts, 0)
    return points, tangents, counts, colors, kind


def _slid(fur, body, points, tangents, width, counts, kind, up):
    """(Points, tangents) of strands that slide along the body, to which distances are exact."""
    corners = body.triangles[:, :3]
    cell = np.ptp(body.positions, axis=0).max() / CELLS
    there = distance.Body(body.positions[corners], body.normals[corners])
    points, moved = distance.slide(points, width, counts, there.look, cell)
    for number, each in enumerate(fur.types):
        mine, end = np.flatnonzero(moved & (kind == number)), each.segments + 1
        tangents[mine, :end] = strands.tangents_of(points[mine, :end], up[mine])
    return points, tangents


def _between(fur, root, frame, kind, mesh, traits):
    """(Points, tangents) of strands between guides, as `strands.grow` has them."""
    curves = fur.guides.on_host
    some, ends = curves.counts > 1, np.cumsum(curves.counts, dtype=np.int64)
    shapes = [shape.astype(float) for shape, is_one in zip(np.split(curves.points, ends[:-1]), some) if is_one]
    places = np.array([shape[0] for shape in shapes])
    normals = guides.normals_at(*guides.feet(places, mesh.positions, mesh.faces)[1:], mesh.positions, mesh.normals,
                                mesh.faces) if curves.root_normal is None else curves.root_normal[some].astype(float)
    types = None if curves.type_of is None else curves.type_of[some]
    points = guides.between(root, frame, kind, fur.types, shapes, normals, types, fur.guides_blended, fur.parting,
                            fur.seed, traits, fur.guides_reach)
    tangents = np.full_like(points, np.nan)
    for number, each in enumerate(fur.types):
        mine, end = np.flatnonzero(kind == number), each.segments + 1
        tangents[mine, :end] = strands.tangents_of(points[mine, :end], frame[mine, 2])
    return points, tangents


def _looks(types):
    """How types scatter light: {member of `layout.HairType`: [types, 4]}."""
    return {"shine": np.array([layout.shine(kind.look, kind.alpha) for kind in types]),
            "lobes": np.array([kind.look.lobes for kind in types])}


def before(eye, hair, body, near, window):
    """(`Fibres`, `Triangles`) of a scene before an eye."""
    fibres = Fibres(eye, hair.points[hair.first], hair.points[hair.first + 1], hair.starts, hair.ends, near, window)
    return fibres, Triangles(eye, body.positions[body.triangles[:, :3]], near, window)


def segments(spans):
    """Every segment's (first point, strand)."""
    counts = np.maximum(spans[:, 1] - 1, 0)
    owner = np.repeat(np.arange(len(spans)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return spans[owner, 0] + within, owner
