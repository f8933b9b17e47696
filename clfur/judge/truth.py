"""What the methods approximate, by brute force and independent of the kernels."""

import io
import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import attrs
import numpy as np

from .. import cache, layout
from ..errors import Error
from ..render import schedulers
from ..scene import Curves, Mesh, Scene, Strands, Tufts, checks, extent
from ..scene.environment import ambient_of
from ..scene.ground import ground_from, height_of
from ..scene.maps import planes
from ..scene.seen import seen
from ..scene.tufts import spots_of
from ..stages.tessellate import tessellate
from ..twin import distance, ground, guides, maps, scatter, strands, tufts
from ..twin.vectors import dot, unit
from .paths import Paths
from .places import on_body, on_strand
from .rays import Eye, Fibres, Triangles, frame_along
from .sky import Sky, spread

VERSION = 3              # of what `picture` gives, strands and bodies included: another makes the cache anew
RAYS = 1 << 18           # of the picture at a time
STEEP = 1.5              # radians aside that a point light looks for what shades
DISC = 64                # points of a disc from which it shines
ALL = 1 << 12            # times that light is scattered at most: a path ends long before
CELLS = 87               # of a body's longest side: strands that slide along it are looked at so often
EVEN = (math.sqrt(5) - 1) / 2


def picture(scene: Scene, samples: int = 8, seed: int = 0, progress: Callable | None = None, orders: int = 0
            ) -> np.ndarray:
    """The picture that `clfur.render` approximates -> float64 [height, width, 4], as `render` has it.

    ``samples`` squared rays a pixel, one at random (by ``seed``) in each of as many squares, are averaged: a box filter
    over the pixel.  Each sees what is nearest: strands of their real width (ribbons that face the eye), or the body.
    The light there is as hair's look has it, or Lambert's on the body.  Of direct light a ray towards the light leaves
    the product of the alphas of all strands that it crosses (round, of their real width, all but the one it starts on),
    and nothing where it meets the body.  Light of a sky is what comes through along one ray for each of these, whose
    direction is chosen at random; it counts by its sine with a strand, its cosine on the body, over the sum of these.
    A light that is a disc shines from one of its points to each place.
    A ground is seen as `Ground` has it, a holdout hides.
    ``orders``: 0, or how many times light is scattered on its way at most (`ALL`: until nothing is left), where all
    strands have the look `clfur.Chiang`: what ``Settings(scattering="grid")`` stands for.  Then each ray goes on as a
    path does, by chance in a direction from which hair, or the body, sends light to where it came from; through strands
    as often as their alpha lets light through.  Lights and what is bright of a sky shine on each place where it turns,
    and where it leaves the scene it sees the sky, whose light hair then sends on as any other.  Lights leave out the
    flat ambient that they have by default; a ground gives hair no light.
    ``progress`` is called with the share that is done.  Raises `clfur.Error`
    for shells: these are judged by their own picture at many samples (tools/shells_laws.py); and for ``orders`` with
    strands of another look.
    """
    if not isinstance(scene, Scene):
        raise Error(f"scene is {scene!r:.60}; allowed: a clfur.Scene")
    if scene.shells is not None:
        raise Error("Scene.fur has Shells; allowed: Strands or Curves, since the truth knows strands and bodies only")
    samples, orders = checks.whole(1, 64)(samples, "samples"), checks.whole(0, ALL)(orders, "orders")
    if orders:
        _check_looks(scene)
    scene = scene.local
    hair, body = _geometry(scene)
    eye, to_place, near = _camera(scene)
    width, height = scene.camera.size
    corners = np.array([(x, y, 1) for x in (0, width) for y in (0, height)]) @ to_place.T
    window = corners[:, :2].min(0), corners[:, :2].max(0)
    fibres, triangles = _before(eye, hair, body, near, window)
    lights = [(_Disc if light.size else _Light)(scene, light, hair, body, orders > 0) for light in scene.lights]
    sky = None if scene.environment is None else Sky(scene, hair, body)
    under = _Ground(scene) if scene.ground else None
    shining = Paths(scene, hair, body, lights, sky, orders) if orders else _Straight(scene, hair, body, lights, sky)

    result = np.zeros((height, width, 4))
    rows = max(RAYS // (width * samples**2), 1)
    for top in range(0, height, rows):
        end = min(top + rows, height)
        pixels = np.concatenate([_in_row(row, width, samples, seed) for row in range(top, end)])
        places = (np.column_stack([pixels, np.ones(len(pixels))]) @ to_place.T)[:, :2]
        color = np.zeros((len(places), 4))
        depth, fibre = fibres.nearest(places)
        body_depth, triangle = triangles.nearest(places)
        ground_depth = under.distances(pixels) if under else np.full(len(depth), np.inf)
        nearer = np.flatnonzero(depth < np.minimum(body_depth, ground_depth))
        bare = np.flatnonzero((body_depth <= np.minimum(depth, ground_depth)) & (triangle >= 0))
        below = np.flatnonzero(ground_depth < np.minimum(depth, body_depth))
        if scene.body != "drawn":
            bare = bare[:0]
        on = np.concatenate([nearer, bare])
        color[on, 3] = 1
        p = np.concatenate([eye.points(places[nearer], depth[nearer]), eye.points(places[bare], body_depth[bare])])
        fibre[bare], triangle[nearer] = -1, -1
        share = np.concatenate([fibres.share(places[nearer], fibre[nearer]), np.zeros(len(bare))])
        random = sky and np.concatenate([_of_sky(row, width, samples, seed) for row in range(top, end)])
        own = np.random.default_rng((seed, top, 2)) if orders else sky and random[on]
        color[on, :3] = shining.light(p, _towards(eye, p), fibre[on], triangle[on], share, own)
        if under:
            at = eye.points(places[below], ground_depth[below])
            color[below] = under.light(at, lights, sky, random[below] if sky else None)
        result[top:end] = color.reshape(end - top, width, samples**2, 4).mean(2)
        if progress:
            progress(end / height)
    return result


def noise_of(scene, samples=8, seed=0, progress=None, orders=0):
    """One estimate of the standard error of each number of `picture`, from it and another seed -> [height, width, 4].

    Its root mean square over many pixels is that of the picture's error.  Arguments are as for `picture`.
    """
    one, other = (picture(scene, samples, seed + k, progress, orders) for k in (0, 1))
    return np.abs(one - other) / math.sqrt(2)


def cached_picture(scene, samples=8, folder=None, progress=None, orders=0):
    """`picture` with seed 0, kept in ``folder`` (clfur's in the user's cache if None) under what the scene is.

    Other arguments are as for `picture`.  A damaged file is made anew.  Raises `clfur.Error` as `picture` does, and
    where there is no folder to write to.
    """
    known = cache.digest(VERSION, samples, scene, *([orders] if orders else []))
    file = (cache.folder("truth") if folder is None else Path(folder)) / f"{known}.npz"
    width, height = scene.camera.size
    try:
        with np.load(file) as saved:
            kept = saved["picture"]
        if kept.shape == (height, width, 4) and kept.dtype == np.float64:
            return kept
    except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile, zipfile.zlib.error):   # none, or damaged
        pass
    result, stream = picture(scene, samples, 0, progress, orders), io.BytesIO()
    np.savez_compressed(stream, picture=result)
    cache.write(file, stream.getvalue())
    return result


