"""The live preview as the graphics card draws it: no object, no mesh, nothing to undo, save or clean up.

Places are Blender units in world space. `gpu` exists only where Blender draws, so it is imported there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import Surface
from ...core.mesh import blend, vertex_normals

VERTEX = "void main() { shade = turn * normal; gl_Position = place * vec4(position, 1.0); }"
# Lit from the eye and on both sides: a surface cut off at the border shows its inside.
FRAGMENT = "void main() { colour = vec4(paint.rgb * (0.18 + 0.72 * abs(normalize(shade).z)), 1.0); }"
_shader: list[Any] = []


class PreviewSurface:
    """A surface on the graphics card; made while Blender draws.

    Parameters
    ----------
    surface : Surface
        RAS+ mm.
    scale : float
        Blender units of 1 mm.
    """

    def __init__(self, surface: Surface, alpha: float, scale: float) -> None:
        self.surface, self.alpha, self.scale = surface, alpha, scale
        normals = surface.normals
        self.normals = vertex_normals(surface.linear, surface.faces) if normals is None else normals
        self.batch: Any = None

    def move(self, alpha: float) -> None:
        """Show it at another alpha."""
        if alpha != self.alpha:
            self.alpha, self.batch = alpha, None

    def positions(self) -> NDArray[np.float32]:
        """The vertices at the present alpha, Blender units."""
        mixed = blend(self.surface.midpoints, self.surface.linear, self.alpha)
        mixed *= np.float32(self.scale)
        return mixed

    def draw(self, matrix: Any, view: Any, colour: tuple[float, float, float]) -> None:
        """Draw it among the scene's objects, from perspective `matrix` and view matrix `view`."""
        import gpu

        shader = shader_of()
        if self.batch is None:
            self.batch = self.new_batch()
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        shader.bind()
        shader.uniform_float("place", matrix)
        shader.uniform_float("turn", view.to_3x3())
        shader.uniform_float("paint", (*colour, 1.0))
        self.batch.draw(shader)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")

    def new_batch(self) -> Any:
        """Vertices, normals and triangles on the graphics card."""
        import gpu

        layout = gpu.types.GPUVertFormat()
        for name in ("position", "normal"):
            layout.attr_add(id=name, comp_type="F32", len=3, fetch_mode="FLOAT")
        vertices = gpu.types.GPUVertBuf(layout, len(self.surface.midpoints))
        vertices.attr_fill("position", np.ascontiguousarray(self.positions(), np.float32))
        vertices.attr_fill("normal", np.ascontiguousarray(self.normals, np.float32))
        triangles = gpu.types.GPUIndexBuf(type="TRIS", seq=np.ascontiguousarray(self.surface.faces, np.int32))
        return gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=triangles)


def shader_of() -> Any:
    """The one shader of all previews."""
    if not _shader:
        _shader.append(new_shader())
    return _shader[0]


def forget_shader() -> None:
    """Free it."""
    _shader.clear()


def new_shader() -> Any:
    """One colour, lit from the eye."""
    import gpu

    between = gpu.types.GPUStageInterfaceInfo("ctmc_preview")
    between.smooth("VEC3", "shade")
    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "place")
    info.push_constant("MAT3", "turn")
    info.push_constant("VEC4", "paint")
    info.vertex_in(0, "VEC3", "position")
    info.vertex_in(1, "VEC3", "normal")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(VERTEX)
    info.fragment_source(FRAGMENT)
    return gpu.shader.create_from_info(info)
