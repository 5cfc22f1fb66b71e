# SPDX-License-Identifier: GPL-3.0-or-later
"""Define what every format returns: a source whose headers were read, and the values read from it.

Spacing given by the user, mirrored axes (geometry.py) and the meaning of the values are the same question in every
format, so they are answered here. Affines map (x, y, z) = (column, row, slice) to RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core import (
    PAUSE,
    Budget,
    MemoryLimitError,
    ReadError,
    SettingsError,
    Stages,
    Steps,
    VolumeError,
    descriptions,
    finish,
    one_line,
    spacing_text,
)
from ..core.files.input_files import add_inputs
from ..core.volume import SliceReader, ValueKind, ValuesInMemory, Volume, anatomy_of, box_of
from .file_formats import stem
from .geometry import AXIAL, flipped, instead_of, require_spacing, respaced, taken_as_axial
from .labels.names.tables import table_for
from .options import ReadingOptions, options_of
from .series import Series
from .value_kind import kind_steps, require_volume_memory

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class RawValues:
    """Values as they are stored in the file.

    Parameters
    ----------
    values : (slices, rows, columns) array, or SliceReader
        As `Volume` takes them; a reader that fetches them, or those that were read, the machine's byte order.
    affine : (4, 4) float64 or None
        To RAS+ mm; None where the format has neither orientation nor spacing.
    notes : tuple of str
        What was assumed.
    kind : ValueKind or None
        None where only name and values can tell; labels that are stored as floats are looked at whatever it says.
    label_names : mapping of int to str
        Where the file has them.
    label_colors : mapping of int to (red, green, blue) int
        sRGB, 0 to 255, where the file has them.
    has_palette : bool
        Whether a program chose these colors by the labels' numbers, so that anatomy's colors are better.
    own_spacing : str
        Words about the file's spacing, where the affine already holds what was asked for.
    spacing : (x, y, z) float or None
        Millimeters, of a file that has spacing and no orientation.
    directions : (3, 3) float64 or None
        A column for each axis, where the file says them apart from their lengths, one of which may be 0.
    layers : tuple of (slices, rows, columns) array
        Further labels on the same grid, where labels overlap.
    """

    values: NDArray[Any] | SliceReader
    affine: NDArray[np.float64] | None
    notes: tuple[str, ...] = ()
    kind: ValueKind | None = None
    label_names: Mapping[int, str] = field(default_factory=dict)
    label_colors: Mapping[int, tuple[int, int, int]] = field(default_factory=dict)
    has_palette: bool = False
    own_spacing: str = ""
    spacing: tuple[float, float, float] | None = None
    directions: NDArray[np.float64] | None = None
    layers: tuple[NDArray[Any], ...] = ()


@dataclass(frozen=True)
class ReadRequest(ReadingOptions):
    """A request to a format's reader: the reading options, and the budget for the work.

    Parameters
    ----------
    time : int
        Which of the series' volumes, from 1 to its number of times.
    level : int
        Which of the resolutions, 0 the full one.
    whole : bool
        Whether all values are needed at once.
    mask : bool
        Whether the caller looks for two values itself, so that the reader need not.
    budget : Budget
        The threads that decode, and the memory that the values may take.
    """

    time: int = 1
    level: int = 0
    whole: bool = True
    mask: bool = False
    budget: Budget = Budget(threads=1)  # noqa: RUF009  (frozen)


class VolumeSource:
    """The volume at a path, described by its headers; its values are not read yet. `open_volume` returns it.

    Parameters
    ----------
    path : Path
        What was opened.
    series : tuple of Series
        The series of a DICOM folder or file, or the one volume of any other path.
    files : tuple of Path
        All files that belong to it.
    name : str, optional
        Of the volume; by default the path's, without its suffix.

    Attributes
    ----------
    format : str
        As in the registry, or 'DICOM SEG', 'DICOM RTSTRUCT' or 'masks'.
    has_geometry : bool
        Whether the format says spacing and orientation.
    has_series : bool
        Whether there may be several series, one of which is read.
    levels : tuple of (columns, rows, slices)
        The sizes in which it is stored, the full resolution first; empty where there is one alone.
    label_groups : tuple of str
        Label volumes that lie in it, as paths from it.
    """

    format: str
    has_geometry: bool
    has_series = False
    levels: tuple[tuple[int, int, int], ...] = ()
    label_groups: tuple[str, ...] = ()

    def __init__(self, path: Path, series: tuple[Series, ...], files: Sequence[Path], name: str = "") -> None:
        self.path = path
        self.series = series
        self._files = tuple(files)
        self.name = name or stem(path)
        add_inputs(self._files or (path,))

    @property
    def files(self) -> tuple[Path, ...]:
        """Return all files that belong to it."""
        return self._files

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values; a format whose values stay in the file until they are wanted has `raw_values` instead."""
        yield PAUSE
        return self.raw_values(request)

    def raw_values(self, request: ReadRequest) -> RawValues:
        """Return the values as `read_raw_steps`."""
        raise NotImplementedError

    def selected_series(self, series: str | int | None) -> Series | None:
        """Return the series that `read_steps` would read; None where there is none, or not this one."""
        del series
        return self.series[0]

    def images_read(self, options: ReadingOptions) -> list[Path]:
        """Return the DICOM images that `read_steps` reads; none for other formats."""
        del options
        return []

    def read_steps(
        self,
        options: ReadingOptions | None = None,
        *,
        budget: Budget | None = None,
        region: Sequence[float] | None = None,
        region_unit: str = "voxel",
        stride: Sequence[int] = (1, 1, 1),
        **fields: Any,
    ) -> Steps[Volume]:
        """Read the volume; parameters, result and errors are those of `read_volume`."""
        budget, sides = checked_budget(budget), checked_stride(stride)
        whole = region is None and sides == (1, 1, 1)
        stages = Stages({"Checking values": 1, "Reading values": 0.1 if whole else 9})
        opened = self._opened_steps(options_of(options, fields), budget, whole)
        slabs = yield from stages.run("Checking values", opened)
        x, y, z = box_of(slabs, None if region is None else tuple(region), region_unit)
        slabs = slabs.part((x, y, z))
        if not whole:
            shape = [-(-size // side) for size, side in zip(slabs.size, sides, strict=True)]
            require_volume_memory(shape[::-1], slabs.dtype.itemsize, self.path.name, budget)
        return (yield from stages.run("Reading values", self._named_errors_steps(slabs.in_memory_steps(sides))))

    def slabs_steps(
        self, options: ReadingOptions | None = None, *, budget: Budget | None = None, **fields: Any
    ) -> Steps[Volume]:
        """Return the volume to be read slab by slab: values and all else are those of `read_steps`, bit for bit.

        What a value means, and the type of scaled values, can hang on all values: where headers do not settle it, they
        are looked at here, and none is kept.
        """
        return (yield from self._opened_steps(options_of(options, fields), checked_budget(budget), whole=False))

    def _named_errors_steps(self, steps: Steps[Result]) -> Steps[Result]:
        """Run the same steps; turn the error of a file that cannot be opened into a `ReadError`."""
        try:
            return (yield from steps)
        except OSError as error:
            raise unreadable(self.path, error) from error
        except MemoryError as error:
            raise out_of_memory(self.path) from error

    def _opened_steps(self, options: ReadingOptions, budget: Budget, whole: bool) -> Steps[Volume]:
        """Return the volume, with its values in memory if all are requested at once."""
        if options.series and not self.has_series:
            raise ReadError(f"{self.path.name} has no series to choose from; leave out the series '{options.series}'")
        level, notes = self.selected_level(options.level)
        time, time_notes = self.selected_time(options.series, options.time)
        given = {name: getattr(options, name) for name in descriptions(ReadingOptions)} | {"time": time, "level": level}
        request = ReadRequest(**given, whole=whole, budget=budget)
        return (yield from self._named_errors_steps(self._slabs_steps(request, [*notes, *time_notes])))

    def selected_time(self, series: str | int | None, time: int | None) -> tuple[int, list[str]]:
        """Return the time to read, from 1 on, and a note about it if none was requested."""
        line = self.selected_series(series)
        if line is None:  # an error of the series, not of the time
            return 1, []
        times = line.times
        if time is not None and not 1 <= time <= times:
            holds = f"holds {times} times" if times > 1 else "holds a single time"
            raise ReadError(f"there is no time {time}, because {self.path.name} {holds}; choose from 1 to {times}")
        if time is not None or times == 1:
            return time or 1, []
        if line.default_time == 1:
            return 1, [f"{times} time points found, showing the first"]
        return line.default_time, [f"{times} time points found, showing number {line.default_time}"]

    def selected_level(self, level: int | None) -> tuple[int, list[str]]:
        """Return the resolution to read, 0 for the full one, and a note with all resolutions."""
        last = max(0, len(self.levels) - 1)
        if level is not None and not 0 <= level <= last:
            remedy = f"choose from 0 to {last}" if last else "it has one resolution, so leave the level out"
            raise ReadError(f"{self.path.name} has no level {level}; {remedy}")
        sizes = [f"{number} ({' x '.join(map(str, size))})" for number, size in enumerate(self.levels)]
        note = f"level {level or 0} was read of the levels of resolution {', '.join(sizes)}"
        return level or 0, [note] if last else []

    def read(self, options: ReadingOptions | None = None, **fields: Any) -> Volume:
        """Do what `read_steps` does, without steps."""
        return finish(self.read_steps(options, **fields))

    def _slabs_steps(self, request: ReadRequest, earlier_notes: Sequence[str]) -> Steps[Volume]:
        """Return the volume with the requested spacing and mirrored axes, and notes about them."""
        stages = Stages({"Reading values": 9, "Checking values": 1})
        raw = yield from stages.run("Reading values", self.read_raw_steps(request))
        reader = raw.values if isinstance(raw.values, SliceReader) else ValuesInMemory(raw.values)
        if request.whole:
            if reader.own_bytes:
                require_volume_memory(reader.shape, reader.dtype.itemsize, self.path.name, request.budget)
            values = yield from stages.run("Reading values", reader.values_steps(*reader.everything))
            reader = ValuesInMemory(values, reader.value_step)
        spacing = request.spacing
        notes = [*earlier_notes, *raw.notes]
        affine = raw.affine
        if affine is None:
            lengths = spacing or raw.spacing or (1.0, 1.0, 1.0)
            affine = np.eye(4)
            affine[:3, :3] = AXIAL * lengths
            what = "a NumPy file" if self.format == "NumPy" else self.format
            notes.append(taken_as_axial(what))
            if spacing is not None and raw.spacing is not None:
                notes.append(f"spacing {spacing_text(spacing)} as asked, {instead_of(raw.spacing)}")
            if spacing is None and raw.spacing is None:
                notes.append(f"{what} has no spacing: 1 mm is assumed along x, y and z; give the spacing in mm")
        elif spacing is not None:
            affine, own_spacing, spacing_notes = respaced(affine, spacing, raw.directions)
            notes += [f"spacing {spacing_text(spacing)} as asked, {raw.own_spacing or own_spacing}", *spacing_notes]
        require_spacing(affine, self.path.name)
        if request.flip:
            affine = flipped(affine, reader.shape[::-1], request.flip)
            notes.append(f"mirrored along {', '.join(request.flip)} as asked, at the same position")
        kind = raw.kind
        if kind is None or (kind == ValueKind.LABEL and not reader.is_whole):
            is_label = kind == ValueKind.LABEL or bool(raw.label_names)
            looking = kind_steps(reader, self.name, is_label, raw.affine is not None)
            kind, reader, value_notes = yield from stages.run("Checking values", looking)
            notes += value_notes
        names, colors = raw.label_names, raw.label_colors
        if kind == ValueKind.LABEL and not names:
            names, colors, table_notes = table_for(self.path, self.name)
            notes += table_notes
        names = {value: one_line(name) for value, name in names.items()}
        if request.anatomy_colors or (raw.has_palette and not request.file_colors):
            kept = {value: color for value, color in colors.items() if anatomy_of(names.get(value, "")) is None}
            if len(kept) < len(colors) and not request.anatomy_colors:
                notes.append(
                    "colors follow the anatomical names, because the file's colors repeat; file_colors keeps them"
                )
            colors = kept
        lines = tuple(one_line(note) for note in notes)
        layers = tuple(ValuesInMemory(layer) for layer in raw.layers)
        name = request.name or one_line(self.name)
        try:
            volume = Volume(reader, affine, lines, name, kind, names, colors, layers=layers)
        except VolumeError as error:
            raise VolumeError(f"{self.path.name}: {error}") from error
        if request.remove_table:
            from ..core.segmentation import without_table_steps

            return (yield from without_table_steps(volume))
        return volume


def unreadable(path: Path, error: OSError) -> ReadError:
    """Return the error for a file that the system does not open."""
    name = Path(error.filename).name if isinstance(error.filename, str) else path.name
    return ReadError(f"{name} cannot be read ({error.strerror or error}); check the file and its permissions")


def out_of_memory(path: Path) -> MemoryLimitError:
    """Return the error for a file whose unpacking takes more memory than is left."""
    return MemoryLimitError(f"{path.name} needs more memory than is available; check the file, or close other programs")


def checked_budget(budget: Budget | None) -> Budget:
    """Return `budget`, by default what the machine has, or raise a `SettingsError` where it has no thread."""
    budget = budget or Budget()
    return replace(budget, threads=budget.thread_count)


def checked_stride(stride: Sequence[int]) -> tuple[int, int, int]:
    """Return a stride as (x, y, z) samples.

    Parameters
    ----------
    stride : sequence of int

    Raises
    ------
    SettingsError
        If it is not three whole numbers from 1 on.
    """
    sides = tuple(stride)
    if len(sides) != 3 or not all(isinstance(side, int | np.integer) and side >= 1 for side in sides):
        raise SettingsError(f"stride takes 3 whole numbers x, y and z from 1 on, not {stride}")
    return (int(sides[0]), int(sides[1]), int(sides[2]))
