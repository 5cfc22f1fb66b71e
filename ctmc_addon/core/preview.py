# SPDX-License-Identifier: GPL-3.0-or-later
"""A coarse surface while a slider moves, and a finer one when the hand is idle.

The volume is subsampled once for each stride (every second, fourth... sample along the axes whose samples lie
closest), and only this small copy is extracted from while a slider moves. How fine it may be follows from the time of
the last surface. Surfaces are in RAS+ mm; the last, partial voxel of a stride is left out, as this is only a preview.
The finest surface of a label that is smoothed all at once is the reconstruction's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import CtmcError, LabelError
from .machine.budget import Budget
from .mesh.triangle_mesh import Surface
from .progress import Steps, finish, timed_steps
from .settings import ALPHA, SIMPLIFICATION, ReconstructionSettings, settings_of_stage
from .smoothing.methods import refinement_of, smoothing_of
from .surfaces.extract import full_steps
from .volume.region import region_box
from .volume.statistics.thresholding import quick_threshold, used_threshold_steps
from .volume.volume import Box, Volume

REFINED = 12.0  # A refined surface may take this many budgets; it can be stopped at any step.
GROWTH = 0.75  # The time grows with the number of voxels to about this power: between a surface's and a volume's.
SAFETY_FACTOR = 0.7  # Plan this share of the budget: the last surface may have been an easy one.
FEWEST_SAMPLES = 8  # Keep at least this many samples along an axis.
LEAVE_IT = {*settings_of_stage(ALPHA), *settings_of_stage(SIMPLIFICATION)}
"""Settings that leave a preview as it is: it is the full surface, with both ends of alpha."""
Stride = tuple[int, int, int]


class _Rung(NamedTuple):
    """Coarseness of a surface: stride, and steps from slice to slice; the settings' own by default."""

    stride: Stride
    slice_steps: int
    as_set: bool = False


@dataclass(frozen=True, eq=False)
class PreviewResult:
    """A surface to show: both ends of alpha, RAS+ mm, and the stride and seconds it took."""

    surface: Surface
    stride: Stride
    seconds: float


class Preview:
    """Quick surfaces of one volume.

    Parameters
    ----------
    volume : Volume
    budget : float
        Seconds that `interactive` may take.
    limits : Budget, optional
        As in `reconstruct`.
    """

    def __init__(self, volume: Volume, budget: float = 0.1, limits: Budget | None = None) -> None:
        self.volume, self.budget, self.limits = volume, budget, limits or Budget()
        self.subsampled: dict[tuple[object, ...], Volume] = {}
        self.last: dict[str, tuple[int, float]] = {}  # voxels and seconds of the last surface of every smoothing
        self.threshold: float | None = None  # of the last surface

    def interactive(self, settings: ReconstructionSettings) -> PreviewResult | None:
        """Return the finest surface that stays within the budget; None if the settings give none.

        None too where Otsu's threshold of many samples is needed and none is known of another region: counting them
        takes longer than a slider may wait, and `refine_steps` does it.
        """
        try:
            threshold = quick_threshold(self.volume, settings)
        except CtmcError:
            return None
        if threshold is None:
            threshold = self.threshold  # of another region, until Otsu's of this one is known
        if threshold is None:
            return None
        return finish(self.refine_steps(settings, self.budget * SAFETY_FACTOR, threshold))

    def refine_steps(
        self, settings: ReconstructionSettings, seconds: float | None = None, threshold: float | None = None
    ) -> Steps[PreviewResult | None]:
        """Return the finest surface within `seconds` (by default `REFINED` budgets), at the settings' threshold."""
        limit = self.budget * REFINED if seconds is None else seconds
        box = region_box(self.volume, settings)
        ladder = rungs(self.volume, settings, _box_size(box))
        fitting = (at for at, rung in enumerate(ladder) if self.expected(settings, rung, box) <= limit)
        rung = next(fitting, len(ladder) - 1)
        while True:
            try:
                if threshold is None:
                    threshold = yield from used_threshold_steps(self.volume, settings)
                return (yield from self._surface_steps(settings, threshold, ladder[rung], box))
            except LabelError:
                if rung == 0:  # not even at full resolution
                    return None
                rung = max(0, rung - 3)  # too small for so wide a stride
            except CtmcError:
                return None

    def expected(self, settings: ReconstructionSettings, rung: _Rung, box: Box) -> float:
        """Return the seconds that a surface will take, from the last one."""
        voxels = voxel_count(rung, box)
        if settings.smoothing_method not in self.last:
            return voxels * smoothing_of(settings).voxel_seconds
        before, seconds = self.last[settings.smoothing_method]
        return float(seconds * (voxels / before) ** GROWTH)

    def _surface_steps(
        self, settings: ReconstructionSettings, threshold: float, rung: _Rung, box: Box
    ) -> Steps[PreviewResult]:
        volume = self.volume
        plain = replace(
            settings.without(SIMPLIFICATION),
            topology="classic",
            threshold=threshold if settings.label is None else None,
        )
        if not rung.as_set:
            key = (rung.stride, box)
            if key not in self.subsampled:
                small = subsample(volume, rung.stride, box)
                self.subsampled = {key: small} | dict(list(self.subsampled.items())[:2])
            volume = self.subsampled[key]
            plain = replace(plain, stride=(1, 1, 1), slice_steps=rung.slice_steps, region=None)
        work = full_steps(volume, plain, self.limits)
        result, seconds = yield from timed_steps(work)
        self.last[settings.smoothing_method], self.threshold = (voxel_count(rung, box), seconds), threshold
        assert result.surface is not None, "nothing has been simplified"
        return PreviewResult(result.surface, rung.stride, seconds)


