# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the reading options as Blender properties, of a scene and of the dialog that loads a CT.

0, an empty text and no ticked axis stand for an option that is not given. A scene has a switch for each axis to flip
and keeps the name as `volume_name`. As in settings.py, this module must not hold `bpy` itself.
"""

from __future__ import annotations

from typing import Any

from ....core import defaults, descriptions
from ....readers import ReadingOptions
from ..described import as_typed, property_of, tooltip
from ..kinds import boolean, booleans

SHOWN = ("spacing", "flip", "series", "time", "strict", "skip_damaged", "remove_table")
"""The options that say what is read; the others are for the command line (colors are changed in the list)."""
SIDES = {"x": "Left - Right", "y": "Front - Back", "z": "Head - Feet"}
LOOKS: dict[str, dict[str, Any]] = {"spacing": {"subtype": "XYZ", "unit": "CAMERA"}}
"""Display options of reading options that their descriptions do not contain."""


def scene_properties() -> dict[str, Any]:
    """Return the properties of a scene that store how its CT is read and named."""
    about = descriptions(ReadingOptions)
    properties = {name: option(name) for name in SHOWN if name != "flip"}
    properties |= {f"flip_{axis}": option("flip", axis) for axis in SIDES}
    return properties | {"volume_name": property_of(about["name"], None)}


def dialog_properties() -> dict[str, Any]:
    """Return the properties of the dialog, and those that buttons and scripts set."""
    hidden = {"flip", "series", "time"}
    properties = {
        name: option(name, options={"SKIP_SAVE", "HIDDEN"} if name in hidden else {"SKIP_SAVE"}) for name in SHOWN
    }
    about = descriptions(ReadingOptions)["flip"]
    return properties | {"flip_axes": booleans(about.label, tooltip(about), size=3, options={"SKIP_SAVE"})}


def option(name: str, axis: str = "", **options: Any) -> Any:
    """Return the property of one option, or the switch of one axis of `flip`."""
    about = descriptions(ReadingOptions)[name]
    if axis:
        return boolean(SIDES[axis], tooltip(about), **options)
    return property_of(about, defaults(ReadingOptions)[name], **LOOKS.get(name, {}), **options)


def options_of_scene(stored: Any) -> ReadingOptions:
    """Return the reading options in the panel for the scene's CT."""
    return _options_of(stored, "".join(axis for axis in SIDES if getattr(stored, f"flip_{axis}")))


def options_of_dialog(operator: Any) -> ReadingOptions:
    """Return the reading options of the dialog, a button or a script."""
    ticked = "".join(axis for axis, is_ticked in zip(SIDES, operator.flip_axes, strict=True) if is_ticked)
    return _options_of(operator, operator.flip or ticked)


def _options_of(properties: Any, flip: str) -> ReadingOptions:
    """Return the options in the properties of a scene or a dialog."""
    values: dict[str, Any] = {}
    for name in SHOWN:
        if name != "flip":
            value = as_typed(getattr(properties, name), descriptions(ReadingOptions)[name])
            values[name] = value if any(value if isinstance(value, tuple) else (value,)) else None
    switches = {name: getattr(properties, name) for name in ("strict", "skip_damaged", "remove_table")}
    return ReadingOptions(**values | {"flip": flip} | switches)


def set_button(button: Any, options: ReadingOptions) -> None:
    """Set the properties of a button that reads a CT with these options."""
    for name in SHOWN:
        value = getattr(options, name)
        if value is not None:
            setattr(button, name, value)


def show_options(stored: Any, options: ReadingOptions) -> None:
    """Store in a scene how its CT was read."""
    for name in SHOWN:
        value = getattr(options, name)
        if name == "flip":
            for axis in SIDES:
                setattr(stored, f"flip_{axis}", axis in value)
        elif value is None:
            stored.property_unset(name)
        else:
            setattr(stored, name, value)
