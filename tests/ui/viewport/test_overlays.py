# SPDX-License-Identifier: GPL-3.0-or-later
"""The slice's and the region's properties, and what their handles read and write. The drawing is tested in a window."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.core.volume.region import region_corners
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.viewport import overlays as viewport
from ctmc_addon.ui.viewport.surface import region


@pytest.fixture
def volume(scene, ball_file):
    """The ball, 24 x 24 x 12 samples, columns to the left, rows to the back, slices to the head."""
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    return volumes.current(scene)


def test_nothing_is_drawn_without_a_window(scene):
    assert bpy.app.background
    assert viewport._handlers == []


def test_window_and_level_begin_with_the_volumes_range_and_stay_as_chosen(scene, volume):
    view = scene.ctmc_view
    low, high = float(volume.values.min()), float(volume.values.max())
    assert (view.window, view.level) == pytest.approx((high - low, (high + low) / 2))
    view.window = 30.0
    assert (view.window, view.level) == pytest.approx((30.0, (high + low) / 2))


def test_stepping_moves_by_one_slice_and_stops_at_the_ends(scene, volume):
    view = scene.ctmc_view
    view.position = 0.0
    for _ in range(3):
        bpy.ops.ctmc.slice_step(by=1)
    assert view.position == pytest.approx(3 / 11)
    bpy.ops.ctmc.slice_step(by=-5)
    assert view.position == 0.0


def test_a_file_of_version_0_2_keeps_its_slice(scene, volume):
    view = scene.ctmc_view
    stored = view.bl_system_properties_get(do_create=True) if bpy.app.version >= (5, 0, 0) else view
    stored["position"] = 0.75
    assert view.position == 0.75
    view.plane = "coronal"
    assert view.position == 0.75
    view.position = 0.25
    view.plane = "axial"
    assert view.position == 0.75


def test_the_tint_follows_threshold_and_labels(scene, volume):
    settings = scene.ctmc
    assert viewport.requested_labels(settings) == ()
    settings.label = 3
    assert viewport.requested_labels(settings) == (3,)


def test_fitting_the_region_takes_the_whole_volume_and_uses_it(scene, volume):
    bpy.ops.ctmc.fit_region()
    assert scene.ctmc.use_region
    assert tuple(scene.ctmc.region) == (0, 0, 0, 23, 23, 11)


@pytest.mark.parametrize("unit", ["voxel", "mm"])
@pytest.mark.parametrize("face", range(6))
def test_a_handle_stands_on_its_side_of_the_box_and_moves_only_that(scene, volume, unit, face):
    scene.ctmc.region_unit = unit
    bpy.ops.ctmc.fit_region()
    side = region.current_face(face)
    place = np.array(side.base + side.direction * side.offset()) / 0.01
    corners = region_corners(volume, tuple(scene.ctmc.region), unit)
    high = face >= 3
    on_side = [corner for number, corner in enumerate(corners) if bool(number >> face % 3 & 1) == high]
    assert place == pytest.approx(np.mean(on_side, axis=0), abs=1e-4)
    before = np.array(scene.ctmc.region)
    read, write = region.handle_of(face)
    write(read() - 0.02)  # 2 mm inwards
    moved = np.array(scene.ctmc.region) - before
    spacing = volume.spacing[face % 3] if unit == "voxel" else 1.0
    assert moved[face] == pytest.approx((-2.0 if high else 2.0) / spacing, abs=1e-4)
    assert np.count_nonzero(moved) == 1


def test_the_middle_handle_moves_the_box_and_keeps_its_size(scene, volume):
    scene.ctmc.region = (4, 4, 2, 12, 12, 6)
    x, y, z = region.read_middle()
    region.write_middle((x - 0.03, y, z))  # 3 mm to the left, along the columns
    assert tuple(scene.ctmc.region) == pytest.approx((7, 4, 2, 15, 12, 6), abs=1e-4)


def test_without_a_volume_the_handles_do_nothing(scene):
    read, write = region.handle_of(0)
    before = tuple(scene.ctmc.region)
    write(5.0)
    region.write_middle((1.0, 1.0, 1.0))
    assert read() == 0.0
    assert tuple(scene.ctmc.region) == before
    assert not bpy.ops.ctmc.fit_region.poll()
