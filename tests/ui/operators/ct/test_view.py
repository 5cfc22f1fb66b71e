# SPDX-License-Identifier: GPL-3.0-or-later
"""The CT's box and collection, and the region that it begins with; what the viewports show is tested in a window."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.scene.ct_box import box_of
from ctmc_addon.core.volume import volume_box
from ctmc_addon.ui.state.ct import volumes


@pytest.fixture
def loaded(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    return scene


def test_a_ct_has_one_box_of_its_size_in_the_collection_of_its_folder(loaded, ball_file):
    for _ in range(2):
        box = box_of(loaded, loaded.ctmc.volume_fingerprint)
        corners = volume_box(volumes.current(loaded)) * 0.01
        np.testing.assert_allclose(box.location, (corners.min(axis=0) + corners.max(axis=0)) / 2, atol=1e-6)
        np.testing.assert_allclose(box.scale, np.ptp(corners, axis=0) / 2, atol=1e-6)
        assert [obj.type for obj in loaded.objects] == ["EMPTY"]
        assert [owner.name for owner in box.users_collection] == [ball_file.parent.name]
        bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 3))  # the same file, read otherwise


def test_surfaces_go_to_the_collection_of_their_ct(loaded, ball_file):
    loaded.ctmc.threshold = 100.0
    bpy.ops.ctmc.reconstruct()
    obj = bpy.context.view_layer.objects.active
    assert [owner.name for owner in obj.users_collection] == [ball_file.parent.name]


def test_view_needs_a_ct_and_no_window(scene, ball_file):
    assert not bpy.ops.ctmc.view.poll()
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    assert bpy.ops.ctmc.view(side="A") == {"FINISHED"}


def test_ticking_the_region_fits_it_once_and_another_unit_leaves_the_box(loaded):
    settings = loaded.ctmc
    settings.use_region = True
    assert tuple(settings.region) == (0, 0, 0, 23, 23, 11)
    settings.region = (2, 3, 1, 20, 21, 9)
    settings.use_region = False
    settings.use_region = True
    assert tuple(settings.region) == (2, 3, 1, 20, 21, 9)
    settings.region_in = "mm"
    assert settings.region_unit == "mm"
    settings.region_in = "voxel"
    assert tuple(settings.region) == pytest.approx((2, 3, 1, 20, 21, 9), abs=1e-4)


def test_slices_cuts_and_rulers_go_to_the_collection_of_their_ct(loaded, ball_file):
    loaded.ctmc.threshold = 100.0
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.cut_at_slice()
    bpy.ops.ctmc.add_slice(three=True)
    bpy.ops.ctmc.measure_distance(points_mm=(0, 0, 0, 3, 4, 0))
    collection = bpy.data.collections[ball_file.parent.name]
    assert set(loaded.objects) == set(collection.objects)
    assert len(collection.objects) == 7  # box, surface, the slice that cuts, its cut, two more slices, distance
