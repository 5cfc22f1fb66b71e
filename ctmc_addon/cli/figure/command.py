# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc figure INPUT -o FILE.png`: make a figure for print; `figure sheet` and `figure turntable` are below it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...blender.figure.spec import Cell
from ...core import Budget, Reconstruction, Stages
from ..commands.reconstruct import input_steps
from ..flags.arguments import Parser
from ..flags.solid import add_solid, settings_labels_and_solid
from ..machine.blender_host import quiet_steps, require_blender
from ..surfaces import open_words, surfaces_steps
from ..terminal import Progress
from . import common, sheet, turntable

STAGES = {"Reading": 1, "Reconstructing": 3, "Rendering": 6}
DESCRIPTION = (
    "Render a surface, or several labels, to a PNG for print: framed, with a scale bar, the patient's axes and a "
    "caption, and write the .blend that made it. `ctmc figure sheet` compares settings, `ctmc figure turntable` turns "
    "the surface."
)


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`, and the commands below it."""
    parser: Parser = commands.add_parser(
        "figure", help="render a figure for print, a sheet or a turntable", description=DESCRIPTION
    )
    common.add_common(parser, "FILE.png; its folder is created if needed", "figure")
    common.add_surfaces(parser)
    add_solid(parser)
    common.add_distance_map(parser)
    common.add_map_colors(parser, without=("deviation",))  # It has a figure of its own.
    common.add_blend(parser)
    parser.set_defaults(run=common.with_output_folders(run))
    sheet.add_flags(parser.add_command("sheet", sheet.DESCRIPTION))
    turntable.add_flags(parser.add_command("turntable", turntable.DESCRIPTION))


def run(args: argparse.Namespace) -> None:
    """Read, reconstruct, render, and print what came out."""
    settings, choices, solid = settings_labels_and_solid(args)
    distances = common.map_of(args)
    if distances.deviation:
        common.require_no_solid(solid)
        settings, choices = common.only_one(args, "a distance map"), ()
    maps = common.maps_of(args, settings)
    common.require_surfaces(args, choices, solid)
    require_blender("a figure")
    from ...blender.figure.page.sheet import deviation_figure_steps
    from ...blender.figure.rendering.render import figure_steps, require_png
    from ...blender.figure.styles import require_engine

    page, style = common.page_of(args), common.style_of(args)
    target = Path(args.output)
    require_png(target)
    require_engine(style.engine, distances.deviation or bool(maps))
    blend = common.blend_of(args, target)
    stages = Stages(STAGES)
    with Progress() as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        steps = surfaces_steps(volume, settings, choices, Budget(args.threads), maps=maps, solid=solid)
        surfaces = progress.finish(stages.run("Reconstructing", steps))
        common.require_names(args, len(surfaces.results))
        style = common.in_colors(style, surfaces.results, maps)
        results: Sequence[Reconstruction] = surfaces.results
        if distances.deviation:
            figure = deviation_figure_steps(
                volume, results[0], target, page, style, blend, distances.limit_mm, own_process=True
            )
            size = progress.finish(stages.run("Rendering", quiet_steps(figure)))
        else:
            with common.shown_of(args, style, surfaces) as (scene, shown, results):
                if style.caption is None:
                    explode = common.exploded_by(args)
                    caption = common.caption_of(results, volume.kind, args.names or (), style, explode)
                    style = replace(style, caption=caption)
                figure = figure_steps([Cell(shown)], target, page, style, blend, scene, own_process=True)
                size = progress.finish(stages.run("Rendering", quiet_steps(figure)))
    facts = [
        ("figure", common.size_of(page, size)),
        ("surfaces", open_words(len(results), sum(not result.measures.closed for result in results))),
        ("triangles", f"{sum(len(result.mesh.faces) for result in results):,}"),
    ]
    print(common.summary(facts, surfaces.notes, [target, blend]))
