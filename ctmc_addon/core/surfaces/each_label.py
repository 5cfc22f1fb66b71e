# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on each of several labels of a volume, side by side.

A label that is more than its share of the work goes first and alone, with all threads; the others follow from the
largest to the smallest, one thread each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from ..errors import CtmcError, LabelError, MemoryLimitError
from ..machine.budget import Budget
from ..machine.memory import give_back
from ..machine.parallel import side_by_side_steps
from ..planning.plan import advised_steps
from ..progress import Stages, Steps
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink
from ..volume.labels.extents import label_extents_steps
from ..volume.volume import Box, Volume

Result = TypeVar("Result")


def label_title(volume: Volume, label: int) -> str:
    """Return the name of a label for messages: 'label 3 (spleen)'."""
    name = volume.label_names.get(label, "")
    return f"label {label} ({name})" if name else f"label {label}"


def left_out(volume: Volume, label: int, error: CtmcError) -> str:
    """Return the note on a label without a surface, if all labels were asked for."""
    return without(label_title(volume, label), error)


def without(title: str, error: CtmcError) -> str:
    """Return the note on a structure that was left out."""
    sentence = f"{title} is left out: {error}"
    return f"{sentence}."


class NoSurfaceError(LabelError):
    """Raised if none of several labels has a surface; `errors` has the reason for each."""

    def __init__(self, message: str, errors: Mapping[int, CtmcError]) -> None:
        super().__init__(message)
        self.errors = errors


def no_surface(volume: Volume, errors: Mapping[int, CtmcError]) -> NoSurfaceError:
    """Return the error for a volume none of whose labels has a surface, with the first reason."""
    label, error = next(iter(errors.items()))
    return NoSurfaceError(f"no label of {volume.name} has a surface; {left_out(volume, label, error)}", errors)


def each_label_steps(
    volume: Volume,
    region: Box,
    runs: Sequence[ReconstructionSettings],
    work_steps: Callable[[int, Budget], Steps[Result]],
    budget: Budget,
    sink: Sink = HOLD,
) -> Steps[list[Result | CtmcError]]:
    """Run `work_steps` for several labels at a time, and return each result or `CtmcError`.

    Parameters
    ----------
    volume : Volume
    region : Box
        Region of the settings.
    runs : sequence of ReconstructionSettings
        Alike but for their labels.
    work_steps : function
        Takes the number of a run, and its budget: what does not fit beside others is tried again alone. Driven in
        threads of its own.
    budget : Budget
    sink : Sink
        Sink that receives the surfaces, for the advice.

    Raises
    ------
    MemoryLimitError
        For the first label that does not fit by itself.
    """
    workers = budget.thread_count
    extents = yield from label_extents_steps(volume, region, budget.threads)  # Look through the volume once.
    work = [float(budget.small_label)] * len(runs)
    for at, run in enumerate(runs):
        if run.label in extents:
            work[at] += math.prod(stop - start for start, stop in extents[run.label].box)
    order = sorted(range(len(runs)), key=lambda at: -work[at])
    large = [at for at in order if work[at] * workers > sum(work)] if workers > 1 else []
    if not volume.reader.thread_safe:
        large = order
    small = order[len(large) :]
    stages = Stages({"alone": 1.0 + sum(work[at] for at in large), "others": 1.0 + sum(work[at] for at in small)})
    outcomes: dict[int, Result | CtmcError] = {}

    def tried_steps(at: int, at_once: int) -> Steps[Result | CtmcError]:
        side_by_side = at_once > 1
        own = budget.shared_by(at_once) if side_by_side else replace(budget, threads=workers)
        working = work_steps(at, own)
        if not side_by_side:
            working = advised_steps(working, volume, runs[at], own, sink)
        try:
            with own.refusal("this surface", "choose a region"):
                return (yield from working)
        except MemoryLimitError as error:
            if side_by_side:
                return without_traceback(error)
            label = runs[at].label  # Stop: all surfaces are needed.
            if label is None:
                raise
            raise MemoryLimitError(f"{label_title(volume, label)}: {error}") from error
        except CtmcError as error:
            return without_traceback(error)

    def several_steps(which: Sequence[int], at_once: int, name: str) -> Steps[None]:
        works = [lambda at=at: tried_steps(at, at_once) for at in which]
        weights = [work[at] for at in which]
        results = yield from stages.run(name, side_by_side_steps(works, weights, at_once))
        outcomes.update(zip(which, results, strict=True))

    yield from several_steps(large, 1, "alone")
    yield from several_steps(small, workers, "others")
    # What does not fit beside others may fit alone.
    again = [at for at in small if workers > 1 and isinstance(outcomes[at], MemoryLimitError)]
    give_back()
    yield from several_steps(again, 1, "others")
    return [outcomes[at] for at in range(len(runs))]


def without_traceback(error: CtmcError) -> CtmcError:
    """Return the error without its traceback and causes, which keep arrays alive."""
    error.__cause__ = error.__context__ = None
    return error.with_traceback(None)
