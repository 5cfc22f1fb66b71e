# SPDX-License-Identifier: GPL-3.0-or-later
"""Add, show and remove maps of the active surface: values on its vertices, such as wall thickness."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import StringProperty
from mathutils import Vector

from ....blender.figure.map_colors import title_of
from ....blender.maps import delete_map, hide_map, show_map, shown_name, stored_map, stored_maps, write_map
from ....blender.rulers import add_ruler
from ....blender.surface import (
    Provenance,
    own_mesh,
    placement_of,
    reconstruction_of,
    require_editable,
    require_provenance,
)
from ....core import (
    Budget,
    MadeSurface,
    MeshError,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Stages,
    Steps,
    SurfaceRequest,
    TriangleMesh,
    defaults,
    descriptions,
    make_surfaces_steps,
    one_of_labels_steps,
)
from ....core.maps import MAPPING, QUANTITIES, MapRequest, Quantity, mapped_steps
from ....readers import MapFiles, open_volume_steps
from ....reporting.formatting import capitalized
from ... import jobs
from ...properties.described import as_typed, property_of, with_unit
from ...properties.kinds import choice, text
from ...properties.preferences import machine
from ...properties.surface.structures import structure_choices
from ...state import session
from ...state.results import surfaces
from ...state.surface import structures
from ...translations import translate, translate_sentence
from ...viewport.results import maps as viewport_maps
from ..paths import RELATIVE

READING = "Reading files"
FROM_FILE = "FILE"
NAME_AND_FILE, STRUCTURE_OR_FILE = "NAME=PATH", "NAME|PATH"
"""Placeholders of the flags of quantities that need a file, or a structure."""
_items: list[tuple[str, str, str]] = []  # Blender keeps no reference to the texts of a menu.


def kind_of(flag: str) -> type[Quantity]:
    """Return the quantity of a flag."""
    return next(kind for kind in QUANTITIES if kind.flag == flag)


def _structure_items(_operator: Any, context: bpy.types.Context) -> list[tuple[str, str, str]]:
    """Return the labels of the list, followed by a file."""
    _items.clear()
    _items.extend((key, item.name or key, "") for key, item in structure_choices(context.scene.ctmc))
    _items.append((FROM_FILE, translate("File"), ""))
    return _items


def _option_properties() -> dict[str, Any]:
    """Return a property for each option of every quantity."""
    properties = {}
    for kind in {kind.options for kind in QUANTITIES if kind.options is not None}:
        for field in descriptions(kind):
            about, default = descriptions(kind)[field], defaults(kind)[field]
            properties[field] = property_of(about, default, name=with_unit(about), options={"SKIP_SAVE"})
    return properties


class _MapAdder(jobs.LongOperator):
    """The work of `ctmc.map_add`; its properties are added to those of the quantities' options."""

    def invoke(self: Any, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for a file, a structure or options, if the quantity needs any."""
        kind = kind_of(self.quantity)
        self.windowed = True
        if kind.metavar == NAME_AND_FILE and not self.filepath:
            context.window_manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        if kind.metavar or kind.options is not None:
            return context.window_manager.invoke_props_dialog(self)
        return self.begin(context)

    def draw(self: Any, _context: bpy.types.Context) -> None:
        kind, layout = kind_of(self.quantity), self.layout
        layout.use_property_split = True
        if kind.metavar == NAME_AND_FILE:
            layout.prop(self, "map_name")
        elif kind.metavar:
            layout.prop(self, "structure")
            if self.structure == FROM_FILE:
                layout.prop(self, "filepath")
        for field in () if kind.options is None else descriptions(kind.options):
            layout.prop(self, field)

    def plan(self: Any, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        obj, kind = context.view_layer.objects.active, kind_of(self.quantity)
        require_editable(obj)
        about = {} if kind.options is None else descriptions(kind.options)
        options = [field for field in about if self.properties.is_property_set(field)]
        given = {field: as_typed(getattr(self, field), about[field]) for field in options}
        return added_steps(obj, context.scene, kind, self.text_of(kind), given)

    def text_of(self: Any, kind: type[Quantity]) -> str:
        """Return the value of the quantity's flag on the command line."""
        path = bpy.path.abspath(self.filepath)
        if kind.metavar == NAME_AND_FILE:
            if not self.filepath:
                raise SettingsError("no file was chosen; choose the volume to paint")
            name = self.map_name or Path(path).name.partition(".")[0]
            return f"{name}={path}"
        if not kind.metavar:
            return ""
        if self.structure == FROM_FILE and not self.filepath:
            raise SettingsError("no structure and no file was chosen; choose one of them")
        return path if self.structure == FROM_FILE else str(self.structure)


CTMC_OT_map_add = type(
    "CTMC_OT_map_add",
    (_MapAdder, bpy.types.Operator),
    {
        "__doc__": "Add a map to the active surface, and show it.",
        "__module__": __name__,
        "bl_idname": "ctmc.map_add",
        "bl_label": "Add Map",
        "bl_description": "Compute a quantity on every vertex of the active surface and show it in colors",
        "bl_options": {"REGISTER", "UNDO"},
        "needs": (jobs.idle, surfaces.can_change),
        "__annotations__": {
            "quantity": choice(
                "Quantity",
                "Quantity to compute",
                items=[(kind.flag, kind.label, capitalized(kind.text)) for kind in QUANTITIES],
            ),
            "structure": choice("Structure", "Structure to measure to", items=_structure_items),
            "map_name": text("Name", "Name of the map. Empty = name of the file"),
            "filepath": StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE}),
            **_option_properties(),
        },
    },
)


