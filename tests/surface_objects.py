# SPDX-License-Identifier: GPL-3.0-or-later
"""What tests look at in the objects of surfaces."""

from __future__ import annotations

import numpy as np

from ctmc_addon.blender.surface import evaluated_triangles


def alpha_key(obj):
    return obj.data.shape_keys.key_blocks["alpha"]


def worst_mm(obj, mesh):
    seen = evaluated_triangles(obj)
    assert (seen.faces == mesh.faces).all()
    return np.abs(seen.vertices.astype(np.float64) - mesh.vertices).max()
