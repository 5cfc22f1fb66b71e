# SPDX-License-Identifier: GPL-3.0-or-later
"""Reduce the triangles of a surface, and make a plain mesh of it: `ctmc.simplify`, `ctmc.make_final`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import bpy

from ....blender.surface import apply_shape_and_modifiers, require_provenance, require_updatable
from ....core import GOALS, CtmcError, MeshError, Steps
from ....reporting.formatting import count
from ... import jobs
from ...needs import Needs
from ...state.draw import drawings
from ...state.results import surfaces
from ...state.surface import structures
from ...translations import translate
from ..surface.placing import ObjectRequest
from ..surface.reconstruct import surfaces_steps


class CTMC_OT_simplify(jobs.LongOperator, bpy.types.Operator):
    """Simplify the active surface to the goal of the panel."""

    bl_idname = "ctmc.simplify"
    bl_label = "Simplify Surface"
    bl_description = (
        "Simplify the active surface to the number of triangles or the error set above, starting "
        "from the full surface, which is not extracted again while in memory"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, surfaces.can_change)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        panel = context.scene.ctmc.to_settings()
        return from_full_steps(context, {name: getattr(panel, name) for name in ("simplifier", *GOALS)})


def from_full_steps(
    context: bpy.types.Context, changes: Mapping[str, Any], *, extracts: bool = False
) -> Steps[jobs.Conclusion]:
    """Make the active surface again with other settings, from its full form if known and not `extracts`."""
    scene, obj = context.scene, context.view_layer.objects.active
    require_updatable(obj)
    provenance = require_provenance(obj)
    settings = replace(provenance.settings, **changes)
    full = None if extracts else surfaces.full_of(obj, scene)
    if full is None and provenance.part:
        raise MeshError(f"{obj.name} is a part of a solid and cannot be made alone; press Reconstruct for all parts")
    if full is None and not surfaces.is_of_ct(obj, scene):
        raise MeshError(f"{obj.name} is simplified already and its full surface is not in memory; load its CT again")
    drawn = drawings.hash_of(scene, scene.ctmc.structure_of(settings)) if full is None else None
    request = ObjectRequest(
        settings, target=obj.session_uid, fingerprint=provenance.fingerprint, drawn=drawn, part=provenance.part
    )
    return surfaces_steps(structures.volume_of(scene, settings), [request], scene.session_uid, full)


class CTMC_OT_apply_shape(Needs, bpy.types.Operator):
    """Bake alpha and modifiers of the active surface."""

    bl_idname = "ctmc.make_final"
    bl_label = "Apply Shape and Modifiers"
    bl_description = "Bake alpha and every modifier that shows in the viewport into a plain mesh"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, surfaces.can_change)

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = context.view_layer.objects.active
        try:
            apply_shape_and_modifiers(obj)
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        message = translate("{name}: {faces} triangles")
        self.report({"INFO"}, message.format(name=obj.name, faces=count(len(obj.data.polygons))))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_simplify, CTMC_OT_apply_shape))
