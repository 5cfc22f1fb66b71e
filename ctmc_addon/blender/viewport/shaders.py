# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw triangles of one color, lit from the eye, on the graphics card or its software stand-in.

`gpu` exists only where Blender draws, so it is imported where something is drawn.
"""

from __future__ import annotations

import sys
from ctypes.util import find_library
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

VERTEX = """
void main() {
    shade = normal;
    beyond = dot(plane, vec4(position, 1.0));
    gl_Position = projection * vec4(position, 1.0);
}"""
# Lit from the eye, whose direction is all that is needed of the view's rotation: 128 bytes of constants are what every
# graphics card has. Lit on both sides: a surface cut off at the border shows its inside.
FRAGMENT = """
void main() {
    if (beyond > 0.0) { discard; }
    shown = vec4(color.rgb * (0.18 + 0.72 * abs(dot(normalize(shade), eye))), 1.0);
}"""
WHOLE = (0.0, 0.0, 0.0, 0.0)  # A plane with nothing beyond it.
SOFTWARE = ("llvmpipe", "softpipe", "swiftshader", "software", "basic render", "gdi generic")
"""Parts of the names of drivers that draw on the processor."""
_shader: list[Any] = []


def can_draw() -> bool:
    """Return whether Blender can draw here; on Linux without a window and EGL, trying would end the process."""
    return not sys.platform.startswith("linux") or not bpy.app.background or find_library("EGL") is not None


def draws_in_software() -> bool:
    """Return whether the processor draws, because there is no graphics card; False if Blender does not know."""
    import gpu

    try:
        name = gpu.platform.renderer_get().lower()
    except SystemError:  # In the background, before anything was drawn.
        return False
    return any(word in name for word in SOFTWARE)


def new_batch(positions: NDArray[np.float32], normals: NDArray[np.float32], faces: NDArray[np.int32]) -> Any:
    """Return triangles on the graphics card.

    Parameters
    ----------
    positions : (V, 3) float32
    normals : (V, 3) float32
    faces : (F, 3) int32
    """
    import gpu

    layout = gpu.types.GPUVertFormat()
    for name in ("position", "normal"):
        layout.attr_add(id=name, comp_type="F32", len=3, fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(positions))
    vertices.attr_fill("position", np.ascontiguousarray(positions, np.float32))
    vertices.attr_fill("normal", np.ascontiguousarray(normals, np.float32))
    triangles = gpu.types.GPUIndexBuf(type="TRIS", seq=np.ascontiguousarray(faces, np.int32))
    return gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=triangles)


def draw_surface(
    batch: Any,
    projection: Any,
    view_rotation: Any,
    color: tuple[float, float, float],
    plane: tuple[float, float, float, float] = WHOLE,
) -> None:
    """Draw a batch into the scene; nearer objects hide it.

    Parameters
    ----------
    projection : Matrix
        4 x 4, from the batch's space to the picture.
    view_rotation : Matrix
        3 x 3, from the normals' space to the eye's.
    plane : (a, b, c, d)
        Points with a x + b y + c z + d above 0 in the batch's space are left out.
    """
    import gpu

    shader = _surface_shader()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    shader.bind()
    shader.uniform_float("projection", projection)
    shader.uniform_float("eye", view_rotation[2])
    shader.uniform_float("color", (*color, 1.0))
    shader.uniform_float("plane", plane)
    batch.draw(shader)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")


def _surface_shader() -> Any:
    """Return the shader, which is made once while Blender draws."""
    if not _shader:
        import gpu

        between = gpu.types.GPUStageInterfaceInfo("ctmc_surface")
        between.smooth("VEC3", "shade")
        between.smooth("FLOAT", "beyond")
        info = gpu.types.GPUShaderCreateInfo()
        info.push_constant("MAT4", "projection")
        info.push_constant("VEC3", "eye")
        info.push_constant("VEC4", "color")
        info.push_constant("VEC4", "plane")
        info.vertex_in(0, "VEC3", "position")
        info.vertex_in(1, "VEC3", "normal")
        info.vertex_out(between)
        info.fragment_out(0, "VEC4", "shown")
        info.vertex_source(VERTEX)
        info.fragment_source(FRAGMENT)
        _shader.append(gpu.shader.create_from_info(info))
    return _shader[0]


def free_shader() -> None:
    """Free the shader."""
    _shader.clear()
