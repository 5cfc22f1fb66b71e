# SPDX-License-Identifier: GPL-3.0-or-later
"""Work out the memory that a work needs, whether it fits, and what to advise if not: the only owner of these.

The cost estimate shows it, refusals say it, batch and sidebar ask it before they begin. It decides nothing about a
result: triangles are counted by extraction's own first passes, a slab of values at a time, so that what is proposed is
counted and not guessed.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

from ..errors import CtmcError, MemoryLimitError
from ..extraction.field_pieces import WORK_BYTES, WORK_FACTOR, FieldSlabs
from ..extraction.marching_cubes import Counts
from ..machine.budget import Budget
from ..machine.memory import NO_THREAD, amount, give_back
from ..mesh.pieces import spool
from ..progress import Stages, Steps
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink
from ..smoothing.methods import smoothing_of
from ..smoothing.prepare import field_steps
from ..volume.field import ScalarField
from ..volume.slice_reader import fitting_stride
from ..volume.volume import Volume

if TYPE_CHECKING:
    from ..simplification.whole import Goal

T = TypeVar("T")

FACE_BYTES = 128  # A held triangle takes 36 bytes, and 92 to measure it; a mesh in Blender takes less, after that.
BOUNDED_REDUCTION = 0.9  # A maximum error is taken to remove this share of the triangles.
# Bytes that Blender was seen to take for each triangle of a foam of 1.7 million: as an object, and in a figure.
OBJECT_BYTES, FIGURE_BYTES = 240, 600
# Bytes that writing was seen to take for each triangle of a structure of 1.2 million, beside it.
WRITTEN_BYTES = {".obj": 12, ".glb": 130, ".3mf": 14, ".html": 120}
READ_SHARE = 0.25  # Values that are read at once may take this share of the memory besides the surface.
SMALL_BYTES = 1 << 26  # Values of up to this many bytes are read at once even under a stride.
# A copy of a CT that is shown may take this share of the memory: previews and surfaces need the rest.
SHOWN_SHARE = 0.25
MOST_STRIDE = 16
LEAST_PROPOSED = 1000  # Propose to leave at least this many triangles, in steps of as many.
ROUNDED = 0.9  # Propose this share of the triangles that would fit.
COUNTED_SHARE = 0.9  # A surface may take this share of the memory if some of its slabs were counted.
LOOKING = "Finding settings that fit in memory"


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
        if self.simplifies:
            counts = self.counts
            simplifying = self._goal.memory_needed(counts.faces, self.left, self.budget, counts.vertices, counts.layers)
            after = self.left * (FACE_BYTES + self.written_bytes)
            return self.value_bytes + max(self.spooled_bytes + simplifying, after)
        of_surface = self.counts.faces * (FACE_BYTES + self.written_bytes) if self.sink.holds else self.spooled_bytes
        return self.budget.work_bytes + self.value_bytes + of_surface

    @property
    def spooled_bytes(self) -> int:
        """Bytes of pieces that stay in memory because they are looked at several times; the others wait in a file."""
        if not self.settings.looks_again:
            return 0
        counts = self.counts
        spooled = counts.vertices * spool.VERTEX_BYTES + counts.faces * spool.FACE_BYTES
        return min(spooled, self.budget.spool_bytes)

    def fits(self, there: int) -> bool:
        """Return whether the surface fits in some bytes, with a reserve if not all of it was counted."""
        return self.needed <= (there if self.counts.exact else COUNTED_SHARE * there)

    def most_triangles(self, there: int) -> int:
        """Return how many triangles simplification may leave in `there` bytes; 0 where none fit."""

        def refused(target: int) -> bool:
            settings = replace(self.settings, reduction=None, max_error_mm=None, target_faces=target)
            return not replace(self, settings=settings).fits(there)

        targets = range(LEAST_PROPOSED, self.counts.faces, LEAST_PROPOSED)
        fitting = bisect_left(targets, True, key=refused)
        return int(ROUNDED * targets[fitting - 1]) if fitting else 0

    @property
    def has_thin_batches(self) -> bool:
        """Whether seams dominate the memory, so that a lower target would not help."""
        counts, goal = self.counts, self._goal
        in_batches = self.simplifies and counts.faces > goal.most_whole(self.budget)
        return in_batches and goal.has_thin_batches(self.budget, counts.vertices, counts.layers)

    @property
    def _goal(self) -> Goal:
        from ..simplification.whole import Goal

        return Goal(self.settings.reduction, self.settings.target_faces, self.settings.max_error_mm)


def plan_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    sink: Sink = HOLD,
    written_bytes: int = 0,
    field: ScalarField | None = None,
    most_slabs: int | None = None,
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
    field : ScalarField, optional
        The field that is extracted, if it is known already; by default it is prepared here.
    most_slabs : int, optional
        Count triangles in no more slabs than these; by default in all.
    """
    budget = budget or Budget()
    stages = Stages({"Preparing values": 1, "Counting triangles": 1})
    if field is None:
        field = yield from stages.run("Preparing values", field_steps(volume, settings, budget))
    slabs = FieldSlabs(replace(field.again(), settings=settings), budget, normals=False)
    counts = yield from stages.run("Counting triangles", slabs.counts_steps(most_slabs))
    return Plan(counts, settings, budget, field.values.own_bytes, sink, written_bytes)


