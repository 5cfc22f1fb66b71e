"""Marching Cubes on voxels of any stride, with a coefficient alpha between midpoint and linear crossing.

Three passes, each over slabs of sample layers and each spread over threads:

1. `inside_bits` compares every sample with the threshold, one bit a sample.
2. `scan` finds the active voxels, 64 at a time: their corners are not all equal. It gives their
   places and cases, and with them the exact number of vertices and triangles.
3. `fill` places a vertex on every crossed edge and gathers the triangles' corners.

A voxel owns the three edges at its lowest corner. The samples are repeated once beyond the last
along every axis, so the edges in the high borders have an owner too: a half voxel, which gives no triangles.

Positions are in index space (x = column, y = row, z = slice); volume.py moves them to RAS+ millimetres.
Su and Ma, eq. 5 to 7; cases after Lorensen and Cline 1987, doi:10.1145/37401.37422.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .cases import EDGES, FIRST_TRIANGLE, TRIANGLE_COUNT, TRIANGLE_EDGES
from .errors import MeshError, SettingsError, ThresholdError, VolumeError
from .memory import require
from .mesh import Surface, TriangleMesh, blend, vertex_normals
from .normals import Sampler, edge_normals
from .progress import Step, Steps, finish, within
from .sampling import WORD, Grid, check_threshold, inside_bits, make_grid
from .workers import in_batches, worker_count

SLAB_SAMPLES = 1 << 22  # samples in a slab: enough to outweigh the cost of a call, few enough for little memory
MAP_SAMPLES = 1 << 19  # samples whose edges' vertex numbers are looked up at once: they stay in the cache
NEAREST = 2.0**-10  # share of an edge that a crossing keeps from the edge's ends
CROSSES = np.array([[(case ^ case >> (1 << axis)) & 1 for case in range(256)] for axis in range(3)], bool)
"""(3, 256) whether a case crosses the edge along an axis that its voxel owns."""


@dataclass(frozen=True, eq=False)
class Slab:
    """The active voxels of the sample layers `low` to `high`, half voxels among them.

    Parameters
    ----------
    low, high : int
    x, y : int
        First column and row of samples of the slab's window: outside it no sample is inside.
    rows, pitch : int
        Rows of samples in the window, and samples in a row.
    place : (n,) int32
        Place in the window's samples (layers, rows, pitch), ascending.
    case : (n,) uint8
    whole : (n,) bool
        False for half voxels.
    owned : three (n_axis,) intp
        Which of the voxels own a crossed edge along x, y, z: one vertex each.
    """

    low: int
    high: int
    x: int
    y: int
    rows: int
    pitch: int
    place: NDArray[np.int32]
    case: NDArray[np.uint8]
    whole: NDArray[np.bool_]
    owned: tuple[NDArray[np.intp], ...]

    @property
    def vertices(self) -> int:
        """Number of vertices on edges that the slab's voxels own."""
        return sum(len(voxels) for voxels in self.owned)

    @property
    def faces(self) -> int:
        """Number of triangles."""
        return int(TRIANGLE_COUNT[self.case[self.whole]].sum(dtype=np.int64))

    def samples(self, place: NDArray[np.int32]) -> tuple[NDArray[np.int32], ...]:
        """Sample numbers along x, y and z of places in the window."""
        row = place // np.int32(self.pitch)
        layer = row // np.int32(self.rows)
        x = place - row * np.int32(self.pitch)
        y = row - layer * np.int32(self.rows)
        return x + np.int32(self.x), y + np.int32(self.y), layer + np.int32(self.low)


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
    stride: tuple[int, int, int] = (1, 1, 1),
    alpha: float = 1.0,
    close_border: bool = False,
    normals: bool = True,
    threads: int | None = None,
) -> TriangleMesh:
    """Surface between the values below and those at or above a threshold.

    Parameters
    ----------
    values : (slices, rows, columns) bool, integers, float32 or float64
        At least two along every axis, in any byte order and memory layout; never copied.
    threshold : float
        Inside is ``value >= threshold``.
    stride : (x, y, z) int
        Sides of a voxel in pixels. The last, partial voxel is kept.
    alpha : float
        0 puts vertices at the edges' midpoints, 1 at the linear crossings (Su and Ma, eq. 7). A crossing
        keeps 2**-10 of the edge from its ends, so no two vertices coincide.
    close_border : bool
        Cap the surface half a pixel outside the outermost samples.
    normals : bool
        Whether to give normals, from central differences of the grey values (Su and Ma, eq. 2 to 4).
    threads : int, optional
        By default one for each processor. The result does not depend on it.

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
        If alpha lies outside 0..1 or a stride below 1 or above the volume.
    VolumeError
        If the values are no three-dimensional numbers, or NaN or infinite beside the surface.

    Examples
    --------
    >>> ball = np.sqrt((np.indices((21, 21, 21)) - 10.0) ** 2).sum(axis=0) < 8
    >>> marching_cubes(ball, 0.5).euler
    2
    """
    if not 0 <= alpha <= 1:
        raise SettingsError(f"alpha must be from 0 to 1, not {alpha:g}")
    grid = make_grid(checked_values(values), stride, close_border)
    return finish(_extract_steps(grid, threshold, (alpha,), normals, threads))[0]


