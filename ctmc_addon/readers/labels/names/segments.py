# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the segments of 3D Slicer's `.seg.nrrd`: header keys `SegmentN_...`, and layers where segments overlap.

slicer.readthedocs.io, developer guide, modules/segmentations.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from numpy.typing import NDArray

from ....core import ReadError, Step, Steps
from ....core.volume import SliceReader
from ..colors import RGB, rgb_of_shares
from ..label_map import LabelMap, clean_name

MOST_SEGMENTS = 4096
MOST_SHOWN = 20  # An error shows this many letters of a damaged value.


class StoredSegment(NamedTuple):
    """A segment in a file: the voxels of a layer that have a value."""

    value: int
    layer: int
    name: str
    color: RGB | None


def segments_of(header: Mapping[str, Any], name: str) -> list[StoredSegment]:
    """Return the segments that have a value, in the order of their numbers."""
    keys = (re.fullmatch(r"Segment(\d{1,9})_(?:ID|LabelValue)", key) for key in header)
    numbers = sorted({int(match[1]) for match in keys if match})
    is_old = not any(f"Segment{number}_LabelValue" in header for number in numbers)  # before Slicer 4.11: a mask each
    if len(numbers) > MOST_SEGMENTS:
        raise ReadError(f"{name} has {len(numbers)} segments, and at most {MOST_SEGMENTS} are read; save fewer")
    segments = []
    for number in numbers:
        fields = {"LabelValue": 1, "Layer": number} if is_old else {"LabelValue": "", "Layer": 0}
        value, layer = (str(header.get(f"Segment{number}_{key}", own)).strip() for key, own in fields.items())
        if not value:
            continue
        for key, text in (("LabelValue", value), ("Layer", layer)):
            if not re.fullmatch(r"\d{1,18}", text, re.ASCII):
                shown = text[:MOST_SHOWN] + "..." * (len(text) > MOST_SHOWN)
                raise ReadError(
                    f"{name} has '{shown}' as {key} of segment {number}, and a whole number of 18 digits at most "
                    "belongs there; export it again"
                )
        called = clean_name(header.get(f"Segment{number}_Name", ""), f"Segment {number}")
        color = rgb_of_shares(str(header.get(f"Segment{number}_Color", "")).split())
        segments.append(StoredSegment(int(value), int(layer), called, color))
    return segments


def names_and_colors(segments: Sequence[StoredSegment], labels: Sequence[int]) -> tuple[dict[int, str], dict[int, RGB]]:
    """Return names and colors by label.

    Parameters
    ----------
    segments : sequence of StoredSegment
    labels : sequence of int
        The label of each.
    """
    names = {label: segment.name for label, segment in zip(labels, segments, strict=True)}
    colors = {label: segment.color for label, segment in zip(labels, segments, strict=True) if segment.color}
    return names, colors


class _Layered(NamedTuple):
    """Labels in layers, as few as keep every segment whole."""

    layers: list[NDArray[Any]]
    names: dict[int, str]
    colors: dict[int, RGB]
    notes: tuple[str, ...]


def layered_steps(layers: Sequence[SliceReader], segments: Sequence[StoredSegment], name: str) -> Steps[_Layered]:
    """Return the segments of a file's layers as labels, in layers (slices, rows, columns) of which none overlap.

    Parameters
    ----------
    layers : sequence of SliceReader
        (slices, rows, columns) each.
    segments : sequence of StoredSegment
        With layer and value.
    name : str
        Of the file, for errors and notes.

    Returns
    -------
    Layered
        Its labels are the segments' values, or 1, 2, 3 and so on where segments of two layers share one.
    """
    values = [segment.value for segment in segments]
    missing = [segment.layer for segment in segments if segment.layer >= len(layers)]
    if missing:
        raise ReadError(f"{name} has a segment in layer {missing[0]} of {len(layers)}, counted from 0; export it again")
    shared = len(set(values)) < len(values) or 0 in values
    labels = list(range(1, len(values) + 1)) if shared else values
    names, colors = names_and_colors(segments, labels)
    label_map = LabelMap(layers[0].shape, names, colors, name)
    slices, rows, columns = layers[0].everything
    for number in slices:
        yield Step(number / len(slices), "Painting segments")
        for layer, reader in enumerate(layers):
            own = [at for at, segment in enumerate(segments) if segment.layer == layer]
            if own:
                stored = reader.read(range(number, number + 1), rows, columns)[0]
            for at in own:
                label_map.paint(number, stored == values[at], labels[at])
    notes = label_map.overlap_note("segments") + label_map.empty_note("segments")
    if shared:
        notes.append("segments of different layers share a value: they are renumbered, in their order")
    return _Layered(label_map.layers(), names, colors, tuple(notes))
