# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a DICOM folder, file or DICOMDIR as values and affine: find the series, stack it, decode it.

Headers are read in header.py and frames.py, stack_geometry.py does the geometry and pixels.py the pixels. No patient
data is read. Errors name DICOM files, notes never do.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core import DamagedSliceError, ReadError, Stages, Steps, mm_text
from ...core.volume import SPACING_LIMITS, ValueKind, is_spacing
from ..file_formats import files_below, natural_key, suffix, volume_stem
from ..optional_imports import imported_steps, quiet, quiet_batches_steps
from ..options import ReadingOptions
from ..registry import FORMATS
from ..result import RawValues, ReadRequest, Series, VolumeSource
from ..value_kind import is_mask_steps
from .dose_frames import GY
from .header import (
    DOSE_MODALITY,
    Broken,
    ImageFile,
    Slice,
    has_other_suffix,
    kind_in_words,
    may_be_dicom,
    read_dose_header,
    read_header,
)
from .listing import is_placed, is_scout, largest_group, listed, turning
from .mask_series import masks_among_steps
from .pixel_format import high_bit_notes
from .pixels import check_codec
from .slices import values_steps
from .stack_geometry import Stack, stack_up
from .times import times_of
from .uptake import uptake_steps

MOST_LISTED = 12  # More series are counted, not listed.
SHORTEST = 132  # A DICOM file has at least the bytes of its preamble.
PET_MODALITY = "PT"
SHORTEST_CT = 10  # Slices; a PET of more slices than a CT is passed over, but not for a scout.
STEEPEST = 1e9  # A larger RescaleSlope or RescaleIntercept is damage.


class FolderContent(NamedTuple):
    """The DICOM files of a folder: slices by series, and images that cannot be read."""

    series: dict[str, list[Slice]]
    broken: list[Broken]
    color: list[ImageFile]
    strays: int


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
        damaged = _damaged(self.content, uid)
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
        kind, said = ValueKind.GRAY, meaning(slices)
        if all(ct_slice.image.hounsfield for ct_slice in slices):
            kind = ValueKind.HU
        elif slices[0].image.modality == DOSE_MODALITY:
            is_gray = all(ct_slice.geometry.unit == GY for ct_slice in slices)
            kind, said = ValueKind.DOSE if is_gray else ValueKind.GRAY, list(slices[0].image.remarks)
        elif slices[0].image.modality == PET_MODALITY:
            uptake = yield from uptake_steps(slices, self.content.series[uid])
            slices, said = uptake.slices, uptake.notes
            kind = ValueKind.SUV if uptake.is_suv else kind
        stack, own_spacing = _stack_and_spacing_note(slices, request)
        ordered = [slices[at] for at in stack.order]
        notes += _damaged_notes(damaged, self.content.series[uid], stack)
        stages = Stages({"Decoding slices": 9, "Looking at the values": 1})
        decoding = values_steps(ordered, stack, request.whole, request.budget)
        values, padding_notes = yield from stages.run("Decoding slices", decoding)
        mask = 0
        if not request.mask and kind in (ValueKind.HU, ValueKind.GRAY):
            mask = yield from stages.run("Looking at the values", is_mask_steps(values))
        notes += [*([] if mask or request.mask else said), *stack.notes, *padding_notes]
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
        longest = max(other.slices for other in self.series)
        why = "with the most slices" if line.slices == longest else "which is not a PET"
        return line.uid, [f"{count} series found: series {line.number}, {why}, was read"]


def _stack_and_spacing_note(slices: Sequence[Slice], request: ReadRequest) -> tuple[Stack, str]:
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
    stages = Stages({"Reading header": 1, "Reading headers": 19, "Looking at masks": 1})
    if path.is_dir() or path.name.upper() == "DICOMDIR":
        folder = path if path.is_dir() else path.parent
        candidates = [file for file in files or files_below(folder) if not has_other_suffix(file)]
        headers = yield from stages.run("Reading headers", headers_steps(candidates))
        source = DicomSource(path, _sorted_out(headers))
        yield from stages.run("Looking at masks", source.find_masks_steps())
        return source
    (own,) = yield from stages.run("Reading header", _each_header_steps([path]))
    if own is None or (isinstance(own, Broken) and own.stray):
        kind = kind_in_words(path)
        what = f"holds a DICOM object that is not a CT: {kind}" if kind else "is not a DICOM image"
        raise ReadError(f"{path.name} {what}; choose a CT slice or its folder")
    if isinstance(own, Broken):
        raise truncated(own)
    if len(own.frames) > 1:
        return DicomSource(path, _sorted_out([own]))
    files = sorted((file for file in path.parent.iterdir() if file.is_file()), key=natural_key)
    at = next(number for number, file in enumerate(files) if file.name == path.name)
    before = yield from stages.run("Reading headers", headers_steps(files[:at]))
    after = yield from stages.run("Reading headers", headers_steps(files[at + 1 :]))
    headers = [*before, own, *after]
    return DicomSource(
        path, _sorted_out([header for header in headers if header.series == own.series or isinstance(header, Broken)])
    )


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
    return DicomSource(path, _sorted_out([own]))


