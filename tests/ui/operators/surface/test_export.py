# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel writes the bytes that the command line writes, and takes nothing for a surface that is not one."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.figure.render import figure_steps
from ctmc_addon.blender.figure.spec import Cell, Page, ShownSurface
from ctmc_addon.cli import main
from ctmc_addon.core import finish
from ctmc_addon.ui.operators.figure import subject
from ctmc_addon.ui.operators.surface.export import CTMC_OT_export
from ctmc_addon.ui.operators.surface.results import command_text
from ctmc_addon.ui.state import surfaces, volumes


def active():
    return bpy.context.view_layer.objects.active


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
@pytest.mark.parametrize("flags", [("--alpha", "0.3"), ("--simplify", "0.5"), ("--label", "100")])
def test_panel_and_command_line_write_the_same_bytes(loaded, ball_file, tmp_path, suffix, flags):
    if flags[0] == "--label":
        loaded.ctmc.use_threshold, loaded.ctmc.use_label, loaded.ctmc.label = False, True, 100
    else:
        setattr(loaded.ctmc, "alpha" if flags[0] == "--alpha" else "reduction", float(flags[1]))
        flags = ("--threshold", "100", *flags)
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.export(filepath=str(tmp_path / f"panel{suffix}"))
    line = ["reconstruct", str(ball_file), "-o", str(tmp_path / f"command{suffix}"), "--spacing", "1", "1", "2", *flags]
    assert main(line) == 0
    assert (tmp_path / f"panel{suffix}").read_bytes() == (tmp_path / f"command{suffix}").read_bytes()


def test_an_object_with_a_slash_in_its_name_is_exported_under_one_that_a_file_can_have(loaded, tmp_path):
    from types import SimpleNamespace

    bpy.ops.ctmc.reconstruct()
    active().name = "CT Kidney/left"
    dialog = SimpleNamespace(ending=lambda: ".stl")
    assert CTMC_OT_export.suggestion(dialog, bpy.context) == "CT Kidney_left.stl"
    assert subject(bpy.context) == "CT Kidney_left"
    assert bpy.ops.ctmc.export(filepath=str(tmp_path / "CT Kidney_left.stl")) == {"FINISHED"}
    assert [path.name for path in tmp_path.glob("*.stl")] == ["CT Kidney_left.stl"]


def test_a_length_in_a_name_is_not_a_suffix(loaded, tmp_path):
    bpy.ops.ctmc.reconstruct()
    assert bpy.ops.ctmc.export(filepath=str(tmp_path / "liver 1.5mm")) == {"FINISHED"}
    assert bpy.ops.ctmc.export(filepath=str(tmp_path / "liver 1.5mm"), kind=".ply") == {"FINISHED"}
    assert [path.name for path in sorted(tmp_path.glob("liver*"))] == ["liver 1.5mm.ply", "liver 1.5mm.stl"]


def test_the_copied_command_writes_a_file_that_can_be(loaded):
    loaded.ctmc.use_threshold, loaded.ctmc.use_label, loaded.ctmc.label = False, True, 100
    record = volumes.loaded(loaded)
    object.__setattr__(record.volume, "name", "thorax/axial")
    assert "-o thorax_axial_label_100.stl --" in command_text(loaded)


def test_the_objects_of_a_figures_blend_are_not_surfaces(loaded, tmp_path):
    bpy.ops.ctmc.reconstruct()
    finish(
        figure_steps(
            [Cell((ShownSurface(active()),))], tmp_path / "a.png", Page(30.0, 40.0), None, tmp_path / "a.blend"
        )
    )
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    objects = [obj for obj in bpy.data.objects if obj.type == "MESH"]
    assert objects
    assert not [obj for obj in objects if surfaces.is_surface(obj)]


def test_another_add_ons_property_is_not_a_surface(scene):
    stranger = bpy.data.objects.new("stranger", bpy.data.meshes.new("stranger"))
    scene.collection.objects.link(stranger)
    for value in ({"scale": 0.01}, 3, "text"):
        stranger["ctmc"] = value
        assert not surfaces.is_surface(stranger)


def test_an_update_leaves_the_alpha_key_where_a_hand_has_put_it(loaded):
    bpy.ops.ctmc.reconstruct()
    active().data.shape_keys.key_blocks["alpha"].value = 0.2
    loaded.ctmc.threshold = 120.0
    bpy.ops.ctmc.reconstruct()
    assert active().data.shape_keys.key_blocks["alpha"].value == pytest.approx(0.2)


def test_a_surface_linked_from_a_file_is_exported_beside_an_object_of_its_name(loaded, tmp_path):
    bpy.ops.ctmc.reconstruct()
    name, faces = active().name, len(active().data.polygons)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.collection.objects.link(bpy.data.objects.new(name, bpy.data.meshes.new(name)))
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, linked):
        linked.objects = [name]
    scene.collection.objects.link(linked.objects[0])
    bpy.context.view_layer.objects.active = linked.objects[0]
    assert bpy.ops.ctmc.export(filepath=str(tmp_path / "linked.stl")) == {"FINISHED"}
    assert (tmp_path / "linked.stl").stat().st_size == 84 + 50 * faces
