# SPDX-License-Identifier: GPL-3.0-or-later
"""The cube of a new file is removed when the first CT comes; whatever somebody has made stays."""

import pytest

bpy = pytest.importorskip("bpy")

import ctmc_addon


@pytest.fixture
def new_file():
    """Blender's own new file, with its cube."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    ctmc_addon.register()
    yield bpy.context.scene
    ctmc_addon.unregister()


def load(path):
    bpy.ops.ctmc.load(filepath=str(path), spacing=(1, 1, 2))


def test_it_is_removed_with_its_mesh_and_undo_brings_it_back(new_file, ball_file):
    bpy.ops.ed.undo_push(message="New file")
    bpy.ops.ctmc.load("EXEC_DEFAULT", True, filepath=str(ball_file), spacing=(1, 1, 2))
    assert "Cube" not in bpy.data.objects
    assert "Cube" not in bpy.data.meshes
    assert [obj.type for obj in new_file.objects].count("MESH") == 0  # So Alt-H has none to show.
    bpy.ops.ed.undo()
    assert "Cube" in bpy.data.objects
    assert "Cube" in bpy.data.meshes


CHANGES = ["moved", "edited", "beside another", "modified", "painted", "parent", "of a saved file"]


@pytest.mark.parametrize("change", CHANGES)
def test_what_somebody_has_made_stays(new_file, ball_file, tmp_path, change):
    cube = bpy.data.objects["Cube"]
    if change == "moved":
        cube.location.x = 0.5
    elif change == "edited":
        cube.data.vertices[0].co.x = -2.0
    elif change == "beside another":
        bpy.ops.mesh.primitive_cone_add()
    elif change == "modified":
        cube.modifiers.new("Mine", "SUBSURF")
    elif change == "painted":
        cube.active_material.diffuse_color = (1.0, 0.0, 0.0, 1.0)
    elif change == "parent":
        bpy.data.objects["Light"].parent = cube
    else:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    bpy.context.view_layer.update()
    load(ball_file)
    assert not cube.hide_get()
    assert not cube.hide_render
