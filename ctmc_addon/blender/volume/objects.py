# SPDX-License-Identifier: GPL-3.0-or-later
"""Add a Volume object at its position in the patient."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy

from ...core import Volume
from ..scene.ct_box import link_beside_ct
from .appearance import Appearance, volume_material
from .vdb import middle_mm

# Before Blender 5.0 Cycles shows a sample, and Volume to Mesh has it, half a voxel beyond its place along each axis.
RENDERED_OFF = -0.5 if bpy.app.version < (5, 0, 0) else 0.0
CT = "ctmc_volume_of"  # Custom property of the object: the fingerprint of its CT.


def add_volume(
    scene: bpy.types.Scene, volume: Volume, path: Path, scale: float, appearance: Appearance, fingerprint: str = ""
) -> bpy.types.Object:
    """Add the object of a .vdb that `vdb_steps` has written.

    Parameters
    ----------
    scene : bpy.types.Scene
    volume : Volume
        The written volume.
    path : Path
        Path of the .vdb.
    scale : float
        Blender units a millimeter.
    appearance : Appearance
    fingerprint : str
        Fingerprint of the CT.
    """
    name = f"{volume.name} {appearance.label}"
    data = bpy.data.volumes.new(name)
    data.filepath = bpy.path.relpath(str(path)) if bpy.data.filepath else str(path)
    data.materials.append(volume_material(name, appearance, scale))
    data.render.space = "WORLD"
    # Half a voxel a step sees every sample.
    data.render.step_size = 0.5 * scale * min(volume.spacing)
    obj = bpy.data.objects.new(name, data)
    obj.location = [scale * value for value in middle_mm(volume, RENDERED_OFF)]
    obj[CT] = fingerprint
    link_beside_ct(scene, obj, fingerprint)
    if scene.eevee.volumetric_tile_size in {"8", "16"}:
        scene.eevee.volumetric_tile_size = "2"  # Pixels; EEVEE's default leaves blocks.
    return obj


def of_ct(scene: bpy.types.Scene, fingerprint: str) -> Iterator[bpy.types.Object]:
    """Yield the Volume objects of a CT in a scene."""
    for obj in scene.objects:
        if obj.type == "VOLUME" and fingerprint and obj.get(CT) == fingerprint:
            yield obj
