# SPDX-License-Identifier: GPL-3.0-or-later
"""A PET: SUVbw by the vendor-neutral pseudo-code of QIBA, worked out by hand, and what is said where it is unknown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, reconstruct
from ctmc_addon.readers import read_volume, volumes_beside
from ctmc_addon.readers.dicom.labels.classes import object_class

WEIGHT_G, DOSE, HALF_LIFE = 70_000.0, 350e6, 6586.2


def by_hand(decay_seconds):
    """Return g/ml for each Bq/ml as QIBA writes it."""
    return WEIGHT_G / (DOSE * math.pow(2, -decay_seconds / HALF_LIFE))


def check(folder, activity, factor):
    volume = read_volume(folder)
    assert (volume.kind, volume.kind.unit, volume.dtype) == ("SUVbw", "g/ml", np.float32)
    np.testing.assert_allclose(volume.values, activity * factor, rtol=1e-6)
    return volume


def test_values_decay_to_the_start_of_the_scan_with_a_slope_for_each_slice(tmp_path, save_pet):
    activity = save_pet(tmp_path)
    volume = check(tmp_path, activity, by_hand(3600.0))
    note = "the PET's values are SUVbw: Bq/ml by weight and dose, decayed for 60 minutes to the start of the scan"
    assert volume.notes == (note,)


def test_values_corrected_to_the_injection_do_not_decay(tmp_path, save_pet):
    activity = save_pet(tmp_path, {"RadionuclideHalfLife": None}, DecayCorrection="ADMIN", SeriesTime=None)
    check(tmp_path, activity, by_hand(0.0))


@pytest.mark.parametrize(
    ("tracer", "tags", "seconds"),
    [
        ({}, {"SeriesTime": "101500.5", "AcquisitionTime": "101501"}, 4500.5),
        # made after the scan: the earliest acquisition counts
        ({}, {"SeriesTime": "170000", "AcquisitionTime": "101000"}, 4200.0),
        ({}, {"SeriesDate": "20240301", "SeriesTime": "080000", "AcquisitionTime": "101000"}, 4200.0),
        ({}, {"SeriesTime": None, "AcquisitionTime": "101000"}, 4200.0),
        ({}, {"AcquisitionTime": None}, 3600.0),
        # with a day, and over midnight
        ({"RadiopharmaceuticalStartDateTime": "20240229084500"}, {}, 4500.0),
        ({"RadiopharmaceuticalStartDateTime": "20240229084500", "RadiopharmaceuticalStartTime": None}, {}, 4500.0),
        ({"RadiopharmaceuticalStartDateTime": "20240228233000.00"}, {"SeriesTime": "003000"}, 3600.0),
        ({"RadiopharmaceuticalStartTime": "233000"}, {"SeriesTime": "003000"}, 3600.0),
        # days that removing names has moved apart
        ({"RadiopharmaceuticalStartDateTime": "19000101084500"}, {}, 3600.0),
        ({"RadiopharmaceuticalStartDateTime": "20240229104500+0200"}, {"TimezoneOffsetFromUTC": "+0000"}, 4500.0),
        # given after the scan had begun, as for the heart
        ({"RadiopharmaceuticalStartTime": "100200"}, {}, -120.0),
    ],
)
def test_the_scan_and_the_tracer_have_their_times(tmp_path, save_pet, tracer, tags, seconds):
    check(tmp_path, save_pet(tmp_path, tracer, **tags), by_hand(seconds))


def test_the_earliest_of_all_beds_begins_the_scan(tmp_path, save_pet):
    activity = save_pet(tmp_path, SeriesTime="170000", each=lambda at: {"AcquisitionTime": f"10{20 - 5 * at:02}00"})
    check(tmp_path, activity, by_hand(3600.0 + 600.0))


def test_the_start_is_worked_out_from_the_frame_where_the_series_is_later(tmp_path, save_pet):
    duration, reference = 180.0, 700.0
    activity = save_pet(
        tmp_path,
        SeriesTime="170000",
        AcquisitionTime="101000",
        FrameReferenceTime=reference * 1000,
        ActualFrameDuration=int(duration * 1000),
    )
    decay = math.log(2) / HALF_LIFE
    average = math.log(decay * duration / (1 - math.exp(-decay * duration))) / decay
    check(tmp_path, activity, by_hand(4200.0 - reference + average))


def test_ge_keeps_the_start_of_the_scan_in_an_element_of_its_own(tmp_path, save_pet):
    private = [((0x0009, 0x0010), "LO", "GEMS_PETD_01"), ((0x0009, 0x100D), "DT", "20240229100500.00")]
    activity = save_pet(tmp_path, private=private, SeriesTime="170000", AcquisitionTime="101000")
    check(tmp_path, activity, by_hand(3900.0))


CREATOR = ((0x7053, 0x0010), "LO", "Philips PET Private Group")
SUV, ACTIVITY = ((0x7053, 0x1000), "DS", "0.000125"), ((0x7053, 0x1009), "DS", "1.75")


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2.1", "1.2.840.10008.1.2"])
@pytest.mark.parametrize(
    ("private", "factor"),
    [
        ([CREATOR, SUV, ACTIVITY], 0.000125),
        ([CREATOR, SUV], 0.000125),
        ([CREATOR, ((0x7053, 0x1000), "DS", "0"), ACTIVITY], 1.75 * by_hand(3600.0)),
        ([CREATOR, ACTIVITY], 1.75 * by_hand(3600.0)),
    ],
)
def test_philips_counts_have_factors_of_their_own(tmp_path, save_pet, private, factor, syntax):
    counts = save_pet(tmp_path, private=private, Units="CNTS", syntax=syntax)
    check(tmp_path, counts, factor)


@pytest.mark.parametrize("suv_type", [None, "BW"])
def test_values_in_grams_pass_as_they_are(tmp_path, save_pet, suv_type):
    values = save_pet(tmp_path, {"RadionuclideTotalDose": None}, Units="GML", SUVType=suv_type, PatientWeight=None)
    check(tmp_path, values, 1.0)


@pytest.mark.parametrize(
    ("tracer", "tags", "text"),
    [
        ({}, {"PatientWeight": None}, "stay in Bq/ml and are not SUV: PatientWeight is missing"),
        ({}, {"PatientWeight": 0}, "PatientWeight is missing"),
        (
            {"RadionuclideTotalDose": None, "RadionuclideHalfLife": None},
            {"PatientWeight": None},
            "PatientWeight, RadionuclideTotalDose and RadionuclideHalfLife are missing",
        ),
        ({"RadiopharmaceuticalStartTime": None}, {}, "RadiopharmaceuticalStartTime is missing"),
        ({}, {"SeriesTime": None, "AcquisitionTime": None}, "SeriesTime or AcquisitionTime is missing"),
        ({}, {"DecayCorrection": None}, "DecayCorrection is missing"),
        ({}, {"DecayCorrection": "NONE"}, "DecayCorrection is NONE, not START or ADMIN"),
        ({}, {"CorrectedImage": ["DECY"]}, "not corrected for attenuation"),
        ({"RadionuclideTotalDose": 350.0}, {}, "RadionuclideTotalDose is 350 Bq, too little for a scan"),
        ({"RadionuclideHalfLife": 76.0}, {}, "the tracer was given 47 half-lives before the scan"),
        ({}, {"RadiopharmaceuticalInformationSequence": None}, "RadionuclideTotalDose"),
        ({}, {"Units": "CNTS"}, "stay in counts and are not SUV: Philips' factors (7053,1000) and (7053,1009)"),
        ({}, {"Units": "PROPCPS"}, "stay in PROPCPS and are not SUV: Units are PROPCPS"),
        ({}, {"Units": None}, "have no known unit and are not SUV: Units is missing"),
        ({}, {"Units": "GML", "SUVType": "LBM"}, "stay in g/ml and are not SUV: SUVType is LBM, not BW"),
    ],
)
def test_what_is_missing_is_named_and_values_stay_in_their_unit(tmp_path, save_pet, tracer, tags, text):
    values = save_pet(tmp_path, tracer, **tags)
    volume = read_volume(tmp_path)
    assert volume.kind == "gray value"
    np.testing.assert_allclose(volume.values, values, rtol=1e-6)
    assert any(text in note for note in volume.notes), volume.notes


def test_no_note_tells_weight_dose_or_times(tmp_path, save_pet):
    save_pet(tmp_path, {"RadiopharmaceuticalStartTime": "091234"}, PatientWeight=83.25)
    text = " ".join(read_volume(tmp_path).notes)
    for secret in ("83", "350", "0912", "09:12", "2024", "Muster", "4711"):
        assert secret not in text


def test_a_region_has_the_values_of_the_whole(tmp_path, save_pet):
    save_pet(tmp_path)
    whole, part = read_volume(tmp_path), read_volume(tmp_path, region=(1, 1, 0, 5, 3, 1))
    np.testing.assert_array_equal(part.values, whole.values[0:2, 1:4, 1:6])
    assert part.kind == "SUVbw"


def test_few_whole_values_are_uptake_and_not_a_mask(tmp_path, save_pet):
    save_pet(tmp_path, Units="GML", slopes=(1.0, 1.0), each=lambda at: {"PixelPaddingValue": None})
    assert read_volume(tmp_path).kind == "SUVbw"


def test_a_hot_spot_is_a_surface(tmp_path, save_slice, save_pet):
    z, y, x = np.meshgrid(np.arange(20), np.arange(20), np.arange(20), indexing="ij")
    hot = np.sqrt((x - 9.5) ** 2 + (y - 9.5) ** 2 + (z - 9.5) ** 2)
    stored = np.clip(10000 * (10 - hot) / 10, 0, None).astype(np.uint16)  # SUV 4 at 6 mm with a slope of 0.001
    for number in range(20):
        tags = {"Modality": "PT", "Units": "GML", "RescaleSlope": 0.001, "RescaleIntercept": 0}
        save_slice(tmp_path / f"{number}.dcm", stored[number], (0, 0, number), PixelSpacing=[1, 1], **tags)
    mesh = reconstruct(read_volume(tmp_path), ReconstructionSettings(threshold=4.0)).mesh
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 6.0**3, rel=0.02)


def test_a_ct_is_read_though_a_pet_beside_it_has_more_slices(tmp_path, save_stack, save_pet):
    hu = save_stack(tmp_path / "study" / "ct", range(10), FrameOfReferenceUID="1.2.3.99")
    save_pet(tmp_path / "study" / "pet", slopes=(1.5,) * 12, FrameOfReferenceUID="1.2.3.99")
    volume = read_volume(tmp_path / "study")
    assert volume.kind == "HU"
    np.testing.assert_array_equal(volume.values, hu)
    assert any("series 1, which is not a PET, was read" in note for note in volume.notes)
    assert read_volume(tmp_path / "study", series="2").kind == "SUVbw"
    assert volumes_beside(tmp_path / "study") == (tmp_path / "study" / "pet",)
    assert volumes_beside(tmp_path / "study" / "ct") == (tmp_path / "study" / "pet",)


def test_pet_in_the_folder_of_the_ct_is_named_by_its_first_file(tmp_path, save_stack, save_pet, save_slice):
    save_stack(tmp_path, range(4))
    for name, uid in (("ac", "1.2.3.4.91"), ("nac", "1.2.3.4.92")):
        save_pet(tmp_path / name, SeriesInstanceUID=uid)
        for number in range(3):
            (tmp_path / name / f"{number}.dcm").rename(tmp_path / f"{name}{number}.dcm")
        (tmp_path / name).rmdir()
    assert volumes_beside(tmp_path) == (tmp_path / "ac0.dcm", tmp_path / "nac0.dcm")
    assert read_volume(tmp_path / "ac0.dcm").kind == "SUVbw"


def test_a_pet_of_another_frame_of_reference_is_not_beside_the_ct(tmp_path, save_stack, save_pet):
    save_stack(tmp_path / "ct", range(4), FrameOfReferenceUID="1.2.3.99")
    save_pet(tmp_path / "pet", FrameOfReferenceUID="1.2.3.98")
    assert volumes_beside(tmp_path / "ct") == ()


def test_a_pet_is_recognized_by_its_first_bytes(tmp_path, save_pet):
    save_pet(tmp_path)
    assert object_class(tmp_path / "0.dcm") == "PET"
