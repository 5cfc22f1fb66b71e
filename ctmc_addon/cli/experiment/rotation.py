"""`ctmc experiment rotation`: how much faster a simplified surface turns (Su and Ma, table 2)."""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core import SettingsError, TriangleMesh, described, reconstruct_steps, within
from ..arguments import flag_of, given_settings
from ..blender_host import blender_at_work, load_scene, quiet
from ..terminal import Progress, by
from .common import add_common, facts_of, levels_of, prepared, require_builtin
from .plot import Panel, write_plot
from .table import Column, Row, Table, experiment_folder, number, once, plain

ENGINES = {"workbench": "BLENDER_WORKBENCH", "cycles": "CYCLES"}
TIMES = ("first", "second", "third", "fourth", "fifth")
DESCRIPTION = (
    "Turn a surface once around its z axis in several rounds, at several levels of simplification, and compare the "
    "time. INPUT may also be a mesh: .stl, .ply, .obj, .glb or .blend."
)


def add_parser(commands: Any) -> None:
    """Add the experiment to `ctmc experiment`."""
    parser = commands.add_parser("rotation", help="table 2: rotation", description=DESCRIPTION, allow_abbrev=False)
    add_common(parser)
    parser.add_argument(
        "--levels",
        nargs="+",
        type=float,
        default=[0.0, 50.0, 90.0],
        metavar="PERCENT",
        help="share of the triangles to remove, 0 to 99 (default 0 50 90)",
    )
    parser.add_argument("--rounds", type=int, default=5, metavar="N", help="turns of each level (default 5)")
    parser.add_argument(
        "--step",
        type=float,
        default=20.0,
        metavar="DEGREES",
        help="between frames (default 20); what it leaves of a turn is left out",
    )
    parser.add_argument(
        "--resolution", nargs=2, type=int, metavar=("W", "H"), help="px (default 640 480; with Cycles 160 120)"
    )
    parser.add_argument(
        "--engine", choices=tuple(ENGINES), help="default: Workbench where Blender can draw, else Cycles"
    )
    parser.set_defaults(run=run)


def run(chosen: argparse.Namespace) -> None:
    """Read, simplify, rotate, write the table and the plot, and print the table."""
    with experiment_folder(chosen.output, chosen.overwrite) as folder:
        done = table_of(chosen, folder)
        done.write(folder)
    print(done.printed())


def table_of(chosen: argparse.Namespace, folder: Path) -> Table:
    """The table; its plot is written to `folder`."""
    levels = levels_of(chosen.levels)
    require_turning(chosen)
    scene = load_scene()
    engine, why = engine_of(chosen.engine, scene)
    size = tuple(chosen.resolution) if chosen.resolution else scene.turntable.SIZES[engine]
    mesh, facts, progress = surface_of(chosen)
    with progress:
        simplified = progress.drive(within(scene.turntable.simplified_steps(mesh, once(levels, first=0)), 0.2, 0.4))
        steps = scene.turntable.rotation_test_steps(simplified, engine, chosen.rounds, chosen.step, size)
        turned = progress.drive(within(quiet(steps), 0.4, 1.0))
    frames = scene.turntable.frames_of(chosen.step)
    turn = turn_told(frames, chosen.step)
    name = "Workbench" if engine == ENGINES["workbench"] else "Cycles"
    rows = rows_of(turned, name, size, frames)
    facts += [
        ("engine", f"{name}, off screen, {by(size)} px{why}"),
        ("timed", f"{turn} about z: {frames} frames, {chosen.step:g} degrees apart, each a whole render: Blender"),
        ("", "evaluates the scene, hands the mesh to the engine, draws, and reads the picture"),
        ("not timed", "reading, simplifying, building, and a first frame of every level in every round"),
        ("rounds", f"{chosen.rounds}, the levels in turn; every level is a static mesh with no modifier and no key"),
    ]
    if rows[0]["draw_rounds"]:
        facts.append(("drawing", "the triangles alone, by GPUOffScreen: they are on the GPU before the clock starts"))
    write_plot(folder / "plot.png", panels(rows, turn))
    return Table("Rotation", facts, columns(chosen.rounds), rows, [("plot.png", f"Time of {turn} over the level")])


def turn_told(frames: int, step_degrees: float) -> str:
    """How far the frames turn the surface.

    Examples
    --------
    >>> turn_told(18, 20.0), turn_told(51, 7.0)
    ('one turn', '357 degrees')
    """
    degrees = frames * step_degrees
    return "one turn" if abs(degrees - 360.0) < 1e-6 else f"{degrees:g} degrees"


