# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the planes of a structure's contours, and assign them to slices.

Contours need not lie on slices. A slice with a plane on it takes that plane as it is drawn. One between two planes
takes the body between them, unless the planes are much farther apart than the structure's others: that is a gap.
Before the first and behind the last plane a slice takes that plane if it lies less than half a slice away, which is as
far as a slice itself reaches. Heights are along the normal of the slices, mm.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .slice_grid import EVEN, SliceGrid

SAME_PLANE = 0.05  # Contours that lie closer are in one plane, in distances between slices.
WIDEST = 3.5  # Planes farther apart than this are a gap, in the usual distance and in those before and behind.
ROUNDING = 0.01  # Heights that differ by less are the same, in distances between slices.


class Contour(NamedTuple):
    """One closed contour."""

    height: float
    corners: NDArray[np.float64]  # (n, 2) column and row in pixels
    xor: bool  # True if its type asks for the even-odd rule.


class Plane(NamedTuple):
    """The contours of one structure that lie in one plane."""

    height: float
    contours: list[NDArray[np.float64]]
    xor: bool


class Source(NamedTuple):
    """The two planes of a slice, the same one twice if the slice takes it as drawn."""

    slice_: int
    below: int
    above: int
    share: float  # Share of the way from the plane below to the one above.


class PlaneAssignment(NamedTuple):
    """The slices that take the planes of one structure."""

    sources: list[Source]  # One entry for each slice.
    apart_mm: float  # Usual distance of planes with filled slices between; 0 without such planes.
    gaps_mm: list[float]  # Gaps with slices, which stay empty.

    @property
    def used(self) -> set[int]:
        """Return the numbers of the planes that slices take."""
        return {plane for source in self.sources for plane in (source.below, source.above)}

    @property
    def between(self) -> int:
        """Return the number of filled slices between planes."""
        return sum(source.below != source.above for source in self.sources)


def planes_of(contours: Iterable[Contour], slice_mm: float) -> tuple[list[Plane], int]:
    """Return the planes of contours by height, and how many copies of contours were left out.

    The even-odd rule would take a contour that is drawn twice for a hole in itself.
    """
    planes: list[Plane] = []
    copies = 0
    for contour in sorted(contours, key=lambda contour: contour.height):
        if not planes or contour.height - planes[-1].height > SAME_PLANE * slice_mm:
            planes.append(Plane(contour.height, [], False))
        plane = planes[-1]
        plane.contours.append(contour.corners)
        planes[-1] = plane._replace(xor=plane.xor or contour.xor)
    for plane in planes:
        single = list({corners.tobytes(): corners for corners in plane.contours}.values())
        copies += len(plane.contours) - len(single)
        plane.contours[:] = single
    return planes, copies


def assigned_planes(structures: Sequence[Sequence[Plane]], grid: SliceGrid) -> list[PlaneAssignment]:
    """Assign each structure's planes to slices of the volume."""
    assignments = []
    for planes in structures:
        heights = np.array([plane.height for plane in planes])
        joined = _are_joined(np.diff(grid.scanned_numbers(heights)))
        sources = _sources_of(heights, joined, grid.heights, grid.slice_mm)
        taken = {source.slice_ for source in sources}
        inner = [np.flatnonzero((grid.heights > low) & (grid.heights < high)) for low, high in pairs(heights)]
        gaps = [not taken.issuperset(between.tolist()) for between in inner]
        mm = np.diff(heights)
        filled = sorted({source.below for source in sources if source.below != source.above})
        assignments.append(PlaneAssignment(sources, _lower_median(mm[filled]), mm[gaps].tolist()))
    return assignments


def _are_joined(steps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether the body goes on between each plane and the next: it does not where a step is far wider.

    A skipped contour or two are not a gap, nor are contours that are drawn more rarely at an end of the structure.

    Parameters
    ----------
    steps : (n,) float64
        Distances between planes, in slices.

    Examples
    --------
    >>> bool(_are_joined(np.array([3.0, 2.0, 1.0, 1.0, 1.0, 3.0, 3.0])).all()), _are_joined(np.array([40.0])).tolist()
    (True, [True])
    >>> _are_joined(np.array([1.0, 1.0, 6.0, 1.0, 3.0, 1.0])).tolist()
    [True, True, False, True, True, True]
    """
    padded_steps = np.concatenate([[0.0], steps, [0.0]])
    usual = np.maximum(np.maximum(padded_steps[:-2], padded_steps[2:]), max(_lower_median(steps), 1.0))
    return np.asarray(steps <= WIDEST * usual + ROUNDING)


def _sources_of(
    planes: NDArray[np.float64], joined: NDArray[np.bool_], slices: NDArray[np.float64], slice_mm: float
) -> list[Source]:
    """Return the slices that take planes, with their planes.

    Parameters
    ----------
    planes : (n,) float64
        Heights, rising.
    joined : (n - 1,) bool
        Whether the body goes on between a plane and the next.
    slices : (slices,) float64
        Heights, rising.
    slice_mm : float
        Usual distance between slices.

    Examples
    --------
    >>> heights = np.array([0.0, 3.0, 6.0])
    >>> for source in _sources_of(heights, np.array([True, True]), np.arange(5) * 2.0, 2.0): print(*source)
    0 0 0 0.0
    1 0 1 0.6666666666666666
    2 1 2 0.3333333333333333
    3 2 2 0.0
    """
    sources = []
    for slice_, height in enumerate(slices.tolist()):
        above = int(np.searchsorted(planes, height))
        around = [plane for plane in (above - 1, above) if 0 <= plane < len(planes)]
        if not around:
            continue
        nearest = min(around, key=lambda plane: abs(float(planes[plane]) - height))
        way = abs(float(planes[nearest]) - height)
        if way <= EVEN * slice_mm:
            sources.append(Source(slice_, nearest, nearest, 0.0))
        elif len(around) == 2 and joined[above - 1]:
            low, high = float(planes[above - 1]), float(planes[above])
            sources.append(Source(slice_, above - 1, above, (height - low) / (high - low)))
        elif way < (0.5 - ROUNDING) * slice_mm:
            sources.append(Source(slice_, nearest, nearest, 0.0))
    # A body of one plane halfway between two slices would be in neither.
    used = {plane for source in sources for plane in (source.below, source.above)}
    for plane in set(range(len(planes))) - used:
        if not joined[max(0, plane - 1) : plane + 1].any():
            way = np.abs(slices - planes[plane])
            nearest = int(way.argmin())
            if way[nearest] <= (0.5 + ROUNDING) * slice_mm:
                sources.append(Source(nearest, plane, plane, 0.0))
    return sorted(sources)


def pairs(heights: NDArray[np.float64]) -> Iterable[tuple[float, float]]:
    """Return neighboring heights."""
    return zip(heights[:-1].tolist(), heights[1:].tolist(), strict=True)


def _lower_median(values: NDArray[np.float64]) -> float:
    """Return the median, the lower of the middle two; 0 of no values.

    Examples
    --------
    >>> _lower_median(np.array([9.0, 2.0])), _lower_median(np.zeros(0))
    (2.0, 0.0)
    """
    return float(np.sort(values)[(len(values) - 1) // 2]) if len(values) else 0.0
