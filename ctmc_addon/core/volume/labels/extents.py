# SPDX-License-Identifier: GPL-3.0-or-later
"""The labels of a volume: where each lies, how many voxels it has, and which of them are meant by a name.

One look through the values finds the boxes of all labels: runs of equal values along x are the only things that are
counted, and a label volume has a thousand times fewer of them than voxels.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ...errors import AbsentLabelError, LabelError
from ...machine.parallel import map_steps, worker_count
from ...progress import Step, Steps, finish
from ..region import Region, converted_region, region_limits
from ..value_kind import ValueKind
from ..volume import Box, Volume
from .whole_labels import NotWholeError

SLAB_VALUES = 1 << 20  # Look at this many values in one go.
ALL = "all"  # The word for every label.
MOST_LABELS = 1 << 16  # More values than this are not labels.
LISTED = 20  # A message lists this many labels.
CLOSE = 5  # Propose this many names for an unknown one.


class LabelExtent(NamedTuple):
    """Box and size of a label.

    Parameters
    ----------
    voxels : int
    box : Box
        The smallest that holds it, in voxel indices of the volume.
    """

    voxels: int
    box: Box


Extents = dict[int, LabelExtent]


class _BoxExtents(NamedTuple):
    """The labels of a box, and notes on changes of values made to find them."""

    extents: Extents
    notes: tuple[str, ...]


_extents_of: WeakKeyDictionary[Volume, dict[Box, _BoxExtents]] = WeakKeyDictionary()


def label_extents_steps(volume: Volume, box: Box | None = None, threads: int | None = None) -> Steps[Extents]:
    """Return every label but 0 in a box, by default the whole volume, in the order of the values; looked for once.

    Raises
    ------
    LabelError
        If there are more than 65,536, or a value stands for no whole number.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> values = np.array([[[0, 0, 5], [0, 0, 5]], [[0, 2, 0], [0, 0, 0]]], np.uint8)
    >>> for label, extent in finish(label_extents_steps(Volume(values, np.eye(4), kind="label"))).items():
    ...     print(label, extent.voxels, extent.box)
    2 1 ((1, 2), (0, 1), (1, 2))
    5 2 ((2, 3), (0, 2), (0, 1))
    """
    x, y, z = volume.size
    box = box or ((0, x), (0, y), (0, z))
    volume = volume.as_labels
    of_box = _extents_of.setdefault(volume, {})
    if box not in of_box:
        extents: Extents = {}
        for layer in volume.each_layer:
            extents |= yield from _scan_steps(layer, box, None, threads)
        of_box[box] = _BoxExtents(dict(sorted(extents.items())), _notes_of(volume))
    return of_box[box].extents


def label_notes(volume: Volume, box: Box) -> tuple[str, ...]:
    """Return notes on changes of values that finding the labels of a box made, besides the volume's own notes.

    It is the same whatever was read of other boxes since, if all labels of this one were looked for.
    """
    volume = volume.as_labels
    cached = _extents_of.get(volume, {}).get(box)
    notes = _notes_of(volume) if cached is None else cached.notes
    return tuple(note for note in notes if note not in volume.notes)


def _notes_of(volume: Volume) -> tuple[str, ...]:
    return tuple(dict.fromkeys(note for layer in volume.each_layer for note in layer.reader.notes))


def label_extent_steps(volume: Volume, label: int, box: Box, threads: int | None = None) -> Steps[LabelExtent | None]:
    """Return one label's extent in a box, None where it has no voxel there."""
    volume = volume.as_labels
    cached = _extents_of.get(volume, {}).get(box)
    if cached is not None:
        return cached.extents.get(label)
    for layer in volume.each_layer:
        extent = (yield from _scan_steps(layer, box, label, threads)).get(label)
        if extent is not None:
            return extent
    return None


def layer_of_label_steps(volume: Volume, label: int, box: Box, threads: int | None = None) -> Steps[Volume]:
    """Return the layer of a volume that has a label in a box; the volume itself where none has it."""
    volume = volume.as_labels
    if volume.layers:
        for layer in volume.each_layer:
            if (yield from label_extent_steps(layer, label, box, threads)) is not None:
                return layer
    return volume


