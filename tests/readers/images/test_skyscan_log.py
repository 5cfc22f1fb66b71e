# SPDX-License-Identifier: GPL-3.0-or-later
"""The pixel size in SkyScan's log beside the slices is their spacing."""

from __future__ import annotations

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from ctmc_addon.core import OutputError
from ctmc_addon.core.files.input_files import own_input_files, require_no_input
from ctmc_addon.readers import read_volume

ACQUISITION = (
    "[System]\nScanner=Skyscan1172\n[Acquisition]\nCamera Pixel Size (um)=   9.0\nImage Pixel Size (um)=  26.77\n"
)
RECONSTRUCTION = ACQUISITION + "[Reconstruction]\nPixel Size (um)=13.68221\nSection to Section Step=1\n"


def save(folder, names="bone_rec{:08d}.bmp"):
    for number in range(120, 124):
        path = folder / names.format(number)
        plane = np.full((4, 5), number, np.uint8)
        tifffile.imwrite(path, plane) if path.suffix == ".tif" else iio.imwrite(path, plane)
    return folder


@pytest.mark.parametrize("end", ["bmp", "png", "tif", "jpg", "jp2"])
@pytest.mark.parametrize(
    ("log", "content", "um"),
    [
        ("bone_rec.log", RECONSTRUCTION, 13.68221),
        ("bone_rec.LOG", ACQUISITION, 26.77),
        ("bone.log", ACQUISITION, 26.77),
        ("bone.log", RECONSTRUCTION.replace("\n", "\r\n"), 13.68221),
        ("bone_rec.log", "[Acquisition]\nPixel Size (\u00b5m)=  12,5", 12.5),
    ],
)
def test_the_pixel_size_is_the_spacing(tmp_path, end, log, content, um):
    save(tmp_path, "bone_rec{:08d}." + end)
    (tmp_path / log).write_bytes(content.encode("latin-1"))
    volume = read_volume(tmp_path)
    assert volume.spacing == pytest.approx((um / 1000,) * 3)
    assert f"{log} says that pixels are {um:.6g} um wide: {um / 1000:.6g} mm" in volume.notes
    assert not any("has no spacing" in note for note in volume.notes)


def test_the_log_of_the_reconstruction_comes_before_that_of_the_scan(tmp_path):
    save(tmp_path)
    (tmp_path / "bone.log").write_text(ACQUISITION)
    (tmp_path / "bone_rec.log").write_text(RECONSTRUCTION)
    assert read_volume(tmp_path).spacing == pytest.approx((0.01368221,) * 3)
    given = read_volume(tmp_path, spacing=(1, 2, 3))
    assert given.spacing == (1, 2, 3)


def test_sections_that_were_passed_over_are_further_apart(tmp_path):
    save(tmp_path)
    (tmp_path / "bone_rec.log").write_text(RECONSTRUCTION.replace("Step=1", "Step=3"))
    volume = read_volume(tmp_path)
    assert volume.spacing == pytest.approx((0.01368221, 0.01368221, 0.04104663))
    assert any("slices are 3 pixels apart (Section to Section Step 3)" in note for note in volume.notes)


@pytest.mark.parametrize(
    ("log_step", "file_step", "apart"), [(1, 2, 2), (1, 10, 10), (2, 2, 2), (2, 4, 4), (3, 1, 3), (2, 3, 6)]
)
def test_slices_that_were_taken_out_are_further_apart(tmp_path, log_step, file_step, apart):
    for number in range(0, 5 * file_step, file_step):
        iio.imwrite(tmp_path / f"x_rec{number:08d}.bmp", np.full((4, 5), number, np.uint8))
    step = f"Section to Section Step={log_step}"
    (tmp_path / "x_rec.log").write_text(f"[Reconstruction]\nPixel Size (um)=10\n{step}\n")
    volume = read_volume(tmp_path)
    assert volume.spacing == pytest.approx((0.01, 0.01, 0.01 * apart))
    (note,) = (note for note in volume.notes if "x_rec.log" in note)
    by_files = f"the files are numbered in steps of {file_step}, " if file_step not in (1, log_step) else ""
    assert note.endswith(f"slices are {apart} pixels apart ({by_files}Section to Section Step {log_step})")


@pytest.mark.parametrize(
    ("log", "content"),
    [
        ("other_rec.log", RECONSTRUCTION),
        ("bone_rec_voi.log", RECONSTRUCTION),
        ("bone_rec.log", "Pixel Size (um)=5\n"),
        ("bone_rec.log", "[Reconstruction]\nCamera Pixel Size (um)=5\n"),
        ("bone_rec.log", "\0\xff"),
    ],
)
def test_another_log_says_nothing(tmp_path, log, content):
    save(tmp_path)
    (tmp_path / log).write_text(content, encoding="latin-1")
    volume = read_volume(tmp_path)
    assert volume.spacing == (1, 1, 1)
    assert any("BMP has no spacing" in note for note in volume.notes)
    assert not any(".log" in note for note in volume.notes)


@pytest.mark.parametrize("size", ["0", "-3", "nan", "inf", "wide", ""])
def test_a_pixel_size_that_is_not_a_length_is_named(tmp_path, size):
    save(tmp_path)
    (tmp_path / "bone_rec.log").write_text(f"[Reconstruction]\nPixel Size (um)={size}\n")
    volume = read_volume(tmp_path)
    assert volume.spacing == (1, 1, 1)
    assert f"the pixel size '{size}' in bone_rec.log is not a length and was ignored" in volume.notes


def test_the_log_is_an_input_that_no_output_replaces(tmp_path):
    save(tmp_path)
    (tmp_path / "bone_rec.log").write_text(RECONSTRUCTION)
    with own_input_files():
        read_volume(tmp_path)
        with pytest.raises(OutputError, match=r"bone_rec.log"):
            require_no_input(tmp_path / "bone_rec.log")
