# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of several labels of one volume: one look for all their boxes, then each in its own box, side by side.

A label that is more than its share of the work goes first and alone, with all threads; the others follow from the
largest to the smallest, one thread each. Every surface has the bytes of `reconstruct` with that label alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from .errors import CtmcError, LabelError, MemoryLimitError, MeshError, ThresholdError
from .memory import available_bytes
from .parallel import side_by_side_steps, worker_count
from .pipeline import Reconstruction, reconstruct_steps
from .progress import Stages, Steps, finish
from .settings import ReconstructionSettings
from .volume.labels import Extents, chosen_labels_steps, label_extents_steps
from .volume.region import region_box
from .volume.volume import Volume

STAGES = {"Finding the labels": 1, "Making the surfaces": 30}
SMALL_WORK = 1 << 15  # voxels that the smallest label counts for


class LabelSurfaces(NamedTuple):
    """The surfaces of several labels, and why others have none.

    Parameters
    ----------
    surfaces : list of Reconstruction
        In the order in which the labels were asked for.
    left_out : list of str
        A sentence for each label without a surface; empty unless all labels were asked for.
    """

    surfaces: list[Reconstruction]
    left_out: list[str]


def reconstruct_labels(
    volume: Volume,
    settings: ReconstructionSettings,
    labels: Sequence[int] | None = None,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> LabelSurfaces:
    """Make a surface of each of several labels.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
        Of every surface; their own label does not count.
    labels : sequence of int, optional
        By default all but 0; then those that have no surface are left out and said.
    threads : int, optional
        By default one for each processor. The result does not depend on it.
    memory_limit : int, optional
        Bytes the work may take; by default what the machine has available.

    Raises
    ------
    CtmcError
        As `reconstruct`; a label that was asked for and has no surface.

    Examples
    --------
    >>> import numpy as np
    >>> values = np.zeros((8, 8, 20), np.uint8)
    >>> values[2:6, 2:6, 2:6], values[3:5, 3:5, 12:18] = 1, 2
    >>> volume = Volume(values, np.eye(4), kind="label", label_names={1: "box", 2: "bar"})
    >>> [result.label_name for result in reconstruct_labels(volume, ReconstructionSettings()).surfaces]
    ['box', 'bar']
    """
    return finish(reconstruct_labels_steps(volume, settings, labels, threads, memory_limit))


def reconstruct_labels_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    labels: Sequence[int] | None = None,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Steps[LabelSurfaces]:
    """`reconstruct_labels` as steps; closing the generator cancels."""
    stages, workers = Stages(STAGES), worker_count(threads)
    finding, making = STAGES
    box = region_box(volume, settings)
    choices = ("all",) if labels is None else tuple(labels)
    chosen = yield from stages.run(finding, chosen_labels_steps(volume, choices, box, threads))
    extents = yield from stages.run(finding, label_extents_steps(volume, box, threads))
    wanted = {label: replace(settings, threshold=None, label=label) for label in chosen}
    for label in chosen:
        if label not in extents:  # raises, with the labels that there are
            yield from reconstruct_steps(volume, wanted[label], threads, memory_limit)
    made = yield from stages.run(making, _made_steps(volume, wanted, extents, workers, memory_limit))
    surfaces, left_out = [], []
    for label in chosen:
        result = made[label]
        if isinstance(result, Reconstruction):
            surfaces.append(result)
        elif labels is None and isinstance(result, (LabelError, MeshError, ThresholdError)):
            left_out.append(f"{label_title(volume, label)} is left out: {result}.")
        else:
            raise result
    if not surfaces:
        raise LabelError(f"no label of {volume.name} has a surface; {left_out[0]}")
    return LabelSurfaces(surfaces, left_out)


def label_title(volume: Volume, label: int) -> str:
    """What a label is called in a sentence: 'label 3 (spleen)'."""
    name = volume.label_names.get(label, "")
    return f"label {label} ({name})" if name else f"label {label}"


Made = dict[int, "Reconstruction | CtmcError"]


def _made_steps(
    volume: Volume,
    wanted: dict[int, ReconstructionSettings],
    extents: Extents,
    workers: int,
    memory_limit: int | None,
) -> Steps[Made]:
    """Return the surface of every label, or its error."""
    work = {
        label: float(SMALL_WORK + math.prod(stop - start for start, stop in extents[label].box)) for label in wanted
    }
    order = sorted(wanted, key=lambda label: -work[label])
    alone = [label for label in order if work[label] * workers > sum(work.values())] if workers > 1 else []
    others = order[len(alone) :]
    shares = {"alone": sum(work[label] for label in alone) / workers, "others": sum(work[label] for label in others)}
    stages = Stages({name: share + 1.0 for name, share in shares.items()})
    limit = available_bytes() if memory_limit is None else memory_limit
    made: Made = {}

    def begun(label: int, threads: int, bytes_: int | None) -> Callable[[], Steps[Reconstruction | CtmcError]]:
        return lambda: _tried_steps(volume, wanted[label], threads, bytes_)

    def several_steps(labels: Sequence[int], at_once: int, name: str) -> Steps[None]:
        share = None if memory_limit is None and at_once == 1 else None if limit is None else limit // at_once
        works = [begun(label, workers // at_once, share) for label in labels]
        weights = [work[label] for label in labels]
        results = yield from stages.run(name, side_by_side_steps(works, weights, at_once))
        made.update(zip(labels, results, strict=True))

    yield from several_steps(alone, 1, "alone")
    yield from several_steps(others, workers, "others")
    # What does not fit beside others may fit alone.
    again = [label for label in others if workers > 1 and isinstance(made[label], MemoryLimitError)]
    yield from several_steps(again, 1, "others")
    return made


def _tried_steps(
    volume: Volume, settings: ReconstructionSettings, threads: int, memory_limit: int | None
) -> Steps[Reconstruction | CtmcError]:
    try:
        return (yield from reconstruct_steps(volume, settings, threads, memory_limit))
    except CtmcError as error:
        return error
