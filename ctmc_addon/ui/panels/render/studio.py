# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw what renders need: where the camera stands, engine, background, and the buttons."""

from __future__ import annotations

from typing import Any

import bpy

from ....blender.scene.background import is_studio_world
from ....blender.scene.lighting import has_placed_camera
from ... import jobs
from ...operators.render.studio import render_text
from ..layout import draw_text


def draw_render(layout: Any, context: bpy.types.Context) -> None:
    """Draw the settings of a render, Render, Set Up, and what F12 renders with."""
    scene = context.scene
    column = layout.column()
    column.enabled = not jobs.locked()
    column.operator_menu_enum("ctmc.figure_view", "side", icon="CAMERA_DATA")
    column.prop(scene.ctmc_figure, "engine")
    background = column.row()  # Does nothing to a world of the user's.
    background.enabled = is_studio_world(scene.world) or not has_placed_camera(scene)
    background.prop(scene.ctmc_studio, "background")
    button = column.row()
    button.scale_y = 1.5
    button.operator("ctmc.render", icon="RENDER_STILL")
    column.operator("ctmc.setup_studio", icon="OUTLINER_OB_LIGHT")
    draw_text(column, context, f"F12: {render_text(context)}", "INFO")
