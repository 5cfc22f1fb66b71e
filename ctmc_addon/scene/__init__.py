"""A surface in the Blender file, and out of it.

Every function takes the object or the scene it works on; none reads the context.
"""

from . import turntable
from .decimate import decimated
from .deviation import Deviation, Reference, deviation
from .evaluate import evaluated_triangles
from .export import SUFFIXES, export, writer_of
from .figures import render_figure
from .gpu_drawing import can_draw
from .imports import MESH_SUFFIXES, read_mesh
from .stage import prepare_scene
from .surfaces import add_reconstruction, make_final, refresh_normals, remembered, update_reconstruction

__all__ = [
    "MESH_SUFFIXES",
    "SUFFIXES",
    "Deviation",
    "Reference",
    "add_reconstruction",
    "can_draw",
    "decimated",
    "deviation",
    "evaluated_triangles",
    "export",
    "make_final",
    "prepare_scene",
    "read_mesh",
    "refresh_normals",
    "remembered",
    "render_figure",
    "turntable",
    "update_reconstruction",
    "writer_of",
]
