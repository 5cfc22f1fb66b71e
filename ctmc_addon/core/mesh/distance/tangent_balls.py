# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest ball that touches a surface at each vertex and has no other part of the surface inside.

A ball that touches the surface at p, where n points to the ball's side, and passes through q has the radius

    r(p, q) = d² / (2 n·d)    with d = q - p,

so the largest ball with nothing inside has the least of these radii: what shrinking balls (Ma et al. 2010,
doi:10.1007/s00371-010-0494-y) come to by asking for the nearest neighbor of one center after the other. Here a branch
and bound asks once. Near p the quotient is made of noise, so q is chosen by the least of

    d² / (2 (n·d - slope |d| - depth)),

which is large for what lies low over the tangent plane, and which is without effect on r at q. (Ma et al. and Peters
2018 stop at a least angle instead, beyond which they find no value.) The surface at q is its tangent plane there, with
normal m, so the ball that touches both planes counts:

    r = (p - q)·m / (1 - n·m),

unless it touches the plane of q far from q, as at a sharp edge.

Neighbors have nearly the same answer, so samples are searched from coarse to fine and begin with that of a neighbor.
A ball may be too large by `TOLERANCE` before it meets its tangent plane. Positions and results in one unit.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Doubles, Flags, Floats, Indices
from ...machine.parallel import map_steps
from ...progress import PAUSE, Steps
from ..vectors import dot
from .patch_tree import BRANCH, PATCH, PatchTree

SLOPE = 0.12  # Normals of a field are off by up to about this, 7 degrees.
TRIANGLE_SLOPE = 0.3  # Normals that are means of triangles are off by up to about this, 17 degrees.
DEPTH = 0.05  # Of the samples' distance.
TOLERANCE = 0.01  # Of the radius.
ROUNDING = np.float32(1 + 1e-5)
GROUP = 16  # Search for this many places at once.
COARSER = 16  # Search every place of this many first, then those between.
BLOCK = 2048  # Places that are searched for at once.
COARSE_BLOCK = 256  # The same among the coarser ones, whose neighbors say less: a place has more pairs.
TESTED = 1 << 15  # Pairs of a place and a patch whose discs are tested at once.
PAIRS = 2048  # Pairs of a place and a patch whose samples are measured at once: they stay in the cache.
FAR = 1.5  # The plane of a sample counts up to this many of the samples' distances from it.
CAP = 2.0  # Times the limit: the radius with slope and depth is larger than the ball.
FIRST_TRY = 4.0  # Without a neighbor, begin with this many times the distance of samples as radius.
NEXT_TRY = 4.0  # Times the last one.
NEIGHBORS_TRY = 1.5  # Times the radius of the neighbors.
Hints = tuple[Indices, Floats]  # What balls meet, -1 for nothing, and their radii.


