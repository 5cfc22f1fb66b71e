# SPDX-License-Identifier: GPL-3.0-or-later
"""A CT and its labels by mouse: from the files to all structures in view."""

from __future__ import annotations

import shutil

import pytest
from window.scenes import IDLE, LOADED, QUIET, begin, choose_file

pytestmark = pytest.mark.window

LOAD, MAKE = "bpy.ops.ctmc.load()", "bpy.ops.ctmc.reconstruct()"
LABELS = 'bpy.ops.ctmc.load_labels(filepath="{}")'
LISTED = "answer = [[i.kind, i.chosen] for i in bpy.context.scene.ctmc.labels]"
OPENED = "answer = bpy.context.window_manager.ctmc_page"


@pytest.fixture(scope="module", autouse=True)
def tab(desk, phantom):
    """The tab is open on an empty scene, and labels lie beside the CT."""
    shutil.copy(phantom / "segmentation-0.nii.gz", desk.folder)
    begin(desk)
    yield desk
    desk.ask("bpy.context.preferences.view.language = 'en_US'; bpy.context.preferences.view.ui_scale = 1.1")


def test_from_files_to_all_structures_in_four_clicks(desk):
    desk.look("structures-01-before")
    assert desk.ask(OPENED) == "CT"
    desk.press(LOAD, "load")
    choose_file(desk, f"{desk.inside}/volume-0.nii.gz")
    desk.wait(f"{IDLE} and {LOADED}")
    desk.wait(QUIET)
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (4, 4, 1); s.preview = False")
    assert desk.ask(OPENED) == "CT"
    desk.press(LABELS.format(f"{desk.inside}/segmentation-0.nii.gz"), "load_labels")
    desk.wait(f"{IDLE} and len(bpy.context.scene.ctmc.labels) == 2")
    assert desk.ask(OPENED) == "SURFACE"
    desk.look("structures-02-labels")
    desk.press("bpy.ops.ctmc.add_threshold()", "add_threshold", 0.08)
    assert desk.ask(LISTED) == [["label", True], ["label", True], ["threshold", True]]
    desk.press(MAKE, "reconstruct")
    assert desk.ask(OPENED) == "SURFACE"
    desk.wait(f"{IDLE} and len(bpy.data.meshes) == 3")
    desk.wait(QUIET)
    desk.look("structures-03-made")
    names = desk.ask("answer = sorted(o.name for o in bpy.data.objects if o.type == 'MESH')")
    assert names == ["Bone", "Label 1", "Label 2"]


@pytest.mark.parametrize(
    ("language", "scale"),
    [
        pytest.param("de_DE", 1.0, marks=pytest.mark.once),
        ("de_DE", 2.0),
        pytest.param("zh_HANS", 1.0, marks=pytest.mark.once),
    ],
)
def test_the_list_can_be_looked_at_in_every_language_and_twice_as_large(desk, language, scale):
    desk.ask(f"v = bpy.context.preferences.view; v.language = {language!r}; v.ui_scale = {scale}")
    desk.look(f"structures-04-{language}-{scale}")
    desk.find("bpy.ops.ctmc.add_threshold()", 0.08)
