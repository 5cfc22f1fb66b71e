# SPDX-License-Identifier: GPL-3.0-or-later
"""Set Up Camera and Lights, and opacity from the panel."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from ctmc_addon.blender.materials import material_opacity


def test_the_button_needs_a_surface_and_sets_the_camera(loaded):
    assert not bpy.ops.ctmc.setup_studio.poll()
    bpy.ops.ctmc.reconstruct()
    assert bpy.ops.ctmc.setup_studio() == {"FINISHED"}
    assert loaded.camera.name == "CTMC Studio Camera"
    surface = bpy.context.view_layer.objects.active
    surface.hide_render = True
    assert not bpy.ops.ctmc.setup_studio.poll()


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
