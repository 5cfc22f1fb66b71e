# SPDX-License-Identifier: GPL-3.0-or-later
"""Which collapses of a round would make triangles cross: for surfaces, and for complexes of labels that share walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mesh.intersections import self_intersections_steps
from ..progress import PAUSE, Steps
from .collapses import Collapses

Ints = NDArray[np.int32]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]


def crossing_collapses_steps(collapses: Collapses, positions: Floats, faces: Ints) -> Steps[Flags]:
    """Which collapses would leave a triangle that meets another where it may not, (n,) bool.

    All of them are thought to be done at once. Where two triangles of two collapses would meet, both are named; what
    met before, and no collapse touches, is not looked at. It takes as long as testing the mesh near the collapses.

    Parameters
    ----------
    collapses : Collapses
        Of any triangles: an edge may have more than two, as in a complex.
    positions : (3, V) float32
    faces : (3, F) int32
        Those that are gone have equal corners.
    """
    becomes = np.arange(positions.shape[1], dtype=np.int32)
    becomes[collapses.dropped] = collapses.kept
    owner = np.full(faces.shape[1], -1, np.int32)
    owner[collapses.faces] = collapses.owner
    after = np.take(becomes, faces)
    left = np.flatnonzero((after != after[[1, 2, 0]]).all(axis=0))
    yield PAUSE
    owner = owner[left]
    pairs = yield from self_intersections_steps(collapses.moved(positions).T, after[:, left].T, owner >= 0)
    refused = np.zeros(len(collapses.kept) + 1, bool)
    refused[owner[pairs]] = True  # -1 is the last: in no collapse
    return refused[:-1]
