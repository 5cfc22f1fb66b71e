# SPDX-License-Identifier: GPL-3.0-or-later
"""A loaded CT to draw on."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")


@pytest.fixture
def drawing(loaded):
    bpy.ops.ed.undo_push(message="Loaded")
    return loaded.ctmc_draw
