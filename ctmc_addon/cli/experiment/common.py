# SPDX-License-Identifier: GPL-3.0-or-later
"""Share code of the experiments: flags, reading and reconstructing, measures, and facts for their tables."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import TypeVar

from ...core import (
    Budget,
    FinishedSurface,
    Reconstruction,
    ReconstructionSettings,
    Stages,
    Steps,
    TriangleMesh,
    Volume,
    equal_part,
    measure,
    reconstruct_steps,
    sizes_text,
)
from ...core.mesh import SAMPLES, SEED, OneWayDistance, ReferenceSurface, SurfaceDistance, surface_distance_steps
from ..commands.reconstruct import input_steps
from ..flags.arguments import UsageError, add_input, add_settings, add_work, command_of, settings_from
from ..terminal import Progress, dimensions
from .table import Row, plain, unique

FETCHED = "The file was read again for every surface, which times include."
MEASURING = (
    "distance",
    f"exact from point to surface, both ways: {SAMPLES} points on each surface, even by area, seed {SEED}; "
    "the maximum also at all vertices",
)
T = TypeVar("T")


class Work:
    """The stages of an experiment, shown on the terminal."""

    def __init__(self, args: argparse.Namespace, stages: Mapping[str, float], progress: Progress) -> None:
        self.args, self.stages, self.progress = args, Stages(stages), progress
        self.budget = Budget(args.threads)

    def run(self, name: str, steps: Steps[T]) -> T:
        """Run the steps of a stage to their end."""
        return self.progress.finish(self.stages.run(name, steps))

    def read(self, settings: ReconstructionSettings) -> Volume:
        """Read the input."""
        return self.run("Reading", input_steps(self.args, settings))

    def reconstruct(self, volume: Volume, settings: ReconstructionSettings) -> Reconstruction:
        """Make the surface of a volume."""
        return self.run("Reconstructing", reconstruct_steps(volume, settings, self.budget))


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add the flags of all experiments: input, folder and settings."""
    add_input(parser)
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="output folder, created if needed")
    parser.add_argument("--overwrite", action="store_true", help="replace an older experiment in that folder")
    add_work(parser)
    add_settings(parser)


def add_levels(parser: argparse.ArgumentParser, default: Sequence[float]) -> None:
    """Add the flag for levels of simplification, per cent."""
    parser.add_argument(
        "--levels",
        nargs="+",
        type=_level,
        default=list(default),
        metavar="PERCENT",
        help=f"share of the triangles to remove, 0 to 99 (default {' '.join(f'{percent:g}' for percent in default)})",
    )


def _level(word: str) -> float | int:
    percent = float(word)
    if not 0 <= percent <= 99:
        raise argparse.ArgumentTypeError(f"a level is from 0 to 99 per cent of the triangles to remove, not {word}")
    return plain(percent)


def settings_of(args: argparse.Namespace) -> ReconstructionSettings:
    """Return the settings of file and flags; a label is not smoothed unless they say so, as in the paper.

    Raises
    ------
    UsageError
        For a simplifier that works in Blender, after the stages that an experiment measures.
    """
    settings = settings_from(args)
    if settings.simplifies and settings.simplifier == "decimate":
        raise UsageError(
            "this experiment simplifies with the built-in simplifier; leave --simplifier decimate out "
            "(`ctmc experiment simplify` compares the two)"
        )
    return settings.unsmoothed if settings.smoothing_is_automatic else settings


def facts_of(
    volume: Volume, settings: ReconstructionSettings, threshold: float, notes: Sequence[str]
) -> list[tuple[str, str]]:
    """Return input, settings and notes, by name."""
    spacing = [round(gap, 4) for gap in volume.spacing]
    facts = [
        ("input", f"{volume.name}, {dimensions(volume.size)} voxels of {sizes_text(spacing, digits=6)}"),
        ("settings", f"{command_of(settings) or 'the defaults'} (surface at {threshold:.6g})"),
    ]
    if volume.reader.own_bytes:
        notes = [*notes, FETCHED]
    return facts + [("note", note) for note in unique(notes)]


def measured(mesh: TriangleMesh, *names: str) -> Row:
    """Return measures of a surface by their names."""
    surface = FinishedSurface(mesh.measures)
    return {name: measure(name).value(surface) for name in names}


def distance_cells(distance: SurfaceDistance) -> Row:
    """Return a distance as rows have it."""
    return {"mean_mm": distance.mean, "max_mm": distance.largest}


def way_cells(distance: SurfaceDistance) -> Row:
    """Return both ways of a distance, and the components that are lost, for the last columns."""
    ways = {"to_full": distance.to_full, "from_full": distance.from_full}
    cells = {f"{name}_{key}": value for name, way in ways.items() for key, value in _parts(way).items()}
    lost = distance.lost
    return cells | {"collapsed_components": lost.count, "collapsed_mm3": lost.volume, "collapsed_max_mm": lost.largest}


def _parts(way: OneWayDistance) -> Row:
    return {"mean_mm": way.mean, "p95_mm": way.percentile_95, "max_mm": way.largest}


def distances_steps(meshes: Sequence[TriangleMesh], reference: TriangleMesh) -> Steps[list[SurfaceDistance]]:
    """Measure the distance of every surface to the reference."""
    surface = ReferenceSurface(reference)
    distances = []
    for at, mesh in enumerate(meshes):
        distances.append((yield from equal_part(surface_distance_steps(mesh, surface), at, len(meshes))))
    return distances
