# SPDX-License-Identifier: GPL-3.0-or-later
"""Add camera and lights for F12 in a separate collection: key, fill and rim, sized to the subject.

The camera looks from the patient's front and left. Lights are areas as wide as the subject, so soft, and as far away
as they have to be for the whole of it; their energy grows with the square of that, so a scan of any size and scale is
lit alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..figure.spec import AZIMUTH, ELEVATION
from .background import NAME, is_studio_world, show_background
from .ct_box import boxes_of_scene
from .new_file import is_first_camera, is_first_light
from .studio import corners_of, frame, matrix_of_axes, view_axes

CAMERA = "CTMC Studio Camera"
STATE = "ctmc_state"
"""The collection's property: numbers of camera and lights as they were set up."""
LINE = 0.08  # Length of the lines that the viewport draws from lights and camera, as a share of their distance.
CLEARANCE = 1.1  # Distance of a light, as a multiple of that of the furthest corner towards it.


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
    scene: bpy.types.Scene,
    objects: Sequence[bpy.types.Object],
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    background: str = "GRADIENT",
) -> tuple[bpy.types.ID, ...]:
    """Add a camera framed on objects, three lights and a background to a scene, replacing earlier ones.

    Other objects, materials and lights stay as they are, except that renders do not see the light of a new file. The
    scene's camera, world and view transform are set; engine, size and samples stay. Camera and lights stand outside
    the CTs' boxes, and clicks do not catch the lights.

    Parameters
    ----------
    azimuth, elevation : float
        Camera position, degrees: from the patient's front towards the left, and up.
    background : str
        One of `BACKGROUNDS`.

    Returns
    -------
    tuple of ID
        The new collection, objects, then their data, then the world.
    """
    _remove_studio(scene)
    points = np.concatenate([corners_of(obj, scene) for obj in objects])
    around = np.concatenate([points, *map(_corners_of_box, boxes_of_scene(scene))])
    folder = bpy.data.collections.new(NAME)
    scene.collection.children.link(folder)
    camera = bpy.data.cameras.new(CAMERA)
    camera.display_size = LINE  # The frame that the viewport draws stays off the patient, too.
    eye = bpy.data.objects.new(camera.name, camera)
    folder.objects.link(eye)
    size = (scene.render.resolution_x, scene.render.resolution_y)
    frame(eye, points, view_axes(azimuth, elevation), size, around)
    scene.camera = eye
    lights = [_add_lamp(folder, name, lamp, points, around, azimuth, elevation) for name, lamp in LAMPS.items()]
    for obj in filter(is_first_light, scene.objects):
        obj.hide_render = True
    is_first = not is_studio_world(scene.world)
    show_background(scene, background)
    if is_first:  # Later changes of a user stay.
        scene.view_settings.view_transform = "Standard"  # Shows colors of anatomy as they are in lists and files.
        scene.view_settings.look, scene.view_settings.exposure, scene.view_settings.gamma = "None", 0.0, 1.0
    folder[STATE] = _state_of(folder)
    return (folder, eye, *lights, camera, *(light.data for light in lights), scene.world)


def has_placed_camera(scene: bpy.types.Scene) -> bool:
    """Return whether a person has placed the scene's camera or changed the studio's lights."""
    eye, folder = scene.camera, _studio_of(scene)
    if eye is None or is_first_camera(eye):
        return False
    if folder is None or eye.name not in folder.objects:
        return True
    now, before = _state_of(folder), list(folder.get(STATE, ()))
    return len(now) != len(before) or not np.allclose(now, before, rtol=1e-5, atol=1e-6)


def _state_of(folder: bpy.types.Collection) -> list[float]:
    """Return the numbers of a studio that change if a person changes its camera or lights."""
    numbers: list[float] = []
    for obj in sorted(folder.objects, key=lambda obj: obj.name):
        data: Any = obj.data
        numbers += [float(value) for row in obj.matrix_basis for value in row] + [float(obj.hide_render)]
        if obj.type == "LIGHT":
            numbers += [data.energy, data.size, *data.color]
        elif obj.type == "CAMERA":
            numbers += [data.ortho_scale, data.lens, data.shift_x, data.shift_y, float(data.type == "ORTHO")]
    return numbers


def _studio_of(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """Return the studio of a scene, if there is one."""
    return next((child for child in scene.collection.children if child.name.partition(".")[0] == NAME), None)


def _corners_of_box(box: bpy.types.Object) -> NDArray[np.float64]:
    """Return the corners of a CT's box, (8, 3), in the scene."""
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    return np.array(box.location) + signs * np.array(box.scale)


def sphere_of(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return middle (3,) and radius of the sphere around the box of points (n, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle: NDArray[np.float64] = (low + high) / 2
    return middle, max(float(np.sqrt(((high - low) ** 2).sum())) / 2, 1e-6)


def _add_lamp(
    folder: bpy.types.Collection,
    name: str,
    lamp: _Lamp,
    points: NDArray[np.float64],
    around: NDArray[np.float64],
    azimuth: float,
    elevation: float,
) -> bpy.types.Object:
    """Add an area light that looks at the middle of a subject, with all points `around` it on its bright side."""
    light: Any = bpy.data.lights.new(name, "AREA")
    middle, radius = sphere_of(points)
    axes = view_axes(azimuth + lamp.turn, min(elevation + lamp.rise, 89.0))
    clear = CLEARANCE * float(((around - middle) * axes[:, 2]).sum(axis=1).max())
    radius = max(radius, clear / lamp.away)
    away, side = lamp.away * radius, lamp.size * radius
    light.shape, light.size, light.color = "SQUARE", side, lamp.tint
    light.cutoff_distance = LINE * away  # Unused but for the line that the viewport draws, which stays off the patient.
    # A square of this power lights what faces it at a distance with about power / (pi * distance^2): white is pi of it.
    light.energy = lamp.share * math.pi * away**2 * math.pi
    obj = bpy.data.objects.new(name, light)
    obj.matrix_world = matrix_of_axes(axes, middle + away * axes[:, 2])
    obj.hide_select = True  # A click on what lies behind it is meant for that.
    folder.objects.link(obj)
    return obj


def _remove_studio(scene: bpy.types.Scene) -> None:
    """Remove a scene's earlier studio with its objects; other objects in it move to the scene."""
    for folder in [child for child in scene.collection.children if child.name.partition(".")[0] == NAME]:
        for obj in list(folder.objects):
            if obj.type in ("CAMERA", "LIGHT") and obj.name.startswith("CTMC "):
                data = obj.data
                bpy.data.objects.remove(obj)
                if not data.users:
                    (bpy.data.cameras if isinstance(data, bpy.types.Camera) else bpy.data.lights).remove(data)
            elif not any(obj.name in collection.objects for collection in obj.users_collection if collection != folder):
                scene.collection.objects.link(obj)
        bpy.data.collections.remove(folder)