def labels_by_layer_steps(
    volume: Volume, labels: Sequence[int], box: Box, threads: int | None = None
) -> Steps[list[tuple[Volume, list[int]]]]:
    """Return every layer that has some of the labels in a box, and these, in their order."""
    out = []
    for layer in volume.as_labels.each_layer:
        extents = yield from label_extents_steps(layer, box, threads)
        own = [label for label in labels if label in extents]
        if own:
            out.append((layer, own))
    return out


def require_labels(volume: Volume) -> None:
    """Raise `LabelError` if a label is asked of Hounsfield units."""
    if volume.kind == ValueKind.HU:
        raise LabelError(
            f"{volume.name} holds HU, which are densities and not labels; give the label volume, or a threshold"
        )


def chosen_labels_steps(
    volume: Volume, choices: Sequence[int | str], box: Box | None = None, threads: int | None = None
) -> Steps[tuple[int, ...]]:
    """Return the values of labels that are chosen by value, by name or by the word "all", each once.

    A name means every label that has it; case, spaces and underscores make no difference.

    Raises
    ------
    AbsentLabelError
        If no label has a name, or "all" finds none.
    LabelError
        If the labels have no names at all.
    """
    values: list[int] = []
    for choice in choices:
        require_labels(volume)
        if choice == ALL:
            extents = yield from label_extents_steps(volume, box, threads)
            if not extents:
                raise AbsentLabelError(
                    f"{volume.name} has no label {'in this region' if box else 'here'}: all voxels are 0"
                )
            values += extents
        elif isinstance(choice, str):
            values += _labels_called(volume, choice)
        else:
            values.append(choice)
    return tuple(dict.fromkeys(values))


def existing_labels_steps(volume: Volume, box: Box, threads: int | None = None) -> Steps[str]:
    """Return which labels a box has, for a message."""
    labels = list((yield from label_extents_steps(volume, box, threads)))
    if not labels:
        return "every voxel is 0"
    return f"the labels are {', '.join(map(str, labels[:LISTED]))}{' and more' if len(labels) > LISTED else ''}"


