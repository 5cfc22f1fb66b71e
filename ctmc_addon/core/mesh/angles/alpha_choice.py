# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest alpha at which no triangle of a surface has an angle below a given one.

Toward the midpoints, triangles become more even and the surface less accurate, so the largest such alpha costs least. A
triangle's smallest angle is a smooth function of alpha in pieces, and neither rises nor falls throughout. So alphas are
tested on a grid of thousandths, with the float32 positions of the surface there: the result is the same as after trying
every number by hand.

A few triangles, the witnesses, rule out most alphas: their smallest angle is computed at every alpha of the grid. The
largest alpha that they allow is tested on the whole surface. Triangles below the angle there become witnesses, until
there are none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arithmetic import tangent
from ...measures.units import length_text
from ...progress import PAUSE, Step, Steps, WithResult
from ..pieces.completed_pieces import with_next_steps
from ..topology import FACES_PER_STEP
from ..triangle_mesh import Pieces, Surface, blend
from .triangle_angles import degrees_of, doubled_areas, smallest_tangents, squared_length, squared_sides

STEPS = 1000
"""Tested alphas are whole numbers divided by this."""
ALPHAS_AT_ONCE = 64
WITNESSES = 64  # Follow this many triangles over all alphas at once.


@dataclass(frozen=True)
class AlphaChoice:
    """An alpha that was chosen from a surface, and its cost.

    Parameters
    ----------
    alpha : float
        A whole number of thousandths.
    min_angle_deg : float
        The angle that was asked for, degrees.
    smallest_angle_deg : float
        The smallest angle of the full surface at `alpha`, degrees. Where no alpha reaches the angle that was asked for,
        the alpha is the one at which this is largest.
    mean_mm, largest_mm : float
        Distance between the position of a vertex at `alpha` and at alpha 1, mean over the vertices and largest. No
        point of the surface is farther from the surface at alpha 1 than the largest.
    """

    alpha: float
    min_angle_deg: float
    smallest_angle_deg: float
    mean_mm: float
    largest_mm: float

    @property
    def reached(self) -> bool:
        """Whether no triangle has an angle below the one that was asked for."""
        return self.smallest_angle_deg >= self.min_angle_deg

    def sentence(self) -> str:
        """Return the chosen alpha and what it costs, in words."""
        cost = (
            f"compared with alpha 1 its vertices move by {length_text(self.mean_mm, 3)} on average and "
            f"{length_text(self.largest_mm, 3)} at most"
        )
        if self.reached:
            return (
                f"Alpha {self.alpha:g} was chosen: the largest at which no triangle of the full surface has an angle "
                f"below {self.min_angle_deg:g} degrees; {cost}."
            )
        return (
            f"No alpha keeps every angle at {self.min_angle_deg:g} degrees or more: the best is "
            f"{self.smallest_angle_deg:.3g} degrees at alpha {self.alpha:g}, which was taken; {cost}."
        )

    def report(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "alpha": self.alpha,
            "min_angle_deg": self.min_angle_deg,
            "reached": self.reached,
            "smallest_angle_deg": self.smallest_angle_deg,
            "mean_mm": self.mean_mm,
            "largest_mm": self.largest_mm,
        }


def chosen_alpha_steps(one_pass: Callable[[], Pieces], min_angle_deg: float, most: float = 1.0) -> Steps[AlphaChoice]:
    """Choose the largest alpha at which no triangle has a smaller angle; if there is none, that with the best angle.

    Parameters
    ----------
    one_pass : callable
        Gives the pieces of a surface in mm from the first to the last, as often as it is called.
    min_angle_deg : float
        Degrees.
    most : float
        Larger alphas are not tested.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> from ctmc_addon.core.mesh.triangle_mesh import replayed_steps
    >>> linear = np.array([[0, 0, 0], [2, 0, 0], [0, 0.125, 0]], np.float32)
    >>> midpoints = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0]], np.float32)
    >>> surface = Surface(midpoints, linear, np.array([[0, 1, 2]], np.int32))
    >>> choice = finish(chosen_alpha_steps(lambda: replayed_steps([surface]), 5.0))
    >>> choice.alpha, round(choice.smallest_angle_deg, 2), round(choice.largest_mm, 6)
    (0.973, 5.02, 0.050625)
    """
    search, moved = _Search(min_angle_deg, most), _Moved()
    count = unchanged = passes = 0
    while not passes or unchanged < count:
        pieces = WithResult(with_next_steps(one_pass()))
        for item in pieces:
            if isinstance(item, Step):
                yield Step(1.0 - 0.5**passes + 0.5 ** (passes + 1) * item.fraction)
                continue
            piece = _piece(*item)
            if not passes:
                count += 1
                moved.add(piece)
            changed = yield from search.look_steps(piece)
            unchanged = 1 if changed else unchanged + 1
            if passes and unchanged >= count:
                break
        passes += 1
    alpha, back = search.alpha, 1.0 - search.alpha
    return AlphaChoice(alpha, min_angle_deg, search.smallest_angle_deg, back * moved.mean, back * moved.largest)


def kept_alpha_steps(pass_at: Callable[[float], Pieces], min_angle_deg: float) -> Steps[AlphaChoice]:
    """Choose alpha for a surface without small components, whose choice depends on alpha too, if little.

    `pass_at` returns the pieces that are kept at an alpha. The choice is repeated with them until it does not change.
    """
    most = 1.0
    while True:
        choice = yield from chosen_alpha_steps(partial(pass_at, most), min_angle_deg, most)
        if choice.alpha == most:
            return choice
        most = choice.alpha


