# SPDX-License-Identifier: GPL-3.0-or-later
"""Add the CT itself to the scene as a Volume object, and show millimeters in Blender's own numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import EnumProperty

from ....blender.units import set_units
from ....blender.volume import APPEARANCES, add_volume, vdb_steps, vdb_writer
from ....core import MeshError, Steps, Volume
from ....core.files.file_names import file_name
from ....core.volume import box_of
from ... import jobs
from ...properties.preferences import machine
from ...state import session
from ...state.ct import volumes
from ...translations import translate


def _can_write(operator: Any, _context: bpy.types.Context) -> bool:
    """Return whether the .blend has a folder and Blender a module to write the .vdb, with the reason if not."""
    if vdb_writer() is None:
        operator.poll_message_set("This Blender has no OpenVDB module; the Blender of blender.org has one")
        return False
    if not bpy.data.filepath:
        operator.poll_message_set("Save the .blend first: the volume's file goes beside it")
        return False
    return True


class CTMC_OT_add_volume(jobs.LongOperator, bpy.types.Operator):
    """Add the CT, or its region, as a Volume object."""

    bl_idname = "ctmc.add_volume"
    bl_label = "Add Volume"
    bl_description = (
        "Add the CT, or its region, at the stride as a Volume object that Cycles and EEVEE render. "
        "Its values are written into a .vdb file beside the .blend"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, volumes.has_volume, _can_write)

    appearance: EnumProperty(
        name="Appearance",
        description="Tissue to show; threshold, window and level change it afterwards",
        items=[(name, about.label, about.text) for name, about in APPEARANCES.items()],
    )

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        scene = context.scene
        ct, settings = volumes.require_loaded(scene), scene.ctmc.to_settings()
        x, y, z = box_of(ct.full, settings.region, settings.region_unit)
        part = replace(ct.full, name=volumes.called(scene)).part((x, y, z))
        return self.steps(part, settings.stride, scene.session_uid, ct.statistics.fingerprint)

    def steps(self, part: Volume, stride: tuple[int, int, int], uid: int, fingerprint: str) -> Steps[jobs.Conclusion]:
        """Write the file, then add the object."""
        path, scale, appearance = _free_path(part.name), machine().scale, APPEARANCES[self.appearance]
        volume = yield from part.in_memory_steps(stride)
        yield from vdb_steps(volume, path, scale)

        def conclude() -> str:
            scene = session.scene_of(uid)
            if scene is None:
                raise MeshError("the scene was deleted meanwhile; add the volume to another")
            obj = add_volume(scene, volume, path, scale, appearance, fingerprint)
            return translate("{name}: written to {file}").format(name=obj.name, file=path.name)

        return conclude


def _free_path(name: str) -> Path:
    """Return an unused path of a .vdb next to the .blend."""
    folder = Path(bpy.data.filepath).parent
    stem = file_name(name)
    number, path = 1, folder / f"{stem}.vdb"
    while path.exists():
        number += 1
        path = folder / f"{stem} {number}.vdb"
    return path


class CTMC_OT_set_units(bpy.types.Operator):
    """Let Blender's own numbers be millimeters."""

    bl_idname = "ctmc.set_units"
    bl_label = "Show Millimeters"
    bl_description = (
        "Set the scene's units so that Blender's ruler, dimensions and sidebar show the patient's millimeters. "
        "No object moves"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    def execute(self, context: bpy.types.Context) -> set[str]:
        set_units(context.scene, machine().scale)
        self.report({"INFO"}, translate("Units set to millimeters"))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_add_volume, CTMC_OT_set_units))
