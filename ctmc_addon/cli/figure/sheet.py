# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc figure sheet`: show the same surface at several settings, side by side (Su and Ma, figures 6 to 8)."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...blender.figure.spec import Comparison
from ...core import Budget, Stages, length_text, one_way_text, volume_text
from ..commands.reconstruct import input_steps
from ..experiment.voxels import sides_of
from ..flags.arguments import flags_checked
from ..flags.described import add_described
from ..machine.blender_host import quiet_steps, require_blender
from ..terminal import Progress, table
from . import common

STAGES = {"Reading": 1, "Rendering": 9}
DESCRIPTION = (
    "Reconstruct with several settings and show the surfaces side by side, seen by the same camera, each with its "
    "setting, triangles, seconds and error against full resolution. Two of --smoothings, --strides, --alphas and "
    "--levels may be crossed: the first goes down, the second across."
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of `ctmc figure sheet`."""
    common.add_common(parser, "FILE.png; its folder is created if needed", "sheet")
    group = parser.add_argument_group("settings to compare")
    add_described(group, Comparison, readers={"strides": sides_of})
    common.add_distance_map(parser)
    common.add_blend(parser)
    parser.set_defaults(run=common.with_output_folders(run))


def run(args: argparse.Namespace) -> None:
    """Read, reconstruct, measure, render, and print what the captions say."""
    settings = common.only_one(args, "a sheet")
    require_blender("a figure")
    from ...blender.figure.page.sheet import sheet_steps
    from ...blender.figure.rendering.render import require_png
    from ...blender.figure.styles import require_engine

    with flags_checked():
        axes = common.values_of(args, Comparison)
        comparison = Comparison(**{name: tuple(dict.fromkeys(axis)) for name, axis in axes.items()})
        comparison.variants(settings)
    page, style, distances = common.page_of(args), common.style_of(args), common.map_of(args)
    target = Path(args.output)
    require_png(target)
    require_engine(style.engine, distances.deviation)
    blend = common.blend_of(args, target)
    stages = Stages(STAGES)
    with Progress() as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        sheet = sheet_steps(
            *(volume, settings, comparison, target, page, style, blend),
            *(distances.deviation, distances.limit_mm, Budget(args.threads), True),
        )
        size, cells = progress.finish(stages.run("Rendering", quiet_steps(sheet)))
    heads = ("cell", "volume", "triangles", "seconds", "mean", "largest", "to full surface", "from full surface")
    rows = [(*heads, "specks removed")]
    rows += [
        (
            f"({cell.letter}) {cell.title}",
            volume_text(cell.result.mesh.volume) if cell.result.mesh.closed else "open",
            str(len(cell.result.mesh.faces)),
            f"{cell.seconds:.3f}",
            length_text(cell.distance.mean, 3),
            length_text(cell.distance.largest, 3),
            one_way_text(cell.distance.to_full),
            one_way_text(cell.distance.from_full),
            str(cell.distance.lost.count),
        )
        for cell in cells
    ]
    facts = [("figure", common.size_of(page, size))]
    print(f"{table(rows)}\n\n{common.summary(facts, cells[0].result.notes, [target, blend])}")
