# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep drawings in the file: each is a line of the list of structures, and its mask is a source of labels."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Iterator
from itertools import count
from typing import Any

import bpy

from ....core.volume import ValueKind, linear, structure_color
from ...properties.surface.structures import LABEL, filling
from .. import change_events, session
from ..ct import volumes
from ..results import surfaces
from . import masks


def structures(scene: bpy.types.Scene) -> Iterator[Any]:
    """Yield the drawn structures of the scene's CT that are in the list of structures."""
    return structures_of(scene.ctmc)


def structures_of(ct: Any) -> Iterator[Any]:
    """Yield the drawn structures of a CT of a scene, stored as `ct`, that are in its list."""
    fingerprint, sources = ct.volume_fingerprint, {line.source for line in ct.labels}
    for item in ct.id_data.ctmc_draw.structures:
        if fingerprint and item.fingerprint == fingerprint and item.key in sources:
            yield item


def line_of(scene: bpy.types.Scene, item: Any) -> Any:
    """Return the line of a drawn structure in the list of structures: its name, color and label."""
    return next(line for line in scene.ctmc.labels if line.source == item.key)


def drawn_by(scene: bpy.types.Scene, line: Any) -> Any | None:
    """Return the drawing of a line of the list of structures; None for a label from a file, or a threshold."""
    return next((item for item in structures(scene) if item.key == line.source), None)


def active(scene: bpy.types.Scene) -> Any | None:
    """Return the structure that is drawn on: the marked line of the list, if it was drawn."""
    lines, index = scene.ctmc.labels, scene.ctmc.label_index
    return drawn_by(scene, lines[index]) if 0 <= index < len(lines) else None


def add(scene: bpy.types.Scene, name: str) -> Any:
    """Add an empty structure to the list, ticked and marked; a name that is taken gets a number."""
    taken = {line.name for line in scene.ctmc.labels}
    names = (name if not number else f"{name} {number + 1}" for number in count())
    item = scene.ctmc_draw.structures.add()
    item.key, item.fingerprint = f"drawn-{uuid.uuid4().hex}", scene.ctmc.volume_fingerprint
    item.name = next(free for free in names if free not in taken)
    value = _free_value(scene)
    item.color = linear(structure_color(value, None, item.name).rgb)
    line = connect(scene, item)
    scene.ctmc.label_index = len(scene.ctmc.labels) - 1
    line.chosen = True
    return item


def _free_value(scene: bpy.types.Scene) -> int:
    """Return a label that no line of the list and no surface of the CT uses."""
    used = [provenance.settings.label or 0 for _, provenance in surfaces.of_panel(scene)]
    return max([0, *used, *(line.value for line in scene.ctmc.labels)]) + 1


def connect(scene: bpy.types.Scene, item: Any) -> Any:
    """Return the line of a drawing in the list of structures; add it if needed."""
    stored = scene.ctmc
    if not any(source.key == item.key for source in stored.label_sources):
        value = _free_value(scene)
        source = stored.label_sources.add()
        source.key, source.offset = item.key, value - 1
        stored.add_labels([(value, item.name, tuple(item.color))], item.key)
    return line_of(scene, item)


def _connect_all(scene: bpy.types.Scene) -> None:
    """Connect all drawings on the scene's CT, which has just been loaded."""
    if volumes.loaded(scene) is None or volumes.is_coarse(scene):
        return
    for item in scene.ctmc_draw.structures:
        if item.fingerprint == scene.ctmc.volume_fingerprint:
            connect(scene, item)


def take_along(scene: bpy.types.Scene, before: str) -> int:
    """Move the drawings on a CT to the panel's CT, which has the same samples; return the number of structures.

    Parameters
    ----------
    before : str
        Fingerprint of the CT that was drawn on, before it was read again.
    """
    items = [item for item in scene.ctmc_draw.structures if item.fingerprint == before]
    parked = next((scan for scan in scene.ctmc_scans if scan.volume_fingerprint == before), None)
    if parked is None:
        return 0
    earlier = volumes.ct_of(before)
    for item in items:
        item.fingerprint = scene.ctmc.volume_fingerprint
        if earlier is not None:
            earlier.drawn.pop((scene.session_uid, item.key), None)
        line = connect(scene, item)
        at = next((at for at, old in enumerate(parked.labels) if old.source == item.key), None)
        if at is None:
            continue
        old, is_marked = parked.labels[at], at == parked.label_index
        with filling():
            line.opacity, line.opaque = old.opacity, old.opaque
        line.chosen = old.chosen
        if is_marked:
            scene.ctmc.label_index = len(scene.ctmc.labels) - 1
    keys = {item.key for item in items}
    for lines, name in ((parked.labels, "source"), (parked.label_sources, "key")):
        for at in reversed(range(len(lines))):
            if getattr(lines[at], name) in keys:
                lines.remove(at)
    choose(parked, _left_to_choose(parked, of_labels=False))
    return len(items)


