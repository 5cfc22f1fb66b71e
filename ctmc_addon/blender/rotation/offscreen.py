# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw triangles on the GPU, or its software stand-in, with nothing of Blender's around them."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.mesh import vertex_normals
from ..colors import BONE
from ..surface import mesh_data as meshes
from ..viewport.shaders import draw_surface, free_shader, new_batch
from .levels import Level

BACKGROUND = (1.0, 1.0, 1.0, 1.0)


class TriangleDrawing:
    """Draw levels into a picture off screen: vertices and indices are on the GPU before the clock starts.

    Used in a `with`, which frees the picture. Before Blender 5.2 something must have been rendered by Workbench or
    EEVEE before, where there is no window.
    """

    def __init__(self, scene: bpy.types.Scene, levels: Sequence[Level], size: tuple[int, int]) -> None:
        import gpu

        if hasattr(gpu, "init"):
            gpu.init()
        eye, layer = scene.camera, scene.view_layers[0]
        layer.update()
        self.view = eye.matrix_world.inverted()
        self.projection = eye.calc_matrix_camera(layer.depsgraph, x=size[0], y=size[1])
        self.levels = list(levels)
        self.batches = []
        for level in levels:
            positions = meshes.read_positions(level.obj.data)
            normals = vertex_normals(positions, level.mesh.faces)
            self.batches.append(new_batch(positions, normals, level.mesh.faces))
        self.picture = gpu.types.GPUOffScreen(*size)

    def __enter__(self) -> TriangleDrawing:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.picture.free()
        free_shader()

    def show(self, level: Level) -> None:
        """Do nothing, because the triangles of every level are on the GPU already."""

    def draw(self, level: Level) -> None:
        """Clear, draw, and read one pixel, which waits until all triangles are drawn."""
        import gpu

        seen = self.view @ level.obj.matrix_basis
        with self.picture.bind():
            target = gpu.state.active_framebuffer_get()
            target.clear(color=BACKGROUND, depth=1.0)
            batch = self.batches[self.levels.index(level)]
            draw_surface(batch, self.projection @ seen, seen.to_3x3().normalized(), BONE)
            target.read_color(0, 0, 1, 1, 4, 0, "FLOAT")

    def pixels(self) -> NDArray[np.uint8]:
        """Return the present picture, (height, width, 4) uint8, from the bottom up."""
        buffer = self.picture.texture_color.read()
        buffer.dimensions = self.picture.width * self.picture.height * 4
        return np.array(buffer, np.uint8).reshape(self.picture.height, self.picture.width, 4)