class _Piece(NamedTuple):
    """Vertices of a piece at both ends of alpha, with those of the next that its triangles use."""

    midpoints: NDArray[np.float32]
    linear: NDArray[np.float32]
    faces: NDArray[np.int32]
    own: int


class _Moved:
    """Sum of the distances between alpha 1 and alpha 0, added vertex by vertex so that cuts do not matter."""

    def __init__(self) -> None:
        self._sum = self.largest = 0.0
        self._count = 0

    @property
    def mean(self) -> float:
        return self._sum / max(1, self._count)

    def add(self, piece: _Piece) -> None:
        far = np.sqrt(squared_length(piece.linear[: piece.own].astype(np.float64) - piece.midpoints[: piece.own]))
        self._sum = float(np.cumsum(np.concatenate([[self._sum], far]))[-1])
        self._count += len(far)
        self.largest = max(self.largest, float(far.max(initial=0.0)))


class _Search:
    """The smallest angle of the witnesses at every alpha, and the alpha that they leave."""

    def __init__(self, min_angle_deg: float, most: float) -> None:
        self._limit = tangent(min_angle_deg)
        self._tangents = np.full(round(most * STEPS) + 1, math.inf)  # Of the witnesses, at every alpha.
        self._at = len(self._tangents) - 1
        self._smallest = math.inf  # Smallest tangent of the triangles tested at this alpha.

    @property
    def alpha(self) -> float:
        """The largest alpha at which no witness is below the angle, or else the best one."""
        return self._at / STEPS

    @property
    def smallest_angle_deg(self) -> float:
        """The smallest angle of all triangles, valid after a pass in which alpha has not changed."""
        return degrees_of(self._smallest)

    def look_steps(self, piece: _Piece) -> Steps[bool]:
        """Lower alpha until no triangle of a piece is below the angle; return whether alpha has changed."""
        before = self._at
        while True:
            below, smallest = yield from self._below_steps(piece)
            if not len(below):
                break
            while len(below):  # Most of these are below the angle at the next alpha too.
                self._add_witnesses(piece, below[:WITNESSES])
                below = self._sorted_below(piece, below)
                yield PAUSE
        changed = self._at != before
        self._smallest = smallest if changed else min(smallest, self._smallest)
        return changed

    @property
    def _needed(self) -> float:
        """The tangent that every triangle needs at the present alpha: none may be worse than the witnesses there."""
        return min(self._limit, float(self._tangents[self._at]))

    def _below_steps(self, piece: _Piece) -> Steps[tuple[NDArray[np.intp], float]]:
        """Return the triangles of a piece below the angle at this alpha, worst first, and the smallest tangent."""
        vertices = blend(piece.midpoints, piece.linear, self.alpha)
        numbers, tangents, smallest = [np.empty(0, np.intp)], [np.empty(0)], math.inf
        for start in range(0, len(piece.faces), FACES_PER_STEP):
            tangent = _tangents_at(vertices[piece.faces[start : start + FACES_PER_STEP]])
            smallest = min(smallest, float(tangent.min()))
            below = np.flatnonzero(tangent < self._needed)
            numbers.append(below + start)
            tangents.append(tangent[below])
            yield PAUSE
        return np.concatenate(numbers)[np.argsort(np.concatenate(tangents), kind="stable")], smallest

    def _sorted_below(self, piece: _Piece, faces: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return those of the triangles that are below the angle at this alpha, the worst first."""
        corners = piece.faces[faces]
        tangent = _tangents_at(blend(piece.midpoints[corners], piece.linear[corners], self.alpha))
        order = np.argsort(tangent, kind="stable")
        return faces[order[tangent[order] < self._needed]]

    def _add_witnesses(self, piece: _Piece, faces: NDArray[np.intp]) -> None:
        """Add triangles as witnesses, and set the largest alpha that all witnesses allow."""
        corners = piece.faces[faces]
        midpoints, linear = piece.midpoints[corners], piece.linear[corners]  # (w, 3, 3)
        for low in range(0, len(self._tangents), ALPHAS_AT_ONCE):
            tangents = self._tangents[low : low + ALPHAS_AT_ONCE]
            alphas = np.arange(low, low + len(tangents)) / STEPS
            mixed = (linear - midpoints) * alphas.astype(np.float32)[:, None, None, None]  # as `blend` does
            tangent = _tangents_at((mixed + midpoints).reshape(-1, 3, 3))
            np.minimum(tangents, tangent.reshape(len(tangents), -1).min(axis=1), out=tangents)
        reached = np.flatnonzero(self._tangents >= self._limit)
        best = np.flatnonzero(self._tangents == self._tangents.max())
        self._at = int((reached if len(reached) else best)[-1])


def _tangents_at(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Tangent of the smallest angle of every triangle, (f,), from its corners (f, 3, 3)."""
    a, b, c = (corners[:, corner].astype(np.float64) for corner in range(3))
    return smallest_tangents(doubled_areas((a, b, c)), squared_sides((a, b, c)))


def _piece(surface: Surface, following: Surface | None) -> _Piece:
    """Return a piece with those vertices of the following one that its triangles need."""
    own = len(surface.linear)
    beyond = int(surface.faces.max(initial=-1)) + 1 - own
    if beyond <= 0 or following is None:
        return _Piece(surface.midpoints, surface.linear, surface.faces, own)
    return _Piece(
        np.concatenate([surface.midpoints, following.midpoints[:beyond]]),
        np.concatenate([surface.linear, following.linear[:beyond]]),
        surface.faces,
        own,
    )
