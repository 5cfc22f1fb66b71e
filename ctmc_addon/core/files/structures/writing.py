# SPDX-License-Identifier: GPL-3.0-or-later
"""Write several structures to one file, or its two, whole or not at all: the same bytes from everywhere."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...errors import OutputError
from ...exploded import shifts_of
from ...progress import Steps, finish
from ..atomic_write import refused, whole_files
from ..mesh_files import STRUCTURE_SUFFIXES, files_of, require_placements
from .glb import write_glb_steps
from .page import write_page_steps
from .structure import Structure, as_structures
from .three_mf import write_3mf_steps
from .wavefront import write_obj_steps

Writer = Callable[[Path, Sequence[Structure]], Steps[None]]
WRITERS: dict[str, Writer] = dict(
    zip(STRUCTURE_SUFFIXES, (write_obj_steps, write_glb_steps, write_3mf_steps, write_page_steps), strict=True)
)
TURNED = (".obj", ".3mf")  # The axes of these formats can be LPS; the other formats fix their axes.


def write_structures(
    path: str | os.PathLike[str], structures: Sequence[Structure], space: str = "ras", explode: float = 0.0
) -> None:
    """Write structures to one file, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    path : path
        Ends in .glb, .obj (its .mtl is written beside it), .3mf or .html.
    structures : sequence of Structure
        Names that several have get a number.
    space : {"ras", "lps"}
        Axes of an OBJ or 3MF, which are in mm. A GLB is in meters with Y up, as glTF has it.
    explode : float
        Shift of the structure that is farthest from the common center in an exploded view, mm, as `shifts_of` has it.
        A GLB keeps it as translations of its nodes, a page as the start of its slider; vertices stay in place.

    Raises
    ------
    OutputError
        For another suffix, a structure without triangles, a place that cannot be written to, or an exploded view in a
        file of coordinates alone.
    """
    with whole_files(files_of(Path(path))) as places:
        finish(write_structures_steps(places[Path(path)], structures, space, explode))


def write_structures_steps(
    path: Path, structures: Sequence[Structure], space: str = "ras", explode: float = 0.0
) -> Steps[None]:
    """Do what `write_structures` does as steps, straight to a path; the caller makes sure that files are whole."""
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        formats = ", ".join(STRUCTURE_SUFFIXES)
        raise OutputError(f"{path.name or 'an empty name'} cannot hold several structures; the formats are {formats}")
    if explode:
        require_placements(path)
    named = as_structures(structures, path.name)
    if explode:
        named = _moved_apart(named, explode)
    if space == "lps" and path.suffix.lower() in TURNED:
        named = [_turned(structure) for structure in named]
    try:
        yield from writer(path, named)
    except OSError as error:
        raise refused(path, error) from error


def _moved_apart(structures: Sequence[Structure], explode: float) -> list[Structure]:
    """Return the structures with their shifts in an exploded view."""
    shifts = shifts_of([(structure.vertices, structure.faces) for structure in structures], explode)
    return [
        replace(structure, shift=(x, y, z)) for structure, (x, y, z) in zip(structures, shifts.tolist(), strict=True)
    ]


def _turned(structure: Structure) -> Structure:
    """Return the structure in LPS+ mm: half a turn about z."""
    turn = np.array([-1, -1, 1], np.float32)
    normals = None if structure.normals is None else structure.normals * turn
    return replace(structure, vertices=structure.vertices * turn, normals=normals)
