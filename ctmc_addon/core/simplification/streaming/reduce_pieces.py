# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplify a surface that comes piece by piece, so that memory follows the simplified surface.

Pieces are gathered to batches, and each batch is simplified while its seams to the next stay as they are; where most of
its triangles shall go, by quick clusters at first. Then the strips along the seams are simplified, and at last the
surface as a whole, exactly to the goal. The batches leave `SPARE` times as many triangles as are wanted: the last pass
chooses where they matter most. Batches are cut by the count of triangles alone, so the result depends neither on the
machine nor on the number of threads.

What holds at the end is what `simplify` promises. A maximum error is shared by the two passes: distances between three
surfaces add up at most. A closed component may go as a whole; one that is cut by a seam, in the last pass.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from typing import Generic, TypeVar

import numpy as np

from ...errors import MeshError
from ...memory import available_bytes, require, require_or_killed
from ...mesh.triangle_mesh import SurfacePieces
from ...parallel import side_by_side_steps, worker_count
from ...progress import Step, Steps, WithResult
from ..component_removal import RemovedComponents
from ..edge_collapse import CollapsingMesh
from ..simplify import (
    SAFETY_FACTOR,
    Simplification,
    collapse_steps,
    memory_needed,
    require_finite,
    target_of,
)
from .clustering import clustered_steps
from .parts import NEW, Numbering, Part, area, batches_steps, beside, joined, shared
from .workers import Task, Workers, working

T = TypeVar("T")

BATCH_FACES, BOUNDED_BATCH_FACES = 1 << 20, 1 << 18  # triangles that are simplified together
LAST_FACES, BOUNDED_LAST_FACES = 3 << 19, 3 << 18  # in the last pass, at most
SPARE = 2.0  # times as many triangles as wanted are left for the last pass
FIRST_SHARE = 0.8  # of a maximum error is for the batches, the rest for the last pass
CLUSTERED = 4.0  # times as many triangles as wanted: worth clustering first
LEFT_BY_CLUSTERS = 2.0  # times as many triangles as wanted: edges collapse from there on
BATCHES_SHARE = 0.8  # of the time
REMEDY = "choose a region or a larger stride, or give it more memory"


@dataclass(frozen=True)
class Goal:
    """What simplification is to reach; exactly one is not None. See `simplify`."""

    reduction: float | None = None
    target_faces: int | None = None
    max_error: float | None = None

    def target(self, face_count: int) -> int:
        """How many of so many triangles shall be left; 0 with a maximum error."""
        return target_of(face_count, self.reduction, self.target_faces, self.max_error)

    @property
    def sizes(self) -> tuple[int, int]:
        """Triangles of a batch, and of the last pass at most."""
        if self.max_error is None:
            return BATCH_FACES, LAST_FACES
        return BOUNDED_BATCH_FACES, BOUNDED_LAST_FACES


@dataclass(frozen=True, eq=False)
class Reduced:
    """A simplified part, its density and what went.

    part : Part
    density : float
        Triangles wanted for each unit of area.
    removed : RemovedComponents
    handles_cut : int
    """

    part: Part
    density: float
    removed: RemovedComponents
    handles_cut: int


@dataclass(frozen=True, eq=False)
class StreamedSimplification(Generic[T]):
    """A simplified surface, how many triangles it had, and what the maker of its pieces returned."""

    simplification: Simplification
    full_faces: int
    info: T


def reduce_pieces_steps(
    pieces: SurfacePieces[T],
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
    memory_limit: int | None = None,
    threads: int | None = None,
) -> Steps[StreamedSimplification[T]]:
    """Simplify a surface that comes in pieces; goals and promises are those of `simplify`.

    Parameters
    ----------
    pieces : generator of Step and SurfacePiece
        Closed at the end, whatever happens.
    reduction, target_faces, max_error, memory_limit
        As of `simplify`.
    threads : int, optional
        By default one for each processor. The result does not depend on it.
    """
    goal = Goal(reduction, target_faces, max_error)
    goal.target(1)
    batch_faces, last_faces = goal.sizes
    threads = worker_count(threads)
    with working(_fitting_threads(threads, memory_needed(batch_faces, max_error), memory_limit)) as workers:
        collected = _Collected(goal, workers)
        source = WithResult(batches_steps(pieces, batch_faces))
        for item in source:
            if isinstance(item, Step):
                yield Step(BATCHES_SHARE * item.fraction, item.message)
            else:
                yield from collected.add_steps(item)
        yield from collected.end_steps()
    if not collected.full_faces:
        raise MeshError("there is no surface to simplify: no piece has a triangle")
    target = goal.target(collected.full_faces)
    yield from _last_pass_steps(collected, target, last_faces, threads, memory_limit)
    mesh = joined(collected.parts).mesh
    simplification = Simplification(mesh, collected.removed, collected.handles_cut)
    yield Step(1.0, simplification.message(target))
    return StreamedSimplification(simplification, collected.full_faces, source.result)


