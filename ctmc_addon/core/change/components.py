# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure each component of a label: its samples, and the volume and largest diameter of its surface.

Samples are connected along the axes, as the surface connects them (smoothing/label_components.py). A component of the
surface, with the walls of its cavities, belongs to the samples next to its vertices. If the surface connects components
of the samples, as a Gaussian does, they count as one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Doubles, Indices
from ..mesh.diameter import largest_diameter_steps
from ..mesh.measures import measures_steps
from ..mesh.pieces.kept_pieces import bodies_steps
from ..mesh.topology import component_roots_steps, components_of_vertices
from ..mesh.triangle_mesh import Surface, TriangleMesh
from ..progress import PAUSE, Step, Steps, equal_part
from ..smoothing.label_components import LabelComponents, label_components_steps
from ..volume.affine import to_index, transform_points
from ..volume.labels.extents import label_extent_steps, layer_of_label_steps
from ..volume.volume import Box, Volume

AT_ONCE = 1 << 18  # Look up this many vertices at once.
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Component:
    """A component of a label.

    Parameters
    ----------
    number : int
        From 1 on, beginning with the component with the most samples.
    voxels : int
    volume_mm3 : float
        Volume enclosed by its surface; without a closed surface, that of its samples.
    diameter_mm : float or None
        Largest diameter of its surface; None without one.
    center_mm : (x, y, z) float
        Mean position of its samples, RAS+ mm.
    closed : bool
        Whether it has a closed surface.
    """

    number: int
    voxels: int
    volume_mm3: float
    diameter_mm: float | None
    center_mm: Point
    closed: bool


@dataclass(frozen=True, eq=False)
class MeasuredLabel:
    """The components of a label in a volume.

    Parameters
    ----------
    volume : Volume
    components : tuple of Component
        In the order of their numbers.
    runs : LabelComponents
        Runs of samples by slice, row and column of the volume; their components are positions in `components`.
    box : Box
        Smallest box around the samples; empty without samples.
    numbers : (slices, rows, columns) int32
        Position in `components` of each sample in that box; -1 for samples of no component.
    mesh : TriangleMesh or None
        Surface of all components, RAS+ mm.
    of_vertex : (V,) int32
        Position in `components` of each vertex of the mesh; -1 for none.
    dropped : int
        Number of components that were left out because they have no surface.
    """

    volume: Volume
    components: tuple[Component, ...]
    runs: LabelComponents
    box: Box
    numbers: NDArray[np.int32]
    mesh: TriangleMesh | None
    of_vertex: NDArray[np.int32]
    dropped: int = 0


def measured_label_steps(
    volume: Volume, label: int | None, region: Box, mesh: TriangleMesh | None, drop: bool = False
) -> Steps[MeasuredLabel]:
    """Measure the components of a label.

    Parameters
    ----------
    volume : Volume
    label : int or None
        None for a volume that lacks it.
    region : Box
        Part of the volume to measure.
    mesh : TriangleMesh or None
        Surface of the label, RAS+ mm.
    drop : bool
        Whether to leave out components without a surface, because the settings drop small ones.
    """
    extent = None
    if label is not None:
        layer = yield from layer_of_label_steps(volume, label, region)
        extent = yield from label_extent_steps(layer, label, region)
    if extent is None:
        box: Box = ((0, 0), (0, 0), (0, 0))
        runs = yield from label_components_steps(np.zeros((0, 1, 1), bool))
        return MeasuredLabel(volume, (), runs, box, np.empty((0, 0, 0), np.int32), None, np.empty(0, np.int32))
    yield Step(0.1, "Finding components")
    columns, rows, slices = (range(start, stop) for start, stop in extent.box)
    x, y, z = columns.start, rows.start, slices.start
    runs = yield from label_components_steps(layer.samples(slices, rows, columns) == label)
    shape = _shape(extent.box)
    bodies = np.empty(0, np.int32)
    if mesh is not None:
        bodies = yield from _bodies_steps(mesh)
        near = yield from _near_steps(volume, mesh, (yield from _numbers_steps(runs, shape)), (x, y, z))
        runs, bodies = yield from _joined_steps(runs, mesh, bodies, near)
    runs, bodies, dropped = _by_size(runs, bodies, drop)
    numbers = yield from _numbers_steps(runs, shape)
    runs = runs.moved(z, y, x)
    of_vertex = np.empty(0, np.int32)
    if mesh is not None:
        of_vertex = components_of_vertices(mesh.faces, bodies, len(mesh.vertices))
    components = yield from equal_part(_components_steps(volume, runs, mesh, bodies), 1, 2)
    return MeasuredLabel(volume, components, runs, extent.box, numbers, mesh, of_vertex, dropped)


