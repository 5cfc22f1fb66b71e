# SPDX-License-Identifier: GPL-3.0-or-later
"""Set up camera, light and background for one surface, in Blender units.

The camera is orthographic, so lengths can be compared across a picture. It looks from the patient's front,
a little from the left and from above, the head upwards.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.volume import transform_points
from ..figure.spec import AZIMUTH, ELEVATION
from ..materials import mixed, use_nodes
from ..sockets import output_of
from ..surface import mesh_data as meshes
from ..surface.evaluate import evaluated_object
from ..surface.placement import matrix_of

SIZE = (1200, 900)
MARGIN = 1.12
SAMPLES = 9
WORLD = 0.25  # Strength of the light from all sides.
WHITE = (1.0, 1.0, 1.0)


class Sun(NamedTuple):
    """A light at infinity, relative to the camera.

    Parameters
    ----------
    turn, rise : float
        Degrees from the camera's azimuth and elevation.
    share : float
        Brightness of a white surface that faces it, as a share of white.
    angle : float
        Width of its disc, degrees: the wider, the softer the edge of a shadow.
    shadow : bool
    tint : (red, green, blue) float
    """

    turn: float
    rise: float
    share: float
    angle: float
    shadow: bool
    tint: tuple[float, float, float] = WHITE


# A sun beyond the right shoulder, so wide that the edge of a shadow does not show the triangles that cast it; and a
# fill from the camera, without shadows: what the sun does not reach keeps its form.
SUNS = {"CTMC Light": Sun(32.0, 28.0, 0.6, 12.0, True), "CTMC Fill": Sun(0.0, 0.0, 0.2, 0.0, False)}


def prepare_scene(
    scene: bpy.types.Scene,
    objects: Sequence[bpy.types.Object],
    size: tuple[int, int] = SIZE,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
) -> tuple[bpy.types.ID, ...]:
    """Make `scene` ready to look at and to render: a camera framed on `objects`, a light, a white background.

    Parameters
    ----------
    size : (width, height) int
        Size of the picture, pixels.
    azimuth, elevation : float
        Camera position, degrees: from the patient's front towards the left, and up.

    Returns
    -------
    tuple of ID
        The new objects, then their data, then the world.
    """
    axes = view_axes(azimuth, elevation)
    points = np.concatenate([corners_of(obj, scene) for obj in objects])
    camera = bpy.data.cameras.new("CTMC Camera")
    eye = bpy.data.objects.new("CTMC Camera", camera)
    frame(eye, points, axes, size)
    scene.collection.objects.link(eye)
    scene.camera = eye
    light, fill, *data = add_light(scene, azimuth, elevation)
    set_render(scene, size)
    return eye, light, fill, camera, *data


def corners_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Return all vertices of an object as shown, (n, 3), in the scene."""
    with evaluated_object(obj, scene) as (evaluated, _):
        return transform_points(matrix_of(evaluated.matrix_world), meshes.read_positions(evaluated.data))


def add_light(
    scene: bpy.types.Scene,
    azimuth: float,
    elevation: float,
    suns: Mapping[str, Sun] = SUNS,
    world: float = WORLD,
    paper: tuple[float, float, float] = WHITE,
) -> tuple[bpy.types.ID, ...]:
    """Add suns around the scene's camera, which stands at these angles, and a world that is seen as `paper`.

    Returns objects first, then their data, then the world. By default they light a white surface to less than white.
    """
    lights = [bpy.data.lights.new(name, "SUN") for name in suns]
    objects = [bpy.data.objects.new(light.name, light) for light in lights]
    for obj, light, sun in zip(objects, lights, suns.values(), strict=True):
        axes = sun_axes(sun, azimuth, elevation)
        obj.matrix_world = matrix_of_axes(axes, scene.camera.matrix_world.translation)
        light.energy, light.angle, light.color = sun.share * math.pi, math.radians(sun.angle), sun.tint
        light.use_shadow = sun.shadow
        if hasattr(light, "cycles") and hasattr(light.cycles, "cast_shadow"):
            light.cycles.cast_shadow = sun.shadow
        scene.collection.objects.link(obj)
    scene.world = page_world(paper, world)
    return *objects, *lights, scene.world


