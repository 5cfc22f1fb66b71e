# SPDX-License-Identifier: GPL-3.0-or-later
"""Color ramps for values on a surface.

All suit color-blind readers. viridis and magma (Smith and van der Walt 2015) have even steps of lightness, so they work
in gray print; `light` is the lighter part of magma, from light to dark. coolwarm (Moreland 2009) is light around 0.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Bytes, Floats

RAMPS = {
    "viridis": (
        "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c "
        "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
    ),
    "magma": (
        "000004 0a0822 1d1147 36106b 51127c 6a1c81 832681 9c2e7f b73779 "
        "d0416f e75263 f56b5c fc8961 fea772 fec488 fde2a3 fcfdbf"
    ),
    "coolwarm": (
        "3b4cc0 4e68d8 6282ea 779af7 8db0fe a3c2fe b9d0f9 ccd9ed dddcdc "
        "ecd3c5 f5c4ac f7b093 f4987a eb7d62 dd5f4b ca3b37 b40426"
    ),
    "light": "fcfdbf feca8d fd9668 f1605d cd4071 9e2f7f 721f81 440f76",
}
"""sRGB colors at even steps from the lowest value to the highest, by the name of the ramp."""
DIVERGING = ("coolwarm",)
"""Ramps with 0 in the middle."""
NO_VALUE = "a0a0a0"
"""The color of a vertex without a value."""


def stops_of(ramp: str) -> list[tuple[float, float, float]]:
    """Return the colors of a ramp as sRGB, 0 to 1."""
    return [rgb_of(color) for color in RAMPS[ramp].split()]


def colors_of(values: Floats, range_: tuple[float, float], ramp: str) -> Bytes:
    """Return the sRGB color of every value, (n, 3) uint8; values beyond the range get the color of its end.

    Parameters
    ----------
    values : (n,) float32
        NaN gets the color `NO_VALUE`.
    range_ : (low, high) float
    ramp : str
        A key of `RAMPS`.

    Examples
    --------
    >>> colors_of(np.array([-1, 1, np.nan], np.float32), (0.0, 1.0), "viridis").tolist()
    [[68, 1, 84], [253, 231, 37], [160, 160, 160]]
    """
    low, high = range_
    stops = np.array(stops_of(ramp)) * 255
    share = np.clip((values.astype(np.float64) - low) / ((high - low) or 1.0), 0.0, 1.0)
    there = np.isfinite(share)
    share[~there] = 0.0
    along = np.linspace(0.0, 1.0, len(stops))
    colors = np.stack([np.interp(share, along, stops[:, channel]) for channel in range(3)], axis=1)
    colors[~there] = np.array(rgb_of(NO_VALUE)) * 255
    return (colors + 0.5).astype(np.uint8)


def linear(color: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """Return the linear RGBA of an sRGB color (IEC 61966-2-1), as Blender's nodes take it."""
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in color)
    return red, green, blue, 1.0


def rgb_of(color: str) -> tuple[float, float, float]:
    """Return the sRGB of a color such as 'fde725', 0 to 1."""
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (0, 2, 4))
    return red, green, blue
