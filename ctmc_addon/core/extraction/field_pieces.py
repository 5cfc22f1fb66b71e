# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface of a field, slab by slab: a piece is what a slab gave, in RAS+ mm and with both ends of alpha.

A field that is held in memory is one slab. Pieces one after the other are the whole surface: vertices and triangles
stand in an order that no cut changes (order.py), and what a triangle needs of the next piece are numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...version import VERSION
from ..errors import ReadError
from ..machine.budget import Budget
from ..machine.memory import require_or_killed
from ..mesh.face_normals import vertex_normals
from ..mesh.pieces.completed_pieces import with_next_steps
from ..mesh.triangle_mesh import Pieces, Surface
from ..progress import PAUSE, Stages, Step, Steps, WithResult
from ..settings import ReconstructionSettings
from ..smoothing.prepare import field_steps
from ..volume.affine import transform_faces, transform_normals, transform_points
from ..volume.field import ScalarField
from ..volume.volume import Box, Volume
from .grid import Grid, layers_in_unit, make_axes
from .marching_cubes import Counts, piece_steps
from .scan import SCAN_STAGES, scan_steps

# Extracting a slab takes these bytes and this many times the bytes of its values.
WORK_BYTES, WORK_FACTOR = 32 << 20, 4
KEPT_SLICES = 3  # Two slabs share at most this many slices: the layer between them, and one to either side for normals.
GOLDEN_RATIO = (math.sqrt(5.0) - 1.0) / 2.0
COPIED_BYTES = 32 << 20  # Copy this many bytes of slices between two steps.
POINTS_AT_ONCE = 1 << 16  # Move this many points to millimeters in one go, so that the float64 in between stays small.
TASK_SLABS = 4  # A task of a worker has at most this many slabs.
TASKS_PER_WORKER = 4  # A worker gets at least this many tasks: a lost one costs little, and all are busy to the end.
EXTRACTING, COUNTING = "Extracting the surface", "Counting triangles"


@dataclass(frozen=True, eq=False)
class SlabTask:
    """The slabs of a surface that one worker extracts.

    Parameters
    ----------
    layers : (low, high) int
        Layers of samples.
    shape, dtype : tuple, str
        Fingerprint of the volume, by which a worker notices that it reads another file.
    settings, window
        Settings and window of the whole surface; the settings have its threshold.
    normals : bool
    slab_bytes : int
        As in `Budget`.
    version : str
        Version of this package.
    """

    layers: tuple[int, int]
    shape: tuple[int, int, int]
    dtype: str
    settings: ReconstructionSettings
    window: Box
    normals: bool
    slab_bytes: int
    version: str = VERSION


@dataclass(frozen=True, eq=False)
class SlabResult:
    """Pieces that a worker has extracted, and the samples of a label that it saw on the wrong side."""

    pieces: list[Surface]
    wrong_side: int


