"""A coarse surface that follows a slider, and a finer one when the hand rests.

The volume is thinned out once for each stride (every second, fourth... sample along the axes whose samples lie
closest), and only the thin copy is looked at while a slider moves. How fine it may be is learnt from how long the last
one took. Surfaces are in RAS+ mm; the last, partial voxel of a stride is left out, as this is only a preview.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .errors import CtmcError, LabelError
from .mesh.triangle_mesh import Surface
from .pipeline import full_steps
from .progress import Steps, finish
from .settings import ReconstructionSettings
from .volume.region import region_box
from .volume.volume import Volume

FIRST_PACE = 8e-8  # seconds a voxel, before anything has been measured: slow on purpose
FINER = 12.0  # how many times the budget a refined surface may take; it can be stopped at any step
GROWTH = 0.75  # the time grows with the number of voxels to about this power: between a surface's and a volume's
CAUTION = 0.7  # of the budget is aimed at: the last surface may have been an easy one
FEWEST = 8  # samples along an axis
Stride = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Shown:
    """A surface to show: both ends of alpha, RAS+ mm, and the stride and seconds it took."""

    surface: Surface
    stride: Stride
    seconds: float


class Preview:
    """Surfaces of one volume, quickly.

    Parameters
    ----------
    volume : Volume
    budget : float
        Seconds that `follow` may take.
    otsu : float, optional
        Threshold for settings that give neither threshold nor label.
    threads, memory_limit : int, optional
        As in `reconstruct`.
    """

    def __init__(
        self,
        volume: Volume,
        budget: float = 0.1,
        otsu: float | None = None,
        threads: int | None = None,
        memory_limit: int | None = None,
    ) -> None:
        self.volume, self.budget, self.otsu = volume, budget, otsu
        self.threads, self.memory_limit = threads, memory_limit
        self.thin: dict[tuple[object, ...], Volume] = {}
        self.last: tuple[int, float] | None = None  # voxels and seconds of the last surface

    def follow(self, settings: ReconstructionSettings) -> Shown | None:
        """The finest surface that stays within the budget; None where there is none at these settings."""
        return finish(self.refine_steps(settings, self.budget * CAUTION))

    def refine_steps(self, settings: ReconstructionSettings, seconds: float | None = None) -> Steps[Shown | None]:
        """The finest surface within `seconds` (by default `FINER` budgets), as steps."""
        limit = self.budget * FINER if seconds is None else seconds
        box = region_box(self.volume, settings)
        ladder = strides(self.volume, settings.stride, box_size(box))
        rung = next((at for at, one in enumerate(ladder) if self.expected(one, box) <= limit), len(ladder) - 1)
        while True:
            try:
                return (yield from self._surface(settings, ladder[rung], box))
            except LabelError:
                if rung == 0:  # not even at full resolution
                    return None
                rung = max(0, rung - 3)  # too small for so wide a mesh
            except CtmcError:
                return None

    def expected(self, stride: Stride, box: tuple[tuple[int, int], ...]) -> float:
        """Seconds that a surface at this stride will take, from the last one."""
        voxels = voxels_of(stride, box)
        if self.last is None:
            return voxels * FIRST_PACE
        before, seconds = self.last
        return float(seconds * (voxels / before) ** GROWTH)

    def _surface(
        self, settings: ReconstructionSettings, stride: Stride, box: tuple[tuple[int, int], ...]
    ) -> Steps[Shown]:
        key = (stride, box)
        if key not in self.thin:
            self.thin = {key: thinned(self.volume, stride, box)} | dict(list(self.thin.items())[:2])
        plain = replace(
            settings,
            stride=(1, 1, 1),
            region=None,
            simplifier="none",
            reduction=None,
            target_faces=None,
            max_error_mm=None,
            topology="classic",
            threshold=self.otsu if settings.threshold is None and settings.label is None else settings.threshold,
        )
        start = time.perf_counter()
        found = yield from full_steps(self.thin[key], plain, self.threads, self.memory_limit)
        seconds = time.perf_counter() - start
        self.last = (voxels_of(stride, box), seconds)
        assert found.surface is not None, "nothing has been simplified"
        return Shown(found.surface, stride, seconds)


def box_size(box: tuple[tuple[int, int], ...]) -> tuple[int, ...]:
    """Samples of a box along x, y and z."""
    return tuple(stop - start for start, stop in box)


def voxels_of(stride: Stride, box: tuple[tuple[int, int], ...]) -> int:
    """How many samples of a box remain under a stride."""
    return int(np.prod([-(-size // step) for size, step in zip(box_size(box), stride, strict=True)]))


def strides(volume: Volume, finest: Stride, size: tuple[int, ...]) -> list[Stride]:
    """Strides from the settings' own to coarser ones, each doubling the axis whose samples lie closest.

    Examples
    --------
    >>> strides(Volume(np.zeros((20, 40, 40)), np.diag([1.0, 1.0, 2.0, 1.0])), (1, 1, 1), (40, 40, 20))
    [(1, 1, 1), (2, 1, 1), (2, 2, 1), (4, 2, 1), (4, 4, 1), (4, 4, 2)]
    """
    ladder = [finest]
    while True:
        last = ladder[-1]
        free = [axis for axis in range(3) if size[axis] // (2 * last[axis]) >= FEWEST]
        if not free:
            return ladder
        axis = min(free, key=lambda one: (last[one] * volume.spacing[one], one))
        wider = list(last)
        wider[axis] *= 2
        ladder.append((wider[0], wider[1], wider[2]))


def thinned(volume: Volume, stride: Stride, box: tuple[tuple[int, int], ...]) -> Volume:
    """Every so many samples of a box of a volume, at their places; a copy that lies close in memory."""
    low, high = zip(*box, strict=True)
    part = volume.cropped(low, high)
    values: NDArray[np.generic] = part.values[tuple(slice(None, None, step) for step in stride[::-1])]
    affine = part.affine.copy()
    affine[:3, :3] *= np.array(stride, np.float64)
    same = stride == (1, 1, 1)
    return Volume(values if same else np.ascontiguousarray(values), affine, (), volume.name, volume.kind)
