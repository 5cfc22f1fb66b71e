# SPDX-License-Identifier: GPL-3.0-or-later
"""Clustering: far fewer triangles, the same topology, and a border that stays."""

import numpy as np
import pytest
from meshes import as_mesh, assert_sound, icosphere, joined, torus

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.mesh import surface_distance
from ctmc_addon.core.simplification.streaming.clustering import clustered_steps
from ctmc_addon.core.simplification.streaming.parts import Part


def clustered(mesh):
    return finish(clustered_steps(Part(mesh, np.arange(len(mesh.vertices)))))


def noise(close_border, seed=0):
    values = np.random.default_rng(seed).normal(size=(22, 24, 26)).astype(np.float32)
    values[1:] += values[:-1]
    values[:, :, 1:] += values[:, :, :-1]
    return marching_cubes(values, 0.8, close_border=close_border)


@pytest.mark.parametrize(
    "mesh", [icosphere(5), torus(120, 60), joined(icosphere(4), icosphere(3, 0.3)), noise(True), noise(True, 1)]
)
def test_components_and_handles_are_those_of_the_mesh(mesh):
    result = clustered(mesh).mesh
    assert_sound(result)
    assert result.closed
    assert not len(result.non_manifold_edges)
    assert (result.euler, result.components) == (mesh.euler, mesh.components)


def test_about_a_third_of_a_smooth_surface_is_left_and_it_hardly_moves():
    mesh = icosphere(5, 10.0)  # edges of 0.35
    result = clustered(mesh).mesh
    assert 0.2 * len(mesh.faces) < len(result.faces) < 0.45 * len(mesh.faces)
    assert surface_distance(result, mesh).largest < 0.05
    assert result.volume == pytest.approx(mesh.volume, rel=0.002)


def test_the_smallest_components_stay():
    octahedra = joined(*(icosphere(0, 1.0, (3 * i, 0, 0)) for i in range(9)))
    assert clustered(octahedra).mesh.components == 9


def test_a_border_and_its_numbers_stay():
    mesh = noise(False)
    part = clustered(mesh)
    border = np.unique(mesh.boundary_edges)
    assert np.isin(border, part.numbers).all()
    place = np.searchsorted(part.numbers, border)
    assert (part.mesh.vertices[place] == mesh.vertices[border]).all()
    assert len(part.mesh.boundary_edges) == len(mesh.boundary_edges)
    assert not len(part.mesh.non_manifold_edges)


def test_normals_stay_of_length_one():
    mesh = icosphere(4)
    result = clustered(as_mesh(mesh.vertices, mesh.faces, mesh.vertices)).mesh
    assert np.allclose((result.normals**2).sum(axis=1), 1, atol=1e-5)
    assert np.allclose(result.normals, result.vertices, atol=0.05)
