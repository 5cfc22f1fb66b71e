# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume read slab by slab has the values, the type and the place of the volume in memory."""

import numpy as np
import pytest
from volumes import FileReader, in_file

from ctmc_addon.core import CtmcError, Volume, finish
from ctmc_addon.readers import open_volume

WORDS = ("affine", "notes", "name", "kind", "label_names", "label_colors")


@pytest.mark.parametrize("dtype", ["u1", "<i2", ">i2", ">f4", "bool"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_slabs_are_the_slices_of_the_volume(dtype, order):
    rng = np.random.default_rng(1)
    values = np.asarray(rng.integers(0, 100, (7, 5, 6)), dtype, order=order)
    volume = Volume(values, np.diag([-1.0, 2.0, 3.0, 1.0]), ("a note",), "name", "label", {1: "bone"}, {1: (1, 2, 3)})
    slabs = Volume(FileReader(values), *(getattr(volume, name) for name in WORDS))
    joined = np.concatenate([slabs.slab(low, min(7, low + 3)) for low in range(0, 7, 3)])
    assert np.array_equal(joined, values)
    assert joined.dtype.isnative
    assert joined.dtype == slabs.dtype == values.dtype.newbyteorder("=")
    assert slabs.slab(2, 5).flags.c_contiguous
    assert np.shares_memory(volume.slab(2, 5), values) == values.dtype.isnative
    assert np.array_equal(volume.slab(2, 5), values[2:5])
    assert slabs.shape == values.shape
    assert slabs.size == volume.size
    assert slabs.nbytes == values.nbytes
    for what in (*WORDS[1:], "spacing", "orientation"):
        assert getattr(slabs, what) == getattr(volume, what)


def test_a_crop_of_a_crop_has_the_values_and_the_place_of_that_of_the_volume():
    rng = np.random.default_rng(2)
    affine = np.eye(4)
    affine[:3, :3] = rng.normal(size=(3, 3))
    volume = Volume(rng.normal(size=(9, 10, 11)), affine)
    expected = volume.cropped((1, 2, 3), (9, 9, 9)).cropped((1, 0, 2), (5, 6, 5))
    slabs = in_file(volume).cropped((1, 2, 3), (9, 9, 9)).cropped((1, 0, 2), (5, 6, 5))
    assert np.array_equal(slabs.slab(0, 3), expected.values)
    assert np.array_equal(
        slabs.samples(range(0, 3, 2), range(1, 6, 2), range(0, 4, 3)), expected.values[::2, 1::2, ::3]
    )
    assert np.array_equal(slabs.affine, expected.affine)


def test_a_file_that_is_gone_is_a_sentence(tmp_path):
    np.save(tmp_path / "ct.npy", np.zeros((4, 5, 6), np.uint8))
    slabs = finish(open_volume(tmp_path / "ct.npy").slabs_steps())
    (tmp_path / "ct.npy").unlink()
    for fetch in (lambda: slabs.slab(0, 2), lambda: finish(slabs.in_memory_steps((2, 2, 2)))):
        with pytest.raises(CtmcError, match=r"ct can no longer be read .*; load it from where it is now"):
            fetch()
