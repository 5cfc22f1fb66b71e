"""Choose connected parts of a surface by the volume they enclose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..progress import Pauses, finish
from .cavities import finding_owners
from .triangle_mesh import Surface, TriangleMesh, numbering_parts


def part_volumes(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Signed volume of every connected part, (parts,), in the order of `mesh.part_of_face`.

    Negative for a cavity, whose faces point into the hole. Each part is measured about its own middle:
    for one that is open at the border that is the volume of the cone over its rim, near the truth.

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 6]], np.float32)
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    >>> part_volumes(TriangleMesh(corners, faces))
    array([1.])
    """
    return finish(_measuring(mesh, mesh.part_of_face))


def _measuring(mesh: TriangleMesh, part: NDArray[np.int32]) -> Pauses[NDArray[np.float64]]:
    count = int(part.max()) + 1 if len(part) else 0
    corners_of = np.bincount(part, minlength=count) * 3
    columns = []
    for axis in range(3):
        yield
        a, b, c = (mesh.vertices[corner, axis].astype(np.float64) for corner in mesh.faces.T)  # (F,) each
        yield
        middle = (np.bincount(part, a + b + c, count) / corners_of)[part]
        columns.append((a - middle, b - middle, c - middle))
    yield
    (ax, bx, cx), (ay, by, cy), (az, bz, cz) = columns
    triple = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)  # (F,)
    yield
    # bincount adds in the order of the faces: the same bits everywhere.
    return np.bincount(part, triple, count) / 6.0


def keep_parts(surface: Surface, mesh: TriangleMesh, largest: int = 0, min_volume: float = 0.0) -> Surface:
    """The surface without the parts that are too small; the walls of a cavity belong to the part around it.

    Parameters
    ----------
    surface : Surface
        What to choose from.
    mesh : TriangleMesh
        The same faces at the alpha and in the space in which to measure.
    largest : int
        Keep this many with their cavities; 0 keeps all. A part counts by what its outer wall encloses,
        equal parts in the order of their numbers.
    min_volume : float
        Drop parts and fill cavities below it, mm3 of a mesh in mm; applied together with `largest`.

    Returns
    -------
    Surface
        Where nothing is found around a cavity, as may be where the surface is open, it counts as a part
        of its own.

    Raises
    ------
    MeshError
        If nothing would be left.
    """
    return finish(keeping_parts(surface, mesh, largest, min_volume))


def keeping_parts(surface: Surface, mesh: TriangleMesh, largest: int, min_volume: float) -> Pauses[Surface]:
    """`keep_parts`, pausing now and then."""
    if not len(mesh.faces) or (largest == 0 and min_volume <= 0):
        return surface
    part = yield from numbering_parts(mesh.faces, len(mesh.vertices))
    yield
    volumes = yield from _measuring(mesh, part)
    owner = yield from finding_owners(mesh, part, volumes)
    sizes, bodies = np.abs(volumes), owner == np.arange(len(owner))
    keep = sizes >= min_volume
    if not keep[bodies].any():
        raise MeshError(
            f"no part has a volume of {min_volume:g} mm3 or more: the largest of {bodies.sum()} has "
            f"{sizes.max():.4g} mm3; lower the smallest part"
        )
    if largest:
        keep[np.flatnonzero(bodies)[np.argsort(-sizes[bodies], kind="stable")[largest:]]] = False
    keep &= keep[owner]
    return surface if keep.all() else surface.keeping(keep[part])
