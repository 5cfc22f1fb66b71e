# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the patient's millimeters in Blender's own numbers."""

from __future__ import annotations

import math

import bpy

NEW = {"system": "METRIC", "length_unit": "METERS", "scale_length": 1.0}  # Units of a new file.


def set_units(scene: bpy.types.Scene, scale: float) -> None:
    """Show lengths in mm; nothing moves.

    Parameters
    ----------
    scene : bpy.types.Scene
    scale : float
        Blender units a millimeter; Blender shows a unit as `scale_length` meters.
    """
    units = scene.unit_settings
    units.system, units.length_unit, units.scale_length = "METRIC", "MILLIMETERS", 0.001 / scale


def shows_mm(scene: bpy.types.Scene, scale: float) -> bool:
    """Return whether Blender's numbers are the patient's millimeters.

    Parameters
    ----------
    scene : bpy.types.Scene
    scale : float
        Blender units a millimeter.
    """
    units = scene.unit_settings
    is_mm = units.system == "METRIC" and units.length_unit == "MILLIMETERS"
    return is_mm and math.isclose(units.scale_length, 0.001 / scale, rel_tol=1e-5)


def has_blenders_units(scene: bpy.types.Scene) -> bool:
    """Return whether a scene's units are the defaults of a new file."""
    units = scene.unit_settings
    return all(getattr(units, name) == value for name, value in NEW.items())
