# SPDX-License-Identifier: GPL-3.0-or-later
"""The drawing tools are in the toolbar while a scene has a CT, and at no other time."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from bl_ui.space_toolsystem_toolbar import VIEW3D_PT_tools_active

import ctmc_addon


def in_toolbar():
    """Our tools in the toolbar of the viewport, and its length."""
    tools = VIEW3D_PT_tools_active._tools["OBJECT"]
    names = [tool.idname for tool in VIEW3D_PT_tools_active._tools_flatten(tools) if tool is not None]
    return [name for name in names if name.startswith("ctmc.")], len(tools)


OURS = ["ctmc.grow", "ctmc.brush", "ctmc.eraser", "ctmc.scissors"]


def test_they_come_with_a_ct_and_go_with_its_file(scene, ball_file, tmp_path):
    none, length = in_toolbar()
    assert none == []
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    assert in_toolbar()[0] == OURS
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "ball.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert in_toolbar() == ([], length)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "ball.blend"))
    assert in_toolbar()[0] == OURS


def test_undo_of_loading_takes_them_out_and_redo_brings_them_back(scene, ball_file):
    bpy.ops.ed.undo_push(message="New file")
    bpy.ops.ctmc.load("EXEC_DEFAULT", True, filepath=str(ball_file), spacing=(1, 1, 2))
    bpy.ops.ed.undo()
    assert in_toolbar()[0] == []
    bpy.ops.ed.redo()
    assert in_toolbar()[0] == OURS


def test_none_is_left_after_disabling(scene, ball_file):
    _, length = in_toolbar()
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    ctmc_addon.unregister()
    assert in_toolbar() == ([], length)
    ctmc_addon.register()