def _check_looks(scene):
    """Raise `clfur.Error` where light cannot be followed from hair to hair."""
    fur = scene.strands
    types = () if fur is None else fur.hairy_types
    other = next((kind.look.model for kind in types if kind.look.model != "chiang"), None)
    if other is not None:
        raise Error(f"light is to go from hair to hair, but the look of hair is {other}; allowed: clfur.Chiang for all "
                    "strands (--look chiang), or orders=0")


# --- the scene ------------------------------------------------------------------------------------------


def _geometry(scene):
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
    hair.first, hair.owner = _segments(hair.spans)
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


def _before(eye, hair, body, near, window):
    """(`Fibres`, `Triangles`) of a scene before an eye."""
    fibres = Fibres(eye, hair.points[hair.first], hair.points[hair.first + 1], hair.starts, hair.ends, near, window)
    return fibres, Triangles(eye, body.positions[body.triangles[:, :3]], near, window)


def _camera(scene):
    """(eye, the matrix from pixels to places, least distance ahead that is seen)."""
    camera = scene.camera
    eye = Eye(camera.pose[:3, 3], camera.pose[:3, :3].T * np.array([[1], [-1], [-1]]), False)
    return eye, np.linalg.inv(camera.intrinsics), seen(scene).near


def _in_row(row, width, samples, seed):
    """Where the rays of a row pass, in pixels: [width * samples², 2], the same whatever is drawn with it."""
    down, across = np.divmod(np.arange(samples**2), samples)
    within = np.random.default_rng((seed, row)).random((width, samples**2, 2)) + np.stack([across, down], 1)
    return (within / samples + np.stack([np.arange(width), np.full(width, row)], 1)[:, None]).reshape(-1, 2)


