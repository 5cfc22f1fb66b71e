# SPDX-License-Identifier: GPL-3.0-or-later
"""Read DICOM segmentations: frames of masks or labels become one label volume.

A frame holds one segment at one position, or in a label map all segments there; empty frames may be missing. Positions
are in LPS+ mm. DICOM PS3.3 C.8.20 (segmentation), C.7.6.16 (functional groups).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, Stages, Step, Steps
from ....core.volume import ValueKind
from ...labels.label_map import LabelMap
from ...optional_imports import imported_steps
from ...result import RawValues, ReadRequest, VolumeSource
from ...series import Series
from ..header import Slice
from ..pixels.pixels import check_codec
from ..pixels.stored import StoredPixels
from .bit_frames import plain_frames
from .references import grid_of, referenced_slices_steps
from .segmentation_header import SegmentationHeader, header_steps
from .slice_grid import SliceGrid, grid_of_frames


class _SegmentationSource(VolumeSource):
    """One DICOM segmentation, on the grid of its CT if that lies near."""

    format = "DICOM SEG"
    has_geometry = True

    def __init__(self, path: Path, header: SegmentationHeader, slices: list[Slice]) -> None:
        self.header, self.slices = header, slices
        grid = self._grid(False)[0]
        most = max(header.names, default=1)
        count, rows, columns = grid.shape
        dtype = "uint8" if most < 256 else "uint16"
        super().__init__(path, (Series(1, header.image.series, count, (columns, rows), "SEG", dtype),), [path])

    def _grid(self, strict: bool) -> tuple[SliceGrid, NDArray[np.int64], list[str]]:
        """Return the grid of the volume, the slice, row and column at which each frame begins, and notes."""
        image, frames = self.header.image, self.header.frames
        size = (image.rows, image.columns)
        notes: list[str] = []
        if self.slices:
            reason = "its frames do not lie on the slices"
            try:
                grid, notes = grid_of(self.slices, image.path, strict)
                offsets = grid.offsets(frames.positions, frames.orientation, frames.spacing, size)
                if offsets is not None:
                    return grid, offsets, notes
            except ReadError as error:
                reason = str(error)
            notes = [f"the CT that the segmentation refers to was not used for its grid: {reason}"]
        grid, own = grid_of_frames(
            frames.positions, frames.orientation, frames.spacing, size, frames.gap, image.path.name
        )
        offsets = grid.offsets(frames.positions, frames.orientation, frames.spacing, size)
        if offsets is None:
            raise ReadError(f"the frames of {image.path.name} do not lie on one grid; export it again")
        return grid, offsets, [*notes, *own]

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Put every frame in its position; segments that overlap lie in different layers."""
        header = self.header
        grid, offsets, notes = self._grid(request.strict)
        _check_single(offsets, header.frames.segments, self.path.name)
        plain = plain_frames(header.image)
        if plain is None:
            check_codec(header.image)
        highest = 0
        if header.kind == "LABELMAP":
            highest = 2 ** header.image.pixels.options["bits_allocated"] - 1
        label_map = LabelMap(grid.shape, header.names, header.colors, self.path.name, highest, budget=request.budget)
        volume_slices = [np.flatnonzero(grid.source == at) for at in range(len(grid.positions))]
        slices = [Slice(header.image, number) for number in range(len(offsets))]
        with StoredPixels(slices) as decoded:
            for number in range(len(offsets)):
                step = Step(number / len(offsets), "Reading frames")
                yield step
                stored = next(plain) if plain else (yield from decoded.slice_steps(number, step))
                at, row, column = offsets[number].tolist()
                for slice_number in volume_slices[at].tolist():
                    segment = int(header.frames.segments[number])
                    paint(label_map, (slice_number, row, column), stored, header, segment)
        notes += label_map.overlap_note("segments")
        notes += label_map.empty_note("segments") + label_map.undescribed_note()
        names, colors = label_map.names, label_map.colors
        first, *further = label_map.layers()
        return RawValues(first, grid.affine, tuple(notes), ValueKind.LABEL, names, colors, layers=tuple(further))


def open_steps(path: Path) -> Steps[_SegmentationSource]:
    """Read the file's header, and those of the images near it."""
    stages = Stages({"Loading pydicom": 1, "Reading headers": 2, "Looking for the CT": 4})
    yield from stages.run("Loading pydicom", imported_steps("pydicom", "pydicom", "DICOM"))
    header = yield from stages.run("Reading headers", header_steps(path))
    slices = yield from stages.run("Looking for the CT", referenced_slices_steps(path, header.reference))
    return _SegmentationSource(path, header, slices)


def paint(
    label_map: LabelMap, at: tuple[int, int, int], stored: NDArray[Any], header: SegmentationHeader, segment: int
) -> None:
    """Write the label of one frame into the label map.

    Parameters
    ----------
    label_map : LabelMap
    at : (slice, row, column) int
        The position of the frame's first pixel.
    stored : (rows, columns) uint8 or uint16
        Pixels of the frame.
    header : SegmentationHeader
        It has the meaning of the pixels.
    segment : int
        Number of the frame's segment; a label map has its numbers in the pixels.
    """
    slice_, top, left = at
    if header.kind == "LABELMAP":
        labels = np.where(stored == header.padding, 0, stored) if header.padding else stored
        label_map.paint_labels(slice_, labels, top, left)
    else:
        inside = stored >= header.half if header.kind == "FRACTIONAL" else stored != 0
        label_map.paint(slice_, inside, segment, top, left)


def _check_single(offsets: NDArray[np.int64], segments: NDArray[np.int64], name: str) -> None:
    """Refuse several frames of one segment at one position, because a volume has one time point."""
    keys = np.column_stack([offsets, segments])
    several = len(keys) - len(np.unique(keys, axis=0))
    if several:
        raise ReadError(
            f"{name} has {several} further frame{'s' * (several > 1)} of a segment at the same position, such as time "
            "points; export each time point as a file of its own"
        )
