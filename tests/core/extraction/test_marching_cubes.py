# SPDX-License-Identifier: GPL-3.0-or-later
"""Extraction against a slow oracle, closed forms, invariants and scikit-image."""

import numpy as np
import pytest
from meshes import boundary_edges, non_manifold_edges
from oracles.marching_cubes import by_edge, canonical, reference_triangles
from oracles.trilinear import grid_topology

from ctmc_addon.core import marching_cubes
from ctmc_addon.core.errors import CtmcError, SettingsError, ThresholdError, VolumeError
from ctmc_addon.core.extraction.grid import make_grid
from ctmc_addon.core.extraction.marching_cubes import extract_steps


def noise(shape, seed=0, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, 255, shape).astype(dtype)


def sphere(radius, spacing=1.0, size=None):
    """Signed distance to a sphere about the middle, positive inside, and the middle."""
    size = size or int(2 * radius / spacing) + 7
    middle = (size - 1) / 2
    return radius - spacing * np.sqrt(((np.indices((size,) * 3) - middle) ** 2).sum(axis=0)), middle


@pytest.mark.parametrize("close_border", [False, True])
@pytest.mark.parametrize("stride", [(1, 1, 1), (2, 2, 1), (3, 1, 2), (4, 5, 3)])
@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_the_fast_extraction_equals_three_loops(stride, alpha, close_border):
    values = noise((6, 7, 8), seed=sum(stride))
    mesh = marching_cubes(values, 127.5, stride, alpha, close_border)
    expected = reference_triangles(values, 127.5, stride, alpha, close_border)
    np.testing.assert_allclose(canonical(mesh.vertices[mesh.faces]), canonical(expected), atol=1.5e-3)


@pytest.mark.parametrize("shape", [(5, 30, 130), (40, 17, 64)])
def test_vertices_are_those_of_scikit_image(shape):
    measure = pytest.importorskip("skimage.measure", reason="scikit-image is not installed")
    values = noise(shape).astype(np.float32)
    peer = np.unique(measure.marching_cubes(values, 127.25, method="lorensen")[0][:, ::-1].round(4), axis=0)
    ours = marching_cubes(values, 127.25).vertices
    assert len(ours) == len(peer)
    np.testing.assert_allclose(by_edge(ours), by_edge(peer), atol=1e-4)
    scrambled = np.stack([ours[:, 0], np.roll(ours[:, 1], 1), ours[:, 2]], axis=1)
    assert np.abs(by_edge(scrambled) - by_edge(peer)).max() > 0.5


@pytest.mark.parametrize("seed", range(20))
def test_random_values_give_a_closed_manifold_surface_when_the_border_is_closed(seed):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(2, 20, 3))
    stride = tuple(int(rng.integers(1, size)) for size in shape[::-1])
    mesh = marching_cubes(noise(shape, seed), 127.5, stride, rng.random(), close_border=True)
    assert mesh.closed
    assert len(non_manifold_edges(mesh)) == 0
    assert mesh.volume > 0


@pytest.mark.parametrize("seed", range(5))
def test_an_open_surface_ends_at_the_border_and_nowhere_else(seed):
    mesh = marching_cubes(noise((9, 8, 12), seed), 127.5)
    assert len(non_manifold_edges(mesh)) == 0
    ends = mesh.vertices[boundary_edges(mesh)]  # (n, 2, 3)
    on_side = (ends == 0) | (ends == np.array([11, 7, 8]))
    assert on_side.all(axis=1).any(axis=1).all()


def test_inside_is_at_or_above_the_threshold():
    values = np.zeros((3, 3, 3), np.int16)
    values[1, 1, 1] = 100
    assert len(marching_cubes(values, 100).faces) == 8
    with pytest.raises(ThresholdError, match=r"threshold 100\.5 is above the maximum 100"):
        marching_cubes(values, 100.5)


@pytest.mark.parametrize("radius", [5.0, 12.5])
def test_a_sphere_is_closed_and_its_area_and_volume_slightly_low(radius):
    values, _ = sphere(radius, 0.5)
    mesh = marching_cubes(values, 0.0)
    area, volume = mesh.area * 0.25, mesh.volume * 0.125
    assert 0.985 * 4 * np.pi * radius**2 < area < 4 * np.pi * radius**2
    assert 0.985 * 4 / 3 * np.pi * radius**3 < volume < 4 / 3 * np.pi * radius**3
    assert mesh.euler == 2
    assert mesh.closed


def test_the_area_of_a_sphere_converges_with_the_square_of_the_voxel_side():
    errors = []
    for spacing in (1.0, 0.5, 0.25):
        values, _ = sphere(10.0, spacing)
        errors.append(1 - marching_cubes(values, 0.0).area * spacing**2 / (4 * np.pi * 100))
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert 3.5 < errors[1] / errors[2] < 4.5


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_the_result_does_not_depend_on_threads(threads):
    values = noise((70, 128, 128), seed=1)
    values[20:40] = 0
    values[:, :, :70] //= 3
    one = marching_cubes(values, 127.5, (2, 2, 1), threads=1)
    many = marching_cubes(values, 127.5, (2, 2, 1), threads=threads)
    for name in ("vertices", "faces", "normals"):
        assert getattr(one, name).tobytes() == getattr(many, name).tobytes()


