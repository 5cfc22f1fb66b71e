# SPDX-License-Identifier: GPL-3.0-or-later
"""Which samples lie within a distance of a mask: exact distances between samples' centers, in millimeters.

Axis by axis as Felzenszwalb and Huttenlocher 2012 (doi:10.4086/toc.2012.v008a019): along x by the nearest sample on
either side, then along y and z the least of `squared distance so far + squared step`, by brute force over the steps
that the limit allows. Masks are (slices, rows, columns); a grid's spacing is (x, y, z).
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Flags, Floats
from ..progress import Step, Steps

Spacing = tuple[float, float, float]
Window = tuple[slice, slice, slice]
BLOCK = 1 << 18  # Work on this many samples at once, each with some bytes.
SLACK = 1e-6  # This share of a distance is rounding.


def window_of(mask: Flags) -> Window | None:
    """Return the smallest window (z, y, x) that holds a mask's samples; None where it has none.

    Examples
    --------
    >>> mask = np.zeros((4, 5, 6), bool)
    >>> mask[1, 2:4, 5] = True
    >>> window_of(mask)
    (slice(1, 2, None), slice(2, 4, None), slice(5, 6, None))
    """
    ranges = []
    part = mask
    for axis in range(3):
        across = tuple(each for each in range(3) if each != axis)
        at = np.flatnonzero(part.any(axis=across))
        if not at.size:
            return None
        ranges.append(slice(int(at[0]), int(at[-1]) + 1))
        part = part[(slice(None),) * axis + (ranges[-1],)]
    return ranges[0], ranges[1], ranges[2]


def grown_window(window: Window, margin_mm: float, spacing_mm: Spacing, shape: tuple[int, ...]) -> Window:
    """Return a window (z, y, x) that is larger by some mm on every side, inside a grid of this shape.

    Examples
    --------
    >>> grown_window((slice(1, 2), slice(2, 4), slice(5, 6)), 2.0, (1.0, 1.0, 4.0), (4, 5, 6))
    (slice(0, 3, None), slice(0, 5, None), slice(3, 6, None))
    """
    grown = []
    for side, count, mm in zip(window, shape, reversed(spacing_mm), strict=True):
        more = math.ceil(min(margin_mm / mm, count))
        grown.append(slice(max(0, side.start - more), min(count, side.stop + more)))
    return grown[0], grown[1], grown[2]


def squared_distances(mask: Flags, spacing_mm: Spacing, limit_mm: float = math.inf) -> Floats:
    """Return the squared distance from every sample to the nearest one of a mask, mm2, exact up to the limit.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    spacing_mm : (x, y, z) float
    limit_mm : float
        Farther distances may be given as infinite.

    Returns
    -------
    (slices, rows, columns) float32

    Examples
    --------
    >>> squared_distances(np.array([[[True, False, False]], [[False] * 3]]), (1.0, 1.0, 2.0)).tolist()
    [[[0.0, 1.0, 4.0]], [[4.0, 5.0, 8.0]]]
    """
    squares = _in_slices(mask, spacing_mm, limit_mm)
    return _least_along(0, squares, spacing_mm[2], limit_mm)


def _in_slices(mask: Flags, spacing_mm: Spacing, limit_mm: float) -> Floats:
    """Do what `squared_distances` does in every slice by itself."""
    columns = mask.shape[2]
    at = np.arange(columns, dtype=np.int32)
    far = np.int32(2 * columns)
    before = np.maximum.accumulate(np.where(mask, at, -far), axis=2)
    behind = np.minimum.accumulate(np.where(mask, at, 2 * far)[:, :, ::-1], axis=2)[:, :, ::-1]
    steps = np.minimum(at - before, behind - at)
    squares = steps.astype(np.float32) * np.float32(spacing_mm[0])
    squares *= squares
    squares[steps >= far] = np.inf
    return _least_along(1, squares, spacing_mm[1], limit_mm)


def _least_along(axis: int, squares: Floats, mm: float, limit_mm: float) -> Floats:
    """Return the least sum of squared distance and squared step, over all steps along an axis."""
    nearest = squares.copy()
    finite = nearest[np.isfinite(nearest)]
    if not finite.size:
        return squares
    most = math.inf if finite.size < nearest.size else float(finite.max())
    for step in range(1, squares.shape[axis]):
        extra = np.float32(step * mm * (step * mm))
        if extra > _farthest(limit_mm) or extra >= most:
            break
        head, tail = [slice(None)] * 3, [slice(None)] * 3
        head[axis], tail[axis] = slice(step, None), slice(None, -step)
        for to, of in ((tuple(head), tuple(tail)), (tuple(tail), tuple(head))):
            np.minimum(nearest[to], squares[of] + extra, out=nearest[to])
    return nearest


def _farthest(limit_mm: float) -> float:
    """Return the squared distance that a limit allows."""
    return limit_mm * limit_mm * (1 + SLACK)


def near_steps(mask: Flags, spacing_mm: Spacing, limit_mm: float, below: bool = False) -> Steps[Flags]:
    """Find the samples that are at most `limit_mm` from one of the mask, the mask's own included.

    Works on some slices at a time. It takes a byte for each sample of the grid, and up to eight for each sample of the
    slices that lie within the limit on either side of those: of all slices at most.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    spacing_mm : (x, y, z) float
        For an oblique or sheared affine the lengths of its columns.
    limit_mm : float
        0 or more.
    below : bool
        Whether a sample at exactly this distance is left out.

    Returns
    -------
    (slices, rows, columns) bool
    """
    result = mask.copy()
    window = window_of(mask)
    if window is None or limit_mm <= 0:
        return result
    window = grown_window(window, limit_mm, spacing_mm, mask.shape)
    inner, marked = mask[window], result[window]
    slices, rows, columns = inner.shape
    reach = min(slices, math.ceil(limit_mm / spacing_mm[2]))
    most = np.float32(limit_mm * limit_mm * (1 - SLACK if below else 1 + SLACK))
    layers = max(1, BLOCK // (rows * columns))
    squares = np.empty((min(slices, layers + 2 * reach), rows, columns), np.float32)
    first = end = 0  # the first slice that `squares` has, and the one behind the last
    for low in range(0, slices, layers):
        high = min(slices, low + layers)
        done = max(0, low - reach) - first
        squares[: end - first - done] = squares[done : end - first]
        first += done
        while end < min(slices, high + reach):
            more = inner[end : min(slices, high + reach, end + layers)]
            squares[end - first : end - first + len(more)] = _in_slices(more, spacing_mm, limit_mm)
            end += len(more)
            yield Step((end + low) / (2 * slices), "Measuring distances")
        near = squares[low - first : high - first] <= most
        for step in range(1, reach + 1):
            extra = np.float32(step * spacing_mm[2] * (step * spacing_mm[2]))
            if extra > _farthest(limit_mm):
                break
            for way in (-step, step):
                start, stop = max(low, -way), min(high, slices - way)
                if start < stop:
                    shifted = squares[start + way - first : stop + way - first]
                    near[start - low : stop - low] |= shifted + extra <= most
        marked[low:high] |= near
        yield Step((end + high) / (2 * slices), "Measuring distances")
    return result


def far_inside_steps(mask: Flags, spacing_mm: Spacing, limit_mm: float, at_least: bool = False) -> Steps[Flags]:
    """Find the samples of a mask that are farther than `limit_mm` from every sample outside of it.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
        Space beyond the border of the grid does not count as outside.
    spacing_mm : (x, y, z) float
    limit_mm : float
        0 or more.
    at_least : bool
        Whether a sample at exactly this distance is kept.
    """
    result = np.zeros(mask.shape, bool)
    window = window_of(mask)
    if window is None:
        return result
    # The nearest outside is never behind the first layer of samples around the mask's box.
    window = grown_window(window, min(spacing_mm) / 2, spacing_mm, mask.shape)
    outside = ~mask[window]
    result[window] = ~(outside | (yield from near_steps(outside, spacing_mm, limit_mm, below=at_least)))
    return result
