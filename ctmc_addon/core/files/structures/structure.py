# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface with a name, a color and an opacity, as files hold it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Floats
from ...errors import OutputError
from ...mesh.face_normals import vertex_normals
from ..file_names import file_key, printable


@dataclass(frozen=True, eq=False)
class Structure:
    """A surface as a file of several holds it.

    Parameters
    ----------
    name : str
    vertices : (V, 3) float32
        RAS+ mm.
    faces : (F, 3) int32
        Counter-clockwise seen from outside.
    rgb : (red, green, blue) int
        sRGB, 0 to 255.
    opacity : float
        From 0, invisible, to 1.
    normals : (V, 3) float32 or None
        Unit length, pointing outside; without them a file gets the means of the triangles'.
    volume_mm3 : float or None
        Volume of a closed surface; None for an open one.
    """

    name: str
    vertices: Floats
    faces: NDArray[np.int32]
    rgb: tuple[int, int, int]
    opacity: float = 1.0
    normals: Floats | None = None
    volume_mm3: float | None = None

    @property
    def closed(self) -> bool:
        """Whether the surface encloses a volume."""
        return self.volume_mm3 is not None

    def vertex_normals(self) -> Floats:
        """The normals, made of the triangles where there are none, (V, 3)."""
        return vertex_normals(self.vertices, self.faces) if self.normals is None else self.normals


def as_structures(structures: Iterable[Structure], target: str) -> list[Structure]:
    """Return structures as a file holds them: with names on one line, all different.

    Raises
    ------
    OutputError
        If one has no triangles, or an opacity beyond 0 to 1.

    Examples
    --------
    >>> corner = np.eye(3, dtype=np.float32)
    >>> tissue = Structure("liver", corner, np.array([[0, 1, 2]], np.int32), (122, 28, 40))
    >>> [structure.name for structure in as_structures([tissue, tissue, replace(tissue, name="")], "a.glb")]
    ['liver', 'liver 2', 'structure']
    """
    out: list[Structure] = []
    taken: set[str] = set()
    for structure in structures:
        if not len(structure.faces):
            raise OutputError(f"{structure.name} has no triangles to write to {target}; leave it out")
        if not 0.0 <= structure.opacity <= 1.0:
            raise OutputError(f"the opacity {structure.opacity:g} of {structure.name} is not from 0 to 1")
        name = _unique(printable(structure.name) or "structure", taken)
        taken.add(file_key(name))
        out.append(replace(structure, name=name))
    return out


def _unique(name: str, taken: set[str]) -> str:
    """Return the name, with the first free number if it is taken."""
    number, unique = 1, name
    while file_key(unique) in taken:
        number += 1
        unique = f"{name} {number}"
    return unique


def hex_color(structure: Structure) -> str:
    """The color with its opacity as a web page writes it.

    Examples
    --------
    >>> corner = np.eye(3, dtype=np.float32)
    >>> hex_color(Structure("liver", corner, np.array([[0, 1, 2]], np.int32), (122, 28, 40), 0.6))
    '#7A1C2899'
    """
    return "#{:02X}{:02X}{:02X}{:02X}".format(*structure.rgb, round(structure.opacity * 255))


def total(counts: Sequence[int], most: int, target: str, what: str) -> int:
    """Return the sum of counts, or raise `OutputError` where a format holds fewer."""
    count = sum(counts)
    if count > most:
        raise OutputError(f"{target} can hold {most} {what}, and there are {count}; simplify the surfaces")
    return count
