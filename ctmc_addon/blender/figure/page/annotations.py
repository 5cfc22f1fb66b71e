# SPDX-License-Identifier: GPL-3.0-or-later
"""Write letters, scale bars and legends on a figure, as objects in front of its camera.

They are placed in page space (see spec.py) and stand still before the camera, so that the .blend shows what the picture
shows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ....core import length_text
from ....core.maps import NO_VALUE, linear, rgb_of
from ...colors import INK, Color
from ...maps.material import blocks_of, map_material
from ...maps.stored import write_values
from ...materials import flat_material
from ...surface import mesh_data as meshes
from ..letters import CAP, text_curve
from ..spec import WHITE, Box, ColorScale

LINE_MM = 0.25
GAP_MM = 1.0
COLUMN_GAP_MM = 3.0  # Gap between columns of a legend.
NO_BREAK = "\N{NO-BREAK SPACE}"
LEADING = 1.3  # Line spacing, in letter sizes.


@dataclass
class Board:
    """The plane in front of a figure's camera that holds the writing.

    Parameters
    ----------
    scene : Scene
    unit : float
        Blender units of a millimeter on the page.
    size_mm : (width, height)
    depth : float
        Distance from the camera, Blender units.
    font_mm : float
        Size of the letters.
    pen, paper : (red, green, blue) float
        Colors of letters and lines, and of the page behind them.
    """

    scene: bpy.types.Scene
    unit: float
    size_mm: tuple[float, float]
    depth: float
    font_mm: float
    blocks: list[bpy.types.ID] = field(default_factory=list)
    inks: dict[Color, bpy.types.Material] = field(default_factory=dict)
    pen: Color = INK
    paper: Color = WHITE

    def ink(self, color: Color | None = None) -> bpy.types.Material:
        """Return the flat material of a color, by default that of the pen."""
        color = color or self.pen
        if color not in self.inks:
            self.inks[color] = flat_material("CTMC Ink", color)
            self.blocks.append(self.inks[color])
        return self.inks[color]

    def put(
        self, name: str, shape: Any, x: float, y: float, material: bpy.types.Material | None = None, behind: float = 0.0
    ) -> Any:
        """Add an object of `shape`, drawn in millimeters, with its origin at (x, y) of the page, mm `behind` it."""
        obj = bpy.data.objects.new(name, shape)
        if material is not None:
            shape.materials.append(material)
        obj.parent = self.scene.camera
        obj.location = self.local(x, y, behind)
        obj.scale = (self.unit,) * 3
        self.scene.collection.objects.link(obj)
        self.blocks += [obj, shape]
        # It neither lights nor shades what stands behind it.
        obj.visible_shadow = obj.visible_diffuse = obj.visible_glossy = obj.visible_transmission = False
        return obj

    def local(self, x: float, y: float, behind: float = 0.0) -> Vector:
        """Return (x, y) of the page in the camera's space, `behind` mm behind the board."""
        width, height = self.size_mm
        return Vector((x - width / 2, y - height / 2, -behind)) * self.unit - Vector((0.0, 0.0, self.depth))

    def text(
        self,
        body: str,
        x: float,
        y: float,
        across: str = "LEFT",
        along: str = "BOTTOM_BASELINE",
        size: float = 1.0,
        ink: bpy.types.Material | None = None,
    ) -> Any:
        """Write letters at (x, y), `size` times the page's."""
        shape = text_curve(body, size * self.font_mm)
        shape.align_x, shape.align_y, shape.resolution_u = across, along, 4
        return self.put("CTMC Text", shape, x, y, ink or self.ink())

    def width_of(self, body: str, size: float = 1.0) -> float:
        """Return the width of one line of letters, mm."""
        shape = text_curve(body, size * self.font_mm)
        obj = bpy.data.objects.new("CTMC Text", shape)
        self.scene.collection.objects.link(obj)
        self.scene.view_layers[0].update()
        width = float(obj.dimensions.x)
        bpy.data.batch_remove([obj, shape])
        return width

    def lines_of(self, body: str, width_mm: float, size: float = 1.0) -> list[str]:
        """Return the text in lines that fit a width, not broken at no-break spaces; a wider word stays whole."""
        out = []
        for line in body.splitlines():
            words = line.split(" ")
            shown = words[0]
            for word in words[1:]:
                longer = f"{shown} {word}"
                if self.width_of(longer, size) > width_mm:
                    out.append(shown)
                    shown = word
                else:
                    shown = longer
            out.append(shown)
        return [line.replace(NO_BREAK, " ") for line in out]

    def rectangle(self, box: Box, color: Color | None = None) -> Any:
        """Draw a filled rectangle."""
        left, bottom, right, top = box
        corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * [right - left, top - bottom, 0]
        shape = meshes.new_mesh("CTMC Bar", corners.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        return self.put("CTMC Bar", shape, left, bottom, self.ink(color))

    def disc(self, at: tuple[float, float], radius: float, color: Color | None = None, behind: float = 0.0) -> Any:
        """Draw a filled disc, mm `behind` the board."""
        return self.put("CTMC Dot", disc("CTMC Dot", radius), *at, self.ink(color), behind)


def disc(name: str, radius: float) -> bpy.types.Mesh:
    """Return a flat disc about the origin."""
    around = 2 * np.pi * np.arange(32) / 32
    ring = np.column_stack([np.cos(around), np.sin(around), 0 * around]) * radius
    faces = np.array([[0, at, at + 1] for at in range(1, 31)], np.int32)
    return meshes.new_mesh(name, ring.astype(np.float32), faces)


def scale_bar(board: Board, length_mm: float, page_mm: float, x: float, y: float) -> None:
    """Draw a bar with its length written above it.

    Parameters
    ----------
    board : Board
    length_mm : float
        Length in the patient.
    page_mm : float
        Length on the page.
    x : float
        Left end, mm on the page.
    y : float
    """
    board.rectangle((x, y, x + page_mm, y + 3 * LINE_MM))
    board.text(length_text(length_mm), x, y + 3 * LINE_MM + 0.6)


def round_length(most: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, 50... that is not above `most`.

    Parameters
    ----------
    most : float

    Examples
    --------
    >>> round_length(34.0), round_length(0.7)
    (20.0, 0.5)
    """
    power = 10.0 ** math.floor(math.log10(most))
    return float(f"{max(factor * power for factor in (1, 2, 5) if factor * power <= most * (1 + 1e-9)):.6g}")


def legend(board: Board, entries: Sequence[tuple[str, Color]], x: float, y: float, columns: int = 1) -> None:
    """Draw colors with their names, in columns, a line each.

    Parameters
    ----------
    board : Board
    entries : sequence of (name, Color)
    x : float
        Left end of the first column, mm on the page.
    y : float
        Last baseline of the first column.
    columns : int
    """
    side = CAP * board.font_mm
    rows = -(-len(entries) // columns)
    for at, (name, color) in enumerate(entries):
        row = at % rows
        base = y + (rows - 1 - row) * LEADING * board.font_mm
        board.rectangle((x, base, x + side, base + side), color)
        board.text(name, x + side + GAP_MM, base)
        if row == rows - 1:
            x += side + GAP_MM + COLUMN_GAP_MM + max(board.width_of(entry) for entry, _ in entries[at - row : at + 1])


def color_bar(board: Board, scale: ColorScale, box: Box) -> None:
    """Draw a color bar in a box of the page: its title above, values below, and a square for what has no value."""
    left, bottom, right, _ = box
    font = board.font_mm
    if scale.gaps:
        side = CAP * font
        board.rectangle((left, bottom, left + side, bottom + side), linear(rgb_of(NO_VALUE))[:3])
        board.text("no value", left + side + GAP_MM, bottom)
        bottom += 1.2 * LEADING * font
    ends = [board.width_of(scale.label(share)) / 2 for share in (0.0, 1.0)]
    left, right = left + max(ends), right - max(ends)
    base = bottom + CAP * font + GAP_MM
    steps = 64
    across = np.repeat(np.linspace(0.0, right - left, steps + 1), 2)
    tall = np.tile([0.0, font], steps + 1)
    corners = np.column_stack([across, tall, np.zeros_like(across)]).astype(np.float32)
    at = 2 * np.arange(steps, dtype=np.int32)
    faces = np.concatenate([np.stack([at, at + 2, at + 3], axis=1), np.stack([at, at + 3, at + 1], axis=1)])
    bar = meshes.new_mesh("CTMC Colors", corners, faces)
    write_values(bar, scale.name, np.repeat(np.linspace(*scale.range, steps + 1), 2).astype(np.float32))
    material = map_material(scale)
    board.blocks += blocks_of(material)
    board.put("CTMC Colors", bar, left, base, material)
    for share in (0.0, 0.5, 1.0):
        x = left + share * (right - left)
        board.rectangle((x - 0.06, base - 0.5, x + 0.06, base))
        board.text(scale.label(share), x, bottom, "CENTER")
    board.text(scale.heading, (left + right) / 2, base + font + 0.8, "CENTER")
