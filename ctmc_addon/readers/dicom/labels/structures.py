# SPDX-License-Identifier: GPL-3.0-or-later
"""Read DICOM structure sets: contours of a radiotherapy plan, filled on the slices of their CT.

A contour within another of the same region is a hole, drawn with a keyhole or as one of its own. Contours that overlap
in part are united, but for those of type CLOSEDPLANAR_XOR. Slices between contours take the body between them, as
`contour_planes` tells. Positions are in LPS+ mm. DICOM PS3.3 C.8.8.5 and C.8.8.6.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, Stages, Step, Steps
from ....core.volume import ValueKind
from ...labels.colors import RGB, rgb_of_bytes
from ...labels.label_map import LabelMap, clean_name, limited
from ...optional_imports import imported_steps
from ...result import RawValues, ReadRequest, VolumeSource
from ...series import Series
from ..header import Slice
from .contour_filling import fill_steps
from .contour_planes import Contour, Plane, PlaneAssignment, assigned_planes, planes_of
from .elements import LOCATION, VALUE, Damaged, Elements, ElementWalker, ValueLocation
from .label_file import decimals, opened, reference_of, texts, uid, whole
from .references import Reference, grid_of, referenced_slices_steps
from .slice_grid import SliceGrid

REQUESTED = {
    0x00080005: VALUE,
    0x0020000E: VALUE,
    0x30060010: {  # Referenced frames of reference: studies: series: images.
        0x00200052: VALUE,
        0x30060012: {0x30060014: {0x0020000E: VALUE, 0x30060016: {0x00081155: VALUE}}},
    },
    0x30060020: {0x30060022: VALUE, 0x30060024: VALUE, 0x30060026: VALUE},  # Regions.
    0x30060039: {  # Contours of the regions.
        0x30060084: VALUE,
        0x3006002A: VALUE,
        0x30060040: {0x30060016: {0x00081155: VALUE}, 0x30060042: VALUE, 0x30060050: LOCATION},
    },
}
XOR = "CLOSEDPLANAR_XOR"
CLOSED = ("CLOSED_PLANAR", XOR)
OPEN = ("POINT", "OPEN_PLANAR", "OPEN_NONPLANAR")
LONGEST_CONTOUR = 1 << 26  # A longer contour, in bytes of decimal text, is damage.
MOST_BYTES = 1 << 29  # All contours of a set may have this many bytes.
MOST_MM = 1e6
PLANAR = 0.25  # A contour may leave its plane by this share of the gap between slices.
CONTOURS_PER_STEP = 64

LeftOut = Counter[tuple[str, str]]  # Counts by reason and region name.


class Region(NamedTuple):
    """One region of interest."""

    name: str
    color: RGB | None
    contours: list[tuple[str, ValueLocation]]  # Type of each contour, and location of its positions.


class _StructureHeader(NamedTuple):
    """The description of the regions in a structure set."""

    series: str
    regions: list[Region]
    reference: Reference


class _StructureSource(VolumeSource):
    """One DICOM structure set, on the grid of its CT."""

    format = "DICOM RTSTRUCT"
    has_geometry = True

    def __init__(self, path: Path, header: _StructureHeader, slices: list[Slice]) -> None:
        self.header, self.slices = header, slices
        count, rows, columns = grid_of(slices, path, False)[0].shape
        dtype = "uint8" if len(header.regions) < 256 else "uint16"
        super().__init__(path, (Series(1, header.series, count, (columns, rows), "RTSTRUCT", dtype),), [path])

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Fill every region; those that overlap lie in different layers."""
        stages = Stages({"Reading contours": 1, "Filling contours": 2})
        grid, notes = grid_of(self.slices, self.path, request.strict)
        structures, left_out = yield from stages.run("Reading contours", _planes_steps(self.path, self.header, grid))
        numbered = list(enumerate(self.header.regions, 1))
        names = {label: region.name for label, region in numbered}
        colors = {label: region.color for label, region in numbered if region.color}
        label_map = LabelMap(grid.shape, names, colors, self.path.name, budget=request.budget)
        assignments = assigned_planes(structures, grid)
        for (_, region), planes, assignment in zip(numbered, structures, assignments, strict=True):
            _count_unused(region.name, planes, assignment, grid, left_out)
        if not any(assignment.sources for assignment in assignments):
            reasons = "; ".join(_left_out_notes(left_out))
            raise ReadError(
                f"{self.path.name} has no contours to fill on its CT ({reasons}); choose another structure set"
            )
        notes += yield from stages.run(
            "Filling contours", fill_steps(label_map, structures, assignments, grid, self.path.name)
        )
        notes += _left_out_notes(left_out)
        notes += label_map.overlap_note("regions")
        notes += label_map.empty_note("regions")
        names, colors = label_map.names, label_map.colors
        first, *further = label_map.layers()
        return RawValues(first, grid.affine, tuple(notes), ValueKind.LABEL, names, colors, layers=tuple(further))


def open_steps(path: Path) -> Steps[_StructureSource]:
    """Read the file's header, and those of the images near it; raise a `ReadError` if its CT is missing."""
    stages = Stages({"Loading pydicom": 1, "Reading headers": 2, "Looking for the CT": 4})
    yield from stages.run("Loading pydicom", imported_steps("pydicom", "pydicom", "DICOM"))
    header = yield from stages.run("Reading headers", header_steps(path))
    slices = yield from stages.run("Looking for the CT", referenced_slices_steps(path, header.reference))
    if not slices:
        raise ReadError(
            f"{path.name} holds contours, and the CT series that they were drawn on is not in its folder, a "
            "folder in it or a neighboring folder; put the two in one folder"
        )
    return _StructureSource(path, header, slices)


