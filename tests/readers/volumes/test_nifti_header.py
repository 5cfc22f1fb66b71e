# SPDX-License-Identifier: GPL-3.0-or-later
"""The header of NIfTI against nibabel's, whatever its fields say."""

from __future__ import annotations

import logging

import nibabel
import numpy as np
import pytest

from ctmc_addon.readers.volumes.nifti_header import nifti_header

SILENT = logging.Logger("silent")
SILENT.addHandler(logging.NullHandler())
WRONG = (nibabel.spatialimages.HeaderDataError, nibabel.spatialimages.HeaderTypeError, ValueError)


def random_header(chance, kind, order):
    """A header of one file with numbers of every kind: right, unusual and wrong."""
    header = kind(endianness=order)
    header.set_data_shape(tuple(chance.integers(1, 40, chance.integers(3, 6)).tolist()))
    header["datatype"] = chance.choice([2, 4, 8, 16, 64, 256, 512, 768, 1024, 1280, 32, 3])
    header["pixdim"] = chance.choice([0, 1, -1, 0.7, 2.5, -3], 8)
    header["qform_code"], header["sform_code"] = chance.choice([0, 0, 1, 5, 6, -1, 99], 2)
    turn = chance.normal(size=4) * [chance.random() > 0.1, 1, 1, 1]
    turn *= chance.choice([1, 1, 1, 1.2]) / np.linalg.norm(turn)
    header["quatern_b"], header["quatern_c"], header["quatern_d"] = turn[1:]
    for axis in "xyz":
        header[f"qoffset_{axis}"], header[f"srow_{axis}"] = chance.normal(size=()) * 100, chance.normal(size=4)
    header["scl_slope"] = chance.choice([0, 1, np.nan, np.inf, 0.3, -2])
    header["scl_inter"] = chance.choice([0, -1024, 0.1, np.nan])
    header["xyzt_units"] = chance.choice([0, 1, 2, 3, 9, 10, 11])
    header["vox_offset"] = 544
    return header


def nibabels(kind, content):
    header = kind(content, check=False)
    header.check_fix(SILENT, 40)
    slope, intercept = header.get_slope_inter()
    scale = (1.0, 0.0) if slope is None else (slope, intercept)
    unit = header.get_xyzt_units()[0]
    affine = np.array(header.get_best_affine(), float).tolist()
    return header.get_data_shape(), header.get_data_dtype(), header["vox_offset"], scale, unit, affine


def own(content):
    header = nifti_header(content)
    return header.sides, header.dtype, header.start, header.scale, header.unit, header.affine.tolist()


@pytest.mark.parametrize("kind", [nibabel.Nifti1Header, nibabel.Nifti2Header])
@pytest.mark.parametrize("order", "<>")
def test_a_header_says_what_nibabel_reads_in_it(kind, order):
    chance = np.random.default_rng(0)
    refused = 0
    for _ in range(100):
        content = random_header(chance, kind, order).structarr.tobytes()
        try:
            expected = nibabels(kind, content)
        except WRONG:
            refused += 1
            with pytest.raises(ValueError, match=r"supported|intercept|quaternion"):
                own(content)
        else:
            assert own(content) == expected
    assert 20 < refused < 90
