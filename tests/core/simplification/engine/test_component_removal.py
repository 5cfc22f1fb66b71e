# SPDX-License-Identifier: GPL-3.0-or-later
"""Small components that go as a whole: which, how many, and what never changes."""

import numpy as np
import pytest
from meshes import (
    as_mesh,
    assert_sound,
    component_of_face,
    icosphere,
    joined,
    largest_error,
    non_manifold_edges,
    sheet,
    torus,
)

from ctmc_addon.core import distances, finish, simplify
from ctmc_addon.core.simplification.engine.component_removal import CollapsedComponents
from ctmc_addon.core.simplification.simplify import simplification_steps

TETRAHEDRON = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]


def simplification(mesh, **goal):
    steps = []
    return finish(simplification_steps(mesh, **goal), steps.append), steps[-1].message


def small_components(count, gap=3.0, radius=0.1, seed=0):
    """Octahedra-like balls of 20 triangles at random places `gap` above a sphere of radius 10."""
    way = np.random.default_rng(seed).normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    return joined(*(icosphere(0, radius, center) for center in (10 + gap) * way))


# Counts


@pytest.mark.parametrize("reduction", [0.5, 0.8, 0.9, 0.95, 0.98])
def test_a_large_sphere_with_500_small_components_has_exactly_the_triangles_asked_for(reduction):
    mesh = joined(icosphere(5, 10.0), small_components(500))
    found, message = simplification(mesh, reduction=reduction)
    asked = round((1 - reduction) * len(mesh.faces))
    assert asked - 1 <= len(found.mesh.faces) <= asked
    assert found.mesh.closed
    assert_sound(found.mesh)
    assert found.collapsed.count == 501 - found.mesh.components
    assert message.startswith(f"{len(found.mesh.faces)} triangles")


def test_the_small_components_go_before_the_sphere_is_harmed():
    sphere = icosphere(5, 10.0)
    mesh = joined(sphere, small_components(500, radius=0.02))
    small = simplify(mesh, target_faces=1000)
    assert small.components < 20
    alone = simplify(sphere, target_faces=1000)
    error = [distances(sphere.vertices, m).mean() for m in (small, alone)]
    assert error[0] < 1.1 * error[1]


def test_a_component_far_away_stays_longer_than_one_of_its_size_nearby():
    near, far = small_components(200, gap=0.3), small_components(200, gap=40.0, seed=1)
    small = simplify(joined(icosphere(4, 10.0), near, far), target_faces=2000)
    part = np.unique(component_of_face(small), return_index=True)[1]
    away = np.linalg.norm(small.vertices[small.faces[part, 0]], axis=1)
    assert (away > 30).sum() > (abs(away - 10.3) < 0.25).sum() + 50


def test_the_largest_removed_volume_is_in_the_unit_of_the_mesh():
    small = small_components(300)
    found, message = simplification(joined(icosphere(4, 10.0), small), target_faces=400)
    assert found.collapsed.count > 250
    assert found.collapsed.largest == pytest.approx(icosphere(0, 0.1).volume, rel=1e-3)
    assert message.endswith(f"; {found.collapsed.sentence()}")


def test_without_small_components_the_message_has_the_count_alone():
    found, message = simplification(icosphere(4), reduction=0.9)
    assert found.collapsed.count == 0
    assert message == "512 triangles"


def test_what_went_is_said_in_a_sentence():
    assert CollapsedComponents(562, 0.03, 1.9).sentence() == "562 specks removed (1.9 mm3 in total)"
    assert CollapsedComponents(1, 12345.6, 12345.6).sentence() == "1 speck removed (12.3 ml)"


# What never goes


@pytest.mark.parametrize("mesh", [icosphere(3), torus(40, 8, 3.0, 0.2), sheet(12, 12), as_mesh(*TETRAHEDRON)])
def test_a_single_component_never_vanishes(mesh):
    small = simplify(mesh, target_faces=1)
    assert small.components == 1
    assert small.closed == mesh.closed


def test_of_equal_components_one_remains():
    small = simplify(joined(*(icosphere(2, 1.0, (4 * i, 0, 0)) for i in range(5))), target_faces=1)
    assert small.components == 1
    assert len(small.faces) == 4


def test_only_tetrahedra_are_met_with_too_few_triangles_rather_than_too_many():
    tetrahedra = joined(*(as_mesh(np.add(TETRAHEDRON[0], [5 * i, 0, 0]), TETRAHEDRON[1]) for i in range(10)))
    assert len(simplify(tetrahedra, target_faces=10).faces) == 8
    assert len(simplify(tetrahedra, target_faces=12).faces) == 12


