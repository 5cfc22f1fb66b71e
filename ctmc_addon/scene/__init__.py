"""A surface in the Blender file, and out of it.

Every function takes the object or the scene it works on; none reads the context.
"""

from . import turntable
from .compose import Cell, Look, Shown
from .decimate import decimated
from .deviation import Deviation, Reference, deviation
from .evaluate import evaluated_triangles
from .export import SUFFIXES, export, writer_of
from .figures import figure_steps, render_figure, require_png
from .film import Turn, finished_film, is_film, require_turntable, turntable_steps
from .gpu_drawing import can_draw
from .imports import MESH_SUFFIXES, read_mesh
from .looks import ENGINES, STYLES, require_engine
from .materials import colour_of
from .page import Page
from .stage import prepare_scene
from .surfaces import add_reconstruction, make_final, refresh_normals, remembered, surface_mesh, update_reconstruction
from .variations import Compared, Comparison, deviation_figure_steps, holds_others, sheet_steps

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
