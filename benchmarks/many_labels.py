# SPDX-License-Identifier: GPL-3.0-or-later
"""All labels of a volume at once: 104 bodies of an adult's sizes in 512 x 512 x 600, against the largest one alone.

The same from file to files, and the organs of a patient, with shared walls against each by itself.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import ReconstructionSettings, Volume, finish, reconstruct, reconstruct_labels
from ctmc_addon.core.volume import label_extents_steps
from ctmc_addon.readers import read_volume

from .measuring import Row, Session
from .processes import run, written

SIZE = (600, 512, 512)  # (slices, rows, columns)
SPACING_MM = (0.75, 0.75, 1.0)
FILES_SECONDS = 14.85  # Target for all labels, from a NIfTI to STL files: half of the first time.
SHARED = 1.5  # Target ratio to the time of separate surfaces.
# Milliliters of what TotalSegmentator finds in an adult, and how often; and how many times longer than wide it is.
BODIES = (
    (1500, 1, 1.3), (1300, 1, 1.1), (850, 5, 1.5), (800, 2, 1.4), (700, 4, 4.0), (350, 4, 2.0), (300, 3, 3.0),
    (220, 3, 1.8), (200, 3, 6.0), (150, 4, 1.6), (100, 8, 1.5), (60, 14, 1.3), (30, 14, 2.0), (14, 26, 8.0),
    (8, 6, 5.0), (4, 6, 2.0),
)  # fmt: skip


def many_bodies(size: tuple[int, int, int] = SIZE) -> Volume:
    """Make wavy ellipsoids, each with its own label from 1 on in the order of sizes, in all orientations."""
    rng = np.random.default_rng(104)
    labels = np.zeros(size, np.uint8)
    spacing = np.array(SPACING_MM[::-1])  # z, y, x
    extent = np.array(size) * spacing
    scale = float(np.prod(size) / np.prod(SIZE)) ** (1 / 3)
    number = 0
    for milliliters, count, long in BODIES:
        for _ in range(count):
            number += 1
            short = scale * (1000 * milliliters / (4 / 3 * np.pi * long)) ** (1 / 3)
            axes = short * np.array([long, 1.0, 1.0])
            turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            reach = 1.08 * np.sqrt(((turn * axes) ** 2).sum(axis=1))
            reach_in = np.minimum(reach, 0.49 * extent)
            put(labels, number, rng.uniform(reach_in, extent - reach_in), reach, turn / axes, spacing)
    return Volume(labels, np.diag([*SPACING_MM, 1.0]), name="bodies", kind="label")


def put(
    labels: NDArray[np.uint8],
    number: int,
    middle: NDArray[np.float64],
    reach: NDArray[np.float64],
    turn: NDArray[np.float64],
    spacing: NDArray[np.float64],
) -> None:
    """Fill one body: free samples at which its rotated, wavy radius is below 1."""
    low = np.maximum(0, np.floor((middle - reach) / spacing).astype(int))
    high = np.minimum(labels.shape, np.ceil((middle + reach) / spacing).astype(int) + 1)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    z, y, x = (
        ((np.arange(a, b) * side - at).astype(np.float32)).reshape([-1 if n == axis else 1 for n in range(3)])
        for axis, (a, b, side, at) in enumerate(zip(low, high, spacing, middle, strict=True))
    )
    u, v, w = (z * t[0] + y * t[1] + x * t[2] for t in turn.T.astype(np.float32))
    radius = u * u + v * v + w * w + np.float32(0.08) * (np.sin(9 * u) * np.sin(7 * v) + np.sin(8 * w))
    part = labels[box]
    part[(radius < 1) & (part == 0)] = number


def measure(session: Session) -> None:
    """Compare all labels with the largest label, smoothed by default and bare, each on a fresh volume."""
    bodies = many_bodies()
    extents = finish(label_extents_steps(bodies))
    largest = max(extents, key=lambda label: extents[label].voxels)
    for smoothing in ("constrained", "none"):
        settings = ReconstructionSettings(label=largest, smoothing=smoothing, interfaces="separate")

        def everything(settings: ReconstructionSettings = settings) -> Any:
            return reconstruct_labels(replace(bodies), settings).surfaces

        def largest(settings: ReconstructionSettings = settings) -> Any:
            return reconstruct(replace(bodies), settings)

        work = f"{len(extents)} labels of 512 x 512 x 600 by themselves, smoothing {smoothing}"
        session.compare(work, everything, {"the largest label alone": (largest, 4.0)}, repeats=min(3, session.repeats))
    to_files(session, bodies, len(extents))
    organs = session.data / "ts_nifti" / "example_seg_fast_force_split.nii.gz"
    if not organs.exists():
        session.say(f"No {organs.name} in {session.data}: its row is left out")
    else:
        volume = read_volume(organs)
        count = len(finish(label_extents_steps(volume)))

        def make(interfaces: str) -> Any:
            settings = ReconstructionSettings(label=1, interfaces=interfaces)
            return reconstruct_labels(replace(volume), settings).surfaces

        session.compare(
            f"{count} organs of a patient at 3 mm, walls shared",
            lambda: make("shared"),
            {"each by itself": (lambda: make("separate"), SHARED)},
            repeats=min(3, session.repeats),
        )


def to_files(session: Session, bodies: Volume, count: int) -> None:
    """Time all labels as users make them: a process that reads a NIfTI and writes a folder of STL."""
    source = written(session.scratch / "bodies.nii", bodies.values, bodies.affine)
    seconds = {}
    for interfaces in ("separate", "shared"):
        out = session.scratch / interfaces
        asked = ["--label", "all", "--interfaces", interfaces, "-o", f"{out}{os.sep}"]
        seconds[interfaces], _ = session.timed(
            lambda a=asked: run(["ctmc_addon", "reconstruct", str(source), *a], None)
        )
        assert len(list(out.glob("*.stl"))) == count, "a label is missing"
        shutil.rmtree(out)
    source.unlink()
    work = f"{count} labels of 512 x 512 x 600 to STL, whole process"
    separate, shared = seconds["separate"], seconds["shared"]
    session.add(Row(session.part, f"{work}, by themselves", f"{FILES_SECONDS:g} s", separate, FILES_SECONDS, 1.0))
    session.add(Row(session.part, f"{work}, walls shared", "each by itself", shared, separate, SHARED))
