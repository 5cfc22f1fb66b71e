# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc segment CT -o labels.seg.nrrd --seed NAME X Y Z`: segment structures from points into a label file."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ... import readers
from ...core import (
    SETTINGS,
    LabelError,
    ReconstructionSettings,
    SettingsError,
    Stages,
    Steps,
    Volume,
    defaults,
    volume_text,
)
from ...core.files.atomic_write import require_writable, whole_files
from ...core.files.file_names import printable
from ...core.files.label_files import LABEL_SUFFIXES, Segment, write_labels_steps
from ...core.segmentation import (
    HU_PER_MM,
    MAX_MM,
    Click,
    Sample,
    compete_steps,
    connected_steps,
    range_mask_steps,
    require_count,
    sample_at,
)
from ...core.volume import Box, ValueKind, box_of
from .. import dicom_segmentation
from ..drawn_structures import Structures
from ..flags.arguments import UsageError, add_input, add_quiet, reading_of, with_flags
from ..flags.described import add_flag
from ..terminal import Progress, listing, titled

STAGES = {
    "Opening the CT": 1,
    "Reading the CT": 4,
    "Reading labels": 1,
    "Segmenting": 4,
    "Growing": 1,
    "Writing": 2,
    "Reading back": 1,
}
METHODS = ("compete", "connected")


