# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors of surfaces, linear RGB; no Blender here."""

from __future__ import annotations

Color = tuple[float, float, float]

RED: Color = (0.70, 0.03, 0.025)
YELLOW: Color = (1.0, 0.80, 0.02)
GRAY: Color = (0.52, 0.52, 0.52)
INK: Color = (0.02, 0.02, 0.02)
BONE: Color = (0.76, 0.68, 0.52)

# Okabe and Ito's colors, sRGB: told apart by color-blind eyes too. https://jfly.uni-koeln.de/color/
HUES = ((213, 94, 0), (0, 114, 178), (240, 228, 66), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0))
LIGHTNESS = (1.0, 0.62, 1.35)  # of the first seven labels, the next seven, the third; then all of them again


def linear(rgb: tuple[int, int, int]) -> Color:
    """Return the linear color of an sRGB one, 0 to 255 (IEC 61966-2-1).

    Parameters
    ----------
    rgb : (red, green, blue) int
        sRGB, 0 to 255.

    Returns
    -------
    (red, green, blue) float, 0 to 1

    Examples
    --------
    >>> linear((255, 0, 55))
    (1.0, 0.0, 0.038204371595346506)
    """
    red, green, blue = (share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in
                        (level / 255 for level in rgb))  # fmt: skip
    return red, green, blue


def label_rgb(label: int) -> tuple[int, int, int]:
    """Return the sRGB color of a label that has none of its own: the same for its number in every file.

    Examples
    --------
    >>> label_rgb(2), label_rgb(9), label_rgb(23)
    ((0, 114, 178), (0, 71, 110), (0, 114, 178))
    """
    light, hue = divmod((label - 1) % (len(HUES) * len(LIGHTNESS)), len(HUES))
    factor = LIGHTNESS[light]
    red, green, blue = (
        round(level * factor if factor <= 1 else 255 - (255 - level) * (2 - factor)) for level in HUES[hue]
    )
    return red, green, blue


def color_of(label: int | None, rgb: tuple[int, int, int] | None = None) -> Color:
    """Return the color of a label: its own sRGB, else that of its number; of bone for a surface by threshold.

    Parameters
    ----------
    label : int or None
        None for a surface by threshold.
    rgb : (red, green, blue) int, optional
        sRGB, 0 to 255.
    """
    return BONE if label is None else linear(rgb or label_rgb(label))