def extract_steps(
    grid: Grid,
    threshold: float,
    normals: bool = True,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Steps[Surface]:
    """The surface of a grid with both ends of alpha, in index space, as steps."""
    ends = yield from _extract_steps(grid, threshold, (0.0, None), normals, threads, memory_limit)
    return Surface(ends[0].vertices, ends[1].vertices, ends[0].faces, ends[0].normals)


def count_steps(grid: Grid, threshold: float, threads: int | None = None) -> Steps[Counts]:
    """Exact numbers of active voxels, vertices and triangles, by the first two passes alone."""
    slabs = yield from _scan_steps(grid, threshold, worker_count(threads))
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
    if values.dtype.kind not in "buif" or values.dtype.itemsize > 8:
        raise VolumeError(f"values of type {values.dtype} are no grey values; convert them to int16 or float32")
    return values


def _scan_steps(grid: Grid, threshold: float, threads: int) -> Steps[list[Slab]]:
    if not math.isfinite(threshold):
        raise ThresholdError(f"threshold {threshold} is not a number; give a grey value of the volume")
    layers, rows, pitch = grid.z.count, grid.y.count + 1, grid.words * WORD
    bits = np.zeros((layers + 1, rows, grid.words), np.uint64)
    height = max(1, SLAB_SAMPLES // (rows * pitch))
    ranges = [(low, min(low + height, layers)) for low in range(0, layers, height)]
    compare = in_batches(
        lambda part: inside_bits(grid, threshold, *part, bits), ranges, threads, "Comparing with the threshold"
    )
    yield from within(compare, 0.0, 0.3)
    find = in_batches(lambda part: scan(grid, bits, *part), ranges, threads, "Finding active voxels")
    return (yield from within(find, 0.3, 0.5))


def scan(grid: Grid, bits: NDArray[np.uint64], low: int, high: int) -> Slab:
    """Find the active voxels of the sample layers `low` to `high`, and their cases."""
    window = _window(bits[low : high + 1])
    here = bits[low : high + 1, window[0], window[1]]  # (layers + 1, rows, words)
    rows, words = here.shape[1:]
    at_border = [window[1].stop == bits.shape[2], window[0].stop == bits.shape[1], high == grid.z.count]
    last_bit = np.uint64(1 << (grid.x.count - 1) % WORD)

    next_x = here >> np.uint64(1)
    next_x[..., :-1] |= here[..., 1:] << np.uint64(WORD - 1)
    if at_border[0]:
        next_x[..., -1] |= here[..., -1] & last_bit
    some, every = here | next_x, here & next_x
    some, every = some[:, :-1] | some[:, 1:], every[:, :-1] & every[:, 1:]
    active = (some[:-1] | some[1:]) ^ (every[:-1] & every[1:])  # (layers, rows - 1, words)

    at_word = np.flatnonzero(active)
    eights = active.reshape(-1)[at_word].view(np.uint8)  # eight voxels a byte
    at_eight = np.flatnonzero(eights != 0)
    at_voxel = np.flatnonzero(_bits_of(eights[at_eight]))
    if at_border[0]:
        active[..., -1] &= ~last_bit
    if at_border[1]:
        active[:, -1] = 0
    if at_border[2]:
        active[-1] = 0
    whole = _bits_of(active.reshape(-1)[at_word].view(np.uint8)[at_eight])[at_voxel].view(bool)

    at_word += at_word // ((rows - 1) * words) * words  # every layer of `here` has a row more than `active`
    byte = at_word[at_eight >> 3] * 8 + (at_eight & 7)
    cases = np.zeros(8 * len(byte), np.uint8)
    sides = (np.ascontiguousarray(here).reshape(-1).view(np.uint8), next_x.reshape(-1).view(np.uint8))
    for corner in range(8):
        shift = ((corner >> 1 & 1) + (corner >> 2) * rows) * words * 8
        cases |= _bits_of(sides[corner & 1].take(byte + shift)) << np.uint8(corner)
    case = cases[at_voxel]
    place = ((byte * 8)[at_voxel >> 3] + (at_voxel & 7)).astype(np.int32)
    owned = tuple(np.flatnonzero(CROSSES[axis].take(case)) for axis in range(3))
    return Slab(low, high, window[1].start * WORD, window[0].start, rows, words * WORD, place, case, whole, owned)


def _window(bits: NDArray[np.uint64]) -> tuple[slice, slice]:
    """Rows and words that can hold an active voxel: those with a sample inside, and one more on either side."""
    inside = np.bitwise_or.reduce(bits, axis=0) != 0  # (rows, words)
    rows, words = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if not len(rows):
        return slice(0, 1), slice(0, 1)
    return (
        slice(max(0, int(rows[0]) - 1), min(bits.shape[1], int(rows[-1]) + 2)),
        slice(max(0, int(words[0]) - 1), int(words[-1]) + 1),
    )


def _bits_of(eights: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.unpackbits(eights, bitorder="little")


def _extract_steps(
    grid: Grid,
    threshold: float,
    alphas: tuple[float | None, ...],
    normals: bool,
    threads: int | None,
    memory_limit: int | None = None,
) -> Steps[tuple[TriangleMesh, ...]]:
    """One mesh for each alpha (None for the linear crossing itself), sharing faces and normals."""
    threads = worker_count(threads)
    slabs = yield from _scan_steps(grid, threshold, threads)
    first_vertex = np.cumsum([0] + [slab.vertices for slab in slabs])
    first_face = np.cumsum([0] + [slab.faces for slab in slabs])
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

    yield from within(in_batches(fill, range(len(slabs)), threads, "Placing vertices and triangles"), 0.5, 0.95)
    if directions is not None:
        complete_normals(directions, positions[-1], faces)
    yield Step(1.0, "Surface extracted")
    return tuple(TriangleMesh(position, faces, directions) for position in positions)


def fill_vertices(
    grid: Grid,
    sampler: Sampler,
    threshold: float,
    slab: Slab,
    targets: list[tuple[float | None, NDArray[np.float32]]],
    directions: NDArray[np.float32] | None,
) -> None:
    """Place a vertex on every crossed edge the slab owns: first those along x, then y, then z."""
    axes = (grid.x, grid.y, grid.z)
    samples = [sample[np.concatenate(slab.owned)] for sample in slab.samples(slab.place)]  # the edges' low ends
    ends = np.cumsum([0] + [len(voxels) for voxels in slab.owned])
    parts = [slice(ends[axis], ends[axis + 1]) for axis in range(3)]
    index = [axes[axis].index.take(samples[axis]) for axis in range(3)]
    place = sampler.place(*index)

    side = np.empty(len(place), np.float32)
    begin = np.empty(len(place), np.float32)
    beyond = place.copy()
    for axis, part in enumerate(parts):
        along, at = axes[axis], samples[axis][part]
        begin[part] = along.position.take(at)
        side[part] = np.diff(along.position).take(at)
        beyond[part] += (np.diff(along.index) * sampler.steps[axis]).take(at)
    low = sampler.take(place)
    rise = sampler.take(beyond) - low
    # The outside sample of a closed border repeats its neighbour's value: no rise, so the cap lies half-way.
    on_cap = rise == 0
    rise[on_cap] = 1.0
    t = (threshold - low) / rise
    t[on_cap] = 0.5
    if sampler.may_be_nan and not np.isfinite(t).all():
        raise VolumeError("there are NaN or infinite values beside the surface; read them as a number with nan_as")
    np.clip(t, NEAREST, 1 - NEAREST, out=t)

    middle = begin + np.float32(0.5) * side
    linear = (begin + t * side).astype(np.float32)
    for alpha, position in targets:
        for axis in range(3):
            position[:, axis] = axes[axis].position.take(samples[axis])
        mixed = linear if alpha is None else blend(middle, linear, alpha)
        for axis, part in enumerate(parts):
            position[part, axis] = mixed[part]
    if directions is not None:
        edge_normals(sampler, index, place, parts, linear, directions)
        directions[on_cap] = 0.0


def fill_faces(slab: Slab, following: Slab | None, first_vertex: int, out: NDArray[np.int32]) -> None:
    """Gather the triangles' corners from a map of edge to vertex number, a few layers at a time."""
    layer = slab.rows * slab.pitch
    places, vertices = _numbered_edges(slab, following, first_vertex)
    count = TRIANGLE_COUNT.take(slab.case)
    count *= slab.whole
    height = max(1, MAP_SAMPLES // layer)
    start = 0
    for first in range(0, slab.high - slab.low, height):
        last = min(first + height, slab.high - slab.low)
        vertex_of = np.empty((3, (last - first + 1) * layer), np.int32)
        for axis in range(3):
            known = slice(*np.searchsorted(places[axis], (first * layer, (last + 1) * layer)))
            vertex_of[axis, places[axis][known] - first * layer] = vertices[axis][known]
        voxels = slice(*np.searchsorted(slab.place, (first * layer, last * layer)))
        base = slab.place[voxels] - np.int32(first * layer)
        part = out[start : start + int(count[voxels].sum(dtype=np.int64))]
        start += len(part)
        _gather(vertex_of, base, slab.case[voxels], count[voxels], (1, slab.pitch, layer), part)


def _numbered_edges(
    slab: Slab, following: Slab | None, first_vertex: int
) -> tuple[list[NDArray[np.intp]], list[NDArray[np.int32]]]:
    """Place and vertex number of the crossed edges along x, y and z; those in the top layer are the next slab's."""
    places, vertices = [], []
    vertex, next_vertex = first_vertex, first_vertex + slab.vertices
    for axis in range(3):
        place = [slab.place.take(slab.owned[axis]).astype(np.intp)]
        number = [np.arange(vertex, vertex + len(place[0]), dtype=np.int32)]
        vertex += len(place[0])
        if following is not None and axis < 2:
            owned = following.place.take(following.owned[axis])
            owned = owned[: np.searchsorted(owned, following.rows * following.pitch)]
            x, y, _ = following.samples(owned)
            top = ((slab.high - slab.low) * slab.rows + (y - slab.y)) * slab.pitch + (x - slab.x)
            place.append(top.astype(np.intp))
            number.append(np.arange(next_vertex, next_vertex + len(top), dtype=np.int32))
            next_vertex += len(following.owned[axis])
        places.append(np.concatenate(place))
        vertices.append(np.concatenate(number))
    return places, vertices


def _gather(
    vertex_of: NDArray[np.int32],
    base: NDArray[np.int32],
    case: NDArray[np.uint8],
    count: NDArray[np.uint8],
    steps: tuple[int, int, int],
    out: NDArray[np.int32],
) -> None:
    """Write the voxels' triangles, those of voxels with one triangle first, then those with two, and so on."""
    offset_of_edge = np.array(
        [
            edge // 4 * vertex_of.shape[1] + sum(steps[axis] for axis in range(3) if low >> axis & 1)
            for edge, (low, _) in enumerate(EDGES)
        ],
        np.intp,
    )
    offsets = offset_of_edge[TRIANGLE_EDGES].reshape(-1)
    numbers = vertex_of.reshape(-1)
    by_count = np.argsort(count, kind="stable")
    ends = np.cumsum(np.bincount(count))
    start = 0
    for triangles in range(1, len(ends)):
        voxels = by_count[ends[triangles - 1] : ends[triangles]]
        at_voxel = base.take(voxels).astype(np.intp)
        first = FIRST_TRIANGLE.take(case.take(voxels)) * 3
        part = out[start : start + triangles * len(voxels)].reshape(-1, 3 * triangles)
        start += triangles * len(voxels)
        for corner in range(3 * triangles):
            at = offsets[corner:].take(first)
            at += at_voxel
            part[:, corner] = numbers.take(at, mode="clip")


def complete_normals(normals: NDArray[np.float32], positions: NDArray[np.float32], faces: NDArray[np.int32]) -> None:
    """Give the mesh's own normal to every vertex whose gradient vanishes or that lies on a cap."""
    missing = np.flatnonzero((normals[:, 0] == 0) & (normals[:, 1] == 0) & (normals[:, 2] == 0))
    if len(missing):
        normals[missing] = vertex_normals(positions, faces)[missing]
