# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplify a surface in batches side by side, so that memory follows the simplified surface and threads serve it.

Each batch is simplified while its seams to its neighbors stay as they are; where most of its triangles shall go, by
quick clusters at first. They leave `spare` times as many triangles as are wanted, and those along the seams: where
these are most, batches that follow each other are simplified again as one. The last pass simplifies all of them, the
seams too, exactly to the goal: a larger surface in regions, whose borders do not run along the seams.

What holds at the end is what `simplify` promises. A maximum error is shared by the two passes: distances between three
surfaces add up at most. A closed component may go as a whole; one that is cut by a seam, in the last pass.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...arrays import Indices
from ...errors import MeshError
from ...machine.budget import Budget
from ...machine.memory import give_back, require_or_killed
from ...machine.parallel import in_order_steps
from ...mesh.intersections import self_intersections_steps
from ...mesh.topology import Groups
from ...progress import Step, Steps, WithResult
from ..engine.component_removal import CollapsedComponents
from ..whole import Goal, Simplification, require_finite, whole_steps
from .full_moments import NOTHING
from .pieces import Batch, Numbering, crossing_batches_steps, joined, regions, shared_count
from .reduced_batch import Reduced, reduce_batch_steps

BATCHES_SHARE = 0.8  # Batches take about this share of the time.


@dataclass(frozen=True, eq=False)
class _Held:
    """A simplified batch that waits for the last pass.

    batch : Batch
    inner_target : float
        Triangles that it may have, beside those along its seams.
    below, above : int
        Vertices that it shares with the batch before and with the next one.
    """

    batch: Batch
    inner_target: float
    below: int
    above: int


Work = Callable[[], Steps[Reduced]]


def in_batches_steps(
    batches: Iterable[Step | Batch], goal: Goal, budget: Budget, face_count: int | None = None
) -> Steps[tuple[Simplification, int]]:
    """Simplify batches that follow each other; returns also how many triangles they had.

    Parameters
    ----------
    batches : iterable of Step and Batch
        A single one of no more than `goal.most_whole` triangles is simplified as a whole.
    goal : Goal
    budget : Budget
    face_count : int, optional
        Number of triangles, if it is known and the steps of `batches` do not say how far they are.
    """
    passes = _Passes(goal, budget)
    left = yield from passes.batches_steps(batches, face_count)
    if not passes.full_faces:
        raise MeshError("there is no surface to simplify: no piece has a triangle")
    if passes.full_faces <= goal.most_whole(budget):
        simplification = yield from _after_batches_steps(whole_steps(left[0].mesh, goal, budget))
        return simplification, passes.full_faces
    target = goal.target(passes.full_faces)
    left = yield from passes.last_pass_steps(left, target)
    mesh, crossing_count = joined(left).mesh, passes.crossing_count
    if crossing_count is None:
        crossing_count = len((yield from self_intersections_steps(mesh.vertices, mesh.faces)))
    simplification = Simplification(mesh, passes.collapsed, passes.handles_cut, crossing_count)
    yield Step(1.0, simplification.message(target))
    return simplification, passes.full_faces


