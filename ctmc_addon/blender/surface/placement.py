# SPDX-License-Identifier: GPL-3.0-or-later
"""Place a surface in the scene: from RAS+ millimeters to Blender's units and back.

1 mm is `scale` units, and RAS axes are Blender's axes (Z up = head). The object stands at the surface's
center, and its vertices are kept relative to it, so float32 holds them to far below a micrometre.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import TriangleMesh
from ...core.volume import determinant, product, to_index, transform_faces, transform_normals, transform_points

SCALE = 0.01
ROUNDING = 4 * float(np.finfo(np.float32).eps)
FIT_SAMPLES = 10_000  # Vertices tested for a transform that was applied to a mesh.
FEW = 0.1  # Share of vertices that may stay in place by chance: on the axis of a rotation, in the plane of a mirror.
FLAT = 1e-15  # Volume of the unit cube moved by a matrix, over its largest number cubed, that is rounding.
Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Placement:
    """Transform from millimeters to an object's local space.

    Parameters
    ----------
    origin : (x, y, z) float
        The object's location when it was made, Blender units, exactly as float32 stores it.
    scale : float
        Blender units of 1 mm.
    applied : three rows of three floats, or None
        Rotation and scale that Blender's Apply has written into the vertices; None where there is neither.
    """

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = SCALE
    applied: Rows | None = None

    def to_local(self, points_ras_mm: NDArray[Any]) -> NDArray[np.float32]:
        """Return local positions (n, 3) float32 of (n, 3) RAS+ millimeters."""
        out = points_ras_mm.astype(np.float64)
        out *= self.scale
        out -= self.origin
        if self.applied is not None:
            out = transform_points(affine_of(self.applied), out)
        return out.astype(np.float32)

    def to_mm(self, local: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return RAS+ millimeters (n, 3) float32 of local positions."""
        out = local.astype(np.float64)
        if self.applied is not None:
            out = to_index(affine_of(self.applied), out)
        out += self.origin
        out /= self.scale
        return out.astype(np.float32)

    def transform_mm(self, matrix_world: Any) -> NDArray[np.float64]:
        """Return the transform of the object since it was placed, as a (4, 4) matrix of RAS+ millimeters."""
        matrix = matrix_of(matrix_world)
        if self.applied is not None:
            matrix = product(matrix, affine_of(self.applied))
        own = product(matrix[:3, :3], np.array(self.origin)[:, None])[:, 0]
        # An object that was only moved, or not at all, gets a matrix without rounding errors.
        matrix[:3, 3] = (matrix[:3, 3] - own) / self.scale
        return matrix


def placed_at_center(points_ras_mm: NDArray[Any], scale: float = SCALE) -> Placement:
    """Return the placement whose origin is the middle of the box around points.

    Parameters
    ----------
    points_ras_mm : (n, 3) float
    scale : float
        Blender units a millimeter.
    """
    # A column at a time is ten times as fast as both axes at once.
    low, high = (np.array([end(points_ras_mm[:, axis]) for axis in range(3)]) for end in (np.min, np.max))
    middle = (low.astype(np.float64) + high) * (0.5 * scale)
    x, y, z = (float(value) for value in middle.astype(np.float32))
    return Placement((x, y, z), scale)


