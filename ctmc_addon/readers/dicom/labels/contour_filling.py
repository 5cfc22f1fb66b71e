# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill the planes of structures on the volume's slices, one structure and one pair of planes at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from ....core import ReadError, Step, Steps, mm_text
from ....core.segmentation import Outline, between_planes_steps
from ...labels.contours import Filled, edges_of, filled_steps
from ...labels.label_map import LabelMap, limited
from ...labels.overlaps import United, united_steps
from .contour_planes import Plane, PlaneAssignment, Source
from .slice_grid import SliceGrid

MOST_CROSSINGS = 1 << 26  # Edges of real sets cross rows of pixels some million times.


def fill_steps(
    label_map: LabelMap,
    structures: Sequence[Sequence[Plane]],
    assignments: Sequence[PlaneAssignment],
    grid: SliceGrid,
    name: str,
) -> Steps[list[str]]:
    """Paint every structure; return notes about slices filled between contours and about united contours.

    Parameters
    ----------
    label_map : LabelMap
        Its labels count the structures from 1.
    structures, assignments
        The planes of each structure, and the slices that take them.
    grid : SliceGrid
    name : str
        The file, for an error.
    """
    total = max(1, sum(len(assignment.sources) for assignment in assignments))
    done = crossings = 0
    united, apart = Counter[int](), Counter[int]()  # labels: planes, slices
    for label, (planes, assignment) in enumerate(zip(structures, assignments, strict=True), 1):
        filled: dict[int, Filled] = {}
        for numbers, group in groupby(assignment.sources, lambda source: (source.below, source.above)):
            for number in numbers:
                if number not in filled:
                    crossings += int(edges_of(planes[number].contours, grid.shape[1]).crossings.sum())
                    if crossings > MOST_CROSSINGS:
                        raise ReadError(
                            f"the contours of {name} cross rows of pixels more than {MOST_CROSSINGS} times, too "
                            "often for drawn contours; export it again"
                        )
                    filled[number], changed = yield from _plane_steps(planes[number], grid, name)
                    united[label] += changed
            filled = {number: filled[number] for number in numbers}  # the planes below are done
            sources = list(group)
            if numbers[0] == numbers[1]:
                top, left, mask = filled[numbers[0]]
                for source in sources:
                    label_map.paint(source.slice_, mask, label, top, left)
            else:
                pair = [(planes[number], filled[number]) for number in numbers]
                apart[label] += yield from _paint_between_steps(label_map, label, sources, pair, grid)
            done += len(sources)
            yield Step(done / total, "Filling contours")
    return [
        *_overlap_notes(label_map, united),
        *_between_notes(label_map, assignments, grid.slice_mm, apart),
        *_gap_notes(label_map, assignments),
    ]


def _plane_steps(plane: Plane, grid: SliceGrid, name: str) -> Steps[United]:
    _, rows, columns = grid.shape
    if plane.xor or len(plane.contours) == 1:
        return United((yield from filled_steps(edges_of(plane.contours, rows), columns)), False)
    return (yield from united_steps(plane.contours, rows, columns, name))


def _paint_between_steps(
    label_map: LabelMap, label: int, sources: Sequence[Source], pair: Sequence[tuple[Plane, Filled]], grid: SliceGrid
) -> Steps[int]:
    """Paint the slices between two planes; return how many are empty although neither plane is."""
    visible = [filled for _, filled in pair if filled.mask.size]
    if not visible:
        return 0
    top, left = min(filled.top for filled in visible), min(filled.left for filled in visible)
    bottom = max(filled.top + filled.mask.shape[0] for filled in visible)
    right = max(filled.left + filled.mask.shape[1] for filled in visible)
    outlines = []
    for plane, filled in pair:
        mask = np.zeros((bottom - top + 2, right - left + 2), np.bool_)  # with a margin of a pixel
        row, column = filled.top - top + 1, filled.left - left + 1
        if filled.mask.size:
            mask[row : row + filled.mask.shape[0], column : column + filled.mask.shape[1]] = filled.mask
        edges = edges_of(plane.contours, grid.shape[1])
        corner = np.array([left - 1, top - 1])
        outlines.append(Outline(mask, edges.start - corner, edges.end - corner))
    empty = 0
    between = yield from between_planes_steps(outlines[0], outlines[1], (grid.spacing[0], grid.spacing[1]))
    for source in sources:
        body = between.at(source.share)
        label_map.paint(source.slice_, body[1:-1, 1:-1], label, top, left)
        empty += not body.any()
    return empty if all(filled.mask.any() for _, filled in pair) else 0


def _overlap_notes(label_map: LabelMap, united: Counter[int]) -> list[str]:
    named = _counted(label_map, united)
    return [f"partly overlapping contours were united (planes: {named})"] if named else []


def _between_notes(
    label_map: LabelMap, assignments: Sequence[PlaneAssignment], slice_mm: float, apart: Counter[int]
) -> list[str]:
    by_distance: dict[str, Counter[int]] = {}
    for label, assignment in enumerate(assignments, 1):
        if assignment.between:
            by_distance.setdefault(mm_text(assignment.apart_mm, 3), Counter())[label] = assignment.between
    notes = [
        f"contours lie {apart} apart and slices {mm_text(slice_mm, 3)}; slices between contours were filled by "
        f"distance: {_counted(label_map, between)}"
        for apart, between in sorted(by_distance.items(), key=lambda item: float(item[0].split()[0]))
    ]
    named = _counted(label_map, apart)
    if named:
        notes.append(f"slices between contours that do not overlap are empty: {named}")
    return notes


def _gap_notes(label_map: LabelMap, assignments: Sequence[PlaneAssignment]) -> list[str]:
    named = [
        f"{label_map.name(label)} {mm_text(gap, 3)}"
        for label, assignment in enumerate(assignments, 1)
        for gap in assignment.gaps_mm
    ]
    if not named:
        return []
    return [f"gaps between contours far wider than the usual distance stay empty: {limited(named)}"]


def _counted(label_map: LabelMap, counts: Counter[int]) -> str:
    """Return the names of labels with their counts; empty where all are 0."""
    return limited(f"{label_map.name(label)} {count}" for label, count in counts.items() if count)
