# SPDX-License-Identifier: GPL-3.0-or-later
"""Which component a cavity belongs to, against winding numbers."""

import numpy as np
import pytest
from meshes import cavity_owners, component_of_face

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.mesh.measures import component_volumes_steps


@pytest.mark.parametrize("seed", range(4))
def test_every_cavity_belongs_to_the_smallest_component_around_it(seed):
    """Against the winding number of every component about a point on the cavity (van Oosterom and Strackee 1983)."""
    random = np.random.default_rng(seed)
    values = np.pad(random.normal(size=(14, 15, 16)), 2, constant_values=-9)
    values[7:9] = -9
    mesh = marching_cubes(values, -1.5, normals=False)
    component = component_of_face(mesh)
    volumes = finish(component_volumes_steps(mesh.vertices, mesh.faces, component))
    owner = cavity_owners(mesh, component, volumes)
    bodies, cavities = np.flatnonzero(volumes > 0), np.flatnonzero(volumes < 0)
    assert len(cavities) > 10
    assert len(bodies) > 1
    for cavity in cavities:
        point = mesh.vertices[mesh.faces[component == cavity][-1]].mean(axis=0)
        turns = np.bincount(component, solid_angles(mesh, point), len(volumes)) / (4 * np.pi)
        around = [body for body in bodies if turns[body] > 0.5]
        assert owner[cavity] == min(around, key=lambda body: volumes[body])
    assert (owner[bodies] == bodies).all()


def solid_angles(mesh, point):
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(float) - point for corner in range(3))
    x, y, z = (np.sqrt((side * side).sum(axis=1)) for side in (a, b, c))
    over = (a * np.cross(b, c)).sum(axis=1)
    under = x * y * z + (a * b).sum(axis=1) * z + (a * c).sum(axis=1) * y + (b * c).sum(axis=1) * x
    return 2 * np.arctan2(over, under)
