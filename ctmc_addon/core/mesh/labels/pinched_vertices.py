# SPDX-License-Identifier: GPL-3.0-or-later
"""Split the vertices at which a surface touches itself, so that it is a manifold.

Where labels meet in a point, the triangles of one of them may lie around it in several fans, which have no edge in
common. Each fan then has a vertex of its own, at the same position.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Ints
from ...progress import finish
from ..topology import component_numbers_steps


def split_pinched(faces: Ints, candidates: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Give every fan of triangles around a vertex a vertex of its own.

    Parameters
    ----------
    faces : (F, 3) int32
        Faces of a surface no edge of which has more than two triangles.
    candidates : (V,) bool
        The vertices that are looked at.

    Returns
    -------
    faces : (F, 3) int32
        The fan of the first triangle keeps the vertex; the others have those from V on. The same array where no vertex
        is pinched.
    copied : (c,) int32
        The vertices that those are copies of.
    """
    corners = faces.reshape(-1)
    at = np.flatnonzero(candidates[corners])
    face, slot = np.divmod(at, 3)
    vertex = corners[at].astype(np.int64)
    # Two corners at a vertex are in one fan where their triangles share an edge from there.
    ends = np.stack([faces[face, (slot + 1) % 3], faces[face, (slot + 2) % 3]], axis=1)
    edges, number = np.unique(vertex[:, None] * len(candidates) + ends, return_inverse=True)
    number = number.reshape(-1, 2).astype(np.int32)
    fan = finish(component_numbers_steps(number, len(edges)))
    fans = int(fan.max(initial=-1)) + 1
    of_fan = np.empty(fans, np.int64)
    of_fan[fan] = vertex
    order = np.argsort(of_fan, kind="stable")  # fans are numbered by their first triangles
    more = np.zeros(fans, bool)
    more[order[1:]] = of_fan[order[1:]] == of_fan[order[:-1]]
    copied = of_fan[more].astype(np.int32)
    if not len(copied):
        return faces, copied
    of_fan[more] = np.arange(len(candidates), len(candidates) + len(copied))
    split = corners.copy()
    split[at] = of_fan[fan]
    return split.reshape(faces.shape), copied
