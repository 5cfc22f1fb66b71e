# SPDX-License-Identifier: GPL-3.0-or-later
"""Drop the small components of every label of a complex.

A neighbor of a dropped component keeps its wall, which then borders on samples without a label. A component inside a
second label becomes that label.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import MeshError
from ...progress import Steps
from ..component_limits import ComponentLimits
from ..pieces.kept_pieces import kept_faces_steps
from ..topology import compacted
from .label_complex import ComplexSurface, borders_of


def keep_complex_components_steps(
    surface: ComplexSurface, labels: Sequence[int], alpha: float, limits: ComponentLimits
) -> Steps[tuple[ComplexSurface, dict[int, MeshError]]]:
    """Return the complex without small components, and why a label has none left.

    Parameters
    ----------
    surface : ComplexSurface
    labels : sequence of int
        Labels whose components are looked at, each by itself.
    alpha : float
        Alpha at which to measure.
    limits : ComponentLimits

    Returns
    -------
    surface : ComplexSurface
        Triangles whose two sides are now the same are dropped; vertices are renumbered in their order.
    errors : dict of int to MeshError
        Error for every label of which nothing is left.
    """
    sides, errors = surface.sides.copy(), {}
    borders = borders_of(surface.faces, surface.sides)
    for label in labels:
        own = np.flatnonzero((surface.sides == label).any(axis=1))
        own_surface, beyond = surface.within(borders[label])
        try:
            component, keep, volumes = yield from kept_faces_steps(own_surface, alpha, limits)
        except MeshError as error:
            errors[label] = error
            sides[sides == label] = 0
            continue
        if keep.all():
            continue
        # A small cavity is filled where it holds nothing but what has no label.
        filled = (volumes < 0) & ~keep
        filled[component[beyond != 0]] = False
        released = own[~keep[component] & ~filled[component]]
        sides[released] = np.where(surface.sides[released] == label, 0, sides[released])
        within = own[filled[component]]
        sides[within] = label
    return _between_different(surface, sides), errors


def _between_different(surface: ComplexSurface, sides: NDArray[np.int32]) -> ComplexSurface:
    """Return the triangles whose sides differ, with the vertices that they use."""
    stay = np.flatnonzero(sides[:, 0] != sides[:, 1])
    if len(stay) == len(sides):
        return replace(surface, sides=sides)
    used, faces = compacted(surface.faces[stay], len(surface.linear))
    return ComplexSurface(surface.midpoints[used], surface.linear[used], faces, sides[stay], surface.off_edges[used])
