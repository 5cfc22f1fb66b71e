# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension registered in a fresh Blender file, and a ball on disk."""

from __future__ import annotations

import numpy as np
import pytest

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
    z, y, x = np.indices((12, 24, 24)) - np.array([5.5, 11.5, 11.5])[:, None, None, None]
    values = 160 - 10 * np.sqrt(x**2 + y**2 + (2 * z) ** 2)
    np.save(tmp_path / "ball.npy", values.astype(np.int16))
    return tmp_path / "ball.npy"