def added_steps(
    obj: bpy.types.Object, scene: bpy.types.Scene, kind: type[Quantity], value: str, options: Mapping[str, Any]
) -> Steps[jobs.Conclusion]:
    """Calculate a quantity on an object's mesh, in millimeters of the patient; write and show it at the end.

    Parameters
    ----------
    obj : bpy.types.Object
    scene : bpy.types.Scene
    kind : type of Quantity
    value : str
        Value of the quantity's flag.
    options : mapping
        Options of the quantity.
    """
    uid, provenance, mesh, budget = obj.session_uid, require_provenance(obj), own_mesh(obj), machine().budget
    result = reconstruction_of(mesh, None, provenance.settings, provenance)
    volume, labels = structures.require_volume_of(scene, provenance.settings), structures.named_labels(scene)
    inputs = MapFiles(labels or volume, budget, open_volume_steps)
    surface_steps = _surfaces_of(scene, provenance, surfaces.full_of_last_run(obj, scene), budget)
    stages = Stages({READING: 1, MAPPING: 3})
    quantity = yield from stages.run(READING, kind.from_text_steps(value, inputs, options))
    source = labels if labels is not None and kind.metavar == STRUCTURE_OR_FILE else volume
    making = mapped_steps(source, [result], MapRequest((quantity,)), budget, surface_steps)
    [mapped] = yield from stages.run(MAPPING, making)

    def conclude() -> str:
        changed = session.object_of(uid)
        if changed is None or len(changed.data.vertices) != len(mesh.vertices):
            raise MeshError("the surface was deleted or changed meanwhile; add the map again")
        require_editable(changed)
        [surface_map] = mapped.maps
        write_map(changed.data, surface_map)
        show_map(changed, surface_map.name)
        viewport_maps.show()
        title = translate(capitalized(title_of(surface_map.name, surface_map.unit)))
        return ". ".join([f"{changed.name}: {title}", *map(translate_sentence, surface_map.notes)])

    return conclude


