# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict the seconds of surfaces that are made at once: a sum over stages, each corrected by finished surfaces.

The amount of work comes from counts. Until a stage has run, its seconds are multiples of the time of a unit of work on
a small ball in this process; afterwards they are those of its last run, in proportion to the work.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..described import AUTO
from ..extraction.grid import make_grid
from ..extraction.marching_cubes import count_steps, extract_steps
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction
from ..progress import PAUSE, Steps, timed_steps
from ..simplification.simplify import simplify_steps
from ..surfaces.finish import AVERAGING, CHOOSING, EXTRACTING, KEEPING, LOOKING, PREPARING, SIMPLIFYING
from ..surfaces.request import share_walls
from .counted_surface import CostEstimate

MEASURING, COMPARING, ADDING = "Measuring", "Comparing", "Adding the surface"
THRESHOLD, LABEL, LABELS, SHARED = WAYS = ("threshold", "label", "labels", "shared")
"""The ways in which surfaces are made: of gray values, of one label, of several side by side, or sharing walls."""
Key = tuple[str, str]
"""A way and a stage; adding has no way. Measures of simplified surfaces count as comparing, which takes most of it."""
BALL_SAMPLES = 112  # The ball that a fresh process is measured on has this many samples along an axis.
SMALL_FACES = 1000  # The seconds of surfaces with fewer triangles teach nothing.
SMALL_SHARE = 0.01  # Nor do those of a stage with less than this share of the time.


@dataclass(frozen=True)
class Ratios:
    """Work in each stage, for a triangle unless it says otherwise, in multiples of extracting one of the ball.

    Found by `benchmarks/predictions.py`; they hold until the stage has run once.

    Parameters
    ----------
    keeping, choosing, averaging, looking, measuring, adding : float
    comparing, compared : float
        Distances between a simplified surface and its full one, for a triangle of either and for a surface.
    simplified : float
        Simplifying, for a surface.
    scene : float
        Adding any number of surfaces to the scene.
    crossing : float
        Counting triangles of labels that share walls that cross each other, for a triangle of a full surface.
    shared : float
        Extracting a vertex or triangle of labels that share walls.
    shared_fields : float
        Preparing labels that share walls, in multiples of preparing each by itself.
    collapsing : float
        Removing a triangle, in multiples of one of the ball; 1.6 on noisy bone.
    bounded : float
        Simplifying a triangle with a maximum error, in multiples of a collapse: 10 on smooth surfaces, 35 on bone.
    largest, kept : float
        Share of the triangles that the largest components have, and those above a volume.
    """

    keeping: float = 16.0
    choosing: float = 4.0
    averaging: float = 2.0
    looking: float = 4.0
    measuring: float = 12.0
    comparing: float = 35.0
    compared: float = 6e5
    simplified: float = 7e5
    adding: float = 7.0
    scene: float = 3e5
    crossing: float = 60.0
    shared: float = 4.0
    shared_fields: float = 1.5
    collapsing: float = 1.3
    bounded: float = 20.0
    largest: float = 0.75
    kept: float = 0.9


RATIOS = Ratios()


