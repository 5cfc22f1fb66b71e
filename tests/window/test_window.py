# SPDX-License-Identifier: GPL-3.0-or-later
"""An afternoon in a real window, in the order of the sidebar: real mouse and keys, and a picture of each step.

The tests of one Blender build on each other. Run by `make test-window`; the pictures are in out/window.
"""

from __future__ import annotations

import numpy as np
import pytest
from window.desk import Desk

pytestmark = pytest.mark.window

OLDEST = (4, 2)
POSITION, THRESHOLD = "ctmc_view.position", "ctmc.threshold_value"
RECONSTRUCT, ROTATE = "bpy.ops.ctmc.reconstruct()", "bpy.ops.ctmc.rotation_test()"
# All that a run may touch.
STATE = """
answer = {
    "objects": sorted(
        (o.name, o.data.name, len(o.data.vertices), len(o.modifiers), o.hide_viewport, o.select_get())
        for o in bpy.data.objects if o.type == "MESH"
    ),
    "active": getattr(getattr(viewport().window.view_layer.objects.active, "data", None), "name", None),
    "meshes": sorted(m.name for m in bpy.data.meshes),
    "materials": sorted(m.name for m in bpy.data.materials),
}
"""
JOB = "(lambda job: None if job is None else job.step.fraction)(ours('ui.jobs').running())"
SURFACE = "len(bpy.data.meshes) == 1"
IDLE = "ours('ui.jobs').running() is None"
BEFORE = 7  # a frame that is the present one only from the step before the first surface
TABLE = "ours('ui.state.session').of(bpy.context.scene).rotation"
# The middle of the volume fills the viewport, seen from the head, the patient's front up.
FROM_ABOVE = """
from mathutils import Quaternion, Vector
view = viewport()
corners = ours("core.volume").volume_box(ours("ui.state.ct.volumes").current(bpy.context.scene)) * 0.01
about = view.space.region_3d
about.view_perspective = "ORTHO"
about.view_rotation = Quaternion((1, 0, 0, 0))
about.view_location = Vector((corners[0] + corners[7]) / 2)
about.view_distance = 7.0
"""
# From the patient's front, right and head.
FROM_THE_FRONT = """
from mathutils import Euler
about = viewport().space.region_3d
about.view_perspective = "PERSP"
about.view_rotation = Euler((1.05, 0, 2.6)).to_quaternion()
about.view_distance = 7.5
"""
# Gray and tinted patches of the slice: where they are on the screen, and the colors they must have.
PATCHES = """
import numpy as np
slicing, volume = ours("core.volume"), ours("ui.state.ct.volumes").current(bpy.context.scene)
view, settings = bpy.context.scene.ctmc_view, bpy.context.scene.ctmc
place = slicing.slice_at(volume, view.plane, view.position)
colors = slicing.windowed(slicing.slice_values(volume, place), view.window, view.level, settings.threshold)
answer = []
for row in range(136, 400, 24):
    for column in range(76, 436, 24):
        around = colors[row - 4 : row + 5, column - 4 : column + 5, :3]
        if around.std(axis=(0, 1)).max() < 0.12:
            at = slicing.transform_points(volume.affine, np.array([[column, row, place.index]]))[0] * 0.01
            answer.append((*on_screen(at), *(255 * around.mean(axis=(0, 1))).tolist()))
"""


def stop_half_way(desk: Desk, button: str, operator: str, fraction: float, picture: str) -> dict[str, object]:
    """Press a button, and Esc once its job is so far; the state at that moment. The job is held for its picture."""
    desk.press(button, operator)
    desk.wait(f"{IDLE} or {JOB} > {fraction}")
    assert desk.ask(f"answer = {JOB}") is not None, "it was through before it could be stopped"
    desk.ask("ours('ui.jobs').running().advance = lambda: None")
    desk.look(picture)
    state = desk.ask(STATE)
    desk.ask("del ours('ui.jobs').running().advance")
    desk.key("Escape")
    desk.wait(IDLE)
    return state