@dataclass(frozen=True)
class Request:
    """A request as the flags describe it.

    Parameters
    ----------
    points : list of (str, (x, y, z))
        Structure, empty for the surroundings, and RAS+ mm, as given.
    margins : mapping of str to float
        Millimeters, by structure.
    """

    points: list[tuple[str, tuple[float, ...]]]
    margins: Mapping[str, float]
    method: str
    limits: tuple[float, float] | None
    region: tuple[float, ...] | None
    region_unit: str
    max_mm: float | None
    opening_mm: float
    hu_per_mm: float


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "segment",
        help="make labels from points in a CT",
        description="Segment structures from points in a CT and write them as labels: a 3D Slicer segmentation "
        "(.seg.nrrd, with names, colors and overlaps), NIfTI (.nii, .nii.gz) or a DICOM segmentation "
        "(.dcm). Points are in RAS+ mm; repeat the flag for each.",
    )
    add_input(parser)
    parser.add_argument(
        "-o", "--output", required=True, metavar="FILE", help="labels: .seg.nrrd, .nrrd, .nii, .nii.gz, .dcm"
    )
    parser.add_argument(
        "--with-identity", action="store_true",
        help="write the patient's name, birth date and ID into a DICOM segmentation (.dcm), as DICOM requires",
    )  # fmt: skip
    parser.add_argument(
        "--seed", action="append", dest="points", nargs=4, default=[], metavar=("NAME", "X", "Y", "Z"),
        help="point inside a structure; with --method compete, later points correct earlier ones",
    )  # fmt: skip
    parser.add_argument(
        "--background", action="append", dest="points", nargs=3, default=[], metavar=("X", "Y", "Z"),
        help="point outside all structures; stops a leak",
    )  # fmt: skip
    parser.add_argument("--range", nargs=2, metavar=("LOW", "HIGH"), help="take only values between these two")
    own = defaults(ReconstructionSettings)
    for name in ("region", "region_unit"):
        add_flag(parser, name, SETTINGS[name], own[name])
    parser.add_argument(
        "--method", choices=METHODS, default=METHODS[0],
        help="compete: assign each voxel to the nearest point, counting mm and HU differences, and cut "
            "where the border is sharpest; connected: take the voxels connected to the points within "
            "--range (default: compete)",
    )  # fmt: skip
    parser.add_argument(
        "--max-mm",
        metavar="MM",
        help="farthest distance from its points that a structure reaches; increase for a large organ with "
        f"one point (default: {MAX_MM:g} for compete)",
    )
    parser.add_argument(
        "--hu-per-mm",
        metavar="HU",
        help=(
            f"compete: HU difference that counts as one millimeter; increase for a noisy CT (default: {HU_PER_MM:g})"
        ),
    )
    parser.add_argument(
        "--opening-mm", metavar="MM", help="connected: do not pass openings narrower than this (default: pass all)"
    )
    parser.add_argument(
        "--margin", action="append", nargs=2, default=[], metavar=("NAME", "MM"),
        help="grow a finished structure; a negative number shrinks it",
    )  # fmt: skip
    parser.add_argument("--from", dest="labels", metavar="FILE", help="labels on the CT's grid to start from")
    add_quiet(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Make the structures, write them, read them back and print their volumes."""
    request = _request_of(args)
    output = require_writable(args.output, (*LABEL_SUFFIXES, dicom_segmentation.SUFFIX))
    as_dicom = output.suffix.lower() == dicom_segmentation.SUFFIX
    _check_identity(as_dicom, args.with_identity)
    stages = Stages(STAGES)
    opening, reading, before, segmenting, growing, writing, back = STAGES
    with Progress() as progress:
        options = reading_of(args)
        source = progress.finish(stages.run(opening, readers.open_volume_steps(args.input, options.allow_outside)))
        images = dicom_segmentation.images_of(source, options) if as_dicom else []
        ct = progress.finish(stages.run(reading, source.read_steps(options)))
        if ct.kind == ValueKind.LABEL:
            raise LabelError(f"{Path(args.input).name} holds labels; give the CT as INPUT and the labels with --from")
        structures = Structures(ct.shape)
        if args.labels:
            progress.finish(stages.run(before, structures.read_steps(args.labels, ct)))
        progress.finish(stages.run(segmenting, _segmented_steps(structures, ct, request)))
        progress.finish(stages.run(growing, structures.grow_steps(request.margins, ct.spacing)))
        segments = structures.segments(in_order=as_dicom)
        with whole_files([output]) as temporary_paths:
            path = temporary_paths[output]
            if as_dicom:
                dicom_segmentation.write(path, structures.layers, segments, ct.affine, images)
            else:
                labels = structures.layers.labels
                progress.finish(stages.run(writing, write_labels_steps(path, labels, segments, ct.affine)))
            progress.finish(stages.run(back, structures.check_steps(path, segments, ct.affine)))
    print(text_of(structures, segments, ct, output))


def _check_identity(as_dicom: bool, with_identity: bool) -> None:
    """Refuse an identity that is not asked for, and one that is asked for where none can be."""
    if as_dicom and not with_identity:
        raise UsageError(
            "a DICOM segmentation carries the patient's name, birth date and ID, as DICOM requires; "
            "allow it with --with-identity, or write a .seg.nrrd, which carries none"
        )
    if with_identity and not as_dicom:
        raise UsageError("--with-identity is for a DICOM segmentation, -o labels.dcm; other files carry no identity")
    if as_dicom:
        dicom_segmentation.require_highdicom()


def _request_of(args: argparse.Namespace) -> Request:
    """Return the request that the flags describe, or raise a `UsageError` if they contradict each other."""
    points: list[tuple[str, tuple[float, ...]]] = []
    for words in args.points:
        if len(words) == 3:
            points.append(("", _numbers_of("--background", words)))
            continue
        called = printable(words[0])
        if not called:
            raise UsageError("--seed begins with the structure's name: --seed liver -40 20 95")
        points.append((called, _numbers_of("--seed", words[1:])))
    seeds = [name for name, _ in points if name]
    margins = {printable(name): _numbers_of("--margin", [mm])[0] for name, mm in args.margin}
    if len(margins) < len(args.margin):
        raise UsageError("--margin is given twice for one structure; give it once, with the sum")
    limits = None if args.range is None else _numbers_of("--range", args.range)
    if not seeds and not (args.labels and margins):
        raise UsageError("give a point with --seed NAME X Y Z, or labels with --from and a --margin")
    if points and not seeds:
        raise UsageError(
            "--background takes voxels from a structure; give the structure a point with --seed NAME X Y Z"
        )
    if args.method == "connected" and seeds and limits is None:
        raise UsageError("--method connected needs --range LOW HIGH: it takes connected voxels in that range")
    if args.method == "connected" and len(seeds) < len(points):
        raise UsageError("--background is for --method compete; with connected choose --opening-mm or a --range")
    if args.method == "compete" and args.opening_mm is not None:
        raise UsageError("--opening-mm is for --method connected; with compete close a leak by --background X Y Z")
    max_mm = None if args.max_mm is None else _numbers_of("--max-mm", [args.max_mm])[0]
    opening_mm = 0.0 if args.opening_mm is None else _numbers_of("--opening-mm", [args.opening_mm])[0]
    if args.method == "connected" and args.hu_per_mm is not None:
        raise UsageError("--hu-per-mm is for --method compete; with connected choose --opening-mm or a --range")
    hu_per_mm = HU_PER_MM if args.hu_per_mm is None else _numbers_of("--hu-per-mm", [args.hu_per_mm])[0]
    region, unit = getattr(args, "region", None), getattr(args, "region_unit", "voxel")
    given = None if limits is None else (limits[0], limits[1])
    return Request(points, margins, args.method, given, region, unit, max_mm, opening_mm, hu_per_mm)


def _numbers_of(flag: str, words: list[str]) -> tuple[float, ...]:
    """Return the numbers of a flag; raise `UsageError` for one that is not a finite number."""
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = (math.nan,)
    if not all(math.isfinite(number) for number in numbers):
        raise UsageError(f"{flag} takes finite numbers, not {' '.join(words)}")
    return numbers


def _segmented_steps(structures: Structures, ct: Volume, request: Request) -> Steps[None]:
    """Make the structures of the seeds, and add them to those that are there."""
    names = list(dict.fromkeys(name for name, _ in request.points if name))
    if not names:
        return
    require_count(len(names))
    box = box_of(ct, request.region, request.region_unit)
    part = ct.part(box)
    samples = [(name, _clicked_sample(ct, point, box)) for name, point in request.points]
    allowed = None
    if request.limits is not None:
        allowed = yield from range_mask_steps(part, *request.limits)
        for (name, sample), (_, point) in zip(samples, request.points, strict=True):
            if name and not allowed[sample]:
                raise SettingsError(
                    f"the point {_numbers_text(point)} of {name} has the value "
                    f"{value_at(part, sample):.5g}, outside the range {request.limits[0]:g} to "
                    f"{request.limits[1]:g}; give another point or a wider range"
                )
    x, y, z = (slice(*side) for side in box)
    if request.method == "connected":
        assert allowed is not None
        max_mm = math.inf if request.max_mm is None else request.max_mm
        for name in names:
            own = [sample for called, sample in samples if called == name]
            mask = yield from connected_steps(allowed, own, part.spacing, max_mm, request.opening_mm)
            structures.add(name, mask, (z, y, x))
        return
    clicks = [Click(sample, names.index(name) + 1 if name else 0) for name, sample in samples]
    reach_mm = MAX_MM if request.max_mm is None else request.max_mm
    labels = yield from compete_steps(part, clicks, allowed, request.hu_per_mm, reach_mm)
    for number, name in enumerate(names, 1):
        structures.add(name, labels == number, (z, y, x))


def _clicked_sample(ct: Volume, point: tuple[float, ...], box: Box) -> Sample:
    """Return the sample of a region at a point; refuse one that lies outside of it, or that has no value."""
    sample = sample_at(ct, point)
    if not math.isfinite(value_at(ct, sample)):
        raise SettingsError(f"the CT is NaN at the point {_numbers_text(point)}; give another point")
    z, y, x = (at - low for at, (low, _) in zip(sample, reversed(box), strict=True))
    if min(z, y, x) < 0 or any(at >= high - low for at, (low, high) in zip((x, y, z), box, strict=True)):
        raise SettingsError(
            f"the point {_numbers_text(point)} lies outside the region; give another point or a larger --region"
        )
    return z, y, x


def value_at(volume: Volume, sample: Sample) -> float:
    """Return the value of a sample."""
    z, y, x = (range(at, at + 1) for at in sample)
    return float(volume.samples(z, y, x)[0, 0, 0])


def _numbers_text(point: tuple[float, ...]) -> str:
    """Return a point as it is given."""
    return " ".join(f"{part:g}" for part in point)


def text_of(structures: Structures, segments: Sequence[Segment], ct: Volume, output: Path) -> str:
    """Return the volumes of the structures, and what was assumed, for a person."""
    lines = []
    for segment, voxels in zip(segments, structures.layers.voxels().values(), strict=True):
        volume = volume_text(voxels * ct.voxel_mm3)
        lines.append((segment.name, f"{volume}, {voxels} voxels, label {segment.label}"))
    notes = [*map(with_flags, ct.notes), *structures.notes]
    return listing([*lines, ("file", output.name), *titled("note", notes)])
