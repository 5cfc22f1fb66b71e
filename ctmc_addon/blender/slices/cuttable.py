# SPDX-License-Identifier: GPL-3.0-or-later
"""Find objects that can be cut open: meshes that are neither slices nor cutting boxes."""

from __future__ import annotations

import bpy

from ...core import MeshError
from .plane import is_slice

BOX = "ctmc_cut_box"  # Custom property of a box that cuts.


def is_cut_box(obj: bpy.types.Object | None) -> bool:
    """Return whether an object was made by `add_cut_box`."""
    return obj is not None and obj.type == "MESH" and BOX in obj


def is_cuttable(obj: bpy.types.Object) -> bool:
    """Return whether an object can be cut open."""
    return obj.type == "MESH" and not is_slice(obj) and not is_cut_box(obj)


def require_cuttable(obj: bpy.types.Object) -> None:
    """Raise `MeshError` for an object that cannot be cut open."""
    if not is_cuttable(obj):
        raise MeshError(f"{obj.name} is not a surface; choose surfaces")