def test_a_component_at_a_non_manifold_edge_stays():
    corners = [*TETRAHEDRON[0], [1, -1, 0]]
    odd = as_mesh(np.array(corners) * 0.01 + [10.5, 0, 0], [*TETRAHEDRON[1], [0, 1, 4]])
    mesh = joined(icosphere(4, 10.0), odd, small_components(50))
    small = simplify(mesh, target_faces=200)
    assert len(non_manifold_edges(small)) == 1


# Kinds of components


def test_small_open_components_and_rings_go_too():
    pieces = [sheet(3, 3), torus(6, 4, 3.0, 1.0)]
    placed = [as_mesh(p.vertices * 0.02 + [11 + i, 0, 0], p.faces) for i in range(10) for p in pieces]
    mesh = joined(icosphere(4, 10.0), *placed)
    small = simplify(mesh, target_faces=300)
    assert len(small.faces) in (299, 300)
    assert small.components == 1


def test_a_cavity_goes_before_the_component_around_it_or_with_it():
    hollow = []
    for number in range(20):
        outer, inner = icosphere(1, 0.2, (11, number, 0)), icosphere(1, 0.15, (11, number, 0))
        hollow += [outer, as_mesh(inner.vertices, inner.faces[:, ::-1])]
    for target in (400, 700, 1100, 1500):
        small = simplify(joined(icosphere(4, 12.0), *hollow), target_faces=target)
        component = component_of_face(small)
        faces = [small.faces[component == number] for number in range(small.components)]
        volume = [as_mesh(small.vertices, own).volume for own in faces]
        middle = [small.vertices[own].mean(axis=(0, 1)) for own in faces]
        for hole in np.flatnonzero(np.array(volume) < 0):
            near = np.linalg.norm(np.array(middle) - middle[hole], axis=1) < 0.1
            assert near.sum() == 2


# A maximum error


def test_within_a_maximum_error_only_what_is_near_the_rest_goes():
    near, far = small_components(60, gap=0.2, radius=0.05), small_components(40, gap=2.0, radius=0.05, seed=1)
    mesh = joined(icosphere(4, 10.0), near, far)
    found, _ = simplification(mesh, max_error=0.5)
    assert 50 <= found.collapsed.count <= 60  # the others are near too, but the sphere has moved away from them
    assert found.mesh.components == 101 - found.collapsed.count
    ends = np.unique(component_of_face(found.mesh), return_index=True)[1]
    assert (np.linalg.norm(found.mesh.vertices[found.mesh.faces[ends, 0]], axis=1) > 11.5).sum() == 40
    assert found.mesh.closed
    assert largest_error(mesh, found.mesh) <= 0.5


@pytest.mark.parametrize("bound", [0.05, *(pytest.param(bound, marks=pytest.mark.once) for bound in (0.3, 2.0, 5.0))])
def test_the_bound_holds_both_ways_with_components_everywhere(bound):
    clouds = [small_components(40, gap, 0.08, seed) for seed, gap in enumerate((0.2, 0.5, 1.5, 4.0))]
    mesh = joined(icosphere(3, 10.0), *clouds)
    small = simplify(mesh, max_error=bound)
    assert small.closed
    assert largest_error(mesh, small) <= bound


# How


def test_the_same_input_gives_the_same_bytes():
    mesh = joined(icosphere(4, 10.0), small_components(300))
    one, two = (simplify(mesh, reduction=0.9) for _ in range(2))
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()


def test_the_unit_of_the_mesh_does_not_matter():
    mesh = joined(icosphere(4, 10.0), small_components(300))
    one, _ = simplification(mesh, reduction=0.9)
    other, _ = simplification(as_mesh(np.ldexp(mesh.vertices, -30), mesh.faces), reduction=0.9)
    assert np.array_equal(other.mesh.faces, one.mesh.faces)
    assert other.collapsed.largest == np.ldexp(one.collapsed.largest, -90)


def test_components_count_with_the_volume_that_they_had_before_clusters_shrank_them():
    turns = np.arange(12) * np.pi / 6
    around = [icosphere(3, 0.3, (10.5 * np.cos(turn), 10.5 * np.sin(turn), 0)) for turn in turns]
    mesh, volume = joined(icosphere(5, 10.0), *around), around[0].volume
    collapsed = simplification(mesh, reduction=0.99)[0].collapsed
    assert collapsed.count > 0
    assert collapsed.volume == pytest.approx(collapsed.count * volume, rel=1e-4)
    all_too_large = simplification(mesh, reduction=0.99, largest_component=0.99 * volume)[0]
    assert all_too_large.collapsed.count == 0
    assert all_too_large.mesh.components == 13
