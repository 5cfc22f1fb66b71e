# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of closed form, and their labels: what surfaces made from labels are measured against.

A body is a function of points in millimeters, positive inside. Every body has a true surface: a fine mesh of
the same function, whose vertices are moved onto its zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

Doubles = NDArray[np.float64]
Body = Callable[[Doubles, Doubles, Doubles], Doubles]


@dataclass(frozen=True)
class Labelled:
    """A label volume, its affine from (x, y, z) index to mm, and the true surface in mm."""

    mask: NDArray[np.bool_]
    affine: Doubles
    vertices: Doubles
    faces: NDArray[Any]
    volume: float


def harmonics(seed: int, radius: float = 21.5, height: float = 0.14) -> Body:
    """Make a star-shaped blob: its radius has smooth waves of degree 2 to 4 over the directions."""
    random = np.random.default_rng(seed)
    waves = random.normal(size=(6, 3))
    waves /= np.linalg.norm(waves, axis=1, keepdims=True)
    powers = random.integers(2, 5, 6)
    sizes = random.normal(size=6) * height

    def body(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
        r = np.sqrt(x * x + y * y + z * z) + 1e-9
        swell = sum(
            size * ((x * a + y * b + z * c) / r) ** power
            for (a, b, c), power, size in zip(waves, powers, sizes, strict=True)
        )
        return radius * (1 + swell) - r

    return body


def drops(seed: int, radius: float = 17.0) -> Body:
    """Make five drops that have run into each other."""
    random = np.random.default_rng(seed)
    centers = random.uniform(-14, 14, (5, 3))

    def body(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
        total = sum(np.exp(-((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) / (0.9 * radius**2)) for a, b, c in centers)
        return 10.0 * np.log(total / 0.9)

    return body


def bean(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
    """Make a bent, oblique ellipsoid."""
    u, v, w = 0.8 * x + 0.6 * z, y, -0.6 * x + 0.8 * z
    v = v + 0.012 * u * u - 4.0
    return 20.0 * (1.0 - np.sqrt((u / 32) ** 2 + (v / 19) ** 2 + (w / 16.5) ** 2 + 1e-12))


def box(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
    """Make a box with well rounded edges: flat faces oblique to the slices."""
    u, v, w = 0.936 * x + 0.352 * z, y, -0.352 * x + 0.936 * z
    u, v = 0.94 * u + 0.342 * v, -0.342 * u + 0.94 * v
    return 18.0 * (1.0 - ((u / 19) ** 4 + (v / 17) ** 4 + (w / 18) ** 4 + 1e-12) ** 0.25)


def torus(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
    """Make an oblique ring: 22 mm, and 8 mm thick at every side."""
    u, w = 0.866 * x + 0.5 * z, -0.5 * x + 0.866 * z
    return 8.0 - np.sqrt((np.sqrt(u * u + y * y) - 22.0) ** 2 + w * w)


def tube(diameter: float, length: float = 60.0) -> Body:
    """Make a tube along a helix, at least 30 degrees to the slices; its ends are half balls."""
    turns = np.linspace(0, 1, 240)
    path = np.stack([16 * np.cos(5 * turns), 16 * np.sin(5 * turns), length * (turns - 0.5)], axis=1)
    return _along([path], [diameter / 2])


def vessels(trunk: float = 5.0) -> Body:
    """Make a trunk that branches twice, thinner at every branch."""
    t = np.linspace(0, 1, 160)[:, None]
    root, fork, left, right = (np.array(p, float) for p in ([0, 0, -34], [2, 1, -4], [-16, 6, 12], [14, -4, 10]))
    tips = [np.array(p, float) for p in ([-26, -4, 30], [-12, 18, 32], [24, 8, 28], [12, -20, 26])]
    legs = [(root, fork, 1.0), (fork, left, 0.75), (fork, right, 0.75)]
    legs += [(left, tips[0], 0.5), (left, tips[1], 0.5), (right, tips[2], 0.5), (right, tips[3], 0.5)]
    return _along([a + (b - a) * t for a, b, _ in legs], [trunk * share for _, _, share in legs])


def _along(paths: list[Doubles], radii: list[float]) -> Body:
    from scipy.spatial import cKDTree

    trees = [cKDTree(path) for path in paths]

    def body(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
        points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        depths = np.full(len(points), -2.0)
        for tree, path, radius in zip(trees, paths, radii, strict=True):
            apart, nearest = tree.query(points, distance_upper_bound=radius + 2.0)
            close = np.flatnonzero(nearest < len(path))
            nearest, apart, some = nearest[close], apart[close], points[close]
            # The nearest point of the two pieces beside the nearest corner of the path.
            for step in (-1, 1):
                other = path[np.clip(nearest + step, 0, len(path) - 1)] - path[nearest]
                t = ((some - path[nearest]) * other).sum(axis=1) / np.maximum((other**2).sum(axis=1), 1e-12)
                foot = path[nearest] + np.clip(t, 0, 1)[:, None] * other
                apart = np.minimum(apart, np.sqrt(((some - foot) ** 2).sum(axis=1)))
            depths[close] = np.maximum(depths[close], radius - apart)
        return depths.reshape(x.shape)

    return body


BLOBS: dict[str, Body] = {
    "waves 1": harmonics(1, 25.0, 0.10),
    "waves 2": harmonics(5, 21.5, 0.12),
    "drops": drops(3),
    "bean": bean,
    "box": box,
}


def labelled(body: Body, spacing: tuple[float, float, float], reach: float, fine: float = 0.5, turn: float = 0.0):
    """Sample the label of a body on a grid of this spacing, turned against the body by an angle in degrees."""
    angle = np.deg2rad(turn)
    about_x = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    about_z = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    axes = about_z @ about_x * np.array(spacing)
    counts = [int(np.ceil(2 * reach * (1.3 if turn else 1.0) / side)) + 3 for side in spacing]
    affine = np.eye(4)
    affine[:3, :3] = axes
    affine[:3, 3] = -axes @ ((np.array(counts) - 1) / 2.0 + np.array([0.13, 0.29, 0.41]))
    k, j, i = np.meshgrid(*(np.arange(n) for n in counts[::-1]), indexing="ij")
    x, y, z = (affine[r, 0] * i + affine[r, 1] * j + affine[r, 2] * k + affine[r, 3] for r in range(3))
    mask = body(x, y, z) >= 0
    side = np.arange(-reach - 1.0, reach + 1.0 + fine, fine)
    z, y, x = np.meshgrid(side, side, side, indexing="ij")
    vertices, faces, _, _ = marching_cubes(body(x, y, z), 0.0)
    points = vertices[:, ::-1] * fine + side[0]
    for _ in range(3):  # Newton along the gradient, onto the surface itself
        step = 1e-3
        here = body(*points.T)
        slope = np.stack([(body(*(points + step * e).T) - here) / step for e in np.eye(3)], axis=1)
        points = points - np.clip(here / (slope**2).sum(axis=1), -0.2, 0.2)[:, None] * slope
    corners = points[faces]
    volume = float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)
    if volume < 0:
        faces, volume = faces[:, ::-1], -volume
    return Labelled(mask, affine, points, np.ascontiguousarray(faces), volume)
