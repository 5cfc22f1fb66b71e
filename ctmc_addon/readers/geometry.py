# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply the requested spacing and mirrored axes to an affine, and complete directions that a file lacks.

Affines map (x, y, z) = (column, row, slice) to RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import ReadError, spacing_text
from ..core.volume import SPACING_LIMITS, is_spacing, spacing_of

ROUNDED = 1e-3  # Two lengths in a file are the same if they differ by at most this share.
AXIAL = np.diag([-1.0, -1.0, 1.0])  # Unknown directions are taken so: columns to the left, rows to the back.


def taken_as_axial(what: str) -> str:
    """Return the note for a format without orientation."""
    return (
        f"{what} has no orientation: taken as axial, columns towards the patient's left, "
        "rows towards the back, slices towards the head; flip x, y or z changes it"
    )


def flipped(affine: NDArray[np.float64], size: Sequence[int], axes: str) -> NDArray[np.float64]:
    """Mirror the affine along index `axes`: the same box in space, its samples in the opposite order."""
    mirrored = affine.copy()
    for axis in ("xyz".index(letter) for letter in axes):
        mirrored[:3, 3] += mirrored[:3, axis] * (size[axis] - 1)
        mirrored[:3, axis] *= -1.0
    return mirrored


def respaced(
    affine: NDArray[np.float64], spacing: tuple[float, float, float], directions: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], str, tuple[str, ...]]:
    """Return the affine with columns of the lengths `spacing`, words about those it had, and what was assumed.

    An axis without length has the direction that the file says apart from it, else one at right angles to the others.
    """
    lengths, scaled = spacing_of(affine), affine.copy()
    has_length = lengths > 0
    notes: tuple[str, ...] = ()
    if directions is None and not has_length.all():
        directions = completed(affine[:3, :3], has_length)
        axes = ", ".join(axis for axis, is_given in zip("xyz", has_length.tolist(), strict=True) if not is_given)
        notes = (f"the file has no direction along {axes}: taken at right angles; flip x, y or z changes it",)
    if directions is not None:
        scaled[:3, :3] = np.where(has_length, affine[:3, :3], directions)
    before = spacing_of(scaled)
    # An axis that has no length still is left alone: Volume refuses it as singular.
    scaled[:3, :3] *= np.divide(spacing, before, out=np.ones(3), where=before > 0)
    return scaled, instead_of(lengths), notes


def instead_of(lengths_mm: Iterable[float]) -> str:
    """Return words about a file's spacing where another one is asked for."""
    return f"instead of the file's own {spacing_text(lengths_mm)}"


def turned_notes(what: str, lengths: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the note on axes that a file turns round by a length below 0; `what` is the name of its field.

    Examples
    --------
    >>> turned_notes("spacings", np.array([1.0, 1.0, -2.0]))
    ('the file has spacings 1 x 1 x -2: an axis below 0 runs backwards; flip x, y or z changes it',)
    """
    if not (lengths < 0).any():
        return ()
    return (f"the file has {what} {lengths_text(lengths)}: an axis below 0 runs backwards; flip x, y or z changes it",)


def require_spacing(affine: NDArray[np.float64], name: str) -> None:
    """Refuse a spacing that no CT has; an affine that is broken in another way is refused by `Volume`.

    Parameters
    ----------
    affine : (4, 4) float64
    name : str
        Of the file or folder.

    Raises
    ------
    ReadError
        With the limits and the way out.
    """
    lengths = spacing_of(affine)
    if np.isfinite(lengths).all() and not is_spacing(lengths):
        raise ReadError(
            f"{name} has a spacing of {spacing_text(lengths)}, and it must be {SPACING_LIMITS}; "
            "give the spacing x, y, z in mm"
        )


def completed(axes: NDArray[np.float64], has_length: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return directions (3, 3), a column for each axis; missing ones are at right angles to the rest.

    They run as those of axial slices, as far as right angles allow.
    """
    directions = np.where(has_length, axes, 0.0)
    directions /= np.sqrt((directions**2).sum(axis=0)) + ~has_length
    missing = [axis for axis in range(3) if not has_length[axis]]
    while len(missing) > 1:  # At most one direction is known: leave out its share of the axial ones.
        along = directions.sum(axis=1)[:, None]
        rest = AXIAL - along * (along * AXIAL).sum(axis=0)
        lengths = np.sqrt((rest**2).sum(axis=0))
        axis = max(missing, key=lambda axis: float(lengths[axis]))
        directions[:, axis] = rest[:, axis] / lengths[axis]
        missing.remove(axis)
    for axis in missing:
        across = np.cross(directions[:, (axis + 1) % 3], directions[:, (axis + 2) % 3])
        directions[:, axis] = -across if (across * AXIAL[:, axis]).sum() < 0 else across
    return directions


def differ(lengths: NDArray[Any], other_lengths: NDArray[Any]) -> bool:
    """Return whether two spacings (3,) differ, by more than headers round them."""
    return bool((np.abs(lengths - other_lengths) > ROUNDED * np.abs(other_lengths)).any())


def lengths_text(lengths: Iterable[float]) -> str:
    """Return three lengths as text, such as '0.5 x 0.5 x 2'."""
    return " x ".join(f"{length:.4g}" for length in lengths)
