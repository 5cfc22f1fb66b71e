# SPDX-License-Identifier: GPL-3.0-or-later
"""Outlines that show a solid before it is made: planes of cuts, drains and pegs. Places are RAS+ mm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles
from ...mesh.vectors import cross, dot
from ..fields.shapes import Bar, HalfSpace
from ..request import Cut, Drain, Pegs, Point


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
        Of the box.

    Returns
    -------
    (4, 3) float64
        Its corners, one after the other.

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


def peg_bars(cut: Cut, pegs: Pegs, corners: Doubles) -> list[Bar]:
    """Return a peg in the middle of a cut's rectangle, for its size; the places of all are known once they are made.

    Parameters
    ----------
    cut : Cut
    pegs : Pegs
    corners : (4, 3) float64
        Of the rectangle.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 2.0, 1.0], [0.0, 2.0, 1.0]])
    >>> peg_bars(Cut((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)), Pegs(3, diameter=4.0, length=6.0), square)
    [Bar(start=(1.0, 1.0, 1.0), end=(1.0, 1.0, -5.0), radius=2.0)]
    """
    middle = corners.mean(axis=0)
    end = middle - pegs.length * HalfSpace(cut.point, cut.normal).unit
    return [Bar(_point(middle), _point(end), pegs.diameter / 2)]


def drain_bars(drain: Drain, vertices: NDArray[np.float32]) -> list[Bar]:
    """Return the holes of a drain through a surface: to its nearest vertex, else at its lowest and highest.

    Parameters
    ----------
    drain : Drain
    vertices : (n, 3) float32
        Of the surface.

    Examples
    --------
    >>> surface = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 5.0], [0.0, 0.0, 9.0]], np.float32)
    >>> drain_bars(Drain(2.0, (2.0, 0.0, 5.0)), surface)
    [Bar(start=(2.0, 0.0, 5.0), end=(5.0, 0.0, 5.0), radius=1.0)]
    >>> [bar.end for bar in drain_bars(Drain(2.0), surface)]
    [(0.0, 0.0, -1.0), (0.0, 0.0, 10.0)]
    """
    radius, bars = drain.diameter / 2, []
    if drain.point is None:
        for number, up in ((int(vertices[:, 2].argmin()), -1.0), (int(vertices[:, 2].argmax()), 1.0)):
            outward = np.array([0.0, 0.0, up])
            bars.append(_bar(vertices[number] - drain.diameter * outward, outward, drain.diameter + radius, radius))
        return bars
    start = np.array(drain.point)
    ways = vertices - start
    way = ways[int((ways * ways).sum(axis=1).argmin())]
    length = float(np.sqrt(dot(way, way)))
    return [_bar(start, way / length, length + radius, radius)] if length else []


def _bar(start: Doubles, direction: Doubles, length: float, radius: float) -> Bar:
    return Bar(_point(start), _point(start + length * direction), radius)


def _point(values: Doubles) -> Point:
    x, y, z = map(float, values)
    return x, y, z
