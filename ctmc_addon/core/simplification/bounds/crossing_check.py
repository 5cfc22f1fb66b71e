# SPDX-License-Identifier: GPL-3.0-or-later
"""Refuse collapses that would make triangles cross, once some have.

A test of all collapses would take longer than these. So triangles are tested now and then, and what made some cross is
undone (see `uncrossing`). What is then left to go is little: from the first undoing at the end on collapses are tested
before they are done. Those that pass need no test afterwards.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Flags, Floats, Ints
from ...mesh.intersections import self_intersections_steps
from ...progress import Steps
from ..engine.collapses import Collapses


def crosses_steps(
    collapses: Collapses, positions: Floats, faces: Ints, alive: Flags, done: Flags, asked: Flags
) -> Steps[Flags]:
    """Return which collapses make triangles cross, (n,) bool; of two that do so with each other, one.

    Parameters
    ----------
    collapses : Collapses
    positions : (3, V) float32
    faces : (3, F) int32
    alive : (F,) bool
        Faces that are not gone already.
    done : (n,) bool
        Collapses that are done, or would be.
    asked : (n,) bool
        Collapses whose triangles are tested, done or not.
    """
    doing = collapses.select(done)
    becomes = np.arange(positions.shape[1], dtype=np.int32)
    becomes[doing.dropped] = doing.kept
    owner = np.full(faces.shape[1], -1, np.int32)
    owner[collapses.faces] = collapses.owner
    stays = alive.copy()
    stays[doing.faces[doing.vanishing]] = False
    left = np.flatnonzero(stays)
    owner = owner[left]
    selected = (owner >= 0) & np.take(asked, owner)
    corners = np.take(becomes, np.take(faces, left, axis=1))
    crossing = yield from self_intersections_steps(doing.moved(positions).T, corners.T, selected)
    own = owner[crossing].T  # (2, n), -1 of a face that none changes
    own = np.where((own >= 0) & np.take(done, own), own, np.int32(-1))
    own = own[:, (own >= 0).any(axis=0)]
    # Of two collapses the one goes that meets more: a large triangle does not keep all that it would cut from going.
    met = np.bincount(own.ravel() + 1, minlength=len(done) + 1)
    met[0] = -1
    refused = np.zeros(len(done), bool)
    refused[np.where(met[own[0] + 1] >= met[own[1] + 1], own[0], own[1])] = True
    return refused
