"""`ctmc experiment voxels`: time and error of larger voxels (Su and Ma, table 1 and figures 4 to 7)."""

from __future__ import annotations

import argparse
import gc
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ...core import (
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Stages,
    Step,
    Steps,
    Volume,
    equal_part,
    finish,
    reconstruct_steps,
)
from ...core.mesh import ReferenceSurface, surface_distance_steps
from ...reporting.parse import parsed_stride
from ..arguments import at_least, flags_checked, settings_from
from ..terminal import Progress, dimensions
from .common import facts_of, input_steps, measuring_fact, require_builtin
from .plot import Panel, write_plot
from .table import Column, Row, Table, number, runs_text, unique

STAGES = {"Reading": 1, "Reconstructing": 2, "Timing": 6, "Measuring": 1}
Sides = tuple[int, int, int]
# What happens to every pixel before voxels are made of them, whatever their sides: labels, softening, Otsu's threshold.
PREPARING = "Preparing values"
# A single short reconstruction says more of what else the machine is doing than of itself.
RUN_SECONDS, MOST_IN_A_RUN = 0.1, 20
HELP = "table 1: larger voxels"
DESCRIPTION = (
    "Reconstruct with several voxel sides, in turn, and compare time, triangles and surface with voxels of one pixel."
)


@dataclass
class Measured:
    """One voxel side: its surface, and the seconds of every run, and of the preparation before it."""

    sides: Sides
    result: Reconstruction
    runs: list[float] = field(default_factory=list)
    preparing: list[float] = field(default_factory=list)
    mean_mm: float = 0.0
    max_mm: float = 0.0


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Which voxel sides, and how often."""
    parser.add_argument(
        "--strides",
        nargs="+",
        type=sides_of,
        default=[(1, 1), (2, 2), (3, 3)],
        metavar="N",
        help="voxel sides in x and y, px: 2, or 2x1 for x and y apart; z is that of --stride (default 1 2 3)",
    )
    parser.add_argument("--repeats", type=at_least(1), default=5, metavar="N", help="timed runs of each (default 5)")


def sides_of(word: str) -> tuple[int, int]:
    """Sides in x and y.

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
    """The table; its plot is written to `folder`."""
    settings = settings_from(args)
    require_builtin(settings)
    with flags_checked():
        sides = [(x, y, settings.stride[2]) for x, y in unique(args.strides, first=(1, 1))]
        variants = [replace(settings, stride=stride) for stride in sides]
    stages = Stages(STAGES)
    with Progress() as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        measured = progress.finish(stages.run("Reconstructing", surfaces_steps(volume, variants, args.threads)))
        progress.finish(stages.run("Timing", timed_runs_steps(volume, measured, args.repeats, args.threads)))
        progress.finish(stages.run("Measuring", distances_steps(measured)))
    rows = rows_of(measured, volume)
    write_plot(folder / "plot.png", panels(rows))
    result = measured[0].result
    timed = ", ".join(stage.name.lower() for stage in result.stages if stage.name != PREPARING)
    facts = [
        *facts_of(volume, variants[0], result.threshold, result.notes),
        ("seconds", f"{runs_text(args.repeats)}, after one that is not counted; a run repeats "),
        ("", f"the reconstruction until {RUN_SECONDS:g} s have passed and is the median of that"),
        ("timed", f"{timed}; neither reading nor writing"),
        ("preparing", "labels, softening and Otsu's threshold, pixel by pixel whatever the voxel sides: beside it"),
        ("compared", "time, volume and surface with voxel sides of 1 x 1 pixel in x and y"),
        measuring_fact(),
    ]
    return Table("Larger voxels", facts, COLUMNS, rows, [("plot.png", "Time and error over the voxel side")])


def surfaces_steps(
    volume: Volume, variants: Sequence[ReconstructionSettings], threads: int | None
) -> Steps[list[Measured]]:
    """Reconstruct with each of the settings; these runs are not timed."""
    measured = []
    for at, settings in enumerate(variants):
        result = yield from equal_part(reconstruct_steps(volume, settings, threads), at, len(variants))
        measured.append(Measured(settings.stride, result))
    return measured


