# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the region in which a surface is extracted as a box with handles in the viewport.

The handles write `scene.ctmc.region` and nothing else: an arrow on each side of the box moves that side, the one in
its middle moves the box.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ....core.volume import (
    SampleGrid,
    moved_region,
    region_axes,
    region_corners,
    region_limits,
    region_shift,
    with_moved_face,
)
from ...properties.preferences import machine
from ...state.ct import volumes

COLORS = ((0.9, 0.25, 0.3), (0.4, 0.75, 0.2), (0.2, 0.5, 0.95))  # Colors of x, y and z as everywhere in Blender.


class _RegionFace:
    """One side of the box, as Blender's arrow handle reads and moves it.

    An arrow is at its base plus an offset along its direction; the base is the side's position at 0.
    """

    def __init__(self, scene: bpy.types.Scene, volume: SampleGrid, face: int) -> None:
        settings, scale = scene.ctmc, machine().scale
        self.settings, self.face, self.axis = settings, face, face % 3
        self.limits = region_limits(volume, settings.region_unit)
        step = region_axes(volume, settings.region_unit)[self.axis] * scale
        self.unit = float(np.sqrt((step * step).sum()))
        self.outward = -1.0 if face < 3 else 1.0
        self.direction = self.outward * step / self.unit
        region = np.array(settings.region, np.float64)
        corners = region_corners(volume, tuple(region), settings.region_unit) * scale
        self.middle = corners.mean(axis=0)
        self.base = self.middle - step * (region[self.axis] + region[self.axis + 3]) / 2

    def offset(self) -> float:
        """Return the position of the side, from the base outwards, Blender units."""
        return float(self.outward * self.settings.region[self.face] * self.unit)

    def move(self, offset: float) -> None:
        """Move the side of the box to this offset."""
        value = self.outward * offset / self.unit
        self.settings.region = with_moved_face(tuple(self.settings.region), self.face, value, self.limits)

    def matrix(self) -> Matrix:
        """Return the matrix of the arrow's base, which points outwards."""
        turned = Vector(self.direction).to_track_quat("Z", "Y").to_matrix().to_4x4()
        return Matrix.Translation(Vector(self.base)) @ turned


def current_face(face: int) -> _RegionFace | None:
    """Return the present side; Blender keeps handles longer than any scene or volume."""
    scene = bpy.context.scene
    volume = volumes.current_full(scene)
    return None if volume is None else _RegionFace(scene, volume, face)


def handle_of(face: int) -> tuple[Callable[[], float], Callable[[float], None]]:
    """Return the getter and setter for the arrow of a side."""

    def read() -> float:
        side = current_face(face)
        return 0.0 if side is None else side.offset()

    def write(offset: float) -> None:
        side = current_face(face)
        if side is not None:
            side.move(offset)

    return read, write


def read_middle() -> tuple[float, float, float]:
    """Return the move handle's offset, the box's middle; the base is at 0."""
    side = current_face(0)
    if side is None:
        return (0.0, 0.0, 0.0)
    x, y, z = side.middle.tolist()
    return (x, y, z)


def write_middle(point: Any) -> None:
    """Move the box's middle to a position in the viewport."""
    scene = bpy.context.scene
    volume = volumes.current_full(scene)
    if volume is None:
        return
    settings = scene.ctmc
    region = tuple(settings.region)
    limits = region_limits(volume, settings.region_unit)
    shift = region_shift(volume, settings.region_unit, (np.array(point) - np.array(read_middle())) / machine().scale)
    for axis in range(3):
        region = moved_region(region, axis, float(shift[axis]), limits)
    settings.region = region


class CTMC_GGT_region(bpy.types.GizmoGroup):
    """Handles of the region's box."""

    bl_idname = "CTMC_GGT_region"
    bl_label = "CTMC Region"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT", "SHOW_MODAL_ALL"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        space = context.space_data
        shown = space is not None and space.type == "VIEW_3D" and space.overlay.show_overlays
        return bool(shown and context.scene.ctmc.use_region and volumes.current_full(context.scene) is not None)

    def setup(self, _context: bpy.types.Context) -> None:
        for face in range(6):
            arrow = self.gizmos.new("GIZMO_GT_arrow_3d")
            read, write = handle_of(face)
            arrow.target_set_handler("offset", get=read, set=write)
            arrow.draw_style = "BOX"
            arrow.length = 0.35
            arrow.color, arrow.alpha = COLORS[face % 3], 0.8
            arrow.color_highlight, arrow.alpha_highlight = (1.0, 1.0, 0.6), 1.0
        middle = self.gizmos.new("GIZMO_GT_move_3d")
        middle.target_set_handler("offset", get=read_middle, set=write_middle)
        middle.draw_style = "RING_2D"
        middle.draw_options = {"FILL_SELECT", "ALIGN_VIEW"}
        middle.scale_basis = 0.2
        middle.color, middle.alpha = (1.0, 0.75, 0.1), 0.8
        middle.color_highlight, middle.alpha_highlight = (1.0, 1.0, 0.6), 1.0

    def draw_prepare(self, _context: bpy.types.Context) -> None:
        """Move the handles to the present box."""
        for face, arrow in enumerate(list(self.gizmos)[:6]):
            side = current_face(face)
            if side is not None:
                arrow.matrix_basis = side.matrix()


register, unregister = bpy.utils.register_classes_factory((CTMC_GGT_region,))
