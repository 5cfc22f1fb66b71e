# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc experiment simplify`: the built-in simplifier beside Blender's Decimate at the same number of triangles."""

from __future__ import annotations

import argparse
import gc
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...core import SIMPLIFICATION, Budget, Stages, Step, Steps, TriangleMesh, reconstruct_steps, simplify
from ...core.mesh import SurfaceDistance
from ..arguments import at_least
from ..blender_host import blender_at_work, require_blender
from ..commands.reconstruct import input_steps
from ..terminal import Progress
from .common import add_levels, bare_settings_from, distances_steps, facts_of, measuring_fact, require_builtin
from .plot import Panel, write_plot
from .table import LEVEL, MAX_MM, MEAN_MM, TRIANGLES, Column, Row, Table, figures, runs_text, unique

STAGES = {"Reading": 1, "Reconstructing": 1, "Simplifying": 6, "Measuring": 2}
BUILTIN, DECIMATE = "built-in", "Decimate"
HELP = "the built-in simplifier and Decimate"
DESCRIPTION = (
    "Simplify one surface by the built-in quadric error simplifier and by Blender's Decimate, to the same number of "
    "triangles, and compare time and distance."
)


@dataclass
class Measured:
    """One simplifier at one level."""

    percent: float
    simplifier: str
    mesh: TriangleMesh
    runs: list[float] = field(default_factory=list)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags for the levels and the number of repetitions."""
    add_levels(parser, (50, 90))
    parser.add_argument("--repeats", type=at_least(1), default=3, metavar="N", help="timed runs of each (default 3)")


def table_of(args: argparse.Namespace, folder: Path) -> Table:
    """Return the table; its plot is written to `folder`."""
    settings = bare_settings_from(args)
    require_builtin(settings)
    require_blender("a comparison with Decimate")
    full = settings.without(SIMPLIFICATION)
    stages = Stages(STAGES)
    with Progress() as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        result = progress.finish(stages.run("Reconstructing", reconstruct_steps(volume, full, Budget(args.threads))))
        simplifying = simplify_levels_steps(result.mesh, unique(args.levels), args.repeats)
        measured = progress.finish(stages.run("Simplifying", simplifying))
        steps = distances_steps([item.mesh for item in measured], result.mesh)
        rows = rows_of(measured, progress.finish(stages.run("Measuring", steps)))
    write_plot(folder / "plot.png", panels(rows))
    facts = [
        *facts_of(volume, full, result.threshold, result.notes),
        ("surface", f"{len(result.mesh.faces)} triangles, {'closed' if result.mesh.closed else 'open'}"),
        ("seconds", runs_text(args.repeats)),
        ("timed", "built-in: arrays to arrays; Decimate: the modifier, from a mesh in Blender to its evaluated mesh"),
        ("compared", "with the surface before simplification"),
        measuring_fact(),
    ]
    return Table("Simplification", facts, COLUMNS, rows, [("plot.png", "Time and error over the level")])


def simplify_levels_steps(mesh: TriangleMesh, levels: Sequence[float], repeats: int) -> Steps[list[Measured]]:
    """Simplify `mesh` to every level both ways, `repeats` times in turn."""
    pairs = [(Measured(percent, BUILTIN, mesh), Measured(percent, DECIMATE, mesh)) for percent in levels]
    for turn in range(repeats):
        for at, (builtin, decimate) in enumerate(pairs):
            run = f"{builtin.percent:g} %, run {turn + 1} of {repeats}"
            done = turn * len(pairs) + at
            yield Step(done / (repeats * len(pairs)), f"Simplifying by {run}")
            run_builtin(mesh, builtin)
            yield Step((done + 0.5) / (repeats * len(pairs)), f"Decimating by {run}")
            run_decimate(mesh, decimate, len(builtin.mesh.faces))
    return [item for pair in pairs for item in pair]


def run_builtin(mesh: TriangleMesh, item: Measured) -> None:
    """One run of the built-in simplifier."""
    gc.collect()
    start = time.perf_counter()
    item.mesh = simplify(mesh, reduction=item.percent / 100)
    item.runs.append(time.perf_counter() - start)


def run_decimate(mesh: TriangleMesh, item: Measured, target_faces: int) -> None:
    """Run Blender's Decimate once."""
    gc.collect()
    from ...blender.surface import decimated

    with blender_at_work():
        item.mesh, seconds = decimated(mesh, target_faces)
    item.runs.append(seconds)


def rows_of(measured: Sequence[Measured], distances: Sequence[SurfaceDistance]) -> list[Row]:
    """Return what table.json says of every simplifier at every level."""
    return [
        {
            "level_percent": item.percent,
            "simplifier": item.simplifier,
            "faces": len(item.mesh.faces),
            "seconds": statistics.median(item.runs),
            "mean_mm": distance.mean,
            "max_mm": distance.largest,
            "closed": item.mesh.closed,
            "volume_mm3": item.mesh.enclosed_volume,
            "runs": item.runs,
        }
        for item, distance in zip(measured, distances, strict=True)
    ]


COLUMNS = (
    LEVEL,
    Column("simplifier", lambda row: str(row["simplifier"])),
    TRIANGLES,
    figures("seconds", "seconds", 3),
    MEAN_MM,
    MAX_MM,
    Column("closed", lambda row: "yes" if row["closed"] else "no"),
)


def panels(rows: Sequence[Row]) -> list[Panel]:
    """Time and error of both simplifiers over the level."""
    by_name = {name: [row for row in rows if row["simplifier"] == name] for name in (BUILTIN, DECIMATE)}
    labels = [f"{row['level_percent']:g} %" for row in by_name[BUILTIN]]
    titles = {"Time, s": "seconds", "Mean distance, mm": "mean_mm", "Maximum distance, mm": "max_mm"}
    return [
        Panel(
            title,
            "share of the triangles removed",
            labels,
            {name: [row[key] for row in part] for name, part in by_name.items()},
        )
        for title, key in titles.items()
    ]
