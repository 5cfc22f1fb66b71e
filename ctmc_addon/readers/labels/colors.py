# SPDX-License-Identifier: GPL-3.0-or-later
"""Convert label colors from the forms that files have to sRGB, 0 to 255.

DICOM PS3.3 C.10.7.1.1 stores CIELab as three numbers of 16 bits. The white point is D65, as in PixelMed, dcmqi and
highdicom; sRGB is that of IEC 61966-2-1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

RGB = tuple[int, int, int]
WHITE = (0.95047, 1.0, 1.08883)  # White as XYZ of D65.
TO_LINEAR_RGB = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))
MOST = 0xFFFF
CYCLE: tuple[RGB, ...] = (
    *((255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (255, 0, 255), (0, 255, 255), (255, 128, 0)),
    *((255, 0, 128), (128, 255, 128), (0, 128, 255), (128, 128, 128), (185, 170, 155)),
)
"""The colors that TotalSegmentator 2 gives to the labels 0, 1, 2, ... and again from 12 on."""
FEW_LABELS = 4  # Fewer labels may have the colors of a palette by chance.
REPETITIONS = 3  # A person may color left and right alike, but not three times in the order of the numbers.


def is_palette(colors: Mapping[int, RGB]) -> bool:
    """Return whether a program chose the colors: by the number of the label, in a cycle, not by what it is.

    Colors are TotalSegmentator's cycle, or repeat at least three times over all labels.

    Examples
    --------
    >>> is_palette({label: CYCLE[label] for label in (1, 2, 5, 7)}), is_palette({2: CYCLE[2], 5: CYCLE[5]})
    (True, False)
    >>> is_palette({label: [(250, 0, 0), (0, 99, 0), (0, 0, 99)][label % 3] for label in range(1, 10)})
    True
    """
    if len(colors) < FEW_LABELS:
        return False
    if all(color == CYCLE[label % len(CYCLE)] for label, color in colors.items()):
        return True
    for length in range(3, (max(colors) - min(colors) + 1) // REPETITIONS + 1):
        cycle: dict[int, RGB] = {}
        repeated = [cycle.setdefault(label % length, color) == color for label, color in colors.items()]
        if all(repeated) and REPETITIONS * len(cycle) <= len(colors) and len(set(cycle.values())) >= 3:
            return True
    return False


def rgb_of_shares(words: Sequence[str]) -> RGB | None:
    """Return the color of three shares of 1 in words; None where they are something else.

    Parameters
    ----------
    words : sequence of str
        Red, green and blue.

    Examples
    --------
    >>> rgb_of_shares(["1", "0.5", "0"]), rgb_of_shares(["1", "2", "0"])
    ((255, 128, 0), None)
    """
    shares = _three_numbers(words)
    if shares is None or not all(0.0 <= share <= 1.0 for share in shares):
        return None
    red, green, blue = (int(255.0 * share + 0.5) for share in shares)
    return (red, green, blue)


def rgb_of_bytes(words: Sequence[str]) -> RGB | None:
    """Return the color of three numbers from 0 to 255 in words; None where they are something else.

    Parameters
    ----------
    words : sequence of str
        Red, green and blue; what lies beyond goes to the nearest limit.

    Examples
    --------
    >>> rgb_of_bytes(["255.0", "-1", "300"]), rgb_of_bytes(["red", "0", "0"])
    ((255, 0, 255), None)
    """
    numbers = _three_numbers(words)
    if numbers is None:
        return None
    red, green, blue = (int(min(255.0, max(0.0, number)) + 0.5) for number in numbers)
    return (red, green, blue)


def _three_numbers(words: Sequence[str]) -> list[float] | None:
    """Return the three finite numbers in a text, or None."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return None
    return numbers if len(numbers) == 3 and all(map(math.isfinite, numbers)) else None


def rgb_of_cielab(stored: Sequence[int]) -> RGB:
    """Return the sRGB color of a RecommendedDisplayCIELabValue; what sRGB cannot show goes to the nearest limit.

    Parameters
    ----------
    stored : 3 int
        L* from 0 to 100, a* and b* from -128 to 127, each spread over 0 to 65535.

    Examples
    --------
    >>> rgb_of_cielab((65535, 32896, 32896)), rgb_of_cielab((34885, 53485, 50171))
    ((255, 255, 255), (255, 0, 0))
    """
    lightness = stored[0] * 100.0 / MOST
    a, b = (value * 255.0 / MOST - 128.0 for value in stored[1:3])
    middle = (lightness + 16.0) / 116.0
    roots = (middle + a / 500.0, middle, middle - b / 200.0)
    xyz = [white * _of_root(root) for white, root in zip(WHITE, roots, strict=True)]
    linear = [sum(share * value for share, value in zip(row, xyz, strict=True)) for row in TO_LINEAR_RGB]
    red, green, blue = (min(255, max(0, round(255.0 * _companded(value)))) for value in linear)
    return (red, green, blue)


def _of_root(root: float) -> float:
    """Invert CIELab's cube root with its straight part near black."""
    cube = root**3
    return cube if cube > 0.008856 else (root - 16.0 / 116.0) / 7.787


def _companded(linear: float) -> float:
    """Return the sRGB value of a linear one."""
    return float(1.055 * linear ** (1 / 2.4) - 0.055) if linear > 0.0031308 else 12.92 * linear
