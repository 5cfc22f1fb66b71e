# SPDX-License-Identifier: GPL-3.0-or-later
"""Switch between several CTs in a scene: the panel shows the one whose object or collection is active.

The panel's state of every other CT is in `scene.ctmc_scans`, so undo and saving need nothing here. Their values stay
in memory while there is room (`volumes.keep`).
"""

from __future__ import annotations

from typing import Any

import bpy

from ....blender.scene.ct_box import box_of, boxes_in, fingerprint_of_box, give_box, paths_of_boxes, remove_box
from ....blender.surface import read_provenance
from ... import jobs
from ...properties.ct.scans import clear as clear_state, take_over
from ...properties.surface.structures import filling
from .. import change_events, session
from . import volumes
from .stored_paths import name_of as name_of_path, states_in


def park(scene: bpy.types.Scene) -> None:
    """Store the panel's state of its CT, before another is loaded."""
    stored, scans = scene.ctmc, scene.ctmc_scans
    if not stored.volume_fingerprint:
        return
    forget(scene, stored.volume_fingerprint)
    with filling():
        take_over(scans.add(), stored)


def forget(scene: bpy.types.Scene, fingerprint: str) -> None:
    """Drop the stored state of a CT, which is the panel's again."""
    for number in reversed(range(len(scene.ctmc_scans))):
        if scene.ctmc_scans[number].volume_fingerprint == fingerprint:
            scene.ctmc_scans.remove(number)


def state_of(scene: bpy.types.Scene, fingerprint: str) -> Any | None:
    """Return the panel's state of a CT of a scene; None for a CT that the scene does not have."""
    return next((ct for ct in states_in(scene) if fingerprint and ct.volume_fingerprint == fingerprint), None)


def name_of(scene: bpy.types.Scene, ct: Any) -> str:
    """Return the name of a CT of a scene, in memory or not."""
    loaded = volumes.ct_of(ct.volume_fingerprint)
    if loaded is not None:
        return volumes.called_as(ct, loaded)
    box = box_of(scene, ct.volume_fingerprint, ct.volume_path)
    return str(ct.volume_name).strip() or (name_of_path(ct.volume_path) if box is None else box.name)


def listed(scene: bpy.types.Scene) -> list[Any]:
    """Return the panel's state of each CT of a scene, by name: a CT that becomes the panel's keeps its row."""
    cts = [ct for ct in states_in(scene) if ct.volume_fingerprint]
    return sorted(cts, key=lambda ct: (name_of(scene, ct).casefold(), ct.volume_fingerprint))


def other_readings(scene: bpy.types.Scene, fingerprint: str) -> list[str]:
    """Return the fingerprints of the other CTs that share a CT's box: series, times and spacings of the same path."""
    ct = state_of(scene, fingerprint)
    path = "" if ct is None else ct.volume_path
    same = [reading.volume_fingerprint for reading in states_in(scene) if path and reading.volume_path == path]
    return [reading for reading in same if reading and reading != fingerprint]


def remove(scene: bpy.types.Scene, fingerprint: str) -> None:
    """Remove a CT from a scene; the panel shows the next one, if any. Its values stay in memory.

    Its box goes too, unless it is that of another reading of the same path.
    """
    ct = state_of(scene, fingerprint)
    if ct is None:
        return
    readings = other_readings(scene, fingerprint)  # Before another CT takes this one's place.
    if ct == scene.ctmc:
        following = next(iter(scene.ctmc_scans), None)
        with filling():
            if following is None:
                clear_state(ct)
            else:
                take_over(ct, following)
        forget(scene, ct.volume_fingerprint)
        change_events.notify(ct, "volume")
    else:
        forget(scene, fingerprint)
    if readings:
        give_box(scene, fingerprint, readings[0])
    else:
        remove_box(scene, fingerprint)
    session.of(scene).boxes.discard(fingerprint)


