# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that meet where they may not, in fractions, straight from the definition: slow and obvious.

What two triangles have in common is a polytope in the shares that their corners have in a point. Its extreme points
have shares of a few corners alone, which are enough to give one solution: all such choices are tried.
"""

from fractions import Fraction
from itertools import combinations


def crossing_pairs(vertices, faces):
    """Sorted pairs of triangles of a mesh; twice the same for one without area, which is compared with no other."""
    points = [tuple(Fraction(float(value)) for value in vertex) for vertex in vertices]
    faces = [tuple(int(corner) for corner in face) for face in faces]
    flat = [_has_no_area([points[corner] for corner in face]) for face in faces]
    pairs = [(number, number) for number, is_flat in enumerate(flat) if is_flat]
    for first, second in combinations([number for number, is_flat in enumerate(flat) if not is_flat], 2):
        common = set(faces[first]) & set(faces[second])
        allowed = [points[corner] for corner in common]
        met = _common_points([points[c] for c in faces[first]], [points[c] for c in faces[second]])
        if len(common) == 3 or not all(_is_between(point, allowed) for point in met):
            pairs.append((first, second))
    return sorted(pairs)


def _has_no_area(triangle):
    a, b, c = triangle
    u, v = [y - x for x, y in zip(a, b, strict=True)], [y - x for x, y in zip(a, c, strict=True)]
    return all(u[i - 2] * v[i - 1] == u[i - 1] * v[i - 2] for i in range(3))


def _is_between(point, ends):
    """Whether a point is one of the ends, or on the line between two."""
    if point in ends or len(ends) < 2:
        return point in ends
    a, b = ends
    inside = all(min(x, y) <= z <= max(x, y) for x, y, z in zip(a, b, point, strict=True))
    return inside and _has_no_area([a, b, point])


def _common_points(first, second):
    """The extreme points of what two triangles have in common."""
    found = set()
    for ours in (chosen for size in (1, 2, 3) for chosen in combinations(first, size)):
        for theirs in (chosen for size in (1, 2, 3) for chosen in combinations(second, size)):
            rows = [[p[axis] for p in ours] + [-p[axis] for p in theirs] + [0] for axis in range(3)]
            rows.append([1] * len(ours) + [0] * len(theirs) + [1])
            rows.append([0] * len(ours) + [1] * len(theirs) + [1])
            shares = _only_solution(rows)
            if shares is not None and min(shares) >= 0:
                found.add(tuple(sum(s * p[i] for s, p in zip(shares, ours, strict=False)) for i in range(3)))
    return found


def _only_solution(rows):
    """The solution of linear equations, their constants last; None where there is none or more than one."""
    rows = [[Fraction(value) for value in row] for row in rows]
    unknowns = len(rows[0]) - 1
    for column in range(unknowns):
        pivot = next((n for n in range(column, len(rows)) if rows[n][column] != 0), None)
        if pivot is None:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        rows[column] = [value / rows[column][column] for value in rows[column]]
        for number, row in enumerate(rows):
            if number != column and row[column] != 0:
                factor = row[column]
                rows[number] = [x - factor * y for x, y in zip(row, rows[column], strict=True)]
    return None if any(row[-1] != 0 for row in rows[unknowns:]) else [row[-1] for row in rows[:unknowns]]
