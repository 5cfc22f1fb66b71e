"""A surface in the Blender file, and out of it.

Every function takes the object or the scene it works on; none reads the context. Nothing is imported here, so that
`figure.spec` can be asked without Blender.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

MODULES = {
    "export": "SUFFIXES export",
    "figure.spec": "Cell Comparison ENGINES Page STYLES Turn FigureStyle ShownSurface",
    "figure.render": "figure_steps render_figure require_png",
    "figure.sheet": "Compared deviation_figure_steps holds_others sheet_steps",
    "figure.styles": "require_engine",
    "figure.turntable": "is_finished_video is_video require_turntable turntable_steps",
    "import_mesh": "MESH_SUFFIXES read_mesh",
    "colors": "color_of",
    "rotation": "can_draw",
    "studio": "prepare_scene",
    "surface.decimate": "decimated",
    "surface": "add_reconstruction refresh_normals surface_mesh update_reconstruction evaluated_triangles",
    "surface.provenance": "remembered",
}
OLD = {
    "colour_of": "color_of",
    "Look": "FigureStyle",
    "Shown": "ShownSurface",
    "finished_film": "is_finished_video",
    "is_film": "is_video",
}


def __getattr__(name: str) -> Any:
    """The names that were here before callers imported the modules, loaded with the first of them."""
    if name.startswith("__"):
        raise AttributeError(name)
    for module, names in MODULES.items():
        loaded = import_module(f".{module}", __name__)
        globals().update({one: getattr(loaded, one) for one in names.split()})
    globals()["turntable"] = import_module(".rotation", __name__)
    globals()["make_final"] = import_module(".surface", __name__).apply_shape_and_modifiers
    globals().update({old: globals()[new] for old, new in OLD.items()})
    if name not in globals():
        raise AttributeError(name)
    return globals()[name]
