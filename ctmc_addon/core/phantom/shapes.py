# SPDX-License-Identifier: GPL-3.0-or-later
"""Star-shaped bodies of known volume: the phantom's liver and tumors.

A blob is an ellipsoid whose radius rises or falls towards some directions. In the space where the
ellipsoid is the unit ball the radius along the unit vector n is a polynomial,
r(n) = 1 + sum of height * ((1 + n . direction) / 2)^8, so its volume, a third of the integral of r^3, is
exact by a product rule on the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Blob:
    """A star-shaped body.

    Parameters
    ----------
    center, half_axes : (x, y, z) float, millimeters
        Center and half axes of the ellipsoid it starts from.
    lobes : (n, 3) float64
        Unit vectors of the directions in which it rises or falls, in the space of the unit ball.
    heights : (n,) float64
        Heights in radii.
    """

    center: Point
    half_axes: Point
    lobes: NDArray[np.float64]
    heights: NDArray[np.float64]

    def radius(self, x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return r(n) for the unit vectors (x, y, z), in radii of the ellipsoid."""
        total = np.ones(np.broadcast_shapes(x.shape, y.shape, z.shape))
        for (a, b, c), height in zip(self.lobes.tolist(), self.heights.tolist(), strict=True):
            rise = (x * a + y * b + z * c) * 0.5 + 0.5
            for _ in range(3):
                rise *= rise
            total += height * rise
        return total

    @cached_property
    def rim(self) -> NDArray[np.float64]:
        """r(n) at `directions()`, (338,)."""
        return self.radius(*directions()[0].T)

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Bounds of r(n): its extremes at `directions()` and a margin for what lies between them."""
        return (float(self.rim.min()) - 0.1, float(self.rim.max()) + 0.1)

    @cached_property
    def steepness(self) -> float:
        """A bound of how fast the depth changes along a line that stays outside the ball of the smaller limit.

        A lobe's slope over the angle is largest at 2 atan(sqrt(1/15)), where it is 1.233 of its height.
        """
        return 1.0 + 1.24 * float(np.abs(self.heights).sum()) / self.limits[0]

    def box(self, axis: int) -> tuple[float, float]:
        """Return bounds of the body along an axis, mm."""
        reach = self.limits[1] * self.half_axes[axis]
        return (self.center[axis] - reach, self.center[axis] + reach)

    def reach(self, axis: int, sign: float) -> float:
        """Return how far the body reaches from its center along +axis or -axis, in half axes, with a small margin."""
        return float((directions()[0][:, axis] * sign * self.rim).max()) + 0.03

    def inside(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the points (n, 3), mm, are inside, (n,)."""
        x, y, z = ((points[:, axis] - self.center[axis]) / self.half_axes[axis] for axis in range(3))
        return self.depth(x, y, z) > 0

    def in_slice(
        self, x: NDArray[np.float64], y: NDArray[np.float64], z: float, thickness: float
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Return which voxels of a slice have their center inside, and how much of each lies inside.

        Parameters
        ----------
        x, y : (columns,), (rows,) float64
            Positions of the voxels' centers, mm.
        z, thickness : float
            Middle and thickness of the slice, mm.

        Returns
        -------
        inside : (rows, columns) bool
        share : (rows, columns) float64
            Of the line through the center, from the bottom of the slice to its top, with depth taken to be linear
            between five heights.
        """
        shape = len(y), len(x)
        inside, share = np.zeros(shape, bool), np.zeros(shape)
        u = np.broadcast_to((x - self.center[0]) / self.half_axes[0], shape)
        v = np.broadcast_to(((y - self.center[1]) / self.half_axes[1])[:, None], shape)
        w, half = (z - self.center[2]) / self.half_axes[2], thickness / 2 / self.half_axes[2]
        square, nearest = u * u + v * v, max(abs(w) - half, 0.0)
        inside[square + (abs(w) + half) ** 2 < self.limits[0] ** 2] = True
        rim = np.flatnonzero(~inside & (square + nearest**2 < self.limits[1] ** 2))
        u, v = u.take(rim), v.take(rim)
        middle = self.depth(u, v, np.array(w))
        inside.flat[rim] = middle > 0
        share[inside] = 1.0
        cut = (np.abs(middle) < self.steepness * half) | (u * u + v * v < self.limits[0] ** 2)
        below, low, high, above = self.depth(u[cut], v[cut], w + half * np.array([[-1.0], [-0.5], [0.5], [1.0]]))
        depths = (below, low, middle[cut], high, above)
        share.flat[rim[cut]] = sum(map(_share_inside, depths, depths[1:])) / 4
        return inside, share

    def depth(self, u: NDArray[np.float64], v: NDArray[np.float64], w: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far below the surface positions are, along the ray from the center; below 0 outside.

        Positions, of shapes that broadcast, and depth are in the space of the unit ball.
        """
        length = np.sqrt(u * u + v * v + w * w)
        unit = np.where(length > 0, length, 1.0)
        return self.radius(u / unit, v / unit, w / unit) - length

    def surface(self, factor: float = 1.0, margin_mm: float = 0.0) -> NDArray[np.float64]:
        """Return the points of the surface at `directions()`, moved out by a factor and a margin, (338, 3) mm."""
        out = directions()[0] * (self.rim * factor)[:, None] * np.array(self.half_axes)
        length = np.sqrt(out[:, 0] ** 2 + out[:, 1] ** 2 + out[:, 2] ** 2)
        return out * (1.0 + margin_mm / length)[:, None] + np.array(self.center)

    def volume_mm3(self, half_height_mm: float | None = None) -> float:
        """Return the volume, mm3; with `half_height_mm` that of the part with |z| below it, to about 1e-4 of it."""
        if half_height_mm is None:
            radii, weights = self.rim, directions()[1]
        else:
            unit, weights = directions(80, 160)
            radii = self.radius(*unit.T)
            room = np.where(unit[:, 2] > 0, half_height_mm - self.center[2], half_height_mm + self.center[2])
            radii = np.minimum(radii, room / (self.half_axes[2] * np.abs(unit[:, 2])))
        a, b, c = self.half_axes
        return float((weights * radii**3).sum() / 3.0 * (a * b * c))


def _share_inside(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return which part of a line is inside whose depth changes evenly from start to end."""
    span = np.abs(start) + np.abs(end)
    return (np.maximum(start, 0) + np.maximum(end, 0)) / np.where(span > 0, span, 1.0)


@lru_cache(maxsize=2)
def directions(rings: int = 13, around: int = 26) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return unit vectors (n, 3) and weights (n,) that integrate over the sphere.

    Gauss-Legendre along z and even steps about it: exact for polynomials up to degree 2 * rings - 1 and
    below `around`; r^3 of a `Blob` has degree 24. The vectors are rounded, so that they do
    not depend on the last bit of a machine's cosine.
    """
    gauss: Any = np.polynomial.legendre.leggauss  # untyped in some of NumPy's own stubs
    height, weight = gauss(rings)
    turn = (np.arange(around) + 0.5) * (2 * np.pi / around)
    flat = np.sqrt(1 - height**2)
    unit = np.stack(
        [np.outer(flat, np.cos(turn)).ravel(), np.outer(flat, np.sin(turn)).ravel(), np.repeat(height, around)], axis=1
    )
    return np.rint(unit * 2**30) / 2**30, np.repeat(weight * (2 * np.pi / around), around)


def unit_vectors(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rows (n, 3) at length 1."""
    length = np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)
    return vectors / length[:, None]


def liver_shape(rng: np.random.Generator, scale: float, gap_mm: float) -> Blob:
    """Return a big right lobe, a left lobe that reaches to the front, a hollow towards the stomach and spine."""
    lobes = unit_vectors(
        np.array([[1.0, -0.55, 0.25], [0.55, 0.8, -0.2], [-0.5, 0.75, -0.3], [0.0, -0.6, -0.8], [-0.3, 0.0, 1.0]])
    )
    heights = np.array([0.55, -0.40, 0.12, -0.12, 0.08]) + (rng.random(5) - 0.5) * 0.06
    tall = max(58.0 * scale, 2.6 * gap_mm)  # thick slices stretch it, so that two of them can cut a tumor
    return Blob((-58.0 * scale, -12.0 * scale, 0.0), (82.0 * scale, 66.0 * scale, tall), lobes, heights)


# The cube's six sides and eight corners: evenly spread directions.
SPREAD = unit_vectors(
    np.array(
        [[side * sign for side in axis] for axis in np.eye(3).tolist() for sign in (1, -1)]
        + [[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)],
        np.float64,
    )
)


def grow_tumors(
    rng: np.random.Generator, liver: Blob, scale: float, spacing: Point, axes: list[NDArray[np.float64]]
) -> list[Blob]:
    """Return five to seven tumors inside the liver that do not touch; at least one whatever the grid is.

    The first is the largest and sits deep in the right lobe; a smaller one without room in 60 tries is left out.
    """
    sizes = np.sort(6.0 + 13.0 * rng.random(int(rng.integers(4, 7))))[::-1]
    tumors: list[Blob] = []
    for number, size in enumerate([19.0 + 5.0 * float(rng.random()), *sizes.tolist()]):
        radius = size * scale
        for _ in range(60):
            tumor = _random_tumor(rng, liver, radius, spacing, axes, deep=number == 0)
            if has_room(tumor, liver, tumors, scale):
                tumors.append(tumor)
                break
            if not number:
                radius *= 0.9
    return sorted(tumors, key=lambda tumor: -tumor.volume_mm3())


def has_room(tumor: Blob, liver: Blob, tumors: list[Blob], scale: float) -> bool:
    """Return whether the tumor is inside the liver, with a margin, and touches none of `tumors`."""
    if not liver.inside(tumor.surface(1.05, 3.0 * scale)).all():
        return False
    for placed in tumors:
        distance = [
            (tumor.center[axis] - placed.center[axis])
            / (tumor.half_axes[axis] * tumor.limits[1] + placed.half_axes[axis] * placed.limits[1])
            for axis in range(3)
        ]
        if distance[0] * distance[0] + distance[1] * distance[1] + distance[2] * distance[2] < 1.0:
            return False
    return True


def _random_tumor(
    rng: np.random.Generator, liver: Blob, radius: float, spacing: Point, axes: list[NDArray[np.float64]], deep: bool
) -> Blob:
    """Return a tumor of about this radius, mm, at random in the liver's box, or deep in its right lobe."""
    half = radius * (0.8 + 0.45 * rng.random(3))
    lobes = unit_vectors(SPREAD + 0.7 * (rng.random(SPREAD.shape) - 0.5))
    heights = -0.24 + 0.58 * rng.random(len(SPREAD))
    slices = len(axes[2])
    if slices == 3:
        heights *= 0.4  # rounder, so that the stack does not cut it
    shape = Blob((0.0, 0.0, 0.0), (half[0], half[1], half[2]), lobes, heights)

    spread = 0.25 if deep else 1.2
    position = [liver.center[axis] + liver.half_axes[axis] * spread * (2 * rng.random() - 1) for axis in range(3)]
    for axis in range(2):
        if half[axis] < 3 * spacing[axis]:  # coarse pixels: on one, so that the label is there
            position[axis] = float(axes[axis][np.argmin(np.abs(axes[axis] - position[axis]))])
    position[2], half[2] = _fitted_height(shape, position[2], spacing[2], slices, half_mm=float(half[2]))
    return Blob((position[0], position[1], position[2]), (half[0], half[1], half[2]), lobes, heights)


def _fitted_height(shape: Blob, height: float, gap: float, slices: int, half_mm: float) -> tuple[float, float]:
    """Return the height of the center and the half axis along z, mm, so that two slices or more cut the body's axis.

    From 4 slices on, the first and the last slice stay free.
    """
    poles = shape.radius(np.zeros(2), np.zeros(2), np.array([1.0, -1.0]))
    up, down = shape.reach(2, 1.0), shape.reach(2, -1.0)
    most = (slices - 1) / 2 * gap  # height of the last slice
    half = max(half_mm, 0.62 * gap / float(poles.min()))
    if half * float(poles.sum()) < 2.3 * gap or 2 * most < 1.05 * half * (up + down):
        # Thick slices, or few: the center is half-way between two of them, which the shortest pole reaches.
        low, high = (0, 1) if slices == 3 else (1, slices - 3)
        below = min(max(round(height / gap + (slices - 1) / 2 - 0.5), low), high)
        height = (below + 0.5 - (slices - 1) / 2) * gap
        room = min((most - height) / up, (most + height) / down) if slices > 3 else 0.0
        return height, max(min(half, 0.97 * room), 0.62 * gap / float(poles.min()))
    return min(max(height, -most + 1.02 * half * down), most - 1.02 * half * up), half
