# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances to closed surfaces by looking at every triangle: slow and obvious."""

import numpy as np


def to_triangle(point, a, b, c):
    """Distance of a point to a triangle, by regions (Ericson, Real-Time Collision Detection, 5.1.5)."""
    best = min(to_edge(point, *edge) for edge in ((a, b), (b, c), (c, a)))
    normal = np.cross(b - a, c - a)
    if np.dot(normal, normal) > 0:
        foot = point - normal * np.dot(point - a, normal) / np.dot(normal, normal)
        if all(np.dot(np.cross(q - p, foot - p), normal) >= 0 for p, q in ((a, b), (b, c), (c, a))):
            best = min(best, np.linalg.norm(point - foot))
    return best


def to_edge(point, a, b):
    along = b - a
    share = np.clip(np.dot(point - a, along) / max(np.dot(along, along), 1e-300), 0, 1)
    return np.linalg.norm(point - a - share * along)


def between_edges(p, q, r, s):
    """Distance of two segments, by ends and by the two lines."""
    best = min(to_edge(p, r, s), to_edge(q, r, s), to_edge(r, p, q), to_edge(s, p, q))
    normal = np.cross(q - p, s - r)
    if np.dot(normal, normal) > 1e-18:
        at, other = np.linalg.lstsq(np.stack([q - p, r - s], axis=1), r - p, rcond=None)[0]
        if 0 <= at <= 1 and 0 <= other <= 1:
            best = min(best, np.linalg.norm(p + at * (q - p) - r - other * (s - r)))
    return best


def between_triangles(first, second):
    """Distance of two triangles that do not cross."""
    best = min(to_triangle(corner, *second) for corner in first)
    best = min(best, *(to_triangle(corner, *first) for corner in second))
    pairs = ((i, j) for i in range(3) for j in range(3))
    return min(best, *(between_edges(first[i], first[i - 2], second[j], second[j - 2]) for i, j in pairs))


def winding_numbers(points, mesh):
    """How often a closed surface runs around each point (van Oosterom and Strackee 1983): 1 inside, 0 outside."""
    corners = mesh.vertices[mesh.faces].astype(float)
    out = []
    for point in points:
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=1)
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        out.append(2 * np.arctan2(volume, below).sum() / (4 * np.pi))
    return np.array(out)
