# SPDX-License-Identifier: GPL-3.0-or-later
"""Check conditions of drawing, and read the state that all of its operators need."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import bpy

from ....core import ReadError, SettingsError, Steps, Volume, volume_text
from ....core.segmentation import Flags, Window, range_mask_steps
from ....core.volume import ValueKind
from ...state import session
from ...state.ct import volumes
from ...state.draw import drawings, masks
from ...translations import translate
from ..ct.slice_object import in_object_mode


def can_draw(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the CT in memory can be drawn on, with the reason if not.

    In edit mode Blender's undo steps hold only the mesh, so a change of the drawing could not be undone.
    """
    if not (in_object_mode(operator, context) and volumes.has_volume(operator, context)):
        return False
    if volumes.require_loaded(context.scene).volume.kind == ValueKind.LABEL:
        operator.poll_message_set("This volume holds labels; load the CT to draw")
        return False
    if volumes.is_coarse(context.scene):
        operator.poll_message_set("This CT does not fit in memory; load a part of it to draw")
        return False
    return True


def has_structure(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether there is a structure to work on, with the reason if not."""
    if drawings.active(context.scene) is None:
        operator.poll_message_set("Select a drawn structure, or add one")
        return False
    return True


def require_active(scene: bpy.types.Scene) -> Any:
    """Return the structure that is drawn on, or raise a `SettingsError`."""
    item = drawings.active(scene)
    if item is None:
        raise SettingsError("there is no structure; add one first")
    return item


def active_or_new(scene: bpy.types.Scene) -> Any:
    """Return the structure that is drawn on, or a new one for the first stroke."""
    return drawings.active(scene) or drawings.add(scene, translate("Structure"))


def structure_of(scene: bpy.types.Scene, key: str) -> Any:
    """Return the structure with a key; raise a `SettingsError` if it was removed since the work began."""
    for item in drawings.structures(scene):
        if item.key == key:
            return item
    raise SettingsError("the structure was removed; choose another one")


class DrawTarget(NamedTuple):
    """State at the start of work, which `require` checks at its end: scene, CT, key and revision of the structure.

    An empty key stands for a new structure.
    """

    scene_uid: int
    fingerprint: str
    key: str = ""
    revision: int = 0


def target_of(scene: bpy.types.Scene, item: Any | None) -> DrawTarget:
    """Return the present state of a structure; None stands for a new one."""
    target = DrawTarget(scene.session_uid, scene.ctmc.volume_fingerprint)
    return target if item is None else target._replace(key=item.key, revision=masks.of(scene, item).revision)


def require(target: DrawTarget) -> tuple[bpy.types.Scene, Any]:
    """Return scene and structure at the end of the work; raise a `SettingsError` if they have changed."""
    scene = session.scene_of(target.scene_uid)
    if scene is None:
        raise SettingsError("the scene was removed; draw in another one")
    item = structure_of(scene, target.key) if target.key else drawings.active(scene)
    if target_of(scene, item) != target:
        raise SettingsError("the structure changed meanwhile, for example by undo; try again")
    return scene, item or active_or_new(scene)


def volume_of(scene: bpy.types.Scene) -> Volume:
    """Return the CT that is drawn on; raise a `ReadError` if it is not fully in memory."""
    ct = volumes.require_loaded(scene)
    if ct.file is not None:
        raise ReadError("this CT does not fit in memory; load a part of it to draw")
    return ct.volume


def limits_of(drawing: Any) -> tuple[float, float] | None:
    """Return the range that tools stay in; None without one."""
    return (drawing.low, drawing.high) if drawing.use_range else None


def allowed_steps(volume: Volume, window: Window, limits: tuple[float, float] | None) -> Steps[Flags | None]:
    """Return which samples of a window are in a range, or None without a range."""
    if limits is None:
        return None
    z, y, x = window
    part = volume.part(((x.start, x.stop), (y.start, y.stop), (z.start, z.stop)))
    return (yield from range_mask_steps(part, *limits))


def whole(shape: Sequence[int]) -> Window:
    """Return the window of a whole volume."""
    z, y, x = (slice(0, count) for count in shape)
    return z, y, x


def named_volume_text(scene: bpy.types.Scene, item: Any) -> str:
    """Return the name of a structure with its volume."""
    text, name = translate("{name}: {volume}"), drawings.line_of(scene, item).name
    return text.format(name=name, volume=volume_text(masks.mm3_of(scene, item)))
