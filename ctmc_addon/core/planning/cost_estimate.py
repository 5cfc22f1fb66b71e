# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the cost of a surface before it is made: voxels, triangles, memory, seconds.

Voxels and triangles are counted by extraction's own first passes and are exact before simplification and before
components are dropped. Seconds are a sum over the stages (`rates`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..machine.budget import Budget
from ..progress import Stages, Steps, timed_steps
from ..settings import FIELD, ReconstructionSettings, settings_of_stage
from ..smoothing.methods import smoothing_of, used_settings
from ..smoothing.prepare import field_steps
from ..volume.field import ScalarField, held_steps
from ..volume.volume import Volume
from .counted_surface import CostEstimate
from .plan import LOOKING, READ_SHARE, advice_of, plan_steps, proposals_steps
from .rates import CALIBRATION

WHOLE_MACHINE = Budget()


@dataclass
class FieldCache:
    """The field of a volume, made again only when a setting that matters to it has changed."""

    volume: Volume
    budget: Budget = WHOLE_MACHINE
    key: tuple[object, ...] | None = None
    field: ScalarField | None = None
    seconds: float = 0.0

    def field_steps(self, settings: ReconstructionSettings) -> Steps[ScalarField]:
        """Return the field for these settings; keep a smoothed one if there is room for it."""
        smoothing, used = smoothing_of(settings), used_settings(settings)
        own = [name for name in settings_of_stage(FIELD) if name in used and name not in ("smoothing", "smoothing_mm")]
        key = (
            smoothing.name,
            settings.smoothing_width_mm,
            settings.threshold is None,
            None if settings.label is None else settings.stride,  # the sides of its box lie on the stride's grid
            *(getattr(settings, name) for name in (*own, *smoothing.reads)),
        )
        if self.field is None or key != self.key:
            self.field, self.seconds = yield from timed_steps(self._make_steps(settings))
            self.key = key
        elif settings.threshold is not None:
            self.field = self.field.at_threshold(settings.threshold)
        self.field = replace(self.field, settings=settings)
        return self.field

    def _make_steps(self, settings: ReconstructionSettings) -> Steps[ScalarField]:
        field = yield from field_steps(self.volume, settings, self.budget)
        there, needed = self.budget.available, 4 * math.prod(field.values.shape)
        keeps = self.volume.reader.own_bytes == 0 and (there is None or needed <= READ_SHARE * there)
        return (yield from held_steps(field)) if keeps and not field.values.held else field


def cost_estimate_steps(cache: FieldCache, settings: ReconstructionSettings) -> Steps[CostEstimate]:
    """Estimate the cost of a surface with these settings.

    Raises
    ------
    CtmcError
        If they give no surface at all.
    """
    stages = Stages({"Measuring this machine": 3, "Preparing values": 3, "Counting": 3, LOOKING: 1})
    yield from stages.run("Measuring this machine", CALIBRATION.measure_steps())
    field = yield from stages.run("Preparing values", cache.field_steps(settings))
    planning = plan_steps(cache.volume, settings, cache.budget, field=field)
    plan = yield from stages.run("Counting", planning)
    if not plan.counts.faces:
        yield from field.check_extracted_steps()
    field.check_closed()
    x, y, z = (spacing * side for spacing, side in zip(cache.volume.spacing, settings.stride, strict=True))
    estimate = CostEstimate(
        settings=settings,
        voxels=plan.counts.voxels,
        vertices=plan.counts.vertices,
        faces=plan.counts.faces,
        memory=plan.needed,
        left=plan.left,
        preparing_seconds=cache.seconds,
        counting_seconds=stages.seconds["Counting"],
        available=cache.budget.available,
        sides_mm=(x, y, z / field.slice_steps),
    )
    if estimate.fits or estimate.available is None:
        return estimate
    looking = proposals_steps(cache.volume, plan, estimate.available)
    return replace(estimate, remedy=advice_of((yield from stages.run(LOOKING, looking))))
