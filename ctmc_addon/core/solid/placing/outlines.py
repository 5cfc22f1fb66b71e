# SPDX-License-Identifier: GPL-3.0-or-later
"""Show and move the planes of cuts. Points are RAS+ mm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Doubles
from ...mesh.vectors import cross, dot
from ..fields.shapes import HalfSpace
from ..request import Cut, Point


def position_of(cut: Cut) -> float:
    """Return the height of a cut's plane above the origin, along its normal, mm.

    Examples
    --------
    >>> position_of(Cut((5.0, 6.0, 7.0), (0.0, 0.0, -2.0)))
    -7.0
    """
    return -float(HalfSpace(cut.point, cut.normal).at(np.zeros((3, 1)))[0])


def moved_to(cut: Cut, position: float) -> Cut:
    """Return a cut moved along its normal to a position, mm.

    Examples
    --------
    >>> moved_to(Cut((5.0, 6.0, 7.0), (0.0, 0.0, -2.0)), 3.0).point
    (5.0, 6.0, -3.0)
    """
    move = position - position_of(cut)
    return replace(cut, point=_point(np.array(cut.point) + move * HalfSpace(cut.point, cut.normal).unit))


def rectangle_of(cut: Cut, corners: Doubles) -> Doubles:
    """Return the rectangle of a cut's plane that covers a box, seen along the normal.

    Parameters
    ----------
    cut : Cut
    corners : (n, 3) float64
        Corners of the box.

    Returns
    -------
    (4, 3) float64
        Corners of the rectangle in order.

    Examples
    --------
    >>> box = np.array([[x, y, z] for z in (0.0, 9.0) for y in (0.0, 2.0) for x in (0.0, 4.0)])
    >>> rectangle_of(Cut((1.0, 1.0, 3.0), (0.0, 0.0, 1.0)), box).tolist()
    [[0.0, 0.0, 3.0], [4.0, 0.0, 3.0], [4.0, 2.0, 3.0], [0.0, 2.0, 3.0]]
    """
    normal = HalfSpace(cut.point, cut.normal).unit
    across = np.zeros(3)
    across[(int(np.abs(normal).argmax()) + 1) % 3] = 1.0
    across -= dot(across, normal) * normal
    across /= np.sqrt(dot(across, across))
    up = cross(normal, across)
    from_point = (corners - np.array(cut.point)).T  # (3, n)
    low_x, high_x, low_y, high_y = (
        end(dot(from_point, axis[:, None])) for axis in (across, up) for end in (np.min, np.max)
    )
    sides = ((low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y))
    return np.array([np.array(cut.point) + x * across + y * up for x, y in sides])


def _point(values: Doubles) -> Point:
    x, y, z = map(float, values)
    return x, y, z
