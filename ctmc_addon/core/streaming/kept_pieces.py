# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the components of a surface that enclose enough, or the largest of them, where the surface comes in pieces.

Which components stay is decided as for a surface in memory, from the same sums in the same order of faces, so the
decision is the same to the last bit. That takes the pieces several times: to see what hangs together across seams,
for the middle of every component, for its volume, for what is around each cavity, and to give what stays. Between
the passes a few numbers of every component are kept, and no pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..mesh.cavities import crossings_steps, points_within, smallest_around, summed_pairs
from ..mesh.completed_pieces import CompletedPiece, completed_pieces_steps
from ..mesh.components import kept_components
from ..mesh.measures import triple_products
from ..mesh.topology import component_numbers_steps
from ..mesh.triangle_mesh import SurfacePiece, SurfacePieces, TriangleMesh
from ..progress import Step, Steps, WithResult, equal_part, finish
from .piece_links import PieceLinks

T = TypeVar("T")

LINKING, WEIGHING, MEASURING, ENCLOSING, KEEPING = range(5)  # passes
TITLES = ("Joining components", "Measuring components", "Measuring components", "Finding cavities", "")
PASSES = len(TITLES)
MOST_PAIRS = 1 << 20  # of a ray and a component, before they are summed up


class KeptPieces(Generic[T]):
    """The pieces of a surface without small components.

    Parameters
    ----------
    one_pass : callable
        Gives the pieces from the first to the last, as often as it is called; with normals if it is told so.
    largest, min_volume
        As of `keep_components_steps`.
    """

    def __init__(self, one_pass: Callable[[bool], SurfacePieces[T]], largest: int, min_volume: float):
        self.one_pass, self.largest, self.min_volume = one_pass, largest, min_volume
        self.first: list[int] = []  # of every piece's components among those of all pieces; the end
        self.component = np.empty(0, np.int32)  # of the surface, for a component of a piece

    @property
    def count(self) -> int:
        """Components of the surface."""
        return int(self.component.max(initial=-1)) + 1

    def pieces_steps(self, normals: bool) -> SurfacePieces[T]:
        """Yield what stays, and steps between.

        Raises
        ------
        MeshError
            If nothing would be left.
        """
        yield from self._link_steps()
        if self.min_volume <= 0 and self.count <= self.largest:
            return (yield from self._pass_steps(KEEPING, normals))
        points, middles = yield from self._middles_steps()
        volumes = yield from self._volumes_steps(middles)
        del middles
        owner = yield from self._owners_steps(points, volumes)
        del points
        keep = kept_components(volumes, owner, self.largest, self.min_volume)
        if keep.all():
            return (yield from self._pass_steps(KEEPING, normals))
        return (yield from self._kept_steps(keep, normals))

    def _pass_steps(self, number: int, normals: bool = False) -> SurfacePieces[T]:
        """One pass over the pieces, as part `number` of the work."""
        share = number / PASSES, (number + 1) / PASSES
        return (yield from pieces_between_steps(self.one_pass(normals), *share, TITLES[number]))

    def _completed_steps(self, number: int, normals: bool = False) -> Generator[Step | CompletedPiece, None, T]:
        """The pieces of a pass as meshes."""
        return (yield from completed_pieces_steps(self._pass_steps(number, normals)))

    def _link_steps(self) -> Steps[None]:
        """See which components of pieces are one across the seams."""
        links = PieceLinks()
        for item in self._completed_steps(LINKING):
            if isinstance(item, Step):
                yield item
            else:
                finish(links.add_steps(item))
        self.first = links.first
        self.component = yield from equal_part(links.joined_steps(), WEIGHING, PASSES)

    def _meshes_steps(self, number: int) -> Iterator[Step | tuple[TriangleMesh, NDArray[np.int32]]]:
        """The triangles of every piece that has any, with all their corners, and the component of each, (f,)."""
        piece = 0
        for item in self._completed_steps(number):
            if isinstance(item, Step):
                yield item
                continue
            if len(item.mesh.faces):
                yield item.mesh, self._components(item.mesh, piece)
            piece += 1

    def _components(self, mesh: TriangleMesh, number: int) -> NDArray[np.int32]:
        """The component of the surface that every triangle of a piece is in, (f,)."""
        within = finish(component_numbers_steps(mesh.faces, len(mesh.vertices)))
        return self.component[self.first[number] : self.first[number + 1]][within]

    def _middles_steps(self) -> Steps[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """A point on the first triangle of every component, and its middle, (components, 3) each."""
        points, sums = np.zeros((self.count, 3)), np.zeros((self.count, 3))
        faces = np.zeros(self.count, np.int64)
        for item in self._meshes_steps(WEIGHING):
            if isinstance(item, Step):
                yield item
                continue
            mesh, component = item
            numbers, start, at = np.unique(component, return_index=True, return_inverse=True)
            at = at.ravel()
            new = faces[numbers] == 0
            points[numbers[new]] = points_within(mesh.vertices[mesh.faces[start[new]]])
            faces[numbers] += np.bincount(at)
            for axis in range(3):
                a, b, c = (mesh.vertices[corner, axis].astype(np.float64) for corner in mesh.faces.T)
                sums[numbers, axis] = _added(sums[numbers, axis], at, a + b + c)
        return points, sums / (faces * 3)[:, None]

    def _volumes_steps(self, middles: NDArray[np.float64]) -> Steps[NDArray[np.float64]]:
        """What `component_volumes_steps` returns for the whole surface."""
        sums = np.zeros(self.count)
        for item in self._meshes_steps(MEASURING):
            if isinstance(item, Step):
                yield item
                continue
            mesh, component = item
            numbers, at = np.unique(component, return_inverse=True)
            at = at.ravel()
            columns = []
            for axis in range(3):
                middle = middles[component, axis]
                columns.append([mesh.vertices[corner, axis].astype(np.float64) - middle for corner in mesh.faces.T])
            sums[numbers] = _added(sums[numbers], at, triple_products(columns))
        return sums / 6.0

    def _owners_steps(self, points: NDArray[np.float64], volumes: NDArray[np.float64]) -> Steps[NDArray[np.intp]]:
        """What `owners_steps` returns for the whole surface."""
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
            corners = mesh.vertices[mesh.faces.ravel()]
            low, high = corners.min(axis=0), corners.max(axis=0)
            beside = (points[:, 1:] >= low[1:]) & (points[:, 1:] <= high[1:])
            near = np.flatnonzero(beside.all(axis=1) & (points[:, 0] <= high[0]))
            if not len(near):
                continue
            ray, face, leaves = finish(crossings_steps(mesh, points[near]))
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

    def _kept_steps(self, keep: NDArray[np.bool_], normals: bool) -> SurfacePieces[T]:
        """The pieces without the triangles of other components, and without the vertices that are then unused."""
        held: tuple[CompletedPiece, NDArray[np.int32], NDArray[np.bool_]] | None = None
        number = 0
        source = WithResult(self._completed_steps(KEEPING, normals))
        for item in source:
            if isinstance(item, Step):
                yield item
                continue
            kept = item.mesh.faces[keep[self._components(item.mesh, number)]]
            number += 1
            used = np.zeros(len(item.mesh.vertices), bool)
            used[kept] = True
            if held is not None:
                seam = held[2][held[0].own :]
                used[: len(seam)] |= seam
                yield _without_unused(*held, used[: item.own])
            held = item, kept, used
        if held is not None:
            yield _without_unused(*held, np.empty(0, bool))
        return source.result


def pieces_between_steps(pieces: SurfacePieces[T], low: float, high: float, title: str = "") -> SurfacePieces[T]:
    """The same pieces, whose steps go from `low` to `high` of a larger work."""
    source = WithResult(pieces)
    for item in source:
        yield Step(low + (high - low) * item.fraction, title or item.message) if isinstance(item, Step) else item
    return source.result


def _added(sums: NDArray[np.float64], at: NDArray[np.intp], terms: NDArray[Any]) -> NDArray[np.float64]:
    """The sums with the terms added to them one after the other: the same bits as of all terms at once."""
    places = np.concatenate([np.arange(len(sums)), at])
    return np.asarray(np.bincount(places, np.concatenate([sums, terms]), len(sums)), np.float64)


def _without_unused(
    piece: CompletedPiece, faces: NDArray[np.int32], used: NDArray[np.bool_], used_next: NDArray[np.bool_]
) -> SurfacePiece:
    """A piece with some of its triangles, whose numbers also pass over the unused vertices of the next."""
    used_own = np.flatnonzero(used[: piece.own])
    number = np.concatenate([np.cumsum(used[: piece.own]) - 1, len(used_own) + np.cumsum(used_next) - 1])
    normals = None if piece.mesh.normals is None else piece.mesh.normals[used_own]
    return SurfacePiece(piece.mesh.vertices[used_own], number.astype(np.int32)[faces], normals)
