# SPDX-License-Identifier: GPL-3.0-or-later
"""Define settings of figures: `scene.ctmc_figure`, generated from blender.figure.spec.

The panel's own properties are added to the generated ones: kind, format, file, and the switches. As in
settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from typing import Any

from bpy.props import PointerProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ....core import defaults, descriptions
from ..described import as_typed, property_of, tooltip, with_unit
from ..kinds import boolean, choice, text

FRAMES = "frames"  # Stands for a video's suffix.
OF_EACH_PAGE = ("width_mm", "dpi")
"""Fields of a page that each kind of figure has for itself, as `figure_dpi`."""
SHOWN = (
    *("transparent", "dark", "style", "engine", "azimuth", "elevation", "scale_bar", "orientation", "caption"),
    *("hiding_opacity", "explode", "limit_mm", "seconds", "fps", "revolutions"),
)
"""Fields that the panel shows under their own names."""
COMPARED = {"strides": "1 2 3", "alphas": "0 0.25 0.75 1", "levels": "0 50 90"}
"""Fields of a comparison, which the panel takes as a line of text, and what stands there first."""
LOOKS: dict[str, dict[str, Any]] = {
    "width_mm": {"precision": 1},
    "dpi": {"precision": 0},
    "azimuth": {"precision": 1, "step": 500, "min": -360.0, "max": 360.0},
    "elevation": {"precision": 1, "step": 500},
    "hiding_opacity": {"precision": 2, "subtype": "FACTOR"},
    "explode": {"precision": 1, "soft_max": 200.0},
    "limit_mm": {"precision": 2},
    "seconds": {"precision": 1, "min": 0.1, "soft_max": 60.0},
}
"""Display options of fields that their descriptions do not contain."""


def all_properties() -> dict[str, Any]:
    """Return every property of `scene.ctmc_figure`."""
    return _generated_properties() | panel_properties()


def _generated_properties() -> dict[str, Any]:
    """Return the properties made from the fields of blender.figure.spec."""
    from ....blender.figure.spec import FIGURE_SETTINGS, PAGES

    properties: dict[str, Any] = {}
    for kind in FIGURE_SETTINGS:
        own = defaults(kind)
        for name, about in descriptions(kind).items():
            options = {"name": with_unit(about), **LOOKS.get(name, {})}
            if name in OF_EACH_PAGE:
                for page_kind, page in PAGES.items():
                    properties[f"{page_kind}_{name}"] = property_of(about, getattr(page, name), **options)
            elif name in SHOWN:
                properties[name] = property_of(about, own[name], **options)
            elif name in COMPARED:
                properties[name] = text(with_unit(about), tooltip(about), default=COMPARED[name])
            elif name == "deviation":
                properties["sheet_deviation"] = property_of(about, own[name])
    return properties


def panel_properties() -> dict[str, Any]:
    """Return the properties that only the panel has."""
    from ....blender.figure.spec import VIDEO_FORMATS, Comparison

    frames = (FRAMES, "PNG Frames", "A folder with one picture per frame")
    properties: dict[str, Any] = {
        "kind": choice(
            "Kind",
            "Kind of figure",
            items=[
                ("figure", "Figure", "The selected surfaces on a page, a PNG"),
                ("sheet", "Sheet", "The CT with several settings, side by side, a PNG"),
                ("deviation", "Distances", "The active surface in the colors of its distance to full resolution"),
                ("turntable", "Turntable", "The selected surfaces turning, a video or PNG frames"),
            ],
        ),
        "write_blend": boolean(
            "Write .blend", "Also write the figure's scene, to change and render it again", default=True
        ),
        "use_caption": boolean("Use Caption", "Write a caption under the figure", default=True),
        "film": choice(
            "Format",
            "Format of a turntable whose name has no suffix",
            items=[*((suffix, suffix[1:].upper(), "A video") for suffix in VIDEO_FORMATS), frames],
        ),
    }
    for name in COMPARED:
        properties[f"use_{name}"] = boolean(
            f"Compare {descriptions(Comparison)[name].label}",
            "Compare these; if two settings are compared, the first goes down and the second across",
            default=name == "strides",
        )
    return properties


def values_of(panel: Any, kind: type, page_kind: str = "") -> dict[str, Any]:
    """Return the values of a described dataclass's fields in the panel, by name; a page's fields are of `page_kind`."""
    values = {}
    own = defaults(kind)
    for name, about in descriptions(kind).items():
        shown = f"{page_kind}_{name}" if name in OF_EACH_PAGE else name
        if name in (*SHOWN, *OF_EACH_PAGE):
            value = as_typed(getattr(panel, shown), about)
            values[name] = None if own[name] is None and not value else value
    return values


CTMCFigure = type(
    "CTMCFigure",
    (PropertyGroup,),
    {"__annotations__": all_properties(), "__doc__": "How the next figure is made.", "__module__": __name__},
)


def register() -> None:
    """Give every scene its figure."""
    register_class(CTMCFigure)
    Scene.ctmc_figure = PointerProperty(type=CTMCFigure, name="CTMC Figure")


def unregister() -> None:
    """Unregister it."""
    del Scene.ctmc_figure
    unregister_class(CTMCFigure)
