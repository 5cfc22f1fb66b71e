# SPDX-License-Identifier: GPL-3.0-or-later
"""Add camera and lights for F12 in a separate collection: key, fill and rim, sized to the subject.

The camera looks from the patient's front and left. Lights are areas as wide as the subject, so soft, and as far away
as they have to be for the whole of it; their energy grows with the square of that, so a scan of any size and scale is
lit alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..figure.spec import AZIMUTH, ELEVATION
from ..materials import mixed, use_nodes
from ..sockets import output_of
from .studio import corners_of, frame, matrix_of_axes, view_axes

NAME = "CTMC Studio"
BACKGROUND = 0.1  # Linear gray on which light bone and dark liver both stand out.
AMBIENT = 0.35


class _Lamp(NamedTuple):
    """A light relative to camera and subject.

    Parameters
    ----------
    turn, rise : float
        Degrees from the camera's azimuth and elevation.
    away, size : float
        Distance and side, in radii of the subject.
    share : float
        Brightness of a white surface that faces it, as a share of white.
    tint : (red, green, blue) float
    """

    turn: float
    rise: float
    away: float
    size: float
    share: float
    tint: tuple[float, float, float]


LAMPS = {
    "CTMC Key": _Lamp(-38.0, 32.0, 3.5, 2.0, 0.75, (1.0, 0.96, 0.9)),
    "CTMC Fill Light": _Lamp(48.0, 0.0, 4.0, 4.0, 0.22, (0.88, 0.94, 1.0)),
    "CTMC Rim": _Lamp(155.0, 35.0, 3.5, 2.0, 1.1, (1.0, 1.0, 1.0)),
}


def set_up_studio(
    scene: bpy.types.Scene, objects: Sequence[bpy.types.Object], azimuth: float = AZIMUTH, elevation: float = ELEVATION
) -> tuple[bpy.types.ID, ...]:
    """Add a camera framed on objects, three lights and a background to a scene, replacing earlier ones.

    All other objects, materials and lights stay as they are. What F12 depends on is set: the scene's camera, world,
    view transform, and enough light paths for translucent surfaces; engine, size and samples stay.

    Parameters
    ----------
    azimuth, elevation : float
        Camera position, degrees: from the patient's front towards the left, and up.

    Returns
    -------
    tuple of ID
        The new collection, objects, then their data, then the world.
    """
    _remove_studio(scene)
    points = np.concatenate([corners_of(obj, scene) for obj in objects])
    axes = view_axes(azimuth, elevation)
    middle, radius = sphere_of(points)
    folder = bpy.data.collections.new(NAME)
    scene.collection.children.link(folder)
    camera = bpy.data.cameras.new("CTMC Studio Camera")
    eye = bpy.data.objects.new(camera.name, camera)
    folder.objects.link(eye)
    frame(eye, points, axes, (scene.render.resolution_x, scene.render.resolution_y))
    scene.camera = eye
    lights = [_add_lamp(folder, name, lamp, middle, radius, azimuth, elevation) for name, lamp in LAMPS.items()]
    scene.world = gray_world()
    scene.view_settings.view_transform = "Standard"  # colors of anatomy as they are in lists and files
    scene.view_settings.look, scene.view_settings.exposure, scene.view_settings.gamma = "None", 0.0, 1.0
    if hasattr(scene, "cycles"):
        scene.cycles.max_bounces = max(scene.cycles.max_bounces, 4)
        scene.cycles.transparent_max_bounces = max(scene.cycles.transparent_max_bounces, 64)
    return (folder, eye, *lights, camera, *(light.data for light in lights), scene.world)


def sphere_of(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return middle (3,) and radius of the sphere around the box of points (n, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle: NDArray[np.float64] = (low + high) / 2
    return middle, max(float(np.sqrt(((high - low) ** 2).sum())) / 2, 1e-6)


def _add_lamp(
    folder: bpy.types.Collection,
    name: str,
    lamp: _Lamp,
    middle: NDArray[np.float64],
    radius: float,
    azimuth: float,
    elevation: float,
) -> bpy.types.Object:
    """Add an area light that looks at the middle of a subject of this radius."""
    light: Any = bpy.data.lights.new(name, "AREA")
    away, side = lamp.away * radius, lamp.size * radius
    light.shape, light.size, light.color = "SQUARE", side, lamp.tint
    # A square of this power lights what faces it at a distance with about power / (pi * distance^2): white is pi of it.
    light.energy = lamp.share * math.pi * away**2 * math.pi
    obj = bpy.data.objects.new(name, light)
    axes = view_axes(azimuth + lamp.turn, min(elevation + lamp.rise, 89.0))
    obj.matrix_world = matrix_of_axes(axes, middle + away * axes[:, 2])
    folder.objects.link(obj)
    return obj


def gray_world() -> bpy.types.World:
    """Dark gray to the camera, a soft light to what it lights."""
    world = bpy.data.worlds.new(NAME)
    use_nodes(world)
    tree = world.node_tree
    tree.nodes.clear()
    output, path = (tree.nodes.new(kind) for kind in ("ShaderNodeOutputWorld", "ShaderNodeLightPath"))
    shaders = []
    for level in (AMBIENT, BACKGROUND):
        background = tree.nodes.new("ShaderNodeBackground")
        background.inputs["Color"].default_value = (level, level, level, 1.0)
        shaders.append(output_of(background, "Background"))
    tree.links.new(mixed(tree, path.outputs["Is Camera Ray"], *shaders), output.inputs["Surface"])
    world.color = (BACKGROUND,) * 3
    return world


def _remove_studio(scene: bpy.types.Scene) -> None:
    """Remove a scene's earlier studio with its objects; other objects in it move to the scene."""
    for folder in [child for child in scene.collection.children if child.name.partition(".")[0] == NAME]:
        for obj in list(folder.objects):
            if obj.type in ("CAMERA", "LIGHT") and obj.name.startswith("CTMC "):
                data = obj.data
                bpy.data.objects.remove(obj)
                if not data.users:
                    (bpy.data.cameras if isinstance(data, bpy.types.Camera) else bpy.data.lights).remove(data)
            elif not any(obj.name in other.objects for other in obj.users_collection if other != folder):
                scene.collection.objects.link(obj)
        bpy.data.collections.remove(folder)
    old = scene.world
    if old is not None and old.name.partition(".")[0] == NAME and old.users == 1:
        scene.world = None
        bpy.data.worlds.remove(old)
