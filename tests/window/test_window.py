"""An afternoon in a real window, in the order of the sidebar: real mouse and keys, and a picture of each step.

The tests of one Blender build on each other. Run by `make test-window`; the pictures are in out/window.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from window.desk import Box, Desk, NotSeenError

pytestmark = pytest.mark.window

VERSIONS = {"trixie": "4.3", "sid": "5.2"}
SHOW_TAB = "viewport().sidebar.active_panel_category = 'CTMC'"
# All that a run may touch.
STATE = """
answer = {
    "objects": sorted((o.name, o.data.name, len(o.data.vertices), len(o.modifiers)) for o in bpy.data.objects),
    "meshes": sorted(m.name for m in bpy.data.meshes),
    "materials": sorted(m.name for m in bpy.data.materials),
}
"""
JOB = "(lambda job: job is not None and job.step.fraction)(ours('ui.jobs').running())"
IDLE = "ours('ui.jobs').running() is None"
# The middle of the volume fills the viewport, seen from the head, the patient's front up.
FROM_ABOVE = """
from mathutils import Quaternion, Vector
view = viewport()
corners = ours("core.boxes").volume_box(ours("ui.volumes").current(bpy.context.scene)) * 0.01
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
# Grey and tinted patches of the slice: where they are on the screen, and the colours they must have.
PATCHES = """
import numpy as np
slicing, volume = ours("core.slicing"), ours("ui.volumes").current(bpy.context.scene)
view, settings = bpy.context.scene.ctmc_view, bpy.context.scene.ctmc
place = slicing.slice_place(volume, view.plane, view.position)
colours = slicing.picture(slicing.slice_values(volume, place), view.window, view.level, settings.threshold)
answer = []
for row in range(136, 400, 24):
    for column in range(76, 436, 24):
        around = colours[row - 4 : row + 5, column - 4 : column + 5, :3]
        if around.std(axis=(0, 1)).max() < 0.12:
            at = ours("core.volume").to_ras_mm(volume.affine, np.array([[column, row, place.index]]))[0] * 0.01
            answer.append((*on_screen(at), *(255 * around.mean(axis=(0, 1))).tolist()))
"""


def sidebar(desk: Desk) -> Box:
    """Where the sidebar is on the screen."""
    return tuple(
        desk.ask("""
view = viewport()
bar = view.sidebar
answer = [bar.x, view.window.height - bar.y - bar.height, bar.width, bar.height]
""")
    )


def field(desk: Desk, label: str) -> tuple[int, int]:
    """A place in the field beside a label: fields fill the right part of the sidebar."""
    box = sidebar(desk)
    return int(box[0] + 0.65 * box[2]), desk.find(label, box)[1]


