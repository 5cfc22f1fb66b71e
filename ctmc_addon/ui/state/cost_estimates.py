# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the cost of the panel's settings for all surfaces; finished surfaces improve the next estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...core import (
    CALIBRATION,
    CostEstimate,
    CtmcError,
    FieldCache,
    Reconstruction,
    ReconstructionSettings,
    Steps,
    cost_estimate_steps,
)
from . import session


@dataclass(frozen=True)
class CostEstimates:
    """Costs of all surfaces, the settings they hold for, and the reason if they cannot be made."""

    settings: tuple[ReconstructionSettings, ...]
    estimates: tuple[CostEstimate, ...] = ()
    error: str = ""

    @property
    def voxels(self) -> int:
        """Return how many voxels all surfaces visit."""
        return sum(estimate.voxels for estimate in self.estimates)

    @property
    def faces(self) -> int:
        """Return the number of triangles of all surfaces, before simplification."""
        return sum(estimate.faces for estimate in self.estimates)

    @property
    def memory(self) -> int:
        """Return the memory of the most expensive surface, bytes."""
        return max(estimate.memory for estimate in self.estimates)

    @property
    def seconds(self) -> float:
        """Return the predicted time of all surfaces together, seconds."""
        return CALIBRATION.seconds(self.estimates)

    @property
    def refusal(self) -> str:
        """Return why the surfaces cannot be made, such as too little memory; empty if they can."""
        return self.error or next((estimate.sentence for estimate in self.estimates if not estimate.fits), "")


def estimate_steps(works: Sequence[tuple[FieldCache, ReconstructionSettings]]) -> Steps[CostEstimates]:
    """Count the cost of surfaces, each with these settings in these fields."""
    estimates: list[CostEstimate] = []
    settings = tuple(surface_settings for _, surface_settings in works)
    try:
        for fields, surface_settings in works:
            estimates.append((yield from cost_estimate_steps(fields, surface_settings)))
    except CtmcError as error:
        return CostEstimates(settings, error=str(error))
    return CostEstimates(settings, tuple(estimates))


def learn(scene_uid: int, results: Sequence[Reconstruction], **seconds: float) -> None:
    """Correct the next estimate by the seconds of these surfaces, if their cost was counted.

    Parameters
    ----------
    scene_uid : int
        session_uid of the scene.
    results : sequence of Reconstruction
    seconds
        As `Calibration.learn` takes them.
    """
    scene = session.scene_of(scene_uid)
    cost = None if scene is None else session.of(scene).cost
    if cost is not None and cost.estimates and cost.settings == tuple(result.settings for result in results):
        CALIBRATION.learn(cost.estimates, results, **seconds)
