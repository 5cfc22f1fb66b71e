# SPDX-License-Identifier: GPL-3.0-or-later
"""The solid of the panel: what is asked of core, and the box of its structures, RAS+ mm.

The box is looked for again only when it may have changed, because the viewport asks at every redraw.
"""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ....core import ReconstructionSettings, SettingsError
from ....core.solid import SolidRequest
from ....core.volume import ValueKind, labels_region, region_corners, volume_box
from ...properties.surface.structures import LABEL, of_structure, structure_choices
from .. import session
from ..ct import volumes
from . import structures


def box_of(scene: bpy.types.Scene) -> NDArray[np.float64] | None:
    """Return the corners (8, 3) around the ticked labels, else of the region or the CT; None without a CT."""
    volume, settings = volumes.current_full(scene) or volumes.current(scene), scene.ctmc
    if volume is None:
        return None
    labels = structures.label_volume(scene) if settings.use_label else None
    ticked = [item for item in settings.labels if item.chosen]
    if labels is not None and labels.kind == ValueKind.LABEL and ticked and all(item.kind == LABEL for item in ticked):
        values = tuple(item.value for item in ticked)
        kept = session.of(scene)
        if kept.box is None or kept.box[0] is not labels or kept.box[1] != values:
            kept.box = (labels, values, region_corners(labels, labels_region(labels, values, "mm"), "mm"))
        return kept.box[2]
    if settings.use_region:
        return region_corners(volume, tuple(settings.region), settings.region_unit)
    return volume_box(volume)


def runs_of(scene: bpy.types.Scene, solid: SolidRequest) -> list[ReconstructionSettings]:
    """Return the settings of every surface of the panel, and of the labels that combinations of `solid_of` name.

    Raises
    ------
    SettingsError
        If settings contradict each other, no structure is ticked, or there are no structures to combine.
    """
    stored, names = scene.ctmc, {name for combination in solid.combinations for name in combination.of}
    if solid and stored.simplifier == "decimate" and stored.to_settings().simplifies:
        raise SettingsError("Decimate would move the cuts of a solid; choose Built-In, or remove the solid")
    if not names:
        runs: list[ReconstructionSettings] = stored.all_settings()
        return runs
    if not stored.use_label:
        raise SettingsError("a threshold has no structures to combine; choose Structures, or remove the combinations")
    settings = stored.to_settings()
    runs = [
        of_structure(item, settings)
        for item in stored.labels
        if item.chosen or (item.kind == LABEL and str(item.value) in names)
    ]
    if not runs:
        raise SettingsError("no structure is ticked; tick one in the list")
    return runs


def counted_runs(scene: bpy.types.Scene) -> list[ReconstructionSettings]:
    """Return the settings of the surfaces whose cost is counted: without the solid while that is contradictory.

    Raises
    ------
    SettingsError
        If settings of surfaces contradict each other, or no structure is ticked.
    """
    try:
        return runs_of(scene, solid_of(scene))
    except SettingsError:
        runs: list[ReconstructionSettings] = scene.ctmc.all_settings()
        return runs


def solid_of(scene: bpy.types.Scene) -> SolidRequest:
    """Return the panel's solid, whose combinations name labels by their numbers: the list may call them otherwise.

    Raises
    ------
    SettingsError
        If two settings contradict each other.
    """
    solid: SolidRequest = scene.ctmc_solid.to_request()
    numbers = {key: str(item.value) for key, item in structure_choices(scene.ctmc)}
    numbered = [replace(each, of=tuple(numbers.get(name, name) for name in each.of)) for each in solid.combinations]
    return replace(solid, combinations=tuple(numbered))
