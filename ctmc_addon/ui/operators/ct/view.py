# SPDX-License-Identifier: GPL-3.0-or-later
"""Look at the CT: the operator `ctmc.view`, and what a load does to the viewports of the screen."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import EnumProperty

from ....blender.viewport import frame, is_held
from ....core import Volume
from ....core.volume import volume_box
from ...needs import Needs
from ...properties.preferences import machine
from ...state import session
from ...state.ct import volumes
from ...translations import translate

AS_IT_IS = "CT"
SIDES = {
    AS_IT_IS: ("View CT", "Center the CT in the viewport, as large as it fits"),
    "A": ("Anterior", "Look at the CT from the front"),
    "P": ("Posterior", "Look at the CT from the back"),
    "L": ("Left", "Look at the CT from the patient's left"),
    "R": ("Right", "Look at the CT from the patient's right"),
    "S": ("Superior", "Look at the CT from the head, the patient's front up"),
    "I": ("Inferior", "Look at the CT from the feet, the patient's front up, as radiologists do"),
}


def frame_everywhere(volume: Volume) -> None:
    """Frame a CT in every free 3D viewport of the screen, in its present direction."""
    screen = bpy.context.screen
    corners = volume_box(volume) * machine().scale
    for area in () if screen is None else [area for area in screen.areas if area.type == "VIEW_3D"]:
        space = area.spaces.active
        for view in space.region_quadviews or [space.region_3d]:
            if not is_held(space, view):
                frame(area, space, view, corners)


class CTMC_OT_view(Needs, bpy.types.Operator):
    """Look at the CT, from a side of the patient or as the viewport looks now."""

    bl_idname = "ctmc.view"
    bl_label = "View CT"
    bl_description = "Center the CT in the viewport, seen from a side of the patient or from the present direction"

    side: EnumProperty(
        name="Side", description="Direction to look from", items=[(key, *texts) for key, texts in SIDES.items()]
    )

    needs = (volumes.has_volume,)

    @classmethod
    def description(cls, _context: Any, properties: Any) -> str:
        """Return the tooltip of the button of a side."""
        return translate(SIDES[properties.side][1])

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Move the eye of this viewport; outside of viewports, of all viewports of the screen.

        In quad view the four come to the CT, and the one that turns looks from the side.
        """
        volume = volumes.current(context.scene)
        assert volume is not None, "poll asks for one"
        area = context.area
        if area is None or area.type != "VIEW_3D":
            frame_everywhere(volume)
            return {"FINISHED"}
        side = "" if self.side == AS_IT_IS else self.side
        space = area.spaces.active
        for view in space.region_quadviews or [space.region_3d]:
            frame(area, space, view, volume_box(volume) * machine().scale, side if view == space.region_3d else "")
        session.redraw_viewports()
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_view,))
