# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
from meshes import edges

from ctmc_addon.core import TriangleMesh, finish, marching_cubes
from ctmc_addon.core.mesh.distance.subdivision import cut_in_four_steps, mean_longest_edge_steps, subdivided_steps

OCTAHEDRON = TriangleMesh(
    np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32),
    np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)], np.int32),
)


def test_cutting_keeps_the_surface():
    mesh = marching_cubes(8 - np.sqrt(((np.indices((20, 20, 20)) - 9.5) ** 2).sum(axis=0)), 0.0)
    cut = finish(cut_in_four_steps(mesh))
    assert len(cut.faces) == 4 * len(mesh.faces)
    assert len(cut.vertices) == len(mesh.vertices) + len(edges(mesh)[0])
    assert cut.closed
    assert cut.volume == pytest.approx(mesh.volume, rel=1e-5)
    assert cut.area == pytest.approx(mesh.area, rel=1e-5)
    assert np.abs(np.sqrt((cut.normals**2).sum(axis=1)) - 1).max() < 1e-5


def test_triangles_are_cut_until_their_edges_are_short_enough_but_not_beyond_the_limit():
    assert finish(mean_longest_edge_steps(OCTAHEDRON)) == pytest.approx(np.sqrt(2))
    assert len(finish(subdivided_steps(OCTAHEDRON, 1.1)).faces) == 8
    assert len(finish(subdivided_steps(OCTAHEDRON, 0.3)).faces) == 8 * 16
    assert len(finish(subdivided_steps(OCTAHEDRON, 1e-6)).faces) == 8 * 4**7 < 400_000 < 8 * 4**8
