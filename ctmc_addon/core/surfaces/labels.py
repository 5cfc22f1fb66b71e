# SPDX-License-Identifier: GPL-3.0-or-later
"""Make surfaces of several labels of one volume, with shared interfaces or each by itself.

Made by itself, a surface has the same bytes as from `reconstruct`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..errors import LabelError, MeshError, ThresholdError
from ..machine.budget import Budget
from ..maps.quantity import Quantity
from ..maps.request import MapRequest
from ..measures.reconstruction import Reconstruction
from ..progress import Stages, Steps, finish
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink
from ..volume.labels.extents import ALL, chosen_labels_steps
from ..volume.region import region_box
from ..volume.volume import Volume
from .each_label import left_out, no_surface
from .make import make_surfaces_steps
from .request import MadeSurface, SurfaceRequest

STAGES = {"Finding the labels": 1, "Making the surfaces": 30}


class LabelSurfaces(NamedTuple):
    """Surfaces of several labels, and why other labels have none.

    Parameters
    ----------
    surfaces : list of Reconstruction
        Surfaces in the order in which the labels were asked for.
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
    maps: Sequence[Quantity] | MapRequest = (),
) -> LabelSurfaces:
    """Make a surface of each of several labels.

    Parameters
    ----------
    volume : Volume
        If threads cannot share its file, labels are made one after the other.
    settings : ReconstructionSettings
        Settings of every surface, without their label. With `interfaces` "shared" neighbors have the same triangles
        where they touch, and a number of triangles is that of all surfaces of a layer.
    labels : sequence of int, optional
        By default all but 0; labels without a surface are then left out and reported.
    budget : Budget, optional
        Threads and memory; by default what the machine has. The result does not depend on it.
    maps : sequence of Quantity or MapRequest
        Maps to make on every surface.

    Raises
    ------
    CtmcError
        As `reconstruct`, and if a requested label has no surface.

    Examples
    --------
    >>> import numpy as np
    >>> values = np.zeros((8, 8, 20), np.uint8)
    >>> values[2:6, 2:6, 2:6], values[3:5, 3:5, 12:18] = 1, 2
    >>> volume = Volume(values, np.eye(4), kind="label", label_names={1: "box", 2: "bar"})
    >>> [result.label_name for result in reconstruct_labels(volume, ReconstructionSettings()).surfaces]
    ['box', 'bar']
    """
    return finish(reconstruct_labels_steps(volume, settings, labels, budget, maps=MapRequest.of(maps)))


def reconstruct_labels_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    labels: Sequence[int] | None = None,
    budget: Budget | None = None,
    sink_of: Callable[[int], Sink] = lambda _: HOLD,
    maps: MapRequest | None = None,
) -> Steps[LabelSurfaces]:
    """`reconstruct_labels` as steps; closing the generator cancels.

    `sink_of` a label says where its surface goes; by default all are held.
    """
    budget = budget or Budget()
    stages = Stages(STAGES)
    finding, making = STAGES
    choices = (ALL,) if labels is None else tuple(labels)
    looking = chosen_labels_steps(volume, choices, region_box(volume, settings), budget.threads)
    selected = yield from stages.run(finding, looking)
    requests = [SurfaceRequest(replace(settings, threshold=None, label=label), sink_of(label)) for label in selected]
    working = make_surfaces_steps(volume, requests, budget, all_needed=labels is not None, maps=maps)
    surfaces, errors = [], {}
    for label, outcome in zip(selected, (yield from stages.run(making, working)), strict=True):
        if isinstance(outcome, MadeSurface):
            surfaces.append(outcome.result)
        elif isinstance(outcome, (LabelError, MeshError, ThresholdError)):
            errors[label] = outcome
        else:
            raise outcome
    if not surfaces:
        raise no_surface(volume, errors)
    return LabelSurfaces(surfaces, [left_out(volume, label, error) for label, error in errors.items()])
