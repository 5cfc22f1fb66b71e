# SPDX-License-Identifier: GPL-3.0-or-later
"""Define drawn structures and tool settings: `scene.ctmc_draw`, with packed slices, so the file holds every stroke.

Undo, saving, autosave and Blender's question before a file closes then include the drawing without further code.
As in settings.py, this module must not hold `bpy` itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from bpy.props import (
    BoolProperty,
    CollectionProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ...core.segmentation import HU_PER_MM, MAX_MM
from ..state.change_events import DRAWN, notify
from .kinds import boolean, choice, decimal, text


def on_look(owner: Any, _context: Any) -> None:
    """Send a change event, so that structures are shown as they look now."""
    notify(owner.id_data.ctmc, DRAWN)


class CTMCPoint(PropertyGroup):
    """A point of a stroke, or a corner of a lasso, as an operator's argument."""

    at: FloatVectorProperty(size=3, options={"HIDDEN"})


class _CTMCPackedSlice(PropertyGroup):
    """A slice of a structure: its number, and its bits as `core.segmentation.packed_slices` packs them."""

    number: IntProperty(options={"HIDDEN"})
    content: StringProperty(subtype="BYTE_STRING", options={"HIDDEN"})


class _CTMCDrawnClick(PropertyGroup):
    """A click of Grow: its sample (slice, row, column), and whether it lies in the structure or its surroundings."""

    sample: IntVectorProperty(size=3, options={"HIDDEN"})
    inside: BoolProperty(options={"HIDDEN"})


class CTMCDrawnStructure(PropertyGroup):
    """Drawing of a structure; its line of the list `scene.ctmc.labels` has the same source.

    Loading another CT empties that list, so name and color are kept here, for when the CT comes back.
    """

    key: StringProperty(options={"HIDDEN"})
    fingerprint: StringProperty(options={"HIDDEN"})
    name: StringProperty(options={"HIDDEN"})
    color: FloatVectorProperty(size=3, options={"HIDDEN"})
    shown: boolean("Show", "Show the structure on slices and as a preview", default=True, update=on_look)
    slices: CollectionProperty(type=_CTMCPackedSlice, options={"HIDDEN"})
    clicks: CollectionProperty(type=_CTMCDrawnClick, options={"HIDDEN"})


class CTMCDrawing(PropertyGroup):
    """Drawings of a scene, and settings of the tools."""

    structures: CollectionProperty(type=CTMCDrawnStructure, options={"HIDDEN"})
    radius_mm: decimal(
        "Radius",
        "Radius of brush and eraser. F changes it in the viewport",
        unit="CAMERA",
        default=5.0,
        min=0.1,
        soft_max=50.0,
        max=500.0,
        precision=1,
    )
    ball: boolean("Ball", "Draw a ball through the neighboring slices instead of a disc in the slice")
    on_surfaces: boolean(
        "On Surfaces", "Also draw along the CT's surfaces, with a ball, where one lies in front of the slices"
    )
    method: choice(
        "Grow",
        "How far a click reaches",
        items=[
            ("compete", "To Borders", "To where the border is sharpest; for tumors and organs"),
            ("connected", "In Range", "Through connected values in the range; for vessels and bone"),
        ],
    )
    hu_per_mm: decimal(
        "Noise [HU]",
        "HU difference that counts as one millimeter. Larger = a smoother border, for a noisy CT",
        default=HU_PER_MM,
        min=0.1,
        soft_max=20.0,
        max=1000.0,
        precision=1,
    )
    reach_mm: decimal(
        "Reach",
        "Leave voxels farther from a click unchanged",
        unit="CAMERA",
        default=MAX_MM,
        min=1.0,
        soft_max=200.0,
        max=5000.0,
        precision=1,
    )
    opening_mm: decimal(
        "Opening",
        "Cut connections narrower than this, so that a vessel does not leak into an organ. 0 = cut none",
        unit="CAMERA",
        min=0.0,
        soft_max=10.0,
        max=100.0,
        precision=1,
    )
    depth_mm: decimal(
        "Depth",
        "How deep Scissors cut, from the nearest point of the structure in the lasso. 0 = through everything",
        unit="CAMERA",
        min=0.0,
        soft_max=200.0,
        max=5000.0,
        precision=1,
    )
    use_range: boolean("Stay in Range", "Brush, growing and margin change only values in the range")
    low: decimal("From", "Lowest value, in HU or gray values", default=150.0, precision=1, step=500)
    high: decimal("To", "Highest value, in HU or gray values", default=3000.0, precision=1, step=500)
    margin_mm: decimal(
        "Margin",
        "Distance by which Margin grows the structure; a negative one shrinks it",
        unit="CAMERA",
        default=2.0,
        soft_min=-20.0,
        soft_max=20.0,
        min=-200.0,
        max=200.0,
        precision=1,
    )
    islands_mm3: decimal(
        "Smaller [mm3]", "Remove islands smaller than this", default=100.0, min=0.0, soft_max=10_000.0, precision=3
    )
    other: text("With", "The structure to combine with")
    combination: choice(
        "Combine",
        "How to combine the structures",
        items=[
            ("or", "Add", "Voxels in either structure"),
            ("minus", "Subtract", "Voxels not in the other structure"),
            ("and", "Overlap", "Voxels in both structures"),
        ],
    )


CLASSES = (CTMCPoint, _CTMCPackedSlice, _CTMCDrawnClick, CTMCDrawnStructure, CTMCDrawing)


def points_of(places: Iterable[Sequence[float]]) -> list[dict[str, Any]]:
    """Return points as an operator takes them: two or three numbers each."""
    return [{"name": "", "at": (*place, 0.0)[:3]} for place in places]


def register() -> None:
    """Give every scene its drawing."""
    for kind in CLASSES:
        register_class(kind)
    Scene.ctmc_draw = PointerProperty(type=CTMCDrawing, name="CTMC Draw")


def unregister() -> None:
    """Unregister it; the data in files stays."""
    del Scene.ctmc_draw
    for kind in reversed(CLASSES):
        unregister_class(kind)
