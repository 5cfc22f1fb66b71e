# SPDX-License-Identifier: GPL-3.0-or-later
"""Decide whether a surface shows a face, which DICOM PS3.15 E.1.1 calls recognizable visual features.

Only the surface is used, because most formats do not name the part of the body. RAS+ mm.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..volume.value_kind import ValueKind

SKIN_HU = (-900.0, 60.0)  # A threshold between air and soft tissue gives skin.
BAND_MM = 10.0
# Widths and depths of heads, from a child's to one with ears and headrest, from 1 to 99 % of a band's vertices.
WIDTH_MM = (110.0, 235.0)  # From right to left.
DEPTH_MM = (130.0, 270.0)  # From back to front.
LEAST_MM = 80.0  # This much of the body's length is that wide and deep; a face is longer.
FEWEST = 50  # A band has at least this many vertices.
MOST = 400_000  # Look at up to this many vertices.
NOTE = "this surface shows a face, which can identify the person; share it with care"


def face_notes(kind: str, threshold: float, vertices_ras_mm: NDArray[Any]) -> tuple[str, ...]:
    """The note of a surface that is skin and as large as a head over `LEAST_MM`; else nothing.

    A slim trunk may be taken for a head; an abdomen or thorax of an adult is wider.

    Parameters
    ----------
    kind : str
        Meaning of the volume's values; skin is looked for in 'HU' only.
    threshold : float
        HU.
    vertices_ras_mm : (n, 3)
    """
    if kind != ValueKind.HU or not SKIN_HU[0] <= threshold <= SKIN_HU[1] or not len(vertices_ras_mm):
        return ()
    right, front, up = vertices_ras_mm[:: 1 + len(vertices_ras_mm) // MOST].T  # (n,) each
    if not np.isfinite(up).all():
        return ()
    band = ((up - up.min()) // BAND_MM).astype(np.int64)
    order = np.argsort(band, kind="stable")
    starts = np.unique(band[order], return_index=True)[1].tolist()
    alike = 0
    for start, stop in pairwise([*starts, len(order)]):
        inside = order[start:stop]
        alike += (
            len(inside) >= FEWEST
            and WIDTH_MM[0] <= _extent_mm(right[inside]) <= WIDTH_MM[1]
            and DEPTH_MM[0] <= _extent_mm(front[inside]) <= DEPTH_MM[1]
        )
    return (NOTE,) if alike * BAND_MM >= LEAST_MM else ()


def _extent_mm(positions: NDArray[Any]) -> float:
    """Return the extent of the values, mm, without the lowest and the highest one per cent."""
    out = len(positions) // 100
    positions = np.sort(positions)
    return float(positions[-1 - out] - positions[out])
