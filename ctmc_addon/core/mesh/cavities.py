# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the component of a surface to which each cavity belongs: the smallest one around it.

From a point of every cavity a ray goes along +x. A component is around the point if the ray leaves it once
more than it enters it, which for closed ones holds along every ray (Jordan). Only triangles beside a
ray are looked at: they are put into bins across x as wide as the widest triangle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..progress import PAUSE, Steps
from .topology import FACES_PER_STEP
from .triangle_mesh import TriangleMesh

# A point within a triangle that lies over no other triangle's edge, however regular the grid.
WEIGHTS = (0.4142135, 0.3178372, 0.2679493)
PAIRS_PER_STEP = 1 << 19  # Test this many pairs of a ray and a triangle in a step.


def points_within(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return a point within each triangle, (n, 3), from its corners, (n, 3, 3)."""
    a, b, c = corners.astype(np.float64).transpose(1, 0, 2)  # (n, 3) each
    return np.asarray(a * WEIGHTS[0] + b * WEIGHTS[1] + c * WEIGHTS[2])


def smallest_around(
    cavities: NDArray[np.intp],
    volumes: NDArray[np.float64],
    ray: NDArray[np.intp],
    component: NDArray[Any],
    leaves: NDArray[Any],
) -> NDArray[np.intp]:
    """Return which component every component belongs to, (components,): itself, or for a cavity the one around it.

    A cavity with nothing around it, as where the surface is open, stays its own.

    Parameters
    ----------
    cavities : (rays,) intp
        Components.
    volumes : (components,) float64
        Signed, below zero for cavities.
    ray, component, leaves : (n,)
        Number of times that each ray leaves a component less those it enters it; repeated pairs are added up.
    """
    owner = np.arange(len(volumes))
    around, times = summed_pairs(ray * len(volumes) + component, leaves)
    ray, outer = np.divmod(around[times > 0], len(volumes))
    candidate = (volumes[outer] > 0) & (outer != cavities[ray])
    ray, outer = ray[candidate], outer[candidate]
    largest_first = np.argsort(-volumes[outer], kind="stable")  # the smallest is written last
    owner[cavities[ray[largest_first]]] = outer[largest_first]
    return owner


def summed_pairs(pairs: NDArray[np.int64], leaves: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return every pair of a ray and a component once, in order, and the sum of its `leaves`."""
    around, inverse = np.unique(pairs, return_inverse=True)
    return around, np.asarray(np.bincount(inverse.ravel(), leaves, len(around)), np.float64)


def crossings_steps(
    mesh: TriangleMesh, points: NDArray[np.float64]
) -> Steps[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.int8]]]:
    """Find the pairs of a ray from `points` along +x and a face, and whether it leaves (1) or enters (-1)."""
    faces, starts, stops = yield from _faces_near_rays_steps(mesh, points)
    counts = stops - starts  # (rays, 2)
    done = np.cumsum(counts.sum(axis=1))
    hits = []
    at = 0
    while at < len(points):
        end = max(at + 1, int(np.searchsorted(done, (done[at - 1] if at else 0) + PAIRS_PER_STEP)))
        pairs = counts[at:end].ravel()
        ray = np.repeat(np.arange(at, end).repeat(2), pairs)
        pair = np.arange(pairs.sum()) + np.repeat(starts[at:end].ravel() + pairs - np.cumsum(pairs), pairs)
        leaves = _directions(mesh, faces[pair], points[ray])
        hit = leaves != 0
        hits.append((ray[hit], faces[pair[hit]], leaves[hit]))
        at = end
        yield PAUSE
    ray, face, leaves = (np.concatenate(columns) for columns in zip(*hits, strict=True))
    return ray, face, leaves


def _faces_near_rays_steps(
    mesh: TriangleMesh, points: NDArray[np.float64]
) -> Steps[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]]:
    """Faces near the rays, sorted by bins, and for every ray the two ranges of them that it may meet, (rays, 2)."""
    y, z = mesh.vertices[:, 1], mesh.vertices[:, 2]
    chunks = range(0, len(mesh.faces), FACES_PER_STEP)
    widths, lows = [], []  # of the faces, a chunk each, (2, f)
    for start in chunks:
        corners = mesh.faces[start : start + FACES_PER_STEP].T
        a, b, c = (np.stack([y[corner], z[corner]]) for corner in corners)
        lows.append(np.minimum(np.minimum(a, b), c))
        widths.append((np.maximum(np.maximum(a, b), c) - lows[-1]).max(axis=1))
        yield PAUSE
    width = np.max(widths, axis=0).astype(np.float64)[:, None]  # (2, 1)
    width[width == 0] = 1.0
    lowest = np.min([low.min(axis=1) for low in lows], axis=0).astype(np.float64)[:, None]
    # One bin more on every side, which stays empty.
    rows = int((mesh.vertices[:, 2].max() - lowest[1, 0]) / width[1, 0]) + 4

    def bin_of(places: NDArray[Any]) -> NDArray[np.int64]:
        at = np.floor((places - lowest) / width).astype(np.int64) + 1
        return at[0] * rows + at[1]

    # A triangle over the point begins in the point's bin or in the one before, in y and in z.
    own = bin_of(points[:, 1:].T)
    last = np.stack([own - rows, own], axis=1)  # (rays, 2)
    near_ray = np.zeros(int((mesh.vertices[:, 1].max() - lowest[0, 0]) / width[0, 0] + 4) * rows, bool)
    near_ray[last] = near_ray[last - 1] = True
    bins, faces = [], []
    for start, low in zip(chunks, lows, strict=True):
        bin_number = bin_of(low)
        face = np.flatnonzero(near_ray[bin_number])
        bins.append(bin_number[face])
        faces.append(face + start)
        yield PAUSE
    sorted_bins, near_faces = np.concatenate(bins), np.concatenate(faces)
    order = np.argsort(sorted_bins, kind="stable")
    sorted_bins = sorted_bins[order]
    yield PAUSE
    return near_faces[order], np.searchsorted(sorted_bins, last - 1), np.searchsorted(sorted_bins, last, side="right")


def _directions(mesh: TriangleMesh, faces: NDArray[np.intp], points: NDArray[np.float64]) -> NDArray[np.int8]:
    """1 where the ray from the point along +x leaves through the face, -1 where it enters, 0 where it misses, (n,)."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = mesh.vertices[mesh.faces[faces]].astype(np.float64).transpose(1, 2, 0)
    px, py, pz = points.T
    # Twice the areas that the point makes with the sides, seen along x.
    ab = (by - ay) * (pz - az) - (bz - az) * (py - ay)
    bc = (cy - by) * (pz - bz) - (cz - bz) * (py - by)
    ca = (ay - cy) * (pz - cz) - (az - cz) * (py - cy)
    sign = np.sign(ab).astype(np.int8)
    over = (sign != 0) & (np.sign(bc) == sign) & (np.sign(ca) == sign)
    beyond = bc * (ax - px) + ca * (bx - px) + ab * (cx - px)  # the hit's way along x, times the whole area
    return np.where(over & (beyond * sign > 0), sign, 0).astype(np.int8)
