# SPDX-License-Identifier: GPL-3.0-or-later
"""Set Up Camera and Lights, and opacity from the panel."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from ctmc_addon.blender.materials import material_opacity
from ctmc_addon.blender.scene import engine
from ctmc_addon.ui.operators.render import studio


def test_the_button_needs_a_surface_and_sets_the_camera(loaded):
    assert not bpy.ops.ctmc.setup_studio.poll()
    bpy.ops.ctmc.reconstruct()
    assert bpy.ops.ctmc.setup_studio() == {"FINISHED"}
    assert loaded.camera.name == "CTMC Studio Camera"
    surface = bpy.context.view_layer.objects.active
    surface.hide_render = True
    assert not bpy.ops.ctmc.setup_studio.poll()


@pytest.fixture
def made(loaded):
    """A scene with a surface, and small pictures."""
    bpy.ops.ctmc.reconstruct()
    loaded.render.resolution_x, loaded.render.resolution_y = 64, 48
    return loaded


def test_set_up_sets_the_engine_that_is_shown_and_undo_takes_all_of_it_back(made):
    made.render.engine, made.ctmc_figure.engine = "BLENDER_WORKBENCH", "cycles"
    bpy.ops.ed.undo_push(message="Made")
    bpy.ops.ctmc.setup_studio("EXEC_DEFAULT", True)
    assert made.render.engine == "CYCLES"
    assert made.cycles.time_limit == 60.0
    assert studio.render_text(bpy.context).startswith(f"Cycles, {made.cycles.samples} samples, 64 x 48, about ")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert scene.render.engine == "BLENDER_WORKBENCH"
    assert scene.camera is None
    assert "CTMC Studio" not in bpy.data.collections


def test_without_a_graphics_card_cycles_takes_the_place_of_eevee(made, monkeypatch):
    monkeypatch.setattr(engine, "draws_in_software", lambda: True)
    made.ctmc_figure.engine = "eevee"
    bpy.ops.ctmc.setup_studio()
    assert made.render.engine == "CYCLES"
    assert made.ctmc_figure.engine == "cycles"


def test_the_background_changes_at_once_after_set_up_alone(made):
    own = bpy.data.worlds.new("mine")
    made.world = own
    made.ctmc_studio.background = "TRANSPARENT"
    assert made.world == own
    assert not made.render.film_transparent
    bpy.ops.ctmc.setup_studio()
    assert made.render.film_transparent
    made.ctmc_studio.background = "WHITE"
    assert min(made.world.color) >= 1.0
    assert not made.render.film_transparent


def test_render_sets_up_once_and_writes_the_surface_on_its_background(made, tmp_path):
    made.ctmc_studio.background = "WHITE"
    before = made.render.filepath
    assert bpy.ops.ctmc.render(filepath=str(tmp_path / "ball.png")) == {"FINISHED"}
    assert made.camera.name == "CTMC Studio Camera"
    assert made.render.filepath == before
    image = bpy.data.images.load(str(tmp_path / "ball.png"))
    pixels = np.array(image.pixels[:]).reshape(48, 64, 4)[..., :3]
    assert pixels[4, 4].min() > 0.99
    assert pixels[24, 32].min() < 0.95
    made.camera.location.z += 0.02
    place = made.camera.location.copy()
    bpy.ops.ctmc.render()
    assert made.camera.location == place


def test_render_follows_the_view_of_the_panel_until_a_person_moves_the_camera(made):
    bpy.ops.ctmc.render()
    bpy.ops.ctmc.figure_view(side="left")
    bpy.ops.ctmc.render()
    assert made.camera.matrix_world.col[2].to_tuple(3)[:3] == pytest.approx((-1.0, 0.0, 0.0), abs=1e-3)


def test_render_keeps_samples_and_exposure_that_a_person_sets_after_set_up(made):
    bpy.ops.ctmc.setup_studio()
    made.cycles.samples, made.view_settings.exposure = 3, 1.0
    bpy.ops.ctmc.render()
    assert (made.cycles.samples, made.view_settings.exposure) == (3, 1.0)


def test_render_is_cancelled_where_set_up_refuses(made, monkeypatch):
    from ctmc_addon.core import OutputError
    from ctmc_addon.ui.operators.render import studio

    def refuse(*_):
        raise OutputError("Blender's Cycles is switched off; enable it")

    monkeypatch.setattr(studio, "set_render_engine", refuse)
    assert bpy.ops.ctmc.render() == {"CANCELLED"}
    assert made.camera is None or made.camera.name != "CTMC Studio Camera"


def test_results_set_the_opacity_of_the_active_surface(loaded):
    bpy.ops.ctmc.reconstruct()
    surface = bpy.context.view_layer.objects.active
    assert loaded.ctmc.opacity == 1.0
    loaded.ctmc.opacity = 0.25
    assert material_opacity(surface) == 0.25
    assert loaded.ctmc.opacity == pytest.approx(0.25)


@pytest.fixture
def labels(scene, tmp_path):
    values = np.zeros((8, 8, 20), np.uint8)
    values[2:6, 2:6, 2:7], values[2:6, 2:6, 12:18] = 1, 2
    np.save(tmp_path / "labels.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"), spacing=(1, 1, 1))
    scene.ctmc.use_label = True
    scene.ctmc.show_labels([(1, "liver", (0.2, 0, 0)), (2, "bone", (0.8, 0.8, 0.7))])
    return scene


def test_the_list_begins_with_anatomy_and_surfaces_made_together_follow(labels):
    items = labels.ctmc.labels
    assert [item.opacity for item in items] == pytest.approx([0.6, 1.0])
    for item in items:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    found = {obj.name.split()[-1]: obj for obj in labels.objects if obj.type == "MESH"}
    assert {name: material_opacity(obj) for name, obj in found.items()} == {"liver": 0.6, "bone": 1.0}
    items[0].opacity, items[1].opacity = 0.35, 0.15
    assert {name: material_opacity(obj) for name, obj in found.items()} == {"liver": 0.35, "bone": 0.15}


def test_a_label_made_alone_is_opaque(labels):
    labels.ctmc.labels[0].chosen = True
    labels.ctmc.labels[1].chosen = False
    bpy.ops.ctmc.reconstruct()
    [obj] = [obj for obj in labels.objects if obj.type == "MESH"]
    assert material_opacity(obj) == 1.0
