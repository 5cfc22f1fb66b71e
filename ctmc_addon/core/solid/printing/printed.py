# SPDX-License-Identifier: GPL-3.0-or-later
"""Add the facts for a print lab to parts; no other module does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...errors import MeshError
from ...machine.budget import Budget
from ...measures.reconstruction import Reconstruction, Stage
from ...progress import Stages, Steps
from ..request import SolidRequest
from .print_facts import print_facts_steps

PRINTING = "Measuring for print"
"""The stage in which the facts of parts are measured."""


def printed_steps(
    results: Sequence[Reconstruction], solid: SolidRequest, budget: Budget | None = None, spacing: float | None = None
) -> Steps[list[Reconstruction]]:
    """Return parts, or any surfaces, with the facts for a print lab and notes on what speaks against a print.

    Parameters
    ----------
    results : sequence of Reconstruction
        Held in memory, in RAS+ mm.
    solid : SolidRequest
        The request for the parts; only its bed, pegs and least wall matter.
    budget : Budget, optional
    spacing : float, optional
        Distance between samples of walls, mm; by default that of the samples of the volume, less for thin walls.

    Raises
    ------
    MeshError
        If a surface has been written already or has no triangles.
    """
    stages = Stages({f"{at}": 1.0 + len(result.mesh.faces) for at, result in enumerate(results)})
    printed = []
    for at, result in enumerate(results):
        if result.measured is not None:
            raise MeshError("the surface is already written, and facts for print need it in memory; make it again")
        between = sum(result.spacing_mm) / 3 if spacing is None else spacing
        facts = yield from stages.run(f"{at}", print_facts_steps(result.mesh, solid, budget, between))
        stage = Stage(PRINTING, stages.seconds[f"{at}"])
        notes = (*result.notes, *facts.notes)
        printed.append(replace(result, printing=facts, notes=notes, stages=(*result.stages, stage)))
    return printed
