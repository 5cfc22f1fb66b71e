# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks in a slice as a translucent picture: a veil of each structure's color, and its outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

VEIL, OUTLINE = 0.22, 0.9  # opacity
ACTIVE_VEIL = 0.38


def veiled(
    masks: Sequence[NDArray[np.bool_]], colors: Sequence[Sequence[float]], active: int | None = None
) -> NDArray[np.float32]:
    """Return masks of one slice as colors, (rows, columns, 4) float32, later ones over earlier ones.

    Parameters
    ----------
    masks : sequence of (rows, columns) bool
        At least one.
    colors : sequence of (red, green, blue)
        0 to 1, as they are to appear.
    active : int, optional
        Which of them is drawn on; it is denser.

    Examples
    --------
    >>> mask = np.ones((3, 3), bool)
    >>> picture = veiled([mask], [(1.0, 0.0, 0.0)])
    >>> [round(float(share), 2) for share in (picture[0, 0, 3], picture[1, 1, 3])]
    [0.9, 0.22]
    """
    picture = np.zeros((*masks[0].shape, 4), np.float32)
    for number, (mask, color) in enumerate(zip(masks, colors, strict=True)):
        inner = np.zeros_like(mask)
        inner[1:-1, 1:-1] = mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
        picture[mask] = (*color, OUTLINE)
        picture[inner, 3] = ACTIVE_VEIL if number == active else VEIL
    return picture
