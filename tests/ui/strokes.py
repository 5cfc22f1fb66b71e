# SPDX-License-Identifier: GPL-3.0-or-later
"""Strokes without a window, and what came of them."""

from __future__ import annotations

import bpy

from ctmc_addon.core.volume import volume_box
from ctmc_addon.ui.properties.drawing import points_of
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.draw import drawings, masks


def middle():
    """The middle of the ball, RAS+ mm."""
    box = volume_box(volumes.current(bpy.context.scene))
    return tuple(((box[0] + box[7]) / 2).tolist())


def stroke(*points, **options):
    return bpy.ops.ctmc.draw_stroke(stroke=points_of(points), **options)


def mask():
    scene = bpy.context.scene
    return masks.of(scene, drawings.active(scene)).mask
