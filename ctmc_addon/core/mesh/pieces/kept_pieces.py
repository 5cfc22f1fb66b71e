# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the components of a surface that enclose enough, or the largest of them, where the surface comes in pieces.

That takes the pieces several times: to see what is connected across seams, for the middle of every component, for its
volume, for what is around each cavity, and to give what stays. Sums go on in the order of the triangles, so where the
pieces are cut decides nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Step, Steps, WithResult
from ..cavities import crossings_steps, points_within, smallest_around, summed_pairs
from ..component_limits import ComponentLimits
from ..measures import BLOCK, triple_products
from ..topology import component_numbers_steps
from ..triangle_mesh import Pieces, Surface, TriangleMesh, at_alpha_steps, replayed_steps
from .completed_pieces import completed_pieces_steps
from .piece_links import PieceLinks
from .spool import Spool

LINKING, WEIGHING, MEASURING, ENCLOSING, KEEPING = range(5)  # The passes.
TITLES = ("Joining components", "Measuring components", "Measuring components", "Finding cavities", "")
PASSES = len(TITLES)
MOST_PAIRS = 1 << 20  # Sum up pairs of a ray and a component once there are this many.

Decision = tuple[NDArray[np.bool_], NDArray[np.float64]]  # The components that stay, and their signed volumes.


