# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the rotation test in a viewport of a window, which is redrawn as a whole."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy

from .levels import Level, show_only


class ViewportDrawing:
    """Draw in a viewport: return once the picture is on the screen, and restore the view at the end.

    The test turns the level about z; zoom and pan move the eye out and back by the same share of a round instead.

    Parameters
    ----------
    window : bpy.types.Window
    area : bpy.types.Area
        A 3D viewport in it.
    motion : {"rotate", "zoom", "pan"}
    """

    def __init__(self, window: bpy.types.Window, area: bpy.types.Area, motion: str) -> None:
        self.window, self.area, self.motion = window, area, motion
        self.levels: Sequence[Level] = ()
        self.eye = area.spaces.active.region_3d

    def __enter__(self) -> ViewportDrawing:
        self.distance, self.location = self.eye.view_distance, self.eye.view_location.copy()
        return self

    def __exit__(self, *_: object) -> None:
        self.eye.view_distance, self.eye.view_location = self.distance, self.location

    def show(self, level: Level) -> None:
        """Show this level and no other."""
        show_only(self.levels, level)

    def draw(self, level: Level) -> None:
        """Draw the window and wait for it."""
        if self.motion != "rotate":
            share = math.sin(level.obj.rotation_euler.z / 2)  # Move out and back within a round.
            level.obj.rotation_euler.z = 0.0
            if self.motion == "zoom":
                self.eye.view_distance = self.distance * (1.0 - 0.5 * share)
            else:
                side = self.eye.view_rotation @ type(self.location)((1.0, 0.0, 0.0))
                self.eye.view_location = self.location + side * (0.25 * self.distance * share)
        self.area.tag_redraw()
        with bpy.context.temp_override(window=self.window):
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
