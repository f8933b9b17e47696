"""The two ways to draw strands: opaque, in samples, or as much of each pixel as they cover.

A pass takes some rows of the picture through five steps: `count` begins to find out how many rows fit, while lights are
made ready; `rasterize` tells it, and what each of their samples sees; `resolve` what of that is in front, with shell
fur taken into account; `shade` lights it; `hashed` gives its bits.  Parts of the scene are gone through forwards and
backwards in turn: the last one of a step is there for the next.
"""

import functools
import weakref
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import layout
from ..device.team import Team
from ..stages import coverage, ground, masks, mattes, shade, strand_light
from ..stages.coverage import EVERY, KEPT, REACH, TILE
from ..stages.lighting import Lighting
from ..stages.strands import no_strands
from ..stages.tessellate import no_surface
from . import build
from .mattes import UNIT, Told
from .plan import Plan
from .views import band_of, one_sample


@dataclass(frozen=True)
class Band:
    """Rows of the picture that are drawn together, before strands that are transparent."""

    rows: tuple       # first, one past the last
    view: np.void     # layout.View of these rows
    visible: Any      # [rows, width, samples] uint64 depth << 32 | id of what is nearest: the body, or an opaque strand
    counted: Any = None   # `Counted` rows, these among them, where strands are transparent


@dataclass(frozen=True)
class Front:
    """What is seen of a band."""

    view: np.void     # layout.View of the samples in which it is
    keys: Any         # [rows, width, samples] uint64 depth << 32 | id of strand or body
    shell_transmittance: Any   # [rows, width, samples] float32 share of light that comes through shell fur, or None;
                      # where strands are transparent, alpha stands for it
    shell_front: Any  # [rows, width, samples] uint64 depth << 32 | face of shell fur, or None
    outputs: dict     # {name: array} of outputs that are known by now
    image: Any = None       # [rows, width, 4] float32 light of what is lit by now, or None
    body_transmittance: Any = None   # [rows, width, samples] float32 share of the body's light, by transparent strands
    shells: tuple = (None, None)     # what `march.march` gave, where it is told whose pixels are


class Samples:
    """Strands are opaque, and at least 1/samples of a pixel wide: a sample sees the nearest of strands and body."""

    digests = 1       # arrays that `hashed` gives

    def __init__(self, plan: Plan, team: Team) -> None:
        self.plan, self.team = plan, team

    def count(self, gpu: Any, top: int, end: int) -> None:
        """Nothing is to be counted."""

    def rasterize(self, gpu: Any, top: int, end: int) -> Band:
        """`Band` of as many rows as fit each device, ``top`` to ``end`` at most; the devices share the strands."""
        end = min(top + min(self.team.each(self.plan.rows)), end)
        view = band_of(self.plan.view, top, end)
        visible, = self.team.gather("rasterize", functools.partial(build.rasterize, self.plan, view), [np.minimum],
                                    self.plan.strands, gpu)
        return Band((top, end), view, build.on(gpu, visible))

    def resolve(self, gpu: Any, band: Band, lighting: Lighting | None, image: Any, shell_transmittance: Any,
                shell_front: Any) -> Front:
        """`Front` of a band, behind shell fur as `march.march` has it; image: its light."""
        return Front(band.view, band.visible, shell_transmittance, shell_front, {}, image)

    def shade(self, gpu: Any, band: Band, front: Front, lighting: Lighting | None) -> tuple:
        """Light what is in front -> (image, {other output: array}), None and {} where not asked for."""
        plan, known, image, through = self.plan, None, front.image, front.shell_transmittance
        parts, on_ground = plan.parts(gpu), plan.ground is not None
        several = len(parts) > 1 or on_ground
        sums = shade.no_light(gpu, *band.visible.shape[:2]) if plan.wants_color and several else None
        if plan.seen_through and image is not None:   # what the fur of shells covers
            shade.cover(gpu, band.visible, through, image)
            shade.uncover(gpu, band.visible, through, image)
        for part in reversed(parts):
            if len(parts) > 1:
                build.tally(gpu, plan, part)
            if plan.wants_color:
                result = _color(gpu, plan, part, band.view, band.visible,
                                build.hair(gpu, plan, part, plan.settings.lod), build.body(gpu, plan, part), lighting,
                                image, front.shell_transmittance, sums)
            if plan.others:
                known = shade.outputs(gpu, front.view, front.keys, build.hair(gpu, plan, part, plan.settings.lod),
                                      build.body(gpu, plan, part), known)
        if plan.wants_color:
            if on_ground:
                _light_ground(gpu, plan, band, lighting, sums, through)
            image = result if sums is None else shade.blend(gpu, sums, image)
            if through is not None and not plan.seen_through:
                shade.cover(gpu, front.keys, through, image)
        if plan.others and on_ground:
            _tell_ground(gpu, plan, front, known)
        return image, known or {}

    def parts(self, gpu: Any, band: Band) -> list:
        """[`Part`] in which a band is drawn."""
        return self.plan.parts(gpu)

    def tell(self, gpu: Any, band: Band, front: Front) -> dict:
        """{output: array} of whose light the pixels' is, see `mattes.Told`."""
        plan, samples, told = self.plan, band.visible.shape[2], Told(self.plan, band.rows)
        body, ground, through = _shares(gpu, band.visible, front.shell_transmittance)
        ids = gpu.download(band.visible).astype(np.uint32).ravel()   # the lower half
        of_strands = np.flatnonzero(ids < layout.CONSTANTS["BODY"])
        if len(of_strands):
            which, back = np.unique(ids[of_strands], return_inverse=True)
            there = gpu.upload(which)
            known = mattes.Owners.empty(gpu, {"id": len(which)})
            for part in plan.parts(gpu):
                if part.hairy:
                    mattes.owners(gpu, band.view, there, build.hair(gpu, plan, part, plan.settings.lod), known)
            told.add(of_strands // samples, gpu.download(known.owners)[back], gpu.download(known.turns)[back],
                     through.ravel()[of_strands] / np.float32(samples))
            told.flush()
        return told.images(body, ground, (1 - through.astype(np.float64)).mean(2) if plan.scene.shells else None)

    def hashed(self, gpu: Any, band: Band, front: Front) -> list:
        """[Bits of integers], the same on every device."""
        return [build.bytes_of(gpu, band.visible)]


