# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces after the first: updated, several labels at once, simplified again, alpha, measured, mapped, turned."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import meshes_in

from ctmc_addon.blender.surface import evaluated_triangles, read_provenance
from ctmc_addon.core import Budget, MemoryLimitError, ReconstructionSettings, SettingsError, finish, reconstruct
from ctmc_addon.core.volume import otsu
from ctmc_addon.readers import read_volume
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import volumes


@pytest.fixture
def labels_file(tmp_path):
    """Three boxes of labels 1, 2 and 5."""
    values = np.zeros((12, 12, 24), np.uint8)
    for number, label in enumerate((1, 2, 5)):
        values[3:9, 3:9, 2 + 7 * number : 7 + 7 * number] = label
    np.save(tmp_path / "labels.npy", values)
    return tmp_path / "labels.npy"


def active():
    return bpy.context.view_layer.objects.active


def steps_of(scene, *runs, target=None):
    """The steps of a reconstruction, as the panel's button drives them."""
    from ctmc_addon.ui.operators.surface.placing import ObjectRequest
    from ctmc_addon.ui.operators.surface.reconstruct import surfaces_steps

    requests = [ObjectRequest(one, target=target) for one in runs or (scene.ctmc.to_settings(),)]
    return surfaces_steps(volumes.current(scene), requests, scene.session_uid)


def test_the_edges_of_a_surface_are_found_once_for_its_measures_and_for_blender(loaded, monkeypatch):
    from ctmc_addon.core.mesh import topology

    sorted_pairs, sort = [], topology._order
    monkeypatch.setattr(topology, "_order", lambda *pairs: sorted_pairs.append(len(pairs[0])) or sort(*pairs))
    monkeypatch.setattr("ctmc_addon.core.mesh.measures.edge_keys_steps", None)  # Nothing sorts them a second time.
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    assert sum(sorted_pairs) == 3 * len(active().data.polygons)


def test_components_that_were_counted_once_are_not_looked_for_again_to_keep_the_largest(loaded, monkeypatch):
    from ctmc_addon.core.mesh.pieces import piece_links

    bpy.ops.ctmc.reconstruct()
    sizes, number = [], piece_links.component_numbers_steps
    monkeypatch.setattr(
        piece_links, "component_numbers_steps", lambda faces, count: sizes.append(len(faces)) or number(faces, count)
    )
    faces = len(active().data.polygons)
    assert bpy.ops.ctmc.keep_largest() == {"FINISHED"}
    assert len(active().data.polygons) == faces
    assert faces not in sizes


def test_again_on_a_selected_surface_updates_it_and_keeps_what_is_its_own(loaded):
    bpy.ops.ctmc.reconstruct()
    thing, material = active(), active().data.materials[0]
    thing.location.x += 3.0
    thing.modifiers.new("Mine", "SMOOTH")
    before = len(thing.data.polygons)
    loaded.ctmc.threshold = 120.0
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    assert meshes_in(loaded) == [thing]
    assert len(thing.data.polygons) < before
    assert thing.data.materials[0] == material
    assert [one.name for one in thing.modifiers] == ["Mine"]
    assert len(bpy.data.meshes) == 1
    thing.select_set(False)
    bpy.ops.ctmc.reconstruct()
    assert len(meshes_in(loaded)) == 2


def test_an_update_refuses_what_it_cannot_change(loaded):
    bpy.ops.ctmc.reconstruct()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Edit Mode"):
        bpy.ops.ctmc.reconstruct()
    with pytest.raises(RuntimeError, match="Leave Edit Mode first"):
        bpy.ops.ctmc.export()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    assert len(meshes_in(loaded)) == 1


def test_an_update_leaves_an_alpha_that_a_hand_has_moved(loaded):
    bpy.ops.ctmc.reconstruct()
    active().data.shape_keys.key_blocks["alpha"].value = 0.25
    loaded.ctmc.threshold = 110.0
    bpy.ops.ctmc.reconstruct()
    assert active().data.shape_keys.key_blocks["alpha"].value == 0.25


