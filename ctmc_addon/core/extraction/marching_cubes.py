"""Marching Cubes on voxels of any stride, with a coefficient alpha between midpoint and linear crossing.

Three passes, each over slabs of sample layers and each spread over threads:

1. `sampling.inside_bits` compares every sample with the threshold, one bit a sample.
2. `active.find_active` finds the active voxels, 64 at a time: their corners are not all equal. It gives their
   places and cases, and with them the exact number of vertices and triangles. For `topology="trilinear"`
   `inner.resolved` then decides the ambiguous ones.
3. `vertices.fill_vertices` places a vertex on every crossed edge, `triangles.fill_faces` gathers the corners.

Positions are in index space (x = column, y = row, z = slice); volume.py moves them to RAS+ millimetres.
Su and Ma, eq. 5 to 7; cases after Lorensen and Cline 1987, doi:10.1145/37401.37422.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, SettingsError, ThresholdError, VolumeError
from ..memory import require
from ..mesh.triangle_mesh import Surface, TriangleMesh
from ..parallel import map_steps, worker_count
from ..progress import Step, Steps, finish, within
from ..volume.thresholding import check_threshold
from .active_voxels import Slab, find_active
from .faces import fill_faces
from .gradients import Sampler, complete_normals
from .grid import WORD, Grid, inside_bits, make_grid
from .interior_vertices import resolved
from .trilinear_decider import tables
from .vertices import fill_vertices

SLAB_SAMPLES = 1 << 22  # samples compared at a time: enough to outweigh the cost of a call
SLAB_WORDS = 1 << 20  # words of 64 samples in a slab, for little memory
SLAB_MIXED = 1 << 15  # and those of them that a surface crosses: enough to outweigh the cost of a call
KEPT_BYTES = 1 << 23  # more than most arrays of a slab; see _scan_steps
TOPOLOGIES = ("classic", "trilinear")


@dataclass(frozen=True)
class Counts:
    """What a surface would cost: all exact, known before any of it is made."""

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
) -> TriangleMesh:
    """Surface between the values below and those at or above a threshold.

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
        Whether to give normals, from central differences of the grey values (Su and Ma, eq. 2 to 4).
    threads : int, optional
        By default one for each processor. The result does not depend on it.
    topology : {"classic", "trilinear"}
        "classic" parts the inside corners on every ambiguous face; "trilinear" gives the surface the parts and
        tunnels of the trilinear interpolant, with vertices inside some voxels. Both are closed and manifold.

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
        If the values are no three-dimensional numbers, or NaN or infinite beside the surface.

    Examples
    --------
    >>> distance = np.sqrt(((np.indices((21, 21, 21)) - 10.0) ** 2).sum(axis=0))
    >>> ball = marching_cubes(-distance, -8)
    >>> ball.euler, round(ball.volume / (4 / 3 * np.pi * 8**3), 2)
    (2, 0.99)
    """
    if not 0 <= alpha <= 1:
        raise SettingsError(f"alpha must be from 0 to 1, not {alpha:g}")
    grid = make_grid(checked_values(values), stride, close_border)
    return finish(_extract_steps(grid, float(threshold), (alpha,), normals, threads, None, topology))[0]


def extract_steps(
    grid: Grid,
    threshold: float,
    normals: bool = True,
    threads: int | None = None,
    memory_limit: int | None = None,
    topology: str = "classic",
) -> Steps[Surface]:
    """The surface of a grid with both ends of alpha, in index space, as steps."""
    ends = yield from _extract_steps(grid, float(threshold), (0.0, None), normals, threads, memory_limit, topology)
    return Surface(ends[0].vertices, ends[1].vertices, ends[0].faces, ends[0].normals)


def count_steps(grid: Grid, threshold: float, threads: int | None = None, topology: str = "classic") -> Steps[Counts]:
    """Exact numbers of active voxels, vertices and triangles, by the first two passes alone."""
    slabs = yield from _scan_steps(grid, float(threshold), worker_count(threads), topology)
    return Counts(
        grid.voxels,
        sum(int(slab.whole.sum()) for slab in slabs),
        sum(slab.vertices for slab in slabs),
        sum(slab.faces for slab in slabs),
    )


def checked_values(values: NDArray[Any]) -> NDArray[Any]:
    """`values` as an array that can be extracted from, or a `VolumeError`."""
    values = np.asarray(values)
    if values.ndim != 3 or min(values.shape) < 2:
        raise VolumeError(f"values must be (slices, rows, columns) with at least 2 of each, not {values.shape}")
    if values.dtype.kind not in "buif" or values.dtype.itemsize > 8 or values.dtype == np.float16:
        raise VolumeError(f"values of type {values.dtype} are no grey values; convert them to int16 or float32")
    return values


def _scan_steps(grid: Grid, threshold: float, threads: int, topology: str) -> Steps[list[Slab]]:
    if topology not in TOPOLOGIES:
        raise SettingsError(f"topology is one of {', '.join(TOPOLOGIES)}, not {topology!r}")
    if not math.isfinite(threshold):
        raise ThresholdError(f"threshold {threshold} is not a number; give a grey value of the volume")
    # The GNU C library gives freed memory back to the system, page by page to be fetched again, unless a larger
    # piece was freed before. This is one; nothing is written to it.
    np.empty(KEPT_BYTES, np.uint8)
    layers, rows, pitch = grid.z.count, grid.y.count + 1, grid.words * WORD
    bits = np.zeros((layers + 1, rows, grid.words), np.uint64)
    ranges = _even_parts(np.full(layers, rows * pitch / SLAB_SAMPLES))
    compare = map_steps(
        lambda part: inside_bits(grid, threshold, *part, bits), ranges, threads, "Comparing with the threshold"
    )
    yield from within(compare, 0.0, 0.3)
    ranges = _slabs(bits)
    sampler = Sampler(grid.values)
    if topology == "trilinear":
        tables()  # made once, not by every thread

    def scan(part: tuple[int, int]) -> Slab:
        slab = find_active(grid, bits, *part)
        return resolved(slab, grid, sampler, threshold) if topology == "trilinear" else slab

    return (yield from within(map_steps(scan, ranges, threads, "Finding active voxels"), 0.3, 0.5))


def _slabs(bits: NDArray[np.uint64]) -> list[tuple[int, int]]:
    """Ranges of sample layers of about equal work each, by every sixteenth row of words."""
    mixed = np.count_nonzero(bits[:-1, ::16] + np.uint64(1) > 1, axis=(1, 2)) * 16  # neither no sample nor all
    return _even_parts(np.maximum(mixed / SLAB_MIXED, bits[0].size / SLAB_WORDS))


def _even_parts(work: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Ranges (low, high) of layers with about equal shares of the work, near 1; an even number, where not just one."""
    done = np.cumsum(work)
    parts = 2 * math.ceil(done[-1] / 2) if done[-1] > 0.25 else 1  # less is not worth a second thread
    part = np.floor((done - work / 2) * (parts / done[-1]))
    firsts = [0, *(np.flatnonzero(np.diff(part)) + 1), len(work)]
    return [(int(low), int(high)) for low, high in pairwise(firsts)]