class Coverage:
    """Strands are as wide as they are and as transparent as they are thin: each covers a share of a pixel."""

    digests = 2

    def __init__(self, plan: Plan, team: Team) -> None:
        self.plan = plan
        self._counted: Any = None    # `Counted` rows,
        self._counting: Any = None   # or a function that waits for them

    def count(self, gpu: Any, top: int, end: int) -> None:
        """Begin to count what shows in rows, row ``top`` among them, unless that is known: in all that are wanted or as
        many as fit."""
        plan, counted = self.plan, self._counted
        if counted is not None and counted.gpu is gpu and counted.first <= top < counted.end:
            return
        self._counted = self._counting = None   # goes before more is made
        end = min(top + plan.rows(gpu), end)
        view = band_of(plan.view, top, end)
        parts = plan.parts(gpu)
        alone = len(parts) == 1 and parts[0].hairy
        visible = build.rasterize_body(gpu, plan, view)   # while strands are made ready
        hair = build.hair(gpu, plan, parts[0], plan.settings.lod) if alone else None
        tiles = coverage.bound(gpu, view, visible, 0 if hair is None else len(hair.spans))
        for part in reversed(parts):
            if part.hairy:
                coverage.count(gpu, view, build.hair(gpu, plan, part, plan.settings.lod), tiles)
                if len(parts) > 1:
                    build.tally(gpu, plan, part)
        self._counting = functools.partial(
            self._count, gpu, parts, gpu.downloading(tiles.counts), gpu.downloading(tiles.survivors),
            first=top, end=end, tiles=tiles, made_for=hair and weakref.ref(hair), visible=visible)

    def _count(self, gpu, parts, counts, survivors, **known):
        """`Counted` rows, when they are; ``parts``: in which they were."""
        counts = counts().reshape(-1, coverage.tiles_of(self.plan.size[0], 0)[0])
        survivors = int(survivors()[0])
        cut = self.plan.cut_counted(gpu, counts, survivors)
        build.let_go_of_parts(gpu, self.plan, parts, cut.parts)
        return Counted(gpu, counts=counts, survivors=survivors, cut=cut, **known)

    def rasterize(self, gpu: Any, top: int, end: int) -> Band:
        """`Band` of as many rows as fit the device, by what was counted in each row of tiles."""
        if self._counting:
            self._counted, self._counting = self._counting(), None
        counted = self._counted
        fit = self.plan.rows_counted(gpu, counted.cut, counted.counts, counted.survivors, top - counted.first)
        until = min(top + fit, end)
        view = band_of(self.plan.view, top, until)
        visible, counted.visible = counted.visible if (top, until) == (counted.first, counted.end) else None, None
        if visible is None:   # the body was seen in more rows than fit with what strands cover of them
            visible = build.rasterize_body(gpu, self.plan, view)
        return Band((top, until), view, visible, counted)

    def resolve(self, gpu: Any, band: Band, lighting: Lighting | None, image: Any, shell_transmittance: Any,
                shell_front: Any) -> Front:
        """`Front` of a band: strands and shell fur, as `march.march` has it, hidden behind each other and the body."""
        plan, counted, (top, end) = self.plan, band.counted, band.rows
        whole = (top, end) == (counted.first, counted.end)
        tiles = counted.tiles if whole else coverage.bound(gpu, band.view, band.visible)
        if plan.wants_color and image is None:
            image = gpu.empty((*band.visible.shape[:2], 4), np.float32)
        told = plan.tells and plan.scene.shells
        shells = gpu.upload(gpu.download(shell_transmittance)) if told else None, shell_front   # it becomes the body's
        covered = coverage.nothing(gpu, band.visible, shell_transmittance)
        for window in plan.windows(gpu, counted.cut, counted.of(band.rows), counted.survivors):
            self._cover(gpu, band, tiles, window, lighting, covered, image, shell_front)
        front = covered.shell_front if plan.scene.shells else None
        return Front(one_sample(band.view), covered.front, covered.alpha, front, {"coverage": covered.alpha}, image,
                     covered.body_transmittance, shells)

    def parts(self, gpu: Any, band: Band) -> list:
        """[`Part`] in which a band is drawn."""
        return band.counted.cut.parts

    def tell(self, gpu: Any, band: Band, front: Front) -> dict:
        """{output: array} of whose light the pixels' is, see `mattes.Told`: strands are drawn again, without light."""
        plan, counted, told = self.plan, band.counted, Told(self.plan, band.rows)
        whole = band.rows == (counted.first, counted.end)
        tiles = counted.tiles if whole else coverage.bound(gpu, band.view, band.visible)
        image = shade.IMAGE.empty(gpu, band.visible.shape[:2])
        covered = coverage.nothing(gpu, band.visible, front.shells[0])
        for window in plan.windows(gpu, counted.cut, counted.of(band.rows), counted.survivors):
            self._cover(gpu, band, tiles, window, None, covered, image, front.shells[1], told)
            told.flush()
        body, ground, _ = _shares(gpu, band.visible, front.body_transmittance)
        rest = gpu.download(front.outputs["coverage"]) - body - ground - told.strands.reshape(body.shape) / UNIT
        return told.images(body, ground, np.maximum(rest, 0) if plan.scene.shells else None)

    def shade(self, gpu: Any, band: Band, front: Front, lighting: Lighting | None) -> tuple:
        """Light what is in front -> (image, {other output: array}), None and {} where not asked for."""
        plan, parts, known, image = self.plan, band.counted.cut.parts, None, front.image
        bodies = [part for part in parts if part.body]
        for part in reversed(parts):
            if part.hairy and plan.others:
                known = shade.outputs(gpu, front.view, front.keys, build.hair(gpu, plan, part, plan.settings.lod),
                                      no_surface(gpu), known)
        on_ground = plan.ground is not None
        several = plan.wants_color and (len(bodies) > 1 or plan.seen_through)
        sums = shade.no_light(gpu, *band.visible.shape[:2]) if several else None
        for part in bodies:
            body, none = build.body(gpu, plan, part), no_strands(gpu)
            if plan.wants_color and not plan.held:
                _color(gpu, plan, part, band.view, band.visible, none, body, lighting, None if several else image,
                       front.body_transmittance, sums, None if several else front.outputs["coverage"])
            if plan.others:
                known = shade.outputs(gpu, front.view, front.keys, none, body, known)
            del body   # goes before the next one is made
        if plan.others and on_ground:
            known = known or shade.outputs(gpu, front.view, front.keys, no_strands(gpu), no_surface(gpu))
            _tell_ground(gpu, plan, front, known)
        if sums is not None and plan.seen_through:
            if on_ground:
                _light_ground(gpu, plan, band, lighting, sums, front.body_transmittance)
            shade.uncover(gpu, band.visible, front.body_transmittance, image)
            image = shade.blend(gpu, sums, image)
        elif sums is not None:
            image = shade.blend(gpu, sums, image, front.outputs["coverage"])
        return image, known or {}

    def hashed(self, gpu: Any, band: Band, front: Front) -> list:
        """[Bits of integers], the same on every device: what shells let through, and so what is seen of strands among
        them, differs in the last bits."""
        if self.plan.scene.shells:
            return [build.bytes_of(gpu, band.visible), band.counted.of(band.rows)]
        return [build.bytes_of(gpu, front.keys), build.bytes_of(gpu, front.outputs["coverage"])]

    def _cover(self, gpu, band, tiles, window, lighting, covered, image, shell_front, told=None):
        """Draw what shows in a window: some tiles, (first, one past the last)."""
        plan, counted = self.plan, band.counted
        counts = counted.of(band.rows).ravel().copy()
        counts[:window[0]] = counts[window[1]:] = 0   # of the others nothing is listed
        listed = int(counts.sum(dtype=np.int64))
        most = plan.most_listed(gpu, counted.cut, counted.of(band.rows), counted.survivors)
        draw = functools.partial(self._draw, gpu, band, tiles, window, lighting, covered, image, shell_front, told)
        if listed <= most:
            draw(counts)
            return
        slabs, kept = self._slabs(gpu, band, tiles, window, listed, most), KEPT.empty(gpu, plan.of_kept)
        for (first, end), counts[window[0]] in slabs:   # nearest first
            unfinished = int(gpu.download(draw(counts, (first, end), kept))[0])
            if not unfinished and end < EVERY[1]:   # nothing behind can be seen
                counts[:] = 0
                draw(counts, (end, EVERY[1]), kept)
                return

    def _slabs(self, gpu, band, tiles, window, listed, most):
        """`coverage.slabs_of` what is listed in a tile."""
        plan = self.plan
        reaches, taken = REACH.empty(gpu, listed), gpu.full(1, np.uint32, 0)
        for part in band.counted.cut.parts:
            if part.hairy:
                coverage.reach(gpu, band.view, build.hair(gpu, plan, part, plan.settings.lod), tiles, reaches, taken,
                               window)
        slabs = coverage.slabs_of(gpu.download(reaches), most)
        if not slabs:
            raise plan.too_many(gpu, listed)
        return slabs

    def _draw(self, gpu, band, tiles, window, lighting, covered, image, shell_front, told, counts, slab=EVERY,
              kept=None):
        """Draw what ``counts`` tells to show in each tile -> what `coverage.cover` gives."""
        counted, listed = band.counted, int(counts.sum(dtype=np.int64))
        segments = coverage.allocate(gpu, counts, min(counted.survivors, listed))
        hairy = [part for part in counted.cut.parts if part.hairy and (listed or slab == EVERY)]
        cover = masks.cover if self.plan.settings.masks else coverage.cover
        draw = functools.partial(cover, gpu, band.view, band.visible, segments, covered, image=image,
                                 shell_front=shell_front, slab=slab, kept=kept)
        if told:
            return self._tell(gpu, band, hairy, tiles, window, told, counts, slab, segments, draw, kept)
        if hairy and slab == EVERY and self.plan.waits(gpu, counted.cut, counted.of(band.rows)):
            hair = self._list(gpu, band, hairy[0], tiles, window, slab, segments)
            light = functools.partial(self._light, gpu, band, hairy[0], hair, lighting)
            coverage.cover_seen(gpu, segments, counts, window, light, draw)
            return None
        lit = None if lighting is None else strand_light.unlit(gpu, lighting, len(segments.ids), self.plan.around)
        for part in hairy:
            hair = self._list(gpu, band, part, tiles, window, slab, segments)
            if lighting:
                last = part is hairy[-1]
                all_there = last and (window, slab) == ((0, counted.counts.size), EVERY)
                until = counted.survivors if all_there else int(gpu.download(segments.survivors)[0])
                lit = functools.partial(self._light, gpu, band, part, hair, lighting, segments.ids, until, lit, last)
                lit = lit if last else lit()   # the last one when all else is ready
            del hair   # it goes before the next one is made
        return draw(lit=lit, window=window)

    def _tell(self, gpu, band, hairy, tiles, window, told, counts, slab, segments, draw, kept):
        """Tell whose the pieces are of what shows of some parts -> what `coverage.cover` gives."""
        known = mattes.Owners.empty(gpu, {"id": len(segments.ids)})
        for part in hairy:
            hair = self._list(gpu, band, part, tiles, window, slab, segments)
            mattes.owners(gpu, band.view, segments.ids, hair, known, int(gpu.download(segments.survivors)[0]))
            del hair
        owners, turns, unfinished = gpu.download(known.owners), gpu.download(known.turns), None
        rows, width, _ = band.visible.shape
        for found, of_draw in mattes.pieces(gpu, segments, counts, window, (width, rows), draw, kept):
            unfinished = of_draw
            told.add(found.pixels, owners[found.numbers], turns[found.numbers], found.weights)
            if slab == EVERY:
                told.flush()
        return unfinished

    def _list(self, gpu, band, part, tiles, window, slab, segments):
        """List what shows of a part -> its strands."""
        plan, hair = self.plan, build.hair(gpu, self.plan, part, self.plan.settings.lod)
        if len(tiles.shown) and not (plan.grown or band.counted.made_for() is hair):   # see `_transmittance`
            tiles = replace(tiles, shown=gpu.empty(0, np.uint32))
        coverage.fill(gpu, band.view, hair, tiles, segments, window, slab)
        return hair

    def _light(self, gpu, band, part, hair, lighting, ids, until=None, lit=None, last=True):
        """Light of those segments of a part that end at ``until`` -> `strand_light.Places`, of these and of ``lit``."""
        plan, falling = self.plan, build.on_hair(gpu, self.plan, lighting)
        some, first = ids if until is None else None, lit.until if lit else 0   # else all of a part
        through = self._transmittance(gpu, band, part, hair, falling, some)
        lit = strand_light.radiance(gpu, band.view, falling, hair, through, ids, until, lit, last,
                                    build.scattering(gpu, plan), build.sky_points(gpu, plan, part, hair), plan.even,
                                    build.transport(gpu, plan, lighting), some is not None)
        if not plan.is_deep:
            return lit
        through = self._transmittance(gpu, band, part, hair, build.hair_alone(gpu, plan, lighting), some, "hair")
        return strand_light.axes(gpu, build.deep(gpu, plan, lighting), hair, ids, first, lit, through, some is not None)

    def _transmittance(self, gpu, band, part, hair, lighting, some, what=""):
        """[lights, points] float32 transmittance to the strands of a part; it stays for other rows and cameras where
        there is room.  [lights, 2n] of ``some`` segments' ends alone, unless these are None."""
        plan = self.plan
        if plan.settings.shadows == "off":
            return None
        if some is not None:
            return strand_light.transmittance(gpu, hair, lighting, some)
        one = len(band.counted.cut.parts) == 1
        known = build.transmittances(gpu, plan) if one or plan.keeps_transmittances(gpu) else {}
        made_for, result = known.get((part, what), (None, None))
        # The user's strands of one place lie in any order among themselves, another one each time that they are made.
        if result is None or not (plan.grown or made_for() is hair):
            result = strand_light.transmittance(gpu, hair, lighting)
            known[part, what] = weakref.ref(hair), result
        return result


