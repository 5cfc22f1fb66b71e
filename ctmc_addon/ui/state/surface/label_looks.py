# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply a name, color or opacity of the list's structures to their surfaces."""

from __future__ import annotations

from typing import Any

from ....blender.colors import part_color
from ....blender.materials import recolor
from ....blender.surface import call, read_provenance
from ....blender.tissue import set_opacity
from ...properties.surface.structures import called
from .. import change_events

NAME, COLOR, OPACITY = "label_name", "label_color", "label_opacity"


def follow(properties: Any, name: str) -> None:
    """Update the surfaces of the scene's CT to the names, colors and opacities of the list."""
    if name not in (NAME, COLOR, OPACITY):
        return
    scene = properties.id_data
    for obj in scene.objects:
        provenance = read_provenance(obj)
        if provenance is None or provenance.fingerprint != properties.volume_fingerprint or obj.library is not None:
            continue
        item = properties.structure_of(provenance.settings)
        if item is None:
            continue
        if name == NAME:
            if called(item) and not provenance.part:  # A part keeps the name that Reconstruct finds it by.
                call(obj, f"{properties.volume_name} {called(item)}".strip())
        elif name == OPACITY:
            set_opacity(obj, round(float(item.opacity), 3))
        else:
            recolor(obj, part_color(tuple(item.color), provenance.part_number))


def register() -> None:
    """Listen for changes of the list."""
    change_events.subscribe(follow)


def unregister() -> None:
    """Stop listening for changes."""
    change_events.unsubscribe(follow)
