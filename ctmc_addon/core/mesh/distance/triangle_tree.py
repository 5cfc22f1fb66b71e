# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact distance from points to the nearest triangle of a mesh.

The triangles are in Morton order (Morton 1966), so that neighbors in space are neighbors in memory, and every box
of the tree holds four boxes, or triangles, of the level below: box b holds 4 b to 4 b + 3. A point first tries two
triangles beside it in that order. The distance to the nearer of them is a bound, mostly a tight one. Then blocks of
points go down the tree level by level, as pairs of point and box; a pair is dropped when its box is farther than the
point's bound, or near the bottom the disc of its triangles (discs.py). The remaining pairs are measured exactly.

Of many points every 64th goes first, then every 16th and so on: what is nearest to those before and after a point in
Morton order bounds its own distance too.

Boxes are float32 about the mesh's middle, for speed, and a little too large, so that rounding drops no triangle.
Distances are float64. Positions in any one space; distances in its unit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags, Floats, Indices
from ...errors import MeshError
from ...machine.parallel import map_steps, worker_count
from ...progress import PAUSE, Steps, finish, timed_steps
from ..topology import FACES_PER_STEP
from ..triangle_mesh import TriangleMesh
from ..vectors import cross, dot
from .discs import BRANCH, HEIGHTS, discs_steps, squared_outside

BLOCK = 2048  # This many points go down the tree at once: their pairs stay in the cache.
CROWD = 16  # Improve the bounds once a point has more pairs than this.
MOST_PAIRS = 1 << 20  # Part the points of a block once there are more pairs.
STRIDES = (64, 16, 4, 1)  # Every 64th point goes first.
MARGIN = 2.0**-21  # Boxes are too large by this share of the mesh's extent: some units in the last place of float32.
BRANCH_BITS = 2
SLACK = 1 + 2.0**-18  # Widen a squared bound by this factor, for the same reason.
CODE_BITS = 21  # A coordinate has this many bits in a Morton code.


def distances(points: NDArray[Any], mesh: TriangleMesh) -> Doubles:
    """Distance from every point to the surface.

    Parameters
    ----------
    points : (n, 3)
        In the space of the mesh.
    mesh : TriangleMesh
        With at least one triangle.

    Returns
    -------
    (n,) float64
        To the nearest point of the nearest triangle.

    Raises
    ------
    MeshError
        If the mesh has no triangles.

    Examples
    --------
    >>> flat = TriangleMesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    >>> distances(np.array([[1.0, 0, 0], [1, 1, 1]]), flat).round(6)
    array([0.      , 1.154701])
    """
    return TriangleTree(mesh).distances(points)


