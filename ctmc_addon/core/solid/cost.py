# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict time and memory of a solid's parts from counted surfaces, before any surface is made.

The lattice is that around the counted box, with steps divided as for the parts. Triangles grow with its area; seconds
are multiples of a unit of extraction, corrected by the last solid that was made in this process (`planning.rates`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..planning.counted_surface import CostEstimate
from ..planning.rates import CALIBRATION
from ..reconstruction import Reconstruction
from ..surfaces.request import share_walls
from .fields.lattice import AROUND
from .parts import MAKING
from .printing.printed import PRINTING
from .request import SolidRequest
from .structure import PER_HOLE, longest_step, margin_of

SOLID = "solid"
"""The way, among those of `planning.rates`, whose stages are learned here."""


@dataclass(frozen=True)
class SolidRatios:
    """Work for a solid in multiples of extracting a triangle of the ball, and what its parts have of triangles.

    Measured on a vertebra, a hip, a liver and the bone of a thorax, hollow, cut and pegged.

    Parameters
    ----------
    sampling, making, printing : float
        For a sample of the lattice, and for a triangle of the parts.
    inner : float
        Surface of a hollow, as a share of the outer one.
    thin : float
        Further share of triangles where a wall is as thin as a step, falling to none at 4/3 of it: two surfaces pass
        through most cells there.
    section : float
        Triangles of a cut, as a share of the surface.
    rim : float
        Triangles of a square of a step on pegs and holes.
    sample_bytes, slot_bytes, face_bytes : int
        Bytes for a sample, for a sample of each further slot, for a triangle of the parts.
    slots : int
        Structures that meet in one place, at most.
    """

    sampling: float = 1.0
    making: float = 270.0
    printing: float = 120.0
    inner: float = 0.85
    thin: float = 0.9
    section: float = 0.25
    rim: float = 12.0
    sample_bytes: int = 14
    slot_bytes: int = 4
    face_bytes: int = 600
    slots: int = 12


RATIOS = SolidRatios()
GIB = 1 << 30


@dataclass(frozen=True)
class SolidCost:
    """What the parts of a solid cost beside the surfaces that they are made of.

    Parameters
    ----------
    samples : int
        Of all lattices.
    faces : int
        Triangles of all parts before simplification.
    memory : int
        Peak of making them, bytes.
    """

    samples: int
    faces: int
    memory: int

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
        """Return why the parts cannot be made in so many bytes, and what would help; empty if they fit."""
        if available is None or self.memory <= available:
            return ""
        needed, there = self.memory / GIB, available / GIB
        return (
            f"the parts of this solid would need {needed:.1f} GiB of memory and {there:.1f} GiB are available; "
            "choose a region, a larger stride or fewer structures"
        )

    @property
    def _expected(self) -> dict[str, float]:
        making = RATIOS.sampling * self.samples + RATIOS.making * self.faces
        return {MAKING: CALIBRATION.unit * making, PRINTING: CALIBRATION.unit * RATIOS.printing * self.faces}

    def learn(self, parts: Sequence[Reconstruction]) -> None:
        """Correct the next prediction by the seconds of these parts, which were made as predicted."""
        making = {stage for part in parts for stage in part.stages if stage.name == MAKING}  # Once for each group.
        printing = [stage for part in parts for stage in part.stages if stage.name == PRINTING]
        for name, stages in ((MAKING, making), (PRINTING, printing)):
            taken, expected = sum(stage.seconds for stage in stages), self._expected[name]
            if taken and expected:
                CALIBRATION.learned[SOLID, name] = taken / expected


def making_bytes(samples: int, slots: int, faces: int) -> int:
    """Return the bytes that making parts on one lattice takes, beside the surfaces of their structures."""
    slot_bytes = RATIOS.slot_bytes * slots if slots > 1 else 0
    return samples * (RATIOS.sample_bytes + slot_bytes) + faces * RATIOS.face_bytes


def solid_cost(estimates: Sequence[CostEstimate], solid: SolidRequest, most_voxels: int) -> SolidCost:
    """Predict the cost of the parts of surfaces that were counted.

    Parameters
    ----------
    estimates : sequence of CostEstimate
    solid : SolidRequest
    most_voxels : int
        Voxels of the region that all structures lie in, at the stride.
    """
    each = [(_samples(estimate.voxels, estimate, solid), _faces(estimate, solid)) for estimate in estimates]
    faces = sum(own for _, own in each)
    if len(estimates) > 1 and (solid.combinations or share_walls([estimate.settings for estimate in estimates])):
        voxels = min(most_voxels, sum(estimate.voxels for estimate in estimates))
        samples = _samples(voxels, estimates[0], solid)
        return SolidCost(samples, faces, making_bytes(samples, min(len(each), RATIOS.slots), faces))
    memory = max(making_bytes(samples, 1, own) for samples, own in each)
    return SolidCost(sum(samples for samples, _ in each), faces, memory)


def _divisions(estimate: CostEstimate, solid: SolidRequest) -> tuple[float, float, float]:
    """Return into how many steps of the lattice a step of the surface is divided along x, y and z, on average."""
    longest, along = longest_step(estimate.sides_mm, solid), math.cbrt(estimate.voxels)
    holes = [(drain.diameter, drain.diameter, 1 if drain.point is not None else 2) for drain in solid.drains]
    if solid.pegs is not None:
        holes.append((solid.pegs.diameter, solid.pegs.length, solid.pegs.count * len(solid.cuts)))
    divisions = []
    for side in estimate.sides_mm:
        parts = max(1, math.ceil(side / longest - 1e-6))
        finest, more = 1, 0.0
        for width, length, count in holes:
            finer = max(1, math.ceil(PER_HOLE * side / (parts * width) - 1e-6))
            more += (finer - 1) * count * (length / side + 2) / along
            finest = max(finest, finer)
        divisions.append(parts * min(1.0 + more, float(finest)))
    x, y, z = divisions
    return x, y, z


def _samples(voxels: int, estimate: CostEstimate, solid: SolidRequest) -> int:
    """Return the samples of the lattice around a box of voxels, about as if it were a cube."""
    along = math.cbrt(voxels)
    margin = margin_of(solid)
    samples = 1.0
    for side, parts in zip(estimate.sides_mm, _divisions(estimate, solid), strict=True):
        samples *= parts * (along + 2 * margin / side) + 2 * AROUND
    return int(samples)


def _faces(estimate: CostEstimate, solid: SolidRequest) -> int:
    """Return the triangles of the parts of one surface."""
    x, y, z = _divisions(estimate, solid)
    steps = [side / parts for side, parts in zip(estimate.sides_mm, (x, y, z), strict=True)]
    faces = estimate.faces * (x * y + y * z + z * x) / 3
    share = 1.0
    if solid.hollow:
        share += RATIOS.inner
        share *= 1.0 + RATIOS.thin * min(1.0, max(0.0, 4.0 - 3.0 * solid.hollow / max(steps)))
    share += RATIOS.section * len(solid.cuts)
    if solid.pegs is not None:
        step = min(max(steps), solid.pegs.diameter / PER_HOLE)
        squares = math.pi * solid.pegs.diameter * solid.pegs.length / (step * step)
        faces += RATIOS.rim * squares * solid.pegs.count * len(solid.cuts)
    return int(faces * share)
