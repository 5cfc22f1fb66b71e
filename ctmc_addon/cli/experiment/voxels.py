# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc experiment voxels`: measure time and error of larger voxels (Su and Ma, table 1 and figures 4 to 7)."""

from __future__ import annotations

import argparse
import gc
import statistics
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...core import (
    Budget,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Step,
    Steps,
    Volume,
    equal_part,
    finish,
    reconstruct_steps,
)
from ...core.mesh import SurfaceDistance
from ...reporting.parse import parsed_stride
from ..flags.arguments import at_least, flags_checked
from ..terminal import dimensions
from .common import MEASURING, Work, distance_cells, distances_steps, facts_of, measured, settings_of, way_cells
from .plot import Plot, series
from .table import MAX_MM, MEAN_MM, TRIANGLES, VOLUME_ML, WAYS, Column, ExperimentTable, Row, figures, runs_text, unique

STAGES = {"Reading": 1, "Reconstructing": 2, "Timing": 6, "Measuring": 1}
# The stage of labels, smoothing and Otsu's threshold, which takes every pixel whatever the stride.
PREPARING = "Preparing values"
# A single short reconstruction says more about other programs on the machine than about itself.
RUN_SECONDS, MOST_IN_A_RUN = 0.1, 20
HELP = "table 1: larger voxels"
DESCRIPTION = (
    "Reconstruct with several strides, in turn, and compare time, triangles and surface with voxels of one pixel."
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags for the strides and the number of repetitions."""
    parser.add_argument(
        "--strides",
        nargs="+",
        type=sides_of,
        default=[(1, 1), (2, 2), (3, 3)],
        metavar="N",
        help="strides in x and y, px: 2, or 2x1 for different ones; z is that of --stride (default 1 2 3)",
    )
    parser.add_argument("--repeats", type=at_least(1), default=5, metavar="N", help="timed runs of each (default 5)")


def sides_of(word: str) -> tuple[int, int]:
    """Return sides in x and y, pixels.

    Examples
    --------
    >>> sides_of("2"), sides_of("2x1")
    ((2, 2), (2, 1))
    """
    try:
        return parsed_stride(word)
    except SettingsError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def table_of(args: argparse.Namespace, work: Work, _folder: Path) -> ExperimentTable:
    """Return the table."""
    settings = settings_of(args)
    with flags_checked():
        sides = [(x, y, settings.stride[2]) for x, y in unique(args.strides, first=(1, 1))]
        variants = [replace(settings, stride=stride) for stride in sides]
    volume = work.read(settings)
    results = work.run("Reconstructing", _surfaces_steps(volume, variants, work.budget))
    runs = work.run("Timing", _runs_steps(volume, variants, args.repeats, work.budget))
    meshes = [result.mesh for result in results]
    rows = _rows_of(results, runs, work.run("Measuring", distances_steps(meshes[1:], meshes[0])))
    result = results[0]
    timed = ", ".join(stage.name.lower() for stage in result.stages if stage.name != PREPARING)
    facts = [
        *facts_of(volume, variants[0], result.threshold, result.notes),
        ("seconds", f"{runs_text(args.repeats)}, after one that is not counted; a run repeats "),
        ("", f"the reconstruction until {RUN_SECONDS:g} s have passed and is the median of that"),
        ("timed", f"{timed}; neither reading nor writing"),
        ("preparing", "labels, smoothing and Otsu's threshold, pixel by pixel whatever the stride, in its own column"),
        ("compared", "time, volume and surface with a stride of 1 x 1 pixel in x and y"),
        MEASURING,
    ]
    charts = {
        "Reconstruction time, s": series(rows, seconds="seconds"),
        "Distance to voxels of 1 x 1, mm": series(rows, mean="mean_mm", maximum="max_mm"),
    }
    labels = [dimensions(row["sides_px"][:2]) for row in rows]
    plot = Plot("Time and error over the stride", "stride in x and y, px", labels, charts)
    return ExperimentTable("Larger voxels", facts, COLUMNS, rows, plot)


def _surfaces_steps(
    volume: Volume, variants: Sequence[ReconstructionSettings], budget: Budget
) -> Steps[list[Reconstruction]]:
    results = []
    for at, settings in enumerate(variants):
        results.append((yield from equal_part(reconstruct_steps(volume, settings, budget), at, len(variants))))
    return results


def _runs_steps(
    volume: Volume, variants: Sequence[ReconstructionSettings], repeats: int, budget: Budget
) -> Steps[list[list[tuple[float, float]]]]:
    """Return the runs of each of the settings, made in turn."""
    runs: list[list[tuple[float, float]]] = [[] for _ in variants]
    for turn in range(repeats):
        for at, settings in enumerate(variants):
            done = (turn * len(variants) + at) / (repeats * len(variants))
            yield Step(done, f"Timing a stride of {dimensions(settings.stride[:2])}, run {turn + 1} of {repeats}")
            gc.collect()
            runs[at].append(_run(volume, settings, budget))
    return runs


def _run(volume: Volume, settings: ReconstructionSettings, budget: Budget) -> tuple[float, float]:
    """Return the seconds of preparing the values and of all stages after it, medians over `RUN_SECONDS`."""
    preparing: list[float] = []
    seconds: list[float] = []
    while sum(preparing) + sum(seconds) < RUN_SECONDS and len(seconds) < MOST_IN_A_RUN:
        stages = finish(reconstruct_steps(volume, settings, budget)).stages
        preparing.append(sum(stage.seconds for stage in stages if stage.name == PREPARING))
        seconds.append(sum(stage.seconds for stage in stages if stage.name != PREPARING))
    return statistics.median(preparing), statistics.median(seconds)


def _rows_of(
    results: Sequence[Reconstruction],
    runs: Sequence[Sequence[tuple[float, float]]],
    distances: Sequence[SurfaceDistance],
) -> list[Row]:
    """Return the rows of every stride; distances are those of all but the first."""
    reference = results[0].mesh.enclosed_volume
    rows: list[Row] = []
    for result, pairs, distance in zip(results, runs, (SurfaceDistance(), *distances), strict=True):
        x, y, _ = sides = result.settings.stride
        preparing, seconds = map(list, zip(*pairs, strict=True))
        median, volume = statistics.median(seconds), result.mesh.enclosed_volume
        rows.append(
            {
                "stride": x if x == y else f"{x}x{y}",
                "seconds": median,
                "improved_percent": 100.0 * (1.0 - median / (rows[0]["seconds"] if rows else median)),
                "voxels": result.voxels_visited,
                **measured(result.mesh, "faces", "volume_mm3"),
                "volume_error_percent": None if volume is None or not reference else 100.0 * (volume / reference - 1.0),
                **distance_cells(distance),
                "prepare_seconds": statistics.median(preparing),
                "runs": seconds,
                "sides_px": list(sides),
                "sides_mm": [side * gap for side, gap in zip(sides, result.spacing_mm, strict=True)],
                **way_cells(distance),
            }
        )
    return rows


COLUMNS = (
    Column("stride", lambda row: f"{dimensions(row['sides_px'][:2])} px"),
    Column("mm", lambda row: dimensions([round(side, 2) for side in row["sides_mm"][:2]])),
    figures("seconds", "seconds", 4),
    figures("improved, %", "improved_percent", 1),
    figures("preparing, s", "prepare_seconds", 4),
    figures("voxels", "voxels", 0),
    TRIANGLES,
    VOLUME_ML,
    figures("volume error, %", "volume_error_percent", 2),
    MEAN_MM,
    MAX_MM,
    *WAYS,
)
