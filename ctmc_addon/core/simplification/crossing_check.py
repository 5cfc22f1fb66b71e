# SPDX-License-Identifier: GPL-3.0-or-later
"""Refuse collapses that would make triangles cross, near vertices where some have crossed before.

A test of all collapses would take longer than these. So triangles are tested now and then, what made some cross is
undone (see `uncrossing`), and from then on collapses beside the vertices that it had moved are tested before they are
done. Without that the same collapses come again, until their vertices are locked: of a patient's 61 organs at 98 % that
was a third of all vertices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mesh.intersections import self_intersections_steps
from ..progress import Steps
from .collapses import Collapses

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
Flags = NDArray[np.bool_]


def crosses_steps(collapses: Collapses, positions: Floats, faces: Ints, alive: Flags, asked: Flags) -> Steps[Flags]:
    """Which collapses would make triangles cross, (n,) bool: only of those asked for are the triangles tested.

    Parameters
    ----------
    collapses : Collapses
        Of which all are done, or would be.
    positions : (3, V) float32
    faces : (3, F) int32
    alive : (F,) bool
        Faces that are not gone already.
    asked : (n,) bool
    """
    becomes = np.arange(positions.shape[1], dtype=np.int32)
    becomes[collapses.dropped] = collapses.kept
    owner = np.full(faces.shape[1], -1, np.int32)
    owner[collapses.faces] = collapses.owner
    stays = alive.copy()
    stays[collapses.faces[collapses.gone]] = False
    left = np.flatnonzero(stays)
    owner = owner[left]
    selected = (owner >= 0) & np.take(asked, owner)
    corners = np.take(becomes, np.take(faces, left, axis=1))
    crossing = yield from self_intersections_steps(collapses.moved(positions).T, corners.T, selected)
    refused = np.zeros(len(collapses.edges), bool)
    own = owner[crossing].T  # (2, n), -1 of a face that none changes
    # Of two collapses the one goes that meets more: a large triangle does not keep all that it would cut from going.
    met = np.bincount(own.ravel() + 1, minlength=len(refused) + 1)
    met[0] = -1
    refused[np.where(met[own[0] + 1] >= met[own[1] + 1], own[0], own[1])] = True
    return refused
