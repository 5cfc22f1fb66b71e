"""What every format's reader hands to the package's face, and what is decided there for all of them.

Spacing given by the user, mirrored axes and the meaning of the values are the same question in
every format, so they are answered here. Affines map (x, y, z) = (column, row, slice) to RAS+ mm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import memory
from ..core.errors import SettingsError
from ..core.volume import KINDS, Volume

LABEL_NAMES = ("segmentation", "label", "mask", "seg")


@dataclass(frozen=True)
class Series:
    """One series in a DICOM folder, or the one volume of another file; no patient data.

    Parameters
    ----------
    number : int
        1-based, in the natural order of the files.
    uid : str
        SeriesInstanceUID, empty where there is none.
    slices : int
        Images or frames at different positions, scouts included.
    size : (columns, rows) int
        Of most of its slices.
    modality : str
        Such as 'CT'; empty where the format has none.
    """

    number: int
    uid: str
    slices: int
    size: tuple[int, int]
    modality: str = ""

    @property
    def text(self) -> str:
        """For notes: 'series 2: 30 slices of 512 x 512, CT'."""
        end = f", {self.modality}" if self.modality else ""
        plural = "slice" if self.slices == 1 else "slices"
        return f"series {self.number}: {self.slices} {plural} of {self.size[0]} x {self.size[1]}{end}"


@dataclass(frozen=True, eq=False)
class Reading:
    """Values as a format's reader found them.

    Parameters
    ----------
    values : (slices, rows, columns)
        As `Volume` takes them.
    affine : (4, 4) float64 or None
        To RAS+ mm; None where the format has neither orientation nor spacing.
    notes : tuple of str
        What was assumed.
    kind : str
        One of `KINDS`, or empty where only name and values can tell.
    label_names : mapping of int to str
        Where the file has them.
    what : str
        The format in a word, for notes.
    """

    values: NDArray[Any]
    affine: NDArray[np.float64] | None
    notes: tuple[str, ...] = ()
    kind: str = ""
    label_names: Mapping[int, str] = field(default_factory=dict)
    what: str = ""


def volume_of(reading: Reading, name: str, spacing: tuple[float, float, float] | None, flip: str) -> Volume:
    """The volume, with the user's spacing and mirrored axes applied and said."""
    notes = list(reading.notes)
    affine = reading.affine
    if affine is None:
        affine = np.diag([*(value * sign for value, sign in zip(spacing or (1.0,) * 3, (-1, -1, 1), strict=True)), 1.0])
        notes.append(
            f"{reading.what} has no orientation: taken as axial, columns towards the patient's left, "
            "rows towards the back, slices towards the head; flip x, y or z changes it"
        )
        if spacing is None:
            notes.append(f"{reading.what} has no spacing: 1 mm is assumed along x, y and z; give the spacing in mm")
    elif spacing is not None:
        affine, note = respaced(affine, spacing)
        notes.append(note)
    if flip:
        affine = flipped(affine, reading.values.shape[::-1], flip)
        notes.append(f"mirrored along {', '.join(flip)} as asked, the volume staying in its place")
    kind = reading.kind or kind_of(reading.values, name, bool(reading.label_names), reading.affine is not None)
    return Volume(reading.values, affine, tuple(notes), name, kind, reading.label_names)


def checked_spacing(spacing: float | Sequence[float] | None) -> tuple[float, float, float] | None:
    """`spacing` as (x, y, z) mm, or a `SettingsError`; one number stands for all three.

    Examples
    --------
    >>> checked_spacing(0.5)
    (0.5, 0.5, 0.5)
    """
    if spacing is None:
        return None
    try:
        many = (spacing,) * 3 if isinstance(spacing, (int, float)) else tuple(spacing)
        numbers = tuple(float(value) for value in many)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"spacing is three numbers x, y, z in mm, not {spacing!r}") from error
    if len(numbers) != 3:
        raise SettingsError(f"spacing is three numbers x, y, z in mm, not {len(numbers)}: {spacing}")
    for axis, value in zip("xyz", numbers, strict=True):
        if not (math.isfinite(value) and value > 0):
            raise SettingsError(f"spacing along {axis} must be above 0 mm, not {value:g}; measure it or leave it out")
    return (numbers[0], numbers[1], numbers[2])


def checked_flip(flip: str | None) -> str:
    """The axes to mirror, each once and in the order x, y, z, or a `SettingsError`.

    Examples
    --------
    >>> checked_flip("ZX")
    'xz'
    """
    letters = (flip or "").lower().replace(",", "").replace(" ", "")
    if set(letters) - set("xyz") or len(set(letters)) != len(letters):
        raise SettingsError(f"flip takes the axes x, y and z, each at most once, such as 'xz', not {flip!r}")
    return "".join(sorted(letters))


