# SPDX-License-Identifier: GPL-3.0-or-later
"""The color and opacity that a structure begins with: its file's own color, else that of its name, else a palette's."""

from __future__ import annotations

from .anatomy import Anatomy, anatomy_of

RGB = tuple[int, int, int]
LinearColor = tuple[float, float, float]

# Okabe and Ito's colors, sRGB: told apart by color-blind eyes too. https://jfly.uni-koeln.de/color/
HUES = ((213, 94, 0), (0, 114, 178), (240, 228, 66), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0))
LIGHTNESS = (1.0, 0.62, 1.35)  # The first seven labels, the next seven, the third; then all of them again.
BONE: RGB = (226, 215, 191)  # The color of a surface by threshold.
# Of five shades in turn two differ if their numbers differ by a power of 2, as those of parts on two sides of a cut do.
SHADES = (0.0, 0.3, 0.15, 0.45, 0.22)


def linear(rgb: RGB) -> LinearColor:
    """Return the linear color of an sRGB one, 0 to 255 (IEC 61966-2-1).

    Examples
    --------
    >>> [round(share, 4) for share in linear((255, 0, 55))]
    [1.0, 0.0, 0.0382]
    """
    red, green, blue = (share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in
                        (level / 255 for level in rgb))  # fmt: skip
    return red, green, blue


def label_rgb(label: int) -> RGB:
    """Return the sRGB color of a label without a color: the same for its number in every file.

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


def part_rgb(rgb: RGB, number: int) -> RGB:
    """Return the sRGB color of a part of a structure: the first has the structure's, others a lighter or darker shade.

    Parameters
    ----------
    rgb : (red, green, blue) int
        Of the structure; light colors get darker, dark ones lighter.
    number : int
        Of the part, from 0.

    Examples
    --------
    >>> part_rgb((122, 28, 40), 0), part_rgb((122, 28, 40), 1), part_rgb((226, 215, 191), 1)
    ((122, 28, 40), (162, 96, 104), (158, 150, 134))
    """
    red, green, blue = rgb
    end = 0 if 2 * red + 5 * green + blue > 8 * 128 else 255  # Rec. 601's luma, roughly.
    share = SHADES[number % len(SHADES)]
    red, green, blue = (round(level + share * (end - level)) for level in rgb)
    return red, green, blue


def structure_color(label: int | None, rgb: RGB | None = None, name: str = "") -> Anatomy:
    """Return the color and opacity of a structure that nobody has chosen them for.

    Parameters
    ----------
    label : int or None
        Its number; None for a surface by threshold, which is of bone.
    rgb : (red, green, blue) int, optional
        sRGB, what its file gives it: goes before the color of its name.
    name : str
        Name in its file: gives the opacity, and the color if the file has none.

    Examples
    --------
    >>> structure_color(1, None, "liver") == structure_color(7, None, "Leber")
    True
    >>> structure_color(1, (9, 9, 9), "liver"), structure_color(2, None, "structure 2")
    (Anatomy(rgb=(9, 9, 9), opacity=0.6), Anatomy(rgb=(0, 114, 178), opacity=1.0))
    """
    anatomy = anatomy_of(name)
    if label is None:
        return Anatomy(rgb or BONE, 1.0)
    return Anatomy(rgb or (anatomy.rgb if anatomy else label_rgb(label)), anatomy.opacity if anatomy else 1.0)
