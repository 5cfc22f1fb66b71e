# SPDX-License-Identifier: GPL-3.0-or-later
"""Add the signed distance to the earlier surface of a label to the later one, as a map."""

from __future__ import annotations

from dataclasses import replace

from ..errors import MeshError
from ..machine.budget import Budget
from ..maps.distance import DistanceTo
from ..maps.make import mapped_steps
from ..maps.request import MapRequest
from ..measures.reconstruction import Reconstruction
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Steps
from ..settings import ReconstructionSettings
from ..surfaces.extract import reconstruct_steps
from ..volume.volume import Volume

EARLIER = "earlier"  # The name of the map becomes distance_earlier_mm.


def with_distance_steps(
    after: Reconstruction, before: TriangleMesh, volume: Volume, budget: Budget
) -> Steps[Reconstruction]:
    """Return the later surface with the map distance_earlier_mm, or with a note if it cannot be calculated.

    Parameters
    ----------
    after : Reconstruction
        Surface from the later volume.
    before : TriangleMesh
        Earlier surface, RAS+ mm.
    volume : Volume
        Later volume.
    budget : Budget
    """

    def surface_steps(settings: ReconstructionSettings) -> Steps[TriangleMesh]:
        return (yield from reconstruct_steps(volume, settings, budget)).mesh

    request = MapRequest((DistanceTo(before, EARLIER),))
    try:
        [mapped] = yield from mapped_steps(volume, [after], request, budget, surface_steps)
    except MeshError as error:
        return replace(after, notes=(*after.notes, f"No distance to the earlier surface: {error}."))
    return mapped
