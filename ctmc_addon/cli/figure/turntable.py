# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc figure turntable`: turn a surface about its vertical axis, as a video or as pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...blender.figure.spec import Cell, Turn
from ...core import Budget, Stages
from ..commands.reconstruct import input_steps
from ..flags.arguments import flags_checked
from ..flags.described import add_described
from ..flags.solid import add_solid, settings_labels_and_solid
from ..machine.blender_host import quiet_steps, require_blender
from ..surfaces import surfaces_steps
from ..terminal import Progress, dimensions
from . import common

STAGES = {"Reading": 1, "Reconstructing": 1, "Rendering": 8}
DESCRIPTION = (
    "Turn one or several surfaces about the vertical axis in a seamless loop. OUTPUT with the suffix "
    "of a video (.mp4, .mkv, .mov, .webm, .avi, .ogv) becomes a video, any other name a folder of "
    "PNG frames."
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of `ctmc figure turntable`."""
    common.add_common(parser, "a video, such as FILE.mp4, or a folder for PNG frames", "turntable")
    common.add_surfaces(parser)
    group = parser.add_argument_group("turntable")
    add_described(group, Turn)
    again = group.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="continue this turntable if it was interrupted")
    again.add_argument("--overwrite", action="store_true", help="replace an existing turntable")
    add_solid(parser)
    common.add_map_colors(parser)
    common.add_blend(parser)
    parser.set_defaults(run=common.with_output_folders(run))


def run(args: argparse.Namespace) -> None:
    """Read, reconstruct, render every frame, write the video, and print what came out."""
    settings, choices, solid = settings_labels_and_solid(args)
    maps = common.maps_of(args, settings)
    common.require_surfaces(args, choices, solid)
    require_blender("a turntable")
    from ...blender.figure.styles import require_engine
    from ...blender.figure.turntable import is_finished_video, is_video, require_turntable, turntable_steps

    with flags_checked():
        turn = Turn(**common.values_of(args, Turn))
    page, style = common.page_of(args), common.style_of(args)
    require_engine(style.engine, bool(maps))
    target = Path(args.output)
    require_turntable(target, page, args.resume, args.overwrite)
    if args.resume and is_finished_video(target):
        print(f"{target.name} already exists and was not changed; replace it with --overwrite")
        return
    blend = common.blend_of(args, target if is_video(target) else target.with_name(target.name + ".blend"))
    stages = Stages(STAGES)
    with Progress(lines=True) as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        steps = surfaces_steps(volume, settings, choices, Budget(args.threads), maps=maps, solid=solid)
        surfaces = progress.finish(stages.run("Reconstructing", steps))
        common.require_names(args, len(surfaces.results))
        style = common.in_colors(style, surfaces.results, maps)
        with common.shown_of(args, style, surfaces) as (scene, shown, _):
            video = turntable_steps(
                Cell(shown), target, page, style, turn, blend, scene, args.resume, args.overwrite, True
            )
            size, rendered = progress.finish(stages.run("Rendering", quiet_steps(video)))
    facts = [
        ("loop", f"{turn.seconds:g} s, {turn.frames} frames, {turn.fps} a second, {dimensions(size)} pixels"),
        ("rendered", f"{rendered} frames now" if rendered < turn.frames else "all frames"),
    ]
    print(common.summary(facts, surfaces.notes, [target, blend]))
