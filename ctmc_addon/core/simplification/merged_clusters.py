# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface whose clusters have become one vertex each, and the removal of those that tear, turn or cross it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Flags, Floats, Indices
from ..mesh.intersections import self_intersections_steps
from ..mesh.vectors import cross
from ..progress import PAUSE, Steps
from .engine.collapses import turns_too_far
from .policy import POLICY, Policy

ID_BITS = 21  # Bits of a vertex number: three numbers and a direction fit into 64 bits.


@dataclass(eq=False)
class Merged:
    """Surface whose clusters have become one vertex each, and its state before.

    positions : (3, V) float32
    faces : (3, F) int64
        Before.
    joins : (V,) int64
        The root that each vertex has joined.
    placed : (3, V) float32
        Present positions of the roots.
    multiple : (V,) bool
        Roots that others have joined.
    policy : Policy, optional
    """

    positions: Floats
    faces: Indices
    joins: Indices
    placed: Floats
    multiple: Flags
    policy: Policy = POLICY

    def __post_init__(self) -> None:
        """Find the corners of the triangles as they are now."""
        self.new = np.take(self.joins, self.faces)

    def take_apart(self, clusters: Flags) -> Flags:
        """Take clusters apart, (V,) bool by their roots; return which vertices are back where they were, (V,) bool."""
        self.multiple &= ~clusters
        back = clusters[self.joins]
        apart = np.flatnonzero(back)
        self.joins[apart] = apart
        self.placed[:, apart] = self.positions[:, apart]
        touched = self._touched(self.faces, back)
        for corner, before in zip(self.new, self.faces, strict=True):
            corner[touched] = self.joins[before[touched]]
        return back

    def settle_steps(self, back: Flags | None = None) -> Steps[Flags]:
        """Take apart what tears the surface or turns its triangles; return which vertices came back, (V,) bool.

        `back` are vertices round which to look, by default all; those count among the vertices brought back.
        """
        changed = self.multiple.copy() if back is None else back
        at = self._touched(self.new, changed)
        all_back = np.zeros(len(changed), bool) if back is None else back.copy()
        while True:
            at = at[_whole(np.take(self.new, at, axis=1))]
            corners = np.take(self.new, at, axis=1)
            bad = _torn(corners, self.multiple, changed)
            yield PAUSE
            bad |= self._turned(np.take(self.faces, at, axis=1), corners)
            yield PAUSE
            if not bad.any():
                bad = self.multiple & ~self.used()[0]  # a whole component
                if not bad.any():
                    return all_back
            # Look again at the triangles of clusters that are taken apart.
            changed = self.take_apart(bad)
            at = self._touched(self.faces, changed)
            all_back |= changed
            yield PAUSE

    def uncross_steps(self) -> Steps[None]:
        """Take apart the clusters whose triangles cross other triangles."""
        untested = self.multiple.copy()
        while untested.any():
            at = np.flatnonzero(_whole(self.new))
            left = np.take(self.new, at, axis=1)
            tested = np.take(untested, left[0]) | np.take(untested, left[1]) | np.take(untested, left[2])
            crossing = yield from self_intersections_steps(self.placed.T, left.T, tested)
            bad = np.zeros(len(untested), bool)
            bad[left[:, crossing]] = True
            bad &= self.multiple
            untested = bad
            if bad.any():
                untested = yield from self.settle_steps(self.take_apart(bad))

    def used(self) -> tuple[Flags, Indices]:
        """Return which vertices the triangles use, (V,) bool, and the triangles renumbered to those, (3, f)."""
        left = np.compress(_whole(self.new), self.new, axis=1)
        used = np.zeros(len(self.joins), bool)
        for corner in left:
            used[corner] = True
        return used, np.take(np.cumsum(used) - 1, left)

    def _turned(self, before: Indices, after: Indices) -> Flags:
        """Return which clusters, (V,) bool, have a triangle that turns too far or loses its area."""
        normals = []
        for corners, places in ((before, self.positions), (after, self.placed)):
            a, b, c = (np.take(places, corner, axis=1) for corner in corners)
            normals.append(cross(b - a, c - a))
        turned = turns_too_far(normals[0], normals[1], self.policy.least_turn)
        bad = np.zeros(len(self.multiple), bool)
        bad[after[:, turned]] = True
        return bad & self.multiple

    @staticmethod
    def _touched(faces: Indices, vertices: Flags) -> Indices:
        a, b, c = (np.take(vertices, corner) for corner in faces)
        return np.flatnonzero(a | b | c)


def _whole(faces: Indices) -> Flags:
    """Return which triangles have three different corners, (F,) bool."""
    return (faces[0] != faces[1]) & (faces[1] != faces[2]) & (faces[2] != faces[0])


def _torn(faces: Indices, multiple: Flags, changed: Flags) -> Flags:
    """Return which clusters, (V,) bool, have an open or wrongly directed edge, or two triangles back to back.

    Edges with an end that has `changed` are looked at; the faces must be all that have such a corner.
    """
    count = len(multiple)
    used = np.zeros(count, bool)
    used[faces] = True
    used = np.flatnonzero(used)
    number = np.empty(count, np.uint64)
    number[used] = np.arange(len(used), dtype=np.uint64)
    bits = np.uint64(ID_BITS)
    mask, unit = np.uint64((1 << ID_BITS) - 1), np.uint64(1)
    corners = np.take(number, faces)
    keys = np.empty(corners.shape, np.uint64)
    for row, (start, end, other) in zip(keys, ((0, 1, 2), (1, 2, 0), (2, 0, 1)), strict=True):
        low, high = np.minimum(corners[start], corners[end]), np.maximum(corners[start], corners[end])
        np.left_shift(low, bits, out=row)
        row |= high
        row <<= bits
        row |= corners[other]
        row <<= unit
        row |= corners[start] < corners[end]
    keys = keys.ravel()
    keys.sort(kind="stable")
    edge = keys >> (bits + unit)
    same = edge[1:] == edge[:-1]
    pair = keys[1:] ^ keys[:-1]  # of one edge: the lowest bit is set where the directions differ
    wrong = np.zeros(len(keys) + 1, bool)
    wrong[1:-1] = same & ((pair & unit == 0) | (pair & (mask << unit) == 0))
    wrong[1:-2] |= same[1:] & same[:-1]
    single = np.ones(len(keys), bool)
    single[1:] &= ~same
    single[:-1] &= ~same
    at = np.flatnonzero(wrong[:-1] | wrong[1:] | single)
    shifts = bits + bits + unit, bits + unit, unit
    low, high, third = (used[((keys[at] >> shift) & mask).astype(np.int64)] for shift in shifts)
    at_changed = changed[low] | changed[high]
    bad = np.zeros(count, bool)
    for corner in (low, high, third):
        bad[corner[at_changed]] = True
    return bad & multiple
