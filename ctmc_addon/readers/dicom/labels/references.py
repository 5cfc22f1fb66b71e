# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the series that a segmentation or structure set was drawn on, near its file.

The search covers the file's folder, the folders in it and its neighbors, as exports and archives arrange them.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ....core import ReadError, Steps
from ....core.files.input_files import add_inputs
from ....core.volume import SPACING_LIMITS, is_spacing
from ..header import ImageFile, Slice
from ..series.folder import headers_steps
from ..series.one_stack import one_geometry
from ..series.stack_geometry import stack_up
from ..series.times import times_of
from .slice_grid import SliceGrid, grid_of_ct

DEEPEST_BELOW, DEEPEST_IN_SIBLINGS = 3, 1  # Folders are searched this many levels deep.
MOST_FILES = 20_000  # The search ends after this many files.
FEWEST_SLICES = 2


class Reference(NamedTuple):
    """The series that a file refers to; fields are empty if missing."""

    series: frozenset[str]
    instances: frozenset[str]
    frame_of_reference: str

    def matches(self, images: list[ImageFile]) -> list[ImageFile]:
        """Return the images of the referenced series; if several match, of the one with most named slices."""
        candidates = [image for image in images if image.gray and not image.scout]
        named = [image for image in candidates if image.uid in self.instances]
        of_series = [image for image in candidates if image.series in self.series]
        if not named and not of_series and self.frame_of_reference:
            of_series = [image for image in candidates if image.frame_of_reference == self.frame_of_reference]
        best = Counter(image.series for image in named or of_series).most_common(1)
        return [image for image in candidates if best and image.series == best[0][0]]


def referenced_slices_steps(path: Path, reference: Reference) -> Steps[list[Slice]]:
    """Return the slices of the referenced series that lie near `path`; none where there are too few."""
    if not any(reference):
        return []
    for files in (below(path.parent, DEEPEST_BELOW), neighbors(path.parent)):
        listed = [file for _, file in zip(range(MOST_FILES), files, strict=False)]
        headers = yield from headers_steps(listed)
        images = reference.matches([header for header in headers if isinstance(header, ImageFile)])
        slices = [Slice(image, frame) for image in images for frame in range(len(image.frames))]
        if len(slices) >= FEWEST_SLICES:
            add_inputs(image.path for image in images)
            return slices
    return []


def grid_of(slices: list[Slice], path: Path, strict: bool) -> tuple[SliceGrid, list[str]]:
    """Return the grid of the volume of these slices, and notes about it."""
    slices, notes = one_geometry(slices, path)
    slices = max(times_of(slices), key=len)  # all times stand at the same places
    spacing = slices[0].geometry.spacing
    if spacing is None or not is_spacing(spacing):
        raise ReadError(f"the series that {path.name} refers to has no PixelSpacing {SPACING_LIMITS}; export it again")
    geometry = slices[0].geometry
    positions = np.array([ct_slice.geometry.position for ct_slice in slices], np.float64)  # (n, 3)
    names = [ct_slice.name for ct_slice in slices]
    stack = stack_up(positions, geometry.orientation or (), spacing, names, strict)
    return grid_of_ct(slices, stack, spacing), [*notes, *stack.notes]


def below(folder: Path, deepest: int) -> Iterator[Path]:
    """Yield the files of a folder and its folders, except hidden and unreadable ones.

    Parameters
    ----------
    folder : Path
    deepest : int
        How many folders deep to look.
    """
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    inner = []
    for entry in entries:
        if entry.name.startswith("."):
            continue
        if entry.is_dir(follow_symlinks=False):
            inner.append(Path(entry.path))
        elif entry.is_file():
            yield Path(entry.path)
    if deepest:
        for path in inner:
            yield from below(path, deepest - 1)


def neighbors(folder: Path) -> Iterator[Path]:
    """Yield files of the folders next to `folder`, unless those are a home's or the whole disk's."""
    folder = folder.resolve()
    around = folder.parent
    if around in (folder, around.parent, Path.home().parent, Path.home()):
        return
    try:
        siblings = sorted(entry.path for entry in os.scandir(around) if entry.is_dir(follow_symlinks=False))
    except OSError:
        return
    for sibling in map(Path, siblings):
        if sibling != folder and not sibling.name.startswith("."):
            yield from below(sibling, DEEPEST_IN_SIBLINGS)
