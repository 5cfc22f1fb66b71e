# SPDX-License-Identifier: GPL-3.0-or-later
"""Remove Patient Table reads the CT without it, and with it again."""

import nibabel
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn

from ctmc_addon.ui.operators.results.results import command_text
from ctmc_addon.ui.panels.main import CTMC_PT_ct
from ctmc_addon.ui.state.ct import volumes


def test_it_is_a_switch_that_the_note_and_the_command_know(scene, tmp_path):
    _, y, x = np.indices((20, 60, 70), np.float32)
    values = np.where(((x - 35) / 30) ** 2 + ((y - 25) / 20) ** 2 < 1, 40, -1000).astype(np.int16)
    values[:, 52:54] = 100
    nibabel.save(nibabel.Nifti1Image(values.T, np.diag([-2.0, -2.0, 2.0, 1.0])), tmp_path / "ct.nii")
    bpy.ops.ctmc.load(filepath=str(tmp_path / "ct.nii"))
    assert "ctmc.remove_table" in drawn(CTMC_PT_ct).buttons
    assert bpy.ops.ctmc.remove_table() == {"FINISHED"}
    assert volumes.current(scene).values[:, 50:].max() == -1000
    assert any(text == "Patient table removed (22.4 ml)" for text in volumes.current(scene).notes)
    assert "--remove-table" in command_text(scene)
    bpy.ops.ctmc.remove_table()
    np.testing.assert_array_equal(volumes.current(scene).values, values)
