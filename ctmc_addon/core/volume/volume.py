# SPDX-License-Identifier: GPL-3.0-or-later
"""A CT volume: gray values on a grid, and where that grid lies in the patient.

Values are (slices, rows, columns); the affine maps the index (column, row, slice) = (x, y, z)
to RAS+ millimeters.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError, SettingsError, VolumeError
from ..progress import Steps
from .affine import axis_codes, checked_affine, determinant, spacing_of, with_origin
from .labels.whole_labels import WholeLabels, WholeNumbers
from .slice_reader import SliceReader, ValuesInMemory
from .value_kind import ValueKind

Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""Start and stop along x, y, z."""


def require_gray_type(dtype: np.dtype[Any]) -> None:
    """Raise a `VolumeError` for values of another type than bool, integers, float32 and float64."""
    if dtype.kind not in "buif" or dtype.itemsize > 8 or dtype == np.float16:
        raise VolumeError(f"values of type {dtype} are not gray values; convert them to int16 or float32")


def _require_samples(shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Raise a `VolumeError` for a volume without a voxel, or of values that are not gray values."""
    if min(shape) < 2:
        raise VolumeError(
            f"a surface needs at least 2 samples along every axis, and this volume has {shape} "
            "(slices, rows, columns); read the whole stack"
        )
    require_gray_type(dtype)


class SampleGrid(ABC):
    """A grid of samples in patient space, wherever its values are."""

    affine: NDArray[np.float64]
    """(4, 4) float64, index (x, y, z) = (column, row, slice) to RAS+ millimeters."""

    @property
    @abstractmethod
    def size(self) -> tuple[int, int, int]:
        """Number of samples along (x, y, z)."""

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distance between neighboring samples along (x, y, z), millimeters."""
        x, y, z = spacing_of(self.affine).tolist()
        return (x, y, z)

    @property
    def voxel_mm3(self) -> float:
        """Volume of a voxel, mm3; the sides of one from a tilted gantry are not at right angles.

        Examples
        --------
        >>> Volume(np.zeros((2, 2, 2)), np.diag([0.5, 0.5, 2.0, 1.0])).voxel_mm3
        0.5
        """
        return abs(determinant(self.affine))

    @property
    def orientation(self) -> str:
        """The patient's side that each axis (x, y, z) runs towards, such as 'LPS'."""
        return axis_codes(self.affine)


@dataclass(frozen=True, eq=False)
class Volume(SampleGrid):
    """Gray values or labels on a grid in patient space, in memory or in a file.

    Parameters
    ----------
    reader : (slices, rows, columns) bool, int8 to int64, uint8 to uint64, float32 or float64; or a SliceReader
        Source of the values. An array is never copied and becomes read-only.
    affine : (4, 4) float64
        Index (x, y, z) = (column, row, slice) to RAS+ millimeters; may be oblique, mirrored or sheared.
    notes : tuple of str
        Assumptions of the reader, in plain sentences for the user.
    name : str
        Stem of the file or folder; never taken from a DICOM tag.
    kind : ValueKind or str
        Meaning of the values: "HU", "SUVbw", "Gy", "gray value" or "label".
    label_names : mapping of int to str
        Names of label values, where the file has them.
    label_colors : mapping of int to (red, green, blue) int
        sRGB colors of label values, 0 to 255, where the file has them.
    box : ((x, stop), (y, stop), (z, stop)), optional
        The part of what the reader has that is this volume; by default all of it.
    layers : tuple of SliceReader
        Further labels on the same grid, where labels overlap: each label is in the values or in one of these.

    Raises
    ------
    VolumeError
        If the values are not three-dimensional numbers with two samples along every axis,
        or the affine is not finite, not affine or singular.
    """

    reader: SliceReader
    affine: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    name: str = "volume"
    kind: ValueKind = ValueKind.GRAY
    label_names: Mapping[int, str] = field(default_factory=dict)
    label_colors: Mapping[int, tuple[int, int, int]] = field(default_factory=dict)
    box: Box | None = None
    layers: tuple[SliceReader, ...] = ()

    if TYPE_CHECKING:

        def __init__(
            self,
            reader: SliceReader | NDArray[Any],
            affine: NDArray[Any],
            notes: tuple[str, ...] = (),
            name: str = "volume",
            kind: ValueKind | str = ValueKind.GRAY,
            label_names: Mapping[int, str] = ...,
            label_colors: Mapping[int, tuple[int, int, int]] = ...,
            box: Box | None = None,
            layers: tuple[SliceReader, ...] = (),
        ) -> None: ...

    def __post_init__(self) -> None:
        if not isinstance(self.reader, SliceReader):
            values = np.asarray(self.reader)
            if values.ndim != 3:
                raise VolumeError(
                    f"a volume has three dimensions (slices, rows, columns), not {values.ndim}: {values.shape}"
                )
            require_gray_type(values.dtype)
            object.__setattr__(self, "reader", ValuesInMemory(values))
        _require_samples(self.shape, self.dtype)
        try:
            object.__setattr__(self, "kind", ValueKind(self.kind))
        except ValueError:
            raise VolumeError(f"kind is one of {', '.join(ValueKind)}, not {self.kind!r}") from None
        object.__setattr__(self, "affine", checked_affine(self.affine))
        object.__setattr__(self, "notes", tuple(self.notes))

    @cached_property
    def each_layer(self) -> tuple[Volume, ...]:
        """The volume as one of each layer, of which none has labels that overlap; itself where it is one."""
        if not self.layers:
            return (self,)
        return tuple(replace(self, reader=reader, layers=()) for reader in (self.reader, *self.layers))

    @cached_property
    def as_labels(self) -> Volume:
        """The volume with each value as the whole number it stands for; itself if its values are known to be whole.

        Nothing is read. A value that stands for none is a `LabelError` when it is read.

        Examples
        --------
        >>> Volume(np.full((2, 2, 2), 5.9999995, np.float32), np.eye(4)).as_labels.values[0, 0].tolist()
        [6.0, 6.0]
        """
        readers = (self.reader, *self.layers)
        if all(reader.is_whole for reader in readers):
            return self
        whole = [
            reader if reader.is_whole else WholeLabels(reader, WholeNumbers(reader.value_step, self.name))
            for reader in readers
        ]
        return replace(self, reader=whole[0], layers=tuple(whole[1:]))

    @property
    def size(self) -> tuple[int, int, int]:
        """Number of samples along (x, y, z)."""
        if self.box is None:
            slices, rows, columns = self.reader.shape
            return (columns, rows, slices)
        x, y, z = (stop - start for start, stop in self.box)
        return (x, y, z)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(slices, rows, columns)."""
        x, y, z = self.size
        return (z, y, x)

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values, in the machine's byte order."""
        return self.reader.dtype

    @property
    def nbytes(self) -> int:
        """Bytes that all values take in memory."""
        x, y, z = self.size
        return x * y * z * self.dtype.itemsize

    @property
    def values(self) -> NDArray[Any]:
        """All values, (slices, rows, columns), read-only: a view of what is in memory; those of a file are read."""
        slices, rows, columns = self.shape
        values = self.samples(range(slices), range(rows), range(columns))
        view = values.view()
        view.flags.writeable = False
        return view

    def slab(self, low: int, high: int) -> NDArray[Any]:
        """Return the values of slices `low` to `high`, `high` left out: (high - low, rows, columns).

        Examples
        --------
        >>> values = np.arange(24).reshape(4, 2, 3)
        >>> bool((Volume(values, np.eye(4)).slab(1, 3) == values[1:3]).all())
        True
        """
        return self.samples(range(low, high), range(self.size[1]), range(self.size[0]))

    def samples(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        """Return the values at some slices, rows and columns, (slices, rows, columns)."""
        x, y, z = (0, 0, 0) if self.box is None else (start for start, _ in self.box)
        with self._readable():
            return self.reader.read(_moved(slices, z), _moved(rows, y), _moved(columns, x))

    def in_memory_steps(self, stride: tuple[int, int, int] = (1, 1, 1)) -> Steps[Volume]:
        """Return the volume with its values in memory: all, or one of every few along x, y and z from the first on."""
        for axis, size, side in zip("xyz", self.size, stride, strict=True):
            if side >= size:
                raise SettingsError(
                    f"stride {side} along {axis} leaves fewer than 2 of {size} samples; choose a smaller one"
                )
        x, y, z = (0, 0, 0) if self.box is None else (start for start, _ in self.box)
        columns, rows, slices = self.size
        ranges = (range(z, z + slices, stride[2]), range(y, y + rows, stride[1]), range(x, x + columns, stride[0]))
        read = []
        with self._readable():
            for reader in (self.reader, *self.layers):
                values = yield from reader.values_steps(*ranges)
                read.append(ValuesInMemory(values, reader.value_step, reader.is_whole))
        affine = self.affine.copy()
        affine[:3, :3] *= stride
        return replace(self, reader=read[0], affine=affine, box=None, layers=tuple(read[1:]))

    def cropped(self, low: tuple[int, int, int], high: tuple[int, int, int]) -> Volume:
        """Return the samples `low` to `high` (x, y, z), `high` left out, at their position; nothing is read."""
        own = self.box or ((0, 0), (0, 0), (0, 0))
        x, y, z = ((start + first, start + stop) for (start, _), first, stop in zip(own, low, high, strict=True))
        return replace(self, box=(x, y, z), affine=with_origin(self.affine, low))

    def part(self, box: Box) -> Volume:
        """Return the samples in a box; nothing is read."""
        x, y, z = box
        return self.cropped((x[0], y[0], z[0]), (x[1], y[1], z[1]))

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """Turn the system's error on a file that can no longer be read into a `ReadError`."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            raise ReadError(f"{self.name} can no longer be read ({reason}); load it from where it is now") from error

    def __reduce__(self) -> tuple[Any, ...]:
        words = (self.notes, self.name, self.kind, dict(self.label_names), dict(self.label_colors))
        first, *layers = (
            ValuesInMemory(layer.values, layer.reader.value_step, layer.reader.is_whole) for layer in self.each_layer
        )
        return (Volume, (first, self.affine, *words, None, tuple(layers)))


def _moved(numbers: range, by: int) -> range:
    return range(numbers.start + by, numbers.stop + by, numbers.step)
