# SPDX-License-Identifier: GPL-3.0-or-later
"""Which CT a surface is of: files opened again, a CT of the same name, and one whose content has changed."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ui.drawing import meshes_in

from ctmc_addon.blender.surface import read_provenance
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.results import surfaces


def active():
    return bpy.context.view_layer.objects.active


def test_a_reopened_file_knows_its_ct_and_offers_to_reload(loaded, ball_file, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
    bpy.ops.ctmc.load(again=True)
    assert loaded.ctmc.volume_path == "//ball.npy"
    bpy.ops.wm.save_mainfile()
    volumes._loaded.clear()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "day.blend"))
    scene = bpy.context.scene
    assert volumes.missing(scene)
    with pytest.raises(RuntimeError, match="Load the CT again first"):
        bpy.ops.ctmc.reconstruct()
    assert bpy.ops.ctmc.load(again=True) == {"FINISHED"}
    assert volumes.current(scene).spacing == (1.0, 1.0, 2.0)
    ball_file.unlink()
    volumes._loaded.clear()
    with pytest.raises(RuntimeError, match=r"ball\.npy"):
        bpy.ops.ctmc.load(again=True)
    assert "ball.npy" in session.of(scene).load_message


@pytest.fixture
def namesake(tmp_path):
    """Another patient's CT of the same name: a smaller ball in another folder."""
    (tmp_path / "other").mkdir()
    values = 140 - 10 * distance_mm((12, 24, 24), spacing=(1, 1, 2))
    np.save(tmp_path / "other" / "ball.npy", values.astype(np.int16))
    return tmp_path / "other" / "ball.npy"


def test_a_ct_of_the_same_name_leaves_another_patients_surface_alone(loaded, ball_file, namesake):
    from ui.drawing import drawn

    from ctmc_addon.ui.panels import main as panels

    bpy.ops.ctmc.reconstruct()
    first, faces = active(), len(active().data.polygons)
    assert "ctmc.reconstruct Update Surface" in drawn(*panels.STEPS).buttons
    bpy.ops.ctmc.load(filepath=str(namesake), spacing=(1, 1, 2))
    assert volumes.current(loaded).name == read_provenance(first).name
    assert not surfaces.is_of_ct(first, loaded)
    assert "ctmc.reconstruct Reconstruct Surface" in drawn(*panels.STEPS).buttons
    bpy.ops.ctmc.reconstruct()
    assert (len(meshes_in(loaded)), len(first.data.polygons)) == (2, faces)
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    assert surfaces.is_of_ct(first, loaded)
    del first["ctmc"]["fingerprint"]  # as an older file has it
    assert not surfaces.is_of_ct(first, loaded)


def test_a_surface_is_not_extracted_again_from_a_ct_of_the_same_name(loaded, namesake):

    loaded.ctmc.reduction = 0.5
    bpy.ops.ctmc.reconstruct()
    known = read_provenance(active()).fingerprint
    bpy.ops.ctmc.simplify()
    assert read_provenance(active()).fingerprint == known != ""
    session.clear()
    bpy.ops.ctmc.load(filepath=str(namesake), spacing=(1, 1, 2))
    with pytest.raises(RuntimeError, match="load its CT again"):
        bpy.ops.ctmc.simplify()


def test_load_again_says_that_the_content_has_changed(loaded, ball_file):
    bpy.ops.ctmc.load(again=True)
    assert session.of(loaded).load_message == ""
    values = np.load(ball_file)
    np.save(ball_file, values + 1)
    bpy.ops.ctmc.load(again=True)
    assert "The CT has changed since this file was saved: ball.npy" in session.of(loaded).load_message
    bpy.ops.ctmc.load(again=True)
    assert session.of(loaded).load_message == ""
    np.save(ball_file, values)
    volumes._loaded.clear()  # as in a file that was opened
    bpy.ops.ctmc.load(again=True)
    assert "The CT has changed since" in session.of(loaded).load_message
    loaded.ctmc.spacing = (1, 1, 3)  # another place by the person's own hand
    bpy.ops.ctmc.load(again=True)
    assert session.of(loaded).load_message == ""


def test_what_could_not_be_read_stays_in_the_panel_until_the_next_load(loaded, ball_file, tmp_path):
    from ui.drawing import drawn

    from ctmc_addon.ui.panels import main as panels

    with pytest.raises(RuntimeError, match="nowhere"):
        bpy.ops.ctmc.load(filepath=str(tmp_path / "nowhere"))
    bpy.ops.ctmc.reconstruct()
    assert "nowhere" in "".join(drawn(*panels.STEPS).texts)  # a line may end in the midst of a long path
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    assert "nowhere" not in "".join(drawn(*panels.STEPS).texts)
