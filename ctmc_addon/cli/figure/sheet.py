"""`ctmc figure sheet`: the same surface at several settings, side by side (Su and Ma, figures 6 to 8)."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core import SettingsError, within
from ..blender_host import load_scene, quiet
from ..commands.reconstruct import Work
from ..experiment.voxels import sides_of
from ..terminal import Progress, table
from . import common

DESCRIPTION = (
    "Reconstruct with several settings and show the surfaces side by side, seen by the same camera, each with its "
    "setting, triangles, seconds and error against full resolution. Two of --strides, --alphas and --levels may be "
    "crossed: the first goes down, the second across."
)


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "figure sheet", help="settings side by side", description=DESCRIPTION, allow_abbrev=False
    )
    common.add_common(parser, "FILE.png; its folder is made", width_mm=170.0, dpi=300.0)
    group = parser.add_argument_group("what is compared")
    group.add_argument("--strides", nargs="+", type=sides_of, default=[], metavar="N", help="voxel sides: 2, or 2x1")
    group.add_argument("--alphas", nargs="+", type=float, default=[], metavar="A")
    group.add_argument(
        "--levels", nargs="+", type=float, default=[], metavar="PERCENT", help="share of the triangles to remove"
    )
    group.add_argument("--columns", type=int, metavar="N", help="cells side by side")
    common.add_map(parser)
    common.add_blend(parser)
    parser.set_defaults(run=common.in_made_folders(run))


def run(chosen: argparse.Namespace) -> None:
    """Read, reconstruct, measure, render, and print what the captions say."""
    settings = common.only_one(common.settings_of(chosen), "a sheet")
    scene = load_scene()
    comparison = scene.Comparison(
        *(tuple(dict.fromkeys(axis)) for axis in (chosen.strides, chosen.alphas, chosen.levels))
    )
    comparison.variants(settings)  # checks the limits of all before the work
    if chosen.columns is not None and chosen.columns < 1:
        raise SettingsError(f"columns must be 1 or more, not {chosen.columns}")
    page, look = common.page_of(chosen), replace(common.look_of(chosen, False, ""), columns=chosen.columns)
    scene.require_png(Path(chosen.output))
    scene.require_engine(chosen.engine, chosen.deviation)
    target = Path(chosen.output)
    blend = common.blend_of(chosen, target)
    work = Work()
    with Progress() as progress:
        volume = common.volume_of(chosen, settings, work, progress)
        steps = scene.sheet_steps(
            volume, settings, comparison, target, page, look, blend, chosen.deviation, chosen.limit_mm, chosen.threads
        )
        size, compared = progress.drive(within(quiet(steps), 0.1, 1.0))
    rows = [("cell", "triangles", "seconds", "mean, mm", "max, mm")]
    rows += [
        (
            f"({one.letter}) {one.title}",
            str(len(one.result.mesh.faces)),
            f"{one.seconds:.3f}",
            f"{one.mean_mm:.4f}",
            f"{one.max_mm:.3f}",
        )
        for one in compared
    ]
    notes = [*work.notes, *compared[0].result.notes]
    print(f"{table(rows)}\n\n{common.told([('figure', common.size_of(page, size))], notes, [target, blend])}")
