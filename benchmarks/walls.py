# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies whose thickness is known at every point, sampled as fields and as labels, in any pose.

Millimeters about the body's center, its axis along z; the samples lie off its symmetry, so no error cancels by luck.
The truth is the diameter of the ball inside that touches the surface at a point; points whose ball an end limits, and
points within a voxel or two of an edge, are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import Budget, ReconstructionSettings, TriangleMesh, Volume, reconstruct
from ctmc_addon.core.maps.quantity import MappedSurface
from ctmc_addon.core.progress import finish

Doubles = NDArray[np.float64]
OFFSETS = (0.31, 0.17, 0.43)  # Offsets of the samples from the center, in spacings.
EDGE = 1.5  # Leave out what is so near the edge of an end, mm.
TURN_AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)


@dataclass(frozen=True)
class Wall:
    """A body with its thickness.

    Parameters
    ----------
    name : str
    depth : callable of points (3, ...)
        Above zero inside, mm near the surface.
    half : float
        Half of the side of a cube that it fits in, in any pose.
    thickness : callable of points (3, n) on the surface
        Diameters (n,), NaN where there is no closed form.
    """

    name: str
    depth: Callable[[Doubles], Doubles]
    half: float
    thickness: Callable[[Doubles], Doubles]


def shell(outer: float = 18.0, inner: float = 10.0) -> Wall:
    """Return what lies between two balls."""
    middle, half = (outer + inner) / 2, (outer - inner) / 2
    return Wall(
        "shell", lambda p: half - np.abs(_length(p) - middle), outer, lambda p: np.full(p.shape[1], outer - inner)
    )


def plate(thickness: float = 8.0, half: float = 20.0) -> Wall:
    """Return a square plate."""

    def true(p: Doubles) -> Doubles:
        within = np.maximum(np.abs(p[0]), np.abs(p[1])) < half - thickness / 2 - EDGE
        return np.where(within, thickness, np.nan)

    return Wall(
        "plate",
        lambda p: np.minimum(thickness / 2 - np.abs(p[2]), half - np.maximum(np.abs(p[0]), np.abs(p[1]))),
        np.sqrt(2) * half + thickness / 2,
        true,
    )


def tube(outer: float = 14.0, inner: float = 6.0, half: float = 18.0) -> Wall:
    """Return a tube along z."""
    wall = outer - inner

    def depth(p: Doubles) -> Doubles:
        radius = _length(p[:2])
        return np.minimum(np.minimum(outer - radius, radius - inner), half - np.abs(p[2]))

    return Wall(
        "tube",
        depth,
        float(np.hypot(outer, half)),
        lambda p: np.where(np.abs(p[2]) < half - wall / 2 - EDGE, wall, np.nan),
    )


def wedge(degrees: float = 20.0, height: float = 36.0, half: float = 16.0, least: float = 6.0) -> Wall:
    """Return a wedge with its edge along x, opening by twice `degrees` towards z; thinner than `least` is left out.

    A ball that touches both faces at a distance s from the edge has its center between them: its radius is s tan a.
    """
    return _opening("wedge", degrees, height, least, lambda p: np.abs(p[1]), half)


def cone(degrees: float = 25.0, height: float = 36.0, least: float = 6.0) -> Wall:
    """Return a cone along z; a ball touches it in a circle, at a distance s from the apex: its radius is s tan a."""
    return _opening("cone", degrees, height, least, lambda p: _length(p[:2]), None)


def _opening(
    name: str, degrees: float, height: float, least: float, aside: Callable[[Doubles], Doubles], half: float | None
) -> Wall:
    angle = np.radians(degrees)
    sine, cosine, tangent = np.sin(angle), np.cos(angle), np.tan(angle)
    top = height / 2

    def depth(p: Doubles) -> Doubles:
        inside = np.minimum((p[2] + top) * sine - aside(p) * cosine, top - p[2])
        return inside if half is None else np.minimum(inside, half - np.abs(p[0]))

    def true(p: Doubles) -> Doubles:
        along = (p[2] + top) * cosine + aside(p) * sine
        radius = along * tangent
        center = along / cosine - top
        on_side = np.abs(aside(p) * cosine - (p[2] + top) * sine) < EDGE / 2
        within = on_side & (2 * radius > least) & (center + radius < top - EDGE / 2)
        if half is not None:
            within &= np.abs(p[0]) + radius < half - EDGE / 2
        return np.where(within, 2 * radius, np.nan)

    width = height * tangent if half is None else np.hypot(height * tangent, half)
    return Wall(name, depth, float(np.hypot(top, width)), true)


WALLS = {wall.name: wall for wall in (shell(), plate(), wedge(), tube(), cone())}


def sampled(wall: Wall, spacing: float, degrees: float = 0.0, label: bool = False) -> Volume:
    """Return a volume of depths, or of label 1, of a body turned by `degrees`."""
    count = int(np.ceil(wall.half / spacing)) + 2
    axes = [(np.arange(-count, count + 1) + offset) * spacing for offset in OFFSETS]
    values = np.empty([len(axis) for axis in axes[::-1]], np.uint8 if label else np.float32)
    y, x = np.meshgrid(axes[1], axes[0], indexing="ij")
    turn = turned(degrees)
    for values_of_slice, z in zip(values, axes[2], strict=True):
        depth = wall.depth(turn[0, :, None, None] * x + turn[1, :, None, None] * y + turn[2, :, None, None] * z)
        values_of_slice[:] = depth >= 0 if label else depth
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = [axis[0] for axis in axes]
    return Volume(values, affine)


def turned(degrees: float) -> Doubles:
    """Return the rotation by an angle about an oblique axis (Rodrigues)."""
    x, y, z = TURN_AXIS
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across


def surface_of(volume: Volume, label: bool = False, **settings: Any) -> TriangleMesh:
    """Return the surface of a sampled body."""
    field = {"label": 1} if label else {"threshold": 0.0}
    return reconstruct(volume, ReconstructionSettings(**field, **settings)).mesh


def truth(wall: Wall, mesh: TriangleMesh, degrees: float = 0.0) -> Doubles:
    """Return the true thickness at the vertices, NaN where there is no closed form."""
    return truth_at(wall, mesh.vertices, degrees)


def truth_at(wall: Wall, points: NDArray[Any], degrees: float = 0.0) -> Doubles:
    """Return the true thickness at points (n, 3) of the surface, NaN where there is no closed form."""
    return wall.thickness(turned(degrees).T @ points.T.astype(np.float64))


def mapped(mesh: TriangleMesh, volume: Volume, threads: int = 1, label: bool = False) -> MappedSurface:
    """Return a surface for quantities that need no other surface."""

    def no_surface_steps(_: ReconstructionSettings) -> Any:
        raise AssertionError("no other surface is needed")

    settings = ReconstructionSettings(label=1) if label else ReconstructionSettings()
    return MappedSurface(mesh, settings, volume, Budget(threads=threads), no_surface_steps)


def values_of(quantity: Any, surface: MappedSurface) -> Doubles:
    """Return the values of a quantity."""
    return finish(quantity.values_steps(surface)).values.astype(np.float64)


def _length(vectors: Doubles) -> Doubles:
    return np.sqrt((vectors * vectors).sum(axis=0))
