# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the folds of settings on the page Surface: components, and rarely changed ones."""

from __future__ import annotations

from typing import Any

import bpy

from ....core import COMPONENTS, settings_of_stage
from ....reporting.formatting import count
from ...state import session
from ...translations import translate
from ..layout import block, draw_pair, draw_setting, draw_table
from .reconstruct import alpha_matters


def draw_components(room: Any, context: bpy.types.Context) -> None:
    """Draw which components are kept, and whether the surface is closed at the border."""
    layout = block(room)
    for name in (*settings_of_stage(COMPONENTS), "close_border"):
        draw_setting(layout, context.scene.ctmc, name)


def draw_advanced(room: Any, context: bpy.types.Context) -> None:
    """Draw alpha by an angle, shared walls, normals, topology, the value that replaces NaN, and the command line."""
    layout, settings = block(room), context.scene.ctmc
    row = draw_pair(layout, context)
    row.enabled = alpha_matters(settings)
    row.use_property_split = False
    row.operator("ctmc.choose_alpha", text="Choose Alpha", icon="AUTO")
    row.prop(settings, "min_angle_deg", text="Angle [°]")
    if settings.use_label:
        row = layout.row()
        row.active = sum(item.chosen for item in settings.labels) > 1
        draw_setting(row, settings, "interfaces")
    for name in ("normals", "topology", "nan_as"):
        draw_setting(layout, settings, name)
    cost = session.of(context.scene).cost
    voxels = "-" if cost is None or cost.error else count(cost.voxels)
    draw_table(layout, [(translate("Voxels"), voxels)])
    layout.operator("ctmc.copy_command", text="Copy Command", icon="COPYDOWN")