def test_the_memory_limit_of_the_preferences_is_handed_to_every_simplifier(loaded, monkeypatch, tmp_path):
    from ctmc_addon.core.simplification.whole import Goal
    from ctmc_addon.ui.operators.render import figure, rotation
    from ctmc_addon.ui.operators.surface import reconstruct
    from ctmc_addon.ui.properties.preferences import Machine

    bpy.ops.ctmc.reconstruct()
    limit = Goal(reduction=0.5).bytes_at_once(len(active().data.polygons)) - 1
    for module in (figure, reconstruct, rotation):
        monkeypatch.setattr(module, "machine", lambda: Machine(budget=Budget(bytes=limit)))
    bpy.ops.ctmc.reconstruct()  # extraction needs less
    loaded.ctmc.reduction = 0.5
    for operator in (bpy.ops.ctmc.reconstruct, bpy.ops.ctmc.simplify):
        with pytest.raises(RuntimeError, match="MiB of memory"):
            operator()
    with pytest.raises(RuntimeError, match="MiB of memory"):
        bpy.ops.ctmc.rotation_test()
    loaded.ctmc_figure.use_levels = True
    with pytest.raises(RuntimeError, match="MiB of memory"):
        bpy.ops.ctmc.figure_sheet(filepath=str(tmp_path / "sheet.png"))


@pytest.fixture
def too_large(loaded, monkeypatch):
    """The ball, which does not fit as a whole and is simplified as it is extracted; the memory limit."""

    from ctmc_addon.core.simplification.whole import Goal
    from ctmc_addon.core.surfaces.extract import FieldSurface
    from ctmc_addon.ui.operators.surface import reconstruct as operators
    from ctmc_addon.ui.properties.preferences import Machine

    bpy.ops.ctmc.reconstruct(new=True)
    limit = Goal(reduction=0.5).bytes_at_once(len(active().data.polygons)) - 1
    bpy.data.objects.remove(active())
    session.clear()
    full_steps = FieldSurface.full_steps

    def refused_steps(self):
        yield from full_steps(self)
        raise MemoryLimitError("the surface does not fit; choose a larger stride or a region")

    monkeypatch.setattr(FieldSurface, "full_steps", refused_steps)
    budget = Budget(bytes=limit, slab_bytes=1, work_bytes=0, whole_faces=200)
    monkeypatch.setattr(operators, "machine", lambda: Machine(budget=budget))
    return budget


def test_a_surface_that_does_not_fit_is_simplified_as_it_is_extracted(loaded, too_large, ball_file):
    from ctmc_addon.core.planning.cost_estimate import FieldCache
    from ctmc_addon.ui.state.surface.cost_estimates import estimate_steps

    loaded.ctmc.reduction = 0.9
    settings = loaded.ctmc.to_settings()
    volume = read_volume(ball_file, spacing=(1, 1, 2))
    assert finish(estimate_steps([(FieldCache(volume, too_large), settings)])).refusal == ""
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    expected = reconstruct(volume, settings, too_large)
    seen = evaluated_triangles(active())
    assert seen.faces.tobytes() == expected.mesh.faces.tobytes()
    assert seen.vertices.tobytes() == expected.mesh.vertices.tobytes()
    assert expected.mesh.closed
    assert len(seen.faces) <= 0.1 * expected.full_faces == 0.1 * read_provenance(active()).full_faces
    assert session.of(loaded).full == {}
    assert active().data.shape_keys is None
    with pytest.raises(RuntimeError, match="stride 2 2 2 would fit"):
        bpy.ops.ctmc.map_add(quantity="deviation")


def test_a_surface_that_was_never_whole_takes_another_goal_and_no_other_simplifier(loaded, too_large):
    loaded.ctmc.reduction = 0.9
    bpy.ops.ctmc.reconstruct()
    loaded.ctmc.reduction = 0.95
    assert bpy.ops.ctmc.simplify() == {"FINISHED"}
    assert len(active().data.polygons) <= 0.05 * read_provenance(active()).full_faces
    volumes._loaded.clear()
    with pytest.raises(RuntimeError, match="its full surface is not in memory; load its CT again"):
        bpy.ops.ctmc.simplify()


