# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut by a lasso that was drawn in a view: what is seen inside of it, through everything or to a depth.

The view is a (4, 4) matrix from RAS+ mm to clip space, as Blender's and OpenGL's: divided by w, x and y are those of
the lasso. A polygon that crosses itself has inside what an odd number of its sides encloses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags, Indices
from ...errors import SettingsError
from ...progress import Step, Steps
from ...volume.affine import product
from ...volume.volume import SampleGrid
from ..distance import Window, window_of

SAMPLES_PER_STEP = 1 << 18
SIDES_PER_STEP = 1 << 24  # Samples times sides of the lasso in a step.


def scissors_steps(
    mask: Flags,
    volume: SampleGrid,
    view: Doubles,
    lasso: Doubles,
    keep_inside: bool = False,
    depth_mm: float = math.inf,
) -> Steps[Flags]:
    """Erase the samples that a lasso encloses in a view, or all other ones.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    volume : SampleGrid
        The mask's grid.
    view : (4, 4) float64
        RAS+ mm to clip space; of a perspective or an orthographic view.
    lasso : (n, 2) float64
        Corners of the polygon, x and y after the division by w.
    keep_inside : bool
        Erase what is outside of the lasso.
    depth_mm : float
        Cut so deep from the sample of the mask that the view sees first inside the lasso; infinite for all depths.

    Raises
    ------
    SettingsError
        If the lasso has fewer than three corners, or a number is not finite, or the depth is not above zero.
    """
    view, lasso = np.array(view, np.float64), np.array(lasso, np.float64)
    if view.shape != (4, 4) or lasso.ndim != 2 or lasso.shape[1] != 2 or len(lasso) < 3:
        raise SettingsError(
            f"a lasso has three corners or more and a view is a (4, 4) matrix, not {lasso.shape} and {view.shape}"
        )
    if not (np.isfinite(view).all() and np.isfinite(lasso).all() and depth_mm > 0):
        raise SettingsError(f"view and lasso are finite numbers and the depth is above 0 mm, not {depth_mm:g}")
    result = mask.copy()
    window = window_of(mask)
    if window is None:
        return result
    matrix = product(view, volume.affine)
    has_depth, nearest = depth_mm < math.inf, math.inf
    low, high = lasso.min(axis=0), lasso.max(axis=0)
    for turn in range(2 if has_depth else 1):  # with a depth, first what the view sees first
        for z, y, x in _samples(mask, window, max(1, SIDES_PER_STEP // len(lasso))):
            clip = [((row[0] * x + row[1] * y) + row[2] * z) + row[3] for row in matrix]
            seen = clip[3] > 0
            w = np.where(seen, clip[3], 1.0)
            across, up = clip[0] / w, clip[1] / w
            inside = seen & (across >= low[0]) & (across <= high[0]) & (up >= low[1]) & (up <= high[1])
            inside[inside] = inside_polygon(across[inside], up[inside], lasso)
            depth = _depth_mm(view, volume, [x, y, z]) if has_depth else None
            if depth is not None and turn == 0:
                nearest = float(np.min(depth[inside], initial=nearest))
            else:
                cut = inside if depth is None else inside & (depth <= nearest + depth_mm)
                result[z, y, x] = cut if keep_inside else ~cut
            share = (int(z[0]) - window[0].start) / (window[0].stop - window[0].start)
            yield Step((turn + share) / (2 if has_depth else 1), "Cutting")
    return result


def _samples(mask: Flags, window: Window, at_once: int) -> Iterator[tuple[Indices, Indices, Indices]]:
    """Yield the samples of a mask in a window, some at once: slices, rows, columns, each (n,)."""
    rows, columns = (side.stop - side.start for side in window[1:])
    layers = max(1, SAMPLES_PER_STEP // (rows * columns))
    for low in range(window[0].start, window[0].stop, layers):
        slab = (slice(low, min(window[0].stop, low + layers)), window[1], window[2])
        z, y, x = (at + side.start for at, side in zip(np.nonzero(mask[slab]), slab, strict=True))
        for first in range(0, len(z), at_once):
            part = slice(first, first + at_once)
            yield z[part], y[part], x[part]


def inside_polygon(x: Doubles, y: Doubles, corners: Doubles) -> NDArray[np.bool_]:
    """Return which points (n,) an odd number of a polygon's sides encloses.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    >>> inside_polygon(np.array([1.0, 3.0]), np.array([1.0, 1.0]), square).tolist()
    [True, False]
    """
    inside = np.zeros(len(x), bool)
    for (x1, y1), (x2, y2) in zip(corners.tolist(), np.roll(corners, -1, axis=0).tolist(), strict=True):
        if y1 != y2:
            inside ^= ((y1 > y) != (y2 > y)) & (x < (x2 - x1) * ((y - y1) / (y2 - y1)) + x1)
    return inside


def _depth_mm(view: Doubles, volume: SampleGrid, index: list[Indices]) -> Doubles:
    """Return how deep samples lie along the view's direction, mm from an arbitrary plane; larger is farther.

    In a perspective view w grows with the depth, in an orthographic one z does: either is a plane's equation.
    """
    row = view[3] if np.abs(view[3, :3]).max() > 1e-12 else view[2]
    normal = row[:3] / math.sqrt(float((row[:3] * row[:3]).sum()))
    along = product(normal[None], volume.affine[:3])[0].tolist()
    return ((along[0] * index[0] + along[1] * index[1]) + along[2] * index[2]) + along[3]
