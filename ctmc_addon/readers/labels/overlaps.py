# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill the closed contours of one structure in one plane; those that partly overlap are united, inner ones are holes.

A contour within another is a hole in it (even-odd rule). Two that overlap in part are two strokes of one body: the
even-odd rule would leave out the overlap. Contours that are united count as one from there on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Step, Steps
from ...core.mesh import Groups
from .contours import FAR, Filled, edges_of, traced_steps

SLIVER = 0.05  # A contour lies within another if a smaller share of it lies outside.
MOST_COMPARED = 1 << 28  # Pixels of pairs of contours whose boxes overlap, in one plane.
LEAST_COMPARED = 1 << 8  # Pixels that a pair counts as: comparing it takes this long at least.


class United(NamedTuple):
    """The pixels of a plane, and whether their union differs from the even-odd rule."""

    filled: Filled
    changed: bool


def united_steps(contours: Sequence[NDArray[np.float64]], rows: int, columns: int, name: str) -> Steps[United]:
    """Return the pixels inside of contours.

    Parameters
    ----------
    contours : sequence of (n, 2) float64
        Column and row in pixels.
    rows, columns : int
        Of the picture.
    name : str
        The file, for an error.

    Raises
    ------
    ReadError
        If more contours overlap than a drawing has.

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> squares = [np.array([[a, a], [b, a], [b, b], [a, b]]) for a, b in ((0.5, 10.5), (5.5, 15.5))]
    >>> united = finish(united_steps(squares, 20, 20, "rs.dcm"))
    >>> united.filled.mask.sum().item(), united.changed
    (175, True)
    """
    plain = (yield from traced_steps(edges_of(contours, rows), columns)).filled
    groups = yield from _groups_steps(contours, rows, columns, name)
    if len(groups) == len(contours) or not plain.mask.size:
        return United(plain, False)
    odd, on = np.zeros_like(plain.mask), np.zeros_like(plain.mask)
    for group in groups:
        inside = np.zeros_like(odd) if len(group) > 1 else odd
        for number in group:
            traced = yield from traced_steps(edges_of([contours[number]], rows), columns)
            if not traced.odd.size:
                continue
            top, left = traced.top - plain.top, traced.left - plain.left
            window = np.s_[top : top + traced.odd.shape[0], left : left + traced.odd.shape[1]]
            on[window] |= traced.on
            if len(group) > 1:
                inside[window] |= traced.odd
            else:
                odd[window] ^= traced.odd
        if len(group) > 1:
            odd ^= inside
    filled = Filled(plain.top, plain.left, odd | on)
    return United(filled, not np.array_equal(filled.mask, plain.mask))


def _groups_steps(
    contours: Sequence[NDArray[np.float64]], rows: int, columns: int, name: str
) -> Steps[list[list[int]]]:
    """Return the numbers of contours, a list for each group that partial overlaps connect."""
    groups = Groups(len(contours))
    filled: dict[int, Filled] = {}
    for pair in _pairs_with_overlapping_boxes(contours, rows, columns, name):
        for number in pair:
            if number not in filled:
                filled[number] = (yield from traced_steps(edges_of([contours[number]], rows), columns)).filled
        if _partly_overlap(filled[pair[0]], filled[pair[1]]):
            groups.join(*pair)
        yield Step(pair[0] / len(contours), "Filling contours")
    return groups.lists()


def _pairs_with_overlapping_boxes(
    contours: Sequence[NDArray[np.float64]], rows: int, columns: int, name: str
) -> Iterator[tuple[int, int]]:
    """Yield pairs of contours, the lower number first, whose boxes share pixels of the picture."""
    low = np.array([np.ceil(np.clip(corners.min(axis=0), 0, FAR)) for corners in contours])
    high = np.array([np.floor(np.clip(corners.max(axis=0), -1, (columns - 1, rows - 1))) for corners in contours])
    compared = 0.0
    for number in range(len(contours) - 1):
        sides = np.minimum(high[number], high[number + 1 :]) - np.maximum(low[number], low[number + 1 :]) + 1
        for following in np.flatnonzero((sides > 0).all(axis=1)).tolist():
            compared += max(LEAST_COMPARED, float(sides[following, 0] * sides[following, 1]))
            if compared > MOST_COMPARED:
                raise ReadError(
                    f"contours of {name} overlap each other in one plane on more than {MOST_COMPARED} pixels, too "
                    "many for drawn contours; export it again"
                )
            yield number, number + 1 + following


def _partly_overlap(first: Filled, second: Filled) -> bool:
    """Return whether two bodies share pixels and each has more than a sliver for itself."""
    top, left = max(first.top, second.top), max(first.left, second.left)
    windows = [box.mask[top - box.top :, left - box.left :] for box in (first, second)]
    rows, columns = (min(window.shape[axis] for window in windows) for axis in (0, 1))
    shared = np.count_nonzero(windows[0][:rows, :columns] & windows[1][:rows, :columns])
    smaller, larger = sorted(np.count_nonzero(box.mask) - shared for box in (first, second))
    # The ring that a hole leaves may be thin: what sticks out of it is compared with the ring, too.
    return shared > 0 and smaller > SLIVER * min(shared + smaller, larger)