def _fitting_threads(threads: int, batch_bytes: int, memory_limit: int | None) -> int:
    limit = available_bytes() if memory_limit is None else memory_limit
    return threads if limit is None else max(1, min(threads, limit // (2 * batch_bytes)))


class _Collected:
    """Parts as they are done."""

    def __init__(self, goal: Goal, workers: Workers) -> None:
        self.goal, self.workers, self.numbering = goal, workers, Numbering()
        self.full_faces = 0
        self.removed, self.handles_cut = RemovedComponents(), 0
        self.held: Part | None = None  # the last batch; where it is the only one, the last pass takes care of it
        self.seam_vertices = 0  # of the seams of `held`
        self.at_work: deque[Task[Reduced]] = deque()
        self.last: Reduced | None = None  # its strip at the lower seam is taken off already
        self.bodies: list[Part] = []
        self.strips: list[Task[Reduced]] = []
        self.parts: list[Part] = []

    def add_steps(self, batch: Part) -> Steps[None]:
        """Take in another batch."""
        require_finite(batch.mesh)
        seam = 0
        if self.held is not None:
            seam = len(shared(self.held, batch))
            yield from self._begin_steps(self.held, self.seam_vertices + seam)
        self.held, self.seam_vertices = batch, seam
        self.full_faces += batch.face_count

    def end_steps(self) -> Steps[None]:
        """Wait for everything that is at work."""
        if self.held is None:
            return
        if self.last is None and not self.at_work:
            self.parts = [self.held]
            return
        yield from self._begin_steps(self.held, self.seam_vertices)
        self.held = None
        while self.at_work:
            yield from self._take_steps()
        assert self.last is not None
        self.bodies.append(self.last.part)
        strips = []
        for task in self.strips:
            strips.append((yield from self.result_steps(task)).part)
        for pair in zip_longest(self.bodies, strips):
            self.parts += [part for part in pair if part is not None and part.face_count]

    def result_steps(self, task: Task[Reduced]) -> Steps[Reduced]:
        """The result of a task, counted."""
        return self.counted((yield from task.result_steps()))

    def counted(self, reduced: Reduced) -> Reduced:
        """A result, with numbers for its new vertices; what went is added up."""
        self.handles_cut += reduced.handles_cut
        largest = max(self.removed.largest, reduced.removed.largest)
        self.removed = RemovedComponents(self.removed.count + reduced.removed.count, largest)
        return replace(reduced, part=self.numbering.completed(reduced.part))

    def _begin_steps(self, batch: Part, seam_vertices: int) -> Steps[None]:
        """Give a batch to the workers, no more than they can work at."""
        while len(self.at_work) >= self.workers.threads:
            yield from self._take_steps()
        needed = memory_needed(batch.face_count, self.goal.max_error)
        require_or_killed(needed, f"simplifying {batch.face_count} triangles at once", REMEDY)
        if self.goal.max_error is None:
            # Of a number of triangles every batch may have as many as if all were like those so far.
            wanted = batch.face_count * min(1.0, SPARE * self.goal.target(self.full_faces) / self.full_faces)
            reducing = reduce_part_steps(batch, wanted, 2 * seam_vertices)
        else:
            reducing = reduce_part_steps(batch, 0, 0, FIRST_SHARE * self.goal.max_error)
        self.at_work.append(self.workers.begin(reducing))

    def _take_steps(self) -> Steps[None]:
        """Wait for the first batch at work, and cut the strip along its seam to the one before out of both."""
        reduced = yield from self.result_steps(self.at_work.popleft())
        before, self.last = self.last, reduced
        if before is None:
            return
        if self.goal.max_error is not None:
            self.bodies.append(before.part)  # only the last pass may add to their error
            return
        seam = shared(before.part, reduced.part)
        halves, bodies, wanted = [], [], 0.0
        for each in (before, reduced):
            in_strip = beside(each.part, seam)
            halves.append(each.part.with_faces(in_strip))
            bodies.append(each.part.with_faces(~in_strip))
            wanted += each.density * area(halves[-1].mesh)
        self.bodies.append(bodies[0])
        self.last = replace(reduced, part=bodies[1])
        reducing = reduce_part_steps(joined(halves), wanted)
        self.strips.append(self.workers.begin(reducing))


def reduce_part_steps(
    part: Part, wanted: float, at_border: int = 0, max_error: float | None = None, whole: bool = False
) -> Steps[Reduced]:
    """Simplify a part whose border stays.

    Parameters
    ----------
    part : Part
    wanted : float
        Triangles to leave, with a maximum error 0.
    at_border : int
        Triangles to leave besides, because the border stays.
    max_error : float, optional
    whole : bool
        Whether it is the whole surface: then components with a border may go, and any where no edge is left that can.
    """
    target = round(wanted) + at_border
    if target >= part.face_count:
        return Reduced(part, _density(part, wanted), RemovedComponents(), 0)
    if max_error is None and not whole and part.face_count - at_border > CLUSTERED * wanted:
        part = yield from clustered_steps(part, round(LEFT_BY_CLUSTERS * wanted) + at_border)
    collapsing = CollapsingMesh(part.mesh, max_error, SAFETY_FACTOR, part=not whole)
    yield from collapse_steps(collapsing, target, last=whole)
    if max_error is not None:
        yield from collapsing.roll_back_steps()
    mesh, original = collapsing.numbered_mesh()
    reduced = Part(mesh, np.where(original >= 0, part.numbers[original], NEW))
    return Reduced(reduced, _density(reduced, wanted), collapsing.removed, collapsing.handles_cut)


def _density(part: Part, wanted: float) -> float:
    """Triangles wanted for each unit of a part's area."""
    size = area(part.mesh)
    return wanted / size if size > 0 else 0.0


def _last_pass_steps(
    collected: _Collected, target: int, most: int, threads: int, memory_limit: int | None
) -> Steps[None]:
    """Simplify the whole surface to the goal: at once where it is small enough, else in stretches side by side."""
    max_error = collected.goal.max_error
    if max_error is not None and len(collected.parts) > 1:
        max_error *= 1.0 - FIRST_SHARE
    faces, before = sum(part.face_count for part in collected.parts), 0
    while faces > target and faces != before:
        stretches = _stretches(collected.parts, most)
        counts = [sum(part.face_count for part in stretch) for stretch in stretches]
        need = memory_needed(max(counts), max_error)
        require(need, f"simplifying {faces} triangles", "ask for fewer triangles, or use a larger stride", memory_limit)
        whole = len(stretches) == 1
        # Borders of stretches stay, so they do not give all at once: the next stretches have other borders.
        goal = target if whole else max(target, faces // 2)
        wanted = [goal] if whole else _shares(goal, counts)
        works = [
            partial(_stretch_steps, stretch, share if max_error is None else 0, max_error, whole)
            for stretch, share in zip(stretches, wanted, strict=True)
        ]
        collected.parts = []
        del stretches
        at_once = _fitting_threads(threads, need, memory_limit)
        results = yield from _after_batches_steps(side_by_side_steps(works, counts, at_once))
        collected.parts = [collected.counted(reduced).part for reduced in results]
        before, faces = faces, sum(part.face_count for part in collected.parts)
        if max_error is not None:
            return


def _stretch_steps(stretch: list[Part], wanted: int, max_error: float | None, whole: bool) -> Steps[Reduced]:
    return (yield from reduce_part_steps(joined(stretch), wanted, 0, max_error, whole))


def _shares(goal: int, counts: list[int]) -> list[int]:
    """What to leave of each of so many triangles, in all `goal`; they go by twos, so an odd one is left to the next.

    Examples
    --------
    >>> _shares(50, [60, 40, 101])
    [14, 10, 26]
    """
    shares: list[int] = []
    for number, count in enumerate(counts):
        share = max(1, goal * sum(counts[: number + 1]) // sum(counts) - sum(shares))
        odd = (count - share) % 2 and number + 1 < len(counts)
        shares.append(share + bool(odd))
    return shares


def _stretches(parts: list[Part], most: int) -> list[list[Part]]:
    """Parts that follow one another, together no more than so many triangles where that is possible."""
    if sum(part.face_count for part in parts) <= most:
        return [parts]
    stretches: list[list[Part]] = [[]]
    count = 0
    for part in parts:
        if count and count + part.face_count > most:
            stretches.append([])
            count = 0
        stretches[-1].append(part)
        count += part.face_count
    return stretches


def _after_batches_steps(steps: Steps[T]) -> Steps[T]:
    """The same steps in the time that is left after the batches."""
    try:
        while True:
            try:
                fraction, message = next(steps)
            except StopIteration as end:
                result: T = end.value
                return result
            yield Step(BATCHES_SHARE + (1.0 - BATCHES_SHARE) * fraction, message)
    finally:
        steps.close()
