# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension registered in a fresh Blender file, and a ball on disk."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

import ctmc_addon


@pytest.fixture
def scene():
    """The only scene of a fresh file, the extension registered."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    ctmc_addon.register()
    yield bpy.context.scene
    ctmc_addon.unregister()


@pytest.fixture
def ball_file(tmp_path):
    """A ball of 6 mm radius at 100 and above, 1 x 1 x 2 mm once the spacing is given."""
    values = 160 - 10 * distance_mm((12, 24, 24), spacing=(1, 1, 2))
    np.save(tmp_path / "ball.npy", values.astype(np.int16))
    return tmp_path / "ball.npy"


@pytest.fixture
def loaded(scene, ball_file):
    """The ball, loaded, threshold 100."""
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    scene.ctmc.threshold = 100.0
    return scene