def _numbers_steps(runs: LabelComponents, shape: tuple[int, int, int]) -> Steps[NDArray[np.int32]]:
    """Return the component of every sample of a grid, (slices, rows, columns) int32; -1 for none."""
    slices, rows, columns = shape
    numbers = np.empty(shape, np.int32)
    ends = np.searchsorted(runs.z, np.arange(slices + 1))
    start, stop = (runs.y * columns + along for along in (runs.start, runs.stop))
    for number in range(slices):
        own = slice(ends[number], ends[number + 1])
        turns = np.zeros(rows * columns + 1, np.int32)
        turns[start[own]] += (runs.component[own] + 1).astype(np.int32)  # No two runs begin or end at one sample.
        turns[stop[own]] -= (runs.component[own] + 1).astype(np.int32)
        numbers[number] = np.cumsum(turns[:-1], dtype=np.int32).reshape(rows, columns) - 1
        if number % 16 == 0:
            yield PAUSE
    return numbers


def _shape(box: Box) -> tuple[int, int, int]:
    x, y, z = (stop - start for start, stop in box)
    return z, y, x


def _bodies_steps(mesh: TriangleMesh) -> Steps[NDArray[np.int32]]:
    """Return the number of every triangle's body, (F,), from 0 on."""
    owner = yield from bodies_steps(Surface(mesh.vertices, mesh.vertices, mesh.faces), 1.0)
    return np.unique(owner, return_inverse=True)[1].astype(np.int32)


def _near_steps(
    volume: Volume, mesh: TriangleMesh, numbers: NDArray[np.int32], origin: tuple[int, int, int]
) -> Steps[NDArray[np.int32]]:
    """Return the component of the nearest of the eight samples around every vertex, (V,); -1 if none has one.

    `numbers` holds the components in a box whose first sample is `origin` (x, y, z).
    """
    near = np.full(len(mesh.vertices), -1, np.int32)
    sides = np.array(volume.spacing) ** 2
    size = np.array(numbers.shape[::-1])
    for start in range(0, len(near), AT_ONCE):
        block = slice(start, start + AT_ONCE)
        at = to_index(volume.affine, mesh.vertices[block]) - origin  # (n, 3)
        low = np.floor(at).astype(np.int64)
        best = np.full(len(at), np.inf)
        for corner in np.ndindex(2, 2, 2):
            index = low + corner
            there = ((index >= 0) & (index < size)).all(axis=1)
            x, y, z = np.where(there[:, None], index, 0).T
            number = np.where(there, numbers[z, y, x], -1)
            square = (at - index) ** 2 * sides
            far = square[:, 0] + square[:, 1] + square[:, 2]
            nearer = (number >= 0) & (far < best)
            near[block][nearer] = number[nearer]
            best[nearer] = far[nearer]
        yield PAUSE
    return near


