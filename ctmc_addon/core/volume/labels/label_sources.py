# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels of several sources on the grid of one CT: each source becomes further layers, with numbers of its own.

Nothing is resampled. A source lies on the grid where its samples are samples of the grid, in any order of the axes;
it may cover a part of it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import VolumeError
from ...measures.units import mm_text, spacing_text
from ...progress import Step, Steps
from ..affine import index_to_index, product, to_index, transform_points
from ..slice_reader import SliceReader, ValuesInMemory
from ..volume import Box, Volume

NEAR = 0.05
"""Of a sample: as far as the corners of labels may lie from samples of the CT, which is what files round."""


class _Renumbered(SliceReader):
    """Labels of another reader, each with a number added; 0 stays 0."""

    def __init__(self, reader: SliceReader, offset: int) -> None:
        self.reader, self.offset = reader, offset
        self.shape, self.thread_safe, self.chunk_slices = reader.shape, reader.thread_safe, reader.chunk_slices
        is_wide = reader.dtype.kind == "f" or reader.dtype.itemsize == 8
        self.dtype = reader.dtype if is_wide else np.dtype(np.int32)

    @property
    def is_whole(self) -> bool:
        """Return whether the labels of the other reader are whole numbers."""
        return self.reader.is_whole

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Write the values with the number added."""
        values = self.reader.read(slices, rows, columns)
        out[...] = values
        np.add(out, self.dtype.type(self.offset), out=out, where=values != 0)


def placed_labels_steps(labels: Volume, ct: Volume) -> Steps[Volume]:
    """Return labels on the whole grid of a CT, 0 where they say nothing; themselves where they lie on it already.

    Raises
    ------
    VolumeError
        If their samples are not samples of the CT, or labels lie outside it.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> ct = Volume(np.zeros((2, 3, 4)), np.eye(4), kind="HU")
    >>> flipped = np.diag([-1.0, 1.0, 1.0, 1.0])
    >>> flipped[0, 3] = 2.0  # its columns are 2, 1, 0 of the CT
    >>> labels = Volume(np.array([[[7, 0, 0], [0, 0, 9]]] * 2), flipped, kind="label")
    >>> finish(placed_labels_steps(labels, ct)).values[0].tolist()
    [[0, 0, 7, 0], [9, 0, 0, 0], [0, 0, 0, 0]]
    """
    axes, shift = samples_on_grid(labels, ct)
    if labels.box is None and labels.shape == ct.shape and np.array_equal(axes, np.eye(3)) and not shift.any():
        return replace(labels, affine=ct.affine)
    layers: list[SliceReader] = []
    for number, layer in enumerate(labels.each_layer):
        yield Step(number / len(labels.each_layer), "Placing the labels")
        layers.append(ValuesInMemory(_on_grid(layer, ct, axes, shift), is_whole=layer.reader.is_whole))
    return replace(labels, reader=layers[0], layers=tuple(layers[1:]), affine=ct.affine, box=None)


def samples_on_grid(labels: Volume, ct: Volume) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return how indices of labels become indices of a CT: a signed permutation (3, 3) and a shift (3,).

    Raises
    ------
    VolumeError
        If they lie beside its samples, with how far in mm, or as far apart as its samples are not.
    """
    sizes = np.array(labels.size)
    corners = np.array(np.meshgrid(*[(0, size - 1) for size in sizes], indexing="ij"), float).reshape(3, 8).T
    there_mm = transform_points(labels.affine, corners)  # (8, 3)
    indices = to_index(ct.affine, there_mm)
    matrix = index_to_index(labels.affine, ct.affine)
    axes = np.rint(matrix[:3, :3]).astype(np.int64)
    if np.abs(axes).max() > 1 or any((np.abs(axes).sum(axis=axis) != 1).any() for axis in (0, 1)):
        own, other = (spacing_text(volume.spacing, 3) for volume in (labels, ct))
        raise VolumeError(
            f"{labels.name} has samples every {own} along {labels.orientation}, the CT every {other} along "
            f"{ct.orientation}; resample it to the CT, or use it without this CT"
        )
    shift = np.rint(matrix[:3, 3]).astype(np.int64)
    nearest = product(corners, axes.T) + shift
    if np.abs(indices - nearest).max() > NEAR:
        away = np.sqrt(((transform_points(ct.affine, nearest) - there_mm) ** 2).sum(axis=1)).max()
        raise VolumeError(
            f"{labels.name} has samples up to {mm_text(away, 3)} away from those of the CT; resample it to "
            "the CT, or use it without this CT"
        )
    return axes, shift


