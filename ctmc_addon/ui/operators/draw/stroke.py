# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw and erase along strokes on a slice, or with a ball along surfaces: the operator `ctmc.draw_stroke`.

The mask follows the mouse; the file gets the stroke when the button is released. Esc restores the mask from the file.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatVectorProperty

from ....core import CtmcError, SettingsError
from ....core.segmentation import brush
from ... import jobs
from ...needs import Needs
from ...properties.drawing import CTMCPoint
from ...state import session
from ...state.ct import volumes
from ...state.draw import drawings, masks
from ...translations import translate
from ...viewport.ct.slice_hits import SliceHit, brush_under
from ...viewport.mouse import viewport_at
from .needs import active_or_new, can_draw, limits_of, require_active, structure_of, volume_of

Point = Sequence[float]


class CTMC_OT_draw_stroke(Needs, bpy.types.Operator):
    """Draw or erase along the mouse, on the slice where it begins or along surfaces."""

    bl_idname = "ctmc.draw_stroke"
    bl_label = "Draw Stroke"
    bl_description = "Draw on a slice with the radius of the brush; Ctrl erases. Esc cancels the stroke"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    erase: BoolProperty(name="Erase", description="Erase instead of drawing", options={"SKIP_SAVE"})
    stroke: CollectionProperty(type=CTMCPoint, options={"HIDDEN", "SKIP_SAVE"})
    normal: FloatVectorProperty(size=3, default=(0.0, 0.0, 1.0), options={"HIDDEN", "SKIP_SAVE"})

    needs = (jobs.idle, can_draw)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Draw a stroke through points in RAS+ mm, their `at`; a disc is across `normal`."""
        try:
            self.start(context.scene)
            self.dab(context.scene, [tuple(point.at) for point in self.stroke], tuple(self.normal))
            return self.finish(context)
        except (CtmcError, MemoryError) as error:
            return self.give_up(context, error)

    def start(self, scene: bpy.types.Scene) -> None:
        """Store the target and the list's choices before a first stroke."""
        self.key, self.chosen = "", drawings.chosen_in(scene.ctmc)
        self.touched: set[int] = set()
        self.is_new = drawings.active(scene) is None
        self.key = (require_active(scene) if self.erase else active_or_new(scene)).key

    def dab(self, scene: bpy.types.Scene, points_mm: Sequence[Point], normal: Point | None) -> None:
        """Draw from point to point; a ball if there is no normal, on a surface."""
        drawing, volume = scene.ctmc_draw, volume_of(scene)
        drawn = masks.of(scene, structure_of(scene, self.key))
        across = None if drawing.ball else normal
        window = brush(drawn.mask, volume, points_mm, drawing.radius_mm, across, limits_of(drawing), self.erase)
        self.touched.update(range(window[0].start, window[0].stop))
        masks.touched(drawn)

    def finish(self, context: bpy.types.Context) -> set[str]:
        """Put the stroke into the file; a new structure that stays empty is removed."""
        scene = context.scene
        item = structure_of(scene, self.key)
        masks.store(scene, item, self.touched)
        if self.is_new and masks.window_in(scene, item) is None:
            raise SettingsError("nothing was drawn: no voxel under the brush is in the CT and in the range")
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin at the mouse on a slice; a click off all slices passes through."""
        if context.area is None or context.area.type != "VIEW_3D":
            self.report({"ERROR"}, translate("Press this in a 3D viewport"))
            return {"CANCELLED"}
        hit = brush_under(context.scene, context.area, event)
        if hit is None:
            return {"CANCELLED", "PASS_THROUGH"}
        self.area, self.hit = context.area.as_pointer(), hit
        masks.begin_stroke(self)
        try:
            self.start(context.scene)
            self.follow(context, hit)
        except (CtmcError, MemoryError) as error:
            return self.give_up(context, error)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def follow(self, context: bpy.types.Context, hit: SliceHit) -> None:
        """Draw up to the mouse."""
        points = dict.fromkeys([tuple(self.hit.point_mm), tuple(hit.point_mm)])
        self.dab(context.scene, list(points), None if hit.on_surface else hit.normal.tolist())
        self.hit = hit
        session.redraw_viewports()

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse on the slice where the stroke began."""
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        try:
            if event.type == "LEFTMOUSE" and event.value == "RELEASE":
                masks.end_stroke(self)
                return self.finish(context)
            if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE"):
                area = viewport_at(context, self.area)
                hit = None if area is None else brush_under(context.scene, area, event, self.hit)
                if hit is not None:
                    self.follow(context, hit)
        except (CtmcError, MemoryError) as error:
            return self.give_up(context, error)
        return {"RUNNING_MODAL"}

    def give_up(self, context: bpy.types.Context, error: Exception) -> set[str]:
        """Revert the stroke, and report the reason."""
        self.cancel(context)
        return jobs.refuse(self, context.scene.session_uid, error)

    def cancel(self, context: bpy.types.Context) -> None:
        """Restore the mask from the file, if structure and CT still exist, and the list as it was."""
        masks.end_stroke(self)
        scene = context.scene
        item = next((each for each in drawings.structures(scene) if each.key == self.key), None)
        if item is None or volumes.loaded(scene) is None:
            return
        masks.revert(scene, item, self.touched)
        if self.is_new:
            drawings.remove(scene, drawings.line_of(scene, item))
            drawings.choose(scene.ctmc, self.chosen)
        session.redraw_viewports()


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_stroke,))
