# SPDX-License-Identifier: GPL-3.0-or-later
"""Time a turn in this viewport: `ctmc.rotation_test`, and its table copied or saved."""

from __future__ import annotations

from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from ....blender import rotation as turntable
from ....blender.rotation import ViewportDrawing, can_draw
from ....blender.surface import SCALE, evaluated_triangles, placement_of
from ....core import Budget, MeshError, SettingsError, Stages, Steps, TriangleMesh
from ....core.files.atomic_write import write_text
from ....reporting.parse import parsed_levels
from ....reporting.rotation_table import RotationTable
from ... import jobs
from ...needs import Needs
from ...properties.preferences import machine
from ...state import session
from ...state.results import surfaces
from ...translations import translate
from ...viewport.surface import preview
from ..paths import SaveDialog
from ..surface import placing

STAGES = {"Simplifying": 3, "Timing the rotation": 7}


def _is_mesh(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the active object is a mesh in object mode, with the reason if not."""
    obj = context.view_layer.objects.active
    if obj is None or obj.type != "MESH":
        operator.poll_message_set("Choose a surface first")
        return False
    if obj.mode != "OBJECT":
        operator.poll_message_set("Switch to Object Mode first")
        return False
    return True


def has_table(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether a test has been run, with the reason if not."""
    if session.of(context.scene).rotation is None:
        operator.poll_message_set("Run the rotation test first")
        return False
    return True


class CTMC_OT_rotation_test(jobs.LongOperator, bpy.types.Operator):
    """Time how long the active surface takes to turn, at several levels of simplification."""

    bl_idname = "ctmc.rotation_test"
    bl_label = "Run Rotation Test"
    bl_description = (
        "Time how long the active surface takes to turn once around in this viewport, at several levels of "
        "simplification. Esc stops it and puts everything back"
    )
    locks = True  # The levels are in the scene meanwhile.

    needs = (_is_mesh, jobs.idle)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        scene, obj = context.scene, context.view_layer.objects.active
        panel = scene.ctmc
        levels = parsed_levels(panel.rotation_levels)
        windowed = self.windowed and not bpy.app.background
        if panel.rotation_kind != "rotate" and not windowed:
            raise SettingsError(f"{panel.rotation_kind} can be timed only in a window; choose rotate without one")
        mesh = full_mesh(scene, obj)
        view = ViewportDrawing(context.window, viewport_of(context), panel.rotation_kind) if windowed else None
        options = {"rounds": panel.rotation_rounds, "step_degrees": float(panel.rotation_step)}
        return test_steps(scene, obj, mesh, levels, panel.rotation_kind, options, view, machine().budget)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.windowed = True
        return self.begin(context)


def viewport_of(context: bpy.types.Context) -> bpy.types.Area:
    """Return the 3D viewport of the button, else the first of the window; raise a `MeshError` if there is none."""
    areas = [area for area in (context.area, *context.window.screen.areas) if area is not None]
    area = next((area for area in areas if area.type == "VIEW_3D"), None)
    if area is None:
        raise MeshError("there is no 3D viewport in this window; open one to turn the surface in")
    return area


def full_mesh(scene: bpy.types.Scene, obj: bpy.types.Object) -> TriangleMesh:
    """Return the surface before simplification if it is known, else the present one; RAS+ mm."""
    full = surfaces.full_of(obj, scene) if surfaces.is_surface(obj) else None
    mesh: TriangleMesh = evaluated_triangles(obj, scene) if full is None else full.mesh
    if not len(mesh.faces):
        raise MeshError(f"{obj.name} has no triangles; choose a surface")
    return mesh


def test_steps(
    scene: bpy.types.Scene,
    obj: bpy.types.Object,
    mesh: TriangleMesh,
    percents: tuple[float, ...],
    motion: str,
    options: dict[str, Any],
    view: ViewportDrawing | None,
    budget: Budget,
) -> Steps[jobs.Conclusion]:
    """Make the levels, turn them, and show the result in the panel."""
    uid, scale = scene.session_uid, placement_of(obj).scale if surfaces.is_surface(obj) else SCALE
    stages = Stages(STAGES)
    simplifying, timing = STAGES
    simplified = yield from stages.run(simplifying, turntable.simplified_steps(mesh, percents, budget))
    faces = tuple(len(small.faces) for _, small in simplified)
    if view is None:
        engine = "BLENDER_WORKBENCH" if can_draw() else "CYCLES"
        turned = yield from stages.run(timing, turntable.rotation_test_steps(simplified, engine, **options))
        rounds = [level.rounds for level in turned]
    else:
        with _objects_hidden(scene), turntable.levels_in(scene, simplified, scale) as levels, view:
            view.levels = levels
            steps = turntable.rotation_steps(levels, view, **options)
            timed = yield from stages.run(timing, steps)
            rounds = [tuple(times) for times in timed]
    table = RotationTable(motion, percents, faces, tuple(rounds))
    return lambda: conclude(uid, table)


def conclude(uid: int, table: RotationTable) -> str:
    """Show the table in the panel."""
    scene = session.scene_of(uid)
    if scene is not None:
        session.of(scene).rotation = table
    last = max(range(len(table.savings)), key=lambda at: table.percents[at])
    text = "With {percent} % fewer triangles a rotation takes {seconds} s instead of {before} s ({change} %)"
    return translate(text).format(
        percent=f"{table.percents[last]:g}",
        seconds=f"{table.averages[last]:.2g}",
        before=f"{table.averages[0]:.2g}",
        change=f"{-table.savings[last]:+.0f}",
    )


@contextmanager
def _objects_hidden(scene: bpy.types.Scene) -> Iterator[None]:
    """Hide every object of the scene from the viewport within the block; afterwards show those that still exist."""
    hidden = [obj.session_uid for obj in scene.objects if not obj.hide_viewport]
    selected = [obj.session_uid for obj in scene.objects if obj.select_get()]
    active = bpy.context.view_layer.objects.active
    selected.sort(key=lambda uid: active is not None and uid == active.session_uid)
    _set_hidden(hidden, True)
    preview.hide()
    try:
        yield
    finally:
        _set_hidden(hidden, False)
        # Blender deselects what it hides.
        objects = (session.object_of(uid) for uid in selected)
        placing.select(scene, [obj for obj in objects if obj is not None])


def _set_hidden(uids: Container[int], hide: bool) -> None:
    """Hide or show the objects with these session_uids, if they still exist."""
    for obj in bpy.data.objects:
        if obj.session_uid in uids:
            obj.hide_viewport = hide


class CTMC_OT_rotation_copy(Needs, bpy.types.Operator):
    """Copy the table."""

    bl_idname = "ctmc.rotation_copy"
    bl_label = "Copy Table"
    bl_description = "Copy the table as CSV, times in seconds"

    needs = (has_table,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.window_manager.clipboard = session.of(context.scene).rotation.csv()
        self.report({"INFO"}, translate("Table copied"))
        return {"FINISHED"}


class CTMC_OT_rotation_save(Needs, SaveDialog, bpy.types.Operator):
    """Save the table."""

    bl_idname = "ctmc.rotation_save"
    bl_label = "Save Table"
    bl_description = "Save the table as CSV, times in seconds"

    suffixes = (".csv",)

    filter_glob: StringProperty(default="*.csv", options={"HIDDEN"})

    needs = (has_table,)

    def suggestion(self, _context: bpy.types.Context) -> str:
        return "rotation_test.csv"

    def write(self, context: bpy.types.Context, path: Path) -> None:
        write_text(path, session.of(context.scene).rotation.csv())


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_rotation_test, CTMC_OT_rotation_copy, CTMC_OT_rotation_save)
)
