# SPDX-License-Identifier: GPL-3.0-or-later
"""The order of vertices and triangles is the one the module promises, however a surface is cut into slabs."""

import numpy as np
import pytest

from ctmc_addon.core import marching_cubes
from ctmc_addon.core.extraction import grid, scan

SHAPE = (11, 9, 70)


def noise(seed):
    return np.random.default_rng(seed).integers(0, 255, SHAPE).astype(np.uint8)


def promised(values, threshold, unit):
    """The vertices at alpha 0, edge by edge: unit by unit, its lowest layer's along x and y before the others."""
    inside = values >= threshold
    lists = {}
    for z, y, x in np.ndindex(*SHAPE):
        for axis, step in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0))):
            end = (z + step[0], y + step[1], x + step[2])
            if all(at < side for at, side in zip(end, SHAPE, strict=True)) and inside[z, y, x] != inside[end]:
                lowest = z % unit == 0 and axis < 2
                middle = (x + step[2] / 2, y + step[1] / 2, z + step[0] / 2)
                lists.setdefault((z // unit, not lowest, axis), []).append(middle)
    return np.array([point for key in sorted(lists) for point in lists[key]], np.float32)


@pytest.mark.parametrize("unit", [1, 3, 4, 100])
@pytest.mark.parametrize("slab_mixed", [1, 24, 1 << 13])
def test_vertices_stand_in_the_promised_order_whatever_the_slabs(monkeypatch, unit, slab_mixed):
    monkeypatch.setattr(grid, "UNIT_SAMPLES", unit * SHAPE[1] * SHAPE[2])
    monkeypatch.setattr(scan, "SLAB_MIXED", slab_mixed)
    mesh = marching_cubes(noise(1), 128, alpha=0, normals=False)
    np.testing.assert_array_equal(mesh.vertices, promised(noise(1), 128, unit))
    units = np.floor(mesh.vertices[mesh.faces][:, :, 2].min(axis=1) / unit)
    assert (np.diff(units) >= 0).all()


@pytest.mark.parametrize("topology", ["classic", "trilinear"])
@pytest.mark.parametrize("unit", [1, 3, 100])
@pytest.mark.parametrize("threads", [1, 3])
def test_no_byte_hangs_on_the_slabs(monkeypatch, unit, topology, threads):
    monkeypatch.setattr(grid, "UNIT_SAMPLES", unit * SHAPE[1] * SHAPE[2])
    expected = marching_cubes(noise(2), 100, close_border=True, topology=topology, threads=1)
    for slab_mixed in (1, 7, 60):
        monkeypatch.setattr(scan, "SLAB_MIXED", slab_mixed)
        mesh = marching_cubes(noise(2), 100, close_border=True, topology=topology, threads=threads)
        for name in ("vertices", "faces", "normals"):
            assert getattr(mesh, name).tobytes() == getattr(expected, name).tobytes()