def test_the_zip_is_enabled_and_the_tab_is_there(desk):
    assert tuple(desk.ask("answer = bpy.app.version")) >= OLDEST
    assert desk.ask("answer = 'bl_ext.user_default.ctmc' in bpy.context.preferences.addons")
    desk.ask("bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.materials])")
    desk.ask("open_fold('rotation'); viewport().space.show_region_ui = True")
    desk.wait("viewport().sidebar.width > 100")
    desk.wait("bring_tab('CTMC')")
    desk.look("01-empty")
    assert desk.find("bpy.ops.ctmc.load()")


def test_a_ct_loads_and_its_slice_can_be_moved(desk):
    desk.ask(f"bpy.ops.ctmc.load(filepath='{desk.inside}/volume-0.nii.gz')")
    desk.ask("bpy.context.scene.ctmc.threshold = 200; bpy.context.scene.ctmc.preview = False")
    desk.ask(FROM_ABOVE)
    desk.look("02-loaded")
    assert desk.ask("answer = ours('ui.state.ct.volumes').current(bpy.context.scene).size") == [512, 512, 29]
    assert desk.find(POSITION)


def test_the_slice_stands_at_its_place_in_its_grays_and_its_tint(desk):
    picture = desk.look("03-slice")
    patches = desk.ask(PATCHES)
    assert len(patches) > 30
    wrong = []
    for x, y, *expected in patches:
        around = picture.crop((int(x) - 3, int(y) - 3, int(x) + 4, int(y) + 4))
        seen = np.asarray(around).mean(axis=(0, 1)).tolist()
        if max(abs(one - other) for one, other in zip(seen, expected, strict=True)) > 20:
            wrong.append((round(x), round(y), seen, expected))
    # A letter, the 3D cursor and a line may cover a patch or two.
    assert len(wrong) <= 3, wrong


def test_a_slider_moves_the_slice(desk):
    before, state = desk.ask(f"answer = bpy.context.scene.{POSITION}"), desk.ask(STATE)
    x, y = desk.find(POSITION)
    desk.drag((x, y), (x + 15, y))
    desk.look("04-slice-moved")
    assert desk.ask(f"answer = bpy.context.scene.{POSITION}") > before
    assert desk.ask(STATE) == state


def test_a_drag_changes_the_threshold_and_the_tint_follows(desk):
    before, state = desk.ask(f"answer = bpy.context.scene.{THRESHOLD}"), desk.ask(STATE)
    x, y = desk.find(THRESHOLD)
    desk.drag((x, y), (x + 60, y))
    desk.look("05-threshold")
    assert desk.ask(f"answer = bpy.context.scene.{THRESHOLD}") > before
    assert desk.ask(STATE) == state
    desk.ask("bpy.context.scene.ctmc.threshold = 200")


def test_a_handle_moves_one_face_of_the_region(desk):
    desk.ask("bpy.context.scene.ctmc_view.position = 0.3; bpy.ops.ctmc.fit_region()")
    desk.ask("bpy.context.scene.ctmc.region = (120, 120, 4, 400, 400, 24)")
    before = desk.look("06-region") and desk.ask("answer = list(bpy.context.scene.ctmc.region)")
    # The head of the arrow on the side of the lowest x, which is the patient's right.
    x, y = desk.ask("""
side = ours("ui.viewport.surface.region").current_face(0)
middle = side.base + side.direction * side.offset()
(x, y), (u, v) = on_screen(middle), on_screen(middle + side.direction)
length = ((u - x) ** 2 + (v - y) ** 2) ** 0.5
reach = 0.35 * bpy.context.preferences.view.gizmo_size * bpy.context.preferences.system.ui_scale
answer = [round(x + reach * (u - x) / length), round(y + reach * (v - y) / length)]
""")
    desk.drag((x, y), (x - 60, y))
    after = desk.ask("answer = list(bpy.context.scene.ctmc.region)")
    desk.look("07-region-moved")
    assert after[0] > before[0] + 10
    assert after[1:] == before[1:]
    desk.ask("bpy.context.scene.ctmc.use_region = False")


