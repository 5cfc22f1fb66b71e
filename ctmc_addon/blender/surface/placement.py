"""Where a surface lies in the scene: from RAS+ millimetres to Blender's units and back.

1 mm is `scale` units, and RAS axes are Blender's axes (Z up = head). The object stands at the surface's
center, and its vertices are kept relative to it, so float32 holds them to far below a micrometre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import TriangleMesh

SCALE = 0.01


@dataclass(frozen=True)
class Placement:
    """How millimetres become an object's local space.

    Parameters
    ----------
    origin : (x, y, z) float
        The object's place when it was made, Blender units, exactly as float32 holds it.
    scale : float
        Blender units of 1 mm.
    """

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = SCALE

    def to_local(self, points_ras_mm: NDArray[Any]) -> NDArray[np.float32]:
        """Local positions (n, 3) float32 of (n, 3) RAS+ millimetres."""
        out = points_ras_mm.astype(np.float64)
        out *= self.scale
        out -= self.origin
        return out.astype(np.float32)

    def to_mm(self, local: NDArray[np.float32]) -> NDArray[np.float32]:
        """RAS+ millimetres (n, 3) float32 of local positions."""
        out = local.astype(np.float64)
        out += self.origin
        out /= self.scale
        return out.astype(np.float32)

    def transform_mm(self, matrix_world: Any) -> NDArray[np.float64]:
        """What has been done to the object since it was placed, as a (4, 4) matrix of RAS+ millimetres."""
        matrix = matrix_of(matrix_world)
        own = matrix[:3, :3] @ np.array(self.origin)
        # Nothing but a move, or nothing at all, must leave no rounding behind.
        matrix[:3, 3] = (matrix[:3, 3] - own) / self.scale
        return matrix


def placed_at_center(points_ras_mm: NDArray[Any], scale: float = SCALE) -> Placement:
    """The placement whose origin is the middle of the box around (n, 3) points."""
    # A column at a time is ten times as fast as both axes at once.
    low, high = (np.array([end(points_ras_mm[:, axis]) for axis in range(3)]) for end in (np.min, np.max))
    middle = (low.astype(np.float64) + high) * (0.5 * scale)
    x, y, z = (float(value) for value in middle.astype(np.float32))
    return Placement((x, y, z), scale)


def matrix_of(matrix: Any) -> NDArray[np.float64]:
    """A matrix of Blender's as an array."""
    return np.array([list(row) for row in matrix], np.float64)


def moved(matrix: NDArray[np.float64], points: NDArray[Any]) -> NDArray[np.float64]:
    """(n, 3) points moved by a (4, 4) matrix, (n, 3) float64, as sums in a fixed order."""
    x, y, z = (points[:, axis].astype(np.float64) for axis in range(3))
    out = np.empty((len(points), 3))
    for row in range(3):
        out[:, row] = ((x * matrix[row, 0] + y * matrix[row, 1]) + z * matrix[row, 2]) + matrix[row, 3]
    return out


def moved_mesh(matrix: NDArray[np.float64], mesh: TriangleMesh) -> TriangleMesh:
    """A mesh moved by a (4, 4) matrix, its normals with it; a mirrored one turns the winding too."""
    if (matrix == np.eye(4)).all():
        return mesh
    faces, normals = mesh.faces, mesh.normals
    if np.linalg.det(matrix[:3, :3]) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    if normals is not None:
        inverse_transpose = np.eye(4)
        inverse_transpose[:3, :3] = np.linalg.inv(matrix[:3, :3]).T
        turned = moved(inverse_transpose, normals)
        length = np.sqrt(turned[:, 0] ** 2 + turned[:, 1] ** 2 + turned[:, 2] ** 2)
        length[length == 0] = 1.0
        normals = (turned / length[:, None]).astype(np.float32)
    return TriangleMesh(moved(matrix, mesh.vertices).astype(np.float32), faces, normals)
