# SPDX-License-Identifier: GPL-3.0-or-later
"""Update slices that are moved: their pictures show the CT there, and they meet at a picked point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ...core import Volume
from ...core.volume import AIR, ValueKind, resliced, slice_corners, slice_normal, slice_through
from .material import pack, paint, picture_of, set_window, show_in_solid
from .plane import PLANE, SHOWN, SLICE, is_slice, outside_body

STILL = 1e-3  # Distance in mm that a slice may move before its picture is updated.


def corners_of(obj: bpy.types.Object, scale: float) -> NDArray[np.float64]:
    """Return the present corners of a slice, (4, 3) RAS+ mm."""
    return np.array([obj.matrix_world @ corner.co for corner in obj.data.vertices], np.float64) / scale


def pictures_of(obj: bpy.types.Object) -> list[tuple[bpy.types.Material, bpy.types.Image]]:
    """Return the materials of a slice that still have a picture, each with that picture."""
    pairs = [(material, picture_of(material)) for material in obj.data.materials]
    return [(material, picture) for material, picture in pairs if picture is not None]


def slices_of(scene: bpy.types.Scene, fingerprint: str) -> Iterator[bpy.types.Object]:
    """Yield the slices of a CT in a scene."""
    for obj in scene.objects:
        if is_slice(obj) and fingerprint and obj[SLICE] == fingerprint and len(obj.data.vertices) == 4:
            yield obj


def at_corners(
    scene: bpy.types.Scene, fingerprint: str, corners_mm: NDArray[np.float64], scale: float
) -> bpy.types.Object | None:
    """Return the slice of a CT with these corners, (4, 3) RAS+ mm, or None."""
    for obj in slices_of(scene, fingerprint):
        if np.abs(corners_of(obj, scale) - corners_mm).max() < STILL:
            return obj
    return None


def refresh(scene: bpy.types.Scene, volume: Volume, fingerprint: str, scale: float, *, again: bool = False) -> int:
    """Update the pictures of a CT's moved slices; return how many slices had moved.

    Parameters
    ----------
    again : bool
        Update slices that have not moved too: undo restores positions, but not pictures.
    """
    moved = 0
    for obj in slices_of(scene, fingerprint):
        corners, pictures = corners_of(obj, scale), pictures_of(obj)
        shown = np.array(obj.get(SHOWN, ()), np.float64)
        is_still = shown.size == corners.size and np.abs(shown - corners.ravel()).max() < STILL
        if not pictures or (is_still and not again):
            continue
        for material, picture in pictures:
            columns, rows = picture.size
            values = resliced(volume, corners, (rows, columns), AIR if volume.kind == ValueKind.HU else 0.0)
            paint(material, values, outside_body(volume, values, corners))
        obj[SHOWN] = corners.ravel().tolist()
        moved += 1
    return moved


def show_window(scene: bpy.types.Scene, fingerprint: str, window: float, level: float) -> None:
    """Give the slices of a CT another window and level."""
    for obj in slices_of(scene, fingerprint):
        for material, _ in pictures_of(obj):
            set_window(material, window, level)
            show_in_solid(material)


def pack_pictures() -> None:
    """Put updated pictures into the .blend that is being saved."""
    for obj in bpy.data.objects:
        for material, _ in pictures_of(obj) if is_slice(obj) and obj.library is None else ():
            pack(material)


def cross_at(
    scene: bpy.types.Scene,
    volume: Volume,
    fingerprint: str,
    point_mm: Sequence[float],
    scale: float,
    clicked: bpy.types.Object | None = None,
) -> None:
    """Move the slices of a CT so that they and the 3D cursor meet at a point; `clicked` stays.

    If several slices lie in one plane, the nearest moves.
    """
    scene.cursor.location = [value * scale for value in point_mm]
    nearest: dict[str, tuple[float, bpy.types.Object, Vector]] = {}
    kept = clicked.get(PLANE) if clicked is not None and is_slice(clicked) else None
    for obj in slices_of(scene, fingerprint):
        plane = obj.get(PLANE)
        if plane is None or plane == kept:
            continue
        corners = corners_of(obj, scale)
        normal = slice_normal(corners)
        target = slice_corners(volume, slice_through(volume, plane, point_mm)).mean(axis=0)
        way = float((normal * (target - corners[0])).sum())
        if plane not in nearest or abs(way) < nearest[plane][0]:
            nearest[plane] = (abs(way), obj, Vector((normal * way * scale).tolist()))
    for _, obj, shift in nearest.values():
        matrix = obj.matrix_world.copy()
        matrix.translation += shift
        obj.matrix_world = matrix
