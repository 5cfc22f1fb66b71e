# SPDX-License-Identifier: GPL-3.0-or-later
"""Which slice is under the mouse, and where: the one drawn in the viewport, and slices that are objects.

Surfaces are looked through: who draws on a slice means the slice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...blender.slices import corners_of, slices_of
from ...core.volume import slice_at, slice_corners, where_ray_meets
from ..properties.preferences import machine
from ..state import volumes
from .mouse import ray_under


@dataclass(frozen=True)
class SliceHit:
    """A place on a slice, and the slice's corners; RAS+ mm."""

    point_mm: tuple[float, float, float]
    corners_mm: NDArray[np.float64]

    @property
    def normal(self) -> NDArray[np.float64]:
        """The slice's normal, of length 1."""
        normal = np.cross(self.corners_mm[1] - self.corners_mm[0], self.corners_mm[3] - self.corners_mm[0])
        return np.asarray(normal / np.linalg.norm(normal), np.float64)


def slices_in(scene: bpy.types.Scene, space: Any) -> Iterator[NDArray[np.float64]]:
    """Yield the corners of the slices that a viewport shows, (4, 3) RAS+ mm."""
    ct, view = volumes.loaded(scene), scene.ctmc_view
    if ct is None:
        return
    if view.show_slice and space.overlay.show_overlays:
        yield slice_corners(ct.volume, slice_at(ct.volume, view.plane, view.position))
    for obj in slices_of(scene, ct.statistics.fingerprint):
        if obj.visible_get(viewport=space):
            yield corners_of(obj, machine().scale)


def slice_under(scene: bpy.types.Scene, area: Any, event: Any, corners: Any = None) -> SliceHit | None:
    """Return where the mouse is on the nearest slice, or on that with these corners; None beside it."""
    ray = ray_under(area, event)
    if ray is None:
        return None
    origin, direction = ray
    scale = machine().scale
    found: tuple[float, NDArray[np.float64]] | None = None
    for corners_mm in slices_in(scene, area.spaces.active) if corners is None else (corners,):
        way = where_ray_meets(corners_mm * scale, origin, direction)
        if way is not None and (found is None or way < found[0]):
            found = (way, corners_mm)
    if found is None:
        return None
    x, y, z = (origin + direction * found[0]) / scale
    return SliceHit((x, y, z), found[1])