def drop_deleted(scene: bpy.types.Scene, *_: Any) -> None:
    """Remove CTs whose box was deleted; their values stay in memory, because undo brings the box back.

    Two readings of a path share a box. Objects are looked through only when their number or the CTs have changed,
    because this runs at each frame of playback.
    """
    cts = [ct for ct in states_in(scene) if ct.volume_fingerprint]
    if not cts or jobs.running() is not None:
        return
    own, present = session.of(scene), (len(scene.objects), *(ct.volume_fingerprint for ct in cts))
    if own.looked_for == present:
        return
    own.looked_for, boxes = present, paths_of_boxes(scene)
    deleted = []
    for ct in cts:
        fingerprint = ct.volume_fingerprint
        if fingerprint in boxes or ct.volume_path in boxes.values():
            own.boxes.add(fingerprint)
        elif fingerprint in own.boxes:
            deleted.append(fingerprint)
    for fingerprint in deleted:  # Removing one moves the others.
        remove(scene, fingerprint)
        own.boxes.add(fingerprint)  # Undo may bring back the list without the box.


def activate(scene: bpy.types.Scene, fingerprint: str) -> bool:
    """Switch the panel to another CT of the scene and report it; return whether it exists."""
    is_another = bring_back(scene, fingerprint)
    if is_another:
        change_events.notify(scene.ctmc, "volume")
    return is_another


def bring_back(scene: bpy.types.Scene, fingerprint: str) -> bool:
    """Restore the panel's state of another CT of the scene, and store the present one; return whether it exists."""
    if not fingerprint or fingerprint == scene.ctmc.volume_fingerprint:
        return False
    if not any(scan.volume_fingerprint == fingerprint for scan in scene.ctmc_scans):
        return False
    park(scene)
    with filling():
        take_over(scene.ctmc, next(scan for scan in scene.ctmc_scans if scan.volume_fingerprint == fingerprint))
    forget(scene, fingerprint)
    return True


def _active_fingerprint(context: bpy.types.Context, what: tuple[Any, ...]) -> str:
    """Return the CT of the object or collection that became active; empty if it belongs to none.

    An object that is no longer selected is still Blender's active one, but has not become so.

    Parameters
    ----------
    context : bpy.types.Context
    what : tuple
        Changed parts of `_active_in`; the object comes first.
    """
    layer = context.view_layer
    obj, before = layer.objects.active, session.of(context.scene).active
    if what[0] is not None and (before is None or before[0] != what[0]):
        provenance = read_provenance(obj)
        return provenance.fingerprint if provenance is not None else fingerprint_of_box(obj)
    if before is not None and before[1] == what[1]:
        return ""
    boxes = {fingerprint_of_box(box) for box in boxes_in(layer.active_layer_collection.collection)}
    return boxes.pop() if len(boxes) == 1 else ""


def _active_in(context: bpy.types.Context) -> tuple[Any, ...]:
    """Return an identifier of the active object and collection."""
    layer = context.view_layer
    obj = layer.objects.active
    is_selected = obj is not None and obj.select_get(view_layer=layer)
    return (obj.session_uid if is_selected else None, layer.active_layer_collection.collection.session_uid)


def note(context: bpy.types.Context) -> None:
    """Take the present active object as seen, so that a CT that has just been loaded stays the panel's."""
    session.of(context.scene).active = _active_in(context)


def follow(*_: Any) -> None:
    """Switch the panel to the CT of the newly active object or collection."""
    context = bpy.context
    if context.scene is None or context.view_layer is None or not len(context.scene.ctmc_scans):
        return
    what, own = _active_in(context), session.of(context.scene)
    if own.active == what or jobs.running() is not None:
        return
    fingerprint = _active_fingerprint(context, what)
    own.active = what
    activate(context.scene, fingerprint)


def notice(context: bpy.types.Context) -> None:
    """Follow soon if the active object or collection changed; only drawing notices a click on a collection."""
    has_changed = len(context.scene.ctmc_scans) and session.of(context.scene).active != _active_in(context)
    if has_changed and not bpy.app.timers.is_registered(follow):
        bpy.app.timers.register(follow, first_interval=0.0)


def _after_update(scene: bpy.types.Scene, *_: Any) -> None:
    """Follow the active object, and deleted boxes."""
    follow()
    drop_deleted(scene)


def _forget_timer() -> None:
    if bpy.app.timers.is_registered(follow):
        bpy.app.timers.unregister(follow)


register, unregister = change_events.following(depsgraph_update_post=_after_update, at_end=_forget_timer)