def test_a_deleted_target_becomes_a_new_object(loaded):
    bpy.ops.ctmc.reconstruct()
    conclude = finish(steps_of(loaded, target=active().session_uid))
    bpy.data.objects.remove(active())
    conclude()
    assert len(meshes_in(loaded)) == 1


@pytest.mark.parametrize("meshes", [0, 1, 2])
def test_a_job_left_while_blender_makes_meshes_leaves_none(loaded, meshes):
    settings = loaded.ctmc.to_settings()
    steps = steps_of(loaded, settings, settings)
    assert any(len(bpy.data.meshes) == meshes for step in steps if step.message == "Adding the surface")
    assert (len(bpy.data.meshes), len(meshes_in(loaded))) == (meshes, 0)
    steps.close()
    assert (len(bpy.data.meshes), len(meshes_in(loaded))) == (0, 0)


def test_a_mesh_that_undo_has_taken_is_made_again(loaded):
    conclude = finish(steps_of(loaded))
    bpy.data.meshes.remove(bpy.data.meshes[0])
    conclude()
    assert len(active().data.polygons) > 100


def test_a_mesh_made_for_an_object_that_is_gone_goes_too(loaded):
    bpy.ops.ctmc.reconstruct()
    where = active().matrix_world.translation.copy()
    loaded.ctmc.region = (0, 0, 0, 15, 23, 11)
    conclude = finish(steps_of(loaded, target=active().session_uid))
    bpy.data.meshes.remove(active().data)
    conclude()
    assert [thing.data for thing in meshes_in(loaded)] == list(bpy.data.meshes)
    # A new object has its origin in the middle of its own surface.
    corners = np.array(active().bound_box)
    assert np.abs(corners.min(axis=0) + corners.max(axis=0)).max() < 1e-5
    assert (active().matrix_world.translation - where).length > 0.005


def test_several_labels_give_several_objects_in_line_each_with_its_color(scene, labels_file):
    bpy.ops.ctmc.load(filepath=str(labels_file), spacing=(1, 1, 1))
    assert [(item.value, item.chosen) for item in scene.ctmc.labels] == [(1, True), (2, False), (5, False)]
    scene.ctmc.labels[2].chosen = True
    assert scene.ctmc.use_label
    assert [one.label for one in scene.ctmc.all_settings()] == [1, 5]
    scene.ctmc.labels[2].color = (0.1, 0.9, 0.2)
    bpy.ops.ctmc.reconstruct()
    first, second = meshes_in(scene)
    assert (first.name, second.name) == ("Label 1", "Label 5")
    assert second.data.materials[0].diffuse_color[:3] == pytest.approx((0.1, 0.9, 0.2))
    assert first.location.x - second.location.x == pytest.approx(0.14)  # columns run to the left, 14 mm apart
    scene.ctmc.smoothing_mm = 0.5
    bpy.ops.ctmc.reconstruct()
    assert len(meshes_in(scene)) == 2
    scene.ctmc.alpha = 0.25  # both are selected
    assert [thing.data.shape_keys.key_blocks["alpha"].value for thing in (first, second)] == [0.25, 0.25]
    first.select_set(False)
    scene.ctmc.alpha = 0.75
    assert [thing.data.shape_keys.key_blocks["alpha"].value for thing in (first, second)] == [0.25, 0.75]


def test_a_label_that_has_a_name_gives_it_to_its_object(scene, tmp_path):
    values = np.zeros((20, 24, 28), np.uint8)
    values[4:12, 4:12, 4:12], values[4:12, 4:12, 18:26] = 1, 5
    (tmp_path / "organs.nrrd").write_bytes(
        b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 28 24 20\nencoding: raw\n"
        b"space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n"
        b"Segment0_LabelValue:=1\nSegment0_Name:=spleen\n\n" + values.tobytes()
    )
    bpy.ops.ctmc.load(filepath=str(tmp_path / "organs.nrrd"))
    for item in scene.ctmc.labels:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    assert [thing.name for thing in meshes_in(scene)] == ["spleen", "Label 5"]


