# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a DICOM folder, file or DICOMDIR as values and affine: find the series, stack it, decode it.

`folder.py` reads and sorts headers, `one_stack.py` chooses the slices of a stack, `../pixels` has their values. No
patient data is read. Errors name DICOM files, notes never do.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ....core import DamagedSliceError, ReadError, Stages, Steps
from ....core.volume import ValueKind
from ...file_formats import files_below, natural_key, volume_stem
from ...optional_imports import imported_steps, quiet
from ...options import ReadingOptions
from ...result import RawValues, ReadRequest, VolumeSource
from ...series import Series
from ...value_kind import is_mask_steps
from ..dose_frames import GY
from ..header import DOSE_MODALITY, Broken, Slice, has_other_suffix, kind_in_words, read_dose_header
from ..pixels.pixel_format import high_bit_notes
from ..pixels.pixels import check_codec
from ..pixels.slices import values_steps
from ..uptake import uptake_steps
from .folder import (
    FolderContent,
    damaged_notes,
    damaged_of,
    each_header_steps,
    headers_steps,
    sorted_by_series,
    truncated,
)
from .listing import listed
from .mask_series import masks_among_steps
from .one_stack import one_geometry, stack_and_spacing_note
from .times import times_of

MOST_LISTED = 12  # More series are counted, not listed.
PET_MODALITY = "PT"
SHORTEST_CT = 10  # Slices; a PET of more slices than a CT is passed over, but not for a scout.


