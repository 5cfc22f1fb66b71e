# SPDX-License-Identifier: GPL-3.0-or-later
"""The fuzzer's second readers agree with whole files, and find one value or one place that differs."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from fuzz.mutations import change_dicom_element, change_tiff_entry, dicom_elements, tiff_entries
from fuzz.peers import disagreement
from fuzz.seeds import SEEDS

from ctmc_addon.readers import read_volume

COMPARED = ["nii", "nii.gz", "mgz", "analyze", "nrrd gzip", "npy", "dicom", "dicom rle", "pages zlib", "imagej times"]
COMPARED += ["pages 1", "pages 2", "pages 4 packbits", "pages 12 lzw", "pages palette 1", "tif"]
COMPARED += ["imagej calibrated"]


@pytest.mark.parametrize("name", COMPARED)
def test_a_second_reader_agrees_and_finds_one_value_that_differs(tmp_path, name):
    path = SEEDS[name](tmp_path)
    volume = read_volume(path)
    assert disagreement(path, volume) == ""
    values = volume.values.copy()
    values[1, 3, 4] ^= 1
    changed = replace(volume, reader=values)
    assert disagreement(path, changed).startswith("values: 1 differ, at (1, 3, 4) ")


@pytest.mark.parametrize("name", ["rtdose", "pet", "zarr 2", "zarr 3"])
def test_a_second_reader_agrees_on_scaled_values_and_on_the_chunks_of_a_store(tmp_path, name):
    if name.startswith("zarr"):
        pytest.importorskip("zarr")
    path = SEEDS[name](tmp_path)
    volume = read_volume(path)
    assert disagreement(path, volume) == ""
    values = volume.values.copy()
    values[1, 3, 4] = values[0].max() - values[1, 3, 4]
    assert disagreement(path, replace(volume, reader=values)).startswith("values: 1 differ, at (1, 3, 4) ")


@pytest.mark.parametrize("name", ["nii", "mgz", "nrrd gzip", "dicom"])
def test_a_second_reader_finds_an_origin_that_differs(tmp_path, name):
    path = SEEDS[name](tmp_path)
    volume = read_volume(path)
    affine = volume.affine + np.eye(4)[:, [3]] * 0
    affine[0, 3] += 0.5
    assert disagreement(path, replace(volume, affine=affine)).startswith("affine: ")


def test_every_tag_of_a_tiff_and_every_element_of_a_dicom_file_is_found(tmp_path):
    content = bytearray(SEEDS["pages 12"](tmp_path).read_bytes())
    assert len(tiff_entries(content)[2]) == 4 * 9
    (tmp_path / "dicom").mkdir()
    slices = SEEDS["dicom"](tmp_path / "dicom")
    content = bytearray((slices / "0.dcm").read_bytes())
    tags = [bytes(content[at : at + 4]) for at, *_ in dicom_elements(content)]
    assert b"\x28\x00\x10\x00" in tags
    assert tags[-1] == b"\xe0\x7f\x10\x00"


def test_a_change_by_field_changes_the_file(tmp_path):
    chance = random.Random(0)
    whole = SEEDS["pages 12"](tmp_path).read_bytes()
    changed = 0
    for _ in range(50):
        content = bytearray(whole)
        change_tiff_entry(chance, content)
        changed += content != whole
    assert changed > 35
    content = bytearray(128) + b"DICM" + b"\x28\x00\x10\x00US\x02\x00\x22\x00"
    before = bytes(content)
    while content == before:
        change_dicom_element(chance, content)
    assert content[:132] == before[:132]
