# SPDX-License-Identifier: GPL-3.0-or-later
"""Check whether parts stand: their centers of mass, the points they rest on, and pieces that hang above.

Lengths are in mm, positions RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles
from ...measures.units import mm_text
from ...mesh.labels.label_complex import ComplexMesh, bordering
from ...mesh.topology import FACES_PER_STEP, compacted, component_numbers_steps, components_of_vertices
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import PAUSE, Steps
from ..fields.lattice import Lattice
from ..fields.shapes import Bar, HalfSpace
from ..request import Point
from .foot import Foot, foot_steps, outline_of
from .rounding import rounded_up

LEVEL = 1 - 1e-6  # A plane is level if its unit normal points up by more than this: within 0.08 degrees.
RESTING = 0.05  # Vertices up to this share of a step above the lowest point rest on the ground.


@dataclass(frozen=True, eq=False)
class Pieces:
    """The components of a closed mesh, including cavities.

    Parameters
    ----------
    of_vertex : (v,) int32
        Number of each vertex's component.
    volumes : (n,) float64
        Enclosed volume, below 0 for a cavity.
    low, high : (n,) float64
        Range of each along z.
    center : (x, y, z) float
        Center of mass of all components.
    """

    of_vertex: NDArray[np.int32]
    volumes: Doubles
    low: Doubles
    high: Doubles
    center: Point


def pieces_steps(mesh: TriangleMesh) -> Steps[Pieces]:
    """Measure the components of a closed mesh with at least one triangle."""
    component = yield from component_numbers_steps(mesh.faces, len(mesh.vertices))
    count = int(component.max()) + 1
    middle = mesh.vertices.mean(axis=0, dtype=np.float64)
    sums = np.zeros((4, count))  # 6 times the volume, and 24 times the volume times its center.
    for start in range(0, len(mesh.faces), FACES_PER_STEP):
        block = slice(start, start + FACES_PER_STEP)
        a, b, c = (mesh.vertices[mesh.faces[block, corner]].T - middle[:, None] for corner in range(3))
        sixfold = (
            a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        for row, weights in enumerate([sixfold, *(sixfold * (a + b + c))]):
            sums[row] += np.bincount(component[block], weights, count)
        yield PAUSE
    of_vertex = components_of_vertices(mesh.faces, component, len(mesh.vertices))
    heights = mesh.vertices[:, 2].astype(np.float64)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, of_vertex, heights)
    np.maximum.at(high, of_vertex, heights)
    total = np.cumsum(sums, axis=1)[:, -1]
    x, y, z = (middle + total[1:] / (4 * total[0] or 1.0)).tolist()
    return Pieces(of_vertex, sums[0] / 6, low, high, (x, y, z))


def _outside_rest(vertices: NDArray[np.float32], center: Point, near: float) -> float:
    """Return how far a center of mass lies outside the vertices (v, 3) `near` the lowest one; below 0 inside."""
    heights = vertices[:, 2]
    resting = vertices[heights <= heights.min() + near, :2].T.astype(np.float64)
    return float((outline_of(np.array(center[:2])[:, None]) - outline_of(resting)).max())


@dataclass(frozen=True, eq=False)
class Feet:
    """The feet of parts.

    Both mappings have the number of a part as key.

    Parameters
    ----------
    lattice : Lattice
    shapes : dict of int to Foot
    level : dict of int to float
        Height of the level cut on which a part without a foot stands.
    """

    lattice: Lattice
    shapes: dict[int, Foot]
    level: dict[int, float]


def feet_steps(
    mesh: ComplexMesh,
    base: float,
    lattice: Lattice,
    sides: Callable[[int], Iterable[tuple[HalfSpace, float]]],
    holes: Callable[[int], Iterable[Bar]],
    is_single: bool,
) -> Steps[Feet]:
    """Make a foot for every part that does not stand on a level cut.

    Parameters
    ----------
    mesh : ComplexMesh
        Parts without feet and pegs.
    base : float
        Height of a foot, mm.
    lattice : Lattice
    sides : callable
        Returns the planes that bound a part, each with 1.0 if the part is on the side of its normal, else -1.0.
    holes : callable
        Returns the drains of a part.
    is_single : bool
        Whether all parts belong to one structure.
    """
    feet = Feet(lattice, {}, {})
    for part in mesh.labels:
        own = mesh.of_label(part)
        pieces = yield from pieces_steps(own)
        foot = yield from foot_steps(own, pieces.center, base, lattice, is_single)
        near, lowest = RESTING * lattice.shortest_mm, float(pieces.low.min())
        is_level = any(
            sign * plane.unit[2] > LEVEL and abs(plane.point[2] - lowest) < near for plane, sign in sides(part)
        )
        if is_level and _outside_rest(own.vertices, pieces.center, near) < 0:
            feet.level[part] = lowest
        else:
            feet.shapes[part] = foot.with_holes(holes(part))
    return feet


def stood_steps(mesh: ComplexMesh, feet: Feet) -> Steps[tuple[ComplexMesh, NDArray[np.intp], dict[int, list[str]]]]:
    """Remove pieces cut off from feet by other parts, and note which parts have no foot or do not stand.

    Parameters
    ----------
    mesh : ComplexMesh
        The parts, with feet and pegs.
    feet : Feet

    Returns
    -------
    mesh : ComplexMesh
    kept : (f,) int
        Numbers of the triangles that are left, rising.
    notes : dict of int to list of str
        By the number of the part.
    """
    sides, notes = mesh.sides.copy(), {}
    for part in mesh.labels:
        border = bordering(mesh.faces, mesh.sides, part)
        vertices = mesh.vertices[border.used]
        pieces = yield from pieces_steps(TriangleMesh(vertices, border.faces))
        foot, near = feet.shapes.get(part), RESTING * feet.lattice.shortest_mm
        loose = np.zeros(len(pieces.volumes), np.bool_)
        if foot is not None:
            loose = (pieces.volumes > 0) & (pieces.low >= foot.low - near) & (pieces.high <= foot.high + near)
            loose[pieces.volumes.argmax()] = False
            numbers = np.flatnonzero((mesh.sides == part).any(axis=1))[loose[pieces.of_vertex[border.faces[:, 0]]]]
            sides[numbers] = np.where(mesh.sides[numbers] == part, 0, sides[numbers])
        yield PAUSE
        resting = vertices[~loose[pieces.of_vertex]]
        outside_mm = _outside_rest(resting, pieces.center, near)
        notes[part] = list(_notes(pieces, outside_mm, feet, part))
    kept = np.flatnonzero(sides[:, 0] != sides[:, 1])
    if len(kept) < len(sides):
        used, faces = compacted(mesh.faces[kept], len(mesh.vertices))
        mesh = ComplexMesh(mesh.vertices[used], faces, sides[kept])
    return mesh, kept, notes


def _notes(pieces: Pieces, outside: float, feet: Feet, part: int) -> Iterator[str]:
    """Yield notes on how a part stands."""
    foot = feet.shapes.get(part)
    low = feet.level[part] if foot is None else foot.low
    rest = "level cut" if foot is None else "foot"
    below = low - float(pieces.low.min())
    if below > feet.lattice.shortest_mm / 2:
        yield (
            f"The pegs reach {mm_text(below, 3)} below the {rest}; "
            "flip the normal of the cut, so that the other part has the pegs."
        )
    elif foot is None:
        yield "The part stands on its level cut and has no foot."
    elif outside > 0:
        yield (
            f"The part does not stand: its center of mass lies {mm_text(outside, 3)} outside its foot, and a cut or "
            "another part leaves no room for a wider one; lay it on its cut, or make the cut level."
        )
    top = low + RESTING * feet.lattice.shortest_mm if foot is None else foot.high
    hanging = pieces.low[(pieces.volumes > 0) & (pieces.low > top)]
    if len(hanging):
        reach = rounded_up(float(hanging.max()) - low + feet.lattice.shortest_mm / 4)
        more = f"above the {rest}; --keep-parts 1 leaves out small pieces, --base {reach:g} reaches all."
        yield f"1 piece hangs {more}" if len(hanging) == 1 else f"{len(hanging)} pieces hang {more}"
