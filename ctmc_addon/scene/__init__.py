"""A surface in the Blender file, and out of it.

Every function takes the object or the scene it works on; none reads the context.
"""

from .decimate import decimated
from .deviation import Deviation, Reference, deviation
from .evaluate import evaluated_triangles
from .export import SUFFIXES, export, writer_of
from .figures import render_figure
from .stage import prepare_scene
from .surfaces import add_reconstruction, make_final, refresh_normals, remembered, update_reconstruction

__all__ = [
    "SUFFIXES",
    "Deviation",
    "Reference",
    "add_reconstruction",
    "decimated",
    "deviation",
    "evaluated_triangles",
    "export",
    "make_final",
    "prepare_scene",
    "refresh_normals",
    "remembered",
    "render_figure",
    "update_reconstruction",
    "writer_of",
]