def _of_sky(row, width, samples, seed):
    """Random numbers of the rays of a row, for what they get from the sky: [width * samples², 3]."""
    return spread(samples**2, np.random.default_rng((seed, row, 1)).random((width, 1, 2))).reshape(-1, 3)


def _towards(eye, p):
    return unit(eye.origin - p)


# --- light ----------------------------------------------------------------------------------------------


class _Straight:
    """Light that comes to what is seen straight from lights and a sky."""

    def __init__(self, scene, hair, body, lights, sky):
        self.scene, self.hair, self.body, self.lights, self.sky = scene, hair, body, lights, sky

    def light(self, p, v, fibre, triangle, share, random):
        """Light [n, 3] that places send towards v.

        p, v: [n, 3]; each lies on a segment ``fibre`` [n], a share of the way along it, or on a triangle [n] (-1: not).
        random: [n, 3], see `Sky.light`; None without a sky.
        """
        sent = np.zeros(p.shape)
        for some, of, on in ((fibre >= 0, self._of_hair, (fibre, share)), (fibre < 0, self._of_body, (triangle,))):
            its = p[some], v[some], *(each[some] for each in on)
            sent[some] = of(*its, None if random is None else random[some])
        return sent

    def _of_hair(self, p, v, fibre, share, random):
        strand, t, color = on_strand(self.hair, fibre, share)
        kind, none, sent = self.hair.kind[strand], np.full(len(p), -1), 0
        for light in self.lights:
            to_light, direct = light.arriving(p, strand, none)
            sent = sent + scatter.fibre(color, self.hair.shine[kind], t, to_light, v, direct, light.ambient,
                                        self.hair.lobes[kind])
        return sent + color * self.sky.light(p, t, none > 0, strand, none, random) if self.sky else sent

    def _of_body(self, p, v, triangle, random):
        n, color = on_body(self.scene, self.body, triangle, p, v)
        none = np.full(len(p), -1)
        sent = sum(color * (light.arriving(p, none, triangle, n)[1] + light.ambient) for light in self.lights)
        return sent + color * self.sky.light(p, n, none < 0, none, triangle, random) if self.sky else sent


class _Light:
    """One light of a scene on places in it."""

    def __init__(self, scene, light, hair, body, scatters=False):
        self.light, self.hair = light, hair
        self.ambient = ambient_of(light, scene.environment, scatters)
        spot, direction = self.light.position is not None, self.light.direction
        center, radius = extent(scene.mesh, scene.fur)
        if light.everywhere:
            direction = _ahead(light, center)
        self.eye = Eye(self.light.position if spot else np.zeros(3), frame_along(direction), not spot)
        near = 1e-6 * (radius or 1.0)
        if spot:
            half = math.radians(self.light.angle) / 2
            if light.everywhere:   # what lies behind it shades nothing that it may stand before
                off = max(float(np.linalg.norm(center - light.position)), 1e-30)
                half = min(math.asin(min(1.01 * radius / off, 1)), STEEP)
            window = np.array([[-1], [1]]) * np.full(2, math.tan(half))
        else:
            places = self.eye.places(self.eye.frame(np.concatenate([hair.points[:, :3], body.positions])))
            grown = hair.points[:, 3].max(initial=0)
            window = places.min(0, initial=np.inf) - grown, places.max(0, initial=-np.inf) + grown
        self.fibres, self.triangles = _before(self.eye, hair, body, near, window)
        with np.errstate(divide="ignore"):
            self.depth = np.log(hair.shine[hair.kind[hair.owner], 2])     # of a crossing; alpha 0 lets nothing through
        self.bias = 1e-7 * radius                                         # a place on the body is not before itself

    def arriving(self, p, strand, triangle, normal=None):
        """What comes to places p [n, 3], which lie on a strand or a triangle [n] (-1: not) -> (unit vectors to the
        light, its light) [n, 3]; by its cosine with a normal [n, 3], if that is given."""
        to_light, direct = self._unshadowed(p)
        if normal is not None:
            direct *= np.maximum(dot(normal, to_light), 0)[:, None]
        some = np.flatnonzero(direct.any(1))
        direct[some] *= self._transmittance(p[some], triangle[some], strand[some])[:, None]
        return to_light, direct

    def on_ground(self, p):
        """What falls on places p of a level plane: (all of it, what is left of it) [n, 3]."""
        to_light, direct = self._unshadowed(p)
        direct = direct * np.maximum(to_light[:, 1:2], 0)
        left, some = direct.copy(), np.flatnonzero(direct.any(1))
        none = np.full(len(some), -1)
        left[some] *= self._transmittance(p[some], none, none)[:, None]
        return direct + self.ambient, left + self.ambient

    def _unshadowed(self, p):
        """(unit vectors to the light, its colour where nothing is in its way) [n, 3]."""
        light = self.light
        direct = np.repeat(light.strength[None].astype(float), len(p), 0)
        if light.position is None:
            return np.broadcast_to(-light.direction, p.shape), direct
        to_light = unit(light.position - p)
        if not light.everywhere:
            direct[-to_light @ light.direction < math.cos(math.radians(light.angle) / 2)] = 0
        return to_light, direct

    def _transmittance(self, p, triangle, strand):
        """Share of the light [n] that is left at places p, which lie on a triangle or a strand (-1: not)."""
        if not len(p) or not self.light.shadows:
            return np.ones(len(p))
        framed = self.eye.frame(p)
        places, z = self.eye.places(framed), framed[:, 2]
        share = np.where(self.triangles.any_before(places, z - self.bias, triangle), 0.0, 1.0)
        if (self.depth < 0).any():
            some = np.flatnonzero(share)
            share[some] = np.exp(self.fibres.sum_before(
                places[some], z[some], strand[some], self.hair.owner, self.depth))
        return share


