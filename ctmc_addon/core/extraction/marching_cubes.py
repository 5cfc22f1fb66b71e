# SPDX-License-Identifier: GPL-3.0-or-later
"""Marching Cubes on voxels of any stride, with a coefficient alpha between midpoint and linear crossing.

Three passes, each over slabs of sample layers and each spread over threads. Read in this order:

    grid.py             which values of the volume are samples, the corners of voxels
    scan.py             the first two passes, and into which slabs a surface is cut
    classify.py         1. every sample is compared with the threshold, one bit a sample
    active_voxels.py    2. the active voxels are found, 64 at a time, with their cases, and with them the exact
                           number of vertices and triangles
    order.py               where each of them stands
    case_table.py          how a surface passes through a voxel of each case
    vertices.py         3. a vertex is placed on every crossed edge, with its normal (gradients.py)
    faces.py               the triangles' corners are gathered

For `topology="trilinear"` the second pass goes on with the modules of trilinear/: decider.py decides ambiguous voxels
by their gray values, cases.py has their triangles, interior_vertices.py places the vertices that some have inside.

field_pieces.py does this for a field whose values are fetched some slices at a time.

Positions are in index space (x = column, y = row, z = slice); field_pieces.py moves them to RAS+ millimeters.
Su and Ma, eq. 5 to 7; cases after Lorensen and Cline 1987, doi:10.1145/37401.37422.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, SettingsError, VolumeError
from ..machine.budget import Budget
from ..machine.parallel import map_steps
from ..mesh.triangle_mesh import Surface, TriangleMesh
from ..progress import Stages, Steps, finish
from ..volume.statistics.thresholding import check_threshold
from ..volume.volume import require_gray_type
from .faces import fill_faces
from .gradients import Sampler, complete_normals_steps
from .grid import Grid, make_grid
from .order import order_of
from .scan import SCAN_STAGES, scan_steps, slab_threads
from .trilinear.interior_vertices import fill_interior_vertices
from .vertices import VertexArrays, fill_edge_vertices

PLACING, COMPLETING = "Placing vertices and triangles", "Completing normals"
STAGES = SCAN_STAGES | {PLACING: 4.5}
STAGES_WEIGHT = sum(STAGES.values())
INTERIOR_SLABS = 8  # Place the vertices inside voxels of this many slabs at once.
ENDS: tuple[float | None, ...] = (0.0, None)  # The ends of alpha: the midpoint, and the linear crossing itself.


@dataclass(frozen=True)
class Counts:
    """Size of a surface, known before any of it is made.

    Parameters
    ----------
    voxels, active, vertices, faces : int
    exact : bool
        Whether all of the surface was counted, and not some slabs of it.
    layers : int
        Layers of voxels along z; 0 where that is not known.
    """

    voxels: int
    active: int
    vertices: int
    faces: int
    exact: bool = True
    layers: int = 0


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
        Values, at least two along every axis, in any byte order and memory layout; never copied.
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
    grid = make_grid(_checked_values(values), stride, close_border, upper=upper)
    surface = finish(extract_steps(grid, float(threshold), normals, Budget(threads), topology, (alpha,)))
    return TriangleMesh(surface.linear, surface.faces, surface.normals)


def extract_steps(
    grid: Grid,
    threshold: float,
    normals: bool = True,
    budget: Budget | None = None,
    topology: str = "classic",
    alphas: tuple[float | None, ...] = ENDS,
) -> Steps[Surface]:
    """The surface of a grid that is whole, in index space, as steps; normals are complete.

    Raises
    ------
    ThresholdError, MeshError
        If there is no surface.
    """
    stages = Stages({"": STAGES_WEIGHT, COMPLETING: 0.5})
    surface = yield from stages.run("", piece_steps(grid, threshold, normals, budget or Budget(), topology, alphas))
    if not len(surface.faces):
        check_threshold(threshold, grid.window_values, upper=grid.upper)
        raise MeshError(f"threshold {threshold:g} separates no samples of this grid; use a smaller stride")
    if surface.normals is not None:
        completing = complete_normals_steps(surface.normals, surface.linear, surface.faces)
        yield from stages.run(COMPLETING, completing)
    return surface


def count_steps(grid: Grid, threshold: float, budget: Budget | None = None, topology: str = "classic") -> Steps[Counts]:
    """Count active voxels, vertices and triangles exactly by the first two passes only."""
    stages = Stages(SCAN_STAGES)
    slabs, _ = yield from scan_steps(stages, grid, float(threshold), (budget or Budget()).thread_count, topology)
    return Counts(
        grid.voxels,
        sum(slab.cell_count for slab in slabs),
        sum(slab.vertex_count for slab in slabs),
        sum(slab.face_count for slab in slabs),
    )


def _checked_values(values: NDArray[Any]) -> NDArray[Any]:
    """`values` as an array that can be extracted from, or a `VolumeError`."""
    values = np.asarray(values)
    if values.ndim != 3 or min(values.shape) < 2:
        raise VolumeError(f"values must be (slices, rows, columns) with at least 2 of each, not {values.shape}")
    require_gray_type(values.dtype)
    return values


def piece_steps(
    grid: Grid, threshold: float, normals: bool, budget: Budget, topology: str, alphas: tuple[float | None, ...] = ENDS
) -> Steps[Surface]:
    """The piece of a surface that a grid has, in index space, with both ends of alpha; perhaps without a triangle.

    Where the grid continues, numbers beyond the piece's own vertices are those of the next piece. Vertices without a
    gradient have a normal of zero.

    Parameters
    ----------
    grid : Grid
        Begins with a unit of layers, and ends with one where it continues.
    alphas : tuple of float or None
        One or two at which to place vertices, None the linear crossing itself; of one alone the surface has it twice.
    """
    threads = budget.thread_count
    stages = Stages(STAGES)
    slabs, top = yield from scan_steps(stages, grid, threshold, threads, topology)
    order = order_of(slabs, top)
    if order.vertex_count > np.iinfo(np.int32).max:
        raise MeshError(f"{order.vertex_count} vertices are more than a mesh can number; use a larger stride")
    budget.require(
        12 * order.face_count + 12 * (len(alphas) + normals) * order.vertex_count,
        f"a surface of {order.face_count} triangles",
        "use a larger stride or a region",
    )
    size = (order.vertex_count, 3)
    normal_array = np.empty(size, np.float32) if normals else None
    out = VertexArrays(alphas, tuple(np.empty(size, np.float32) for _ in alphas), normal_array)
    faces = np.empty((order.face_count, 3), np.int32)
    sampler = Sampler(grid.values, grid.first_slice, grid.slices)
    above = slabs[1:] if top is None else [*slabs[1:], top]

    def fill(number: int) -> None:
        slab, places = slabs[number], order.places[number]
        following = None if number == len(above) else (above[number], order.places[number + 1])
        # What is NaN or infinite is refused, or left to the mesh's own normals; NumPy need not warn of it.
        with np.errstate(all="ignore"):
            fill_edge_vertices(grid, sampler, threshold, slab, places.vertices[:3], out)
            if topology == "trilinear" and number % INTERIOR_SLABS == 0:
                group = slabs[number : number + INTERIOR_SLABS]
                runs = [each.vertices[3] for each in order.places[number : number + len(group)]]
                fill_interior_vertices(grid, threshold, group, runs, out)
        fill_faces(slab, places, following, faces)

    yield from stages.run(PLACING, map_steps(fill, range(len(slabs)), slab_threads(len(slabs), threads), ""))
    return Surface(out.positions[0], out.positions[-1], faces, out.normals)
