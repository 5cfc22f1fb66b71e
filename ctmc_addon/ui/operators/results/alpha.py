# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose alpha by the triangles of the active surface: `ctmc.choose_alpha`."""

from __future__ import annotations

import bpy

from ....core import MeshError, Reconstruction, Steps, chosen_alpha_steps, length_text, replayed_steps
from ... import jobs
from ...state import session
from ...state.results import surfaces
from ...translations import translate


class CTMC_OT_choose_alpha(jobs.LongOperator, bpy.types.Operator):
    """Set alpha to the largest at which the active surface has no angle below the panel's minimum."""

    bl_idname = "ctmc.choose_alpha"
    bl_label = "Choose Alpha"
    bl_description = (
        "Set alpha to the largest at which no triangle of the active surface, before simplification, has an angle "
        "below the minimum angle; nothing is extracted again"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, surfaces.can_change)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        scene, obj = context.scene, context.view_layer.objects.active
        full = surfaces.full_of(obj, scene)
        if full is None or full.surface is None:
            raise MeshError(
                f"{obj.name} is simplified already and its full surface is not in memory; reconstruct it again"
            )
        return _choosing_steps(full, scene.ctmc.to_settings().min_angle_deg, scene.session_uid)


def _choosing_steps(full: Reconstruction, min_angle_deg: float, uid: int) -> Steps[jobs.Conclusion]:
    """Choose alpha, then move the panel's slider, which the selected surfaces follow."""
    surface = full.surface
    assert surface is not None
    choice = yield from chosen_alpha_steps(lambda: replayed_steps([surface]), min_angle_deg)

    def conclude() -> str:
        scene = session.scene_of(uid)
        if scene is not None:
            scene.ctmc.alpha = choice.alpha
        message = translate("Alpha {alpha}: smallest angle {angle}°, vertices moved by {mean}, at most {most}")
        if not choice.reached:
            message = translate(
                "No alpha keeps {asked}°; the best, {alpha}, has {angle}°, vertices moved {mean}, at most {most}"
            )
        return message.format(
            asked=f"{min_angle_deg:g}",
            alpha=f"{choice.alpha:g}",
            angle=f"{choice.smallest_angle_deg:.3g}",
            mean=length_text(choice.mean_mm, 3),
            most=length_text(choice.largest_mm, 3),
        )

    return conclude


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_choose_alpha,))