def not_a_label_steps(volume: Volume) -> Steps[str]:
    """Return the first value of a volume that is not a whole number, as text; empty without one.

    Examples
    --------
    >>> finish(not_a_label_steps(Volume(np.full((2, 2, 2), 0.25), np.eye(4))))
    '0.25'
    """
    labels, step = volume.as_labels, max(1, SLAB_VALUES // (volume.size[0] * volume.size[1]))
    if labels is volume:
        return ""
    try:
        for low in range(0, volume.size[2], step):
            yield Step(low / volume.size[2], "Checking values")
            labels.slab(low, min(low + step, volume.size[2]))
    except NotWholeError as error:
        return error.value_text
    return ""


def _labels_called(volume: Volume, name: str) -> list[int]:
    plain_name = compared_name(name)
    labels = [label for label, own_name in volume.label_names.items() if compared_name(own_name) == plain_name]
    if labels:
        return labels
    names = {compared_name(own_name): own_name for own_name in volume.label_names.values()}
    if not names:
        raise LabelError(f"the labels of {volume.name} have no names, so none is called {name!r}; give a number")
    close = difflib.get_close_matches(plain_name, names, CLOSE)
    close += [plain for plain in names if plain_name in plain and plain not in close][: CLOSE - len(close)]
    listed = [names[plain] for plain in close] or list(names.values())[:LISTED]
    more = "similar names are" if close else f"there are {len(names)}, such as" if len(names) > LISTED else "there are"
    raise AbsentLabelError(f"no label is called {name!r}; {more} {', '.join(listed)}")


def compared_name(name: str) -> str:
    """Return a label's name as names are compared, without case and underscores.

    Examples
    --------
    >>> compared_name("Left_Kidney")
    'left kidney'
    """
    return " ".join(name.casefold().replace("_", " ").split())


def _scan_steps(volume: Volume, box: Box, only: int | None, threads: int | None) -> Steps[Extents]:
    """Return the extents in a box of all labels, or of only one, of a volume whose values are whole."""
    inside = volume.part(box)
    slices, rows, columns = inside.shape
    step = max(1, SLAB_VALUES // (rows * columns))
    workers = worker_count(threads) if volume.reader.thread_safe else 1
    parts: list[NDArray[np.int64]] = []

    def look(low: int) -> tuple[list[int], NDArray[np.int64]]:
        end = min(low + step, slices)
        slab = inside.slab(low, end)
        if only is None:
            labels, extents = slab_extents(slab)
        else:
            extents = _mask_extent(slab == only)
            labels = [only] * len(extents)
        extents[:, [3, 6]] += low
        return labels, extents

    part_of: dict[int, int] = {}  # label, and where it stands in `parts`
    for labels, extents in (yield from map_steps(look, range(0, slices, step), workers)):
        for label, extent in zip(labels, extents, strict=True):
            at = part_of.setdefault(label, len(parts))
            if at == len(parts):
                parts.append(extent)
            else:
                total = parts[at]
                total[0] += extent[0]
                total[1:4] = np.minimum(total[1:4], extent[1:4])
                total[4:] = np.maximum(total[4:], extent[4:])
        if len(part_of) > MOST_LABELS:
            raise LabelError(f"more than {MOST_LABELS} values are not labels; give a threshold, or a label volume")
    (x, _), (y, _), (z, _) = box
    out: Extents = {}
    for label in sorted(part_of):
        voxels, x0, y0, z0, x1, y1, z1 = parts[part_of[label]].tolist()
        out[label] = LabelExtent(voxels, ((x + x0, x + x1), (y + y0, y + y1), (z + z0, z + z1)))
    return out


def slab_extents(slab: NDArray[Any]) -> tuple[list[int], NDArray[np.int64]]:
    """Return the labels of a slab and for each its voxels, lowest x, y, z and highest x, y, z, these left out: (n, 7).

    Parameters
    ----------
    slab : (slices, rows, columns)
        Whole numbers.
    """
    _, rows, columns = slab.shape
    flat = slab.reshape(-1)
    begins = np.empty(flat.size, bool)
    np.not_equal(flat[1:], flat[:-1], out=begins[1:])
    begins[::columns] = True  # a run ends with its row
    start = np.flatnonzero(begins)
    value, length = flat[start], np.diff(start, append=flat.size)
    kept = value != 0
    start, value, length = start[kept], value[kept], length[kept]
    if not len(value):
        return [], np.zeros((0, 7), np.int64)
    order = np.argsort(value, kind="stable")
    start, value, length = start[order], value[order], length[order]
    first = np.flatnonzero(np.concatenate([[True], value[1:] != value[:-1]]))
    row, x = np.divmod(start, columns)
    z, y = np.divmod(row, rows)
    lows = [np.minimum.reduceat(axis, first) for axis in (x, y, z)]
    highs = [np.maximum.reduceat(axis, first) for axis in (x + length, y + 1, z + 1)]
    return [int(label) for label in value[first].tolist()], np.stack([np.add.reduceat(length, first), *lows, *highs], 1)


def _mask_extent(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Do what `slab_extents` does for the samples that are set: (1, 7), or (0, 7) if none is.

    Examples
    --------
    >>> mask = np.zeros((4, 5, 6), bool)
    >>> mask[1, 2, 3:5] = True
    >>> _mask_extent(mask).tolist()
    [[2, 3, 2, 1, 5, 3, 2]]
    """
    voxels = np.count_nonzero(mask)
    if not voxels:
        return np.zeros((0, 7), np.int64)
    plane = np.bitwise_or.reduce(mask.view(np.uint8), axis=0)  # of bytes, which NumPy takes many at a time
    ends = [np.flatnonzero(axis) for axis in (plane.any(axis=0), plane.any(axis=1), mask.any(axis=(1, 2)))]
    return np.array([[voxels, *(int(at[0]) for at in ends), *(int(at[-1]) + 1 for at in ends)]])


def labels_region(volume: Volume, labels: Collection[int], unit: str) -> Region:
    """Return the region around labels with a sample of room on each side; where none of them is, the whole volume's.

    Examples
    --------
    >>> values = np.zeros((5, 6, 7), np.uint8)
    >>> values[2, 3, 4] = 8
    >>> labels_region(Volume(values, np.eye(4), kind="label"), [8], "voxel")
    (3.0, 2.0, 1.0, 5.0, 4.0, 3.0)
    """
    extents = finish(label_extents_steps(volume)) if labels else {}
    boxes = np.array([extents[label].box for label in labels if label in extents])  # (n, 3, 2)
    if not len(boxes):
        return region_limits(volume, unit)
    low = np.maximum(boxes[:, :, 0].min(axis=0) - 1.0, 0.0)
    high = np.minimum(boxes[:, :, 1].max(axis=0), np.array(volume.size) - 1.0)
    return converted_region(volume, (*low.tolist(), *high.tolist()), "voxel", unit)