class _Disc:
    """A light of a scene that is a disc: as many lights without a size, one of which shines to each place."""

    def __init__(self, scene, light, hair, body, scatters=False):
        center, _ = extent(scene.mesh, scene.fur)
        x, y, z = frame_along(_ahead(light, center) if light.everywhere else light.direction)
        across = light.size if light.position is not None else math.tan(math.radians(light.size) / 2)
        self.points, self.turn = [], 0.0
        for a, b in layout.disc(DISC).astype(float) * across:
            where = {"direction": z + a * x + b * y} if light.position is None else {
                "position": light.position + a * x + b * y}
            self.points.append(_Light(scene, attrs.evolve(light, size=0.0, **where), hair, body, scatters))

    @property
    def ambient(self):
        """That of the light."""
        return self.points[0].ambient

    def arriving(self, p, *rest):
        """See `_Light.arriving`: of a point each, neighbours of others, all over the disc."""
        return self._from_each(p, "arriving", *rest)

    def on_ground(self, p):
        """See `_Light.on_ground`."""
        return self._from_each(p, "on_ground")

    def _from_each(self, p, name, *rest):
        """Two results [n, 3] of the points, of one for each place."""
        which = ((np.arange(len(p)) * EVEN + self.turn) % 1 * DISC).astype(int)
        self.turn += EVEN * (len(p) + .5)
        result = np.zeros((2, len(p), 3))
        for number, point in enumerate(self.points):
            its = np.flatnonzero(which == number)
            if len(its):
                result[:, its] = getattr(point, name)(p[its], *(each[its] for each in rest))
        return result


def _ahead(light, center):
    """The way [3] from a point light to the middle of a scene."""
    way = center - light.position
    length = np.linalg.norm(way)
    return way / length if length else np.array([0.0, 0, -1])


class _Ground:
    """The scene's ground, as its camera sees it."""

    def __init__(self, scene):
        self.color, self.seen = scene.ground.color, ground_from(scene.camera, height_of(scene))

    def distances(self, pixels):
        """How far ahead each ray [n, 2] meets it, [n]: infinite where it does not."""
        if self.seen is None:
            return np.full(len(pixels), np.inf)
        down, above = self.seen
        falls = np.column_stack([pixels, np.ones(len(pixels))]) @ down
        return np.where(falls > 0, above / np.where(falls > 0, falls, 1), np.inf)

    def light(self, p, lights, sky, random):
        """Light and alpha [n, 4] at places p of it, also of a sky; for ``random`` see `Sky.light`."""
        if not len(p):
            return np.zeros((0, 4))
        whole, left = (sum(each) for each in zip(*(light.on_ground(p) for light in lights)))
        if sky:
            none, up = np.full(len(p), -1), np.tile((0.0, 1.0, 0.0), (len(p), 1))
            whole = whole + sky.on_level()
            left = left + sky.light(p, up, none < 0, none, none, random)
        if self.color is not None:
            return np.column_stack([self.color * left, np.ones(len(p))])
        all_of_it = whole @ ground.LUMINANCE
        alpha = np.where(all_of_it > 0, 1 - left @ ground.LUMINANCE / np.where(all_of_it > 0, all_of_it, 1), 0)
        return np.column_stack([np.zeros((len(p), 3)), alpha])