@dataclass
class Calibration:
    """Seconds of a unit of work in this process, and what finished surfaces taught about each stage.

    Parameters
    ----------
    unit : float
        Seconds to extract a vertex or triangle of the ball.
    collapse : float
        Seconds to remove a triangle of the ball.
    measured : bool
    learned : dict of Key to float
        Seconds of a stage in multiples of those expected by its ratio.
    kept : dict of bool to float
        Share of the triangles that stays where components are removed, by whether only the largest stay.
    """

    unit: float = 0.0
    collapse: float = 0.0
    measured: bool = False
    learned: dict[Key, float] = field(default_factory=dict)
    kept: dict[bool, float] = field(default_factory=lambda: {True: RATIOS.largest, False: RATIOS.kept})

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
        least_counting = least = math.inf
        for _ in range(3):  # Another program may delay any of them.
            counts, counting = yield from timed_steps(count_steps(grid, threshold))
            surface, seconds = yield from timed_steps(extract_steps(grid, threshold))
            least_counting, least = min(least_counting, counting), min(least, seconds)
        self.unit = max(1e-4, least - least_counting) / (counts.vertices + counts.faces)
        _, seconds = yield from timed_steps(simplify_steps(surface.at(1.0), reduction=0.5))
        self.collapse = seconds / (0.5 * counts.faces)
        self.measured = True

    def stage_seconds(self, estimates: Sequence[CostEstimate]) -> dict[Key, float]:
        """Return the predicted seconds of every stage of surfaces that are made at once."""
        return {key: self._learned(key) * seconds for key, seconds in self._expected(estimates).items()}

    def seconds(self, estimates: Sequence[CostEstimate]) -> float:
        """Return the predicted seconds of surfaces that are made at once."""
        return sum(self.stage_seconds(estimates).values())

    def learn(
        self,
        estimates: Sequence[CostEstimate],
        results: Sequence[Reconstruction],
        *,
        measuring: float,
        adding: float,
        seconds: float,
    ) -> None:
        """Take over the seconds of surfaces that were made at once.

        Parameters
        ----------
        estimates : sequence of CostEstimate
        results : sequence of Reconstruction
            The surfaces, in the same order.
        measuring, adding : float
            Seconds of measuring all of them and of handing them to Blender.
        seconds : float
            Time for everything. Threads make it less than the sum over the stages, a window that answers more.
        """
        if sum(estimate.faces for estimate in estimates) < SMALL_FACES:
            return
        settings = estimates[0].settings
        if settings.drops_components:
            counted = sum(estimate.faces for estimate in estimates)
            self.kept[settings.keep_parts > 0] = min(1.0, sum(result.full_faces for result in results) / counted)
        expected = self._expected(estimates)
        taken: dict[Key, float] = defaultdict(float, {("", ADDING): adding})
        measured = {key: seconds for key, seconds in expected.items() if key[1] in (MEASURING, COMPARING)}
        for key, of_way in measured.items():
            taken[key] = measuring * of_way / sum(measured.values())
        seen = set()
        for way, result in zip(_ways(estimates), results, strict=True):
            if way == SHARED and result.stages in seen:
                continue  # Labels of one complex all have its stages.
            seen.add(result.stages)
            for stage in result.stages:
                taken[way, stage.name] += stage.seconds
        total = sum(taken.values())
        for key, by_ratio in expected.items():
            if by_ratio > 0 and taken[key] > SMALL_SHARE * total:
                self.learned[key] = seconds / total * taken[key] / by_ratio

    def _learned(self, key: Key) -> float:
        """Return the correction of a stage, else that of the same stage in another way; 1 before any has run.

        Preparing has nothing in common from way to way: a threshold's values are ready.
        """
        way, stage = key
        ratios = WAYS if way and stage != PREPARING else ()
        return next((self.learned[kind, stage] for kind in (way, *ratios) if (kind, stage) in self.learned), 1.0)

    def _expected(self, estimates: Sequence[CostEstimate]) -> dict[Key, float]:
        """Return the seconds of every stage from the ratios, without learned ones."""
        expected: dict[Key, float] = defaultdict(float)
        for way, estimate in zip(_ways(estimates), estimates, strict=True):
            for stage, seconds in self._expected_of(estimate, way).items():
                expected[way if stage != ADDING else "", stage] += seconds
        expected["", ADDING] += self.unit * RATIOS.scene
        return dict(expected)

    def _expected_of(self, estimate: CostEstimate, way: str) -> dict[str, float]:
        settings, ratios, unit = estimate.settings, RATIOS, self.unit
        extracting = unit * (estimate.vertices + estimate.faces)
        share = self.kept[settings.keep_parts > 0] if settings.drops_components else 1.0
        faces = share * estimate.faces
        left = min(estimate.left, faces) if settings.target_faces else share * estimate.left
        stages = {PREPARING: estimate.preparing_seconds, EXTRACTING: estimate.counting_seconds + extracting}
        if way == SHARED:
            stages = {EXTRACTING: ratios.shared_fields * estimate.preparing_seconds + ratios.shared * extracting}
            stages[AVERAGING] = unit * ratios.averaging * (faces + left)
            stages[LOOKING] = unit * ratios.looking * faces * (not settings.simplifies_here)
        elif settings.normals == "mesh":
            stages[AVERAGING] = unit * ratios.averaging * left
        stages[CHOOSING] = unit * ratios.choosing * estimate.faces * (settings.alpha == AUTO)
        stages[KEEPING] = unit * ratios.keeping * estimate.faces * settings.drops_components
        if settings.simplifies_here:
            bounded = settings.max_error_mm is not None
            collapses = ratios.bounded * faces if bounded else ratios.collapsing * (faces - left)
            stages[SIMPLIFYING] = self.collapse * collapses + unit * ratios.simplified
            stages[COMPARING] = unit * (ratios.comparing * (faces + left) + ratios.compared)
        else:
            stages[MEASURING] = unit * (ratios.measuring + ratios.crossing * (way == SHARED)) * faces
        stages[ADDING] = unit * ratios.adding * left
        return {name: seconds for name, seconds in stages.items() if seconds}


def _ways(estimates: Sequence[CostEstimate]) -> list[str]:
    """Return in which way each of several surfaces is made."""
    labels = [estimate.settings for estimate in estimates if estimate.settings.label is not None]
    way = SHARED if share_walls(labels) else LABELS if len(labels) > 1 else LABEL
    return [THRESHOLD if estimate.settings.label is None else way for estimate in estimates]


CALIBRATION = Calibration()
