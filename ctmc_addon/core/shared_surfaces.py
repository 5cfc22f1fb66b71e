# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of several labels of one volume whose neighbors share their interfaces: made and simplified together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .budget import Budget
from .errors import MeshError
from .extraction.interfaces import LabelComplex, label_complex_steps
from .mesh.complex_components import keep_complex_components_steps
from .mesh.face_normals import vertex_normals_steps
from .mesh.label_complex import ComplexSurface, neighbors_of
from .mesh.triangle_mesh import Surface, TriangleMesh
from .progress import Stages, Step, Steps
from .reconstruct import AVERAGING, EXTRACTING, KEEPING, SIMPLIFYING, voxels_visited
from .reconstruction import Reconstruction, Stage
from .settings import ReconstructionSettings
from .simplification.label_complexes import ComplexSimplification, simplify_complex_steps
from .volume.region import region_box
from .volume.volume import Volume

WEIGHTS = {EXTRACTING: 60, KEEPING: 5, SIMPLIFYING: 30, AVERAGING: 5}


class SharedSurfaces(NamedTuple):
    """Surfaces that fit each other, by label.

    Parameters
    ----------
    full : mapping of int to Reconstruction
        Every surface before the built-in simplifier, at both ends of alpha.
    results : mapping of int to Reconstruction
        What the settings ask for; the same where nothing is simplified.
    errors : mapping of int to MeshError
        Why a label has no surface.
    """

    full: Mapping[int, Reconstruction]
    results: Mapping[int, Reconstruction]
    errors: Mapping[int, MeshError]


def shared_surfaces_steps(
    volume: Volume, settings: ReconstructionSettings, labels: Sequence[int], budget: Budget
) -> Steps[SharedSurfaces]:
    """Make the surfaces of labels that all have samples, neighbors with the same triangles where they touch.

    Parameters
    ----------
    volume : Volume
        Of labels.
    settings : ReconstructionSettings
        Of every surface; their own label does not count. A number of triangles is that of all surfaces, what two of
        them share counted once.
    labels : sequence of int
    budget : Budget

    Raises
    ------
    MemoryLimitError
        Where the labels do not fit in memory together.
    CtmcError
        As `reconstruct`.
    """
    return (yield from _Making(volume, settings, labels, budget).result_steps())


class _Making:
    """Surfaces that are being made together."""

    def __init__(self, volume: Volume, settings: ReconstructionSettings, labels: Sequence[int], budget: Budget) -> None:
        self.volume, self.settings, self.labels, self.budget = volume, settings, labels, budget
        self.stages = Stages(WEIGHTS)
        self.extracted: LabelComplex

    def result_steps(self) -> Steps[SharedSurfaces]:
        settings, stages = self.settings, self.stages
        extracting = label_complex_steps(self.volume, settings, self.labels, self.budget)
        self.extracted = yield from stages.run(EXTRACTING, extracting)
        surface, errors = self.extracted.surface, {}
        if settings.keep_parts or settings.min_part_mm3:
            limits = (settings.alpha, settings.keep_parts, settings.min_part_mm3)
            keeping = keep_complex_components_steps(surface, self.labels, *limits)
            surface, errors = yield from stages.run(KEEPING, keeping)
        labels = [label for label in self.labels if label not in errors]
        simplified = None
        if settings.simplifies and settings.simplifier == "builtin":
            goals = (settings.reduction, settings.target_faces, settings.max_error_mm)
            simplifying = simplify_complex_steps(surface.at(settings.alpha), *goals, self.budget)
            simplified = yield from stages.run(SIMPLIFYING, simplifying)
        full = yield from stages.run(AVERAGING, self._full_steps(surface, labels))
        results = dict(full)
        if simplified is not None:
            results = yield from stages.run(AVERAGING, self._simplified_steps(simplified, full))
        timed = tuple(Stage(name, stages.seconds[name]) for name in WEIGHTS if name in stages.seconds)
        return SharedSurfaces(
            {label: replace(result, stages=timed) for label, result in full.items()},
            {label: replace(result, stages=timed) for label, result in results.items()},
            errors,
        )

    def _full_steps(self, surface: ComplexSurface, labels: Sequence[int]) -> Steps[dict[int, Reconstruction]]:
        """Return each label's own surface at both ends of alpha."""
        full = {}
        for at, label in enumerate(labels):
            yield Step(at / len(labels))
            own, beyond = surface.of_label(label)
            mesh = own.at(self.settings.alpha)
            normals = yield from vertex_normals_steps(mesh.vertices, mesh.faces)
            own, mesh = replace(own, normals=normals), replace(mesh, normals=normals)
            full[label] = self._described(label, mesh, own, beyond)
        return full

    def _simplified_steps(
        self, simplified: ComplexSimplification, full: Mapping[int, Reconstruction]
    ) -> Steps[dict[int, Reconstruction]]:
        """Return what simplification has left of each label; a label of which nothing is left stays out."""
        results = {}
        for at, (label, result) in enumerate(full.items()):
            yield Step(at / len(full))
            mesh, beyond = simplified.mesh.of_label(label)
            normals = None
            if self.settings.normals == "mesh":
                normals = yield from vertex_normals_steps(mesh.vertices, mesh.faces)
            results[label] = replace(
                result,
                mesh=replace(mesh, normals=normals),
                surface=None,
                notes=(*result.notes, *simplified.notes),
                beyond=beyond,
                neighbors=neighbors_of(mesh, beyond),
            )
        return results

    def _described(self, label: int, mesh: TriangleMesh, surface: Surface, beyond: NDArray[np.int32]) -> Reconstruction:
        volume, settings, extracted = self.volume, self.settings, self.extracted
        return Reconstruction(
            mesh=mesh,
            surface=surface,
            settings=replace(settings, threshold=None, label=label),
            threshold=0.5,
            full_faces=len(mesh.faces),
            voxels_visited=voxels_visited(region_box(volume, settings), settings.stride, extracted.slice_steps),
            stages=(),
            spacing_mm=volume.spacing,
            notes=(*volume.notes, *extracted.notes),
            name=volume.name,
            slice_steps=extracted.slice_steps,
            wrong_side=extracted.wrong_side[label],
            label_name=volume.label_names.get(label, ""),
            label_color=volume.label_colors.get(label),
            beyond=beyond,
            neighbors=neighbors_of(mesh, beyond),
        )
