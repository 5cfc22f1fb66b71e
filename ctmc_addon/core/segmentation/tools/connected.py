# SPDX-License-Identifier: GPL-3.0-or-later
"""Find what is connected to clicked points, through openings that are wide enough.

The mask is eroded by half an opening, flooded from the points, and the flood dilated back by as much inside the mask:
a leak through a bridge that is narrower than the opening is cut. All distances are exact (`distance`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...arrays import Flags
from ...errors import SettingsError
from ...measures.units import mm_text
from ...progress import Step, Steps, equal_part
from ..distance import SLACK, Spacing, far_inside_steps, near_steps
from ..points import Sample, sample_in, window_around
from .islands import touching_steps


def connected_steps(
    allowed: Flags, samples: Sequence[Sample], spacing_mm: Spacing, max_mm: float = math.inf, opening_mm: float = 0.0
) -> Steps[Flags]:
    """Return the part of a mask that is connected to given samples.

    Parameters
    ----------
    allowed : (slices, rows, columns) bool
        Such as a range.
    samples : sequence of (slice, row, column) int
        The clicked points; those outside of the allowed samples have no effect.
    spacing_mm : (x, y, z) float
        For an oblique or sheared affine the lengths of its columns.
    max_mm : float
        No sample is farther from the nearest clicked one, as the crow flies.
    opening_mm : float
        Openings that are narrower by more than a voxel are closed, and none as wide; 0 closes none.

    Returns
    -------
    (slices, rows, columns) bool

    Raises
    ------
    SettingsError
        If no clicked sample is allowed, or none lies where the mask is as wide as the opening; or a length is below 0.
    """
    if not (max_mm > 0 and 0 <= opening_mm < math.inf):
        raise SettingsError(
            f"max_mm must be above 0, opening_mm 0 or more, not {max_mm:g} and {opening_mm:g}; leave them out"
        )
    clicked = [sample for sample in samples if allowed[sample]]
    if not clicked:
        raise SettingsError("no clicked point lies in the range; click inside the structure, or widen the range")
    result = np.zeros(allowed.shape, bool)
    window = window_around(clicked, max_mm, spacing_mm, allowed.shape)
    inner = allowed[window]
    own = [sample_in(sample, window) for sample in clicked]
    if max_mm < math.inf:
        inner = inner & (yield from equal_part(_around_steps(own, inner.shape, spacing_mm, max_mm), 0, 4))
    if opening_mm == 0:
        result[window] = yield from touching_steps(inner, own)
        return result
    half = opening_mm / 2
    core = yield from equal_part(far_inside_steps(inner, spacing_mm, half, at_least=True), 1, 4)
    wide = yield from equal_part(_cores_steps(core, inner, own, spacing_mm, half), 2, 4)
    flood = yield from touching_steps(core, wide)
    result[window] = inner & (yield from equal_part(near_steps(flood, spacing_mm, half), 3, 4))
    return result


def _around_steps(
    samples: Sequence[Sample], shape: tuple[int, ...], spacing_mm: Spacing, max_mm: float
) -> Steps[Flags]:
    """Return the samples that are at most so far from one of a few: a ball around each."""
    near = np.zeros(shape, bool)
    most = max_mm * max_mm * (1 + SLACK)
    for number, sample in enumerate(samples):
        squares = [
            ((np.arange(count) - at) * side) ** 2
            for count, at, side in zip(shape, sample, spacing_mm[::-1], strict=True)
        ]
        across = squares[1][:, None] + squares[2]
        for layer, square in enumerate(squares[0].tolist()):
            near[layer] |= across <= most - square
        yield Step((number + 1) / len(samples), "Measuring distances")
    return near


def _cores_steps(
    core: Flags, inner: Flags, clicked: Sequence[Sample], spacing_mm: Spacing, half_mm: float
) -> Steps[list[Sample]]:
    """Return the clicked samples of the core, and for each other one a core sample near it that the mask connects."""
    samples: list[Sample] = []
    for sample in clicked:
        if core[sample]:
            samples.append(sample)
            continue
        window = window_around([sample], half_mm, spacing_mm, core.shape)
        own = sample_in(sample, window)
        linked = yield from touching_steps(inner[window], [own])
        at = np.argwhere(core[window] & linked)
        apart = (at - np.array(own)) * np.array(spacing_mm[::-1])
        square = apart[:, 0] ** 2 + apart[:, 1] ** 2 + apart[:, 2] ** 2
        if at.size and square.min() <= half_mm * half_mm * (1 + 1e-6):
            z, y, x = (at[int(square.argmin())] + [side.start for side in window]).tolist()
            samples.append((z, y, x))
    if not samples:
        raise SettingsError(
            f"no clicked point lies where the structure is {mm_text(2 * half_mm)} wide; choose a narrower "
            "opening_mm, or click where it is wider"
        )
    return samples
