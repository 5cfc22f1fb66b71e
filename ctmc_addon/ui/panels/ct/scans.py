# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the CTs of the file, a row for each, as Blender lists data-blocks; and the way past a damaged slice."""

from __future__ import annotations

from typing import Any

import bpy

from ....reporting.formatting import size_of_bytes
from ... import jobs
from ...properties.ct.reading import set_button
from ...state import session
from ...state.ct import scans, volumes
from ..layout import is_narrow


def draw_cts(layout: Any, context: bpy.types.Context) -> None:
    """Draw a row for each CT: its name, pressed for the panel's, its memory, which a press frees, and Remove."""
    scene = context.scene
    column = layout.column(align=True)
    column.enabled = jobs.running() is None
    for ct in scans.listed(scene):
        fingerprint, loaded = ct.volume_fingerprint, volumes.ct_of(ct.volume_fingerprint)
        row = column.row(align=True)
        name = scans.name_of(scene, ct)
        is_chosen = fingerprint == scene.ctmc.volume_fingerprint
        choose = row.operator("ctmc.choose_ct", text=name, icon="VOLUME_DATA", translate=False, depress=is_chosen)
        choose.fingerprint = fingerprint
        if loaded is not None:
            size = "" if is_narrow(context) else size_of_bytes(loaded.nbytes)
            freed = row.row(align=True)
            freed.ui_units_x = 5.2 if size else 1.0
            freed.operator("ctmc.free_ct", text=size, icon="MEMORY", translate=False).fingerprint = fingerprint
        row.operator("ctmc.remove_ct", text="", icon="X").fingerprint = fingerprint


def draw_without_damaged(layout: Any, context: bpy.types.Context) -> None:
    """Draw a button that reads the CT that was refused, without its damaged slices."""
    refused = session.of(context.scene).refused
    if refused is None:
        return
    path, reading = refused
    button = layout.operator("ctmc.load", text="Load Without Damaged Slices", icon="FILE_REFRESH")
    set_button(button, reading)
    button.filepath, button.skip_damaged = path, True
