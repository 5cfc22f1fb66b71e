# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the voxels of a scene's structures: one label volume on the grid of its CT, combined from all sources.

The list `scene.ctmc.labels` and the sources `scene.ctmc.label_sources` are the file's, so undo, saving and opening need
nothing here; the voxels of a source are kept with the CT, by the source's key. What is combined is derived from both.

A structure from elsewhere is a source without a path: `add_labels(scene, labels, key)`. The voxels of a drawn
structure are its mask.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from .... import readers
from ....blender.colors import color_of
from ....core import CtmcError, LabelError, ReconstructionSettings, Stages, Steps, Volume, equal_part, finish
from ....core.volume import (
    ValueKind,
    combined_labels,
    free_offset,
    label_extents_steps,
    not_a_label_steps,
    placed_labels_steps,
    volume_statistics_steps,
)
from ....readers import ReadingOptions
from ...properties.preferences import machine
from ...properties.surface.structures import LABEL
from .. import session
from ..ct import volumes
from ..ct.stored_paths import stored_path
from ..draw import masks

STAGES = {"Reading headers": 10, "Reading values": 60, "Placing the labels": 20, "Counting the labels": 10}


class PlacedLabels(NamedTuple):
    """Labels on the grid of a CT, their file, and the key that identifies them."""

    path: Path
    labels: Volume
    key: str


def voxels_of(scene: bpy.types.Scene, key: str) -> Volume | None:
    """Return the voxels of a source of a scene; None if they are not in memory."""
    ct = volumes.loaded(scene)
    return None if ct is None else ct.labels.get(key) or masks.voxels_of(scene, key)


def label_volume(scene: bpy.types.Scene) -> Volume | None:
    """Return the labels of a scene's CT on its grid: its own if it is a label volume, and all added ones.

    None if no labels are in memory.
    """
    ct = volumes.loaded(scene)
    if ct is None:
        return None
    own = [(ct.full, 0)] if ct.volume.kind == ValueKind.LABEL else []
    sources = [(voxels_of(scene, source.key), source.offset) for source in scene.ctmc.label_sources]
    added = [(volume, offset) for volume, offset in sources if volume is not None]
    if not added:
        return own[0][0] if own else None
    parts, kept = own + added, session.of(scene)
    if kept.labels is None or kept.labels[0] != parts:
        kept.labels = (parts, combined_labels(parts))
    return kept.labels[1]


def named_labels(scene: bpy.types.Scene) -> Volume | None:
    """Return the labels of the scene's CT, with the names of the list; None without any."""
    volume = label_volume(scene)
    if volume is None or volume.kind != ValueKind.LABEL:
        return None
    names = {item.value: item.name for item in scene.ctmc.labels if item.kind == LABEL and item.name}
    return replace(volume, label_names={**volume.label_names, **names})


def volume_of(scene: bpy.types.Scene, settings: ReconstructionSettings) -> Volume | None:
    """Return the volume of a surface with these settings: the labels, or the values of the CT.

    Parameters
    ----------
    settings : ReconstructionSettings
        Only the label matters.
    """
    labels = label_volume(scene) if settings.label is not None else None
    return labels or volumes.current_full(scene)


def shown_volume_of(scene: bpy.types.Scene, settings: ReconstructionSettings) -> Volume | None:
    """Return the volume as `volume_of` does, but the coarse copy of a CT that does not fit in memory."""
    return volumes.current(scene) if volumes.is_coarse(scene) else volume_of(scene, settings)


def require_volume_of(scene: bpy.types.Scene, settings: ReconstructionSettings) -> Volume:
    """Return the volume of a surface with these settings.

    Raises
    ------
    LabelError
        If its label is from a file that is not in memory.
    ReadError
        If the CT is not in memory.
    """
    item = scene.ctmc.structure_of(settings)
    if item is not None and item.source and voxels_of(scene, item.source) is None:
        raise LabelError(f"the labels of {item.name or settings.label} are not in memory; press Load Again")
    return volume_of(scene, settings) or volumes.require_loaded(scene).full


