# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks in structures and in their surroundings compete for the voxels around them.

Each voxel goes to the click from which it is nearest by a time that counts millimeters and differences of smoothed
values: the geodesic distance of Criminisi et al. 2008 (doi:10.1007/978-3-540-88682-2_9), by plane sweeps
(`geodesic`). One click makes a structure, and later ones correct it (`claims`). Then the values of what was claimed and
of what lies around draw a smooth border (`border`).

Coarse to fine: all this is found on blocks of voxels, and only voxels near a border of the result are looked at one by
one (`blocks`). Nothing is read or touched farther from the clicks than `max_mm`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Bytes, Flags, Floats
from ...errors import SettingsError
from ...progress import PAUSE, Stages, Step, Steps, equal_part
from ...smoothing.gaussian import convolved, weights
from ...volume.value_kind import ValueKind
from ...volume.volume import Volume
from ..distance import Spacing, Window
from ..layers import MOST_STRUCTURES
from ..points import Sample, sample_in, window_around
from .blocks import Factors, block_means, blocks_any, drawn_steps, factors_of
from .border import BorderEvidence, border_steps
from .claims import Claims, Ground, Sides, claim_steps, no_claims
from .geodesic import BLOCKED, heights_of

MOST_CLICKS = 255
HU_PER_MM = 2.0
MAX_MM = 65.0
LIMITS = (0.01, 10_000.0)  # The limits of both numbers of a competition.
CLICKED_MM = 1.5  # Samples this near to a click are its own, whatever their values say.
NOISE_MM = 1.0  # Smooth the values that borders are drawn by with this sigma.
SIGMA_MM = 1.7  # Smooth the values that times are counted on by this much more.
SOFT_HU, MIDDLE_HU = 150.0, 50.0  # Differences count in full near soft tissue, less in bone and air.
# Above this value differences count by this factor: bone varies more inside than at its border.
BONE_HU, BONE = 150.0, 0.1
TABLE_HU = (-1024, 3072)
GRAY_HU = 120.0  # HU that the range from the lowest to the highest percent of other values stands for.
STAGES = {"Checking values": 4, "Growing regions": 4, "Finding the border": 4, "Drawing the border": 3}


class Click(NamedTuple):
    """A sample (slice, row, column) that belongs to a structure, numbered from 1; to the surroundings if that is 0."""

    sample: Sample
    structure: int


def compete_steps(
    volume: Volume,
    clicks: Sequence[Click],
    allowed: Flags | None = None,
    hu_per_mm: float = HU_PER_MM,
    max_mm: float = MAX_MM,
) -> Steps[Bytes]:
    """Give the voxels around clicks to structures.

    Parameters
    ----------
    volume : Volume
        HU; other gray values are scaled so that 98 % of them lie within 120 HU.
    clicks : sequence of Click
        At most 255 clicks, in their order: a later one corrects the result of the earlier ones.
    allowed : (slices, rows, columns) bool, optional
        Such as a range: other voxels belong to no structure.
    hu_per_mm : float
        HU that count as one millimeter; with fewer, a click claims only values closer to its own.
    max_mm : float
        Nothing farther from all clicks as the crow flies belongs to a structure. A first click's longest time is 1.5
        times that, because differences of values count too.

    Returns
    -------
    (slices, rows, columns) uint8
        Numbers of structures, 0 elsewhere.

    Raises
    ------
    SettingsError
        If there is no click in a structure, more than 255 clicks, one that is not allowed or lies outside, a structure
        above 255, or `hu_per_mm` or `max_mm` is not from 0.01 to 10,000.
    """
    _require_within("hu_per_mm", hu_per_mm)
    _require_within("max_mm", max_mm)
    own = _own_clicks(clicks, volume)
    if allowed is not None and not all(allowed[click.sample] for click in own):
        raise SettingsError("a click in a structure lies outside the range; widen the range, or click elsewhere")
    stages = Stages(STAGES)
    finding, competing, bordering, drawing = STAGES
    window = window_around([click.sample for click in own], max_mm, volume.spacing, volume.shape)
    near = [Click(sample_in(click.sample, window), click.structure) for click in clicks if _is_in(click.sample, window)]
    permitted = None if allowed is None else allowed[window]
    tissue = yield from stages.run(finding, _tissue_steps(volume, window))
    factors = factors_of(tissue.shape, volume.spacing)
    z, y, x = (side * factor for side, factor in zip(reversed(volume.spacing), factors, strict=True))
    means = yield from _smoothed_steps(block_means(tissue, factors), (z, y, x), NOISE_MM)
    smooth = yield from _smoothed_steps(means, (z, y, x), SIGMA_MM)
    bone = float(_rounded(_soft(np.array(BONE_HU)))) if volume.kind == ValueKind.HU else math.inf
    ground = Ground(smooth, heights_of(smooth, hu_per_mm), (z, y, x), bone)
    blocks = [(_block_of(click.sample, factors), click.structure) for click in near]
    reachable = None if permitted is None else blocks_any(permitted, factors)
    # Times begin at the border of a ball around the middle of a block, and the click may be at the block's corner.
    corner_mm = math.hypot(*(side * (1 - 1 / factor) / 2 for side, factor in zip((z, y, x), factors, strict=True)))
    reach_mm = max(max_mm - corner_mm, max_mm / 10)
    claims = yield from stages.run(competing, _claims_steps(ground, blocks, reachable, reach_mm))
    borders = yield from stages.run(bordering, _borders_steps(claims, means, (z, y, x), blocks))
    labels = np.zeros(volume.shape, np.uint8)
    labels[window] = yield from stages.run(drawing, drawn_steps(tissue, permitted, borders, factors))
    for click in clicks:  # A click always counts, whatever its value.
        ball, inside = _ball(click.sample, min(CLICKED_MM, max_mm), volume.spacing, labels.shape)
        labels[ball][inside if allowed is None else inside & allowed[ball]] = click.structure
    return labels


