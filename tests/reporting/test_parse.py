# SPDX-License-Identifier: GPL-3.0-or-later
"""Typed lists of numbers: each once, and an error that names what was typed."""

import pytest

from ctmc_addon.core import SettingsError
from ctmc_addon.reporting.parse import parsed_levels, parsed_numbers, parsed_stride, parsed_strides


def test_separators_may_be_mixed_and_repeats_count_once():
    assert parsed_numbers("0, 0.5;1  0.5", "alphas", "0 1") == (0.0, 0.5, 1.0)
    assert parsed_strides("1;1x1, 2x3") == ((1, 1), (2, 3))
    assert parsed_levels("0 %, 50, 90") == (0.0, 50.0, 90.0)


@pytest.mark.parametrize("text", ["", " , ", "0 x"])
def test_numbers_that_are_missing_or_not_numbers_are_refused(text):
    with pytest.raises(SettingsError, match=r"0 0\.25 1"):
        parsed_numbers(text, "alphas", "0 0.25 1")


@pytest.mark.parametrize("word", ["two", "2x", "x2", "1.5"])
def test_a_word_that_is_not_a_stride_is_refused(word):
    with pytest.raises(SettingsError, match=f"'{word}'"):
        parsed_stride(word)


@pytest.mark.parametrize("text", ["", "100", "-1 5", "50 50", "half"])
def test_levels_outside_their_limits_are_refused(text):
    with pytest.raises(SettingsError, match="0 to 99"):
        parsed_levels(text)
