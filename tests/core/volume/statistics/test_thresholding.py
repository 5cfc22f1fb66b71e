# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest

from ctmc_addon.core import (
    FieldCache,
    Preview,
    ReconstructionSettings,
    Volume,
    cost_estimate_steps,
    finish,
    reconstruct,
)
from ctmc_addon.core.errors import ThresholdError
from ctmc_addon.core.volume import volume_statistics_steps
from ctmc_addon.core.volume.statistics import thresholding
from ctmc_addon.core.volume.statistics.thresholding import otsu, quick_threshold, used_threshold_steps
from ctmc_addon.core.volume.statistics.values import value_range


def brute(values):
    """The variance between the classes at every half-integer; the middle of the best ones."""
    cuts = np.arange(values.min(), values.max()) + 0.5
    apart = []
    for cut in cuts:
        low, high = values[values < cut].astype(float), values[values >= cut].astype(float)
        apart.append(low.size * high.size * (high.mean() - low.mean()) ** 2)
    best = cuts[np.isclose(apart, max(apart), rtol=1e-12)]
    return best.mean()


def two_tissues(dtype, shape=(20, 30, 30), seed=0):
    chance = np.random.default_rng(seed)
    values = np.where(chance.random(shape) < 0.3, chance.normal(120, 12, shape), chance.normal(40, 15, shape))
    return np.clip(np.rint(values), 0, 250).astype(dtype)


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, ">u2", np.int32, np.int64])
def test_otsu_equals_the_brute_force_search(dtype):
    values = two_tissues(dtype)
    assert otsu(values) == brute(values)


def test_otsu_of_floats_lies_within_a_bin_of_that_of_integers():
    values = two_tissues(np.int16)
    width = (int(values.max()) - int(values.min())) / 1024
    assert abs(otsu(values.astype(np.float32)) - otsu(values)) <= 0.5 + width
    assert otsu(values.astype(np.float64)) == otsu(values.astype(">f4"))


def test_otsu_equals_scikit_image():
    filters = pytest.importorskip("skimage.filters", reason="scikit-image is not installed")
    values = two_tissues(np.int16, seed=4)
    assert otsu(values) == filters.threshold_otsu(values) + 0.5


def test_two_values_are_parted_half_way():
    values = np.zeros((4, 4, 4), np.uint8)
    values[1] = 200
    assert otsu(values) == 100.0
    assert otsu(values > 0) == 0.5


def test_a_padding_value_does_not_move_the_threshold():
    values = two_tissues(np.int16)
    padded = np.concatenate([values, np.full((30, 30, 30), -2000, np.int16)])
    assert otsu(padded) == otsu(values)
    assert otsu(np.concatenate([values, np.full((30, 30, 30), 30000, np.int16)])) == otsu(values)


def test_nan_and_infinity_are_left_out():
    values = two_tissues(np.float32)
    broken = np.concatenate(
        [values, np.full((1, 30, 30), np.nan, np.float32), np.full((1, 30, 30), np.inf, np.float32)]
    )
    assert otsu(broken) == otsu(values)
    assert value_range(broken) == value_range(values)


def test_a_wide_spread_of_integers_is_binned():
    values = two_tissues(np.int64) * 10**12
    assert otsu(values) == pytest.approx(otsu(two_tissues(np.int16)) * 1e12, rel=0.02)


def test_the_range_is_that_of_all_slabs():
    values = np.zeros((5, 1100, 1000), np.int8)
    values[0, 0, 0], values[4, -1, -1] = -128, 127
    assert value_range(values) == (-128.0, 127.0)
    assert np.isnan(value_range(np.full((2, 2, 2), np.nan))).all()


@pytest.mark.parametrize("value", [0, -7])
def test_a_volume_of_one_value_has_no_threshold(value):
    with pytest.raises(ThresholdError, match=f"are {value}; there is no surface"):
        otsu(np.full((3, 3, 3), value, np.int16))
    with pytest.raises(ThresholdError, match=f"are {value}; there is no surface"):
        otsu(np.full((3, 3, 3), value, np.float32))
    with pytest.raises(ThresholdError, match="no finite value"):
        otsu(np.full((3, 3, 3), np.nan))


REGION = (0.0, 0.0, 0.0, 19.0, 19.0, 8.0)


@pytest.fixture
def two_scales():
    """A box of 100 in 0 in the lower half, one of 1000 in the upper; Otsu's is 550 of all and 50 of the lower half."""
    values = np.zeros((20, 20, 20), np.int16)
    values[2:7, 5:15, 5:15] = 100
    values[12:17, 5:15, 5:15] = 1000
    return Volume(values, np.eye(4))


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, 550.0),
        ({"region": REGION}, 50.0),
        ({"region": REGION, "region_unit": "mm"}, 50.0),
        ({"threshold": 20.0, "region": REGION}, 20.0),
        ({"label": 100, "region": REGION}, 0.5),
    ],
)
def test_all_use_the_same_threshold(two_scales, settings, expected):
    settings = ReconstructionSettings(**settings)
    assert finish(used_threshold_steps(two_scales, settings)) == expected
    assert quick_threshold(two_scales, settings) == expected
    assert reconstruct(two_scales, settings).threshold == expected
    preview, cache = Preview(two_scales, 10.0), FieldCache(two_scales)
    assert preview.interactive(settings) is not None
    assert preview.threshold == expected
    finish(cost_estimate_steps(cache, settings))
    assert cache.field.threshold == expected


def test_a_large_region_is_looked_through_once_and_not_while_a_slider_moves(two_scales, monkeypatch):
    settings = ReconstructionSettings(region=REGION)
    preview = Preview(two_scales, 10.0)
    assert preview.interactive(ReconstructionSettings()) is not None
    monkeypatch.setattr(thresholding, "QUICK_VALUES", 1)
    assert quick_threshold(two_scales, settings) is None
    preview.interactive(settings)
    assert preview.threshold == 550.0  # that of the last surface
    finish(preview.refine_steps(settings))
    assert preview.threshold == quick_threshold(two_scales, settings) == 50.0


def test_a_slider_does_not_wait_for_the_first_count_of_a_large_region(two_scales, monkeypatch):
    monkeypatch.setattr(thresholding, "QUICK_VALUES", 1)
    preview = Preview(two_scales, 10.0)
    assert preview.interactive(ReconstructionSettings(region=REGION)) is None
    assert finish(preview.refine_steps(ReconstructionSettings(region=REGION))) is not None
    assert preview.threshold == 50.0
    assert preview.interactive(ReconstructionSettings(region=REGION)) is not None


def test_the_threshold_of_a_whole_volume_is_known_with_its_statistics(two_scales, monkeypatch):
    monkeypatch.setattr(thresholding, "QUICK_VALUES", 1)
    assert quick_threshold(two_scales, ReconstructionSettings()) is None
    finish(volume_statistics_steps(two_scales))
    assert quick_threshold(two_scales, ReconstructionSettings()) == 550.0
