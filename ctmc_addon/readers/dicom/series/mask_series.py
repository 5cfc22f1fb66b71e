# SPDX-License-Identifier: GPL-3.0-or-later
"""Tell a series of mask slices from a CT: by the names of its folders and by the values of its middle slice."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ....core import CtmcError, Step, Steps
from ...file_formats import is_named_mask
from ...value_kind import NotAMask, two_values
from ..header import Slice
from ..pixels.stored import StoredPixels


def middle_is_mask_steps(slices: Sequence[Slice]) -> Steps[bool]:
    """Return whether the middle slice has at most two values, which no CT has."""
    try:
        with StoredPixels([slices[len(slices) // 2]]) as pixels:
            two_values((yield from pixels.slice_steps(0, Step(0.0, "Checking masks"))))
    except (CtmcError, NotAMask):
        return False
    return True


def masks_among_steps(candidates: Sequence[Sequence[Slice]], root: Path) -> Steps[frozenset[int]]:
    """Return which of several series are masks; empty if all or none of them are.

    One slice of each series is decoded at most, and none after the first series that is not a mask.

    Parameters
    ----------
    candidates : sequence of sequences of Slice
        The slices of each series.
    root : Path
        The opened folder; names of folders above it do not count.
    """
    named = [number for number, slices in enumerate(candidates) if is_named_mask(_folders_below(slices[0], root))]
    unnamed = [number for number in range(len(candidates)) if number not in named]
    masks: list[int] = []
    for number in (*unnamed, *named):
        if not (yield from middle_is_mask_steps(candidates[number])):
            return frozenset([*masks, *(named if number in unnamed else ())])
        masks.append(number)
    return frozenset(named if unnamed else ())


def _folders_below(ct_slice: Slice, root: Path) -> tuple[str, ...]:
    """Return the names of the folders between the opened folder and the file of a slice."""
    folder = ct_slice.image.path.parent
    return folder.relative_to(root).parts if folder.is_relative_to(root) else (folder.name,)
