# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a folder of masks, a file or a folder of slices for each structure, as one label volume.

TotalSegmentator writes a NIfTI for each organ, 3D-IRCADb has a folder of DICOM slices for each. A mask has one value
besides the one around it; the labels are numbered by the natural order of the names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import CtmcError, OutputError, ReadError, Stages, Step, Steps
from ...core.volume import (
    NotWholeError,
    SliceReader,
    ValueKind,
    ValuesInMemory,
    WholeNumbers,
    farthest_corner_mm,
    spacing_of,
)
from ..dicom.series.folder import FolderContent
from ..dicom.series.mask_series import middle_is_mask_steps
from ..dicom.series.series import DicomSource
from ..file_formats import natural_key, segmentation_sibling, stem, suffix
from ..registry import MASK_SUFFIXES
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..value_kind import NotAMask, two_values
from .label_map import MOST_LABELS, LabelMap, limited

FEWEST = 2  # A folder of masks has at least this many.
MOST_NON_MASKS = 2  # With more files of other kinds it is not a folder of masks.
SAME_GRID = 0.1  # Corners may differ by this share of the smallest spacing.


class _MaskFolder(VolumeSource):
    """A folder of masks on one grid, read one after the other.

    Parameters
    ----------
    masks : mapping of str to VolumeSource
        By the name of the structure, in the order of their labels.
    """

    format = "masks"
    has_geometry = True

    def __init__(self, path: Path, masks: Mapping[str, VolumeSource]) -> None:
        self.masks = dict(masks)
        first = next(iter(self.masks.values())).series[0]
        dtype = "uint8" if len(self.masks) < 256 else "uint16"
        files = [file for source in self.masks.values() for file in source.files]
        super().__init__(path, (Series(1, "", first.slices, first.size, "", dtype),), files)

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Return labels in layers, each mask whole."""
        names = dict(enumerate(self.masks, 1))
        if len(names) > MOST_LABELS:
            raise ReadError(f"the folder {self.path.name} has {len(names)} masks, and at most {MOST_LABELS} are read")
        stages = Stages({f"{part} {name}": 1.0 for name in names.values() for part in ("Opening", "Reading")})
        label_map: LabelMap | None = None
        affine: NDArray[np.float64] | None = None
        notes: list[str] = []
        for label, (name, source) in enumerate(self.masks.items(), 1):
            raw = yield from stages.run(
                f"Opening {name}", source.read_raw_steps(replace(request, series=None, whole=False, mask=True))
            )
            reader = raw.values if isinstance(raw.values, SliceReader) else ValuesInMemory(raw.values)
            if label_map is None:
                label_map = LabelMap(reader.shape, names, {}, self.path.name, budget=request.budget)
                affine, first_name, first_shape = raw.affine, name, reader.shape
            elif reader.shape != first_shape or not _same_place(raw.affine, affine, reader.shape):
                raise _other_grid(self.path, first_name, name)
            try:
                rounded = yield from stages.run(f"Reading {name}", painted_steps(label_map, reader, label))
            except NotAMask as error:
                raise ReadError(
                    f"'{name}' in the folder {self.path.name} holds {error}, so it is not a mask; move it out of the "
                    "folder to read the masks, or choose one file"
                ) from error
            notes += [note for note in (*raw.notes, *rounded) if note not in notes]
        assert label_map is not None, "there are masks"
        notes += label_map.overlap_note("masks")
        notes += label_map.empty_note("masks")
        first, *further = label_map.layers()
        return RawValues(first, affine, tuple(notes), ValueKind.LABEL, label_map.names, layers=tuple(further))


def painted_steps(label_map: LabelMap, reader: SliceReader, label: int) -> Steps[tuple[str, ...]]:
    """Read a mask some slices at a time and give its voxels `label`; return what was changed of its values.

    Outside is 0 where it occurs, as -1 may be 255 in 8 bits with a sign; else the lower of two values, as DICOM's
    intercept may have moved both. Slices of one value below 0 wait until the other is known, and are outside without.
    """
    seen: set[float] = set()
    done = waiting = 0
    numbers = WholeNumbers(reader.value_step, "")

    def look(values: NDArray[Any]) -> bool:
        nonlocal done, waiting
        for plane in _whole_if_nearly(values, numbers):
            before = next(iter(seen), 0.0)
            own = two_values(plane)
            seen.update(own)
            if len(seen) > 2 or (len(seen) == 2 and min(seen) > 0):
                raise NotAMask("the values " + limited(f"{value:g}" for value in sorted(seen)))
            outside = 0.0 if 0.0 in seen else min(*seen, 0.0)
            if len(seen) == 1 and outside < 0:
                waiting += 1
            elif waiting:
                if before != outside:
                    for number in range(waiting):
                        label_map.paint(number, np.ones(plane.shape, bool), label)
                waiting = 0
            if own != {outside}:  # compared in the values' own type: 0.0 beside integers would make floats of all
                label_map.paint(done, plane != plane.dtype.type(outside), label)
            done += 1
        return False

    yield from reader.runs_steps(look)
    return numbers.notes


def _whole_if_nearly(values: NDArray[Any], numbers: WholeNumbers) -> NDArray[Any]:
    """Return values of a mask as whole numbers if all are nearly whole; else unchanged."""
    try:
        return numbers.of(values)
    except NotWholeError:
        return values


def _same_place(
    affine: NDArray[np.float64] | None, second: NDArray[np.float64] | None, shape: tuple[int, int, int]
) -> bool:
    """Return whether two volumes (slices, rows, columns) have their corners at the same places."""
    if affine is None or second is None:
        return affine is second
    apart_mm = farthest_corner_mm(affine, second, (shape[2], shape[1], shape[0]))
    return apart_mm <= SAME_GRID * float(spacing_of(second).min())


def _other_grid(folder: Path, first: str, name: str) -> ReadError:
    return ReadError(
        f"the masks '{first}' and '{name}' in the folder {folder.name} lie on different grids; choose one of them, or "
        "resample them to one grid"
    )


def in_files_steps(folder: Path, open_steps: Callable[[Path], Steps[VolumeSource]]) -> Steps[_MaskFolder | None]:
    """Return the masks that lie as files in a folder, one in each; None where they are something else.

    Bytes are taken for masks until they are read; wider numbers are looked at, which is short for anything else.

    Raises
    ------
    ReadError
        If a file or two beside more masks hold something else, as a CT or a map of probabilities.
    """
    files = sorted((file for file in folder.iterdir() if suffix(file) in MASK_SUFFIXES), key=natural_key)
    files = [file for file in files if not file.name.startswith(".") and file.is_file()]
    if len(files) < FEWEST or any(map(segmentation_sibling, files)):
        return None
    masks: dict[str, VolumeSource] = {}
    non_masks: dict[str, str] = {}
    for number, file in enumerate(files):
        yield Step(number / len(files), "Reading headers")
        try:
            source = yield from open_steps(file)
            reason = yield from _no_mask_steps(source)
        except OutputError:
            raise
        except CtmcError:
            return None
        if reason:
            non_masks[file.name] = reason
        else:
            masks[stem(file) if stem(file) not in masks else file.name] = source
        if len(non_masks) > MOST_NON_MASKS:
            return None
    if non_masks and len(masks) > len(non_masks):
        names = " and ".join(f"'{name}' holds {reason}" for name, reason in non_masks.items())
        so, them = ("it is not a mask", "it") if len(non_masks) == 1 else ("they are not masks", "them")
        raise ReadError(
            f"the folder {folder.name} has {len(masks)} masks, and {names}, so {so}; move {them} out of the folder to "
            "read the masks, or choose one file"
        )
    return None if non_masks else checked(folder, masks)


def _no_mask_steps(source: VolumeSource) -> Steps[str]:
    """Return the content of a file that is not a mask, in words; empty if it may be one. Bytes are masks by type."""
    line = source.series[0]
    if line.times > 1:
        return f"{line.times} times"
    if line.dtype in ("uint8", "int8", "bool"):
        return ""
    raw = yield from source.read_raw_steps(ReadRequest(whole=False))
    if raw.label_names:
        return f"{len(raw.label_names)} labels with names"
    reader = raw.values if isinstance(raw.values, SliceReader) else ValuesInMemory(raw.values)
    seen: set[float] = set()
    numbers, reason = WholeNumbers(reader.value_step, ""), ""

    def look(values: NDArray[Any]) -> bool:
        nonlocal reason
        try:
            seen.update(two_values(_whole_if_nearly(values, numbers)))
        except NotAMask as error:
            reason = str(error)
        return bool(reason) or len(seen) > 2

    yield from reader.runs_steps(look)
    if not reason and (len(seen) > 2 or 0.0 not in seen):
        reason = "the values " + limited(f"{value:g}" for value in sorted(seen))
    return reason


def in_folders_steps(source: DicomSource) -> Steps[_MaskFolder | None]:
    """Open masks that are DICOM slices, one folder for each mask; None if the folders hold something else."""
    folders: dict[Path, FolderContent] = {}
    for uid, slices in source.content.series.items():
        for ct_slice in slices:
            content = folders.setdefault(ct_slice.image.path.parent, FolderContent({}, [], [], 0))
            content.series.setdefault(uid, []).append(ct_slice)
    if len(folders) < FEWEST or source.path in folders:
        return None
    for broken in source.content.broken:
        if broken.path.parent in folders:
            folders[broken.path.parent].broken.append(broken)
    masks: dict[str, VolumeSource] = {}
    for number, folder in enumerate(sorted(folders, key=natural_key)):
        yield Step(number / len(folders), "Checking masks")
        mask = DicomSource(folder, folders[folder])
        slices = folders[folder].series[mask.series[0].uid]
        if len(mask.series) > 1 or len(slices) < FEWEST or not (yield from middle_is_mask_steps(slices)):
            return None
        inner = folder.relative_to(source.path).as_posix()
        masks[folder.name if folder.name not in masks else inner] = mask
    return checked(source.path, masks)


def checked(folder: Path, masks: Mapping[str, VolumeSource]) -> _MaskFolder:
    """Return the folder of masks, or a `ReadError` where they are of different sizes."""
    first, *other_masks = masks.items()
    for name, source in other_masks:
        if source.series[0].shape != first[1].series[0].shape:
            raise _other_grid(folder, first[0], name)
    return _MaskFolder(folder, masks)
