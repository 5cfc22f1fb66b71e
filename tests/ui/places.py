# SPDX-License-Identifier: GPL-3.0-or-later
"""Places in the scene, mm."""

import bpy

from ctmc_addon.core.volume import volume_box
from ctmc_addon.ui.state.ct import volumes


def cursor_at(*mm):
    bpy.context.scene.cursor.location = [value * 0.01 for value in mm]


def own_center(scene):
    """The middle of the CT, mm."""
    return volume_box(volumes.current_full(scene)).mean(axis=0)