def _require_within(name: str, value: float) -> None:
    low, high = LIMITS
    if not low <= value <= high:
        raise SettingsError(f"{name} must be from {low:g} to {high:g}, not {value:g}")


def _own_clicks(clicks: Sequence[Click], volume: Volume) -> list[Click]:
    """Return the clicks in structures; refuse impossible ones."""
    if len(clicks) > MOST_CLICKS:
        raise SettingsError(
            f"{len(clicks)} clicks are too many, at most {MOST_CLICKS} can compete; draw in several regions"
        )
    for click in clicks:
        if not 0 <= click.structure <= MOST_STRUCTURES:
            raise SettingsError(f"a click names structure {click.structure}; number structures from 1 to 255")
        if not all(0 <= at < count for at, count in zip(click.sample, volume.shape, strict=True)):
            raise SettingsError(
                f"a click at {click.sample} lies outside the volume, which has {volume.shape}; click inside it"
            )
    own = [click for click in clicks if click.structure]
    if not own:
        raise SettingsError("no click marks a structure; click in one before clicking in its surroundings")
    return own


def _ball(sample: Sample, radius_mm: float, spacing_mm: Spacing, shape: Sequence[int]) -> tuple[Window, Flags]:
    """Return the window of the voxels within a radius of a sample, and which of it they are."""
    sides = list(reversed(spacing_mm))
    window = [
        slice(max(0, at - int(radius_mm / side)), min(count, at + int(radius_mm / side) + 1))
        for at, side, count in zip(sample, sides, shape, strict=True)
    ]
    z, y, x = (
        ((np.arange(span.start, span.stop) - at) * side) ** 2
        for span, at, side in zip(window, sample, sides, strict=True)
    )
    return (window[0], window[1], window[2]), z[:, None, None] + y[:, None] + x <= radius_mm * radius_mm


def _tissue_steps(volume: Volume, window: Window) -> Steps[Floats]:
    """Return the values in a window on a scale where a difference of soft tissues counts in full, float32."""
    z, y, x = window
    shape = tuple(side.stop - side.start for side in window)
    tissue = np.empty(shape, np.float32)
    low, high = TABLE_HU
    hu = np.arange(low, high + 1, dtype=np.float64)
    scale = _soft(hu)
    scale -= (1 - BONE) * np.maximum(scale - _soft(np.array(BONE_HU)), 0)
    table = _rounded(scale).astype(np.float32)
    first, share = 0.0, 1.0
    if volume.kind != ValueKind.HU:
        table = (hu - low).astype(np.float32)
        sample = volume.samples(
            *(range(side.start, side.stop, max(1, (side.stop - side.start) // 48)) for side in window)
        )
        ends = np.percentile(sample[np.isfinite(sample)], (1.0, 99.0)) if np.isfinite(sample).any() else (0.0, 1.0)
        first, share = float(ends[0]), GRAY_HU / max(float(ends[1]) - float(ends[0]), 1e-12)
    layers = max(1, (1 << 20) // (shape[1] * shape[2]))
    for start in range(z.start, z.stop, layers):
        stop = min(z.stop, start + layers)
        values: NDArray[Any] = volume.samples(range(start, stop), range(y.start, y.stop), range(x.start, x.stop))
        if volume.kind != ValueKind.HU:
            values = (values - first) * share + low
        if values.dtype.kind == "f":
            values = np.nan_to_num(values, nan=low, posinf=high, neginf=low).clip(low, high).round()
        at = np.clip(values, low, high).astype(np.int16) - np.int16(low)
        np.take(table, at, out=tissue[start - z.start : stop - z.start])
        yield Step((stop - z.start) / shape[0])
    return tissue


def _soft(hu: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return HU on a scale where differences of soft tissues count in full."""
    return SOFT_HU * np.arcsinh((hu - MIDDLE_HU) / SOFT_HU)


def _rounded(scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values rounded, so that the last bit of a machine's logarithm does not matter."""
    return np.rint(scale * 16) / 16


def _smoothed_steps(values: Floats, sides_mm: Sides, sigma_mm: float) -> Steps[Floats]:
    for axis, side in enumerate(sides_mm):
        values = convolved(values, weights(sigma_mm / side), axis)
        yield PAUSE
    return values


def _claims_steps(
    ground: Ground, clicks: Sequence[tuple[Sample, int]], reachable: Flags | None, max_mm: float
) -> Steps[Claims]:
    """Let the clicks claim blocks, one after the other."""
    if reachable is not None:
        ground.heights[~reachable] += BLOCKED
    claims = no_claims(ground.values.shape)
    for number, (block, structure) in enumerate(clicks):
        yield from equal_part(claim_steps(claims, ground, block, structure, max_mm), number, len(clicks))
    return claims


def _borders_steps(
    claims: Claims, means: Floats, sides_mm: Sides, clicks: Sequence[tuple[Sample, int]]
) -> Steps[dict[int, BorderEvidence]]:
    borders = {}
    structures = sorted({structure for _, structure in clicks if structure})
    for number, structure in enumerate(structures):
        work = border_steps(claims, means, sides_mm, clicks, structure)
        border = yield from equal_part(work, number, len(structures))
        if border is not None:
            borders[structure] = border
    return borders


def _block_of(sample: Sample, factors: Factors) -> Sample:
    z, y, x = (at // factor for at, factor in zip(sample, factors, strict=True))
    return z, y, x


def _is_in(sample: Sample, window: Window) -> bool:
    return all(side.start <= at < side.stop for at, side in zip(sample, window, strict=True))
