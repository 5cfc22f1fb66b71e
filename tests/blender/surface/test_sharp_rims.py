# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of solids are shaded with sharp rims."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bpy")

from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.blender.surface.mesh_data import corner_normals, read_triangles
from ctmc_addon.core import ReconstructionSettings, Volume
from ctmc_addon.core.solid import Cut, SolidRequest, solid_parts


def test_a_flat_cut_is_shaded_flat_up_to_its_rim(scene):
    x, y, z = np.meshgrid(*[np.arange(21) - 10.0] * 3, indexing="ij")
    ball = Volume((100 - 10 * np.sqrt(x * x + y * y + z * z)).astype(np.float32), np.eye(4))
    solid = SolidRequest(cuts=(Cut((10, 10, 10), (0, 0, 1)),))
    part, _ = solid_parts(ball, ReconstructionSettings(threshold=30), solid)
    obj = add_reconstruction(part, scene)
    heights = part.mesh.vertices[read_triangles(obj.data), 2]
    flat = (heights < 10.01).all(axis=1)
    normals = corner_normals(obj.data).reshape(-1, 3, 3)[flat]
    assert flat.sum() > 50
    assert np.abs(normals - (0, 0, -1)).max() < 0.01
