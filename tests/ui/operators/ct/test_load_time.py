# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of several times of a CT is loaded: chosen in the panel, kept in the file."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn

from ctmc_addon.readers import read_volume
from ctmc_addon.ui.operators.results import results
from ctmc_addon.ui.panels import main as panels
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import volumes


def several_times(path):
    """Cubes that grow with the time, in NIfTI."""
    nibabel = pytest.importorskip("nibabel")
    values = np.zeros((10, 10, 10, 3), np.int16)
    for time in range(3):
        values[3 : 5 + time, 3:6, 3:6, time] = 500
    nibabel.Nifti1Image(values, np.eye(4)).to_filename(path)
    return path


def test_the_time_of_the_panel_is_read_and_noted(scene, tmp_path):
    heart = several_times(tmp_path / "heart.nii")
    assert bpy.ops.ctmc.load(filepath=str(heart)) == {"FINISHED"}
    for time in (1, 3, 2):
        if time > 1:
            scene.ctmc.time = time
            assert bpy.ops.ctmc.load(again=True) == {"FINISHED"}
        loaded = volumes.loaded(scene)
        assert (scene.ctmc.time, loaded.times) == (time, 3)
        assert (loaded.volume.values == read_volume(heart, time=time).values).all()
        assert (loaded.volume.values == 500).sum() == 9 * (1 + time)
    layout = drawn(panels.STEPS[0])
    assert "time" in layout.shown
    assert "Time, 1 to 3" in layout.labels
    assert "ctmc.load Load Time Point" in layout.buttons
    assert "--time 2" in results.command_text(scene)
    scene.ctmc.time = 4
    with pytest.raises(RuntimeError, match=r"no time 4, because heart\.nii holds 3 times; choose from 1 to 3"):
        bpy.ops.ctmc.load(again=True)
    assert volumes.loaded(scene).reading.time == 2


def test_name_and_region_hold_for_the_other_times(scene, tmp_path, monkeypatch):
    from ctmc_addon.ui.operators.ct import load

    framed = []
    monkeypatch.setattr(load, "frame_everywhere", framed.append)
    bpy.ops.ctmc.load(filepath=str(several_times(tmp_path / "heart.nii")))
    scene.ctmc.volume_name = "left ventricle"
    scene.ctmc.region_unit, scene.ctmc.region = "voxel", (0, 0, 0, 8, 8, 8)
    scene.ctmc.use_region = False
    bpy.ops.ctmc.load(again=True, time=2)
    scene.ctmc.use_region = True
    assert tuple(scene.ctmc.region) == (0, 0, 0, 8, 8, 8)
    assert scene.ctmc.volume_name == "left ventricle"
    assert len(framed) == 1  # the view stays
    bpy.ops.ctmc.load(filepath=str(several_times(tmp_path / "other.nii")), time=3)
    assert scene.ctmc.volume_name == ""
    assert len(framed) == 2


def test_the_time_belongs_to_its_ct_and_stays_in_the_file(scene, tmp_path, ball_file):
    heart = several_times(tmp_path / "heart.nii")
    bpy.ops.ctmc.load(filepath=str(heart), time=3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    volumes._loaded.clear()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    opened = bpy.context.scene
    assert volumes.missing(opened)
    assert bpy.ops.ctmc.load(again=True) == {"FINISHED"}
    assert not session.of(opened).load_message  # it is the CT that the file knew
    assert (volumes.current(opened).values == read_volume(heart, time=3).values).all()
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    assert opened.ctmc.time == 0
    assert "time" not in drawn(panels.STEPS[0]).shown
