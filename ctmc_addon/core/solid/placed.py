# SPDX-License-Identifier: GPL-3.0-or-later
"""Place pegs and drains on surfaces before a solid is made, to show them.

They are placed as in the finished solid, but its surfaces do not exist yet: depths are thickened and combined instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Doubles
from ..errors import SettingsError
from ..mesh.distance.signed_distance import SignedSurface
from ..progress import Steps
from .fields.depth import Depth, depth_below
from .fields.shapes import Bar, Shape
from .placing.drains import drains_steps
from .placing.joints import Joined, cut_pegs_steps
from .request import Combination, Combining, SolidRequest
from .structure import shared_drains_steps


@dataclass(frozen=True)
class PlacedBars:
    """Pegs or drains of a solid.

    Parameters
    ----------
    bars : tuple of Bar
        RAS+ mm; the round ends lie beyond the ends of the axes.
    notes : tuple of str
        Sentences for the user about pegs and drains that do not fit.
    """

    bars: tuple[Bar, ...] = ()
    notes: tuple[str, ...] = ()


def placed_drains_steps(
    surfaces: Mapping[str, SignedSurface], solid: SolidRequest, threads: int | None = None
) -> Steps[PlacedBars]:
    """Place the drains of a solid.

    Parameters
    ----------
    surfaces : mapping of str to SignedSurface
        Closed surfaces by the structure's name; coarse surfaces give positions nearby.
    solid : SolidRequest
    threads : int, optional
    """
    bars: list[Bar] = []
    notes: list[str] = []
    shared = yield from shared_drains_steps(list(surfaces.values()), solid.drains)
    for own, surface in zip(shared, surfaces.values(), strict=True):
        below = depth_below(surface, solid.thicken, threads=threads)
        for drain in own:
            try:
                placed = yield from drains_steps([drain], surface, below, solid.hollow, solid.thicken)
            except SettingsError as error:
                notes.append(str(error))
                continue
            bars += placed.bars
            notes += placed.notes
    return PlacedBars(tuple(bars), tuple(dict.fromkeys(notes)))


def placed_cuts_pegs_steps(
    surfaces: Mapping[str, SignedSurface], solid: SolidRequest, drains: Sequence[Bar], threads: int | None = None
) -> Steps[PlacedBars]:
    """Place the pegs of all cuts where they avoid the drains; a hole has the axis of its peg."""
    if solid.pegs is None:
        return PlacedBars()
    bars: list[Bar] = []
    notes: list[str] = []
    solids, avoid = _joined(surfaces, solid, threads), list[Shape](drains)
    for number in range(len(solid.cuts)):
        cut_pegs = yield from cut_pegs_steps(solid, number, solids, avoid)
        if cut_pegs.refused and not cut_pegs.placed:
            notes.append(str(cut_pegs.refused[0][1]))
        for _, placed in cut_pegs.placed:
            bars += placed.bars
            avoid.append(placed.holes)
            notes += placed.notes
    return PlacedBars(tuple(bars), tuple(dict.fromkeys(notes)))


def _joined(surfaces: Mapping[str, SignedSurface], solid: SolidRequest, threads: int | None) -> list[Joined]:
    """Return the solids that pegs stand on."""
    assert solid.pegs is not None, "the request has pegs"
    shaped = bool(solid.combinations)
    joined = {}
    for name, surface in surfaces.items():
        # Combined hollows have no material around pegs except their walls.
        depth = depth_below(surface, solid.thicken, solid.hollow if shaped else 0.0, threads)
        joined[name] = Joined(depth, surface.mesh.vertices, solid.thicken, solid.hollow > 0 and not shaped)
    for combination in solid.combinations:
        members = [joined.pop(name) for name in combination.of if name in joined]
        if members:
            joined[combination.name] = _combined(combination, members)
    return list(joined.values())


def _combined(combination: Combination, members: Sequence[Joined]) -> Joined:
    """Return the solid of a combination."""

    def depth_steps(points: Doubles) -> Steps[Doubles]:
        out = yield from members[0].depth(points)
        for member in members[1:]:
            distances = yield from member.depth(points)
            if combination.how is Combining.MERGE:
                out = np.maximum(out, distances)
            else:
                out = np.minimum(out, distances if combination.how is Combining.INTERSECT else -distances)
        return out

    depth: Depth = depth_steps
    whole = members if combination.how is Combining.MERGE else members[:1]
    return Joined(depth, np.concatenate([each.extent for each in whole]), members[0].beyond)
