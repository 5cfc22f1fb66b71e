# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles' corners across the borders of bytes, words, rows and slabs."""

import numpy as np
import pytest
from oracles.marching_cubes import canonical, reference_triangles

from ctmc_addon.core import marching_cubes
from ctmc_addon.core.extraction import faces, scan


def noise(shape, seed=0, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, 255, shape).astype(dtype)


@pytest.mark.parametrize("shape", [(2, 2, 2), (2, 3, 63), (3, 2, 64), (2, 2, 65), (4, 3, 129)])
def test_rows_of_every_length_around_a_word_are_right(shape):
    values = noise(shape, seed=5)
    mesh = marching_cubes(values, 100)
    np.testing.assert_allclose(
        canonical(mesh.vertices[mesh.faces]), canonical(reference_triangles(values, 100)), atol=1.5e-3
    )


@pytest.mark.parametrize("topology", ["classic", "trilinear"])
def test_small_maps_and_blocks_give_the_same_triangles(monkeypatch, topology):
    values = noise((9, 8, 70), seed=6)
    expected = marching_cubes(values, 127.5, topology=topology)
    monkeypatch.setattr(faces, "MAP_BYTES", 1)
    monkeypatch.setattr(faces, "VOXELS_AT_ONCE", 13)
    assert marching_cubes(values, 127.5, topology=topology).faces.tobytes() == expected.faces.tobytes()


def test_slabs_of_one_layer_give_the_same_bytes(monkeypatch):
    values = noise((9, 8, 70), seed=7)
    expected = marching_cubes(values, 127.5)
    for name in ("SLAB_SAMPLES", "SLAB_WORDS"):
        monkeypatch.setattr(scan, name, 1)
    mesh = marching_cubes(values, 127.5)
    for name in ("vertices", "faces", "normals"):
        assert getattr(mesh, name).tobytes() == getattr(expected, name).tobytes()