def turned_values(values: NDArray[Any], axes: NDArray[np.int64]) -> NDArray[Any]:
    """Return values of labels (slices, rows, columns) in the order and directions of a CT's axes; a view.

    Parameters
    ----------
    values : (slices, rows, columns)
    axes : (3, 3)
        As `samples_on_grid` returns it.
    """
    order = np.abs(axes).argmax(axis=1)  # the axis of the labels that runs along each of the CT, x first
    signs = axes.sum(axis=1)
    turned = values.transpose(2, 1, 0).transpose(*order)[tuple(slice(None, None, int(sign)) for sign in signs)]
    return turned.transpose(2, 1, 0)


def moved_box(box: Box, axes: NDArray[np.int64], shift: NDArray[np.int64]) -> Box:
    """Return the box in a CT of a box in labels, which may lie outside it.

    Examples
    --------
    >>> moved_box(((0, 2), (0, 3), (0, 4)), np.diag([1, -1, 1]), np.array([5, 9, 0]))
    ((5, 7), (7, 10), (0, 4))
    """
    corners = np.array(box).T - ((0, 0, 0), (1, 1, 1))  # first and last sample
    first, last = np.sort(product(corners, axes.T) + shift, axis=0).tolist()
    x, y, z = ((low, high + 1) for low, high in zip(first, last, strict=True))
    return x, y, z


def _on_grid(layer: Volume, ct: Volume, axes: NDArray[np.int64], shift: NDArray[np.int64]) -> NDArray[Any]:
    """Return one layer of labels on the whole grid of a CT."""
    moved = turned_values(layer.values, axes).transpose(2, 1, 0)  # x, y, z
    columns, rows, slices = layer.size
    low = np.array(moved_box(((0, columns), (0, rows), (0, slices)), axes, shift))[:, 0]
    start, stop = np.maximum(low, 0), np.minimum(low + moved.shape, ct.size)
    inside = moved[tuple(slice(int(a), int(max(a, b))) for a, b in zip(start - low, stop - low, strict=True))]
    outside = np.count_nonzero(moved) - np.count_nonzero(inside)
    if outside:
        raise VolumeError(
            f"{layer.name} has {outside} labeled voxels outside the CT; choose the labels of this CT, "
            "or use them without this CT"
        )
    out = np.zeros(ct.shape, moved.dtype)
    part = out.transpose(2, 1, 0)[tuple(slice(int(a), int(b)) for a, b in zip(start, stop, strict=True))]
    part[...] = inside
    return out


def free_offset(used: Collection[int], values: Collection[int]) -> int:
    """Return the number to add to labels so that none has a used number: 0 if none has.

    Examples
    --------
    >>> free_offset([1, 2], [7]), free_offset([1, 2, 7], [1, 7])
    (0, 7)
    """
    return 0 if set(used).isdisjoint(values) else max(used)


def combined_labels(sources: Sequence[tuple[Volume, int]]) -> Volume:
    """Return labels of several sources on one grid as one volume, each source with its offset added to its numbers.

    Examples
    --------
    >>> first = Volume(np.ones((2, 2, 2), np.uint8), np.eye(4), kind="label", label_names={1: "liver"})
    >>> second = Volume(np.ones((2, 2, 2), np.uint8), np.eye(4), kind="label", label_names={1: "tumor"})
    >>> both = combined_labels([(first, 0), (second, 1)])
    >>> both.label_names, [int(layer.values.max()) for layer in both.each_layer]
    ({1: 'liver', 2: 'tumor'}, [1, 2])
    """
    (first, _), *rest = sources
    if not rest and not sources[0][1]:
        return first
    readers: list[SliceReader] = []
    names: dict[int, str] = {}
    colors: dict[int, tuple[int, int, int]] = {}
    for volume, offset in sources:
        own = [volume.reader, *volume.layers]
        readers += [_Renumbered(reader, offset) for reader in own] if offset else own
        names |= {label + offset: name for label, name in volume.label_names.items()}
        colors |= {label + offset: color for label, color in volume.label_colors.items()}
    notes = tuple(dict.fromkeys(note for volume, _ in sources for note in volume.notes))
    return replace(
        first, reader=readers[0], layers=tuple(readers[1:]), label_names=names, label_colors=colors, notes=notes
    )
