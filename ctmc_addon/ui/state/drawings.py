# SPDX-License-Identifier: GPL-3.0-or-later
"""The masks of drawn structures. The file holds their slices packed; the masks here are made of those.

So nothing is lost that Blender does not lose: undo and redo bring back other slices, and `follow_file` unpacks those
that differ. While a stroke is drawn its mask is ahead of the file, until `store` or `revert`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import bpy
import numpy as np

from ...core import Volume
from ...core.segmentation import Change, Mask, Window, packed_slices, unpack_into, window_of
from ...core.volume import ValueKind, linear, structure_color
from . import change_events, session, volumes

_revisions = count(1)


@dataclass
class Drawn:
    """A structure in memory.

    Parameters
    ----------
    unpacked : dict of int to bytes
        The slices of the file that the mask was made of.
    revision : int
        Another number after every change of the mask; what shows it asks whether it has shown this one.
    grown : tuple or None
        The clicks and settings of the last Grow, and what came of them, which the next click changes.
    """

    mask: Mask
    unpacked: dict[int, bytes] = field(default_factory=dict)
    revision: int = 0
    grown: tuple[Any, Change] | None = None


_strokes: list[Any] = []  # the operator whose stroke is being drawn
_drawn: dict[tuple[int, int], Drawn] = {}  # by session_uid of the scene, and number of the structure


def structures(scene: bpy.types.Scene) -> Iterator[Any]:
    """Yield the structures that were drawn on the scene's CT."""
    fingerprint = scene.ctmc.volume_fingerprint
    yield from (item for item in scene.ctmc_draw.structures if fingerprint and item.fingerprint == fingerprint)


def active(scene: bpy.types.Scene) -> Any | None:
    """Return the structure that is drawn on; None where there is none of the scene's CT."""
    drawing = scene.ctmc_draw
    if not 0 <= drawing.index < len(drawing.structures):
        return None
    item = drawing.structures[drawing.index]
    return item if item.fingerprint == scene.ctmc.volume_fingerprint else None


def add(scene: bpy.types.Scene, name: str) -> Any:
    """Add an empty structure and make it the active one; a name that is taken gets a number."""
    drawing = scene.ctmc_draw
    taken = {item.name for item in drawing.structures}
    names = (name if not number else f"{name} {number + 1}" for number in count())
    number = max((item.number for item in drawing.structures), default=0) + 1
    item = drawing.structures.add()
    item.number, item.fingerprint = number, scene.ctmc.volume_fingerprint
    item.name = next(one for one in names if one not in taken)
    item.color = linear(structure_color(number, None, item.name).rgb)
    drawing.index = len(drawing.structures) - 1
    return item


def remove(scene: bpy.types.Scene, item: Any) -> None:
    """Remove a structure; the one before it becomes the active one."""
    drawing = scene.ctmc_draw
    place = next(at for at, one in enumerate(drawing.structures) if one.number == item.number)
    _drawn.pop((scene.session_uid, item.number), None)
    drawing.structures.remove(place)
    drawing.index = max(0, min(drawing.index, len(drawing.structures) - 1))
    change_events.notify(scene.ctmc, change_events.DRAWN)


def of(scene: bpy.types.Scene, item: Any) -> Drawn:
    """Return a structure in memory, made of the file where it is not there yet; the scene's CT must be loaded."""
    key, volume = (scene.session_uid, item.number), volumes.require_loaded(scene).volume
    drawn = _drawn.get(key)
    if drawn is None or drawn.mask.shape != volume.shape:
        drawn = _drawn[key] = Drawn(np.zeros(volume.shape, bool))
        take(drawn, item)
    return drawn


def take(drawn: Drawn, item: Any) -> bool:
    """Bring a mask to what the file has of it; return whether anything had changed."""
    content = {entry.number: entry.content for entry in item.slices}
    numbers = content.keys() | drawn.unpacked.keys()
    changed = {n: content.get(n, b"") for n in numbers if content.get(n, b"") != drawn.unpacked.get(n, b"")}
    if changed or not drawn.revision:
        unpack_into(drawn.mask, changed)
        drawn.unpacked, drawn.revision = content, next(_revisions)
    return bool(changed)