def _surfaces_of(
    scene: bpy.types.Scene, provenance: Provenance, full: Reconstruction | None, budget: Budget
) -> Callable[[ReconstructionSettings], Steps[TriangleMesh]]:
    """Return the maker of other surfaces of the scene's CT, the same as on the command line.

    Labels that were made at once with a surface share their walls with it. The full surfaces of the last run are not
    made again while their labels are the same; `full` is that of the surface itself.
    """
    sharing_labels = () if provenance.part else provenance.sharing_labels  # A solid measures to labels by themselves.
    kept = session.of(scene)
    of_last_run = dict(kept.full) if kept.full_labels is structures.label_volume(scene) else {}

    def held(settings: ReconstructionSettings) -> Reconstruction | None:
        if settings.label == provenance.settings.label:
            return full
        other = of_last_run.get(surfaces.origin(provenance.fingerprint, settings))
        return other if other is not None and other.sharing_labels == sharing_labels else None

    def surface_steps(settings: ReconstructionSettings) -> Steps[TriangleMesh]:
        full = held(settings)
        if full is None:
            volume = structures.require_volume_of(scene, settings)
            return (yield from one_of_labels_steps(volume, settings, sharing_labels, budget)).mesh
        [outcome] = yield from make_surfaces_steps(None, [SurfaceRequest(settings, full=full)], budget, all_needed=True)
        assert isinstance(outcome, MadeSurface), "an error is raised"
        return outcome.result.mesh

    return surface_steps


MAP_NAME = "Name of the map. Empty = the map that is shown, else the last one"


class _OfMap:
    """An operator on a map of the active surface, by name; inherited before `bpy.types.Operator`."""

    @classmethod
    def poll(cls: Any, context: bpy.types.Context) -> bool:
        obj = context.view_layer.objects.active
        if not surfaces.can_change(cls, context):
            return False
        if not stored_maps(obj.data) and not shown_name(obj):
            cls.poll_message_set("Add a map first")
            return False
        return True

    def execute(self: Any, context: bpy.types.Context) -> set[str]:
        """Find the map, and hand its name over."""
        obj = context.view_layer.objects.active
        shown, names = shown_name(obj), [stored.name for stored in stored_maps(obj.data)]
        name = self.map_name or shown or names[-1]
        if name not in (shown, *names):
            error = MeshError(f"there is no map {name}; the maps are {', '.join(names)}")
            return jobs.refuse(self, context.scene.session_uid, error)
        try:
            self.change(obj, name)
        except MeshError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        session.redraw_viewports()
        return {"FINISHED"}


class CTMC_OT_map_show(_OfMap, bpy.types.Operator):
    """Show a map of the active surface, or hide it."""

    bl_idname = "ctmc.map_show"
    bl_label = "Show Map"
    bl_description = "Show a map in the viewport and in renders, with a legend; press again for the surface's own look"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    map_name: text("Name", MAP_NAME)

    def change(self, obj: bpy.types.Object, name: str) -> None:
        """Show the map, or hide it."""
        if shown_name(obj) == name:
            hide_map(obj)
            viewport_maps.hide()
        else:
            show_map(obj, name)
            viewport_maps.show()


class CTMC_OT_map_remove(_OfMap, bpy.types.Operator):
    """Remove a map of the active surface."""

    bl_idname = "ctmc.map_remove"
    bl_label = "Remove Map"
    bl_description = "Remove a map from the active surface"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    map_name: text("Name", MAP_NAME)

    def change(self, obj: bpy.types.Object, name: str) -> None:
        """Remove the map."""
        delete_map(obj, name)
        viewport_maps.hide()


class CTMC_OT_map_nearest(_OfMap, bpy.types.Operator):
    """Keep the nearest two points of a distance map as a ruler."""

    bl_idname = "ctmc.map_nearest"
    bl_label = "Mark Nearest Points"
    bl_description = (
        "Add the distance of the nearest two points of the surface and the other one as an object, as Distance does"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    map_name: text("Name", MAP_NAME)

    def change(self, obj: bpy.types.Object, name: str) -> None:
        """Add the ruler, where the object lies now."""
        stored, scene = stored_map(obj.data, name), bpy.context.scene
        if stored is None or stored.nearest is None:
            raise MeshError(f"the map {name} has no nearest points; choose a distance to another surface")
        add_ruler(
            scene,
            "distance",
            [obj.matrix_world @ Vector(point) for point in placement_of(obj).to_local(np.array(stored.nearest))],
            translate("Nearest"),
            machine().scale,
            stored.nearest,
            require_provenance(obj).fingerprint,
        )


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_map_add, CTMC_OT_map_show, CTMC_OT_map_remove, CTMC_OT_map_nearest)
)
