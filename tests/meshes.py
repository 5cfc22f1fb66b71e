# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with a closed form, and what must hold for every simplified one."""

from dataclasses import replace

import numpy as np

from ctmc_addon.core import TriangleMesh, distances, finish
from ctmc_addon.core.mesh.cavities import crossings_steps, points_within, smallest_around
from ctmc_addon.core.mesh.face_normals import face_vectors
from ctmc_addon.core.mesh.topology import component_numbers_steps
from ctmc_addon.core.mesh.triangle_mesh import SurfacePiece


def as_mesh(vertices, faces, normals=None):
    return TriangleMesh(np.asarray(vertices, np.float32), np.asarray(faces, np.int32), normals)


def icosphere(levels, radius=1.0, center=(0.0, 0.0, 0.0)):
    """20 * 4^levels faces on a sphere, with the sphere's own normals."""
    golden = (1 + 5**0.5) / 2
    points = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0)]
    points += [(0, -1, golden), (0, 1, golden), (0, -1, -golden), (0, 1, -golden)]
    points += [(golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)]
    vertices = np.array(points) / np.sqrt(1 + golden**2)
    top, bottom = (11, 5, 1, 7, 10), (2, 4, 9, 8, 6)  # the rings round vertices 0 and 3
    rows = []
    for i in range(5):
        j = (i + 1) % 5
        rows += [(0, top[i], top[j]), (3, bottom[j], bottom[i])]
        rows += [(top[j], top[i], bottom[j]), (bottom[i], bottom[j], top[i])]
    faces = np.array(rows)
    for _ in range(levels):
        count = len(vertices)
        edges = np.sort(np.concatenate([faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)]]), axis=1)
        edges, inverse = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (inverse.reshape(-1) + count).reshape(3, -1)
        a, b, c = faces.T
        faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        middle = vertices[edges].sum(axis=1)
        vertices = np.concatenate([vertices, middle / np.linalg.norm(middle, axis=1)[:, None]])
    return as_mesh(vertices * radius + center, faces, vertices.astype(np.float32))


def torus(around, across, major=3.0, minor=1.0):
    i, j = np.divmod(np.arange(around * across), across)
    u, v = 2 * np.pi * i / around, 2 * np.pi * j / across
    ring = major + minor * np.cos(v)
    right, up = (i + 1) % around * across, (j + 1) % across
    faces = [(i * across + j, right + j, right + up), (i * across + j, right + up, i * across + up)]
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=1)
    return as_mesh(vertices, np.concatenate([np.stack(f, axis=1) for f in faces]))


def sheet(columns, rows, height=None):
    """An open grid over the plane z = 0, or over height(x, y)."""
    y, x = np.divmod(np.arange(columns * rows), columns)
    z = np.zeros(len(x)) if height is None else height(x, y)
    corner = np.flatnonzero((x < columns - 1) & (y < rows - 1))
    right, up = corner + 1, corner + columns
    faces = np.concatenate([np.stack([corner, right, up], axis=1), np.stack([right, up + 1, up], axis=1)])
    return as_mesh(np.stack([x, y, z], axis=1), faces)


def joined(*meshes):
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes])
    return as_mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=False)]),
    )


def pieces_of(mesh, count):
    """The pieces of a mesh, cut along z where it is long enough for its triangles."""
    z = mesh.vertices[:, 2]
    piece = np.searchsorted(np.linspace(z.min(), z.max(), count + 1)[1:-1], z, side="right")
    first = piece[mesh.faces].min(axis=1)
    assert (piece[mesh.faces].max(axis=1) - first <= 1).all()
    for number in range(count):
        own, following = np.flatnonzero(piece == number), np.flatnonzero(piece == number + 1)
        place = np.full(len(z), -1, np.int32)
        place[own] = np.arange(len(own))
        place[following] = len(own) + np.arange(len(following))
        normals = None if mesh.normals is None else mesh.normals[own]
        yield SurfacePiece(mesh.vertices[own], place[mesh.faces[first == number]], normals)


def layered(mesh):
    """A mesh in index space with its vertices and faces layer by layer of samples, as extraction orders them."""
    layer = np.floor(mesh.vertices[:, 2])
    order = np.argsort(layer, kind="stable")
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order), dtype=np.int32)
    faces = place[mesh.faces]
    faces = faces[np.argsort(layer[order][faces].min(axis=1), kind="stable")]
    return replace(
        mesh, vertices=mesh.vertices[order], faces=faces, normals=None if mesh.normals is None else mesh.normals[order]
    )


