# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of several labels of one volume: with shared interfaces (shared.py), or each by itself.

By itself every surface has the bytes of `reconstruct` with that label alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..budget import Budget
from ..errors import CtmcError, LabelError, MeshError, ThresholdError
from ..progress import Stages, Steps, finish
from ..reconstruction import Reconstruction
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink
from ..volume.labels import ALL, chosen_labels_steps, label_extents_steps
from ..volume.region import region_box
from ..volume.volume import Volume
from .each_label import each_label_steps, left_out, no_surface
from .extract import reconstruct_steps
from .shared import shared_surfaces_steps

STAGES = {"Finding the labels": 1, "Making the surfaces": 30}


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
    budget: Budget | None = None,
) -> LabelSurfaces:
    """Make a surface of each of several labels.

    Parameters
    ----------
    volume : Volume
        Of a file that threads cannot share, values are fetched for one label after the other.
    settings : ReconstructionSettings
        Of every surface; their own label does not count. With `interfaces` "shared" neighbors have the same triangles
        where they touch, and a number of triangles is that of all surfaces of a layer.
    labels : sequence of int, optional
        By default all but 0; then those that have no surface are left out and said.
    budget : Budget, optional
        Threads and memory; by default what the machine has. The result does not depend on it.

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
    return finish(reconstruct_labels_steps(volume, settings, labels, budget))


def reconstruct_labels_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    labels: Sequence[int] | None = None,
    budget: Budget | None = None,
    sink_of: Callable[[int], Sink] = lambda _: HOLD,
) -> Steps[LabelSurfaces]:
    """`reconstruct_labels` as steps; closing the generator cancels.

    `sink_of` a label says where its surface goes; by default all are held.
    """
    budget = budget or Budget()
    stages = Stages(STAGES)
    finding, making = STAGES
    box = region_box(volume, settings)
    choices = (ALL,) if labels is None else tuple(labels)
    chosen = yield from stages.run(finding, chosen_labels_steps(volume, choices, box, budget.threads))
    extents = yield from stages.run(finding, label_extents_steps(volume, box, budget.threads))
    runs = [replace(settings, threshold=None, label=label) for label in chosen]
    for run in runs:
        if run.label not in extents:  # raises, with the labels that there are
            yield from reconstruct_steps(volume, run, budget)
    if settings.interfaces == "shared" and len(chosen) > 1:
        results = yield from stages.run(
            making, _shared_steps(volume, settings, chosen, budget, sink_of, labels is not None)
        )
    else:
        results = yield from stages.run(making, _separate_steps(volume, runs, budget, sink_of))
    surfaces, errors = [], {}
    for label, result in zip(chosen, results, strict=True):
        if isinstance(result, Reconstruction):
            surfaces.append(result)
        elif labels is None and isinstance(result, (LabelError, MeshError, ThresholdError)):
            errors[label] = result
        else:
            raise result
    if not surfaces:
        raise no_surface(volume, errors)
    return LabelSurfaces(surfaces, [left_out(volume, label, error) for label, error in errors.items()])


def _separate_steps(
    volume: Volume, runs: Sequence[ReconstructionSettings], budget: Budget, sink_of: Callable[[int], Sink]
) -> Steps[list[Reconstruction | CtmcError]]:
    """Make each label by itself."""

    def work_steps(at: int, budget: Budget) -> Steps[Reconstruction]:
        return (yield from reconstruct_steps(volume, runs[at], budget, sinks[at]))

    sinks = [sink_of(run.label) for run in runs if run.label is not None]
    return (yield from each_label_steps(volume, runs, work_steps, budget, sinks[0]))


def _shared_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    labels: Sequence[int],
    budget: Budget,
    sink_of: Callable[[int], Sink],
    all_needed: bool,
) -> Steps[list[Reconstruction | CtmcError]]:
    """Make all labels together, then hand each to its sink."""
    made = yield from shared_surfaces_steps(volume, settings, labels, budget, all_needed)
    results: list[Reconstruction | CtmcError] = []
    for label in labels:
        if label not in made.results:
            results.append(made.errors[label])
            continue
        result, sink = made.results[label], sink_of(label)
        if not sink.holds:
            taken = yield from sink.mesh_steps(result.mesh)
            result = replace(result, mesh=taken.mesh, surface=None, measured=taken.measured, beyond=None)
        results.append(result)
    return results
