# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc experiment voxels`: time and error of larger voxels (Su and Ma, table 1 and figures 4 to 7)."""

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
    Stages,
    Step,
    Steps,
    Volume,
    finish,
    reconstruct_steps,
)
from ...core.mesh import SurfaceDistance
from ...reporting.parse import parsed_stride
from ..arguments import at_least, flags_checked
from ..commands.reconstruct import input_steps
from ..terminal import Progress, dimensions
from .common import bare_settings_from, distances_steps, facts_of, measuring_fact, require_builtin, variants_steps
from .plot import Panel, panel_of, write_plot
from .table import MAX_MM, MEAN_MM, TRIANGLES, VOLUME_ML, Column, Row, Table, figures, runs_text, unique

STAGES = {"Reading": 1, "Reconstructing": 2, "Timing": 6, "Measuring": 1}
# What happens to every pixel before voxels are made of them, whatever their sides: labels, smoothing, Otsu's threshold.
PREPARING = "Preparing values"
# A single short reconstruction says more of what else the machine is doing than of itself.
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


def table_of(args: argparse.Namespace, folder: Path) -> Table:
    """Return the table; its plot is written to `folder`."""
    settings = bare_settings_from(args)
    require_builtin(settings)
    with flags_checked():
        sides = [(x, y, settings.stride[2]) for x, y in unique(args.strides, first=(1, 1))]
        variants = [replace(settings, stride=stride) for stride in sides]
    stages = Stages(STAGES)
    with Progress() as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        results = progress.finish(stages.run("Reconstructing", variants_steps(volume, variants, Budget(args.threads))))
        timing = timed_runs_steps(volume, variants, args.repeats, Budget(args.threads))
        runs = progress.finish(stages.run("Timing", timing))
        meshes = [result.mesh for result in results]
        distances = progress.finish(stages.run("Measuring", distances_steps(meshes[1:], meshes[0])))
    rows = rows_of(results, runs, distances)
    write_plot(folder / "plot.png", panels(rows))
    result = results[0]
    timed = ", ".join(stage.name.lower() for stage in result.stages if stage.name != PREPARING)
    facts = [
        *facts_of(volume, variants[0], result.threshold, result.notes),
        ("seconds", f"{runs_text(args.repeats)}, after one that is not counted; a run repeats "),
        ("", f"the reconstruction until {RUN_SECONDS:g} s have passed and is the median of that"),
        ("timed", f"{timed}; neither reading nor writing"),
        ("preparing", "labels, smoothing and Otsu's threshold, pixel by pixel whatever the stride: beside it"),
        ("compared", "time, volume and surface with a stride of 1 x 1 pixel in x and y"),
        measuring_fact(),
    ]
    return Table("Larger voxels", facts, COLUMNS, rows, [("plot.png", "Time and error over the stride")])


def timed_runs_steps(
    volume: Volume, variants: Sequence[ReconstructionSettings], repeats: int, budget: Budget
) -> Steps[list[list[tuple[float, float]]]]:
    """Return what `timed_run` says of each of the settings, `repeats` times in turn."""
    runs: list[list[tuple[float, float]]] = [[] for _ in variants]
    for turn in range(repeats):
        for at, settings in enumerate(variants):
            done = (turn * len(variants) + at) / (repeats * len(variants))
            yield Step(done, f"Timing a stride of {dimensions(settings.stride[:2])}, run {turn + 1} of {repeats}")
            gc.collect()
            runs[at].append(timed_run(volume, settings, budget))
    return runs


def timed_run(volume: Volume, settings: ReconstructionSettings, budget: Budget | None = None) -> tuple[float, float]:
    """Seconds of preparing the values and of all stages after it, medians of what fits into `RUN_SECONDS`."""
    preparing: list[float] = []
    seconds: list[float] = []
    while sum(preparing) + sum(seconds) < RUN_SECONDS and len(seconds) < MOST_IN_A_RUN:
        stages = finish(reconstruct_steps(volume, settings, budget)).stages
        preparing.append(sum(stage.seconds for stage in stages if stage.name == PREPARING))
        seconds.append(sum(stage.seconds for stage in stages if stage.name != PREPARING))
    return statistics.median(preparing), statistics.median(seconds)


def rows_of(
    results: Sequence[Reconstruction],
    runs: Sequence[Sequence[tuple[float, float]]],
    distances: Sequence[SurfaceDistance],
) -> list[Row]:
    """Return what table.json says of every stride; distances are those of all but the first."""
    reference = results[0].mesh.enclosed_volume
    rows: list[Row] = []
    for result, pairs, distance in zip(results, runs, (None, *distances), strict=True):
        x, y, z = result.settings.stride
        preparing, seconds = ([run[at] for run in pairs] for at in (0, 1))
        median = statistics.median(seconds)
        volume = result.mesh.enclosed_volume
        rows.append(
            {
                "stride": x if x == y else f"{x}x{y}",
                "seconds": median,
                "improved_percent": 100.0 * (1.0 - median / (rows[0]["seconds"] if rows else median)),
                "voxels": result.voxels_visited,
                "faces": len(result.mesh.faces),
                "volume_mm3": volume,
                "volume_error_percent": None if volume is None or not reference else 100.0 * (volume / reference - 1.0),
                "mean_mm": distance.mean if distance else 0.0,
                "max_mm": distance.largest if distance else 0.0,
                "prepare_seconds": statistics.median(preparing),
                "runs": seconds,
                "sides_px": [x, y, z],
                "sides_mm": [side * gap for side, gap in zip((x, y, z), result.spacing_mm, strict=True)],
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
)


def panels(rows: Sequence[Row]) -> list[Panel]:
    """Time and error over the stride."""
    labels = [dimensions(row["sides_px"][:2]) for row in rows]
    across = "stride in x and y, px"
    return [
        panel_of("Reconstruction time, s", across, labels, rows, seconds="seconds"),
        panel_of("Distance to voxels of 1 x 1, mm", across, labels, rows, mean="mean_mm", maximum="max_mm"),
    ]
