# SPDX-License-Identifier: GPL-3.0-or-later
"""What was drawn goes along where its CT is read another way and each sample is the same one."""

from __future__ import annotations

import nibabel
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from ui.strokes import mask, middle, stroke

from ctmc_addon.ui.state.ct import scans, volumes
from ctmc_addon.ui.state.draw import drawings
from ctmc_addon.ui.state.surface import structures


def drawn_lines():
    return [(line.name, round(line.opacity, 3), line.chosen) for line in bpy.context.scene.ctmc.labels if line.source]


def read_again(name, value):
    setattr(bpy.context.scene.ctmc, name, value)
    bpy.ops.ctmc.load(again=True)


@pytest.mark.parametrize(
    ("name", "there", "back"), [("spacing", (1, 1, 2.5), (1, 1, 2)), ("flip_x", True, False), ("remove_table", 1, 0)]
)
def test_a_drawing_is_taken_along_and_back(scene, ball_file, tmp_path, name, there, back):
    if name == "remove_table":
        _, y, x = np.indices((20, 60, 70), np.float32)
        values = np.where(((x - 35) / 30) ** 2 + ((y - 25) / 20) ** 2 < 1, 40, -1000).astype(np.int16)
        values[:, 52:54] = 100
        nibabel.save(nibabel.Nifti1Image(values.T, np.diag([-2.0, -2.0, 2.0, 1.0])), tmp_path / "ct.nii")
        bpy.ops.ctmc.load(filepath=str(tmp_path / "ct.nii"))
    else:
        bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    bpy.ops.ctmc.add_threshold()
    for number, called in enumerate(("liver", "tumor")):
        bpy.ops.ctmc.draw_add()
        stroke(middle())
        line = scene.ctmc.labels[-1]
        line.name, line.opacity, line.chosen = called, 0.5, bool(number)
    scene.ctmc.label_index = 1
    before, lines, key = mask().copy(), drawn_lines(), drawings.active(scene).key
    first, affine = scene.ctmc.volume_fingerprint, volumes.current(scene).affine.copy()
    for value in (there, back):
        read_again(name, value)
        assert (scene.ctmc.volume_fingerprint == first) == (value == back)
        assert drawings.active(scene).key == key
        assert (mask() == before).all()
        assert drawn_lines() == lines
        assert (structures.label_volume(scene).affine == volumes.current(scene).affine).all()
        assert [len(scan.label_sources) for scan in scene.ctmc_scans] == [0]
    assert (volumes.current(scene).affine == affine).all()
    assert before.any()


def test_another_ct_of_the_same_size_takes_no_drawing_along(drawing, ball_file, tmp_path):
    scene = bpy.context.scene
    stroke(middle())
    before, first = mask().copy(), scene.ctmc.volume_fingerprint
    np.save(tmp_path / "other.npy", np.load(ball_file) + 1)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "other.npy"), spacing=(1, 1, 2))
    assert not any(drawings.structures(scene))
    assert scans.activate(scene, first)
    assert (mask() == before).all()


def test_the_earlier_reading_is_made_at_a_threshold_once_its_drawings_have_gone_along(drawing):
    scene = bpy.context.scene
    stroke(middle())
    first = scene.ctmc.volume_fingerprint
    assert scene.ctmc.use_label
    read_again("spacing", (1, 1, 2.5))
    assert scene.ctmc.use_label
    assert scans.activate(scene, first)
    assert (len(scene.ctmc.labels), scene.ctmc.label_index, scene.ctmc.use_label) == (0, 0, False)


def test_undo_of_another_spacing_gives_the_drawing_its_place_back(drawing):
    scene = bpy.context.scene
    stroke(middle())
    bpy.ops.ed.undo_push(message="Stroke")
    before = mask().copy()
    read_again("spacing", (1, 1, 2.5))
    bpy.ops.ed.undo_push(message="Load")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert (mask() == before).all()
    assert (structures.label_volume(scene).affine == volumes.current(scene).affine).all()
    assert volumes.current(scene).spacing[2] == 2