def layered_pieces(mesh, cuts):
    """The pieces of a `layered` mesh, cut before these layers."""
    layer = np.floor(mesh.vertices[:, 2])
    ends = [0, *np.searchsorted(layer, sorted(cuts)), len(layer)]
    face_layer = layer[mesh.faces].min(axis=1)
    face_ends = [0, *np.searchsorted(face_layer, sorted(cuts)), len(face_layer)]
    for number in range(len(ends) - 1):
        own = slice(ends[number], ends[number + 1])
        faces = mesh.faces[face_ends[number] : face_ends[number + 1]] - np.int32(ends[number])
        yield SurfacePiece(mesh.vertices[own], faces, None if mesh.normals is None else mesh.normals[own])


def edges(mesh):
    """Every undirected edge once, (E, 2) with the lower vertex first, and its number of triangles, (E,)."""
    ends = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    keys, count = np.unique(ends[:, 0] * len(mesh.vertices) + ends[:, 1], return_counts=True)
    return np.stack(np.divmod(keys, max(len(mesh.vertices), 1)), axis=1), count


def boundary_edges(mesh):
    """Edges with one triangle, (n, 2)."""
    ends, count = edges(mesh)
    return ends[count == 1]


def non_manifold_edges(mesh):
    """Edges with three triangles or more, (n, 2)."""
    ends, count = edges(mesh)
    return ends[count > 2]


def component_of_face(mesh):
    """The number of the component that every face is in, (F,), in the order of their first face."""
    return finish(component_numbers_steps(mesh.faces, len(mesh.vertices)))


def cavity_owners(mesh, component, volumes):
    """The component that every component belongs to, (components,): itself, or for a cavity the smallest around it.

    Volumes are signed, below zero for cavities; the whole mesh is searched at once.
    """
    cavities = np.flatnonzero(volumes < 0)
    if len(cavities) in (0, len(volumes)):
        return np.arange(len(volumes))
    first_face = np.unique(component, return_index=True)[1]
    points = points_within(mesh.vertices[mesh.faces[first_face[cavities]]])
    ray, face, leaves = finish(crossings_steps(mesh, points))
    return smallest_around(cavities, volumes, ray, component[face], leaves)


def assert_sound(mesh):
    """Every vertex used, no face with a vertex twice, no face twice, no edge with three faces."""
    assert mesh.vertices.dtype == np.float32
    assert mesh.faces.dtype == np.int32
    assert mesh.vertices.flags.c_contiguous
    assert mesh.faces.flags.c_contiguous
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))
    rows = np.sort(mesh.faces, axis=1)
    assert (np.diff(rows, axis=1) > 0).all()
    assert len(np.unique(rows, axis=0)) == len(rows)
    assert not len(non_manifold_edges(mesh))


def spread(mesh, count, seed):
    """Points spread evenly at random over the surface, and its vertices."""
    draw = np.random.default_rng(seed)
    vectors = face_vectors(mesh.vertices, mesh.faces)
    area = np.sqrt((vectors**2).sum(axis=1))
    face = draw.choice(len(area), count, p=area / area.sum())
    u, v = draw.random((2, count, 1))
    u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))
    a, b, c = mesh.vertices[mesh.faces[face]].astype(float).transpose(1, 0, 2)
    return np.concatenate([a + u * (b - a) + v * (c - a), mesh.vertices])


def largest_error(mesh, small, count=4000):
    there = distances(spread(mesh, count, 1), small).max()
    return max(there, distances(spread(small, count, 2), mesh).max())


def read_ply(path):
    """Positions, normals and triangles of a binary PLY as it is written here."""
    head, raw = path.read_bytes().split(b"end_header\n", 1)
    vertices, faces = (int(line.split()[2]) for line in head.decode().splitlines() if line.startswith("element"))
    numbers = np.frombuffer(raw, "<f4", 6 * vertices).reshape(-1, 6)
    rows = np.frombuffer(raw, [("count", "u1"), ("vertices", "<i4", 3)], faces, numbers.nbytes)
    assert len(raw) == numbers.nbytes + rows.nbytes
    assert (rows["count"] == 3).all()
    return numbers[:, :3], numbers[:, 3:], rows["vertices"]