def sun_axes(sun: Sun, azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return the axes of a sun for a camera that stands at these angles, (3, 3); the last column points towards it.

    Parameters
    ----------
    sun : Sun
    azimuth, elevation : float
        Degrees; above 90 a sun stands beyond the head, which is still upwards.
    """
    return view_axes(azimuth + sun.turn, elevation + sun.rise)


def view_axes(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return a camera's right, up and backward axis as the columns of a (3, 3) rotation.

    Parameters
    ----------
    azimuth : float
        Degrees.
    elevation : float
        Degrees.
    """
    turn, rise = math.radians(azimuth), math.radians(elevation)
    back = (-math.sin(turn) * math.cos(rise), math.cos(turn) * math.cos(rise), math.sin(rise))
    right = (-math.cos(turn), -math.sin(turn), 0.0)
    up = np.cross(back, right)
    return np.array([right, up, back]).T


def angles_of(backward: Sequence[float]) -> tuple[float, float]:
    """Return azimuth and elevation of a camera, degrees; the inverse of `view_axes`.

    Parameters
    ----------
    backward : (3,) float
        The camera's backward axis.

    Examples
    --------
    >>> angles_of((0.0, 1.0, 0.0)), angles_of((-1.0, 0.0, 0.0)), angles_of((0.0, 0.0, 1.0))
    ((0.0, 0.0), (90.0, 0.0), (0.0, 90.0))
    """
    x, y, z = backward
    across = math.hypot(x, y)
    azimuth = math.degrees(math.atan2(-x, y)) if across > 1e-6 else 0.0
    return azimuth + 0.0, math.degrees(math.atan2(z, across))


def matrix_of_axes(axes: NDArray[np.float64], location: Any = (0.0, 0.0, 0.0)) -> Any:
    """Return the 4 x 4 matrix of an object.

    Parameters
    ----------
    axes : (3, 3) float64
        Its axes as columns.
    location : (3,) float
        In Blender units.
    """
    from mathutils import Matrix

    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = location
    return Matrix(matrix.tolist())


def frame(
    eye: bpy.types.Object,
    points: NDArray[np.float64],
    axes: NDArray[np.float64],
    size: tuple[int, int],
    around: NDArray[np.float64] | None = None,
) -> None:
    """Place an orthographic camera so that all points fill a picture, with a margin.

    Parameters
    ----------
    eye : bpy.types.Object
        The camera.
    points : (n, 3) float64
        In Blender units.
    axes : (3, 3) float64
        Axes as `view_axes` returns them.
    size : (width, height) int
        Pixels.
    around : (m, 3) float64, optional
        Points that the camera stands in front of, though they need not be in the picture.
    """
    seen = np.stack([(points * axes[:, axis]).sum(axis=1) for axis in range(3)], axis=1)  # Right, up, backward.
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent, middle = high - low, (low + high) / 2
    longest = max(size)
    shown = MARGIN * max(extent[0] * longest / size[0], extent[1] * longest / size[1], 1e-6)
    away = extent[2] / 2 + shown
    if around is not None:
        away = max(away, float((around * axes[:, 2]).sum(axis=1).max()) - middle[2] + 0.1 * shown)
    middle[2] += away
    camera = eye.data
    camera.type = "ORTHO"
    camera.ortho_scale = shown
    camera.clip_start, camera.clip_end = away * 1e-3, 2.0 * away + extent[2]
    eye.matrix_world = matrix_of_axes(axes, axes @ middle)


def swept(points: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points around the volume that points sweep when they turn about a vertical axis.

    Parameters
    ----------
    points : (n, 3) float64
    axis : (3,) float64
        A point on the axis.
    """
    away = points - axis
    reach = float(np.sqrt((away[:, :2] ** 2).sum(axis=1).max()))
    around = np.radians(np.arange(0, 360, 5))
    ring = np.stack([reach * np.cos(around), reach * np.sin(around)], axis=1)
    heights = (away[:, 2].min(), away[:, 2].max())
    return np.concatenate([np.column_stack([ring, np.full(len(ring), height)]) for height in heights]) + axis


def page_world(paper: tuple[float, float, float] = WHITE, strength: float = WORLD) -> bpy.types.World:
    """Return a world of one color to the camera, and a soft white of some strength to what it lights."""
    world = bpy.data.worlds.new("CTMC World")
    use_nodes(world)
    tree = world.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputWorld")
    path = tree.nodes.new("ShaderNodeLightPath")
    shaders = []
    for color, level in ((WHITE, strength), (paper, 1.0)):
        background = tree.nodes.new("ShaderNodeBackground")
        background.inputs["Color"].default_value = (*color, 1.0)
        background.inputs["Strength"].default_value = level
        shaders.append(output_of(background, "Background"))
    tree.links.new(mixed(tree, path.outputs["Is Camera Ray"], *shaders), output.inputs["Surface"])
    return world


def set_render(scene: bpy.types.Scene, size: tuple[int, int]) -> None:
    """Render with Cycles on the CPU, which every machine has, with true colors and no machine data in the file."""
    render = scene.render
    render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.use_light_tree = False
    scene.cycles.seed = 0
    scene.cycles.max_bounces = 0
    scene.view_settings.view_transform = "Standard"
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    render.dither_intensity = 0.0  # White stays white.
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGB"
    render.filepath = "//"
    for name in [prop.identifier for prop in render.bl_rna.properties]:
        if name.startswith("use_stamp"):
            setattr(render, name, False)