def _joined_steps(
    runs: LabelComponents, mesh: TriangleMesh, bodies: NDArray[np.int32], near: NDArray[np.int32]
) -> Steps[tuple[LabelComponents, NDArray[np.int32]]]:
    """Join components connected by the surface; return the runs, and each triangle's component (F,), -1 for none.

    A body belongs to the component next to most of its vertices, and a component to the body that has most of the
    vertices next to it.
    """
    count, body_count = len(runs.voxels), int(bodies.max(initial=-1)) + 1
    body_of = components_of_vertices(mesh.faces, bodies, len(near)).astype(np.int64)
    voting = (near >= 0) & (body_of >= 0)
    pair, votes = np.unique(body_of[voting] * count + near[voting], return_counts=True)
    body, component = np.divmod(pair, max(count, 1))
    kept = _with_most(body, votes) | _with_most(component, votes)
    links = np.stack([component[kept], count + body[kept]], axis=1).astype(np.int32)
    root = yield from component_roots_steps(links, count + body_count)
    names, number = np.unique(root[:count], return_inverse=True)
    voxels = np.bincount(number, runs.voxels, len(names)).astype(np.int64)
    joined = replace(
        runs, component=number[runs.component].astype(np.int64), voxels=voxels, label=np.ones(len(names), bool)
    )
    place = np.searchsorted(names, root[count:])
    is_member = (place < len(names)) & (names[np.minimum(place, len(names) - 1)] == root[count:])
    return joined, np.where(is_member, place, -1).astype(np.int32)[bodies]


def _with_most(key: Indices, votes: Indices) -> NDArray[np.bool_]:
    """Return whether each entry has the most votes among those with its key; of equal entries only the first."""
    order = np.lexsort((np.arange(len(key)), -votes, key))
    first = np.concatenate([[True], key[order][1:] != key[order][:-1]])[: len(key)]
    most = np.zeros(len(key), bool)
    most[order[first]] = True
    return most


def _by_size(
    runs: LabelComponents, bodies: NDArray[np.int32], drop: bool
) -> tuple[LabelComponents, NDArray[np.int32], int]:
    """Number components by samples, the largest first; if `drop`, leave out those without triangles and count them."""
    count = len(runs.voxels)
    kept = np.ones(count, bool)
    if drop:
        kept = np.bincount(bodies[bodies >= 0], minlength=count) > 0
    order = np.argsort(-runs.voxels[kept], kind="stable")
    number = np.full(count + 1, -1, np.int64)  # The last entry is for triangles of no component.
    number[np.flatnonzero(kept)[order]] = np.arange(len(order))
    stays = kept[runs.component]
    z, y, start, stop = (along[stays] for along in (runs.z, runs.y, runs.start, runs.stop))
    component = number[runs.component[stays]]
    ordered = LabelComponents(z, y, start, stop, component, runs.voxels[kept][order], runs.label[kept][order])
    return ordered, number[bodies].astype(np.int32), int(count - kept.sum())


def _components_steps(
    volume: Volume, runs: LabelComponents, mesh: TriangleMesh | None, bodies: NDArray[np.int32]
) -> Steps[tuple[Component, ...]]:
    count = len(runs.voxels)
    centers = transform_points(volume.affine, _mean_indices(runs))
    order = np.argsort(bodies, kind="stable")
    ends = np.searchsorted(bodies[order], np.arange(count + 1))
    components = []
    for at in range(count):
        volume_mm3, diameter, closed = float(runs.voxels[at]) * volume.voxel_mm3, None, False
        own = order[ends[at] : ends[at + 1]]
        if mesh is not None and len(own):
            used, corners = np.unique(mesh.faces[np.sort(own)], return_inverse=True)
            vertices = mesh.vertices[used]
            measures = yield from measures_steps(vertices, corners.reshape(-1, 3).astype(np.int32))
            diameter = yield from largest_diameter_steps(vertices)
            closed = measures.closed
            volume_mm3 = measures.volume if closed else volume_mm3
        x, y, z = centers[at].tolist()
        components.append(Component(at + 1, int(runs.voxels[at]), volume_mm3, diameter, (x, y, z), closed))
        yield Step(at / count, "Measuring components")
    return tuple(components)


def _mean_indices(runs: LabelComponents) -> Doubles:
    """Return the mean indices (x, y, z) of the samples of every component, (components, 3); integer sums are exact."""
    length = runs.stop - runs.start
    sums = (length * (runs.start + runs.stop - 1) / 2, length * runs.y, length * runs.z)
    return np.stack([np.bincount(runs.component, each, len(runs.voxels)) for each in sums], axis=1) / np.maximum(
        runs.voxels, 1
    ).reshape(-1, 1)
