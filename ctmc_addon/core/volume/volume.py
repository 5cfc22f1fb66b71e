# SPDX-License-Identifier: GPL-3.0-or-later
"""A CT volume: gray values on a grid, and where that grid lies in the patient.

Values are (slices, rows, columns); the affine maps the index (column, row, slice) = (x, y, z)
to RAS+ millimeters.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import VolumeError
from .affine import axis_codes, checked_affine, spacing_of, with_origin

KINDS = ("HU", "grey value", "label")


def require_gray_type(dtype: np.dtype[Any]) -> None:
    """Raise a `VolumeError` for values of another type than bool, integers, float32 and float64."""
    if dtype.kind not in "buif" or dtype.itemsize > 8 or dtype == np.float16:
        raise VolumeError(f"values of type {dtype} are not gray values; convert them to int16 or float32")


def require_samples(shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Raise a `VolumeError` for a volume without a voxel, or of values that are not gray values."""
    if min(shape) < 2:
        raise VolumeError(
            f"a surface needs at least 2 samples along every axis, and this volume has {shape} "
            "(slices, rows, columns); read the whole stack"
        )
    require_gray_type(dtype)


class Placed(ABC):
    """A grid of samples in patient space: what a volume is, wherever its values are."""

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
    def orientation(self) -> str:
        """The patient's side that each axis (x, y, z) runs towards, such as 'LPS'."""
        return axis_codes(self.affine)


@dataclass(frozen=True, eq=False)
class Volume(Placed):
    """Gray values or labels on a grid in patient space.

    Parameters
    ----------
    values : (slices, rows, columns) bool, int8 to int64, uint8 to uint64, float32 or float64
        Never copied; the attribute is a read-only view.
    affine : (4, 4) float64
        Index (x, y, z) = (column, row, slice) to RAS+ millimeters; may be oblique, mirrored or sheared.
    notes : tuple of str
        What a reader had to assume, in plain sentences for the user.
    name : str
        Stem of the file or folder; never taken from a DICOM tag.
    kind : {"HU", "grey value", "label"}
        What the values mean.
    label_names : mapping of int to str
        Names of label values, where the file has them.
    label_colors : mapping of int to (red, green, blue) int
        sRGB colors of label values, 0 to 255, where the file has them.

    Raises
    ------
    VolumeError
        If the values are not three-dimensional numbers with two samples along every axis,
        or the affine is not finite, not affine or singular.
    """

    values: NDArray[Any]
    affine: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    name: str = "volume"
    kind: str = "grey value"
    label_names: Mapping[int, str] = field(default_factory=dict)
    label_colors: Mapping[int, tuple[int, int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        if values.ndim != 3:
            raise VolumeError(
                f"a volume has three dimensions (slices, rows, columns), not {values.ndim}: {values.shape}"
            )
        require_samples(values.shape, values.dtype)
        if self.kind not in KINDS:
            raise VolumeError(f"kind is one of {', '.join(KINDS)}, not {self.kind!r}")
        view = values.view()
        view.flags.writeable = False
        object.__setattr__(self, "values", view)
        object.__setattr__(self, "affine", checked_affine(self.affine))
        object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def size(self) -> tuple[int, int, int]:
        """Number of samples along (x, y, z)."""
        slices, rows, columns = self.values.shape
        return (columns, rows, slices)

    def cropped(self, low: tuple[int, int, int], high: tuple[int, int, int]) -> Volume:
        """Return the samples `low` to `high` (x, y, z), `high` left out, at their position; a view, not a copy."""
        window = tuple(slice(start, stop) for start, stop in zip(low[::-1], high[::-1], strict=True))
        affine = with_origin(self.affine, low)
        return replace(self, values=self.values[window], affine=affine)

    def __reduce__(self) -> tuple[Any, ...]:
        words = (self.notes, self.name, self.kind, dict(self.label_names), dict(self.label_colors))
        return (Volume, (self.values, self.affine, *words))
