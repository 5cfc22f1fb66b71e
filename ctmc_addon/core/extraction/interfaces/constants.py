# SPDX-License-Identifier: GPL-3.0-or-later
"""The constants that give labels that touch the volumes of their samples, all together.

Each label's field already has the constant that keeps its volume where it is alone. Where two fields meet, the wall
lies between the two surfaces, so both labels are a little off. What is added here moves every wall by half the
difference of its labels' constants, and what faces no label by the constant itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ROUNDS = 4
EXACT_ENOUGH = 2e-4  # of the volume
SWEEPS = 200
FACES_AT_ONCE = 1 << 16


def measured_pairs(
    positions: NDArray[np.float32],
    faces: NDArray[np.int32],
    sides: NDArray[np.intp],
    sizes_mm: tuple[float, float, float],
    labels: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the volume of every label, (labels + 1,) mm3, and the areas between them, (labels + 1,) * 2 mm2.

    Parameters
    ----------
    positions : (V, 3) float32
        In index space; triangles close every label.
    sizes_mm : (x, y, z)
        Of the space between two samples.
    """
    volume, area = np.zeros(labels + 1), np.zeros((labels + 1) ** 2)
    if not len(faces):
        return volume, area.reshape(labels + 1, -1)
    scaled = (positions - positions.mean(axis=0, dtype=np.float64)) * np.array(sizes_mm)
    for start in range(0, len(faces), FACES_AT_ONCE):
        part = slice(start, start + FACES_AT_ONCE)
        a, b, c = (scaled.take(faces[part, corner], axis=0).T for corner in range(3))
        u, v = b - a, c - a
        cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        six = cross[0] * a[0] + cross[1] * a[1] + cross[2] * a[2]
        behind, front = sides[part].T
        volume += np.bincount(behind, six, labels + 1) - np.bincount(front, six, labels + 1)
        double = np.sqrt(cross[0] ** 2 + cross[1] ** 2 + cross[2] ** 2)
        area += np.bincount(behind * (labels + 1) + front, double, (labels + 1) ** 2)
    area = area.reshape(labels + 1, -1) / 2
    return volume / 6, area + area.T


def next_constants(
    missing_mm3: NDArray[np.float64], areas_mm2: NDArray[np.float64], free: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return what to add to the constants so that every label gains what it misses, (labels + 1,) mm.

    Parameters
    ----------
    missing_mm3 : (labels + 1,)
    areas_mm2 : (labels + 1, labels + 1)
        Between each two; the first is no label.
    free : (labels + 1,) bool
        Labels that may get a constant.
    """
    total = areas_mm2[:, 0] + areas_mm2[:, 1:].sum(axis=1) / 2
    step = np.zeros(len(missing_mm3))
    movable = np.flatnonzero(free & (total > 0))
    for _ in range(SWEEPS):  # Gauss-Seidel: the sums are diagonally dominant, and the same on every machine
        change = 0.0
        for label in movable.tolist():
            pushed = sum((areas_mm2[label, 1:] * step[1:]).tolist()) / 2
            value = (missing_mm3[label] + pushed) / total[label]
            change = max(change, abs(value - step[label]))
            step[label] = value
        if change < 1e-7:
            break
    return step
