# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict time and memory of a solid's parts from counted surfaces, before any surface is made.

The lattice lies around the counted box, with steps divided as for the parts. Triangles grow with the area; seconds are
multiples of a unit of extraction, corrected by the last solid made in this process (`planning.rates`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..arithmetic import cube_root
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction
from ..planning.counted_surface import CostEstimate
from ..planning.rates import CALIBRATION
from ..surfaces.request import share_walls
from .fields.lattice import AROUND, steps_in
from .printing.printed import PRINTING
from .request import SolidRequest
from .structure import MAKING, PER_HOLE, divisions, margin_of

SOLID = "solid"
"""The key in `planning.rates` under which the seconds of these stages are learned."""


@dataclass(frozen=True)
class SolidRatios:
    """Work for a solid in multiples of extracting a triangle of the ball, and triangles of its parts.

    Measured on a vertebra, a hip and a liver that were hollow, cut, pegged and thickened, on 60 organs that touch, and
    on the bone of a thorax: time within a factor of 1.5, memory never too low.

    Parameters
    ----------
    started : float
        Work for each group of structures.
    sampling, making, printing : float
        Work for each sample of the lattice, and for each triangle of the parts.
    rims : float
        Further share of making a triangle where several surfaces pass through cells, or where the steps of the lattice
        are divided, so that the surface was not extracted on it.
    inner, rough_inner : float
        Area of the hollow's surface, for a label and for a threshold, as a share of the outer area.
    thin : float
        Further share of triangles where a wall is as thin as a step, because two surfaces pass through most cells
        there; it falls to 0 at 4/3 of a step.
    section : float
        Triangles of a cut, as a share of the surface.
    touching : float
        Further share of triangles for structures that touch, where three surfaces meet.
    tries : float
        Number of times these are extracted, because moving their walls a little removes crossings.
    pegs : float
        Triangles on each square of one step on pegs and holes.
    started_bytes, sample_bytes, again_bytes, slot_bytes, face_bytes, rim_bytes, touching_bytes : int
        Bytes for a group; for a sample, more if it is thickened before it is made hollow, and more for each further
        slot; for a triangle of the parts, more with `rims` and for structures that touch.
    slots : int
        Largest number of structures that meet at one point.
    """

    started: float = 3.5e6
    sampling: float = 1.0
    making: float = 78.0
    printing: float = 120.0
    rims: float = 2.2
    inner: float = 0.85
    rough_inner: float = 0.3
    thin: float = 0.9
    section: float = 0.4
    touching: float = 1.0
    tries: float = 3.0
    pegs: float = 12.0
    started_bytes: int = 64 << 20
    sample_bytes: int = 14
    again_bytes: int = 12
    slot_bytes: int = 4
    face_bytes: int = 280
    rim_bytes: int = 200
    touching_bytes: int = 350
    slots: int = 12


RATIOS = SolidRatios()
GIB = 1 << 30


@dataclass(frozen=True)
class SolidCost:
    """Cost of the parts of a solid, without the surfaces that they are made from.

    Parameters
    ----------
    faces : int
        Triangles of all parts before simplification.
    memory : int
        Peak of making them, bytes.
    work : float
        Work of making them, in the multiples of `SolidRatios`.
    """

    faces: int
    memory: int
    work: float

    @property
    def stage_seconds(self) -> dict[str, float]:
        """Return the predicted seconds of every stage."""
        return {
            stage: CALIBRATION.learned.get((SOLID, stage), 1.0) * seconds for stage, seconds in self._expected.items()
        }

    @property
    def seconds(self) -> float:
        """Return the predicted seconds of all stages."""
        return sum(self.stage_seconds.values())

    def refusal(self, available: int | None) -> str:
        """Return why the parts do not fit in `available` bytes, with a remedy; empty if they fit."""
        if available is None or self.memory <= available:
            return ""
        needed, there = self.memory / GIB, available / GIB
        return (
            f"the parts of this solid would need {needed:.1f} GiB of memory and {there:.1f} GiB are available; "
            "choose a region, a larger stride or fewer structures"
        )

    @property
    def _expected(self) -> dict[str, float]:
        return {MAKING: CALIBRATION.unit * self.work, PRINTING: CALIBRATION.unit * RATIOS.printing * self.faces}

    def learn(self, parts: Sequence[Reconstruction]) -> None:
        """Correct the next prediction by the seconds that these parts took."""
        making = {stage for part in parts for stage in part.stages if stage.name == MAKING}  # Once for each group.
        printing = [stage for part in parts for stage in part.stages if stage.name == PRINTING]
        for name, stages in ((MAKING, making), (PRINTING, printing)):
            taken, expected = sum(stage.seconds for stage in stages), self._expected[name]
            if taken and expected:
                CALIBRATION.learned[SOLID, name] = taken / expected


@dataclass(frozen=True)
class _Group:
    """Structures on one lattice, whose sides are those of the samples that they were extracted from."""

    solid: SolidRequest
    sides_mm: tuple[float, float, float]
    samples: int
    slots: int
    plain_faces: int
    is_label: bool

    @property
    def divisions(self) -> tuple[int, int, int]:
        """Number of lattice steps in a side along x, y and z."""
        return divisions(self.sides_mm, self.solid)

    @property
    def refined(self) -> tuple[float, float, float]:
        """Mean number of steps that each step becomes along x, y and z, because those around holes are divided."""
        along, solid = float(cube_root(self.samples)), self.solid
        holes = [(drain.diameter, drain.diameter, 1 if drain.point is not None else 2) for drain in solid.drains]
        if solid.pegs is not None:
            holes.append((solid.pegs.diameter, solid.pegs.length, solid.pegs.count * len(solid.cuts)))
        refined = []
        for side, parts in zip(self.sides_mm, self.divisions, strict=True):
            step, finest, more = side / parts, 1, 0.0
            for width, length, count in holes:
                finer = steps_in(step, width / PER_HOLE)
                more += (finer - 1) * count * min(1.0, (length / step + 2) / along)
                finest = max(finest, finer)
            refined.append(min(1.0 + more, float(finest)))
        x, y, z = refined
        return x, y, z

    @property
    def all_samples(self) -> float:
        """Number of samples, with the further ones around holes."""
        x, y, z = self.refined
        return self.samples * x * y * z

    @property
    def thin(self) -> float:
        """Thinness of the wall relative to the steps: 1 for a wall of one step."""
        if not self.solid.hollow:
            return 0.0
        longest = max(side / parts for side, parts in zip(self.sides_mm, self.divisions, strict=True))
        return min(1.0, max(0.0, 4.0 - 3.0 * self.solid.hollow / longest))

    @property
    def has_rims(self) -> bool:
        return self.divisions != (1, 1, 1) or self.refined != (1, 1, 1) or self.thin > 0 or self.slots > 1

    @property
    def faces(self) -> int:
        """Number of triangles of the parts."""
        solid = self.solid
        steps = [side / parts for side, parts in zip(self.sides_mm, self.divisions, strict=True)]
        x, y, z = (parts * more for parts, more in zip(self.divisions, self.refined, strict=True))
        faces = self.plain_faces * (x * y + y * z + z * x) / 3
        share = 1.0
        if solid.hollow:
            share += RATIOS.inner if self.is_label else RATIOS.rough_inner
            share *= 1.0 + RATIOS.thin * self.thin
        share += RATIOS.section * len(solid.cuts) + RATIOS.touching * (self.slots > 1)
        if solid.pegs is not None:
            step = min(max(steps), solid.pegs.diameter / PER_HOLE)
            squares = math.pi * solid.pegs.diameter * solid.pegs.length / (step * step)
            faces += RATIOS.pegs * squares * solid.pegs.count * len(solid.cuts)
        return int(faces * share)

    @property
    def is_made_twice(self) -> bool:
        return bool(self.solid.thicken and self.solid.hollow)

    @property
    def memory(self) -> int:
        """Peak bytes."""
        sample = RATIOS.sample_bytes + RATIOS.again_bytes * self.is_made_twice
        sample += RATIOS.slot_bytes * self.slots if self.slots > 1 else 0
        face = RATIOS.face_bytes + RATIOS.rim_bytes * self.has_rims + RATIOS.touching_bytes * (self.slots > 1)
        return RATIOS.started_bytes + int(sample * self.all_samples) + face * self.faces

    @property
    def work(self) -> float:
        making = RATIOS.making * self.faces * (1.0 + RATIOS.rims * self.has_rims)
        times = (1 + self.is_made_twice) * (RATIOS.tries if self.slots > 1 else 1.0)
        return RATIOS.started + RATIOS.sampling * self.all_samples + making * times


def solid_cost(estimates: Sequence[CostEstimate], solid: SolidRequest, most_voxels: int) -> SolidCost:
    """Predict the cost of the parts made from counted surfaces.

    Parameters
    ----------
    estimates : sequence of CostEstimate
    solid : SolidRequest
    most_voxels : int
        Voxels of the region that all structures lie in, at the stride.
    """
    first = estimates[0]
    sharing = solid.combinations or share_walls([estimate.settings for estimate in estimates])
    if len(estimates) > 1 and sharing:
        voxels = min(most_voxels, sum(estimate.voxels for estimate in estimates))
        faces = sum(estimate.faces for estimate in estimates)
        slots = min(len(estimates), RATIOS.slots)
        groups = [_Group(solid, first.sides_mm, _samples(voxels, first.sides_mm, solid), slots, faces, True)]
    else:
        groups = [
            _Group(
                solid,
                each.sides_mm,
                _samples(each.voxels, each.sides_mm, solid),
                1,
                each.faces,
                each.settings.label is not None,
            )
            for each in estimates
        ]
    faces = sum(group.faces for group in groups)
    return SolidCost(faces, max(group.memory for group in groups), sum(group.work for group in groups))


def require_memory(
    budget: Budget, solid: SolidRequest, sides_mm: tuple[float, float, float], samples: int, slots: int, faces: int
) -> None:
    """Raise a `MemoryLimitError` if parts on a lattice do not fit, with a stride that would.

    Parameters
    ----------
    budget : Budget
    solid : SolidRequest
    sides_mm : (x, y, z) float
        Steps of the samples that the surfaces were extracted from.
    samples : int
        Samples of the lattice.
    slots : int
    faces : int
        Triangles of all surfaces.
    """

    def needed(times: int) -> int:
        x, y, z = (times * side for side in sides_mm)
        return _Group(
            solid, (x, y, z), samples // times // times // times, slots, faces // times // times, False
        ).memory

    def remedy(available: int) -> str:
        times = next((times for times in range(2, 5) if needed(times) <= available), None)
        return "choose a region" if times is None else f"choose a region or a stride {times} times as wide"

    budget.require(needed(1), "the parts of a solid", remedy)


def _samples(voxels: int, sides_mm: tuple[float, float, float], solid: SolidRequest) -> int:
    """Return about how many samples the lattice around a box of voxels has, as if it were a cube."""
    along = float(cube_root(voxels))
    samples = 1.0
    for side, parts in zip(sides_mm, divisions(sides_mm, solid), strict=True):
        samples *= parts * (along + 2 * margin_of(solid) / side) + 2 * AROUND
    return int(samples)
