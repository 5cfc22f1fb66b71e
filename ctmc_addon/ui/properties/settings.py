# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings as Blender properties, generated from core.settings: label, text, unit, limits and choices.

`scene.ctmc` carries the settings' own names. A setting that may be absent has a switch `use_<name>` beside it.
Beside them stand what the file knows of its CT, the labels to choose from, and the panel's own switches.

This module must not hold `bpy` itself: Blender 4.2 never lets go of a registered PropertyGroup, nor of what its
functions can see, and a Python whose bpy module stays alive crashes at exit.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import replace
from typing import Any

from bpy.props import PointerProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ...core import EXCLUSIVE, SETTINGS, ReconstructionSettings
from ...core.volume import structure_color
from ..state.change_events import notify
from .described import as_typed, property_of, tooltip
from .kinds import boolean, collection, decimal, decimals, integer, text
from .limits import DEFAULTS, optional, switch
from .panel import fit_region, panel_properties
from .reading import scene_properties

OF_ONE_VOLUME = {"region", "region_unit", "nan_as"}
"""Settings that mean nothing for another CT, which presets leave alone."""


class SettingsMethods:
    """What `scene.ctmc` can do beside holding its properties."""

    labels: Any
    label: Any
    use_label: Any

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
            if not optional(name) or getattr(self, switch(name))
        }
        return ReconstructionSettings.from_dict(values)

    def all_settings(self) -> list[ReconstructionSettings]:
        """Return the settings of every surface to make: one for each label that is ticked, or a single one."""
        settings = self.to_settings()
        if settings.label is None:
            return [settings]
        ticked = [item.value for item in self.labels if item.chosen]
        return [replace(settings, label=label) for label in ticked or [settings.label]]

    def color_of(self, label: int | None) -> tuple[float, float, float] | None:
        """Return the color chosen in the list for a label; None for one that is not in it."""
        return next((tuple(item.color) for item in self.labels if item.value == label), None)

    def opacity_of(self, label: int | None) -> float | None:
        """Return the opacity of a label that its name or the list has chosen; None where nobody has."""
        item = next((item for item in self.labels if item.value == label), None)
        return None if item is None or (item.opacity == 1.0 and not item.opaque) else round(float(item.opacity), 3)

    def name_of(self, label: int) -> str:
        """Return what a label's surface is called: its name in the list, else its number."""
        named = next((item.name for item in self.labels if item.value == label), "")
        return named or f"Label {label}"

    def show_labels(self, labels: list[tuple[int, str, tuple[float, float, float]]]) -> None:
        """Fill the list of labels: value, name and color of each."""
        _filling.append(True)
        self.labels.clear()
        for value, name, color in labels:
            item = self.labels.add()
            item.value, item.name, item.color = value, name, color
            item.opacity = structure_color(value, None, name).opacity
        _filling.clear()
        tick_only(self, self.label if self.use_label else None)

    def show_preset(self, **values: Any) -> None:
        """Show these values and the defaults of all other settings, but of those that belong to one volume."""
        self.from_settings(ReconstructionSettings(**values), but=OF_ONE_VOLUME)

    def from_settings(self, settings: ReconstructionSettings, but: Set[str] = frozenset()) -> None:
        """Show these settings, except those named in `but`."""
        for name in (name for name in SETTINGS if name not in but):
            value = getattr(settings, name)
            if value is not None and value not in SETTINGS[name].words:  # a word is for a script, such as auto
                setattr(self, name, value)
            if optional(name):
                setattr(self, switch(name), value is not None)


def on_change(name: str) -> Callable[[Any, Any], None]:
    """Use a setting from the moment it gets a value: switch it on, and its rivals off."""

    def update(properties: Any, _context: Any) -> None:
        if name == "region":
            properties.region_for = properties.volume_fingerprint
        if optional(name) and not getattr(properties, switch(name)):
            setattr(properties, switch(name), True)
        if name == "smoothing" and properties.smoothing != "gaussian":
            properties.use_smoothing_mm = False
        if name == "label":
            tick_only(properties, properties.label)
        notify(properties, name)

    return update


