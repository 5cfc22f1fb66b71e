# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest

from ctmc_addon import readers
from ctmc_addon.core.phantom import foam

pytestmark = pytest.mark.usefixtures("scene")


@pytest.mark.parametrize("suffix", [".npy", ".tif"])
def test_a_foam_is_written_as_it_is_made(ctmc, tmp_path, suffix):
    path = tmp_path / f"foam{suffix}"
    outcome = ctmc("foam", path, "--slices", "19", "--size", "33", "--pore", "12", "--seed", "5")
    assert outcome.code == 0, outcome.errors
    np.testing.assert_array_equal(readers.read_volume(path).values, foam(19, 33, 12, 5).slab(0, 19))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_another_suffix_is_refused(refused, tmp_path):
    assert ".npy" in refused("foam", tmp_path / "foam.raw")
