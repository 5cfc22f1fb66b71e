"""A DICOM folder, file or DICOMDIR to values and affine: find the series, stack it, decode it.

What the headers say is read in headers.py and multiframe.py, geometry is slices.py's, pixels are
pixels.py's. No patient data is read; names of DICOM files stand in errors, never in notes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Step, Steps, within
from ..file_formats import DICOM_SUFFIXES, KNOWN_SUFFIXES, files_below, natural, suffix
from ..optional_imports import imported_steps, quiet, quiet_batches
from ..result import Reading, Series
from ..value_kind import PLANES, require_memory
from .frames import FrameGeometry
from .header import WHAT, Broken, ImageFile, has_preamble, looks_like_dataset, read_by_pydicom, read_header, read_plain
from .pixels import DoesNotFit, SliceRead, check_codec, fill_slice, output_type, padding_mark
from .stack_geometry import Stack, stack_up

SCAN_SHARE = 0.3  # of the progress goes to headers
SAME_DIRECTION = 1e-4  # of a unit vector: rounding in the files, 0.05 mm over 512 pixels
MOST_LISTED = 12  # series in one note


class Slice(NamedTuple):
    """One frame of one file."""

    image: ImageFile
    frame: int

    @property
    def geometry(self) -> FrameGeometry:
        """Place and scale of this frame."""
        return self.image.frames[self.frame]

    @property
    def name(self) -> str:
        """For errors: the file, and the frame where there are several."""
        several = len(self.image.frames) > 1
        return f"{self.image.path.name} frame {self.frame + 1}" if several else self.image.path.name


class Found(NamedTuple):
    """What a folder holds: slices by series, and images that are broken."""

    series: dict[str, list[Slice]]
    broken: list[Broken]
    colour: int
    strays: int


def may_be_dicom(path: Path) -> bool:
    """Whether a file in a folder is worth parsing: by its suffix and its first bytes."""
    if suffix(path) in KNOWN_SUFFIXES and suffix(path) not in DICOM_SUFFIXES:
        return False
    try:
        with path.open("rb") as file:
            return has_preamble(file) or looks_like_dataset(file)
    except OSError:
        return False


def read_steps(
    path: Path,
    series: str | int | None,
    strict: bool,
    spacing: tuple[float, float, float] | None,
) -> Steps[Reading]:
    """Read the series of a folder with the most slices, or the one `series` names, or a file's own."""
    found = yield from within(find_steps(path), 0.0, SCAN_SHARE)
    uid, notes = chosen_series(found, series, path)
    slices, left_out = one_geometry(found.series[uid], path)
    notes += left_out
    check_whole(found, uid)
    if found.strays:
        notes.append(f"{found.strays} file{'s' * (found.strays > 1)} named like DICOM left out, being something else")
    for image in {one.image.pixels.syntax: one.image for one in slices}.values():
        if image.pixels.compressed:
            yield from within(imported_steps("pydicom", "pydicom", WHAT), SCAN_SHARE, SCAN_SHARE)
            check_codec(image)
    first = slices[0].geometry
    pixel_spacing, unusable = first.spacing, ""
    if pixel_spacing is None or min(pixel_spacing) <= 0:
        unusable = "no PixelSpacing" if pixel_spacing is None else f"a PixelSpacing of {min(pixel_spacing):g} mm"
        if spacing is None:
            raise ReadError(f"the series has {unusable}, and it must be above 0 mm; give the spacing x, y, z in mm")
        pixel_spacing = (spacing[1], spacing[0])
    positions = np.array([one.geometry.position for one in slices], np.float64)  # (n, 3)
    orientation = first.orientation or ()
    stack = stack_up(positions, orientation, pixel_spacing, [one.name for one in slices], strict)
    ordered = [slices[at] for at in stack.order]
    values, padding_notes = yield from within(values_steps(ordered, stack), SCAN_SHARE, 1.0)
    kind = "HU" if all(one.image.hounsfield for one in ordered) else "grey value"
    notes += [*meaning(ordered), *stack.notes, *padding_notes]
    gap = float(np.sqrt((stack.affine[:3, 2] ** 2).sum()))
    own_spacing = f"where the series has {unusable} and {gap:.4g} mm between slices" if unusable else ""
    return Reading(values, stack.affine, tuple(notes), kind, what=WHAT, own_spacing=own_spacing)


