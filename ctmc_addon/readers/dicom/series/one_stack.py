# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the slices of a series that make one stack, and stack them; refuse those that make none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ....core import ReadError, mm_text
from ....core.volume import SPACING_LIMITS, is_spacing
from ...result import ReadRequest
from ..header import Slice
from .listing import is_placed, is_scout, largest_group, turning
from .stack_geometry import Stack, stack_up

STEEPEST = 1e9  # A larger RescaleSlope or RescaleIntercept is damage.


def one_geometry(slices: Sequence[Slice], path: Path) -> tuple[list[Slice], list[str]]:
    """Return the largest group of slices of one size, orientation and spacing, and notes about other slices.

    Parameters
    ----------
    slices : sequence of Slice
        Slices of one series.
    path : Path
        For errors.

    Raises
    ------
    ReadError
        If the slices cannot be told apart into stacks.
    """
    placed = [ct_slice for ct_slice in slices if is_placed(ct_slice)]
    scouts = sum(map(is_scout, placed))
    best = largest_group(slices, path)
    if not best:
        if scouts:
            raise ReadError(f"{path.name} has only scouts ({scouts}); choose the series of slices")
        if any(ct_slice.geometry.position for ct_slice in slices):
            raise ReadError(
                f"no image in {path.name} has a position and a direction (ImageOrientationPatient), which put slices "
                "in order; export the series again, or as NIfTI"
            )
        none = f"the image in {path.name} has no position"
        if len(slices) > 1:
            none = f"none of the {len(slices)} slices or frames in {path.name} has a position"
        raise ReadError(
            f"{none} (ImagePositionPatient), which puts slices in order; export the series again, or as NIfTI"
        )
    turn = turning([ct_slice for ct_slice in placed if not is_scout(ct_slice)], best)
    if turn:
        raise ReadError(f"{turn}; resample the series to parallel slices (MPR) and export these")
    notes = []
    if len(placed) < len(slices):
        notes.append(f"{len(slices) - len(placed)} images without a position were left out")
    odd_slices = len(placed) - scouts - len(best)
    if scouts:
        notes.append(f"{scouts} scout{'s' * (scouts > 1)} left out")
    if odd_slices:
        plural = "slices" if odd_slices > 1 else "slice"
        notes.append(f"{odd_slices} {plural} of another size, orientation or spacing left out")
    if any(ct_slice.image.lookup for ct_slice in best):
        raise ReadError("the series scales its values by a look-up table, not by a slope; export it with RescaleSlope")
    for slope, intercept in {(ct_slice.geometry.slope, ct_slice.geometry.intercept) for ct_slice in best}:
        if not (0 < abs(slope) <= STEEPEST and abs(intercept) <= STEEPEST):  # nor NaN
            raise ReadError(
                f"the series has a RescaleSlope of {slope:g} and a RescaleIntercept of {intercept:g}, which give no "
                f"usable values: the slope must not be 0, and both at most {STEEPEST:g}; export it again"
            )
    return best, notes


def stack_and_spacing_note(slices: Sequence[Slice], request: ReadRequest) -> tuple[Stack, str]:
    """Return the stack of the slices, and words about a spacing that cannot be used."""
    first = slices[0].geometry
    pixel_spacing, unusable = first.spacing, ""
    if pixel_spacing is None or not is_spacing(pixel_spacing):
        unusable = "no PixelSpacing"
        if pixel_spacing is not None:
            wrong = next(length for length in pixel_spacing if not is_spacing([length]))
            unusable = f"a PixelSpacing of {mm_text(wrong)}"
        if request.spacing is None:
            raise ReadError(
                f"the series has {unusable}, and it must be {SPACING_LIMITS}; give the spacing x, y, z in mm"
            )
        pixel_spacing = (request.spacing[1], request.spacing[0])
    positions = np.array([ct_slice.geometry.position for ct_slice in slices], np.float64)  # (n, 3)
    orientation = first.orientation or ()
    stack = stack_up(positions, orientation, pixel_spacing, [ct_slice.name for ct_slice in slices], request.strict)
    gap = float(np.sqrt((stack.affine[:3, 2] ** 2).sum()))
    return stack, f"where the series has {unusable} and {mm_text(gap, 4)} between slices" if unusable else ""
