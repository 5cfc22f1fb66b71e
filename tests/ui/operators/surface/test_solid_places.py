# SPDX-License-Identifier: GPL-3.0-or-later
"""Where pegs and drains of the panel's solid will be: found once for each setting, and shown."""

from __future__ import annotations

import numpy as np
import pytest
from ui.drawing import drawn

bpy = pytest.importorskip("bpy")

from ui.places import cursor_at, own_center

from ctmc_addon.core import finish
from ctmc_addon.ui.panels.surface.page import CTMC_PT_surface
from ctmc_addon.ui.panels.surface.solid import draw_places
from ctmc_addon.ui.viewport.surface import solid_places
from ctmc_addon.ui.viewport.surface.solid import outline_of


@pytest.fixture(autouse=True)
def _page(loaded):
    bpy.context.window_manager.ctmc_page = "SURFACE"


def test_pegs_and_drains_are_shown_where_they_are_made_once_they_are_found(loaded):
    assert outline_of(loaded) is None
    solid = loaded.ctmc_solid
    cursor_at(*own_center(loaded))
    bpy.ops.ctmc.cut_add(direction="Z")
    bpy.ops.ctmc.drain_add()
    solid.use_pegs, solid.hollow, solid.peg_diameter, solid.peg_length, solid.peg_count = True, 1.5, 1.0, 1.5, 3
    outline = outline_of(loaded)
    assert (outline.pegs, outline.holes, outline.drains) == ([], [], [])
    assert [radius for _, radius in outline.places] == [2.0]
    assert solid_places.is_looking(loaded)
    assert "Placing pegs and drains" in drawn(draw_places).texts
    finish(solid_places.placing_steps(loaded.session_uid))
    assert not solid_places.is_looking(loaded)
    outline = outline_of(loaded)
    [drain] = outline.drains
    assert (len(outline.pegs), outline.places) == (3, [])
    assert [hole.radius for hole in outline.holes] == pytest.approx([0.7] * 3)
    middle = np.array(own_center(loaded))
    for peg in outline.pegs:  # Beside the wall, 4.5 to 6 mm from the middle, down from the cut.
        across = np.linalg.norm((np.array(peg.start) - middle)[:2])
        assert 3.0 < across < 6.0
        assert peg.start[2] - peg.end[2] == pytest.approx(1.5)
    assert np.linalg.norm(np.subtract(drain.end, middle)) > 6.0


def test_places_are_found_again_for_other_settings_alone(loaded, monkeypatch):
    solid = loaded.ctmc_solid
    cursor_at(*own_center(loaded))
    bpy.ops.ctmc.cut_add(direction="Z")
    solid.use_pegs, solid.peg_diameter, solid.peg_length, solid.peg_count = True, 2.0, 2.0, 1
    assert solid_places.ask(loaded)
    assert not solid_places.ask(loaded), "asked before"
    finish(solid_places.placing_steps(loaded.session_uid))
    [first] = outline_of(loaded).pegs
    solid.cuts[0].position += 1.0
    assert outline_of(loaded).pegs == []
    assert solid_places.ask(loaded)
    finish(solid_places.placing_steps(loaded.session_uid))
    [second] = outline_of(loaded).pegs
    assert second.start[2] - first.start[2] == pytest.approx(1.0, abs=1e-4)
    monkeypatch.setattr(solid_places, "placed_cuts_pegs_steps", None)
    solid.cuts[0].position -= 1.0
    solid.base = 3.0  # Moves no peg.
    assert outline_of(loaded).pegs == [first], "kept"
    solid_places.clear()
    assert outline_of(loaded).pegs == []


def test_what_does_not_fit_is_said_in_the_panel(loaded):
    solid = loaded.ctmc_solid
    cursor_at(*own_center(loaded))
    bpy.ops.ctmc.cut_add(direction="Z")
    solid.use_pegs, solid.peg_diameter, solid.peg_length = True, 11.0, 40.0
    finish(solid_places.placing_steps(loaded.session_uid))
    assert outline_of(loaded).pegs == []
    assert any("No peg of 11 mm" in text for text in drawn(CTMC_PT_surface).texts)
