# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the tab CTMC in the 3D viewport's sidebar: a row of five buttons, and the page that is chosen."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from ..properties.page import PAGES
from ..state.ct import scans
from ..translations import translate
from .ct.page import CTMC_PT_ct
from .draw import CTMC_PT_draw
from .layout import SidePanel, text_width, width_of
from .render.page import CTMC_PT_render
from .results.page import CTMC_PT_results
from .surface.page import CTMC_PT_surface

STEPS = (CTMC_PT_ct, CTMC_PT_surface, CTMC_PT_draw, CTMC_PT_results, CTMC_PT_render)
"""The pages, in the order of the work."""
MARGIN, PADDING = 52.0, 2.0  # Pixels beside the row, tabs included, and of a button beside its word.


class CTMC_PT_main(SidePanel, bpy.types.Panel):
    """Parent of the pages, with the row that chooses one."""

    bl_idname = "CTMC_PT_main"
    bl_label = "CTMC"
    bl_options = {"HIDE_HEADER"}  # noqa: RUF012  (Blender reads it from the class)

    def draw(self, context: bpy.types.Context) -> None:
        scans.notice(context)
        names = {key: translate(name) for key, (name, _) in PAGES.items()}
        column = self.layout.column(align=True)
        for keys in lines_of(names, width_of(context) - MARGIN):
            row = column.row(align=True)
            for key in keys:
                row.prop_enum(context.window_manager, "ctmc_page", key, text=names[key], translate=False)


def lines_of(names: Mapping[str, str], room: float) -> list[list[str]]:
    """Return the keys of buttons of equal width in one line, or in more where a name would be cut.

    Parameters
    ----------
    names : dict of str to str
        Their keys and words.
    room : float
        Pixels.
    """
    keys, widest = list(names), max(text_width(name) for name in names.values()) + PADDING
    columns = next((n for n in (len(keys), 3, 2) if n * widest <= room), 1)
    return [keys[start : start + columns] for start in range(0, len(keys), columns)]


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_main, *STEPS))