# --- light in hair alone --------------------------------------------------------------------------------


def transmittance(points, spans, alphas, towards_light, queries, own, footprint, rays=64, seed=0):
    """How much light reaches places in hair: the mean of alpha^crossings over rays of light in a footprint.

    ``points``: [P, 4] x, y, z, width; ``spans``: [strands, 2] first point, points; ``alphas``: what one hair lets
    through, a number or [strands].  ``towards_light``: unit [3].  ``queries``: [Q, 3] with ``own`` [Q] the strand
    that each lies on (not counted), or -1.  Each of ``rays`` rays starts in the query's plane across the light,
    uniformly within ``footprint`` [world] of it; a single ray would see only the gaps between hairs.  Hairs are
    round fibres of their real width.  -> [Q] float64.
    """
    points, spans = np.asarray(points, float), np.asarray(spans, np.int64)
    alphas = np.broadcast_to(np.asarray(alphas, float), len(spans))
    z = -np.asarray(towards_light, float)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(z, x), z], 1)              # across, across, the way the light travels

    first, owner = _segments(spans)
    a, b = points[first, :3] @ frame, points[first + 1, :3] @ frame
    radius = (points[first, 3] + points[first + 1, 3]) / 4
    places = np.asarray(queries, float) @ frame

    # Segments by square bins of the plane across the light, so that a query looks only at its neighbours.
    bin_size = max(footprint, np.abs(b - a)[:, :2].max(initial=0), 1e-9)
    low = np.floor((np.minimum(a, b)[:, :2] - radius[:, None] - footprint) / bin_size).astype(np.int64)
    high = np.floor((np.maximum(a, b)[:, :2] + radius[:, None] + footprint) / bin_size).astype(np.int64)
    entries, keys = [], []
    for dx in range(int((high - low)[:, 0].max(initial=0)) + 1):
        for dy in range(int((high - low)[:, 1].max(initial=0)) + 1):
            here = np.flatnonzero((low[:, 0] + dx <= high[:, 0]) & (low[:, 1] + dy <= high[:, 1]))
            entries.append(here)
            keys.append(_key(low[here] + (dx, dy)))
    entries, keys = np.concatenate(entries), np.concatenate(keys)
    order = np.argsort(keys, kind="stable")
    entries, keys = entries[order], keys[order]

    random = np.random.default_rng(seed)
    result = np.ones(len(places))
    query_keys = _key(np.floor(places[:, :2] / bin_size).astype(np.int64))
    starts, ends = np.searchsorted(keys, query_keys), np.searchsorted(keys, query_keys, "right")
    for q, (place, start, end) in enumerate(zip(places, starts, ends)):
        near = entries[start:end]
        near = near[(owner[near] != own[q]) & (np.minimum(a[near, 2], b[near, 2]) < place[2])]
        r, angle = footprint * np.sqrt(random.random(rays)), 2 * math.pi * random.random(rays)
        ray = place[:2] + np.stack([r * np.cos(angle), r * np.sin(angle)], 1)
        d = b[near] - a[near]
        e = ray[:, None] - a[near, :2]                       # [rays, near, 2]
        square = (d[:, :2] ** 2).sum(1)
        square[square == 0] = np.inf                         # along the light: no ray crosses it
        t = (e * d[:, :2]).sum(2) / square
        aside = np.abs(e[..., 0] * d[:, 1] - e[..., 1] * d[:, 0]) / np.sqrt(square)
        hit = (t >= 0) & (t < 1) & np.isfinite(square) & (aside < radius[near]) & (a[near, 2] + t * d[:, 2] < place[2])
        result[q] = np.exp(hit @ np.log(np.maximum(alphas[owner[near]], 1e-300))).mean()
    return result


def _segments(spans):
    """Every segment's (first point, strand)."""
    counts = np.maximum(spans[:, 1] - 1, 0)
    owner = np.repeat(np.arange(len(spans)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return spans[owner, 0] + within, owner


def _key(bins):
    return bins[:, 0] * (1 << 32) + bins[:, 1]
