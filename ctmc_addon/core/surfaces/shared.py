# SPDX-License-Identifier: GPL-3.0-or-later
"""Make and simplify together the labels of one layer whose neighbors share their interfaces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import CtmcError
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction
from ..mesh.labels.complex_components import keep_complex_components_steps
from ..mesh.labels.label_complex import ComplexMesh, ComplexSurface, borders_of, neighbors_of
from ..mesh.triangle_mesh import Surface, TriangleMesh, replayed_steps
from ..progress import Step, Steps
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Taken
from ..volume.volume import Volume
from .finish import (
    AVERAGING,
    CHOOSING,
    EXTRACTING,
    KEEPING,
    LOOKING,
    SIMPLIFYING,
    Finish,
    averaged_steps,
    described,
    limits_of,
)
from .finish_labels import crossings_steps, own_surfaces_steps, simplified_labels_steps
from .interfaces import LabelComplex, complex_steps
from .request import MadeSurface, Scope

CLASSIC_NOTE = "Interfaces are cut by the classic cases; topology trilinear needs interfaces separate."
WEIGHTS = {EXTRACTING: 60, CHOOSING: 5, KEEPING: 5, SIMPLIFYING: 30, AVERAGING: 5, LOOKING: 15}


class TouchingLabels(Finish):
    """Make surfaces of the labels of one layer that share walls."""

    extracted: LabelComplex

    def __init__(
        self,
        volume: Volume,
        scope: Scope,
        settings: ReconstructionSettings,
        labels: Sequence[int],
        budget: Budget,
        all_needed: bool,
    ) -> None:
        super().__init__(settings, budget, HOLD, WEIGHTS)
        self.volume, self.scope, self.labels, self.all_needed = volume, scope, labels, all_needed

    def result_steps(self) -> Steps[dict[int, MadeSurface | CtmcError]]:
        """Extract, drop small components, simplify, and return each label's own surface."""
        stages = self.stages
        extracting = complex_steps(self.volume, self.settings, self.labels, self.budget, self.all_needed, self.scope)
        self.extracted = yield from stages.run(EXTRACTING, extracting)
        surface = self.extracted.surface
        errors: dict[int, CtmcError] = dict(self.extracted.errors)
        whole = Surface(surface.midpoints, surface.linear, surface.faces)
        yield from self.choose_alpha_steps(lambda _: replayed_steps([whole]))
        settings, alpha = self.settings, self.settings.alpha_number
        if settings.drops_components:
            keeping = keep_complex_components_steps(surface, self.extracted.labels, alpha, limits_of(settings))
            surface, dropped = yield from stages.run(KEEPING, keeping)
            errors |= dropped
            if dropped and self.all_needed:
                raise next(iter(dropped.values()))
        labels = [label for label in self.labels if label not in errors]
        if not labels:
            return {**errors}
        full_mesh = surface.at(alpha)
        simplified = (yield from simplified_labels_steps(self, full_mesh)) if settings.simplifies_here else None
        full = yield from stages.run(AVERAGING, self._full_steps(surface, full_mesh, labels))
        if simplified is not None:
            own = own_surfaces_steps(self, simplified, full, len(full_mesh.faces), averages=settings.normals == "mesh")
            results = yield from own
        else:
            crossings = yield from stages.run(LOOKING, crossings_steps(full_mesh, surface.may_cross))
            results = {label: replace(full[label], self_intersections=crossings.get(label, 0)) for label in labels}
        surfaces = {
            label: MadeSurface(replace(results[label], stages=self.ran), replace(full[label], stages=self.ran))
            for label in labels
        }
        return {**surfaces, **errors}

    def _full_steps(
        self, surface: ComplexSurface, mesh: ComplexMesh, labels: Iterable[int]
    ) -> Steps[dict[int, Reconstruction]]:
        """Return each label's own surface at both ends of alpha."""
        full: dict[int, Reconstruction] = {}
        interfaces, borders = mesh.interfaces, borders_of(surface.faces, surface.sides)
        for label in labels:
            yield Step(len(full) / len(self.labels))
            own, beyond = surface.within(borders[label])
            at_alpha = yield from averaged_steps(own.at(self.settings.alpha_number))
            described = self._described(label, at_alpha, replace(own, normals=at_alpha.normals), beyond)
            full[label] = replace(described, neighbors=neighbors_of(label, interfaces))
        return full

    def _described(self, label: int, mesh: TriangleMesh, surface: Surface, beyond: NDArray[np.int32]) -> Reconstruction:
        """Describe a label's own surface."""
        extracted = self.extracted
        result = described(
            self.volume,
            self.scope,
            replace(self.settings, threshold=None, label=label),
            Taken(mesh, surface, wrong_side=extracted.wrong_side[label]),
            notes=extracted.notes[label],
            slice_steps=self.scope.slice_steps,
            choice=self.choice,
            threshold=extracted.thresholds[label],
            full_faces=len(mesh.faces),
            stages=(),
            beyond=beyond,
        )
        return result if self.settings.topology == "classic" else replace(result, notes=(*result.notes, CLASSIC_NOTE))
