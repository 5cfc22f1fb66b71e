# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of known area, volume and normals, sampled on grids of any spacing, and what extraction makes of them.

Millimeters about the body's center; the samples lie off its symmetry, so no error cancels by luck.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import TriangleMesh, marching_cubes

Doubles = NDArray[np.float64]
Triple = tuple[float, float, float]
OFFSETS = (0.31, 0.17, 0.43)  # Offsets of the samples from the center, in spacings.
AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)  # Axis of cylinder and capsule, oblique to the grid.
EVEN, UNEVEN = (1.0, 1.0, 1.0), (1.0, 1.0, 2.5)  # Proportions of spacings.


@dataclass(frozen=True)
class Shape:
    """A body with its truth.

    Parameters
    ----------
    name : str
    depth : callable of x, y, z
        Above zero inside; smooth at the surface wherever the body is.
    half : (x, y, z) float
        Half of the box it fits in, mm.
    area, volume : float
        mm2 and mm3.
    gradient : callable of points (n, 3)
        Outward normals (n, 3), of any length; None where the body has edges.
    area_order : float
        With which power of the spacing the area's error falls: 2 on smooth bodies. At an edge a strip as
        wide as a voxel is cut off, so there it is 1, and still 2 for the volume.
    """

    name: str
    depth: Callable[[Any, Any, Any], Doubles]
    half: Triple
    area: float
    volume: float
    gradient: Callable[[Doubles], Doubles] | None = None
    area_order: float = 2.0


def sphere(radius: float = 10.0) -> Shape:
    """Return a ball."""
    return Shape(
        "sphere",
        lambda x, y, z: radius - np.sqrt(x * x + y * y + z * z),
        (radius, radius, radius),
        4 * np.pi * radius**2,
        4 / 3 * np.pi * radius**3,
        lambda points: points,
    )


def ellipsoid(a: float = 12.0, b: float = 9.0, c: float = 6.0) -> Shape:
    """Return an ellipsoid with half axes a, b, c."""
    return Shape(
        "ellipsoid",
        lambda x, y, z: 1 - np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2),
        (a, b, c),
        ellipsoid_area(a, b, c),
        4 / 3 * np.pi * a * b * c,
        lambda points: points / np.array([a, b, c]) ** 2,
    )


def ellipsoid_area(a: float, b: float, c: float) -> float:
    """Return the area by a product rule on the sphere of directions, exact to rounding for our half axes."""
    height, weight = np.polynomial.legendre.leggauss(200)
    turn = (np.arange(400) + 0.5) * (2 * np.pi / 400)
    flat = np.sqrt(1 - height**2)[:, None]
    stretch = (b * c * flat * np.cos(turn)) ** 2 + (a * c * flat * np.sin(turn)) ** 2 + (a * b * height[:, None]) ** 2
    return float((np.sqrt(stretch).sum(axis=1) * weight).sum() * (2 * np.pi / 400))


def torus(ring: float = 8.0, tube: float = 3.0) -> Shape:
    """Return a tube about a ring in the plane of x and y."""

    def gradient(points: Doubles) -> Doubles:
        on_ring = points * [1, 1, 0]
        return points - ring * on_ring / np.sqrt((on_ring**2).sum(axis=1, keepdims=True))

    return Shape(
        "torus",
        lambda x, y, z: tube - np.sqrt((np.sqrt(x * x + y * y) - ring) ** 2 + z * z),
        (ring + tube, ring + tube, tube),
        4 * np.pi**2 * ring * tube,
        2 * np.pi**2 * ring * tube**2,
        gradient,
    )


def capsule(radius: float = 5.0, half: float = 5.0) -> Shape:
    """Return an oblique cylinder with round ends."""

    def depth(x: Any, y: Any, z: Any) -> Doubles:
        along = x * AXIS[0] + y * AXIS[1] + z * AXIS[2]
        beyond = along - np.clip(along, -half, half)
        return radius - np.sqrt(x * x + y * y + z * z - along * along + beyond * beyond)

    def gradient(points: Doubles) -> Doubles:
        return points - np.clip(points @ AXIS, -half, half)[:, None] * AXIS

    reach = radius + half
    volume = np.pi * radius**2 * 2 * half + 4 / 3 * np.pi * radius**3
    area = 4 * np.pi * radius * (half + radius)
    return Shape("capsule", depth, (reach, reach, reach), area, volume, gradient)


def cylinder(radius: float = 5.0, half: float = 8.0) -> Shape:
    """Return an oblique cylinder with flat ends and sharp edges."""

    def depth(x: Any, y: Any, z: Any) -> Doubles:
        along = x * AXIS[0] + y * AXIS[1] + z * AXIS[2]
        side = np.sqrt(x * x + y * y + z * z - along * along) - radius
        end = np.abs(along) - half
        return -np.minimum(np.maximum(side, end), 0) - np.sqrt(np.maximum(side, 0) ** 2 + np.maximum(end, 0) ** 2)

    reach = radius + half
    area = 2 * np.pi * radius * (2 * half + radius)
    return Shape("cylinder", depth, (reach, reach, reach), area, np.pi * radius**2 * 2 * half, area_order=1.0)


SHAPES = {shape.name: shape for shape in (sphere(), ellipsoid(), torus(), capsule(), cylinder())}


def sampled(shape: Shape, spacing: Triple) -> tuple[Doubles, Doubles]:
    """Return values (slices, rows, columns) float64, and the first sample's position (x, y, z), mm."""
    axes = []
    for gap, half, offset in zip(spacing, shape.half, OFFSETS, strict=True):
        count = int(np.ceil(half / gap)) + 2
        axes.append((np.arange(-count, count + 1) + offset) * gap)
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij", sparse=True)
    return shape.depth(x, y, z), np.array([axis[0] for axis in axes])


def extracted(shape: Shape, spacing: Triple, alpha: float = 1.0, normals: bool = False) -> TriangleMesh:
    """Return the body's surface, vertices in mm about its center; normals, if requested, in index space."""
    values, first = sampled(shape, spacing)
    mesh = marching_cubes(values, 0.0, alpha=alpha, normals=normals)
    return replace(mesh, vertices=(mesh.vertices * np.array(spacing) + first).astype(np.float32))


def errors(shape: Shape, spacing: Triple, alpha: float = 1.0) -> tuple[float, float]:
    """Return the relative errors of area and volume."""
    mesh = extracted(shape, spacing, alpha)
    return mesh.area / shape.area - 1, mesh.volume / shape.volume - 1


def order(steps: list[float], measured_errors: list[float]) -> float:
    """Return the order of an error in the spacing: the slope of the logarithms by least squares."""
    x, y = np.log(steps), np.log(np.abs(measured_errors))
    return float(((x - x.mean()) * (y - y.mean())).sum() / ((x - x.mean()) ** 2).sum())


def angles(normals: NDArray[Any], truth: NDArray[Any]) -> Doubles:
    """Return the degrees between two sets of vectors (n, 3), (n,)."""
    lengths = np.sqrt((normals.astype(np.float64) ** 2).sum(axis=1) * (truth**2).sum(axis=1))
    cross = np.sqrt((np.cross(normals, truth) ** 2).sum(axis=1)) / lengths
    along = (normals * truth).sum(axis=1) / lengths
    return np.degrees(np.arctan2(cross, along))
