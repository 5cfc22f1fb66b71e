"""Triangles drawn on the GPU, or its software stand-in, with nothing of Blender's around them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from ctypes.util import find_library
from types import TracebackType
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.mesh import vertex_normals
from ..materials import BONE
from ..surface import mesh_data as meshes

if TYPE_CHECKING:
    from .timing import Level

BACKGROUND = (1.0, 1.0, 1.0, 1.0)
VERTEX = "void main() { shade = turn * normal; gl_Position = place * vec4(position, 1.0); }"
PAINT = ", ".join(str(part) for part in BONE)
FRAGMENT = f"void main() {{ colour = vec4(vec3({PAINT}) * (0.25 + 0.75 * max(normalize(shade).z, 0.0)), 1.0); }}"


def can_draw() -> bool:
    """Whether Blender can draw here. On Linux without EGL the attempt would end the process, so it is not made."""
    return not sys.platform.startswith("linux") or not bpy.app.background or find_library("EGL") is not None


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
        self.shader = new_shader()
        self.batches = [self.batch_of(level) for level in levels]
        self.levels = list(levels)
        self.picture = gpu.types.GPUOffScreen(*size)

    def __enter__(self) -> TriangleDrawing:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.picture.free()

    def batch_of(self, level: Level) -> Any:
        """A level's vertices, normals and triangles on the GPU."""
        from gpu_extras.batch import batch_for_shader

        positions: NDArray[np.float32] = meshes.read_positions(level.thing.data)
        normals = vertex_normals(positions, level.mesh.faces)
        content = {"position": positions, "normal": normals}
        return batch_for_shader(self.shader, "TRIS", content, indices=np.ascontiguousarray(level.mesh.faces))

    def show(self, level: Level) -> None:
        """Nothing to do: every level is there."""

    def draw(self, level: Level) -> None:
        """Clear, draw, and read one pixel, which waits until all are drawn."""
        import gpu

        seen = self.view @ level.thing.matrix_basis
        with self.picture.bind():
            target = gpu.state.active_framebuffer_get()
            target.clear(color=BACKGROUND, depth=1.0)
            gpu.state.depth_test_set("LESS_EQUAL")
            gpu.state.depth_mask_set(True)
            self.shader.bind()
            self.shader.uniform_float("place", self.projection @ seen)
            self.shader.uniform_float("turn", seen.to_3x3().normalized())
            self.batches[self.levels.index(level)].draw(self.shader)
            target.read_color(0, 0, 1, 1, 4, 0, "FLOAT")
            gpu.state.depth_test_set("NONE")

    def pixels(self) -> NDArray[np.uint8]:
        """The picture as it is now, (height, width, 4) uint8, from the bottom up."""
        buffer = self.picture.texture_color.read()
        buffer.dimensions = self.picture.width * self.picture.height * 4
        return np.array(buffer, np.uint8).reshape(self.picture.height, self.picture.width, 4)


def new_shader() -> Any:
    """One colour, lit from the eye."""
    import gpu

    between = gpu.types.GPUStageInterfaceInfo("ctmc_shade")
    between.smooth("VEC3", "shade")
    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "place")
    info.push_constant("MAT3", "turn")
    info.vertex_in(0, "VEC3", "position")
    info.vertex_in(1, "VEC3", "normal")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(VERTEX)
    info.fragment_source(FRAGMENT)
    return gpu.shader.create_from_info(info)
