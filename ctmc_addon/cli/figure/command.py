"""`ctmc figure INPUT -o FILE.png`: one command to a figure for print, and `figure sheet`, `figure turntable`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core import within
from ..blender_host import load_scene, quiet
from ..commands.reconstruct import Work
from ..terminal import Progress
from . import common
from . import sheet as figure_sheet
from . import turntable as figure_turntable

DESCRIPTION = (
    "Render a surface, or several labels, to a PNG for print: framed, with a scale bar, the patient's axes and a "
    "caption, and write the .blend that made it. `ctmc figure sheet` compares settings, `ctmc figure turntable` turns "
    "the surface."
)


def add_parser(commands: Any) -> None:
    """Add the commands to `ctmc`."""
    parser = commands.add_parser("figure", help="a figure for print", description=DESCRIPTION, allow_abbrev=False)
    common.add_common(parser, "FILE.png; its folder is made", width_mm=85.0, dpi=300.0)
    common.add_surfaces(parser)
    common.add_map(parser)
    common.add_blend(parser)
    parser.set_defaults(run=common.in_made_folders(run))
    figure_sheet.add_parser(commands)
    figure_turntable.add_parser(commands)


def run(chosen: argparse.Namespace) -> None:
    """Read, reconstruct, render, and say what came out."""
    every = common.settings_of(chosen)
    if chosen.deviation:
        common.only_one(every, "a map of distances")
    common.require_names(chosen, len(every))
    scene = load_scene()
    page, look = common.page_of(chosen), common.look_of(chosen, len(every) > 1, "")
    scene.require_png(Path(chosen.output))
    scene.require_engine(chosen.engine, chosen.deviation)
    target = Path(chosen.output)
    blend = common.blend_of(chosen, target)
    work = Work()
    with Progress() as progress:
        volume = common.volume_of(chosen, every[0], work, progress)
        results = progress.drive(within(common.surfaces_steps(volume, every, chosen.threads), 0.1, 0.4))
        if chosen.deviation:
            steps = quiet(scene.deviation_figure_steps(volume, results[0], target, page, look, blend, chosen.limit_mm))
            size = progress.drive(within(steps, 0.4, 1.0))
        else:
            with common.objects_of(results) as (home, things, shown):
                if chosen.caption is None:
                    look = replace(look, caption=common.caption_of(shown, chosen.names or ()))
                cell = scene.Cell(tuple(common.shown_of(chosen, things, shown)))
                steps = quiet(scene.figure_steps([cell], target, page, look, blend, home))
                size = progress.drive(within(steps, 0.4, 1.0))
                results = shown
    facts = [
        ("figure", common.size_of(page, size)),
        ("triangles", ", ".join(f"{len(result.mesh.faces):,}" for result in results)),
    ]
    print(common.told(facts, [*work.notes, *results[0].notes], [target, blend]))
