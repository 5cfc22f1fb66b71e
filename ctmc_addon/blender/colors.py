# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the colors of surfaces, linear RGB; no Blender here."""

from __future__ import annotations

from ..core.volume import linear, part_rgb, structure_color

Color = tuple[float, float, float]

RED: Color = (0.70, 0.03, 0.025)
YELLOW: Color = (1.0, 0.80, 0.02)
GRAY: Color = (0.52, 0.52, 0.52)
INK: Color = (0.02, 0.02, 0.02)
BONE: Color = (0.76, 0.68, 0.52)


def color_of(label: int | None, rgb: tuple[int, int, int] | None = None, name: str = "") -> Color:
    """Return the color of a label: its own sRGB, else that of its anatomical name, else that of its number.

    A surface by threshold gets the color of bone.
    """
    return BONE if label is None else linear(structure_color(label, rgb, name).rgb)


def part_color(color: Color, number: int) -> Color:
    """Return the color of a part, by its number, of a structure with this color."""
    return linear(part_rgb(srgb(color), number)) if number else color


def srgb(color: Color) -> tuple[int, int, int]:
    """Return the sRGB color, 0 to 255, that is next to a linear one (IEC 61966-2-1).

    Parameters
    ----------
    rgb : (red, green, blue) int
        sRGB, 0 to 255.

    Returns
    -------
    (red, green, blue) float, 0 to 1

    Examples
    --------
    >>> srgb(linear((255, 0, 55))), srgb((-1.0, 0.5, 2.0))
    ((255, 0, 55), (0, 188, 255))
    """
    shares = (min(1.0, max(0.0, share)) for share in color)
    red, green, blue = (
        round(255 * (12.92 * share if share <= 0.0031308 else 1.055 * share ** (1 / 2.4) - 0.055)) for share in shares
    )
    return red, green, blue
