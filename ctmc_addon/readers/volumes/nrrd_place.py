# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the position of an NRRD's samples in the patient, from its header.

The named spaces are turned to RAS+ mm. teem.sourceforge.net/nrrd/format.html is the format's description.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from ...core.volume import determinant, spacing_of, to_index, transform_points
from ..geometry import AXIAL, differ, lengths_text, turned_notes
from ..length_units import in_mm, mm_of

# Signs that turn a named space's axes to right, anterior, superior.
SPACES = {
    "right-anterior-superior": (1.0, 1.0, 1.0),
    "left-anterior-superior": (-1.0, 1.0, 1.0),
    "left-posterior-superior": (-1.0, -1.0, 1.0),
    "ras": (1.0, 1.0, 1.0),
    "las": (-1.0, 1.0, 1.0),
    "lps": (-1.0, -1.0, 1.0),
}


def placed(header: Mapping[str, Any], kept: list[int]) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    """Return the affine to RAS+ mm and what was assumed; a file without directions is taken as axial.

    Parameters
    ----------
    header : mapping
        As pynrrd reads it.
    kept : list of int
        The three axes of space.
    """
    if "space directions" in header:
        return _by_directions(header, kept)
    return _by_spacings(header, kept)


def _by_directions(header: Mapping[str, Any], kept: list[int]) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return the affine of an NRRD that has a space, and the assumptions."""
    space = str(header.get("space", "")).strip().lower()
    directions = np.asarray(header["space directions"], np.float64)
    origin = np.asarray(header.get("space origin", (0.0, 0.0, 0.0)), np.float64)
    notes = []
    if directions.shape[1:] == origin.shape == (4,) and not directions[kept, 3].any():  # the fourth is time
        directions, origin = directions[:, :3], origin[:3]
        if not space:
            space = "left-posterior-superior"
            notes.append("the file's space has no name: taken as left-posterior-superior, as ITK writes times")
    if directions.ndim != 2 or directions.shape[1] != 3 or len(directions) <= max(kept) or origin.shape != (3,):
        raise ReadError(
            f"'space directions' {directions.shape} and 'space origin' {origin.shape} of the NRRD do not place "
            "three axes in space; export it again"
        )
    affine = np.eye(4)
    affine[:3, :3] = directions[kept].T
    affine[:3, 3] = origin
    lengths, spacings = spacing_of(affine), _per_axis(header, "spacings", kept)
    if np.isfinite(spacings).all() and differ(spacings, lengths):
        notes.append(
            f"the file has spacings {lengths_text(spacings)} and space directions of the lengths "
            f"{lengths_text(lengths)}: the directions are taken"
        )
    signs = SPACES.get(space.removesuffix("-time"))
    if signs is None:
        signs = (1.0, 1.0, 1.0)
        notes.append(
            f"the file's space '{space or 'none'}' does not name sides of the patient: taken as right-anterior-superior"
        )
    affine[:3] *= np.array(signs)[:, None]
    of_space, of_axes = _units_of_space(header), _units_of_axes(header, kept)
    if of_space:
        lengths_mm, unit_notes = in_mm(of_space)
        affine[:3] *= np.array(lengths_mm)[:, None]
        return affine, (*notes, *unit_notes, *_other_units("space units", of_space, "units", of_axes))
    lengths_mm, unit_notes = in_mm(of_axes or [""] * 3)
    if len(set(lengths_mm)) == 1:
        affine[:3] *= lengths_mm[0]
        return affine, (*notes, *unit_notes)
    notes.append(
        f"the file's units {_quoted(of_axes)} differ and it has no space units: "
        "directions and origin were converted by the unit of each axis"
    )
    return _converted_along(affine, lengths_mm), (*notes, *unit_notes)


def _converted_along(affine: NDArray[np.float64], lengths_mm: list[float]) -> NDArray[np.float64]:
    """Return an affine whose axes of samples are in different units in mm, with the origin as many samples away.

    Where an axis has no length the origin stays as it is.
    """
    directions = affine.copy()
    directions[:3, 3] = 0.0
    converted = directions * [*lengths_mm, 1.0]
    if 0 < abs(determinant(affine)) < math.inf:
        (converted[:3, 3],) = transform_points(converted, to_index(directions, affine[None, :3, 3]))
    return converted


def _other_units(taken: str, words: list[str], other: str, other_words: list[str]) -> tuple[str, ...]:
    """Return the note on units under two names of a field that differ; the first are taken."""
    lengths, other_lengths = (
        {mm_of(word) or word.strip() for word in each if word.strip()} for each in (words, other_words)
    )
    if not other_words or not words or lengths == other_lengths:
        return ()
    return (f"the file has {taken} {_quoted(words)} and {other} {_quoted(other_words)}: the {taken} are taken",)


def _quoted(units: list[str]) -> str:
    """Return units in words: 'um', 'um', 'mm'."""
    return ", ".join(f"'{unit.strip()[:60]}'" for unit in units)


def _by_spacings(header: Mapping[str, Any], kept: list[int]) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    """Return the affine of an NRRD without directions, taken as axial, and the assumptions; None without spacing."""
    low, high = _per_axis(header, "axis mins", kept), _per_axis(header, "axis maxs", kept)
    words = [str(word).lower() for word in _field(header, "centerings")]
    centerings = [words[axis] if axis < len(words) else "" for axis in kept]
    in_cells = np.array([word == "cell" for word in centerings])
    steps = np.array([header["sizes"][axis] for axis in kept], np.float64) - np.where(in_cells, 0.0, 1.0)
    spacings = _per_axis(header, "spacings", kept)
    spacings = np.where(np.isfinite(spacings), spacings, (high - low) / np.maximum(steps, 1.0))
    if not np.isfinite(spacings).all():
        return None, ()
    # A cell begins half a spacing before its sample.
    first, signs = np.where(np.isfinite(low), low + np.where(in_cells, spacings / 2.0, 0.0), 0.0), AXIAL.diagonal()
    origin = np.asarray(header.get("space origin", ()), np.float64)
    notes = [
        "the NRRD has spacings but no orientation: taken as axial, columns towards the patient's left, "
        "rows towards the back, slices towards the head; flip x, y or z changes it"
    ]
    if origin.shape == (3,) and np.isfinite(origin).all():
        space = str(header.get("space", "")).strip().lower()
        first, signs = origin, np.array(SPACES.get(space, signs))
    elif np.isfinite(low).any() and not all(word in ("cell", "node") for word in centerings):
        notes.append("the NRRD has axis mins without centerings: taken as the positions of the first samples")
    of_axes, of_space = _units_of_axes(header, kept), _units_of_space(header)
    notes += [*turned_notes("spacings", spacings), *_other_units("units", of_axes, "space units", of_space)]
    lengths_mm, unit_notes = in_mm(of_axes or of_space or [""] * 3)
    affine = np.eye(4)
    affine[:3, :3] = AXIAL * spacings * lengths_mm
    affine[:3, 3] = signs * first * lengths_mm + 0.0
    return affine, (*notes, *unit_notes)


def _field(header: Mapping[str, Any], name: str) -> list[Any]:
    """Return the entries of a field, which may be written without the space in its name; none where it lacks."""
    return list(header.get(name, header.get(name.replace(" ", ""), ())))


def _per_axis(header: Mapping[str, Any], name: str, kept: list[int]) -> NDArray[np.float64]:
    """Return a field's numbers for the axes of space, (3,); NaN where there are none."""
    numbers = _field(header, name)
    return np.array([numbers[axis] if axis < len(numbers) else np.nan for axis in kept], np.float64)


def _units_of_space(header: Mapping[str, Any]) -> list[str]:
    """Return the unit along each axis of the patient, if any; one unit is for all axes, a fourth is that of time."""
    words = [str(word) for word in _field(header, "space units")]
    own = words[:3] if len(words) > 2 else words[:1] * 3
    return own if any(word.strip() for word in own) else []


def _units_of_axes(header: Mapping[str, Any], kept: list[int]) -> list[str]:
    """Return the unit along each axis of the samples; none where the file has none."""
    words = [str(word) for word in _field(header, "units")]
    own = [words[axis] if axis < len(words) else "" for axis in kept]
    return own if any(word.strip() for word in own) else []
