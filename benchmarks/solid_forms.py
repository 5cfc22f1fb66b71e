# SPDX-License-Identifier: GPL-3.0-or-later
"""Balls, capsules, tori and boxes in any pose, with their distances and the volumes of all bodies parallel to them.

Lengths are in voxels of 1 mm. Points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import Volume

Doubles = NDArray[np.float64]
AROUND = 3  # Voxels around a body.
CLAMP, HU_PER_MM = 3.0, 500.0  # A gray value is the distance up to some voxels, as a CT holds it.


@dataclass(frozen=True)
class Form:
    """A body about the origin.

    Parameters
    ----------
    name : str
    at : callable of points (3, n)
        Distance to the surface, positive inside.
    volume : callable of float
        Volume of the body whose surface is moved outward by this, inward if negative.
    reach : float
        No point of it is farther from the middle.
    inner : float
        A point in the middle of its material is so far from the middle, along x.
    genus : int
    """

    name: str
    at: Callable[[Doubles], Doubles]
    volume: Callable[[float], float]
    reach: float
    inner: float
    genus: int = 0


@dataclass(frozen=True)
class Pose:
    """A turn, and the place of the middle between voxels.

    Parameters
    ----------
    turn : (3, 3) float64
    offset : (3,) float64
        Shares of a voxel.
    """

    turn: Doubles
    offset: Doubles


def ball(radius: float) -> Form:
    """Return a ball."""
    return Form("ball", lambda at: radius - length(at), lambda more: ball_volume(radius + more), radius, radius / 2)


def capsule(radius: float) -> Form:
    """Return a capsule, two diameters long."""
    half = radius

    def distance(at: Doubles) -> Doubles:
        return radius - length(at - np.clip(at[2], -half, half) * np.array([[0.0], [0], [1]]))

    def volume(more: float) -> float:
        return float(ball_volume(radius + more) + np.pi * (radius + more) ** 2 * 2 * half)

    return Form("capsule", distance, volume, radius + half, radius / 2)


def torus(tube: float) -> Form:
    """Return a torus whose ring is twice as wide as its tube."""
    ring = 2 * tube

    def distance(at: Doubles) -> Doubles:
        return tube - np.hypot(np.hypot(at[0], at[1]) - ring, at[2])

    return Form("torus", distance, lambda more: float(2 * np.pi**2 * ring * (tube + more) ** 2), ring + tube, ring, 1)


def box(half: float) -> Form:
    """Return a box with sides in proportions of 1 : 1.2 : 1.4; grown, it is the sum of the box and a ball."""
    halves = half * np.array([1.0, 1.2, 1.4])

    def distance(at: Doubles) -> Doubles:
        over = np.abs(at) - halves[:, None]
        return -length(np.maximum(over, 0)) - np.minimum(over.max(axis=0), 0)

    def volume(more: float) -> float:
        a, b, c = 2 * (halves + min(more, 0.0))
        grown = max(more, 0.0)
        faces, edges = 2 * (a * b + b * c + a * c), a + b + c
        return float(a * b * c + faces * grown + np.pi * edges * grown**2 + ball_volume(grown))

    return Form("box", distance, volume, float(np.sqrt((halves**2).sum())), half / 2)


FORMS = (ball, capsule, torus, box)


def poses() -> list[Pose]:
    """Return poses along the grid and turned, each between voxels."""
    draw = np.random.default_rng(35)
    turns = [np.eye(3), *(turn_of(*draw.uniform(0, 2 * np.pi, 3)) for _ in range(2))]
    return [Pose(turn, draw.uniform(-0.5, 0.5, 3)) for turn in turns]


def turn_of(first: float, second: float, third: float) -> Doubles:
    """Return a turn by three angles about z, y and z."""
    turns = []
    for angle, (a, b) in ((first, (0, 1)), (second, (0, 2)), (third, (0, 1))):
        turn = np.eye(3)
        turn[a, a] = turn[b, b] = np.cos(angle)
        turn[a, b], turn[b, a] = -np.sin(angle), np.sin(angle)
        turns.append(turn)
    return np.asarray(turns[0] @ turns[1] @ turns[2])


@dataclass(frozen=True)
class Posed:
    """A body in a volume."""

    form: Form
    pose: Pose

    @property
    def size(self) -> int:
        """Voxels along every side of the volume."""
        return 2 * int(np.ceil(self.form.reach + AROUND)) + 1

    @property
    def middle(self) -> Doubles:
        """Middle of the body, mm."""
        return (self.size - 1) / 2 + self.pose.offset

    def at(self, points: Doubles) -> Doubles:
        """Return the distance of points to its surface, positive inside."""
        return self.form.at(self.pose.turn @ (points - self.middle[:, None]))

    def turned(self, ways: Doubles) -> Doubles:
        """Return ways (3, n) of the body in the volume."""
        return np.asarray(self.pose.turn.T @ ways)

    def volume(self, label: bool) -> Volume:
        """Return the body as gray values, or as a label."""
        points = np.indices((self.size,) * 3)[::-1].reshape(3, -1).astype(np.float64)
        distance = self.at(points).reshape((self.size,) * 3)
        if label:
            return Volume((distance > 0).astype(np.uint8), np.eye(4), name=self.form.name, kind="label")
        values = np.rint(HU_PER_MM * np.clip(distance, -CLAMP, CLAMP)).astype(np.int16)
        return Volume(values, np.eye(4), name=self.form.name)


def length(vectors: Doubles) -> Doubles:
    """Return the lengths of vectors (3, n)."""
    return np.sqrt((vectors**2).sum(axis=0))


def ball_volume(radius: float) -> float:
    """Return the volume of a ball."""
    return float(4 / 3 * np.pi * radius**3)
