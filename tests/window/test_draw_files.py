# SPDX-License-Identifier: GPL-3.0-or-later
"""What becomes of a drawing: two CTs in a file, Blender's question before it closes, and a Blender that is killed."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import ImageChops
from window.conftest import CT
from window.desk import LIMIT
from window.scenes import IDLE, LOADED, QUIET, begin, load

pytestmark = pytest.mark.window

OTHER = "other.npy"
AGAIN = "bpy.ops.ctmc.load(again=True)"
# The axial slice of the panel's CT from the head, the brush in the hand; two pixels near the middle of the slice.
READY = """
bpy.context.preferences.view.smooth_view = 0
scene, view = bpy.context.scene, viewport()
scene.ctmc_view.plane, scene.ctmc_draw.radius_mm = "axial", 12.0
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side="S")
    bpy.ops.ctmc.draw_tool(tool="ctmc.brush")
core, volume = ours("core.volume"), ours("ui.state.ct.volumes").current(scene)
corners = core.slice_corners(volume, core.slice_at(volume, "axial", scene.ctmc_view.position)) * 0.01
middle, size = corners.mean(axis=0), corners.max(axis=0) - corners.min(axis=0)
answer = [[round(v) for v in on_screen(middle + size * (right, {front}, 0.0))] for right in (-0.1, 0.1)]
"""
# Voxels of each structure on the panel's CT.
VOXELS = """
scene, drawings, masks = bpy.context.scene, ours("ui.state.draw.drawings"), ours("ui.state.draw.masks")
answer = [int(masks.of(scene, item).mask.sum()) for item in drawings.structures(scene)]
"""
ACTIVATE = """
box = next(obj for obj in bpy.context.scene.objects if obj.name == {!r})
bpy.context.view_layer.objects.active = box
box.select_set(True)
"""
CALL = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.wm.{}(filepath={!r})
"""
TAB = "viewport().space.show_region_ui = True"


def draw(desk, front=0.1):
    """Draw a stroke with the brush on the CT of the panel, so far in front of its middle; the structure's voxels."""
    start, end = desk.ask(READY.format(front=front))
    desk.drag(tuple(start), tuple(end))
    (voxels,) = desk.ask(VOXELS)
    return voxels


def open_file(desk, operator, path):
    """Open a .blend, and bring the tab to the front."""
    desk.ask(CALL.format(operator, path))
    desk.ask(TAB)
    desk.wait("viewport().sidebar.width > 100")
    desk.wait("bring_tab('CTMC')")
    desk.places.clear()


def load_again(desk):
    """Press Load Again, and wait until the drawing has followed; voxels of its structures."""
    desk.press(AGAIN, "load")
    desk.wait(f"{IDLE} and {LOADED}")
    desk.wait(QUIET)
    return desk.ask(VOXELS)


@pytest.fixture(scope="module")
def drawn(desk):
    """The voxels drawn on each of two CTs, by the name of its box."""
    begin(desk)
    values = np.add.outer(np.arange(40), np.add.outer(np.arange(60), np.arange(60))).astype(np.int16)
    np.save(desk.folder / OTHER, values)
    voxels = {}
    for path, options in ((CT, {}), (OTHER, {"spacing": (2.0, 2.0, 3.0)})):
        load(desk, f"{desk.inside}/{path}", **options)
        voxels[desk.ask("answer = ours('ui.state.ct.volumes').current(bpy.context.scene).name")] = draw(desk)
    return voxels


def test_each_ct_keeps_its_drawing_while_the_other_is_the_panels(desk, drawn):
    assert len({*drawn.values()}) == 2
    for name, voxels in drawn.items():
        desk.ask(ACTIVATE.format(name))
        desk.wait(f"ours('ui.state.ct.volumes').current(bpy.context.scene).name == {name!r}")
        assert desk.ask(VOXELS) == [voxels]
        desk.look(f"files-01-{name}")


def test_an_unsaved_drawing_asks_before_blender_closes(desk, drawn):
    assert desk.ask("answer = bpy.data.is_dirty")
    desk.move(500, 500)
    before = desk.look("files-02-before")
    desk.key("ctrl+q")
    asked = desk.look("files-02-asked")
    assert desk.is_open()
    changed = ImageChops.difference(before, asked).crop((0, 0, before.width, before.height - 40))  # but the status bar
    left, top, right, bottom = changed.getbbox()
    assert 200 < right - left < 700  # a question in the middle, not another screen
    assert 50 < bottom - top < 300
    desk.key("Escape")
    assert desk.is_open()
    assert list(drawn.values())[-1:] == desk.ask(VOXELS)


@pytest.mark.once
def test_both_drawings_are_saved_beside_the_blend_and_found_when_it_is_opened_again(desk, drawn):
    folder = desk.folder / "kept"
    folder.mkdir()
    desk.ask(f"bpy.ops.wm.save_as_mainfile(filepath='{desk.inside}/kept/case.blend')")
    beside = sorted(file.name for file in folder.glob("*.seg.nrrd"))
    assert len(beside) == 2
    for name, file in zip(sorted(drawn), sorted(beside), strict=True):
        assert re.fullmatch(rf"case Scene {re.escape(name)} \w{{4}} drawn\.seg\.nrrd", file)
    desk.ask("ours('ui.state.ct.volumes')._loaded.clear()")  # as in a Blender that was just opened
    open_file(desk, "open_mainfile", f"{desk.inside}/kept/case.blend")
    last = list(drawn)[-1]
    assert load_again(desk) == [drawn[last]]
    (first,) = set(drawn) - {last}
    desk.ask(ACTIVATE.format(first))
    desk.wait("ours('ui.state.ct.volumes').missing(bpy.context.scene)")
    desk.places.clear()
    assert load_again(desk) == [drawn[first]]
    desk.look("files-03-opened")


@pytest.mark.once
def test_the_autosave_of_a_blender_that_was_killed_has_the_drawing_and_its_ct(desk, drawn, monkeypatch):
    monkeypatch.setattr(desk, "limit", 4 * LIMIT)  # Blender's shortest timer is a minute, and waits for a pause
    desk.ask("bpy.context.preferences.filepaths.auto_save_time = 1")  # minutes, the fewest
    voxels = draw(desk, -0.1)
    assert voxels not in drawn.values()
    assert desk.ask("answer = bpy.data.is_dirty")
    desk.wait(f"any(__import__('pathlib').Path('{desk.inside}').glob('case*autosave.blend'))")
    (saved,) = desk.folder.glob("case*autosave.blend")
    desk.kill()
    desk.open()
    open_file(desk, "recover_auto_save", f"{desk.inside}/{saved.name}")
    assert desk.ask("answer = bpy.data.filepath") == f"{desk.inside}/kept/case.blend"
    assert load_again(desk) == [voxels]
    desk.look("files-04-recovered")
    assert "Traceback" not in desk.printed()
