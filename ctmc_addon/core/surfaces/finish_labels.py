# SPDX-License-Identifier: GPL-3.0-or-later
"""Finish labels, or parts of a solid, that were made as one complex: simplify it, then give each its own surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..measures.reconstruction import Reconstruction
from ..mesh.intersections import self_intersections_steps
from ..mesh.labels.label_complex import ComplexMesh, borders_of, neighbors_of
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Step, Steps
from ..simplification.complexes.flats import Flat
from ..simplification.complexes.simplify import ComplexSimplification, simplify_complex_steps
from ..simplification.engine.component_removal import CollapsedComponents
from ..simplification.policy import POLICY, Policy
from ..simplification.whole import Simplification
from .finish import AVERAGING, LOOKING, SIMPLIFYING, Finish, averaged_steps, goal_of


def simplified_labels_steps(
    finishing: Finish, mesh: ComplexMesh, policy: Policy = POLICY, flats: Sequence[Flat] = ()
) -> Steps[ComplexSimplification]:
    """Simplify labels together as the settings ask; what is on one of the `flats` stays on it."""
    goal = goal_of(finishing.settings)
    simplifying = simplify_complex_steps(mesh, budget=finishing.budget, policy=policy, flats=flats, **goal)
    return (yield from finishing.stages.run(SIMPLIFYING, simplifying))


def own_surfaces_steps(
    finishing: Finish,
    simplified: ComplexSimplification,
    full: Mapping[int, Reconstruction],
    full_faces: int,
    averages: bool,
) -> Steps[dict[int, Reconstruction]]:
    """Return each label's own surface after simplification, with notes on what it lost and what crosses.

    Parameters
    ----------
    finishing : Finish
    simplified : ComplexSimplification
    full : mapping of int to Reconstruction
        Surface of every label before.
    full_faces : int
        Triangles of all labels before; shared ones count once.
    averages : bool
        Whether surfaces have normals, averaged from their triangles.
    """
    crossings: dict[int, int] = {}
    if simplified.self_intersections != 0:  # There are some, or nothing was tested.
        crossings = yield from finishing.stages.run(LOOKING, crossings_steps(simplified.mesh))
    own = _own_steps(finishing, simplified, full, full_faces, crossings, averages)
    return (yield from finishing.stages.run(AVERAGING, own))


def _own_steps(
    finishing: Finish,
    simplified: ComplexSimplification,
    full: Mapping[int, Reconstruction],
    full_faces: int,
    crossings: Mapping[int, int],
    averages: bool,
) -> Steps[dict[int, Reconstruction]]:
    """Return each label's own surface after simplification."""
    results: dict[int, Reconstruction] = {}
    final = simplified.mesh
    interfaces, borders = final.interfaces, borders_of(final.faces, final.sides)
    for label, result in full.items():
        yield Step(len(results) / len(full))
        faces, beyond, used = borders[label]
        mesh = TriangleMesh(final.vertices[used], faces)
        if averages:
            mesh = yield from averaged_steps(mesh)
        collapsed = simplified.collapsed_of.get(label, CollapsedComponents())
        own = Simplification(mesh, collapsed, simplified.handles_cut, crossings.get(label, 0))
        result = finishing.simplified(result, own, (full_faces, len(final.faces)))
        results[label] = replace(result, beyond=beyond, neighbors=neighbors_of(label, interfaces))
    return results


def crossings_steps(mesh: ComplexMesh, selected: NDArray[np.bool_] | None = None) -> Steps[dict[int, int]]:
    """Count pairs of triangles that cross, by label; one of each pair is `selected`, (F,) bool, by default any."""
    return crossings_of(mesh, (yield from self_intersections_steps(mesh.vertices, mesh.faces, selected)))


def crossings_of(mesh: ComplexMesh, pairs: NDArray[np.int64]) -> dict[int, int]:
    """Return the number of these pairs of triangles, (n, 2), of each label; a pair of two labels counts for both."""
    return (
        {label: int((mesh.sides[pairs] == label).any(axis=(1, 2)).sum()) for label in mesh.labels} if len(pairs) else {}
    )
