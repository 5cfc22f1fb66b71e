# SPDX-License-Identifier: GPL-3.0-or-later
"""Marching Cubes with three loops: slow and obvious, the oracle for the fast one."""

import numpy as np

from ctmc_addon.core.extraction.case_table import EDGES, case_triangles


def sample_positions(size, stride, close_border):
    positions = [*range(0, size - 1, stride), size - 1]
    return [-1, *positions, size] if close_border else positions


def reference_triangles(values, threshold, stride=(1, 1, 1), alpha=1.0, close_border=False):
    """Triangles (n, 3, 3) in float64, voxel by voxel."""
    size = values.shape[::-1]
    axes = [sample_positions(size[axis], stride[axis], close_border) for axis in range(3)]

    def value(place):
        if any(not 0 <= place[axis] < size[axis] for axis in range(3)):
            return None  # beyond the border: outside
        return float(values[place[2], place[1], place[0]])

    def crossing(low, high):
        a, b = value(low), value(high)
        t = 0.5 if a is None or b is None else (threshold - a) / (b - a)
        t = 0.5 + alpha * (min(max(t, 2.0**-10), 1 - 2.0**-10) - 0.5)
        return np.array(low) + t * (np.array(high) - np.array(low))

    triangles = []
    for k in range(len(axes[2]) - 1):
        for j in range(len(axes[1]) - 1):
            for i in range(len(axes[0]) - 1):
                corners = [(axes[0][i + (c & 1)], axes[1][j + (c >> 1 & 1)], axes[2][k + (c >> 2)]) for c in range(8)]
                gray = [value(corner) for corner in corners]
                case = sum(1 << c for c in range(8) if gray[c] is not None and gray[c] >= threshold)
                for triangle in case_triangles(case):
                    triangles.append([crossing(corners[EDGES[e][0]], corners[EDGES[e][1]]) for e in triangle])
    return np.array(triangles).reshape(-1, 3, 3)


def canonical(triangles):
    """Triangles in an order of their own, each beginning with its lowest corner, its winding kept."""
    turned = [
        min(tuple(map(tuple, np.roll(triangle, -turn, axis=0).tolist())) for turn in range(3))
        for triangle in np.round(np.asarray(triangles, float) + 0.000137, 3)  # no coordinate lies on a rounding edge
    ]
    return np.array(sorted(turned))


def by_edge(vertices):
    """Vertices (n, 3) in the order of the edges they lie on: two coordinates are whole, and one lies between."""
    vertices = np.asarray(vertices, float)
    axis = np.abs(vertices - vertices.round()).argmax(axis=1)
    low = vertices.round()
    low[np.arange(len(low)), axis] = np.floor(vertices[np.arange(len(low)), axis])
    return vertices[np.lexsort((axis, *low.T))]
