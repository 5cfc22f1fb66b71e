# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the constants with which all labels that touch enclose the volumes of their samples.

Each label's field already has the constant that keeps its volume where it is alone. Where two fields meet, the wall
lies between the two surfaces, so both labels are a little off. What is added here moves every wall by half the
difference of its labels' constants, and what faces no label by the constant itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...machine.parallel import map_steps
from ...progress import Steps

ROUNDS = 5
GAINS = (0.3, 2.0)
EXACT_ENOUGH = 5e-4  # A volume is exact enough if it is off by less than this share.
SWEEPS = 200
FACES_AT_ONCE = 1 << 16


def measured_pairs_steps(
    positions: NDArray[np.float32],
    faces: NDArray[np.int32],
    sides: NDArray[np.intp],
    sizes_mm: tuple[float, float, float],
    labels: int,
    threads: int = 1,
) -> Steps[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the volume of every label, (labels + 1,) mm3, and the areas between them, (labels + 1,) * 2 mm2.

    Parameters
    ----------
    positions : (V, 3) float32
        In index space; triangles close every label.
    faces, sides : (F, 3), (F, 2)
        Labels counted from 1.
    sizes_mm : (x, y, z)
        Sides of the space between two samples.
    """
    count = labels + 1
    columns = np.ascontiguousarray(positions.T, np.float64)  # (3, V)
    middle = (columns.min(axis=1) + columns.max(axis=1)) / 2 if len(positions) else np.zeros(3)
    along = [(each - center) * size for each, center, size in zip(columns, middle, sizes_mm, strict=True)]

    def measure(start: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        part = slice(start, start + FACES_AT_ONCE)
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (
            [values.take(of) for values in along] for of in faces[part].T.astype(np.intp)
        )
        along_z = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        along_x = (by - ay) * (cz - az) - (cy - ay) * (bz - az)
        along_y = (bz - az) * (cx - ax) - (cz - az) * (bx - ax)
        six = along_x * ax + along_y * ay + along_z * az
        pair = sides[part, 0] * count + sides[part, 1]
        double = np.sqrt(along_x * along_x + along_y * along_y + along_z * along_z)
        sums = [np.bincount(pair, of, count**2).astype(np.float64) for of in (six, double)]
        return sums[0], sums[1]

    six, double = np.zeros(count**2), np.zeros(count**2)
    for more_six, more_double in (yield from map_steps(measure, range(0, len(faces), FACES_AT_ONCE), threads)):
        six += more_six
        double += more_double
    area, between = double.reshape(count, count) / 2, six.reshape(count, count) / 6
    return between.sum(axis=1) - between.sum(axis=0), area + area.T


def next_constants(
    missing_mm3: NDArray[np.float64], areas_mm2: NDArray[np.float64], free: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the changes of the constants that give every label its missing volume, (labels + 1,) mm.

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
            pushed = float(np.cumsum(areas_mm2[label, 1:] * step[1:])[-1]) / 2
            value = (missing_mm3[label] + pushed) / total[label]
            change = max(change, abs(value - step[label]))
            step[label] = value
        if change < 1e-7:
            break
    return step


def next_gain(
    gain: NDArray[np.float64], before_mm3: NDArray[np.float64], missing_mm3: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the factor for the next steps, (labels + 1,), from the missing volumes before and after the last one.

    A field is not everywhere a distance: where it rises more slowly, its surface moves farther than the constant.

    Examples
    --------
    >>> next_gain(np.ones(3), np.array([8.0, 0.0, -2.0]), np.array([-4.0, 3.0, 3.0])).round(3).tolist()
    [0.667, 1.0, 0.4]
    """
    usable = before_mm3 != 0
    answered = 1.0 - missing_mm3 / np.where(usable, before_mm3, 1.0)
    usable &= answered > 0  # else it went the wrong way
    return np.where(usable, np.clip(gain / np.where(usable, answered, 1.0), *GAINS), gain)
