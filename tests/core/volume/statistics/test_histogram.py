# SPDX-License-Identifier: GPL-3.0-or-later
"""The histogram as a control: bars, ticks, tissues and limits, against closed forms."""

from itertools import pairwise

import numpy as np
import pytest

from ctmc_addon.core import Volume, finish
from ctmc_addon.core.volume import (
    TISSUES,
    ThresholdLimits,
    grabbed_limit,
    histogram_bars,
    moved_limit,
    round_ticks,
    rounded_to,
    shown_range,
    surface_name,
    tissue_bands,
    volume_statistics_steps,
)


def statistics_of(values):
    return finish(volume_statistics_steps(Volume(np.asarray(values), np.eye(4))))


@pytest.mark.parametrize("most", [1, 7, 100, 333, 1000, 5000])
def test_even_counts_make_even_bars_at_any_width(most):
    statistics = statistics_of(np.arange(1000, dtype=np.int16).reshape(10, 10, 10))
    bars = histogram_bars(statistics, 0, 999, most)
    assert len(bars.heights) <= most
    assert bars.heights[:-1] == pytest.approx(1.0)  # the last one may hold fewer bins
    assert bars.start == -0.5
    assert bars.start + bars.width * len(bars.heights) >= 999.5


def test_a_bar_stands_where_its_value_is_and_is_as_high_as_its_logarithm():
    values = np.zeros((10, 10, 10), np.int16)
    values[0, 0, :7] = 40
    bars = histogram_bars(statistics_of(values), 0, 40, 1000)
    assert (bars.start, bars.width, len(bars.heights)) == (-0.5, 1.0, 41)
    assert np.flatnonzero(bars.heights).tolist() == [0, 40]
    assert bars.heights[40] == pytest.approx(np.log1p(7) / np.log1p(993))


def test_a_part_of_the_axis_shows_its_part_of_the_bars():
    statistics = statistics_of(np.arange(1000, dtype=np.int16).reshape(10, 10, 10))
    bars = histogram_bars(statistics, 100, 199, 1000)
    assert (bars.start, len(bars.heights)) == (99.5, 100)
    assert len(histogram_bars(statistics, 5000, 6000, 10).heights) == 1


def test_a_volume_without_a_finite_value_has_an_axis_and_no_bars():
    statistics = statistics_of(np.full((2, 2, 2), np.nan))
    assert shown_range(statistics, "gray value") == (0.0, 1.0)
    assert not histogram_bars(statistics, 0.0, 1.0, 10).heights.any()


def test_the_axis_leaves_padding_and_metal_out_but_never_a_limit():
    statistics = statistics_of(np.array([[[-3024, 0], [100, 20000]]] * 2, np.int16))
    assert shown_range(statistics, "HU") == (-1100.0, 3100.0)
    assert shown_range(statistics, "HU", 9000.0, None) == (-1100.0, 9000.0)
    assert shown_range(statistics, "gray value") == (-3024.0, 20000.0)
    assert shown_range(statistics_of(np.full((2, 2, 2), 5, np.uint8)), "gray value") == (4.5, 5.5)


@pytest.mark.parametrize(("low", "high"), [(-1024.0, 3071.0), (0.0, 1.0), (0.0, 65535.0), (-3e-4, 8e-4), (17.0, 18.0)])
@pytest.mark.parametrize("most", [2, 5, 8, 20])
def test_ticks_are_round_numbers_inside_and_no_more_than_asked_for(low, high, most):
    ticks = np.array(round_ticks(low, high, most))
    assert len(ticks) <= most
    assert ((low <= ticks) & (ticks <= high)).all()
    if len(ticks) > 1:
        step = np.diff(ticks)
        assert step == pytest.approx(step[0])
        assert f"{step[0]:e}"[0] in "125"
        assert ticks / step[0] == pytest.approx(np.round(ticks / step[0]))
    assert len(ticks) >= most / 5  # no emptier than the next coarser step makes it


def test_bands_lie_side_by_side_and_name_the_surface_of_a_threshold_in_them():
    bands = tissue_bands(-1100.0, 3100.0)
    assert [band.name for band in bands] == [
        tissue.name for tissue in sorted(TISSUES.values(), key=lambda tissue: tissue.threshold)
    ]
    for band, following in pairwise(bands):
        assert band.low < band.high <= following.low
    for band in bands:
        upper = band.high if band.name == "Lung" else None
        assert surface_name("HU", band.low, upper).startswith(band.name)


def test_a_dragged_number_is_as_precise_as_a_pixel():
    assert rounded_to(226.4, 1.0) == 226.0
    assert rounded_to(226.4, 0.99) == 226.4
    assert rounded_to(31234.0, 43.0) == 31230.0


def test_limits_never_cross_and_an_upper_limit_at_the_end_is_none():
    limits = ThresholdLimits(200.0, 500.0)
    assert moved_limit(limits, False, -5000.0, -1000.0, 3000.0) == (-1000.0, 500.0)
    assert moved_limit(limits, True, 100.0, -1000.0, 3000.0) == (200.0, 200.0)
    assert moved_limit(limits, True, 9000.0, -1000.0, 3000.0) == (200.0, None)
    assert moved_limit(ThresholdLimits(200.0, None), False, 700.0, -1000.0, 3000.0) == (700.0, None)


@pytest.mark.parametrize(
    ("upper", "value", "is_upper"),
    [(500, 210, False), (500, 495, True), (500, 340, False), (500, 900, True), (None, 900, False), (None, 2995, True)],
)
def test_a_press_takes_the_limit_that_is_meant(upper, value, is_upper):
    assert grabbed_limit(ThresholdLimits(200.0, upper), value, 3000.0, 10.0) is is_upper