def describe_steps(path: Path) -> Steps[tuple[Series, ...]]:
    """The series of a folder, or of one file."""
    found = yield from find_steps(path)
    return listed(found)


def find_steps(path: Path) -> Steps[Found]:
    """Headers of every DICOM image in the folder, or of the file's series in its folder."""
    if path.is_file() and path.name.upper() != "DICOMDIR":
        own = next(iter((yield from headers_steps([path]))), None)
        if own is None or (isinstance(own, Broken) and own.stray):
            raise ReadError(f"{path.name} is no DICOM image; choose a CT slice or its folder")
        if isinstance(own, Broken):
            raise truncated(own)
        if len(own.frames) > 1:
            return sorted_out([own])
        files = sorted((file for file in path.parent.iterdir() if file.is_file()), key=natural)
        headers = yield from headers_steps(files)
        return sorted_out([one for one in headers if one.series == own.series or isinstance(one, Broken)])
    folder = path.parent if path.is_file() else path
    return sorted_out((yield from headers_steps(list(files_below(folder)))))


def named_after(path: Path) -> Path:
    """What a volume is named after: a multi-frame file, else the folder: a slice's name often is an identifier."""
    own = read_header(path) if path.is_file() and path.name.upper() != "DICOMDIR" else None
    whole = path.is_dir() or (isinstance(own, ImageFile) and len(own.frames) > 1)
    return path if whole else path.absolute().parent


def headers_steps(files: Sequence[Path]) -> Steps[list[ImageFile | Broken]]:
    """Every DICOM image among `files`, in their order; parsing holds the interpreter, so one thread does it."""
    found: list[ImageFile | Broken | None] = []
    found += yield from within(quiet_batches(read_plain, files, "Reading headers", 16), 0.0, 0.1)
    others = [at for at, image in enumerate(found) if image is None]
    if any(may_be_dicom(files[at]) for at in others):
        yield from within(imported_steps("pydicom", "pydicom", WHAT), 0.1, 0.1)
    read = quiet_batches(read_by_pydicom, [files[at] for at in others], "Reading headers", 16)
    for at, image in zip(others, (yield from within(read, 0.1, 1.0)), strict=True):
        found[at] = image
    return [image for image in found if image is not None]


def sorted_out(headers: Sequence[ImageFile | Broken]) -> Found:
    """Slices by series, in the order in which the series first appear."""
    series: dict[str, list[Slice]] = {}
    broken, colour = [one for one in headers if isinstance(one, Broken)], 0
    for image in headers:
        if isinstance(image, Broken):
            continue
        if not image.grey:
            colour += 1
            continue
        series.setdefault(image.series, []).extend(Slice(image, frame) for frame in range(len(image.frames)))
    unsound = [one for one in broken if not one.stray]
    return Found(series, unsound, colour, len(broken) - len(unsound))


def listed(found: Found) -> tuple[Series, ...]:
    """The series without patient data, numbered from 1."""
    lines: list[Series] = []
    for number, (uid, slices) in enumerate(found.series.items(), 1):
        sizes = Counter((one.image.columns, one.image.rows) for one in slices)
        places = {one.geometry.position for one in slices} - {None}
        lines.append(
            Series(number, uid, len(places) or len(slices), sizes.most_common(1)[0][0], slices[0].image.modality)
        )
    return tuple(lines)