def require_turning(chosen: argparse.Namespace) -> None:
    """Raise `SettingsError` for rounds, steps or a resolution that nothing can be timed with."""
    if chosen.rounds < 1:
        raise SettingsError(f"rounds must be 1 or more, not {chosen.rounds}")
    if not 1 <= chosen.step <= 180:
        raise SettingsError(f"step must be from 1 to 180 degrees, not {chosen.step:g}")
    if chosen.resolution and not all(16 <= side <= 8192 for side in chosen.resolution):
        raise SettingsError(f"resolution must be from 16 to 8192 px a side, not {by(chosen.resolution)}")


def engine_of(asked: str | None, scene: Any) -> tuple[str, str]:
    """Blender's name of the engine, and why it is not the usual one."""
    if scene.can_draw():
        return ENGINES[asked or "workbench"], ""
    if asked == "workbench":
        raise SettingsError("Workbench needs EGL, which this machine lacks; install libegl1, or leave --engine out")
    return ENGINES["cycles"], ", as this machine has no EGL to draw with"


def surface_of(chosen: argparse.Namespace) -> tuple[TriangleMesh, list[tuple[str, str]], Progress]:
    """The surface that is to turn, what the table says of it, and the progress line so far."""
    path, scene = Path(chosen.input), load_scene()
    if path.suffix.lower() in scene.MESH_SUFFIXES:
        given = sorted(given_settings(chosen))
        if given:
            flag = flag_of(given[0], described()[given[0]])
            raise SettingsError(f"{path.name} is a mesh already; leave {flag} out")
        with blender_at_work():
            mesh = scene.read_mesh(path)
        return mesh, [("input", f"{path.name}, {len(mesh.faces)} triangles")], Progress()
    settings, volume, notes, progress = prepared(chosen, require_builtin)
    full = replace(settings, reduction=None, target_faces=None, max_error_mm=None)
    with progress:
        result = progress.drive(within(reconstruct_steps(volume, full, chosen.threads), 0.1, 0.2))
    return result.mesh, facts_of(volume, full, result.threshold, [*notes, *result.notes]), progress


def rows_of(turned: Sequence[Any], engine: str, size: Sequence[int], frames: int) -> list[Row]:
    """What table.json says of every level; `turned` are those of scene/turntable.py."""
    first = statistics.fmean(turned[0].rounds)
    drawn_first = statistics.fmean(turned[0].draw_rounds) if turned[0].draw_rounds else None
    rows = []
    for one in turned:
        average = statistics.fmean(one.rounds)
        drawn = statistics.fmean(one.draw_rounds) if one.draw_rounds else None
        rows.append(
            {
                "level_percent": plain(one.percent),
                "rounds": list(one.rounds),
                "average": average,
                "saved_percent": 100.0 * (1.0 - average / first),
                "faces": one.faces,
                "engine": engine,
                "draw_rounds": list(one.draw_rounds),
                "draw_average": drawn,
                "draw_saved_percent": None if drawn is None or not drawn_first else 100.0 * (1.0 - drawn / drawn_first),
                "resolution": list(size),
                "frames": frames,
            }
        )
    return rows


def columns(rounds: int) -> list[Column]:
    """The paper's table 2, triangles and drawing alone beside it."""

    def round_column(at: int) -> Column:
        title = f"{TIMES[at] if at < len(TIMES) else at + 1}, s"
        return Column(title, lambda row: number(row["rounds"][at], 4))

    return [
        Column("simplification", lambda row: f"{row['level_percent']:g} %" if row["level_percent"] else "none"),
        Column("triangles", lambda row: str(row["faces"])),
        *(round_column(at) for at in range(rounds)),
        Column("average, s", lambda row: number(row["average"], 4)),
        Column("saved, %", lambda row: number(row["saved_percent"], 1)),
        Column("drawing, s", lambda row: number(row["draw_average"], 4)),
        Column("saved, %", lambda row: number(row["draw_saved_percent"], 1)),
    ]


def panels(rows: Sequence[Row], turn: str) -> list[Panel]:
    """The time of a turn, as whole frames and as drawing alone."""
    labels = [f"{row['level_percent']:g} %" for row in rows]
    across = "share of the triangles removed"
    made = [
        Panel(f"{turn.capitalize()}, whole frames, s", across, labels, {"seconds": [row["average"] for row in rows]})
    ]
    if rows[0]["draw_average"] is not None:
        made.append(
            Panel(
                f"{turn.capitalize()}, drawing alone, s", across, labels, {"s": [row["draw_average"] for row in rows]}
            )
        )
    return made
