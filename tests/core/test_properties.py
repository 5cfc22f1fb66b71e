# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties that hold for every volume: hypothesis draws small ones, the same at every run."""

from __future__ import annotations

import numpy as np
import pytest

hypothesis = pytest.importorskip("hypothesis", reason="the Python package hypothesis is not installed")
from hypothesis import HealthCheck, Phase, given, settings, strategies as st

from ctmc_addon.core import Budget, ReconstructionSettings, Volume, reconstruct, reconstruct_labels

# A failure is shown as it was drawn: a smaller one takes minutes to find.
DRAWN = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=20,
    phases=[Phase.generate],
    suppress_health_check=[HealthCheck.too_slow],
)
SEEDS = st.integers(0, 2**32 - 1)
SIDES = st.integers(4, 9)
SHAPES = st.tuples(SIDES, SIDES, SIDES)


def waves_of(shape, seed):
    """Smooth values around 0 without one at exactly 0; those in the middle are positive."""
    random = np.random.default_rng(seed)
    z, y, x = np.indices(shape)
    values = sum(
        random.normal() * np.sin(random.uniform(0.3, 1.5, 3) @ np.array([z.ravel(), y.ravel(), x.ravel()]) + turn)
        for turn in random.uniform(0, 6, 4)
    ).reshape(shape)
    values[tuple(n // 2 for n in shape)] = 3.0
    return (values + 1e-3).astype(np.float32)


def turned(seed):
    """A 3 x 3 matrix with columns of 0.2 to 5 mm in any orientation, sheared a little, mirrored or not."""
    random = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    shear = np.eye(3) + np.triu(random.uniform(-0.4, 0.4, (3, 3)), 1)
    return rotation @ shear @ np.diag(random.uniform(0.2, 5.0, 3))


def triangles_of(mesh):
    """Rounded corners of every triangle, the first one lowest; sorted, so that meshes of any order compare."""
    corners = np.round(mesh.vertices[mesh.faces].astype(np.float64), 4) + 0.0  # (f, 3, 3)
    return sorted(min(tuple(map(tuple, np.roll(face, turn, axis=0))) for turn in range(3)) for face in corners)


@DRAWN
@given(SHAPES, SEEDS, SEEDS, st.floats(0.0, 1.0), st.sampled_from(["classic", "trilinear"]))
def test_an_affine_carries_the_surface_and_keeps_its_outside(shape, seed, turn, alpha, topology):
    matrix, values = turned(turn), waves_of(shape, seed)
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = matrix, np.random.default_rng(turn).uniform(-500, 500, 3)
    chosen = ReconstructionSettings(threshold=0.0, alpha=alpha, topology=topology, close_border=True)
    plain, carried = (reconstruct(Volume(values, space), chosen).mesh for space in (np.eye(4), affine))
    expected = plain.vertices.astype(np.float64) @ matrix.T + affine[:3, 3]
    np.testing.assert_allclose(carried.vertices, expected, atol=3e-4)
    determinant = np.linalg.det(matrix)
    assert (carried.faces == (plain.faces if determinant > 0 else plain.faces[:, ::-1])).all()
    assert carried.closed
    assert plain.volume > 0
    assert carried.volume == pytest.approx(plain.volume * abs(determinant), rel=1e-3)


@DRAWN
@given(SHAPES, SEEDS, st.data())
def test_a_region_has_the_triangles_of_the_whole_surface_that_lie_in_it(shape, seed, data):
    values = waves_of(shape, seed)
    sizes = shape[::-1]
    lows = [data.draw(st.integers(0, size - 2)) for size in sizes]
    highs = [data.draw(st.integers(low + 1, size - 1)) for low, size in zip(lows, sizes, strict=True)]
    box = values[tuple(slice(low, high + 1) for low, high in zip(lows[::-1], highs[::-1], strict=True))]
    if (box > 0).all() or (box < 0).all():
        return
    volume, region = Volume(values, np.eye(4)), (*lows, *highs)
    whole = reconstruct(volume, ReconstructionSettings(threshold=0.0)).mesh
    part = reconstruct(volume, ReconstructionSettings(threshold=0.0, region=region)).mesh
    centers = whole.vertices[whole.faces].mean(axis=1)
    within = ((centers > lows) & (centers < highs)).all(axis=1)
    chosen = type(whole)(whole.vertices, whole.faces[within])
    assert triangles_of(part) == triangles_of(chosen)
    capped = reconstruct(volume, ReconstructionSettings(threshold=0.0, region=region, close_border=True)).mesh
    assert capped.closed
    assert capped.volume > 0


@DRAWN
@given(st.tuples(*[st.integers(2, 5)] * 3), st.tuples(*[st.integers(1, 3)] * 3), SEEDS)
def test_a_stride_cuts_the_volume_of_the_samples_that_it_visits(voxels, stride, seed):
    """The samples between them change nothing."""
    shape = tuple(count * step + 1 for count, step in zip(voxels, stride[::-1], strict=True))
    visited = waves_of([count + 1 for count in voxels], seed)
    values = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
    values[:: stride[2], :: stride[1], :: stride[0]] = visited
    chosen = {"threshold": 0.0, "normals": "mesh"}
    wide = reconstruct(Volume(values, np.eye(4)), ReconstructionSettings(**chosen, stride=stride))
    plain = reconstruct(Volume(visited, np.diag([*stride, 1.0])), ReconstructionSettings(**chosen))
    assert wide.voxels_visited == plain.voxels_visited == np.prod(voxels)
    assert wide.mesh.faces.tobytes() == plain.mesh.faces.tobytes()
    np.testing.assert_allclose(wide.mesh.vertices, plain.mesh.vertices, atol=1e-5)


def labels_of(shape, seed):
    """Samples of 0 to 3 in a frame of 0: noise, or blocks of two samples."""
    random = np.random.default_rng(seed)
    block = int(random.integers(1, 3))
    values = random.integers(0, 4, shape).repeat(block, 0).repeat(block, 1).repeat(block, 2)
    return np.pad(values[tuple(slice(n) for n in shape)], 1).astype(np.uint8)


def directed(mesh):
    """Each triangle's corners as bytes, from the lowest one on, and those of the same triangle from behind."""
    corners = [[point.tobytes() for point in face] for face in mesh.vertices[mesh.faces]]
    ways = [min(face[turn:] + face[:turn] for turn in range(3)) for face in corners]
    return [tuple(face) for face in ways], [(first, third, second) for first, second, third in ways]


@settings(DRAWN, max_examples=12)
@given(st.tuples(*[st.integers(2, 5)] * 3), SEEDS, st.sampled_from(["none", "constrained"]))
def test_labels_are_closed_keep_their_samples_and_share_their_walls(shape, seed, smoothing):
    values = labels_of(shape, seed)
    affine = np.eye(4)
    affine[:3, :3] = turned(seed)
    volume = Volume(values, affine, kind="label")
    chosen = ReconstructionSettings(smoothing=smoothing)
    found = reconstruct_labels(volume, chosen, budget=Budget(threads=1)).surfaces
    again = reconstruct_labels(volume, chosen, budget=Budget(threads=2)).surfaces
    fronts, backs = {}, {}
    for result, other in zip(found, again, strict=True):
        label, mesh = result.settings.label, result.mesh
        assert mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
        assert mesh.faces.tobytes() == other.mesh.faces.tobytes()
        assert mesh.closed  # every edge has two triangles, which run through it in opposite ways
        assert mesh.volume > 0
        assert (enclosed_samples(mesh, affine, values.shape) == (values == label)).all()
        fronts[label], backs[label] = directed(mesh)
        assert len(set(fronts[label])) == len(fronts[label])
    assert set(fronts) == set(np.unique(values)) - {0}
    for label, behind in backs.items():
        for other in fronts.keys() - {label}:
            assert not set(fronts[label]) & set(fronts[other])
            assert bool(set(behind) & set(fronts[other])) >= touch(values, label, other)


def enclosed_samples(mesh, affine, shape):
    """Which samples of a grid a closed mesh winds around, by the solid angles of its triangles.

    van Oosterom and Strackee 1983, doi:10.1109/TBME.1983.325207.
    """
    samples = np.argwhere(np.ones(shape))[:, ::-1] @ affine[:3, :3].T + affine[:3, 3]  # (n, 3)
    corners = mesh.vertices[mesh.faces].astype(np.float64)  # (f, 3, 3)
    a, b, c = np.moveaxis(corners - samples[:, None, None], 2, 0)  # (n, f, 3) each
    far_a, far_b, far_c = (np.sqrt(np.einsum("nfx,nfx->nf", way, way)) for way in (a, b, c))
    between = np.einsum("nfx,nfx->nf", a, b) * far_c + np.einsum("nfx,nfx->nf", b, c) * far_a
    between += np.einsum("nfx,nfx->nf", c, a) * far_b + far_a * far_b * far_c
    angles = 2 * np.arctan2(np.einsum("nfx,nfx->nf", a, np.cross(b, c)), between)  # (n, f)
    turns = angles.sum(axis=1) / (4 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)
    return (np.round(turns) == 1).reshape(shape)


def touch(values, label, other):
    """Whether two labels have samples that are neighbors along an axis."""
    pairs = [np.stack([np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]]) for axis in range(3)]
    return any(((low == label) & (high == other) | (low == other) & (high == label)).any() for low, high in pairs)