def _box_size(box: Box) -> tuple[int, ...]:
    """Return the samples of a box along x, y and z."""
    return tuple(stop - start for start, stop in box)


def voxel_count(rung: _Rung, box: Box) -> int:
    """Return how many samples of a box are worked on, those between slices among them."""
    stride = (1, 1, 1) if rung.as_set else rung.stride
    return rung.slice_steps * int(
        np.prod([-(-size // step) for size, step in zip(_box_size(box), stride, strict=True)])
    )


def rungs(volume: Volume, settings: ReconstructionSettings, size: tuple[int, ...]) -> list[_Rung]:
    """Return how coarse a surface may be, the finest first.

    A label that is smoothed all at once is first the reconstruction's own, then gets fewer steps between its
    slices, of which stride z counts, and only then fewer samples.

    Examples
    --------
    >>> thick = Volume(np.zeros((20, 40, 40), np.uint8), np.diag([1.0, 1.0, 8.0, 1.0]))
    >>> ladder = rungs(thick, ReconstructionSettings(label=1), (40, 40, 20))
    >>> [(rung.stride, rung.slice_steps) for rung in ladder[:4]]
    [((1, 1, 1), 4), ((1, 1, 1), 2), ((1, 1, 1), 1), ((2, 1, 1), 1)]
    """
    if smoothing_of(settings).by_slabs:
        return [_Rung(stride, 1) for stride in strides(volume, settings.stride, size)]
    most = refinement_of(volume.spacing, settings)
    x, y, z = settings.stride
    ladder = [_Rung(settings.stride, most, as_set=True)]
    coarser = strides(volume, (x, y, max(1, z // most)), size)
    steps = max(1, most // z)
    while steps:
        if (coarser[0], steps) != ((1, 1, 1), most):
            ladder.append(_Rung(coarser[0], steps))
        steps //= 2
    return ladder + [_Rung(stride, 1) for stride in coarser[1:]]


def strides(volume: Volume, finest: Stride, size: tuple[int, ...]) -> list[Stride]:
    """Return strides from the settings' own to coarser ones, each doubling the axis whose samples lie closest.

    Examples
    --------
    >>> strides(Volume(np.zeros((20, 40, 40)), np.diag([1.0, 1.0, 2.0, 1.0])), (1, 1, 1), (40, 40, 20))
    [(1, 1, 1), (2, 1, 1), (2, 2, 1), (4, 2, 1), (4, 4, 1), (4, 4, 2)]
    """
    ladder = [finest]
    while True:
        last = ladder[-1]
        free = [axis for axis in range(3) if size[axis] // (2 * last[axis]) >= FEWEST_SAMPLES]
        if not free:
            return ladder
        axis = min(free, key=lambda candidate: (last[candidate] * volume.spacing[candidate], candidate))
        wider = list(last)
        wider[axis] *= 2
        ladder.append((wider[0], wider[1], wider[2]))


def subsample(volume: Volume, stride: Stride, box: Box) -> Volume:
    """Return one of every few samples of a box of a volume, at their positions; a contiguous copy."""
    low, high = zip(*box, strict=True)
    part = volume.cropped(low, high)
    values: NDArray[np.generic] = part.values[tuple(slice(None, None, step) for step in stride[::-1])]
    affine = part.affine.copy()
    affine[:3, :3] *= np.array(stride, np.float64)
    same = stride == (1, 1, 1)
    return Volume(values if same else np.ascontiguousarray(values), affine, (), volume.name, volume.kind)