def test_ticks_and_the_label_setting_go_together(scene, labels_file):
    bpy.ops.ctmc.load(filepath=str(labels_file), spacing=(1, 1, 1))
    scene.ctmc.label = 2
    assert [item.value for item in scene.ctmc.labels if item.chosen] == [2]
    scene.ctmc.labels[0].chosen = True
    scene.ctmc.labels[1].chosen = False
    assert (scene.ctmc.label, scene.ctmc.use_label) == (1, True)
    scene.ctmc.labels[0].chosen = False
    with pytest.raises(SettingsError, match="no structure is ticked"):
        scene.ctmc.all_settings()
    scene.ctmc.labels[2].chosen = True
    scene.ctmc.threshold = 3.0
    assert not scene.ctmc.use_label
    assert [settings.threshold for settings in scene.ctmc.all_settings()] == [3.0]


def test_simplify_goes_between_levels_without_extracting_again(loaded, ball_file, monkeypatch):
    from ctmc_addon.core.surfaces import make

    bpy.ops.ctmc.reconstruct()
    full = len(active().data.polygons)
    monkeypatch.setattr(make, "result_and_full_steps", None)  # extraction would fail
    for reduction in (0.5, 0.9, 0.25):
        loaded.ctmc.reduction = reduction
        assert bpy.ops.ctmc.simplify() == {"FINISHED"}
        expected = reconstruct(read_volume(ball_file, spacing=(1, 1, 2)), loaded.ctmc.to_settings()).mesh
        seen = evaluated_triangles(active())
        assert (seen.faces == expected.faces).all()
        assert np.abs(seen.vertices - expected.vertices).max() <= 1e-4
        assert read_provenance(active()).full_faces == full
    loaded.ctmc.simplifier = "none"
    bpy.ops.ctmc.simplify()
    assert len(active().data.polygons) == full
    assert active().data.shape_keys.key_blocks["alpha"].value == 1.0


def test_simplify_takes_the_objects_own_mesh_when_the_ct_is_gone(loaded):
    bpy.ops.ctmc.reconstruct()
    full = len(active().data.polygons)
    session.clear()
    volumes._loaded.clear()
    loaded.ctmc.reduction = 0.5
    bpy.ops.ctmc.simplify()
    assert abs(len(active().data.polygons) - full / 2) <= 1
    session.clear()
    with pytest.raises(RuntimeError, match="load its CT again"):
        bpy.ops.ctmc.simplify()


def test_the_slider_of_alpha_moves_the_active_surface_live(loaded, ball_file):
    bpy.ops.ctmc.reconstruct()
    thing, mesh = active(), active().data
    loaded.ctmc.alpha = 0.25
    assert thing.data == mesh
    assert mesh.shape_keys.key_blocks["alpha"].value == 0.25
    assert read_provenance(thing).settings.alpha == 0.25
    settings = ReconstructionSettings(threshold=100.0, alpha=0.25)
    expected = reconstruct(read_volume(ball_file, spacing=(1, 1, 2)), settings).mesh
    assert np.abs(evaluated_triangles(thing).vertices - expected.vertices).max() <= 1e-4


def test_choose_alpha_sets_the_slider_to_what_auto_would_choose(loaded, ball_file):
    bpy.ops.ctmc.reconstruct()
    thing = active()
    loaded.ctmc.min_angle_deg = 12.0
    assert bpy.ops.ctmc.choose_alpha() == {"FINISHED"}
    settings = ReconstructionSettings(threshold=100.0, alpha="auto", min_angle_deg=12.0)
    expected = reconstruct(read_volume(ball_file, spacing=(1, 1, 2)), settings)
    chosen = expected.settings.alpha
    assert 0 < chosen < 1
    assert loaded.ctmc.alpha == np.float32(chosen)
    assert thing.data.shape_keys.key_blocks["alpha"].value == np.float32(chosen)
    assert read_provenance(thing).settings.alpha == chosen
    assert np.abs(evaluated_triangles(thing).vertices - expected.mesh.vertices).max() <= 1e-4


