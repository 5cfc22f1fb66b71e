# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators `ctmc.add_volume` and `ctmc.set_units` as the sidebar presses them."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.volume import vdb_writer

needs_openvdb = pytest.mark.skipif(vdb_writer() is None, reason="this Blender has no OpenVDB module")


@needs_openvdb
def test_a_volume_is_added_beside_the_blend_and_follows_the_sidebar(scene, ball_file, tmp_path):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1.0, 1.0, 2.0))
    assert not bpy.ops.ctmc.add_volume.poll()  # the .blend has no folder yet
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    scene = bpy.context.scene
    scene.ctmc.stride = (2, 2, 1)
    assert bpy.ops.ctmc.add_volume(appearance="skin") == {"FINISHED"}
    assert bpy.ops.ctmc.add_volume(appearance="bone") == {"FINISHED"}
    assert sorted(path.name for path in tmp_path.glob("*.vdb")) == ["ball 2.vdb", "ball.vdb"]
    first, second = (bpy.data.objects[name] for name in ("ball Skin", "ball Bone"))
    assert (first.data.filepath, second.data.filepath) == ("//ball.vdb", "//ball 2.vdb")
    assert first.data.grids.load()
    spacing = np.array(first.data.grids[0].matrix_object)[:3, :3] / 0.01
    assert np.abs(spacing).sum(axis=0) == pytest.approx([2.0, 2.0, 2.0])
    scene.ctmc.threshold, scene.ctmc_view.window = 123.0, 321.0
    for obj in (first, second):
        nodes = obj.data.materials[0].node_tree.nodes
        shown = {node.label: node.outputs[0].default_value for node in nodes if node.type == "VALUE"}
        assert (shown["Threshold"], shown["Window"]) == (123.0, 321.0)


def test_units_are_set_once_and_undone_by_hand(scene):
    assert bpy.ops.ctmc.set_units() == {"FINISHED"}
    units = scene.unit_settings
    assert (units.system, units.length_unit) == ("METRIC", "MILLIMETERS")
    assert units.scale_length == pytest.approx(0.1)  # a Blender unit is 100 mm
