# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the colors of a map with their values in the lower left of a 3D viewport."""

from __future__ import annotations

import bpy

from ...core.maps import NO_VALUE, rgb_of, stops_of
from ..figure.spec import ColorScale
from .overlay import FONT

BAR = (16.0, 150.0)  # Width and height, pixels at Blender's usual size.
LEFT, BOTTOM, GAP, LETTERS = 70.0, 40.0, 6.0, 12.0
TICKS = 4


def draw_legend(title: str, scale: ColorScale, no_value: str = "") -> None:
    """Draw a color bar with the lowest value at the bottom.

    Parameters
    ----------
    title : str
    scale : ColorScale
    no_value : str
        Text next to the color of what has no value; empty to leave it out.
    """
    import blf

    pixel = bpy.context.preferences.system.ui_scale
    left, bottom, width, height = LEFT * pixel, BOTTOM * pixel, BAR[0] * pixel, BAR[1] * pixel
    if no_value:
        _draw_band([rgb_of(NO_VALUE)] * 2, left, bottom, width, width)
        bottom += 2 * width
    _draw_band(stops_of(scale.ramp), left, bottom, width, height)
    blf.size(FONT, LETTERS * pixel)
    blf.color(FONT, 1.0, 1.0, 1.0, 1.0)
    blf.enable(FONT, blf.SHADOW)
    blf.shadow(FONT, 5, 0.0, 0.0, 0.0, 1.0)
    right = left + width + GAP * pixel
    texts = [
        (right, bottom + height * tick / TICKS - LETTERS * pixel / 3, scale.label(tick / TICKS))
        for tick in range(TICKS + 1)
    ]
    unit = scale.shown_unit.name
    texts[-1] = (*texts[-1][:2], f"{texts[-1][2]} {unit}".rstrip())
    texts.append((left, bottom + height + 1.5 * LETTERS * pixel, title))
    if no_value:
        texts.append((right, BOTTOM * pixel + width / 2 - LETTERS * pixel / 3, no_value))
    for x, y, text in texts:
        blf.position(FONT, x, y, 0.0)
        blf.draw(FONT, text)
    blf.disable(FONT, blf.SHADOW)


def _draw_band(
    colors: list[tuple[float, float, float]], left: float, bottom: float, width: float, height: float
) -> None:
    """Draw sRGB colors in even steps from the bottom to the top of a rectangle."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    last = len(colors) - 1
    corners, shades = [], []
    for number, color in enumerate(colors):
        y = bottom + height * number / last
        corners += [(left, y), (left + width, y)]
        shades += [(*color, 1.0)] * 2
    triangles = [(at + a, at + b, at + c) for at in range(0, 2 * last, 2) for a, b, c in ((0, 1, 2), (1, 3, 2))]
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": corners, "color": shades}, indices=triangles)
    gpu.state.depth_test_set("NONE")
    batch.draw(shader)
