# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel writes the bytes that the command line writes, and takes nothing for a surface that is not one."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn

from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.spec import Cell, Page, ShownSurface
from ctmc_addon.cli import main
from ctmc_addon.core import finish
from ctmc_addon.ui.operators.render.figure import subject
from ctmc_addon.ui.operators.results import export
from ctmc_addon.ui.operators.results.export import CTMC_OT_export
from ctmc_addon.ui.operators.results.results import command_text
from ctmc_addon.ui.panels.results.page import CTMC_PT_results
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.results import surfaces


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


def organs_file(tmp_path):
    """Labels of three boxes, which TotalSegmentator calls kidney_right, liver and sacrum."""
    values = np.zeros((12, 12, 14), np.uint8)
    values[2:6, 2:6, 2:6], values[7:10, 7:10, 7:10], values[2:5, 7:10, 2:5] = 5, 2, 25
    np.save(tmp_path / "totalsegmentator_seg.npy", values)
    return tmp_path / "totalsegmentator_seg.npy"


@pytest.mark.parametrize("which", ["SELECTED", "VISIBLE"])
def test_several_surfaces_go_to_one_file_with_the_bytes_of_the_command_line(scene, tmp_path, which):
    path = organs_file(tmp_path)
    bpy.ops.ctmc.load(filepath=str(path), spacing=(1, 1, 2))
    for item in scene.ctmc.labels:
        item.chosen = item.value != 25
    bpy.ops.ctmc.reconstruct()
    bpy.ops.mesh.primitive_cube_add()
    cube = active()
    for obj in bpy.context.scene.objects:
        obj.select_set(obj is not cube and obj.name in ("liver", "kidney_right"))
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    line = ["reconstruct", str(path), "--spacing", "1", "1", "2", "--label", "kidney_right,liver", "-o"]
    bpy.ops.ctmc.export(filepath=str(tmp_path / "a" / "x.obj"), which=which)
    assert main([*line, str(tmp_path / "b" / "x.obj")]) == 0
    assert (tmp_path / "a" / "x.obj").read_bytes() == (tmp_path / "b" / "x.obj").read_bytes()
    lines = (tmp_path / "a" / "x.mtl").read_text("utf-8").splitlines()
    assert [text for text in lines if text.startswith(("newmtl", "Kd"))] == [
        "newmtl kidney_right",
        "Kd 0.6510 0.3529 0.2196",
        "newmtl liver",
        "Kd 0.4784 0.1098 0.1569",
    ]


def three_organs(scene, tmp_path):
    bpy.ops.ctmc.load(filepath=str(organs_file(tmp_path)), spacing=(1, 1, 2))
    for item in scene.ctmc.labels:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    return sum(len(obj.data.polygons) for obj in surfaces.selected_surfaces(bpy.context))


def test_several_selected_surfaces_go_to_the_file_of_a_script_that_does_not_say_which(scene, tmp_path, capfd):
    faces = three_organs(scene, tmp_path)
    assert bpy.ops.ctmc.export(filepath=str(tmp_path / "organs.glb")) == {"FINISHED"}
    size = max(1, round((tmp_path / "organs.glb").stat().st_size / 1000))
    path = tmp_path / "organs.glb"
    assert f"Info: Wrote {path}: 3 objects, {faces:,} triangles, {size} kB" in capfd.readouterr().out
    with pytest.raises(RuntimeError, match=r"a\.stl can hold one surface, not 3; choose the format 3MF or GLB"):
        bpy.ops.ctmc.export(filepath=str(tmp_path / "a.stl"))
    for obj in bpy.context.scene.objects:
        obj.select_set(obj == active())
    bpy.ops.ctmc.export(filepath=str(tmp_path / "one.stl"))
    bpy.ops.ctmc.export(filepath=str(tmp_path / "all.obj"))
    assert (tmp_path / "one.stl").stat().st_size == 84 + 50 * len(active().data.polygons)
    assert sum(line.startswith("o ") for line in (tmp_path / "all.obj").read_text("utf-8").splitlines()) == 3
    active().hide_set(True)
    bpy.ops.ctmc.export(filepath=str(tmp_path / "two.obj"), which="VISIBLE")
    assert sum(line.startswith("o ") for line in (tmp_path / "two.obj").read_text("utf-8").splitlines()) == 2


