# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface with a name, a color and an opacity, to be written to a file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Floats
from ...errors import OutputError
from ...maps.surface_map import SurfaceMap
from ...mesh.face_normals import vertex_normals
from ..file_names import file_key, printable
from ..map_names import require_values


@dataclass(frozen=True, eq=False)
class Structure:
    """A surface in a file that holds several.

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
    maps : tuple of SurfaceMap
        Values on the vertices.
    shown : str
        Name of the map whose colors are shown; `rgb` is shown where it is empty or no map has that name.
    shift : (x, y, z) float
        Shift in an exploded view, RAS+ mm; the vertices keep their positions in the patient.
    """

    name: str
    vertices: Floats
    faces: NDArray[np.int32]
    rgb: tuple[int, int, int]
    opacity: float = 1.0
    normals: Floats | None = None
    volume_mm3: float | None = None
    maps: tuple[SurfaceMap, ...] = ()
    shown: str = ""
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def shown_map(self) -> SurfaceMap | None:
        """The map whose colors are shown; None for the plain color."""
        return next((each for each in self.maps if each.name == self.shown), None) if self.shown else None

    @property
    def closed(self) -> bool:
        """Whether the surface encloses a volume."""
        return self.volume_mm3 is not None

    def vertex_normals(self) -> Floats:
        """Return the normals, made of the triangles where there are none, (V, 3)."""
        return vertex_normals(self.vertices, self.faces) if self.normals is None else self.normals


def as_structures(structures: Iterable[Structure], target: str) -> list[Structure]:
    """Return structures for a file, with different names of one line each.

    Maps with the same name get one range and ramp, so that their colors can be compared.

    Raises
    ------
    OutputError
        If one has no triangles, an opacity beyond 0 to 1, a map of another surface, or two maps of one name.

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
        require_values(structure.name, len(structure.vertices), structure.maps)
        twice = _first_twice(each.name for each in structure.maps)
        if twice is not None:
            raise OutputError(f"{structure.name} has two maps called {twice}; give one of them another name")
        name = _unique(printable(structure.name) or "structure", taken)
        taken.add(file_key(name))
        out.append(replace(structure, name=name))
    return _with_common_ranges(out)


def _with_common_ranges(structures: Sequence[Structure]) -> list[Structure]:
    """Return structures whose maps with the same name share the widest range and the ramp of the first."""
    first: dict[str, SurfaceMap] = {}
    for each in (each for structure in structures for each in structure.maps):
        seen = first.setdefault(each.name, each)
        low, high = min(seen.range[0], each.range[0]), max(seen.range[1], each.range[1])
        if (low, high) != seen.range:
            first[each.name] = replace(seen, range=(low, high))

    def common(each: SurfaceMap) -> SurfaceMap:
        range_, ramp = first[each.name].range, first[each.name].ramp
        return each if (each.range, each.ramp) == (range_, ramp) else replace(each, range=range_, ramp=ramp)

    return [
        replace(structure, maps=tuple(map(common, structure.maps))) if structure.maps else structure
        for structure in structures
    ]


def _first_twice(names: Iterable[str]) -> str | None:
    """Return the first name that is repeated, or None."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def _unique(name: str, taken: set[str]) -> str:
    """Return the name, with the first free number if it is taken."""
    number, unique = 1, name
    while file_key(unique) in taken:
        number += 1
        unique = f"{name} {number}"
    return unique


def hex_color(structure: Structure) -> str:
    """Return the color with its opacity as a web page writes it.

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
