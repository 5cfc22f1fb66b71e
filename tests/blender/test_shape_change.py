# SPDX-License-Identifier: GPL-3.0-or-later
"""An object that was mirrored or scaled is known as such, applied or not."""

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.shape_change import shape_change
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct


@pytest.fixture
def surface():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    values = -distance_mm((12, 14, 16), center=(6.0, 7.0, 5.5), spacing=(1.0, 1.2, 1.5))
    volume = Volume(values, np.diag([1.0, 1.2, 1.5, 1.0]))
    result = reconstruct(volume, ReconstructionSettings(threshold=-5.0))
    obj = add_reconstruction(result, bpy.context.scene)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return obj


@pytest.mark.parametrize("applied", [False, True])
@pytest.mark.parametrize(
    ("scale", "turn", "mirrored", "text"),
    [
        ((1, 1, 1), 1.0, False, ""),
        ((-1, 1, 1), 0.0, True, ""),
        ((-1, -1, 1), 0.3, False, ""),  # half a turn
        ((-2, -2, -2), 0.5, True, "2"),
        ((1, 1, 1.5), 0.0, False, "1 x 1 x 1.5"),
    ],
)
def test_it_is_told_from_a_turn_and_survives_apply(surface, applied, scale, turn, mirrored, text):
    surface.scale, surface.rotation_euler.x, surface.location.x = scale, turn, 3.0
    bpy.context.view_layer.update()
    if applied:
        surface.shape_key_remove(surface.data.shape_keys.key_blocks["alpha"])
        surface.shape_key_clear()
        bpy.ops.object.transform_apply()
    change = shape_change(surface)
    assert change.mirrored == mirrored
    assert (change.factors_text if change.scaled else "") == text