def button(desk: Desk, text: str) -> tuple[int, int]:
    """A button of the sidebar, which is scrolled where the button is too far down."""
    box = sidebar(desk)
    for _ in range(3):
        try:
            return desk.find(text, box)
        except NotSeenError:
            desk.move(box[0] + 40, box[1] + box[3] // 2)
            desk.hand("click", "--repeat", "8", "--delay", "30", "5")
    return desk.find(text, box)


def press(desk: Desk, text: str, operator: str) -> None:
    """Click on a button that can be pressed."""
    assert desk.ask(f"answer = bpy.ops.ctmc.{operator}.poll()"), f"{text} is greyed out"
    desk.click(*button(desk, text))


def test_the_zip_is_enabled_and_the_tab_is_there(desk):
    assert desk.ask("answer = bpy.app.version_string").startswith(tuple(VERSIONS.values()))
    assert desk.ask("answer = 'bl_ext.user_default.ctmc' in bpy.context.preferences.addons")
    desk.ask("bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.materials])")
    desk.ask("viewport().space.show_region_ui = True")
    desk.wait("viewport().sidebar.width > 100")
    desk.ask(SHOW_TAB)
    desk.ask("viewport().area.tag_redraw()")
    desk.look("01-empty")
    assert button(desk, "Load CT")


def test_a_ct_loads_and_the_panel_says_what_it_is(desk):
    desk.ask(f"bpy.ops.ctmc.load(filepath='{desk.inside}/volume-0.nii.gz')")
    desk.ask("bpy.context.scene.ctmc.threshold = 200; bpy.context.scene.ctmc.preview = False")
    desk.ask(FROM_ABOVE)
    desk.look("02-loaded")
    said = "".join(word for word, _, _ in desk.words(sidebar(desk)))
    assert "512x512x29" in said


def test_the_slice_stands_at_its_place_in_its_greys_and_its_tint(desk):
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
    before = desk.ask("answer = bpy.context.scene.ctmc_view.position")
    x, y = field(desk, "Position")
    desk.drag((x, y), (x + 15, y))
    desk.look("04-slice-moved")
    assert desk.ask("answer = bpy.context.scene.ctmc_view.position") > before


def test_a_drag_changes_the_threshold_and_the_tint_follows(desk):
    before = desk.ask("answer = bpy.context.scene.ctmc.threshold")
    x, y = button(desk, "200.000")
    desk.drag((x, y), (x + 60, y))
    desk.look("05-threshold")
    assert desk.ask("answer = bpy.context.scene.ctmc.threshold") > before
    desk.ask("bpy.context.scene.ctmc.threshold = 200")


def test_a_handle_moves_one_face_of_the_region(desk):
    desk.ask("bpy.context.scene.ctmc_view.position = 0.3; bpy.ops.ctmc.fit_region()")
    desk.ask("bpy.context.scene.ctmc.region = (120, 120, 4, 400, 400, 24)")
    before = desk.look("06-region") and desk.ask("answer = list(bpy.context.scene.ctmc.region)")
    # The head of the arrow on the side of the lowest x, which is the patient's right.
    x, y = desk.ask("""
side = ours("ui.region").current_face(0)
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
    press(desk, "Reconstruct Surface", "reconstruct")
    desk.wait("len(bpy.data.objects) == 1")
    desk.wait(IDLE)
    state = desk.ask(STATE)
    desk.look("08-reconstructed")
    assert len(state["objects"]) == len(state["meshes"]) == 1
    assert state["objects"][0][2] > 10_000


def test_esc_half_way_leaves_the_scene_as_it_was(desk):
    before = desk.ask(STATE)
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 150; s.max_error_mm = 0.3")
    press(desk, "Update Surface", "reconstruct")
    desk.wait(f"{JOB} > 0.3")
    desk.look("09-half-way")
    desk.press("Escape")
    # On a busy machine with software GL; how fast Esc is by itself is measured without a window.
    desk.wait(IDLE, seconds=15)
    desk.look("10-cancelled")
    assert desk.ask(STATE) == before


def test_the_same_run_goes_through_afterwards(desk):
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (3, 3, 1); s.reduction = 0.5")
    before = desk.ask(STATE)["objects"]
    press(desk, "Update Surface", "reconstruct")
    desk.wait(f"({IDLE}) and len(bpy.data.objects[0].data.vertices) != {before[0][2]}")
    desk.look("11-again")
    after = desk.ask(STATE)["objects"]
    assert len(after) == 1, "the selected surface is updated, not joined by another"
    assert after[0][2] < before[0][2]


def test_the_rotation_test_runs_and_puts_everything_back(desk):
    before = desk.ask(STATE)
    desk.ask("s = bpy.context.scene.ctmc; s.rotation_rounds = 2; s.rotation_step = 60")
    desk.click(*button(desk, "Rotation Test"))
    time.sleep(1)
    press(desk, "Run Rotation Test", "rotation_test")
    desk.wait("ours('ui.jobs').running() is not None")
    desk.look("12-rotation-test")
    desk.wait("ours('ui.session').of(bpy.context.scene).rotation is not None", seconds=180)
    desk.wait(IDLE)
    desk.look("13-rotation-table")
    table = desk.ask("t = ours('ui.session').of(bpy.context.scene).rotation; answer = [t.percents, t.rounds]")
    assert [len(one) for one in table[1]] == [2] * len(table[0])
    assert all(seconds > 0 for one in table[1] for seconds in one)
    assert desk.ask(STATE) == before
    assert desk.ask("answer = all(not o.hide_viewport for o in bpy.data.objects)")


def test_switched_off_and_on_it_draws_once_more_and_then_no_more(desk):
    module = "bl_ext.user_default.ctmc"
    handlers = desk.ask(f"""
import addon_utils
drawn = []
for _ in range(3):
    addon_utils.disable("{module}")
    drawn.append(len(ours("ui.viewport")._handlers))
    addon_utils.enable("{module}")
    drawn.append(len(ours("ui.viewport")._handlers))
addon_utils.disable("{module}")
answer = [*drawn, len(ours("ui.viewport")._handlers)]
""")
    assert handlers == [0, 2, 0, 2, 0, 2, 0]
    desk.look("14-switched-off")
    assert desk.ask("answer = hasattr(bpy.types.Scene, 'ctmc_view')") is False


def test_it_quits_in_peace(desk):
    status = desk.close()
    log = (desk.pictures / "blender.log").read_text(encoding="utf-8", errors="replace")
    assert status == 0
    assert "Traceback" not in log, log[-3000:]
