# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of surfaces: measures, distances, components, goals, and settings taken from them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn, meshes_in

from ctmc_addon.blender.maps.colors import COLORS
from ctmc_addon.blender.surface import evaluated_triangles, read_provenance
from ctmc_addon.core import ReconstructionSettings, reconstruct
from ctmc_addon.readers import read_volume
from ctmc_addon.ui.operators.surface.placing import summary
from ctmc_addon.ui.panels.results.page import CTMC_PT_results
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.results import measurements, surfaces


def active():
    return bpy.context.view_layer.objects.active


def test_results_are_measured_and_the_distance_is_that_of_the_surfaces(loaded):
    from ctmc_addon.core import distances

    loaded.ctmc.reduction = 0.8
    bpy.ops.ctmc.reconstruct()
    thing = active()
    result, full = measurements.of(thing), surfaces.full_of(thing, loaded)
    made = evaluated_triangles(thing)
    assert result.measures.faces == len(made.faces) == pytest.approx(0.2 * full.full_faces, abs=1)
    assert result.measures.closed
    assert result.measures.volume == pytest.approx(made.volume, rel=1e-4)
    exact = distances(made.vertices, full.mesh)
    assert result.distance.largest >= exact.max() - 1e-4
    assert 0 < result.distance.mean < result.distance.largest < 1.0
    assert bpy.ops.ctmc.map_add(quantity="deviation") == {"FINISHED"}
    found = np.empty(len(thing.data.vertices), np.float32)
    thing.data.attributes["deviation_mm"].data.foreach_get("value", found)
    assert found == pytest.approx(exact, abs=1e-4)
    assert thing.data.color_attributes.active_color_name == COLORS
    del thing[measurements.PROPERTY]
    assert bpy.ops.ctmc.measure() == {"FINISHED"}
    assert measurements.of(thing).measures.volume == pytest.approx(result.measures.volume, rel=1e-4)
    assert measurements.of(thing).measures.quality.smallest_angle_deg == pytest.approx(
        result.measures.quality.smallest_angle_deg, rel=1e-2
    )


def test_moving_the_object_is_not_a_deviation(loaded):
    loaded.ctmc.reduction = 0.5
    bpy.ops.ctmc.reconstruct()
    obj = active()
    before = measurements.of(obj)
    obj.location.x += 0.5
    obj.rotation_euler.z = 1.0
    bpy.ops.ctmc.measure()
    after = measurements.of(obj)
    assert after.distance.largest == pytest.approx(before.distance.largest, rel=1e-4)
    assert after.measures.volume == pytest.approx(before.measures.volume, rel=1e-4)


def double_positions(obj):
    for key in obj.data.shape_keys.key_blocks:
        co = np.empty(3 * len(key.points), np.float32)
        key.points.foreach_get("co", co)
        key.points.foreach_set("co", 2 * co)


def move_a_vertex(obj):
    obj.data.shape_keys.key_blocks["alpha"].points[7].co.z += 1e-3


def decimate(obj):
    obj.modifiers.new("Mine", "DECIMATE").ratio = 0.1


def mute_alpha(obj):
    obj.data.shape_keys.key_blocks["alpha"].mute = True


@pytest.mark.parametrize("change", [double_positions, move_a_vertex, decimate, mute_alpha])
def test_measures_are_those_of_the_surface_as_it_is_or_not_shown(loaded, change):
    bpy.ops.ctmc.reconstruct()
    obj = active()
    assert measurements.of(obj) is not None
    change(obj)
    assert measurements.of(obj) is None
    bpy.ops.ctmc.measure()
    assert measurements.of(obj) is not None


def test_other_settings_of_a_modifier_are_another_surface(loaded):
    bpy.ops.ctmc.reconstruct()
    obj = active()
    decimate(obj)
    bpy.ops.ctmc.measure()
    faces = measurements.of(obj).measures.faces
    obj.modifiers["Mine"].ratio = 0.5
    assert measurements.of(obj) is None
    obj.modifiers["Mine"].ratio = 0.1
    obj.modifiers["Mine"].show_expanded = False
    assert measurements.of(obj).measures.faces == faces