def flipped(affine: NDArray[np.float64], size: Sequence[int], axes: str) -> NDArray[np.float64]:
    """Mirror the affine along index `axes`: the same box in space, its samples in the opposite order."""
    out = affine.copy()
    for axis in ("xyz".index(letter) for letter in axes):
        out[:3, 3] += out[:3, axis] * (size[axis] - 1)
        out[:3, axis] *= -1.0
    return out


def respaced(affine: NDArray[np.float64], spacing: tuple[float, float, float]) -> tuple[NDArray[np.float64], str]:
    """Give the affine's columns the lengths `spacing`, and the note that says so."""
    lengths = np.sqrt((affine[:3, :3] ** 2).sum(axis=0))
    out = affine.copy()
    # An axis without length is left alone: Volume refuses it as singular.
    out[:3, :3] *= np.divide(spacing, lengths, out=np.ones(3), where=lengths > 0)
    old, new = (" x ".join(f"{value:.4g}" for value in three) for three in (lengths, spacing))
    return out, f"spacing {new} mm as asked, in place of the file's own {old} mm"


def kind_of(values: NDArray[Any], name: str, has_label_names: bool, may_be_hu: bool) -> str:
    """What the values mean, where the file does not say it.

    Labels: the file names them, its name begins like a label file's, or all values are whole numbers
    from 0 to 255 with at most 128 different ones (TotalSegmentator has 117 labels; grey values of
    8 bits nearly use up their range). HU: the format holds physical values and some lie below -100,
    which only air, lung and fat have. Everything else is a grey value.
    """
    integral = values.dtype.kind in "bui"
    if has_label_names or (name.lower().startswith(LABEL_NAMES) and (integral or _all_whole(values))):
        return KINDS[2]
    if not may_be_hu:
        return KINDS[1]
    low = min(float(np.fmin.reduce(plane, axis=None)) for plane in values)
    high = max(float(np.fmax.reduce(plane, axis=None)) for plane in values)
    if integral and low >= 0 and high <= 255:
        counts = np.zeros(256, np.int64)
        for plane in values:
            counts += np.bincount(plane.ravel().astype(np.uint8), minlength=256)
        return KINDS[2] if (counts > 0).sum() <= 128 else KINDS[1]
    return KINDS[0] if low < -100 else KINDS[1]


def _all_whole(values: NDArray[Any]) -> bool:
    return all(bool((plane == np.floor(plane)).all()) for plane in values)


def native(values: NDArray[Any]) -> NDArray[Any]:
    """The same values in the machine's byte order, swapped in place; later stages run faster."""
    if values.dtype.isnative:
        return values
    return values.byteswap(inplace=True).view(values.dtype.newbyteorder("="))


def scaled(values: NDArray[Any], slope: float, intercept: float) -> NDArray[Any]:
    """`values * slope + intercept`, plane by plane: int16 or int32 where it is exact, else float32.

    As nibabel does it, in float64, and then rounded to float32.
    """
    if slope == 1.0 and intercept == 0.0:
        return values
    whole = values.dtype.kind in "bui" and slope.is_integer() and intercept.is_integer()
    dtype: Any = np.float32
    if whole:
        ends = [int(end) * int(slope) + int(intercept) for end in (values.min(), values.max())]
        dtype = smallest_integer(min(ends), max(ends)) or np.float32
    if values.dtype.itemsize == np.dtype(dtype).itemsize and values.flags.writeable:
        out = values.view(dtype)  # plane by plane in place
    else:
        require_memory(values.shape, dtype, "scaling this volume")
        out = np.empty(values.shape, dtype)
    for plane, target in zip(values, out, strict=True):
        target[...] = plane.astype(np.float64) * slope + intercept
    return out


def smallest_integer(low: int, high: int) -> type[np.signedinteger[Any]] | None:
    """int16 or int32, whichever first holds `low` to `high`; None where neither does."""
    for dtype in (np.int16, np.int32):
        limits = np.iinfo(dtype)
        if limits.min <= low and high <= limits.max:
            return dtype
    return None


def require_memory(shape: Sequence[int], dtype: Any, what: str) -> None:
    """Say before anything is read that a volume (slices, rows, columns) would not fit in memory."""
    size = math.prod(int(side) for side in shape) * np.dtype(dtype).itemsize
    sides = " x ".join(str(int(side)) for side in reversed(shape))
    memory.require(
        size, f"{what} ({sides}, {np.dtype(dtype)})", "read fewer or smaller slices, or close other programs"
    )


def with_notes(reading: Reading, *notes: str) -> Reading:
    """The reading with more said about it, first."""
    return replace(reading, notes=(*notes, *reading.notes))
