# SPDX-License-Identifier: GPL-3.0-or-later
"""Change the map that the active surface shows: range, ramp and limits, at once in all viewports."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ....blender.maps import StoredMap, change_map, map_values, recolor_map, shown_map
from ....blender.surface import own_mesh
from ....core.maps import shares_beyond, vertex_areas
from . import measurements, surfaces

_areas: dict[int, tuple[Any, NDArray[np.float64]]] = {}
"""By the mesh's session_uid: state of the surface, and the areas of its vertices."""


def active_map(scene: bpy.types.Scene) -> StoredMap | None:
    """Return the map that the surface on the page Results shows, or None."""
    return shown_map(surfaces.of_results(scene))


def change(scene: bpy.types.Scene, **fields: Any) -> None:
    """Change the range or ramp of the map that is shown, or its limits with the shares of the area beyond them."""
    obj, stored = surfaces.of_results(scene), active_map(scene)
    if obj is None or stored is None or obj.library is not None or obj.data.library is not None:
        return
    changed = replace(stored, **fields)
    if "limits" not in fields:
        recolor_map(obj, changed)
        return
    below, above = shares_beyond(map_values(obj.data, stored.name), _areas_of(obj), changed.core_limits)
    change_map(obj.data, replace(changed, statistics=replace(changed.statistics, share_below=below, share_above=above)))


def set_end(scene: bpy.types.Scene, at: int, value: float) -> None:
    """Move the first (`at` 0) or the last color to a value; an end that would be passed moves with it."""
    stored = active_map(scene)
    if stored is None or stored.range[at] == value:
        return
    low, high = stored.range
    if at == 0:
        change(scene, range=(value, high if value < high else value + (high - low)))
    else:
        change(scene, range=(low if low < value else value - (high - low), value))


def set_limit(scene: bpy.types.Scene, at: int, value: float | None) -> None:
    """Change the lower (`at` 0) or the upper limit; None for no limit, and the other limit gives way."""
    stored = active_map(scene)
    if stored is None or stored.limits[at] == value:
        return
    low, high = stored.limits
    if at == 0:
        high = None if high is None else max(high, high if value is None else value)
        change(scene, limits=(value, high))
    else:
        low = None if low is None else min(low, low if value is None else value)
        change(scene, limits=(low, value))


def _areas_of(obj: bpy.types.Object) -> NDArray[np.float64]:
    state = measurements.plain_state(obj, None)
    uid = obj.data.session_uid
    if uid not in _areas or _areas[uid][0] != state:
        _areas.clear()  # Of one surface at a time.
        _areas[uid] = (state, vertex_areas(own_mesh(obj)))
    return _areas[uid][1]