def headers_steps(files: Sequence[Path]) -> Steps[list[ImageFile | Broken]]:
    """Read the header of every DICOM image among files, in their order; other files are passed over.

    Parameters
    ----------
    files : sequence of Path
    """
    headers = yield from _each_header_steps(files)
    return [header for header in headers if header is not None]


def _each_header_steps(files: Sequence[Path]) -> Steps[list[ImageFile | Broken | None]]:
    """Return `read_header` of each file; pydicom is imported only where one may be DICOM."""
    stages = Stages({"Loading pydicom": 1, "Reading headers": 4})
    if any(map(may_be_dicom, files)):
        yield from stages.run("Loading pydicom", imported_steps("pydicom", "pydicom", "DICOM"))
    return (yield from stages.run("Reading headers", quiet_batches_steps(read_header, files, "Reading headers", 16)))


def estimate_voxels(folder: Path) -> int:
    """Return the voxels of a folder's slices if all are like the first; 0 if it has no image."""
    files = list(files_below(folder))
    with quiet():
        first = next((header for header in map(read_header, files) if isinstance(header, ImageFile)), None)
    return 0 if first is None else first.rows * first.columns * len(files) * len(first.frames)


def _sorted_out(headers: Sequence[ImageFile | Broken]) -> FolderContent:
    """Group slices by series, in the order in which the series first appear."""
    series: dict[str, list[Slice]] = {}
    broken = [header for header in headers if isinstance(header, Broken)]
    images = [header for header in headers if isinstance(header, ImageFile)]
    color = [image for image in images if not image.gray]
    for image in images:
        if image.gray:
            series.setdefault(image.series, []).extend(Slice(image, frame) for frame in range(len(image.frames)))
    slice_names: dict[tuple[Path, str], set[str]] = {}
    for image in images if broken else []:
        slice_names.setdefault((image.path.parent, _name_pattern(image.path)), set()).add(image.series)
    unsound, strays = [], 0
    for header in broken:
        own = (
            slice_names.get((header.path.parent, _name_pattern(header.path)), ()) if header.stray else (header.series,)
        )
        damage = "named like the slices, but not DICOM" if header.path.stat().st_size else "0 bytes"
        unsound += [
            header._replace(series=uid, damage=damage if header.stray else header.damage) for uid in sorted(own)
        ]
        strays += not own and _is_named_dicom(header.path)
    return FolderContent(series, unsound, color, strays)


def _name_pattern(path: Path) -> str:
    """Return the common part of the names in one export, with '#' for numbers and hexadecimal words.

    Examples
    --------
    >>> _name_pattern(Path("IM-0001-0017.dcm")), _name_pattern(Path("1.2.840.17")), _name_pattern(Path("0f1e22ab-77aa"))
    ('im-#-#.dcm', '#.#.#.#', '#-#')
    """
    words = re.sub(r"(?<![0-9a-z])[0-9a-f]{4,}(?![0-9a-z])", "#", path.name.casefold())
    return re.sub(r"[0-9]+", "#", words)


def _is_named_dicom(path: Path) -> bool:
    """Return whether a file that is not DICOM has a suffix of DICOM, or none and too few bytes."""
    return suffix(path) in FORMATS["DICOM"].suffixes or (not suffix(path) and path.stat().st_size < SHORTEST)


def _damaged(content: FolderContent, uid: str) -> list[Broken]:
    """Return the damaged files of a series, without which slices would be missing silently."""
    return [
        broken
        for broken in content.broken
        if broken.series == uid  # or one that was cut off within its UID
        or (broken.series not in content.series and uid.startswith(broken.series))
    ]


def _damaged_notes(damaged: Sequence[Broken], slices: Sequence[Slice], stack: Stack) -> list[str]:
    """Return the note about slices that were left out, by their number: the names of files may hold a patient's."""
    if not damaged:
        return []
    paths = {ct_slice.image.path for ct_slice in slices} | {broken.path for broken in damaged}
    numbers = {path: number for number, path in enumerate(sorted(paths, key=natural_key), 1)}
    left_out = sorted(numbers[broken.path] for broken in damaged)
    gap = "the gap was filled by linear interpolation" if stack.resampled else "no gap remains within the stack"
    if len(left_out) == 1:
        return [f"slice {left_out[0]} of {len(paths)}, by file name, is damaged and was left out; {gap}"]
    some = [str(number) for number in left_out[:MOST_LISTED]]
    some += ["more"] if len(left_out) > MOST_LISTED else []
    named = f"{', '.join(some[:-1])} and {some[-1]}"
    return [f"slices {named} of {len(paths)}, by file name, are damaged and were left out; {gap}"]


def truncated(broken: Broken) -> ReadError:
    """Return the error for a DICOM file that cannot be read to its end."""
    damage = broken.damage or f"{broken.path.stat().st_size} bytes"
    return ReadError(f"{broken.path.name} is a truncated or damaged DICOM file ({damage}); {broken.remedy}")


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


def meaning(slices: Sequence[Slice]) -> list[str]:
    """Return the notes about the meaning of the values."""
    modality = slices[0].image.modality
    if modality != "CT":
        return [f"the series is {modality or 'of unknown modality'}, not CT: its gray values are not HU"]
    return (
        [] if all(ct_slice.image.hounsfield for ct_slice in slices) else ["the CT's values are not in HU (RescaleType)"]
    )
