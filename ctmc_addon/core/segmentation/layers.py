# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks that may overlap as layers of labels, of which none has two structures at one voxel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from .distance import Mask

Labels = NDArray[np.uint8]
MOST_STRUCTURES = 255


def layers_of(masks: Sequence[Mask]) -> tuple[list[Labels], list[int]]:
    """Return masks as labels 1, 2, 3 and so on, in as few layers as first fit, and the layer of each mask.

    Parameters
    ----------
    masks : sequence of (slices, rows, columns) bool
        One or more of one shape, at most 255.

    Raises
    ------
    SettingsError
        If there is none, or more than 255.

    Examples
    --------
    >>> row = np.array([[[True, True, False]], [[False, True, True]], [[False, False, True]]])[:, None]
    >>> layers, layer_of_each = layers_of(list(row))
    >>> [layer.ravel().tolist() for layer in layers], layer_of_each
    ([[1, 1, 3], [0, 2, 2]], [0, 1, 0])
    """
    if not 0 < len(masks) <= MOST_STRUCTURES:
        raise SettingsError(f"{len(masks)} structures are no segmentation; draw 1 to {MOST_STRUCTURES}")
    layers: list[Labels] = []
    used = []
    for number, mask in enumerate(masks, 1):
        free = next((at for at, layer in enumerate(layers) if not (layer[mask] > 0).any()), len(layers))
        if free == len(layers):
            layers.append(np.zeros(mask.shape, np.uint8))
        layers[free][mask] = number
        used.append(free)
    return layers, used
