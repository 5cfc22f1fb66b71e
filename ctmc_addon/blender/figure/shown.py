# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the color and opacity of each surface of a figure, for the command line and the panel."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.volume import is_lesion
from ..exploded import scene_shifts, triangles_in_scene
from ..materials import material_color, material_opacity
from ..scene.studio import view_axes
from .rendering.visibility import depth_maps, hiding
from .spec import FigureStyle, ShownSurface, Transparency


def shown_surfaces(
    objects: Sequence[bpy.types.Object],
    scene: bpy.types.Scene | None,
    style: FigureStyle,
    names: Sequence[str] = (),
    opacities: Sequence[float | None] = (),
    transparency: Transparency | None = None,
    explode: float = 0.0,
) -> tuple[ShownSurface, ...]:
    """Return objects with color and opacity: a single one opaque in the color of the style, several in their own.

    A surface that hides a tumor from the camera is translucent unless its opacity is given. Other surfaces have the
    opacity of their material, which follows from their anatomical name.

    Parameters
    ----------
    scene : Scene or None
        Scene in which the objects are evaluated; None takes the first scene that holds each.
    names : sequence of str
        Names for legend and anatomy; by default those of the objects, without a legend.
    opacities : sequence of float or None
        Opacity that the user has set for each object; None for none.
    explode : float
        Shift of the farthest of several in an exploded view, mm.
    """
    opacities = opacities or [None] * len(objects)
    if len(objects) == 1:
        name = names[0] if names else ""
        by_hand = opacities[0]
        return (ShownSurface(objects[0], written(name), opacity=1.0 if by_hand is None else by_hand),)
    called = names or [obj.name for obj in objects]
    hides = [False] * len(objects)
    shifts = [(0.0, 0.0, 0.0)] * len(objects)
    if explode or None in opacities:
        triangles = [triangles_in_scene(obj, scene) for obj in objects]
        if explode:
            shifts = scene_shifts(objects, triangles, explode)
        if None in opacities:
            axes = view_axes(style.azimuth, style.elevation)
            seen = [
                (_along(axes, points + shift), faces) for (points, faces), shift in zip(triangles, shifts, strict=True)
            ]
            hides = hiding(depth_maps(seen), [is_lesion(name) for name in called])
    most = (transparency or Transparency()).hiding_opacity
    shown = []
    for at, obj in enumerate(objects):
        by_hand, own = opacities[at], material_opacity(obj)
        opacity = by_hand if by_hand is not None else min(own, most) if hides[at] else own
        color = None if style.style == "print" else material_color(obj)
        shown.append(ShownSurface(obj, written(names[at]) if names else "", color, opacity, shifts[at]))
    return tuple(shown)


def written(name: str) -> str:
    """Return a structure's name in plain writing: 'rib left 7' for 'rib_left_7'."""
    return name.replace("_", " ")


def _along(axes: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points along the camera's axes, (n, 3)."""
    return np.stack([(points * axes[:, at]).sum(axis=1) for at in range(3)], axis=1)
