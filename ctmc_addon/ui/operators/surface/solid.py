# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit the panel's solid, such as its cuts, with the operators `ctmc.solid_*`, `ctmc.cut_*` and similar ones.

Reconstruct makes the parts, each as its own object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
from bpy.props import BoolProperty, IntProperty
from mathutils import Vector

from ....core import Budget, Reconstruction, SettingsError, Steps, SurfaceRequest, Volume, descriptions, position_text
from ....core.solid import LENGTHS, MOST_CUTS, MadeParts, SolidRequest, solid_parts_steps
from ....reporting.formatting import count
from ... import jobs
from ...needs import Needs
from ...properties.kinds import choice
from ...properties.preferences import machine
from ...properties.surface.solid import COMBININGS
from ...state import session
from ...state.change_events import COMBINED, notify
from ...state.ct import volumes
from ...state.results import surfaces
from ...translations import translate, translate_phrase
from .placing import ObjectRequest

DIRECTIONS = (
    ("VIEW", "View", "Across the direction of the view; part a lies on the viewer's side"),
    ("Z", "z, Head and Feet", "Across the patient's long axis; part a lies on the side of the head"),
    ("Y", "y, Front and Back", "Across the axis from back to front; part a lies in front"),
    ("X", "x, Right and Left", "Across the axis from left to right; part a lies on the patient's right"),
)
AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
LISTS = {"drains": "Drain", "cuts": "Cut", "combinations": "Combination"}


@dataclass(frozen=True)
class SolidParts:
    """The parts of a solid to make, and the objects that take them.

    Parameters
    ----------
    solid : SolidRequest
    targets : mapping of str to int
        `session_uid` of the object of a part, by the name of the part; parts without one get a new object.
    """

    solid: SolidRequest
    targets: Mapping[str, int]

    def parts_steps(
        self, volume: Volume, requests: Sequence[ObjectRequest], budget: Budget, labels: Volume | None
    ) -> Steps[MadeParts]:
        """Make the parts of the requested surfaces."""
        surface_requests = [SurfaceRequest(request.settings) for request in requests]
        return (yield from solid_parts_steps(volume, surface_requests, self.solid, budget, labels=labels))

    def requests_of(self, parts: Sequence[Reconstruction], requests: Sequence[ObjectRequest]) -> list[ObjectRequest]:
        """Return the request of each part's object."""
        return [self._request_of(part, requests) for part in parts]

    def _request_of(self, part: Reconstruction, requests: Sequence[ObjectRequest]) -> ObjectRequest:
        """Return the request of a part's object: that of its structure, with the name of the part."""
        made_of = surfaces.made_of(part.settings)
        own = next((each for each in requests if surfaces.made_of(each.settings) == made_of), requests[0])
        name = part.label_name or own.structure or translate("Part")
        prefix = "" if part.settings.label is None else own.prefix  # The name of a threshold's part has it.
        return replace(own, settings=part.settings, part=name, prefix=prefix, target=self.targets.get(name))


def makes_solid(scene: bpy.types.Scene) -> bool:
    """Return whether Reconstruct makes the parts of a solid; it reports contradicting settings itself."""
    try:
        return bool(scene.ctmc_solid.to_request())
    except SettingsError:
        return True


def solid_text(solid: SolidRequest) -> str:
    """Return the operations on the next surfaces as text; empty without any."""
    if not solid:
        return ""
    texts = []
    for name in LENGTHS:
        caption, length = descriptions(SolidRequest)[name].caption, getattr(solid, name)
        if caption is not None and length:
            texts.append(translate_phrase(caption(length)))
    pegs = 0 if solid.pegs is None else solid.pegs.count
    for single, several, number in (
        ("1 drain", "{count} drains", len(solid.drains)),
        ("1 cut", "{count} cuts", len(solid.cuts)),
        ("1 peg", "{count} pegs", pegs),
    ):
        if number:
            texts.append(translate(single if number == 1 else several).format(count=count(number)))
    texts += [combination.name for combination in solid.combinations]
    return translate("Makes a solid: {what}").format(what=", ".join(texts))


def place_text(point: Sequence[float], size: float) -> str:
    """Return the place of something of this size in the patient, mm, short enough for a line of a list."""
    return position_text(point, size, decimals=0)


def _cursor_mm(context: bpy.types.Context) -> tuple[float, float, float]:
    x, y, z = (value / machine().scale for value in context.scene.cursor.location)
    return x, y, z


