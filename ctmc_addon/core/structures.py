# SPDX-License-Identifier: GPL-3.0-or-later
"""Reconstructions as structures of one file: each with its name, color and opacity."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence

from .files.file_names import file_key, printable
from .files.structures import Structure, write_structures
from .reconstruction import Reconstruction
from .volume.structure_colors import structure_color


def structures_of(results: Sequence[Reconstruction], names: Sequence[str] = ()) -> list[Structure]:
    """Return a structure of each result.

    Colors are those of the file, else of the anatomical name, else of the label's number; one structure alone is
    opaque, as it has nothing to hide.

    Parameters
    ----------
    results : sequence of Reconstruction
        With their meshes.
    names : sequence of str
        What each is called; by default as its label, or as the volume.

    Examples
    --------
    >>> import numpy as np
    >>> from .label_surfaces import reconstruct_labels
    >>> from .settings import ReconstructionSettings
    >>> from .volume.volume import Volume
    >>> values = np.zeros((8, 8, 20), np.uint8)
    >>> values[2:6, 2:6, 2:6], values[3:5, 3:5, 12:18] = 1, 2
    >>> volume = Volume(values, np.eye(4), kind="label", label_names={1: "liver", 2: "tumor"})
    >>> surfaces = reconstruct_labels(volume, ReconstructionSettings()).surfaces
    >>> [(structure.name, structure.rgb, structure.opacity) for structure in structures_of(surfaces)]
    [('liver', (122, 28, 40), 0.6), ('tumor', (242, 184, 36), 1.0)]
    """
    out = []
    for name, result in zip(names or structure_names(results), results, strict=True):
        color, opacity = structure_color(result.settings.label, result.label_color, result.label_name)
        mesh, measures = result.mesh, result.measures
        milliliters = measures.milliliters if measures.closed else None
        shown = opacity if len(results) > 1 else 1.0
        out.append(Structure(name, mesh.vertices, mesh.faces, color, shown, mesh.normals, milliliters))
    return out


def structure_names(results: Sequence[Reconstruction]) -> tuple[str, ...]:
    """Return what results are called: as their labels, where several have a name with their numbers, or as the volume.

    Names are those of the volume on one line, and 'label 3' for a label without one.
    """
    names = [printable(result.label_name) for result in results]
    count = Counter(file_key(name) for name in names)
    out = []
    for name, result in zip(names, results, strict=True):
        label = result.settings.label
        shared = f" {label}" if count[file_key(name)] > 1 else ""
        out.append(printable(result.name) if label is None else f"{name}{shared}" if name else f"label {label}")
    return tuple(out)


def save_structures(
    path: str | os.PathLike[str], results: Sequence[Reconstruction], names: Sequence[str] = (), space: str = "ras"
) -> None:
    """Write surfaces to one file with names, colors and opacity, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    path : path
        Ends in .glb, .obj (its .mtl is written beside it), .3mf or .html; its folder exists.
    results : sequence of Reconstruction
        Such as `reconstruct_labels(...).surfaces`.
    names : sequence of str
        What each is called; by default as its label, or as the volume.
    space : {"ras", "lps"}
        Axes of an OBJ or 3MF, which are in mm. A GLB is in meters with Y up, as glTF has it.

    Raises
    ------
    OutputError
        For another suffix, or a place that cannot be written to.
    """
    write_structures(path, structures_of(results, names), space)
