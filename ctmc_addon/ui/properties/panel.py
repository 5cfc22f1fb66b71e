# SPDX-License-Identifier: GPL-3.0-or-later
"""Define properties of the panel only: settings in a user's terms, the preview, the rotation test.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from typing import Any

from ...core import GOALS, SETTINGS
from ...core.volume import converted_region, labels_region
from ..state.change_events import notify
from .kinds import boolean, choice, decimal, decimals, integer, text
from .limits import highest, switch
from .surface.threshold_choice import threshold_properties


def current_volume(properties: Any) -> Any:
    """Return the scene's volume, in memory or in its file; `volumes` holds bpy and is looked up only when asked."""
    from ..state.ct import volumes

    return volumes.current_full(properties.id_data)


def fit_region(properties: Any) -> None:
    """Put the region around the ticked labels, else around the whole CT; without a CT it stays."""
    from ..state.surface import structures

    volume = structures.label_volume(properties.id_data) if properties.use_label else None
    volume = volume or current_volume(properties)
    if volume is not None:
        ticked = [item for item in properties.labels if item.chosen] if properties.use_label else []
        is_whole = any(item.kind == "threshold" for item in ticked)
        labels = [] if is_whole else [item.value for item in ticked]
        properties.region = labels_region(volume, labels, properties.region_unit)


def _get_unit(properties: Any) -> int:
    return SETTINGS["region_unit"].choices.index(properties.region_unit)


def _set_unit(properties: Any, number: int) -> None:
    """Change the region's unit; the box stays where it is and its numbers are converted."""
    before, unit = properties.region_unit, SETTINGS["region_unit"].choices[number]
    volume = current_volume(properties)
    used = properties.use_region
    if volume is not None and before != unit:
        properties.region = converted_region(volume, tuple(properties.region), before, unit)
    properties.region_unit = unit
    properties.use_region = used


NO_GOAL = "none"


def _get_goal(properties: Any) -> int:
    """Return the number of the goal that is used, 0 without a goal."""
    used = [name for name in GOALS if getattr(properties, switch(name))]
    return GOALS.index(used[0]) + 1 if used and properties.simplifier != "none" else 0


def _set_goal(properties: Any, number: int) -> None:
    """Change the goal of simplification; where Decimate cannot reach it, choose the built-in method."""
    goal = GOALS[number - 1] if number else ""
    if goal and (properties.simplifier == "none" or goal == "max_error_mm"):
        properties.simplifier = "builtin"
    for name in GOALS:
        if getattr(properties, switch(name)) != (name == goal):
            setattr(properties, switch(name), name == goal)


def _get_method(properties: Any) -> int:
    """Return 0 for the built-in simplifier, 1 for Decimate."""
    return int(properties.simplifier == "decimate")


def _set_method(properties: Any, number: int) -> None:
    properties.simplifier = "decimate" if number else "builtin"


def _get_ratio(properties: Any) -> float:
    """Return the share of the triangles to keep."""
    return float(1.0 - properties.reduction)


def _set_ratio(properties: Any, ratio: float) -> None:
    properties.reduction = min(1.0 - ratio, highest(SETTINGS["reduction"]))


def _get_keep_largest(properties: Any) -> bool:
    return bool(properties.keep_parts > 0)


def _set_keep_largest(properties: Any, keeps: bool) -> None:
    """Keep only the largest component, or all of them."""
    if keeps != _get_keep_largest(properties):
        properties.keep_parts = int(keeps)


def _get_color(properties: Any) -> Any:
    """Return the color of the active surface; bone without one."""
    from ..state.results import surfaces

    return surfaces.active_color(properties.id_data)


def _set_color(properties: Any, color: Any) -> None:
    from ..state.results import surfaces

    surfaces.recolor_active(properties.id_data, tuple(color))


def _get_opacity(properties: Any) -> float:
    """Return the opacity of the active surface; 1 without one."""
    from ..state.results import surfaces

    return surfaces.active_opacity(properties.id_data)


def set_opacity(properties: Any, opacity: float) -> None:
    """Change the opacity of the active surface."""
    from ..state.results import surfaces

    surfaces.fade_active(properties.id_data, opacity)


DISPLAYS = ("FULL", "LIGHT")


def _get_display(properties: Any) -> int:
    """Return the number of the display of the active surface."""
    from ..state.results import surfaces

    return DISPLAYS.index("LIGHT" if surfaces.is_active_light(properties.id_data) else "FULL")


