# SPDX-License-Identifier: GPL-3.0-or-later
"""Show slices of the CT in a figure: their planes, and the caps of surfaces that were cut at them.

The picture of a slice lies where its plane lies (blender/slices). A figure's copies move on the page and may turn, so
the pictures hang on copies of the planes, or on empties where a plane itself is not shown.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np
from mathutils import Matrix

from ...materials import lights_nothing
from ...slices import is_slice
from ...surface.evaluate import evaluated_copy

Shift = tuple[float, float, float]
IN_PLACE: Shift = (0.0, 0.0, 0.0)


@dataclass
class SlicePictures:
    """Objects that carry the pictures of a cell: a copy of the plane, or an empty, for each slice."""

    scene: bpy.types.Scene
    blocks: list[bpy.types.ID]
    anchors: dict[tuple[bpy.types.Object, Shift], bpy.types.Object] = field(default_factory=dict)

    def add_plane(self, plane: bpy.types.Object, scene: bpy.types.Scene | None) -> None:
        """Add a copy of a slice's plane that shows its picture."""
        mesh, evaluated = evaluated_copy(plane, scene)
        self.blocks.append(mesh)
        copy = self.add_anchor(plane, mesh)
        copy.matrix_world = evaluated.matrix_world
        for slot, material in enumerate(mesh.materials):
            mesh.materials[slot] = self.hung(material)

    def add_anchor(
        self, plane: bpy.types.Object, mesh: bpy.types.Mesh | None = None, shift: Shift = IN_PLACE
    ) -> bpy.types.Object:
        """Add the object that carries a picture: a copy of the plane with this mesh, or an empty where it is None.

        It stands `shift` from the plane, as the surface that was cut there does.
        """
        anchor = bpy.data.objects.new("CTMC Slice", mesh)
        anchor.matrix_world = Matrix.Translation(shift) @ plane.matrix_world
        anchor.visible_shadow = False
        self.scene.collection.objects.link(anchor)
        self.blocks.append(anchor)
        self.anchors[plane, shift] = anchor
        return anchor

    def hung(self, material: bpy.types.Material, shift: Shift = IN_PLACE) -> bpy.types.Material:
        """Return a copy of a slice's material whose picture follows this figure's objects, those moved by `shift`."""
        copy = material.copy()
        self.blocks.append(copy)
        for node in copy.node_tree.nodes:
            if node.type == "TEX_COORD" and is_slice(node.object):
                anchor = self.anchors.get((node.object, shift))
                node.object = anchor or self.add_anchor(node.object, shift=shift)
        lights_nothing(copy)
        return copy

    def keep_caps(self, mesh: bpy.types.Mesh, material: bpy.types.Material, shift: Shift = IN_PLACE) -> None:
        """Give a surface, moved by `shift`, its material and leave the caps that show a slice as they are."""
        before = list(mesh.materials)
        caps = [slot for slot, old in enumerate(before) if old is not None and shows_slice(old)]
        if not caps:  # Reading the slots of a large mesh is slow.
            mesh.materials.clear()
            mesh.materials.append(material)
            if (numbers := mesh.attributes.get("material_index")) is not None:
                mesh.attributes.remove(numbers)
            return
        slots = np.zeros(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("material_index", slots)
        mesh.materials.clear()
        mesh.materials.append(material)
        new = np.zeros(len(mesh.polygons), np.int32)
        for slot in caps:
            new[slots == slot] = len(mesh.materials)
            mesh.materials.append(self.hung(before[slot], shift))
        mesh.polygons.foreach_set("material_index", new)


def shows_slice(material: bpy.types.Material) -> bool:
    """Return whether a material is that of a slice."""
    tree = material.node_tree
    return tree is not None and any(node.type == "TEX_COORD" and is_slice(node.object) for node in tree.nodes)