def present_placement(
    placement: Placement, kept: NDArray[np.float32], local: NDArray[np.float32], location: tuple[float, float, float]
) -> Placement:
    """Return the placement of the vertices now, which changes when a transform is applied to them.

    Blender's Apply and Set Origin move every vertex in local space but not the kept millimeters. If hardly any vertex
    is where `placement` puts it, the translation or affine transform to the present positions is fitted.

    Parameters
    ----------
    placement : Placement
        The placement when the object was made.
    kept, local : (V, 3) float32
        RAS+ millimeters and local positions of the same vertices.
    location : (x, y, z) float
        Location of the object: if it is unmoved after Apply or Set Origin, this is exactly the new origin.

    Returns
    -------
    Placement
        `placement` itself if no other one explains half of the vertices: then they were moved by hand.
    """
    step = max(1, len(kept) // FIT_SAMPLES)
    kept, local = kept[::step], local[::step]
    if not len(kept) or in_place(placement, kept, local).mean() > FEW:
        return placement
    moved = kept.astype(np.float64) * placement.scale - local
    x, y, z = (float(value) for value in np.median(moved, axis=0))
    for origin in (location, (x, y, z)):
        candidate = replace(placement, origin=origin, applied=None)
        if in_place(candidate, kept, local).mean() >= 0.5:
            return candidate
    fitted = fitted_placement(placement, kept, local)
    return placement if fitted is None or in_place(fitted, kept, local).mean() < 0.5 else fitted


def in_place(placement: Placement, kept: NDArray[np.float32], local: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return which vertices, (V,), are where the placement puts their kept millimeters, except for rounding."""
    return is_close(local, placement.to_local(kept), kept, placement)


def is_close(
    local: NDArray[np.float32], expected: NDArray[np.float32], kept: NDArray[np.float32], placement: Placement
) -> NDArray[np.bool_]:
    """Return which local positions equal the expected ones except for rounding to float32, (V,) bool.

    Parameters
    ----------
    local : (V, 3) float32
    expected : (V, 3) float32
        In the object's space.
    kept : (V, 3) float32
        RAS+ mm that were kept.
    placement : Placement
    """
    size = np.abs(kept) * np.float32(placement.scale)
    if placement.applied is not None:  # Every sum of a row rounds by its largest term.
        size = size.max(axis=1, keepdims=True) * np.float32(max(1.0, np.abs(placement.applied).sum()))
    return (np.abs(local - expected) <= ROUNDING * (np.abs(expected) + size)).all(axis=1)


def fitted_placement(placement: Placement, kept: NDArray[np.float32], local: NDArray[np.float32]) -> Placement | None:
    """Return the affine transform from kept millimeters to local positions by least squares; None if singular.

    The fit is repeated twice on the better half, so that a few vertices moved by hand do not count.
    """
    points = kept.astype(np.float64) * placement.scale - placement.origin
    moved = local.astype(np.float64)
    matrix = fitted_affine(points, moved)
    for _ in range(2):
        if matrix is None:
            return None
        distances = np.abs(transform_points(matrix, points) - moved).max(axis=1)
        used = distances <= np.median(distances)
        matrix = fitted_affine(points[used], moved[used])
    if matrix is None or is_flat(matrix[:3, :3]):
        return None
    x, y, z = (placement.origin + to_index(matrix, np.zeros((1, 3)))[0]).tolist()
    return replace(placement, origin=(x, y, z), applied=tuple(map(tuple, matrix[:3, :3].tolist())))


def fitted_affine(points: NDArray[np.float64], moved: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the (4, 4) matrix that moves points (n, 3) nearest to target points; None for flat points.

    Least squares by the normal equations about the middles, summed in a fixed order, so every processor gives the same
    bits.
    """
    middle, moved_middle = points.mean(axis=0), moved.mean(axis=0)
    apart, moved_apart = points - middle, moved - moved_middle
    squares = np.array([[(apart[:, i] * apart[:, j]).sum() for j in range(3)] for i in range(3)])
    products = np.array([[(moved_apart[:, i] * apart[:, j]).sum() for j in range(3)] for i in range(3)])
    if is_flat(squares):
        return None
    matrix = np.eye(4)
    matrix[:3, :3] = to_index(affine_of(squares), products)  # The matrix of squares is symmetric.
    matrix[:3, 3] = moved_middle - transform_points(matrix, middle[None])[0]
    return matrix


def is_flat(linear: NDArray[np.float64]) -> bool:
    """Return whether a (3, 3) matrix is singular, except for rounding."""
    return bool(abs(determinant(linear)) <= FLAT * np.abs(linear).max() ** 3)


def affine_of(linear: Any) -> NDArray[np.float64]:
    """Return three rows of three as an affine, (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    return matrix


def matrix_of(matrix: Any) -> NDArray[np.float64]:
    """Return a Blender matrix as an array."""
    return np.array([list(row) for row in matrix], np.float64)


def moved_mesh(matrix: NDArray[np.float64], mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh moved by a matrix, with its normals and its outward winding.

    Parameters
    ----------
    matrix : (4, 4) float64
    mesh : TriangleMesh
    """
    if (matrix == np.eye(4)).all():
        return mesh
    vertices = transform_points(matrix, mesh.vertices).astype(np.float32)
    normals = None if mesh.normals is None else transform_normals(matrix, mesh.normals)
    return TriangleMesh(vertices, transform_faces(matrix, mesh.faces), normals)
