# SPDX-License-Identifier: GPL-3.0-or-later
"""Handles of the panel's solid in the viewport: an arrow moves a cut, a ring on it turns it, a ring moves a drain.

They start `ctmc.solid_drag`, which is undone as one step.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ....core.solid import MOST_CUTS, HalfSpace, rectangle_of
from ... import jobs
from ...properties.preferences import machine
from ...state.surface import solids
from . import solid

MOST_DRAINS = 12
"""At most this many drains have a handle."""
LENGTH, RING = 0.6, 1.0  # Length of the arrow and position of the ring, in sizes of Blender's gizmos.
HIGHLIGHT = (1.0, 1.0, 0.6)


def middle_of(scene: bpy.types.Scene, index: int) -> NDArray[np.float64] | None:
    """Return the middle of a cut's rectangle, (3,) mm; None for a cut that is not shown."""
    box, cuts = solids.box_of(scene), scene.ctmc_solid.cuts
    if box is None or not 0 <= index < len(cuts) or not any(cuts[index].normal):
        return None
    return np.asarray(rectangle_of(cuts[index].to_request(), box).mean(axis=0))


def _matrix_of_cut(scene: bpy.types.Scene, index: int) -> Matrix | None:
    """Return the matrix of a cut's handles, at its middle with z along its normal; None for a cut that is not shown."""
    middle = middle_of(scene, index)
    if middle is None:
        return None
    cut = scene.ctmc_solid.cuts[index].to_request()
    turned = Vector(HalfSpace(cut.point, cut.normal).unit).to_track_quat("Z", "Y").to_matrix().to_4x4()
    return Matrix.Translation(Vector(middle * machine().scale)) @ turned


def _matrix_of_drain(scene: bpy.types.Scene, index: int) -> Matrix | None:
    """Return the matrix of a drain's handle; None for a drain without a point."""
    drains = scene.ctmc_solid.drains
    if not 0 <= index < len(drains) or drains[index].auto:
        return None
    return Matrix.Translation(Vector(drains[index].point) * machine().scale)


class CTMC_GGT_solid(bpy.types.GizmoGroup):
    """Handles of the solid's cuts and drains."""

    bl_idname = "CTMC_GGT_solid"
    bl_label = "CTMC Solid"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT", "SHOW_MODAL_ALL"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        space, stored = context.space_data, context.scene.ctmc_solid
        shown = space is not None and space.type == "VIEW_3D" and space.overlay.show_overlays
        return bool(shown and solid.shows(context) and (len(stored.cuts) or len(stored.drains)) and not jobs.running())

    def setup(self, _context: bpy.types.Context) -> None:
        for index in range(MOST_CUTS):
            arrow = self._handle("GIZMO_GT_arrow_3d", "MOVE", index, solid.CUT_COLOR)
            arrow.draw_style, arrow.length = "NORMAL", LENGTH
            ring = self._handle("GIZMO_GT_move_3d", "TURN", index, solid.CUT_COLOR)
            ring.matrix_offset = Matrix.Translation((0.0, 0.0, RING / ring.scale_basis))
            ring.use_draw_offset_scale = True
        for index in range(MOST_DRAINS):
            self._handle("GIZMO_GT_move_3d", "DRAIN", index, solid.DRAIN_COLOR)

    def _handle(self, kind: str, what: str, index: int, color: tuple[float, ...]) -> Any:
        """Add a handle that drags a part of the solid."""
        handle = self.gizmos.new(kind)
        dragging = handle.target_set_operator("ctmc.solid_drag")
        dragging.what, dragging.index = what, index
        handle.color, handle.alpha = color[:3], 0.9
        handle.color_highlight, handle.alpha_highlight = HIGHLIGHT, 1.0
        if kind == "GIZMO_GT_move_3d":
            handle.draw_style, handle.draw_options = "RING_2D", {"FILL_SELECT", "ALIGN_VIEW"}
            handle.scale_basis = 0.15
        return handle

    def draw_prepare(self, context: bpy.types.Context) -> None:
        """Move the handles to the present cuts and drains, and hide unused ones."""
        handles = list(self.gizmos)
        matrices = [_matrix_of_cut(context.scene, index // 2) for index in range(2 * MOST_CUTS)]
        matrices += [_matrix_of_drain(context.scene, index) for index in range(MOST_DRAINS)]
        for handle, matrix in zip(handles, matrices, strict=True):
            handle.hide = matrix is None
            if matrix is not None:
                handle.matrix_basis = matrix


register, unregister = bpy.utils.register_classes_factory((CTMC_GGT_solid,))
