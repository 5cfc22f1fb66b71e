# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the folds of settings on the page Surface: components, and rarely changed ones."""

from __future__ import annotations

from typing import Any

import bpy

from .layout import block, draw_setting

COMPONENTS = ("keep_parts", "min_part_mm3", "close_border")
ADVANCED = ("normals", "topology", "nan_as")


def draw_settings(room: Any, context: bpy.types.Context, names: tuple[str, ...]) -> None:
    """Draw these settings."""
    layout = block(room)
    for name in names:
        draw_setting(layout, context.scene.ctmc, name)