@dataclass
class Counted:
    """Rows of which is known how many segments of strands each tile may show."""

    gpu: Any
    first: int
    end: int
    tiles: Any        # `coverage.Tiles`
    counts: Any       # [tiles down, across] uint32 segments
    survivors: int    # segments that may show anywhere
    cut: Any          # `plan.Cut` for them
    made_for: Any     # weak reference to the strands, if all are counted at once
    visible: Any      # of the body in all of these rows, until it is taken

    def of(self, rows: tuple) -> Any:
        """The counts of some of these rows, (first, one past the last)."""
        return self.counts[(rows[0] - self.first) // TILE:-(-(rows[1] - self.first) // TILE)]


def _shares(gpu, visible, transmittance):
    """(share [rows, width] of pixels that is the body's, that is the ground's, share [rows, width, samples] that comes
    through what stands before each sample)."""
    ids = gpu.download(visible).astype(np.uint32)   # the lower half
    through = np.ones(ids.shape, np.float32) if transmittance is None else gpu.download(transmittance)
    on_ground = ids == layout.CONSTANTS["GROUND"]
    on_body = (ids >= layout.CONSTANTS["BODY"]) & (ids != layout.CONSTANTS["NOTHING"]) & ~on_ground
    return *(np.where(each, through, 0).mean(2, dtype=np.float64) for each in (on_body, on_ground)), through


def _color(gpu, plan, part, view, visible, hair, body, lighting, image, sample_transmittance, sums, alpha=None):
    body_color = plan.scene.body_color
    if body_color is None or isinstance(body_color, tuple):   # none is drawn, or materials tell, where its light counts
        body_color = (0, 0, 0)
    body = no_surface(gpu) if plan.held else body   # what is hidden needs no light
    scattering = build.scattering(gpu, plan) if len(hair.points) else None
    return shade.color(gpu, view, lighting, visible, hair, body, body_color, image, sample_transmittance, sums,
                       scattering, build.light_around(gpu, plan, lighting),
                       *build.paint(gpu, plan, part if len(body.triangles) else None), alpha)


def _light_ground(gpu, plan, band, lighting, sums, sample_transmittance):
    ground.light(gpu, band.view, plan.ground, lighting, band.visible, sums, sample_transmittance, build.sky(gpu, plan))


def _tell_ground(gpu, plan, front, known):
    ground.outputs(gpu, front.view, plan.ground, front.keys, known)