class Dialog:
    """The operator as its file browser has it."""

    suffixes, suggested = CTMC_OT_export.suffixes, ""
    kind, which, filepath = ".stl", "ACTIVE", ""
    ending, suggestion, surfaces = CTMC_OT_export.ending, CTMC_OT_export.suggestion, CTMC_OT_export.surfaces
    check, follow = CTMC_OT_export.check, CTMC_OT_export.follow
    properties = type("Properties", (), {"is_property_set": lambda self, name: False})()

    def __init__(self, monkeypatch):
        monkeypatch.setattr(export.SaveDialog, "invoke", lambda self, *_: None)
        CTMC_OT_export.invoke(self, bpy.context, None)
        self.filepath = f"/x/{self.suggested}"


def test_the_dialog_takes_several_selected_surfaces_and_the_name_of_their_ct(scene, tmp_path, monkeypatch):
    three_organs(scene, tmp_path)
    dialog = Dialog(monkeypatch)
    assert (dialog.which, dialog.filepath) == ("SELECTED", "/x/totalsegmentator_seg.glb")
    scene.ctmc.volume_name = "Ex 4"
    dialog = Dialog(monkeypatch)
    assert dialog.filepath == "/x/Ex 4.glb"
    dialog.which = "ACTIVE"
    assert dialog.check(bpy.context)
    assert dialog.filepath == f"/x/{active().name}.glb"
    for obj in bpy.context.scene.objects:
        obj.select_set(obj == active())
    dialog = Dialog(monkeypatch)
    assert (dialog.which, dialog.filepath) == ("ACTIVE", f"/x/{active().name}.stl")
    dialog.kind = ".3mf"
    assert dialog.check(bpy.context)
    assert (dialog.which, dialog.filepath) == ("VISIBLE", "/x/Ex 4.3mf")
    dialog.filepath = "/x/mine.ply"
    dialog.check(bpy.context)
    assert (dialog.kind, dialog.which, dialog.filepath) == (".ply", "ACTIVE", "/x/mine.ply")


def test_several_surfaces_do_not_go_to_an_stl(scene, tmp_path):
    bpy.ops.ctmc.load(filepath=str(organs_file(tmp_path)), spacing=(1, 1, 2))
    for item in scene.ctmc.labels:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    with pytest.raises(RuntimeError, match=r"a\.stl can hold one surface, not 3; choose the format 3MF or GLB"):
        bpy.ops.ctmc.export(filepath=str(tmp_path / "a.stl"), which="VISIBLE")
    assert not (tmp_path / "a.stl").exists()


def test_an_object_with_a_slash_in_its_name_is_exported_under_one_that_a_file_can_have(loaded, tmp_path):
    from types import SimpleNamespace

    bpy.ops.ctmc.reconstruct()
    active().name = "CT Kidney/left"
    dialog = SimpleNamespace(ending=lambda: ".stl", surfaces=lambda _: [active()])
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


def test_a_mirrored_or_scaled_surface_is_said_in_results_and_export(loaded, tmp_path):
    bpy.ops.ctmc.reconstruct()
    obj, operator = active(), type("Export", (), {"which": "ACTIVE", "surfaces": CTMC_OT_export.surfaces})()

    def said():
        bpy.context.view_layer.update()
        texts = drawn(CTMC_PT_results).texts
        return CTMC_OT_export.warnings(operator, bpy.context), "Mirrored: left and right are exchanged" in texts

    assert said() == ([], False)
    obj.scale.x = -1.0
    assert said() == ([f"{obj.name}: Mirrored: left and right are exchanged"], True)
    obj.scale = (1.5, 1.5, 1.5)
    (warning,), mirrored = said()
    assert warning.startswith(f"{obj.name}: Scaled by 1.5:")
    assert not mirrored
