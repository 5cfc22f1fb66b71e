# SPDX-License-Identifier: GPL-3.0-or-later
"""Order the slices of a stack, check their gaps and tilt, and make the affine.

Positions and directions are in DICOM's patient space (LPS+ mm), the affine leads to RAS+ mm.
DICOM PS3.3 C.7.6.2.1.1: the center of pixel (row r, column c) lies at
`position + c * column_mm * row_direction + r * row_mm * column_direction`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, mm_text

SAME_MM = 0.001  # Closer positions are the same slice twice.
EVEN_SHARE, EVEN_MM = 0.01, 0.01  # Gaps this near to the median are even.
WIDEST_GAP = 3.0  # In a wider gap, in medians, slices are missing.
NARROWEST_GAP = 0.25  # An uneven stack is not resampled finer, in medians.
TILT_DEGREES = 0.1  # Smaller angles come from rounded positions.


@dataclass(frozen=True, eq=False)
class Stack:
    """The order, resampling and affine that make a volume of slices.

    Parameters
    ----------
    order : tuple of int
        Numbers of the given slices to read, along the normal; duplicates left out.
    below : (slices,) int64
        For every slice of the volume, the index in `order` of the slice that it is, or that it lies above.
    weight : (slices,) float64
        Share of the next slice in it; 0 where the slice is taken as it is.
    affine : (4, 4) float64
        Index (x, y, z) to RAS+ mm.
    notes : tuple of str
        The changes to the stack.
    """

    order: tuple[int, ...]
    below: NDArray[np.int64]
    weight: NDArray[np.float64]
    affine: NDArray[np.float64]
    notes: tuple[str, ...]

    @property
    def resampled(self) -> bool:
        """Return whether slices of the volume lie between slices of the stack."""
        return bool(self.weight.any())


def stack_up(
    positions_lps: NDArray[np.float64],
    orientation: Sequence[float],
    pixel_spacing: Sequence[float],
    names: Sequence[str],
    strict: bool = False,
) -> Stack:
    """Order slices by position and find the affine.

    Parameters
    ----------
    positions_lps : (n, 3) float64
        ImagePositionPatient of every slice, in any order.
    orientation : 6 floats
        ImageOrientationPatient: direction of a row, then of a column.
    pixel_spacing : (row_mm, column_mm)
        PixelSpacing: between rows, then between columns.
    names : n str
        Names of the slices for errors.
    strict : bool
        Refuse every unevenness instead of resampling.

    Raises
    ------
    ReadError
        If fewer than two slices remain, slices are missing, or do not lie behind each other.

    Examples
    --------
    >>> stack = stack_up(np.array([[0, 0, 5.0], [0, 0, 2.5]]), (1, 0, 0, 0, 1, 0), (0.5, 0.5), "ab")
    >>> stack.order, stack.affine[2]
    ((1, 0), array([0. , 0. , 2.5, 2.5]))
    """
    row, column = np.array(orientation[:3], np.float64), np.array(orientation[3:], np.float64)
    normal = checked_normal(row, column)
    along = dot(positions_lps, normal)  # (n,) mm
    order, notes = _without_duplicates(along, np.argsort(along, kind="stable"))
    if len(order) < 2:
        reason = f"there is only one slice ({names[order[0]]})"
        if len(along) > 1:
            which = f"all {len(along)} slices (such as {names[order[0]]})"
            reason = f"{which} are at one position to within {mm_text(SAME_MM)}"
        raise ReadError(
            f"{reason}, at {mm_text(along[order[0]])}; a surface needs at least 2 slices at different positions"
        )
    along, points, names = along[order], positions_lps[order], [names[at] for at in order]
    notes += _aligned(along, points, names, pixel_spacing, strict)
    below, weight, gap_notes = _resampling(along, names, strict)
    step = (points[-1] - points[0]) / (len(below) - 1)
    affine = np.eye(4)
    affine[:3, 0] = row * pixel_spacing[1]
    affine[:3, 1] = column * pixel_spacing[0]
    affine[:3, 2] = step
    affine[:3, 3] = points[0]
    affine[:2] *= -1.0  # LPS to RAS
    tilt = _tilt_degrees(step, normal)
    if tilt >= TILT_DEGREES:
        gap_mm, along_tilt = abs(float((step * normal).sum())), math.sqrt(float((step * step).sum()))
        gap_notes.append(
            f"the slices are tilted by {tilt:.1f} degrees (gantry tilt), which the affine carries exactly: "
            f"they are {mm_text(gap_mm, 4)} apart, and {mm_text(along_tilt, 4)} along the tilt"
        )
    return Stack(tuple(int(at) for at in order), below, weight, affine, (*notes, *gap_notes))


def checked_normal(row: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normal of the slices, (3,) float64.

    Parameters
    ----------
    row : (3,) float64
        Direction of rising columns, LPS+.
    column : (3,) float64
        Direction of rising rows, LPS+.

    Raises
    ------
    ReadError
        If the directions are not two perpendicular units.
    """
    lengths = [math.sqrt(float((axis * axis).sum())) for axis in (row, column)]
    slant = float((row * column).sum())
    if not all(abs(length - 1) < 0.01 for length in lengths) or not abs(slant) < 0.01:
        raise ReadError(
            f"the orientation {tuple(np.round([*row, *column], 4).tolist())} is not a pair of perpendicular "
            "directions of length 1; export the series again"
        )
    normal = np.array(
        [row[(a + 1) % 3] * column[(a + 2) % 3] - row[(a + 2) % 3] * column[(a + 1) % 3] for a in range(3)]
    )
    return normal / math.sqrt(float((normal * normal).sum()))


