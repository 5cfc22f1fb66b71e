"""What the experiments share: flags, reading, and what their tables say of input and settings."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

from ...core import ReconstructionSettings, SettingsError, Volume, within
from ...core.mesh import SAMPLES, SEED
from ..arguments import add_input, add_settings, command_of, settings_from
from ..blender_host import load_scene
from ..commands.reconstruct import Work, volume_steps
from ..terminal import Progress, by
from .table import once, plain


def add_common(parser: argparse.ArgumentParser) -> None:
    """INPUT, the folder, the settings and what every experiment knows."""
    add_input(parser)
    parser.add_argument(
        "-o", "--output", required=True, metavar="DIR", help="folder for table and pictures; made with its parents"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an older experiment in that folder")
    parser.add_argument("--threads", type=int, metavar="N", help="default: one for each processor, at most 8")
    add_settings(parser)


def prepared(
    chosen: argparse.Namespace, check: Callable[[ReconstructionSettings], None]
) -> tuple[ReconstructionSettings, Volume, list[str], Progress]:
    """Settings that pass the check, the volume, notes on which file it is, and the progress line so far."""
    settings = settings_from(chosen)
    check(settings)
    load_scene()  # says so where there is no Blender, before anything is read
    work, progress = Work(), Progress()
    with progress:
        volume = progress.drive(within(volume_steps(chosen, settings, work), 0.0, 0.1))
    return settings, volume, work.notes, progress


def require_builtin(settings: ReconstructionSettings) -> None:
    """Raise `SettingsError` for a simplifier that works in Blender, after the stages that an experiment measures."""
    if settings.simplifies and settings.simplifier == "decimate":
        raise SettingsError(
            "this experiment simplifies with the built-in simplifier; leave --simplifier decimate out "
            "(`ctmc experiment simplify` compares the two)"
        )


def levels_of(percents: Sequence[float]) -> list[float]:
    """Simplification levels in per cent, each once, or a `SettingsError`."""
    for percent in percents:
        if not 0 <= percent <= 99:
            raise SettingsError(f"a level must be from 0 to 99 per cent of the triangles to remove, not {percent:g}")
    return once([plain(percent) for percent in percents])


def facts_of(
    volume: Volume, settings: ReconstructionSettings, threshold: float, notes: Sequence[str]
) -> list[tuple[str, str]]:
    """Input, settings and notes."""
    facts = [
        ("input", f"{volume.name}, {by(volume.size)} voxels of {by([round(gap, 4) for gap in volume.spacing])} mm"),
        ("settings", f"{command_of(settings) or 'the defaults'} (surface at {threshold:.6g})"),
    ]
    return facts + [("note", note) for note in once(notes)]


def measuring_fact() -> tuple[str, str]:
    """How distances are measured."""
    return (
        "distance",
        f"exact from point to surface, both ways: {SAMPLES} points on each surface, even by area, seed {SEED}; "
        "the maximum also at all vertices",
    )
