# SPDX-License-Identifier: GPL-3.0-or-later
"""The shipped presets: each sets every value it is to set, and no other."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.ui.panels import presets

FOLDER = presets.SHIPPED / "presets" / presets.SUBFOLDER
EXPECTED = {
    "bone": {"threshold": 200.0, "min_part_mm3": 50.0, "reduction": 0.5},
    "skin": {"threshold": -300.0, "stride": (2, 2, 1), "close_border": True, "keep_parts": 1, "reduction": 0.9},
    "lung": {"threshold": -950.0, "upper": -600.0, "stride": (2, 2, 1), "min_part_mm3": 1000.0, "reduction": 0.8},
    "liver_tumor_label_2": {"label": 2, "stride": (2, 2, 1), "reduction": 0.9},
    "3d_print": {"threshold": 200.0, "close_border": True, "keep_parts": 1, "max_error_mm": 0.1},
    "figure": {
        **{"threshold": 200.0, "stride": (3, 3, 1), "alpha": 0.5, "min_part_mm3": 50.0},
        **{"normals": "mesh", "simplifier": "none"},
    },
}


def test_six_presets_are_shipped_where_blender_looks(scene):
    assert {path.stem for path in FOLDER.glob("*.py")} == set(EXPECTED)
    assert str(FOLDER) in bpy.utils.preset_paths(presets.SUBFOLDER)


@pytest.mark.parametrize("name", EXPECTED)
def test_a_preset_gives_these_settings_whatever_stood_there(scene, name):
    volumes_own = {"region": (0, 0, 0, 5, 5, 5), "region_unit": "mm", "nan_as": -1000.0}
    scene.ctmc.from_settings(
        ReconstructionSettings(
            **volumes_own, label=7, alpha=0.2, target_faces=77, keep_parts=3, topology="trilinear", smoothing_mm=3.0
        )
    )
    scene.ctmc.simplifier, scene.ctmc.max_error_mm = "decimate", 0.3  # which contradict each other
    text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    exec(compile(text, name, "exec"), {})
    assert scene.ctmc.to_settings() == ReconstructionSettings(**volumes_own, **EXPECTED[name])


def test_a_users_own_preset_is_kept_and_removed(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_a, **_k: str(tmp_path))
    # Blender shows the chosen preset's name in place of the list's label.
    monkeypatch.setattr(presets.CTMC_PT_presets, "bl_label", presets.CTMC_PT_presets.bl_label)
    scene.ctmc.threshold = 321.0
    assert bpy.ops.ctmc.preset_add(name="Mine") == {"FINISHED"}
    [kept] = tmp_path.rglob("*.py")
    assert "settings.threshold = 321.0" in kept.read_text(encoding="utf-8")
