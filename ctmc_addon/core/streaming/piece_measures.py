# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures of a surface that comes in pieces, none of which is kept: those of `measures_steps` for the whole.

Numbers are exact; area and volume are summed in another order, and agree to twelve digits or so. An edge between two
vertices of the next piece waits for that piece's triangles. Of every component of a piece there are sums, from which
its volume about its own middle follows when all pieces have come: with N the sum of the triangles' vectors and V the
volume about another point that lies at -m from the middle, it is V - m . N / 3.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mesh.completed_pieces import CompletedPiece
from ..mesh.face_normals import face_vectors
from ..mesh.measures import MANY, SMALL, Measures, borders_steps
from ..mesh.topology import edge_counts_steps
from ..progress import PAUSE, Steps
from .piece_links import PieceLinks

MOST_SAMPLED = 1 << 19  # vertices


class PieceMeasures:
    """Takes pieces from the first to the last.

    Attributes
    ----------
    sample : (n, 3) float32
        Some of the vertices, evenly along the surface.
    """

    def __init__(self) -> None:
        self.sample = np.empty((0, 3), np.float32)
        self._every = 1  # vertex, of those that came, is in the sample
        self._links = PieceLinks()
        self._sums: list[NDArray[np.float64]] = []  # of every component, (c, 8)
        self._middle: NDArray[np.float64] | None = None
        self._faces = self._edges = self._vertices = self._used_vertices = 0
        self._area = 0.0
        self._closed = True
        self._borders = [np.empty((2, 0), np.int64)]  # edges with one triangle, vertices counted in the surface
        self._used = np.empty(0, bool)  # of the next piece's vertices by this one
        self._seam = np.empty((2, 0), np.int64)  # edges between them, their triangles, and those that run up
        self._seam_counts = np.empty((2, 0), np.int64)

    def add_steps(self, piece: CompletedPiece) -> Steps[None]:
        """Take in the next piece."""
        self._add_vertices(piece)
        self._faces += len(piece.mesh.faces)
        yield from self._add_edges_steps(piece)
        yield from self._add_sums_steps(piece)

    def measures_steps(self) -> Steps[Measures]:
        """The measures of the surface, when all pieces have come."""
        component = yield from self._links.joined_steps()
        sums = np.concatenate([np.empty((0, 8)), *self._sums])
        count = int(component.max(initial=-1)) + 1
        volume, *rest, faces = (np.bincount(component, column, count) for column in sums.T)
        vectors, corners = np.stack(rest[:3]), np.stack(rest[3:])  # (3, c) each
        volumes = (volume - (corners * vectors).sum(axis=0) / (3 * np.maximum(faces, 1))) / 6.0
        border, borders = np.concatenate(self._borders, axis=1), 0
        if border.shape[1]:
            numbers, ends = np.unique(border, return_inverse=True)
            borders = yield from borders_steps(ends.reshape(border.shape).astype(np.int32), len(numbers))
        closed = self._closed and self._faces > 0
        return Measures(
            faces=self._faces,
            area=self._area,
            volume=float(volume.sum() / 6.0) if closed else math.nan,
            closed=closed,
            euler=self._used_vertices - self._edges + self._faces,
            components=count,
            small_components=int((np.abs(volumes) < SMALL).sum()) if count >= MANY else 0,
            borders=borders,
            vertices=self._vertices,
        )

    def _add_vertices(self, piece: CompletedPiece) -> None:
        used = np.zeros(len(piece.mesh.vertices), bool)
        used[piece.mesh.faces] = True
        used[: len(self._used)] |= self._used
        self._vertices += piece.own
        self._used_vertices += int(np.count_nonzero(used[: piece.own]))
        self._used = used[piece.own :]
        offset = -piece.first % self._every
        self.sample = np.concatenate([self.sample, piece.mesh.vertices[offset : piece.own : self._every]])
        while len(self.sample) > MOST_SAMPLED:
            self.sample, self._every = self.sample[::2].copy(), 2 * self._every

    def _add_edges_steps(self, piece: CompletedPiece) -> Steps[None]:
        ends, *counts = yield from edge_counts_steps(piece.mesh.faces, len(piece.mesh.vertices))
        count = np.stack(counts)  # (2, E): triangles, and those that run up
        # Edges come in the order of their ends, and so do these keys.
        keys = ends[0].astype(np.int64) << 32 | ends[1]
        waiting = self._seam[0] << 32 | self._seam[1]
        at = np.minimum(np.searchsorted(keys, waiting), max(0, len(keys) - 1))
        again = keys[at] == waiting if len(keys) else np.zeros(len(waiting), bool)
        count[:, at[again]] += self._seam_counts[:, again]
        self._finish_edges(self._seam[:, ~again], self._seam_counts[:, ~again], piece.first)
        open_end = ends[0] >= piece.own  # the lower end
        self._finish_edges(ends[:, ~open_end], count[:, ~open_end], piece.first)
        self._seam = ends[:, open_end].astype(np.int64) - piece.own
        self._seam_counts = count[:, open_end]

    def _finish_edges(self, ends: NDArray[Any], counts: NDArray[np.int64], first: int) -> None:
        count, upwards = counts
        self._edges += len(count)
        self._closed &= bool((count == 2).all() and (upwards == 1).all())
        self._borders.append(ends[:, count == 1].astype(np.int64) + first)

    def _add_sums_steps(self, piece: CompletedPiece) -> Steps[None]:
        numbers = yield from self._links.add_steps(piece)
        mesh = piece.mesh
        if not len(mesh.faces):
            return
        if self._middle is None:  # far from the origin the terms would cancel badly
            self._middle = (mesh.vertices.min(axis=0).astype(np.float64) + mesh.vertices.max(axis=0)) / 2
        vectors = face_vectors(mesh.vertices, mesh.faces)  # (f, 3)
        yield PAUSE
        self._area += float(0.5 * np.sqrt((vectors**2).sum(axis=1)).sum())
        corners = mesh.vertices.astype(np.float64) - self._middle
        volume = (corners[mesh.faces[:, 0]] * vectors).sum(axis=1)
        yield PAUSE
        columns = [volume, *vectors.T]
        for axis in range(3):
            columns.append(corners[mesh.faces, axis].sum(axis=1))
            yield PAUSE
        columns.append(np.ones(len(mesh.faces)))
        self._sums.append(np.stack([np.bincount(numbers, column) for column in columns], axis=1))
