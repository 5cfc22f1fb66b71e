# SPDX-License-Identifier: GPL-3.0-or-later
"""Clustering: far fewer triangles, the same topology, and a border that stays."""

import numpy as np
import pytest
from meshes import as_mesh, assert_sound, boundary_edges, icosphere, joined, non_manifold_edges, torus

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.mesh import surface_distance
from ctmc_addon.core.simplification.batches.pieces import Batch
from ctmc_addon.core.simplification.clustering import clustered_steps


def clustered(mesh, share=0.0):
    batch = Batch(mesh, np.arange(len(mesh.vertices)))
    return finish(clustered_steps(batch, round(share * len(mesh.faces))))[0]


def noise(close_border, seed=0):
    values = np.random.default_rng(seed).normal(size=(22, 24, 26)).astype(np.float32)
    values[1:] += values[:-1]
    values[:, :, 1:] += values[:, :, :-1]
    return marching_cubes(values, 0.8, close_border=close_border)


@pytest.mark.parametrize(
    "mesh", [icosphere(5), torus(120, 60), joined(icosphere(4), icosphere(3, 0.3)), noise(True), noise(True, 1)]
)
@pytest.mark.parametrize("share", [0.5, 0.0])  # some clusters of one round, and as many rounds as there are
def test_components_and_handles_are_those_of_the_mesh(mesh, share):
    result = clustered(mesh, share).mesh
    assert_sound(result)
    assert result.closed
    assert not len(non_manifold_edges(result))
    assert (result.euler, result.components) == (mesh.euler, mesh.components)


@pytest.mark.parametrize(("share", "largest", "mean"), [(0.37, 0.03, 0.008), (0.2, 0.06, 0.02), (0.1, 0.12, 0.04)])
def test_a_smooth_surface_hardly_moves_and_has_no_fewer_triangles_than_asked(share, largest, mean):
    mesh = icosphere(5, 10.0)  # edges of 0.35
    result = clustered(mesh, share).mesh
    assert share * len(mesh.faces) <= len(result.faces) < 1.15 * share * len(mesh.faces)
    away = surface_distance(result, mesh)
    assert away.largest < largest
    assert away.mean < mean
    assert result.volume == pytest.approx(mesh.volume, rel=0.01 * largest / 0.03)


def test_the_smallest_components_stay():
    octahedra = joined(*(icosphere(0, 1.0, (3 * i, 0, 0)) for i in range(9)))
    assert clustered(octahedra).mesh.components == 9


def test_a_border_and_its_numbers_stay():
    mesh = noise(False)
    batch = clustered(mesh)
    assert len(batch.mesh.faces) < 0.95 * len(mesh.faces)
    border = np.unique(boundary_edges(mesh))
    assert np.isin(border, batch.numbers).all()
    place = np.searchsorted(batch.numbers, border)
    assert (batch.mesh.vertices[place] == mesh.vertices[border]).all()
    assert len(boundary_edges(batch.mesh)) == len(boundary_edges(mesh))
    assert not len(non_manifold_edges(batch.mesh))


def test_normals_stay_of_length_one():
    mesh = icosphere(4)
    result = clustered(as_mesh(mesh.vertices, mesh.faces, mesh.vertices), 0.2).mesh
    assert np.allclose((result.normals**2).sum(axis=1), 1, atol=1e-5)
    assert np.allclose(result.normals, result.vertices, atol=0.05)
