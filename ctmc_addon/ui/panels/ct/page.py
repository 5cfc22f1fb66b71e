# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the page CT: load, the file's CTs, facts, labels, slice, view."""

from __future__ import annotations

import bpy

from ...state.ct import volumes
from ..layout import PagePanel, begin, block, draw_status
from .slice import draw_slice
from .volume import LOAD, LOAD_LABELS, draw_load, draw_views


class CTMC_PT_ct(PagePanel, bpy.types.Panel):
    """Page that loads a CT and shows its facts and slices."""

    bl_idname = "CTMC_PT_ct"
    bl_label = "CT"
    page = "CT"

    def draw(self, context: bpy.types.Context) -> None:
        draw_load(begin(self.layout), context)
        if volumes.current(context.scene) is None:
            draw_status(self.layout, context, LOAD, LOAD_LABELS)
            return
        draw_slice(block(self.layout), context)
        draw_views(block(self.layout))
        draw_status(self.layout, context, LOAD, LOAD_LABELS)
