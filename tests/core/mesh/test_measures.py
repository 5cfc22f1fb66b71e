# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures against closed forms, whatever the size of a block."""

import numpy as np
import pytest

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.mesh import measures, measures_steps


@pytest.fixture(params=[1 << 18, 50])
def block(request, monkeypatch):
    """Faces in a step: all of them, and few."""
    monkeypatch.setattr(measures, "FACES_PER_STEP", request.param)


@pytest.mark.parametrize("close", [True, False])
def test_a_box_of_voxels_has_its_closed_form_measures(block, close):
    values = np.zeros((9, 10, 11), np.uint8)
    values[: 9 if not close else 6, 2:7, 3:8] = 1
    mesh = marching_cubes(values, 0.5, alpha=0, close_border=close)
    found = finish(measures_steps(mesh.vertices, mesh.faces))
    assert (found.faces, found.components, found.closed) == (len(mesh.faces), 1, close)
    assert found.euler == (2 if close else 0)
    # At the midpoints every edge loses a prism of half a square of 0.5 x 0.5, every corner 5/6 of a cube of 0.5.
    chamfer = np.sqrt(0.5)
    if close:
        assert found.enclosed_volume == found.volume == pytest.approx(6 * 5 * 5 - 4 * (5 + 4 + 4) / 8 - 8 * 5 / 48)
    else:
        assert found.enclosed_volume is None
        assert found.area == pytest.approx(8 * (4 * 4 + 4 * chamfer))


def test_a_mesh_with_one_triangle_turned_over_is_not_closed(block):
    mesh = marching_cubes(np.pad(np.ones((2, 2, 2), np.uint8), 2), 0.5)
    faces = mesh.faces.copy()
    faces[0] = faces[0, ::-1]
    assert finish(measures_steps(mesh.vertices, mesh.faces)).closed
    assert not finish(measures_steps(mesh.vertices, faces)).closed


def with_specks(count):
    """A ball of 8 voxels radius, and so many single voxels around it."""
    z, y, x = np.indices((20, 40, 40))
    values = ((z - 10) ** 2 + (y - 20) ** 2 + (x - 20) ** 2 <= 64).astype(np.uint8)
    corner = np.argwhere((z % 3 == 1) & (y % 3 == 1) & (x % 3 == 1) & ((y - 20) ** 2 + (x - 20) ** 2 > 150))
    values[tuple(corner[:count].T)] = 1
    return values


@pytest.mark.parametrize("count", [0, 5, 9, 200])
def test_small_components_are_counted_where_there_are_many(count):
    mesh = marching_cubes(with_specks(count), 0.5, normals=False)
    assert mesh.components == count + 1
    assert mesh.measures.small_components == (count if count >= 9 else 0)
    assert mesh.measures.has_many_small_components == (count >= 10)
    grown = finish(measures_steps(mesh.vertices * np.float32(10), mesh.faces))
    assert grown.small_components == 0  # a voxel encloses a sixth of its 1000
