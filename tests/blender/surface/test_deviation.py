import numpy as np
import pytest

pytest.importorskip("bpy")

from ctmc_addon.blender.surface.deviation import Deviation, Reference, deviation
from ctmc_addon.core import TriangleMesh, distances, finish
from ctmc_addon.core.errors import MeshError


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


def test_the_same_surface_is_at_no_distance(torus):
    mesh = torus().mesh
    assert deviation(mesh, mesh) == Deviation(0.0, 0.0)
    turned = TriangleMesh(mesh.vertices, np.roll(mesh.faces, 1, axis=1))
    apart = deviation(turned, mesh)
    assert 0 <= apart.mean < 1e-5
    assert apart.maximum < 1e-4


def test_balls_of_10_and_11_mm_are_a_millimetre_apart_both_ways():
    apart = deviation(ball(11), ball(10))
    assert apart.mean == pytest.approx(1, abs=0.02)
    assert apart.maximum == pytest.approx(1, abs=0.06)
    back = deviation(ball(10), ball(11))
    assert (back.mean, back.maximum) == pytest.approx((apart.mean, apart.maximum), abs=1e-6)


def test_the_maximum_is_found_at_a_vertex_that_no_sample_meets():
    low = ball(10)
    vertices = low.vertices.copy()
    vertices[600] *= 1.5
    assert deviation(TriangleMesh(vertices, low.faces), low, samples=10).maximum == pytest.approx(5, abs=0.02)


def test_a_surface_far_from_the_scene_s_origin_is_measured_as_well(torus):
    near, far = torus(centre_mm=np.zeros(3)).mesh, torus(centre_mm=np.array([4096.0, -4096.0, 4096.0])).mesh
    for mesh in (near, far):
        assert deviation(moved(mesh, [0, 0, 0.25]), mesh).maximum == pytest.approx(0.25, abs=2e-3)


def test_blender_s_tree_agrees_with_the_exact_distance(torus):
    mesh = torus().mesh
    points = mesh.vertices[0] + np.random.default_rng(5).normal(0, 30, (500, 3))
    np.testing.assert_allclose(finish(Reference(mesh).distances_steps(points)), distances(points, mesh), atol=5e-5)


def test_a_surface_without_triangles_is_refused(torus):
    mesh = torus().mesh
    with pytest.raises(MeshError, match="no distance"):
        deviation(mesh, TriangleMesh(mesh.vertices, mesh.faces[:0]))
