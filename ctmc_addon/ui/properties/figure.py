# SPDX-License-Identifier: GPL-3.0-or-later
"""What figures are made with: `scene.ctmc_figure`; its limits and defaults are those of blender.figure.spec.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from typing import Any

from bpy.props import PointerProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from .kinds import boolean, choice, decimal, integer, text

FRAMES = "frames"  # in place of a video's suffix


def all_properties() -> dict[str, Any]:
    """Every property of `scene.ctmc_figure`."""
    return page_properties() | look_properties() | sheet_properties() | turntable_properties()


def page_properties() -> dict[str, Any]:
    """Kind, and the page of each."""
    from ...blender.figure.spec import DPIS, PAGES, WIDTHS_MM

    properties: dict[str, Any] = {
        "kind": choice(
            "Kind",
            "What is made",
            items=[
                ("figure", "Figure", "The selected surfaces on a page, a PNG"),
                ("sheet", "Sheet", "The CT with several settings, side by side, a PNG"),
                ("deviation", "Distances", "The active surface in the colors of its distance to full resolution"),
                ("turntable", "Turntable", "The selected surfaces turning, a video or PNG frames"),
            ],
        )
    }
    for kind, page in PAGES.items():
        properties[f"{kind}_width_mm"] = decimal(
            "Width [mm]",
            "Width as printed [mm]. A column of most journals is 85, two are 170",
            default=page.width_mm,
            min=WIDTHS_MM[0],
            max=WIDTHS_MM[1],
            precision=1,
        )
        properties[f"{kind}_dpi"] = decimal(
            "Resolution [dpi]",
            "Pixels to the inch [dpi]. Larger = sharper, and longer to render",
            default=page.dpi,
            min=DPIS[0],
            max=DPIS[1],
            precision=0,
        )
    properties["transparent"] = boolean("Transparent", "No background instead of a white one; videos always have one")
    properties["write_blend"] = boolean(
        "Write .blend", "Write the figure's own scene beside it, to be changed and rendered again", default=True
    )
    return properties


def look_properties() -> dict[str, Any]:
    """How a figure is seen, and what is written on it."""
    from ...blender.figure.spec import ELEVATIONS, ENGINES, OPACITIES, OPACITY, STYLES, FigureStyle

    style = FigureStyle()
    angle = {"precision": 1, "step": 500}
    return {
        "style": choice(
            "Style",
            "How surfaces look. Several at once keep their own colors; print makes all of them gray",
            items=[(name, name.title(), style.text[0].upper() + style.text[1:]) for name, style in STYLES.items()],
            default=style.style,
        ),
        "engine": choice(
            "Engine",
            "What renders the figure",
            items=[(name, engine.label, engine.text) for name, engine in ENGINES.items()],
            default=style.engine,
        ),
        "azimuth": decimal(
            "Azimuth [°]",
            "Where the camera stands [degrees]: 0 = before the patient, 90 = at the left, 180 = behind",
            **angle,
            default=style.azimuth,
            min=-360.0,
            max=360.0,
        ),
        "elevation": decimal(
            "Elevation [°]",
            "How high the camera stands [degrees]: 90 = above the head, -90 = below the feet",
            **angle,
            default=style.elevation,
            min=ELEVATIONS[0],
            max=ELEVATIONS[1],
        ),
        "opacity": decimal(
            "Opacity",
            "Of a surface that holds all the others, so that they are seen in it. Smaller = clearer",
            subtype="FACTOR",
            default=OPACITY,
            min=OPACITIES[0],
            max=OPACITIES[1],
            precision=2,
        ),
        "scale_bar": boolean("Scale Bar", "A bar of round length in mm", default=style.scale_bar),
        "orientation": boolean(
            "Orientation",
            "The patient's axes: R and L, A and P (front and back), S and I (head and feet)",
            default=style.orientation,
        ),
        "use_caption": boolean("Use Caption", "Write a caption under the figure", default=True),
        "caption": text("Caption", "Written under the figure. Empty = what it shows"),
    }


def sheet_properties() -> dict[str, Any]:
    """What a sheet compares, and the colors of distances."""
    properties: dict[str, Any] = {}
    for name, label, tip, default in (
        ("strides", "Stride [px]", "Strides to compare [px]: 1 2 3, or 2x1 for x and y of their own", "1 2 3"),
        ("alphas", "Alpha", "Alphas to compare, from 0 to 1", "0 0.25 0.75 1"),
        ("levels", "Levels [%]", "Shares of triangles to remove that are compared [%]", "0 50 90"),
    ):
        properties[f"use_{name}"] = boolean(
            f"Compare {label.partition(' [')[0]}",
            "Compare these; where two are compared, the first goes down and the second across",
            default=name == "strides",
        )
        properties[name] = text(label, tip, default=default)
    properties["sheet_deviation"] = boolean(
        "Distances", "Color every surface by its distance to full resolution, with a color bar"
    )
    properties["limit_mm"] = decimal(
        "Bar End [mm]",
        "Distance at the end of the color bar [mm]. 0 = where 99 % of the points are within",
        min=0.0,
        max=1000.0,
        precision=2,
    )
    return properties


def turntable_properties() -> dict[str, Any]:
    """Format, length and speed of a turntable."""
    from ...blender.figure.spec import FPS, REVOLUTIONS, SECONDS, VIDEO_FORMATS, Turn

    turn = Turn()
    frames = (FRAMES, "PNG Frames", "A folder with a picture for every frame")
    return {
        "film": choice(
            "Format",
            "What a turntable is written as, where its name has no suffix",
            items=[*((suffix, suffix[1:].upper(), "A video") for suffix in VIDEO_FORMATS), frames],
        ),
        "seconds": decimal(
            "Length [s]",
            "Length of the loop [s]. Larger = slower, and longer to render",
            default=turn.seconds,
            min=0.1,
            max=SECONDS,
            soft_max=60.0,
            precision=1,
        ),
        "fps": integer(
            "Frame Rate [fps]",
            "Pictures in a second. Larger = smoother, and longer to render",
            default=turn.fps,
            min=FPS[0],
            max=FPS[1],
        ),
        "revolutions": integer(
            "Revolutions",
            "Whole turns in the loop. Below 0 = the other way round",
            default=turn.revolutions,
            min=-REVOLUTIONS,
            max=REVOLUTIONS,
        ),
    }


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
    """Take it away again."""
    del Scene.ctmc_figure
    unregister_class(CTMCFigure)
