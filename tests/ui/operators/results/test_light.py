# SPDX-License-Identifier: GPL-3.0-or-later
"""Display in Results: a large surface is made light by Reconstruct, and every operator still takes all of it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from ui.drawing import drawn

bpy = pytest.importorskip("bpy")

import ctmc_addon
from ctmc_addon.blender.surface import as_shown, light, shown_faces
from ctmc_addon.ui.panels.results import page as results
from ctmc_addon.ui.state.results import measurements

GOAL = 150


@pytest.fixture(autouse=True)
def small_limits(monkeypatch):
    monkeypatch.setattr(light, "ABOVE", 400)
    monkeypatch.setattr(light, "GOAL", GOAL)


@pytest.fixture
def surface(loaded):
    """The ball's surface, shown light."""
    bpy.ops.ed.undo_push(message="Loaded")
    bpy.ops.ctmc.reconstruct()
    return active()


def active():
    return bpy.context.view_layer.objects.active


def viewport_faces(obj):
    bpy.context.view_layer.update()
    return len(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)


def line():
    """The line of Results about the display, or None."""
    return next((text for text in drawn(results.CTMC_PT_results).texts if text.startswith("Shown with")), None)


def test_reconstruct_shows_a_large_surface_light_and_results_say_so(surface):
    faces = len(surface.data.polygons)
    assert faces == 892
    assert viewport_faces(surface) == shown_faces(surface) < 0.5 * faces
    assert bpy.context.scene.ctmc.display == "LIGHT"
    assert line() is not None
    assert f"of {faces:,} triangles" in " ".join(drawn(results.CTMC_PT_results).texts)
    assert measurements.of(surface).measures.faces == faces


def test_display_switches_between_full_and_light(surface):
    settings, faces = bpy.context.scene.ctmc, len(surface.data.polygons)
    settings.display = "FULL"
    assert viewport_faces(surface) == faces
    assert settings.display == "FULL"
    assert line() is None
    assert "display" in drawn(results.CTMC_PT_results).shown
    settings.display = "LIGHT"
    assert viewport_faces(surface) == shown_faces(surface) < faces
    surface.modifiers.clear()
    assert settings.display == "FULL"
    settings.display = "LIGHT"
    assert viewport_faces(surface) == shown_faces(surface) < faces


def test_a_small_surface_has_no_choice(surface, monkeypatch):
    monkeypatch.setattr(light, "ABOVE", 10**6)
    bpy.ops.ctmc.reconstruct()
    assert len(surface.modifiers) == 0
    assert "display" not in drawn(results.CTMC_PT_results).shown
    bpy.context.scene.ctmc.display = "LIGHT"
    assert bpy.context.scene.ctmc.display == "FULL"
    assert viewport_faces(surface) == len(surface.data.polygons)


def test_full_stays_chosen_after_an_update(surface):
    bpy.context.scene.ctmc.display = "FULL"
    bpy.context.scene.ctmc.threshold = 110.0
    bpy.ops.ctmc.reconstruct()
    assert active() == surface
    assert bpy.context.scene.ctmc.display == "FULL"
    assert viewport_faces(surface) == len(surface.data.polygons)


def test_update_and_keep_largest_renew_it(surface):
    shown, faces = shown_faces(surface), len(surface.data.polygons)
    bpy.context.scene.ctmc.threshold = 110.0
    bpy.ops.ctmc.reconstruct()
    assert len(surface.data.polygons) < faces
    assert viewport_faces(surface) == shown_faces(surface)
    bpy.ops.ctmc.keep_largest()
    assert viewport_faces(surface) == shown_faces(surface) < 0.5 * len(surface.data.polygons)
    assert shown > 0
    assert [modifier.name for modifier in surface.modifiers] == [light.LIGHT]


def test_measure_finds_the_same_as_in_full(surface):
    found = []
    for display in ("LIGHT", "FULL"):
        bpy.context.scene.ctmc.display = display
        bpy.ops.ctmc.measure()
        stored = json.loads(surface[measurements.PROPERTY])
        found.append(stored)
        assert measurements.of(surface) is not None
    assert found[0] == found[1]
    bpy.context.scene.ctmc.display = "LIGHT"
    assert measurements.of(surface) is not None  # The choice is not a change of the surface.


def test_export_writes_the_same_bytes_as_in_full(surface, tmp_path):
    contents = []
    for display in ("LIGHT", "FULL"):
        bpy.context.scene.ctmc.display = display
        path = tmp_path / display / "ball.stl"
        path.parent.mkdir()
        bpy.ops.ctmc.export(filepath=str(path))
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert len(contents[0]) == 84 + 50 * len(surface.data.polygons)


def test_undo_of_reconstruct_removes_all_of_it_and_redo_brings_it_back(surface):
    faces, shown = len(surface.data.polygons), shown_faces(surface)
    bpy.ops.ed.undo_push(message="Reconstruct")
    bpy.ops.ed.undo()
    assert not [obj for obj in bpy.data.objects if obj.type == "MESH"]
    assert len(bpy.data.node_groups) == 0
    bpy.ops.ed.redo()
    (obj,) = (obj for obj in bpy.data.objects if obj.type == "MESH")
    assert (len(obj.data.polygons), shown_faces(obj), viewport_faces(obj)) == (faces, shown, shown)


def test_cancel_while_it_is_made_leaves_the_scene_as_it_was(surface):
    kinds = ("objects", "meshes", "node_groups", "materials")
    before = {kind: len(getattr(bpy.data, kind)) for kind in kinds}
    steps = bpy.types.CTMC_OT_reconstruct.plan(SimpleNamespace(new=True), bpy.context)
    texts = []
    for step in steps:
        texts.append(step.message)
        if "Making the light display" in step.message:
            break
    assert "Making the light display" in texts[-1]
    steps.close()
    assert {kind: len(getattr(bpy.data, kind)) for kind in kinds} == before


def test_a_saved_file_opens_as_it_was_without_the_extension(surface, tmp_path):
    shown, faces = shown_faces(surface), len(surface.data.polygons)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "ball.blend"))
    ctmc_addon.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "ball.blend"))
        (obj,) = (obj for obj in bpy.data.objects if obj.type == "MESH")
        assert viewport_faces(obj) == shown
        assert len(obj.data.polygons) == faces
    finally:
        ctmc_addon.register()


def test_a_map_and_its_colors_are_of_every_vertex(loaded):
    loaded.ctmc.goal, loaded.ctmc.ratio = "reduction", 0.8
    bpy.ops.ctmc.reconstruct()
    surface = active()
    assert shown_faces(surface) is not None
    bpy.ops.ctmc.map_add(quantity="deviation")
    assert len(surface.data.attributes["deviation_mm"].data) == len(surface.data.vertices)
    bpy.context.view_layer.update()
    shown = surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert shown.color_attributes.active_color_name == surface.data.color_attributes.active_color_name
    assert np.isfinite(as_shown(surface).mesh.vertices).all()
