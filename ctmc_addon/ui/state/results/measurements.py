# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the measurements of a surface with its object, so that they return with undo and with the file.

They hold for the measured positions, keys and modifiers; for any other state of the object nothing is shown. They
describe the patient, whatever the object's location and scale in the scene.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import bpy
import numpy as np

from ....blender.stored_values import from_stored, parsed_json
from ....blender.surface import key_state, other_modifiers
from ....core import FinishedSurface, Stages, Steps, TriangleMesh, specks_text
from ....core.mesh import (
    Measures,
    ReferenceSurface,
    SurfaceDistance,
    Topology,
    measures_steps,
    self_intersections_steps,
    surface_distance_steps,
)
from ....core.solid import PrintFacts

PROPERTY = "ctmc_measurement"
"""The object's custom property that holds it."""
State = list[Any]
UNSEEN = ("show_", "is_", "name", "use_pin", "use_apply", "execution", "persistent")
"""Beginnings of the names of settings that change no mesh."""
STAGES = {"Measuring": 2, "Looking for self-intersections": 2, "Comparing with the full surface": 3}


@dataclass(frozen=True)
class Measurement:
    """Measures of a surface, and its distance to the full surface in mm, if it is simplified and that is known.

    `self_intersections` are pairs of triangles that cross, touch or overlap each other, None of an older file;
    `printing` is known of a part for print.
    """

    measures: Measures
    distance: SurfaceDistance | None = None
    self_intersections: int | None = None
    printing: PrintFacts | None = None

    @property
    def finished(self) -> FinishedSurface:
        """Return the measures of the surface, counts included."""
        collapsed = None
        if self.distance is not None:
            lost = self.distance.lost
            collapsed = {"count": lost.count, "mm3": lost.volume}
        return FinishedSurface(
            measures=self.measures,
            collapsed_components=collapsed,
            distance=self.distance,
            self_intersections=self.self_intersections,
            printing=self.printing,
        )


def measurement_steps(
    mesh: TriangleMesh,
    full: TriangleMesh | None,
    self_intersections: int | None = None,
    topology: Topology | None = None,
    printing: PrintFacts | None = None,
) -> Steps[Measurement]:
    """Measure a surface, and its distance from the surface before simplification; both meshes in RAS+ mm.

    `self_intersections` are counted if they are None; the `topology` is found if it is None.
    """
    stages = Stages(STAGES)
    measuring, crossing, comparing = STAGES
    measures = yield from stages.run(measuring, measures_steps(mesh.vertices, mesh.faces, topology))
    if self_intersections is None:
        pairs = yield from stages.run(crossing, self_intersections_steps(mesh.vertices, mesh.faces))
        self_intersections = len(pairs)
    distance = None
    if full is not None and len(mesh.faces) < len(full.faces):
        distance = yield from stages.run(comparing, surface_distance_steps(mesh, ReferenceSurface(full)))
    return Measurement(measures, distance, self_intersections, printing)


def mesh_state(obj: bpy.types.Object) -> State:
    """Return an identifier of an object's surface: positions, keys and visible modifiers."""
    return [*plain_state(obj, None)[:-1], _modifiers_text(obj)]


def plain_state(obj: bpy.types.Object, alpha: float | None) -> State:
    """Return `mesh_state` without modifiers, with the key `alpha` at this value; None leaves it."""
    mesh = obj.data
    positions, values = key_state(mesh, alpha)
    # A sum of bit patterns is quick enough for every redraw: 1 ms for a million vertices.
    sums = [int(part.view(np.uint32).sum(dtype=np.uint64)) for part in positions]
    return [len(mesh.polygons), len(mesh.vertices), sums, values, ""]


def _modifiers_text(obj: bpy.types.Object) -> str:
    """Return the settings of all modifiers that change the surface in the viewport, in their order."""
    return json.dumps([settings_text(modifier) for modifier in other_modifiers(obj) if modifier.show_viewport])[1:-1]


def settings_text(modifier: bpy.types.Modifier) -> str:
    """Return the effect of a modifier as text: its settings, and its nodes' inputs."""
    names = [
        setting.identifier
        for setting in modifier.bl_rna.properties
        if setting.type != "COLLECTION" and not setting.is_readonly and not setting.identifier.startswith(UNSEEN)
    ]
    return f"{modifier.type} {[_setting_text(modifier, name) for name in names]} {_inputs_of_nodes(modifier)}"


def _inputs_of_nodes(modifier: bpy.types.Modifier) -> list[str]:
    """Return the inputs of a Geometry Nodes modifier as text; Blender 5.2 keeps a group for each input."""
    if modifier.type != "NODES":
        return []
    if not hasattr(modifier, "properties"):
        return [str(value) for _, value in modifier.items()]
    inputs = getattr(modifier.properties, "inputs", None)
    return [] if inputs is None else [str(group.to_dict()) for _, group in inputs.items()]


def _setting_text(modifier: bpy.types.Modifier, name: str) -> str:
    """Return a setting of a modifier as text; for an object, its name and transform."""
    value = getattr(modifier, name)
    if isinstance(value, bpy.types.Object):
        return f"{value.name} {[list(row) for row in value.matrix_world]}"
    if isinstance(value, bpy.types.bpy_struct):
        return str(getattr(value, "name", ""))
    if isinstance(value, (str, int, float, type(None))):
        return str(value)
    return str(sorted(value) if isinstance(value, set) else list(value))  # The order of a set changes with every start.


def keep(obj: bpy.types.Object, measurement: Measurement, state: State) -> None:
    """Store the measurements of an object in this state."""
    values = asdict(measurement)
    quality = values["measures"]["quality"]
    if quality is not None and not math.isfinite(quality["median_radius_ratio"]):
        values["measures"]["quality"] = None
    obj[PROPERTY] = json.dumps({"state": state, **values})


def of(obj: bpy.types.Object) -> Measurement | None:
    """Return the measurements of an object in its present state; None if it was not measured, or in edit mode."""
    if obj.data.is_editmode:
        return None
    try:
        stored = parsed_json(obj[PROPERTY])
        if stored.pop("state") != mesh_state(obj):
            return None
        if "small" not in stored["measures"]:  # Files of 0.3 count components below 10 mm3.
            stored["measures"].pop("small_components", None)
        if "quality" in stored:  # Files of 0.3 and 0.4 have it outside of the measures.
            stored["measures"]["quality"] = stored.pop("quality")
        if stored.get("distance") is not None and "largest" in stored["distance"]:
            stored["distance"] = None  # Files of 0.3 count lost components too.
        measurement: Measurement = from_stored(Measurement, stored)
    except (KeyError, TypeError, ValueError):
        return None  # Made by an older version, or another add-on.
    # An open surface has no volume, and every other has one.
    return None if measurement.measures.closed == math.isnan(measurement.measures.volume) else measurement


def other_notes(notes: Sequence[str], measurement: Measurement | None) -> list[str]:
    """Return the notes on a surface without that on removed specks, if its measures say the same."""
    if measurement is None or measurement.distance is None:
        return list(notes)
    lost = measurement.distance.lost
    return [note for note in notes if note != specks_text(lost.count, lost.volume)]