class _Passes:
    """The counts that all passes over the batches add to."""

    def __init__(self, goal: Goal, budget: Budget) -> None:
        self.goal, self.budget, self.numbering = goal, budget, Numbering()
        self.batch_faces, self.last_faces = goal.sizes(budget)
        self.most_at_once = goal.most_at_once(budget)
        self.large: list[Indices] = []
        self.moments = NOTHING  # of the components of all batches
        self.later_limit = goal.policy.later_volume * goal.largest_component
        self.planned: deque[tuple[float, int, int]] = deque()  # `_Held` without its batch, for each batch at work
        self.full_faces = self.reduced_faces = 0  # of the batches that came, and of those that are simplified
        self.collapsed, self.handles_cut = CollapsedComponents(), 0
        self.crossing_count: int | None = None  # pairs of triangles of the whole surface that cross, if known

    def batches_steps(self, batches: Iterable[Step | Batch], face_count: int | None) -> Steps[list[Batch]]:
        """Simplify the batches; a single one stays as it is."""
        single: list[Batch] = []
        left: list[Batch] = []
        held: list[_Held] = []  # those after `left`, which may still be merged
        fraction = 0.0
        works = self._works_steps(batches, single)
        policy = self.goal.policy
        most = self.budget.whole_faces // policy.merged
        merging = 0 if self.goal.max_error is not None else most * policy.merge_face_bytes
        for item in self._in_order_steps(works, self.batch_faces, self.budget.work_bytes + merging):
            if isinstance(item, Step):
                fraction = max(fraction, item.fraction, self.reduced_faces / face_count if face_count else 0.0)
                yield Step(BATCHES_SHARE * fraction, item.message)
            else:
                self._count(item)
                held.append(_Held(item.batch, *self.planned.popleft()))
                if self.goal.max_error is None and sum(each.batch.face_count for each in held) > most:
                    held = yield from self._merged_steps(held, BATCHES_SHARE * fraction)
                    if sum(each.batch.face_count for each in held) > most // 2:
                        left += [each.batch for each in held]
                        held = []
        left += [each.batch for each in held]
        return single or [batch for batch in left if batch.face_count]

    def _merged_steps(self, held: list[_Held], fraction: float) -> Steps[list[_Held]]:
        """Simplify batches that follow each other as one, where most of their triangles lie along seams between them.

        A slab of a wide volume is thin: its seams may have more triangles than the goal leaves it.
        """
        faces = sum(each.batch.face_count for each in held)
        inner_target, below, above = sum(each.inner_target for each in held), held[0].below, held[-1].above
        border = 2 * (below + above)
        if 2 * (inner_target + border) > faces:
            return held
        self._require(faces, faces * self.goal.policy.merge_face_bytes)
        batch = joined([each.batch for each in held])
        held.clear()
        reducing = WithResult(self._again(batch, inner_target, border)())
        for step in reducing:
            yield Step(fraction, step.message)
        reduced = replace(reducing.result, batch=self.numbering.completed(reducing.result.batch))
        self._count(replace(reduced, face_count=0))  # its triangles were counted before
        return [_Held(reduced.batch, inner_target, below, above)]

    def _works_steps(self, batches: Iterable[Step | Batch], single: list[Batch]) -> Generator[Step | Work, None, None]:
        """Yield the work on each batch when the next has come; a single batch goes to `single`."""
        held: Batch | None = None
        seam = 0  # vertices that the held batch has in common with the one before
        for item in batches:
            if isinstance(item, Step):
                yield item
                continue
            require_finite(item.mesh, item.numbers)
            if held is not None:
                following = shared_count(held, item)
                yield self._work(held, seam, following)
                seam = following
            held = item
            self.full_faces += item.face_count
        if held is not None and held.face_count == self.full_faces:
            single.append(held)
        elif held is not None:
            yield self._work(held, seam, 0)

    def _require(self, face_count: int, needed: int) -> None:
        """Raise if `needed` bytes to simplify some triangles at once are not available."""
        what = f"simplifying {face_count} triangles at once"
        remedy = "choose a region or a larger stride, or give it more memory"
        if self.budget.bytes is None:
            require_or_killed(needed, what, remedy)
        else:
            self.budget.require(needed, what, remedy)

    def _work(self, batch: Batch, below: int, above: int) -> Work:
        """Return the function that simplifies a batch, or raise if its memory is not available."""
        max_error = self.goal.max_error
        self._require(batch.face_count, self.goal.bytes_at_once(batch.face_count))
        if max_error is not None:
            self.planned.append((0.0, below, above))
            return partial(
                reduce_batch_steps,
                batch,
                0,
                0,
                self.goal.policy.first_error_share * max_error,
                largest_component=self.goal.largest_component,
                policy=self.goal.policy,
            )
        # Of a number of triangles every batch may have as many as if all were like those so far.
        share = self.goal.policy.spare * self.goal.target(self.full_faces) / self.full_faces
        inner_target = batch.face_count * min(1.0, share)
        self.planned.append((inner_target, below, above))
        return partial(
            reduce_batch_steps,
            batch,
            inner_target,
            2 * (below + above),
            largest_component=self.goal.largest_component,
            policy=self.goal.policy,
        )

    def _again(
        self, batch: Batch, inner_target: float, at_border: int, max_error: float | None = None, whole: bool = False
    ) -> Work:
        """Return the function that simplifies the rest of batches."""
        return partial(
            reduce_batch_steps,
            batch,
            inner_target,
            at_border,
            max_error,
            whole,
            largest_component=self.later_limit,
            by_box=True,
            protected=self.protected(),
            moments=self.moments,
            policy=self.goal.policy,
        )

    def _in_order_steps(
        self, works: Iterable[Step | Work], most: int, other_bytes: int = 0
    ) -> Generator[Step | Reduced, None, None]:
        """Yield the results of works of at most `most` triangles in their order, with numbers for new vertices."""
        threads = self.budget.threads_for(self.goal.policy.thread_factor * self.goal.bytes_at_once(most), other_bytes)
        for item in in_order_steps(works, threads):
            yield replace(item, batch=self.numbering.completed(item.batch)) if isinstance(item, Reduced) else item

    def _count(self, reduced: Reduced) -> None:
        """Count what a batch lost, if it is not simplified again in another way."""
        self.handles_cut += reduced.handles_cut
        self.collapsed += reduced.collapsed
        if reduced.large is not None and len(reduced.large):
            self.large.append(reduced.large)
        self.reduced_faces += reduced.face_count
        moments = reduced.moments.at(reduced.batch.numbers[reduced.moments.vertices])
        if len(reduced.unused):
            self.moments = self.moments.select(~np.isin(self.moments.vertices, reduced.unused))
        self.moments = self.moments.with_others(moments)

    def protected(self) -> Indices:
        """Indices of the vertices of components that were too large to go when they were first simplified."""
        if len(self.large) > 1:
            self.large = [np.unique(np.concatenate(self.large))]
        return self.large[0] if self.large else np.empty(0, np.int64)

    def last_pass_steps(self, batches: list[Batch], target: int) -> Steps[list[Batch]]:
        """Simplify all to the goal: at once where it is small, or regions bring too little; else region by region."""
        max_error, policy = self.goal.max_error, self.goal.policy
        if max_error is not None and len(batches) > 1:
            max_error *= 1.0 - policy.first_error_share
        faces, before = sum(batch.face_count for batch in batches), 0
        whole = stuck = False
        most, axis = self.last_faces, -1
        while faces > target and not (whole and faces == before):
            give_back()  # what was freed between the batches that are kept
            surface = joined(batches)
            batches.clear()  # the caller's list too: all triangles are there twice and not three times
            parts, axis = regions(surface, faces if stuck else most, axis)
            del surface
            # Borders of regions stay, so these may not give all: the next are larger, and follow along another axis.
            batches, whole, most = [], len(parts) == 1, self.most_at_once
            goal = target if whole else max(target, faces // 2)
            reduced = yield from self._regions_steps(parts, goal, max_error)
            batches = [each.batch for each in reduced]
            for each in reduced:
                self._count(each)
            before, faces = faces, sum(batch.face_count for batch in batches)
            stuck = before - faces < policy.least_gain * (before - goal)
            if max_error is not None:
                break
        return batches

    def _regions_steps(self, parts: list[Batch], goal: int, max_error: float | None) -> Steps[list[Reduced]]:
        """Simplify regions side by side to a number of triangles in all; those that then cross each other, as one."""
        inner_target = _shares(goal, [part.face_count for part in parts])
        results: list[Reduced | None] = [None] * len(parts)
        while True:
            numbers = [number for number, result in enumerate(results) if result is None]
            most = max(parts[number].face_count for number in numbers)
            self.budget.require(
                self.goal.bytes_at_once(most),
                f"simplifying {sum(part.face_count for part in parts)} triangles",
                "ask for fewer triangles, or use a larger stride",
            )
            works = [
                self._again(
                    parts[number], inner_target[number] if max_error is None else 0, 0, max_error, len(parts) == 1
                )
                for number in numbers
            ]
            done = 0
            for item in self._in_order_steps(works, most):
                if isinstance(item, Step):
                    yield Step(BATCHES_SHARE + (1.0 - BATCHES_SHARE) * done / len(works))
                else:
                    results[numbers[done]] = item
                    done += 1
            reduced = [result for result in results if result is not None]
            crossing = yield from crossing_batches_steps([each.batch for each in reduced])
            counts = [each.crossing_count for each in reduced]
            self.crossing_count = None if None in counts else sum(filter(None, counts)) + len(crossing)
            groups = _groups(crossing, [part.face_count for part in parts], self.most_at_once)
            if len(groups) == len(parts):
                return reduced
            results = [results[group[0]] if len(group) == 1 else None for group in groups]
            inner_target = [sum(inner_target[number] for number in group) for group in groups]
            parts = [joined([parts[number] for number in group]) for group in groups]


def _groups(pairs: Indices, counts: list[int], most: int) -> list[list[int]]:
    """Indices in groups, so that those of a pair are in one where its counts do not come to more than `most`.

    Examples
    --------
    >>> _groups(np.array([[1, 3], [0, 2]]), [5, 5, 9, 5], 12)
    [[0], [1, 3], [2]]
    """
    groups, counts = Groups(len(counts)), list(counts)
    for pair in np.unique(pairs, axis=0).tolist():
        low, high = sorted(map(groups.root, pair))
        if low != high and counts[low] + counts[high] <= most:
            groups.join(low, high)
            counts[low] += counts[high]
    return groups.lists()


def _shares(goal: int, counts: list[int]) -> list[int]:
    """Return the number to leave of each count of triangles, `goal` in all; pairs go, so an odd one is passed on.

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


def _after_batches_steps(steps: Steps[Simplification]) -> Steps[Simplification]:
    """Map the steps to the time that is left after the batches."""
    try:
        while True:
            try:
                fraction, message = next(steps)
            except StopIteration as end:
                result: Simplification = end.value
                return result
            yield Step(BATCHES_SHARE + (1.0 - BATCHES_SHARE) * fraction, message)
    finally:
        steps.close()
