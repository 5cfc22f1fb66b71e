# SPDX-License-Identifier: GPL-3.0-or-later
"""Change the map that the active surface shows: range, ramp and limits, at once in all viewports."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ...blender.maps import StoredMap, map_values, recolor_map, shown_map
from ...blender.surface import own_mesh
from ...core.arrays import Doubles
from ...core.maps import statistics_of, vertex_areas
from . import measurements, surfaces

_areas: dict[int, tuple[Any, Doubles]] = {}
"""By the mesh's session_uid: state of the surface, and the areas of its vertices."""


def active_map(scene: bpy.types.Scene) -> StoredMap | None:
    """Return the map that the surface on the page Results shows, or None."""
    return shown_map(surfaces.of_results(scene))


def change(scene: bpy.types.Scene, **fields: Any) -> None:
    """Change fields of the map that is shown; its statistics follow the limits."""
    obj, stored = surfaces.of_results(scene), active_map(scene)
    if obj is None or stored is None or obj.library is not None or obj.data.library is not None:
        return
    changed = replace(stored, **fields)
    if "limits" in fields:
        values = map_values(obj.data, stored.name)
        changed = replace(changed, statistics=statistics_of(values, _areas_of(obj), changed.core_limits))
    recolor_map(obj, changed)


def set_end(scene: bpy.types.Scene, at: int, value: float) -> None:
    """Move the first (`at` 0) or the last color to a value; the other end gives way."""
    stored = active_map(scene)
    if stored is None or stored.range[at] == value:
        return
    low, high = stored.range
    least = max(1e-6 * abs(value), 1e-9)
    change(scene, range=(value, max(high, value + least)) if at == 0 else (min(low, value - least), value))


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


def _areas_of(obj: bpy.types.Object) -> Doubles:
    state = measurements.plain_state(obj, None)
    uid = obj.data.session_uid
    if uid not in _areas or _areas[uid][0] != state:
        _areas.clear()  # Of one surface at a time.
        _areas[uid] = (state, vertex_areas(own_mesh(obj)))
    return _areas[uid][1]
