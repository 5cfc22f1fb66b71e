# SPDX-License-Identifier: GPL-3.0-or-later
"""Store maps on a mesh: the values as an attribute with the name of the map, the rest as JSON in a custom property.

So a map is copied, undone, saved and deleted with its mesh. A mesh whose number of vertices has changed, as after an
edit, has no maps.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import MeshError
from ...core.maps import RAMPS, Limits, MapStatistics, Point, SurfaceMap
from ..stored_values import from_stored, parsed_json

MAPS = "ctmc_maps"
"""Custom property of the mesh that holds the maps by name, as JSON."""


@dataclass(frozen=True)
class StoredMap:
    """A map without its values.

    Parameters
    ----------
    name, unit, range, ramp, statistics, nearest, notes
        As in `SurfaceMap`.
    limits : (low, high)
        None for no limit.
    vertices : int
        Number of vertices of its mesh.
    """

    name: str
    unit: str
    range: tuple[float, float]
    ramp: str
    statistics: MapStatistics
    vertices: int
    limits: tuple[float | None, float | None] = (None, None)
    nearest: tuple[Point, Point] | None = None
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        """Check the fields, which may come from a file.

        Raises
        ------
        ValueError
            For an unknown ramp or a range that does not rise.
        """
        low, high = self.range
        if self.ramp not in RAMPS or not low < high:
            raise ValueError("the ramp is unknown or the range does not rise")

    @property
    def core_limits(self) -> Limits:
        """The limits for `core`."""
        low, high = self.limits
        return Limits(-math.inf if low is None else low, math.inf if high is None else high)


def write_map(mesh: bpy.types.Mesh, surface_map: SurfaceMap) -> None:
    """Write a map to its mesh; replace one with the same name.

    Parameters
    ----------
    mesh : bpy.types.Mesh
        Has a vertex for each value.
    surface_map : SurfaceMap

    Raises
    ------
    MeshError
        If the numbers of vertices and values differ, or Blender does not allow an attribute with this name.
    """
    name, values = surface_map.name, surface_map.values
    if len(values) != len(mesh.vertices):
        raise MeshError(
            f"the map {name} has {len(values):,} values and the surface {len(mesh.vertices):,} vertices; make it again"
        )
    attribute = mesh.attributes.get(name)
    if attribute is not None and name not in _by_name(mesh):
        raise MeshError(f"the mesh has an attribute {name} of its own; give the map another name")
    if attribute is None:
        attribute = mesh.attributes.new(name, "FLOAT", "POINT")
        if attribute is None or attribute.name != name:
            if attribute is not None:
                mesh.attributes.remove(attribute)
            raise MeshError(f"Blender keeps no attribute called {name}; give the map a shorter name")
    write_values(mesh, name, values)
    low, high = (limit if math.isfinite(limit) else None for limit in surface_map.limits)
    stored = StoredMap(
        name=name,
        unit=surface_map.unit,
        range=surface_map.range,
        ramp=surface_map.ramp,
        statistics=surface_map.statistics,
        vertices=len(values),
        limits=(low, high),
        nearest=surface_map.nearest,
        notes=surface_map.notes,
    )
    _keep(mesh, [*(each for each in stored_maps(mesh) if each.name != name), stored])
    mesh.update()


def write_values(mesh: bpy.types.Mesh, name: str, values: NDArray[np.float32]) -> None:
    """Write values as an attribute of the vertices.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    name : str
    values : (V,) float32
    """
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, "FLOAT", "POINT")
    attribute.data.foreach_set("value", np.ascontiguousarray(values, np.float32))


def stored_maps(mesh: bpy.types.Mesh) -> list[StoredMap]:
    """Return the maps of a mesh in the order in which they were made; empty in edit mode."""
    if mesh.is_editmode:
        return []
    return [each for each in _by_name(mesh).values() if _has_values(mesh, each)]


def stored_map(mesh: bpy.types.Mesh, name: str) -> StoredMap | None:
    """Return a map of a mesh by its name, or None."""
    return next((each for each in stored_maps(mesh) if each.name == name), None)


def map_values(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32]:
    """Return the values of a map of the mesh, (V,) float32; NaN for no value."""
    values = np.empty(len(mesh.vertices), np.float32)
    mesh.attributes[name].data.foreach_get("value", values)
    return values


def read_map(mesh: bpy.types.Mesh, name: str) -> SurfaceMap | None:
    """Return a map of a mesh with its values, or None."""
    stored = stored_map(mesh, name)
    if stored is None:
        return None
    return SurfaceMap(
        name=stored.name,
        unit=stored.unit,
        values=map_values(mesh, name),
        range=stored.range,
        ramp=stored.ramp,
        statistics=stored.statistics,
        limits=stored.core_limits,
        nearest=stored.nearest,
        notes=stored.notes,
    )


def change_map(mesh: bpy.types.Mesh, stored: StoredMap) -> None:
    """Replace the properties of a map, such as its range; the values stay."""
    _keep(mesh, [stored if each.name == stored.name else each for each in stored_maps(mesh)])


def remove_map(mesh: bpy.types.Mesh, name: str) -> None:
    """Remove a map from a mesh."""
    if name not in _by_name(mesh):
        return
    if name in mesh.attributes:
        mesh.attributes.remove(mesh.attributes[name])
    _keep(mesh, [each for each in stored_maps(mesh) if each.name != name])


def _keep(mesh: bpy.types.Mesh, maps: Iterable[StoredMap]) -> None:
    """Write the property, or remove it if there are no maps."""
    kept = {each.name: asdict(each) for each in maps}
    if kept:
        mesh[MAPS] = json.dumps(kept)
    else:
        mesh.pop(MAPS, None)


def _by_name(mesh: bpy.types.Mesh) -> dict[str, StoredMap]:
    """Return the maps by name; empty if a second add-on or a newer version wrote the property."""
    try:
        stored: dict[str, StoredMap] = from_stored(dict[str, StoredMap], parsed_json(mesh[MAPS]))
    except (KeyError, TypeError, ValueError):
        return {}
    return stored


def _has_values(mesh: bpy.types.Mesh, stored: StoredMap) -> bool:
    attribute = mesh.attributes.get(stored.name)
    return (
        attribute is not None
        and (attribute.data_type, attribute.domain) == ("FLOAT", "POINT")
        and stored.vertices == len(mesh.vertices) == len(attribute.data)
    )