def forget(scene: bpy.types.Scene, key: str) -> None:
    """Remove the drawing of a structure whose line was removed."""
    drawing = scene.ctmc_draw
    place = next((at for at, item in enumerate(drawing.structures) if item.key == key), None)
    if place is not None:
        drawing.structures.remove(place)
        for ct in volumes.all_cts():
            ct.drawn.pop((scene.session_uid, key), None)
        change_events.notify(scene.ctmc, change_events.DRAWN)


def remove(scene: bpy.types.Scene, line: Any) -> None:
    """Remove a line of the list with its drawing; the setting `label` is then that of another line.

    Without a line, surfaces are made at a threshold again, but of a volume of labels.
    """
    stored, source = scene.ctmc, line.source
    at = next(at for at, each in enumerate(stored.labels) if each == line)
    stored.labels.remove(at)
    if at <= stored.label_index:
        stored.label_index = max(0, stored.label_index - 1)
    if source and not any(each.source == source for each in stored.labels):
        stored.label_sources.remove([each.key for each in stored.label_sources].index(source))
        forget(scene, source)
    ct = volumes.loaded(scene)
    choose(stored, _left_to_choose(stored, of_labels=ct is None or ct.volume.kind == ValueKind.LABEL))
    change_events.notify(stored, "label")


def _left_to_choose(stored: Any, of_labels: bool) -> dict[str, Any]:
    """Return a valid choice after lines of a CT's list were removed; a volume `of_labels` has no threshold."""
    choice, labels = chosen_in(stored), [line for line in stored.labels if line.kind == LABEL]
    choice["label_index"] = max(0, min(stored.label_index, len(stored.labels) - 1))
    if labels and stored.label not in [line.value for line in labels]:
        choice["label"] = next((line for line in labels if line.chosen), labels[0]).value
    if not len(stored.labels) and stored.use_label and not of_labels:
        choice["use_label"] = False
    return choice


def chosen_in(stored: Any) -> dict[str, Any]:
    """Return the marked line and the settings that choose the surface; a value precedes its switch."""
    return {name: getattr(stored, name) for name in ("label_index", "label", "use_label")}


def choose(stored: Any, choice: dict[str, Any]) -> None:
    """Restore this choice without change events of ticks."""
    with filling():
        for name, value in choice.items():
            if getattr(stored, name) != value:
                setattr(stored, name, value)


def hash_of(scene: bpy.types.Scene, line: Any | None) -> str:
    """Return a hash of the stored drawing of a line of the list; empty for other lines."""
    item = None if line is None else drawn_by(scene, line)
    if item is None:
        return ""
    drawn = masks.of(scene, item)
    if not drawn.hash:
        content = hashlib.sha256()
        for number, packed in sorted(drawn.unpacked.items()):
            content.update(f"{number} {len(packed)} ".encode() * bool(packed) + packed)
        drawn.hash = content.hexdigest()
    return drawn.hash


def follow_file(*_: Any) -> None:
    """Update all masks from the file, after undo or redo."""
    scenes = {scene.session_uid: scene for scene in bpy.data.scenes}
    changed = set()
    items = {(uid, item.key): item for uid, scene in scenes.items() for item in scene.ctmc_draw.structures}
    for ct in volumes.all_cts():
        for key, drawn in list(ct.drawn.items()):
            if key not in items:
                del ct.drawn[key]
                changed.add(key[0])
            elif masks.take(drawn, items[key]):
                changed.add(key[0])
    for scene in scenes.values():
        _connect_all(scene)  # Connect structures whose removal was undone.
    for uid in changed & scenes.keys():
        change_events.notify(scenes[uid].ctmc, change_events.DRAWN)
    if changed:
        session.redraw_viewports()


def after_load(*_: Any) -> None:
    """Connect the drawings of an opened file to CTs that are still in memory."""
    for ct in volumes.all_cts():
        ct.drawn.clear()
    for scene in bpy.data.scenes:
        _connect_all(scene)


def follow(properties: Any, name: str) -> None:
    """Connect the drawings with a CT that was loaded, and keep the names and colors of the list."""
    scene = properties.id_data
    if name == "volume":
        _connect_all(scene)
    elif name in (change_events.NAME, change_events.COLOR):
        for item in structures(scene):
            line = line_of(scene, item)
            item.name, item.color = line.name, tuple(line.color)
        change_events.notify(properties, change_events.DRAWN)


register, unregister = change_events.following(
    follow, undo_post=follow_file, redo_post=follow_file, load_post=after_load
)
