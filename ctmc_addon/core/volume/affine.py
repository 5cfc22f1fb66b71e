# SPDX-License-Identifier: GPL-3.0-or-later
"""Affines: points, normals and winding between index space and RAS+ millimeters, and the names of the axes.

An affine is a (4, 4) float64 matrix from the index (x, y, z) = (column, row, slice) to RAS+ millimeters.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import VolumeError
from ..measures.units import mm_text

MOST_MM = 1e9
LEAST_SPACING_MM, MOST_SPACING_MM = 1e-6, 1e4
ROUNDED = 1e-6  # Allow for this share of a spacing: the limits are in float32 too.
SPACING_LIMITS = f"from {LEAST_SPACING_MM:g} to {mm_text(MOST_SPACING_MM)}"


def checked_affine(affine: Any) -> NDArray[np.float64]:
    """Return `affine` as a read-only (4, 4) float64 array; raise a `VolumeError` that explains what is wrong."""
    matrix = np.array(affine, dtype=np.float64)
    if matrix.shape != (4, 4):
        raise VolumeError(f"an affine is a (4, 4) matrix, not {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise VolumeError("the affine holds NaN or infinite numbers; export the file again, or give its spacing")
    if np.abs(matrix).max() > MOST_MM:
        raise VolumeError(
            f"the affine reaches {mm_text(np.abs(matrix).max(), 3)}, and no body is larger than {mm_text(MOST_MM)}; "
            "repair the file's geometry"
        )
    if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
        raise VolumeError(f"the last row of an affine is 0 0 0 1, not {matrix[3]}")
    lengths = spacing_of(matrix)
    if (lengths < 1.0 / MOST_MM).any():
        axes = ", ".join(axis for axis, length in zip("xyz", lengths.tolist(), strict=True) if length < 1.0 / MOST_MM)
        raise VolumeError(
            f"the affine is singular: it has no length along {axes}; set the spacing, or repair the file's geometry"
        )
    if abs(determinant(matrix)) < 1e-6 * lengths.prod():
        raise VolumeError("the affine is singular: its axes lie in one plane; repair the file's geometry")
    matrix.flags.writeable = False
    return matrix


def spacing_of(affine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance between neighboring samples along (x, y, z), (3,) millimeters.

    Examples
    --------
    >>> spacing_of(np.diag([-0.5, 0.5, 2.0, 1.0])).tolist()
    [0.5, 0.5, 2.0]
    """
    axes = affine[:3, :3]
    exponents = np.frexp(np.abs(axes).max(axis=0))[1]  # powers of two keep the bits, and the squares from underflow
    return np.ldexp(np.sqrt((np.ldexp(axes, -exponents) ** 2).sum(axis=0)), exponents)


def is_spacing(lengths_mm: Iterable[float]) -> bool:
    """Return whether distances between samples are in the limits of a CT, `SPACING_LIMITS`; NaN is not.

    Examples
    --------
    >>> is_spacing((0.5, 0.5, 2.0)), is_spacing((0.5, 0.5, 3e-150))
    (True, False)
    """
    low, high = LEAST_SPACING_MM * (1 - ROUNDED), MOST_SPACING_MM * (1 + ROUNDED)
    return all(low <= length <= high for length in lengths_mm)


