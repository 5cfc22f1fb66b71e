# SPDX-License-Identifier: GPL-3.0-or-later
"""Complexes of labels on a grid, and what must hold for every simplified one."""

from itertools import combinations, permutations

import numpy as np

from ctmc_addon.core.mesh.labels.label_complex import ComplexMesh

EDGES = list(combinations(range(4), 2))


def voronoi_labels(size, seeds, radius):
    """Labels 1.. of the nearest of `seeds` (n, 3) within a ball of `radius` around the middle, else 0."""
    middle = (size - 1) / 2
    points = np.stack(np.meshgrid(*[np.arange(size) - middle] * 3, indexing="ij"), axis=-1)
    nearest = ((points[..., None, :] - np.asarray(seeds, float)) ** 2).sum(axis=-1).argmin(axis=-1) + 1
    return np.where((points**2).sum(axis=-1) < radius**2, nearest, 0)


def complex_of(labels, rounds=12, flipped=0):
    """The interfaces between the labels of grid points, smoothed; every label is closed and manifold.

    Six tetrahedra fill a cube; in each, the four corners' regions meet in the middle. At most three regions meet along
    an edge, four in a point, so the boundary of any of them is manifold.
    """
    shape = labels.shape
    number = np.arange(labels.size).reshape(shape)
    flat = labels.ravel()
    starts = number[:-1, :-1, :-1].ravel()
    steps = [shape[1] * shape[2], shape[2], 1]
    tetrahedra = np.concatenate([starts[:, None] + np.cumsum((0, *order)) for order in permutations(steps)])
    mixed = (flat[tetrahedra] != flat[tetrahedra[:, :1]]).any(axis=1)
    tetrahedra = tetrahedra[mixed]
    points = np.stack(np.unravel_index(np.arange(labels.size), shape), axis=1).astype(float)
    keys, sides, along = [], [], []
    empty = np.full(len(tetrahedra), -1)
    for i, j in EDGES:
        a, b = tetrahedra[:, i], tetrahedra[:, j]
        differ = flat[a] != flat[b]
        k, m = (tetrahedra[:, other] for other in range(4) if other not in (i, j))
        middle, centre = np.stack([a, b, empty, empty], axis=1), tetrahedra
        for third in (k, m):
            face = np.stack([a, b, third, empty], axis=1)
            keys.append(np.stack([middle, face, centre], axis=1)[differ])
            sides.append(np.stack([flat[a], flat[b]], axis=1)[differ])
            along.append((points[b] - points[a])[differ])
    keys, sides, along = np.concatenate(keys), np.concatenate(sides), np.concatenate(along)
    keys = np.sort(keys, axis=2).reshape(-1, 4)
    keys, faces = np.unique(keys, axis=0, return_inverse=True)
    faces = faces.reshape(-1, 3)
    used = keys >= 0
    vertices = (points[keys] * used[..., None]).sum(axis=1) / used.sum(axis=1)[:, None]
    a, b, c = (vertices[corner] for corner in faces.T)
    turned = (np.cross(b - a, c - a) * along).sum(axis=1) < 0
    faces[turned] = faces[turned][:, ::-1]
    low = sides[:, 0] < sides[:, 1]
    if flipped:  # some triangles point the other way
        low ^= np.arange(len(sides)) % flipped == 0
    faces[low], sides[low] = faces[low][:, ::-1], sides[low][:, ::-1]
    vertices = smoothed(vertices, faces, rounds)
    return ComplexMesh(vertices.astype(np.float32), faces.astype(np.int32), sides.astype(np.int32))


def edges_of(faces):
    """Every edge once, and how many triangles it has."""
    pairs = np.sort(np.concatenate([faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)]]), axis=1)
    return np.unique(pairs, axis=0, return_counts=True)


def junction_edges(mesh):
    edges, counts = edges_of(mesh.faces)
    return edges[counts != 2]


def corners_of(mesh):
    """Vertices in which junction lines end or branch."""
    degree = np.bincount(junction_edges(mesh).ravel(), minlength=len(mesh.vertices))
    return np.flatnonzero((degree > 0) & (degree != 2))


def smoothed(vertices, faces, rounds):
    """Every vertex to the mean of its neighbors, on junction lines of those along the line; there and a little back."""
    edges, counts = edges_of(faces)
    line = np.zeros(len(vertices), bool)
    line[edges[counts != 2]] = True
    own = edges[(counts != 2) | ~line[edges].any(axis=1)]
    inner = edges[counts == 2]
    inner = np.concatenate([inner, inner[:, ::-1]])
    inner = inner[~line[inner[:, 0]]]
    pairs = np.unique(np.concatenate([inner, own[line[own[:, 0]]], own[line[own[:, 0]]][:, ::-1]]), axis=0)
    degree = np.bincount(pairs[:, 0], minlength=len(vertices))[:, None]
    for turn in range(2 * rounds):
        mean = np.zeros_like(vertices)
        np.add.at(mean, pairs[:, 0], vertices[pairs[:, 1]])
        way = mean / np.maximum(degree, 1) - vertices
        vertices = vertices + (0.5 if turn % 2 == 0 else -0.53) * np.where(degree > 0, way, 0.0)
    return vertices


def assert_labels_sound(mesh):
    """Every label is closed, manifold in edges and vertices, and turned outward; no triangle is there twice."""
    assert len(np.unique(np.sort(mesh.faces, axis=1), axis=0)) == len(mesh.faces)
    assert (mesh.sides[:, 0] != mesh.sides[:, 1]).all()
    assert np.isfinite(mesh.vertices).all()
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)
    for label in mesh.labels:
        own = mesh.of_label(label)
        directed = np.concatenate([own.faces[:, (0, 1)], own.faces[:, (1, 2)], own.faces[:, (2, 0)]])
        assert len(np.unique(directed, axis=0)) == len(directed)
        counts = edges_of(own.faces)[1]
        assert (counts == 2).all(), label
        assert own.volume > 0
        assert single_fans(own.faces)


def single_fans(faces):
    """Whether the triangles around every vertex of a closed manifold hang together."""
    following = {}
    for a, b, c in faces.tolist():
        for u, v, w in ((a, b, c), (b, c, a), (c, a, b)):
            following.setdefault(u, {})[v] = w
    for ring in following.values():
        start = now = next(iter(ring))
        length = 0
        while True:
            now, length = ring[now], length + 1
            if now == start:
                break
        if length != len(ring):
            return False
    return True
