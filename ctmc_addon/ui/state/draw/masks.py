# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the masks of drawn structures in memory, with their CT, unpacked from the slices in the file.

Blender's undo and redo thus cover drawings: they restore other slices, and `follow_file` unpacks those that differ.
While a stroke is drawn its mask is ahead of the file, until `store` or `revert`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from itertools import count
from typing import Any

import bpy
import numpy as np

from ....core import Volume
from ....core.segmentation import Flags, Window, packed_slices, unpack_into, window_of
from ....core.volume import ValueKind
from .. import change_events
from ..ct import volumes
from .drawn import Drawn

_revisions = count(1)
_strokes: list[Any] = []  # The operator whose stroke is being drawn.


def voxels_of(scene: bpy.types.Scene, key: str) -> Volume | None:
    """Return a drawn structure as labels; None if nothing was drawn under this key or its CT is not loaded."""
    if volumes.loaded(scene) is None or volumes.is_coarse(scene):
        return None
    fingerprint = scene.ctmc.volume_fingerprint
    item = next(
        (each for each in scene.ctmc_draw.structures if (each.key, each.fingerprint) == (key, fingerprint)), None
    )
    return None if item is None else of(scene, item).labels


def of(scene: bpy.types.Scene, item: Any) -> Drawn:
    """Return a structure in memory, unpacked from the file if needed; its CT must be loaded."""
    key, ct = (scene.session_uid, item.key), volumes.require_ct(item.fingerprint)
    if key not in ct.drawn:
        mask = np.zeros(ct.volume.shape, bool)
        ct.drawn[key] = Drawn(mask, label_volume(mask, ct.volume))
        take(ct.drawn[key], item)
    return ct.drawn[key]


def take(drawn: Drawn, item: Any) -> bool:
    """Update a mask from the file, in a copy because work in progress may read it; return whether it had changed."""
    content = {entry.number: entry.content for entry in item.slices}
    numbers = content.keys() | drawn.unpacked.keys()
    changed = {n: content.get(n, b"") for n in numbers if content.get(n, b"") != drawn.unpacked.get(n, b"")}
    if changed or not drawn.revision:
        mask = drawn.mask.copy()
        unpack_into(mask, changed)
        drawn.mask, drawn.unpacked = mask, content
        drawn.labels = label_volume(mask, drawn.labels)
        _is_stored(drawn)
    return bool(changed)


def store(scene: bpy.types.Scene, item: Any, numbers: Iterable[int]) -> None:
    """Store changed slices of a mask in the file."""
    drawn = of(scene, item)
    places = {entry.number: at for at, entry in enumerate(item.slices)}
    for number, content in packed_slices(drawn.mask, numbers).items():
        if content == drawn.unpacked.get(number, b""):
            continue
        if number not in places:
            places[number] = len(item.slices)
            item.slices.add().number = number
        item.slices[places[number]].content = content
        drawn.unpacked[number] = content
    _is_stored(drawn)
    change_events.notify(scene.ctmc, change_events.DRAWN)


def _is_stored(drawn: Drawn) -> None:
    """Mark a mask as equal to the slices of the file."""
    drawn.labels, drawn.revision, drawn.hash = dataclasses.replace(drawn.labels), next(_revisions), ""


def touched(drawn: Drawn) -> None:
    """Note a change within a stroke that the file does not have yet."""
    drawn.revision = next(_revisions)


def begin_stroke(operator: Any) -> None:
    """Note that a stroke has begun: its mask is ahead of the file."""
    _strokes.append(operator)


def end_stroke(operator: Any) -> None:
    """Note that the stroke has ended."""
    if operator in _strokes:
        _strokes.remove(operator)


def stroke_under_way() -> bool:
    """Return whether a stroke is being drawn."""
    return bool(_strokes)


def revert(scene: bpy.types.Scene, item: Any, numbers: Iterable[int]) -> None:
    """Restore slices of a mask from the file, because a stroke is cancelled."""
    drawn = of(scene, item)
    unpack_into(drawn.mask, {number: drawn.unpacked.get(number, b"") for number in numbers})
    touched(drawn)


def replace(scene: bpy.types.Scene, item: Any, window: Window, part: Flags) -> None:
    """Replace a window of a structure, in the file too."""
    drawn = of(scene, item)
    differs = (drawn.mask[window] != part).any(axis=(1, 2))
    drawn.mask[window] = part
    store(scene, item, (np.flatnonzero(differs) + window[0].start).tolist())


def window_in(scene: bpy.types.Scene, item: Any) -> Window | None:
    """Return the smallest window of a mask that holds all of it; None if it is empty."""
    drawn = of(scene, item)
    numbers = [number for number, content in drawn.unpacked.items() if content]
    if not numbers:
        return None
    low, high = min(numbers), max(numbers) + 1
    inner = window_of(drawn.mask[low:high])
    return None if inner is None else (slice(low + inner[0].start, low + inner[0].stop), *inner[1:])


def mm3_of(scene: bpy.types.Scene, item: Any) -> float:
    """Return the volume of a structure, mm3."""
    window = window_in(scene, item)
    voxels = 0 if window is None else int(np.count_nonzero(of(scene, item).mask[window]))
    return voxels * volumes.require_loaded(scene).volume.voxel_mm3


def label_volume(mask: Flags, volume: Volume) -> Volume:
    """Return a mask as a volume of labels 0 and 1 on the grid of a CT; it shares the mask's memory."""
    return Volume(mask.view(np.uint8), volume.affine, (), volume.name, ValueKind.LABEL)
