# SPDX-License-Identifier: GPL-3.0-or-later
"""Reconstructions as structures of one file: each with its name, color and opacity."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence, Set
from typing import TYPE_CHECKING

from .errors import AbsentLabelError
from .files.file_names import file_key, printable
from .measures.reconstruction import Reconstruction
from .volume.labels.anatomy import anatomy_of
from .volume.labels.extents import compared_name
from .volume.labels.structure_colors import part_rgb, structure_color

if TYPE_CHECKING:
    from .files.structures import Structure

ALL = "all"


def structures_of(
    results: Sequence[Reconstruction],
    names: Sequence[str] = (),
    opacities: Sequence[float | None] = (),
    shown: str = "",
) -> list[Structure]:
    """Return a structure of each result.

    Colors are those of the file, else of the anatomical name, else of the label's number; one structure alone is
    opaque, as it has nothing to hide.

    Parameters
    ----------
    results : sequence of Reconstruction
        Results with their meshes.
    names : sequence of str
        Name of each; by default that of its label, or of the volume.
    opacities : sequence of float or None
        Opacity of each, from 0 to 1; None is opaque. By default as `opacities_of` has them.
    shown : str
        Name of the map whose colors are shown; empty for plain colors.

    Examples
    --------
    >>> import numpy as np
    >>> from .surfaces.labels import reconstruct_labels
    >>> from .settings import ReconstructionSettings
    >>> from .volume.volume import Volume
    >>> values = np.zeros((8, 8, 20), np.uint8)
    >>> values[2:6, 2:6, 2:6], values[3:5, 3:5, 12:18] = 1, 2
    >>> volume = Volume(values, np.eye(4), kind="label", label_names={1: "liver", 2: "tumor"})
    >>> surfaces = reconstruct_labels(volume, ReconstructionSettings()).surfaces
    >>> [(structure.name, structure.rgb, structure.opacity) for structure in structures_of(surfaces)]
    [('liver', (122, 28, 40), 0.6), ('tumor', (242, 184, 36), 1.0)]
    """
    from .files.structures import Structure

    out = []
    called, shares = names or structure_names(results), opacities or opacities_of(results)
    for name, result, share in zip(called, results, shares, strict=True):
        own = structure_color(result.settings.label, result.label_color, result.label_name).rgb
        color = part_rgb(own, result.part_number)
        mesh, measures = result.mesh, result.measures
        opacity = 1.0 if share is None else share
        volume = measures.enclosed_volume
        out.append(
            Structure(name, mesh.vertices, mesh.faces, color, opacity, mesh.normals, volume, tuple(result.maps), shown)
        )
    return out


def opacities_of(
    results: Sequence[Reconstruction], given: Sequence[tuple[int | str, float]] = ()
) -> tuple[float | None, ...]:
    """Return the opacity of each result; None for an opaque one without a given opacity.

    Parameters
    ----------
    results : sequence of Reconstruction
    given : sequence of (label number, name or 'all', float)
        Opacities from 0 to 1. The last one that fits counts; a label's name or number goes before a name of the same
        anatomy, and that before 'all'. Without one, the anatomical name decides, and a single surface has None.
    """
    out: list[float | None] = []
    for result, opacity in zip(results, chosen_opacities(results, given), strict=True):
        own = structure_color(result.settings.label, None, result.label_name).opacity if len(results) > 1 else 1.0
        out.append(opacity if opacity is not None else own if own < 1.0 else None)
    return tuple(out)


def chosen_opacities(
    results: Sequence[Reconstruction], given: Sequence[tuple[int | str, float]] = ()
) -> tuple[float | None, ...]:
    """Return the given opacity of each result, None for none; `given` is as for `opacities_of`."""
    names = {compared_name(result.label_name) for result in results}
    return tuple(_given_opacity(given, result.settings.label, result.label_name, names) for result in results)


def require_opacities(given: Sequence[tuple[int | str, float]], labels: Iterable[tuple[int, str]]) -> None:
    """Raise `AbsentLabelError` for a name that fits none of these labels, numbers with names.

    Parameters
    ----------
    given : sequence of (label number, name or 'all', float)
    labels : iterable of (int, str)
    """
    label_names = [name for _, name in labels if name]
    for choice, _ in given:
        if isinstance(choice, str) and choice != ALL and not any(_fit(choice, None, name) for name in label_names):
            there = (
                f"; there are {', '.join(label_names[:8])}"
                if label_names
                else "; the labels here have no names: give a number"
            )
            raise AbsentLabelError(f"--opacity names {choice!r}, but no structure has that name{there}")


def _given_opacity(
    given: Sequence[tuple[int | str, float]], label: int | None, name: str, names: Set[str]
) -> float | None:
    best_opacity, best = None, 0
    for choice, opacity in given:
        fit = _fit(choice, label, name)
        # What a structure is called goes to that one alone: of two kidneys the anatomy is the same.
        if fit == 2 and isinstance(choice, str) and compared_name(choice) in names:
            continue
        if fit and fit >= best:
            best_opacity, best = opacity, fit
    return best_opacity


def _fit(choice: int | str, label: int | None, name: str) -> int:
    """3 for the label's own number or name, 2 for a name of the same anatomy, 1 for 'all', 0 for none."""
    if choice == ALL:
        return 1
    if not isinstance(choice, str):
        return 3 if choice == label else 0
    if compared_name(choice) == compared_name(name):
        return 3
    anatomy = anatomy_of(choice)
    return 2 if anatomy is not None and anatomy == anatomy_of(name) else 0


def structure_names(results: Sequence[Reconstruction]) -> tuple[str, ...]:
    """Return names of results: by their labels, with numbers if several have one name, or by the volume.

    Names are those of the volume on one line, and 'label 3' for a label without one. Parts of a solid have names of
    their own, a threshold's too.
    """
    names = [printable(result.label_name) for result in results]
    count = Counter(file_key(name) for name in names)
    out = []
    for name, result in zip(names, results, strict=True):
        label = result.settings.label
        shared = f" {label}" if count[file_key(name)] > 1 else ""
        out.append(name or printable(result.name) if label is None else f"{name}{shared}" if name else f"label {label}")
    return tuple(out)


def save_structures(
    path: str | os.PathLike[str],
    results: Sequence[Reconstruction],
    names: Sequence[str] = (),
    space: str = "ras",
    shown: str = "",
    explode: float = 0.0,
) -> None:
    """Write surfaces to one file with names, colors and opacity, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    path : path
        Ends in .glb, .obj (its .mtl is written beside it), .3mf or .html; its folder exists.
    results : sequence of Reconstruction
        Such as `reconstruct_labels(...).surfaces`.
    names : sequence of str
        Name of each; by default that of its label, or of the volume.
    space : {"ras", "lps"}
        Axes of an OBJ or 3MF, which are in mm. A GLB is in meters with Y up, as glTF has it.
    shown : str
        Name of the map whose colors are shown; empty for plain colors.
    explode : float
        Shift of the structure that is farthest from the common center in an exploded view, mm; a GLB or HTML page
        holds it beside the vertices.

    Raises
    ------
    OutputError
        For another suffix, a place that cannot be written to, or an exploded view in an OBJ or 3MF.
    """
    from .files.structures import write_structures

    write_structures(path, structures_of(results, names, shown=shown), space, explode)
