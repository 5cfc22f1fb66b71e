# SPDX-License-Identifier: GPL-3.0-or-later
"""Where on its edge each vertex lies, and the points inside faces and voxels, which are means of such vertices.

On an edge between two labels the vertex is where both fields are equal. On one that ends in no label it is where the
label's own field is 0, or where it equals what smoothed indicators leave; so a label beside nothing has the surface
that it has alone. A constant of a label moves its vertices along their edges and changes no triangle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ...arrays import Floats
from ...machine.parallel import map_steps
from ...progress import Steps
from ..case_table import NEAREST
from .bands import Band, BandFaces
from .label_samples import LabelSamples
from .owners import Owners


@dataclass(frozen=True, eq=False)
class Crossings:
    """The vertices on edges of one band along one axis.

    Parameters
    ----------
    axis : int
    sample : three (n,) intp
        Sample numbers of their low ends along x, y and z.
    ends : (n, 2) intp
        The owners of both ends.
    fields : (2, n) float64
        Field of the low end's owner minus that of the high end's, at both ends.
    fixed : (n,) bool
        Whether the vertex lies half-way whatever the fields are: to a sample outside a closed border.
    """

    axis: int
    sample: tuple[NDArray[np.intp], ...]
    ends: NDArray[np.intp]
    fields: NDArray[np.float64]
    fixed: NDArray[np.bool_]

    def shares(self, constants: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Return where on their edges the vertices lie, 0 to 1, with a constant added to the field of each label."""
        low, high = self.fields
        if constants is not None:
            added = constants.take(self.ends[:, 0]) - constants.take(self.ends[:, 1])
            low, high = low + added, high + added
        fall = low - high
        flat = fall == 0
        share = low / np.where(flat, 1.0, fall)
        share[flat | self.fixed] = 0.5
        return np.clip(share, NEAREST, 1 - NEAREST, out=share)


def crossings_of(
    owners: Owners,
    band: Band,
    axis: int,
    fields: Sequence[LabelSamples],
    walls: Mapping[tuple[int, int], LabelSamples] = MappingProxyType({}),
) -> Crossings:
    """Return the vertices on a band's edges along an axis.

    Parameters
    ----------
    fields : sequence of LabelSamples
        Fields in the order of the labels' values; empty if labels are not smoothed.
    walls : mapping of (first, second) to LabelSamples
        The field between two labels, above 0 in the first.
    """
    rows, columns = owners.number.shape[1:]
    flat = band.edges[axis]
    z, rest = np.divmod(flat, rows * columns)
    y, x = np.divmod(rest, columns)
    low = (x, y, z + band.low)
    along = (owners.x, owners.y, owners.z)[axis]
    high = tuple(at + (number == axis) for number, at in enumerate(low))
    last = along.count - 2
    fixed = (low[axis] == 0) | (low[axis] == last)
    number = owners.number
    ends = np.stack([number[low[2], low[1], low[0]], number[high[2], high[1], high[0]]], axis=1).astype(np.intp)
    if not fields:
        values = np.repeat(np.array([[1.0], [-1.0]]), len(flat), axis=1)
        return Crossings(axis, low, ends, values, fixed)
    positions = [of.index.take(at) for of, at in zip((owners.x, owners.y, owners.z), low, strict=True)]
    positions[axis] = np.stack([positions[axis], along.index.take(high[axis])])  # of both ends
    totals = None if owners.total is None else np.stack([owners.total[at[2], at[1], at[0]] for at in (low, high)])
    between = np.zeros((2, len(flat)))
    count = len(fields) + 1
    pair = (ends[:, 0] * count + ends[:, 1]).astype(np.min_scalar_type(count * count))
    order = np.argsort(pair, kind="stable")
    first = np.flatnonzero(np.diff(pair[order], prepend=pair.dtype.type(0)) != 0)
    for edge in np.split(order, first):
        if not len(edge):
            continue
        labels = ends[edge[0]].tolist()
        at_ends = [at.take(edge, axis=-1) for at in positions]
        wall = walls.get((min(labels), max(labels)))
        for side, label in enumerate(labels):
            if not label:
                continue
            values = fields[label - 1].at(*at_ends).astype(np.float64)  # (2, n)
            neighbor = labels[1 - side]
            if totals is not None:
                rest = (totals[:, edge] - values) / 2
                # Both fields' mean difference, on an edge between two labels too.
                values = values / 2 if neighbor else values - 0.5 + rest
            elif owners.largest is not None and not neighbor:
                # Its own field, but where a wall's gave it the sample.
                column, row, layer = (number.take(edge) for number in (low, high)[side])
                values[side] = np.where(values[side] < 0, owners.largest[layer, row, column], values[side])
            between[:, edge] += values if side == 0 else -values
        if wall is not None:
            of_wall = wall.at(*at_ends) * np.float64(2 if labels[0] < labels[1] else -2)
            crosses = (of_wall[0] >= 0) & (of_wall[1] <= 0)
            between[:, edge[crosses]] = of_wall[:, crosses]
    return Crossings(axis, low, ends, between, fixed)


