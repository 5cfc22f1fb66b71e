# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the viewport's settings except the surface: `scene.ctmc_view`, the slice, its window and level, the letters.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

from bpy.props import FloatVectorProperty, PointerProperty, StringProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ....core import Volume
from ....core.volume import PLANES, default_window, value_range
from ...state.change_events import notify
from ..kinds import boolean, choice, decimal

_usual: WeakKeyDictionary[Volume, tuple[float, float]] = WeakKeyDictionary()


def current_volume(scene: Any) -> Volume | None:
    """Return the scene's volume; `volumes` holds bpy and is looked up only when asked."""
    from ...state.ct import volumes

    return volumes.current(scene)


def window_and_level(view: Any) -> tuple[float, float]:
    """Return window and level chosen for this volume, else those that suit its kind and range."""
    scene = view.id_data
    if view.chosen_for == scene.ctmc.volume_fingerprint:
        return tuple(view.chosen_window)
    volume = current_volume(scene)
    if volume is None:
        return (1.0, 0.5)
    if volume not in _usual:
        _usual[volume] = default_window(volume, *value_range(volume.values))
    return _usual[volume]


def choose(view: Any, window: float, level: float) -> None:
    """Store window and level for the present volume.

    Parameters
    ----------
    view : scene.ctmc_view
    window : float
        In the values' unit.
    level : float
    """
    view.chosen_for = view.id_data.ctmc.volume_fingerprint
    view.chosen_window = (window, level)
    notify(view.id_data.ctmc, "window")


def positions_of(view: Any) -> list[float]:
    """Return the position of the slice in each plane; a file of version 0.2 has one position for all."""
    if not view.is_property_set("positions"):
        # Blender 5 keeps what is registered apart from what a user has added.
        stored = view.bl_system_properties_get() if hasattr(view, "bl_system_properties_get") else view
        if stored is not None and "position" in stored:
            return [float(stored["position"])] * len(PLANES)
    return list(view.positions)


def _get_position(view: Any) -> float:
    return positions_of(view)[list(PLANES).index(view.plane)]


def _set_position(view: Any, position: float) -> None:
    positions = positions_of(view)
    positions[list(PLANES).index(view.plane)] = position
    view.positions = positions


def _get_window(view: Any) -> float:
    return window_and_level(view)[0]


def _get_level(view: Any) -> float:
    return window_and_level(view)[1]


def set_window(view: Any, window: float) -> None:
    """Change the window from its slider."""
    choose(view, window, window_and_level(view)[1])


def _set_level(view: Any, level: float) -> None:
    choose(view, window_and_level(view)[0], level)


class CTMCView(PropertyGroup):
    """Settings of the CT's display in the viewport."""

    show_slice: boolean("Slice in Viewport", "Show a slice of the CT at its true position", default=True)
    show_letters: boolean(
        "Orientation Letters",
        "Show the patient's sides: R and L, A and P (front and back), S and I (head and feet)",
        default=True,
    )
    plane: choice(
        "Plane",
        "Orientation of the slice in the patient",
        items=[
            ("axial", "Axial", "Across the body; the slider runs from the feet to the head"),
            ("coronal", "Coronal", "As seen from the front; the slider runs from back to front"),
            ("sagittal", "Sagittal", "As seen from the side; the slider runs from left to right"),
        ],
    )
    position: decimal(
        "Position",
        "Position of the slice: 0 = feet, back or left end of the volume, 1 = head, front or right end",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        precision=3,
        get=_get_position,
        set=_set_position,
    )
    positions: FloatVectorProperty(size=3, default=(0.5, 0.5, 0.5), min=0.0, max=1.0, options={"HIDDEN"})
    window: decimal(
        "Window",
        "Width of the range shown from black to white, in HU or gray values. Larger = less contrast",
        min=1e-3,
        soft_max=4000.0,
        precision=1,
        step=500,
        get=_get_window,
        set=set_window,
    )
    level: decimal(
        "Level",
        "Middle of the range shown from black to white, in HU or gray values. Larger = darker",
        soft_min=-1500.0,
        soft_max=3000.0,
        precision=1,
        step=500,
        get=_get_level,
        set=_set_level,
    )
    chosen_window: FloatVectorProperty(size=2, options={"HIDDEN"})
    chosen_for: StringProperty(options={"HIDDEN"})


def register() -> None:
    """Give every scene its view."""
    register_class(CTMCView)
    Scene.ctmc_view = PointerProperty(type=CTMCView, name="CTMC View")


def unregister() -> None:
    """Unregister it."""
    del Scene.ctmc_view
    unregister_class(CTMCView)
    _usual.clear()
