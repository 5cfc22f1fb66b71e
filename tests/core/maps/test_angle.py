# SPDX-License-Identifier: GPL-3.0-or-later
"""Smallest angles around vertices, and distances to the full surface."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import Budget, ReconstructionSettings, TriangleMesh, Volume, finish, reconstruct
from ctmc_addon.core.maps import Deviation, MappedSurface, SmallestAngle
from ctmc_addon.core.mesh.distance.triangle_tree import distances


def test_a_vertex_has_the_smallest_angle_of_its_triangles():
    # Angles 90, 45, 45 and 90, atan(1/3), atan(3).
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -3, 0], [9, 9, 9]], np.float32)
    mesh = TriangleMesh(vertices, np.array([[0, 1, 2], [0, 3, 1]], np.int32))
    surface = MappedSurface(mesh, ReconstructionSettings(), None, Budget(), None)
    values = finish(SmallestAngle().values_steps(surface)).values
    narrow = np.degrees(np.arctan(1 / 3))
    np.testing.assert_allclose(values, [narrow, narrow, 45.0, narrow, np.nan], rtol=1e-6)


def test_its_minimum_is_the_smallest_of_all_and_deviation_is_the_distance_to_the_full_surface():
    distance = np.sqrt(((np.indices((24, 24, 24)) - 11.5) ** 2).sum(axis=0))
    volume = Volume((9 - distance).astype(np.float32), np.eye(4))
    settings = ReconstructionSettings(threshold=0.0, reduction=0.8)
    result = reconstruct(volume, settings, maps=[SmallestAngle(), Deviation()])
    angle, deviation = result.maps
    corners = result.mesh.vertices[result.mesh.faces].astype(float)
    sides = [corners[:, (at + 1) % 3] - corners[:, at] for at in range(3)]
    lengths = [np.sqrt((side**2).sum(axis=1)) for side in sides]
    cosines = [-(sides[at] * sides[at - 1]).sum(axis=1) / lengths[at] / lengths[at - 1] for at in range(3)]
    assert angle.statistics.minimum == pytest.approx(np.degrees(np.arccos(np.max(cosines))), rel=1e-4)
    full = reconstruct(volume, ReconstructionSettings(threshold=0.0)).mesh
    np.testing.assert_allclose(deviation.values, distances(result.mesh.vertices, full), rtol=1e-6, atol=1e-7)
    assert 0 < deviation.statistics.maximum < 0.5
    [none] = reconstruct(volume, ReconstructionSettings(threshold=0.0), maps=[Deviation()]).maps
    assert not none.values.any()
