# SPDX-License-Identifier: GPL-3.0-or-later
"""Exploded views: move structures apart from their common center, so that one sees between them.

The structure farthest from the center moves by the distance asked for, the others in proportion to their distance. If
all moved by the same distance, neighbors on one side, such as vertebrae, would stay together. In proportion every gap
grows, and any two structures, such as the parts of a cut, separate along the line between their centers. No structure
changes its shape or is turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Doubles
from .described import Described, setting
from .mesh.vectors import cross, dot

AT_CENTER = 1e-5  # Distances from the center below this share of the common box's diagonal are rounding.
FACES_AT_ONCE = 1 << 18

Triangles = tuple[NDArray[Any], NDArray[Any]]
"""Vertices (V, 3) float and faces (F, 3) int of a structure."""


@dataclass(frozen=True)
class ExplodedView(Described):
    """Distance by which structures are moved apart.

    Raises
    ------
    SettingsError
        If it is negative or above 1000 mm.
    """

    explode: float = setting(
        0.0,
        "Move several structures apart from their common center: the farthest by this, the others in proportion",
        label="Explode",
        unit="mm",
        low=0.0,
        high=1000.0,
    )


def shifts_of(meshes: Sequence[Triangles], distance: float) -> Doubles:
    """Return how far each structure is moved in an exploded view, (n, 3).

    Parameters
    ----------
    meshes : sequence of (vertices, faces)
        (V, 3) float and (F, 3) int of each structure, in one space.
    distance : float
        Shift of the structure that is farthest from the common center, in the unit of the vertices. A structure alone
        stays, and so do structures that all have the common center.

    Examples
    --------
    Three squares, whose common box has its middle at x = 10:

    >>> corners, faces = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    >>> shifts_of([(corners + (x, 0, 0), faces) for x in (-10, 0, 30)], 6.0)[:, 0].tolist()
    [-6.0, -3.0, 6.0]
    """
    offsets = offsets_of(meshes)
    longest = reach_of(offsets)
    return offsets * (distance / longest) if longest else offsets


def offsets_of(meshes: Sequence[Triangles]) -> Doubles:
    """Return the centers of structures relative to the middle of the box around all of them, (n, 3).

    A center is the mean of the surface, so that it does not depend on the axes: those of two halves of a ball lie on
    the normal of any cut. Offsets that are rounding are 0, as is that of a structure alone.
    """
    offsets = np.zeros((len(meshes), 3))
    if len(meshes) < 2:
        return offsets
    low, high = (
        np.array([[float(end(vertices[:, axis])) for axis in range(3)] for vertices, _ in meshes])
        for end in (np.min, np.max)
    )
    low, high = low.min(axis=0), high.max(axis=0)
    for at, (vertices, faces) in enumerate(meshes):
        offsets[at] = _center(vertices, faces) - (low + high) / 2
    lengths = np.sqrt(dot(offsets.T, offsets.T))
    side = high - low
    offsets[lengths <= AT_CENTER * np.sqrt(dot(side, side))] = 0.0
    return offsets


def reach_of(offsets: Doubles) -> float:
    """Return the length of the longest of offsets or shifts, (n, 3); 0 if there are none."""
    return float(np.sqrt(dot(offsets.T, offsets.T)).max(initial=0.0))


def _center(vertices: NDArray[Any], faces: NDArray[Any]) -> Doubles:
    """Return the mean of a surface, (3,): the middles of its triangles by their areas."""
    total, middle = 0.0, np.zeros(3)
    for start in range(0, len(faces), FACES_AT_ONCE):
        # A row for each coordinate of each corner, which NumPy works through faster.
        corners = vertices[faces[start : start + FACES_AT_ONCE]].astype(np.float64).transpose(1, 2, 0)  # (3, 3, f)
        first, second, third = np.ascontiguousarray(corners)
        normals = cross(second - first, third - first)
        areas = np.sqrt(dot(normals, normals))
        total += float(areas.sum())
        middle += ((first + second + third) * (areas / 3.0)).sum(axis=1)
    if total > 0.0:
        return middle / total
    return np.array([(float(vertices[:, axis].min()) + float(vertices[:, axis].max())) / 2 for axis in range(3)])
