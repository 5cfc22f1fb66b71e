# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes of a closed form for solids, and what must hold for all parts together."""

from dataclasses import dataclass

import numpy as np
from complexes import edges_of

from ctmc_addon.core import finish
from ctmc_addon.core.mesh.distance.signed_distance import SignedSurface
from ctmc_addon.core.mesh.intersections import self_intersections


@dataclass(frozen=True)
class Ball:
    """A ball as a shape of a field."""

    center: tuple[float, float, float]
    radius: float

    @property
    def box(self):
        return np.array(self.center) - self.radius, np.array(self.center) + self.radius

    @property
    def planes(self):
        return ()

    def at(self, points):
        return self.radius - np.sqrt(((points - np.array(self.center)[:, None]) ** 2).sum(axis=0))


def ball_volume(radius):
    return 4 / 3 * np.pi * radius**3


def cap_volume(radius, distance):
    """Volume of a ball beyond a plane at a distance from its middle, on the side away from it."""
    height = radius - distance
    return np.pi * height**2 * (3 * radius - height) / 3


def assert_parts(meshes, crossings=True):
    """Every part is closed, turned outward, each edge has two triangles, and no triangle crosses another."""
    for mesh in meshes:
        assert mesh.closed
        assert (edges_of(mesh.faces)[1] == 2).all()
        assert mesh.volume > 0
    if crossings:
        assert not len(self_intersections(*together(meshes)))


def together(meshes):
    """The vertices and triangles of several meshes as one; what they share is there once."""
    points = np.concatenate([mesh.vertices for mesh in meshes])
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)])
    vertices, number = np.unique(points, axis=0, return_inverse=True)
    faces = number.reshape(-1)[faces].astype(np.int32)
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return vertices.astype(np.float32), faces[np.sort(first)]


def signed_distances(points, mesh):
    """Signed distances of points (n, 3) to a closed mesh, positive outside, mm."""
    surface = SignedSurface()
    finish(surface.prepare_steps(mesh))
    return finish(surface.distances_steps(np.asarray(points, float)))[0]
