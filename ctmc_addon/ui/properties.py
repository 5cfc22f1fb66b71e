"""The settings as Blender properties, generated from core.settings: label, text, unit, limits and choices.

`scene.ctmc` carries the settings' own names. A setting that may be absent has a switch `use_<name>` beside it.

This module must not hold `bpy` itself: Blender 4.2 never lets go of a registered PropertyGroup, nor of what its
functions can see, and a Python whose bpy module stays alive crashes at exit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ..core import ReconstructionSettings
from ..core.settings import Setting, described

# What a setting that may be absent starts from when it is switched on.
STARTS: dict[str, Any] = {
    "threshold": 200.0,
    "label": 1,
    "region": (0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
    "reduction": 0.9,
    "target_faces": 10_000,
    "max_error_mm": 0.5,
    "nan_as": -1024.0,
}
# Of these only one may be on; core refuses more.
RIVALS = (("threshold", "label"), ("reduction", "target_faces", "max_error_mm"))
DEFAULTS = ReconstructionSettings()


class SettingsMethods:
    """What `scene.ctmc` can do beside holding its properties."""

    def to_settings(self) -> ReconstructionSettings:
        """The settings as core takes them, checked.

        Raises
        ------
        SettingsError
            If two of them contradict each other.
        """
        values = {
            name: as_typed(getattr(self, name), about)
            for name, about in described().items()
            if not optional(name) or getattr(self, switch(name))
        }
        return ReconstructionSettings.from_dict(values)

    def from_settings(self, settings: ReconstructionSettings) -> None:
        """Show these settings."""
        for name in described():
            value = getattr(settings, name)
            if value is not None:
                setattr(self, name, value)
            if optional(name):
                setattr(self, switch(name), value is not None)


def optional(name: str) -> bool:
    """Whether a setting may be absent."""
    return getattr(DEFAULTS, name) is None


def as_typed(value: Any, about: Setting) -> Any:
    """The number as it was typed: Blender keeps 0.9 in float32, which read back would be 0.89999998."""
    if about.type is float:
        typed = [float(str(np.float32(one))) for one in np.atleast_1d(np.asarray(value, np.float32))]
        return typed if about.size > 1 else typed[0]
    return tuple(value) if about.size > 1 else value


def property_of(name: str, about: Setting) -> Any:
    """The Blender property of one setting."""
    default = STARTS[name] if optional(name) else getattr(DEFAULTS, name)
    common = {"name": about.label, "description": tooltip(about), "default": default}
    if optional(name):
        common["update"] = turn_on(name)
    if about.type is bool:
        return BoolProperty(**common)
    if about.type is str:
        return EnumProperty(items=[(choice, choice.title(), "") for choice in about.choices], **common)
    if about.size > 1:
        common["size"] = about.size
    whole = about.type is int
    if about.low is not None:
        common["min"] = int(about.low) if whole else about.low
    if about.high is not None:
        common["max"] = int(about.high) if whole else highest(about)
    if whole:
        return IntVectorProperty(**common) if about.size > 1 else IntProperty(**common)
    common["precision"] = 3
    return FloatVectorProperty(**common) if about.size > 1 else FloatProperty(**common)


def tooltip(about: Setting) -> str:
    """The setting's text with its unit."""
    return f"{about.text} [{about.unit}]" if about.unit else about.text


def highest(about: Setting) -> float:
    """The largest float32 that the setting allows."""
    high = np.float32(about.high)
    return float(np.nextafter(high, np.float32(0.0)) if about.high_open else high)


def switch(name: str) -> str:
    """The property that says whether a setting is there."""
    return f"use_{name}"


def turn_on(name: str) -> Callable[[Any, Any], None]:
    """Whoever gives a setting a value wants it used."""

    def update(properties: Any, _context: Any) -> None:
        setattr(properties, switch(name), True)

    return update


def turn_rivals_off(name: str) -> Callable[[Any, Any], None]:
    """Switching one of several rivals on switches the others off."""
    rivals = [other for group in RIVALS if name in group for other in group if other != name]

    def update(properties: Any, _context: Any) -> None:
        if getattr(properties, switch(name)):
            for other in rivals:
                setattr(properties, switch(other), False)

    return update


def all_properties() -> dict[str, Any]:
    """Every property of `scene.ctmc`."""
    found: dict[str, Any] = {}
    for name, about in described().items():
        if optional(name):
            found[switch(name)] = BoolProperty(
                name=f"Use {about.label}", description=tooltip(about), update=turn_rivals_off(name)
            )
        found[name] = property_of(name, about)
    found["volume_path"] = StringProperty(name="CT", description="File or folder that the CT was read from")
    return found


CTMCSettings = type(
    "CTMCSettings",
    (SettingsMethods, PropertyGroup),
    {"__annotations__": all_properties(), "__doc__": "How the next surface is made.", "__module__": __name__},
)


def register() -> None:
    """Register the settings and give every scene its own."""
    register_class(CTMCSettings)
    Scene.ctmc = PointerProperty(type=CTMCSettings, name="CTMC")


def unregister() -> None:
    """Take the settings away again; what a file holds of them stays in the file."""
    del Scene.ctmc
    unregister_class(CTMCSettings)
