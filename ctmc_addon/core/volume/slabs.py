# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume whose values are fetched some slices at a time: a file's, or those of a volume in memory."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError, SettingsError
from ..progress import Step, Steps
from .affine import checked_affine, with_origin
from .region import Box, box_slices
from .volume import Placed, Volume, require_samples

STEP_BYTES = 1 << 22  # unpacked in 0.02 s


class SliceReader(ABC):
    """Fetches values of a file; rising slices are the fastest, as a packed file cannot go back.

    Not for two threads at once.
    """

    shape: tuple[int, int, int]
    """(slices, rows, columns)."""
    dtype: np.dtype[Any]
    """Of the values, in the machine's byte order."""

    @abstractmethod
    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Write the values into `out`, C order and of the reader's type; the ranges rise and lie within the shape."""

    @property
    def at_once(self) -> int:
        """Slices between two steps."""
        return max(1, STEP_BYTES // max(1, self.shape[1] * self.shape[2] * self.dtype.itemsize))

    @property
    def own_bytes(self) -> int:
        """What all values take in memory beside what is there already."""
        slices, rows, columns = self.shape
        return slices * rows * columns * self.dtype.itemsize

    @property
    def everything(self) -> tuple[range, range, range]:
        """All slices, rows and columns."""
        slices, rows, columns = self.shape
        return range(slices), range(rows), range(columns)

    def read(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        """Return values (slices, rows, columns) in C order."""
        out = np.empty((len(slices), len(rows), len(columns)), self.dtype)
        self.fill(out, slices, rows, columns)
        return out

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """`read` as steps."""
        out = np.empty((len(slices), len(rows), len(columns)), self.dtype)
        for start in range(0, len(slices), self.at_once):
            yield Step(start / len(slices), "Reading slices")
            part = slice(start, start + self.at_once)
            self.fill(out[part], slices[part], rows, columns)
        return out

    def runs_steps(self, visit: Callable[[NDArray[Any]], bool]) -> Steps[None]:
        """Hand all values to `visit`, some slices at a time, until it returns True."""
        slices, rows, columns = self.everything
        for start in range(0, len(slices), self.at_once):
            yield Step(start / len(slices), "Looking at the values")
            if visit(self.read(slices[start : start + self.at_once], rows, columns)):
                return


class ValuesInMemory(SliceReader):
    """Takes slices from an array (slices, rows, columns)."""

    def __init__(self, values: NDArray[Any]) -> None:
        self.values = values
        self.shape = (values.shape[0], values.shape[1], values.shape[2])
        self.dtype = values.dtype.newbyteorder("=")

    @property
    def own_bytes(self) -> int:
        """None."""
        return 0

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Copy the values."""
        out[...] = self._part(slices, rows, columns)

    def read(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        """A view where the array allows it, else a copy."""
        return np.ascontiguousarray(self._part(slices, rows, columns), self.dtype)

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """The array itself where all of it is asked for, in its own order; else a copy."""
        if (slices, rows, columns) == self.everything and self.values.dtype.isnative:
            return self.values
        return (yield from super().values_steps(slices, rows, columns))

    def _part(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        return self.values[as_slice(slices), as_slice(rows), as_slice(columns)]


LONGEST = 1 << 62  # samples along an axis, whatever a header says


def as_slice(numbers: range) -> slice:
    """The slice that takes the numbers of a rising range."""
    return slice(numbers.start, numbers.stop, numbers.step)


def fitting_stride(shape: Sequence[int], voxel_bytes: int, limit_bytes: int) -> tuple[int, int, int] | None:
    """Return the smallest stride (x, y, z), the same along all axes that are long enough, whose samples fit.

    Parameters
    ----------
    shape : (slices, rows, columns)

    Examples
    --------
    >>> fitting_stride((1000, 2000, 2000), 1, 2**29)
    (2, 2, 2)
    >>> fitting_stride((2, 9, 9), 2, 15) is None
    True
    """

    def steps(side: int) -> list[int]:
        return [max(1, min(side, size - 1)) for size in shape]

    def fits(side: int) -> bool:
        samples = math.prod(-(-size // step) for size, step in zip(shape, steps(side), strict=True))
        return samples * voxel_bytes <= limit_bytes

    sides = range(1, min(max(shape), LONGEST))  # a larger one never has more samples
    at = bisect_left(sides, True, key=fits)
    if at == len(sides):
        return None
    z, y, x = steps(sides[at])
    return x, y, z


@dataclass(frozen=True, eq=False)
class SlabVolume(Placed):
    """A volume as `Volume` is one, its values fetched when they are asked for.

    Not for two threads at once. Values are those of the full volume, bit for bit and in its type.

    Parameters
    ----------
    reader : SliceReader
    box : ((x, stop), (y, stop), (z, stop))
        The part of what the reader has that is this volume.
    affine, notes, name, kind, label_names, label_colors
        As in `Volume`.
    """

    reader: SliceReader
    box: Box
    affine: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    name: str = "volume"
    kind: str = "grey value"
    label_names: Mapping[int, str] = field(default_factory=dict)
    label_colors: Mapping[int, tuple[int, int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_samples(self.shape, self.dtype)
        object.__setattr__(self, "affine", checked_affine(self.affine))
        object.__setattr__(self, "notes", tuple(self.notes))

    @classmethod
    def of(cls, volume: Volume) -> SlabVolume:
        """A volume in memory."""
        x, y, z = volume.size
        about = (volume.affine, volume.notes, volume.name, volume.kind, volume.label_names, volume.label_colors)
        return cls(ValuesInMemory(volume.values), ((0, x), (0, y), (0, z)), *about)

    @property
    def size(self) -> tuple[int, int, int]:
        """Number of samples along (x, y, z)."""
        x, y, z = (stop - start for start, stop in self.box)
        return (x, y, z)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(slices, rows, columns)."""
        x, y, z = self.size
        return (z, y, x)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the values."""
        return self.reader.dtype

    @property
    def nbytes(self) -> int:
        """What all values would take in memory."""
        x, y, z = self.size
        return x * y * z * self.dtype.itemsize

    def slab(self, low: int, high: int) -> NDArray[Any]:
        """Return the values of slices `low` to `high`, `high` left out: (high - low, rows, columns) in C order.

        Examples
        --------
        >>> values = np.arange(24).reshape(4, 2, 3)
        >>> slabs = SlabVolume.of(Volume(values, np.eye(4)))
        >>> bool((slabs.slab(1, 3) == values[1:3]).all())
        True
        """
        return self.samples(range(low, high), range(self.size[1]), range(self.size[0]))

    def samples(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        """Return the values at some slices, rows and columns, (slices, rows, columns) in C order."""
        x, y, z = (start for start, _ in self.box)
        with self._readable():
            return self.reader.read(_moved(slices, z), _moved(rows, y), _moved(columns, x))

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """What the system says of a file that is gone by now, as a `ReadError`."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            raise ReadError(f"{self.name} cannot be read any more ({reason}); load it from where it is now") from error

    def volume_steps(self, stride: tuple[int, int, int] = (1, 1, 1)) -> Steps[Volume]:
        """Return the values in memory: all, or every so many along x, y and z from the first on."""
        for axis, size, side in zip("xyz", self.size, stride, strict=True):
            if side >= size:
                raise SettingsError(
                    f"stride {side} along {axis} leaves less than 2 of {size} samples; choose a smaller one"
                )
        (x, columns), (y, rows), (z, slices) = self.box
        wanted = range(z, slices, stride[2]), range(y, rows, stride[1]), range(x, columns, stride[0])
        with self._readable():
            values = yield from self.reader.values_steps(*wanted)
        affine = self.affine.copy()
        affine[:3, :3] *= stride
        return Volume(values, affine, self.notes, self.name, self.kind, self.label_names, self.label_colors)

    def cropped(self, low: tuple[int, int, int], high: tuple[int, int, int]) -> SlabVolume:
        """Return the samples `low` to `high` (x, y, z), `high` left out, at their position; nothing is read."""
        x, y, z = ((start + first, start + stop) for (start, _), first, stop in zip(self.box, low, high, strict=True))
        return replace(self, box=(x, y, z), affine=with_origin(self.affine, low))

    def part(self, box: Box) -> SlabVolume:
        """Return the samples in a box; nothing is read."""
        x, y, z = box
        return self.cropped((x[0], y[0], z[0]), (x[1], y[1], z[1]))


def _moved(numbers: range, by: int) -> range:
    return range(numbers.start + by, numbers.stop + by, numbers.step)


def values_in(volume: Volume | SlabVolume, box: Box) -> NDArray[Any] | SlabVolume:
    """The values in a box of a volume: a view, or what fetches them."""
    return volume.values[box_slices(box)] if isinstance(volume, Volume) else volume.part(box)
