# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM structure sets: contours of a radiotherapy plan, filled on the slices of the CT that they were drawn on.

Contours of one region in one plane are taken together by the even-odd rule, so that a contour within another is a hole,
drawn with a keyhole or as one of its own. Positions are in LPS+ mm. DICOM PS3.3 C.8.8.5 and C.8.8.6.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, Stages, Step, Steps
from ....core.volume import ValueKind
from ...labels.colors import RGB, rgb_of_bytes
from ...labels.contours import Edges, edges_of, filled_steps
from ...labels.label_map import LabelMap, clean_name
from ...optional_imports import imported_steps
from ...result import RawValues, ReadRequest, Series, VolumeSource
from ..header import Slice
from .elements import LOCATION, VALUE, Damaged, Elements, Found, ValueLocation
from .label_file import decimals, opened, reference_of, texts, uid, whole
from .references import Reference, found_steps, grid_of
from .slice_grid import SliceGrid

WANTED = {
    0x00080005: VALUE,
    0x0020000E: VALUE,
    0x30060010: {  # referenced frames of reference: studies: series: images
        0x00200052: VALUE,
        0x30060012: {0x30060014: {0x0020000E: VALUE, 0x30060016: {0x00081155: VALUE}}},
    },
    0x30060020: {0x30060022: VALUE, 0x30060026: VALUE},  # regions
    0x30060039: {  # their contours
        0x30060084: VALUE,
        0x3006002A: VALUE,
        0x30060040: {0x30060042: VALUE, 0x30060050: LOCATION},
    },
}
CLOSED = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
LONGEST_CONTOUR = 1 << 26  # bytes of numbers in words
MOST_BYTES = 1 << 29  # of all contours
MOST_CROSSINGS = 1 << 26  # of edges with rows of pixels; real sets have some millions
MOST_MM = 1e6
PLANAR = 0.25  # shares of the gap between slices by which a contour may leave its plane
CONTOURS_PER_STEP = 64

Planes = dict[int, list[NDArray[np.float64]]]  # scanned slice: contours (n, 2), column and row


class Region(NamedTuple):
    """One region of interest."""

    name: str
    color: RGB | None
    contours: list[tuple[str, ValueLocation]]  # type, and where the positions stand


class Header(NamedTuple):
    """The description of the regions in a structure set."""

    series: str
    regions: list[Region]
    reference: Reference


class StructureSource(VolumeSource):
    """One DICOM structure set, on the grid of its CT."""

    format = "DICOM RTSTRUCT"
    has_geometry = True

    def __init__(self, path: Path, header: Header, slices: list[Slice]) -> None:
        self.header, self.slices = header, slices
        count, rows, columns = grid_of(slices, path, False)[0].shape
        dtype = "uint8" if len(header.regions) < 256 else "uint16"
        super().__init__(path, (Series(1, header.series, count, (columns, rows), "RTSTRUCT", dtype),), [path])

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Fill every region; those that overlap lie in different layers."""
        stages = Stages({"Reading contours": 1, "Filling contours": 2})
        grid, notes = grid_of(self.slices, self.path, request.strict)
        regions, left_out = yield from stages.run("Reading contours", planes_steps(self.path, self.header, grid))
        numbered = list(enumerate(self.header.regions, 1))
        names = {label: region.name for label, region in numbered}
        colors = {label: region.color for label, region in numbered if region.color}
        label_map = LabelMap(grid.shape, names, colors, self.path.name, budget=request.budget)
        notes += yield from stages.run("Filling contours", fill_steps(label_map, regions, grid, self.path.name))
        notes += [f"{text}: {count} left out" for text, count in sorted(left_out.items())]
        notes += label_map.overlap_note("regions")
        notes += label_map.empty_note("regions")
        names, colors = label_map.names, label_map.colors
        first, *further = label_map.layers()
        return RawValues(first, grid.affine, tuple(notes), ValueKind.LABEL, names, colors, layers=tuple(further))


def open_steps(path: Path) -> Steps[StructureSource]:
    """Read the file's header, and those of the images near it; a `ReadError` where its CT is not there."""
    stages = Stages({"Loading pydicom": 1, "Reading headers": 2, "Looking for the CT": 4})
    yield from stages.run("Loading pydicom", imported_steps("pydicom", "pydicom", "DICOM"))
    header = yield from stages.run("Reading headers", header_steps(path))
    slices = yield from stages.run("Looking for the CT", found_steps(path, header.reference))
    if not slices:
        raise ReadError(
            f"{path.name} holds contours, and the CT series that they were drawn on is neither in its folder, nor "
            "in the folders in it or beside it; put the two in one folder"
        )
    return StructureSource(path, header, slices)


