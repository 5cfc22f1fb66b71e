# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the tab CTMC in the 3D viewport's sidebar: a row of five buttons, and the page that is chosen."""

from __future__ import annotations

import bpy

from ..state import scans
from .ct.page import CTMC_PT_ct
from .draw import CTMC_PT_draw
from .layout import SidePanel, is_narrow
from .render_page import CTMC_PT_render
from .results import CTMC_PT_results
from .surface import CTMC_PT_surface

STEPS = (CTMC_PT_ct, CTMC_PT_surface, CTMC_PT_draw, CTMC_PT_results, CTMC_PT_render)
"""The pages, in the order of the work."""


class CTMC_PT_main(SidePanel, bpy.types.Panel):
    """Parent of the pages, with the row that chooses one."""

    bl_idname = "CTMC_PT_main"
    bl_label = "CTMC"
    bl_options = {"HIDE_HEADER"}  # noqa: RUF012  (Blender reads it from the class)

    def draw(self, context: bpy.types.Context) -> None:
        scans.notice(context)
        layout = self.layout.grid_flow(columns=2, align=True) if is_narrow(context) else self.layout.row(align=True)
        layout.prop(context.window_manager, "ctmc_page", expand=True)


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_main, *STEPS))
