# SPDX-License-Identifier: GPL-3.0-or-later
"""What a work needs in memory, whether it fits, and what to advise where it does not: the only owner of these.

The cost estimate shows it, refusals say it, batch and sidebar ask it before they begin. It decides nothing about a
result: triangles are counted by extraction's own first passes, a slab of values at a time, so that what is proposed is
counted and not guessed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from .budget import Budget
from .errors import CtmcError, MemoryLimitError
from .extraction.field_pieces import WORK_BYTES, WORK_FACTOR, FieldSlabs
from .extraction.marching_cubes import Counts
from .memory import NO_THREAD, amount, give_back
from .parallel import processors
from .progress import Stages, Steps
from .settings import ReconstructionSettings
from .sinks import HOLD, Sink
from .volume.field import Field, field_steps
from .volume.slice_reader import fitting_stride
from .volume.smoothing import smoothing_of
from .volume.volume import Volume

if TYPE_CHECKING:
    from .simplification.whole import Goal

T = TypeVar("T")

FACE_BYTES = 128  # of a triangle that is held: 36, and 92 to measure it; a mesh in Blender takes less, after that
BOUNDED_REDUCTION = 0.9  # share of the triangles that a maximum error is taken to remove
# Bytes that Blender was seen to take for each triangle of a foam of 1.7 million: as an object, and in a figure.
OBJECT_BYTES, FIGURE_BYTES = 240, 600
# Bytes that writing was seen to take for each triangle of a structure of 1.2 million, beside it.
WRITTEN_BYTES = {".obj": 12, ".glb": 130, ".3mf": 14, ".html": 120}
# Of a process that makes cases, before any values are read: Python, NumPy and work arrays, and Blender for thumbnails,
# which draws them in as much again.
PROCESS_BYTES, BLENDER_PROCESS_BYTES = 130 << 20, 420 << 20
# The most that was measured, on 52 million voxels with 5.3 million triangles and a thumbnail (docs/batch.md).
CASE_VOXEL_BYTES = 32
READING_COPIES = 2  # of the values, while they are read
ASKED_FACTOR = 1.4  # of what smoothing is predicted to take: a label of noise took 1.3, for its triangles
KEPT_BYTES = 256 << 20  # beyond those of the process: one that keeps more between two cases is replaced
CASES_SHARE = 0.85  # of the memory that is there
READ_SHARE = 0.25  # of the memory, that values which are read at once may take beside the surface
SMALL_BYTES = 1 << 26  # that are read at once even under a stride
SHOWN_SHARE = 0.25  # of the memory, for a copy of a CT that is shown: previews and surfaces need the rest
MOST_STRIDE = 16
ROUNDED = 0.9  # of the triangles that would fit are proposed
LOOKING = "Looking for what fits"


@dataclass(frozen=True)
class Plan:
    """The size of a surface and the memory that it takes.

    Parameters
    ----------
    counts : Counts
        Voxels, vertices and triangles of the full surface.
    settings : ReconstructionSettings
    budget : Budget
    value_bytes : int
        Bytes of the values that are in memory at once because of this surface.
    sink : Sink
    written_bytes : int
        Bytes of a triangle while Blender writes files, besides those of the surface.
    """

    counts: Counts
    settings: ReconstructionSettings
    budget: Budget
    value_bytes: int = 0
    sink: Sink = HOLD
    written_bytes: int = 0

    @property
    def simplifies(self) -> bool:
        """Whether the built-in simplifier has a goal, so that the full surface need not be there as a whole."""
        return self.settings.simplifies_here

    @property
    def left(self) -> int:
        """Triangles after simplification, as far as that can be predicted."""
        faces = self.counts.faces
        if not self.simplifies:
            return faces
        return min(faces, self._goal.target(faces) or round(faces * (1.0 - BOUNDED_REDUCTION)))

    @property
    def needed(self) -> int:
        """About the least memory, bytes, in which the surface can be made."""
        of_surface = 0
        if self.simplifies:
            from .simplification.whole import memory_needed

            at_once = memory_needed(self._goal.at_once(self.counts.faces, self.budget), self.settings.max_error_mm)
            of_surface = max(at_once, self.left * self.written_bytes) + self.left * FACE_BYTES
        elif self.sink.holds:
            of_surface = self.counts.faces * (FACE_BYTES + self.written_bytes)
        return self.budget.work_bytes + self.value_bytes + of_surface

    def most_triangles(self, there: int) -> int:
        """Return how many triangles simplification may leave in `there` bytes; 0 where none fit."""
        from .simplification.whole import Goal, memory_needed

        at_once = memory_needed(Goal(target_faces=1).at_once(self.counts.faces, self.budget), None)
        room = there - self.budget.work_bytes - self.value_bytes - at_once
        return max(0, int(ROUNDED * room / (FACE_BYTES + self.written_bytes)))

    @property
    def _goal(self) -> Goal:
        from .simplification.whole import Goal

        return Goal(self.settings.reduction, self.settings.target_faces, self.settings.max_error_mm)


def plan_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    sink: Sink = HOLD,
    written_bytes: int = 0,
    field: Field | None = None,
) -> Steps[Plan]:
    """Count the triangles of a surface and return its plan.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
    budget : Budget, optional
    sink : Sink
    written_bytes : int
        Bytes of a triangle while Blender writes files.
    field : Field, optional
        The field that is extracted, if it is known already; by default it is prepared here.
    """
    budget = budget or Budget()
    stages = Stages({"Preparing values": 1, "Counting triangles": 1})
    if field is None:
        field = yield from stages.run("Preparing values", field_steps(volume, settings, budget))
    slabs = FieldSlabs(replace(field.again(), settings=settings), budget, normals=False)
    counts = yield from stages.run("Counting triangles", slabs.counts_steps())
    return Plan(counts, settings, budget, field.values.own_bytes, sink, written_bytes)


def advised_steps(
    making: Steps[T],
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    sink: Sink = HOLD,
    written_bytes: int = 0,
) -> Steps[T]:
    """The steps of `making`; a lack of memory becomes a `MemoryLimitError` with settings that were counted to fit.

    Parameters
    ----------
    making : steps
        Make the surface of the volume with the settings.
    budget, sink, written_bytes
        As of `plan_steps`.
    """
    budget = budget or Budget()
    there = budget.available
    stages = Stages({"Reconstructing": 9, LOOKING: 1})
    try:
        return (yield from stages.run("Reconstructing", making))
    except (MemoryLimitError, MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not isinstance(error, CtmcError) and str(error) != NO_THREAD:
            raise
        if there is None:
            raise
        refused = error.with_traceback(None)  # what was made until then goes, and what its cause still holds
        refused.__cause__ = refused.__context__ = None
    give_back()
    looking = refusal_steps(volume, settings, replace(budget, bytes=there), sink, written_bytes)
    try:
        sentence = yield from stages.run(LOOKING, looking)
    except (MemoryLimitError, MemoryError):  # even a slab at a time
        sentence = slab_refusal(volume, settings, there)
    except CtmcError:
        sentence = ""
    if not sentence:
        raise refused
    raise MemoryLimitError(sentence) from refused


def refusal_steps(
    volume: Volume, settings: ReconstructionSettings, budget: Budget, sink: Sink = HOLD, written_bytes: int = 0
) -> Steps[str]:
    """Why a surface was refused, and settings that fit, all counted; empty where none is known."""
    there = budget.available or 0
    what = smoothing = ""
    if not smoothing_of(settings).by_slabs:
        what, smoothing = f"smoothing label {settings.label} as constrained", "smoothing gaussian"
        settings = replace(settings, smoothing="gaussian")
    stages = Stages({"Counting triangles": 1, LOOKING: 1})
    planning = plan_steps(volume, settings, budget, sink, written_bytes)
    plan = yield from stages.run("Counting triangles", planning)
    fits = plan.needed <= there  # as far as is known: it was refused
    if smoothing and fits:
        return _refused(what, there, f"{smoothing} would fit")
    room = budget.work_bytes + (plan.needed - budget.work_bytes) // 2 if fits else there
    proposals = yield from stages.run(LOOKING, proposals_steps(volume, plan, room))
    if fits and not proposals:
        return ""
    together = f"{smoothing} with " if smoothing else ""
    what = what or f"a surface of {plan.counts.faces} triangles"
    if fits or smoothing:
        return _refused(what, there, together + advice_of(proposals) if proposals else advice_of([]))
    return (
        f"{what} needs about {amount(plan.needed)} of memory and {amount(there)} are available; {advice_of(proposals)}"
    )


def advice_of(proposals: Sequence[str]) -> str:
    """Return proposals in words.

    Examples
    --------
    >>> advice_of(["stride 2 2 2", "target_faces 5000"])
    'stride 2 2 2 or target_faces 5000 would fit'
    """
    return f"{' or '.join(proposals)} would fit" if proposals else "choose a smaller region"


def _refused(what: str, there: int, advice: str) -> str:
    """Return the refusal for a surface whose memory cannot be predicted."""
    return f"{what} needs more than the {amount(there)} of memory that are available; {advice}"


def proposals_steps(volume: Volume, plan: Plan, room: int) -> Steps[list[str]]:
    """Changes of the settings each of which fits into so many bytes: a wider stride, and fewer triangles left."""
    wider = yield from _stride_steps(volume, plan, room)
    proposals = [] if wider is None else [wider]
    most, settings = plan.most_triangles(room), plan.settings
    if most >= 1000 and settings.simplifier != "decimate" and not settings.max_error_mm:
        proposals.append(f"target_faces {min(most, plan.counts.faces - 1) // 1000 * 1000}")
    return proposals


def slab_refusal(volume: Volume, settings: ReconstructionSettings, there: int) -> str:
    """Why values cannot even be fetched slab by slab, and a region that can."""
    x, y, _ = volume.size
    side = widest_slices(volume, settings, there)
    advice = f"choose a region of at most {side} x {side} voxels across" if side < max(x, y) else "choose a region"
    return _refused("a slab of this volume", there, advice if side > 1 else "give it more memory")


def widest_slices(volume: Volume, settings: ReconstructionSettings, limit: int) -> int:
    """Return the side in voxels of the largest square slices whose slabs are extracted in so many bytes."""
    reach = smoothing_of(settings).reach(volume.spacing, settings)[2]
    item = 4 if reach else volume.dtype.itemsize
    voxel_bytes = WORK_FACTOR * (settings.stride[2] + 1) * item
    if reach:
        voxel_bytes += 4 * (2 * reach + 1)
    return math.isqrt(max(0, limit - WORK_BYTES) // voxel_bytes)


def _stride_steps(volume: Volume, plan: Plan, there: int) -> Steps[str | None]:
    """Return the smallest wider stride at which the surface fits in memory."""
    room = there - plan.budget.work_bytes
    if room <= 0 or not (plan.sink.holds or plan.simplifies):  # triangles are not what it takes
        return None
    for stride in _wider(volume, plan, room):
        settings = replace(plan.settings, stride=stride)
        try:
            counted = yield from plan_steps(volume, settings, plan.budget, plan.sink, plan.written_bytes)
        except CtmcError:  # a slab is thicker at a wider stride, or there is no surface
            return None
        if counted.needed <= there:
            return "stride " + " ".join(map(str, stride))
    return None


def _wider(volume: Volume, plan: Plan, room: int) -> Iterator[tuple[int, int, int]]:
    """Strides along x, y and z, from the first that may fit: triangles fall with the square of the stride."""
    first = max(1, math.floor(math.sqrt(max(0, plan.needed - plan.budget.work_bytes) / room)))
    for more in range(first, MOST_STRIDE):
        x, y, z = (min(side + more, size - 1) for side, size in zip(plan.settings.stride, volume.size, strict=True))
        yield x, y, z


def triangle_bytes(suffixes: Iterable[str], blender: bool, figure: bool) -> int:
    """Return the bytes for each triangle that writing takes beside the surface, and `blender` where it is needed."""
    written = max((WRITTEN_BYTES.get(suffix, 0) for suffix in suffixes), default=0)
    return max(written, OBJECT_BYTES, FIGURE_BYTES * figure) if blender else written


def reads_at_once(value_bytes: int, settings: ReconstructionSettings, budget: Budget) -> bool:
    """Return whether all values of a file are read at once, which is quicker, and leave memory for a surface.

    They are not where most of them are left out. The surface is the same.
    """
    some = settings.region is not None or max(settings.stride) > 1
    there = budget.available
    return (not some or value_bytes <= SMALL_BYTES) and (there is None or value_bytes <= READ_SHARE * there)


def fits_in_memory(value_bytes: int, budget: Budget) -> bool:
    """Return whether the values of a CT that is shown fit in memory, by what its headers say."""
    there = budget.available
    return there is None or value_bytes <= there


def shown_stride(volume: Volume, budget: Budget) -> tuple[int, int, int]:
    """Return the stride at which a copy of a CT leaves memory for surfaces.

    Raises
    ------
    MemoryLimitError
        Where there is none.
    """
    there = budget.available
    room = volume.nbytes if there is None else int(SHOWN_SHARE * there)
    stride = fitting_stride(volume.shape, volume.dtype.itemsize, room)
    if stride is None:
        budget.require(volume.nbytes, f"reading {volume.name}", "close other programs, or raise the memory limit")
    return stride or (1, 1, 1)


def case_bytes(voxels: int, value_bytes: int | None = None, thumbnails: bool = True) -> int:
    """Return the memory that a case of a batch needs, about, by what its headers tell.

    Parameters
    ----------
    voxels : int
    value_bytes : int, optional
        Of a voxel, where the case asks for more itself as soon as it knows its label's box: reading is counted alone.
    thumbnails : bool
        Whether Blender is loaded.
    """
    process = BLENDER_PROCESS_BYTES if thumbnails else PROCESS_BYTES
    return process + voxels * (CASE_VOXEL_BYTES if value_bytes is None else READING_COPIES * value_bytes)


def asks_for_memory(settings: ReconstructionSettings, several: bool) -> bool:
    """Return whether a case says what it needs before it takes it: one or `several` labels, smoothed in their boxes."""
    if several and settings.label is None:
        settings = replace(settings, threshold=None, label=1)
    return settings.label is not None and not smoothing_of(settings).by_slabs


def asked_bytes(has_bytes: int, needed_bytes: int) -> int:
    """Return what a case asks for that has so many bytes and needs so many more for its next work."""
    return has_bytes + int(ASKED_FACTOR * needed_bytes)


def case_process_is_large(resident_bytes: int | None) -> bool:
    """Return whether a process keeps so much memory after a case that the next one is better done by another."""
    return resident_bytes is not None and resident_bytes > BLENDER_PROCESS_BYTES + KEPT_BYTES


def cases_bytes(budget: Budget) -> int | None:
    """Return the bytes that all cases of a batch may take in total; None where the system does not say."""
    there = budget.available
    return None if there is None else int(there * CASES_SHARE)


class AtOnce(NamedTuple):
    """How many cases run side by side, and why not more.

    Parameters
    ----------
    jobs : int
    reason : str
        Such as 'as many as there are processors'.
    """

    jobs: int
    reason: str


def cases_at_once(asked: int | None, needs: Sequence[int], budget: Budget) -> AtOnce:
    """Return how many processes may run at once: as many as asked for or as there are processors, if they fit.

    Only the smallest must fit side by side: the batch lets larger ones wait for others.

    Examples
    --------
    >>> cases_at_once(4, [1 << 30, 2 << 30, 2 << 30], Budget(bytes=6 << 30))
    AtOnce(jobs=3, reason='as many as there are cases')
    >>> cases_at_once(4, [2 << 30] * 5, Budget(bytes=6 << 30))
    AtOnce(jobs=2, reason='as memory allows: a case begins with 2.0 GiB, and 5.1 GiB may be used')
    """
    limits = [
        (processors(), "as many as there are processors"),
        (max(len(needs), 1), "as many as there are cases"),
    ]
    if asked is not None:
        limits[0] = (asked, "as --jobs says")
    limit = cases_bytes(budget)
    if limit is not None and needs:
        fitting = sum(total <= limit for total in accumulate(sorted(needs)))
        least, most = amount(min(needs)), amount(max(needs))
        between = least if least == most else f"{least} to {most}"
        limits.append(
            (max(1, fitting), f"as memory allows: a case begins with {between}, and {amount(limit)} may be used")
        )
    jobs = min(number for number, _ in limits)
    return AtOnce(jobs, next(reason for number, reason in limits if number == jobs))