def test_every_modifier_of_blender_has_a_text_of_its_settings(loaded):
    bpy.ops.ctmc.reconstruct()
    obj = active()
    kinds = [item.identifier for item in bpy.types.Modifier.bl_rna.properties["type"].enum_items]
    for kind in kinds:
        modifier = obj.modifiers.new(kind, kind)
        if modifier is not None:  # some are not for meshes
            assert measurements.settings_text(modifier).startswith(kind)
    assert len(obj.modifiers) > 40


def test_an_input_of_geometry_nodes_is_in_the_text_of_its_modifier(loaded):
    bpy.ops.ctmc.reconstruct()
    modifier = active().modifiers.new("nodes", "NODES")
    modifier.node_group = bpy.data.node_groups.new("group", "GeometryNodeTree")
    socket = modifier.node_group.interface.new_socket("Size", in_out="INPUT", socket_type="NodeSocketFloat")
    texts = []
    for size in (1.25, 2.5, 1.25):
        if hasattr(modifier, "properties"):
            getattr(modifier.properties.inputs, socket.identifier).value = size
        else:
            modifier[socket.identifier] = size
        texts.append(measurements.settings_text(modifier))
    assert texts[0] == texts[2] != texts[1]


def test_results_give_an_open_surface_no_volume(loaded):
    from ctmc_addon.ui.panels.results.page import facts_of, surface_text

    loaded.ctmc.threshold = 20.0  # the ball reaches over the border
    bpy.ops.ctmc.reconstruct()
    measurement = measurements.of(active())
    assert dict(facts_of(read_provenance(active()), measurement))["Volume"] == "- (open)"
    assert surface_text(measurement.measures) == "Surface: open, 6 borders"  # one on each side of the box
    assert bpy.ops.ctmc.close_border() == {"FINISHED"}
    assert surface_text(measurements.of(active()).measures) == "Surface: closed"
    assert loaded.ctmc.close_border, "the next update keeps it"
    assert not bpy.ops.ctmc.close_border.poll()


def test_the_color_in_results_is_that_of_viewport_and_renders(loaded):
    from ctmc_addon.blender.colors import BONE

    assert tuple(loaded.ctmc.color) == pytest.approx(BONE)
    loaded.ctmc.color = (1.0, 0.0, 0.0)  # of nothing
    bpy.ops.ctmc.reconstruct()
    assert tuple(loaded.ctmc.color) == pytest.approx(BONE)
    loaded.ctmc.color = (0.5, 0.25, 0.125)
    [material] = active().data.materials
    assert tuple(material.diffuse_color) == (0.5, 0.25, 0.125, 1.0)
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    assert tuple(shader.inputs["Base Color"].default_value) == (0.5, 0.25, 0.125, 1.0)
    assert tuple(loaded.ctmc.color) == (0.5, 0.25, 0.125)


def test_make_final_and_use_its_settings(loaded):
    loaded.ctmc.alpha = 0.5
    bpy.ops.ctmc.reconstruct()
    active().select_set(False)  # or the panel's alpha would move it
    loaded.ctmc.from_settings(ReconstructionSettings())
    active().select_set(True)
    bpy.ops.ctmc.adopt_settings()
    assert loaded.ctmc.to_settings() == ReconstructionSettings(threshold=100.0, alpha=0.5)
    assert bpy.ops.ctmc.make_final() == {"FINISHED"}
    assert active().data.shape_keys is None


def test_the_copied_command_makes_the_same_file(loaded, ball_file, tmp_path, monkeypatch):
    import shlex

    from ctmc_addon import cli
    from ctmc_addon.ui.operators.results.results import command_text

    loaded.ctmc.stride, loaded.ctmc.reduction = (2, 2, 1), 0.5
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.export(filepath=str(tmp_path / "panel.stl"))
    words = shlex.split(command_text(loaded))
    assert words[:3] == ["ctmc", "reconstruct", str(ball_file)]
    monkeypatch.chdir(tmp_path)
    assert cli.main(words[1:]) == 0
    assert (tmp_path / "ball.stl").read_bytes() == (tmp_path / "panel.stl").read_bytes()


