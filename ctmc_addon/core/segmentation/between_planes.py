# SPDX-License-Identifier: GPL-3.0-or-later
"""The body between two parallel planes: signed distances in each, interpolated linearly from one to the other.

Raya and Udupa 1990, doi:10.1109/42.52980. `between_slices` smooths such a body and needs its planes on slices; here a
plane may lie anywhere, and a slice takes nothing but the two planes around it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .distance import Floats, Mask, signed_mm

ON_SURFACE = 1e-3  # A sample this near to the body, in sides of a sample, is inside.
FIRST_LIMIT = 8  # Distances are measured this far first, in sides of a sample, then twice as far until all are found.


def bodies_between(below: Mask, above: Mask, shares: Sequence[float], sides_mm: Sequence[float]) -> Iterator[Mask]:
    """Yield the body on slices between two planes.

    Samples inside of both planes are inside, those outside of both are outside: distances decide the others alone.

    Parameters
    ----------
    below, above : (rows, columns) bool
        The body in each plane, with a margin of one sample without body.
    shares : sequence of float
        For each slice its way from the plane below to the one above: 0 to 1.
    sides_mm : (rows, columns) float
        Distances between samples.

    Examples
    --------
    >>> planes = [np.array([[0, 1, 1] + [0] * 6], bool), np.array([[0] + [1] * 7 + [0]], bool)]
    >>> [body.sum().item() for body in bodies_between(*planes, [0.0, 0.25, 0.5, 1.0], (1.0, 1.0))]
    [2, 3, 5, 7]
    """
    differing = below ^ above
    mm = [_signed_mm_at(layer, differing, sides_mm) for layer in (below, above)] if differing.any() else None
    for share in shares:
        body = below & above
        if mm is not None:
            body[differing] = (1 - share) * mm[0] + share * mm[1] >= -ON_SURFACE * min(sides_mm)
        yield body


def _signed_mm_at(layer: Mask, wanted: Mask, sides_mm: Sequence[float]) -> Floats:
    """Return the signed distances of some samples, (n,), measured no farther than they need."""
    limit_mm = FIRST_LIMIT * max(sides_mm)
    while True:
        signed = signed_mm(layer, sides_mm, limit_mm)[wanted]
        # Distances between centers are exact up to the limit, and these are up to half a side nearer.
        if float(np.abs(signed).max()) <= limit_mm - max(sides_mm) or limit_mm > max(layer.shape) * 2 * max(sides_mm):
            return signed
        limit_mm *= 2