class _PlanRefusal(MemoryLimitError):
    """A surface does not fit, and the message says which settings would."""


def required_steps(
    volume: Volume, settings: ReconstructionSettings, budget: Budget, sink: Sink, field: ScalarField
) -> Steps[None]:
    """Refuse a surface that does not fit before it is made; refuse none if the available memory is unknown.

    Raises
    ------
    PlanRefusal
        With settings that fit, by counting some slabs of a large volume.
    """
    there = budget.available
    voxels = math.prod(field.values.shape) // math.prod(settings.stride)
    # A surface seldom has a triangle for each voxel: if that many fit, skip counting.
    if there is None or budget.workers is not None or voxels * FACE_BYTES <= there:
        return
    if not sink.holds and not Plan(Counts(0, 0, 0, 0), settings, budget).simplifies:
        return
    stages = Stages({"Counting triangles": 1, LOOKING: 1})
    planning = plan_steps(volume, settings, budget, sink, field=field, most_slabs=budget.counted_slabs)
    plan = yield from stages.run("Counting triangles", planning)
    least = replace(plan, value_bytes=0, budget=replace(budget, work_bytes=0))  # small works take less than these
    give_back()
    left = budget.available  # counting may have left less memory
    there = there if left is None else min(there, left)
    if least.needed > there:
        proposals = yield from stages.run(LOOKING, proposals_steps(volume, plan, there))
        raise _PlanRefusal(_unfitting(plan, there, proposals))


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
        if isinstance(error, _PlanRefusal) and not written_bytes:
            raise
        if isinstance(error, RuntimeError) and not isinstance(error, CtmcError) and str(error) != NO_THREAD:
            raise
        if there is None:
            raise
        refused = error.with_traceback(None)  # what was made until then goes, and what its cause still holds
        refused.__cause__ = refused.__context__ = None
    give_back()
    looking = _refusal_steps(volume, settings, replace(budget, bytes=there), sink, written_bytes)
    try:
        sentence = yield from stages.run(LOOKING, looking)
    except (MemoryLimitError, MemoryError):  # even a slab at a time
        sentence = _slab_refusal(volume, settings, there)
    except CtmcError:
        sentence = ""
    if not sentence:
        raise refused
    raise MemoryLimitError(sentence) from refused


def _refusal_steps(
    volume: Volume, settings: ReconstructionSettings, budget: Budget, sink: Sink = HOLD, written_bytes: int = 0
) -> Steps[str]:
    """Why a surface was refused, and settings that fit, all counted; empty where none is known."""
    there = budget.available or 0
    what = smoothing = ""
    done = smoothing_of(settings)
    if done.fallback:
        what, smoothing = f"smoothing label {settings.label} as {done.name}", f"smoothing {done.fallback}"
        settings = replace(settings, smoothing=done.fallback)
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
    prefix = f"{smoothing} with " if smoothing else ""
    what = what or f"a surface of {plan.counts.faces} triangles"
    if fits or smoothing:
        return _refused(what, there, prefix + advice_of(proposals) if proposals else advice_of([]))
    return _unfitting(plan, there, proposals)


def _unfitting(plan: Plan, there: int, proposals: Sequence[str]) -> str:
    """Return the refusal for a surface that was planned."""
    about = "" if plan.counts.exact else "about "
    return (
        f"a surface of {about}{plan.counts.faces} triangles needs about {amount(plan.needed)} of memory and "
        f"{amount(there)} are available; {advice_of(proposals)}"
    )


def advice_of(proposals: Sequence[str]) -> str:
    """Return proposals in words.

    Examples
    --------
    >>> advice_of(["stride 2 2 2", "triangles 5000"])
    'stride 2 2 2 or triangles 5000 would fit'
    """
    return f"{' or '.join(proposals)} would fit" if proposals else "choose a smaller region"


