# SPDX-License-Identifier: GPL-3.0-or-later
"""`scene.ctmc`: the settings as Blender keeps them."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.core.errors import SettingsError
from ctmc_addon.core.settings import SETTINGS


def test_a_fresh_scene_has_the_default_settings(scene):
    assert scene.ctmc.to_settings() == ReconstructionSettings()


@pytest.mark.parametrize("name", SETTINGS)
def test_every_setting_has_its_label_text_and_limits(scene, name):
    about, shown = SETTINGS[name], scene.ctmc.bl_rna.properties[name]
    assert shown.name == about.label
    assert about.text in shown.description
    assert about.unit in shown.description
    if about.choices:
        assert tuple(item.identifier for item in shown.enum_items) == about.choices
    elif about.type in (int, float):
        assert about.low is None or shown.hard_min == pytest.approx(about.low)
        assert about.high is None or shown.hard_max == pytest.approx(about.high)
    assert getattr(shown, "array_length", 0) == (about.size if about.size > 1 else 0)


@pytest.mark.parametrize(
    "settings",
    [
        {"threshold": 127.5, "stride": (2, 2, 1), "alpha": 0.1, "smoothing_mm": 0.7, "reduction": 0.9},
        {"label": 2, "close_border": True, "normals": "mesh", "simplifier": "decimate", "target_faces": 5000},
        {"region": (0.1, 0.2, 0.3, 10.7, 20.3, 30.9), "region_unit": "mm", "max_error_mm": 0.05, "nan_as": -1024.0},
        {"keep_parts": 3, "min_part_mm3": 12.3, "threshold": -0.3},
    ],
)
def test_settings_come_back_as_they_were_typed(scene, settings):
    typed = ReconstructionSettings(**settings)
    scene.ctmc.from_settings(typed)
    assert scene.ctmc.to_settings() == typed
    scene.ctmc.from_settings(ReconstructionSettings())
    assert scene.ctmc.to_settings() == ReconstructionSettings()


def test_giving_a_value_switches_its_setting_on(scene):
    scene.ctmc.threshold = 300.0
    scene.ctmc.reduction = 0.5
    assert scene.ctmc.to_settings() == ReconstructionSettings(threshold=300.0, reduction=0.5)


def test_of_rivals_the_last_one_counts(scene):
    scene.ctmc.threshold, scene.ctmc.label = 300.0, 2
    scene.ctmc.reduction, scene.ctmc.max_error_mm, scene.ctmc.target_faces = 0.5, 0.2, 100
    assert scene.ctmc.to_settings() == ReconstructionSettings(label=2, target_faces=100)


def test_the_rate_stays_below_one(scene):
    scene.ctmc.reduction = 1.0
    assert 0.99 < scene.ctmc.to_settings().reduction < 1.0


def test_what_contradicts_itself_is_a_settings_error(scene):
    scene.ctmc.simplifier, scene.ctmc.max_error_mm = "decimate", 0.5
    with pytest.raises(SettingsError, match="max_error_mm is not possible with simplifier decimate"):
        scene.ctmc.to_settings()
