# SPDX-License-Identifier: GPL-3.0-or-later
"""Write several structures to one file, or its two, whole or not at all: the same bytes from everywhere."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...errors import OutputError
from ...progress import Steps, finish
from ..atomic_write import refused, whole_files
from ..mesh_files import STRUCTURE_SUFFIXES, files_of
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


def write_structures(path: str | os.PathLike[str], structures: Sequence[Structure], space: str = "ras") -> None:
    """Write structures to one file, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    path : path
        Ends in .glb, .obj (its .mtl is written beside it), .3mf or .html.
    structures : sequence of Structure
        Names that several have get a number.
    space : {"ras", "lps"}
        Axes of an OBJ or 3MF, which are in mm. A GLB is in meters with Y up, as glTF has it.

    Raises
    ------
    OutputError
        For another suffix, a structure without triangles, or a place that cannot be written to.
    """
    with whole_files(files_of(Path(path))) as places:
        finish(write_structures_steps(places[Path(path)], structures, space))


def write_structures_steps(path: Path, structures: Sequence[Structure], space: str = "ras") -> Steps[None]:
    """Do what `write_structures` does as steps, straight to a path; the caller makes sure that files are whole."""
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        formats = ", ".join(STRUCTURE_SUFFIXES)
        raise OutputError(f"{path.name or 'an empty name'} cannot hold several structures; the formats are {formats}")
    named = as_structures(structures, path.name)
    if space == "lps" and path.suffix.lower() in TURNED:
        named = [_turned(structure) for structure in named]
    try:
        yield from writer(path, named)
    except OSError as error:
        raise refused(path, error) from error


def _turned(structure: Structure) -> Structure:
    """The structure in LPS+ mm: half a turn about z."""
    turn = np.array([-1, -1, 1], np.float32)
    normals = None if structure.normals is None else structure.normals * turn
    return replace(structure, vertices=structure.vertices * turn, normals=normals)
