# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a folder of image slices, one image each; it has neither spacing nor orientation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ...core import ReadError, Stages, Steps
from ...core.files.input_files import add_inputs
from ..file_formats import format_of, natural_key, suffix, volume_stem
from ..optional_imports import imported_steps, quiet_batches_steps
from ..registry import BY_SUFFIX, FORMATS, IMAGE_SUFFIXES, PAGE_SUFFIXES
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from .decoded import DecodedSlices
from .ome_files import ome_files_among, ome_files_of, slices_of_ome_steps
from .pillow import DECODED, Picture, gray_slice, picture
from .skyscan_log import skyscan_spacing
from .slice_names import check_numbers, slices_by_name
from .tiff import opened_stack, page_count, raw_values_steps, tiff_picture, tiff_slice
from .tiff_axes import TiffMetadata


class _ImageFolder(VolumeSource):
    """The slices of one format in a folder.

    Parameters
    ----------
    folder : Path
    headers : sequence of Picture
        Of each slice, time after time.
    notes : sequence of str
    times : int
        Volumes at the same place.
    """

    has_geometry = False

    def __init__(self, folder: Path, headers: Sequence[Picture], notes: Sequence[str], times: int = 1) -> None:
        self.headers = headers
        self.notes = tuple(notes)
        self.format = _format_by_name(headers[0].path)
        first = headers[0]
        series = Series(1, "", len(headers) // times, (first.columns, first.rows), "", first.dtype.name, times)
        files = list(dict.fromkeys(header.path for header in headers))
        super().__init__(folder, (series,), files, volume_stem(folder.absolute()))

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Decode the slices, several at a time."""
        slices, rows, columns = self.series[0].shape
        first, earlier = self.headers[0], (request.time - 1) * slices

        def decode(number: int) -> NDArray[Any]:
            header = self.headers[earlier + number]
            pixels = gray_slice(header) if header.kind else tiff_slice(header)
            if pixels.shape != (rows, columns) or pixels.dtype.itemsize > first.dtype.itemsize:
                raise ReadError(
                    f"{header.path.name} is {pixels.shape} {pixels.dtype}, not as its header says; save it again"
                )
            return pixels

        reader = DecodedSlices(decode, (slices, rows, columns), first.dtype, request.budget.thread_count)
        lossy = "JPEG is lossy: the gray values are near the original ones, not equal to them"
        notes = (*self.notes, *([lossy] if self.format == "JPEG" else ()))
        metadata = _common_metadata(self.headers)
        if metadata.spacing is None:
            spacing, log_notes = skyscan_spacing(self.files)
            metadata = metadata._replace(spacing=spacing, notes=(*metadata.notes, *log_notes))
        return (yield from raw_values_steps(reader, metadata, notes, self.path.name, request))


def _common_metadata(headers: Sequence[Picture]) -> TiffMetadata:
    """Return the metadata that all slices share; if their spacings differ, a note instead of a spacing."""
    first = headers[0].metadata
    if all(header.metadata.spacing == first.spacing for header in headers):
        return first
    return first._replace(spacing=None, notes=("the slices have different spacings, so none is used",))


def images_in(folder: Path) -> list[Path]:
    """Return the image files of a folder, in natural order; hidden ones are passed over."""
    files = (path for path in folder.iterdir() if suffix(path) in IMAGE_SUFFIXES and not path.name.startswith("."))
    return sorted((path for path in files if path.is_file()), key=natural_key)


def header_of(path: Path) -> Picture:
    """Return the header of an image file of any format."""
    return tiff_picture(path) if suffix(path) in PAGE_SUFFIXES else picture(path)


def open_steps(path: Path) -> Steps[VolumeSource]:
    """Open the pages of a multi-page file; for a single slice, open the slices of its format in its folder."""
    stack = opened_stack(path) if is_whole_volume(path) else None
    return stack or (yield from open_folder_steps(path.parent, path))


def is_whole_volume(path: Path) -> bool:
    """Return whether a file is a volume by itself, and not a slice of its folder or one of the files of an OME-TIFF."""
    return format_of(path) == "TIFF" and page_count(path) > 1 and ome_files_of(path) is None


def open_folder_steps(folder: Path, own_slice: Path | None = None) -> Steps[VolumeSource]:
    """Open the slices of the format of `own_slice`, else of the commonest; or a folder's only multi-page TIFF."""
    if own_slice is not None and suffix(own_slice) not in IMAGE_SUFFIXES:
        raise ReadError(
            f"{own_slice.name} holds a picture; give it and its neighbors the suffix "
            f"{FORMATS[format_of(own_slice)].suffixes[0]}"
        )
    name = folder.absolute().name
    images = images_in(folder)
    own_slice = own_slice and listed(own_slice, images)
    images, notes = _one_format(images, own_slice)
    stages = Stages({"Reading headers": 1})
    ome = None
    if suffix(images[0]) in PAGE_SUFFIXES:
        ome = ome_files_among(images, name) if own_slice is None else ome_files_of(own_slice)
    if ome is not None:
        headers, ome_notes = yield from stages.run("Reading headers", slices_of_ome_steps(ome, images))
        _check_alike(headers)
        if own_slice is not None:
            notes.insert(0, f"{own_slice.name} belongs to an OME-TIFF of several files, which was read")
        return _ImageFolder(folder, headers, [*notes, *ome_notes], ome.pages.times)
    add_inputs(images)  # No output replaces a picture that is left out, either.
    images, left_out = slices_by_name(images, own_slice, name)
    notes += left_out
    if suffix(images[0]) not in PAGE_SUFFIXES:
        yield from imported_steps("imageio.v3", "imageio", DECODED)
    headers = yield from stages.run("Reading headers", quiet_batches_steps(header_of, images, "Reading headers", 16))
    if len(headers) == 1:
        stack = opened_stack(images[0]) if headers[0].pages > 1 else None
        if stack is None:
            raise ReadError(f"{name} has only one slice ({images[0].name}); a surface needs at least 2 slices")
        stack.name = volume_stem(folder)
        return stack
    _check_alike(headers)
    check_numbers(images)
    if own_slice is not None:
        notes.insert(0, f"{own_slice.name} is one slice: its folder was read, {len(headers)} slices")
    return _ImageFolder(folder, headers, notes)


def listed(own_slice: Path, images: Sequence[Path]) -> Path:
    """Return the path of a picture as its folder lists it, however the path is spelled; refuse hidden files."""
    same = next((path for path in images if path.name == own_slice.name), None)
    same = same or next((path for path in images if path.samefile(own_slice)), None)
    if same is None:
        raise ReadError(f"{own_slice.name}: hidden files are not read as slices; rename it without the leading dot")
    return same


def _format_by_name(path: Path) -> str:
    """Return the format of an image by its suffix, such as 'JPEG'."""
    return BY_SUFFIX[suffix(path)]


def _one_format(images: Sequence[Path], own_slice: Path | None) -> tuple[list[Path], list[str]]:
    """Return the images of the format of `own_slice`, else of the commonest, and a note on those left out."""
    counts = Counter(map(_format_by_name, images))
    best = max(counts, key=lambda name: (counts[name], -list(FORMATS).index(name)))
    best = _format_by_name(own_slice) if own_slice is not None else best
    selected = [path for path in images if _format_by_name(path) == best]
    other_formats = [f"{count} {name}" for name, count in sorted(counts.items()) if name != best]
    note = f"{' and '.join(other_formats)} beside the {len(selected)} {best} slices left out"
    return selected, [note] if other_formats else []


def _check_alike(headers: Sequence[Picture]) -> None:
    """Refuse slices of different sizes or depths, naming the first odd one."""
    pages = next((header for header in headers if header.pages > 1), None)
    if pages is not None:
        raise ReadError(
            f"{pages.path.name} has {pages.pages} pages among {len(headers)} TIFF files; choose one multi-page file"
        )
    for text_of, what in ((_size, "size"), (_depth, "depth"), (_calibration, "calibration")):
        counts = Counter(map(text_of, headers))
        usual = counts.most_common(1)[0][0]
        odd = next((header for header in headers if text_of(header) != usual), None)
        if odd is not None:
            raise ReadError(
                f"the slices differ in {what}: {odd.path.name} is {text_of(odd)} and most are {usual}; "
                "take the others out of the folder"
            )


def _size(header: Picture) -> str:
    return f"{header.columns} x {header.rows} pixels"


def _depth(header: Picture) -> str:
    return f"{header.dtype}"


def _calibration(header: Picture) -> str:
    return header.metadata.calibration.text
