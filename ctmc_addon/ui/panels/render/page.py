# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the page Render: camera and lights, and below them figures for print, the rotation test, the CT as an object."""

from __future__ import annotations

import bpy

from ....blender.volume import vdb_writer
from ...state.ct import volumes
from ..layout import PagePanel, begin, draw_status, fold, lacks_ct
from .figure import OPERATORS, draw_figure
from .rotation import draw_rotation
from .studio import draw_render
from .volume_object import draw_volume_object


class CTMC_PT_render(PagePanel, bpy.types.Panel):
    """Page for renders and figures."""

    bl_idname = "CTMC_PT_render"
    bl_label = "Render"
    page = "RENDER"

    def draw(self, context: bpy.types.Context) -> None:
        layout = begin(self.layout)
        if lacks_ct(layout, context):
            draw_status(self.layout, context)
            return
        draw_render(layout, context)
        body = fold(self.layout, "figure", text="Figure for Print")
        if body is not None:
            draw_figure(body, context)
        body = fold(self.layout, "rotation", text="Rotation Test")
        if body is not None:
            draw_rotation(body, context)
        if volumes.current(context.scene) is not None and vdb_writer() is not None:
            body = fold(self.layout, "volume_object", text="Volume Object")
            if body is not None:
                draw_volume_object(body, context)
        draw_status(self.layout, context, "ctmc.rotation_test", *OPERATORS.values())