class TriangleTree:
    """The triangles of a mesh, ready for many questions about distance; without a mesh, to be prepared in steps.

    Attributes
    ----------
    order : (F,) intp
        The faces in Morton order.
    corners : (3, 3, F) float64
        Corner, axis, triangle: in that order.
    """

    def __init__(self, mesh: TriangleMesh | None = None) -> None:
        if mesh is not None:
            finish(self.prepare_steps(mesh))

    def prepare_steps(self, mesh: TriangleMesh) -> Steps[None]:
        """Build the tree of a mesh."""
        if not len(mesh.faces):
            raise MeshError("no distance can be measured to a mesh without triangles; lower the threshold or reduction")
        low, high = mesh.vertices.min(axis=0).astype(np.float64), mesh.vertices.max(axis=0).astype(np.float64)
        extent = float((high - low).max())
        self._low, self._cells_per_unit = low, (2**CODE_BITS - 1) / (extent or 1.0)
        self._middle = ((low + high) / 2)[:, None]

        def middles(block: slice) -> Doubles:
            return mesh.vertices[mesh.faces[block]].sum(axis=1, dtype=np.float64) / 3.0

        codes = yield from self._codes_steps(len(mesh.faces), middles)
        self.order = yield from order_steps(codes)
        self._sorted_codes = codes[self.order]
        yield PAUSE
        self.corners = np.empty((3, 3, len(codes)))
        bounds = np.empty((2, 3, len(codes)), np.float32)  # lows and negative highs
        columns = np.ascontiguousarray(mesh.vertices.T)
        centered = (columns - self._middle).astype(np.float32)
        for start in range(0, len(codes), FACES_PER_STEP):
            block = slice(start, start + FACES_PER_STEP)
            numbers = np.ascontiguousarray(mesh.faces[self.order[block]].T)  # (3, f)
            for axis in range(3):
                self.corners[:, axis, block] = columns[axis].take(numbers)
                a, b, c = centered[axis].take(numbers)
                bounds[0, axis, block] = np.minimum(np.minimum(a, b), c)
                bounds[1, axis, block] = -np.maximum(np.maximum(a, b), c)
                yield PAUSE
        bounds -= np.float32(extent * MARGIN)
        self._levels: list[NDArray[np.float32]] = []  # bounds of every four boxes, (2, 3, boxes / 4, 4), upwards
        self._height = 0
        while bounds.shape[2] > 1 or not self._height:
            parents = -(-bounds.shape[2] // BRANCH)
            boxes = np.empty((2, 3, parents, BRANCH), np.float32)
            for side, axis in np.ndindex(2, 3):
                row = np.full(parents * BRANCH, np.inf, np.float32)  # no point is near what fills the last parent
                row[: bounds.shape[2]] = bounds[side, axis]
                boxes[side, axis] = row.reshape(parents, BRANCH)
                yield PAUSE
            if self._height >= HEIGHTS:
                self._levels.append(boxes)
            self._height += 1
            bounds = boxes.min(axis=3)
        self._discs = yield from discs_steps(self.corners, self._middle, extent)

    def distances(self, points: NDArray[Any], limit: float = np.inf) -> Doubles:
        """Distance from every point (n, 3) to the surface, (n,); inf where it is above the limit, which saves time."""
        return finish(self.distances_steps(points, limit, threads=1))

    def distances_steps(
        self, points: NDArray[Any], limit: float = np.inf, threads: int | None = None
    ) -> Steps[Doubles]:
        """Do what `distances` does, in steps, with `threads` threads, by default one for each processor."""
        return np.sqrt((yield from self.nearest_steps(points, limit, threads))[0])

    def nearest_steps(
        self, points: NDArray[Any], limit: float = np.inf, threads: int | None = None
    ) -> Steps[tuple[Doubles, Indices]]:
        """Squared distance from every point (n, 3) to the surface, (n,), and which of `corners` is nearest, (n,).

        inf and 0 where it is above the limit. Of equally near triangles the first.
        """
        points = np.asarray(points, np.float64).reshape(-1, 3)
        order = yield from self._order_of_steps(points)
        squared, triangle = np.empty(len(points)), np.zeros(len(points), np.int64)
        before, last = 0, 0  # The stride of the points that are done, and how many there are besides the first.
        for stride in STRIDES:
            places = np.arange(0, len(points), stride)
            places = places[places % before != 0] if before else places

            def measure(start: int, places: Indices = places, before: int = before, last: int = last) -> None:
                here = places[start : start + BLOCK]
                block, seeds = order[here], []
                if before:
                    low = here // before
                    seeds = [triangle[order[each * before]] for each in (low, np.minimum(low + 1, last))]
                nearest = self.nearest(np.ascontiguousarray(points[block].T), np.full(len(here), limit * limit), seeds)
                squared[block], triangle[block] = nearest

            blocks = range(0, len(places), BLOCK)
            work = map_steps(measure, blocks, worker_count(threads), "", batches=max(1, len(blocks)))
            yield from timed_steps(work, 1 / before if before else 0.0, 1 / stride)
            before, last = stride, (len(points) - 1) // stride
        return squared, triangle

    def largest_steps(self, points: NDArray[Any], least: float = 0.0, threads: int | None = None) -> Steps[float]:
        """The largest distance of the points (n, 3) to the surface, or `least` where none is larger.

        Points that are within `least` of a triangle beside them need not be measured, which saves most of the time.
        """
        largest = [least]

        def measure(points: Doubles, _: NDArray[np.intp]) -> None:
            bounds = self._bounds(points)
            most = max(largest)
            points = points[:, bounds > most * most]
            if points.size:
                squared, _ = self.nearest(points, np.full(points.shape[1], np.inf))
                largest.append(float(np.sqrt(squared.max())))

        yield from self._by_blocks_steps(points, measure, threads)
        return max(largest)

    def _by_blocks_steps(
        self, points: NDArray[Any], measure: Callable[[Doubles, NDArray[np.intp]], None], threads: int | None
    ) -> Steps[None]:
        """Call `measure` for blocks of near points (3, n) and their numbers (n,)."""
        points = np.asarray(points, np.float64).reshape(-1, 3)
        order = yield from self._order_of_steps(points)
        blocks = range(0, len(order), BLOCK)

        def measure_block(start: int) -> None:
            block = order[start : start + BLOCK]
            measure(np.ascontiguousarray(points[block].T), block)

        yield from map_steps(measure_block, blocks, worker_count(threads), "", batches=max(1, len(blocks)))

    def nearest(self, points: NDArray[Any], limits: Doubles, seeds: Sequence[Indices] = ()) -> tuple[Doubles, Indices]:
        """Squared distance from every point (3, n) to the nearest triangle, and which of `corners` that is.

        inf and 0 where it is above the point's own limit, which is squared too. Of equally near triangles the first.
        Not for very many points at once. `seeds` (n,) are triangles that may be near, for speed.
        """
        bounds = np.minimum(self._bounds(points), limits)
        for seed in seeds:
            np.minimum(bounds, self._squared(points, np.arange(points.shape[1]), seed), out=bounds)
        nearest = np.full(points.shape[1], np.inf), np.zeros(points.shape[1], np.int64)
        point, box = np.arange(points.shape[1]), np.zeros(points.shape[1], np.int64)
        self._descend(points, (points - self._middle).astype(np.float32), bounds, point, box, nearest, self._height)
        squared, triangle = nearest
        beyond = squared > limits
        squared[beyond], triangle[beyond] = np.inf, 0
        return nearest

    def within(self, points: NDArray[Any], limits: Doubles) -> tuple[Indices, Indices]:
        """Return pairs of a point (3, n) and one of `corners`, all that may be within the point's own squared limit."""
        centered = (points - self._middle).astype(np.float32)
        point, box = np.arange(points.shape[1]), np.zeros(points.shape[1], np.int64)
        for height in reversed(range(self._height)):
            point, box, _ = self._children(centered, limits, point, box, height)
        return point, box

    def _descend(
        self,
        points: NDArray[Any],
        centered: Floats,
        bounds: Doubles,
        point: Indices,
        box: Indices,
        nearest: tuple[Doubles, Indices],
        top: int,
    ) -> None:
        """Go down from pairs of a point and a box of level `top`, and write what is nearest into `nearest`."""
        for height in reversed(range(top)):
            if len(point) > MOST_PAIRS and point[0] != point[-1]:
                middle = int(np.searchsorted(point, (point[0] + point[-1] + 1) // 2))
                for part in (slice(None, middle), slice(middle, None)):
                    self._descend(points, centered, bounds, point[part], box[part], nearest, height + 1)
                return
            point, box, outside = self._children(centered, bounds, point, box, height)
            if len(point) > CROWD * points.shape[1]:
                # The middle triangle of the box nearest to a point gives a new bound of its distance.
                best = _least_of_each(point, outside)
                triangle = np.minimum(box[best] * BRANCH**height + BRANCH**height // 2, len(self.order) - 1)
                near = self._nearer(points, bounds, point, outside, best, triangle)
                point, box, outside = point[near], box[near], outside[near]
        if not len(point):
            return
        if len(point) > 2 * points.shape[1]:
            best = _least_of_each(point, outside)
            near = self._nearer(points, bounds, point, outside, best, box[best])
            point, box = point[near], box[near]
        exact = self._squared(points, point, box)
        best = _least_of_each(point, exact)
        squared, triangle = nearest
        squared[point[best]], triangle[point[best]] = exact[best], box[best]

    def _children(
        self, centered: Floats, bounds: Doubles, point: Indices, box: Indices, height: int
    ) -> tuple[Indices, Indices, Floats]:
        """Return the pairs of points and their boxes' children that are near enough, and their squared distances."""
        position = np.take(centered, point, axis=1)
        if height < HEIGHTS:
            outside = squared_outside(self._discs[height], position, box)
        else:
            outside = self._squared_outside_boxes(height, position, box)
        within = (bounds * SLACK).astype(np.float32).take(point)
        pairs = np.flatnonzero(outside <= np.repeat(within, BRANCH))
        pair = pairs >> BRANCH_BITS
        return point.take(pair), (box.take(pair) << BRANCH_BITS) + (pairs & BRANCH - 1), outside.take(pairs)

    def _squared_outside_boxes(self, height: int, position: Floats, box: Indices) -> Floats:
        """Squared distance from every position (3, n) to the four children of its box, (4 n,)."""
        low, high = self._levels[height - HEIGHTS]
        outside = np.zeros(BRANCH * len(box), np.float32)
        for axis in range(3):
            own = np.repeat(position[axis], BRANCH)
            below, above = np.take(low[axis], box, axis=0).ravel(), np.take(high[axis], box, axis=0).ravel()
            below -= own
            above += own
            np.maximum(below, above, out=below)
            np.maximum(below, 0, out=below)
            below *= below
            outside += below
        return outside

    def _nearer(
        self, points: NDArray[Any], bounds: Doubles, point: Indices, outside: Floats, best: Indices, triangle: Indices
    ) -> Flags:
        """Lower the bounds by triangles of the `best` pairs; return which pairs are near enough still."""
        better = self._squared(points, point[best], triangle)
        bounds[point[best]] = np.minimum(bounds[point[best]], better)
        return np.asarray(outside <= (bounds * SLACK).astype(np.float32).take(point))

    def _squared(self, points: NDArray[Any], point: Indices, triangle: Indices) -> Doubles:
        """Squared distances of pairs of a point and a triangle."""
        return squared_distances(
            np.take(points, point, axis=1), *(np.take(corner, triangle, axis=1) for corner in self.corners)
        )

    def _bounds(self, points: NDArray[Any]) -> Doubles:
        """Return the squared distance from every point (3, n) to the nearer of its two neighbors in Morton order."""
        after = np.minimum(np.searchsorted(self._sorted_codes, self._codes(points.T)), len(self.order) - 1)
        point = np.arange(points.shape[1])
        return np.minimum(self._squared(points, point, after), self._squared(points, point, np.maximum(after - 1, 0)))

    def _order_of_steps(self, points: Doubles) -> Steps[Indices]:
        """Return points (n, 3) in Morton order."""
        return (yield from order_steps((yield from self._codes_steps(len(points), lambda block: points[block]))))

    def _codes_steps(self, count: int, points_of: Callable[[slice], Doubles]) -> Steps[NDArray[np.uint64]]:
        """Return the codes of all points, of which `points_of` gives any block."""
        codes = np.empty(count, np.uint64)
        for start in range(0, count, FACES_PER_STEP):
            block = slice(start, start + FACES_PER_STEP)
            codes[block] = self._codes(points_of(block))
            yield PAUSE
        return codes

    def _codes(self, points: NDArray[Any]) -> NDArray[np.uint64]:
        """Return the position of every point (n, 3) on a curve through the mesh's box that keeps neighbors close."""
        return morton_codes(points, self._low, self._cells_per_unit)


def morton_codes(points: NDArray[Any], low: NDArray[Any], cells_per_unit: float) -> NDArray[np.uint64]:
    """Place of every point (n, 3) on a curve through the box from `low` that keeps neighbors together (Morton 1966)."""
    cells = (np.clip((points - low) * cells_per_unit, 0, 2**CODE_BITS - 1)).astype(np.uint64)
    codes = np.zeros(len(points), np.uint64)
    for axis in range(3):
        bits = cells[:, axis]
        # Two free bits between every two of the 21.
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
        codes |= bits << np.uint64(axis)
    return codes


def squared_distances(points: NDArray[Any], a: NDArray[Any], b: NDArray[Any], c: NDArray[Any]) -> NDArray[Any]:
    """Squared distance of every point to its own triangle abc, (n,); all arrays are (3, n).

    The nearest point is inside the triangle, and the distance that to its plane, or it is on an edge.
    """
    ab, bc, ca = b - a, c - b, a - c
    pa, pb, pc = points - a, points - b, points - c
    squared = _to_segment(pa, ab)
    np.minimum(squared, _to_segment(pb, bc), out=squared)
    np.minimum(squared, _to_segment(pc, ca), out=squared)
    normal = cross(ab, bc)
    inside = dot(cross(ab, pa), normal) >= 0
    inside &= dot(cross(bc, pb), normal) >= 0
    inside &= dot(cross(ca, pc), normal) >= 0
    size = dot(normal, normal)
    inside &= size > 0
    height = dot(pa, normal)
    return np.where(inside, height * height / np.where(inside, size, 1), squared)


def _to_segment(from_start: NDArray[Any], along: NDArray[Any]) -> NDArray[Any]:
    length = dot(along, along)
    share = dot(from_start, along) / np.where(length > 0, length, 1)
    offset = from_start - along * np.clip(share, 0, 1)
    return dot(offset, offset)


def _least_of_each(sorted_numbers: Indices, values: NDArray[Any]) -> NDArray[np.intp]:
    """Return the position of the least value for each number, the first of equals; the numbers never fall."""
    starts = _starts(sorted_numbers)
    least = np.minimum.reduceat(values, starts)
    places = np.flatnonzero(values == np.repeat(least, np.diff(starts, append=len(values))))
    return places[_starts(sorted_numbers[places])]


def _starts(sorted_numbers: Indices) -> NDArray[np.intp]:
    """Return the positions at which a new number begins; the numbers never fall."""
    return np.flatnonzero(np.concatenate([[True], sorted_numbers[1:] != sorted_numbers[:-1]]))


def order_steps(codes: NDArray[np.uint64]) -> Steps[NDArray[np.intp]]:
    """`np.argsort(codes, kind="stable")` in short steps: by 16 bits at a time, which NumPy sorts by counting."""
    order = np.arange(len(codes))
    for shift in (0, 16, 32, 48):
        digits = (codes >> np.uint64(shift)).astype(np.uint16)[order]
        yield PAUSE
        order = order[np.argsort(digits, kind="stable")]
        yield PAUSE
    return order
