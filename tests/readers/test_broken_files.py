# SPDX-License-Identifier: GPL-3.0-or-later
"""A drawer of broken files: whatever is cut or changed in them, one sentence comes out, never a traceback."""

from __future__ import annotations

import random
import warnings

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile
from PIL import Image

from ctmc_addon.core import CtmcError, Volume
from ctmc_addon.readers import VolumeSource, open_volume, read_volume

SHAPE = (4, 20, 24)


@pytest.fixture
def whole(request, tmp_path, save_slice, save_frames):
    """A readable path of a format, and the one file in it that is to be broken."""
    values = np.random.default_rng(0).integers(0, 250, SHAPE).astype(np.int16)
    kind = request.param
    if kind.startswith("dicom"):
        options = {
            "dicom": {},
            "dicom implicit": {"syntax": "1.2.840.10008.1.2"},
            "dicom deflated": {"syntax": "1.2.840.10008.1.2.1.99"},
            "dicom rle": {"compress": "1.2.840.10008.1.2.5"},
        }[kind]
        for number, plane in enumerate(values):
            save_slice(tmp_path / f"{number}.dcm", plane.astype(np.uint16), (0, 0, number), **options)
        return tmp_path, tmp_path / "1.dcm"
    if kind in ("png", "jpg", "bmp", "tif"):
        for number, plane in enumerate(values.astype(np.uint8)):
            Image.fromarray(plane).save(tmp_path / f"{number}.{kind}")
        return tmp_path, tmp_path / f"1.{kind}"
    path = tmp_path / f"whole.{kind}"
    if kind == "enhanced.dcm":
        save_frames(path, values.astype(np.uint16), [(0, 0, z) for z in range(len(values))])
    elif kind in ("nii", "nii.gz"):
        nibabel.save(nibabel.Nifti1Image(values.T, np.eye(4)), path)
    elif kind == "nrrd":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pynrrd's own, with the newest NumPy
            nrrd.write(
                str(path), values.T, {"space": "LPS", "space directions": np.eye(3), "space origin": np.zeros(3)}
            )
    elif kind == "npy":
        np.save(path, values)
    else:
        tifffile.imwrite(path, values, compression="zlib", photometric="minisblack")
    return path, path


KINDS = ["dicom", "dicom implicit", "dicom deflated", "dicom rle", "enhanced.dcm"]
KINDS += ["png", "jpg", "bmp", "tif", "nii", "nii.gz", "nrrd", "npy", "pages.tif"]


@pytest.mark.parametrize("whole", KINDS, indirect=True)
def test_a_broken_file_gives_one_sentence_or_a_volume(whole, request):
    path, file = whole
    content = file.read_bytes()
    chance = random.Random(request.node.name)
    for attempt in range(40):
        broken = bytearray(content)
        if attempt % 3 == 0:
            broken = broken[: chance.randrange(len(broken))]
        for _ in range(attempt % 3 * 2):
            broken[chance.randrange(min(len(broken), 600))] = chance.randrange(256)
        file.write_bytes(broken)
        for look, result in ((read_volume, Volume), (open_volume, VolumeSource)):
            sentence = ""
            try:
                assert isinstance(look(path), result)
            except CtmcError as error:
                sentence = str(error)
            assert "\n" not in sentence
            assert len(sentence) < 420