def store(scene: bpy.types.Scene, item: Any, numbers: Iterable[int]) -> None:
    """Put slices of a mask that have changed into the file."""
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
    drawn.revision = next(_revisions)
    change_events.notify(scene.ctmc, change_events.DRAWN)


def touched(drawn: Drawn) -> None:
    """Note that a mask has changed and is ahead of the file, within a stroke."""
    drawn.revision = next(_revisions)


def begin_stroke(operator: Any) -> None:
    """Note that a stroke is being drawn: its mask is ahead of the file."""
    _strokes.append(operator)


def end_stroke(operator: Any) -> None:
    """Note that it is done, or cancelled."""
    if operator in _strokes:
        _strokes.remove(operator)


def stroke_under_way() -> bool:
    """Return whether a stroke is being drawn."""
    return bool(_strokes)


def revert(scene: bpy.types.Scene, item: Any, numbers: Iterable[int]) -> None:
    """Bring slices of a mask back to what the file has: a stroke is cancelled."""
    drawn = of(scene, item)
    unpack_into(drawn.mask, {number: drawn.unpacked.get(number, b"") for number in numbers})
    touched(drawn)


def replace(scene: bpy.types.Scene, item: Any, window: Window, part: Mask) -> int:
    """Put another part into a structure, in the file too; return how many voxels have changed."""
    drawn = of(scene, item)
    before = drawn.mask[window]
    differs = (before != part).any(axis=(1, 2))
    voxels = int((before != part).sum())
    drawn.mask[window] = part
    store(scene, item, (np.flatnonzero(differs) + window[0].start).tolist())
    return voxels


def window_in(scene: bpy.types.Scene, item: Any) -> Window | None:
    """Return the window of a mask that holds all of it; None where it is empty."""
    drawn = of(scene, item)
    numbers = [number for number, content in drawn.unpacked.items() if content]
    if not numbers:
        return None
    low, high = min(numbers), max(numbers) + 1
    inner = window_of(drawn.mask[low:high])
    return None if inner is None else (slice(low + inner[0].start, low + inner[0].stop), *inner[1:])


def ml_of(scene: bpy.types.Scene, item: Any) -> float:
    """Return the volume of a structure, ml."""
    window = window_in(scene, item)
    spacing = volumes.require_loaded(scene).volume.spacing
    voxels = 0 if window is None else int(np.count_nonzero(of(scene, item).mask[window]))
    return voxels * float(np.prod(spacing)) / 1000


def label_volume(mask: Mask, volume: Volume) -> Volume:
    """Return a mask as a volume of labels 0 and 1 on the grid of a CT; it shares the mask's memory."""
    return Volume(mask.view(np.uint8), volume.affine, (), volume.name, ValueKind.LABEL)


def follow_file(*_: Any) -> None:
    """Bring all masks to what the file has, after undo or redo."""
    scenes = {scene.session_uid: scene for scene in bpy.data.scenes}
    changed = set()
    for (uid, number), drawn in list(_drawn.items()):
        scene = scenes.get(uid)
        item = scene and next((one for one in scene.ctmc_draw.structures if one.number == number), None)
        if scene is None or item is None:
            del _drawn[uid, number]
            changed.add(uid)
        elif take(drawn, item):
            changed.add(uid)
    for uid in changed & scenes.keys():
        change_events.notify(scenes[uid].ctmc, change_events.DRAWN)
    if changed:
        session.redraw_viewports()


def clear(*_: Any) -> None:
    """Release all masks, as another file is loaded."""
    _drawn.clear()


HANDLERS = {"undo_post": follow_file, "redo_post": follow_file, "load_pre": clear}


def register() -> None:
    """Listen for undo and for another file."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(bpy.app.handlers.persistent(handler))


def unregister() -> None:
    """Stop listening, and release all masks."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    clear()
