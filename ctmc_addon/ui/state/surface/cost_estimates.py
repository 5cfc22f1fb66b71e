# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the cost of the panel's settings for all surfaces; finished surfaces improve the next estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ....core import (
    CALIBRATION,
    CostEstimate,
    CtmcError,
    FieldCache,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Steps,
    cost_estimate_steps,
)
from ....core.solid import SolidCost, solid_cost
from ....core.volume import region_box
from .. import session
from ..ct import volumes


@dataclass(frozen=True)
class CostEstimates:
    """Costs of all surfaces, the settings they hold for, and the reason if they cannot be made.

    `solid` is what its parts cost besides, if there is one.
    """

    settings: tuple[ReconstructionSettings, ...]
    estimates: tuple[CostEstimate, ...] = ()
    error: str = ""
    solid: SolidCost | None = None

    @property
    def voxels(self) -> int:
        """Return how many voxels all surfaces visit."""
        return sum(estimate.voxels for estimate in self.estimates)

    @property
    def faces(self) -> int:
        """Return the number of triangles of all surfaces or parts, before simplification."""
        return sum(estimate.faces for estimate in self.estimates) if self.solid is None else self.solid.faces

    @property
    def memory(self) -> int:
        """Return the memory of the most expensive surface, bytes."""
        needed = max(estimate.memory for estimate in self.estimates)
        return needed if self.solid is None else max(needed, self.solid.memory)

    @property
    def seconds(self) -> float:
        """Return the predicted time of all surfaces together, seconds."""
        surfaces = CALIBRATION.seconds(self.estimates)
        return surfaces if self.solid is None else surfaces + self.solid.seconds

    @property
    def refusal(self) -> str:
        """Return why the surfaces cannot be made, such as too little memory; empty if they can."""
        refusal = self.error or next((estimate.sentence for estimate in self.estimates if not estimate.fits), "")
        return refusal if refusal or self.solid is None else self.solid.refusal(self.estimates[0].available)


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


def of_scene(scene: Any) -> CostEstimates | None:
    """Return the counted cost of a scene's settings, with that of the panel's solid; None before it is counted."""
    cost: CostEstimates | None = session.of(scene).cost
    try:
        solid = scene.ctmc_solid.to_request()
    except SettingsError:  # The panel says why.
        return cost
    loaded = volumes.loaded(scene)
    if cost is None or not solid or not cost.estimates or loaded is None:
        return cost
    settings = cost.settings[0]
    inside = math.prod(stop - start for start, stop in region_box(loaded.volume, settings))
    voxels = inside // math.prod(settings.stride)
    return replace(cost, solid=solid_cost(cost.estimates, solid, voxels))


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


def learn_solid(scene_uid: int, parts: Sequence[Reconstruction]) -> None:
    """Correct the next estimate by the seconds of these parts, if the cost of their solid was predicted."""
    scene = session.scene_of(scene_uid)
    cost = None if scene is None else of_scene(scene)
    if cost is not None and cost.solid is not None:
        cost.solid.learn(parts)