class DicomSource(VolumeSource):
    """The DICOM images of a folder, or of a file's series."""

    format = "DICOM"
    has_geometry = True
    has_series = True

    def __init__(self, path: Path, content: FolderContent) -> None:
        self.content = content
        images = dict.fromkeys(ct_slice.image for slices in content.series.values() for ct_slice in slices)
        multi_frame = any(len(image.frames) > 1 and image.path == path for image in images)
        # A slice's own name often is an identifier.
        named_path = path if path.is_dir() or multi_frame else path.absolute().parent
        unused = [*(image.path for image in content.color), *(broken.path for broken in content.broken)]
        files = [*(image.path for image in images), *unused]
        super().__init__(path, listed(content.series, path), files, volume_stem(named_path))
        self.masks: frozenset[str] = frozenset()

    @property
    def _has_ct(self) -> bool:
        """Return whether a series other than a PET is long enough to be read instead of one."""
        return any(line.modality != PET_MODALITY and line.slices >= SHORTEST_CT for line in self.series)

    def find_masks_steps(self) -> Steps[None]:
        """Find the masks among the series with the most slices, which their CT shares with them."""
        most = max(map(self._extent, self.series), default=None)
        equals = [line.uid for line in self.series if self._extent(line) == most]
        if len(equals) > 1:
            masks = yield from masks_among_steps([self.content.series[uid] for uid in equals], self.path)
            self.masks = frozenset(equals[number] for number in masks)

    def selected_series(self, series: str | int | None) -> Series | None:
        """Return the series that would be read; by default the one with the most slices that have a place.

        Among equals a mask comes last. A UID or number names a series, else its folder or its description.
        """
        requested = "" if series is None else str(series).strip()
        matching = [line for line in self.series if requested in ("", line.uid, str(line.number))]
        if not matching:
            names = {line: {line.folder.casefold(), line.description.casefold()} for line in self.series}
            matching = [line for line in self.series if requested.casefold() in names[line]]
        return max(matching, key=self._preference, default=None)

    def _preference(self, line: Series) -> tuple[bool, bool, int, bool, int]:
        """Return the sort key of a series; the highest is read by default."""
        return (*self._extent(line), line.uid not in self.masks, -line.number)

    def images_read(self, options: ReadingOptions) -> list[Path]:
        """Return the files of the images that a volume is read from, in the order in which they were taken."""
        uid, _ = self._selected(str(options.series or ""))
        slices, _ = one_geometry(self.content.series[uid], self.path)
        taken = times_of(slices)[self.selected_time(options.series, options.time)[0] - 1]
        return list(dict.fromkeys(ct_slice.image.path for ct_slice in taken))

    def _extent(self, line: Series) -> tuple[bool, bool, int]:
        """Return whether slices of a series have positions, without which they make no volume, and their number.

        A PET is read only if it is asked for or there is no CT, which may have fewer slices.
        """
        is_placed_somewhere = any(ct_slice.geometry.position for ct_slice in self.content.series[line.uid])
        return is_placed_somewhere, line.modality != PET_MODALITY or not self._has_ct, line.slices

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the series with the most slices, or the one that `request` names."""
        uid, notes = self._selected(request.series or "")
        slices, left_out = one_geometry(self.content.series[uid], self.path)
        notes += left_out
        damaged = damaged_of(self.content, uid)
        if damaged and not request.skip_damaged:
            remedy = "or leave it out with skip_damaged"
            raise DamagedSliceError(f"{truncated(damaged[0])}, {remedy}")
        slices = times_of(slices)[request.time - 1]
        color = sum(image.series == uid for image in self.content.color)
        if color:
            notes.append(f"{color} color image{'s' * (color > 1)} of the series left out")
        strays = self.content.strays
        if strays:
            plural = "s" * (strays > 1)
            notes.append(f"{strays} file{plural} left out, named like DICOM or without a suffix, but not DICOM")
        for image in {ct_slice.image.pixels.syntax: ct_slice.image for ct_slice in slices}.values():
            if image.pixels.compressed:
                yield from imported_steps("pydicom", "pydicom", "DICOM")
                check_codec(image)
        kind, meaning = ValueKind.GRAY, _meaning(slices)
        if all(ct_slice.image.hounsfield for ct_slice in slices):
            kind = ValueKind.HU
        elif slices[0].image.modality == DOSE_MODALITY:
            is_gray = all(ct_slice.geometry.unit == GY for ct_slice in slices)
            kind, meaning = ValueKind.DOSE if is_gray else ValueKind.GRAY, list(slices[0].image.remarks)
        elif slices[0].image.modality == PET_MODALITY:
            uptake = yield from uptake_steps(slices, self.content.series[uid])
            slices, meaning = uptake.slices, uptake.notes
            kind = ValueKind.SUV if uptake.is_suv else kind
        stack, own_spacing = stack_and_spacing_note(slices, request)
        ordered = [slices[at] for at in stack.order]
        notes += damaged_notes(damaged, self.content.series[uid], stack)
        stages = Stages({"Decoding slices": 9, "Checking values": 1})
        decoding = values_steps(ordered, stack, request.whole, request.budget)
        values, padding_notes = yield from stages.run("Decoding slices", decoding)
        mask = 0
        if not request.mask and kind in (ValueKind.HU, ValueKind.GRAY):
            mask = yield from stages.run("Checking values", is_mask_steps(values))
        notes += [*([] if mask or request.mask else meaning), *stack.notes, *padding_notes]
        notes += high_bit_notes(ct_slice.image.pixels for ct_slice in ordered)
        names = {mask: self.name} if mask else {}
        return RawValues(
            values, stack.affine, tuple(notes), ValueKind.LABEL if mask else kind, names, own_spacing=own_spacing
        )

    def _selected(self, requested_series: str) -> tuple[str, list[str]]:
        """Return the UID of the series to read, and a note with the number of series."""
        if not self.series:
            if self.content.broken:
                raise truncated(self.content.broken[0])
            color = len(self.content.color)
            color_images = ""
            if color:
                color_images = "; its color image is not CT" if color == 1 else f"; its {color} color images are not CT"
            raise ReadError(f"{self.path.name} has no DICOM images{color_images}; choose the folder of a CT series")
        line = self.selected_series(requested_series)
        if line is None:
            text = "; ".join(line.text for line in self.series[:MOST_LISTED])
            text += f"; and {len(self.series) - MOST_LISTED} more" if len(self.series) > MOST_LISTED else ""
            raise ReadError(f"there is no series '{requested_series}'; choose by number from {text}")
        if requested_series or len(self.series) == 1:
            return line.uid, []
        count = len(self.series)
        if self.masks:
            return line.uid, [f"{count} series found: series {line.number}, which is not a mask, was read"]
        longest = max(each.slices for each in self.series)
        why = "with the most slices" if line.slices == longest else "which is not a PET"
        return line.uid, [f"{count} series found: series {line.number}, {why}, was read"]


def open_steps(path: Path, files: Sequence[Path] | None = None) -> Steps[DicomSource]:
    """Read the headers of the DICOM images at a path.

    Parameters
    ----------
    path : Path
        A folder, or a file, which stands for its series in its folder.
    files : sequence of Path, optional
        Only these files of the folder.

    Returns
    -------
    DicomSource

    Raises
    ------
    ReadError
        If a file at `path` is no DICOM image or is damaged.
    """
    stages = Stages({"Reading header": 1, "Reading headers": 19, "Checking masks": 1})
    if path.is_dir() or path.name.upper() == "DICOMDIR":
        folder = path if path.is_dir() else path.parent
        candidates = [file for file in files or files_below(folder) if not has_other_suffix(file)]
        headers = yield from stages.run("Reading headers", headers_steps(candidates))
        source = DicomSource(path, sorted_by_series(headers))
        yield from stages.run("Checking masks", source.find_masks_steps())
        return source
    (own,) = yield from stages.run("Reading header", each_header_steps([path]))
    if own is None or (isinstance(own, Broken) and own.stray):
        kind = kind_in_words(path)
        what = f"holds a DICOM object that is not a CT: {kind}" if kind else "is not a DICOM image"
        raise ReadError(f"{path.name} {what}; choose a CT slice or its folder")
    if isinstance(own, Broken):
        raise truncated(own)
    if len(own.frames) > 1:
        return DicomSource(path, sorted_by_series([own]))
    files = sorted((file for file in path.parent.iterdir() if file.is_file()), key=natural_key)
    at = next(number for number, file in enumerate(files) if file.name == path.name)
    before = yield from stages.run("Reading headers", headers_steps(files[:at]))
    after = yield from stages.run("Reading headers", headers_steps(files[at + 1 :]))
    headers = [*before, own, *after]
    own_series = [header for header in headers if header.series == own.series or isinstance(header, Broken)]
    return DicomSource(path, sorted_by_series(own_series))


def open_dose_steps(path: Path) -> Steps[DicomSource]:
    """Read the header of a dose (RTDOSE), which is a volume by itself.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ReadError
        If the file is damaged, or its frames have no place.
    """
    yield from imported_steps("pydicom", "pydicom", "DICOM")
    with quiet():
        own = read_dose_header(path)
    if own is None:
        raise ReadError(f"{path.name} holds an RT Dose without a grid of doses; choose a dose that has one")
    if isinstance(own, Broken):
        raise truncated(own)
    return DicomSource(path, sorted_by_series([own]))


def _meaning(slices: Sequence[Slice]) -> list[str]:
    """Return the notes about the meaning of the values."""
    modality = slices[0].image.modality
    if modality != "CT":
        return [f"the series is {modality or 'of unknown modality'}, not CT: its gray values are not HU"]
    return (
        [] if all(ct_slice.image.hounsfield for ct_slice in slices) else ["the CT's values are not in HU (RescaleType)"]
    )
