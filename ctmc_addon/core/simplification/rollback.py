# SPDX-License-Identifier: GPL-3.0-or-later
"""Revert some of the collapses that made a surface, and those that depend on them.

The history is a list of rounds. To revert collapses, it is replayed without them. What is around a vertex is then no
longer as it was, so a later collapse whose ends met that vertex's triangles is excluded too; all others meet the
triangles that they met before, for which they were checked.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mesh.intersections import self_intersections_steps
from ..progress import PAUSE, Steps
from .error_check import ErrorCheck

Ints = NDArray[np.int32]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]


class History:
    """Rounds of collapses; vertices keep the numbers of the surface at first.

    Parameters
    ----------
    positions, normals : (3, V) float32
        Normals may be None.
    faces : (3, F) int32
    locked : (V,) bool
    """

    def __init__(self, positions: Floats, normals: Floats | None, faces: Ints, locked: Flags) -> None:
        self.first = positions, normals, faces
        self.locked = locked
        self.rounds: list[tuple[Ints, Ints, Floats, Flags]] = []  # kept, dropped, target, excluded
        self.positions, self.normals, self.faces = (
            positions,
            normals,
            faces,
        )  # after the last `replay_steps`
        self.changed = np.zeros(len(locked), bool)  # vertices whose triangles are not as they were with every collapse
        self.last = np.full(len(locked), -1)  # number of the last collapse that each vertex was kept in
        self.becomes = np.arange(len(locked), dtype=np.int32)  # vertex that each has been collapsed into

    def add(self, kept: Ints, dropped: Ints, target: Floats) -> None:
        """Record a round of collapses, none of which share a triangle."""
        self.rounds.append((kept, dropped, target, np.zeros(len(kept), bool)))

    def exclude(self, collapses: NDArray[np.int64]) -> None:
        """Exclude these collapses, by their numbers, from the next `replay_steps`."""
        ends = np.cumsum([0] + [len(kept) for kept, *_ in self.rounds])
        for number in np.unique(collapses).tolist():
            at = int(np.searchsorted(ends, number, side="right")) - 1
            self.rounds[at][3][number - ends[at]] = True

    def replay_steps(self) -> Steps[None]:
        """Repeat all collapses except the excluded ones and those that depend on them, which become excluded."""
        positions, normals, faces = self.first
        self.positions, self.normals = positions.copy(), None if normals is None else normals.copy()
        self.changed[:], self.last[:] = False, -1
        self.becomes = np.arange(len(self.locked), dtype=np.int32)
        number = 0
        for kept, dropped, target, excluded in self.rounds:
            yield PAUSE
            excluded |= self.changed[kept] | self.changed[dropped]
            if self.changed.any():
                excluded |= self._folding(faces, kept, dropped)
            touched = np.zeros(len(self.locked), bool)
            touched[kept[excluded]] = touched[dropped[excluded]] = True
            if excluded.any():
                self.changed[faces[:, np.take(touched, faces).any(axis=0)]] = True
            done = np.flatnonzero(~excluded)
            self.positions[:, kept[done]] = target[:, done]
            if self.normals is not None:
                self.normals[:, kept[done]] += self.normals[:, dropped[done]]
            self.last[kept[done]] = number + done
            number += len(kept)
            new = np.arange(len(self.locked), dtype=np.int32)
            new[dropped[done]] = kept[done]
            self.becomes = new[self.becomes]
            before, faces = faces, np.take(new, faces)
            gone = [(faces[i] == faces[i - 1]) & (before[i] != before[i - 1]) for i in range(3)]
            faces = faces[:, ~(gone[0] | gone[1] | gone[2])]
        self.faces = faces

    def _folding(self, faces: Ints, kept: Ints, dropped: Ints) -> Flags:
        """Which collapses would leave a vertex with two triangles: more triangles around it had gone before."""
        collapse = np.full(len(self.locked), -1)
        collapse[kept] = collapse[dropped] = np.arange(len(kept))
        of = collapse[faces]
        a, b, c = faces
        folding = np.zeros(len(kept), bool)
        count = np.bincount(faces.ravel(), minlength=len(self.locked))
        for start, end, third in ((0, 1, c), (1, 2, a), (2, 0, b)):
            gone = np.flatnonzero((of[start] >= 0) & (of[start] == of[end]))
            few = gone[(count[third[gone]] <= 3) & ~self.locked[third[gone]]]
            folding[of[start][few]] = True
        return folding


def roll_back_steps(history: History, check: ErrorCheck) -> Steps[int]:
    """Revert the last collapse wherever the bound is exceeded or triangles cross, until neither is so anywhere.

    Returns how many pairs of triangles cross that no collapse has touched, as in the original.

    After the first time only what has changed is checked, of the original only what is near that: so all of the
    original is checked once more in the end. Crossings are looked for where the bound holds.
    """
    corners = check.original_faces
    every_face = every_original = True
    yield from history.replay_steps()
    yield from check.compare_with_steps(history.positions, history.faces)
    while True:
        touched = history.changed[history.faces].any(axis=0)
        faces = yield from check.faces_exceeding_steps(np.flatnonzero(touched | every_face))
        near = (touched[check.nearest] | history.changed[history.becomes])[corners].any(axis=0)
        original = yield from check.original_exceeding_steps(np.flatnonzero(near | every_original))
        last = np.concatenate([_last(history, faces), _last_near(history, check, original)])
        crossing = np.zeros((0, 2), np.int64)
        if every_original and not (last >= 0).any():
            crossing = yield from self_intersections_steps(history.positions.T, history.faces.T)
            last = _last(history, crossing.ravel())
        last = last[last >= 0]  # a triangle that no collapse has touched is away by the rounding of the check alone
        if len(last):
            history.exclude(last)
            yield from history.replay_steps()
            yield from check.compare_with_steps(history.positions, history.faces)
            every_face = every_original = False
        elif every_original:
            return len(crossing)
        else:
            every_original = True


def _last(history: History, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """The last collapse that each of these faces was in."""
    return history.last[history.faces[:, faces]].max(axis=0)


def _last_near(history: History, check: ErrorCheck, original: NDArray[np.int64]) -> NDArray[np.int64]:
    """The last collapse of what these faces of the original became, or of the faces nearest to their corners."""
    corners = check.original_faces[:, original]
    near = history.faces[:, check.nearest[corners]].reshape(9, -1)
    return history.last[np.concatenate([history.becomes[corners], near])].max(axis=0)