def chosen_series(found: Found, series: str | int | None, path: Path) -> tuple[str, list[str]]:
    """The UID of the series to read, and the note that lists the others."""
    lines = listed(found)
    if not lines:
        if found.broken:
            raise truncated(found.broken[0])
        other = f"; its {found.colour} colour images are no CT" if found.colour else ""
        raise ReadError(f"{path.name} has no DICOM images{other}; choose the folder of a CT series")
    text = "; ".join(line.text for line in lines[:MOST_LISTED])
    text += f"; and {len(lines) - MOST_LISTED} more" if len(lines) > MOST_LISTED else ""
    if series is not None and str(series).strip():
        wanted = str(series).strip()
        for line in lines:
            if wanted in (line.uid, str(line.number)):
                return line.uid, []
        raise ReadError(f"there is no series '{wanted}'; choose by number from {text}")
    # Pictures without a place make no volume; of as many slices the series listed first is taken.
    placed = {line.uid: any(one.geometry.position for one in found.series[line.uid]) for line in lines}
    best = max(lines, key=lambda line: (placed[line.uid], line.slices, -line.number))
    if len(lines) == 1:
        return best.uid, []
    return best.uid, [f"{len(lines)} series found, series {best.number} with the most slices was read: {text}"]


def check_whole(found: Found, uid: str) -> None:
    """Refuse a series with a broken file: a slice would be missing without a word."""
    for broken in found.broken:
        cut_off = broken.series not in found.series and uid.startswith(broken.series)  # in the midst of its UID
        if broken.series == uid or cut_off:
            raise truncated(broken)


def truncated(broken: Broken) -> ReadError:
    """The error for a DICOM file that cannot be read to its end."""
    size = broken.path.stat().st_size
    return ReadError(f"{broken.path.name} is a truncated or damaged DICOM file ({size} bytes); copy it again")


def one_geometry(slices: Sequence[Slice], path: Path) -> tuple[list[Slice], list[str]]:
    """The largest group of slices of one size, orientation and spacing, and what was left out."""
    placed = [one for one in slices if one.geometry.position and one.geometry.orientation]
    scouts = [one for one in placed if one.image.scout or one.geometry.scout]
    groups: list[list[Slice]] = []
    for one in placed:
        if one.image.scout or one.geometry.scout:
            continue
        group = next((group for group in groups if alike(group[0], one)), None)
        if group is None:
            groups.append([one])
        else:
            group.append(one)
    if not groups:
        if scouts:
            raise ReadError(f"{path.name} has only scouts ({len(scouts)}); choose the series of slices")
        none = f"the image in {path.name} has no position"
        if len(slices) > 1:
            none = f"none of the {len(slices)} slices or frames in {path.name} has a position"
        raise ReadError(
            f"{none} (ImagePositionPatient), which puts slices in order; export the series again, or as NIfTI"
        )
    # The largest, the first of equals; but a file given by itself chooses its own.
    best = next((group for group in groups if any(one.image.path == path for one in group)), max(groups, key=len))
    notes = []
    if len(placed) < len(slices):
        notes.append(f"{len(slices) - len(placed)} images without a position were left out")
    others = sum(len(group) for group in groups) - len(best)
    if scouts:
        notes.append(f"{len(scouts)} scout{'s' * (len(scouts) > 1)} left out")
    if others:
        plural = "slices" if others > 1 else "slice"
        notes.append(f"{others} {plural} of another size, orientation or spacing left out")
    if any(one.image.lookup for one in best):
        raise ReadError("the series scales its values by a look-up table, not by a slope; export it with RescaleSlope")
    if any(one.geometry.slope == 0 for one in best):
        raise ReadError("the series has a RescaleSlope of 0, which makes all values the same; export it again")
    return sorted(best, key=lambda one: (one.image.instance, one.frame)), notes


def alike(one: Slice, other: Slice) -> bool:
    """Whether two slices can belong to one volume."""
    if (one.image.rows, one.image.columns) != (other.image.rows, other.image.columns):
        return False
    a, b = one.geometry, other.geometry
    if (a.spacing is None) != (b.spacing is None):
        return False
    turned = max(abs(p - q) for p, q in zip(a.orientation or (), b.orientation or (), strict=True))
    scaled = max(
        (abs(p - q) / max(p, 1e-9) for p, q in zip(a.spacing or (), b.spacing or (), strict=True)), default=0.0
    )
    return turned <= SAME_DIRECTION and scaled <= SAME_DIRECTION


