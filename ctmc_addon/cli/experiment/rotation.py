# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc experiment rotation`: measure how much faster a simplified surface turns (Su and Ma, table 2)."""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...blender.figure.spec import ENGINES
from ...core import SETTINGS, SIMPLIFICATION, CtmcError, TriangleMesh
from ..flags.arguments import UsageError, at_least, flag_of, given_settings
from ..machine.blender_host import blender_at_work, quiet_steps, require_blender
from ..terminal import dimensions
from .common import Work, add_levels, facts_of, settings_of
from .plot import Plot, series
from .table import LEVEL, TRIANGLES, Column, ExperimentTable, Row, figures, plain, unique

STAGES = {"Reading": 1, "Reconstructing": 1, "Simplifying": 2, "Rotating": 6}
TIMED_ENGINES = ("workbench", "cycles")
TIMES = ("first", "second", "third", "fourth", "fifth")
HELP = "table 2: rotation"
DESCRIPTION = (
    "Turn a surface once around its z axis in several rounds, at several levels of simplification, and compare the "
    "time. INPUT may also be a mesh: .stl, .ply, .obj, .glb or .blend."
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags for the levels and for how they turn."""
    add_levels(parser, (0, 50, 90))
    parser.add_argument("--rounds", type=at_least(1), default=5, metavar="N", help="turns of each level (default 5)")
    parser.add_argument(
        "--step",
        type=float,
        default=20.0,
        metavar="DEGREES",
        help="angle between frames (default 20); a remainder of the turn is left out",
    )
    parser.add_argument(
        "--resolution",
        nargs=2,
        type=int,
        metavar=("W", "H"),
        help="picture size, px (default 640 480; with Cycles 160 120)",
    )
    parser.add_argument(
        "--engine", choices=TIMED_ENGINES, help="render engine (default: Workbench where Blender can draw, else Cycles)"
    )


def table_of(args: argparse.Namespace, work: Work, _folder: Path) -> ExperimentTable:
    """Return the table."""
    _require_turning(args)
    require_blender("the rotation experiment")
    from ...blender import rotation as timing

    engine, reason = engine_of(args.engine)
    size = tuple(args.resolution) if args.resolution else timing.SIZES[engine]
    mesh, facts = _surface_of(args, work)
    simplified = work.run("Simplifying", timing.simplified_steps(mesh, unique(args.levels, first=0)))
    test = timing.rotation_test_steps(simplified, engine, args.rounds, args.step, size)
    frames = timing.frames_of(args.step)
    turn = _turn_text(frames, args.step)
    name = next(kind.label for kind in ENGINES.values() if kind.identifier == engine)
    rows = _rows_of(work.run("Rotating", quiet_steps(test)), name, size, frames)
    facts += [
        ("engine", f"{name}, off screen, {dimensions(size)} px{reason}"),
        ("timed", f"{turn} about z: {frames} frames, {args.step:g} degrees apart, each a whole render: Blender"),
        ("", "evaluates the scene, hands the mesh to the engine, draws, and reads the picture"),
        ("not timed", "reading, simplifying, building, and a first frame of every level in every round"),
        ("rounds", f"{args.rounds}, the levels in turn; every level is a static mesh with no modifier and no key"),
    ]
    charts = {f"{turn.capitalize()}, whole frames, s": series(rows, seconds="average")}
    if rows[0]["draw_rounds"]:
        facts.append(("drawing", "the triangles alone, by GPUOffScreen: they are on the GPU before the clock starts"))
        charts[f"{turn.capitalize()}, drawing alone, s"] = series(rows, seconds="draw_average")
    labels = [LEVEL.show(row) for row in rows]
    plot = Plot(f"Time of {turn} over the level", "share of the triangles removed", labels, charts)
    return ExperimentTable("Rotation", facts, _columns(args.rounds), rows, plot)


def _turn_text(frames: int, step_degrees: float) -> str:
    """Return the angle of the turn as text.

    Examples
    --------
    >>> _turn_text(18, 20.0), _turn_text(51, 7.0)
    ('one turn', '357 degrees')
    """
    degrees = frames * step_degrees
    return "one turn" if abs(degrees - 360.0) < 1e-6 else f"{degrees:g} degrees"


def _require_turning(args: argparse.Namespace) -> None:
    """Raise `UsageError` for steps or a resolution that nothing can be timed with."""
    if not 1 <= args.step <= 180:
        raise UsageError(f"step must be from 1 to 180 degrees, not {args.step:g}")
    if args.resolution and not all(16 <= side <= 8192 for side in args.resolution):
        raise UsageError(f"resolution must be from 16 to 8192 px a side, not {dimensions(args.resolution)}")


def engine_of(name: str | None) -> tuple[str, str]:
    """Return Blender's name of the engine, and the reason if it is not the usual one."""
    from ...blender.rotation import can_draw

    if can_draw():
        return ENGINES[name or "workbench"].identifier, ""
    if name == "workbench":
        raise CtmcError("Workbench needs EGL, which this machine lacks; install libegl1, or leave --engine out")
    return ENGINES["cycles"].identifier, ", as this machine has no EGL to draw with"


def _surface_of(args: argparse.Namespace, work: Work) -> tuple[TriangleMesh, list[tuple[str, str]]]:
    """Return the surface to turn, and the facts about it."""
    from ...blender.import_mesh import MESH_SUFFIXES, read_mesh

    path = Path(args.input)
    if path.suffix.lower() in MESH_SUFFIXES:
        given = sorted(given_settings(args))
        if given:
            flags = " and ".join(flag_of(name, SETTINGS[name]) for name in given)
            raise UsageError(f"{path.name} is a mesh already; leave {flags} out")
        with blender_at_work():
            mesh = read_mesh(path)
        return mesh, [("input", f"{path.name}, {len(mesh.faces)} triangles")]
    full = settings_of(args).without(SIMPLIFICATION)
    volume = work.read(full)
    result = work.reconstruct(volume, full)
    return result.mesh, facts_of(volume, full, result.threshold, result.notes)


def _rows_of(levels: Sequence[Any], engine: str, size: Sequence[int], frames: int) -> list[Row]:
    """Return the rows of every level; `levels` are the `LevelTimes` of blender/rotation."""
    rows: list[Row] = []
    for level in levels:
        average = statistics.fmean(level.rounds)
        drawn = statistics.fmean(level.draw_rounds) if level.draw_rounds else None
        first: Row = rows[0] if rows else {"average": average, "draw_average": drawn}
        rows.append(
            {
                "level_percent": plain(level.percent),
                "rounds": list(level.rounds),
                "average": average,
                "saved_percent": 100.0 * (1.0 - average / first["average"]),
                "faces": level.faces,
                "engine": engine,
                "draw_rounds": list(level.draw_rounds),
                "draw_average": drawn,
                "draw_saved_percent": 100.0 * (1.0 - drawn / first["draw_average"]) if drawn else None,
                "resolution": list(size),
                "frames": frames,
            }
        )
    return rows


def _columns(rounds: int) -> list[Column]:
    """Return the columns of the paper's table 2, with triangles and drawing time."""

    def round_column(at: int) -> Column:
        return Column(f"{TIMES[at] if at < len(TIMES) else at + 1}, s", lambda row: f"{row['rounds'][at]:.4f}")

    return [
        Column("simplification", lambda row: f"{row['level_percent']:g} %" if row["level_percent"] else "none"),
        TRIANGLES,
        *(round_column(at) for at in range(rounds)),
        figures("average, s", "average", 4),
        figures("saved, %", "saved_percent", 1),
        figures("drawing, s", "draw_average", 4),
        figures("saved, %", "draw_saved_percent", 1),
    ]
