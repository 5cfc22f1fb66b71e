# SPDX-License-Identifier: GPL-3.0-or-later
"""A patient's folder in the sidebar: its CT and not a mask, its series, its labels, and a damaged slice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import SHARED

bpy = pytest.importorskip("bpy")
pytest.importorskip("pydicom")

from readers.conftest import save_slice as save_slice, save_stack as save_stack
from ui.drawing import Layout

from ctmc_addon.ui.operators.ct.series import facts_of, items
from ctmc_addon.ui.panels.ct.scans import draw_without_damaged
from ctmc_addon.ui.panels.ct.series import draw_series
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.surface import structures


@pytest.fixture
def patient(scene, tmp_path, save_slice, save_stack):
    """A CT of six slices in a folder beside those of two masks."""
    for number, organ in enumerate(("artery", "liver"), 1):
        stored = np.zeros((6, 5, 7), np.uint8)
        stored[1:5, 1:4, number : number + 3] = 255
        for z, plane in enumerate(stored):
            place = {"SeriesInstanceUID": f"1.7.{number}", "InstanceNumber": z + 1, "RescaleIntercept": 0}
            save_slice(tmp_path / "MASKS_DICOM" / organ / f"image_{z}", plane, (-10, -20, 2 * z), **place)
    save_stack(tmp_path / "PATIENT_DICOM", range(0, 12, 2), SeriesInstanceUID="1.7.9")
    return tmp_path


def buttons_of(draw):
    """The buttons that a function of the sidebar draws."""
    layout = Layout()
    draw(layout, bpy.context)
    return layout.buttons


def test_the_ct_is_loaded_and_its_masks_are_offered_as_labels(scene, patient):
    bpy.ops.ctmc.load(filepath=str(patient))
    ct = volumes.loaded(scene)
    assert (ct.volume.kind, ct.series_number) == ("HU", 3)
    assert ct.labels_beside == (patient / "MASKS_DICOM",)
    assert buttons_of(draw_series) == ["ctmc.load PATIENT_DICOM"]
    bpy.ops.ctmc.load_labels(filepath=str(ct.labels_beside[0]))
    assert [item.name for item in scene.ctmc.labels] == ["artery", "liver"]
    assert len(structures.label_volume(scene).label_names) == 2


def test_the_dropdown_names_the_series_by_folder_and_reads_another(scene, patient):
    bpy.ops.ctmc.load(filepath=str(patient))
    listed = items(None, bpy.context)
    assert [(number, name) for number, name, _ in listed] == [
        ("1", "MASKS_DICOM/artery"),
        ("2", "MASKS_DICOM/liver"),
        ("3", "PATIENT_DICOM"),
    ]
    assert listed[2][2] == "2 mm apart, 6 slices, 7 x 5, in PATIENT_DICOM"
    ct = volumes.loaded(scene).series[2]
    assert facts_of(replace(ct, dicom_number="4")).startswith("No. 4, 2 mm apart")
    assert facts_of(replace(ct, kernel="B70f")).startswith("Kernel B70f, 2 mm apart")
    assert items(None, bpy.context) is listed  # Blender keeps no reference
    bpy.ops.ctmc.load(listed="2")
    assert volumes.loaded(scene).series_number == 2
    assert scene.ctmc.series == "2"
    bpy.ops.ctmc.load(again=True)
    assert volumes.loaded(scene).series_number == 2


def test_a_damaged_slice_is_left_out_by_a_button_and_noted(scene, patient):
    file = patient / "PATIENT_DICOM" / "2.dcm"
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(RuntimeError, match=r"2\.dcm is a truncated or damaged DICOM file"):
        bpy.ops.ctmc.load(filepath=str(patient / "PATIENT_DICOM"), remove_table=True)
    path, reading = session.of(scene).refused
    assert (path, reading.remove_table) == (str(patient / "PATIENT_DICOM"), True)
    assert buttons_of(draw_without_damaged) == ["ctmc.load Load Without Damaged Slices"]
    bpy.ops.ctmc.load(filepath=path, skip_damaged=True)
    assert buttons_of(draw_without_damaged) == []
    note = "slice 3 of 6, by file name, is damaged and was left out; the gap was filled by linear interpolation"
    assert volumes.current(scene).notes[0] == note
    assert volumes.current(scene).size == (7, 5, 6)
    assert scene.ctmc.skip_damaged
    volumes.release(scene.ctmc.volume_fingerprint)
    bpy.ops.ctmc.load(again=True)
    assert volumes.current(scene).notes[0] == note


def test_any_other_refusal_offers_no_such_button(scene, tmp_path):
    with pytest.raises(RuntimeError, match="nowhere"):
        bpy.ops.ctmc.load(filepath=str(tmp_path / "nowhere"))
    assert buttons_of(draw_without_damaged) == []


@pytest.mark.skipif(not (SHARED / "ibsi_lung_tumor").is_dir(), reason="no real CT on this machine")
@pytest.mark.parametrize("opened", ["image", "image/DCM_IMG_00044.dcm"])
def test_a_real_structure_set_in_a_sibling_folder_is_loaded(scene, opened):
    folder = SHARED / "ibsi_lung_tumor" / "dicom"
    bpy.ops.ctmc.load(filepath=str(folder / opened))
    ct = volumes.loaded(scene)
    assert (ct.volume.name, ct.labels_beside) == ("ibsi_lung_tumor", (folder / "mask" / "DCM_RS_00060.dcm",))
    assert "ibsi_lung_tumor" in bpy.data.collections
    assert "image" not in bpy.data.collections
    bpy.ops.ctmc.load_labels(filepath=str(ct.labels_beside[0]))
    assert [item.name for item in scene.ctmc.labels] == ["GTV-1"]
