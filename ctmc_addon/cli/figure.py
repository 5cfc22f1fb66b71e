"""`ctmc figure INPUT -o FILE.png`: one command to a figure for print, and `figure sheet`, `figure turntable`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core import Reconstruction
from ..core.progress import within
from . import figure_sheet, figure_turntable
from .blender import load_scene, quiet
from .figure_common import (
    add_blend,
    add_common,
    add_map,
    add_surfaces,
    blend_of,
    caption_of,
    look_of,
    objects_of,
    only_one,
    output_file,
    page_of,
    require_names,
    settings_of,
    shown_of,
    surfaces_steps,
    volume_of,
)
from .output import Progress, by, listing
from .reconstruct import Work

DESCRIPTION = (
    "Render a surface, or several labels, to a PNG for print: framed, with a scale bar, the patient's axes and a "
    "caption, and write the .blend that made it. `ctmc figure sheet` compares settings, `ctmc figure turntable` turns "
    "the surface."
)


def add_parser(commands: Any) -> None:
    """Add the commands to `ctmc`."""
    parser = commands.add_parser("figure", help="a figure for print", description=DESCRIPTION, allow_abbrev=False)
    add_common(parser, "FILE.png; its folder is made", width_mm=85.0, dpi=300.0)
    add_surfaces(parser)
    add_map(parser)
    add_blend(parser)
    parser.set_defaults(run=run)
    figure_sheet.add_parser(commands)
    figure_turntable.add_parser(commands)


def run(chosen: argparse.Namespace) -> None:
    """Read, reconstruct, render, and say what came out."""
    every = settings_of(chosen)
    if chosen.deviation:
        only_one(every, "a map of distances")
    require_names(chosen, len(every))
    scene = load_scene()
    page, look = page_of(chosen), look_of(chosen, len(every) > 1, "")
    scene.require_png(Path(chosen.output))
    scene.require_engine(chosen.engine, chosen.deviation)
    target = output_file(chosen.output)
    blend = blend_of(chosen, target)
    work = Work()
    with Progress() as progress:
        volume = volume_of(chosen, every[0], work, progress)
        results = progress.drive(within(surfaces_steps(volume, every, chosen.threads), 0.1, 0.4))
        if chosen.deviation:
            steps = quiet(scene.deviation_figure_steps(volume, results[0], target, page, look, blend, chosen.limit_mm))
            size = progress.drive(within(steps, 0.4, 1.0))
        else:
            with objects_of(results) as (home, things, shown):
                if chosen.caption is None:
                    look = replace(look, caption=caption_of(shown, chosen.names or ()))
                cell = scene.Cell(tuple(shown_of(chosen, things, shown)))
                steps = quiet(scene.figure_steps([cell], target, page, look, blend, home))
                size = progress.drive(within(steps, 0.4, 1.0))
                results = shown
    print(told(page, size, results, [target, *([blend] if blend else [])], [*work.notes, *results[0].notes]))


def told(
    page: Any, size: tuple[int, int], results: Sequence[Reconstruction], files: Sequence[Path], notes: Sequence[str]
) -> str:
    """What was written, for a person."""
    height = size[1] / page.pixels_per_mm
    facts = [
        ("figure", f"{page.width_mm:g} x {height:.1f} mm, {by(size)} pixels, {page.dpi:g} dpi"),
        ("triangles", ", ".join(f"{len(result.mesh.faces):,}" for result in results)),
    ]
    facts += [("note" if not at else "", note) for at, note in enumerate(dict.fromkeys(notes))]
    return listing([*facts, ("written", ", ".join(file.name for file in files))])
