# SPDX-License-Identifier: GPL-3.0-or-later
"""The cube of a new file goes out of view when the first CT comes; whatever somebody has made stays."""

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


def test_it_is_hidden_once_and_shown_again_it_stays(new_file, ball_file):
    load(ball_file)
    cube = bpy.data.objects["Cube"]
    assert cube.hide_get()
    assert cube.hide_render
    cube.hide_set(False)
    load(ball_file)
    assert not cube.hide_get()


@pytest.mark.parametrize("change", ["moved", "edited", "beside another", "modified", "of a saved file"])
def test_what_somebody_has_made_stays_in_view(new_file, ball_file, tmp_path, change):
    cube = bpy.data.objects["Cube"]
    if change == "moved":
        cube.location.x = 0.5
    elif change == "edited":
        cube.data.vertices[0].co.x = -2.0
    elif change == "beside another":
        bpy.ops.mesh.primitive_cone_add()
    elif change == "modified":
        cube.modifiers.new("Mine", "SUBSURF")
    else:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    bpy.context.view_layer.update()
    load(ball_file)
    assert not cube.hide_get()
    assert not cube.hide_render
