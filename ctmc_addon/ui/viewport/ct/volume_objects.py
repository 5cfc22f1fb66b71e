# SPDX-License-Identifier: GPL-3.0-or-later
"""Update Volume objects by the threshold, window and level of the sidebar."""

from __future__ import annotations

from typing import Any

import bpy

from ....blender.volume import adjust, of_ct
from ...state import change_events

NUMBERS = ("threshold", "window", "level")


def follow(properties: Any, name: str) -> None:
    """Apply a changed setting of the scene to the materials of the CT's volumes."""
    if name not in NUMBERS:
        return
    scene: bpy.types.Scene = properties.id_data
    view = scene.ctmc_view
    numbers = (
        {"threshold": properties.threshold} if name == "threshold" else {"window": view.window, "level": view.level}
    )
    for obj in of_ct(scene, properties.volume_fingerprint):
        for material in obj.data.materials:
            if material is not None and material.node_tree is not None:
                adjust(material, **numbers)


register, unregister = change_events.following(follow)