def determinant(affine: NDArray[np.float64]) -> float:
    """Return the signed volume of one voxel, cubic millimeters; below zero where the axes are mirrored.

    Examples
    --------
    >>> determinant(np.diag([-0.5, 0.5, 2.0, 1.0]))
    -0.5
    """
    (a, b, c), (d, e, f), (g, h, i) = affine[:3, :3].tolist()
    return float(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def transform_points(affine: NDArray[np.float64], points: NDArray[Any]) -> NDArray[np.float64]:
    """Move (n, 3) positions by an affine, (n, 3) float64: from index (x, y, z) to RAS+ millimeters.

    Written as sums in a fixed order, so every machine gives the same bits.
    """
    x, y, z = (points[:, axis].astype(np.float64) for axis in range(3))
    out = np.empty((len(points), 3))
    for row in range(3):
        out[:, row] = ((x * affine[row, 0] + y * affine[row, 1]) + z * affine[row, 2]) + affine[row, 3]
    return out


def to_index(affine: NDArray[np.float64], points_ras_mm: NDArray[Any]) -> NDArray[np.float64]:
    """Move (n, 3) positions back by an affine, (n, 3) float64: from RAS+ millimeters to index (x, y, z)."""
    inverse = np.eye(4)
    inverse[:3, :3] = cofactors(affine).T / determinant(affine)
    return transform_points(inverse, points_ras_mm - affine[:3, 3])


def index_to_index(affine: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (4, 4) matrix from the index of a grid to the index of another one.

    Examples
    --------
    >>> index_to_index(np.diag([-1.0, 2.0, 3.0, 1.0]), np.diag([1.0, 1.0, 1.0, 1.0])).diagonal().tolist()
    [-1.0, 2.0, 3.0, 1.0]
    """
    ends = to_index(target, transform_points(affine, np.vstack([np.eye(3), np.zeros(3)])))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = (ends[:3] - ends[3]).T, ends[3]
    return matrix


def farthest_corner_mm(affine: NDArray[np.float64], second: NDArray[np.float64], size: tuple[int, int, int]) -> float:
    """Return by how many mm the corners of two grids of (x, y, z) samples differ at most, along an axis of the patient.

    Examples
    --------
    >>> farthest_corner_mm(np.diag([1.0, 1.0, 1.0, 1.0]), np.diag([1.0, 1.0, 1.5, 1.0]), (9, 9, 4))
    2.0
    """
    corners = np.array([(x, y, z) for x in (0, size[0]) for y in (0, size[1]) for z in (0, size[2])])
    return float(np.abs(transform_points(affine - second, corners)).max())


def product(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
    """Return the product of two small matrices, (m, k) and (k, n), as sums in a fixed order.

    `@` leaves the order to the processor's version of the library that NumPy calls.

    Examples
    --------
    >>> product(np.array([[1.0, 2.0]]), np.array([[3.0, 4.0], [5.0, 6.0]])).tolist()
    [[13.0, 16.0]]
    """
    total = first[:, :1] * second[:1]
    for at in range(1, len(second)):
        total = total + first[:, at, None] * second[at]
    return total


def cofactors(affine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cofactor matrix (3, 3) of an affine's linear part: determinant times inverse transpose."""
    m = affine[:3, :3]
    out = np.empty((3, 3))
    for row in range(3):
        for column in range(3):
            r, s = (row + 1) % 3, (row + 2) % 3
            c, d = (column + 1) % 3, (column + 2) % 3
            out[row, column] = m[r, c] * m[s, d] - m[r, d] * m[s, c]
    return out


def transform_faces(affine: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return (n, 3) faces that still point outwards after their vertices were moved by an affine.

    A mirrored affine (slices listed head first) would turn the surface inside out.
    """
    return faces if determinant(affine) > 0 else np.ascontiguousarray(faces[:, ::-1])


def transform_normals(affine: NDArray[np.float64], normals: NDArray[Any]) -> NDArray[np.float32]:
    """Move (n, 3) outward normals by the inverse transpose of an affine, unit length, float32."""
    matrix = np.eye(4)
    matrix[:3, :3] = cofactors(affine) / determinant(affine)
    moved = transform_points(matrix, normals)
    length = np.sqrt(moved[:, 0] ** 2 + moved[:, 1] ** 2 + moved[:, 2] ** 2)
    length[length == 0] = 1.0
    return (moved / length[:, None]).astype(np.float32)


def with_origin(affine: NDArray[np.float64], index: tuple[int, int, int]) -> NDArray[np.float64]:
    """Return the affine of a grid whose first sample is the sample `index` (x, y, z) of this one."""
    moved = affine.copy()
    moved[:3, 3] = transform_points(affine, np.array([index], np.float64))[0]
    return moved


def axis_codes(affine: NDArray[np.float64]) -> str:
    """Return the letters of the patient's sides that the axes x, y and z run towards.

    Each axis takes the side it runs along most, no side twice, the clearest axis first.

    Examples
    --------
    >>> axis_codes(np.diag([-1.0, -1.0, 2.0, 1.0]))
    'LPS'
    """
    directions = affine[:3, :3] / spacing_of(affine)
    codes = ["?", "?", "?"]
    for side, axis in sorted(np.ndindex(3, 3), key=lambda at: -abs(directions[at])):
        letter = ("LR", "PA", "IS")[side][int(directions[side, axis] > 0)]
        taken = {code for code in codes if code in ("LR", "PA", "IS")[side]}
        if codes[axis] == "?" and not taken:
            codes[axis] = letter
    return "".join(codes)
