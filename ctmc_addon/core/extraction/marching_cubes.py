# SPDX-License-Identifier: GPL-3.0-or-later
"""Marching Cubes on voxels of any stride, with a coefficient alpha between midpoint and linear crossing.

Three passes, each over slabs of sample layers and each spread over threads. Read in this order:

    grid.py             which values of the volume are samples, the corners of voxels
    scan.py             the first two passes, and into which slabs a surface is cut
    classify.py         1. every sample is compared with the threshold, one bit a sample
    active_voxels.py    2. the active voxels are found, 64 at a time, with their cases, and with them the exact
                           number of vertices and triangles
    case_table.py          how a surface passes through a voxel of each case
    vertices.py         3. a vertex is placed on every crossed edge, with its normal (gradients.py)
    faces.py               the triangles' corners are gathered

For `topology="trilinear"` the second pass goes on: trilinear_decider.py decides ambiguous voxels by their gray
values, trilinear_cases.py has their triangles, interior_vertices.py places the vertices that some have inside.

Positions are in index space (x = column, y = row, z = slice); pipeline.py moves them to RAS+ millimeters by affine.py.
Su and Ma, eq. 5 to 7; cases after Lorensen and Cline 1987, doi:10.1145/37401.37422.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, SettingsError, VolumeError
from ..memory import require
from ..mesh.triangle_mesh import Surface, TriangleMesh
from ..parallel import map_steps, worker_count
from ..progress import Stages, Step, Steps, finish
from ..volume.thresholding import WHOLE_VOLUME, check_threshold
from ..volume.volume import require_gray_type
from .active_voxels import Slab
from .faces import fill_faces
from .gradients import Sampler, complete_normals_steps
from .grid import Grid, make_grid
from .interior_vertices import fill_interior_vertices
from .scan import SCAN_STAGES, scan_steps
from .vertices import VertexArrays, fill_edge_vertices

PLACING, COMPLETING = "Placing vertices and triangles", "Completing normals"
STAGES = SCAN_STAGES | {PLACING: 4.5, COMPLETING: 0.5}


@dataclass(frozen=True)
class Counts:
    """Exact size of a surface, known before any of it is made."""

    voxels: int
    active: int
    vertices: int
    faces: int


def marching_cubes(
    values: NDArray[Any],
    threshold: float,
    stride: int | tuple[int, int, int] = (1, 1, 1),
    alpha: float = 1.0,
    close_border: bool = False,
    normals: bool = True,
    threads: int | None = None,
    topology: str = "classic",
    upper: float | None = None,
) -> TriangleMesh:
    """Surface between the values below and those at or above a threshold, or about those between two limits.

    Parameters
    ----------
    values : (slices, rows, columns) bool, integers, float32 or float64
        At least two along every axis, in any byte order and memory layout; never copied.
    threshold : float
        Inside is ``value >= threshold``.
    stride : (x, y, z) int
        Sides of a voxel in pixels, one number for all three. The last, partial voxel is kept.
    alpha : float
        0 puts vertices at the edges' midpoints, 1 at the linear crossings (Su and Ma, eq. 7). A crossing
        keeps 2**-10 of the edge from its ends, so no two vertices coincide, up to 16,000 pixels along an axis.
    close_border : bool
        Cap the surface half a pixel outside the outermost samples.
    normals : bool
        Whether to give normals, from central differences of the gray values (Su and Ma, eq. 2 to 4).
    threads : int, optional
        By default one for each processor. The result does not depend on it.
    topology : {"classic", "trilinear"}
        "classic" separates the inside corners on every ambiguous face; "trilinear" gives the surface the components and
        tunnels of the trilinear interpolant, with vertices inside some voxels. Both are closed and manifold.
    upper : float, optional
        Inside is ``threshold <= value <= upper``. An edge from below the threshold to above the upper limit is not
        crossed, as both of its ends are outside.

    Returns
    -------
    TriangleMesh
        Vertices (x, y, z) = (column, row, slice) float32; faces counter-clockwise seen from outside;
        normals pointing outside. The same triangles for every alpha.

    Raises
    ------
    ThresholdError
        If no value, or every value, is at or above the threshold.
    SettingsError
        If alpha lies outside 0..1, a stride below 1 or above the volume, or the topology is unknown.
    VolumeError
        If the values are not three-dimensional numbers, or are NaN or infinite beside the surface.

    Examples
    --------
    >>> distance = np.sqrt(((np.indices((21, 21, 21)) - 10.0) ** 2).sum(axis=0))
    >>> ball = marching_cubes(-distance, -8)
    >>> ball.euler, round(ball.volume / (4 / 3 * np.pi * 8**3), 2)
    (2, 0.99)
    """
    if not 0 <= alpha <= 1:
        raise SettingsError(f"alpha must be from 0 to 1, not {alpha:g}")
    grid = make_grid(checked_values(values), stride, close_border, upper=upper)
    return finish(_extract_steps(grid, float(threshold), (alpha,), normals, threads, None, topology))[0]


def extract_steps(
    grid: Grid,
    threshold: float,
    normals: bool = True,
    threads: int | None = None,
    memory_limit: int | None = None,
    topology: str = "classic",
    kind: str = "grey value",
    place: str = WHOLE_VOLUME,
) -> Steps[Surface]:
    """The surface of a grid with both ends of alpha, in index space, as steps; `kind` and `place` are for messages."""
    ends = (0.0, None)
    midpoints, linear = yield from _extract_steps(
        grid, float(threshold), ends, normals, threads, memory_limit, topology, kind, place
    )
    return Surface(midpoints.vertices, linear.vertices, midpoints.faces, midpoints.normals)


def count_steps(grid: Grid, threshold: float, threads: int | None = None, topology: str = "classic") -> Steps[Counts]:
    """Exact numbers of active voxels, vertices and triangles, by the first two passes alone."""
    stages = Stages(SCAN_STAGES)
    slabs, _ = yield from scan_steps(stages, grid, float(threshold), worker_count(threads), topology)
    return Counts(
        grid.voxels,
        sum(int(slab.is_cell.sum()) for slab in slabs),
        sum(slab.vertex_count for slab in slabs),
        sum(slab.face_count for slab in slabs),
    )


def checked_values(values: NDArray[Any]) -> NDArray[Any]:
    """`values` as an array that can be extracted from, or a `VolumeError`."""
    values = np.asarray(values)
    if values.ndim != 3 or min(values.shape) < 2:
        raise VolumeError(f"values must be (slices, rows, columns) with at least 2 of each, not {values.shape}")
    require_gray_type(values.dtype)
    return values


def _extract_steps(
    grid: Grid,
    threshold: float,
    alphas: tuple[float | None, ...],
    normals: bool,
    threads: int | None,
    memory_limit: int | None,
    topology: str,
    kind: str = "grey value",
    place: str = WHOLE_VOLUME,
) -> Steps[tuple[TriangleMesh, ...]]:
    """One mesh for each alpha (None for the linear crossing itself), sharing faces and normals."""
    threads = worker_count(threads)
    stages = Stages(STAGES)
    slabs, _ = yield from scan_steps(stages, grid, threshold, threads, topology)
    first_vertex = np.cumsum([0] + [slab.vertex_count for slab in slabs], dtype=np.int64)
    first_face = np.cumsum([0] + [slab.face_count for slab in slabs], dtype=np.int64)
    if first_face[-1] == 0:
        check_threshold(threshold, grid.window_values, kind, place, grid.upper)
        raise MeshError(no_surface_text(threshold))
    if first_vertex[-1] > np.iinfo(np.int32).max:
        raise MeshError(f"{first_vertex[-1]} vertices are more than a mesh can number; use a larger stride")
    require(
        12 * int(first_face[-1]) + 12 * (len(alphas) + normals) * int(first_vertex[-1]),
        f"a surface of {first_face[-1]} triangles",
        "use a larger stride or a region",
        memory_limit,
    )

    size = (int(first_vertex[-1]), 3)
    normal_array = np.empty(size, np.float32) if normals else None
    out = VertexArrays(alphas, tuple(np.empty(size, np.float32) for _ in alphas), normal_array)
    faces = np.empty((first_face[-1], 3), np.int32)
    sampler = Sampler(grid.values, grid.first_slice, grid.slices)

    def fill(number: int) -> None:
        slab, following = slabs[number], slabs[number + 1] if number + 1 < len(slabs) else None
        begin, end = int(first_vertex[number]), int(first_vertex[number + 1])
        fill_vertices(grid, sampler, threshold, slab, out.part(begin, end))
        fill_faces(slab, following, begin, faces[first_face[number] : first_face[number + 1]])

    yield from stages.run(PLACING, map_steps(fill, range(len(slabs)), threads, ""))
    if out.normals is not None:
        yield from stages.run(COMPLETING, complete_normals_steps(out.normals, out.positions[-1], faces))
    yield Step(1.0, "Surface extracted")
    return tuple(TriangleMesh(position, faces, out.normals) for position in out.positions)


def fill_vertices(grid: Grid, sampler: Sampler, threshold: float, slab: Slab, out: VertexArrays) -> None:
    """Fill in a slab's vertices, all of `out`."""
    edges, count = slab.edge_vertex_count, slab.vertex_count
    # What is NaN or infinite is refused, or left to the mesh's own normals; NumPy need not warn of it.
    with np.errstate(all="ignore"):
        fill_edge_vertices(grid, sampler, threshold, slab, out.part(0, edges))
        if edges < count:
            fill_interior_vertices(grid, threshold, slab, out.part(edges, count))


def no_surface_text(threshold: float) -> str:
    """Why there is no surface although values lie on both sides of the threshold."""
    return f"no sample of this grid is cut off by threshold {threshold:g}; use a smaller stride"