def timed_runs_steps(volume: Volume, measured: Sequence[Measured], repeats: int, threads: int | None) -> Steps[None]:
    """Time the reconstruction with each of the settings, `repeats` times in turn."""
    for turn in range(repeats):
        for at, item in enumerate(measured):
            done = (turn * len(measured) + at) / (repeats * len(measured))
            yield Step(done, f"Timing voxel sides {dimensions(item.sides[:2])}, run {turn + 1} of {repeats}")
            gc.collect()
            preparing, seconds = timed_run(volume, item.result.settings, threads)
            item.preparing.append(preparing)
            item.runs.append(seconds)


def distances_steps(measured: Sequence[Measured]) -> Steps[None]:
    """Measure every surface against the first."""
    reference = ReferenceSurface(measured[0].result.mesh)
    for at, item in enumerate(measured[1:]):
        distance = yield from equal_part(surface_distance_steps(item.result.mesh, reference), at, len(measured) - 1)
        item.mean_mm, item.max_mm = distance.mean, distance.largest


def timed_run(volume: Volume, settings: ReconstructionSettings, threads: int | None = None) -> tuple[float, float]:
    """Seconds of preparing the values and of all stages after it, medians of what fits into `RUN_SECONDS`."""
    preparing: list[float] = []
    seconds: list[float] = []
    while sum(preparing) + sum(seconds) < RUN_SECONDS and len(seconds) < MOST_IN_A_RUN:
        stages = finish(reconstruct_steps(volume, settings, threads)).stages
        preparing.append(sum(stage.seconds for stage in stages if stage.name == PREPARING))
        seconds.append(sum(stage.seconds for stage in stages if stage.name != PREPARING))
    return statistics.median(preparing), statistics.median(seconds)


def rows_of(measured: Sequence[Measured], volume: Volume) -> list[Row]:
    """What table.json says of every voxel side."""
    first = statistics.median(measured[0].runs)
    true = measured[0].result.mesh.enclosed_volume
    rows = []
    for item in measured:
        x, y, z = item.sides
        seconds = statistics.median(item.runs)
        volume_mm3 = item.result.mesh.enclosed_volume
        rows.append(
            {
                "stride": x if x == y else f"{x}x{y}",
                "seconds": seconds,
                "improved_percent": 100.0 * (1.0 - seconds / first),
                "voxels": item.result.voxels_visited,
                "faces": len(item.result.mesh.faces),
                "volume_mm3": volume_mm3,
                "volume_error_percent": (None if volume_mm3 is None or not true else 100.0 * (volume_mm3 / true - 1.0)),
                "mean_mm": item.mean_mm,
                "max_mm": item.max_mm,
                "prepare_seconds": statistics.median(item.preparing),
                "runs": item.runs,
                "sides_px": [x, y, z],
                "sides_mm": [side * gap for side, gap in zip(item.sides, volume.spacing, strict=True)],
            }
        )
    return rows


def sides_px(row: Row) -> str:
    """'2 x 2 px'."""
    return f"{dimensions(row['sides_px'][:2])} px"


COLUMNS = (
    Column("voxel sides", sides_px),
    Column("mm", lambda row: dimensions([round(side, 2) for side in row["sides_mm"][:2]])),
    Column("seconds", lambda row: number(row["seconds"], 4)),
    Column("improved, %", lambda row: number(row["improved_percent"], 1)),
    Column("preparing, s", lambda row: number(row["prepare_seconds"], 4)),
    Column("voxels", lambda row: str(row["voxels"])),
    Column("triangles", lambda row: str(row["faces"])),
    Column("volume, ml", lambda row: number(None if row["volume_mm3"] is None else row["volume_mm3"] / 1000, 3)),
    Column("volume error, %", lambda row: number(row["volume_error_percent"], 2)),
    Column("mean, mm", lambda row: number(row["mean_mm"], 4)),
    Column("max, mm", lambda row: number(row["max_mm"], 3)),
)


def panels(rows: Sequence[Row]) -> list[Panel]:
    """Time and error over the voxel side."""
    labels = [dimensions(row["sides_px"][:2]) for row in rows]
    across = "voxel sides in x and y, px"
    distances = {"mean": [row["mean_mm"] for row in rows], "maximum": [row["max_mm"] for row in rows]}
    return [
        Panel("Reconstruction time, s", across, labels, {"seconds": [row["seconds"] for row in rows]}),
        Panel("Distance to voxels of 1 x 1, mm", across, labels, distances),
    ]