@dataclass(frozen=True, eq=False)
class ComplexVertices:
    """The vertices of a complex: those on edges, and the points that are means of them.

    Parameters
    ----------
    crossings : list of three Crossings for each band
    faces : list of BandFaces
    starts : (bands, 7) intp
        Start of the lists of each band.
    count : int
        Vertices in all.
    """

    crossings: list[list[Crossings]]
    faces: list[BandFaces]
    starts: NDArray[np.intp]
    count: int

    @property
    def labels(self) -> NDArray[np.intp]:
        """One of the labels at every vertex, (V,), counted from 1."""
        out = np.empty(self.count, np.intp)
        for crossings, faces, starts in zip(self.crossings, self.faces, self.starts.tolist(), strict=True):
            for each, start in zip(crossings, starts, strict=False):
                out[start : start + len(each.ends)] = np.maximum(*each.ends.T)
            first = faces.point_edges[faces.point_first[:-1]]
            out[starts[3] : starts[3] + len(first)] = ~first  # those of the next band are not known yet
        points = np.flatnonzero(out < 0)
        out[points] = out[~out[points]]
        return out

    @property
    def off_edges(self) -> NDArray[np.bool_]:
        """Return whether each vertex is a mean of other vertices, (V,)."""
        out = np.zeros(self.count, bool)
        for faces, starts in zip(self.faces, self.starts.tolist(), strict=True):
            out[starts[3] : starts[3] + len(faces.point_first) - 1] = True
        return out

    def positions_steps(
        self, owners: Owners, shares: list[list[NDArray[np.float64]]] | None, origins: NDArray[np.intp], threads: int
    ) -> Steps[Floats]:
        """Return all positions, (V, 3) float32.

        Parameters
        ----------
        shares : list
            Position of each vertex on its edge; None for half-way.
        origins : (labels + 1, 3) intp
            The sample position from which those of each label's vertices are counted, x, y, z.
        threads : int
        """
        out = np.empty((self.count, 3), np.float32)
        axes = (owners.x, owners.y, owners.z)
        starts = self.starts.tolist()
        sides = [np.diff(axis.position) for axis in axes]

        def place_edges(band: int) -> None:
            for each, start in zip(self.crossings[band], starts[band], strict=False):
                label = np.maximum(*each.ends.T)
                rows = out[start : start + len(label)]
                for column, (axis, sample) in enumerate(zip(axes, each.sample, strict=True)):
                    position = axis.position.take(sample)
                    position -= origins[:, column].astype(np.float32).take(label)
                    if column == each.axis:
                        share = 0.5 if shares is None else shares[band][each.axis]
                        position = position + share * sides[column].take(sample)
                    rows[:, column] = position

        def place_points(band: int) -> None:
            faces, start = self.faces[band], starts[band][3]
            count = np.diff(faces.point_first)
            if len(count):
                corners = out.take(faces.point_edges, axis=0).astype(np.float64)
                sums = np.add.reduceat(corners, faces.point_first[:-1], axis=0)
                out[start : start + len(count)] = sums / count[:, None]

        for place in (place_edges, place_points):
            yield from map_steps(place, range(len(starts)), threads)
        return out
