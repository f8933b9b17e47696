"""The two ways to draw strands: opaque, in samples, or as much of each pixel as they cover.

A pass takes some rows of the picture through four steps: `rasterize` tells how many rows fit and what each of their
samples sees; `resolve` what of that is in front, with shell fur taken into account; `shade` lights it; `hashed` gives
its bits.  Parts of the scene are gone through forwards and backwards in turn: the last one of a step is there for the
next.
"""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..device.team import Team
from ..stages import coverage, shade
from ..stages.lighting import Lighting
from ..stages.strands import no_strands
from ..stages.tessellate import no_surface
from . import build
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
    fragments: Any = None   # of transparent strands: `coverage.Fragments`
    resolved: Any = None    # and `coverage.Resolved`


class Samples:
    """Strands are opaque, and at least 1/samples of a pixel wide: a sample sees the nearest of strands and body."""

    digests = 1       # arrays that `hashed` gives

    def __init__(self, plan: Plan, team: Team, warnings: set) -> None:
        self.plan, self.team = plan, team

    def rasterize(self, gpu: Any, top: int, end: int) -> Band:
        """`Band` of as many rows as fit each device, ``top`` to ``end`` at most; the devices share the strands."""
        end = min(top + min(self.team.each(self.plan.rows)), end)
        view = band_of(self.plan.rig.view, top, end)
        visible, = self.team.gather("rasterize", functools.partial(build.rasterize, self.plan, view), [np.minimum],
                                    self.plan.strands, gpu)
        return Band((top, end), view, build.on(gpu, visible))

    def resolve(self, gpu: Any, band: Band, shell_transmittance: Any, shell_front: Any) -> Front:
        """`Front` of a band, behind shell fur as `march.march` has it."""
        return Front(band.view, band.visible, shell_transmittance, shell_front, {})

    def shade(self, gpu: Any, band: Band, front: Front, lighting: Lighting | None, image: Any) -> tuple:
        """Light what is in front -> (image over ``image``, {other output: array}), None and {} where not asked for.

        image: [rows, width, 4] float32, what shells have lit, or None.
        """
        plan, known = self.plan, None
        parts = plan.parts(gpu)
        sums = shade.no_light(gpu, *band.visible.shape[:2]) if plan.wants_color and len(parts) > 1 else None
        for part in reversed(parts):
            if len(parts) > 1:
                build.tally(gpu, plan, part)
            if plan.wants_color:
                result = _color(gpu, plan, band.view, band.visible, build.hair(gpu, plan, part, plan.settings.lod),
                                build.body(gpu, plan, part), lighting, image, front.shell_transmittance, sums)
            if plan.others:
                known = shade.outputs(gpu, front.view, front.keys, build.hair(gpu, plan, part, plan.settings.lod),
                                      build.body(gpu, plan, part), known)
        if plan.wants_color:
            image = result if sums is None else shade.blend(gpu, sums, image)
            if front.shell_transmittance is not None:
                shade.cover(gpu, front.keys, front.shell_transmittance, image)
        return image, known or {}

    def hashed(self, gpu: Any, band: Band, front: Front) -> list:
        """[Bits of integers], the same on every device."""
        return [build.bytes_of(gpu, band.visible)]