def test_the_rotation_test_gives_a_table_and_leaves_the_scene_alone(loaded):
    loaded.ctmc.rotation_levels, loaded.ctmc.rotation_step, loaded.ctmc.rotation_rounds = "0 50", 120, 2
    bpy.ops.ctmc.reconstruct()
    before = (len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.scenes), active())
    assert bpy.ops.ctmc.rotation_test() == {"FINISHED"}
    table = session.of(loaded).rotation
    assert table.percents == (0.0, 50.0)
    assert [len(times) for times in table.rounds] == [2, 2]
    assert (len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.scenes), active()) == before
    loaded.ctmc.rotation_levels = "zero"
    with pytest.raises(RuntimeError, match="from 0 to 99, not 'zero'"):
        bpy.ops.ctmc.rotation_test()


@pytest.fixture
def noise(scene, tmp_path):
    """A box among 195 single voxels, loaded."""
    values = np.zeros((16, 40, 40), np.int16)
    values[4:12, 14:26, 14:26] = 200
    values[1:15:3, 1:10:3, 1:39:3] = 200
    np.save(tmp_path / "noise.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "noise.npy"), spacing=(1, 1, 1))
    scene.ctmc.threshold = 100.0
    return scene


def test_many_small_components_are_removed_by_a_button_without_extraction(noise, tmp_path, monkeypatch):
    from ui.drawing import drawn

    from ctmc_addon.core.surfaces import make
    from ctmc_addon.ui.panels.results.page import CTMC_PT_results

    noise.ctmc.alpha = 0.5
    bpy.ops.ctmc.reconstruct()
    drawing = drawn(CTMC_PT_results)
    assert "196 components, 195 below 1 mm3" in drawing.texts
    assert "ctmc.remove_small Remove Small" in drawing.buttons
    monkeypatch.setattr(make, "result_and_full_steps", None)  # extraction would fail
    assert bpy.ops.ctmc.remove_small() == {"FINISHED"}
    settings = ReconstructionSettings(threshold=100.0, alpha=0.5, min_part_mm3=1.0)
    expected = reconstruct(read_volume(tmp_path / "noise.npy", spacing=(1, 1, 1)), settings).mesh
    seen = evaluated_triangles(active())
    assert (seen.faces == expected.faces).all()
    assert np.abs(seen.vertices - expected.vertices).max() <= 1e-4
    assert read_provenance(active()).settings == settings
    assert measurements.of(active()).measures.components == 1
    assert len(meshes_in(noise)) == 1
    assert "1 component" in drawn(CTMC_PT_results).texts


def test_results_name_the_removed_components(noise):
    from ui.drawing import drawn

    from ctmc_addon.ui.panels.results.page import CTMC_PT_results

    noise.ctmc.reduction = 0.9
    bpy.ops.ctmc.reconstruct()
    removed = 196 - measurements.of(active()).measures.components
    texts = drawn(CTMC_PT_results).texts
    assert texts[texts.index("Specks Removed") + 1].startswith(f"{removed} (")
    assert not any(text.startswith(f"{removed} specks removed") for text in texts), "said once"
    largest = measurements.of(active()).distance.largest
    assert largest < 1.0, "of what is still there"


def test_results_name_a_goal_that_was_not_met(loaded):
    from ui.drawing import drawn

    from ctmc_addon.ui.panels.results.page import CTMC_PT_results

    loaded.ctmc.threshold = 20.0  # the ball reaches over the border, whose vertices stay
    loaded.ctmc.target_faces = 4
    bpy.ops.ctmc.reconstruct()
    assert f"{len(active().data.polygons)} triangles are left instead of 4" in " ".join(drawn(CTMC_PT_results).texts)


def test_results_keep_the_last_surface_while_a_slice_is_active(loaded):
    assert "No surface is selected" in drawn(CTMC_PT_results).texts
    bpy.ops.ctmc.reconstruct()
    loaded.ctmc.color = (0.1, 0.2, 0.3)
    name, shown = active().name, drawn(CTMC_PT_results).texts
    bpy.ops.ctmc.add_slice()
    assert active().name != name
    assert drawn(CTMC_PT_results).texts == shown
    assert tuple(loaded.ctmc.color) == pytest.approx((0.1, 0.2, 0.3))
    bpy.data.objects.remove(bpy.data.objects[name])
    assert "No surface is selected" in drawn(CTMC_PT_results).texts


@pytest.mark.parametrize(
    ("name", "setting", "text"),
    [
        ("keep_largest", "keep_parts", "Keeps the largest component"),
        ("remove_small", "min_part_mm3", "Removes components below 1 mm3"),
    ],
)
def test_what_a_button_removes_is_said_above_reconstruct_and_one_press_undoes_it(noise, capfd, name, setting, text):
    from ctmc_addon.ui.panels.surface.page import CTMC_PT_surface

    bpy.ops.ctmc.reconstruct()
    full = read_provenance(active()).full_faces
    assert "ctmc.stop_removing" not in drawn(CTMC_PT_surface).buttons
    assert getattr(bpy.ops.ctmc, name)() == {"FINISHED"}
    assert f". For the next surfaces too: {text}" in capfd.readouterr().out
    drawing = drawn(CTMC_PT_surface)
    assert text in drawing.texts
    assert drawing.buttons.index("ctmc.stop_removing") < drawing.buttons.index("ctmc.reconstruct")
    assert read_provenance(active()).full_faces < full
    assert bpy.ops.ctmc.stop_removing(setting=setting) == {"FINISHED"}
    assert getattr(noise.ctmc, setting) == 0
    assert text not in drawn(CTMC_PT_surface).texts
    bpy.ops.ctmc.reconstruct(new=True)
    assert read_provenance(active()).full_faces == full


def test_a_region_and_several_components_are_said_above_reconstruct(noise):
    from ctmc_addon.ui.panels.surface.page import CTMC_PT_surface

    noise.ctmc.keep_parts, noise.ctmc.region = 3, (0, 0, 0, 9, 9, 9)
    lines = ["Keeps the 3 largest components", "Leaves out everything outside the region"]
    assert [text for text in drawn(CTMC_PT_surface).texts if text in lines] == lines
    bpy.ops.ctmc.stop_removing(setting="region")
    assert not noise.ctmc.use_region
    assert lines[0] in drawn(CTMC_PT_surface).texts
    assert lines[1] not in drawn(CTMC_PT_surface).texts


def test_cavities_are_counted_apart_from_components(scene, tmp_path):
    values = np.zeros((20, 20, 20), np.int16)
    values[2:18, 2:18, 2:18], values[4:16:3, 4:16:3, 4:16:3] = 200, 0
    values[0, 0, 0] = 200
    np.save(tmp_path / "holes.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "holes.npy"), spacing=(1.0, 1.0, 1.0))
    scene.ctmc.threshold, scene.ctmc.close_border = 100.0, True
    bpy.ops.ctmc.reconstruct()
    assert "2 components, 64 cavities, 65 below 4 mm3" in " ".join(drawn(CTMC_PT_results).texts)
    bpy.ops.ctmc.keep_largest()
    assert "1 component, 64 cavities, 64 below 4 mm3" in " ".join(drawn(CTMC_PT_results).texts)


def test_a_report_of_many_surfaces_is_one_short_line(loaded):
    made = [SimpleNamespace(result=SimpleNamespace(mesh=SimpleNamespace(faces=range(100_000)))) for _ in range(61)]
    objects = [SimpleNamespace(name=f"organ {number}") for number in range(61)]
    assert summary(objects, made) == "61 surfaces: 6,100,000 triangles; Measure All lists them"
    assert summary(objects[:2], made[:2]) == "organ 0: 100,000 triangles, organ 1: 100,000 triangles"
