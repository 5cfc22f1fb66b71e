# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the volume on either side of a wall not only as a whole but everywhere along it.

The smoothest field flattens what bulges, as far as the samples allow. Over an area wide enough to hold some steps of
the samples, as much has to lie before the surface as the samples have there; so a constant that changes slowly along
the wall is added.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Steps
from .bounds import NEAREST_ZERO
from .bricks import Floats

NARROW_GAPS, NARROW_PIXELS = 1.0, 5.0
WIDE_GAPS = 4.0
ROUNDS = 2


def keep_local_volume_steps(
    field: Floats, sign: NDArray[np.int8], spacing_mm: tuple[float, float, float], slice_steps: int
) -> Steps[None]:
    """Add to a field, in place, what keeps the volume of its samples along its surface.

    Parameters
    ----------
    field : ((slices - 1) * slice_steps + 1, rows, columns) float32, millimeters
    sign : (slices, rows, columns) int8
        1 or -1 at the samples of either side, 0 at others.
    spacing_mm : (x, y, z) float
        Of the samples that have signs.
    slice_steps : int
    """
    x, y, z = spacing_mm
    sides = (z / slice_steps, y, x)
    near_mm, far_mm = max(NARROW_GAPS * z, NARROW_PIXELS * max(x, y)), max(WIDE_GAPS * z, NARROW_PIXELS * max(x, y))
    reaches = [[max(1, round(width / side)) for side in sides] for width in (near_mm, far_mm)]
    samples = _refined(sign, slice_steps)
    known = samples != 0
    bound = np.zeros(field.shape, np.int8)
    bound[::slice_steps] = sign
    least = np.float32(NEAREST_ZERO * min(spacing_mm))
    half = np.float32(max(sides))
    for _ in range(ROUNDS):
        share = np.clip(field / half, -1, 1)
        missing = np.where(known, samples - share, np.float32(0))
        area = (known & (np.abs(share) < 1)) / half
        rise_z, rise_y, rise_x = (np.gradient(field, side, axis=axis) ** 2 for axis, side in enumerate(sides))
        upright = rise_z / np.maximum(rise_x + rise_y + rise_z, np.float32(1e-6)) * area
        yield PAUSE
        constants = []
        for reach in reaches:
            means = [missing, area, upright]
            for axis, steps in enumerate(reach):
                means = [_averaged(each, steps, axis) for each in means]
                yield PAUSE
            some = np.maximum(means[1], 1e-3 / half)
            constants.append(means[0] / some)
            weight = np.clip(means[2] / some, 0, 1)
        constant = np.clip(constants[0] * (1 - weight) + constants[1] * weight, -half, half).astype(np.float32)
        field += constant
        np.maximum(field, least, out=field, where=bound > 0)
        np.minimum(field, -least, out=field, where=bound < 0)
        yield PAUSE


def _refined(sign: NDArray[np.int8], slice_steps: int) -> Floats:
    """The signs on the refined grid, those of the nearest slice."""
    out = np.zeros(((len(sign) - 1) * slice_steps + 1, *sign.shape[1:]), np.float32)
    out[::slice_steps] = sign
    for step in range(1, slice_steps):
        share = 0.0 if 2 * step < slice_steps else 0.5 if 2 * step == slice_steps else 1.0
        between = sign[:-1] * np.float32(1 - share) + sign[1:] * np.float32(share)
        out[step::slice_steps] = np.where((sign[:-1] != 0) & (sign[1:] != 0), between, np.float32(0))
    return out


def _averaged(values: NDArray[np.floating], reach: int, axis: int) -> NDArray[np.float64]:
    """The mean of the samples up to `reach` before and after along an axis, twice; beyond the ends there are zeros."""
    out = np.moveaxis(values.astype(np.float64), axis, 0)
    for _ in range(2):
        total = np.cumsum(np.pad(out, [(reach + 1, reach), (0, 0), (0, 0)]), axis=0)
        out = (total[2 * reach + 1 :] - total[: -2 * reach - 1]) / (2 * reach + 1)
    return np.moveaxis(out, 0, axis)
