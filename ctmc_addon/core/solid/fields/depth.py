# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the depth of points below the surface of a solid, to place pegs and drains.

Distances are in mm, positive inside. Points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...arrays import Doubles
from ...mesh.distance.signed_distance import SignedSurface
from ...progress import Steps

Depth = Callable[[Doubles], Steps[Doubles]]


def depth_below(surface: SignedSurface, thicken: float = 0.0, wall: float = 0.0, threads: int | None = None) -> Depth:
    """Return the depth below the surface of a structure that was thickened and made hollow.

    Parameters
    ----------
    surface : SignedSurface
        Closed.
    thicken : float
        Offset of the surface outward, mm.
    wall : float
        Thickness of the wall of a hollow, mm; 0 for none.
    threads : int, optional
        Default: one for each processor.
    """

    def depth_steps(points: Doubles) -> Steps[Doubles]:
        distances, _ = yield from surface.distances_steps(points.T, threads)
        below = thicken - distances
        return np.minimum(below, wall - below) if wall else below

    return depth_steps
