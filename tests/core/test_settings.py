# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings check themselves against the limits that stand beside them."""

import pickle
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ctmc_addon.core import LEAVE_IT, ReconstructionSettings
from ctmc_addon.core.errors import SettingsError
from ctmc_addon.core.settings import (
    ALPHA,
    COMPONENTS,
    EXTRACTION,
    FIELD,
    SETTINGS,
    SIMPLIFICATION,
    STAGES,
    settings_of_stage,
)


def test_every_setting_describes_itself():
    for name, about in SETTINGS.items():
        assert about.text, name
        assert about.label, name
        assert about.choices or about.type in (int, float, bool), name


def test_one_stride_counts_for_all_axes_and_numbers_take_their_own_type():
    settings = ReconstructionSettings(threshold=200, stride=2, alpha=1, keep_parts=3.0)
    assert settings.stride == ReconstructionSettings(stride=np.int64(2)).stride == (2, 2, 2)
    assert (type(settings.threshold), type(settings.alpha), type(settings.keep_parts)) == (float, float, int)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"alpha": 1.2}, "alpha must be from 0 to 1 or auto, not 1.2"),
        ({"alpha": float("nan")}, "alpha must be a finite number, not nan"),
        ({"alpha": None}, "alpha needs a value: from 0 to 1"),
        ({"stride": (1, 1)}, "stride takes 3 numbers, not 2"),
        ({"stride": "221"}, "stride takes 3 numbers, not '221'"),
        ({"close_border": "no"}, "close_border is on or off, True or False, not 'no'"),
        ({"stride": (1, 1, 17)}, "stride must be from 1 to 16, not 17"),
        ({"stride": (1.5, 1, 1)}, "stride must be a whole number, not 1.5"),
        ({"reduction": 1.0}, "reduction must be at least 0 and below 1, not 1"),
        ({"smoothing_mm": -1}, "smoothing_mm must be from 0 to 50, not -1"),
        ({"max_error_mm": 0}, "max_error_mm must be above 0, not 0"),
        ({"normals": "up"}, "normals is one of gradient, mesh, not 'up'"),
        ({"threshold": float("inf")}, "threshold must be a finite number"),
        ({"threshold": "bone"}, "threshold must be a finite number, not 'bone'"),
        ({"threshold": 1, "label": 2}, "threshold 1 and label 2 cannot be set together"),
        ({"reduction": 0.5, "max_error_mm": 1}, "reduction 0.5 and max_error_mm 1 cannot be set together"),
        ({"simplifier": "decimate", "max_error_mm": 1}, "max_error_mm is not possible with simplifier decimate"),
        ({"region": (5, 0, 0, 5, 9, 9)}, "is empty"),
    ],
)
def test_a_value_outside_its_limits_is_refused_with_value_and_limit(values, words):
    with pytest.raises(SettingsError, match=words):
        ReconstructionSettings(**values)


def test_settings_survive_a_dictionary_and_pickle():
    settings = ReconstructionSettings(
        label=2, stride=(2, 2, 1), smoothing_mm=1.5, region=(0, 0, 0, 9, 9, 9), max_error_mm=0.3
    )
    assert ReconstructionSettings.from_dict(settings.to_dict()) == settings
    assert pickle.loads(pickle.dumps(settings)) == settings
    assert hash(settings) == hash(pickle.loads(pickle.dumps(settings)))
    with pytest.raises(SettingsError, match="unknown setting 'treshold'"):
        ReconstructionSettings.from_dict({"treshold": 1})


@pytest.mark.parametrize(("label", "soften"), [*product((None, 1), (0.0, 1.0))])
def test_alpha_does_nothing_only_on_a_label_that_is_not_softened(label, soften):
    assert ReconstructionSettings(label=label, smoothing_mm=soften).alpha_matters == (label is None or soften > 0)


def test_a_goal_without_a_simplifier_simplifies_nothing():
    assert not ReconstructionSettings().simplifies
    assert ReconstructionSettings(reduction=0.5).simplifies
    assert not ReconstructionSettings(reduction=0.5, simplifier="none").simplifies


@pytest.mark.parametrize(
    ("values", "method", "width"),
    [
        ({}, "none", 0.0),
        ({"threshold": 100}, "none", 0.0),
        ({"label": 1}, "constrained", 0.0),
        ({"label": 1, "smoothing": "none"}, "none", 0.0),
        ({"label": 1, "smoothing": "gaussian"}, "gaussian", 1.0),
        ({"threshold": 100, "smoothing": "gaussian", "smoothing_mm": 2}, "gaussian", 2.0),
        ({"label": 1, "smoothing_mm": 0.5}, "gaussian", 0.5),
        ({"label": 1, "smoothing_mm": 0}, "none", 0.0),
        ({"label": 1, "soften_mm": 1.5}, "gaussian", 1.5),  # as older files have it
        ({"label": 1, "soften_mm": 0.0}, "none", 0.0),
    ],
)
def test_the_smoothing_follows_from_what_is_given(values, method, width):
    settings = ReconstructionSettings.from_dict(values)
    assert (settings.smoothing_method, settings.smoothing_width_mm) == (method, width)
    assert ReconstructionSettings.from_dict(settings.to_dict()) == settings


@pytest.mark.parametrize(
    "values",
    [
        {"threshold": 100, "smoothing": "constrained"},
        {"label": 1, "smoothing": "constrained", "smoothing_mm": 1},
        {"label": 1, "smoothing": "none", "smoothing_mm": 1},
        {"label": 1, "smoothing": "taubin"},
        {"label": 1, "slice_steps": 9},
    ],
)
def test_smoothings_that_cannot_be_are_refused(values):
    with pytest.raises(SettingsError):
        ReconstructionSettings(**values)


def test_every_setting_belongs_to_one_stage():
    assert [name for name, about in SETTINGS.items() if about.stage not in STAGES] == []
    assert sorted(SETTINGS) == sorted(name for stage in STAGES for name in settings_of_stage(stage))


def test_settings_without_a_stage_have_its_defaults_and_keep_all_others():
    given = ReconstructionSettings(label=2, alpha=0.5, keep_parts=2, simplifier="decimate", reduction=0.5)
    assert given.without(SIMPLIFICATION) == ReconstructionSettings(label=2, alpha=0.5, keep_parts=2)
    assert given.without(ALPHA) == replace(given, alpha=1.0)
    assert given.without(EXTRACTION) == given


def test_what_leaves_a_preview_as_it_is_follows_from_the_stages():
    assert {"alpha", "min_angle_deg", *settings_of_stage(SIMPLIFICATION)} == LEAVE_IT
    assert LEAVE_IT.isdisjoint(name for stage in (FIELD, EXTRACTION, COMPONENTS) for name in settings_of_stage(stage))
