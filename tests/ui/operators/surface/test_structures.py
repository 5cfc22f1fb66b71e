# SPDX-License-Identifier: GPL-3.0-or-later
"""One CT with structures of labels and thresholds, from several files, made in one press."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
nibabel = pytest.importorskip("nibabel")
from ui.drawing import drawn, meshes_in

from ctmc_addon.blender.surface import read_provenance
from ctmc_addon.core import volume_text
from ctmc_addon.ui.panels import main as panels
from ctmc_addon.ui.panels.results import page as results
from ctmc_addon.ui.panels.surface.structures import surface_volume_text
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import scans, volumes
from ctmc_addon.ui.state.results import measurements, surfaces
from ctmc_addon.ui.state.surface import structures

AFFINE = np.diag([-1.0, -1.0, 2.0, 1.0])


def cube(*low, size=4):
    """A mask (x, y, z) of 24 x 20 x 12 samples with a cube in it."""
    values = np.zeros((24, 20, 12), np.uint8)
    x, y, z = low
    values[x : x + size, y : y + size, z : z + size] = 1
    return values


def save(path, values, affine=AFFINE):
    nibabel.Nifti1Image(values, affine).to_filename(path)
    return path


@pytest.fixture
def patient(scene, tmp_path):
    """A CT with a bone of 400 HU in a body of 40, and masks of two organs that overlap."""
    body = np.full((24, 20, 12), -1000, np.int16)
    body[2:22, 2:18, 1:11] = 40
    body[cube(16, 4, 4) > 0] = 400
    save(tmp_path / "ct.nii.gz", body)
    (tmp_path / "masks").mkdir()
    save(tmp_path / "masks" / "liver.nii.gz", cube(4, 4, 3, size=6))
    save(tmp_path / "masks" / "tumor.nii.gz", cube(5, 5, 4, size=3))
    bpy.ops.ctmc.load(filepath=str(tmp_path / "ct.nii.gz"))
    return tmp_path


def load_labels(path):
    return bpy.ops.ctmc.load_labels(filepath=str(path))


def test_labels_and_a_threshold_are_made_in_one_press_and_each_has_its_volume(scene, patient):
    load_labels(patient / "masks")
    assert [(item.name, item.chosen) for item in scene.ctmc.labels] == [("liver", True), ("tumor", True)]
    scene.ctmc.threshold = 200.0
    bpy.ops.ctmc.add_threshold()
    bone = scene.ctmc.labels[2]
    assert (bone.name, bone.threshold, bone.chosen, scene.ctmc.use_label) == ("Bone", 200.0, True, True)
    scene.ctmc.smoothing = "none"
    bpy.ops.ctmc.reconstruct()
    assert sorted(obj.name for obj in meshes_in(scene)) == ["Bone", "liver", "tumor"]
    assert {read_provenance(obj).fingerprint for obj in meshes_in(scene)} == {scene.ctmc.volume_fingerprint}
    found = {}
    for item in scene.ctmc.labels:
        (obj,) = surfaces.of_structure(scene, item)
        found[item.name] = measurements.of(obj).measures.volume
        assert surface_volume_text(scene, item) == volume_text(found[item.name])
        assert surfaces.unit_of(obj, scene) == "HU"
    # Voxels are 2 mm3; the corners that the surface cuts off are less than a fifth of a small cube.
    for name, voxels in (("liver", 216), ("tumor", 27), ("Bone", 64)):
        assert 0.75 * 2 * voxels < found[name] < 2 * voxels


def test_the_first_labels_show_the_page_that_lists_them(scene, patient):
    pages = []
    for name in ("liver", "tumor"):
        bpy.context.window_manager.ctmc_page = "CT"
        load_labels(patient / "masks" / f"{name}.nii.gz")
        pages.append(bpy.context.window_manager.ctmc_page)
    assert pages == ["SURFACE", "CT"]


def test_a_press_again_updates_every_structure_and_adds_none(scene, patient):
    load_labels(patient / "masks")
    scene.ctmc.threshold = 200.0
    bpy.ops.ctmc.add_threshold()
    bpy.ops.ctmc.reconstruct()
    before = {obj.name for obj in meshes_in(scene)}
    scene.ctmc.alpha = 0.5
    bpy.ops.ctmc.reconstruct()
    assert {obj.name for obj in meshes_in(scene)} == before


def test_files_one_by_one_have_numbers_of_their_own_and_the_voxels_of_their_masks(scene, patient):
    for name in ("liver", "tumor"):
        load_labels(patient / "masks" / f"{name}.nii.gz")
    assert [(item.value, item.name) for item in scene.ctmc.labels] == [(1, "liver"), (2, "tumor")]
    labels = structures.label_volume(scene)
    assert [int((layer.values == value).sum()) for value, layer in enumerate(labels.each_layer, 1)] == [216, 27]
    assert labels.values.shape == volumes.current(scene).values.shape
    load_labels(patient / "masks" / "liver.nii.gz")
    assert len(scene.ctmc.labels) == 2, "the same labels are added once"


@pytest.mark.parametrize("way", ["mirrored", "part"])
def test_labels_in_another_order_or_of_a_part_lie_where_they_belong(scene, patient, way):
    mask, affine = cube(5, 5, 4, size=3), AFFINE.copy()
    if way == "mirrored":
        affine[0] = [1.0, 0.0, 0.0, -23.0]
        save(patient / "m.nii.gz", mask[::-1].copy(), affine)
    else:
        affine[:3, 3] = AFFINE[:3, :3] @ [3, 2, 1]
        save(patient / "m.nii.gz", mask[3:12, 2:12, 1:9].copy(), affine)
    load_labels(patient / "m.nii.gz")
    load_labels(patient / "masks" / "tumor.nii.gz")
    assert len(scene.ctmc.label_sources) == 1, "they are the same voxels"


def test_labels_beside_the_grid_are_refused_with_their_distance(scene, patient):
    moved = AFFINE.copy()
    moved[2, 3] = 0.8
    save(patient / "moved.nii.gz", cube(5, 5, 4), moved)
    with pytest.raises(RuntimeError, match=r"has samples up to 0\.8 mm away from those of the CT; resample"):
        load_labels(patient / "moved.nii.gz")
    save(patient / "coarse.nii.gz", cube(5, 5, 4), AFFINE * 1.5)
    with pytest.raises(RuntimeError, match=r"every 1\.5 x 1\.5 x 3 mm"):
        load_labels(patient / "coarse.nii.gz")
    with pytest.raises(RuntimeError, match=r"holds HU and not labels"):
        load_labels(patient / "ct.nii.gz")
    assert not len(scene.ctmc.labels)


@pytest.mark.parametrize("stored", [np.uint8, np.int16, np.float32])
def test_labels_that_a_file_scales_or_has_as_floats_are_those_that_were_saved(scene, patient, stored):
    values = 6.0 * cube(4, 4, 3, size=6) + 117.0 * cube(16, 4, 4)
    image = nibabel.Nifti1Image(values if stored != np.float32 else values.astype(stored), AFFINE)
    image.set_data_dtype(stored)  # nibabel finds a scale for integers
    nibabel.save(image, patient / "organs.nii.gz")
    load_labels(patient / "organs.nii.gz")
    assert [item.value for item in scene.ctmc.labels] == [6, 117]
    np.testing.assert_array_equal(structures.label_volume(scene).values.T, values)
    bpy.ops.ctmc.reconstruct()
    assert sorted(obj.name for obj in meshes_in(scene)) == ["Label 117", "Label 6"]
    bpy.ops.ctmc.load(filepath=str(patient / "organs.nii.gz"))
    assert [item.value for item in scene.ctmc.labels] == [6, 117]


def test_shares_are_refused_as_labels_with_the_first_of_them(scene, patient):
    save(patient / "shares.nii.gz", (cube(4, 4, 3, size=6) * 0.37).astype(np.float32))
    with pytest.raises(RuntimeError, match=r"shares holds gray values, such as 0\.37, and not labels; load it as a CT"):
        load_labels(patient / "shares.nii.gz")
    assert not len(scene.ctmc.labels)


def test_labels_come_back_with_undo_and_with_the_file(scene, patient, tmp_path):
    load_labels(patient / "masks")
    scene.ctmc.labels[0].color = (0.1, 0.2, 0.3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    volumes.require_loaded(scene).labels.clear()
    volumes._loaded.clear()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "case.blend"))
    scene = bpy.context.scene
    assert [item.name for item in scene.ctmc.labels] == ["liver", "tumor"]
    assert len(structures.missing(scene)) == 1
    bpy.ops.ctmc.load(again=True)
    assert structures.missing(scene) == []
    assert tuple(scene.ctmc.labels[0].color) == pytest.approx((0.1, 0.2, 0.3))
    bpy.ops.ctmc.reconstruct()
    assert sorted(obj.name for obj in meshes_in(scene)) == ["liver", "tumor"]


def test_ticks_go_by_name_from_load_to_load(scene, patient):
    load_labels(patient / "masks")
    bpy.ops.ctmc.tick_structures(which="none")
    scene.ctmc.labels[1].chosen = True
    assert [item.name for item in scene.ctmc.labels if item.chosen] == ["tumor"]
    other = patient / "other"
    other.mkdir()
    for number, name in enumerate(("aorta", "spleen", "tumor")):
        save(other / f"{name}.nii.gz", cube(2 + 6 * number, 4, 4))
    bpy.ops.ctmc.load(directory=str(other))
    assert [item.name for item in scene.ctmc.labels if item.chosen] == ["tumor"]
    assert scene.ctmc.label == 3


def test_all_none_and_invert(scene, patient):
    load_labels(patient / "masks")
    ticks = lambda: [item.chosen for item in scene.ctmc.labels]  # noqa: E731
    bpy.ops.ctmc.tick_structures(which="none")
    assert ticks() == [False, False]
    with pytest.raises(RuntimeError, match=r"No structure is ticked"):
        bpy.ops.ctmc.reconstruct()
    scene.ctmc.labels[0].chosen = True
    bpy.ops.ctmc.tick_structures(which="invert")
    assert ticks() == [False, True]
    bpy.ops.ctmc.tick_structures(which="all")
    assert ticks() == [True, True]


def test_an_eye_hides_a_structure_and_removal_leaves_its_surface(scene, patient):
    load_labels(patient / "masks")
    bpy.ops.ctmc.reconstruct()
    liver = bpy.data.objects["liver"]
    bpy.ops.ctmc.structure_eye(index=0)
    assert (liver.hide_get(), liver.hide_render) == (True, True)
    bpy.ops.ctmc.structure_eye(index=0)
    assert (liver.hide_get(), liver.hide_render) == (False, False)
    for _ in range(2):
        bpy.ops.ctmc.remove_structure()
    assert (len(scene.ctmc.labels), len(scene.ctmc.label_sources)) == (0, 0)
    assert len(meshes_in(scene)) == 2


def test_a_folder_of_masks_beside_the_ct_is_offered(scene, patient):
    assert "ctmc.load_labels Load Its Labels" in drawn(*panels.STEPS).buttons
    load_labels(patient / "masks")
    assert "ctmc.load_labels Load Its Labels" not in drawn(*panels.STEPS).buttons
    assert "Label 1, liver" in drawn(*panels.STEPS).texts


def test_the_command_of_an_added_label_is_of_its_own_file_and_number(scene, patient):
    from ctmc_addon.ui.operators.results.results import command_text

    for name in ("liver", "tumor"):
        load_labels(patient / "masks" / f"{name}.nii.gz")
    scene.ctmc.threshold = 200.0
    bpy.ops.ctmc.add_threshold()
    liver, tumor, bone = command_text(scene).splitlines()
    assert "liver.nii.gz" in liver
    assert "--label 1" in liver
    assert "tumor.nii.gz" in tumor
    assert "--label 1" in tumor
    assert "ct.nii.gz" in bone
    assert "--threshold 200" in bone


def test_a_labels_row_says_its_number_and_name(scene, patient):
    load_labels(patient / "masks")
    bpy.ops.ctmc.reconstruct()
    (tumor,) = surfaces.of_structure(scene, scene.ctmc.labels[1])
    provenance = read_provenance(tumor)
    assert ("Label", "2, tumor") in results.facts_of(provenance, None, "HU", "tumor")
    assert "2, tumor" in drawn(results.CTMC_PT_results).texts


def test_the_table_has_the_hu_inside_labels_that_were_added(scene, patient):
    load_labels(patient / "masks")
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.table()
    rows, _ = session.of(scene).table
    assert {row.name: row.surface.inside[1:] for row in rows} == {"liver": (40.0, 0.0), "tumor": (40.0, 0.0)}


def test_the_ct_of_what_is_active_is_the_panels_with_its_own_structures(scene, patient):
    load_labels(patient / "masks")
    bpy.ops.ctmc.reconstruct()
    first = scene.ctmc.volume_fingerprint
    save(patient / "other.nii.gz", np.where(cube(4, 4, 4) > 0, 700, -1000).astype(np.int16))
    bpy.ops.ctmc.load(filepath=str(patient / "other.nii.gz"))
    second = scene.ctmc.volume_fingerprint
    assert (first != second, len(scene.ctmc.labels), scene.ctmc.use_label) == (True, 0, False)
    scene.ctmc.threshold = 300.0
    bpy.ops.ctmc.reconstruct()
    made = bpy.context.view_layer.objects.active

    def activate(obj):
        bpy.ops.object.select_all(action="DESELECT")
        obj.select_set(True)
        bpy.context.view_layer.objects.active = obj
        bpy.context.view_layer.update()

    activate(bpy.data.objects["liver"])
    assert scene.ctmc.volume_fingerprint == first
    assert [(item.name, item.chosen) for item in scene.ctmc.labels] == [("liver", True), ("tumor", True)]
    assert (scene.ctmc.use_label, volumes.current(scene).name) == (True, "ct")
    assert len(structures.label_volume(scene).label_names) == 2
    activate(made)
    assert scene.ctmc.volume_fingerprint == second
    assert (scene.ctmc.use_label, scene.ctmc.use_threshold, scene.ctmc.threshold) == (False, True, 300.0)
    activate(next(obj for obj in scene.objects if obj.type == "EMPTY" and obj.name == "ct"))
    assert scene.ctmc.volume_fingerprint == first


def test_a_surface_that_is_no_longer_selected_does_not_bring_its_ct_back(scene, patient):
    load_labels(patient / "masks")
    bpy.ops.ctmc.reconstruct()
    save(patient / "other.nii.gz", np.where(cube(4, 4, 4) > 0, 700, -1000).astype(np.int16))
    bpy.ops.ctmc.load(filepath=str(patient / "other.nii.gz"))
    second = scene.ctmc.volume_fingerprint
    assert bpy.context.view_layer.objects.active.select_get()
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.update()
    assert scene.ctmc.volume_fingerprint == second


def test_a_ct_that_is_not_in_memory_is_the_panels_and_can_be_loaded_again(scene, patient):
    save(patient / "other.nii.gz", np.where(cube(4, 4, 4) > 0, 700, -1000).astype(np.int16))
    first = scene.ctmc.volume_fingerprint
    bpy.ops.ctmc.load(filepath=str(patient / "other.nii.gz"))
    del volumes._loaded[first]
    assert scans.activate(scene, first)
    assert volumes.missing(scene)
    bpy.ops.ctmc.load(again=True)
    assert volumes.current(scene).name == "ct"
    assert [scan.volume_fingerprint for scan in scene.ctmc_scans] != [first]


def test_a_dicom_folder_with_a_structure_set_offers_it_and_both_go_together(scene, real):
    pytest.importorskip("pydicom")
    folder = real("rtstruct")
    bpy.ops.ctmc.load(directory=str(folder))
    assert volumes.current(scene).kind == "HU"
    assert "ctmc.load_labels rt.dcm" in drawn(*panels.STEPS).buttons
    load_labels(folder / "rt.dcm")
    assert len(scene.ctmc.labels)
    assert "ctmc.load_labels rt.dcm" not in drawn(*panels.STEPS).buttons
