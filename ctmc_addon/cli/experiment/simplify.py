# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc experiment simplify`: compare the built-in simplifier with Blender's Decimate at equal triangle counts."""

from __future__ import annotations

import argparse
import gc
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...core import SIMPLIFICATION, Step, Steps, TriangleMesh, simplify
from ..flags.arguments import at_least
from ..machine.blender_host import blender_at_work, require_blender
from .common import (
    MEASURING,
    Work,
    add_levels,
    distance_cells,
    distances_steps,
    facts_of,
    measured,
    settings_of,
    way_cells,
)
from .plot import Plot, series
from .table import LEVEL, MAX_MM, MEAN_MM, TRIANGLES, WAYS, Column, ExperimentTable, figures, runs_text, unique

STAGES = {"Reading": 1, "Reconstructing": 1, "Simplifying": 6, "Measuring": 2}
BUILTIN, DECIMATE = "built-in", "Decimate"
HELP = "compare the built-in simplifier with Decimate"
DESCRIPTION = (
    "Simplify one surface by the built-in quadric error simplifier and by Blender's Decimate, to the same number of "
    "triangles, and compare time and distance."
)


@dataclass
class _SimplifiedLevel:
    """The surface of one simplifier at one level, and the seconds of each run."""

    percent: float
    simplifier: str
    mesh: TriangleMesh
    runs: list[float] = field(default_factory=list)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags for the levels and the number of repetitions."""
    add_levels(parser, (50, 90))
    parser.add_argument("--repeats", type=at_least(1), default=3, metavar="N", help="timed runs of each (default 3)")


def table_of(args: argparse.Namespace, work: Work, _folder: Path) -> ExperimentTable:
    """Return the table."""
    full = settings_of(args).without(SIMPLIFICATION)
    require_blender("a comparison with Decimate")
    volume = work.read(full)
    result = work.reconstruct(volume, full)
    levels = work.run("Simplifying", simplify_levels_steps(result.mesh, unique(args.levels), args.repeats))
    distances = work.run("Measuring", distances_steps([level.mesh for level in levels], result.mesh))
    rows = [
        {
            "level_percent": level.percent,
            "simplifier": level.simplifier,
            **measured(level.mesh, "faces"),
            "seconds": statistics.median(level.runs),
            **distance_cells(distance),
            **measured(level.mesh, "closed", "volume_mm3"),
            "runs": level.runs,
            **way_cells(distance),
        }
        for level, distance in zip(levels, distances, strict=True)
    ]
    facts = [
        *facts_of(volume, full, result.threshold, result.notes),
        ("surface", f"{len(result.mesh.faces)} triangles, {'closed' if result.mesh.closed else 'open'}"),
        ("seconds", runs_text(args.repeats)),
        ("timed", "built-in: arrays to arrays; Decimate: the modifier, from a mesh in Blender to its evaluated mesh"),
        ("compared", "with the surface before simplification"),
        MEASURING,
    ]
    by_name = {name: [row for row in rows if row["simplifier"] == name] for name in (BUILTIN, DECIMATE)}
    titles = {"Time, s": "seconds", "Mean distance, mm": "mean_mm", "Maximum distance, mm": "max_mm"}
    charts = {
        title: {name: series(part, values=key)["values"] for name, part in by_name.items()}
        for title, key in titles.items()
    }
    labels = [LEVEL.show(row) for row in by_name[BUILTIN]]
    plot = Plot("Time and error over the level", "share of the triangles removed", labels, charts)
    return ExperimentTable("Simplification", facts, COLUMNS, rows, plot)


def simplify_levels_steps(mesh: TriangleMesh, levels: Sequence[float], repeats: int) -> Steps[list[_SimplifiedLevel]]:
    """Simplify `mesh` to every level both ways, `repeats` times in turn."""
    from ...blender.surface import decimated

    pairs = [(_SimplifiedLevel(level, BUILTIN, mesh), _SimplifiedLevel(level, DECIMATE, mesh)) for level in levels]
    for turn in range(repeats):
        for at, (builtin, decimate) in enumerate(pairs):
            run = f"{builtin.percent:g} %, run {turn + 1} of {repeats}"
            done = turn * len(pairs) + at
            yield Step(done / (repeats * len(pairs)), f"Simplifying by {run}")
            gc.collect()
            start = time.perf_counter()
            builtin.mesh = simplify(mesh, reduction=builtin.percent / 100)
            builtin.runs.append(time.perf_counter() - start)
            yield Step((done + 0.5) / (repeats * len(pairs)), f"Decimating by {run}")
            gc.collect()
            with blender_at_work():
                decimate.mesh, seconds = decimated(mesh, len(builtin.mesh.faces))
            decimate.runs.append(seconds)
    return [level for pair in pairs for level in pair]


COLUMNS = (
    LEVEL,
    Column("simplifier", lambda row: str(row["simplifier"])),
    TRIANGLES,
    figures("seconds", "seconds", 3),
    MEAN_MM,
    MAX_MM,
    Column("closed", lambda row: "yes" if row["closed"] else "no"),
    *WAYS,
)
