# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be asked of a few triangles with any hashable vertices: slow and obvious."""

from collections import Counter

import numpy as np

from .trilinear import united


def sides(triangles):
    """Every triangle's sides, each from its first to its second end."""
    return [(t[i - 1], t[i]) for t in triangles for i in range(3)]


def topology(triangles):
    """Euler number and number of parts."""
    used, corner = np.unique(np.array(triangles).reshape(-1, 3), return_inverse=True)
    corner = corner.reshape(-1, 3)
    label = united(len(used), np.concatenate([corner[:, :2], corner[:, 1:]]))
    edges = {frozenset(side) for side in sides(triangles)}
    return len(used) - len(edges) + len(triangles), len(set(label.tolist()))


def is_closed_manifold(triangles):
    """Every side has its opposite once, and the triangles at a vertex are one fan."""
    count = Counter(sides(triangles))
    if set(count.values()) - {1} or any((b, a) not in count for a, b in count):
        return False
    following = {}
    for triangle in triangles:
        for i in range(3):
            following.setdefault(triangle[i], {})[triangle[i - 2]] = triangle[i - 1]
    for around in following.values():
        start = step = next(iter(around))
        turns = 0
        while turns == 0 or step != start:
            step, turns = around[step], turns + 1
        if turns != len(around):
            return False
    return True
