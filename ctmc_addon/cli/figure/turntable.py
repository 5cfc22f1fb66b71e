"""`ctmc figure turntable`: a surface turning about its vertical axis, as a film or as pictures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...core import within
from ..blender_host import load_scene, quiet
from ..commands.reconstruct import Work
from ..terminal import Progress, by
from . import common

DESCRIPTION = (
    "Turn a surface, or several labels, once or more about the vertical axis, in a loop without a seam: as a film by "
    "the suffix of OUTPUT (.mp4, .mkv, .mov, .webm, .avi, .ogv), else as PNG frames in a folder of that name."
)


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "figure turntable", help="the surface turning, as a film", description=DESCRIPTION, allow_abbrev=False
    )
    common.add_common(parser, "a film, such as FILE.mp4, or a folder for PNG frames", width_mm=120.0, dpi=150.0)
    common.add_surfaces(parser)
    group = parser.add_argument_group("turntable")
    group.add_argument("--seconds", type=float, default=6.0, metavar="S", help="of the loop (default 6)")
    group.add_argument("--fps", type=int, default=24, metavar="N", help="frames a second (default 24)")
    group.add_argument(
        "--revolutions", type=int, default=1, metavar="N", help="whole turns in the loop; -1 the other way (default 1)"
    )
    again = group.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="go on where this turntable was stopped")
    again.add_argument("--overwrite", action="store_true", help="replace an older turntable")
    common.add_blend(parser)
    parser.set_defaults(run=common.in_made_folders(run), font_pt=12.0)


def run(chosen: argparse.Namespace) -> None:
    """Read, reconstruct, render every frame, write the film, and say what came out."""
    every = common.settings_of(chosen)
    common.require_names(chosen, len(every))
    scene = load_scene()
    turn = scene.Turn(chosen.seconds, chosen.fps, chosen.revolutions)
    page, look = common.page_of(chosen), common.look_of(chosen, len(every) > 1, "")
    scene.require_engine(chosen.engine)
    target = Path(chosen.output)
    scene.require_turntable(target, page, chosen.resume, chosen.overwrite)
    if chosen.resume and scene.finished_film(target):
        print(f"{target.name} is there already and was left as it is; --overwrite makes it anew")
        return
    film = scene.is_film(target)
    blend = common.blend_of(chosen, target if film else target.with_name(target.name + ".blend"))
    work = Work()
    with Progress(lines=True) as progress:
        volume = common.volume_of(chosen, every[0], work, progress)
        results = progress.drive(within(common.surfaces_steps(volume, every, chosen.threads), 0.1, 0.2))
        with common.objects_of(results) as (home, things, shown):
            cell = scene.Cell(tuple(common.shown_of(chosen, things, shown)))
            steps = scene.turntable_steps(cell, target, page, look, turn, blend, home, chosen.resume, chosen.overwrite)
            size, rendered = progress.drive(within(quiet(steps), 0.2, 1.0))
    facts = [
        ("loop", f"{turn.seconds:g} s, {turn.frames} frames, {turn.fps} a second, {by(size)} pixels"),
        ("rendered", f"{rendered} frames now" if rendered < turn.frames else "all frames"),
    ]
    print(common.told(facts, [*work.notes, *results[0].notes], [target, blend]))