class TangentBalls:
    """Search for the largest balls that touch the samples of a tree, on the side that its normals point to.

    Parameters
    ----------
    tree : PatchTree
    gap : float
        Usual distance of neighboring samples.
    limit : float
        Radius up to which to look.
    slope : float
        Points that lie lower above the tangent plane, over their distance, limit no ball.
    """

    def __init__(self, tree: PatchTree, gap: float, limit: float, slope: float = SLOPE) -> None:
        self.tree, self.limit, self._slope = tree, limit, np.float32(slope)
        self.gap = max(gap, 1e-6 * limit) or 1.0  # Triangles without area have none.
        self._depth = np.float32(DEPTH * self.gap)
        self._radius = np.full(len(tree.order), CAP * limit, np.float32)  # with slope and depth
        self._other = np.full(len(tree.order), -1, np.int64)  # place that the ball meets

    def radii_steps(self, asked: Flags, threads: int) -> Steps[Doubles]:
        """Return the radius at each place, (n,) float64: NaN beyond the limit, and where it was not asked for.

        Parameters
        ----------
        asked : (n,) bool
            By place.
        threads : int
        """
        places = np.flatnonzero(asked)
        radii = np.full(len(asked), np.nan)
        strides = [1]
        while strides[-1] * COARSER < len(places):
            strides.append(strides[-1] * COARSER)
        hints = (np.zeros(0, np.int64), np.zeros(0, np.float32))
        for stride in reversed(strides):
            now = places[::stride]
            at_once = BLOCK if stride == 1 else COARSE_BLOCK
            blocks = [slice(start, start + at_once) for start in range(0, len(now), at_once)]

            def search(block: slice, places: Indices = now, hints: Hints = hints, fine: bool = stride == 1) -> None:
                self._search(places[block], hints, block.start, GROUP if fine else 1)
                if fine:
                    radii[places[block]] = self._touching(places[block])

            for step in map_steps(search, blocks, threads, batches=max(1, len(blocks))):
                yield step if stride == 1 else PAUSE
            hints = self._other[now], self._radius[now]  # copies: threads change the originals
        return radii

    def facing(self, places: Indices) -> Floats:
        """Return the cosines between the normals at places and at what their balls meet, -1 where that faces them.

        NaN where a ball meets nothing. `radii_steps` has run.
        """
        limiting = self._other[places]
        cosines = dot(self.tree.normals[:, places], self.tree.normals[:, limiting])
        return np.where(limiting >= 0, cosines, np.float32(np.nan))

    def _search(self, places: Indices, hints: Hints, start: int, group: int) -> None:
        """Search for places, the first of them number `start`.

        `hints` has what every `COARSER`th ball meets, and its radius. Balls are tried from small to large: what limits
        a ball of the radius tried limits larger ones too.
        """
        limiting, radii = hints
        tried = np.full(len(places), FIRST_TRY * self.gap, np.float32)
        if len(limiting):
            number = (np.arange(len(places)) + start) // COARSER
            for step in (0, 1):
                neighbor = np.minimum(number + step, len(limiting) - 1)
                has_hint = np.flatnonzero(limiting[neighbor] >= 0)
                self._measure(places[has_hint], limiting[neighbor[has_hint]] // PATCH)
                tried[has_hint] = np.maximum(tried[has_hint], radii[neighbor[has_hint]] * np.float32(NEIGHBORS_TRY))
        while len(places):
            self._try(places, tried, group)
            larger = np.flatnonzero(self._radius[places] > tried)
            places, tried = places[larger], tried[larger] * np.float32(NEXT_TRY)

    def _try(self, places: Indices, tried: Floats, group: int) -> None:
        """Find what limits the balls of places, up to the radius tried for each."""
        members = np.minimum(np.arange(-(-len(places) // group) * group), len(places) - 1).reshape(-1, group)
        pair_group, patch = self._near_patches(places[members], tried[members])
        number, patch = members[pair_group].ravel(), np.repeat(patch, group)
        # The patch deepest in its ball shrinks it, so that most other patches need not be measured.
        inside, number, patch = self._inside(places, tried, number, patch)
        if not len(number):
            return
        order = np.argsort(number, kind="stable")
        inside, number, patch = inside[order], number[order], patch[order]
        first = np.flatnonzero(np.diff(number, prepend=-1))
        deepest = inside == np.repeat(np.minimum.reduceat(inside, first), np.diff(first, append=len(number)))
        self._measure(places[number[deepest]], patch[deepest])
        _, number, patch = self._inside(places, tried, number[~deepest], patch[~deepest])
        self._measure(places[number], patch)

    def _near_patches(self, places: Indices, tried: Floats) -> tuple[Indices, Indices]:
        """Return pairs of a group of places (g, k) and a patch that may limit a ball of the group."""
        tree = self.tree
        position, normal = tree.positions[:, places], tree.normals[:, places]  # (3, g, k)
        radius = np.minimum(self._radius[places], tried) * np.float32(1 - TOLERANCE)
        centers = position + normal * radius
        center = _middle(centers)
        apart = _length(centers - center[..., None]).max(axis=1)
        largest = radius.max(axis=1)
        middle = _middle(position)
        offset = position - middle[..., None]
        mean = normal[..., 0].copy()
        for number in range(1, places.shape[1]):
            mean += normal[..., number]
        mean /= np.maximum(_length(mean), np.float32(1e-6))
        spread = _length(normal - mean[..., None]).max(axis=1)
        lowest = dot(offset, normal).min(axis=1)
        size = _length(offset).max(axis=1)
        group = np.repeat(np.arange(len(places)), tree.levels[-1].shape[1])
        disc = np.tile(np.arange(tree.levels[-1].shape[1]), len(places))
        for level in range(len(tree.levels) - 1, -1, -1):
            discs = tree.levels[level].take(disc, axis=1)
            height, distance, extent = _over_plane(discs, middle.take(group, axis=1), mean.take(group, axis=1))
            height += spread.take(group) * (distance + extent) - lowest.take(group)
            allowed = self._slope * np.maximum(distance - extent - size.take(group), 0) + self._depth
            near = np.flatnonzero(height >= allowed)
            group, disc, discs = group[near], disc[near], discs.take(near, axis=1)
            radii = largest.take(group)
            reach = np.sqrt(np.maximum(radii * (radii - 2 * allowed[near]), 0)) + apart.take(group)
            near = np.flatnonzero(_squared_from(discs, center.take(group, axis=1)) < reach * reach * ROUNDING)
            group, disc = group[near], disc[near]
            if level:
                group = np.repeat(group, BRANCH)
                disc = (disc[:, None] * BRANCH + np.arange(BRANCH)).ravel()
                there = disc < tree.levels[level - 1].shape[1]
                group, disc = group[there], disc[there]
        return group, disc

    def _inside(
        self, places: Indices, tried: Floats, number: Indices, patch: Indices
    ) -> tuple[Floats, Indices, Indices]:
        """Return the pairs whose patch may limit the ball: how near its disc is, less is deeper, and the pairs.

        Parameters
        ----------
        places, tried : (n,)
        number, patch : (pairs,) int64
            Number of the place in `places`, and the patch.
        """
        kept = [
            self._inside_at_once(places, tried, number[start : start + TESTED], patch[start : start + TESTED])
            for start in range(0, max(1, len(number)), TESTED)
        ]
        inside, number, patch = (np.concatenate(parts) for parts in zip(*kept, strict=True))
        return inside, number, patch

    def _inside_at_once(
        self, places: Indices, tried: Floats, number: Indices, patch: Indices
    ) -> tuple[Floats, Indices, Indices]:
        place = places[number]
        position, normal = self.tree.positions.take(place, axis=1), self.tree.normals.take(place, axis=1)
        discs = self.tree.levels[0].take(patch, axis=1)
        height, distance, extent = _over_plane(discs, position, normal)
        allowed = self._slope * np.maximum(distance - extent, 0) + self._depth
        near = np.flatnonzero(height >= allowed)
        number, patch = number[near], patch[near]
        radius = np.minimum(self._radius.take(place[near]), tried.take(number)) * np.float32(1 - TOLERANCE)
        center = position.take(near, axis=1) + normal.take(near, axis=1) * radius
        beyond = _squared_from(discs.take(near, axis=1), center)
        beyond -= radius * (radius - 2 * allowed[near]) * ROUNDING
        near = np.flatnonzero(beyond < 0)
        return beyond[near], number[near], patch[near]

    def _measure(self, place: Indices, patch: Indices) -> None:
        """Shrink the balls of places by the samples of patches; the places never fall."""
        tree = self.tree
        for start in range(0, len(place), PAIRS):
            at, of = place[start : start + PAIRS], patch[start : start + PAIRS]
            offset = tree.patches.take(of, axis=2)  # (3, 16, pairs)
            offset -= tree.positions.take(at, axis=1)[:, None]
            normal = tree.normals.take(at, axis=1)
            height = offset[0] * normal[0]
            height += offset[1] * normal[1]
            height += offset[2] * normal[2]
            offset *= offset
            squared = offset[0]
            squared += offset[1]
            squared += offset[2]
            height -= np.sqrt(squared) * self._slope
            height -= self._depth
            height *= 2
            # A sample that lies too low gets a huge radius instead of a mask.
            np.maximum(squared, self._depth * self._depth * np.float32(0.01), out=squared)
            np.maximum(height, self._depth * np.float32(1e-12), out=height)
            squared /= height
            least = squared.min(axis=0)
            better = np.flatnonzero(least < self._radius.take(at))
            if not len(better):
                continue
            at, least = at[better], least[better]
            sample = (squared[:, better] == least).argmax(axis=0) + of[better] * PATCH
            # Of the pairs of one place the last one written counts: the least, and of equals the first.
            order = np.lexsort((np.arange(len(at))[::-1], -least))
            self._radius[at[order]], self._other[at[order]] = least[order], sample[order]

    def _touching(self, places: Indices) -> Doubles:
        """Return the radii of the balls that touch the tangent planes at places and at what they meet."""
        limiting = self._other[places]
        n, m = self.tree.normals[:, places].astype(np.float64), self.tree.normals[:, limiting].astype(np.float64)
        offset = self.tree.positions[:, limiting].astype(np.float64) - self.tree.positions[:, places]
        radius = dot(offset, offset) / np.maximum(2 * dot(offset, n), 1e-300)
        facing = 1 - dot(n, m)
        planar = -dot(offset, m) / np.where(facing > 0, facing, 1)
        touched = planar * (n - m) - offset
        planar_too = (facing > 0) & (planar > 0) & (dot(touched, touched) < (FAR * self.gap) ** 2)
        radius = np.where(planar_too, planar, radius)
        return np.where((limiting >= 0) & (radius <= self.limit), radius, np.nan)


def _middle(points: Floats) -> Floats:
    """Return the middles of the boxes around points (3, g, k), (3, g)."""
    return (points.min(axis=2) + points.max(axis=2)) * np.float32(0.5)


def _length(vectors: Floats) -> Floats:
    return np.sqrt(dot(vectors, vectors))


def _squared_from(discs: Floats, point: Floats) -> Floats:
    """Return the squared distances of points from discs (8, n)."""
    offset = point - discs[:3]
    height = dot(offset, discs[3:6])
    aside = dot(offset, offset) - height * height
    aside = np.maximum(np.sqrt(np.maximum(aside, 0)) - discs[7], 0)
    height = np.maximum(np.abs(height) - discs[6], 0)
    return aside * aside + height * height


def _over_plane(discs: Floats, point: Floats, normal: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the largest height of discs over planes, the distance of their centers from the point, and their size."""
    offset = discs[:3] - point
    along = np.abs(dot(discs[3:6], normal))
    height = dot(offset, normal) + along * discs[6] + np.sqrt(np.maximum(1 - along * along, 0)) * discs[7]
    return height, _length(offset), discs[6] + discs[7]
