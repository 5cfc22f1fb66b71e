# SPDX-License-Identifier: GPL-3.0-or-later
"""Read and check the description of frames and segments in a DICOM segmentation.

Positions are in LPS+ mm. DICOM PS3.3 C.8.20 (segmentation), C.7.6.16 (functional groups).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, Steps, spacing_text
from ....core.volume import SPACING_LIMITS, is_spacing
from ...labels.colors import RGB, rgb_of_cielab
from ...labels.label_map import MOST_LABELS, clean_name
from ..header import UNCOMPRESSED, Called, ImageFile
from ..pixels.pixel_format import Pixels, missing_pixels
from .elements import PIXELS, VALUE, Damaged, Elements
from .label_file import first_unsigned, numbers, opened, reference_of, texts, uid, unsigned, whole
from .references import Reference

FRAME_GROUP = {
    0x00209113: {0x00200032: VALUE},  # Position.
    0x00209116: {0x00200037: VALUE},  # Orientation.
    0x00289110: {0x00280030: VALUE, 0x00180050: VALUE, 0x00180088: VALUE},  # Spacing, thickness, gap.
    0x0062000A: {0x0062000B: VALUE},  # Segment.
}
REQUESTED = {
    0x00080005: VALUE,
    0x00081115: {0x0020000E: VALUE, 0x0008114A: {0x00081155: VALUE}},  # Referenced series and their images.
    0x0020000E: VALUE,
    0x00200052: VALUE,
    0x00280008: VALUE,
    0x00280010: VALUE,
    0x00280011: VALUE,
    0x00280100: VALUE,
    0x00280120: VALUE,
    0x00620001: VALUE,
    0x00620002: {0x00620004: VALUE, 0x00620005: VALUE, 0x0062000D: VALUE},
    0x0062000E: VALUE,
    0x52009229: FRAME_GROUP,
    0x52009230: FRAME_GROUP,
}
SAME_WAY = 1e-4
TYPES = {"BINARY": (1, 8), "FRACTIONAL": (8,), "LABELMAP": (8, 16)}  # A pixel may have these bits.


class Frames(NamedTuple):
    """The positions of the frames of a file, LPS+ mm."""

    positions: NDArray[np.float64]  # (n, 3)
    segments: NDArray[np.int64]  # (n,), 0 in a label map
    orientation: tuple[float, ...]
    spacing: tuple[float, ...]  # Millimeters between rows, then between columns.
    gap: float  # Millimeters between slices; 0 if missing.


class SegmentationHeader(NamedTuple):
    """The description of a segmentation in its file."""

    image: ImageFile
    kind: str  # BINARY, FRACTIONAL or LABELMAP
    half: float  # Half of the largest fraction.
    padding: int  # This value of a label map means 'no segment'.
    names: dict[int, str]
    colors: dict[int, RGB]
    frames: Frames
    reference: Reference


def header_steps(path: Path) -> Steps[SegmentationHeader]:
    """Read and check the description of frames and segments."""
    with opened(path) as (elements, syntax):
        header = yield from elements.dataset_steps(REQUESTED)
        kind = uid(header.get(0x00620001, b"")).upper()
        if kind not in TYPES:
            raise ReadError(f"{path.name} is a segmentation of type '{kind}', and {', '.join(TYPES)} are supported")
        image = image_of(path, header, syntax, kind, elements.size)
        decoded = texts(header)
        names, colors = segments_of(header, decoded, path.name)
        largest = first_unsigned(header, 0x0062000E, 255)
        padding = first_unsigned(header, 0x00280120, 0) if kind == "LABELMAP" else 0
        series = header.get(0x00081115, [])
        reference = reference_of(header, series, 0x0008114A)
        frames = _frames_of_header(header, image.pixels.options["number_of_frames"], kind == "LABELMAP", path.name)
    unknown = sorted(set(frames.segments.tolist()) - set(names)) if kind != "LABELMAP" else []
    if unknown:
        raise ReadError(f"{path.name} has frames of segment {unknown[0]}, which it does not describe; export it again")
    return SegmentationHeader(image, kind, largest / 2, padding, names, colors, frames, reference)


def image_of(path: Path, header: Elements, syntax: str, kind: str, size: int) -> ImageFile:
    """Return size and position of the pixels."""
    pixels = header.get(PIXELS[-1])
    if pixels is None:
        raise ReadError(f"{path.name} is a truncated segmentation: it has no pixels; copy it again")
    frame_count = whole(header.get(0x00280008, b"0"))
    rows, columns, bits = (first_unsigned(header, tag, 0) for tag in (0x00280010, 0x00280011, 0x00280100))
    if min(frame_count, rows, columns) < 1 or bits not in TYPES[kind]:
        raise ReadError(
            f"{path.name} says it has {frame_count} frames of {columns} x {rows} pixels of {bits} bits, which no "
            f"segmentation of type {kind} has; export it again"
        )
    options = {
        "number_of_frames": frame_count,
        "rows": rows,
        "columns": columns,
        "bits_allocated": bits,
        "bits_stored": bits,
        "samples_per_pixel": 1,
        "photometric_interpretation": "MONOCHROME2",
        "pixel_representation": 0,
        "pixel_keyword": "PixelData",
        "pixel_vr": pixels.vr or "OW",
    }
    stored = Pixels(syntax, bool(syntax) and syntax not in UNCOMPRESSED, False, None, pixels.start, options)
    damage = missing_pixels(stored, pixels.length, size)
    if damage:
        raise ReadError(f"{path.name} is truncated or damaged ({damage}); copy it again")
    return ImageFile(
        path=path,
        series=uid(header.get(0x0020000E, b"")),
        modality="SEG",
        rows=rows,
        columns=columns,
        uid="",
        frame_of_reference=uid(header.get(0x00200052, b"")),
        instance=0,
        called=Called("", "", ""),
        scout=False,
        gray=True,
        hounsfield=False,
        lookup=False,
        pixels=stored,
        frames=(),
    )


def segments_of(header: Elements, decoded: Callable[[bytes], str], name: str) -> tuple[dict[int, str], dict[int, RGB]]:
    """Return names and colors of the segments by number; in a label map 0 is the background."""
    names: dict[int, str] = {}
    colors: dict[int, RGB] = {}
    for item in header.get(0x00620002, ()):
        number = unsigned(item.get(0x00620004, b""))
        if not number or number[0] in names:
            raise ReadError(f"{name} has two segments with one number, or one without a number; export it again")
        names[number[0]] = clean_name(decoded(item.get(0x00620005, b"")), f"segment {number[0]}")
        cielab = unsigned(item.get(0x0062000D, b""))
        if len(cielab) == 3:
            colors[number[0]] = rgb_of_cielab(cielab)
    if not names:
        raise ReadError(f"{name} describes no segment; export it again")
    return names, colors


def _frames_of_header(header: Elements, count: int, is_map: bool, name: str) -> Frames:
    """Return position and segment of every frame, its own or shared by all."""
    groups = header.get(0x52009230, [])
    if len(groups) != count:
        raise Damaged(f"{len(groups)} functional groups for {count} frames")
    shared = (header.get(0x52009229) or [{}])[0]

    def of(group: Elements, sequence: int, tag: int) -> bytes:
        for source in (group, shared):
            items = source.get(sequence)
            if items and items[0].get(tag):
                return bytes(items[0][tag])
        return b""

    position_texts, segments, ways = [], [], set()
    for group in groups:
        position = of(group, 0x00209113, 0x00200032)
        if not position:
            raise ReadError(
                f"the frames of {name} have no position in the patient (ImagePositionPatient), as those of slide "
                "microscopy; export the segmentation of a CT"
            )
        position_texts.append(position)
        ways.add((of(group, 0x00209116, 0x00200037), of(group, 0x00289110, 0x00280030)))
        segment = unsigned(of(group, 0x0062000A, 0x0062000B))
        if not is_map and not (segment and 0 < segment[0] <= MOST_LABELS):
            raise Damaged("a frame without a segment")
        segments.append(0 if is_map else segment[0])
    if not all(part for way in ways for part in way):
        raise ReadError(f"the frames of {name} have no orientation or no PixelSpacing; export it again")
    orientation, spacing = _one_way({(numbers(turn, 6), numbers(sides, 2)) for turn, sides in ways}, name)
    unique = {text: numbers(text, 3) for text in set(position_texts)}
    first = groups[0]
    gap = of(first, 0x00289110, 0x00180088) or of(first, 0x00289110, 0x00180050)
    return Frames(
        np.array([unique[text] for text in position_texts], np.float64),
        np.array(segments, np.int64),
        orientation,
        spacing,
        abs(numbers(gap, 1)[0]) if gap else 0.0,
    )


def _one_way(
    ways: set[tuple[tuple[float, ...], tuple[float, ...]]], name: str
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the orientation and spacing of all frames; raise a `ReadError` if there are several."""
    first = min(ways)
    for orientation, spacing in ways:
        turn = max(abs(a - b) for a, b in zip(orientation, first[0], strict=True))
        scale = max(abs(a - b) for a, b in zip(spacing, first[1], strict=True))
        if turn > SAME_WAY or scale > SAME_WAY * max(spacing):
            raise ReadError(f"the frames of {name} have {len(ways)} orientations or spacings; export each by itself")
        if not is_spacing(spacing):
            raise ReadError(
                f"the frames of {name} have a PixelSpacing of {spacing_text(spacing, 6)}, and it must be "
                f"{SPACING_LIMITS}; export it again"
            )
    return first