def on_switch(name: str) -> Callable[[Any, Any], None]:
    """Return an update function: switching one of several rivals on switches the others off."""
    rivals = [other for group in EXCLUSIVE if name in group for other in group if other != name]

    def update(properties: Any, _context: Any) -> None:
        if getattr(properties, switch(name)):
            for other in rivals:
                if getattr(properties, switch(other)):
                    setattr(properties, switch(other), False)
        if name == "region" and properties.use_region and properties.region_for != properties.volume_fingerprint:
            fit_region(properties)
        if name == "label":
            ticked = any(item.chosen for item in properties.labels)
            if not properties.use_label or not ticked:
                tick_only(properties, properties.label if properties.use_label else None)
        notify(properties, name)

    return update


_ticking: list[bool] = []  # not empty while ticks are set by code


def tick_only(properties: Any, label: int | None) -> None:
    """Tick this label in the list, and no other."""
    if _ticking:
        return
    _ticking.append(True)
    for item in properties.labels:
        if item.chosen != (item.value == label):
            item.chosen = item.value == label
    _ticking.clear()


def on_tick(item: Any, _context: Any) -> None:
    """Extract labels once one is ticked in the list; the first ticked one becomes the setting `label`."""
    if _ticking:
        return
    properties = item.id_data.ctmc
    ticked = [label.value for label in properties.labels if label.chosen]
    _ticking.append(True)
    if ticked and properties.label not in ticked:
        properties.label = ticked[0]
    if properties.use_label != bool(ticked):
        properties.use_label = bool(ticked)
    _ticking.clear()
    notify(properties, "label")


_filling: list[bool] = []  # not empty while code fills the list


def on_look(event: str) -> Callable[[Any, Any], None]:
    """Give the surfaces of a label its new name or color."""

    def update(item: Any, _context: Any) -> None:
        if not _filling:
            notify(item.id_data.ctmc, event)

    return update


def on_opacity(item: Any, context: Any) -> None:
    """Give the surfaces of a label its new opacity; one that is opaque now was made so by hand."""
    if not _filling:
        item.opaque = item.opacity == 1.0
    _on_opacity(item, context)


_on_opacity = on_look("label_opacity")


class CTMCLabel(PropertyGroup):
    """A label of the volume: its value, its name, its color, and whether a surface is made of it."""

    value: integer("Value", "Value of the label in the volume")
    chosen: boolean("Reconstruct", "Make a surface of this label", update=on_tick)
    name: text(
        "Name", "What the label is; its surface is called so. Double-click to change it", update=on_look("label_name")
    )
    color: decimals(
        "Color",
        "Color of the label's surface",
        subtype="COLOR",
        size=3,
        min=0.0,
        max=1.0,
        update=on_look("label_color"),
    )
    opacity: decimal(
        "Opacity",
        "How opaque the label's surface is, in the viewport, renders, figures and exports; "
        "made alone, a surface begins opaque",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=1.0,
        precision=2,
        update=on_opacity,
    )
    opaque: boolean("Opaque", "Whether an opacity of 1 was chosen in the list", options={"HIDDEN"})


def all_properties() -> dict[str, Any]:
    """Return every property of `scene.ctmc`."""
    properties: dict[str, Any] = {}
    for name, about in SETTINGS.items():
        if optional(name):
            properties[switch(name)] = boolean(f"Use {about.label}", tooltip(about), update=on_switch(name))
        options: dict[str, Any] = {"update": on_change(name)}
        if about.unit == "mm" and about.size == 1:
            options["unit"] = "CAMERA"  # Blender shows it in mm, whatever the scene's unit scale
        properties[name] = property_of(about, about.start if optional(name) else getattr(DEFAULTS, name), **options)
    return properties | volume_properties() | panel_properties()


def volume_properties() -> dict[str, Any]:
    """Return what the file knows of its CT, and how it is to be read."""
    return {
        "volume_path": text("CT", "File or folder that the CT was read from"),
        "volume_fingerprint": text("Fingerprint", "To know the CT again by"),
        "labels": collection("Labels", "Labels of the volume", type=CTMCLabel),
        "label_index": integer("Label", "Line of the list that is marked"),
    } | scene_properties()


CTMCSettings = type(
    "CTMCSettings",
    (SettingsMethods, PropertyGroup),
    {"__annotations__": all_properties(), "__doc__": "How the next surface is made.", "__module__": __name__},
)


def register() -> None:
    """Register the settings and give every scene its own."""
    register_class(CTMCLabel)
    register_class(CTMCSettings)
    Scene.ctmc = PointerProperty(type=CTMCSettings, name="CTMC")


def unregister() -> None:
    """Take the settings away again; what a file holds of them stays in the file."""
    del Scene.ctmc
    unregister_class(CTMCSettings)
    unregister_class(CTMCLabel)
