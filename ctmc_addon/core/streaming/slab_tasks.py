# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of one surface made by workers that read the same file, some layers of samples each.

Who hands the tasks out, to which machines, is not known here. Parts are grouped as those of one machine are, so the
surface has the same bytes however many workers there are and whatever layers each of them gets.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError
from ..progress import PAUSE, Steps, equal_part
from ..settings import ReconstructionSettings
from ..version import VERSION
from ..volume.region import Box
from ..volume.slabs import SlabVolume
from .field_slabs import FieldSlabs
from .parts import PartMaker
from .slab_parts import SlabPart

TASK_SLABS = 4  # slabs of values (parts.py) in a task, at most
TASKS_PER_WORKER = 4  # at least, so that a lost one costs little and all are busy to the end


@dataclass(frozen=True, eq=False)
class SlabTask:
    """What a worker is to extract.

    Parameters
    ----------
    layers : (low, high) int
        Layers of samples.
    shape, dtype : tuple, str
        Of the volume: a worker that sees another file says so.
    settings, window, threshold
        Of the whole surface.
    normals : bool
    version : str
        Of this package.
    """

    layers: tuple[int, int]
    shape: tuple[int, int, int]
    dtype: str
    settings: ReconstructionSettings
    window: Box
    threshold: float
    normals: bool
    version: str = VERSION


@dataclass(frozen=True, eq=False)
class SlabResult:
    """What a worker has extracted: parts, what their grouping needs, and what it saw of the values."""

    parts: list[SlabPart]
    mixed: list[NDArray[np.intp]]
    seen: tuple[bool, bool]
    wrong_side: int | None


class SlabWorkers(Protocol):
    """Those who extract."""

    @property
    def count(self) -> int:
        """How many there are now."""

    def results(self, tasks: Sequence[SlabTask]) -> Generator[SlabResult | None, None, None]:
        """The results in the order of the tasks, and None while nothing happens."""


def slab_result_steps(volume: SlabVolume, task: SlabTask) -> Steps[SlabResult]:
    """Do a task.

    Raises
    ------
    ReadError
        If the volume or the version is not that of whoever gave the task.
    VolumeError
        For NaN beside the surface.
    """
    if task.version != VERSION:
        raise ReadError(f"a worker has ctmc {VERSION} and not {task.version}; install the same version everywhere")
    if (volume.shape, volume.dtype.str) != (task.shape, task.dtype):
        raise ReadError(
            f"a worker reads {volume.name} as {volume.shape} {volume.dtype} and not as {task.shape} "
            f"{np.dtype(task.dtype)}; give a path at which all see the same files"
        )
    field = FieldSlabs(volume, task.settings, task.window, task.threshold, 1)
    settings = task.settings
    maker = PartMaker(field, field.axes(), float(field.level), task.normals, settings.topology, 1, settings.upper)
    field.counted = counted_slices(maker, task.layers)
    parts: list[SlabPart] = []
    for steps in maker.parts_steps(*task.layers):
        parts += yield from steps
    return SlabResult(parts, maker.mixed, field.seen, field.wrong_side)


def counted_slices(maker: PartMaker, layers: tuple[int, int]) -> tuple[int, int]:
    """The slices that belong to some layers alone: of all tasks together each slice once."""
    z, (low, high) = maker.axes[2], layers
    first = 0 if low == 0 else int(z.index[low])
    return first, maker.values.shape[0] if high == z.count else int(z.index[high])


class DistributedMaker(PartMaker):
    """Has the parts of one surface made by workers."""

    def __init__(self, field: FieldSlabs, normals: bool, topology: str, workers: SlabWorkers) -> None:
        super().__init__(field, field.axes(), float(field.level), normals, topology, 1)
        self.field, self.workers = field, workers

    def parts_steps(self, low: int = 0, high: int | None = None) -> Iterator[Steps[list[SlabPart]]]:
        """Yield, for one task after the other, steps that return its parts."""
        field, layers = self.field, self.axes[2].count if high is None else high
        # Whole slabs of values: parts are then cut where those of one machine are.
        slabs = (layers - low) // (self.height * TASKS_PER_WORKER * max(1, self.workers.count))
        size = self.height * max(1, min(TASK_SLABS, slabs))
        volume = field.volume
        tasks = [
            SlabTask(
                (start, min(start + size, layers)),
                volume.shape,
                volume.dtype.str,
                field.settings,
                field.window,
                field.threshold,
                self.normals,
            )
            for start in range(low, layers, size)
        ]
        results = self.workers.results(tasks)
        try:
            for number in range(len(tasks)):
                yield equal_part(self._next_steps(results), number, len(tasks))
        finally:
            results.close()

    def _next_steps(self, results: Iterator[SlabResult | None]) -> Steps[list[SlabPart]]:
        while (result := next(results)) is None:
            yield PAUSE
        self.mixed += result.mixed
        self.field.add_seen(result.seen, result.wrong_side)
        return result.parts
