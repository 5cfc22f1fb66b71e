# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures that may overlap as layers of labels, of which none has two structures at one voxel.

A voxel takes a byte in each layer, however many structures there are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Bytes, Flags
from ..errors import SettingsError
from .distance import Window

MOST_STRUCTURES = 255
WHOLE: Window = (slice(None), slice(None), slice(None))


class Layers:
    """Structures by their labels, in as few layers as first fit.

    Parameters
    ----------
    shape : (slices, rows, columns)

    Attributes
    ----------
    labels : list of (slices, rows, columns) uint8
        The layers.
    layer_of : dict of int to int
        The layer of each label.

    Examples
    --------
    >>> layers = Layers((1, 1, 3))
    >>> layers.put(4, np.array([[[True, True, False]]]))
    >>> layers.put(2, np.array([[[False, True, True]]]))
    >>> [layer.ravel().tolist() for layer in layers.labels], layers.layer_of
    ([[4, 4, 0], [0, 2, 2]], {4: 0, 2: 1})
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.shape = shape
        self.labels: list[Bytes] = []
        self.layer_of: dict[int, int] = {}

    def mask(self, label: int) -> Flags:
        """Return where a structure is."""
        return self.labels[self.layer_of[label]] == label

    def put(self, label: int, mask: Flags, window: Window = WHOLE) -> None:
        """Replace a structure by the mask in a window and by nothing elsewhere, or add it."""
        if label in self.layer_of:
            self.labels[self.layer_of[label]][self.mask(label)] = 0
        free = next((at for at, layer in enumerate(self.labels) if not layer[window][mask].any()), len(self.labels))
        if free == len(self.labels):
            self.labels.append(np.zeros(self.shape, np.uint8))
        self.labels[free][window][mask] = label
        self.layer_of[label] = free

    def voxels(self) -> dict[int, int]:
        """Return how many voxels each structure has, by its label."""
        counts = np.zeros(MOST_STRUCTURES + 1, np.int64)
        for layer in self.labels:
            for labels in layer:  # a slice at a time: counting takes eight bytes a voxel
                counts += np.bincount(labels.ravel(), minlength=len(counts))
        return {label: int(counts[label]) for label in self.layer_of}

    def compact(self) -> None:
        """Take as few layers as first fit now, where structures have changed."""
        for label, layer in self.layer_of.items():
            if layer:
                self.put(label, self.mask(label))
        used = sorted(set(self.layer_of.values()))
        self.labels = [self.labels[layer] for layer in used]
        self.layer_of = {label: used.index(layer) for label, layer in self.layer_of.items()}


def layers_of(masks: Sequence[Flags]) -> tuple[list[Bytes], list[int]]:
    """Return masks as labels 1, 2, 3 and so on, in layers, and the layer of each mask.

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
    require_count(len(masks))
    slices, rows, columns = masks[0].shape
    layers = Layers((slices, rows, columns))
    for label, mask in enumerate(masks, 1):
        layers.put(label, mask)
    return layers.labels, list(layers.layer_of.values())


def require_count(count: int) -> None:
    """Raise a `SettingsError` if there are too many structures for labels of one byte, or none."""
    if not 0 < count <= MOST_STRUCTURES:
        raise SettingsError(f"a segmentation has 1 to {MOST_STRUCTURES} structures, not {count}; draw or remove some")
