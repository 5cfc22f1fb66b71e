"""`ctmc experiment simplify`: the built-in simplifier beside Blender's Decimate at the same number of triangles."""

from __future__ import annotations

import argparse
import gc
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ...core import SettingsError, Step, Steps, TriangleMesh, reconstruct_steps, simplify, within
from ...core.mesh import ReferenceSurface, surface_distance_steps
from ..blender_host import blender_at_work, load_scene
from .common import add_common, facts_of, levels_of, measuring_fact, prepared, require_builtin
from .plot import Panel, write_plot
from .table import Column, Row, Table, experiment_folder, number, runs_told

BUILTIN, DECIMATE = "built-in", "Decimate"
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
    mean_mm: float = 0.0
    max_mm: float = 0.0


def add_parser(commands: Any) -> None:
    """Add the experiment to `ctmc experiment`."""
    parser = commands.add_parser(
        "simplify", help="the built-in simplifier and Decimate", description=DESCRIPTION, allow_abbrev=False
    )
    add_common(parser)
    parser.add_argument(
        "--levels",
        nargs="+",
        type=float,
        default=[50.0, 90.0],
        metavar="PERCENT",
        help="share of the triangles to remove, 0 to 99 (default 50 90)",
    )
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="timed runs of each (default 3)")
    parser.set_defaults(run=run)


def run(chosen: argparse.Namespace) -> None:
    """Read, simplify, measure, write the table and the plot, and print the table."""
    with experiment_folder(chosen.output, chosen.overwrite) as folder:
        done = table_of(chosen, folder)
        done.write(folder)
    print(done.printed())


def table_of(chosen: argparse.Namespace, folder: Path) -> Table:
    """The table; its plot is written to `folder`."""
    levels = levels_of(chosen.levels)
    if chosen.repeats < 1:
        raise SettingsError(f"repeats must be 1 or more, not {chosen.repeats}")
    settings, volume, notes, progress = prepared(chosen, require_builtin)
    full = replace(settings, reduction=None, target_faces=None, max_error_mm=None)
    with progress:
        result = progress.drive(within(reconstruct_steps(volume, full, chosen.threads), 0.1, 0.2))
        measured = progress.drive(within(simplify_levels_steps(result.mesh, levels, chosen.repeats), 0.2, 1.0))
    rows = rows_of(measured)
    write_plot(folder / "plot.png", panels(rows))
    facts = [
        *facts_of(volume, full, result.threshold, [*notes, *result.notes]),
        ("surface", f"{len(result.mesh.faces)} triangles, {'closed' if result.mesh.closed else 'open'}"),
        ("seconds", runs_told(chosen.repeats)),
        ("timed", "built-in: arrays to arrays; Decimate: the modifier, from a mesh in Blender to its evaluated mesh"),
        ("compared", "with the surface before simplification"),
        measuring_fact(),
    ]
    return Table("Simplification", facts, COLUMNS, rows, [("plot.png", "Time and error over the level")])


def simplify_levels_steps(mesh: TriangleMesh, levels: Sequence[float], repeats: int) -> Steps[list[Measured]]:
    """Simplify `mesh` to every level both ways, `repeats` times in turn, and measure against it."""
    share = 1.0 / (len(levels) * 2 * (repeats + 1))
    done = 0.0
    pairs = [(Measured(percent, BUILTIN, mesh), Measured(percent, DECIMATE, mesh)) for percent in levels]
    measured = [one for pair in pairs for one in pair]
    for turn in range(repeats):
        for ours, theirs in pairs:
            yield Step(done, f"Simplifying by {ours.percent:g} %, run {turn + 1} of {repeats}")
            run_builtin(mesh, ours)
            yield Step(done + share, f"Decimating by {ours.percent:g} %, run {turn + 1} of {repeats}")
            run_decimate(mesh, theirs, len(ours.mesh.faces))
            done += 2 * share
    reference = ReferenceSurface(mesh)
    for one in measured:
        apart = yield from within(surface_distance_steps(one.mesh, reference), done, done + share)
        one.mean_mm, one.max_mm = apart.mean, apart.largest
        done += share
    return measured


def run_builtin(mesh: TriangleMesh, one: Measured) -> None:
    """One run of the built-in simplifier."""
    gc.collect()
    start = time.perf_counter()
    one.mesh = simplify(mesh, reduction=one.percent / 100)
    one.runs.append(time.perf_counter() - start)


def run_decimate(mesh: TriangleMesh, one: Measured, target_faces: int) -> None:
    """One run of Blender's Decimate."""
    gc.collect()
    with blender_at_work():
        one.mesh, seconds = load_scene().decimated(mesh, target_faces)
    one.runs.append(seconds)


def rows_of(measured: Sequence[Measured]) -> list[Row]:
    """What table.json says of every simplifier at every level."""
    return [
        {
            "level_percent": one.percent,
            "simplifier": one.simplifier,
            "faces": len(one.mesh.faces),
            "seconds": statistics.median(one.runs),
            "mean_mm": one.mean_mm,
            "max_mm": one.max_mm,
            "closed": one.mesh.closed,
            "volume_mm3": one.mesh.enclosed_volume,
            "runs": one.runs,
        }
        for one in measured
    ]


COLUMNS = (
    Column("level", lambda row: f"{row['level_percent']:g} %"),
    Column("simplifier", lambda row: str(row["simplifier"])),
    Column("triangles", lambda row: str(row["faces"])),
    Column("seconds", lambda row: number(row["seconds"], 3)),
    Column("mean, mm", lambda row: number(row["mean_mm"], 4)),
    Column("max, mm", lambda row: number(row["max_mm"], 3)),
    Column("closed", lambda row: "yes" if row["closed"] else "no"),
)


def panels(rows: Sequence[Row]) -> list[Panel]:
    """Time and error of both simplifiers over the level."""
    labels = [f"{row['level_percent']:g} %" for row in rows if row["simplifier"] == BUILTIN]

    def both(key: str) -> dict[str, list[float | None]]:
        return {name: [row[key] for row in rows if row["simplifier"] == name] for name in (BUILTIN, DECIMATE)}

    across = "share of the triangles removed"
    return [
        Panel("Time, s", across, labels, both("seconds")),
        Panel("Mean distance, mm", across, labels, both("mean_mm")),
        Panel("Maximum distance, mm", across, labels, both("max_mm")),
    ]
