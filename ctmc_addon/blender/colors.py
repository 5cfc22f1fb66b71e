# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors of surfaces, linear RGB; no Blender here."""

from __future__ import annotations

Color = tuple[float, float, float]

RED: Color = (0.70, 0.03, 0.025)
YELLOW: Color = (1.0, 0.80, 0.02)
GRAY: Color = (0.52, 0.52, 0.52)
INK: Color = (0.02, 0.02, 0.02)
BONE: Color = (0.76, 0.68, 0.52)

# A label takes the color of its number, so the same label looks the same in every file.
PALETTE: tuple[Color, ...] = (
    (0.55, 0.13, 0.09),
    RED,
    (0.75, 0.55, 0.28),
    (0.10, 0.28, 0.55),
    (0.16, 0.42, 0.18),
    (0.45, 0.16, 0.50),
    (0.80, 0.30, 0.05),
    (0.10, 0.45, 0.45),
)


def color_of(label: int | None) -> Color:
    """The color of a label, or of bone for a surface by threshold."""
    return BONE if label is None else PALETTE[(label - 1) % len(PALETTE)]
