# SPDX-License-Identifier: GPL-3.0-or-later
"""One surface and its report, for a surface that does not fit in memory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core import Reconstruction, ReconstructionSettings, Steps, Volume
from ...core.files import mesh_files
from ...core.files.atomic_write import whole_files, write_json
from ...core.volume import SlabVolume
from ..outputs import Outputs
from ..piece_writer import written_in_pieces_steps


def written_in_pieces(outputs: Outputs, settings: ReconstructionSettings, choices: Sequence[int | str]) -> bool:
    """Whether a surface with these settings can be written that is never there as a whole."""
    one_file = len(outputs.surfaces) == 1 and outputs.surfaces[0].suffix.lower() in mesh_files.SUFFIXES
    return one_file and not outputs.figure and not settings.simplifies and is_only_choice(settings, choices)


def is_only_choice(settings: ReconstructionSettings, choices: Sequence[int | str]) -> bool:
    """Whether the settings are those of the one surface that is asked for."""
    return all(choice == settings.label for choice in choices)


def written_pieces_steps(
    volume: Volume | SlabVolume, settings: ReconstructionSettings, threads: int | None, outputs: Outputs
) -> Steps[tuple[Reconstruction, list[Path]]]:
    """Write the surface and its report, both or neither."""
    path = outputs.surfaces[0]
    paths = [path] if outputs.report is None else [path, outputs.report]
    with whole_files(paths) as places:
        result = yield from written_in_pieces_steps(volume, settings, threads, places[path], outputs.space)
        if outputs.report is not None:
            write_json(places[outputs.report], result.report() | {"files": [path.name for path in paths]})
    return result, paths
