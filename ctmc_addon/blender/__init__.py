"""A surface in the Blender file, and out of it.

Every function takes the object or the scene it works on; none reads the context.
"""

from .export import SUFFIXES, export, writer_of
from .figure.compose import Cell, Look, Shown
from .figure.page import Page
from .figure.render import figure_steps, render_figure, require_png
from .figure.sheet import Compared, Comparison, deviation_figure_steps, holds_others, sheet_steps
from .figure.styles import ENGINES, STYLES, require_engine
from .figure.turntable import Turn, finished_film, is_film, require_turntable, turntable_steps
from .import_mesh import MESH_SUFFIXES, read_mesh
from .materials import colour_of
from .rotation import timing as turntable
from .rotation.offscreen import can_draw
from .studio import prepare_scene
from .surface.decimate import decimated
from .surface.deviation import Deviation, Reference, deviation
from .surface.evaluate import evaluated_triangles
from .surface.objects import (
    add_reconstruction,
    make_final,
    refresh_normals,
    remembered,
    surface_mesh,
    update_reconstruction,
)

__all__ = [
    "ENGINES",
    "MESH_SUFFIXES",
    "STYLES",
    "SUFFIXES",
    "Cell",
    "Compared",
    "Comparison",
    "Deviation",
    "Look",
    "Page",
    "Reference",
    "Shown",
    "Turn",
    "add_reconstruction",
    "can_draw",
    "colour_of",
    "decimated",
    "deviation",
    "deviation_figure_steps",
    "evaluated_triangles",
    "export",
    "figure_steps",
    "finished_film",
    "holds_others",
    "is_film",
    "make_final",
    "prepare_scene",
    "read_mesh",
    "refresh_normals",
    "remembered",
    "render_figure",
    "require_engine",
    "require_png",
    "require_turntable",
    "sheet_steps",
    "surface_mesh",
    "turntable",
    "turntable_steps",
    "update_reconstruction",
    "writer_of",
]
