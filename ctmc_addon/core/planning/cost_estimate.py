# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the cost of a surface before it is made: voxels, triangles, memory, seconds.

Voxels and triangles are counted by extraction's own first passes and are exact before simplification and before
components are dropped. Seconds are those counts times what a unit of work takes in this process: measured once on a
small ball, and again on every surface that is made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..extraction.grid import make_grid
from ..extraction.marching_cubes import count_steps, extract_steps
from ..machine.budget import Budget
from ..progress import PAUSE, Stages, Steps, timed_steps
from ..reconstruction import Reconstruction
from ..settings import FIELD, ReconstructionSettings, settings_of_stage
from ..simplification.simplify import simplify_steps
from ..smoothing.methods import smoothing_of, used_settings
from ..smoothing.prepare import field_steps
from ..volume.field import Field, held_steps
from ..volume.volume import Volume
from .plan import LOOKING, READ_SHARE, Plan, advice_of, plan_steps, proposals_steps

WHOLE_MACHINE = Budget()
BOUNDED_COLLAPSES = 20  # A triangle costs this many collapses with a maximum error: 10 on smooth surfaces, 35 on bone.
BALL_SAMPLES = 112  # The ball that a fresh process is measured on has this many samples along an axis.


@dataclass(frozen=True)
class CostEstimate:
    """The predicted time, memory and size of a surface.

    Parameters
    ----------
    voxels : int
        Voxels to visit.
    vertices, faces : int
        Exact, before simplification and before components are dropped.
    memory : int
        Peak, bytes.
    seconds : float
        Within a factor of two.
    counting_seconds : float
        Seconds of the first passes, included in `seconds`.
    available : int or None
        Bytes of memory that can be had.
    remedy : str
        Change that would fit, if this does not.
    """

    voxels: int
    vertices: int
    faces: int
    memory: int
    seconds: float
    counting_seconds: float = 0.0
    available: int | None = None
    remedy: str = ""

    @property
    def fits(self) -> bool:
        """Whether there is enough memory."""
        return self.available is None or self.memory <= self.available

    @property
    def sentence(self) -> str:
        """Return why the surface cannot be made, and what would fit; empty if it fits."""
        if self.fits or self.available is None:
            return ""
        return (
            f"this would need {self.memory / 2**30:.1f} GiB of memory and {self.available / 2**30:.1f} GiB are "
            f"available; {self.remedy}"
        )


@dataclass
class Calibration:
    """Seconds that a unit of work takes in this process.

    Parameters
    ----------
    vertex, face : float
        Seconds to extract one.
    collapse : float
        Seconds to remove a triangle.
    bounded_face : float
        Seconds to simplify a triangle with a maximum error.
    blender_face : float
        Seconds to measure a triangle and hand it to Blender.
    measured : bool
    """

    vertex: float = 0.0
    face: float = 0.0
    collapse: float = 0.0
    bounded_face: float = 0.0
    blender_face: float = 2.0e-6
    measured: bool = False

    def measure_steps(self) -> Steps[None]:
        """Measure the speed of this machine on a small ball, once in each process."""
        if self.measured:
            return
        axis = np.arange(BALL_SAMPLES, dtype=np.float32) - (BALL_SAMPLES - 1) / 2
        square = axis * axis
        ball = -(square[:, None, None] + square[:, None] + square)
        yield PAUSE
        grid, threshold = make_grid(ball), -((BALL_SAMPLES / 2.5) ** 2)
        yield from count_steps(grid, threshold, Budget(threads=1))  # the first run of new code is slower
        counts, counting = yield from timed_steps(count_steps(grid, threshold))
        surface, seconds = yield from timed_steps(extract_steps(grid, threshold))
        self.vertex = self.face = max(1e-4, seconds - counting) / (counts.vertices + counts.faces)
        _, seconds = yield from timed_steps(simplify_steps(surface.at(1.0), reduction=0.5))
        self.collapse = seconds / (0.5 * counts.faces)
        self.bounded_face = BOUNDED_COLLAPSES * self.collapse
        self.measured = True

    def learn(self, estimate: CostEstimate, result: Reconstruction, blender_seconds: float) -> None:
        """Take over the seconds of a real surface; `blender_seconds` are those after its last stage."""
        seconds = {stage.name: stage.seconds for stage in result.stages}
        removed = result.full_faces - len(result.mesh.faces)
        counted = estimate.faces + estimate.vertices
        if "Extracting the surface" in seconds and counted > 10_000:
            extracting = seconds["Extracting the surface"]
            self.vertex = self.face = max(extracting - estimate.counting_seconds, 0.0) / counted
        if "Simplifying" in seconds and removed > 1000:
            if result.settings.max_error_mm is not None:
                self.bounded_face = seconds["Simplifying"] / result.full_faces
            else:
                self.collapse = seconds["Simplifying"] / removed
        if estimate.faces > 1000:
            self.blender_face = blender_seconds / estimate.faces


CALIBRATION = Calibration()


@dataclass
class FieldCache:
    """The field of a volume, made again only when a setting that matters to it has changed."""

    volume: Volume
    budget: Budget = WHOLE_MACHINE
    key: tuple[object, ...] | None = None
    field: Field | None = None
    seconds: float = 0.0

    def field_steps(self, settings: ReconstructionSettings) -> Steps[Field]:
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

    def _make_steps(self, settings: ReconstructionSettings) -> Steps[Field]:
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
    stages = Stages({"Measuring the machine": 3, "Preparing values": 3, "Counting": 3, LOOKING: 1})
    yield from stages.run("Measuring the machine", CALIBRATION.measure_steps())
    field = yield from stages.run("Preparing values", cache.field_steps(settings))
    planning = plan_steps(cache.volume, settings, cache.budget, field=field)
    plan = yield from stages.run("Counting", planning)
    if not plan.counts.faces:
        yield from field.check_extracted_steps()
    field.check_closed()
    seconds = stages.seconds["Counting"]
    estimate = CostEstimate(
        voxels=plan.counts.voxels,
        vertices=plan.counts.vertices,
        faces=plan.counts.faces,
        memory=plan.needed,
        seconds=cache.seconds + seconds + _seconds_after_counting(plan),
        counting_seconds=seconds,
        available=cache.budget.available,
    )
    if estimate.fits or estimate.available is None:
        return estimate
    looking = proposals_steps(cache.volume, plan, estimate.available)
    return replace(estimate, remedy=advice_of((yield from stages.run(LOOKING, looking))))


def _seconds_after_counting(plan: Plan) -> float:
    """Return the seconds of all that follows the first passes."""
    work, counts = CALIBRATION, plan.counts
    seconds = counts.vertices * work.vertex + counts.faces * (work.face + work.blender_face)
    if plan.simplifies and plan.settings.max_error_mm is not None:
        return seconds + counts.faces * work.bounded_face
    return seconds + (counts.faces - plan.left) * work.collapse
