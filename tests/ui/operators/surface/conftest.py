# SPDX-License-Identifier: GPL-3.0-or-later
"""A CT in the panel."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")


@pytest.fixture
def loaded(scene, ball_file):
    """The ball, loaded, threshold 100."""
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    scene.ctmc.threshold = 100.0
    return scene
