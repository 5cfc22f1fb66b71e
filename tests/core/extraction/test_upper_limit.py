# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces about the values between two limits: shells in closed form, every case of both limits in one voxel."""

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, SettingsError, Volume, finish, reconstruct
from ctmc_addon.core.errors import ThresholdError
from ctmc_addon.core.extraction import count_steps, make_grid, marching_cubes


def distances(size=40):
    """Distance from the middle, (size, size, size) float32."""
    z, y, x = np.indices((size,) * 3) - (size - 1) / 2
    return np.sqrt(x**2 + y**2 + z**2).astype(np.float32)


@pytest.mark.parametrize("topology", ["classic", "trilinear"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int16])
def test_a_shell_has_the_volume_between_two_spheres_and_normals_out_of_it(topology, dtype):
    values = (distances() * 100).astype(dtype)
    mesh = marching_cubes(values, 800, upper=1600, topology=topology)
    exact = 4 / 3 * np.pi * (16**3 - 8**3)
    assert mesh.closed
    assert (mesh.components, mesh.euler) == (2, 4)
    assert mesh.volume == pytest.approx(exact, rel=0.01)
    from_middle = mesh.vertices - 19.5
    radius = np.linalg.norm(from_middle, axis=1)
    outer = radius > 12
    assert np.abs(radius[outer] - 16).max() < 0.02
    assert np.abs(radius[~outer] - 8).max() < 0.03
    along = (mesh.normals * from_middle).sum(axis=1) / radius
    assert along[outer].min() > 0.99
    assert along[~outer].max() < -0.98


@pytest.mark.parametrize("topology", ["classic", "trilinear"])
@pytest.mark.parametrize("close_border", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_noise_that_jumps_over_both_limits_gives_a_closed_manifold(topology, close_border, seed):
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 9, (7, 8, 9)).astype(np.uint8)
    if not close_border:
        values[[0, -1]], values[:, [0, -1]], values[:, :, [0, -1]] = 0, 8, 0
    mesh = marching_cubes(values, 3, upper=5, topology=topology, close_border=close_border)
    assert mesh.closed
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    assert (uses == 2).all()
    assert mesh.volume > 0


def test_a_limit_is_inside_on_both_sides_whatever_the_type():
    row = np.arange(12)
    for dtype in (np.uint8, np.int16, np.int64, np.float32, np.float64):
        values = np.broadcast_to(row, (3, 3, 12)).astype(dtype)
        for low, high, first, last in ((3, 7, 3, 7), (2.5, 7.5, 3, 7), (3, 6.9999999, 3, 6), (-5, 4, 0, 4)):
            mesh = marching_cubes(values, low, upper=high, normals=False, alpha=0)
            ends = {first - 0.5, last + 0.5} - {-0.5}
            assert set(mesh.vertices[:, 0].tolist()) == ends


def test_an_upper_limit_above_all_values_changes_nothing():
    values = distances(16)
    plain, limited = marching_cubes(values, 4.2), marching_cubes(values, 4.2, upper=1e9)
    for name in ("vertices", "faces", "normals"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(limited, name))


@pytest.mark.parametrize("stride", [(1, 1, 1), (2, 2, 1), (5, 3, 2)])
def test_samples_between_the_limits_are_what_a_mask_of_them_has(stride):
    values = np.random.default_rng(1).integers(-50, 50, (9, 20, 70)).astype(np.int16)
    inside = (values >= -10) & (values <= 12)
    limited = finish(count_steps(make_grid(values, stride, upper=12.0), -10.0))
    masked = finish(count_steps(make_grid(inside, stride), 0.5))
    assert limited == masked


def test_lung_of_a_pipeline_is_said_in_settings_and_measured():
    volume = Volume((distances() * -50).astype(np.int16), np.diag([0.5, 0.5, 0.5, 1.0]), kind="HU")
    result = reconstruct(volume, ReconstructionSettings(threshold=-800, upper=-400))
    assert result.report()["settings"]["upper"] == -400
    assert result.mesh.volume == pytest.approx(4 / 3 * np.pi * (8**3 - 4**3), rel=0.01)


def test_limits_that_contradict_each_other_or_the_values_are_refused():
    volume = Volume(distances(12), np.eye(4))
    with pytest.raises(SettingsError, match="upper 3 is below threshold 5"):
        ReconstructionSettings(threshold=5, upper=3)
    with pytest.raises(SettingsError, match="upper 3 and label 1 cannot be set together"):
        ReconstructionSettings(label=1, upper=3)
    with pytest.raises(ThresholdError, match=r"upper limit 0\.1 is below the minimum"):
        reconstruct(volume, ReconstructionSettings(threshold=0, upper=0.1))
    with pytest.raises(ThresholdError, match="upper limit 99 is at or above the maximum"):
        reconstruct(volume, ReconstructionSettings(threshold=0, upper=99))
    with pytest.raises(ThresholdError, match="is above the upper limit 2"):
        reconstruct(volume, ReconstructionSettings(upper=2))
