# SPDX-License-Identifier: GPL-3.0-or-later
"""Find which surfaces a figure's camera sees and which hide others: depth maps, compared cell by cell.

The camera is orthographic, so a surface is seen as its points (right, up, backward) in the camera's axes. Triangles are
sampled so densely that no cell of a map is left out; the sample that is farthest backward, which is nearest to the
camera, is the depth there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CELLS = 200  # Cells along the longer side of the visible part.
HIDES = 0.25  # A surface hides a tumor if it covers more than this share of the tumor's picture.
HIDES_ALL = 0.9
MOST_SAMPLES = 2_000_000  # Samples processed at once.
TOUCHING = 2.0  # Surfaces this near to each other in cells, such as shared walls, hide nothing.


@dataclass(frozen=True)
class DepthMaps:
    """Depths of several surfaces seen from the camera, on one grid.

    Parameters
    ----------
    depths : (n, rows, columns) float32
        Along the camera's backward axis; -inf where a surface is not seen.
    low : (right, up) float
        Position of the grid's first corner.
    cell : float
        Side of a cell.
    """

    depths: NDArray[np.float32]
    low: tuple[float, float]
    cell: float

    def hidden_share(self, which: int, by: int) -> float:
        """Return the share of one surface's picture that lies behind another surface, 0 to 1."""
        seen = np.isfinite(self.depths[which])
        if not seen.any():
            return 0.0
        covered = self.depths[by][seen] > self.depths[which][seen] + TOUCHING * self.cell
        return float(covered.mean())

    def visible(self, which: int, occluders: Sequence[int]) -> NDArray[np.bool_]:
        """Return the cells, (rows, columns), in which a surface lies behind none of the occluders."""
        own = self.depths[which]
        front = self.depths[list(occluders)].max(axis=0) if len(occluders) else np.full_like(own, -np.inf)
        return np.isfinite(own) & (front <= own + TOUCHING * self.cell)

    def position(self, row: int, column: int) -> tuple[float, float]:
        """Return the middle of a cell, (right, up)."""
        return self.low[0] + (column + 0.5) * self.cell, self.low[1] + (row + 0.5) * self.cell


def depth_maps(surfaces: Sequence[tuple[NDArray[np.float64], NDArray[np.int32]]], cells: int = CELLS) -> DepthMaps:
    """Return the depth maps of surfaces.

    Parameters
    ----------
    surfaces : sequence of ((V, 3) float64, (F, 3) int32)
        Vertices along the camera's right, up and backward axis, and triangles.
    cells : int
        Along the longer side.
    """
    low = np.min([seen[:, :2].min(axis=0) for seen, _ in surfaces], axis=0)
    high = np.max([seen[:, :2].max(axis=0) for seen, _ in surfaces], axis=0)
    cell = max(float((high - low).max()) / cells, 1e-12)
    columns, rows = (int(size / cell) + 1 for size in high - low)
    depths = np.full((len(surfaces), rows * columns), -np.inf, np.float32)
    for depth, (seen, faces) in zip(depths, surfaces, strict=True):
        corners = seen[faces]  # (F, 3, 3)
        sides = corners - np.roll(corners, 1, axis=1)
        longest = np.sqrt((sides[..., :2] ** 2).sum(axis=2).max(axis=1))
        # Samples of a triangle are at most 0.7 cells apart, so that each cell inside of it has one.
        pieces = 2 ** np.ceil(np.log2(np.maximum(longest / (0.7 * cell), 1.0))).astype(np.int64)
        for count in np.unique(pieces).tolist():
            shares = _barycentric(count)  # (S, 3)
            those = corners[pieces == count]
            step = max(1, MOST_SAMPLES // len(shares))
            for first in range(0, len(those), step):
                samples = np.einsum("sk,fkx->fsx", shares, those[first : first + step]).reshape(-1, 3)
                column, row = ((samples[:, :2] - low) / cell).astype(np.int64).T
                np.maximum.at(depth, row * columns + column, samples[:, 2].astype(np.float32))
    return DepthMaps(depths.reshape(-1, rows, columns), (float(low[0]), float(low[1])), cell)


def _barycentric(pieces: int) -> NDArray[np.float64]:
    """Return barycentric coordinates, (S, 3), of the corners of a triangle with subdivided sides.

    Examples
    --------
    >>> _barycentric(1).tolist()
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    >>> len(_barycentric(4))
    15
    """
    first, second = np.mgrid[: pieces + 1, : pieces + 1].reshape(2, -1)
    inside = first + second <= pieces
    first, second = first[inside], second[inside]
    return np.stack([first, second, pieces - first - second], axis=1) / pieces


def hiding(maps: DepthMaps, lesions: Sequence[bool]) -> list[bool]:
    """Return which surfaces hide a lesion from the camera; without lesions, which one hides all other surfaces.

    Parameters
    ----------
    maps : DepthMaps
    lesions : sequence of bool
        Whether each surface is a lesion; a lesion never counts as hiding another.
    """
    every = range(len(lesions))
    if any(lesions):
        hidden = [at for at in every if lesions[at]]
        return [not lesions[by] and any(maps.hidden_share(at, by) > HIDES for at in hidden) for by in every]
    return [len(lesions) > 1 and all(maps.hidden_share(at, by) > HIDES_ALL for at in every if at != by) for by in every]