def _set_display(properties: Any, number: int) -> None:
    from ..state.results import surfaces

    surfaces.show_active(properties.id_data, light=DISPLAYS[number] == "LIGHT")


def _get_surface_from(properties: Any) -> int:
    """Return 0 for a surface by threshold, 1 for one by label."""
    return int(properties.use_label)


def _set_surface_from(properties: Any, use_label: int) -> None:
    if bool(use_label) != properties.use_label:
        properties.use_label = bool(use_label)


def panel_properties() -> dict[str, Any]:
    """Return the properties that only the panel has."""
    return threshold_properties() | {
        "surface_from": choice(
            "Surface From",
            "Make one surface at a gray value, or one for each structure",
            items=[
                ("threshold", "Threshold", "At a gray value: values at or above it are inside"),
                ("label", "Structures", "Several structures at once: labels, and thresholds added to the list"),
            ],
            get=_get_surface_from,
            set=_set_surface_from,
        ),
        "goal": choice(
            "Simplify To",
            "Target of the simplification",
            items=[
                (NO_GOAL, "None", "Keep every triangle"),
                ("reduction", "Ratio", "A share of the triangles"),
                ("target_faces", "Triangles", "A number of triangles"),
                ("max_error_mm", "Maximum Error", "As few triangles as possible within a distance of the full surface"),
            ],
            get=_get_goal,
            set=_set_goal,
        ),
        "method": choice(
            "Method",
            "Simplification method",
            items=[
                ("builtin", "Built-In", "Quadric error simplification, once: exact, and the mesh is small"),
                ("decimate", "Decimate", "Blender's modifier, which stays live; it has no maximum error"),
            ],
            get=_get_method,
            set=_set_method,
        ),
        "ratio": decimal(
            "Ratio",
            "Share of the triangles to keep, as in Blender's Decimate. Smaller = fewer triangles",
            subtype="FACTOR",
            min=0.0,
            max=1.0,
            precision=3,
            get=_get_ratio,
            set=_set_ratio,
        ),
        "keep_largest": boolean(
            SETTINGS["keep_parts"].label, SETTINGS["keep_parts"].text, get=_get_keep_largest, set=_set_keep_largest
        ),
        "region_in": choice(
            "Unit",
            "Unit of the region's numbers; changing it does not move the box",
            items=[("voxel", "Voxels", "Voxel indices"), ("mm", "mm", "RAS+ millimeters")],
            get=_get_unit,
            set=_set_unit,
        ),
        "region_for": text("Region Of", "Fingerprint of the CT that the region was set for", options={"HIDDEN"}),
        "color": decimals(
            "Color",
            "Color of the active surface, in the viewport and in renders",
            subtype="COLOR",
            size=3,
            min=0.0,
            max=1.0,
            get=_get_color,
            set=_set_color,
        ),
        "opacity": decimal(
            "Opacity",
            "How opaque the active surface is, in the viewport, renders, figures and exports; its rim is denser",
            subtype="FACTOR",
            min=0.0,
            max=1.0,
            precision=2,
            get=_get_opacity,
            set=set_opacity,
        ),
        "display": choice(
            "Display",
            "Triangles of the active surface in the viewport. Renders, measures and exports of CTMC are full; "
            "Blender's own exporters and Convert take what the viewport shows",
            items=[
                ("FULL", "Full", "Show every triangle"),
                (
                    "LIGHT",
                    "Light",
                    "Show some 300,000 triangles that follow the surface, so that the viewport is faster",
                ),
            ],
            get=_get_display,
            set=_set_display,
        ),
        "preview": boolean(
            "Live Preview",
            "Show a coarse surface in the viewport that follows the settings",
            default=True,
            update=lambda properties, _: notify(properties, "preview"),
        ),
        "rotation_kind": choice(
            "Motion",
            "Motion to time",
            items=[
                ("rotate", "Rotate", "Turn about the patient's long axis"),
                ("zoom", "Zoom", "Move closer and back"),
                ("pan", "Pan", "Move sideways and back"),
            ],
        ),
        "rotation_levels": text("Levels [%]", "Shares of removed triangles to compare [%]", default="0, 50, 90"),
        "rotation_step": integer(
            "Step [°]", "Angle between two pictures [degrees]. Smaller = more pictures", default=20, min=1, max=180
        ),
        "rotation_rounds": integer(
            "Rounds", "How often to turn each level. Larger = steadier mean", default=5, min=1, max=100
        ),
    }
