# SPDX-License-Identifier: GPL-3.0-or-later
"""The patient's axes on a figure: a cross with depth, and the letters of the ends that point towards the reader.

The nearer an arm, the darker it is, and it covers those behind it. A letter is on its end of an axis; those that point
away fade, as they would stand on the others: of the three ends that are near, no two are closer than the cross reaches.
All of that is worked out where the axes stand, so that they may turn with the surface.
"""

from __future__ import annotations

from typing import Any

import bpy

from ...colors import Color
from ...materials import clear_shader, emission, flat_material, mixed, show_flat, surface_material
from ...sockets import output_of
from ..spec import WHITE
from .annotations import LINE_MM, Board, disc

LETTERS = (("R", (1.0, 0.0, 0.0)), ("A", (0.0, 1.0, 0.0)), ("S", (0.0, 0.0, 1.0)))
OPPOSITE = {"R": "L", "A": "P", "S": "I"}
PIVOT = "CTMC Orientation"
REACH = 1.6  # Distance from the middle to the letters, in letter sizes.
ARM = 0.6  # Length of an arm, as a share of the reach.
SIZE = 0.9  # Size of the letters, relative to the page's.
CLEARING = 0.58  # Radius around a letter that stays clear of what lies behind, in letter sizes.
FADE = (0.1, 0.3)  # Distances behind the middle at which a letter begins to fade and is invisible, in reaches.
SHADES = (-0.2, 0.4)  # Distances behind the middle at which an arm begins to get lighter and is lightest.
FAR: Color = (0.55, 0.55, 0.55)


def reach_mm(font_mm: float) -> float:
    """Return the distance from the middle of the axes to their letters, mm.

    Parameters
    ----------
    font_mm : float
        Size of the letters.
    """
    return REACH * font_mm


def orientation_marker(board: Board, x: float, y: float, rotation: Any, flat: bool, clear: bool) -> Any:
    """Draw the patient's axes about (x, y), their letters R L A P S I facing the camera; return their pivot.

    Parameters
    ----------
    rotation : Matrix
        Rotation of the patient in the scene, 3 x 3.
    flat : bool
        The engine has no nodes: letters that point away are left out, and do not come when the axes turn.
    clear : bool
        The page has no background.
    """
    camera, reach = board.scene.camera, reach_mm(board.font_mm)
    depth = board.depth + 2 * reach * board.unit
    pivot = bpy.data.objects.new(PIVOT, None)
    pivot.empty_display_size = board.unit
    matrix = rotation.to_4x4()
    matrix.translation = camera.matrix_world @ board.local(x, y, 2 * reach)
    pivot.matrix_world = matrix
    board.scene.collection.objects.link(pivot)
    board.blocks.append(pivot)
    limits = [[depth + share * reach * board.unit for share in ends] for ends in (SHADES, FADE)]
    arms, ink, paper = (
        depth_ink(board.pen, FAR, limits[0]),
        depth_ink(board.pen, None, limits[1]),
        page_ink(None if clear else board.paper, limits[1]),
    )
    board.blocks += [arms, ink, paper]
    cross = board.put("CTMC Axes", _axis_lines(ARM * reach), 0.0, 0.0, arms)
    cross.parent, cross.location = pivot, (0.0, 0.0, 0.0)
    towards = camera.matrix_world.to_3x3().col[2]
    for name, direction in LETTERS:
        for letter, sign in ((name, 1.0), (OPPOSITE[name], -1.0)):
            shown = board.text(letter, 0.0, 0.0, "CENTER", "CENTER", SIZE, ink)
            shown.parent = pivot
            shown.location = tuple(sign * reach * board.unit * part for part in direction)
            facing = shown.constraints.new("COPY_ROTATION")
            facing.target = camera
            behind = -sign * (rotation.col["RAS".index(name)] @ towards)
            if flat:
                shown.hide_render = shown.hide_viewport = behind > sum(FADE) / 2
            else:
                room = board.put("CTMC Room", disc("CTMC Room", CLEARING * SIZE * board.font_mm), 0.0, 0.0, paper)
                room.parent, room.location, room.scale = shown, (0.0, 0.0, -0.05), (1.0, 1.0, 1.0)
    return pivot


def depth_ink(near: Color, far: Color | None, limits: list[float]) -> bpy.types.Material:
    """Return a flat color that becomes another, or clear, from one distance before the camera to the next."""
    material = surface_material("CTMC Ink by Depth", near)
    share = _depth_share(material, limits)
    last = clear_shader(material.node_tree) if far is None else emission(material, far)
    show_flat(material, mixed(material.node_tree, share, emission(material, near), last))
    return material


def page_ink(paper: Color | None, limits: list[float]) -> bpy.types.Material:
    """Return a material like the page, None for an empty one, that hides what is behind; clear where letters fade."""
    material = flat_material("CTMC Page", paper or WHITE)
    tree = material.node_tree
    page = emission(material, paper) if paper else output_of(tree.nodes.new("ShaderNodeHoldout"), "Holdout")
    share = _depth_share(material, limits)
    show_flat(material, mixed(tree, share, page, clear_shader(tree)))
    return material


def _depth_share(material: bpy.types.Material, limits: list[float]) -> Any:
    """Return a socket that rises from 0 at the first distance from the camera to 1 at the second."""
    tree = material.node_tree
    camera, share = tree.nodes.new("ShaderNodeCameraData"), tree.nodes.new("ShaderNodeMapRange")
    share.inputs["From Min"].default_value, share.inputs["From Max"].default_value = limits
    tree.links.new(camera.outputs["View Z Depth"], share.inputs["Value"])
    return share.outputs["Result"]


def _axis_lines(reach_mm: float) -> Any:
    """Return three crossing lines of a visible width."""
    lines = bpy.data.curves.new("CTMC Axes", "CURVE")
    lines.dimensions, lines.bevel_depth, lines.bevel_resolution = "3D", 0.7 * LINE_MM, 2
    for _, direction in LETTERS:
        line = lines.splines.new("POLY")
        line.points.add(1)
        for point, sign in zip(line.points, (-1.0, 1.0), strict=True):
            point.co = (*(sign * reach_mm * part for part in direction), 1.0)
    return lines