def dot(points: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return inner products, (n,), summed in a fixed order: the order of slices depends on their last bit.

    Parameters
    ----------
    points : (n, 3) float64
    direction : (3,) float64
    """
    return (points[:, 0] * direction[0] + points[:, 1] * direction[1]) + points[:, 2] * direction[2]


def _without_duplicates(along: NDArray[np.float64], order: NDArray[np.intp]) -> tuple[NDArray[np.intp], list[str]]:
    kept = [order[0]]
    for at in order[1:]:
        if along[at] - along[kept[-1]] > SAME_MM:
            kept.append(at)
    dropped = len(order) - len(kept)
    if not dropped:
        return np.array(kept), []
    text = "1 slice is" if dropped == 1 else f"{dropped} slices are"
    return np.array(kept), [f"{text} at the position of another; the first of each was kept"]


def _aligned(
    along: NDArray[np.float64],
    points: NDArray[np.float64],
    names: Sequence[str],
    pixel_spacing: Sequence[float],
    strict: bool,
) -> list[str]:
    """Check that the positions lie on one line, because an affine can describe nothing else."""
    share = (along - along[0]) / (along[-1] - along[0])
    off = points - (points[0] + share[:, None] * (points[-1] - points[0]))  # (n, 3)
    distance = np.sqrt((off * off).sum(axis=1))
    worst = int(np.argmax(distance))
    limit = 0.5 * min(pixel_spacing)
    if distance[worst] <= EVEN_MM:
        return []
    text = f"{names[worst]} is {mm_text(distance[worst], 3)} off the line through the first and the last slice"
    if strict or distance[worst] > limit:
        allowed = EVEN_MM if strict else limit
        raise ReadError(f"{text}, and at most {mm_text(allowed, 2)} is allowed; choose slices of one acquisition")
    return [
        f"slices are up to {mm_text(distance[worst], 3)} off the line through the first and the last, and were not "
        "moved"
    ]


def _resampling(
    along: NDArray[np.float64], names: Sequence[str], strict: bool
) -> tuple[NDArray[np.int64], NDArray[np.float64], list[str]]:
    """Return lower neighbor and weight of every slice of the volume, and notes."""
    gaps = np.diff(along)
    median = float(np.median(gaps))
    widest = int(np.argmax(gaps))
    # The small share keeps rounded positions from making exactly three medians too many.
    if gaps[widest] > WIDEST_GAP * median * (1 + 1e-6):
        raise ReadError(
            f"the gap of {mm_text(gaps[widest], 4)} between {names[widest]} at {mm_text(along[widest])} and "
            f"{names[widest + 1]} at {mm_text(along[widest + 1])} is more than {WIDEST_GAP:g} times the median gap of "
            f"{mm_text(median, 4)}; add the missing slices, or put each part in a folder of its own"
        )
    even = max(EVEN_SHARE * median, EVEN_MM)
    if (np.abs(gaps - median) <= even).all():
        regular = np.linspace(along[0], along[-1], len(along))
        drift = float(np.abs(along - regular).max())
        notes = [f"slices are up to {mm_text(drift, 3)} off an even grid, and were not moved"] if drift > even else []
        return np.arange(len(along)), np.zeros(len(along)), notes
    text = named_gaps(gaps)
    if strict:
        raise ReadError(f"the gaps between slices are uneven ({text}) and strict reading refuses that")
    gap = max(float(gaps.min()), NARROWEST_GAP * median)
    count = max(2, round(float(along[-1] - along[0]) / gap) + 1)
    heights = np.linspace(along[0], along[-1], count)  # first and last stay where they are
    below = np.clip(np.searchsorted(along, heights, side="right") - 1, 0, len(along) - 2)
    weight = np.clip((heights - along[below]) / gaps[below], 0.0, 1.0)
    below = below + (weight > 1 - 1e-6)
    weight = np.where((weight < 1e-6) | (weight > 1 - 1e-6), 0.0, weight)
    even_gap = float(along[-1] - along[0]) / (count - 1)
    note = (
        f"the gaps between slices are uneven ({text}): {len(along)} slices were resampled linearly to {count}, "
        f"{mm_text(even_gap, 4)} apart"
    )
    return below.astype(np.int64), weight, [note]


def named_gaps(gaps: NDArray[np.float64], most: int = 6) -> str:
    """Return the different gaps in words, to 0.01 mm, or a hundredth of smaller ones.

    Examples
    --------
    >>> named_gaps(np.array([4.0, 4.001, 7.0, 1.08])), named_gaps(np.array([0.004, 0.008]))
    ('1.08, 4 and 7 mm', '0.004 and 0.008 mm')
    """
    decimals = 2 + max(0, -int(f"{np.median(gaps):e}".partition("e")[2]))
    unique = np.unique(np.round(gaps, decimals))
    different = [*(f"{gap:g}" for gap in unique[:-1]), mm_text(unique[-1])]
    if len(different) > most:
        different = [*different[: most - 1], f"up to {different[-1]}"]
    return different[0] if len(different) == 1 else ", ".join(different[:-1]) + " and " + different[-1]


def _tilt_degrees(step: NDArray[np.float64], normal: NDArray[np.float64]) -> float:
    height = float((step * normal).sum())
    across = step - height * normal
    return math.degrees(math.atan2(math.sqrt(float((across * across).sum())), abs(height)))