def header_steps(path: Path) -> Steps[_StructureHeader]:
    """Read the description of the regions, and locate their contours."""
    with opened(path) as (elements, _):
        header = yield from elements.dataset_steps(REQUESTED)
        decoded = texts(header)
        frames = header.get(0x30060010, [])
        series = [item for frame in frames for study in frame.get(0x30060012, ()) for item in study.get(0x30060014, ())]
        # PS3.3 C.8.8.5: the sequence of frames of reference is optional, the one of each region is not.
        named = [frame.get(0x00200052) for frame in frames]
        named += [region.get(0x30060024) for region in header.get(0x30060020, ())]
        coordinates = next((uid(value) for value in named if value), "")
        reference = reference_of(header, series + images_of(header), 0x30060016, coordinates)
        drawn = {whole(item[0x30060084]): item for item in header.get(0x30060039, ()) if item.get(0x30060084)}
        regions = []
        for number, item in enumerate(header.get(0x30060020, ()), 1):
            own = drawn.get(whole(item.get(0x30060022, b"0")), {})
            name = clean_name(decoded(item.get(0x30060026, b"")), f"region {number}")
            regions.append(Region(name, color_of(own), contours_of(own)))
    if not any(region.contours for region in regions):
        raise ReadError(f"{path.name} has no contours; choose another structure set")
    if sum(location.length for region in regions for _, location in region.contours) > MOST_BYTES:
        raise ReadError(f"{path.name} has more than {MOST_BYTES} bytes of contours; export fewer regions")
    return _StructureHeader(uid(header.get(0x0020000E, b"")), regions, reference)


def images_of(header: Elements) -> list[Elements]:
    """Return the contours, each of which may name the images that it was drawn on."""
    return [contour for region in header.get(0x30060039, ()) for contour in region.get(0x30060040, ())]


def color_of(item: Elements) -> RGB | None:
    """Return ROIDisplayColor; None if it is not a color, because nothing else depends on it."""
    words = item.get(0x3006002A, b"").rstrip(b"\0 ").split(b"\\")
    return rgb_of_bytes([word.decode("ascii", "replace") for word in words])


def contours_of(item: Elements) -> list[tuple[str, ValueLocation]]:
    """Return type and location of every contour of a region."""
    contours = item.get(0x30060040, ())
    return [
        (uid(contour.get(0x30060042, b"")).upper(), contour[0x30060050])
        for contour in contours
        if contour.get(0x30060050) is not None
    ]


def _planes_steps(path: Path, header: _StructureHeader, grid: SliceGrid) -> Steps[tuple[list[list[Plane]], LeftOut]]:
    """Return the planes of every region, and counts of omitted contours by reason."""
    structures, left_out = [], LeftOut()
    total = sum(len(region.contours) for region in header.regions)
    done, slice_mm = 0, grid.slice_mm
    with opened(path) as (elements, _):
        for region in header.regions:
            contours = []
            for kind, location in region.contours:
                done += 1
                if done % CONTOURS_PER_STEP == 0:
                    yield Step(done / total, "Reading contours")
                if kind not in CLOSED:
                    left_out[_type_text(kind, path.name), region.name] += 1
                    continue
                points = positions_of(elements, location)
                if len(points) < 3:
                    left_out["contours of less than 3 points", region.name] += 1
                    continue
                height, corners, spread = grid.in_plane(points)
                if spread > PLANAR * slice_mm:
                    left_out["contours that do not lie in the plane of the slices", region.name] += 1
                else:
                    contours.append(Contour(height, corners, kind == XOR))
            planes, copies = planes_of(contours, slice_mm)
            if copies:
                left_out["copies of contours", region.name] += copies
            structures.append(planes)
    return structures, left_out


def _type_text(kind: str, name: str) -> str:
    """Return why contours of a type are left out; `name` is the file's."""
    if kind in OPEN:
        return f"contours of type {kind}, which enclose nothing"
    if not kind:
        return f"contours in {name} without a type (ContourGeometricType)"
    return f"contours in {name} of type '{clean_name(kind, '')}', which DICOM does not define"


def _count_unused(
    region: str, planes: list[Plane], assignment: PlaneAssignment, grid: SliceGrid, left_out: LeftOut
) -> None:
    """Count the contours of planes that no slice takes."""
    first, last = grid.heights[[0, -1]].tolist()
    for number in set(range(len(planes))) - assignment.used:
        outside = not first <= planes[number].height <= last
        why = "contours above or below all slices" if outside else "contours of planes that lie closer than the slices"
        left_out[why, region] += len(planes[number].contours)


def _left_out_notes(left_out: LeftOut) -> list[str]:
    """Return a note for each reason, with the regions that have such contours."""
    notes = []
    for reason in sorted({reason for reason, _ in left_out}):
        counts = {region: count for (why, region), count in left_out.items() if why == reason}
        named = limited(f"{region} {count}" for region, count in counts.items())
        notes.append(f"{reason}: {sum(counts.values())} left out ({named})")
    return notes


def positions_of(elements: ElementWalker, location: ValueLocation) -> NDArray[np.float64]:
    """Return the positions (n, 3) of one contour, mm; the file has x, y and z in turn as decimal text."""
    if location.length > LONGEST_CONTOUR:
        raise Damaged(f"a contour of {location.length} bytes, and at most {LONGEST_CONTOUR} are read")
    elements.file.seek(location.start)
    values = decimals(elements.file.read(location.length))
    if len(values) % 3:
        raise Damaged(f"a contour of {len(values)} numbers, which are not positions")
    if not (np.abs(values) <= MOST_MM).all():  # nor NaN
        raise Damaged("a contour with positions that are not numbers or are outside any patient")
    return values.reshape(-1, 3)
