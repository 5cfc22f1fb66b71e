# SPDX-License-Identifier: GPL-3.0-or-later
"""Set the direction of the figures' camera: the operator `ctmc.figure_view`."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty

from ....blender.scene.studio import angles_of
from ...translations import translate

# Azimuth and elevation, degrees.
VIEWS = {
    "oblique": (30.0, 20.0),
    "front": (0.0, 0.0),
    "left": (90.0, 0.0),
    "back": (180.0, 0.0),
    "right": (-90.0, 0.0),
    "head": (0.0, 90.0),
    "feet": (0.0, -90.0),
}


class CTMC_OT_figure_view(bpy.types.Operator):
    """Set where the figure's camera stands."""

    bl_idname = "ctmc.figure_view"
    bl_label = "View From"
    bl_description = "Direction from which the camera of figures looks; the head stays up"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    side: EnumProperty(
        name="Side",
        description="Camera position",
        items=[
            ("viewport", "This Viewport", "As the viewport shows it now"),
            ("oblique", "Front and Left", "From the front, a little from the patient's left and from above"),
            ("front", "Front", "Before the patient"),
            ("left", "Left", "At the patient's left"),
            ("back", "Back", "Behind the patient"),
            ("right", "Right", "At the patient's right"),
            ("head", "Head", "Above the head"),
            ("feet", "Feet", "Below the feet"),
        ],
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        panel, eye = context.scene.ctmc_figure, getattr(context.space_data, "region_3d", None)
        if self.side != "viewport":
            panel.azimuth, panel.elevation = VIEWS[self.side]
        elif eye is None:
            self.report({"ERROR"}, translate("There is no 3D viewport to take the view from"))
            return {"CANCELLED"}
        else:
            panel.azimuth, panel.elevation = angles_of(eye.view_rotation.to_matrix().col[2])
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_figure_view,))
