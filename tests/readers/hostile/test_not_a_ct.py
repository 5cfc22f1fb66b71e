# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that hold something else are called what they are."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume


@pytest.mark.parametrize(
    ("sop_class", "modality", "words"),
    [
        ("1.2.840.10008.5.1.4.1.1.104.1", "DOC", "Encapsulated PDF"),
        ("1.2.840.10008.5.1.4.1.1.88.11", "SR", "Basic Text SR"),
        ("1.2.840.10008.5.1.4.1.1.11.1", "PR", "Grayscale Softcopy Presentation State"),
        ("1.2.840.10008.5.1.4.1.1.481.2", "RTDOSE", "RT Dose"),
        ("1.2.840.10008.5.1.4.1.1.481.5", "RTPLAN", "RT Plan"),
        ("1.2.3.4.5.6.7.8", "OT", "private kind"),
    ],
)
def test_dicom_without_an_image_is_named(tmp_path, save_slice, sop_class, modality, words):
    import pydicom

    save_slice(tmp_path / "x.dcm", np.zeros((5, 7), np.uint16), SOPClassUID=sop_class, Modality=modality)
    dataset = pydicom.dcmread(tmp_path / "x.dcm")
    for keyword in ("PixelData", "Rows", "Columns"):
        delattr(dataset, keyword)
    dataset.file_meta.MediaStorageSOPClassUID = sop_class
    dataset.save_as(tmp_path / "x.dcm")
    with pytest.raises(ReadError) as caught:
        read_volume(tmp_path / "x.dcm")
    assert "x.dcm" in str(caught.value)
    assert words in str(caught.value)


@pytest.mark.parametrize("content", [b"text", b"", bytes(1000)])
def test_gzip_of_something_else_is_not_taken_for_nifti(tmp_path, content):
    (tmp_path / "x.gz").write_bytes(gzip.compress(content))
    (tmp_path / "y.gz").write_bytes(gzip.compress(content)[:-9])
    for name in ("x.gz", "y.gz"):
        with pytest.raises(ReadError, match=r"unknown suffix '\.gz'"):
            read_volume(tmp_path / name)