def test_reconstruct_makes_one_object_and_one_mesh(desk):
    desk.ask(FROM_THE_FRONT)
    desk.ask(f"bpy.context.scene.frame_current = {BEFORE}; bpy.ops.ed.undo_push(message='Before')")
    desk.press(RECONSTRUCT, "reconstruct")
    desk.wait(SURFACE)
    desk.wait(IDLE)
    state = desk.ask(STATE)
    desk.look("08-reconstructed")
    assert len(state["objects"]) == len(state["meshes"]) == 1
    assert state["objects"][0][2] > 10_000


def test_a_finished_surface_is_one_step_to_undo_and_to_redo(desk):
    state = desk.ask(STATE)
    desk.move(*desk.ask("view = viewport().region; answer = [view.x + view.width // 3, view.y + view.height // 3]"))
    desk.key("ctrl+z")
    desk.look("09-undone")
    assert desk.ask(STATE) == {"objects": [], "active": None, "meshes": [], "materials": []}
    # Not a step too many either: this was set in the last step before.
    assert desk.ask("answer = bpy.context.scene.frame_current") == BEFORE
    desk.key("ctrl+shift+z")
    desk.look("10-redone")
    assert desk.ask(STATE) == state
    assert desk.ask("answer = ours('ui.state.ct.volumes').current(bpy.context.scene) is not None"), (
        "the CT is still there"
    )


def test_esc_half_way_leaves_the_scene_as_it_was(desk):
    before = desk.ask(STATE)
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 150; s.max_error_mm = 0.3")
    stop_half_way(desk, RECONSTRUCT, "reconstruct", 0.3, "11-half-way")
    desk.look("12-cancelled")
    assert desk.ask(STATE) == before


def test_the_same_run_goes_through_afterwards(desk):
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (3, 3, 1); s.reduction = 0.5")
    before = desk.ask(STATE)["objects"]
    desk.press(RECONSTRUCT, "reconstruct")
    desk.wait(f"({IDLE}) and len(bpy.data.meshes[0].vertices) != {before[0][2]}")
    desk.look("13-again")
    after = desk.ask(STATE)["objects"]
    assert len(after) == 1, "the selected surface is updated, not joined by another"
    assert after[0][2] < before[0][2]


def test_esc_stops_the_rotation_test_and_puts_everything_back(desk):
    before = desk.ask(STATE)
    desk.ask("s = bpy.context.scene.ctmc; s.rotation_rounds = 2; s.rotation_step = 90")
    turning = stop_half_way(desk, ROTATE, "rotation_test", 0.4, "14-rotation-test")  # it turns from 0.3 on
    assert len(turning["objects"]) == 4, "the surface and three levels of it"
    desk.look("15-rotation-stopped")
    assert desk.ask(STATE) == before
    assert desk.ask(f"answer = {TABLE} is None")


def test_the_rotation_test_runs_and_puts_everything_back(desk):
    before = desk.ask(STATE)
    desk.press(ROTATE, "rotation_test")
    desk.wait(f"({IDLE}) and {TABLE} is not None")
    desk.find("bpy.ops.ctmc.rotation_save()")  # below the table, which is in sight then
    desk.look("16-rotation-table")
    rounds = desk.ask(f"answer = {TABLE}.rounds")
    assert [len(one) for one in rounds] == [2, 2, 2]
    assert all(seconds > 0 for one in rounds for seconds in one)
    assert desk.ask(STATE) == before


def test_switched_off_and_on_it_draws_once_more_and_then_no_more(desk):
    module = "bl_ext.user_default.ctmc"
    handlers = desk.ask(f"""
import addon_utils
drawn = []
for _ in range(3):
    addon_utils.disable("{module}")
    drawn.append(len(ours("ui.viewport.overlays")._handlers))
    addon_utils.enable("{module}")
    drawn.append(len(ours("ui.viewport.overlays")._handlers))
addon_utils.disable("{module}")
answer = [*drawn, len(ours("ui.viewport.overlays")._handlers)]
""")
    assert handlers == [0, 2, 0, 2, 0, 2, 0]
    desk.look("17-switched-off")
    assert desk.ask("answer = hasattr(bpy.types.Scene, 'ctmc_view')") is False


def test_it_quits_in_peace(desk):
    status = desk.close()
    log = (desk.pictures / "blender.log").read_text(encoding="utf-8", errors="replace")
    assert status == 0
    assert "Traceback" not in log, log[-3000:]