class FieldSlabs:
    """The slabs of a field, fetched from the first to the last.

    Parameters
    ----------
    field : ScalarField
    budget : Budget
    normals : bool
        Whether pieces have the normals of the values' gradient.
    joined : bool
        Whether the pieces are to be one surface: what is held is then one slab.
    """

    def __init__(self, field: ScalarField, budget: Budget, normals: bool, joined: bool = False) -> None:
        self.field, self.budget, self.normals, self.joined = field, budget, normals, joined
        self.values, settings = field.values, field.settings
        self.axes = make_axes(field.window_in_values, settings.stride, settings.close_border)
        self._kept_numbers = np.empty(0, np.intp)
        self._kept = np.empty((0, *self.values.shape[1:]), self.values.dtype)

    @property
    def slice_bytes(self) -> int:
        """Bytes of a slice."""
        return math.prod(self.values.shape[1:]) * self.values.dtype.itemsize

    @property
    def height(self) -> int:
        """Layers of samples in a slab, whole units."""
        x, y, z = self.axes
        if self.joined and self.values.held:
            return z.count
        unit = layers_in_unit(x, y, z)
        return max(1, self.budget.slab_bytes // (z.stride * self.slice_bytes * unit)) * unit

    def ranges(self, low: int = 0, high: int | None = None) -> list[tuple[int, int]]:
        """The layers of each slab, first and end; of all layers, or of some."""
        end = self.axes[2].count if high is None else high
        return [(start, min(start + self.height, end)) for start in range(low, end, self.height)]

    def pieces_steps(self, low: int = 0, high: int | None = None) -> Pieces:
        """Yield the pieces of the slabs in index space, and steps between."""
        surface = self.field.surface
        if surface is not None and not self.normals and (low, high) == (0, None):
            yield PAUSE
            yield Surface(surface.midpoints.copy(), surface.linear.copy(), surface.faces)
            return self.field.wrong_side
        ranges, level = self.ranges(low, high), float(self.field.level)
        stages = Stages(dict.fromkeys(map(str, range(len(ranges))), 1))
        for number, layers in enumerate(ranges):
            grid = yield from self._grid_steps(*layers)
            making = piece_steps(grid, level, self.normals, self.budget, self.field.settings.topology)
            yield (yield from stages.run(str(number), making))
        return self.field.wrong_side

    def counts_steps(self, most_slabs: int | None = None) -> Steps[Counts]:
        """Count active voxels, vertices and triangles by the first two passes only.

        Parameters
        ----------
        most_slabs : int, optional
            Count in no more slabs than these, and take the others to be like them; without it the numbers are exact.
        """
        active = vertices = faces = 0
        ranges, settings = self.ranges(), self.field.settings
        share = 1.0
        if most_slabs is not None and len(ranges) > most_slabs:
            # Steps of the golden ratio meet no period of the volume.
            numbers = {int(number * GOLDEN_RATIO % 1.0 * len(ranges)) for number in range(most_slabs)}
            share = len(numbers) / len(ranges)
            ranges = [ranges[number] for number in sorted(numbers)]
        for number, layers in enumerate(ranges):
            yield Step(number / len(ranges), COUNTING)
            grid = yield from self._grid_steps(*layers)
            threads = self.budget.thread_count
            scanning = scan_steps(Stages(SCAN_STAGES), grid, float(self.field.level), threads, settings.topology)
            slabs, _ = yield from scanning
            active += sum(slab.cell_count for slab in slabs)
            vertices += sum(slab.vertex_count for slab in slabs)
            faces += sum(slab.face_count for slab in slabs)
        active, vertices, faces = (round(counted / share) for counted in (active, vertices, faces))
        voxels = math.prod(axis.voxels for axis in self.axes)
        return Counts(voxels, active, vertices, faces, share == 1.0, self.axes[2].voxels)

    def _grid_steps(self, low: int, high: int) -> Steps[Grid]:
        """Return the samples of the layers `low` to `high`, with the layer on top and the slices that normals read."""
        x, y, z = self.axes
        part, slices = z.part(low, min(high + 1, z.count)), self.values.shape[0]
        upper, continues = self.field.settings.upper, high < z.count
        if not self.values.held:
            at_work = WORK_BYTES + WORK_FACTOR * ((high - low) * z.stride + 1) * self.slice_bytes
            require_or_killed(at_work, "extracting a slab of this volume", "choose a region, or give it more memory")
        elif (low, high) == (0, z.count):
            values = yield from self.values.slices_steps(range(slices))
            return Grid(values, x, y, z, upper=upper)
        if self.normals or z.stride == 1 or not self.values.skips_slices:
            margin = int(self.normals)
            first = max(0, int(part.index[0]) - margin)
            numbers = np.arange(first, min(slices, int(part.index[-1]) + 1 + margin))
            values = yield from self._values_steps(numbers)
            return Grid(values, x, y, part, first, slices, continues, upper)
        # Only the slices that are sampled: the values are then those slices one after the other.
        numbers, index = np.unique(part.index, return_inverse=True)
        values = yield from self._values_steps(numbers)
        return Grid(values, x, y, replace(part, index=index.reshape(-1)), continues=continues, upper=upper)

    def _values_steps(self, numbers: NDArray[np.intp]) -> Steps[NDArray[np.generic]]:
        """Return the values of some slices, of which those that the last slab ended with are not fetched again."""
        if self.values.held:
            return (yield from self.values.slices_steps(numbers.tolist()))
        kept = self._kept[np.isin(self._kept_numbers, numbers)]
        values = yield from self.values.slices_steps(numbers[len(kept) :].tolist())
        if len(kept):
            values = yield from _joined_steps(kept, values)
        self._kept_numbers, self._kept = numbers[-KEPT_SLICES:], values[-KEPT_SLICES:].copy()
        return values


def _joined_steps(first: NDArray[np.generic], then: NDArray[np.generic]) -> Steps[NDArray[np.generic]]:
    """Return slices one after the other; a slab of a large volume takes a second to copy."""
    joined = np.empty((len(first) + len(then), *then.shape[1:]), then.dtype)
    joined[: len(first)] = first
    at_once = max(1, COPIED_BYTES * len(then) // max(1, then.nbytes))
    for start in range(0, len(then), at_once):
        yield PAUSE
        joined[len(first) + start : len(first) + start + at_once] = then[start : start + at_once]
    return joined


class _WorkerSlabs(FieldSlabs):
    """The slabs of a field, extracted by workers that read the same file, some layers each."""

    def pieces_steps(self, low: int = 0, high: int | None = None) -> Pieces:
        """Yield the pieces of the slabs in index space, and steps between."""
        workers, volume = self.budget.workers, self.field.volume
        assert workers is not None
        layers = self.axes[2].count if high is None else high
        slabs = (layers - low) // (self.height * TASKS_PER_WORKER * max(1, workers.count))
        size = self.height * max(1, min(TASK_SLABS, slabs))
        settings, box = self.field.settings, self.field.whole
        whole = (box, volume.dtype.str)
        if settings.label is None:
            settings = replace(settings, threshold=self.field.threshold)  # which may be Otsu's
        tasks = [
            SlabTask(
                (start, min(start + size, layers)),
                *whole,
                settings,
                self.field.window,
                self.normals,
                self.budget.slab_bytes,
            )
            for start in range(low, layers, size)
        ]
        results = workers.results(tasks)
        wrong_side = 0
        try:
            for number in range(len(tasks)):
                while (result := next(results)) is None:
                    yield Step(number / len(tasks))
                wrong_side += result.wrong_side
                yield from result.pieces
        finally:
            results.close()
        return None if self.field.settings.label is None else wrong_side


def slab_result_steps(volume: Volume, task: SlabTask) -> Steps[SlabResult]:
    """Extract the slabs of a task.

    Raises
    ------
    ReadError
        If the volume or the version is not that of whoever gave the task.
    VolumeError
        If NaN lies next to the surface.
    """
    if task.version != VERSION:
        raise ReadError(f"a worker has ctmc {VERSION} and not {task.version}; install the same version everywhere")
    if (volume.shape, volume.dtype.str) != (task.shape, task.dtype):
        raise ReadError(
            f"a worker reads {volume.name} as {volume.shape} {volume.dtype} and not as {task.shape} "
            f"{np.dtype(task.dtype)}; give a path at which all see the same files"
        )
    budget = Budget(threads=1, slab_bytes=task.slab_bytes)
    field = yield from field_steps(volume, task.settings, budget, task.window)
    slabs = FieldSlabs(field, budget, task.normals)
    z, (low, high) = slabs.axes[2], task.layers
    first = 0 if low == 0 else int(z.index[low])
    last = field.values.shape[0] if high == z.count else int(z.index[high])
    field.values.count_within(first, last)  # all tasks together count each slice once
    pieces = []
    for item in slabs.pieces_steps(*task.layers):
        if isinstance(item, Step):
            yield item
        else:
            pieces.append(item)
    return SlabResult(pieces, field.values.wrong_side)


def surface_pieces_steps(field: ScalarField, budget: Budget, normals: bool, joined: bool = False) -> Pieces:
    """Yield the pieces of a field's surface in RAS+ mm, from the first to the last, and steps between.

    Parameters
    ----------
    field : ScalarField
    budget : Budget
    normals : bool
        Whether pieces have normals: those of the values' gradient, and of the mesh where that vanishes or on a cap.
    joined : bool
        Whether the pieces are to be one surface: of a field that is held there is one piece then.

    Raises
    ------
    ThresholdError, LabelError, VolumeError, MeshError, MemoryLimitError
    """
    field = field.again()
    slabs = (_WorkerSlabs if budget.workers is not None else FieldSlabs)(field, budget, normals, joined)
    faces = 0
    pieces = slabs.pieces_steps()
    source = WithResult(_completed_normals_steps(pieces) if normals else pieces)
    for item in source:
        if isinstance(item, Surface):
            faces += len(item.faces)
            item = yield from _in_patient_steps(item, field.affine)
        yield item
    if not faces:
        yield from field.check_extracted_steps()
    field.check_closed()
    return source.result


def _completed_normals_steps(pieces: Pieces) -> Pieces:
    """Yield the pieces with the mesh's own normal at every vertex that has none, as soon as the next piece has come."""
    below = _Seam(np.empty((0, 3, 3), np.float32), np.empty((0, 3), np.int32))
    source = WithResult(with_next_steps(pieces))
    for item in source:
        if isinstance(item, Step):
            yield item
            continue
        piece, following = item
        _complete_normals(piece, below, following)
        if following is not None:
            below = _Seam.below(piece, following)
        yield piece
        del item, piece, following  # No piece is held while the next one is made.
    return source.result


class _Seam(NamedTuple):
    """The triangles of a piece that reach into the next one."""

    corners: NDArray[np.float32]  # (f, 3, 3)
    numbers: NDArray[np.int32]  # (f, 3), of the next piece's vertices; below zero for others

    @classmethod
    def below(cls, piece: Surface, following: Surface) -> _Seam:
        """Return the triangles of a piece that reach into the next one; kept, as pieces are moved where they are."""
        own = len(piece.linear)
        numbers = piece.faces[(piece.faces >= own).any(axis=1)] - np.int32(own)
        corners = np.where(
            (numbers < 0)[..., None],
            piece.linear.take(numbers + own, axis=0, mode="clip"),
            following.linear.take(numbers, axis=0, mode="clip"),
        )
        return cls(corners, numbers)


def _complete_normals(piece: Surface, below: _Seam, following: Surface | None) -> None:
    normals, own = piece.normals, len(piece.linear)
    assert normals is not None
    zero = np.flatnonzero(normals[:, 0] == 0)
    zero = zero[normals[zero, 1] == 0]
    zero = zero[normals[zero, 2] == 0]
    if not zero.size:
        return
    points = [piece.linear, *([] if following is None else [following.linear])]
    beyond = sum(map(len, points))
    next_numbers = np.arange(beyond, beyond + below.numbers.size, dtype=np.int32).reshape(below.numbers.shape)
    around = np.concatenate([*points, below.corners.reshape(-1, 3)])
    triangles = np.concatenate([np.where(below.numbers < 0, next_numbers, below.numbers), piece.faces])
    missing = np.zeros(len(around), bool)
    missing[:own][zero] = True
    touched = missing.take(triangles[:, 0]) | missing.take(triangles[:, 1]) | missing.take(triangles[:, 2])
    normals[zero] = vertex_normals(around, triangles[touched])[zero]


def _in_patient_steps(piece: Surface, affine: NDArray[np.float64]) -> Steps[Surface]:
    """Move a piece from index space to RAS+ mm, its arrays in place."""
    faces = transform_faces(affine, piece.faces)
    moves: list[tuple[NDArray[np.float32] | None, Callable[..., NDArray[Any]]]] = [
        (piece.midpoints, transform_points),
        (piece.linear, transform_points),
        (piece.normals, transform_normals),
    ]
    for vectors, transform in moves:
        if vectors is None:
            continue
        for start in range(0, len(vectors), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            vectors[part] = transform(affine, vectors[part])
            yield PAUSE
    return Surface(piece.midpoints, piece.linear, faces, piece.normals)
