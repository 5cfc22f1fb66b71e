# SPDX-License-Identifier: GPL-3.0-or-later
"""Planes that stay flat: a vertex on one stays on it, and goes only to a vertex on the same ones.

A quadric lets a vertex leave a plane where another surface meets it there, so a cut would bend at its rim. Here the
place of least error is moved straight to the plane; where planes meet, a vertex stays on their line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Bytes, Doubles, Flags, Floats
from ...mesh.vectors import dot

MOST_FLATS = 8


@dataclass(frozen=True)
class Flat:
    """Parallel planes.

    Parameters
    ----------
    normal : (3,) float64
        Of length 1.
    heights : (n,) float64
        Of the planes along the normal, from the origin.
    near : float
        Vertices no farther away than this are on a plane.
    """

    normal: Doubles
    heights: Doubles
    near: float

    def scaled(self, scale: float) -> Flat:
        """Return the planes of positions times a scale."""
        return Flat(self.normal, self.heights * scale, self.near * scale)

    def off(self, points: Floats) -> Doubles:
        """Return how high points (3, n) are above the nearest plane, (n,)."""
        height = dot(self.normal[:, None], points.astype(np.float64))
        off = height - self.heights[0]
        for each in self.heights[1:]:
            other = height - each
            off = np.where(np.abs(other) < np.abs(off), other, off)
        return off


def on_flats(flats: Sequence[Flat], points: Floats) -> Bytes:
    """Return on which flats points (3, n) are, as bits, (n,)."""
    assert len(flats) <= MOST_FLATS
    bits = np.zeros(points.shape[1], np.uint8)
    for number, flat in enumerate(flats):
        bits |= (np.abs(flat.off(points)) <= flat.near).astype(np.uint8) << np.uint8(number)
    return bits


def leaves_flat(bits: tuple[Bytes, Bytes], stays: tuple[Flags, Flags]) -> Flags:
    """Return of which edges a collapse would take a vertex off a plane, (n,) bool.

    `bits` of `on_flats` and whether an end has to stay are of the first ends and of the second.
    """
    (first, second), (first_stays, second_stays) = bits, stays
    only_first, only_second = (first & ~second) != 0, (second & ~first) != 0
    return only_first & (only_second | second_stays) | only_second & first_stays


def flattened(flats: Sequence[Flat], bits: tuple[Bytes, Bytes], ends: tuple[Floats, Floats], target: Floats) -> Floats:
    """Return where edges that do not leave a plane collapse to, (3, n): their targets, moved to the planes.

    Parameters
    ----------
    flats : sequence of Flat
    bits : two of (n,) uint8
        Of their ends, as `on_flats` returns them.
    ends : two of (3, n) float32
    target : (3, n) float32
    """
    (first, second), (start, end) = bits, ends
    both = first | second
    out = np.where(first == second, (start + end) * np.float32(0.5), np.where(first == both, start, end))
    for number, flat in enumerate(flats):
        own = np.flatnonzero(both == 1 << number)
        points = target[:, own]
        out[:, own] = points - flat.normal[:, None] * flat.off(points)
    none = both == 0
    out[:, none] = target[:, none]
    return out
