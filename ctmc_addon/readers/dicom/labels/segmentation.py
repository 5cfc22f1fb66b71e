# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM segmentations: frames of masks or labels, put together to one label volume.

A frame holds one segment at one place, or in a label map all segments there; empty frames may be left out. Positions
are in LPS+ mm. DICOM PS3.3 C.8.20 (segmentation), C.7.6.16 (functional groups), PS3.5 8.1.1 (bits).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, Stages, Step, Steps
from ...labels.label_map import LabelMap
from ...optional_imports import imported_steps, needed, reason
from ...result import RawValues, ReadOptions, Series, VolumeSource
from ..header import ImageFile, Slice, pydicom_errors
from ..pixels import check_codec
from ..stored import StoredPixels
from .elements import Damaged
from .label_file import opened
from .references import found_steps, grid_of
from .segmentation_header import Header, header_steps
from .slice_grid import SliceGrid, grid_of_frames

DEFLATED_FRAMES = "1.2.840.10008.1.2.8.1"  # each frame deflated by itself


class SegmentationSource(VolumeSource):
    """One DICOM segmentation, on the grid of its CT where that lies near."""

    format = "DICOM SEG"
    has_geometry = True

    def __init__(self, path: Path, header: Header, slices: list[Slice]) -> None:
        self.header, self.slices = header, slices
        grid = self._grid(False)[0]
        most = max(header.names, default=1)
        count, rows, columns = grid.shape
        dtype = "uint8" if most < 256 else "uint16"
        super().__init__(path, (Series(1, header.image.series, count, (columns, rows), "SEG", dtype),), [path])

    @classmethod
    def open_steps(cls, path: Path) -> Steps[SegmentationSource]:
        """Read the file's header, and those of the images near it."""
        stages = Stages({"Loading pydicom": 1, "Reading headers": 2, "Looking for the CT": 4})
        yield from stages.run("Loading pydicom", imported_steps("pydicom", "pydicom", "DICOM"))
        header = yield from stages.run("Reading headers", header_steps(path))
        slices = yield from stages.run("Looking for the CT", found_steps(path, header.reference))
        return cls(path, header, slices)

    def _grid(self, strict: bool) -> tuple[SliceGrid, NDArray[np.int64], list[str]]:
        """The grid of the volume, slice, row and column at which each frame begins in it, and what was assumed."""
        image, frames = self.header.image, self.header.frames
        size = (image.rows, image.columns)
        notes: list[str] = []
        if self.slices:
            reason = "its frames do not lie on the slices"
            try:
                grid, notes = grid_of(self.slices, image.path, strict)
                places = grid.places(frames.positions, frames.orientation, frames.spacing, size)
                if places is not None:
                    return grid, places, notes
            except ReadError as error:
                reason = str(error)
            notes = [f"the CT that the segmentation refers to was not used for its grid: {reason}"]
        grid, own = grid_of_frames(
            frames.positions, frames.orientation, frames.spacing, size, frames.gap, image.path.name
        )
        places = grid.places(frames.positions, frames.orientation, frames.spacing, size)
        if places is None:
            raise ReadError(f"the frames of {image.path.name} do not lie on one grid; export it again")
        return grid, places, [*notes, *own]

    def read_raw_steps(self, options: ReadOptions) -> Steps[RawValues]:
        """Put every frame in its place; the label of the higher number keeps a voxel that several have."""
        header = self.header
        grid, places, notes = self._grid(options.strict)
        check_single(places, header.frames.segments, self.path.name)
        if header.image.pixels.compressed and header.image.pixels.syntax != DEFLATED_FRAMES:
            check_codec(header.image)
        highest = 0
        if header.kind == "LABELMAP":
            highest = 2 ** header.image.pixels.options["bits_allocated"] - 1
        label_map = LabelMap(
            grid.shape, header.names, header.colors, self.path.name, highest, memory_limit=options.memory_limit
        )
        volume_slices = [np.flatnonzero(grid.source == at) for at in range(len(grid.positions))]
        size = (header.image.rows, header.image.columns)
        slices = [Slice(header.image, number) for number in range(len(places))]
        plain = plain_frames(header.image)
        with StoredPixels(slices) as decoded:
            for number in range(len(places)):
                step = Step(number / len(places), "Reading frames")
                yield step
                stored = next(plain) if plain else (yield from decoded.slice_steps(number, step))
                at, row, column = places[number].tolist()
                for slice_number in volume_slices[at].tolist():
                    window = label_map.values[slice_number, row : row + size[0], column : column + size[1]]
                    paint(label_map, window, stored, header, int(header.frames.segments[number]))
        notes += label_map.overlap_note("segments", "the one with the higher number")
        notes += label_map.empty_note("segments")
        return RawValues(label_map.values, grid.affine, tuple(notes), "label", label_map.names, label_map.colors)