@pytest.mark.parametrize(
    "dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", ">i2", ">u2", ">i4", ">f4", ">f8"]
)
def test_every_type_and_byte_order_gives_the_same_mesh(dtype):
    values = np.random.default_rng(2).integers(0, 100, (7, 9, 70))
    expected = marching_cubes(values.astype(np.float64), 50.5)
    mesh = marching_cubes(values.astype(dtype), 50.5)
    np.testing.assert_array_equal(mesh.faces, expected.faces)
    np.testing.assert_allclose(mesh.vertices, expected.vertices, atol=1e-5)
    np.testing.assert_allclose(mesh.normals, expected.normals, atol=1e-5)


@pytest.mark.parametrize(
    "layout",
    [
        np.asfortranarray,
        lambda values: values[::-1, :, ::-1].copy()[::-1, :, ::-1],
        lambda values: np.repeat(values, 3, axis=2)[:, :, ::3],
        lambda values: values.transpose(1, 2, 0).copy().transpose(2, 0, 1),
        lambda values: np.rec.fromarrays([values.astype("u1"), values], names="a,b")["b"],
    ],
)
def test_any_memory_layout_gives_the_same_mesh(layout):
    values = noise((7, 9, 12), dtype=np.int16)
    other = layout(values)
    assert (other == values).all()
    for threshold, stride in ((127.5, 1), (np.float64(127.5), (2, 2, 1))):  # NumPy 2 keeps the wider type
        mesh, expected = marching_cubes(other, threshold, stride), marching_cubes(values, 127.5, stride)
        for name in ("vertices", "faces", "normals"):
            assert getattr(mesh, name).tobytes() == getattr(expected, name).tobytes()


def test_steps_can_be_closed_at_any_moment_and_rise():
    grid = make_grid(noise((60, 64, 64)))
    total = [step.fraction for step in extract_steps(grid, 127.5)]
    assert total == sorted(total)
    assert total[-1] == 1.0
    for stop in range(1, len(total)):
        steps = extract_steps(grid, 127.5)
        for _ in range(stop):
            next(steps)
        steps.close()


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"threshold": 300}, ThresholdError, "threshold 300 .*maximum 254.*8 bit slices, not HU"),
        ({"threshold": -5}, ThresholdError, "threshold -5 is not above the minimum 0"),
        ({"threshold": float("nan")}, ThresholdError, "threshold nan"),
        ({"stride": (0, 1, 1)}, SettingsError, "stride 0 along x must be a whole number from 1 to 7"),
        ({"stride": 0}, SettingsError, "stride 0 along x must be a whole number from 1 to 7"),
        ({"stride": (2, 2)}, SettingsError, "stride takes 3 numbers, x, y and z, not 2"),
        ({"stride": (1, 1, 99)}, SettingsError, "stride 99 along z must be a whole number from 1 to 5"),
        ({"alpha": 1.5}, SettingsError, "alpha must be from 0 to 1, not 1.5"),
        ({"threads": 0}, SettingsError, "threads must be 1 or more, not 0"),
    ],
)
def test_bad_arguments_are_one_sentence(changes, error, words):
    with pytest.raises(error, match=words):
        marching_cubes(**{"values": noise((6, 7, 8)), "threshold": 127.5, **changes})


@pytest.mark.parametrize("values", [np.zeros((4, 4)), np.zeros((1, 4, 4)), np.zeros((4, 4, 4), complex)])
def test_values_that_are_no_volume_are_refused(values):
    with pytest.raises(VolumeError):
        marching_cubes(values, 0.5)


def test_nan_beside_the_surface_is_refused():
    values, _ = sphere(5.0)
    values[6, 6, :] = np.nan
    with pytest.raises(CtmcError, match="NaN"):
        marching_cubes(values, 0.0)


@pytest.mark.parametrize("topology", ["classic", "trilinear"])
@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_a_broken_voxel_is_refused_beside_the_surface_and_harmless_elsewhere(broken, topology):
    random = np.random.default_rng(5)
    refused = 0
    for _ in range(60):
        values = random.normal(size=(3, 3, 3))
        values[tuple(random.integers(0, 3, 3))] = broken
        try:
            mesh = marching_cubes(values, 0.1, topology=topology)
        except VolumeError:
            refused += 1
        else:
            assert np.isfinite(mesh.vertices).all()
            assert np.isfinite(mesh.normals).all()
    assert 0 < refused < 60


def test_values_that_are_all_nan_have_no_surface():
    with pytest.raises(ThresholdError, match="no voxel has a finite value"):
        marching_cubes(np.full((3, 3, 3), np.nan), 0.5)


@pytest.mark.parametrize("seed", range(12))
def test_the_trilinear_topology_is_closed_manifold_and_the_same_for_every_alpha_and_stride(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=tuple(rng.integers(2, 12, 3)))
    stride = tuple(int(rng.integers(1, size)) for size in values.shape[::-1])
    meshes = [
        marching_cubes(values, 0.0, stride, alpha, close_border=True, topology="trilinear") for alpha in (0.0, 0.4, 1.0)
    ]
    for mesh in meshes:
        assert mesh.closed
        assert mesh.volume > 0
        assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
        np.testing.assert_array_equal(mesh.faces, meshes[0].faces)


@pytest.mark.parametrize("seed", range(8))
def test_the_trilinear_topology_is_that_of_the_resampled_interpolant(seed):
    values = np.full((6, 6, 6), -1.0)
    values[1:-1, 1:-1, 1:-1] = np.random.default_rng(seed).uniform(-1, 1, (4, 4, 4))
    mesh = marching_cubes(values, 0.0, topology="trilinear")
    assert (mesh.euler, mesh.components) == grid_topology(values, 0.0)
