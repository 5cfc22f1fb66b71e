# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw a color bar with its numbers in the lower left of a 3D viewport."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from .overlay import FONT

BAR = (16.0, 150.0)  # Width and height, pixels at Blender's usual size.
LEFT, BOTTOM, GAP, LETTERS = 70.0, 40.0, 6.0, 12.0
TICKS = 4


def draw_legend(title: str, colors: Sequence[str], largest: float, unit: str) -> None:
    """Draw a color bar from 0 at the bottom to `largest` at the top.

    Parameters
    ----------
    title : str
    colors : sequence of str
        sRGB, such as 'fde725'.
    largest : float
    unit : str
    """
    import blf
    import gpu
    from gpu_extras.batch import batch_for_shader

    scale = bpy.context.preferences.system.ui_scale
    left, bottom, width, height = LEFT * scale, BOTTOM * scale, BAR[0] * scale, BAR[1] * scale
    last = len(colors) - 1
    corners, shades = [], []
    for number, color in enumerate(colors):
        y = bottom + height * number / last
        corners += [(left, y), (left + width, y)]
        shades += [(*(int(color[at : at + 2], 16) / 255 for at in (0, 2, 4)), 1.0)] * 2
    triangles = [(at + a, at + b, at + c) for at in range(0, 2 * last, 2) for a, b, c in ((0, 1, 2), (1, 3, 2))]
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": corners, "color": shades}, indices=triangles)
    gpu.state.depth_test_set("NONE")
    batch.draw(shader)
    blf.size(FONT, LETTERS * scale)
    blf.color(FONT, 1.0, 1.0, 1.0, 1.0)
    blf.enable(FONT, blf.SHADOW)
    blf.shadow(FONT, 5, 0.0, 0.0, 0.0, 1.0)
    for tick in range(TICKS + 1):
        share = tick / TICKS
        text = f"{largest * share:.3g}" + (f" {unit}" if tick == TICKS else "")
        blf.position(FONT, left + width + GAP * scale, bottom + height * share - LETTERS * scale / 3, 0.0)
        blf.draw(FONT, text)
    blf.position(FONT, left, bottom + height + 1.5 * LETTERS * scale, 0.0)
    blf.draw(FONT, title)
    blf.disable(FONT, blf.SHADOW)