def paint(label_map: LabelMap, window: NDArray[Any], stored: NDArray[Any], header: Header, segment: int) -> None:
    """Put one frame into its window."""
    if header.kind == "LABELMAP":
        label_map.paint_labels(window, np.where(stored == header.padding, 0, stored) if header.padding else stored)
    else:
        inside = stored >= header.half if header.kind == "FRACTIONAL" else stored != 0
        label_map.paint(window, inside, segment)


def check_single(places: NDArray[np.int64], segments: NDArray[np.int64], name: str) -> None:
    """Refuse several frames of one segment at one place: time points, of which a volume has one."""
    keys = np.column_stack([places, segments])
    several = len(keys) - len(np.unique(keys, axis=0))
    if several:
        raise ReadError(
            f"{name} has {several} frames of a segment where it has another already, such as time points; "
            "export each as a file of its own"
        )


def plain_frames(image: ImageFile) -> Iterator[NDArray[Any]] | None:
    """The stored frames (rows, columns) in the file's order; None where pydicom has to decode them."""
    if image.pixels.syntax == DEFLATED_FRAMES:
        return read_frames(image, deflated_frames)
    return None if image.pixels.compressed else read_frames(image, native_frames)


def read_frames(
    image: ImageFile, read: Callable[[IO[bytes], ImageFile], Iterator[NDArray[Any]]]
) -> Iterator[NDArray[Any]]:
    """Frames from the opened file."""
    with opened(image.path) as (elements, _):
        elements.file.seek(image.pixels.start)
        yield from read(elements.file, image)


def native_frames(file: IO[bytes], image: ImageFile) -> Iterator[NDArray[Any]]:
    """Frames as they stand; those of one bit follow each other without a gap, the lowest bit first."""
    bits, size = image.pixels.options["bits_allocated"], image.rows * image.columns
    left = b""  # the byte in which the frame before ended
    for number in range(image.pixels.options["number_of_frames"]):
        start, stop = number * size * bits, (number + 1) * size * bits
        count = (stop + 7) // 8 - start // 8 - len(left)
        piece = left + file.read(count)
        left = piece[-1:] if stop % 8 else b""
        yield values_of(piece, bits, start % 8, image)


def deflated_frames(file: IO[bytes], image: ImageFile) -> Iterator[NDArray[Any]]:
    """Frames that are deflated each by itself (PS3.5 A.4.13, Deflated Image Frame Compression)."""
    encaps = needed("pydicom.encaps", "pydicom", "DICOM")
    bits, count = image.pixels.options["bits_allocated"], image.pixels.options["number_of_frames"]
    needed_bytes = (image.rows * image.columns * bits + 7) // 8
    try:
        for packed in encaps.generate_frames(file, number_of_frames=count):
            piece = zlib.decompressobj(-zlib.MAX_WBITS).decompress(packed, needed_bytes)
            yield values_of(piece, bits, 0, image)
    except pydicom_errors() as error:
        raise Damaged(reason(error)) from error


def values_of(piece: bytes, bits: int, first_bit: int, image: ImageFile) -> NDArray[Any]:
    """The pixels (rows, columns) in some bytes."""
    size = image.rows * image.columns
    if len(piece) * 8 < first_bit + size * bits:
        raise Damaged(f"{len(piece)} bytes of a frame of {image.columns} x {image.rows} pixels")
    if bits == 1:
        values = np.unpackbits(np.frombuffer(piece, np.uint8), bitorder="little")[first_bit : first_bit + size]
    else:
        values = np.frombuffer(piece, f"<u{bits // 8}", size)
    return values.reshape(image.rows, image.columns)
