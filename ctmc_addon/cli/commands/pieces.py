# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface that does not fit in memory, written to STL or PLY as it is extracted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core import ReconstructionSettings, Steps, Volume, memory_refusal
from ...core.files import mesh_files
from ...core.files.piece_files import WrittenPieces, write_pieces_steps
from ...core.streaming import SurfaceFacts, surface_pieces_steps
from ...core.volume import SlabVolume
from ..arguments import command_of
from ..outputs import Outputs
from ..terminal import dimensions, listing, titled

REMEDY = "use a larger stride or a region"
NOT_HELD = "The surface does not fit in memory: it was written as it was extracted, and is not measured."


def written_in_pieces(outputs: Outputs, settings: ReconstructionSettings, choices: Sequence[int | str]) -> bool:
    """Whether a surface with these settings can be written that is never there as a whole."""
    one_file = len(outputs.surfaces) == 1 and outputs.surfaces[0].suffix.lower() in mesh_files.SUFFIXES
    measured = outputs.report or outputs.figure
    return one_file and not measured and not settings.simplifies and all(choice == settings.label for choice in choices)


def written_pieces_steps(
    volume: Volume | SlabVolume, settings: ReconstructionSettings, threads: int | None, outputs: Outputs
) -> Steps[WrittenPieces[SurfaceFacts]]:
    """Write the surface."""
    path: Path = outputs.surfaces[0]
    normals = settings.normals == "gradient" and path.suffix.lower() == ".ply"
    pieces = surface_pieces_steps(volume, settings, threads, normals=normals)
    with memory_refusal("writing the surface as it is extracted", REMEDY):
        return (yield from write_pieces_steps(path, pieces, outputs.space))


def pieces_summary(
    written: WrittenPieces[SurfaceFacts],
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    outputs: Outputs,
) -> str:
    """Counts and notes; there are no measures."""
    head = f"{volume.name}: {dimensions(volume.size)}, {dimensions(volume.spacing)} mm"
    facts = [
        ("triangles", f"{written.faces}"),
        ("threshold", f"{written.info.threshold:.6g}"),
        *titled("note", [*volume.notes, *written.info.notes, NOT_HELD]),
        ("written", outputs.surfaces[0].name),
    ]
    return f"{head}\nsettings: {command_of(settings) or 'the defaults'}\n\n{listing(facts)}"
