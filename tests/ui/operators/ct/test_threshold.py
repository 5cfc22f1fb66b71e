# SPDX-License-Identifier: GPL-3.0-or-later
"""The threshold that panel, slice tint and Otsu's button show is that of the reconstruction."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.ui.operators.ct import threshold


def test_with_a_region_the_panel_shows_the_threshold_of_the_region(scene, tmp_path):
    values = np.zeros((20, 20, 20), np.int16)
    values[2:7, 5:15, 5:15], values[12:17, 5:15, 5:15] = 100, 1000
    np.save(tmp_path / "two.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "two.npy"))
    assert threshold.used_threshold(scene) == 550.0
    scene.ctmc.region = (0, 0, 0, 19, 19, 8)
    assert scene.ctmc.use_region
    assert threshold.used_threshold(scene) == 50.0
    assert bpy.ops.ctmc.auto_threshold() == {"FINISHED"}
    assert scene.ctmc.threshold == 50.0
    scene.ctmc.use_threshold = False
    scene.ctmc.label, scene.ctmc.use_label = 100, True
    assert threshold.used_threshold(scene) == 0.5