def header_steps(path: Path) -> Steps[Header]:
    """Return what the file says of its regions, and where their contours stand."""
    with opened(path) as (elements, _):
        found = yield from elements.dataset_steps(WANTED)
        decoded = texts(found)
        frames = found.get(0x30060010, [])
        series = [item for frame in frames for study in frame.get(0x30060012, ()) for item in study.get(0x30060014, ())]
        coordinates = next((uid(frame[0x00200052]) for frame in frames if frame.get(0x00200052)), "")
        reference = reference_of(found, series, 0x30060016, coordinates)
        drawn = {whole(item[0x30060084]): item for item in found.get(0x30060039, ()) if item.get(0x30060084)}
        regions = []
        for number, item in enumerate(found.get(0x30060020, ()), 1):
            own = drawn.get(whole(item.get(0x30060022, b"0")), {})
            name = clean_name(decoded(item.get(0x30060026, b"")), f"region {number}")
            regions.append(Region(name, color_of(own), contours_of(own)))
    if not any(region.contours for region in regions):
        raise ReadError(f"{path.name} has no contours; choose another structure set")
    if sum(location.length for region in regions for _, location in region.contours) > MOST_BYTES:
        raise ReadError(f"{path.name} has more than {MOST_BYTES} bytes of contours; export fewer regions")
    return Header(uid(found.get(0x0020000E, b"")), regions, reference)


def color_of(item: Found) -> RGB | None:
    """ROIDisplayColor; None where it is none, as nothing else hangs on it."""
    words = item.get(0x3006002A, b"").rstrip(b"\0 ").split(b"\\")
    return rgb_of_bytes([word.decode("ascii", "replace") for word in words])


def contours_of(item: Found) -> list[tuple[str, ValueLocation]]:
    """Type and place of every contour of a region."""
    contours = item.get(0x30060040, ())
    return [
        (uid(contour.get(0x30060042, b"")).upper(), contour[0x30060050])
        for contour in contours
        if contour.get(0x30060050) is not None
    ]


def planes_steps(path: Path, header: Header, grid: SliceGrid) -> Steps[tuple[list[Planes], Counter[str]]]:
    """Return the contours of every region by scanned slice, in pixels, and how many were left out and why."""
    regions, left_out = [], Counter[str]()
    total = sum(len(region.contours) for region in header.regions)
    done, gap = 0, grid.gap
    with opened(path) as (elements, _):
        for region in header.regions:
            nearest: dict[int, dict[float, list[NDArray[np.float64]]]] = {}
            for kind, location in region.contours:
                done += 1
                if done % CONTOURS_PER_STEP == 0:
                    yield Step(done / total, "Reading contours")
                if kind not in CLOSED:
                    left_out[f"contours of type {clean_name(kind, 'none')}, which enclose nothing"] += 1
                    continue
                points = positions_of(elements, location)
                if len(points) < 3:
                    left_out["contours of less than 3 points"] += 1
                    continue
                scanned, corners, way, spread = grid.on_slice(points)
                if spread > PLANAR * gap:
                    left_out["contours that do not lie in the plane of the slices"] += 1
                elif abs(way) > 0.5 * gap * (1 + 1e-6):
                    left_out["contours above or below all slices"] += 1
                else:
                    nearest.setdefault(scanned, {}).setdefault(round(abs(way), 2), []).append(corners)
            planes = {scanned: ways[min(ways)] for scanned, ways in nearest.items()}
            finer = sum(len(corners) for ways in nearest.values() for corners in ways.values())
            finer -= sum(map(len, planes.values()))
            if finer:
                left_out["contours of planes that lie closer than the slices"] += finer
            regions.append({scanned: without_copies(planes[scanned], left_out) for scanned in sorted(planes)})
    return regions, left_out