class KeptPieces:
    """The pieces of a surface without small components; the walls of a cavity belong to the component around it.

    Parameters
    ----------
    one_pass : callable
        Returns the pieces from the first to the last at every call; its argument is true at the last call.
    limits : ComponentLimits
        Limits that decide which components stay.
    spool : Spool, optional
        Keeps the component of each triangle; by default they stay in memory.
    components : (F,) int32, optional
        The component of each triangle of a single piece, if it is known.
    """

    def __init__(
        self,
        one_pass: Callable[[bool], Pieces],
        limits: ComponentLimits,
        spool: Spool | None = None,
        components: NDArray[np.int32] | None = None,
    ) -> None:
        self.one_pass, self.limits, self.spool = one_pass, limits, spool or Spool()
        self._known = components
        self.alpha = 1.0  # at which components are measured
        self.first: list[int] = []  # of every piece's components among those of all pieces; the end
        self.component = np.empty(0, np.int32)  # of the surface, for a component of a piece
        self.removed = 0  # components of the surface that do not stay, cavities among them; known at the end
        self._numbers: list[int] = []  # of the spool, for every piece
        self._decided: dict[float, Decision] = {}  # at each alpha

    @property
    def count(self) -> int:
        """Number of components of the surface."""
        return int(self.component.max(initial=-1)) + 1

    def pieces_steps(self, alpha: float, last: bool = True) -> Pieces:
        """Yield the pieces without the components that are dropped at `alpha`, and steps between them.

        Raises
        ------
        MeshError
            If nothing would be left.
        """
        if self.limits.keep_all:
            return (yield from self.one_pass(last))
        keep, _ = yield from self.decision_steps(alpha)
        self.removed = int(np.count_nonzero(~keep))
        if keep.all():
            return (yield from self._pass_steps(KEEPING, last))
        return (yield from self._kept_steps(keep, last))

    def decision_steps(self, alpha: float) -> Steps[Decision]:
        """Return which components stay, (components,), and their signed volumes where those were needed, else none."""
        if alpha not in self._decided:
            self._decided[alpha] = yield from self._decision_steps(alpha)
        return self._decided[alpha]

    def _decision_steps(self, alpha: float) -> Steps[Decision]:
        yield from self._link_steps()
        if not self.count or self.limits.need_no_volumes(self.count):
            return np.ones(self.count, bool), np.empty(0)
        volumes, owner = yield from self._measured_steps(alpha)
        return self.limits.kept(volumes, owner), volumes

    def bodies_steps(self, alpha: float) -> Steps[NDArray[np.intp]]:
        """Return for every component the one that it is a cavity of, else itself, (components,)."""
        yield from self._link_steps()
        return (yield from self._measured_steps(alpha))[1]

    def _measured_steps(self, alpha: float) -> Steps[tuple[NDArray[np.float64], NDArray[np.intp]]]:
        """Return the signed volume and the owner of every component, (components,) each."""
        self.alpha = alpha
        points, middles = yield from self._middles_steps()
        volumes = yield from self._volumes_steps(middles)
        del middles
        return volumes, (yield from self._owners_steps(points, volumes))

    def _pass_steps(self, number: int, last: bool = False) -> Pieces:
        """One pass over the pieces, as part `number` of the work."""
        low, high = number / PASSES, (number + 1) / PASSES
        source, done = WithResult(self.one_pass(last)), 0.0
        for item in source:
            if isinstance(item, Step):
                done = max(done, item.fraction)  # a pause does not know how far it is
                yield Step(low + (high - low) * done, TITLES[number] or item.message)
            else:
                yield item
        return source.result

    def _link_steps(self) -> Steps[None]:
        """See which components of pieces are one across the seams, once: that is the same at every alpha."""
        if self.first:
            return
        links = PieceLinks()
        for item in completed_pieces_steps(at_alpha_steps(self._pass_steps(LINKING), self.alpha)):
            if isinstance(item, Step):
                yield item
                continue
            numbers = yield from links.add_steps(item.mesh.faces, item.own, self._known)
            self._numbers.append(self.spool.put(numbers))
        self.first = links.first
        joining = WithResult(links.joined_steps())
        for _ in joining:
            yield PAUSE
        self.component = joining.result

    def _meshes_steps(self, number: int) -> Iterator[Step | tuple[TriangleMesh, NDArray[np.int32]]]:
        """Yield the triangles of every piece that has any, with all their corners, and the component of each, (f,)."""
        piece = 0
        for item in completed_pieces_steps(at_alpha_steps(self._pass_steps(number), self.alpha)):
            if isinstance(item, Step):
                yield item
                continue
            if len(item.mesh.faces):
                yield item.mesh, self._components(piece)
            piece += 1

    def _components(self, number: int) -> NDArray[np.int32]:
        """Return the component of the surface that every triangle of a piece is in, (f,)."""
        (within,) = self.spool.get(self._numbers[number])
        return self.component[self.first[number] : self.first[number + 1]][within]

    def _middles_steps(self) -> Steps[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return a point on the first triangle of every component, and its middle, (components, 3) each."""
        points, sums = np.zeros((self.count, 3)), np.zeros((self.count, 3))
        faces = np.zeros(self.count, np.int64)
        for item in self._meshes_steps(WEIGHING):
            if isinstance(item, Step):
                yield item
                continue
            mesh, component = item
            at = np.full(self.count, -1)
            at[component[::-1]] = np.arange(len(component))[::-1]  # the first triangle is written last
            yield PAUSE
            new = np.flatnonzero((at >= 0) & (faces == 0))
            points[new] = points_within(mesh.vertices[mesh.faces[at[new]]])
            faces += np.bincount(component, minlength=self.count)
            for axis in range(3):
                along, total = np.ascontiguousarray(mesh.vertices[:, axis], np.float64), np.zeros(len(mesh.faces))
                for corner in mesh.faces.T:
                    total += np.take(along, corner)
                    yield PAUSE
                sums[:, axis] = _added(sums[:, axis], component, total)
                yield PAUSE
        return points, sums / (faces * 3)[:, None]

    def _volumes_steps(self, middles: NDArray[np.float64]) -> Steps[NDArray[np.float64]]:
        """Return the signed volume of every component, (components,) float64."""
        sums = np.zeros(self.count)
        middle_columns = np.ascontiguousarray(middles.T)
        for item in self._meshes_steps(MEASURING):
            if isinstance(item, Step):
                yield item
                continue
            mesh, component = item
            columns = np.ascontiguousarray(mesh.vertices.T, np.float64)
            values = np.empty(len(component))
            for start in range(0, len(component), BLOCK):
                block = slice(start, start + BLOCK)
                own, corners = component[block], mesh.faces[block].T
                offsets = [
                    [np.take(along, corner) - np.take(middle, own) for corner in corners]
                    for along, middle in zip(columns, middle_columns, strict=True)
                ]
                values[block] = triple_products(offsets)
                yield PAUSE
            sums = _added(sums, component, values)
        return sums / 6.0

    def _owners_steps(self, points: NDArray[np.float64], volumes: NDArray[np.float64]) -> Steps[NDArray[np.intp]]:
        """Return for every component the component that it is a cavity of, else itself, (components,)."""
        cavities = np.flatnonzero(volumes < 0)
        if len(cavities) in (0, len(volumes)):
            return np.arange(len(volumes))
        points = points[cavities]
        pairs, times = [np.empty(0, np.int64)], [np.empty(0)]
        waiting = 0
        for item in self._meshes_steps(ENCLOSING):
            if isinstance(item, Step):
                yield item
                continue
            mesh, component = item
            used = np.zeros(len(mesh.vertices), bool)
            used[mesh.faces] = True
            yield PAUSE
            corners = mesh.vertices[used]
            low, high = corners.min(axis=0), corners.max(axis=0)
            yield PAUSE
            in_reach = (points[:, 1:] >= low[1:]) & (points[:, 1:] <= high[1:])
            near = np.flatnonzero(in_reach.all(axis=1) & (points[:, 0] <= high[0]))
            if not len(near):
                continue
            ray, face, leaves = yield from crossings_steps(mesh, points[near])
            outer = component[face]
            around = volumes[outer] > 0
            pair, sums = summed_pairs(near[ray[around]] * len(volumes) + outer[around], leaves[around])
            pairs.append(pair)
            times.append(sums)
            waiting += len(pair)
            if waiting > max(MOST_PAIRS, len(pairs[0])):
                pair, sums = summed_pairs(np.concatenate(pairs), np.concatenate(times))
                pairs, times, waiting = [pair[sums != 0]], [sums[sums != 0]], 0
        ray, outer = np.divmod(np.concatenate(pairs), len(volumes))
        return smallest_around(cavities, volumes, ray, outer, np.concatenate(times))

    def _kept_steps(self, keep: NDArray[np.bool_], last: bool) -> Pieces:
        """Return the pieces without the triangles of dropped components, and without vertices that are then unused."""
        held: tuple[Surface, NDArray[np.int32], NDArray[np.bool_]] | None = None
        number = 0
        source = WithResult(self._pass_steps(KEEPING, last))
        for item in source:
            if isinstance(item, Step):
                yield item
                continue
            own = len(item.linear)
            vertices = max(own, int(item.faces.max(initial=-1)) + 1)
            stays = keep[self._components(number)]
            yield PAUSE
            kept = item.faces[stays]
            yield PAUSE
            number += 1
            used = np.zeros(vertices, bool)
            used[kept] = True
            yield PAUSE
            if held is not None:
                seam = held[2][len(held[0].linear) :]
                used[: len(seam)] |= seam
                yield _without_unused(*held, used[:own])
            held = item, kept, used
        if held is not None:
            yield _without_unused(*held, np.empty(0, bool))
        return source.result


def keep_components_steps(surface: Surface, alpha: float, limits: ComponentLimits) -> Steps[Surface]:
    """Return a surface that is held without small components; parameters and errors are those of `KeptPieces`."""
    return (yield from kept_and_removed_steps(surface, alpha, limits))[0]


def kept_and_removed_steps(
    surface: Surface, alpha: float, limits: ComponentLimits, components: NDArray[np.int32] | None = None
) -> Steps[tuple[Surface, int]]:
    """Do what `keep_components_steps` does, and count the removed components, cavities among them.

    The component of each triangle may be known, (F,).
    """
    kept = KeptPieces(lambda _: replayed_steps([surface]), limits, components=components)
    for item in kept.pieces_steps(alpha):
        if isinstance(item, Step):
            yield item
        else:
            surface = item
    return surface, kept.removed


def kept_faces_steps(
    surface: Surface, alpha: float, limits: ComponentLimits
) -> Steps[tuple[NDArray[np.int32], NDArray[np.bool_], NDArray[np.float64]]]:
    """Return the component of every triangle, (F,), which components stay, and their signed volumes in mm3.

    Parameters and errors are those of `KeptPieces`; there are no volumes where nothing had to be measured.
    """
    kept = KeptPieces(lambda _: replayed_steps([surface]), limits)
    keep, volumes = yield from kept.decision_steps(alpha)
    return (yield from component_numbers_steps(surface.faces, len(surface.linear))), keep, volumes


def bodies_steps(surface: Surface, alpha: float) -> Steps[NDArray[np.intp]]:
    """Return the body that every triangle of a surface belongs to, (F,): a component with the walls of its cavities."""
    owner = yield from KeptPieces(lambda _: replayed_steps([surface]), ComponentLimits()).bodies_steps(alpha)
    return np.asarray(owner[(yield from component_numbers_steps(surface.faces, len(surface.linear)))])


def with_faces(surface: Surface, selected: NDArray[np.bool_]) -> Surface:
    """Return a surface of some of the triangles, (F,), and of the vertices that these use."""
    faces = surface.faces[selected]
    used = np.zeros(len(surface.linear), bool)
    used[faces] = True
    return _without_unused(surface, faces, used, np.empty(0, bool))


def _added(sums: NDArray[np.float64], at: NDArray[np.intp], terms: NDArray[Any]) -> NDArray[np.float64]:
    """Return the sums with the terms added to them one after the other: the same bits as of all terms at once."""
    if not sums.any():
        return np.asarray(np.bincount(at, terms, len(sums)), np.float64)
    places = np.concatenate([np.arange(len(sums)), at])
    return np.asarray(np.bincount(places, np.concatenate([sums, terms]), len(sums)), np.float64)


def _without_unused(
    piece: Surface, faces: NDArray[np.int32], used: NDArray[np.bool_], used_next: NDArray[np.bool_]
) -> Surface:
    """Return a piece with some of its triangles, whose numbers also pass over the unused vertices of the next."""
    own = len(piece.linear)
    used_own = np.flatnonzero(used[:own])
    number = np.concatenate([np.cumsum(used[:own]) - 1, len(used_own) + np.cumsum(used_next) - 1])
    return Surface(
        piece.midpoints[used_own],
        piece.linear[used_own],
        number.astype(np.int32)[faces],
        None if piece.normals is None else piece.normals[used_own],
    )
