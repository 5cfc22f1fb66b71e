# SPDX-License-Identifier: GPL-3.0-or-later
"""Show three slices at once, each from its own side, next to the turnable view: the operator `ctmc.quad_view`."""

from __future__ import annotations

import time
from functools import partial

import bpy

from ....blender.slices import slices_of
from ....blender.viewport import clip, frame
from ....core.volume import volume_box
from ...needs import Needs
from ...properties.preferences import machine
from ...state import session
from ...state.ct import volumes
from ...translations import translate
from ...viewport.ct import slice_objects
from ..ct.slice_object import add_slices, chosen_slices, in_object_mode

SOON = 0.01  # Seconds between two checks whether the views have their sizes.
LONGEST = 1.0  # Seconds to wait for the views' sizes.


class CTMC_OT_quad_view(Needs, bpy.types.Operator):
    """Divide the viewport into Blender's four views, with three slices to draw on."""

    bl_idname = "ctmc.quad_view"
    bl_label = "Quad View"
    bl_description = (
        "Show three slices beside the 3D view. All can be drawn on, and Pick Point moves them; each "
        "hides the surfaces in front of it. Press again for a single view; the slices stay, as "
        "objects"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (in_object_mode, volumes.has_volume)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, area = context.scene, context.area
        if area is None or area.type != "VIEW_3D":
            self.report({"ERROR"}, translate("Press this in a 3D viewport"))
            return {"CANCELLED"}
        ct, space = volumes.require_loaded(scene), area.spaces.active
        is_divided = bool(space.region_quadviews)
        if not is_divided and not any(slices_of(scene, ct.statistics.fingerprint)):
            add_slices(context, chosen_slices(scene))
        region = next(region for region in area.regions if region.type == "WINDOW")
        with context.temp_override(area=area, region=region):
            bpy.ops.screen.region_quadview()
        scene.ctmc_view.show_slice = is_divided  # Slice objects would lie in the same plane.
        work = partial(arrange, scene.session_uid, area.as_pointer(), time.monotonic() + LONGEST)
        bpy.app.timers.register(work, first_interval=0.0)
        session.redraw_viewports()
        return {"FINISHED"}


def has_room(area: bpy.types.Area) -> bool:
    """Return whether Blender has given the views of a viewport their sizes; before, each has that of the whole."""
    views = [region for region in area.regions if region.type == "WINDOW"]
    return 0.5 < sum(view.width * view.height for view in views) / (area.width * area.height) <= 1


def arrange(scene_uid: int, pointer: int, latest: float) -> float | None:
    """Frame the CT in every view of a viewport once they have sizes; the three from a side then show their slices."""
    scene = session.scene_of(scene_uid)
    volume = None if scene is None else volumes.current(scene)
    if volume is None:
        return None
    for window in bpy.context.window_manager.windows:
        for area in (area for area in window.screen.areas if area.as_pointer() == pointer):
            if not has_room(area) and time.monotonic() < latest:
                return SOON
            space = area.spaces.active
            for view in space.region_quadviews or [space.region_3d]:
                frame(area, space, view, volume_box(volume) * machine().scale)
                if view.lock_rotation:
                    clip(window, area, view)
    slice_objects.show_from_sides(scene)
    return None


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_quad_view,))
