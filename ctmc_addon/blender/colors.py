# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors of surfaces, linear RGB; no Blender here."""

from __future__ import annotations

from ..core.volume import linear, structure_color

Color = tuple[float, float, float]

RED: Color = (0.70, 0.03, 0.025)
YELLOW: Color = (1.0, 0.80, 0.02)
GRAY: Color = (0.52, 0.52, 0.52)
INK: Color = (0.02, 0.02, 0.02)
BONE: Color = (0.76, 0.68, 0.52)


def color_of(label: int | None, rgb: tuple[int, int, int] | None = None, name: str = "") -> Color:
    """Return the color of a label: its own sRGB, else that of its anatomical name, else that of its number.

    Of bone for a surface by threshold.
    """
    return BONE if label is None else linear(structure_color(label, rgb, name).rgb)
