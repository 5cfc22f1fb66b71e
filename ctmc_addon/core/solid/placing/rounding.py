# SPDX-License-Identifier: GPL-3.0-or-later
"""Round numbers that messages suggest: few digits, on the side that works, for microns as for meters."""

from __future__ import annotations

from collections.abc import Iterable

DIGITS = 3


def rounded_up(value: float, digits: int = DIGITS) -> float:
    """Return the least number with few digits that is not below `value`.

    Examples
    --------
    >>> rounded_up(12.31), rounded_up(0.01231), rounded_up(-1.239), rounded_up(0.5)
    (12.4, 0.0124, -1.23, 0.5)
    """
    return -rounded_down(-value, digits)


def rounded_down(value: float, digits: int = DIGITS) -> float:
    """Return the greatest number with few digits that is not above `value`.

    Examples
    --------
    >>> rounded_down(12.39), rounded_down(0.01239), rounded_down(1234.0), rounded_down(3.0)
    (12.3, 0.0123, 1230.0, 3.0)
    """
    if not value:
        return 0.0
    nearest = float(f"{value:.{digits - 1}e}")
    return nearest if nearest <= value else float(f"{nearest - step_of(value, digits):.{digits - 1}e}")


def step_of(value: float, digits: int = DIGITS) -> float:
    """Return the value of one unit in the last of a number's digits.

    Examples
    --------
    >>> step_of(12.31), step_of(0.5, 2)
    (0.1, 0.01)
    """
    return float(f"1e{int(f'{value:e}'.partition('e')[2]) - digits + 1}")


def placed(values: Iterable[float], near: float) -> list[float]:
    """Return a point rounded by at most a tenth of `near` for a message, without negative zeros.

    Examples
    --------
    >>> placed((12.3456, -0.0123, 7.0), 2.0), placed((0.123456, 0.02, 0.0), 0.02)
    ([12.3, 0.0, 7.0], [0.123, 0.02, 0.0])
    """
    decimals = -int(f"{near:e}".partition("e")[2]) + 1
    return [round(value, decimals) + 0.0 for value in values]


def place_text(values: Iterable[float], near: float) -> str:
    """Return the text of `placed`.

    Examples
    --------
    >>> place_text((12.3456, -0.0123, 7.0), 2.0)
    '12.3 0 7'
    """
    return " ".join(f"{value:.10g}" for value in placed(values, near))
