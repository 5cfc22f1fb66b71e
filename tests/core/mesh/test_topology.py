# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges and components against slow, obvious answers."""

import numpy as np
import pytest

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.mesh.topology import (
    Groups,
    compacted,
    component_numbers_steps,
    component_roots_steps,
    edge_ends,
    edge_keys_steps,
    edges_steps,
    keys_of_edges_steps,
)


@pytest.mark.parametrize("at_once", [7, 1 << 18])
@pytest.mark.parametrize("seed", range(5))
def test_components_are_those_of_a_walk_from_face_to_face(seed, at_once, monkeypatch):
    monkeypatch.setattr("ctmc_addon.core.mesh.topology.FACES_PER_STEP", at_once)
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 200, (120, 3)).astype(np.int32)
    parents = list(range(200))

    def root(vertex):
        while parents[vertex] != vertex:
            vertex = parents[vertex]
        return vertex

    for a, b, c in faces.tolist():
        parents[root(a)] = root(b)
        parents[root(b)] = root(c)
    roots = [root(a) for a, _, _ in faces.tolist()]
    order = {}
    expected = [order.setdefault(r, len(order)) for r in roots]
    assert finish(component_numbers_steps(faces, 200)).tolist() == expected


def test_a_long_strip_is_one_component():
    n = 20000
    strip = np.stack([np.arange(n), np.arange(n) + 1, np.arange(n) + 2], axis=1).astype(np.int32)
    assert finish(component_numbers_steps(strip, n + 2)).max() == 0


@pytest.mark.parametrize("bucket", [1, 50, 1 << 19])
def test_edges_found_bucket_by_bucket_are_those_found_at_once(monkeypatch, bucket):
    monkeypatch.setattr("ctmc_addon.core.mesh.topology.BUCKET", bucket)
    values = np.random.default_rng(2).integers(0, 100, (4, 5, 6)).astype(np.uint8)
    faces = np.ascontiguousarray(marching_cubes(values, 50.5).faces.T)
    found, number = finish(edges_steps(faces, faces.max() + 3))
    ends = faces, faces[[1, 2, 0]]
    sides = np.stack([np.minimum(*ends), np.maximum(*ends)]).reshape(2, -1)
    edges, at = np.unique(sides, axis=1, return_inverse=True)
    np.testing.assert_array_equal(found, edges)
    np.testing.assert_array_equal(number, at.reshape(faces.shape))


def test_of_every_edge_the_triangles_are_counted_and_those_that_run_up_it():
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]], np.int32)
    keys, irregular, (count, upwards) = finish(edge_keys_steps(faces, 5))
    assert irregular.tolist() == list(range(7))
    assert edge_ends(keys).T.tolist() == [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [1, 3], [1, 4]]
    assert count.tolist() == [3, 1, 1, 1, 1, 1, 1]
    assert upwards.tolist() == [2, 0, 1, 0, 1, 0, 1]


@pytest.mark.parametrize("seed", range(5))
def test_known_edges_are_counted_as_edges_that_are_found(seed):
    faces = np.random.default_rng(seed).integers(0, 30, (90, 3)).astype(np.int32)  # Some edges are points.
    closed = marching_cubes(np.pad(np.ones((2, 2, 2), np.uint8), 2), 0.5).faces
    for each in (faces, closed, faces[:0]):
        edges = finish(edges_steps(np.ascontiguousarray(each.T), 100))
        found = finish(edge_keys_steps(each, 100))
        for known, expected in zip(finish(keys_of_edges_steps(each, *edges)), found, strict=True):
            assert known.dtype == expected.dtype
            np.testing.assert_array_equal(known, expected)


def test_links_of_two_connect_as_faces_do():
    faces = np.array([[0, 4, 2], [5, 1, 1], [3, 5, 5]], np.int32)
    links = np.concatenate([faces[:, :2], faces[:, 1:]])
    assert finish(component_roots_steps(links, 7)).tolist() == finish(component_roots_steps(faces, 7)).tolist()
    assert finish(component_roots_steps(links, 7)).tolist() == [0, 1, 0, 1, 0, 1, 6]


@pytest.mark.parametrize("seed", range(5))
def test_groups_joined_one_after_the_other_are_the_components(seed):
    pairs = np.random.default_rng(seed).integers(0, 40, (25, 2)).astype(np.int32)
    groups = Groups(40)
    joined = [groups.join(*pair) for pair in pairs.tolist()]
    roots = finish(component_roots_steps(pairs, 40)).tolist()
    assert [groups.root(number) for number in range(40)] == roots
    assert sum(joined) == 40 - len(set(roots))
    assert groups.lists() == [[n for n in range(40) if roots[n] == root] for root in sorted(set(roots))]


def test_compacted_faces_keep_the_order_of_the_vertices_that_they_use():
    faces = np.array([[7, 2, 5], [5, 2, 9]], np.int32)
    used, left = compacted(faces, 11)
    assert np.flatnonzero(used).tolist() == [2, 5, 7, 9]
    np.testing.assert_array_equal(np.flatnonzero(used)[left], faces)
    assert compacted(faces[:0], 3)[0].tolist() == [False] * 3