def test_choose_alpha_of_a_simplified_surface_asks_its_full_one_and_refuses_without(loaded):
    loaded.ctmc.min_angle_deg = 12.0
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.choose_alpha()
    chosen = loaded.ctmc.alpha
    loaded.ctmc.alpha = 1.0
    loaded.ctmc.reduction = 0.5
    bpy.ops.ctmc.simplify()
    bpy.ops.ctmc.choose_alpha()
    assert loaded.ctmc.alpha == chosen
    session.clear()
    with pytest.raises(RuntimeError, match="is simplified already and its full surface is not in memory"):
        bpy.ops.ctmc.choose_alpha()


def test_settings_with_an_alpha_of_auto_leave_the_slider_where_it_is(scene):
    scene.ctmc.alpha = 0.5
    scene.ctmc.from_settings(ReconstructionSettings(threshold=7.0, alpha="auto", min_angle_deg=9.0))
    assert (scene.ctmc.alpha, scene.ctmc.min_angle_deg, scene.ctmc.threshold) == (0.5, 9.0, 7.0)


def test_otsu_and_tissues_set_the_threshold(loaded):
    loaded.ctmc.use_threshold = False
    assert bpy.ops.ctmc.auto_threshold() == {"FINISHED"}
    assert loaded.ctmc.use_threshold
    assert loaded.ctmc.threshold == pytest.approx(otsu(volumes.loaded(loaded).volume.values))
    with pytest.raises(RuntimeError, match="Thresholds of tissues are in HU"):
        bpy.ops.ctmc.tissue(tissue="bone")


def test_labels_of_hounsfield_units_are_refused_in_the_panel(scene, tmp_path):
    values = np.full((6, 8, 8), -1000, np.int16)
    values[2:4, 2:6, 2:6] = 40
    import nibabel

    nibabel.save(nibabel.Nifti1Image(values.transpose(2, 1, 0), np.eye(4)), tmp_path / "volume-0.nii")
    bpy.ops.ctmc.load(filepath=str(tmp_path / "volume-0.nii"))
    scene.ctmc.label = 2
    with pytest.raises(RuntimeError, match="give the label volume"):
        bpy.ops.ctmc.reconstruct()
    assert "give the label volume" in session.of(scene).message
    bpy.ops.ctmc.tissue(tissue="skin")
    assert scene.ctmc.to_settings() == ReconstructionSettings(threshold=-300.0)


def test_zoom_and_pan_are_refused_without_a_window(loaded):
    bpy.ops.ctmc.reconstruct()
    for kind in ("zoom", "pan"):
        loaded.ctmc.rotation_kind = kind
        with pytest.raises(RuntimeError, match=f"{kind} can be timed only in a window"):
            bpy.ops.ctmc.rotation_test()
    assert session.of(loaded).rotation is None


def test_simplify_after_apply_leaves_the_surface_in_its_place(loaded):
    bpy.ops.ctmc.reconstruct()
    obj = active()
    full = evaluated_triangles(obj)
    loaded.ctmc.reduction = 0.5
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    for forget in (False, True):  # from the full surface in memory, and from the object's own mesh
        if forget:
            session.of(loaded).full.clear()
        assert bpy.ops.ctmc.simplify() == {"FINISHED"}
        vertices = evaluated_triangles(obj).vertices
        for end in (np.min, np.max):
            assert np.abs(end(vertices, axis=0) - end(full.vertices, axis=0)).max() < 0.5


def test_a_name_in_the_panel_is_the_surfaces(loaded, labels_file):
    loaded.ctmc.volume_name = " case 7 "
    bpy.ops.ctmc.reconstruct()
    assert active().name.startswith("case 7")
    assert "ball" not in active().name
    bpy.ops.ctmc.load(filepath=str(labels_file))
    assert loaded.ctmc.volume_name == ""
