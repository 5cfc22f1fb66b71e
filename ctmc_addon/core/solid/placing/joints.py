# SPDX-License-Identifier: GPL-3.0-or-later
"""Place the pegs of a cut through several solids; every joint, between two sides of the other cuts, has its own pegs.

Points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from numpy.typing import NDArray

from ...errors import SettingsError
from ...progress import Steps
from ..fields.depth import Depth
from ..fields.shapes import HalfSpace, Shape
from ..request import SolidRequest
from .pegs import PlacedPegs, heights_of, placed_pegs_steps


@dataclass(frozen=True)
class Joined:
    """A solid whose parts are joined by pegs.

    Parameters
    ----------
    depth : Depth
        Depth below its surface.
    extent : (n, 3)
        Points such as the vertices of a mesh; the solid lies within their hull, grown by `beyond` mm.
    beyond : float
    is_hollow : bool
        Whether pegs stay near the surface.
    """

    depth: Depth
    extent: NDArray[Any]
    beyond: float = 0.0
    is_hollow: bool = False


@dataclass(frozen=True)
class CutPegs:
    """Pegs of one cut.

    Parameters
    ----------
    placed : tuple of (int, PlacedPegs)
        Pegs of every joint, with the number of its solid.
    refused : tuple of (int, SettingsError)
        Errors of joints in which no peg fits, with the number of the solid.
    """

    placed: tuple[tuple[int, PlacedPegs], ...]
    refused: tuple[tuple[int, SettingsError], ...]


def cut_pegs_steps(
    solid: SolidRequest, number: int, solids: Sequence[Joined], avoid: Sequence[Shape]
) -> Steps[CutPegs]:
    """Place the pegs of a cut.

    Parameters
    ----------
    solid : SolidRequest
        Has cuts and pegs.
    number : int
        Number of the cut.
    solids : sequence of Joined
    avoid : sequence of Shape
        Holes placed before.
    """
    assert solid.pegs is not None, "the request has pegs"
    cut, planes = solid.cuts[number], [HalfSpace(cut.point, cut.normal) for cut in solid.cuts]
    other_sides = [(plane, plane.turned) for plane in planes[:number] + planes[number + 1 :]]
    placed: list[tuple[int, PlacedPegs]] = []
    refused: list[tuple[int, SettingsError]] = []
    for at, joined in enumerate(solids):
        low, high = heights_of(cut, joined.extent, joined.beyond)
        if not low < 0 < high:
            continue
        beyond = max(0.0, joined.beyond)
        for sides in product(*other_sides):
            placing = placed_pegs_steps(
                cut, solid.pegs, joined.depth, sides, joined.extent, beyond, avoid, joined.is_hollow
            )
            try:
                placed.append((at, (yield from placing)))
            except SettingsError as error:
                refused.append((at, error))
    return CutPegs(tuple(placed), tuple(refused))
