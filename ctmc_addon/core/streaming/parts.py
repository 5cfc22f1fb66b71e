# SPDX-License-Identifier: GPL-3.0-or-later
"""Extract the parts of a surface as the values come, a slab of slices at a time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..extraction.active_voxels import Slab
from ..extraction.classify import inside_bits
from ..extraction.gradients import Sampler
from ..extraction.grid import WORD, Axis, Grid
from ..extraction.marching_cubes import Counts, fill_vertices
from ..extraction.scan import MIXED_ROWS, SCAN_STAGES, mixed_words, scan_steps, slab_ranges
from ..extraction.vertices import VertexArrays
from ..memory import require_or_killed
from ..parallel import map_steps
from ..progress import Stages, Step, Steps, equal_part
from .slab_parts import SlabPart

SLAB_BYTES = 1 << 23  # of values fetched at once, or those of one layer of samples
WORK_BYTES, WORK_FACTOR = 32 << 20, 4  # of memory while a slab is extracted: these and so many times its values
KEPT_SLICES = 3  # that two slabs share at most: the layer between them, and one to either side for normals
ENDS: tuple[float | None, ...] = (0.0, None)  # of alpha: the midpoint, and the linear crossing itself
PLACING, COUNTING = "Placing vertices", "Counting triangles"
STAGES = SCAN_STAGES | {PLACING: 4.0}


class SlabValues(Protocol):
    """Values that are fetched some slices at a time, first to last."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """(slices, rows, columns)."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the values."""

    @property
    def skips_slices(self) -> bool:
        """Whether slices that are not sampled need not be fetched."""

    def slices_steps(self, numbers: list[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""


@dataclass(eq=False)
class PartMaker:
    """Makes the parts of one surface.

    Parameters
    ----------
    values : SlabValues
    axes : (x, y, z) Axis
        The samples, in the values.
    level : float
        Inside is ``value >= level``.
    normals : bool
    topology : str
    threads : int
    upper : float or None
        Inside is ``level <= value <= upper`` where it is given.

    Attributes
    ----------
    mixed : list of (n,) intp
        Of the layers done, what `slab_ranges` asks for.
    """

    values: SlabValues
    axes: tuple[Axis, Axis, Axis]
    level: float
    normals: bool
    topology: str
    threads: int
    upper: float | None = None

    def __post_init__(self) -> None:
        self.mixed: list[NDArray[np.intp]] = []
        self._kept_numbers = np.empty(0, np.intp)
        self._kept = np.empty((0, *self.values.shape[1:]), self.values.dtype)
        x, _, z = self.axes
        slice_bytes = int(np.prod(self.values.shape[1:], dtype=np.int64)) * self.values.dtype.itemsize
        # The same with and without normals: simplification of a part at a time depends on where parts end.
        self.height = max(1, SLAB_BYTES // (z.stride * slice_bytes))
        self.words = -(-x.count // WORD)

    def ranges(self) -> list[tuple[int, int]]:
        """The ranges of layers in which the whole surface is numbered; to be asked when all layers are done."""
        return slab_ranges(np.concatenate(self.mixed), (self.axes[1].count + 1) * self.words)

    def parts_steps(self, low: int = 0, high: int | None = None) -> Iterator[Steps[list[SlabPart]]]:
        """Yield, for one slab of values after the other, steps that return its parts; of all layers, or of some."""
        layers = self.axes[2].count if high is None else high
        starts = range(low, layers, self.height)
        for number, start in enumerate(starts):
            steps = self.layers_steps(start, min(start + self.height, layers))
            yield equal_part(steps, number, len(starts))

    def ranges_steps(self) -> Steps[list[tuple[int, int]]]:
        """`ranges` alone, before any part is made: from every sixteenth row of the samples."""
        _, y, z = self.axes
        layers, normals = z.count, self.normals
        self.normals = False  # which would fetch more slices
        rows = np.minimum(np.arange(0, y.count + 1, MIXED_ROWS), y.count - 1)
        rough = replace(y, position=y.position[rows], index=y.index[rows], stride=MIXED_ROWS * y.stride)
        mixed = []
        for low in range(0, layers, self.height):
            yield Step(low / layers)
            grid = replace((yield from self._grid_steps(low, min(low + self.height, layers))), y=rough)
            bits = np.zeros((grid.z.count + 1, len(rows) + 1, grid.words), np.uint64)
            inside_bits(grid, self.level, 0, grid.layers, bits)
            mixed.append(mixed_words(bits[: grid.layers, :-1]))
        self.normals, self.mixed = normals, mixed
        return self.ranges()

    def counts_steps(self) -> Steps[Counts]:
        """What `count_steps` returns of all layers."""
        active = vertices = faces = 0
        layers = self.axes[2].count
        self.normals = False  # which would fetch more slices
        for low in range(0, layers, self.height):
            yield Step(low / layers, COUNTING)
            grid = yield from self._grid_steps(low, min(low + self.height, layers))
            slabs, _ = yield from scan_steps(Stages(SCAN_STAGES), grid, self.level, self.threads, self.topology)
            active += sum(int(slab.is_cell.sum()) for slab in slabs)
            vertices += sum(slab.vertex_count for slab in slabs)
            faces += sum(slab.face_count for slab in slabs)
        return Counts(math.prod(axis.voxels for axis in self.axes), active, vertices, faces)

    def layers_steps(self, low: int, high: int) -> Steps[list[SlabPart]]:
        """The parts of the sample layers `low` to `high`, and what `ranges` asks of them at the end of `mixed`."""
        grid = yield from self._grid_steps(low, high)
        stages = Stages(STAGES)
        slabs, mixed = yield from scan_steps(stages, grid, self.level, self.threads, self.topology)
        self.mixed.append(mixed)
        sampler = Sampler(grid.values, grid.first_slice, grid.slices)

        def place(slab: Slab) -> SlabPart:
            vectors = tuple(np.empty((slab.vertex_count, 3), np.float32) for _ in range(2 + self.normals))
            out = VertexArrays(ENDS, vectors[:2], vectors[2] if self.normals else None)
            fill_vertices(grid, sampler, self.level, slab, out)
            return SlabPart(replace(slab, low=slab.low + low, high=slab.high + low), vectors)

        return (yield from stages.run(PLACING, map_steps(place, slabs, self.threads)))

    def _grid_steps(self, low: int, high: int) -> Steps[Grid]:
        """The samples of the layers `low` to `high`, with the layer on top and what normals read beyond."""
        layer_bytes = int(np.prod(self.values.shape[1:], dtype=np.int64)) * self.values.dtype.itemsize
        x, y, z = self.axes
        at_work = WORK_BYTES + WORK_FACTOR * ((high - low) * z.stride + 1) * layer_bytes
        require_or_killed(at_work, "extracting a slab of this volume", "choose a region, or give it more memory")
        part, slices = z.part(low, min(high + 1, z.count)), self.values.shape[0]
        continues = high < z.count
        if self.normals or z.stride == 1 or not self.values.skips_slices:
            margin = int(self.normals)
            first = max(0, int(part.index[0]) - margin)
            numbers = np.arange(first, min(slices, int(part.index[-1]) + 1 + margin))
            values = yield from self._values_steps(numbers)
            return Grid(values, x, y, part, first, slices, continues, self.upper)
        # Only the slices that are sampled: the values are then those slices one after the other.
        numbers, index = np.unique(part.index, return_inverse=True)
        values = yield from self._values_steps(numbers)
        return Grid(values, x, y, replace(part, index=index.reshape(-1)), continues=continues, upper=self.upper)

    def _values_steps(self, numbers: NDArray[np.intp]) -> Steps[NDArray[Any]]:
        """The values of some slices, of which those that the last slab ended with are not fetched again."""
        kept = self._kept[np.isin(self._kept_numbers, numbers)]
        values = yield from self.values.slices_steps(numbers[len(kept) :].tolist())
        if len(kept):
            values = np.concatenate([kept, values])
        self._kept_numbers, self._kept = numbers[-KEPT_SLICES:], values[-KEPT_SLICES:].copy()
        return values
