# SPDX-License-Identifier: GPL-3.0-or-later
"""Star-shaped bodies: their volume, slices and limits."""

import numpy as np
import pytest

from ctmc_addon.core.phantom.shapes import Blob, directions, grow_tumors, liver_shape, unit_vectors


def test_a_blob_without_lobes_is_an_ellipsoid():
    ball = Blob((1.0, 2.0, 3.0), (10.0, 8.0, 5.0), np.zeros((0, 3)), np.zeros(0))
    assert ball.volume_mm3() == pytest.approx(4 / 3 * np.pi * 400, rel=1e-9)
    assert ball.volume_mm3(half_height_mm=3.0) == pytest.approx(
        # From the bottom of the ball at z = -2 to the plane at 3, its middle: half of it.
        2 / 3 * np.pi * 400,
        rel=1e-9,
    )


def test_a_blob_has_the_volume_that_sampling_it_finds():
    rng = np.random.default_rng(5)
    blob = Blob((0.5, 0.0, 0.0), (10.0, 8.0, 6.0), unit_vectors(rng.normal(size=(9, 3))), rng.uniform(-0.2, 0.4, 9))
    step = 0.25
    grid = np.arange(-24, 24, step) + step / 2
    count = sum(int(blob.in_slice(grid, grid, z, step)[0].sum()) for z in grid.tolist())
    assert count * step**3 == pytest.approx(blob.volume_mm3(), rel=1e-3)
    assert blob.volume_mm3(100.0) == pytest.approx(blob.volume_mm3(), rel=1e-6)


def test_a_slice_of_a_blob_holds_the_points_the_definition_holds():
    rng = np.random.default_rng(6)
    blob = Blob((1.0, -2.0, 3.0), (9.0, 7.0, 5.0), unit_vectors(rng.normal(size=(5, 3))), rng.uniform(-0.3, 0.5, 5))
    x, y, z = np.linspace(-15, 15, 41), np.linspace(-15, 12, 37), 2.25
    rows, columns = np.meshgrid(y, x, indexing="ij")
    points = np.stack([columns.ravel(), rows.ravel(), np.full(rows.size, z)], axis=1)
    offset = (points - blob.center) / blob.half_axes
    length = np.linalg.norm(offset, axis=1)
    rise = ((1 + (offset / length[:, None]) @ blob.lobes.T) / 2) ** 8
    expected = length < 1 + rise @ blob.heights
    assert (blob.in_slice(x, y, z, 2.0)[0].ravel() == expected).all()
    assert (blob.inside(points) == expected).all()


def test_the_shares_of_a_thick_slice_of_a_ball_are_those_of_its_chords():
    ball = Blob((0.0, 0.0, 1.0), (12.0, 12.0, 12.0), np.zeros((0, 3)), np.zeros(0))
    across = np.arange(-14.0, 15.0)
    half = np.sqrt(np.maximum(144 - across**2 - across[:, None] ** 2, 0))  # of the chord along z
    for z in (-12.5, -7.5, -2.5, 2.5, 7.5, 12.5):
        chord = np.clip(1 + half, z - 2.5, z + 2.5) - np.clip(1 - half, z - 2.5, z + 2.5)
        share = ball.in_slice(across, across, z, 5.0)[1]
        assert share[14, 14] == pytest.approx(chord[14, 14] / 5, abs=1e-12)  # depth is linear along the axis
        assert share == pytest.approx(chord / 5, abs=0.15)  # most at grazing columns
        assert share.sum() == pytest.approx(chord.sum() / 5, rel=3e-3)


def test_thick_slices_share_out_the_volume_of_a_body():
    rng = np.random.default_rng(5)
    blob = Blob((0.5, 0.0, 0.0), (30.0, 24.0, 18.0), unit_vectors(rng.normal(size=(9, 3))), rng.uniform(-0.2, 0.4, 9))
    across, heights = np.arange(-70.0, 71.0), np.arange(-60.0, 61.0, 5.0)
    slices = [blob.in_slice(across, across, z, 5.0) for z in heights.tolist()]
    assert 5 * sum(share.sum() for _, share in slices) == pytest.approx(blob.volume_mm3(), rel=1e-3)


def test_no_direction_lies_outside_the_limits_of_a_blob():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        liver = liver_shape(rng, 1.0, 5.0)
        axes = [(np.arange(n) - (n - 1) / 2) * gap for n, gap in ((512, 0.74), (512, 0.74), (29, 5.0))]
        for shape in [liver, *grow_tumors(rng, liver, 1.0, (0.74, 0.74, 5.0), axes)]:
            radii = shape.radius(*unit_vectors(rng.normal(size=(20000, 3))).T)
            assert shape.limits[0] < radii.min()
            assert radii.max() < shape.limits[1]


def test_the_rule_on_the_sphere_integrates_a_polynomial_exactly():
    unit, weights = directions()
    assert weights.sum() == pytest.approx(4 * np.pi)
    assert (weights * unit[:, 0] ** 8 * unit[:, 2] ** 16).sum() == pytest.approx(
        # 4 pi (8-1)!! (16-1)!! / (24+1)!!
        4 * np.pi * 105 * 2027025 / 7905853580625,
        rel=1e-5,
    )
