# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the live preview on the graphics card: no object, no mesh, nothing to undo, save or clean up.

Positions are Blender units in world space.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import Surface
from ...core.mesh import blend, vertex_normals
from .shaders import WHOLE, draw_surface, new_batch


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
        """Show the surface at another alpha."""
        if alpha != self.alpha:
            self.alpha, self.batch = alpha, None

    def positions(self) -> NDArray[np.float32]:
        """Return the vertices at the present alpha, Blender units."""
        mixed = blend(self.surface.midpoints, self.surface.linear, self.alpha)
        mixed *= np.float32(self.scale)
        return mixed

    def draw(
        self,
        matrix: Any,
        view: Any,
        color: tuple[float, float, float],
        plane: tuple[float, float, float, float] = WHOLE,
    ) -> None:
        """Draw it among the scene's objects with perspective `matrix` and view matrix `view`, up to a plane."""
        if self.batch is None:
            self.batch = new_batch(self.positions(), self.normals, self.surface.faces)
        draw_surface(self.batch, matrix, view.to_3x3(), color, plane)
