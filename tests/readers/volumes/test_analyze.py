# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs of `.hdr` and `.img` as nibabel writes them: Analyze of three kinds, and NIfTI."""

from __future__ import annotations

import gzip

import nibabel
import numpy as np
import pytest

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

PLAIN = np.diag([-2.0, 3, 4, 1])
OBLIQUE = np.array([[-0.9, 0.1, 0, 3], [0.1, 0, 1.1, -5], [0, -1.2, 0.1, 7], [0, 0, 0, 1]])
KINDS = ["AnalyzeImage", "Spm99AnalyzeImage", "Spm2AnalyzeImage", "Nifti1Pair", "Nifti2Pair"]


def saved(folder, kind, dtype=np.int16, shape=(5, 6, 7), order="<"):
    """What nibabel reads of a pair that it wrote."""
    values = np.random.default_rng(0).integers(0, 100, shape).astype(dtype)
    kind = getattr(nibabel, kind)
    header = kind.header_class(endianness=order)
    header.set_data_dtype(dtype)
    image = kind(values, OBLIQUE if "Nifti" in kind.__name__ else PLAIN, header)
    if "Spm" in kind.__name__:  # SPM's own way would write a .mat, by SciPy
        image.file_map = kind.filespec_to_file_map(str(folder / "ct.img"))
        nibabel.AnalyzeImage.to_file_map(image)
    else:
        nibabel.save(image, folder / "ct.img")
    return values, nibabel.load(folder / "ct.img").affine


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int32, np.float32])
@pytest.mark.parametrize("order", "<>")
def test_values_and_place_are_nibabels(tmp_path, kind, dtype, order):
    values, affine = saved(tmp_path, kind, dtype, order=order)
    for name in ("ct.hdr", "ct.img"):
        volume = read_volume(tmp_path / name)
        np.testing.assert_array_equal(volume.values.T, values)
        np.testing.assert_array_equal(volume.affine, affine)
        assert volume.name == "ct"
        assert ("no orientation" in " ".join(volume.notes)) == ("Nifti" not in kind)


def test_analyze_without_an_origin_has_the_center_of_the_volume_at_0(tmp_path):
    saved(tmp_path, "AnalyzeImage")
    expected = [[-2, 0, 0, 4], [0, 3, 0, -7.5], [0, 0, 4, -12], [0, 0, 0, 1]]
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.hdr").affine, expected)


@pytest.mark.parametrize("kind", KINDS)
def test_each_time_is_read(tmp_path, kind):
    values, _ = saved(tmp_path, kind, shape=(5, 6, 7, 3))
    assert open_volume(tmp_path / "ct.hdr").series[0].times == 3
    for time in (1, 2, 3):
        np.testing.assert_array_equal(read_volume(tmp_path / "ct.hdr", time=time).values.T, values[..., time - 1])


def test_packed_values_are_read(tmp_path):
    values, _ = saved(tmp_path, "Spm2AnalyzeImage")
    (tmp_path / "ct.img.gz").write_bytes(gzip.compress((tmp_path / "ct.img").read_bytes()))
    (tmp_path / "ct.img").unlink()
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.hdr").values.T, values)


def test_half_a_pair_is_refused(tmp_path):
    saved(tmp_path, "AnalyzeImage")
    (tmp_path / "ct.img").rename(tmp_path / "other.img")
    with pytest.raises(CtmcError, match=r"belongs to a pair of files, and its \.img is missing"):
        read_volume(tmp_path / "ct.hdr")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cut", [100, 347])
def test_a_header_cut_off_is_refused(tmp_path, kind, cut):
    saved(tmp_path, kind)
    (tmp_path / "ct.hdr").write_bytes((tmp_path / "ct.hdr").read_bytes()[:cut])
    with pytest.raises(CtmcError, match=r"ct\.hdr is not a readable") as caught:
        read_volume(tmp_path / "ct.hdr")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_values_cut_off_are_refused(tmp_path, kind):
    saved(tmp_path, kind)
    (tmp_path / "ct.img").write_bytes((tmp_path / "ct.img").read_bytes()[:-1])
    with pytest.raises(CtmcError, match=r"ct\.img is truncated"):
        read_volume(tmp_path / "ct.hdr")