def meaning(slices: Sequence[Slice]) -> list[str]:
    """What the user has to know of the values."""
    modality = slices[0].image.modality
    if modality != "CT":
        return [f"the series is {modality or 'of unknown modality'}, not CT: its grey values are no HU"]
    return [] if all(one.image.hounsfield for one in slices) else ["the CT's values are not in HU (RescaleType)"]


def values_steps(slices: list[Slice], stack: Stack) -> Steps[tuple[NDArray[Any], list[str]]]:
    """Decode the ordered slices into one array in the smallest type that holds them."""
    floating = any(one.image.pixels.floating for one in slices)
    shape = (len(stack.below), slices[0].image.rows, slices[0].image.columns)
    for dtype in output_type([one.geometry for one in slices], floating):
        require_memory(shape, np.dtype(dtype).itemsize, "this series")
        values = np.empty(shape, dtype)
        decoding = resampled_steps if stack.resampled else decoded_steps
        try:
            lowest, padded = yield from decoding(slices, stack, values)
        except DoesNotFit:
            del values
            continue
        return values, (yield from unpadded_steps(values, lowest, padded))
    raise AssertionError("float32 holds every value")


def batch_size(slices: Sequence[Slice]) -> int:
    """Slices between two steps: one where it has to be decompressed, which takes 0.02 s and more.

    They are read by one thread: plain pixels are there before a thread would be, and pylibjpeg's
    decoders hold the interpreter while they work.
    """
    return 1 if slices[0].image.pixels.start is None else 8


def decoded_steps(slices: list[Slice], stack: Stack, values: NDArray[Any]) -> Steps[tuple[float, int]]:
    """Fill `values` slice by slice; the lowest real value and the number of padding pixels."""

    def fill(at: int) -> SliceRead:
        return fill_slice(slices[at].image, slices[at].frame, values[at])

    seen = yield from quiet_batches(fill, range(len(values)), "Decoding slices", batch_size(slices))
    return min(one.lowest for one in seen), sum(one.padded for one in seen)


def resampled_steps(slices: list[Slice], stack: Stack, values: NDArray[Any]) -> Steps[tuple[float, int]]:
    """Fill `values` by linear interpolation along the normal, holding two slices at a time."""
    lowest, padded = float("inf"), 0
    low, high = np.empty((2, *values.shape[1:]), values.dtype)
    done = 0  # slices of the volume
    for at, one in enumerate(slices):
        low, high = high, low
        with quiet():
            seen = fill_slice(one.image, one.frame, high)
        lowest, padded = min(lowest, seen.lowest), padded + seen.padded
        while done < len(values) and stack.below[done] + (stack.weight[done] > 0) <= at:
            yield Step(done / len(values), "Decoding and resampling slices")
            if stack.below[done] == at:
                values[done] = high
            else:
                between(low, high, float(stack.weight[done]), values[done])
            done += 1
    return lowest, padded


def between(low: NDArray[Any], high: NDArray[Any], weight: float, out: NDArray[Any]) -> None:
    """Linear mean of two slices, rounded where `out` is integer; beside padding the nearer slice alone."""
    mean = low.astype(np.float64) * (1.0 - weight) + high.astype(np.float64) * weight
    out[...] = np.rint(mean) if out.dtype.kind in "iu" else mean
    mark = padding_mark(out.dtype)
    beside = (low == mark) | (high == mark)
    if beside.any():
        out[beside] = (low if weight < 0.5 else high)[beside]


def unpadded_steps(values: NDArray[Any], lowest: float, padded: int) -> Steps[list[str]]:
    """Give padding the lowest real value, so that no surface surrounds it; the note that says so."""
    if not padded:
        return []
    if lowest == float("inf"):
        raise ReadError(f"all {padded} pixels of the series are padding; choose another series")
    mark = padding_mark(values.dtype)
    for at in range(0, len(values), PLANES):
        yield Step(1.0, "Clearing padding")
        some = values[at : at + PLANES]
        some[some == mark] = lowest
    return [f"{padded} padding pixels were set to the lowest value, {lowest:g}"]