def _refused(what: str, there: int, advice: str) -> str:
    """Return the refusal for a surface whose memory cannot be predicted."""
    return f"{what} needs more than the {amount(there)} of memory available; {advice}"


def proposals_steps(volume: Volume, plan: Plan, room: int) -> Steps[list[str]]:
    """Return changes of the settings that each fit into some bytes: a wider stride, and fewer triangles left."""
    wider = yield from _stride_steps(volume, plan, room)
    proposals = [] if wider is None else [wider]
    most, settings = plan.most_triangles(room), plan.settings
    decides = settings.simplifier != "decimate" and not settings.max_error_mm and not plan.has_thin_batches
    if most >= LEAST_PROPOSED and decides:
        proposals.append(f"triangles {most // LEAST_PROPOSED * LEAST_PROPOSED}")
    return proposals


def _slab_refusal(volume: Volume, settings: ReconstructionSettings, there: int) -> str:
    """Why values cannot even be fetched slab by slab, and a region that can."""
    x, y, _ = volume.size
    side = widest_slices(volume, settings, there)
    advice = f"choose a region of at most {side} x {side} voxels across" if side < max(x, y) else "choose a region"
    return _refused("a slab of this volume", there, advice if side > 1 else "give it more memory")


def widest_slices(volume: Volume, settings: ReconstructionSettings, limit: int) -> int:
    """Return the side in voxels of the largest square slices whose slabs can be extracted in some bytes."""
    item, kept = smoothing_of(settings).bytes(volume.spacing, settings, volume.dtype.itemsize)
    voxel_bytes = WORK_FACTOR * (settings.stride[2] + 1) * item + kept
    return math.isqrt(max(0, limit - WORK_BYTES) // voxel_bytes)


def _stride_steps(volume: Volume, plan: Plan, there: int) -> Steps[str | None]:
    """Return the smallest wider stride at which the surface fits in memory."""
    room = there - plan.budget.work_bytes
    if room <= 0 or not (plan.sink.holds or plan.simplifies):  # triangles are not what it takes
        return None
    for stride in _wider(volume, plan, room):
        settings = replace(plan.settings, stride=stride)
        try:
            counted = yield from plan_steps(
                volume,
                settings,
                plan.budget,
                plan.sink,
                plan.written_bytes,
                most_slabs=None if plan.counts.exact else plan.budget.counted_slabs,
            )
        except CtmcError:  # a slab is thicker at a wider stride, or there is no surface
            return None
        if counted.fits(there):
            return "stride " + " ".join(map(str, stride))
    return None


def _wider(volume: Volume, plan: Plan, room: int) -> Iterator[tuple[int, int, int]]:
    """Strides along x, y and z, from the first that may fit: triangles fall with the square of the stride."""
    first = max(1, math.floor(math.sqrt(max(0, plan.needed - plan.budget.work_bytes) / room)))
    for more in range(first, MOST_STRIDE):
        x, y, z = (min(side + more, size - 1) for side, size in zip(plan.settings.stride, volume.size, strict=True))
        yield x, y, z


def triangle_bytes(suffixes: Iterable[str], blender: bool, figure: bool) -> int:
    """Return the bytes for each triangle that writing takes besides the surface, and `blender` if it is needed."""
    written = max((WRITTEN_BYTES.get(suffix, 0) for suffix in suffixes), default=0)
    return max(written, OBJECT_BYTES, FIGURE_BYTES * figure) if blender else written


def reads_at_once(value_bytes: int, settings: ReconstructionSettings, budget: Budget) -> bool:
    """Return whether all values of a file are read at once, which is quicker, and leave memory for a surface.

    They are not where most of them are left out. The surface is the same.
    """
    is_partial = settings.region is not None or max(settings.stride) > 1
    there = budget.available
    return (not is_partial or value_bytes <= SMALL_BYTES) and (there is None or value_bytes <= READ_SHARE * there)


def fits_in_memory(value_bytes: int, budget: Budget) -> bool:
    """Return whether the values of a CT that is shown fit in memory, by its headers."""
    there = budget.available
    return there is None or value_bytes <= there


def shown_stride(volume: Volume, budget: Budget) -> tuple[int, int, int]:
    """Return the stride at which a copy of a CT leaves memory for surfaces.

    Raises
    ------
    MemoryLimitError
        If there is none.
    """
    there = budget.available
    room = volume.nbytes if there is None else int(SHOWN_SHARE * there)
    stride = fitting_stride(volume.shape, volume.dtype.itemsize, room)
    if stride is None:
        budget.require(volume.nbytes, f"reading {volume.name}", "close other programs, or raise the memory limit")
    return stride or (1, 1, 1)