class Coverage:
    """Strands are as wide as they are and as transparent as they are thin: each covers a share of a pixel."""

    digests = 2

    def __init__(self, plan: Plan, team: Team, warnings: set) -> None:
        self.plan, self.warnings, self._counted = plan, warnings, None

    def rasterize(self, gpu: Any, top: int, end: int) -> Band:
        """`Band` of as many rows as fit the device, by the pieces of strands that were counted in each."""
        counted = self._count(gpu, top, end)
        until = min(top + self.plan.rows_counted(gpu, counted.cut, counted.sums, top - counted.first), end)
        view = band_of(self.plan.rig.view, top, until)
        visible, counted.visible = counted.visible if until - top == len(counted.sums) else None, None
        if visible is None:   # the body was seen in more rows than fit with what strands cover of them
            visible = build.rasterize_body(gpu, self.plan, view)
        return Band((top, until), view, visible, counted)

    def resolve(self, gpu: Any, band: Band, shell_transmittance: Any, shell_front: Any) -> Front:
        """`Front` of a band: strands and shell fur, as `march.march` has it, hidden behind each other and the body."""
        counted, (top, end) = band.counted, band.rows
        rows = top - counted.first, end - counted.first
        pieces = int(counted.sums[slice(*rows)].sum())
        fragments = coverage.allocate(gpu, counted.pixels, pieces, rows)
        for part in counted.cut.parts:
            if part.hairy:
                coverage.gather(gpu, band.view, build.hair(gpu, self.plan, part, self.plan.settings.lod), fragments)
        resolved = coverage.resolve(gpu, band.visible, fragments, shell_transmittance, shell_front)
        if gpu.steps and coverage.steps_of(self._counts(gpu, band), gpu.download(resolved.used)) > gpu.steps:
            self.warnings.add(f"{gpu.name} ends long loops: strands are missing where thousands lie in a pixel; "
                              "Settings.lod makes them fewer")
        return Front(one_sample(band.view), resolved.front, resolved.alpha, resolved.shell_front,
                     {"coverage": resolved.alpha}, fragments, resolved)

    def shade(self, gpu: Any, band: Band, front: Front, lighting: Lighting | None, image: Any) -> tuple:
        """Light what is in front -> (image over ``image``, {other output: array}), None and {} where not asked for.

        image: [rows, width, 4] float32, what shells have lit, or None.
        """
        plan, parts, known = self.plan, band.counted.cut.parts, None
        sums = shade.no_light(gpu, *band.visible.shape[:2]) if plan.wants_color else None
        for part in reversed(parts):
            if part.hairy:
                known = self._shade_hair(gpu, band, front, part, lighting, sums, known)
        for part in parts:
            if part.body:
                known = self._shade_body(gpu, band, front, part, lighting, sums, known)
        if plan.wants_color:
            image = shade.blend(gpu, sums, image, front.resolved.strand_transmittance, front.resolved.alpha)
        return image, known or {}

    def hashed(self, gpu: Any, band: Band, front: Front) -> list:
        """[Bits of integers], the same on every device: what shells let through, and so what is seen of strands among
        them, differs in the last bits."""
        if self.plan.scene.shells:
            return [build.bytes_of(gpu, band.visible), self._pixels(gpu, band)]
        return [build.bytes_of(gpu, front.resolved.front), build.bytes_of(gpu, front.resolved.alpha)]

    def _count(self, gpu, top, end):
        """`Counted` rows with row ``top`` among them: all that are wanted, or as many as fit."""
        plan, counted = self.plan, self._counted
        if counted is None or counted.gpu is not gpu or not counted.first <= top < counted.end:
            self._counted = None   # goes before more is made
            end = min(top + plan.rows(gpu), end)
            view = band_of(plan.rig.view, top, end)
            visible = build.rasterize_body(gpu, plan, view)
            pixels, parts = coverage.bound(gpu, visible), plan.parts(gpu)
            for part in reversed(parts):
                if part.hairy:
                    coverage.count(gpu, view, build.hair(gpu, plan, part, plan.settings.lod), pixels)
                    if len(parts) > 1:
                        build.tally(gpu, plan, part)
            sums = gpu.download(coverage.row_sums(gpu, pixels)).astype(np.int64)
            self._counted = Counted(gpu, top, end, pixels, sums, plan.cut_counted(gpu, sums), visible)
            build.let_go_of_parts(gpu, plan, parts, self._counted.cut.parts)
        return self._counted

    def _shade_hair(self, gpu, band, front, part, lighting, sums, known):
        plan = self.plan
        hair = build.hair(gpu, plan, part, plan.settings.lod)
        if plan.wants_color:
            coverage.light(gpu, band.view, lighting, front.fragments, front.resolved, hair,
                           self._transmittance(gpu, band, part, hair, lighting), sums)
        if plan.others:
            known = shade.outputs(gpu, front.view, front.keys, hair, no_surface(gpu), known)
        return known

    def _shade_body(self, gpu, band, front, part, lighting, sums, known):
        plan, body, none = self.plan, build.body(gpu, self.plan, part), no_strands(gpu)
        if plan.wants_color:
            _color(gpu, plan, band.view, band.visible, none, body, lighting, None,
                   front.resolved.body_transmittance, sums)
        if plan.others:
            known = shade.outputs(gpu, front.view, front.keys, none, body, known)
        return known

    def _transmittance(self, gpu, band, part, hair, lighting):
        """[lights, points] float32 transmittance to the strands of a part; it stays for other rows and cameras where
        there is room."""
        plan = self.plan
        if plan.settings.shadows == "off":
            return None
        one = len(band.counted.cut.parts) == 1
        known = build.transmittances(gpu, plan) if one or plan.keeps_transmittances(gpu) else {}
        if gpu.steps and plan.longest * (2 * plan.settings.pcf + 2) ** 2 > gpu.steps:
            self.warnings.add(f"{gpu.name} ends long loops: light is wrong on strands of {plan.longest:,} points with "
                              f"Settings.pcf {plan.settings.pcf}")
        if part not in known:
            known[part] = coverage.transmittance(gpu, hair, lighting)
        return known[part]

    def _pixels(self, gpu, band):
        """[rows, width, 2] uint32 what was counted in a band, on the host."""
        first = band.counted.first
        return np.ascontiguousarray(gpu.download(band.counted.pixels)[band.rows[0] - first:band.rows[1] - first])

    def _counts(self, gpu, band):
        return self._pixels(gpu, band)[..., 1]


@dataclass
class Counted:
    """Rows of which is known how many pieces of strands are in each pixel."""

    gpu: Any
    first: int
    end: int
    pixels: Any       # [rows, width, 2] uint32 depth of what hides strands, pieces: on the device
    sums: Any         # [rows] int64 pieces
    cut: Any          # `plan.Cut` for them
    visible: Any      # of the body in all of these rows, until it is taken


def _color(gpu, plan, view, visible, hair, body, lighting, image, sample_transmittance, sums):
    body_color = (0, 0, 0) if plan.scene.body_color is None else plan.scene.body_color
    return shade.color(gpu, view, lighting, visible, hair, body, body_color, image, sample_transmittance, sums)