def origin_of(scene: bpy.types.Scene, item: Any) -> tuple[str, int]:
    """Return the file of a label of the list, and its number there; no path for other labels."""
    source = next((each for each in scene.ctmc.label_sources if item is not None and each.key == item.source), None)
    return ("", 0) if source is None else (bpy.path.abspath(source.path), item.value - source.offset)


def missing(scene: bpy.types.Scene) -> list[Any]:
    """Return the sources of the file that this session has not read."""
    return [source for source in scene.ctmc.label_sources if voxels_of(scene, source.key) is None]


def read_steps(path: Path, ct: Volume) -> Steps[PlacedLabels]:
    """Read labels and place them on the grid of a CT.

    Raises
    ------
    LabelError
        If the file holds gray values.
    VolumeError
        If the labels do not lie on the grid.
    """
    stages = Stages(STAGES)
    headers, reading, placing, counting = STAGES
    source = yield from stages.run(headers, readers.open_volume_steps(path))
    labels = yield from stages.run(reading, source.read_steps(ReadingOptions(), budget=machine().budget))
    if labels.kind != ValueKind.LABEL:
        value = yield from not_a_label_steps(labels)
        if value:
            what = labels.kind.plural
            raise LabelError(f"{labels.name} holds {what}, such as {value}, and not labels; load it as a CT")
        raise LabelError(f"{labels.name} holds {labels.kind} and not labels; load it as a CT")
    if not source.has_geometry and labels.shape == ct.shape:  # Such as slices painted over those of the CT.
        labels = replace(labels, affine=ct.affine)
    placed = yield from stages.run(placing, placed_labels_steps(labels, ct))
    statistics = yield from stages.run(counting, volume_statistics_steps(placed))
    if not placed.label_names and len(statistics.labels) == 1:  # A mask is named after its file.
        placed = replace(placed, label_names={statistics.labels[0][0]: labels.name})
    return PlacedLabels(path, placed, statistics.fingerprint)


def read_again_steps(sources: Sequence[tuple[str, Path]], ct: Volume) -> Steps[list[tuple[str, PlacedLabels | str]]]:
    """Reload the labels of sources, each with its key; an error message replaces labels that cannot be read."""
    out: list[tuple[str, PlacedLabels | str]] = []
    for number, (key, path) in enumerate(sources):
        try:
            out.append((key, (yield from equal_part(read_steps(path, ct), number, len(sources)))))
        except CtmcError as error:
            out.append((key, str(error)))
    return out


def put(scene: bpy.types.Scene, key: str, labels: Volume) -> None:
    """Store the voxels of a source with the scene's CT, replacing earlier ones."""
    volumes.require_loaded(scene).labels[key] = labels


def add_labels(scene: bpy.types.Scene, labels: Volume, key: str, path: Path | None = None) -> list[Any]:
    """Add labels on the grid of the scene's CT to its structures; return their lines of the list, not ticked.

    Parameters
    ----------
    labels : Volume
        Result of `placed_labels_steps`; its `label_names` and `label_colors` go to the list.
    key : str
        A key that no other source of the scene has.
    path : Path, optional
        The file of the labels, to reload them with the .blend; without one they are not reloaded.
    """
    stored = scene.ctmc
    values = list(finish(label_extents_steps(labels)))
    used = [item.value for item in stored.labels if item.kind == "label"]
    offset = free_offset(used, values)
    put(scene, key, labels)
    source = stored.label_sources.add()
    source.key, source.offset = key, offset
    source.path = "" if path is None else stored_path(path)
    names, colors = labels.label_names, labels.label_colors
    lines = [
        (value + offset, names.get(value, ""), color_of(value + offset, colors.get(value), names.get(value, "")))
        for value in values
    ]
    return list(stored.add_labels(lines, key))