def positions_of(elements: Elements, location: ValueLocation) -> NDArray[np.float64]:
    """Return the positions (n, 3) of one contour, mm; numbers in words, x, y and z in turn."""
    if location.length > LONGEST_CONTOUR:
        raise Damaged(f"a contour of {location.length} bytes, and at most {LONGEST_CONTOUR} are read")
    elements.file.seek(location.start)
    values = decimals(elements.file.read(location.length))
    if len(values) % 3:
        raise Damaged(f"a contour of {len(values)} numbers, which are no positions")
    if not (np.abs(values) <= MOST_MM).all():  # nor NaN
        raise Damaged("a contour with positions that are no number or farther than any patient")
    return values.reshape(-1, 3)


def without_copies(contours: list[NDArray[np.float64]], left_out: Counter[str]) -> list[NDArray[np.float64]]:
    """Contours without those drawn twice, which the even-odd rule would take for a hole in themselves."""
    single = {corners.tobytes(): corners for corners in contours}
    if len(single) < len(contours):
        left_out["copies of contours"] += len(contours) - len(single)
    return list(single.values())


def fill_steps(label_map: LabelMap, regions: list[Planes], grid: SliceGrid, name: str) -> Steps[list[str]]:
    """Paint every region; the notes about slices between contours."""
    volume_slices = [np.flatnonzero(grid.source == scanned).tolist() for scanned in range(len(grid.positions))]
    total, done, crossings, thick = sum(map(len, regions)), 0, 0, []
    for label, planes in enumerate(regions, 1):
        targets, step = with_slices_between(sorted(planes))
        if step > 1:
            thick.append(f"{label_map.name(label)} {step}")
        for plane, scanned in targets.items():
            edges: Edges = edges_of(planes[plane], grid.shape[1])
            crossings += int(edges.crossings.sum())
            if crossings > MOST_CROSSINGS:
                raise ReadError(
                    f"the contours of {name} cross rows of pixels more than {MOST_CROSSINGS} times, which no drawing "
                    "does; export it again"
                )
            top, left, mask = yield from filled_steps(edges, grid.shape[2])
            for number in (number for one in scanned for number in volume_slices[one]):
                label_map.paint(number, mask, label, top, left)
            done += 1
            yield Step(done / total, "Filling contours")
    if not thick:
        return []
    named = ", ".join(thick[:8]) + (f" and {len(thick) - 8} more" if len(thick) > 8 else "")
    return [f"contours lie several slices apart, and those between take the nearest contour ({named} slices)"]


def with_slices_between(planes: list[int]) -> tuple[dict[int, list[int]], int]:
    """For every slice with contours the slices that take them, and how many slices apart contours usually are.

    Examples
    --------
    >>> with_slices_between([4, 6, 8, 14])
    ({4: [4, 5], 6: [6, 7], 8: [8], 14: [14]}, 2)
    """
    step = int(np.median(np.diff(planes))) if len(planes) > 1 else 1
    targets = {plane: [plane] for plane in planes}
    for low, high in pairwise(planes):
        if high - low <= step:
            for between in range(low + 1, high):
                targets[low if 2 * (between - low) <= high - low else high].append(between)
    return targets, step
