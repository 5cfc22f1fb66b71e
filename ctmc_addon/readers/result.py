"""What every format's reader hands to the package's face, and what is decided there for all of them.

Spacing given by the user, mirrored axes and the meaning of the values are the same question in
every format, so they are answered here. Affines map (x, y, z) = (column, row, slice) to RAS+ mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import SettingsError, Steps
from ..core.volume import Volume
from .value_kind import kind_steps


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
        As in `Volume`, or empty where only name and values can tell.
    label_names : mapping of int to str
        Where the file has them.
    what : str
        The format in a word, for notes.
    own_spacing : str
        Words about the file's spacing, where the affine already holds what was asked for.
    """

    values: NDArray[Any]
    affine: NDArray[np.float64] | None
    notes: tuple[str, ...] = ()
    kind: str = ""
    label_names: Mapping[int, str] = field(default_factory=dict)
    what: str = ""
    own_spacing: str = ""


def volume_steps(reading: Reading, name: str, spacing: tuple[float, float, float] | None, flip: str) -> Steps[Volume]:
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
        affine, own = respaced(affine, spacing)
        notes.append(f"spacing {by(spacing)} mm as asked, {reading.own_spacing or own}")
    if flip:
        affine = flipped(affine, reading.values.shape[::-1], flip)
        notes.append(f"mirrored along {', '.join(flip)} as asked, the volume staying in its place")
    kind = reading.kind
    if not kind:
        kind = yield from kind_steps(reading.values, name, bool(reading.label_names), reading.affine is not None)
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
    """The affine with columns of the lengths `spacing`, and words about those it had."""
    lengths = np.sqrt((affine[:3, :3] ** 2).sum(axis=0))
    out = affine.copy()
    # An axis without length is left alone: Volume refuses it as singular.
    out[:3, :3] *= np.divide(spacing, lengths, out=np.ones(3), where=lengths > 0)
    return out, f"in place of the file's own {by(lengths)} mm"


def by(lengths: Iterable[float]) -> str:
    """Three lengths in words: '0.5 x 0.5 x 2'."""
    return " x ".join(f"{length:.4g}" for length in lengths)


def with_notes(reading: Reading, *notes: str) -> Reading:
    """The reading with more said about it, first."""
    return replace(reading, notes=(*notes, *reading.notes))
