# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep distances and angles between points on surfaces as objects of the scene: a thin wire with its value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import bpy
import numpy as np
from mathutils import Vector

from ..core import MeshError, length_text
from ..core.mesh import angle_at, distance_between, where_ray_hits
from .scene.ct_box import link_beside_ct
from .surface import mesh_data as meshes, placement_of, read_provenance, shown_faces
from .surface.evaluate import evaluated_object

PROPERTY = "ctmc_ruler"
"""The object's custom property: kind and value."""
KINDS: Mapping[str, int] = {"distance": 2, "angle": 3}
"""Number of points of each kind."""
UNITS: Mapping[str, str] = {"distance": "mm", "angle": "\N{DEGREE SIGN}"}
WIRE_MM = 0.4  # Radius of the wire.
COLOR = (1.0, 0.72, 0.05, 1.0)
BEHIND = 1e-4  # A ray continues this many Blender units behind a wire.
Point = Sequence[float]


def is_ruler(obj: bpy.types.Object | None) -> bool:
    """Return whether an object is a distance or an angle."""
    return obj is not None and hasattr(obj.get(PROPERTY), "keys") and obj[PROPERTY].get("kind") in KINDS


def rulers_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the rulers of a scene in the order in which they were made."""
    return [obj for obj in scene.objects if is_ruler(obj)]


def value_text(kind: str, value: float) -> str:
    """Return the value with its unit.

    Examples
    --------
    >>> value_text("distance", 12.345), value_text("distance", 0.0456), value_text("angle", 90.0)
    ('12.3 mm', '45.6 um', '90.0°')
    """
    if kind == "distance" and value < 1:
        return length_text(value, 3)
    return f"{value:.1f}{'' if kind == 'angle' else ' '}{UNITS[kind]}"


def text_of(ruler: bpy.types.Object) -> str:
    """Return the text of a ruler, its value with the unit."""
    return value_text(ruler[PROPERTY]["kind"], ruler[PROPERTY]["value"])


def place_of(ruler: bpy.types.Object) -> Vector:
    """Return the position of a ruler's text: the middle of a distance, the corner of an angle; world space."""
    world_points = points_of(ruler)
    return world_points[1] if ruler[PROPERTY]["kind"] == "angle" else (world_points[0] + world_points[1]) / 2


def points_of(ruler: bpy.types.Object) -> list[Vector]:
    """Return the points of a ruler; world space."""
    return [ruler.matrix_world @ point.co.to_3d() for point in ruler.data.splines[0].points]


def patient_mm(obj: bpy.types.Object | None, world_point: Point, scale: float) -> tuple[float, float, float]:
    """Return the position in the patient, RAS+ mm, of a point in world space.

    A point on a surface of ours has its reconstructed position, however the object was moved or scaled.
    """
    provenance = read_provenance(obj)
    if obj is None or provenance is None:
        x, y, z = (value / scale for value in world_point)
        return (x, y, z)
    local = obj.matrix_world.inverted() @ Vector(world_point)
    x, y, z = placement_of(obj).to_mm(np.array([local[:]], np.float32))[0].tolist()
    return (x, y, z)


def measured(points_mm: Sequence[Point]) -> float:
    """Return the distance of two points in mm, or the angle at the second of three in degrees.

    Raises
    ------
    MeshError
        If two points that follow each other are the same.
    """
    if any(distance_between(a, b) == 0 for a, b in pairwise(points_mm)):
        raise MeshError("two points are the same; click on points that lie apart")
    return distance_between(*points_mm) if len(points_mm) == KINDS["distance"] else angle_at(*points_mm)


def add_ruler(
    scene: bpy.types.Scene,
    kind: str,
    world_points: Sequence[Point],
    name: str,
    scale: float,
    points_mm: Sequence[Point] | None = None,
    fingerprint: str = "",
) -> bpy.types.Object:
    """Add a distance or an angle to the scene.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    world_points : sequence of (x, y, z)
        In world space, Blender units; the corner of an angle is the second.
    name : str
        Name of the object, before its value.
    scale : float
        Blender units of 1 mm.
    points_mm : sequence of (x, y, z), optional
        The same points in the patient; without them `world_points` by the scale.
    fingerprint : str
        Fingerprint of the measured CT.

    Raises
    ------
    MeshError
        If two points are the same.
    """
    value = measured(points_mm or [patient_mm(None, world_point, scale) for world_point in world_points])
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions, curve.bevel_depth, curve.use_fill_caps = "3D", WIRE_MM * scale, True
    origin = np.mean(world_points, axis=0)
    spline = curve.splines.new("POLY")
    spline.points.add(len(world_points) - 1)
    for point, world_point in zip(spline.points, np.asarray(world_points, np.float64) - origin, strict=True):
        point.co = (*world_point.tolist(), 1.0)
    curve.materials.append(wire_material())
    obj = bpy.data.objects.new(f"{name} {value_text(kind, value)}", curve)
    obj.location = origin
    obj[PROPERTY] = {"kind": kind, "value": value}
    link_beside_ct(scene, obj, fingerprint)
    return obj


def wire_material() -> bpy.types.Material:
    """Return the material of all wires."""
    material = bpy.data.materials.get("CTMC Ruler")
    if material is None:
        material = bpy.data.materials.new("CTMC Ruler")
        material.diffuse_color = COLOR
        if bpy.app.version < (5, 0, 0):
            material.use_nodes = True
        shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
        shader.inputs["Base Color"].default_value = COLOR
    return material


def hit(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, origin: Vector, direction: Vector
) -> tuple[bpy.types.Object, Vector] | None:
    """Return the first object that a ray meets, except rulers, and the point in world space; None without a hit."""
    while True:
        is_hit, world_point, _, _, obj, _ = scene.ray_cast(depsgraph, origin, direction)
        if not is_hit:
            return None
        if not is_ruler(obj):
            return obj.original, world_point
        origin = world_point + direction * BEHIND


def full_hit(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, origin: Vector, direction: Vector
) -> tuple[bpy.types.Object, Vector] | None:
    """Return the result of `hit`, with the point on the full surface if the object is shown with fewer triangles."""
    seen = hit(scene, depsgraph, origin, direction)
    if seen is None or shown_faces(seen[0]) is None or seen[0].data.is_editmode:
        return seen
    obj, world_point = seen
    # Not Blender's own ray_cast, which takes 12 s for a tree of 4 million triangles.
    with evaluated_object(obj, scene) as (evaluated, _):
        to_world = evaluated.matrix_world.copy()
        vertices, faces = meshes.read_positions(evaluated.data), meshes.read_triangles(evaluated.data)
    to_local = to_world.inverted()
    start, along, near = (
        np.array(vector[:]) for vector in (to_local @ origin, to_local.to_3x3() @ direction, to_local @ world_point)
    )
    way = where_ray_hits(vertices, faces, start, along)
    nearest = vertices[((vertices - near) ** 2).sum(axis=1).argmin()]
    point = nearest if way is None else start + way * along
    return obj, to_world @ Vector(point.tolist())
