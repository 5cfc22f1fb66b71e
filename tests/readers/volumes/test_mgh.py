# SPDX-License-Identifier: GPL-3.0-or-later
"""MGH and MGZ as nibabel writes them; the affine of a header without directions is FreeSurfer's."""

from __future__ import annotations

import gzip

import nibabel
import numpy as np
import pytest

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

AFFINE = np.array([[-0.9, 0.1, 0, 3], [0.1, 0, 1.1, -5], [0, -1.2, 0.1, 7], [0, 0, 0, 1]])


def saved(path, dtype="i2", shape=(5, 6, 7)):
    values = np.random.default_rng(0).integers(0, 100, shape).astype(dtype)  # (columns, rows, slices)
    nibabel.save(nibabel.MGHImage(values, AFFINE), path)
    return values


@pytest.mark.parametrize("name", ["ct.mgh", "ct.mgz"])
@pytest.mark.parametrize("dtype", ["u1", "i2", "i4", "f4"])
def test_values_and_place_are_nibabels(tmp_path, name, dtype):
    values = saved(tmp_path / name, dtype)
    volume = read_volume(tmp_path / name)
    np.testing.assert_array_equal(volume.values.T, values)
    np.testing.assert_allclose(volume.affine, AFFINE, atol=1e-6)
    # nibabel rounds its affine to float32.
    np.testing.assert_array_equal(
        volume.affine.astype(np.float32), nibabel.MGHImage(values, AFFINE).header.get_affine()
    )
    assert (volume.values.dtype, volume.name, volume.notes) == (np.dtype(dtype), "ct", ())


@pytest.mark.parametrize("name", ["ct.mgh", "ct.mgz"])
def test_each_frame_is_a_time(tmp_path, name):
    values = saved(tmp_path / name, shape=(5, 6, 7, 3))
    assert open_volume(tmp_path / name).series[0].times == 3
    for time in (1, 2, 3):
        np.testing.assert_array_equal(read_volume(tmp_path / name, time=time).values.T, values[..., time - 1])


def test_a_file_without_directions_is_taken_as_freesurfer_does(tmp_path):
    saved(tmp_path / "ct.mgh")
    content = bytearray((tmp_path / "ct.mgh").read_bytes())
    content[28:30] = b"\0\0"  # goodRASFlag
    (tmp_path / "ct.mgh").write_bytes(content)
    volume = read_volume(tmp_path / "ct.mgh")
    np.testing.assert_array_equal(volume.affine, [[-1, 0, 0, 2.5], [0, 0, 1, -3.5], [0, -1, 0, 3], [0, 0, 0, 1]])
    assert "columns towards the patient's left" in volume.notes[0]


def number(at, value):
    """A header with another whole number at a byte."""

    def change(content):
        content[at : at + 4] = int(value).to_bytes(4, "big", signed=True)
        return content

    return change


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (number(0, 7), "version 7"),
        (number(4, 0), "sizes"),
        (number(8, -6), "sizes"),
        (number(12, 1), "one slice"),
        (number(12, 2**31 - 1), "memory|truncated"),
        (number(16, 2**31 - 1), "truncated"),
        (number(16, 127), "truncated"),
        (number(16, 2), "truncated"),
        (number(20, 2), "not a readable MGH"),
        (lambda content: content[:200], "not a readable MGH"),
        (lambda content: content[:-60], "truncated"),
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_headers_that_make_no_volume_are_refused(tmp_path, change, sentence, packed):
    saved(tmp_path / "ct.mgh")
    path = tmp_path / ("x.mgz" if packed else "x.mgh")
    content = bytes(change(bytearray((tmp_path / "ct.mgh").read_bytes())))
    path.write_bytes(gzip.compress(content) if packed else content)
    with pytest.raises(CtmcError, match=sentence) as caught:
        read_volume(path)
    assert "\n" not in str(caught.value)
