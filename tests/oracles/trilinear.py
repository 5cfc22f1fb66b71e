# SPDX-License-Identifier: GPL-3.0-or-later
"""The topology of the trilinear interpolant's surface, by resampling each voxel until nothing can hide.

A voxel is cut along x, y and z into boxes, ever finer where the surface is not yet plain. It is plain in a
box that has no ambiguous face and in which the interpolant only rises, or only falls, along one axis: there it is
a graph over a square without the shadows of the box's inside corners above and outside corners below,
which is one disc. A derivative along x is bilinear in (y, z), so its signs at a box's corners are its signs
throughout the box: nothing rests on a tolerance or a resolution. A voxel that is not plain after
`MOST_LINES` cuts is undecided; none of 10,000 random ones was.

Known limit: exact ties come out as rounding has it. Give a threshold a little lower.
"""

from __future__ import annotations

import numpy as np

MOST_LINES = 150
CORNERS = [(k & 1, k >> 1 & 1, k >> 2) for k in range(8)]
EDGES = [(corner, corner | 1 << axis) for axis in range(3) for corner in range(8) if not corner >> axis & 1]


def united(count, pairs):
    """Label of each of `count` things after uniting pairs (n, 2): its set's lowest number."""
    label = np.arange(count)
    while len(pairs):
        low = np.minimum(label[pairs[:, 0]], label[pairs[:, 1]])
        before = label.copy()
        for side in range(2):
            np.minimum.at(label, label[pairs[:, side]], low)
            np.minimum.at(label, pairs[:, side], low)
        label = label[label]
        if (label == before).all():
            break
    while (label != label[label]).any():
        label = label[label]
    return label


def blend(low, high, axis, at):
    """Linear interpolation along one axis at the places `at`."""
    shape = [1, 1, 1]
    shape[axis] = len(at)
    at = at.reshape(shape)
    return low * (1 - at) + high * at


def resampled(corner_values, lines):
    """The interpolant of (2, 2, 2) values at every node of three sets of lines."""
    for axis in range(3):
        low, high = np.split(corner_values, 2, axis=axis)
        corner_values = blend(low, high, axis, lines[axis])
    return corner_values


def every_corner(nodes, combine):
    """`combine` over the 8 corners of every box between nodes."""
    for axis in range(3):
        if nodes.shape[axis] > 1:
            cut = [slice(None)] * 3
            cut[axis] = slice(None, -1)
            low = nodes[tuple(cut)]
            cut[axis] = slice(1, None)
            nodes = combine(low, nodes[tuple(cut)])
    return nodes


def ambiguous(inside, axis):
    """Faces across an axis whose corners are inside and outside in turn."""
    inside = np.moveaxis(inside, axis, 0)
    a, b, c, d = inside[:, :-1, :-1], inside[:, 1:, :-1], inside[:, 1:, 1:], inside[:, :-1, 1:]
    return np.moveaxis((a == c) & (b == d) & (a != b), 0, axis)


def along(array, axis, low, high):
    cut = [slice(None)] * 3
    cut[axis] = slice(low, high)
    return array[tuple(cut)]


def voxel_topology(difference):
    """Euler number and parts (each the set of its crossed edges) of the surface in one voxel.

    `difference` is (2, 2, 2), indexed x, y, z: the corner values less the threshold. None where undecided.
    """
    lines = [np.array([0.0, 1.0])] * 3
    while True:
        inside = resampled(difference, lines) >= 0
        mixed = every_corner(inside, np.logical_or) & ~every_corner(inside, np.logical_and)
        plain = np.zeros(mixed.shape, bool)
        for axis in range(3):
            slope = np.diff(difference, axis=axis)
            for other in range(3):
                if other != axis:
                    slope = blend(*np.split(slope, 2, axis=other), other, lines[other])
            # A slope that vanishes along a line in the box's border leaves the interpolant constant there, not zero.
            for way in (slope, -slope):
                plain |= every_corner(way >= 0, np.logical_and) & every_corner(way > 0, np.logical_or)
        for axis in range(3):
            odd = ambiguous(inside, axis)
            plain &= ~(along(odd, axis, None, -1) | along(odd, axis, 1, None))
        unclear = np.argwhere(mixed & ~plain)
        if not len(unclear):
            break
        for axis in range(3):
            cut = np.unique(unclear[:, axis])
            line = lines[axis]
            lines[axis] = np.sort(np.concatenate([line, (line[cut] + line[cut + 1]) / 2]))
            if len(lines[axis]) > MOST_LINES:
                return None
    return _euler(inside, mixed), _parts(difference, inside, mixed, lines)


def _euler(inside, mixed):
    """Points on the boxes' edges, less arcs in their faces, plus discs in the boxes."""
    points = sum(int((along(inside, a, 1, None) != along(inside, a, None, -1)).sum()) for a in range(3))
    return points - sum(int(_cut_faces(inside, axis).sum()) for axis in range(3)) + int(mixed.sum())


def _cut_faces(inside, axis):
    some, every = inside, inside
    for other in range(3):
        if other != axis:
            some = along(some, other, 1, None) | along(some, other, None, -1)
            every = along(every, other, 1, None) & along(every, other, None, -1)
    return some & ~every


def _parts(difference, inside, mixed, lines):
    number = np.arange(mixed.size).reshape(mixed.shape)
    pairs = []
    for axis in range(3):
        cut = along(_cut_faces(inside, axis), axis, 1, -1)
        pairs.append(np.stack([along(number, axis, None, -1)[cut], along(number, axis, 1, None)[cut]], axis=1))
    label = united(mixed.size, np.concatenate(pairs)).reshape(mixed.shape)
    parts = {}
    for edge, (low, high) in enumerate(EDGES):
        start, end = difference[CORNERS[low]], difference[CORNERS[high]]
        if (start >= 0) == (end >= 0):
            continue
        axis = edge // 4
        column = [-corner for corner in CORNERS[low]]
        column[axis] = slice(None)
        at = int(np.flatnonzero(np.diff(inside[tuple(column)]))[0])
        box = [-corner for corner in CORNERS[low]]
        box[axis] = at
        parts.setdefault(int(label[tuple(box)]), set()).add(edge)
    return {frozenset(part) for part in parts.values()}


def grid_topology(values, threshold):
    """Euler number and number of parts of the surface in a grid of (x, y, z) values; None where undecided."""
    difference = np.asarray(values, float) - threshold
    inside = difference >= 0
    euler = sum(int((along(inside, a, 1, None) != along(inside, a, None, -1)).sum()) for a in range(3))
    for axis in range(3):
        euler -= int(_cut_faces(inside, axis).sum()) + int(ambiguous(inside, axis).sum())
    pairs, size = [], 3 * difference.size
    number = np.arange(difference.size).reshape(difference.shape)
    used = set()
    for place in np.ndindex(*(side - 1 for side in difference.shape)):
        box = tuple(slice(start, start + 2) for start in place)
        if inside[box].all() or not inside[box].any():
            continue
        found = voxel_topology(difference[box])
        if found is None:
            return None
        euler += found[0]
        corners = [int(number[tuple(p + c for p, c in zip(place, corner, strict=True))]) for corner in CORNERS]
        for part in found[1]:
            edges = [3 * corners[EDGES[edge][0]] + edge // 4 for edge in part]
            used.update(edges)
            pairs += [(edges[0], edge) for edge in edges[1:]]
    label = united(size, np.array(pairs).reshape(-1, 2))
    return euler, len({int(label[edge]) for edge in used})
