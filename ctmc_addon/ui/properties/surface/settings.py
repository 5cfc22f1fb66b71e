# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the settings as Blender properties, generated from core.settings: label, text, unit, limits and choices.

`scene.ctmc` has the settings' own names. An optional setting also has a switch `use_<name>`.
`scene.ctmc` also stores the file's CT, its structures, and the panel's own switches.

This module must not hold `bpy` itself: Blender 4.2 never lets go of a registered PropertyGroup, nor of what its
functions can see, and a Python whose bpy module stays alive crashes at exit.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from typing import Any

from bpy.props import PointerProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ....core import EXCLUSIVE, SETTINGS, ReconstructionSettings, has_width
from ...state.change_events import notify
from ..ct.reading import scene_properties
from ..described import as_typed, property_of, tooltip
from ..kinds import boolean, text
from ..limits import DEFAULTS, optional, switch
from ..panel import fit_region, panel_properties
from .structures import CLASSES, StructureMethods, structure_properties, tick_only

OF_ONE_VOLUME = {"region", "region_unit", "nan_as"}
"""Settings that mean nothing for another CT, which presets leave alone."""
OF_GRAY = {rival for group in EXCLUSIVE if "label" in group for rival in group} - {"label"}
"""Settings of a surface by gray value. `use_label` alone decides between them and the structures: each side keeps its
own, so looking at the other side loses nothing."""


class _SettingsMethods(StructureMethods):
    """Methods of `scene.ctmc`."""

    def to_settings(self) -> ReconstructionSettings:
        """Return the settings as core takes them, checked.

        Raises
        ------
        SettingsError
            If two of them contradict each other.
        """
        values = {
            name: as_typed(getattr(self, name), about)
            for name, about in SETTINGS.items()
            if not optional(name) or (getattr(self, switch(name)) and not (self.use_label and name in OF_GRAY))
        }
        return ReconstructionSettings.from_dict(values)

    def all_settings(self) -> list[ReconstructionSettings]:
        """Return the settings of every surface to make: one for each structure that is ticked, or a single one."""
        settings = self.to_settings()
        return [settings] if settings.label is None else self.ticked_settings(settings)

    def show_preset(self, **values: Any) -> None:
        """Show these values and the defaults of all other settings, except those that belong to one volume."""
        self.from_settings(ReconstructionSettings(**values), but=OF_ONE_VOLUME)

    def from_settings(self, settings: ReconstructionSettings, but: Set[str] = frozenset()) -> None:
        """Show these settings, except those named in `but`; those of a label leave the threshold alone."""
        left = but if settings.label is None else but | OF_GRAY
        for name in (name for name in SETTINGS if name not in left):
            value = getattr(settings, name)
            if value is not None and value not in SETTINGS[name].words:  # Words such as auto are for scripts.
                setattr(self, name, value)
            if optional(name):
                setattr(self, switch(name), value is not None)


def _on_change(name: str) -> Callable[[Any, Any], None]:
    """Switch a setting on when it gets a value, and switch its rivals off."""

    def update(properties: Any, _context: Any) -> None:
        if name == "region":
            properties.region_for = properties.volume_fingerprint
        if optional(name) and not getattr(properties, switch(name)):
            setattr(properties, switch(name), True)
        if name in OF_GRAY and properties.use_label:
            properties.use_label = False
        if name == "smoothing" and not has_width(properties.smoothing):
            properties.use_smoothing_mm = False
        if name == "label":
            tick_only(properties, properties.label)
        notify(properties, name)

    return update


def _on_switch(name: str) -> Callable[[Any, Any], None]:
    """Return an update function: switching one of several rivals on switches the others off."""
    rivals = [
        rival for group in EXCLUSIVE if name in group and "label" not in group for rival in group if rival != name
    ]

    def update(properties: Any, _context: Any) -> None:
        if getattr(properties, switch(name)):
            for rival in rivals:
                if getattr(properties, switch(rival)):
                    setattr(properties, switch(rival), False)
        if name == "region" and properties.use_region and properties.region_for != properties.volume_fingerprint:
            fit_region(properties)
        if name == "label" and properties.use_label and not any(item.chosen for item in properties.labels):
            tick_only(properties, properties.label)
        notify(properties, name)

    return update


def all_properties() -> dict[str, Any]:
    """Return every property of `scene.ctmc`."""
    properties: dict[str, Any] = {}
    for name, about in SETTINGS.items():
        if optional(name):
            properties[switch(name)] = boolean(f"Use {about.label}", tooltip(about), update=_on_switch(name))
        options: dict[str, Any] = {"update": _on_change(name)}
        if about.unit == "mm" and about.size == 1:
            options["unit"] = "CAMERA"  # Blender shows it in mm, whatever the scene's unit scale
        properties[name] = property_of(about, about.start if optional(name) else getattr(DEFAULTS, name), **options)
    return properties | _volume_properties() | panel_properties()


def _volume_properties() -> dict[str, Any]:
    """Return the properties that store the file's CT and how to read it."""
    return {
        "volume_path": text("CT", "File or folder that the CT was read from"),
        "volume_fingerprint": text("Fingerprint", "Fingerprint of the CT"),
    } | {**structure_properties(), **scene_properties()}


CTMCSettings = type(
    "CTMCSettings",
    (_SettingsMethods, PropertyGroup),
    {"__annotations__": all_properties(), "__doc__": "How the next surface is made.", "__module__": __name__},
)


def register() -> None:
    """Register the settings and give every scene its own."""
    for kind in CLASSES:
        register_class(kind)
    register_class(CTMCSettings)
    Scene.ctmc = PointerProperty(type=CTMCSettings, name="CTMC")


def unregister() -> None:
    """Unregister the settings; the data in files stays."""
    del Scene.ctmc
    unregister_class(CTMCSettings)
    for kind in reversed(CLASSES):
        unregister_class(kind)
