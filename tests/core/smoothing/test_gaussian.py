# SPDX-License-Identifier: GPL-3.0-or-later
import math

import numpy as np
import pytest

from ctmc_addon.core import Budget, finish
from ctmc_addon.core.smoothing.gaussian import weights
from ctmc_addon.core.smoothing.methods.gaussian import GaussianValues
from ctmc_addon.core.volume.field_values import HeldValues


def gaussian_smoothed(values, spacing, sigma_mm, threads=1):
    """All slices, a few at a time."""
    held = HeldValues(values)
    smooth = GaussianValues(held, spacing, sigma_mm, None, 0.5, Budget(threads))
    starts = range(0, len(values), 4)
    return np.concatenate([finish(smooth.slices_steps(range(at, min(at + 4, len(values))))) for at in starts])


def direct(values, spacing, smoothing_mm):
    """Three loops over clamped samples, float64."""
    out = values.astype(np.float64)
    for axis, gap in zip((2, 1, 0), spacing, strict=True):
        sigma = smoothing_mm / gap
        reach = int(4 * sigma + 0.5)
        taps = [math.exp(-0.5 * (at / sigma) ** 2) for at in range(-reach, reach + 1)]
        count = out.shape[axis]
        total = np.zeros_like(out)
        for at, tap in zip(range(-reach, reach + 1), taps, strict=True):
            total += tap / sum(taps) * np.take(out, np.clip(np.arange(count) + at, 0, count - 1), axis)
        out = total
    return out


@pytest.mark.parametrize("dtype", [bool, np.uint8, ">i2", np.float64])
@pytest.mark.parametrize(
    ("spacing", "smoothing_mm"), [((0.7, 0.9, 5.0), 1.5), ((1.0, 1.0, 1.0), 2.0), ((4.0, 2.0, 0.5), 3.0)]
)
def test_softening_equals_the_direct_sums(dtype, spacing, smoothing_mm):
    values = (np.random.default_rng(1).random((9, 14, 23)) * 200).astype(np.uint8).astype(dtype)
    softened = gaussian_smoothed(values, spacing, smoothing_mm)
    assert softened.dtype == np.float32
    np.testing.assert_allclose(softened, direct(values, spacing, smoothing_mm), atol=2e-4)


def test_softening_equals_scipy():
    ndimage = pytest.importorskip("scipy.ndimage", reason="SciPy is not installed")
    values = np.random.default_rng(2).random((20, 40, 30), np.float32)
    expected = ndimage.gaussian_filter(values.astype(np.float64), (0.5, 2.0, 4.0), mode="nearest", truncate=4.0)
    np.testing.assert_allclose(gaussian_smoothed(values, (0.5, 1.0, 4.0), 2.0), expected, atol=1e-6)


def test_a_constant_stays_and_a_label_keeps_its_mass():
    assert np.abs(gaussian_smoothed(np.full((5, 9, 9), 100, np.int16), (1.0, 1.0, 1.0), 3.0) - 100).max() < 1e-4
    label = np.zeros((40, 40, 40), np.uint8)
    label[18:22, 15:25, 17:20] = 1
    assert gaussian_smoothed(label, (1.0, 1.0, 2.0), 2.0).sum(dtype=np.float64) == pytest.approx(120, rel=1e-5)


def test_no_softening_gives_the_values_themselves():
    values = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    assert (gaussian_smoothed(values, (1.0, 1.0, 1.0), 0.0) == values).all()


def test_threads_and_memory_layout_do_not_change_a_bit():
    values = np.random.default_rng(3).random((31, 37, 29), np.float32)
    one = gaussian_smoothed(values, (0.8, 0.9, 2.0), 1.7)
    for threads in (2, 7):
        assert gaussian_smoothed(values, (0.8, 0.9, 2.0), 1.7, threads).tobytes() == one.tobytes()
    assert gaussian_smoothed(np.asfortranarray(values), (0.8, 0.9, 2.0), 1.7, 2).tobytes() == one.tobytes()


def test_a_mirrored_volume_softens_to_the_mirror_image():
    values = np.random.default_rng(4).random((9, 11, 13), np.float32)
    flipped = gaussian_smoothed(values[::-1, ::-1, ::-1], (1.0, 1.0, 1.0), 1.5)
    assert (flipped[::-1, ::-1, ::-1] == gaussian_smoothed(values, (1.0, 1.0, 1.0), 1.5)).all()


def test_weights_add_up_to_one_and_reach_four_sigma():
    for sigma in (0.3, 1.0, 7.3):
        taps = weights(sigma)
        assert len(taps) == int(4 * sigma + 0.5) + 1
        assert float(taps[0]) + 2 * sum(map(float, taps[1:])) == pytest.approx(1, abs=1e-7)
    assert weights(0.1) == [1.0]
