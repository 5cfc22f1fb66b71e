# SPDX-License-Identifier: GPL-3.0-or-later
"""Store the other CTs of a scene in `scene.ctmc_scans`: the panel's state of each, to restore when it is active again.

As in settings.py, this module must not hold `bpy` itself.
"""

from __future__ import annotations

from typing import Any

from bpy.props import CollectionProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ..kinds import boolean, decimal, integer, text
from ..surface.structures import structure_properties
from .reading import scene_properties

OWN = {
    "volume_path": text("CT", "File or folder that the CT was read from"),
    "volume_fingerprint": text("Fingerprint", "Fingerprint of the CT"),
    "threshold": decimal("Threshold", "Values at or above it are inside [HU or gray value]"),
    "use_threshold": boolean("Threshold", "Whether a threshold was chosen"),
    "upper": decimal("Upper Limit", "Values above it are outside [HU or gray value]"),
    "use_upper": boolean("Upper Limit", "Whether there is an upper limit"),
    "label": integer("Label", "Value of the label in the volume"),
    "use_label": boolean("Structures", "Whether surfaces are made from the list"),
}
"""Besides structures and how it was read; a value stands before its switch, which it would switch on."""
CTMCScan = type(
    "CTMCScan",
    (PropertyGroup,),
    {
        "__annotations__": OWN | structure_properties() | scene_properties(),
        "__doc__": "A CT of the scene that is not the panel's.",
        "__module__": __name__,
    },
)


def take_over(target: Any, source: Any) -> None:
    """Copy all data of a CT, its structures too, from one place to another without change events."""
    for name in CTMCScan.__annotations__:
        if target.bl_rna.properties[name].type == "COLLECTION":
            _copy_lines(getattr(target, name), getattr(source, name))
        elif source.is_property_set(name):
            setattr(target, name, getattr(source, name))
        else:
            target.property_unset(name)


def clear(target: Any) -> None:
    """Forget a CT without change events: everything that `take_over` would copy."""
    for name in CTMCScan.__annotations__:
        if target.bl_rna.properties[name].type == "COLLECTION":
            getattr(target, name).clear()
        else:
            target.property_unset(name)


def _copy_lines(target: Any, source: Any) -> None:
    """Replace the lines of a list by copies of those of another."""
    target.clear()
    for line in source:
        new = target.add()
        for about in line.bl_rna.properties:
            if about.identifier != "rna_type" and line.is_property_set(about.identifier):
                setattr(new, about.identifier, getattr(line, about.identifier))


def register() -> None:
    """Give every scene its other CTs."""
    register_class(CTMCScan)
    Scene.ctmc_scans = CollectionProperty(type=CTMCScan, name="CTMC Scans")


def unregister() -> None:
    """Unregister them; the data in files stays."""
    del Scene.ctmc_scans
    unregister_class(CTMCScan)
