# SPDX-License-Identifier: GPL-3.0-or-later
"""A foam is the same everywhere, and any part of it is what the whole has there."""

import hashlib

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, SettingsError, Volume, marching_cubes, reconstruct
from ctmc_addon.core.phantom import FOAM_THRESHOLD, foam


def test_a_foam_has_these_bytes_on_every_machine():
    values = foam(64, 96, pore=24, seed=3).slab(0, 64)
    assert (values.shape, values.dtype) == ((64, 96, 96), np.uint8)
    assert hashlib.sha256(values).hexdigest()[:16] == "02f406beaee039d5"
    assert foam(64, 96, pore=24, seed=4).slab(0, 1).tobytes() != values[:1].tobytes()


def test_any_part_is_that_of_the_whole():
    volume = foam(40, 50, pore=16)
    part = volume.samples(range(3, 40, 5), range(7, 50, 2), range(1, 49))
    assert part.tobytes() == volume.slab(0, 40)[3:40:5, 7:50:2, 1:49].tobytes()


def test_solid_and_pores_are_connected_and_noise_makes_no_islands():
    values = foam(128, 128, pore=64).slab(0, 128)
    mesh = marching_cubes(values, FOAM_THRESHOLD, close_border=True, normals=False)
    assert mesh.closed
    assert mesh.components <= 4  # corners of the box cut off walls
    assert 0.4 < (values >= FOAM_THRESHOLD).mean() < 0.6


@pytest.mark.parametrize(("slices", "size", "pore"), [(1, 9, 9), (9, 9, 3), (2**14, 2**14, 9)])
def test_a_foam_that_cannot_be_is_refused(slices, size, pore):
    with pytest.raises(SettingsError, match=r"foam|pores"):
        foam(slices, size, pore)


@pytest.mark.once
@pytest.mark.parametrize("extra", [{}, {"stride": (3, 3, 3), "normals": "mesh"}])
def test_samples_past_two_to_the_31_are_counted_right(extra):
    # 2.4e9 voxels, of which the surface of a small region far behind is made and compared.
    volume = foam(66, 6000, pore=100)
    assert np.prod(volume.shape) > 2**31
    region = (5900, 5800, 0, 5999, 5999, 65)
    settings = ReconstructionSettings(threshold=FOAM_THRESHOLD, region=region, **extra)
    mesh = reconstruct(volume, settings).mesh
    low, high = (5900, 5800, 0), (6000, 6000, 66)
    part = volume.cropped(low, high)
    values = Volume(part.slab(0, 66), part.affine)
    expected = reconstruct(values, ReconstructionSettings(threshold=FOAM_THRESHOLD, **extra)).mesh
    np.testing.assert_allclose(mesh.vertices, expected.vertices, atol=1e-4)
    assert mesh.faces.tobytes() == expected.faces.tobytes()
