# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals of triangles, and their means at vertices."""

import numpy as np

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.mesh import face_normals
from ctmc_addon.core.mesh.face_normals import face_vectors, face_vectors_steps, vertex_normals


def test_vertex_normals_of_a_square_point_up():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    np.testing.assert_array_equal(vertex_normals(vertices, faces), [[0, 0, 1]] * 4)


def test_the_vector_of_a_face_is_twice_its_area_long_and_points_outside():
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], np.float32)
    assert face_vectors(corners, np.array([[0, 1, 2], [0, 2, 1]], np.int32)).tolist() == [[0, 0, 6], [0, 0, -6]]


def test_vectors_block_by_block_are_those_of_all_at_once(monkeypatch):
    mesh = marching_cubes(np.random.default_rng(4).integers(0, 100, (6, 7, 8)), 50.5)
    monkeypatch.setattr(face_normals, "FACES_PER_STEP", 7)
    blocks = finish(face_vectors_steps(mesh.vertices, mesh.faces))
    np.testing.assert_array_equal(blocks, face_vectors(mesh.vertices, mesh.faces))
