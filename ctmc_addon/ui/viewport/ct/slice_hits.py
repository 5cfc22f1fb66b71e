# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the slice under the mouse and the position on it: the drawn slice, and slices that are objects.

Surfaces are ignored, because drawing on a slice means the slice. A brush that draws on surfaces tests those too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ....blender.rulers import hit, patient_mm
from ....blender.slices import corners_of, slices_of
from ....core.mesh import distance_between
from ....core.volume import slice_at, slice_corners, slice_normal, where_ray_meets
from ...properties.preferences import machine
from ...state.ct import volumes
from ...state.results import surfaces
from ..mouse import ray_under, window_under


@dataclass(frozen=True)
class SliceHit:
    """A position on a slice, and the slice's corners; RAS+ mm. On a surface, a square across the ray stands for it."""

    point_mm: tuple[float, float, float]
    corners_mm: NDArray[np.float64]
    on_surface: bool = False

    @property
    def normal(self) -> NDArray[np.float64]:
        """Return the slice's normal, of length 1."""
        return slice_normal(self.corners_mm)


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


def _slice_along(scene: bpy.types.Scene, space: Any, ray: tuple[Any, Any], corners: Any = None) -> SliceHit | None:
    """Return where a ray meets the nearest visible slice, or that with these corners; None without a hit."""
    (origin, direction), scale = ray, machine().scale
    planes = slices_in(scene, space) if corners is None else (corners,)
    ways = [(where_ray_meets(corners_mm * scale, origin, direction), corners_mm) for corners_mm in planes]
    way, corners_mm = min(
        ((way, at) for way, at in ways if way is not None), key=lambda each: each[0], default=(None, None)
    )
    if way is None or corners_mm is None:
        return None
    x, y, z = (origin + direction * way) / scale
    return SliceHit((x, y, z), corners_mm)


def _surface_along(scene: bpy.types.Scene, ray: tuple[Any, Any]) -> SliceHit | None:
    """Return where a ray meets a surface of the panel's CT; None if it meets nothing, or another object first."""
    surface_hit = hit(scene, bpy.context.view_layer.depsgraph, *ray)
    if surface_hit is None or not surfaces.is_of_ct(surface_hit[0], scene):
        return None
    place = patient_mm(*surface_hit, machine().scale)
    across = ray[1].orthogonal().normalized()
    down = ray[1].normalized().cross(across)
    square = np.array([(0.0, 0.0, 0.0), across[:], (across + down)[:], down[:]], np.float64)
    return SliceHit(place, square + np.array(place, np.float64), on_surface=True)


def brush_along(scene: bpy.types.Scene, space: Any, view: Any, ray: tuple[Any, Any]) -> SliceHit | None:
    """Return the brush's first hit along a ray: a slice, or a surface if it draws on those too."""
    slice_hit = _slice_along(scene, space, ray)
    if not scene.ctmc_draw.on_surfaces or view.use_clip_planes:  # Quad View hides surfaces before a slice
        return slice_hit
    hits = [each for each in (slice_hit, _surface_along(scene, ray)) if each is not None]
    eye = np.array(ray[0]) / machine().scale
    return min(hits, key=lambda each: distance_between(eye, each.point_mm), default=None)


def slice_under(scene: bpy.types.Scene, area: Any, event: Any) -> SliceHit | None:
    """Return the mouse position on the nearest slice; None without one."""
    ray = ray_under(area, event)
    return None if ray is None else _slice_along(scene, area.spaces.active, ray)


def brush_under(scene: bpy.types.Scene, area: Any, event: Any, held: SliceHit | None = None) -> SliceHit | None:
    """Return the brush's hit under the mouse; a stroke stays on the slice where it began, or on surfaces.

    Parameters
    ----------
    held : SliceHit or None
        The last hit of the stroke; None at its beginning.
    """
    ray, region = ray_under(area, event), window_under(area, event)
    if ray is None or region is None:
        return None
    if held is None:
        return brush_along(scene, area.spaces.active, region.data, ray)
    return _surface_along(scene, ray) if held.on_surface else _slice_along(scene, None, ray, held.corners_mm)
