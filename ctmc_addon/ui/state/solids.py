# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the solid of the panel lies: the box of its structures, and their vertices if their surfaces exist.

Both are looked for again only when they may have changed, because the viewport asks at every redraw. RAS+ mm.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...blender.surface import own_mesh
from ...core.volume import ValueKind, labels_region, region_corners, volume_box
from ..properties.structures import LABEL, is_made_of
from . import structures, surfaces, volumes

_boxes: dict[str, Any] = {}  # "key", "volume" and "corners" of the labels asked for last.
_vertices: dict[str, Any] = {}  # "key" and "vertices" of the surfaces asked for last.


def box_of(scene: bpy.types.Scene) -> NDArray[np.float64] | None:
    """Return the corners (8, 3) around the ticked labels, else of the region or the CT; None without a CT."""
    volume, settings = volumes.current_full(scene) or volumes.current(scene), scene.ctmc
    if volume is None:
        return None
    labels = structures.label_volume(scene) if settings.use_label else None
    ticked = [item for item in settings.labels if item.chosen]
    if labels is not None and labels.kind == ValueKind.LABEL and ticked and all(item.kind == LABEL for item in ticked):
        values = tuple(item.value for item in ticked)
        if _boxes.get("volume") is not labels or _boxes.get("key") != values:
            corners = region_corners(labels, labels_region(labels, values, "mm"), "mm")
            _boxes.update(volume=labels, key=values, corners=corners)
        return np.asarray(_boxes["corners"])
    if settings.use_region:
        return region_corners(volume, tuple(settings.region), settings.region_unit)
    return volume_box(volume)


def vertices_of(scene: bpy.types.Scene) -> NDArray[np.float32] | None:
    """Return the vertices (n, 3) of the surfaces of the solid's structures; None if none was made."""
    objects = [obj for obj in scene.objects if surfaces.is_of_ct(obj, scene) and _is_wanted(scene.ctmc, obj)]
    key = tuple((obj.data.session_uid, len(obj.data.vertices)) for obj in objects)
    if not key:
        return None
    if _vertices.get("key") != key:
        _vertices.update(key=key, vertices=np.concatenate([own_mesh(obj).vertices for obj in objects]))
    return np.asarray(_vertices["vertices"])


def _is_wanted(settings: Any, obj: bpy.types.Object) -> bool:
    """Return whether a surface of the CT is of a structure that Reconstruct makes, and not a part."""
    provenance = surfaces.require_provenance(obj)
    if provenance.part or obj.data.is_editmode:
        return False
    if settings.use_label:
        return any(item.chosen and is_made_of(item, provenance.settings) for item in settings.labels)
    return provenance.settings.label is None


def clear(*_: Any) -> None:
    """Release what was found, because another file is loaded."""
    _boxes.clear()
    _vertices.clear()


def register() -> None:
    """Listen for another file."""
    bpy.app.handlers.load_pre.append(bpy.app.handlers.persistent(clear))


def unregister() -> None:
    """Stop listening, and release what was found."""
    bpy.app.handlers.load_pre.remove(clear)
    clear()