def _has_room_for_cut(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether a further cut is possible; else set the reason."""
    if len(context.scene.ctmc_solid.cuts) >= MOST_CUTS:
        operator.poll_message_set("A solid has at most 6 cuts; remove one")
        return False
    return True


class CTMC_OT_drain_add(Needs, bpy.types.Operator):
    """Add a drain to the panel's solid."""

    bl_idname = "ctmc.drain_add"
    bl_label = "Add Drain"
    bl_description = "Add a round hole that begins at the 3D cursor and runs straight out through the nearest wall"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    auto: BoolProperty(
        name="Auto",
        description="Place two holes, at the lowest and at the highest point, so that liquid runs out",
        options={"SKIP_SAVE"},
    )

    needs = (jobs.idle,)

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Return the tooltip of the button."""
        if properties.auto:
            return translate("Add two round holes to a hollow, at its lowest point and at its highest")
        return translate(cls.bl_description)

    def execute(self, context: bpy.types.Context) -> set[str]:
        drain = context.scene.ctmc_solid.drains.add()
        drain.auto, drain.point = self.auto, _cursor_mm(context)
        session.redraw_viewports()
        return {"FINISHED"}


class CTMC_OT_cut_add(Needs, bpy.types.Operator):
    """Add a cut to the panel's solid."""

    bl_idname = "ctmc.cut_add"
    bl_label = "Add Cut"
    bl_description = "Cut the solid in two at a plane through the 3D cursor"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    direction: choice("Direction", "Choose the direction that the plane faces", items=list(DIRECTIONS), default="Z")

    needs = (jobs.idle, _has_room_for_cut)

    def execute(self, context: bpy.types.Context) -> set[str]:
        cut = context.scene.ctmc_solid.cuts.add()
        cut.point = _cursor_mm(context)
        view = getattr(context.space_data, "region_3d", None)
        if self.direction == "VIEW" and view is not None:
            cut.normal = view.view_rotation @ Vector(AXES["Z"])
        else:
            cut.normal = AXES.get(self.direction, AXES["Z"])
        session.redraw_viewports()
        return {"FINISHED"}


class CTMC_OT_cut_flip(Needs, bpy.types.Operator):
    """Exchange the parts of a cut."""

    bl_idname = "ctmc.cut_flip"
    bl_label = "Flip Cut"
    bl_description = "Exchange parts a and b of this cut, and with them pegs and holes"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    index: IntProperty(options={"HIDDEN", "SKIP_SAVE"})

    needs = (jobs.idle,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        cuts = context.scene.ctmc_solid.cuts
        if not 0 <= self.index < len(cuts):
            return {"CANCELLED"}
        cuts[self.index].normal = [-value for value in cuts[self.index].normal]
        session.redraw_viewports()
        return {"FINISHED"}


class CTMC_OT_combination_add(Needs, bpy.types.Operator):
    """Add a combination of structures to the panel's solid."""

    bl_idname = "ctmc.combination_add"
    bl_label = "Add Combination"
    bl_description = "Make one structure of several from the list"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    how: choice("Combine", "How to combine", items=[(how.value, name, about) for how, name, about in COMBININGS])

    needs = (jobs.idle, volumes.has_volume)

    def execute(self, context: bpy.types.Context) -> set[str]:
        combination = context.scene.ctmc_solid.combinations.add()
        combination.how = self.how
        combination.of.add()
        combination.of.add()
        return {"FINISHED"}


class CTMC_OT_solid_remove(Needs, bpy.types.Operator):
    """Remove a drain, a cut or a combination from the panel's solid."""

    bl_idname = "ctmc.solid_remove"
    bl_label = "Remove"
    bl_description = "Remove this from the list"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    kind: choice(
        "List",
        "List to remove it from",
        items=[(name, label, "") for name, label in LISTS.items()],
        options={"HIDDEN", "SKIP_SAVE"},
    )
    index: IntProperty(options={"HIDDEN", "SKIP_SAVE"})

    needs = (jobs.idle,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        lines = getattr(context.scene.ctmc_solid, self.kind)
        if not 0 <= self.index < len(lines):
            return {"CANCELLED"}
        lines.remove(self.index)
        notify(context.scene.ctmc, COMBINED)
        session.redraw_viewports()
        return {"FINISHED"}


class CTMC_OT_solid_reset(Needs, bpy.types.Operator):
    """Reset the panel's solid."""

    bl_idname = "ctmc.solid_reset"
    bl_label = "Reset Solid"
    bl_description = "Reset everything in Solid, so that the next surfaces are made without it"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        solid = context.scene.ctmc_solid
        for about in solid.bl_rna.properties:
            if about.type == "COLLECTION":
                getattr(solid, about.identifier).clear()
            elif not about.is_readonly:
                solid.property_unset(about.identifier)
        notify(context.scene.ctmc, COMBINED)
        session.redraw_viewports()
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory(
    (
        CTMC_OT_drain_add,
        CTMC_OT_cut_add,
        CTMC_OT_cut_flip,
        CTMC_OT_combination_add,
        CTMC_OT_solid_remove,
        CTMC_OT_solid_reset,
    )
)
