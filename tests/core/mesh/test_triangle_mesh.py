# SPDX-License-Identifier: GPL-3.0-or-later
"""What is measured on meshes, against closed forms and SciPy-free obvious answers."""

import numpy as np
import pytest
from meshes import boundary_edges, component_of_face, non_manifold_edges

from ctmc_addon.core import TriangleMesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)


def tetrahedra(*places):
    vertices = np.concatenate([CORNERS + place for place in places]).astype(np.float32)
    faces = np.concatenate([TETRAHEDRON + 4 * number for number in range(len(places))])
    return TriangleMesh(vertices, faces)


def test_a_tetrahedron_has_its_closed_form_measures():
    mesh = tetrahedra((100.0, -50.0, 7.0))
    assert mesh.area == pytest.approx(1.5 + np.sqrt(3) / 2)
    assert mesh.volume == pytest.approx(1 / 6)
    assert (mesh.euler, mesh.components, mesh.closed) == (2, 1, True)
    assert (len(boundary_edges(mesh)), len(non_manifold_edges(mesh))) == (0, 0)


def test_turned_inside_out_the_volume_is_negative():
    mesh = tetrahedra((0, 0, 0))
    assert TriangleMesh(mesh.vertices, mesh.faces[:, ::-1]).volume == pytest.approx(-1 / 6)


def test_a_missing_face_opens_three_edges():
    mesh = TriangleMesh(CORNERS, TETRAHEDRON[:3])
    assert not mesh.closed
    assert np.isnan(mesh.volume)
    assert mesh.enclosed_volume is None
    assert sorted(map(tuple, boundary_edges(mesh))) == [(1, 2), (1, 3), (2, 3)]


def test_a_face_turned_over_is_not_closed():
    faces = TETRAHEDRON.copy()
    faces[0] = faces[0, ::-1]
    assert not TriangleMesh(CORNERS, faces).closed


def test_three_triangles_at_an_edge_are_non_manifold():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]], np.int32)
    assert non_manifold_edges(TriangleMesh(vertices, faces)).tolist() == [[0, 1]]


def test_an_empty_mesh_measures_nothing():
    mesh = TriangleMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert (mesh.area, mesh.components, mesh.closed, mesh.euler) == (0, 0, False, 0)
    assert np.isnan(mesh.volume)


def test_components_are_numbered_by_their_first_face():
    mesh = tetrahedra((0, 0, 0), (5, 0, 0), (9, 0, 0))
    shuffled = TriangleMesh(mesh.vertices, mesh.faces[[8, 0, 4, 9, 1, 5, 2, 3, 6, 7, 10, 11]])
    assert shuffled.components == 3
    assert component_of_face(shuffled).tolist() == [0, 1, 2, 0, 1, 2, 1, 1, 2, 2, 0, 0]
