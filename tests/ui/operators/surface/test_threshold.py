# SPDX-License-Identifier: GPL-3.0-or-later
"""The threshold that panel, slice tint and Otsu's button show is that of the reconstruction."""

from __future__ import annotations

import nibabel
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from ui.strokes import middle, stroke

from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.viewport.surface import histogram


def test_with_a_region_the_panel_shows_the_threshold_of_the_region(scene, tmp_path):
    values = np.zeros((20, 20, 20), np.int16)
    values[2:7, 5:15, 5:15], values[12:17, 5:15, 5:15] = 100, 1000
    np.save(tmp_path / "two.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "two.npy"))
    assert volumes.used_threshold(scene) == 550.0
    scene.ctmc.region = (0, 0, 0, 19, 19, 8)
    assert scene.ctmc.use_region
    assert volumes.used_threshold(scene) == 50.0
    assert bpy.ops.ctmc.auto_threshold() == {"FINISHED"}
    assert scene.ctmc.threshold == 50.0
    scene.ctmc.use_threshold = False
    scene.ctmc.label, scene.ctmc.use_label = 100, True
    assert volumes.used_threshold(scene) == 0.5


def limits():
    """What Reconstruct would use once Threshold is shown again."""
    bpy.context.scene.ctmc.surface_from = "threshold"
    settings = bpy.context.scene.ctmc.to_settings()
    return settings.threshold, settings.upper, settings.label


@pytest.fixture
def bone(scene, tmp_path):
    """A ball of 300 HU in air of -1000 HU, with Tissue > Bone chosen."""
    z, y, x = np.indices((16, 24, 24)) - np.array([8, 12, 12])[:, None, None, None]
    values = np.where(x**2 + y**2 + z**2 < 36, 300, -1000).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(values.T, np.diag([-1.0, -1.0, 1.0, 1.0])), tmp_path / "ct.nii")
    bpy.ops.ctmc.load(filepath=str(tmp_path / "ct.nii"))
    bpy.ops.ctmc.tissue(tissue="bone")
    assert limits() == (200.0, None, None)
    return scene


def test_looking_at_structures_keeps_threshold_and_upper_limit(bone):
    bone.ctmc.upper = 900.0
    bone.ctmc.surface_from = "label"
    assert bone.ctmc.to_settings() == ReconstructionSettings(label=bone.ctmc.label)
    assert limits() == (200.0, 900.0, None)
    assert volumes.used_threshold(bone) == 200.0


def test_otsu_stays_otsu_after_looking_at_structures(bone):
    bone.ctmc.use_threshold = False
    bone.ctmc.surface_from = "label"
    assert limits() == (None, None, None)


@pytest.mark.parametrize("way", ["grow", "stroke", "tick", "remove", "label", "preset", "copy"])
def test_what_makes_structures_keeps_the_threshold(bone, way):
    if way == "grow":
        bpy.ops.ctmc.draw_grow(point_mm=middle())
    elif way == "stroke":
        stroke(middle())
    elif way in ("tick", "remove"):
        bpy.ops.ctmc.add_threshold()
        assert [(item.threshold, item.use_upper) for item in bone.ctmc.labels] == [(200.0, False)]
        if way == "remove":
            bpy.ops.ctmc.remove_structure()
    elif way == "label":
        bone.ctmc.label = 2
    elif way == "preset":
        bone.ctmc.show_preset(label=2, stride=(2, 2, 1))
    else:
        stroke(middle())
        bpy.ops.ctmc.reconstruct()
        bpy.ops.ctmc.adopt_settings()
    assert bone.ctmc.use_label == (way != "remove")
    assert limits() == (200.0, None, None)


def test_structures_saved_and_opened_keep_the_threshold(bone, tmp_path):
    bpy.ops.ctmc.draw_grow(point_mm=middle())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "bone.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "bone.blend"))
    assert bpy.context.scene.ctmc.use_label
    assert limits() == (200.0, None, None)
    bpy.context.scene.ctmc.surface_from = "label"
    bpy.ops.ctmc.load(again=True)
    assert limits() == (200.0, None, None)


def test_undo_and_redo_keep_the_threshold(bone):
    bpy.ops.ed.undo_push(message="Bone")
    bone.ctmc.surface_from = "label"
    bpy.ops.ed.undo_push(message="Structures")
    bpy.ops.ed.undo()
    assert bpy.context.scene.ctmc.to_settings().threshold == 200.0
    bpy.ops.ed.redo()
    assert bpy.context.scene.ctmc.use_label
    assert limits() == (200.0, None, None)


def test_a_users_preset_of_structures_keeps_its_threshold_and_gives_structures(bone, tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_a, **_k: str(tmp_path))
    bone.ctmc.surface_from = "label"
    bpy.ops.ctmc.preset_add(name="Mine")
    bone.ctmc.threshold = 50.0
    [preset] = tmp_path.rglob("*.py")
    exec(compile(preset.read_text(encoding="utf-8"), "preset", "exec"), {})
    assert bone.ctmc.use_label
    assert limits() == (200.0, None, None)


def test_a_new_threshold_while_structures_are_shown_makes_a_surface_at_it(bone):
    bone.ctmc.surface_from = "label"
    before = histogram.limits_stored(bone)
    bone.ctmc.threshold = 150.0
    assert (bone.ctmc.use_label, bone.ctmc.to_settings().threshold) == (False, 150.0)
    histogram.restore_limits(bone, before)
    assert bone.ctmc.use_label
    assert limits() == (200.0, None, None)


def test_otsu_after_a_number_and_a_number_above_drop_a_tissues_upper_limit(bone):
    settings = bone.ctmc
    settings.threshold_from = "lung"
    assert settings.use_upper
    settings.threshold_value = -700.0
    settings.threshold_from = "otsu"
    assert not settings.use_upper
    settings.threshold_from = "lung"
    settings.threshold_value = settings.upper + 1
    assert not settings.use_upper
