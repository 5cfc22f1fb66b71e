# SPDX-License-Identifier: GPL-3.0-or-later
"""Points and lines of round shapes, to be drawn as wires over a 3D viewport."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

SIDES = 24  # Lines of a circle.
RAILS = 4  # Lines between the two circles of a cylinder.
Pairs = tuple[tuple[int, int], ...]


def cylinder(start: Sequence[float], end: Sequence[float], radius: float) -> tuple[NDArray[np.float64], Pairs]:
    """Return the points (48, 3) of a cylinder's two circles, and the pairs that lines join.

    Parameters
    ----------
    start, end : (x, y, z) float
        Centers of the circles; they differ.
    radius : float
    """
    first, axis = np.array(start, np.float64), np.subtract(end, start)
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    across /= np.linalg.norm(across)
    up = np.cross(axis / np.linalg.norm(axis), across)
    turns = [2 * math.pi * side / SIDES for side in range(SIDES)]
    circle = radius * np.array([math.cos(turn) * across + math.sin(turn) * up for turn in turns])
    rails = tuple((side, side + SIDES) for side in range(0, SIDES, SIDES // RAILS))
    return np.concatenate([first + circle, first + axis + circle]), (*_circle(0), *_circle(SIDES), *rails)


def ball(center: Sequence[float], radius: float) -> tuple[NDArray[np.float64], Pairs]:
    """Return the points (72, 3) of three circles around a center, across x, y and z, and the pairs that lines join."""
    turns = [2 * math.pi * side / SIDES for side in range(SIDES)]
    circle = radius * np.array([(math.cos(turn), math.sin(turn), 0.0) for turn in turns])
    circles = np.concatenate([np.roll(circle, shift, axis=1) for shift in range(3)])
    return np.array(center, np.float64) + circles, sum((_circle(SIDES * each) for each in range(3)), ())


def _circle(first: int) -> Pairs:
    return tuple((first + side, first + (side + 1) % SIDES) for side in range(SIDES))
