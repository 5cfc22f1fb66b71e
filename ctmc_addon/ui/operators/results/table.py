# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure all surfaces of the scene: the operator `ctmc.table`, and the table copied or saved as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from ....blender.surface import as_shown, require_provenance
from ....core import Step, Steps, StructureRow, equal_part, structure_row_steps, table_csv
from ....core.files.atomic_write import write_text
from ....core.volume import ValueKind
from ... import jobs
from ...needs import Needs
from ...state import session
from ...state.ct import volumes
from ...state.results import measurements, surfaces
from ...state.surface import structures
from ...translations import translate
from ..paths import SaveDialog


def has_surfaces(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the scene shows a surface, with the reason if not."""
    if not surfaces.shown_in(context.scene):
        operator.poll_message_set("Show or reconstruct a surface first")
        return False
    return True


def has_table(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the surfaces have been measured, with the reason if not."""
    if session.of(context.scene).table is None:
        operator.poll_message_set("Measure the surfaces first")
        return False
    return True


class CTMC_OT_table(jobs.LongOperator, bpy.types.Operator):
    """Measure all surfaces of the scene."""

    bl_idname = "ctmc.table"
    bl_label = "Measure All"
    bl_description = (
        "Measure all surfaces that are enabled in viewports, alpha and modifiers included: volume, area, components, "
        "largest diameter, mean and standard deviation of the CT's values inside"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, has_surfaces)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        objects = sorted(surfaces.shown_in(context.scene), key=surfaces.label_and_name)
        return table_steps(context.scene.session_uid, [obj.session_uid for obj in objects])


def table_steps(scene_uid: int, uids: Sequence[int]) -> Steps[jobs.Conclusion]:
    """Measure surfaces one after the other; surfaces deleted meanwhile have no row."""
    rows, kinds = [], set()
    for number, uid in enumerate(uids):
        yield Step(number / len(uids), "Measuring the surface")
        scene, obj = session.scene_of(scene_uid), session.object_of(uid)
        if scene is None or obj is None:
            continue
        name, measurement, provenance = obj.name, measurements.of(obj), require_provenance(obj)
        shown, (ct, labels) = as_shown(obj, scene), volumes.ct_and_labels(provenance.fingerprint)
        if labels is None and provenance.fingerprint == scene.ctmc.volume_fingerprint:
            labels = structures.label_volume(scene)
        measures = shown.mesh.measures if measurement is None else measurement.measures
        printing = None if measurement is None else measurement.printing
        about = (name, shown.mesh, measures, shown.settings, shown.threshold, ct, labels)
        measuring = structure_row_steps(*about, printing=printing)
        rows.append((yield from equal_part(measuring, number, len(uids))))
        kinds |= set() if ct is None else {ct.kind}
    kind = ValueKind.GRAY if ValueKind.GRAY in kinds else ValueKind.HU

    def conclude() -> str:
        scene = session.scene_of(scene_uid)
        if scene is not None:
            session.of(scene).table = (tuple(rows), kind)
        return translate("Surfaces measured: {count}").format(count=len(rows))

    return conclude


def csv_of(scene: bpy.types.Scene) -> str:
    """Return the table as `ctmc measure` writes it."""
    table: tuple[tuple[StructureRow, ...], ValueKind] = session.of(scene).table
    return table_csv(*table)


class CTMC_OT_table_copy(Needs, bpy.types.Operator):
    """Copy the table."""

    bl_idname = "ctmc.table_copy"
    bl_label = "Copy Table"
    bl_description = "Copy the table as CSV, with units in the header"

    needs = (has_table,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.window_manager.clipboard = csv_of(context.scene)
        self.report({"INFO"}, translate("Table copied"))
        return {"FINISHED"}


class CTMC_OT_table_save(Needs, SaveDialog, bpy.types.Operator):
    """Save the table."""

    bl_idname = "ctmc.table_save"
    bl_label = "Save Table"
    bl_description = "Save the table as CSV, with units in the header"

    suffixes = (".csv",)

    filter_glob: StringProperty(default="*.csv", options={"HIDDEN"})

    needs = (has_table,)

    def suggestion(self, _context: bpy.types.Context) -> str:
        return "structures.csv"

    def write(self, context: bpy.types.Context, path: Path) -> None:
        write_text(path, csv_of(context.scene))


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_table, CTMC_OT_table_copy, CTMC_OT_table_save))