def _extract_steps(
    grid: Grid,
    threshold: float,
    alphas: tuple[float | None, ...],
    normals: bool,
    threads: int | None,
    memory_limit: int | None,
    topology: str,
) -> Steps[tuple[TriangleMesh, ...]]:
    """One mesh for each alpha (None for the linear crossing itself), sharing faces and normals."""
    threads = worker_count(threads)
    slabs = yield from _scan_steps(grid, threshold, threads, topology)
    first_vertex = np.cumsum([0] + [slab.vertices for slab in slabs], dtype=np.int64)
    first_face = np.cumsum([0] + [slab.faces for slab in slabs], dtype=np.int64)
    if first_face[-1] == 0:
        check_threshold(threshold, grid.values)
        raise MeshError(f"no sample of this grid is cut off by threshold {threshold:g}; use a smaller stride")
    if first_vertex[-1] > np.iinfo(np.int32).max:
        raise MeshError(f"{first_vertex[-1]} vertices are more than a mesh can number; use a larger stride")
    require(
        12 * int(first_face[-1]) + 12 * (len(alphas) + normals) * int(first_vertex[-1]),
        f"a surface of {first_face[-1]} triangles",
        "use a larger stride or a region",
        memory_limit,
    )

    positions = tuple(np.empty((first_vertex[-1], 3), np.float32) for _ in alphas)
    directions = np.empty((first_vertex[-1], 3), np.float32) if normals else None
    faces = np.empty((first_face[-1], 3), np.int32)
    sampler = Sampler(grid.values)

    def fill(number: int) -> None:
        slab, following = slabs[number], slabs[number + 1] if number + 1 < len(slabs) else None
        part = slice(first_vertex[number], first_vertex[number + 1])
        fill_vertices(
            grid,
            sampler,
            threshold,
            slab,
            [(alpha, position[part]) for alpha, position in zip(alphas, positions, strict=True)],
            None if directions is None else directions[part],
        )
        fill_faces(slab, following, part.start, faces[first_face[number] : first_face[number + 1]])

    yield from within(map_steps(fill, range(len(slabs)), threads, "Placing vertices and triangles"), 0.5, 0.95)
    if directions is not None:
        complete_normals(directions, positions[-1], faces)
    yield Step(1.0, "Surface extracted")
    return tuple(TriangleMesh(position, faces, directions) for position in positions)
