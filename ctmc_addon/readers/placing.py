# SPDX-License-Identifier: GPL-3.0-or-later
"""Where samples lie when the files do not say it, or when something else is asked for: spacing, mirrored axes, limits.

Affines map (x, y, z) = (column, row, slice) to RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..core import ReadError
from ..core.volume import SPACING_LIMITS, is_spacing, spacing_of

AXIAL = np.diag([-1.0, -1.0, 1.0])
"""Directions of x, y and z where a format has no orientation."""


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


def respaced(affine: NDArray[np.float64], spacing: tuple[float, float, float]) -> tuple[NDArray[np.float64], str]:
    """Return the affine with columns of the lengths `spacing`, and words about those it had.

    A file whose axes have no length does not say where they run: one is taken at right angles to the others, more
    leave no orientation.
    """
    lengths = spacing_of(affine)
    words = f"in place of the file's own {lengths_text(lengths)} mm"
    scaled = affine.copy()
    missing = np.flatnonzero(lengths == 0).tolist()
    if len(missing) == 1:
        (at,) = missing
        one, other = (affine[:3, axis] / lengths[axis] for axis in ((at + 1) % 3, (at + 2) % 3))
        scaled[:3, at], lengths[at] = np.cross(one, other), 1.0
        words += f"; {'xyz'[at]}, whose direction the file does not say, is taken at right angles to the other axes"
    elif missing:
        scaled[:3, :3], lengths = AXIAL, np.ones(3)
        words += f"; {taken_as_axial('the file')}"
    scaled[:3, :3] *= np.asarray(spacing) / lengths
    return scaled, words


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
            f"{name} has a spacing of {lengths_text(lengths)} mm, and it must be {SPACING_LIMITS}; "
            "give the spacing x, y, z in mm"
        )


def lengths_text(lengths: Iterable[float]) -> str:
    """Three lengths in words: '0.5 x 0.5 x 2'."""
    return " x ".join(f"{length:.4g}" for length in lengths)
