# SPDX-License-Identifier: GPL-3.0-or-later
"""The one estimator of distances between surfaces, against closed forms and every triangle in turn."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import (
    ReconstructionSettings,
    TriangleMesh,
    distances,
    finish,
    marching_cubes,
    reconstruct,
    specks_text,
)
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh import (
    LostComponents,
    ReferenceSurface,
    SurfaceDistance,
    surface_distance,
    surface_distance_steps,
    vertex_distances_steps,
)
from ctmc_addon.core.mesh.quality import surface_samples_steps
from ctmc_addon.readers import read_volume


def moved(mesh, by):
    return TriangleMesh((mesh.vertices + np.asarray(by, np.float32)).astype(np.float32), mesh.faces)


def ball(radius, rings=24, sides=48):
    up, around = np.meshgrid(np.linspace(0, np.pi, rings), np.arange(sides) * 2 * np.pi / sides, indexing="ij")
    points = np.stack([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)], -1).reshape(-1, 3)
    number = np.arange(rings * sides).reshape(rings, sides)
    a, b = number[:-1], number[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return TriangleMesh((radius * points).astype(np.float32), faces.astype(np.int32))


def rough(seed, stride=1):
    values = np.random.default_rng(seed).normal(size=(12, 13, 14)).astype(np.float32)
    return marching_cubes(values, 0.3, stride)


def test_the_same_surface_is_at_no_distance():
    mesh = rough(1)
    assert surface_distance(mesh, mesh) == SurfaceDistance()
    rolled = TriangleMesh(mesh.vertices, np.roll(mesh.faces, 1, axis=1))
    assert surface_distance(rolled, mesh).largest < 1e-12


def test_balls_of_10_and_11_mm_are_a_millimeter_apart_both_ways():
    apart = surface_distance(ball(11), ball(10))
    assert apart.mean == pytest.approx(1, abs=0.02)
    assert apart.percentile_95 == pytest.approx(1, abs=0.06)
    assert apart.largest == pytest.approx(1, abs=0.06)
    back = surface_distance(ball(10), ball(11))
    assert (back.mean, back.percentile_95, back.largest) == pytest.approx(
        (apart.mean, apart.percentile_95, apart.largest), abs=1e-12
    )


def test_the_numbers_are_those_of_all_samples_and_vertices():
    mesh, reference = rough(2), rough(2, stride=2)  # fewer components, so none is lost
    there, back = (
        distances(finish(surface_samples_steps(mesh)), reference),
        distances(finish(surface_samples_steps(reference)), mesh),
    )
    at_vertices = max(distances(mesh.vertices, reference).max(), distances(reference.vertices, mesh).max())
    apart = surface_distance(mesh, reference)
    assert apart.mean == pytest.approx((there.mean() + back.mean()) / 2, rel=1e-12)
    assert apart.percentile_95 == pytest.approx(max(np.percentile(there, 95), np.percentile(back, 95)), rel=1e-12)
    assert apart.largest == pytest.approx(max(there.max(), back.max(), at_vertices), rel=1e-12)
    assert apart.to_full.mean == pytest.approx(there.mean(), rel=1e-12)
    assert apart.from_full.percentile_95 == pytest.approx(np.percentile(back, 95), rel=1e-12)


def joined(*meshes):
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return TriangleMesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces).astype(np.int32))


def test_a_lost_speck_is_named_and_not_the_largest_distance():
    speck = moved(ball(0.4), [46, 0, 0])
    apart = surface_distance(ball(10.5), joined(ball(10), speck))
    assert apart.to_full.largest == pytest.approx(0.5, abs=0.03)
    assert apart.from_full.largest == pytest.approx(0.5, abs=0.03)
    assert apart.largest < 0.6
    assert apart.lost.count == 1
    assert apart.lost.volume == pytest.approx(4 / 3 * np.pi * 0.4**3, rel=0.02)
    assert apart.lost.largest == pytest.approx(46.4 - 10.5, abs=0.05)
    both = surface_distance(joined(moved(ball(0.3), [46, 0, 0]), ball(10.5)), joined(ball(10), speck))
    assert both.lost == LostComponents()
    assert both.largest == pytest.approx(0.5, abs=0.03)


def test_a_lost_cavity_is_a_lost_component():
    cavity = ball(4)
    cavity = TriangleMesh(cavity.vertices, np.ascontiguousarray(cavity.faces[:, ::-1]))
    apart = surface_distance(ball(10), joined(cavity, ball(10)))
    assert (apart.lost.count, apart.largest) == (1, pytest.approx(0, abs=1e-9))
    assert apart.lost.volume == pytest.approx(4 / 3 * np.pi * 4**3, rel=0.02)
    assert apart.lost.largest == pytest.approx(6, abs=0.1)


def test_the_two_ways_are_told_apart():
    plate = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]], np.float32)
    half = plate * np.float32([0.5, 1, 1])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    apart = surface_distance(TriangleMesh(half, faces), TriangleMesh(plate, faces))
    assert apart.to_full.largest == 0.0
    assert (apart.from_full.largest, apart.from_full.percentile_95) == pytest.approx((5.0, 4.5), abs=0.03)


def test_the_largest_is_found_at_a_vertex_that_hardly_any_sample_is_near():
    low = ball(10)
    vertices = low.vertices.copy()
    vertices[600] *= 1.5
    assert surface_distance(TriangleMesh(vertices, low.faces), low).largest == pytest.approx(5, abs=0.02)


@pytest.mark.parametrize("middle", [0.0, 4096.0])
def test_a_surface_far_from_the_origin_is_measured_as_well(middle):
    mesh = moved(ball(10), [middle, -middle, middle])
    assert surface_distance(moved(mesh, [0, 0, 0.25]), mesh).largest == pytest.approx(0.25, abs=2e-3)


def test_the_distance_does_not_depend_on_threads_or_on_what_was_measured_before():
    first, second, reference = rough(3, 2), rough(4), ReferenceSurface(rough(3))
    expected = surface_distance(second, reference.mesh)
    finish(surface_distance_steps(first, reference))
    for threads in (1, 3):
        assert finish(surface_distance_steps(second, reference, threads)) == expected


def test_a_map_has_the_distance_of_every_vertex_in_its_order():
    mesh, reference = rough(5, 3), rough(5)
    found = finish(vertex_distances_steps(mesh, ReferenceSurface(reference)))
    np.testing.assert_array_equal(found, distances(mesh.vertices, reference))


def test_a_surface_without_triangles_is_refused():
    empty = TriangleMesh(ball(10).vertices, np.empty((0, 3), np.int32))
    for pair in ((ball(10), empty), (empty, ball(10))):
        with pytest.raises(MeshError):
            surface_distance(*pair)


@pytest.mark.once
def test_steps_rise_and_can_be_closed_anywhere():
    mesh, reference = rough(6, 2), rough(6)
    fractions = [step.fraction for step in surface_distance_steps(mesh, ReferenceSurface(reference))]
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0)
    for stop in range(1, len(fractions), 7):
        steps = surface_distance_steps(mesh, ReferenceSurface(reference))
        assert len(list(itertools.islice(steps, stop))) == stop
        steps.close()


@pytest.mark.once
def test_specks_of_bone_that_simplification_removed_are_told_apart_from_the_distance(real):
    volume = read_volume(real("ircadb01_abdomen"))
    settings = ReconstructionSettings(threshold=200.0, stride=(2, 2, 1))
    full, small = (reconstruct(volume, replace(settings, reduction=share)) for share in (None, 0.9))
    apart = surface_distance(small.mesh, full.mesh)
    assert apart.lost.count == small.collapsed_components > 1000
    assert apart.lost.volume == pytest.approx(small.collapsed_mm3, rel=1e-9)
    assert apart.lost.largest > 10
    assert specks_text(apart.lost.count, apart.lost.volume) in small.notes
    assert apart.to_full.largest < 2
    assert apart.from_full.largest < apart.lost.largest
    assert apart.from_full.percentile_95 < 1
